import math
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal, special, stats

from jointbayes.inference import GaussianNoise, IntegratedScale, NoiseModel, ScaledNoise, StudentNoise
from jointbayes.posterior.checks import (
    COLUMNS,
    FALSE_ALARM,
    FAR_BELOW,
    ROWS,
    PredictiveCheck,
    Whiteness,
    check_frequencies,
    check_frfs,
    replicated_portmanteau,
)

LINES = 80
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


def correlated(rng: np.random.Generator) -> np.ndarray:
    """Residuals (1, LINES, 1) that follow each other along frequency, E|z|² = 1."""
    step = math.exp(-0.1)
    drive = white(rng, (1, LINES, 1)) * np.where(np.arange(LINES), math.sqrt(1 - step**2), 1.0)[:, None]
    return signal.lfilter([1.0], [1.0, -step], drive, axis=1)


def checked(noise: NoiseModel, z: np.ndarray, hyper: list[float], seed: int = 1) -> PredictiveCheck:
    return check_frfs(noise, z, np.tile(np.array(hyper), (len(z), 1)), np.random.default_rng(seed))


@pytest.mark.science
def test_a_right_model_is_refused_no_more_often_than_stated() -> None:
    rng, none = np.random.default_rng(2), np.empty((40, 0))
    found = []
    for _ in range(300):
        data = DESIGN @ np.array([1.0, -2.0, 3.0]) + white(rng, (LINES,))
        found.append(check_frfs(GaussianNoise(2), posterior_residuals(rng, data, 40), none, rng))
    alarms = sum(c.finding != "explained" for c in found)
    assert alarms <= stats.binom(300, FALSE_ALARM).ppf(0.999)
    for p_values in ([c.chi2_p_value for c in found], [c.whiteness_p_value for c in found]):
        # three parameters of 160 real values are fitted: near uniform, a little drawn to the middle
        assert stats.kstest(p_values, "uniform").statistic < 0.12
        assert 0.04 < np.mean(np.array(p_values) < 0.1) < 0.16
        assert 0.04 < np.mean(np.array(p_values) > 0.9) < 0.16


@pytest.mark.parametrize("parts", [1, pytest.param(2, marks=pytest.mark.science)])
@pytest.mark.parametrize(("name", "hyper"), [("scaled", [2.5]), ("integrated", []), ("student", [])])
def test_data_of_the_noise_model_are_explained(parts: int, name: str, hyper: list[float]) -> None:
    noise = {
        "scaled": ScaledNoise(parts),
        "integrated": IntegratedScale(parts, 4.0, 1.0),
        "student": StudentNoise(parts, 3.0),
    }[name]
    rng = np.random.default_rng(3)
    alarms = 0
    for seed in range(30):
        z = noise.draw(rng, np.array([hyper]), LINES, 2)
        alarms += not checked(noise, z, hyper, seed).explains
    assert alarms <= 3  # 30 · 0.01 expected; four have a probability of 2e-4


def test_residuals_that_the_noise_does_not_allow_are_a_misfit() -> None:
    check = checked(GaussianNoise(2), 1.4 * white(np.random.default_rng(4), (5, 200, 1)), [])
    assert (check.level, check.pattern, check.explains) == ("above", "white", False)
    assert check.chi2_per_line == pytest.approx(1.96, rel=0.15)
    assert check.sentence.startswith("The model does NOT explain the data: the misfit is 1.39 times the noise (")
    assert "p < 0.001" in check.details
    assert "Do not use" in check.sentence


def test_a_small_trend_that_the_sum_of_squares_overlooks_is_seen_along_frequency() -> None:
    z = white(np.random.default_rng(5), (1, 400, 1)) + 0.45 * np.sin(np.arange(400) / 6)[:, None]
    check = checked(GaussianNoise(2), z, [])
    assert (check.level, check.pattern, check.explains) == ("as expected", "correlated", False)
    assert check.sentence.startswith("The model does NOT explain")
    assert check.whiteness.correlations[0] == pytest.approx(0.1, abs=0.06)


def test_an_inferred_noise_scale_hides_misfit_but_not_correlation() -> None:
    z = 6 * correlated(np.random.default_rng(6))
    level = float(np.sqrt((np.abs(z) ** 2).mean()))
    check = checked(ScaledNoise(2), z, [level])
    assert (check.level, check.pattern) == ("as expected", "correlated")
    assert f"inferred as {level:.3g} times the stated" in check.details
    integrated = checked(IntegratedScale(2), np.repeat(z, 50, axis=0), [])
    assert (integrated.level, integrated.pattern, integrated.absorbs) == ("as expected", "correlated", "size")
    (sentence,) = integrated.inferred
    assert float(sentence.split()[5]) == pytest.approx(level, rel=0.1)


def test_overstated_noise_is_said_and_is_no_refusal() -> None:
    check = checked(GaussianNoise(2), 0.5 * white(np.random.default_rng(8), (3, 200, 1)), [])
    assert check.explains
    assert check.finding == "noise overstated"
    assert "overstated" in check.sentence
    assert check.chi2_p_value > 0.999


def test_a_single_outlier_is_pointed_at() -> None:
    z = white(np.random.default_rng(9), (20, 1000, 2))
    assert "deviates by" not in checked(GaussianNoise(2), z, []).details
    z[:, 17, 1] = 5.0
    check = checked(GaussianNoise(2), z, [])
    assert check.explains
    assert check.largest_at == (17, 1)
    assert check.largest == pytest.approx(5 * math.sqrt(2))  # σ holds both parts
    assert "deviates by 7.1 standard deviations (line 18)" in check.details
    assert "deviates by" not in checked(StudentNoise(2, 3.0), z, []).details


@pytest.mark.parametrize("parts", [1, 2])
def test_figures_are_those_of_their_definitions(parts: int) -> None:
    rng = np.random.default_rng(10)
    z = white(rng, (4, 30, 2)) if parts == 2 else rng.standard_normal((4, 30, 2)) / math.sqrt(2)
    check = checked(GaussianNoise(parts), z, [])
    square = (np.abs(z) ** 2).sum(axis=(1, 2))
    dof = parts * 60
    assert check.chi2_per_line == pytest.approx(2 * square.mean() / dof)
    assert check.chi2_p_value == pytest.approx(stats.chi2(dof).sf(2 * square.mean()))
    assert check.test_level == FALSE_ALARM / 2
    assert check.chi2_band == pytest.approx(tuple(stats.chi2(dof).ppf([0.0025, 0.9975]) / dof))
    np.testing.assert_allclose(check.chi2_by_line.mean(), check.chi2_per_line)
    ratio = [[np.sum(p[:-1].conj() * p[1:]).real / np.sum(np.abs(p) ** 2) for p in row.T] for row in z]
    assert check.whiteness.correlations[0] == pytest.approx(np.mean(ratio))
    third = [[np.sum(p[:-3].conj() * p[3:]).real / np.sum(np.abs(p) ** 2) for p in row.T] for row in z]
    assert check.whiteness.correlations[2] == pytest.approx(np.mean(third))
    m = parts * 30
    sd = np.sqrt(parts * (30 - 3) / (2 * m * (m + 2)))
    assert check.whiteness.deviations[2] == pytest.approx(np.mean(third) / sd)
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
    assert checked(GaussianNoise(2), z, []).pattern == "correlated"


def test_natural_frequencies_are_judged_by_the_sum_of_squares() -> None:
    rng = np.random.default_rng(13)
    fine = check_frequencies(rng.standard_normal((1000, 4)))
    assert fine.explains
    assert fine.whiteness_p_value is None
    assert fine.pattern == "white"
    assert "nearby" not in fine.sentence
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
    assert np.mean(np.array(p_values) > 1 - FALSE_ALARM / 2) < 0.016
    assert 0.02 < np.mean(np.array(p_values) < 0.05) < 0.06


@pytest.mark.parametrize("noise", [ScaledNoise(1), IntegratedScale(1)])
def test_of_natural_frequencies_with_an_inferred_scale_the_size_is_no_test(noise: NoiseModel) -> None:
    residuals = 20 * np.random.default_rng(16).standard_normal((1, 12)) * np.ones((200, 1))
    assert check_frequencies(residuals).finding == "misfit"
    hyper = np.full((200, len(noise.names)), float(np.sqrt((residuals**2).mean())))
    check = check_frequencies(residuals, noise, hyper, np.random.default_rng(1))
    assert (check.finding, check.absorbs) == ("explained", "size")
    assert check.chi2_per_line == pytest.approx(1, abs=0.3)
    assert float(check.inferred[0].split()[5]) == pytest.approx(hyper.mean() if hyper.size else 20, rel=0.3)


#: Ljung-Box statistics of white records, by their law's quantiles.
WHITE = stats.chi2(5).ppf((np.arange(4000) + 0.5) / 4000)
MORE_WHITE = Whiteness(5.0, WHITE, (0.0, -0.11, 0.02, 0.0, 0.0), (0.1, -3.2, 0.6, 0.0, 0.0))


def finding_of(**changes: object) -> PredictiveCheck:
    """A check that finds nothing, but for what is changed."""
    fine = PredictiveCheck(1.0, 400, MORE_WHITE, 3.0, 0.5, (0, 0), np.ones(5))
    return replace(fine, **changes)


#: Level and pattern of the residuals, and what the table says of them.
TABLE = {
    ("far below", "white"): "noise overstated",
    ("far below", "correlated"): "noise overstated",
    ("below", "white"): "noise overstated",
    ("below", "correlated"): "misfit below the noise",
    ("as expected", "white"): "explained",
    ("as expected", "correlated"): "misfit",
    ("above", "white"): "misfit",
    ("above", "correlated"): "misfit",
}
LOW, HIGH = finding_of().chi2_band
LIMIT = MORE_WHITE.limit(FALSE_ALARM / 2)


@pytest.mark.parametrize("absorbs", ["nothing", "outliers", "size", "frequencies"])
@pytest.mark.parametrize(
    ("chi2", "level"),
    [
        (FAR_BELOW - 1e-6, "far below"),
        (FAR_BELOW + 1e-6, "below"),
        (LOW - 1e-6, "below"),
        (LOW + 1e-6, "as expected"),
        (1.0, "as expected"),
        (HIGH - 1e-6, "as expected"),
        (HIGH + 1e-6, "above"),
    ],
)
@pytest.mark.parametrize(("statistic", "pattern"), [(LIMIT - 1e-6, "white"), (LIMIT + 1e-6, "correlated")])
def test_each_cell_of_the_table_and_each_of_its_borders(
    absorbs: str, chi2: float, level: str, statistic: float, pattern: str
) -> None:
    if absorbs == "frequencies":
        if pattern == "correlated":
            return  # they have none
        whiteness = None
        n_tests = 2  # as of another test beside this one
    else:
        whiteness, n_tests = replace(MORE_WHITE, statistic=statistic), 0
    check = finding_of(chi2_per_line=chi2, whiteness=whiteness, absorbs=absorbs, n_tests=n_tests)
    assert (check.level, check.pattern) == (level, pattern)
    finding, said = TABLE[level, pattern], check.sentence
    assert check.finding == finding
    assert check.explains == (finding in ("explained", "noise overstated"))
    assert len(said) <= 200
    assert ("Do not use" in said) == (finding == "misfit")
    assert ("intervals are too wide" in said) == (finding == "noise overstated")
    assert ("does NOT explain" in said) == finding.startswith("misfit")
    assert said.startswith("The stated noise is overstated: ") == (finding == "noise overstated")
    assert bool(check.remedy) == (finding != "explained")
    assert (check.remedy in check.details) == check.explains
    if finding == "misfit" or finding == "explained":
        assert (check.misfit_p_value < FALSE_ALARM) == (finding == "misfit")


def test_the_remedy_is_one_that_is_not_taken_already() -> None:
    cells = ((level, *cell) for (level, _), (_, remedies) in ROWS.items() for cell in zip(COLUMNS, remedies))  # noqa: B905
    for level, absorbs, remedy in cells:
        assert not (absorbs == "size" and 'scale = "sampled"' in remedy)
        assert not (absorbs == "outliers" and "Student-t noise," in remedy)
        assert ("smaller" in remedy or "as small" in remedy) <= (level in ("far below", "below"))
    assert "Student-t" not in finding_of(largest_p_value=0.0, absorbs="outliers").details


def test_the_figure_that_failed_is_the_one_that_is_printed() -> None:
    correlated = replace(MORE_WHITE, statistic=22.0)
    said = finding_of(whiteness=correlated).details
    limit = MORE_WHITE.limit(0.005)
    assert limit == pytest.approx(stats.chi2(5).isf(0.005), rel=0.02)
    assert f"correlate (Ljung-Box statistic 22.0, white noise: up to {limit:.1f}; p < 0.001)" in said
    assert "most at 2 lines apart: by -0.11, 3.2 standard deviations of white noise" in said
    low, high = finding_of().chi2_band
    assert f"(99.5 % of replicated data: {low:.3g} to {high:.3g}; p = 0.49)" in said
    # as many digits as tell a figure from the limit that it passed
    close = finding_of(chi2_per_line=high + 1e-5)
    ratio = re.search(r"are (\S+) times .*? to (\S+);", close.details)
    assert float(ratio[1]) > float(ratio[2])
    assert float(ratio[2]) == pytest.approx(high, rel=1e-4)


def test_more_tests_share_one_level() -> None:
    alone, four = finding_of(), finding_of(n_tests=8)
    assert (alone.test_level, four.test_level) == (FALSE_ALARM / 2, FALSE_ALARM / 8)
    between = (alone.chi2_band[1] + four.chi2_band[1]) / 2
    assert finding_of(chi2_per_line=between).finding == "misfit"
    assert finding_of(chi2_per_line=between, n_tests=8).finding == "explained"
    correlated = replace(MORE_WHITE, statistic=MORE_WHITE.limit(0.002))
    assert finding_of(whiteness=correlated).finding == "misfit"
    assert finding_of(whiteness=correlated, n_tests=8).finding == "explained"


@pytest.mark.parametrize(("lines", "pairs", "parts"), [(8, 1, 2), (30, 1, 1), (80, 3, 1)])
def test_white_records_pass_the_limit_as_rarely_as_stated(lines: int, pairs: int, parts: int) -> None:
    rng = np.random.default_rng(15)
    draw = replicated_portmanteau
    statistics = np.concatenate([draw(lines, pairs, parts, rng) for _ in range(4)])
    limits = Whiteness(0.0, np.sort(draw(lines, pairs, parts, rng)), (), ())
    for level in (0.01, 0.005, 0.001):
        count = int((statistics > limits.limit(level)).sum())
        assert 0.6 * level * len(statistics) < count < 1.6 * level * len(statistics)
    middle = replace(limits, statistic=float(np.median(statistics)))
    assert middle.p_value == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize(("p_value", "stands_out"), [(0.00099, True), (0.00101, False)])
def test_student_t_noise_is_named_where_one_value_in_a_thousand_records_would_be_so_large(
    p_value: float, stands_out: bool
) -> None:
    assert ("use Student-t noise" in finding_of(largest_p_value=p_value).details) == stands_out
    assert "Student-t" not in finding_of(largest_p_value=p_value, chi2_per_line=9.0).details


def test_exact_data_with_noise_assumed_are_no_misfit() -> None:
    z = 0.026 * np.sin(np.arange(400) / 6)[None, :, None] * np.ones((5, 1, 1)) * (1 + 1j)
    check = checked(GaussianNoise(2), z, [])
    assert check.pattern == "correlated"
    assert (check.finding, check.explains) == ("noise overstated", True)
    assert "correlate" not in check.details
