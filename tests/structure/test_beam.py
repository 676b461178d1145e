"""A beam is a frame of one member: its elements, its mesh, its quantities."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from jointbayes.frf import DirectSolve, NaturalFrequencies, Ports, receptance_model
from jointbayes.structure import (
    BeamFamily,
    BeamMaterial,
    BeamRecipe,
    FrameBody,
    FrameRecipe,
    LossFactor,
    Member,
    ModalDamping,
    Section,
    beam,
)  # fmt: skip
from jointbayes.structure.frame_recipe import ACCURACY, MANY, BodyMesh, element_error
from jointbayes.structure.matrices import Reduction
from tests.conftest import CLAMP, STEEL, TABLE_3, pair_matrix

PAIR = pair_matrix(TABLE_3)
#: Converged Timoshenko beam with Table 3's joint, computed elsewhere to more digits than these, Hz.
CONVERGED = [121.5355, 752.3930, 2063.7317, 3927.7317, 6266.2214]
SECTIONS = [Section.circle(0.025), Section.rectangle(0.04, 0.012), Section.box(0.03, 0.04, 0.002)]


def recipe(**more):
    given = {"length": 0.383, "section": SECTIONS[0], "material": STEEL, "damping": ModalDamping((0.01,))} | more
    return BeamRecipe(**given)


def relative(found, expected):
    """Largest deviation of entries, each relative to the diagonal's."""
    return np.abs((found - expected) / np.sqrt(np.outer(np.diag(expected), np.diag(expected)))).max()


@pytest.mark.parametrize(("section", "kappa"), [(0, None), (0, 0.8), (1, 0.8), (2, None)])
@pytest.mark.parametrize("dofs_per_node", [2, 5])
@pytest.mark.parametrize("element", ["paper", "converged"])
def test_a_beam_is_the_frame_of_one_member(section, kappa, dofs_per_node, element):
    """Frames are held against exact transfer matrices in `test_frame.py`."""
    ways = {2: ("y", "rz"), 5: ("x", "y", "z", "ry", "rz")}[dofs_per_node]
    at = range(1, 12) if element == "paper" else (1, 4, 11)
    points = {str(i): (0.0383 * (i - 1), 0, 0) for i in at}
    bar = Member(tuple(points), SECTIONS[section], STEEL, shear_coefficient=kappa)
    made = recipe(section=SECTIONS[section], shear_coefficient=kappa, dofs_per_node=dofs_per_node, element=element)
    frame = FrameRecipe(FrameBody(points, (bar,)), made.damping, ways, element=element)
    beams = [one.structure(mesh=one.mesh(("11:y", "4:y"), 4000.0)) for one in (made, frame)]
    ports = Ports(np.arange(20.0, 4000.0, 83.0), ("11:y", "11:rz", "4:y"), ("11:y", "1:rz"))
    one, other = (DirectSolve(each, CLAMP, ports).receptance(PAIR)[0] for each in beams)
    assert_allclose(one, other, rtol=1e-7, atol=1e-8 * np.abs(other).max())
    named = [label for label in beams[0].dofs if "~" not in label]
    assert named == [f"{point}:{way}" for point in at for way in ways]
    assert beams[0].position("4:y") == pytest.approx((0.3 * 0.383, 0, 0))


def test_the_papers_element_in_space_is_its_two_planes_and_a_rod():
    flat, upright = (Section.rectangle(*sides) for sides in ((0.04, 0.012), (0.012, 0.04)))
    space, xy, xz = (
        beam(0.383, section, STEEL, LossFactor(0.0), elements=2, dofs_per_node=count)
        for section, count in ((flat, 5), (flat, 2), (upright, 2))
    )
    flip = np.tile([1.0, -1.0], 3)  # ry = -dw/dx
    area, half = 0.04 * 0.012, 0.383 / 2
    rods = ((2.1e11 * area / half, [1, -1]), (7800 * area * half / 6, [2, 1]))
    for name, (size, (end, off)) in zip(("stiffness", "mass"), rods, strict=True):
        whole, turned = np.array(getattr(space, name)), getattr(xz, name) * np.outer(flip, flip)
        rod = size * np.array([[end, off, 0], [off, 2 * end, off], [0, off, end]])
        for at, expected in (((1, 4), getattr(xy, name)), ((2, 3), turned), ((0,), rod)):
            rows = np.array([5 * node + way for node in range(3) for way in at])
            assert_allclose(whole[np.ix_(rows, rows)], expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())
            whole[np.ix_(rows, rows)] = 0
        assert not whole.any()


@pytest.mark.parametrize("element", ["paper", "converged"])
def test_factors_make_the_beam_that_states_its_quantities_so_much_larger(element):
    made = recipe(element=element, supports=("1:y",), accelerometer_mass=0.01, accelerometer_dofs=("11:y", "6:rz"))
    made = replace(made, added_mass=0.003)
    length, mesh = 1.02 * 0.383 + 0.002, made.mesh()
    factors = {
        "youngs_modulus": 1.1, "density": 0.9, "length": 1.02, "length_offset": np.exp(0.002), "section_size": 1.03,
        "shear_coefficient": 0.93, "accelerometer_mass": 1.2, "damping_ratio": 1.3,
    }  # fmt: skip
    stated = replace(
        made, length=length, material=BeamMaterial(1.1 * 2.1e11, 0.3, 0.9 * 7800.0), section=Section.circle(0.02575),
        shear_coefficient=0.93 * SECTIONS[0].shear_coefficient(0.3)[0], accelerometer_mass=1.2 * 0.01,
    )  # fmt: skip
    bare = replace(stated, accelerometer_mass=0.0, added_mass=0.0)
    same = tuple(BodyMesh(of_body.segments, mesh[0].elements) for of_body in stated.mesh())
    found, expected, light = made.structure(factors, mesh), *(one.structure(mesh=same) for one in (stated, bare))
    assert relative(found.stiffness, expected.stiffness) < 1e-12
    assert relative(found.mass, expected.mass) < 1e-12
    assert found.dofs == expected.dofs
    assert found.damping.ratios == pytest.approx((0.013,))
    weighed = np.argwhere(expected.mass != light.mass)  # an accelerometer sits at translations alone
    assert weighed.tolist() == [[found.dofs.index("11:y")] * 2]
    assert (expected.mass - light.mass).max() == pytest.approx(0.015)


# how it is cut into elements


@pytest.mark.parametrize("elements", [1, 2, 10, 37])
def test_frequencies_are_those_of_the_converged_beam_whatever_points_are_numbered(elements):
    found = NaturalFrequencies(BeamFamily(recipe(elements=elements), {}), CLAMP, 5).frequency_hz(PAIR)[0]
    assert_allclose(found, CONVERGED, atol=6e-5)


def test_the_papers_element_is_as_coarse_as_it_was():
    family = BeamFamily(recipe(element="paper"), {})
    for count in (2, 5):
        made = recipe(element="paper", dofs_per_node=count).structure()
        same = beam(0.383, SECTIONS[0], STEEL, ModalDamping((0.01,)), dofs_per_node=count)
        np.testing.assert_array_equal([made.stiffness, made.mass], [same.stiffness, same.mass])
    error = NaturalFrequencies(family, CLAMP, 5).frequency_hz(PAIR)[0] / CONVERGED - 1
    assert_allclose(error, [5e-6, 1.8e-4, 1.3e-3, 4.6e-3, 1.1e-2], rtol=0.2, atol=5e-6)


def test_elements_end_at_the_points_that_matter_and_only_there():
    family = BeamFamily(recipe(elements=100), {}).at(("1:y", "1:rz", "101:y"), 2500.0)
    assert family.discretisation.elements <= 3
    assert {"1:y", "101:rz"} <= set(family.nominal.dofs)
    assert family.at(("1:y", "38:y"), 2500.0).nominal.position("38:y") == pytest.approx((0.37 * 0.383, 0, 0))
    for elements, richer in ((MANY, 1), (MANY - 1, 4)):  # between many points a reference says enough with one order
        family = BeamFamily(recipe(elements=elements), {})
        assert family.reference().discretisation.order == family.discretisation.order + richer


def test_the_bound_on_an_elements_error_is_kept_and_is_no_waste():
    made, omega = recipe(), 2 * np.pi * 2500.0
    ((count, order),) = made.mesh((), 2500.0)[0].elements
    assert element_error(made.whole.part(0, 1 / count), order, "xy", omega) <= ACCURACY
    assert element_error(made.whole.part(0, 1 / (count - 1)), order, "xy", omega) > ACCURACY


# reduced


@pytest.mark.parametrize("law", [ModalDamping((0.01,)), LossFactor(0.02)], ids=["modal", "loss factor"])
def test_reduced_models_predict_what_much_richer_ones_do(law):
    beams = BeamFamily(recipe(damping=law), {})
    ports = Ports(np.arange(20.0, 2500.0, 3.0), ("11:y", "6:y", "1:y", "1:rz"), ("11:y", "1:rz"))
    rng = np.random.default_rng(1)
    diagonal = 10 ** rng.uniform([5, 3], [11, 8], (20, 2))
    coupling = rng.uniform(-0.9, 0.9, 20) * np.sqrt(diagonal.prod(axis=1))
    joints = pair_matrix(np.column_stack([diagonal[:, 0], coupling, diagonal[:, 1]]))
    found = receptance_model(beams, CLAMP, ports).receptance(joints)
    exact = receptance_model(beams.reference(), CLAMP, ports).receptance(joints)
    error = np.abs(found - exact).max(axis=1) / np.abs(exact).max(axis=1)
    assert error[:, :2, 0].max() < 3e-8  # of translations that are measured
    assert error.max() < 1e-4  # of a stiff joint's own motion, which is small beside its parts


def test_a_reduction_keeps_the_modes_in_the_band_and_the_answer_of_all_others():
    structure = recipe().structure()
    modes, motions = structure.modes(), np.eye(structure.n_dofs)[:, structure.index(["1:y", "11:y"])]
    few = Reduction.below(2500.0, modes, motions).reduce(modes)
    assert few.eigenvalues.size < 15
    np.testing.assert_array_equal(few.eigenvalues[:5], modes.eigenvalues[:5])
    for omega in (0.0, 2 * np.pi * 1800.0):
        answers = []
        for one in (few, modes):
            elastic = one.eigenvalues > 1.0
            seen = motions.T @ one.shapes[:, elastic]
            answers.append(seen / (one.eigenvalues[elastic] - omega**2) @ seen.T)
        assert_allclose(*answers, rtol=1e-9)


def test_a_named_point_between_nodes_is_the_node_that_other_spans_have_there():
    length, damping = 0.383, LossFactor(0.02)
    between = (("mid", 0.45 * length), ("tip", 0.35 * length))
    node, named = recipe(elements=20, damping=damping), recipe(elements=3, damping=damping, points=between)
    assert list(named.positions) == ["1", "2", "tip", "mid", "3", "4"]
    assert named.positions["tip"] == pytest.approx(node.positions["8"])
    assert named.whole.length == length
    values = []
    for made, dofs in ((node, ("8:y", "21:y", "10:rz")), (named, ("tip:y", "4:y", "mid:rz"))):
        built = made.structure(mesh=made.mesh((*CLAMP.labels, *dofs), 3000.0))
        direct = DirectSolve(built, CLAMP, Ports(np.linspace(1.0, 3000.0, 200), dofs, dofs))
        values.append(direct.receptance(PAIR))
    assert_allclose(values[0], values[1], rtol=1e-6, atol=1e-9 * np.abs(values[0]).max())
