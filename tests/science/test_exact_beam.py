"""The exact beam of benchmarks/exact_beam.py against closed forms, finite elements against it, and by themselves."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from benchmarks.exact_beam import ExactBeam, circle, rectangle, tube

import jointbayes as jb
from jointbayes.frf import AssembledShapes, DirectSolve, NaturalFrequencies, Ports
from jointbayes.structure import BeamRecipe, DampingLaw, LossFactor, ModalDamping, Rayleigh, Section, beam
from tests.conftest import CLAMP, CONFIGS, STEEL, TABLE_3, pair_matrix, rod
from tests.oracles import off_peak

LENGTH = 0.383
POINTS = {1: 0.0, 6: LENGTH / 2, 11: LENGTH}
BEAM = ExactBeam(LENGTH, circle(0.025, 0.3), 2.1e11, 0.3, 7800.0, POINTS, tuple(TABLE_3))
EI = 2.1e11 * BEAM.section.inertia
#: Of the lines below a frequency that is nearly zero: a static load.
STATIC_HZ = 1e-4


def test_frequencies_of_the_papers_beam_with_its_joint_are_the_checked_ones():
    # computed with p-version elements up to order 14, to all digits printed
    found = BEAM.modes(7000.0).omega / (2 * np.pi)
    np.testing.assert_allclose(found, [121.5355, 752.3930, 2063.7317, 3927.7317, 6266.2214], rtol=0, atol=5.1e-5)


def test_shear_coefficients_are_cowpers():
    assert circle(0.025, 0.3).shear_coefficient == pytest.approx(0.886364, abs=5e-7)
    assert tube(0.025, 0.0, 0.3) == circle(0.025, 0.3)
    assert tube(1.0, 0.999999, 0.3).shear_coefficient == pytest.approx(2 * 1.3 / (4 + 3 * 0.3), rel=1e-5)
    assert rectangle(0.02, 0.04, 0.0).shear_coefficient == pytest.approx(5 / 6)
    assert rectangle(0.02, 0.04, 0.3).shear_coefficient == pytest.approx(0.849673, abs=5e-7)
    assert rectangle(0.02, 0.04, 0.3).inertia == pytest.approx(0.02 * 0.04**3 / 12)


@pytest.mark.parametrize("points", [{1: 0.0, 2: 1.0}, {1: 0.0, 5: 0.01, 6: 0.5, 2: 1.0}])
def test_a_slender_clamped_beam_is_euler_bernoullis_cantilever(points):
    section = circle(1 / 3000, 0.3)
    bending = 2.1e11 * section.inertia
    clamp = (1e12 * bending, 0.0, 1e12 * bending)
    clamped = ExactBeam(1.0, section, 2.1e11, 0.3, 7800.0, points, clamp)
    roots = np.array([1.8751040687119611, 4.694091132974175, 7.854757438237613, 10.995540734875467])
    expected = roots**2 * np.sqrt(bending / (7800.0 * section.area))
    found = clamped.modes(1.1 * expected[-1] / (2 * np.pi)).omega
    # what shear and rotary inertia leave falls with the square of diameter over length
    np.testing.assert_allclose(found, expected, rtol=4e-6)
    assert (found < expected).all()


@pytest.mark.parametrize("at_joint", [(1, 1.0), (6, 0.5), (11, 0.0)])
def test_static_compliance_of_the_tip_is_that_of_bending_shear_and_joint(at_joint):
    point, share = at_joint
    one = replace(BEAM, joint_point=point, points=POINTS | {2: 0.1})
    arm = share * LENGTH
    c11, c12, _, c22 = np.linalg.inv(pair_matrix(TABLE_3)).ravel()
    shear = BEAM.section.shear_coefficient * 2.1e11 / 2.6 * BEAM.section.area
    tip = arm**3 / (3 * EI) + arm / shear + c11 + 2 * c12 * arm + c22 * arm**2
    slope = arm**2 / (2 * EI) + c12 + c22 * arm
    found = one.receptance([STATIC_HZ], ["11:y", "11:rz"], ["11:y"])[0, :, 0]
    np.testing.assert_allclose(found, [tip, slope], rtol=1e-9)


def test_receptances_are_reciprocal_and_do_not_depend_on_where_the_spans_end():
    lines = np.array([0.1, 20.0, 121.5, 2500.0, 60e3])
    labels = ["1:y", "1:rz", "6:y", "6:rz", "11:y", "11:rz"]
    values = BEAM.receptance(lines, labels, labels, loss_factor=0.02)
    np.testing.assert_allclose(values, values.swapaxes(1, 2), rtol=0, atol=1e-9 * np.abs(values).max())
    finer = replace(BEAM, points=POINTS | {n: 0.0031 * n for n in (2, 3, 4, 5, 80)})
    again = finer.receptance(lines, labels, labels, loss_factor=0.02)
    np.testing.assert_allclose(again, values, rtol=1e-9)


AT = ["11:y", "6:y", "6:rz", "1:rz"], ["11:y", "6:rz"]


def _finite_elements(elements: int, law: DampingLaw, lines: np.ndarray, mass: float = 0.0) -> np.ndarray:
    """Receptances of jointbayes at (tip, middle, middle's and joint's rotation) × (tip, middle's rotation)."""
    middle, end = elements // 2 + 1, elements + 1
    loaded = {"accelerometer_mass": mass, "accelerometer_dofs": (f"{end}:y", f"{middle}:y"), "element": "paper"}
    recipe = BeamRecipe(LENGTH, Section.circle(0.025), STEEL, law, elements, **loaded)
    ports = Ports(lines, (f"{end}:y", f"{middle}:y", f"{middle}:rz", "1:rz"), (f"{end}:y", f"{middle}:rz"))
    return DirectSolve(recipe.structure(), CLAMP, ports).receptance(pair_matrix(TABLE_3))[0]


def _exact(law: DampingLaw, lines: np.ndarray, mass: float = 0.0) -> np.ndarray:
    loaded = replace(BEAM, masses={11: mass, 6: mass} if mass else {})
    if isinstance(law, ModalDamping):
        return loaded.modal_receptance(lines, *AT, law.ratios)
    return loaded.receptance(lines, *AT, **asdict(law))


LAWS = [ModalDamping((0.02, 0.01)), LossFactor(0.02), Rayleigh(10.0, 2e-6)]


@pytest.mark.parametrize(
    ("law", "mass"),
    [(LAWS[0], 0.0), (LAWS[1], 0.05), *(pytest.param(law, 0.0, marks=pytest.mark.science) for law in LAWS[1:])],
)
def test_finite_elements_converge_to_the_exact_receptances(law, mass):
    lines = np.linspace(20.0, 2500.0, 60)
    exact = _exact(law, lines, mass)
    coarse, fine = (_finite_elements(n, law, lines, mass) for n in (50, 100))
    errors = [np.abs(found - exact).max(axis=0) / np.abs(exact).max(axis=0) for found in (coarse, fine)]
    # all eight, cross receptances and rotations with their signs included
    assert (errors[1] < 1e-3).all()
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), 2.0, atol=0.1)
    # what is left of the leading error falls with the fourth power of the length
    assert off_peak((4 * fine - coarse) / 3, exact) < 2e-5


def test_another_shear_coefficient_or_a_flipped_coupling_would_be_noticed():
    lines, law = np.linspace(20.0, 2500.0, 60), LAWS[1]
    fine, exact = _finite_elements(100, law, lines), _exact(law, lines)
    for wrong in (
        replace(BEAM, section=replace(BEAM.section, shear_coefficient=0.9)),
        replace(BEAM, stiffness=(TABLE_3[0], -TABLE_3[1], TABLE_3[2])),
    ):
        assert off_peak(wrong.receptance(lines, *AT, loss_factor=0.02), fine) > 10 * off_peak(exact, fine)


# the paper's elements against checked numbers, closed forms and their own refinement

# Computed with an independent prototype (Timoshenko elements, 10 unless said): Hz
RIGID = [
    (0.383, None, 10, [123.414, 762.620, 2091.453, 3990.611]),
    (0.383, 0.9, 10, [123.417, 762.759, 2092.296]),
    (0.360, 0.9, 10, [139.647, 861.516, 2357.196]),
    (0.360, None, 10, [139.643, 861.338, 2356.132, 4481.618]),
    (0.383, None, 200, [123.413, 762.482, 2088.672, 3971.974]),
]
FLEXIBLE = [
    (0.383, TABLE_3, [121.536, 752.526, 2066.421, 3945.804]),
    (0.383, TABLE_3 * [1, -1, 1], [121.348, 748.688, 2050.242]),
    (0.360, [3.256e8, 0.0, 1.281e5], [120.069, 761.021, 2101.978]),
]


@pytest.mark.parametrize(("length", "kappa", "elements", "expected"), RIGID)
def test_clamped_frequencies_are_the_checked_ones(length, kappa, elements, expected):
    clamped = rod(length, elements=elements, shear_coefficient=kappa).fixed(CLAMP.dofs)
    np.testing.assert_allclose(clamped.modes().frequency_hz[: len(expected)], expected, rtol=1e-5)


@pytest.mark.parametrize(("length", "stiffness", "expected"), FLEXIBLE)
def test_frequencies_with_a_joint_are_the_checked_ones(length, stiffness, expected):
    free = rod(length)
    joined = CLAMP.selection(free) @ pair_matrix(stiffness) @ CLAMP.selection(free).T
    by_assembly = free.modes(joined).frequency_hz[: len(expected)]
    by_coupling = NaturalFrequencies(free, CLAMP, len(expected)).frequency_hz(pair_matrix(stiffness))[0]
    np.testing.assert_allclose(by_assembly, expected, rtol=1e-5)
    np.testing.assert_allclose(by_coupling, by_assembly, rtol=1e-10)


def _cantilever(slenderness: float, elements: int) -> np.ndarray:
    """Frequencies relative to Euler-Bernoulli's, for a rod of length = slenderness × diameter."""
    section = Section.circle(1.0 / slenderness)
    clamped = beam(1.0, section, STEEL, ModalDamping((0.0,)), elements=elements).fixed(["1:y", "1:rz"])
    roots = np.array([1.8751040687119611, 4.694091132974175, 7.854757438237613])
    bending = np.sqrt(STEEL.youngs_modulus * section.inertia_z / (STEEL.density * section.area))
    return clamped.modes().frequency_hz[:3] / (roots**2 * bending / (2 * np.pi)) - 1


def test_frequencies_converge_with_the_fourth_power_of_the_element_length_for_slender_beams():
    reference = 1 + _cantilever(200, 96)
    errors = np.array([1 + _cantilever(200, n) for n in (6, 12)]) / reference - 1
    assert (errors > 0).all()  # a consistent mass approaches from above
    order = np.log2(errors[:-1] / errors[1:])
    np.testing.assert_allclose(order, 4.0, atol=0.35)


@pytest.mark.parametrize("scale", [1e-2, 1.0, 1e4])
def test_frequencies_and_antiresonances_of_the_model_are_those_of_a_beam_without_a_mesh(scale):
    matrix = scale * np.array([[3e7, 2e5], [2e5, 4e4]])
    stiffness = matrix[0, 0], matrix[0, 1], matrix[1, 1]
    free, held = (
        ExactBeam(0.383, circle(0.025, 0.3), 2.1e11, 0.3, 7800.0, {1: 0.0, 11: 0.383}, stiffness, masses=masses)
        for masses in ({}, {11: 1e6})  # a tip of 1000 tons stands still where it has its antiresonances
    )
    frequency, zeros = (beam.modes(20_000.0).omega / (2 * np.pi) for beam in (free, held))
    test = jb.load_case(CONFIGS / "clamped_beam.toml").problem.test
    modelled = NaturalFrequencies(test.structures, test.joints, 4).frequency_hz(matrix)[0]
    np.testing.assert_allclose(modelled, frequency[:4], rtol=1e-8)
    model = AssembledShapes(test.structures, test.joints, 1, (), [("11:y", number) for number in (1, 2, 3)])
    np.testing.assert_allclose(model.modes(matrix).zeros_hz[0], zeros[1:4], rtol=5e-7)
