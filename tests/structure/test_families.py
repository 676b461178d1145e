"""Every kind of body whose quantities are uncertain, against the body built with each draw and solved densely."""

from dataclasses import replace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.frf import NaturalFrequencies, receptance_model
from jointbayes.structure import Rayleigh
from jointbayes.structure.shape_modes import ModeTable
from tests.conftest import STEEL, TABLE_3, pair_matrix
from tests.structure.dense import natural_hz, worst
from tests.structure.test_frame_family import BETWEEN, FLAT, LAWS, SPRINGS, two_bodies
from tests.structure.test_frame_family import PORTS as OF_TWO

CLAMP, PAIR, MODAL = jb.Joint(("1:y", "1:rz")), pair_matrix(TABLE_3), jb.ModalDamping((0.01, 0.02))
BEAM = {"youngs_modulus": 0.12, "density": 0.06, "length": 0.03}
MASS = {"accelerometer_mass": 0.02, "accelerometer_dofs": ("11:y",)}
TIP = jb.Ports(np.arange(20.0, 2500.0, 53.0), ("11:y", "6:y"), ("11:y",))
ALL = jb.Ports(np.linspace(20.0, 2500.0, 60), tuple(f"{n}:y" for n in range(2, 22)), ("21:y",))
PLANES = jb.Ports(np.arange(20.0, 2500.0, 61.0), ("5:y", "5:z"), ("5:y", "5:z"))
ROD = jb.Member(("root", "tip"), jb.Section.circle(0.025), STEEL)
BAR = jb.FrameBody({"root": (0, 0, 0), "tip": (0.36, 0, 0)}, (ROD,))
ROOT, END = (tuple(f"{point}:{way}" for way in ("x", "y", "rz")) for point in ("root", "tip"))
TAUT = {"supports": ("11:y",), "section": jb.Section.circle(0.012), "length": 1.0}
DEAR = ("with an accelerometer, ", "two planes", "two frames")


def beam(ranges, law=MODAL, ports=TIP, joint=CLAMP, matrix=PAIR, **stated):
    given = {"length": 0.383, "section": jb.Section.circle(0.025), "material": STEEL, "damping": law} | stated
    return jb.BeamFamily(jb.BeamRecipe(**given), both_ways(ranges)), joint, matrix, ports, ranges, 0.0


def both_ways(ranges):
    return {name: (-reach, reach) for name, reach in ranges.items()}


def taut(force):
    """A beam that its joint and a support hold under a force, of which the last is uncertain as well."""
    ranges = {"axial_force": 0.7, "youngs_modulus": 0.1, "density": 0.05, "length": 0.02, "section_size": 0.05}
    ports = jb.Ports(np.arange(11.0, 900.0, 37.0), ("6:y", "11:rz"), ("6:y",))
    matrix = np.array([[3e8, 2e5], [2e5, 4e5]])
    *made, _ = beam(ranges, jb.LossFactor(0.02), ports, matrix=matrix, axial_force=force, **TAUT)
    return *made, 900.0


def frames(ranges):
    recipe = two_bodies(accelerometer_mass=0.02, added_mass=0.01, accelerometer_dofs=("left.1:y", "right.3:y"))
    return jb.FrameFamily(recipe, both_ways(ranges)), BETWEEN, SPRINGS, OF_TWO, ranges, 2500.0


def bar(quantity):
    ranges = {"youngs_modulus": 0.06, "density": 0.03, quantity: 0.03}
    family = jb.FrameFamily(jb.FrameRecipe(BAR, jb.LossFactor(0.01), ("x", "y", "rz")), both_ways(ranges))
    return family, jb.Joint(ROOT), np.diag([1e8, 3e7, 1e4]), jb.Ports(TIP.frequency_hz, END, END), ranges, 2500.0


DAMPED = {
    "modal damping": (MODAL, {"damping_ratio_1": 2.3, "damping_ratio_2": 1.0}),
    "loss factor": (jb.LossFactor(0.01), {"loss_factor": 2.3}),
    "Rayleigh": (Rayleigh(1.0, 1e-6), {}),
}
FAMILIES = {
    **{name: beam(BEAM | ranges, law) for name, (law, ranges) in DAMPED.items()},
    **{
        f"with an accelerometer, {name}": beam(BEAM | ranges | {"accelerometer_mass": 0.6}, law, **MASS)
        for name, (law, ranges) in DAMPED.items()
    },
    "with an accelerometer of known mass": beam(BEAM, **MASS),
    "an offset of all lengths": beam({"length": 0.02, "length_offset": 0.012}, **MASS),
    "twenty responses": beam({"length": 0.03, "youngs_modulus": 0.1}, ports=ALL, elements=20),
    "two planes": beam({"length": 0.01}, ports=PLANES, dofs_per_node=5, elements=4),
    "compressed": taut(-9000.0),
    "tensioned": taut(30000.0),
    "bar, its length": bar("length"),
    "bar, its section": bar("section_size"),
    "two frames": frames({"youngs_modulus": 0.1, "density": 0.05, "left.length": 0.02, "right.youngs_modulus": 0.05}),
    "two frames, their sections": frames({"section_size": 0.03, "left.density": 0.05}),
    "two frames, one section": frames({"right.section_size": 0.02, "accelerometer_mass": 0.3}),
    "two frames, shear": frames({"left.shear_coefficient": 0.1, "left.length": 0.01, "left.density": 0.03}),
}


def marked(names):
    """Those that take a second are for .ci/run."""
    return [pytest.param(name, marks=[pytest.mark.science] * name.startswith(DEAR)) for name in names]


def draws(ranges, count, seed=1):
    reach = np.array(list(ranges.values()))
    return np.exp(np.random.default_rng(seed).uniform(-reach, reach, (count, len(reach))))


@pytest.mark.parametrize("name", marked(FAMILIES))
def test_receptances_are_those_of_the_body_assembled_with_these_quantities(name):
    family, joint, matrix, ports, ranges, top_hz = FAMILIES[name]
    assert worst(family, joint, matrix, ports, draws(ranges, 2), top_hz) < 1e-6


@pytest.mark.parametrize("name", marked([name for name in FAMILIES if not name.startswith("two")]))
def test_natural_frequencies_are_those_of_a_full_eigensolution_over_eight_decades_of_stiffness(name):
    family, joint, matrix, _, ranges, _ = FAMILIES[name]
    factors, size = draws(ranges, 6, 4), 10.0 ** np.random.default_rng(4).uniform(-1.5, 2.5, (6, len(matrix), 1))
    matrices = size * matrix * size.swapaxes(1, 2)
    found = NaturalFrequencies(family, joint, 3).frequency_hz(matrices, factors)
    fine = family.at(joint.dofs, 20e3)
    for row, each, hz in zip(factors, matrices, found, strict=True):
        built = fine.structure(row)
        if name == "compressed":  # so far that it has buckled: K has a negative eigenvalue
            expected = NaturalFrequencies(built, joint, 3).frequency_hz(each)[0]
        else:
            expected = natural_hz(built, joint, each, 3)
        np.testing.assert_allclose(hz, expected, rtol=1e-8 if name.startswith("bar") else 1e-7)


@pytest.mark.parametrize(("dofs_per_node", "height"), [(5, 0.01), (5, 0.025), (2, 0.01)])
def test_so_many_natural_frequencies_lie_below_the_frequency_that_is_taken_for_them(dofs_per_node, height):
    section = jb.Section.rectangle(0.035 - height, height)
    family, joint, *_ = beam({}, section=section, length=0.9, dofs_per_node=dofs_per_node)
    top = family.reach_hz(20)
    found = NaturalFrequencies(family, joint, 20).frequency_hz(np.diag([1e20, 1e18]))[0]
    assert 0 < found[-1] < top
    if dofs_per_node == 5:  # and not so far above that no mesh could reach it
        assert top < jb.BeamRecipe(0.9, section, STEEL, MODAL).whole.bending_frequency_hz(26) / 2


def test_more_than_sixty_modes_are_tabulated_too():
    ports = jb.Ports(np.arange(20.0, 9000.0, 451.0), ("11:y", "6:y"), ("11:y",))
    section = jb.Section.rectangle(0.02, 0.002)
    family, joint, *_ = beam({"length": 0.01}, ports=ports, section=section, length=0.9)
    dofs = (*joint.dofs, *ports.outputs)
    placed = family.at(dofs, ports.frequency_hz[-1])
    modes = placed.free_modes(placed.index(dofs), np.eye(4)).bodies[0].modes
    assert isinstance(modes, ModeTable)
    assert modes(np.zeros((1, 1)))[0].shape[1] > 60
    assert worst(family, joint, PAIR, ports, draws({"length": 0.01}, 2), ports.frequency_hz[-1]) < 1e-6


@pytest.mark.parametrize("name", ["modal damping", "an offset of all lengths", "bar, its length"])
def test_without_factors_the_family_is_its_nominal_structure(name):
    family, joint, matrix, ports, *_ = FAMILIES[name]
    found, exact = (receptance_model(one, joint, ports).receptance(matrix) for one in (family, family.nominal))
    np.testing.assert_allclose(found, exact, atol=1e-7 * np.abs(exact).max())


@pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
def test_two_bodies_with_a_joint_are_those_of_a_dense_solve(law):
    for stiffness in (SPRINGS, SPRINGS * 1e6):
        assert worst(jb.FrameFamily(two_bodies(law), {}), BETWEEN, stiffness, OF_TWO, np.empty((1, 0)), 2500.0) < 1e-7


def test_a_joint_beside_the_axis_moves_with_its_arm_whatever_the_length():
    """A form that mixes translation and rotation, as a joint with an offset has."""
    body = jb.FrameBody({1: (0, 0, 0), 11: (0.383, 0, 0)}, (jb.Member((1, 11), FLAT, STEEL),))
    frames = jb.FrameFamily(jb.FrameRecipe(body, LAWS[1], ("y", "rz")), {"length": (-0.02, 0.02)})
    beams = jb.BeamFamily(jb.BeamRecipe(0.383, FLAT, STEEL, LAWS[1]), {"length": (-0.02, 0.02)})

    def motions(family):
        out = np.zeros((family.nominal.n_dofs, 2))
        out[family.nominal.index(["1:y", "1:rz"]), 0] = 1.0, 0.05
        out[family.nominal.index(["11:y"]), 1] = 1.0
        return out

    for family in (frames, beams):
        near = family.at(("1:y", "11:y"), 1500.0)
        lam, rows = near.free_modes(np.arange(near.nominal.n_dofs), motions(near))(np.array([[1.015]]))
        exact = near.reference().at(("1:y", "11:y"), 1500.0)
        full, omega2 = exact.structure(np.array([1.015])).modes(), -((2 * np.pi * 500.0) ** 2)
        r = motions(exact).T @ full.shapes
        expected = (r / (full.eigenvalues - omega2)) @ r.T
        np.testing.assert_allclose((rows[0] / (lam[0] - omega2)) @ rows[0].T, expected, rtol=1e-7)


def test_no_mesh_shows_up_to_the_highest_frequency():
    family = jb.FrameFamily(two_bodies(LAWS[1]), {})
    ports = replace(OF_TWO, frequency_hz=np.arange(3000.0, 5000.0, 97.0))
    found, exact = (receptance_model(f, BETWEEN, ports).receptance(SPRINGS)[0] for f in (family, family.reference()))
    np.testing.assert_allclose(found, exact, atol=1e-7 * np.abs(exact).max())
