"""Simulated FRFs have the noise and the coherence that an analyser gives them."""

import numpy as np
import pytest

import jointbayes as jb
from tests.simulated import noisy_frf
from vibrecords import CoherenceNoise, FrfSet, RelativeNoise


@pytest.mark.parametrize("averages", [2, 5, 50])
def test_noise_and_coherence_are_those_of_h1_from_the_averages_themselves(averages):
    rng = np.random.default_rng(averages)
    lines, law = 20_000, RelativeNoise(0.2, 0.0)
    true = FrfSet(1.0 + np.arange(lines), np.full((lines, 1, 1), 2 - 1j), ("1:y",), ("1:y",))
    short = noisy_frf(true, law, averages, rng)
    sd = np.sqrt(averages * law.variance(true.values)[0, 0, 0] / 2)
    y = 2 - 1j + sd * (rng.standard_normal((averages, lines)) + 1j * rng.standard_normal((averages, lines)))
    coherence = np.abs(y.sum(0)) ** 2 / (averages * (np.abs(y) ** 2).sum(0))
    for quantile in (0.05, 0.5, 0.95):
        assert np.quantile(short.coherence, quantile) == pytest.approx(np.quantile(coherence, quantile), rel=0.02)
    assert np.mean(np.abs(short.values - (2 - 1j)) ** 2) == pytest.approx(law.variance(true.values)[0, 0, 0], rel=0.03)
    assert jb.coherence_variance(short).mean() == pytest.approx(law.variance(true.values)[0, 0, 0], rel=0.03)


def test_one_average_has_no_coherence():
    true = FrfSet([1.0, 2.0], np.ones((2, 1, 1)), ("1:y",), ("1:y",))
    single = noisy_frf(true, RelativeNoise(0.1, 0.0), 1, np.random.default_rng(1))
    assert (single.coherence, single.averages) == (None, 1)


def test_coherence_noise_of_the_case_is_used_as_stated():
    true = FrfSet([1.0, 2.0], np.ones((2, 1, 1)), ("1:y",), ("1:y",))
    rng = np.random.default_rng(5)
    values = np.array([noisy_frf(true, CoherenceNoise(0.8, 10), 10, rng).values[:, 0, 0] for _ in range(4000)])
    assert np.mean(np.abs(values - 1) ** 2) == pytest.approx(0.2 / 8, rel=0.06)
