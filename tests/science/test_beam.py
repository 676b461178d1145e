"""The beam against checked numbers, closed forms and its own refinement."""

import numpy as np
import pytest

from jointbayes.frf import NaturalFrequencies
from jointbayes.structure import BeamMaterial, ModalDamping, Section, beam
from tests.conftest import CLAMP, TABLE_3, pair_matrix, rod

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
    material = BeamMaterial(2.1e11, 0.3, 7800.0)
    section = Section.circle(1.0 / slenderness)
    clamped = beam(1.0, section, material, ModalDamping((0.0,)), elements=elements).fixed(["1:y", "1:rz"])
    roots = np.array([1.8751040687119611, 4.694091132974175, 7.854757438237613])
    bending = np.sqrt(material.youngs_modulus * section.inertia_z / (material.density * section.area))
    return clamped.modes().frequency_hz[:3] / (roots**2 * bending / (2 * np.pi)) - 1


def test_euler_bernoulli_is_the_limit_of_vanishing_shear_and_rotary_inertia():
    stout, slender = _cantilever(20, 60), _cantilever(200, 60)
    assert (stout < -1e-3).all()  # shear and rotary inertia lower every frequency
    # the difference goes with (d/L)²: a hundredth at ten times the slenderness
    np.testing.assert_allclose(slender, stout / 100, rtol=0.05)
    np.testing.assert_allclose(_cantilever(3000, 60), 0.0, atol=2e-6)


def test_frequencies_converge_with_the_fourth_power_of_the_element_length_for_slender_beams():
    reference = 1 + _cantilever(200, 96)
    errors = np.array([1 + _cantilever(200, n) for n in (6, 12)]) / reference - 1
    assert (errors > 0).all()  # a consistent mass approaches from above
    order = np.log2(errors[:-1] / errors[1:])
    np.testing.assert_allclose(order, 4.0, atol=0.35)


def test_frequencies_of_the_papers_beam_converge_under_refinement():
    def frequency(n):
        return rod(elements=n).fixed(CLAMP.dofs).modes().frequency_hz[:3]

    errors = np.array([frequency(n) for n in (5, 10, 20, 40)]) - frequency(400)
    assert (errors > 0).all()
    order = np.log2(errors[:-1] / errors[1:])
    # shear deformation inside an element leaves a second-order term, seen once the fourth-order one is gone
    assert (order > 1.8).all()
    assert (order < 4.3).all()
