"""The variance that a case states for FRFs of files leaves what is fitted with it unbiased."""

from dataclasses import replace

import numpy as np
import pytest

from tests.vibrecords.rod import receptance
from vibrecords import FrfSet, RelativeNoise
from vibrecords.assemble import estimate_variance
from vibrecords.measurement_plan import VarianceSource

LAW = RelativeNoise(0.05, 0.02)
STATED = VarianceSource("relative", LAW)


def exact_frf() -> FrfSet:
    lines = np.arange(20.0, 2500.0, 4.0)
    values = receptance(lines, ("5:y",), ("5:y",), elements=4)
    return FrfSet(lines, values, ("5:y",), ("5:y",)).converted("accelerance")


def test_a_stated_relative_noise_does_not_favour_lines_that_the_noise_made_small():
    exact, rng, z = exact_frf(), np.random.default_rng(2), []
    magnitude = np.abs(exact.values)
    true = 2 * (0.05 * magnitude + 0.02 * np.median(magnitude, axis=0)) ** 2
    for _ in range(4):
        real, imag = rng.standard_normal((2, *exact.values.shape))
        frf = replace(exact, values=exact.values + np.sqrt(true / 2) * (real + 1j * imag))
        measured, words = estimate_variance([frf], STATED, "tip.npz")
        variance = measured.variance
        assert "modal fit" in words
        assert measured.variance_dof is None
        np.testing.assert_allclose(np.median(variance / true), 1.0, atol=0.02)
        weight = magnitude**2 / variance
        gain = (np.conj(exact.values) * frf.values / variance).real.sum() / weight.sum()
        z.append((gain - 1) * np.sqrt(2 * weight.sum()))
    assert abs(np.sum(z)) / 2 < 3  # with the measured |H| as it is, about −4


def test_frfs_without_modes_keep_the_magnitude_they_were_measured_with():
    lines = np.linspace(10.0, 20.0, 40)
    noise = np.random.default_rng(1).standard_normal((2, 40, 1, 1))
    frf = FrfSet(lines, noise[0] + 1j * noise[1], ("5:y",), ("5:y",), "accelerance")
    measured, words = estimate_variance([frf], STATED, "tip.npz")
    assert "modal fit" not in words
    magnitude = np.abs(frf.values)
    np.testing.assert_allclose(measured.variance, 2 * (0.05 * magnitude + 0.02 * np.median(magnitude)) ** 2, rtol=1e-12)


def test_repeats_give_the_degrees_of_freedom_of_their_scatter():
    """The likelihood is Student-t with as many: m measurements about their own mean leave 2(m − 1)."""
    rng, lines, m = np.random.default_rng(5), np.linspace(10.0, 20.0, 20_000), 3
    noise = rng.standard_normal((m, 2, lines.size, 1, 1))
    sets = [FrfSet(lines, 1.0 + n[0] + 1j * n[1], ("5:y",), ("5:y",), "accelerance") for n in noise]
    mean, words = estimate_variance(sets, VarianceSource("repeats", None), "tip.npz")
    dof = mean.variance_dof
    assert words.endswith("whose mean is used")
    assert dof == 2 * (m - 1)
    # over the estimated variance, |z|² is F-distributed: P(|z|² > x) = (1 + 2x/dof)^(−dof/2)
    beyond = (np.abs(mean.frf.values - 1.0) ** 2 / mean.variance > 4.0).mean()
    assert abs(beyond - (1 + 8.0 / dof) ** (-dof / 2)) < 4 * np.sqrt(beyond / lines.size)


def test_coherence_gives_the_degrees_of_freedom_of_its_averages():
    frf = replace(exact_frf(), coherence=np.full(exact_frf().values.shape, 0.99), averages=7)
    assert estimate_variance([frf], VarianceSource("coherence", None), "tip.npz")[0].variance_dof == 12


def test_the_law_is_the_least_that_a_coherence_is_believed():
    frf = replace(exact_frf(), coherence=np.full(exact_frf().values.shape, 1 - 1e-9), averages=7)
    measured, words = estimate_variance([frf], VarianceSource("coherence", RelativeNoise(0.01, 0.0)), "tip.npz")
    np.testing.assert_allclose(measured.variance, 2 * (0.01 * np.abs(frf.values)) ** 2)
    assert "at least a standard deviation of 1 % of |H|" in words


def test_averages_that_the_case_states_go_before_those_of_the_file():
    frf = replace(exact_frf(), coherence=np.full(exact_frf().values.shape, 0.9), averages=7)
    source = VarianceSource("coherence", RelativeNoise(0.001, 0.0), averages=21)
    measured, words = estimate_variance([frf], source, "tip.npz")
    assert (measured.frf.averages, measured.variance_dof) == (21, 40)
    assert "21 averages" in words
    np.testing.assert_allclose(measured.variance, np.abs(frf.values) ** 2 * 0.1 / 0.9 / 20, rtol=1e-12)
    assert estimate_variance([replace(frf, averages=None)], source, "tip.npz")[0].frf.averages == 21


@pytest.mark.parametrize(("times_stated", "smooth"), [(2.0, True), (5.0, False)])
def test_a_modal_fit_tells_the_magnitude_only_where_it_is_within_ten_of_the_stated_variance(times_stated, smooth):
    exact, rng = exact_frf(), np.random.default_rng(7)
    magnitude = np.abs(exact.values)
    sd = times_stated * (LAW.relative * magnitude + LAW.floor * np.median(magnitude, axis=0)) / 10
    real, imag = rng.standard_normal((2, *exact.values.shape))
    source = VarianceSource("relative", RelativeNoise(LAW.relative / 10, LAW.floor / 10))
    _, words = estimate_variance([replace(exact, values=exact.values + sd * (real + 1j * imag))], source, "tip.npz")
    assert ("modal fit" in words) == smooth
