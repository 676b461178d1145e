"""Modes of virtual tests are found, and none is invented: a sample of `benchmarks.modal_fit`."""

import numpy as np
import pytest
from benchmarks.modal_fit import analyse
from benchmarks.virtual_modal_tests import RING_DOWN, beam_roots, beam_shapes, simulate
from scipy import stats

from tests.conftest import first_in_ci


@pytest.mark.science
@pytest.mark.parametrize("count", first_in_ci([10, 30], 1))
def test_no_mode_is_invented_and_none_missed_that_stands_clear(count):
    outcomes = [analyse(index) for index in range(20, 20 + count)]
    invented, missed = (sum(len(getattr(o, name)) for o in outcomes) for name in ("invented", "missed"))
    clear, named = sum(o.clear for o in outcomes), sum(len(o.named) for o in outcomes)
    # of about 60, or 190 modes: one in a hundred invented, one in two hundred missed, and one of each by chance
    assert invented <= 1 + 0.01 * clear
    assert missed + named <= 1 + 0.005 * clear
    scores = np.abs(np.concatenate([outcome.frequency_scores for outcome in outcomes]))
    # no fewer than by chance; that standard deviations are not too wide is for many fits of one mode
    within = int((scores < 2).sum())
    assert stats.binomtest(within, scores.size, 2 * stats.norm.cdf(2) - 1, alternative="less").pvalue > 1e-3


@pytest.mark.science
def test_virtual_tests_have_the_modes_that_they_state():
    """FRFs of hits that ring down are those of the closed form at the line next to each mode, magnitude and phase."""
    roots = beam_roots("clamped-free", 3)
    assert roots == pytest.approx([1.8751041, 4.6940911, 7.8547574])
    x = np.linspace(0, 1, 4001)
    shapes = beam_shapes("clamped-free", roots, x)
    assert (shapes @ shapes.T / x.size) == pytest.approx(np.eye(3), abs=2e-3)
    test = simulate(7)
    assert test.kind == RING_DOWN
    exact = test.truth.accelerance(test.frf.frequency_hz)
    inside = np.flatnonzero(test.above_noise_db > 30)
    assert inside.size >= 3
    at = [int(np.argmin(np.abs(test.frf.frequency_hz - f))) for f in test.truth.frequency_hz[inside]]
    # a force that is linear between samples has the spectrum of its samples times sinc², at 5000 samples per second
    linear = np.sinc(test.truth.frequency_hz[inside] / 5000) ** 2
    assert np.median(test.frf.values[at, :, 0] / exact[at], axis=1) == pytest.approx(linear, abs=0.03)
