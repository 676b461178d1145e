"""Structures: sections, matrices, supports, modes, damping laws and what they refuse."""

import math

import numpy as np
import pytest

from jointbayes.frf import DirectSolve, Ports
from jointbayes.structure import LossFactor, ModalDamping, Section, beam
from tests.conftest import CLAMP, STEEL, TABLE_3, pair_matrix, rod
from tests.vibrecords.rod import free_rod, receptance


def test_sections_have_textbook_area_and_second_moments():
    tube = Section.tube(0.04, 0.03)
    assert tube.area == pytest.approx(math.pi / 4 * (0.04**2 - 0.03**2))
    assert tube.inertia_z == pytest.approx(math.pi / 64 * (0.04**4 - 0.03**4))
    bar = Section.rectangle(width=0.02, height=0.05)
    assert (bar.inertia_z, bar.inertia_y) == pytest.approx((0.02 * 0.05**3 / 12, 0.05 * 0.02**3 / 12))
    box = Section.box(0.02, 0.05, 0.002)
    assert box.area == pytest.approx(0.02 * 0.05 - 0.016 * 0.046)
    assert box.inertia_z == pytest.approx((0.02 * 0.05**3 - 0.016 * 0.046**3) / 12)


def test_cowper_shear_coefficients():
    nu = 0.3
    for section, kappa, rel in (
        (Section.circle(1.0), 6 * (1 + nu) / (7 + 6 * nu), 1e-12),
        (Section.rectangle(1.0, 2.0), 10 * (1 + nu) / (12 + 11 * nu), 1e-12),
        # a very thin tube and a very thin square box tend to Cowper's thin-walled formulas
        (Section.tube(1.0, 1 - 1e-6), 2 * (1 + nu) / (4 + 3 * nu), 1e-5),
        (Section.box(1.0, 1.0, 1e-6), 20 * (1 + nu) / (48 + 39 * nu), 1e-9),
    ):
        assert section.shear_coefficient(nu) == pytest.approx((kappa, kappa), rel=rel)
    # Cowper (1966), thin-walled box, sides at mid-wall: n = flange over web, m = n as the walls are of one thickness
    for found, n in zip(Section.box(0.08, 0.12, 0.002).shear_coefficient(nu), (78 / 118, 118 / 78), strict=True):
        web = (12 + 72 * n + 150 * n**2 + 90 * n**3) + nu * (11 + 66 * n + 135 * n**2 + 90 * n**3)
        flange = 10 * n**2 * ((3 + nu) * n + 3 * n**2)
        assert found == pytest.approx(10 * (1 + nu) * (1 + 3 * n) ** 2 / (web + flange), rel=1e-9)


def test_a_flat_box_shears_more_easily_across_its_flat_side():
    # webs carry shear: a tall narrow box has more of them along y than along z
    along_y, along_z = Section.box(width=0.02, height=0.06, wall=0.001).shear_coefficient(0.3)
    assert along_y > along_z


def test_rigid_body_motion_costs_no_energy_and_moves_the_whole_mass():
    free = rod()
    x = np.linspace(0, 0.383, 11)
    translation = np.tile([1.0, 0.0], 11)
    rotation = np.stack([x, np.ones(11)], axis=-1).ravel()
    mass = 7800 * math.pi / 4 * 0.025**2 * 0.383
    scale = np.abs(free.stiffness).max()
    for motion in (translation, rotation):
        assert np.abs(free.stiffness @ motion).max() < 1e-12 * scale
    assert translation @ free.mass @ translation == pytest.approx(mass, rel=1e-12)
    # about the centre: m L²/12 plus rotary inertia of the section, ρ I L
    about_centre = rotation - 0.383 / 2 * translation
    inertia = mass * 0.383**2 / 12 + 7800 * math.pi / 64 * 0.025**4 * 0.383
    assert about_centre @ free.mass @ about_centre == pytest.approx(inertia, rel=1e-12)


def test_an_upright_section_bends_less_in_its_stiff_plane():
    flat = beam(0.4, Section.rectangle(0.03, 0.01), STEEL, ModalDamping((0.0,)), dofs_per_node=5)
    tip, root = flat.index(["11:y", "11:z"]), [f"1:{d}" for d in ("x", "y", "z", "ry", "rz")]
    fixed = flat.fixed(root)
    static = np.linalg.inv(fixed.stiffness)
    y, z = fixed.index(["11:y"])[0], fixed.index(["11:z"])[0]
    kappa_y, kappa_z = Section.rectangle(0.03, 0.01).shear_coefficient(0.3)
    shear = 0.4 / (kappa_y * STEEL.shear_modulus * 0.03 * 0.01)
    assert kappa_y == kappa_z
    assert tip.size == 2
    assert static[y, y] == pytest.approx(0.4**3 / (3 * 2.1e11 * 0.03 * 0.01**3 / 12) + shear, rel=1e-8)
    assert static[z, z] == pytest.approx(0.4**3 / (3 * 2.1e11 * 0.01 * 0.03**3 / 12) + shear, rel=1e-8)
    # a force along +z turns the section by ry = -dw/dx
    assert static[fixed.index(["11:ry"])[0], z] < 0 < static[fixed.index(["11:rz"])[0], y]


def test_modes_are_mass_normalised_and_satisfy_the_eigenproblem():
    clamped = rod().fixed(["1:y", "1:rz"])
    modes = clamped.modes()
    np.testing.assert_allclose(modes.shapes.T @ clamped.mass @ modes.shapes, np.eye(20), atol=1e-8)
    left, right = clamped.stiffness @ modes.shapes[:, :5], clamped.mass @ modes.shapes[:, :5] * modes.eigenvalues[:5]
    np.testing.assert_allclose(left, right, atol=1e-7 * np.abs(left).max())


def test_modal_ratios_repeat_the_last_one():
    law = ModalDamping((0.01, 0.02))
    assert (law.per_mode(4).tolist(), law.per_mode(1).tolist()) == ([0.01, 0.02, 0.02, 0.02], [0.01])


# the rod that the tests of vibrecords bring along is the rod of jointbayes, computed another way

LINES, DOFS = np.linspace(20.0, 2500.0, 50), ("11:y", "5:y", "1:rz")


def test_both_rods_have_the_matrices_of_one_element_and_the_frfs_of_either_damping():
    ours, (stiffness, mass) = rod(), free_rod()
    for matrix, theirs in ((ours.stiffness, stiffness), (ours.mass, mass)):
        np.testing.assert_allclose(matrix, theirs, rtol=1e-9, atol=1e-12 * np.abs(theirs).max())
    for law, options in ((None, {}), (LossFactor(0.02), {"loss_factor": 0.02})):
        model = DirectSolve(rod(damping=law), CLAMP, Ports(LINES, DOFS, DOFS[:2]))
        found = receptance(LINES, DOFS, DOFS[:2], **options)
        np.testing.assert_allclose(found, model.receptance(pair_matrix(TABLE_3))[0], rtol=1e-5)
