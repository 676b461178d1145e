"""The sampler reproduces posteriors whose moments and marginals are known in closed form."""

import numpy as np
import pytest
from scipy import stats

from jointbayes.sampling import Proposal, SamplerSettings, fit_proposal, run_ensembles
from jointbayes.sampling.coordinate_maps import Identity
from jointbayes.sampling.diagnostics import autocorrelation_time
from jointbayes.sampling.distributions import StudentT
from tests.conftest import first_in_ci
from tests.science.known_densities import TARGETS

pytestmark = pytest.mark.science

ENSEMBLES, WALKERS = 4, 24
FULL = SamplerSettings(ENSEMBLES, WALKERS)
# fewer draws have larger errors, by which the tests judge: they are as sharp in relation to them
SHORTER = SamplerSettings(ENSEMBLES, WALKERS, tau_factor=20.0)


def sampled(target, seed, start=None, proposal=None, settings=SHORTER):
    rng = np.random.default_rng(seed)
    start = target.exact(ENSEMBLES * WALKERS, rng) if start is None else start
    start = start.reshape(ENSEMBLES, WALKERS, -1)
    chains = run_ensembles(target.log_density, start, rng, settings, proposal=proposal)
    assert chains.converged, chains.reason
    return chains.theta[:, chains.burn_in :]


def worst_moment_error(draws, target):
    """Largest error of a mean or covariance in its own Monte Carlo standard errors.

    Each moment is the mean of a statistic of the draws, whose standard error is sd / √(draws / τ) with the τ
    of that statistic.
    """
    centred = draws - target.mean
    rows, columns = np.triu_indices(len(target.mean))
    statistics = np.concatenate([centred, centred[..., rows] * centred[..., columns]], axis=-1)
    expected = np.concatenate([np.zeros(len(target.mean)), target.covariance[rows, columns]])
    ess = statistics[..., 0].size / autocorrelation_time(statistics)
    flat = statistics.reshape(-1, len(expected))
    return float(np.max(np.abs(flat.mean(axis=0) - expected) / (flat.std(axis=0) / np.sqrt(ess))))


def smallest_p_value(draws, target):
    """Kolmogorov-Smirnov test of each marginal, on draws 2 τ apart."""
    thinned = draws[:, :: int(np.ceil(2.0 * autocorrelation_time(draws).max()))]
    pairs = enumerate(target.marginals)
    return min(float(stats.kstest(thinned[..., k].ravel(), marginal).pvalue) for k, marginal in pairs)


@pytest.mark.parametrize("settings", first_in_ci([SHORTER, FULL], 1), ids=["shorter", "full"])
@pytest.mark.parametrize(
    # along a banana these moves are slow: .ci/run has it with the proposals below
    "name",
    [pytest.param(name, marks=[pytest.mark.long] * (name == "banana")) for name in TARGETS],
)
def test_sampler_reproduces_a_known_posterior(name, settings):
    draws = sampled(TARGETS[name], seed=11, settings=settings)
    assert worst_moment_error(draws, TARGETS[name]) < 4.0
    assert smallest_p_value(draws, TARGETS[name]) > 1e-3


@pytest.mark.parametrize("name", TARGETS)
def test_a_fitted_proposal_changes_no_posterior(name):
    target = TARGETS[name]
    near = 0.5 * target.exact(3000, np.random.default_rng(14))  # of another density
    proposal = fit_proposal(target.log_density, [Identity()], near, np.random.default_rng(15))
    draws = sampled(target, seed=16, proposal=proposal)
    assert worst_moment_error(draws, target) < 4.0
    assert smallest_p_value(draws, target) > 1e-3


def test_both_modes_and_their_weights_are_found_from_a_start_that_knows_neither():
    target = TARGETS["two modes"]
    rng = np.random.default_rng(17)
    # fitted to the left mode alone, of which it knows the width
    left = Proposal(StudentT(np.array([-3.0, 0.0]), np.eye(2), 5.0), efficiency=0.6)
    start = 4.0 * rng.normal(size=(ENSEMBLES * WALKERS, 2))
    draws = sampled(target, seed=18, start=start, proposal=left, settings=FULL)
    right = (draws[..., :1] > 0.0).astype(float)
    error = np.sqrt(0.7 * 0.3 * autocorrelation_time(right)[0] / right.size)
    expected = 1.0 - target.marginals[0](np.zeros(1))[0]
    assert abs(right.mean() - expected) < 4.0 * error < 0.1
    assert worst_moment_error(draws, target) < 4.0


@pytest.mark.long
def test_a_banana_is_explored_though_the_proposal_covers_a_corner_of_it():
    target = TARGETS["banana"]
    corner = Proposal(StudentT(np.zeros(2), 0.04 * np.eye(2), 5.0), efficiency=0.25)
    start = 0.3 * np.random.default_rng(19).normal(size=(ENSEMBLES * WALKERS, 2))
    draws = sampled(target, seed=20, start=start, proposal=corner)
    assert worst_moment_error(draws, target) < 4.0
    assert smallest_p_value(draws, target) > 1e-3
