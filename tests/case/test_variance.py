"""The variance that a case states for FRFs of files leaves what is fitted with it unbiased."""

from dataclasses import replace

import numpy as np
import pytest

from jointbayes.case.schema import case as schema
from jointbayes.case.variance import variance_of
from jointbayes.frf import FrfSet, Ports
from jointbayes.joint import joint_matrix
from tests.conftest import TABLE_3, cheap_text

LAW = schema.VarianceSpec(source="relative", relative=0.05, floor=0.02)


def exact_frf() -> FrfSet:
    from jointbayes.case.case import case_from_text

    case = case_from_text("truth", cheap_text())
    lines = np.arange(20.0, 2500.0, 4.0)
    values = case.problem.receptance_model(Ports(lines, ("5:y",), ("5:y",))).receptance(joint_matrix(TABLE_3))[0]
    return FrfSet(lines, values, ("5:y",), ("5:y",)).converted("accelerance")


def test_a_stated_relative_noise_does_not_favour_lines_that_the_noise_made_small():
    exact, rng, z = exact_frf(), np.random.default_rng(2), []
    magnitude = np.abs(exact.values)
    true = 2 * (0.05 * magnitude + 0.02 * np.median(magnitude, axis=0)) ** 2
    for _ in range(4):
        real, imag = rng.standard_normal((2, *exact.values.shape))
        frf = replace(exact, values=exact.values + np.sqrt(true / 2) * (real + 1j * imag))
        _, variance, words, dof = variance_of([frf], LAW, "tip.npz")
        assert "modal fit" in words
        assert dof is None
        np.testing.assert_allclose(np.median(variance / true), 1.0, atol=0.02)
        weight = magnitude**2 / variance
        gain = (np.conj(exact.values) * frf.values / variance).real.sum() / weight.sum()
        z.append((gain - 1) * np.sqrt(2 * weight.sum()))
    assert abs(np.sum(z)) / 2 < 3  # with the measured |H| as it is, about −4


def test_frfs_without_modes_keep_the_magnitude_they_were_measured_with():
    lines = np.linspace(10.0, 20.0, 40)
    noise = np.random.default_rng(1).standard_normal((2, 40, 1, 1))
    frf = FrfSet(lines, noise[0] + 1j * noise[1], ("5:y",), ("5:y",), "accelerance")
    _, variance, words, _ = variance_of([frf], LAW, "tip.npz")
    assert "modal fit" not in words
    magnitude = np.abs(frf.values)
    np.testing.assert_allclose(variance, 2 * (0.05 * magnitude + 0.02 * np.median(magnitude)) ** 2, rtol=1e-12)


def test_repeats_give_the_degrees_of_freedom_of_their_scatter():
    """The likelihood is Student-t with as many: m measurements about their own mean leave 2(m − 1)."""
    rng, lines, m = np.random.default_rng(5), np.linspace(10.0, 20.0, 20_000), 3
    noise = rng.standard_normal((m, 2, lines.size, 1, 1))
    sets = [FrfSet(lines, 1.0 + n[0] + 1j * n[1], ("5:y",), ("5:y",), "accelerance") for n in noise]
    mean, variance, _, dof = variance_of(sets, schema.VarianceSpec(source="repeats", relative=0.0), "tip.npz")
    assert dof == 2 * (m - 1)
    # over the estimated variance, |z|² is F-distributed: P(|z|² > x) = (1 + 2x/dof)^(−dof/2)
    beyond = (np.abs(mean.values - 1.0) ** 2 / variance > 4.0).mean()
    assert abs(beyond - (1 + 8.0 / dof) ** (-dof / 2)) < 4 * np.sqrt(beyond / lines.size)


def test_coherence_gives_the_degrees_of_freedom_of_its_averages():
    frf = replace(exact_frf(), coherence=np.full(exact_frf().values.shape, 0.99), averages=7)
    assert variance_of([frf], schema.VarianceSpec(source="coherence"), "tip.npz")[3] == 12


def test_averages_that_the_case_states_go_before_those_of_the_file():
    frf = replace(exact_frf(), coherence=np.full(exact_frf().values.shape, 0.9), averages=7)
    spec = schema.VarianceSpec(source="coherence", averages=21)
    found, variance, words, dof = variance_of([frf], spec, "tip.npz")
    assert (found.averages, dof) == (21, 40)
    assert "21 averages" in words
    np.testing.assert_allclose(variance, np.abs(frf.values) ** 2 * 0.1 / 0.9 / 20, rtol=1e-12)
    unsaid, *_ = variance_of([replace(frf, averages=None)], spec, "tip.npz")
    assert unsaid.averages == 21


@pytest.mark.parametrize(("times_stated", "smooth"), [(2.0, True), (5.0, False)])
def test_a_modal_fit_tells_the_magnitude_only_where_it_is_within_ten_of_the_stated_variance(times_stated, smooth):
    exact, rng = exact_frf(), np.random.default_rng(7)
    magnitude = np.abs(exact.values)
    sd = times_stated * (LAW.relative * magnitude + LAW.floor * np.median(magnitude, axis=0)) / 10
    real, imag = rng.standard_normal((2, *exact.values.shape))
    law = LAW.model_copy(update={"relative": LAW.relative / 10, "floor": LAW.floor / 10})
    words = variance_of([replace(exact, values=exact.values + sd * (real + 1j * imag))], law, "tip.npz")[2]
    assert ("modal fit" in words) == smooth
