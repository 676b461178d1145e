"""Ranks, their bands and coverage: right for uniform ranks, and not blind to a posterior that is wrong."""

import numpy as np
import pytest
from scipy import stats

from jointbayes.errors import ModelError
from jointbayes.studies.data_sets import coverage, ecdf, ecdf_band, judge, rank_statistic
from tests.one_line import refused

DRAWS, DATA_SETS = 63, 500


def judged(make_draws, seed=3, prior_sd=1.0, noise_sd=0.5):
    """Truths from a normal prior, one measurement each, and draws that someone makes from mean and sd of the posterior.

    The draws are of exp(θ); the right ones are log-normal.
    """
    rng = np.random.default_rng(seed)
    truth = rng.normal(0, prior_sd, DATA_SETS)
    data = truth + rng.normal(0, noise_sd, DATA_SETS)
    sd = (prior_sd**-2 + noise_sd**-2) ** -0.5
    mean = data * sd**2 / noise_sd**2
    ranks, intervals = [], []
    for true, centre in zip(truth, mean, strict=True):
        draws = make_draws(rng, centre, sd)
        ranks.append(rank_statistic([np.exp(true)], draws[:, None], DRAWS, rng)[0])
        intervals.append(np.quantile(draws, [0.025, 0.975]))
    (result,) = judge({"k": ranks}, {"k": intervals}, {"k": np.exp(truth)}, DRAWS)
    return result


def drawn(moved=0.0, wide=1.0):
    """Draws that lie so many standard deviations off, and are so many times as wide as they should be."""
    return lambda rng, mean, sd: np.exp(rng.normal(mean + moved * sd, wide * sd, 1000))


def wrong_jacobian(rng, mean, sd):
    # density over k taken for the density over ln k: weights k, which for a normal is a shift by sd²
    draws = np.exp(rng.normal(mean, sd, 4000))
    return rng.choice(draws, 1000, p=draws / draws.sum())


def test_ranks_of_a_right_posterior_lie_in_the_band_and_its_intervals_cover_95_per_cent():
    result = judged(drawn())
    assert result.inside_band
    assert result.p_value > 0.05
    assert 0.93 <= result.coverage.share <= 0.97


@pytest.mark.parametrize("wrong", [drawn(wide=0.8), drawn(0.25), wrong_jacobian])
def test_a_wrong_posterior_is_flagged(wrong):
    result = judged(wrong)
    assert not result.inside_band
    assert result.p_value < 0.01


def test_too_narrow_intervals_hold_too_few_truths():
    assert judged(drawn(wide=0.8)).coverage.interval95[1] < 0.95


@pytest.mark.parametrize(("n", "draws"), [(500, 63), (50, 127), (20, 31)])
def test_uniform_ranks_lie_in_the_band_with_its_probability(n, draws):
    band = ecdf_band(n, draws)
    rng = np.random.default_rng(11)
    shares = np.array([ecdf(rng.integers(0, draws + 1, n), draws) for _ in range(4000)])
    inside = ((shares >= band.low) & (shares <= band.high)).all(axis=1).mean()
    assert band.probability >= 0.95
    # 4000 simulations have a standard deviation of 0.35 %
    assert inside == pytest.approx(band.probability, abs=0.0105)
    assert band.probability < 0.965  # and it is no wider than the steps of a count need


def test_the_band_is_wider_than_pointwise_intervals_and_narrower_than_bonferroni():
    band = ecdf_band(200, 31)
    assert 0.05 / 31 < band.pointwise < 0.05
    single = stats.binom.interval(0.95, 200, band.position)
    assert (band.low * 200 <= single[0]).all()
    assert (band.high * 200 >= single[1]).all()


def test_a_single_point_has_the_binomial_interval():
    band = ecdf_band(100, 1)
    low, high = stats.binom.interval(0.95, 100, 0.5)
    assert (band.low[0] * 100, band.high[0] * 100) == (low, high)


def test_p_values_of_uniform_ranks_are_uniform_and_agree_with_the_band():
    rng = np.random.default_rng(5)
    ranks = {str(i): rng.integers(0, 32, 100) for i in range(300)}
    same = dict.fromkeys(ranks, np.tile([0.0, 1.0], (100, 1)))
    results = judge(ranks, same, dict.fromkeys(ranks, np.full(100, 0.5)), 31)
    p_values = [r.p_value for r in results]
    assert np.mean(np.array(p_values) < 0.05) == pytest.approx(0.05, abs=0.035)
    assert np.mean(p_values) == pytest.approx(0.5, abs=0.06)
    assert all(r.inside_band == (r.p_value > 1 - r.band.probability) for r in results)


def test_a_rank_counts_the_draws_below_and_parts_ties_evenly():
    rng = np.random.default_rng(1)
    assert rank_statistic([3.5], np.arange(10.0)[:, None], 10, rng).tolist() == [4]
    tied = [rank_statistic([0.0], np.zeros((5, 1)), 5, rng)[0] for _ in range(600)]
    assert np.bincount(tied, minlength=6) == pytest.approx(100, abs=40)


def test_coverage_comes_with_what_so_few_cases_can_tell():
    found = coverage(np.tile([0.0, 1.0], (20, 1)), np.linspace(-0.05, 1.0, 20))
    assert (found.inside, found.total) == (19, 20)
    assert found.interval95 == pytest.approx((0.7513, 0.9987), abs=1e-4)  # Clopper and Pearson's table


@pytest.mark.whole
def test_the_words_of_a_finding_name_what_is_wrong():
    above, below = judged(drawn(0.5)), judged(drawn(-0.5))
    assert (above.finding, below.finding) == ("draws lie above the truths", "draws lie below the truths")
    assert below.largest_deviation < -0.1 < 0.1 < above.largest_deviation
    assert judged(drawn(wide=0.8)).finding == "posteriors are too narrow"
    assert judged(drawn(wide=1.5)).finding == "posteriors are too wide"


def test_data_sets_without_a_posterior_are_not_left_out():
    ranks = {"k": np.random.default_rng(8).integers(0, 64, 400)}
    intervals, truths = {"k": np.tile([0.0, 1.0], (400, 1))}, {"k": np.full(400, 0.5)}
    whole = judge(ranks, intervals, truths, 63)[0]
    few = judge(ranks, intervals, truths, 63, missing=4)[0]
    many = judge(ranks, intervals, truths, 63, missing=100)[0]
    assert whole.p_value > 0.05
    assert many.p_value < 1e-6
    assert not many.inside_band
    assert few.p_value > 0.01  # four of 404 are no more than chance
    assert (many.coverage.inside, many.coverage.total) == (400, 500)


def test_missing_ranks_count_at_the_end_that_looks_worse():
    low, high = np.zeros(300, dtype=int), np.full(300, 63)
    rng = np.random.default_rng(9)
    for end in (low, high):
        ranks = np.concatenate([rng.integers(0, 64, 300), end[:15]])
        one = {"k": np.tile([0.0, 1.0], (ranks.size, 1))}, {"k": np.full(ranks.size, 0.5)}
        without = judge({"k": ranks}, *one, 63)[0].p_value
        assert judge({"k": ranks}, *one, 63, missing=15)[0].p_value < without


@pytest.mark.parametrize("call", [
    lambda rng: rank_statistic([0.0], np.zeros((5, 1)), 6, rng),
    lambda rng: rank_statistic([0.0, 1.0], np.zeros((5, 1)), 5, rng),
    lambda rng: rank_statistic([np.nan], np.zeros((5, 1)), 5, rng),
])  # fmt: skip
def test_impossible_input_is_refused_in_words(call):
    refused(lambda: call(np.random.default_rng(0)), ModelError, r"expected|correct")
