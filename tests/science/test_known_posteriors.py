"""The sampler reproduces posteriors whose moments and marginals are known in closed form."""

from collections.abc import Callable
from dataclasses import dataclass

import emcee
import numpy as np
import pytest
from scipy import stats

from jointbayes.sampling import SamplerSettings, autocorrelation_time, run_ensembles

pytestmark = pytest.mark.science

ENSEMBLES, WALKERS = 4, 24


@dataclass(frozen=True)
class Target:
    """A density with known mean, covariance, marginal distributions and an exact sampler."""

    log_density: Callable[[np.ndarray], np.ndarray]
    exact: Callable[[int, np.random.Generator], np.ndarray]
    mean: np.ndarray
    covariance: np.ndarray
    marginals: tuple[Callable[[np.ndarray], np.ndarray], ...]


def gaussian(dimension):
    scale = np.linspace(1.0, 3.0, dimension)
    correlation = 0.9 ** np.abs(np.subtract.outer(np.arange(dimension), np.arange(dimension)))
    covariance = correlation * np.outer(scale, scale)
    precision, factor = np.linalg.inv(covariance), np.linalg.cholesky(covariance)
    mean = np.arange(dimension) - 1.0
    return Target(
        log_density=lambda x: -0.5 * np.einsum("ni,ij,nj->n", x - mean, precision, x - mean),
        exact=lambda n, rng: mean + rng.normal(size=(n, dimension)) @ factor.T,
        mean=mean,
        covariance=covariance,
        marginals=tuple(stats.norm(m, s).cdf for m, s in zip(mean, scale, strict=True)),
    )


def student_t(freedom=5, dimension=3):
    def exact(n, rng):
        return rng.normal(size=(n, dimension)) / np.sqrt(rng.chisquare(freedom, size=(n, 1)) / freedom)

    return Target(
        log_density=lambda x: -0.5 * (freedom + dimension) * np.log1p(np.sum(x**2, axis=1) / freedom),
        exact=exact,
        mean=np.zeros(dimension),
        covariance=np.eye(dimension) * freedom / (freedom - 2),
        marginals=(stats.t(freedom).cdf,) * dimension,
    )


def banana(width=0.5):
    """x ~ N(0, 1), y | x ~ N(x², width²): E y = 1, var y = 2 + width², cov = 0."""

    def exact(n, rng):
        x = rng.normal(size=n)
        return np.column_stack([x, x**2 + width * rng.normal(size=n)])

    grid = np.linspace(-8.0, 80.0, 4001)
    nodes, weights = np.polynomial.hermite_e.hermegauss(200)
    distribution = stats.norm.cdf((grid[:, None] - nodes**2) / width) @ (weights / weights.sum())
    return Target(
        log_density=lambda x: -0.5 * (x[:, 0] ** 2 + ((x[:, 1] - x[:, 0] ** 2) / width) ** 2),
        exact=exact,
        mean=np.array([0.0, 1.0]),
        covariance=np.diag([1.0, 2.0 + width**2]),
        marginals=(stats.norm.cdf, lambda y: np.interp(y, grid, distribution)),
    )


def truncated_gaussian():
    """Unit Gaussian in 2-D of which only x > 1 is left: a hard wall through the bulk."""

    def exact(n, rng):
        return np.column_stack([stats.truncnorm.rvs(1.0, np.inf, size=n, random_state=rng), rng.normal(size=n)])

    wall = stats.truncnorm(1.0, np.inf)
    return Target(
        log_density=lambda x: np.where(x[:, 0] > 1.0, -0.5 * np.sum(x**2, axis=1), -np.inf),
        exact=exact,
        mean=np.array([wall.mean(), 0.0]),
        covariance=np.diag([wall.var(), 1.0]),
        marginals=(wall.cdf, stats.norm.cdf),
    )


TARGETS = {
    "gaussian-1": gaussian(1),
    "gaussian-3": gaussian(3),
    "gaussian-6": gaussian(6),
    "student-t": student_t(),
    "banana": banana(),
    "truncated": truncated_gaussian(),
}


def sampled(target, seed):
    rng = np.random.default_rng(seed)
    start = target.exact(ENSEMBLES * WALKERS, rng).reshape(ENSEMBLES, WALKERS, -1)
    chains = run_ensembles(target.log_density, start, rng, SamplerSettings(ENSEMBLES, WALKERS))
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


@pytest.mark.parametrize("name", TARGETS)
def test_sampler_reproduces_a_known_posterior(name):
    draws = sampled(TARGETS[name], seed=11)
    assert worst_moment_error(draws, TARGETS[name]) < 4.0
    assert smallest_p_value(draws, TARGETS[name]) > 1e-3


@pytest.mark.parametrize("name", TARGETS)
def test_closed_forms_are_those_of_the_exact_draws(name):
    draws = TARGETS[name].exact(40_000, np.random.default_rng(12)).reshape(4, 1000, 10, -1)
    assert worst_moment_error(draws, TARGETS[name]) < 4.0
    assert smallest_p_value(draws, TARGETS[name]) > 1e-3


def test_the_same_check_fails_for_the_biased_snooker_move():
    # emcee 3.1.6's DESnookerMove misses part of its Hastings factor above one dimension.
    target = TARGETS["gaussian-6"]
    rng = np.random.default_rng(13)
    chains = []
    for seed in range(ENSEMBLES):
        start = emcee.State(target.exact(WALKERS, rng), random_state=np.random.RandomState(seed).get_state())
        move = emcee.moves.DESnookerMove()
        sampler = emcee.EnsembleSampler(WALKERS, 6, target.log_density, moves=move, vectorize=True)
        sampler.run_mcmc(start, 2000)
        chains.append(sampler.get_chain(discard=200))
    assert worst_moment_error(np.stack(chains), target) > 8.0
