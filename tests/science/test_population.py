"""A sample of `make science`: mean and scatter of a known population, from joints measured and inferred one by one."""

import json

import numpy as np
import pytest
from benchmarks import population
from benchmarks.population import MEAN, NAMES, SCATTER, posterior_draws, repetition, section, summary

pytestmark = pytest.mark.science

JOINTS, CAMPAIGNS = 60, 4


@pytest.fixture(scope="module")
def found():
    return [repetition(index, JOINTS) for index in range(CAMPAIGNS)]


@pytest.mark.long
def test_mean_and_scatter_are_those_of_the_population(found):
    scores = np.array([one.score for one in found])
    assert np.abs(scores).max() < 3.9  # of 24 normal ones, in 499 of 500 samples
    assert np.abs(scores.mean(axis=0)).max() < 3.2 / np.sqrt(CAMPAIGNS)


@pytest.mark.long
def test_the_joints_errors_are_no_part_of_the_scatter(found):
    # the error of k11 is as large as its scatter: left in, the scatter would be 1.4 times as large
    ratio = np.exp(np.mean([np.log([ends[1] for ends in one.scatter]) for one in found], axis=0)) / SCATTER
    assert ratio == pytest.approx(1, abs=0.25)


@pytest.mark.long
def test_posteriors_are_good_enough_to_be_reweighted(found):
    assert min(one.least_effective for one in found) > 300
    assert max(one.monte_carlo for one in found) < 0.3


def test_draws_of_a_joint_have_the_density_of_its_posterior():
    rng = np.random.default_rng(3)
    problem = population.measured(MEAN, rng)
    draws, _ = posterior_draws(problem, MEAN, rng)
    other, _ = posterior_draws(problem, MEAN, np.random.default_rng(4))
    assert (draws.mean(axis=0) - other.mean(axis=0)) / draws.std(axis=0) == pytest.approx(0, abs=0.3)
    # of a Gaussian posterior in d = 3, ln p lies 3/2 below its top on average
    below = problem.log_posterior(draws).max() - problem.log_posterior(draws).mean()
    assert below == pytest.approx(1.5, abs=0.4)
    assert (draws.std(axis=0) / SCATTER > [0.5, 0.2, 0.05]).all()


@pytest.mark.long
def test_the_same_repetition_is_the_same_and_others_share_no_joint(found):
    again = repetition(1, JOINTS)
    assert again.score == found[1].score
    assert len({one.score for one in found}) == CAMPAIGNS


@pytest.mark.long
def test_the_page_says_what_was_found(found):
    data = summary(found)
    text = section(data)
    for name in NAMES:
        row = data["rows"][f"scatter of ln {name}"]
        assert f"{row['inside']} of {CAMPAIGNS}" in text


@pytest.mark.skipif(not population.SUMMARY.exists(), reason="`make science` has not been run")
def test_the_published_study_finds_mean_and_scatter_of_every_stiffness():
    data = json.loads(population.SUMMARY.read_text(encoding="utf-8"))
    assert section(data) in population.PAGE.read_text(encoding="utf-8")
    assert data["repetitions"] >= 100
    for name, row in data["rows"].items():
        low, high = row["coverage_interval95"]
        assert low <= 0.98, name
        assert high >= 0.92, name
        assert abs(row["mean_score"]) < 4 / np.sqrt(data["repetitions"]), name
