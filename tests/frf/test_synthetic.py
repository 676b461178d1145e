"""Computed measurements: noise of the stated law, the same for the same seed."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from jointbayes.frf import DirectSolve, Ports, synthesise_frf
from tests.conftest import CLAMP, TABLE_3, pair_matrix, rod
from vibrecords import RelativeNoise

MATRIX = pair_matrix(TABLE_3)
NOISE = RelativeNoise(0.05, 0.02)
ROD = rod(elements=2)


def measured(rng=None, outputs=("3:y", "2:y"), quantity="receptance", lines=None):
    lines = np.linspace(20.0, 2500.0, 200) if lines is None else lines
    return synthesise_frf(ROD, CLAMP, MATRIX, Ports(lines, outputs, ("3:y",)), NOISE, quantity, rng)


def test_the_variance_is_that_of_both_parts_at_the_true_frf():
    exact = measured()
    magnitude = np.abs(exact.frf.values)
    per_part = 0.05 * magnitude + 0.02 * np.median(magnitude, axis=0)
    assert_allclose(exact.variance, 2 * per_part**2, rtol=1e-14)
    assert_array_equal(measured(np.random.default_rng(1)).variance, exact.variance)


@pytest.mark.science
def test_synthetic_noise_is_circular_with_the_stated_variance():
    lines = np.linspace(20.0, 2500.0, 40_000)
    exact, noisy = measured(lines=lines), measured(np.random.default_rng(2), lines=lines)
    unit = (noisy.frf.values - exact.frf.values) / np.sqrt(exact.variance)
    n = unit.size
    assert np.mean(np.abs(unit) ** 2) == pytest.approx(1.0, abs=4 / np.sqrt(n))
    for part in (unit.real, unit.imag):
        assert part.var() == pytest.approx(0.5, abs=4 * 0.5 * np.sqrt(2 / n))
    assert abs(np.mean(unit**2)) < 4 / np.sqrt(n)  # E[δH²] = 0
    assert abs(np.mean(unit)) < 4 / np.sqrt(n)
    assert abs(np.mean(unit[1:] * unit[:-1].conj())) < 4 / np.sqrt(n)  # from line to line
    assert abs(np.mean(unit[:, 0] * unit[:, 1].conj())) < 4 / np.sqrt(n / 2)  # from output to output
    # Gaussian: E|z|⁴ = 2 (E|z|²)²
    assert np.mean(np.abs(unit) ** 4) == pytest.approx(2.0, abs=4 * np.sqrt(20 / n))


def test_a_further_output_leaves_the_noise_of_the_earlier_ones_alone():
    def noise(outputs):
        return (measured(np.random.default_rng(3), outputs).frf.values - measured(None, outputs).frf.values)[:, 0, 0]

    alone = noise(("3:y",))
    for more in (("3:y", "2:y"), ("3:y", "1:rz", "1:y", "2:y")):
        assert_allclose(noise(more), alone, rtol=1e-9)


@pytest.mark.parametrize(("quantity", "power"), [("receptance", 0), ("mobility", 1), ("accelerance", 2)])
def test_without_a_generator_the_frfs_are_exact(quantity, power):
    exact = measured(quantity=quantity)
    lines = exact.frf.frequency_hz
    receptance = DirectSolve(ROD, CLAMP, Ports(lines, ("3:y", "2:y"), ("3:y",))).receptance(MATRIX)[0]
    assert_allclose(exact.frf.values, receptance * ((2j * np.pi * lines) ** power)[:, None, None], rtol=1e-12)
    assert (exact.frf.quantity, exact.synthetic) == (quantity, True)


def test_the_same_seed_gives_the_same_bits_and_another_seed_does_not():
    first, again = (measured(np.random.default_rng(4)).frf.values for _ in range(2))
    assert first.tobytes() == again.tobytes()
    assert (measured(np.random.default_rng(5)).frf.values != first).all()
