"""Elements of high order: exact below the frequency they are made for, whatever points a user numbers."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from jointbayes.errors import ModelError
from jointbayes.frf import NaturalFrequencies, Ports, receptance_model
from jointbayes.joint import Joint
from jointbayes.structure import BeamFamily, BeamMaterial, BeamRecipe, LossFactor, ModalDamping, Section, beam
from jointbayes.structure.beam_recipe import BeamShape, mesh_through
from jointbayes.structure.high_order import ACCURACY, element_error, node_positions, spans_between
from jointbayes.structure.matrices import Reduction
from tests.conftest import pair_matrix

STEEL = BeamMaterial(2.1e11, 0.3, 7800.0)
CLAMP = Joint(("1:y", "1:rz"))
TABLE_3 = pair_matrix([5.05e9, 3.44e7, 1.52e6])
#: Converged Timoshenko beam with Table 3's joint, computed elsewhere to more digits than these, Hz.
CONVERGED = [121.5355, 752.3930, 2063.7317, 3927.7317, 6266.2214]


def recipe(**more):
    return BeamRecipe(0.383, Section.circle(0.025), STEEL, ModalDamping((0.01,)), **more)


def plane(diameter=0.025):
    return BeamShape(0.383, Section.circle(diameter), STEEL).planes[0]


@pytest.mark.parametrize("elements", [1, 2, 10, 37])
def test_frequencies_are_those_of_the_converged_beam_whatever_points_are_numbered(elements):
    family = BeamFamily(recipe(elements=elements), {})
    found = NaturalFrequencies(family, CLAMP, 5).frequency_hz(TABLE_3)[0]
    assert_allclose(found, CONVERGED, atol=6e-5)


def test_the_papers_element_is_what_it_was():
    family = BeamFamily(recipe(element="paper"), {})
    same = beam(0.383, Section.circle(0.025), STEEL, ModalDamping((0.01,)))
    np.testing.assert_array_equal(family.nominal.stiffness, same.stiffness)
    np.testing.assert_array_equal(family.nominal.mass, same.mass)
    found = NaturalFrequencies(family, CLAMP, 5).frequency_hz(TABLE_3)[0]
    error = found / CONVERGED - 1
    assert_allclose(error, [5e-6, 1.8e-4, 1.3e-3, 4.6e-3, 1.1e-2], rtol=0.2, atol=5e-6)


def test_a_refined_two_node_mesh_converges_to_it():
    exact = NaturalFrequencies(BeamFamily(recipe(), {}), CLAMP, 3).frequency_hz(TABLE_3)[0]
    errors = []
    for elements in (20, 40):
        coarse = beam(0.383, Section.circle(0.025), STEEL, ModalDamping((0.01,)), elements=elements)
        errors.append(NaturalFrequencies(coarse, CLAMP, 3).frequency_hz(TABLE_3)[0] / exact - 1)
    assert_allclose(errors[0][1:] / errors[1][1:], 4.0, rtol=0.1)


def test_elements_end_at_the_points_that_matter_and_only_there():
    family = BeamFamily(recipe(elements=100), {}).at(("1:y", "1:rz", "101:y"), 2500.0)
    assert family.mesh.elements <= 3
    assert {"1:y", "101:rz"} <= set(family.nominal.dofs)
    family = family.at(("1:y", "38:y"), 2500.0)
    at = dict(zip(family.mesh.nodes, node_positions(family.mesh.spans), strict=True))
    assert at["38"] == pytest.approx(0.37)


def test_the_bound_on_an_elements_error_is_kept_and_is_no_waste():
    (span,) = spans_between([0.0, 0.383], [plane()], 2 * np.pi * 2500.0)
    length = span.length / span.elements
    assert element_error(length, span.order, plane(), 2 * np.pi * 2500.0) <= ACCURACY
    assert element_error(span.length / (span.elements - 1), span.order, plane(), 2 * np.pi * 2500.0) > ACCURACY


def test_a_frequency_that_no_beam_has_is_refused():
    with pytest.raises(ModelError, match="wavelength"):
        spans_between([0.0, 1.0], [plane()], 1e12)
    with pytest.raises(ModelError, match="above 0"):
        BeamShape(-1.0, Section.circle(0.025), STEEL)


@pytest.mark.parametrize("law", [ModalDamping((0.01,)), LossFactor(0.02)], ids=["modal", "loss factor"])
def test_reduced_models_predict_what_much_richer_ones_do(law):
    beams = BeamFamily(BeamRecipe(0.383, Section.circle(0.025), STEEL, law), {})
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
        elastic, kept = modes.eigenvalues > 1.0, few.eigenvalues > 1.0
        exact = (motions.T @ modes.shapes[:, elastic]) / (modes.eigenvalues[elastic] - omega**2)
        exact = exact @ (motions.T @ modes.shapes[:, elastic]).T
        found = (motions.T @ few.shapes[:, kept]) / (few.eigenvalues[kept] - omega**2)
        assert_allclose(found @ (motions.T @ few.shapes[:, kept]).T, exact, rtol=1e-9)


def test_five_dofs_at_a_node_are_two_planes_and_the_axis():
    whole = BeamFamily(recipe(dofs_per_node=5), {}).at(("1:y", "11:z"), 5000.0).nominal
    flat = BeamFamily(recipe(), {}).at(("1:y", "11:y"), 5000.0).nominal
    found = whole.modes().frequency_hz
    bending = flat.modes().frequency_hz
    bending = bending[bending > 1.0][:3]
    for frequency in bending:
        assert (np.abs(found / frequency - 1) < 1e-8).sum() == 2
    axial = np.sqrt(2.1e11 / 7800.0) / (2 * 0.383)
    assert np.abs(found / axial - 1).min() < 1e-8
    assert (found < 1e-3).sum() == 5


def test_a_mesh_serves_beams_of_any_length():
    shape = BeamShape(0.383, Section.circle(0.025), STEEL)
    mesh = mesh_through(shape, 11, (1, 11), 2500.0, 2)
    assert mesh.nodes[0] == "1"
    assert mesh.nodes[-1] == "11"
    assert sum(span.length for span in mesh.spans) == pytest.approx(1.0)
