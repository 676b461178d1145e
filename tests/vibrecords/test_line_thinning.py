"""Correlated averages and lines: what they count for is what simulation says."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import signal

from tests.simulated import lines_apart
from vibrecords.signals.windows import effective_averages, exponential_window, independent_step, line_correlation

HANN = signal.get_window("hann", 64)


def block_spectra(rng: np.random.Generator, tests: int, blocks: int, hop: int, window: np.ndarray) -> np.ndarray:
    """Spectra of overlapping windowed blocks of white noise, shape (tests, blocks, lines)."""
    noise = rng.standard_normal((tests, window.size + (blocks - 1) * hop))
    cut = np.lib.stride_tricks.sliding_window_view(noise, window.size, axis=1)[:, ::hop]
    return np.fft.rfft(cut * window)


def frf_errors(rng: np.random.Generator, tests: int, blocks: int, hop: int, window: np.ndarray) -> np.ndarray:
    """Errors of H1 for random force and noise at the response, shape (tests, lines)."""
    x, n = (block_spectra(rng, tests, blocks, hop, window) for _ in range(2))
    return (x.conj() * n).sum(axis=1) / (np.abs(x) ** 2).sum(axis=1)


def test_half_overlapping_hann_blocks_correlate_by_a_sixth():
    assert effective_averages(12, HANN, 64) == pytest.approx(12.0)
    assert effective_averages(12, HANN, 32) == pytest.approx(12 / (1 + 2 * 11 / 12 / 36), rel=1e-6)


@pytest.mark.parametrize("hop", [64, 32, 16])
def test_overlapping_blocks_count_for_less_than_their_number(hop):
    count = effective_averages(12, HANN, hop)
    power = (np.abs(block_spectra(np.random.default_rng(hop), 4000, 12, hop, HANN)) ** 2).mean(axis=1)[:, 2:-2]
    # the mean of n independent |X|², each exponentially distributed, has a relative variance of 1/n
    assert (power.mean(axis=0) ** 2 / power.var(axis=0)).mean() == pytest.approx(count, rel=0.03)


@pytest.mark.parametrize("hop", [64, 32, 16])
def test_errors_of_neighbouring_lines_correlate_as_computed_for_a_random_force(hop):
    errors = frf_errors(np.random.default_rng(hop), 2000, 50, hop, HANN)[:, 3:-3]
    power = (np.abs(errors) ** 2).mean()
    found = [np.abs((errors[:, m:] * errors[:, : errors.shape[1] - m].conj()).mean()) / power for m in (1, 2, 3)]
    assert_allclose(found, line_correlation(HANN, random=True, blocks=50, hop=hop)[1:4], atol=0.02)


def test_errors_of_neighbouring_lines_correlate_as_computed_for_the_same_force_in_each_block():
    window = exponential_window(256, 0.05)
    noise = np.fft.rfft(np.random.default_rng(1).standard_normal((8000, 256)) * window)[:, 3:-3]
    power = (np.abs(noise) ** 2).mean()
    found = [np.abs((noise[:, m:] * noise[:, : noise.shape[1] - m].conj()).mean()) / power for m in (1, 2, 5)]
    assert_allclose(found, line_correlation(window, random=False)[[1, 2, 5]], atol=0.01)


@pytest.mark.parametrize(("window", "random", "step"), [
    (np.ones(128), False, 1),
    (np.ones(128), True, 1),
    (signal.get_window("hann", 128), True, 2),
    (signal.get_window("hann", 128), False, 2),
    (signal.get_window("flattop", 128), False, 5),
    (exponential_window(512, 0.05), False, 3),
    (exponential_window(512, 0.01), False, 5),
])  # fmt: skip
def test_every_how_many_lines_are_independent(window, random, step):
    assert independent_step(line_correlation(window, random=random)) == step


def test_lines_are_kept_apart_for_even_and_uneven_lines():
    assert_array_equal(lines_apart(np.arange(10.0, 20.0), 3.0), [0, 3, 6, 9])
    assert_array_equal(lines_apart(0.1 * np.arange(1, 8), 0.3), [0, 3, 6])  # 0.1 is not exact in binary
    assert_array_equal(lines_apart(np.array([1.0, 1.5, 3.0, 10.0, 10.5]), 2.0), [0, 2, 3])


def claimed_over_true_variance(errors: np.ndarray, slope: np.ndarray, step: int) -> float:
    """Variance that least squares on every `step`-th line claims for a parameter, over the one it has.

    Lines are taken for independent; `slope` (lines,) is the derivative of H, `errors` (tests, lines) those of H.
    """
    kept = slice(None, None, step)
    variance = np.mean(np.abs(errors[:, kept]) ** 2, axis=0)
    information = 2 * np.sum(np.abs(slope[kept]) ** 2 / variance)
    found = 2 * np.real(errors[:, kept] @ (slope[kept].conj() / variance)) / information
    return float(1 / information / np.var(found))


def resonance(lines: int) -> np.ndarray:
    """dH/dω₀ of one mode whose half-power bandwidth is nine lines."""
    k = np.arange(lines)
    return 1 / (k - lines / 2 - 4.5j) ** 2


@pytest.mark.science
@pytest.mark.parametrize("hop", [pytest.param(128, marks=pytest.mark.science), 64, 32])
def test_every_other_line_of_a_hann_window_gives_an_honest_variance_and_every_line_does_not(hop):
    window = signal.get_window("hann", 128)
    errors = frf_errors(np.random.default_rng(hop), 3000, 50, hop, window)[:, 4:-4]
    slope = resonance(errors.shape[1])
    step = independent_step(line_correlation(window, random=True, blocks=50, hop=hop))
    assert step == 2
    assert claimed_over_true_variance(errors, slope, 1) < 0.65
    assert claimed_over_true_variance(errors, slope, step) == pytest.approx(1.0, abs=0.12)


@pytest.mark.parametrize("end", [0.1, 0.03])
def test_the_step_of_an_exponential_window_leaves_no_overconfidence(end):
    window = exponential_window(1024, end)
    rng = np.random.default_rng(1)
    errors = np.fft.rfft(rng.standard_normal((3000, 1024)) * window)[:, 100:200]
    rate = -np.log(end) / (2 * np.pi)  # of the window, in lines
    k = np.arange(100)
    slope = 1 / (k - 50 - 1j * (0.5 + rate)) ** 2  # a mode that is narrower than the window makes it
    step = independent_step(line_correlation(window, random=False))
    assert step > 1
    every, kept = (claimed_over_true_variance(errors, slope, s) for s in (1, step))
    assert every < 0.7
    assert 0.95 < kept < 1.4
