"""A beam is a frame of one member: its matrices are those of elements integrated here from their shape functions."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import Polynomial, legendre
from numpy.testing import assert_allclose

from jointbayes.frf import DirectSolve, NaturalFrequencies, Ports, receptance_model
from jointbayes.structure import BeamFamily, BeamMaterial, BeamRecipe, LossFactor, ModalDamping, Section, beam
from jointbayes.structure.frame_recipe import ACCURACY, MANY, BodyMesh, element_error
from jointbayes.structure.matrices import Reduction, Structure
from tests.conftest import CLAMP, STEEL, TABLE_3, pair_matrix

PAIR = pair_matrix(TABLE_3)
#: Converged Timoshenko beam with Table 3's joint, computed elsewhere to more digits than these, Hz.
CONVERGED = [121.5355, 752.3930, 2063.7317, 3927.7317, 6266.2214]
SECTIONS = [Section.circle(0.025), Section.rectangle(0.04, 0.012), Section.box(0.03, 0.04, 0.002)]
AT, WEIGHT = legendre.leggauss(16)
AT, WEIGHT = (AT + 1) / 2, WEIGHT / 2  # on an element of unit length


def recipe(**more):
    given = {"length": 0.383, "section": SECTIONS[0], "material": STEEL, "damping": ModalDamping((0.01,))} | more
    return BeamRecipe(**given)


# the route of its own


def lagrange(order):
    """Values and slopes (2, p + 1, 16) of the polynomials that are 1 at one Gauss-Lobatto-Legendre point each."""
    points = np.array([-1.0, *np.sort(legendre.Legendre.basis(order).deriv().roots().real), 1.0])
    points = (points + 1) / 2
    out = np.zeros((2, order + 1, AT.size))
    for i, own in enumerate(points):
        others = np.delete(points, i)
        factors = (AT - others[:, None]) / (own - others)[:, None]
        out[0, i] = factors.prod(axis=0)
        out[1, i] = sum(np.delete(factors, k, 0).prod(axis=0) / (own - others[k]) for k in range(order))
    return out


def static_shapes(length, bending, shear):
    """Deflection and rotation that loads at the ends of a Timoshenko beam leave, each as `lagrange` gives its own."""
    x = Polynomial([0.0, length])  # of the share of the length
    # constant shear force: θ = a + b x + c x², v' − θ = −2 c EI/κGA
    rotations = [0 * x, x**0, x, x**2]
    deflections = [x**0, x, x**2 / 2, x**3 / 3 - 2 * bending / shear * x]
    ends = [[f(s) for s in (0, 1) for f in pair] for pair in zip(deflections, rotations, strict=True)]
    of_ends = np.linalg.inv(ends)  # each row makes one of the four motions of the ends 1
    return (
        np.array([of_ends @ [f(AT) for f in each], of_ends @ [f.deriv()(AT) for f in each]])
        for each in (deflections, rotations)
    )


def plane_element(length, order, bending, shear, mass, rotary):
    """Stiffness and mass for (v, θ) at each node in turn, from ½∫EI θ'² + κGA (v' − θ)² and ½∫ρA v² + ρI θ²."""
    if order:
        v, theta = np.zeros((2, 2, 2 * (order + 1), AT.size))
        v[:, ::2] = theta[:, 1::2] = lagrange(order)
    else:
        v, theta = static_shapes(length, bending, shear)

    def integrated(functions):
        return length * (functions * WEIGHT) @ functions.T

    stiffness = bending * integrated(theta[1] / length) + shear * integrated(v[1] / length - theta[0])
    return stiffness, mass * integrated(v[0]) + rotary * integrated(theta[0])


def matrices(made, mesh):
    """Stiffness and mass of a beam, assembled here from the lengths and orders of its elements."""
    section, material, n = made.section, made.material, made.dofs_per_node
    e, g, rho, area = material.youngs_modulus, material.shear_modulus, material.density, section.area
    cowper = section.shear_coefficient(material.poissons_ratio)
    along_y, along_z = (made.shear_coefficient or kappa for kappa in cowper)
    in_plane = (1, 4) if n == 5 else (0, 1)
    planes = [(section.inertia_z, along_y, in_plane, 1.0), (section.inertia_y, along_z, (2, 3), -1.0)]
    each = [
        (segment.stretch.length / count, order)
        for segment, (count, order) in zip(mesh[0].segments, mesh[0].elements, strict=True)
        for _ in range(count)
    ]
    nodes = 1 + sum(max(order, 1) for _, order in each)
    out, first = np.zeros((2, n * nodes, n * nodes)), 0
    for length, order in each:
        here = n * (first + np.arange(max(order, 1) + 1))
        for inertia, kappa, (v, t), sign in planes[: 1 if n == 2 else 2]:
            rows = np.stack([here + v, here + t], axis=-1).ravel()
            turn = np.tile([1.0, sign], len(here))  # ry = −∂w/∂x
            parts = plane_element(length, order, e * inertia, kappa * g * area, rho * area, rho * inertia)
            for whole, part in zip(out, parts, strict=True):
                whole[np.ix_(rows, rows)] += part * np.outer(turn, turn)
        if n == 5:
            value, slope = lagrange(max(order, 1))
            out[0][np.ix_(here, here)] += e * area / length * (slope * WEIGHT) @ slope.T
            out[1][np.ix_(here, here)] += rho * area * length * (value * WEIGHT) @ value.T
        first += max(order, 1)
    return out


def relative(found, expected):
    """Largest deviation of entries, each relative to the diagonal's."""
    return np.abs((found - expected) / np.sqrt(np.outer(np.diag(expected), np.diag(expected)))).max()


@pytest.mark.parametrize(("section", "kappa"), [(0, None), (0, 0.8), (1, 0.8), (2, None)])
@pytest.mark.parametrize("dofs_per_node", [2, 5])
@pytest.mark.parametrize(("element", "used"), [("paper", None), ("converged", None), ("converged", ("11:y", "4:rz"))])
def test_matrices_are_those_of_its_elements_integrated_here(section, kappa, dofs_per_node, element, used):
    more = {"shear_coefficient": kappa, "dofs_per_node": dofs_per_node, "element": element}
    made = recipe(section=SECTIONS[section], **more)
    mesh = made.mesh(used, 4000.0)
    found, (stiffness, mass) = made.structure(mesh=mesh), matrices(made, mesh)
    assert relative(found.stiffness, stiffness) < 1e-12
    assert relative(found.mass, mass) < 1e-12
    by_hand = Structure(stiffness, mass, made.damping, found.dofs)
    frequency = by_hand.modes().frequency_hz
    assert_allclose(found.modes().frequency_hz[:12], frequency[:12], rtol=1e-9)
    ports = Ports(np.arange(20.0, 4000.0, 83.0), ("11:y", "11:rz", "4:y"), ("11:y", "1:rz"))
    one, other = (DirectSolve(each, CLAMP, ports).receptance(PAIR)[0] for each in (found, by_hand))
    assert_allclose(one, other, atol=1e-9 * np.abs(other).max())
    named = [label for label in found.dofs if "~" not in label]
    directions = {2: ("y", "rz"), 5: ("x", "y", "z", "ry", "rz")}[dofs_per_node]
    points = range(1, 12) if used is None else (1, 4, 11)
    assert named == [f"{point}:{direction}" for point in points for direction in directions]
    assert found.position("4:y") == pytest.approx((0.3 * 0.383, 0, 0))


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
        shear_coefficient=0.93 * SECTIONS[0].shear_coefficient(0.3)[0],
    )  # fmt: skip
    same = tuple(BodyMesh(of_body.segments, mesh[0].elements) for of_body in stated.mesh())
    stiffness, mass = matrices(stated, same)
    labels = stated.structure(mesh=same).dofs
    at = ["1:y", *labels].index("11:y")
    mass[at, at] += 1.2 * 0.01 + 0.003  # an accelerometer sits at translations alone
    found = made.structure(factors, mesh)
    assert relative(found.stiffness, stiffness[1:, 1:]) < 1e-12
    assert relative(found.mass, mass[1:, 1:]) < 1e-12
    assert found.dofs == labels
    assert found.damping.ratios == pytest.approx((0.013,))


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
