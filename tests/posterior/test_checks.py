import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import special, stats

from jointbayes.errors import ModelError
from jointbayes.inference import (
    CorrelatedNoise,
    GaussianNoise,
    IntegratedScale,
    NoiseModel,
    ScaledNoise,
    StudentNoise,
)
from jointbayes.posterior.checks import FALSE_ALARM, PredictiveCheck, check_frequencies, check_frfs

LINES = 80
FREQUENCY = 10.0 + 2.0 * np.arange(LINES)
#: A model of three parameters, linear: H = design @ β.
DESIGN = np.vander(np.linspace(-1, 1, LINES), 3) * np.exp(1j * np.linspace(0, 4, LINES))[:, None]


def posterior_residuals(rng: np.random.Generator, data: np.ndarray, draws: int, sd: float = 1.0) -> np.ndarray:
    """Residuals (draws, LINES, 1) at draws of the exact posterior of real β, flat prior, complex noise E|n|² = sd²."""
    design, stacked = np.concatenate([DESIGN.real, DESIGN.imag]), np.concatenate([data.real, data.imag])
    precision = design.T @ design * 2 / sd**2
    mean = np.linalg.solve(design.T @ design, design.T @ stacked)
    beta = mean + rng.standard_normal((draws, 3)) @ np.linalg.inv(np.linalg.cholesky(precision))
    return (beta @ DESIGN.T - data)[:, :, None]


def white(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / math.sqrt(2)


def checked(noise: NoiseModel, z: np.ndarray, hyper: list[float], seed: int = 1) -> PredictiveCheck:
    return check_frfs(noise, z, np.tile(np.array(hyper), (len(z), 1)), np.random.default_rng(seed))


def test_a_right_model_is_refused_no_more_often_than_stated() -> None:
    rng, none = np.random.default_rng(2), np.empty((40, 0))
    found = []
    for _ in range(300):
        data = DESIGN @ np.array([1.0, -2.0, 3.0]) + white(rng, (LINES,))
        found.append(check_frfs(GaussianNoise(2), posterior_residuals(rng, data, 40), none, rng))
    alarms = sum(not c.explains for c in found)
    assert alarms <= stats.binom(300, FALSE_ALARM).ppf(0.999)
    for p_values in ([c.chi2_p_value for c in found], [c.whiteness_p_value for c in found]):
        # three parameters of 160 real values are fitted: near uniform, a little drawn to the middle
        assert stats.kstest(p_values, "uniform").statistic < 0.12
        assert 0.04 < np.mean(np.array(p_values) < 0.1) < 0.16
        assert 0.04 < np.mean(np.array(p_values) > 0.9) < 0.16


@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize(
    ("name", "hyper"),
    [("scaled", [2.5]), ("integrated", []), ("student", []), ("correlated", [0.8, 3.0, 30.0])],
)
def test_data_of_the_noise_model_are_explained(parts: int, name: str, hyper: list[float]) -> None:
    noise = {
        "scaled": ScaledNoise(parts),
        "integrated": IntegratedScale(parts, 4.0, 1.0),
        "student": StudentNoise(parts, 3.0),
        "correlated": CorrelatedNoise(parts, FREQUENCY, scaled=True),
    }[name]
    rng = np.random.default_rng(3)
    alarms = 0
    for seed in range(30):
        z = noise.draw(rng, np.array([hyper]), LINES, 2)
        alarms += not checked(noise, z, hyper, seed).explains
    assert alarms <= 3  # 30 · 0.01 expected; four have a probability of 2e-4


def test_residuals_that_the_noise_does_not_allow_are_a_misfit() -> None:
    check = checked(GaussianNoise(2), 1.4 * white(np.random.default_rng(4), (5, 200, 1)), [])
    assert (check.misfit, check.correlated, check.explains) == (True, False, False)
    assert check.chi2_per_line == pytest.approx(1.96, rel=0.15)
    assert check.sentence.startswith("The model does NOT explain the data: squared residuals are ")
    assert "p < 0.001" in check.sentence
    assert "too narrow" in check.sentence


def test_a_small_trend_that_the_sum_of_squares_overlooks_is_seen_along_frequency() -> None:
    z = white(np.random.default_rng(5), (1, 400, 1)) + 0.45 * np.sin(np.arange(400) / 6)[:, None]
    check = checked(GaussianNoise(2), z, [])
    assert (check.misfit, check.correlated, check.explains) == (False, True, False)
    assert check.sentence.startswith("The model does NOT explain")
    assert check.lag1 == pytest.approx(0.1, abs=0.06)


def test_an_inferred_noise_scale_hides_misfit_but_not_correlation() -> None:
    z = 3 * CorrelatedNoise(2, FREQUENCY).draw(np.random.default_rng(6), np.array([[2.0, 20.0]]), LINES, 1)
    level = float(np.sqrt((np.abs(z) ** 2).mean()))
    check = checked(ScaledNoise(2), z, [level])
    assert not check.misfit
    assert check.correlated
    assert f"inferred as {level:.3g} times the stated" in check.sentence
    integrated = checked(IntegratedScale(2), np.repeat(z, 50, axis=0), [])
    assert not integrated.misfit
    assert integrated.correlated
    (sentence,) = integrated.inferred
    assert float(sentence.split()[5]) == pytest.approx(level, rel=0.1)


def test_a_discrepancy_that_was_needed_is_named() -> None:
    noise = CorrelatedNoise(2, FREQUENCY)
    z = noise.draw(np.random.default_rng(7), np.array([[4.0, 20.0]]), LINES, 1)
    assert not checked(GaussianNoise(2), z, []).explains
    check = checked(noise, z, [4.0, 20.0])
    assert check.explains
    assert check.sentence.startswith("The model explains the data: ")
    assert "a model discrepancy of 4 times the stated noise, correlated over 20 Hz" in check.sentence
    assert "small, 0.1 times" in checked(noise, white(np.random.default_rng(8), z.shape), [0.1, 20.0]).sentence


def test_overstated_noise_is_said_and_is_no_refusal() -> None:
    check = checked(GaussianNoise(2), 0.5 * white(np.random.default_rng(8), (3, 200, 1)), [])
    assert check.explains
    assert check.overstated
    assert "overstated" in check.sentence
    assert check.chi2_p_value > 0.999


def test_a_single_outlier_is_pointed_at() -> None:
    z = white(np.random.default_rng(9), (20, 1000, 2))
    assert "stands out" not in checked(GaussianNoise(2), z, []).sentence
    z[:, 17, 1] = 5.0
    check = checked(GaussianNoise(2), z, [])
    assert check.explains
    assert check.largest_at == (17, 1)
    assert check.largest == pytest.approx(5 * math.sqrt(2))  # σ holds both parts
    assert "deviates by 7.1 standard deviations (line 18)" in check.sentence
    assert "stands out" not in checked(StudentNoise(2, 3.0), z, []).sentence


@pytest.mark.parametrize("parts", [1, 2])
def test_figures_are_those_of_their_definitions(parts: int) -> None:
    rng = np.random.default_rng(10)
    z = white(rng, (4, 30, 2)) if parts == 2 else rng.standard_normal((4, 30, 2)) / math.sqrt(2)
    check = checked(GaussianNoise(parts), z, [])
    square = (np.abs(z) ** 2).sum(axis=(1, 2))
    dof = parts * 60
    assert check.chi2_per_line == pytest.approx(2 * square.mean() / dof)
    assert check.chi2_p_value == pytest.approx(stats.chi2(dof).sf(2 * square).mean())
    assert check.chi2_band == pytest.approx(tuple(stats.chi2(dof).ppf([0.025, 0.975]) / dof))
    np.testing.assert_allclose(check.chi2_by_line.mean(), check.chi2_per_line)
    ratio = [[np.sum(p[:-1].conj() * p[1:]).real / np.sum(np.abs(p) ** 2) for p in row.T] for row in z]
    assert check.lag1 == pytest.approx(np.mean(ratio))
    one = np.sqrt(2) * np.abs(z).max(axis=(1, 2))  # in sd of one part
    tail = stats.rayleigh.sf(one) if parts == 2 else 2 * stats.norm.sf(one)
    assert check.largest == pytest.approx(one.mean())
    assert check.largest_p_value == pytest.approx(np.mean(1 - (1 - tail) ** 60))


@pytest.mark.science
@pytest.mark.parametrize("pairs", [1, 3])
def test_white_residuals_have_a_uniform_whiteness_p_value(pairs: int) -> None:
    rng = np.random.default_rng(11)
    # longer than the replicated records, so that their law has to hold for other lengths
    z = white(rng, (40, 1500, pairs))
    p_values = [check_frfs(GaussianNoise(2), one[None], np.empty((1, 0)), rng).whiteness_p_value for one in z]
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3


def test_more_than_one_pair_is_averaged_not_drowned() -> None:
    # noise understated a hundredfold in one pair must not hide a trend in the other
    z = white(np.random.default_rng(12), (1, 400, 2))
    z[:, :, 0] *= 100
    z[:, :, 1] += np.sin(np.arange(400) / 6)
    assert checked(GaussianNoise(2), z, []).correlated


def test_natural_frequencies_are_judged_by_the_sum_of_squares() -> None:
    rng = np.random.default_rng(13)
    fine = check_frequencies(rng.standard_normal((1000, 4)))
    assert fine.explains
    assert fine.whiteness_p_value is None
    assert fine.lag1 is None
    assert "neighbouring" not in fine.sentence
    residual = np.array([[4.0, -3.0, 1.0]])
    wrong = check_frequencies(residual)
    assert not wrong.explains
    assert wrong.chi2_p_value == pytest.approx(special.chdtrc(3, 26))
    assert wrong.largest == pytest.approx(4)
    assert wrong.largest_at == (0, 0)


def test_a_right_model_of_natural_frequencies_is_refused_no_more_often_than_stated() -> None:
    rng = np.random.default_rng(14)
    p_values = []
    for _ in range(2000):
        data = rng.standard_normal(8)  # frequencies about the mean of one parameter, in standard deviations
        mean = data.mean() + rng.standard_normal((50, 1)) / math.sqrt(8)
        p_values.append(check_frequencies(mean - data).chi2_p_value)
    assert np.mean(np.array(p_values) < FALSE_ALARM) < 0.016
    assert 0.02 < np.mean(np.array(p_values) < 0.05) < 0.06


@pytest.mark.parametrize("shape", [(0, 5, 1), (3, 1, 1), (3, 5), (3, 5, 0)])
def test_nothing_to_check_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ModelError, match="posterior check"):
        check_frfs(GaussianNoise(2), np.zeros(shape, dtype=complex), np.empty((shape[0], 0)), np.random.default_rng(1))


def test_residuals_that_are_no_numbers_are_refused() -> None:
    z = np.full((1, 5, 1), np.nan)
    with pytest.raises(ModelError, match="finite"):
        checked(GaussianNoise(1), z, [])
    with pytest.raises(ModelError, match="finite"):
        check_frequencies(z[0])


def finding_of(**changes: object) -> PredictiveCheck:
    """A check that finds nothing, but for what is changed."""
    fine = PredictiveCheck(1.0, (0.9, 1.1), 0.5, 0.5, 0.0, 3.0, 0.5, (0, 0), np.ones(5))
    return replace(fine, **changes)


@pytest.mark.parametrize(
    ("changes", "finding"),
    [
        ({}, "explained"),
        ({"chi2_p_value": 0.0051}, "explained"),
        ({"chi2_p_value": 0.0049}, "misfit"),
        ({"whiteness_p_value": 0.0051}, "explained"),
        ({"whiteness_p_value": 0.0049}, "misfit"),
        ({"chi2_p_value": 0.9949}, "explained"),
        ({"chi2_p_value": 0.9951}, "noise overstated"),
        # of natural frequencies there is one p-value, which has the whole false-alarm level of 1 %
        ({"chi2_p_value": 0.0101, "whiteness_p_value": None, "lag1": None}, "explained"),
        ({"chi2_p_value": 0.0099, "whiteness_p_value": None, "lag1": None}, "misfit"),
        # far below the noise correlation is no misfit; a little below it is one
        ({"chi2_p_value": 1.0, "chi2_per_line": 0.24, "whiteness_p_value": 0.0}, "noise overstated"),
        ({"chi2_p_value": 1.0, "chi2_per_line": 0.26, "whiteness_p_value": 0.0}, "misfit"),
        ({"chi2_p_value": 0.5, "chi2_per_line": 0.24, "whiteness_p_value": 0.0}, "misfit"),
    ],
)
def test_the_limits_of_a_finding_are_those_documented(changes: dict[str, object], finding: str) -> None:
    check = finding_of(**changes)
    assert check.finding == finding
    assert check.explains == (finding != "misfit")
    assert ("too narrow" in check.sentence) == (finding == "misfit")
    assert ("too wide" in check.sentence) == (finding == "noise overstated")
    assert ("does NOT explain" in check.sentence) == (finding == "misfit")
    assert check.sentence.startswith("The stated noise is overstated: ") == (finding == "noise overstated")


@pytest.mark.parametrize(("p_value", "stands_out"), [(0.00099, True), (0.00101, False)])
def test_student_t_noise_is_named_where_one_value_in_a_thousand_records_would_be_so_large(
    p_value: float, stands_out: bool
) -> None:
    assert ("use Student-t noise" in finding_of(largest_p_value=p_value).sentence) == stands_out
    assert "Student-t" not in finding_of(largest_p_value=p_value, chi2_p_value=0.0).sentence


def test_exact_data_with_noise_assumed_are_no_misfit() -> None:
    z = 0.026 * np.sin(np.arange(400) / 6)[None, :, None] * np.ones((5, 1, 1)) * (1 + 1j)
    check = checked(GaussianNoise(2), z, [])
    assert check.correlated
    assert (check.finding, check.explains) == ("noise overstated", True)
    assert "correlate" not in check.sentence
