"""What a campaign says of the population its joints come from: mean and scatter of each coordinate, and of stiffness.

Each joint was inferred by itself, under its own prior. Its draws are reweighted to the population, whose mean μ and
scatter σ are inferred at the same time; so each joint's estimate is drawn towards the population, the more the less its
own data tell. This knows nothing of beams, files or reports.

References
----------
D. W. Hogg, A. D. Myers, J. Bovy (2010). Inferring the eccentricity distribution. The Astrophysical Journal 725,
2166-2175. DOI 10.1088/0004-637X/725/2/2166
D. Lunn, J. Barrett, M. Sweeting, S. Thompson (2013). Fully Bayesian hierarchical modelling in two stages, with
application to meta-analysis. Journal of the Royal Statistical Society C 62(4), 551-572. DOI 10.1111/rssc.12007
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, ndtr, ndtri

from jointbayes.joint import Parametrisation
from jointbayes.sampling import LogDensity, Proposal, SamplerSettings, StudentT, fit_proposal, run_ensembles
from jointbayes.sampling.density import newton_climb
from jointbayes.sampling.distributions import WeightedDraws, resampled
from vibrecords.arrays import Array

#: Effective draws below which a joint's reweighted draws are not to be trusted: its median is then uncertain by more
#: than a quarter of its standard deviation.
LEAST_EFFECTIVE = 20.0
#: Least scatter of a population, in typical standard deviations of a single joint: draws of joints tell no smaller one.
RESOLVED = 0.15
#: Independent draws of a population below which its intervals are not to be used.
FEWEST_POPULATIONS = 100.0
_DRAWS = 1000  # of the population
_ENOUGH = 300.0  # effective, of these
_AVERAGED = 60  # populations over which the weights of a joint's draws are averaged
_EM_STEPS = 25
_DOF = 5.0
_INSIDE = 1.5  # times the least scatter: where the search for the mode begins at the least
_LARGEST = 30.0  # ln of a scatter beyond which squares leave the range of numbers
_FITTED, _WALKED = 300_000, 30_000  # draws of all joints up to which a density as dear as this is fitted, and walked
_RUN = SamplerSettings(
    walkers=24, check_every=25, max_steps=1000, tau_factor=10.0, tau_tolerance=0.1, end_tolerance=0.1
)
_POPULATIONS, _JOINTS = 300, 2000  # drawn to say what a population means in stiffness


_AT_ONCE = 4_000_000  # weights in memory
_LN_2PI = float(np.log(2 * np.pi))


@dataclass(frozen=True, slots=True, eq=False)
class JointDraws:
    """Posterior draws of many joints in the same coordinates, as many of each.

    Parameters
    ----------
    theta
        Draws, shape (joints, n, d). Those of a joint with fewer are filled up, with any finite numbers.
    log_prior
        ln of the density over these coordinates that each was drawn under, shape (joints, n), up to a constant for each
        joint; +inf where there is no draw.
    """

    theta: Array
    log_prior: Array

    @classmethod
    def stacked(cls, theta: list[Array], log_prior: list[Array]) -> Self:
        """From draws (n_j, d) and log priors (n_j,) of each joint."""
        whole = np.zeros((len(theta), max(map(len, theta)), theta[0].shape[-1]))
        density = np.full(whole.shape[:2], np.inf)
        for j, (draws, value) in enumerate(zip(theta, log_prior, strict=True)):
            whole[j] = draws[:1]
            whole[j, : len(draws)], density[j, : len(draws)] = draws, value
        return cls(whole, density)

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number of draws of each joint, shape (joints,)."""
        return (self.log_prior < np.inf).sum(axis=1)

    @property
    def mean(self) -> Array:
        """Mean of each joint's draws under its own prior, shape (joints, d)."""
        there = (self.log_prior < np.inf)[..., None]
        return np.asarray((self.theta * there).sum(axis=1) / self.counts[:, None])

    @property
    def variance(self) -> Array:
        """Variance of each joint's draws under its own prior, shape (joints, d)."""
        there = (self.log_prior < np.inf)[..., None]
        apart = (self.theta - self.mean[:, None]) * there
        return np.asarray((apart**2).sum(axis=1) / self.counts[:, None])


class Reweighting:
    """Probability of all data given a population's mean and scatter, from draws made without knowing the population.

    The population is normal and independent in each coordinate, cut off where there is no positive definite joint. A
    joint's data have, up to a constant, the probability ∫ p(data | θ) p(θ | μ, σ) dθ, which is the mean over its
    posterior draws of p(θ | μ, σ)/π(θ), π being the prior they were drawn under (Hogg, Myers and Bovy 2010, Eq. 9).

    Parameters
    ----------
    draws
        Of all joints.
    parametrisation
        Says where joints are positive definite; None where every θ is possible.

    References
    ----------
    D. W. Hogg, A. D. Myers, J. Bovy, Inferring the eccentricity distribution (2010),
    DOI 10.1088/0004-637X/725/2/2166.
    """

    def __init__(self, draws: JointDraws, parametrisation: Parametrisation | None = None) -> None:
        self.draws, self.parametrisation = draws, parametrisation
        self._centre: Array = np.median(draws.mean, axis=0)
        apart = np.ascontiguousarray((draws.theta - self._centre).reshape(-1, draws.theta.shape[2]).T)
        # ln p(θ | μ, σ) is linear in θ² and θ: one matrix product for all draws and many populations
        self._powers, self._log_prior = np.concatenate([apart**2, apart]), draws.log_prior.ravel()

    def log_likelihood(self, mean: ArrayLike, scatter: ArrayLike) -> Array:
        """ln of the probability of all data, up to a constant, shape (p,).

        A mean of few weights is on average too low in its logarithm by half of its relative variance; that is added.

        Parameters
        ----------
        mean, scatter
            Of the populations, in each coordinate: shape (p, d).
        """
        mu, sigma = np.atleast_2d(np.asarray(mean, float)), np.atleast_2d(np.asarray(scatter, float))
        total = np.empty(len(mu))
        share = 1 / self.draws.counts
        for rows, log_weight in self._blocks(mu, sigma):
            top = log_weight.max(axis=2)
            weight = _exponential(log_weight, top)
            first = weight.sum(axis=2)
            np.multiply(weight, weight, out=weight)
            error = np.maximum(weight.sum(axis=2) / first**2 - share, 0.0)
            total[rows] = (top + np.log(first * share) + error / 2).sum(axis=1)
        return total - len(share) * self.log_possible(mu, sigma)

    def weights(self, mean: Array, scatter: Array) -> tuple[Array, Array]:
        """Weight of each draw, averaged over populations, and each joint's effective number of draws.

        Parameters
        ----------
        mean, scatter
            Equally probable populations, shape (p, d).

        Returns
        -------
        weight : ndarray, shape (joints, n)
            Sums to one for each joint.
        effective : ndarray, shape (joints,)
            1/Σw² of the weights under one population, on average over the populations.
        """
        mixed, effective = np.zeros(self.draws.log_prior.shape), np.zeros(len(self.draws.theta))
        for _, log_weight in self._blocks(mean, scatter):
            weight = _exponential(log_weight, log_weight.max(axis=2))
            weight /= weight.sum(axis=2, keepdims=True)
            mixed += weight.sum(axis=0)
            effective += (1 / (weight**2).sum(axis=2)).sum(axis=0)
        return mixed / len(mean), effective / len(mean)

    def score_covariance(self, mean: Array, scatter: Array) -> Array:
        """Monte Carlo covariance of the slope of `log_likelihood` over (μ, ln σ) at one population, shape (2d, 2d).

        What so few draws of each joint leave uncertain about the slope, and so about the place of the maximum.
        """
        weight, _ = self.weights(mean[None], scatter[None])
        z = (self.draws.theta - mean) / scatter
        slope = np.concatenate([z / scatter, z**2 - 1], axis=2)
        slope -= np.einsum("jn,jnk->jk", weight, slope)[:, None]
        slope *= weight[..., None]
        flat = slope.reshape(-1, slope.shape[2])
        return np.asarray(flat.T @ flat)

    def moments(self, mean: Array, scatter: Array) -> tuple[Array, Array]:
        """Mean and scatter, each (d,), that joints have if they come from this population: one step of EM."""
        weight, _ = self.weights(mean[None], scatter[None])
        middle = np.einsum("jn,jnk->k", weight, self.draws.theta) / len(weight)
        square = np.einsum("jn,jnk->k", weight, (self.draws.theta - middle) ** 2) / len(weight)
        return middle, np.sqrt(square)

    def log_possible(self, mean: Array, scatter: Array) -> Array:
        """ln of the probability of a positive definite joint in populations of shape (p, d), shape (p,)."""
        total = np.zeros(len(mean))
        if self.parametrisation is None:
            return total
        for cone in self.parametrisation.cones:
            normal = cone.normal(mean.shape[1])
            total += log_ndtr(-(mean @ normal) / np.sqrt(scatter**2 @ normal**2))
        for i, axis in enumerate(self.parametrisation.axes):
            if axis.bounded:
                low, high = ((end - mean[:, i]) / scatter[:, i] for end in axis.bounds)
                total += np.log(np.maximum(ndtr(high) - ndtr(low), np.finfo(float).tiny))
        return total

    def _blocks(self, mean: Array, scatter: Array) -> Iterator[tuple[slice, Array]]:
        """Rows of populations and ln of the weight of each draw under them, shape (rows, joints, n)."""
        joints, n, d = self.draws.theta.shape
        step = max(1, _AT_ONCE // (joints * n))
        mu, precision = mean - self._centre, 1 / scatter**2
        factors = np.concatenate([-precision / 2, mu * precision], axis=1)
        constant = -(mu**2 * precision).sum(axis=1) / 2 - np.log(scatter).sum(axis=1) - d * _LN_2PI / 2
        for first in range(0, len(mu), step):
            rows = slice(first, first + step)
            log_weight = factors[rows] @ self._powers
            log_weight += constant[rows, None]
            log_weight -= self._log_prior
            yield rows, log_weight.reshape(-1, joints, n)


def _exponential(log_weight: Array, top: Array) -> Array:
    """exp(ln w − its largest), written over ln w: memory is what this is short of."""
    log_weight -= top[..., None]
    return np.asarray(np.exp(log_weight, out=log_weight))


@dataclass(frozen=True, slots=True, eq=False)
class PopulationPrior:
    """What is assumed of a population before its joints: μ normal, σ half-normal, in each coordinate.

    Parameters
    ----------
    mean, sd
        Of the prior of μ, each shape (d,).
    scale
        Of the half-normal prior of σ, shape (d,).

    Raises
    ------
    ModelError
        If shapes differ or a number is impossible.
    """

    mean: Array
    sd: Array
    scale: Array

    @classmethod
    def from_joints(cls, mean: ArrayLike, sd: ArrayLike) -> "PopulationPrior":
        """From the priors of the single joints, mean and standard deviation of each, shape (joints, d).

        μ has the mean and the variance of their mixture, and σ is half-normal with its standard deviation: a
        population is somewhere where a joint was thought possible, and is no wider than that.
        """
        middle, spread = np.atleast_2d(np.asarray(mean, float)), np.atleast_2d(np.asarray(sd, float))
        width = np.sqrt((spread**2).mean(axis=0) + middle.var(axis=0))
        return cls(middle.mean(axis=0), width, width)

    def log_density(self, mean: Array, log_scatter: Array) -> Array:
        """ln of the density over (μ, ln σ), up to a constant, shape (p,), at arrays of shape (p, d)."""
        square = ((mean - self.mean) / self.sd) ** 2 + np.exp(2 * log_scatter) / self.scale**2
        return np.asarray((log_scatter - square / 2).sum(axis=1))


@dataclass(frozen=True, slots=True, eq=False)
class Population:
    """Posterior of a population's mean and scatter, and what it makes of each joint.

    Parameters
    ----------
    mean, scatter
        Equally weighted draws of μ and σ in each coordinate, shape (p, d).
    weight
        Weight of each draw of each joint, averaged over the population's posterior, shape (joints, n).
    effective
        Each joint's effective number of draws, shape (joints,).
    monte_carlo
        Monte Carlo standard error of the posterior means of μ and of ln σ, which comes from the joints' few draws, as a
        share of their posterior standard deviations, shape (2, d).
    effective_populations
        Independent draws that `mean` and `scatter` are worth.
    how
        How they were drawn, in words.
    converged
        Whether these are enough to be used: walkers that met their stop rule, or weighted draws worth
        `FEWEST_POPULATIONS` independent ones.
    """

    mean: Array
    scatter: Array
    weight: Array
    effective: Array
    monte_carlo: Array
    effective_populations: float
    how: str
    converged: bool

    def unresolved(self, draws: JointDraws) -> NDArray[np.bool_]:
        """Whether joints do not tell a coordinate's scatter from none, shape (d,): then only its upper end counts."""
        least = RESOLVED * np.sqrt(np.median(draws.variance, axis=0))
        return np.asarray(np.quantile(self.scatter, 0.025, axis=0) < 1.5 * least)

    @property
    def trusted(self) -> NDArray[np.bool_]:
        """Whether a joint's reweighted draws may be trusted, shape (joints,)."""
        return np.asarray(self.effective >= LEAST_EFFECTIVE)

    def shrunken(self, values: Array) -> Array:
        """Median and 95 % interval of each joint given all the others, shape (joints, 3): 2.5, 50 and 97.5 %.

        Parameters
        ----------
        values
            A quantity at each draw of each joint, shape (joints, n).
        """
        return weighted_quantiles(values, self.weight, (0.025, 0.5, 0.975))


def hierarchical_posterior(
    draws: JointDraws, prior: PopulationPrior, parametrisation: Parametrisation | None = None, seed: int = 1
) -> Population:
    """Infer mean and scatter of the population that joints come from, and each joint given the others.

    The posterior over (μ, ln σ) is drawn by importance sampling from a Student-t distribution about its mode, or from a
    fitted mixture of these where that is not good enough; of few joints, by ensembles of walkers where neither is. A
    scatter below `RESOLVED` times the joints' own standard deviation is not looked at.

    Parameters
    ----------
    draws
        Posterior draws of each joint with the log density of the prior they were drawn under.
    prior
        Of μ and σ.
    parametrisation
        Whose coordinates these are: where joints are positive definite; None where every θ is possible.
    seed
        Of all random numbers.

    Raises
    ------
    ModelError
        If the prior is of other coordinates than the draws.
    """
    d = draws.theta.shape[2]
    target = Reweighting(draws, parametrisation)

    least = np.log(RESOLVED * np.sqrt(np.median(draws.variance, axis=0)))

    def log_density(phi: Array) -> Array:
        mu, log_scatter = phi[:, :d], phi[:, d:]
        log_densities = np.full(len(phi), -np.inf)
        inside = (log_scatter >= least).all(axis=1) & (log_scatter < _LARGEST).all(axis=1) & np.isfinite(mu).all(axis=1)
        if inside.any():
            here = target.log_likelihood(mu[inside], np.exp(log_scatter[inside]))
            log_densities[inside] = here + prior.log_density(mu[inside], log_scatter[inside])
        return log_densities

    phi, effective, how, converged = _drawn(target, log_density, prior, least, np.random.default_rng([seed, 7]))
    mean, scatter = phi[:, :d], np.exp(phi[:, d:])
    rows = np.linspace(0, len(phi) - 1, min(_AVERAGED, len(phi))).round().astype(int)
    weight, of_joints = target.weights(mean[rows], scatter[rows])
    middle = phi.mean(axis=0)
    noise = target.score_covariance(middle[:d], np.exp(middle[d:]))
    spread = np.atleast_2d(np.cov(phi.T))
    error = np.sqrt(np.diag(spread @ noise @ spread) / np.diag(spread))
    return Population(mean, scatter, weight, of_joints, error.reshape(2, d), effective, how, converged)


def _drawn(
    target: Reweighting, log_density: LogDensity, prior: PopulationPrior, least: Array, rng: np.random.Generator
) -> tuple[Array, float, str, bool]:
    """Equally weighted draws, shape (p, 2d), how many independent ones they are worth, how they came about, if enough.

    The first proposal that is good enough, the cheap ones first; of many joints a fit to the density itself would take
    minutes, and the best so far is taken.
    """
    mode, covariance = _mode(target, log_density, least)
    numbers = target.draws.log_prior.size
    best: tuple[Array, float, str] | None = None
    proposal = Proposal(StudentT(mode, covariance, _DOF), 0.0, 0)
    for how in ("a Student-t distribution about the mode", "a fit to joints taken as Gaussian", "a fitted mixture"):
        if how == "a fit to joints taken as Gaussian":
            proposal = fit_proposal(_gaussian_joints(target.draws, prior, least), [None], [(mode, covariance)], rng)
        elif how == "a fitted mixture":
            if numbers > _FITTED:
                break
            proposal = fit_proposal(log_density, [None], [(mode, covariance)], rng, enough=_ENOUGH / _DRAWS)
        theta, effective = _importance(log_density, proposal, rng)
        if best is None or effective > best[1]:
            best = theta, effective, f"importance sampling from {how}"
        if effective >= _ENOUGH:
            break
    assert best is not None
    if best[1] >= _ENOUGH or numbers > _WALKED:
        return *best, best[1] >= FEWEST_POPULATIONS
    rows = rng.choice(len(best[0]), (_RUN.ensembles, _RUN.walkers))
    start = best[0][rows] + 1e-3 * np.sqrt(np.diag(covariance)) * np.abs(rng.normal(size=(*rows.shape, mode.size)))
    chains = run_ensembles(log_density, start, rng, _RUN, proposal=proposal)
    theta = chains.draws().theta.reshape(-1, mode.size)
    chosen = np.linspace(0, len(theta) - 1, min(4 * _DRAWS, len(theta))).round().astype(int)
    return theta[chosen], float(chains.ess.min()), f"ensembles of walkers: {chains.reason}", chains.converged


def _mode(target: Reweighting, log_density: LogDensity, least: Array) -> tuple[Array, Array]:
    """Mode of the density over (μ, ln σ) and the covariance there: steps of EM, then a climb."""
    middle = target.draws.mean
    floor = _INSIDE * np.exp(least)
    mean, scatter = np.median(middle, axis=0), np.maximum(middle.std(axis=0), floor)
    for _ in range(_EM_STEPS):
        mean, scatter = target.moments(mean, scatter)
        scatter = np.maximum(scatter, floor)
    joints = len(middle)
    width = np.concatenate([scatter / np.sqrt(joints), np.full(mean.size, 1 / np.sqrt(2 * joints))])
    start = np.concatenate([mean, np.log(scatter)])
    mode, _, covariance = newton_climb(
        log_density, start, np.diag(width**2), step=0.2, gain=1e-3, least=1e-3, settled=4.0
    )
    return mode, covariance


def _gaussian_joints(draws: JointDraws, prior: PopulationPrior, least: Array) -> LogDensity:
    """The density over (μ, ln σ) if joints were Gaussian and their own priors flat: nearly the true one, and cheap."""
    middle, variance, d = draws.mean, draws.variance, draws.theta.shape[2]

    def log_density(phi: Array) -> Array:
        mu, log_scatter = phi[:, :d], np.clip(phi[:, d:], least, _LARGEST)
        total = np.exp(2 * log_scatter)[:, None] + variance
        value = -0.5 * ((middle - mu[:, None]) ** 2 / total + np.log(total)).sum(axis=(1, 2))
        inside = (phi[:, d:] == log_scatter).all(axis=1)
        return np.where(inside, value + prior.log_density(mu, log_scatter), -np.inf)

    return log_density


def _importance(log_density: LogDensity, proposal: Proposal, rng: np.random.Generator) -> tuple[Array, float]:
    """Equally weighted draws by their importance weights, and how many independent ones they are worth."""
    drawn = WeightedDraws(*proposal.weighted_draws(log_density, rng, _DRAWS))
    if not len(drawn.theta):
        return drawn.theta, 0.0
    return drawn.theta[rng.permutation(resampled(drawn.weight, _DRAWS, rng))], drawn.effective


@dataclass(frozen=True, slots=True, eq=False)
class PopulationStiffness:
    """One stiffness over a population; each row is median, lower and upper end of the 95 % credible interval.

    Parameters
    ----------
    name, unit
        Of the stiffness.
    median, low95, high95
        Median of the population, and the ends of the range that holds 95 % of its joints, in `unit`, shape (3,) each.
    scatter
        Standard deviation of the population: of ln k, shape (3,); in `unit` where a joint may have either sign.
    logarithmic
        Whether the scatter is that of ln k.
    """

    name: str
    unit: str
    median: Array
    low95: Array
    high95: Array
    scatter: Array
    logarithmic: bool


def population_stiffness(
    population: Population, parametrisation: Parametrisation, seed: int = 1
) -> tuple[PopulationStiffness, ...]:
    """What a population means in stiffness: from joints drawn from it, for each of several hundred draws of it.

    Parameters
    ----------
    population
        Over the coordinates of the parametrisation.
    parametrisation
        Turns them into stiffness, and says which joints are positive definite.
    seed
        Of the random numbers.
    """
    rng = np.random.default_rng([seed, 8])
    d = population.mean.shape[1]
    strata = ndtri((np.arange(_JOINTS) + 0.5) / _JOINTS)  # evenly spread: quantiles of one coordinate are all but exact
    z = np.stack([rng.permutation(strata) for _ in range(d)], axis=1)
    rows = np.linspace(0, len(population.mean) - 1, min(_POPULATIONS, len(population.mean))).round().astype(int)
    summaries = []
    for mu, sigma in zip(population.mean[rows], population.scatter[rows], strict=True):
        theta = mu + sigma * z
        k = parametrisation.values(theta[parametrisation.feasible(theta)])
        if len(k) > 1:
            log = np.log(np.where(k > 0, k, 1.0))
            summaries.append((*np.quantile(k, [0.5, 0.025, 0.975], axis=0), log.std(axis=0), k.std(axis=0)))
    # (populations, 5, quantities)
    ends = np.quantile(np.array(summaries), [0.5, 0.025, 0.975], axis=0)
    logarithmic = {axis.name for axis in parametrisation.axes if axis.logarithmic}
    stiffness = []
    for i, quantity in enumerate(parametrisation.quantities):
        positive = quantity.name in logarithmic or not quantity.may_be_negative
        median, low, high, of_logarithm, of_itself = ends[:, :, i].T
        scatter = of_logarithm if positive else of_itself
        stiffness.append(PopulationStiffness(quantity.name, quantity.unit, median, low, high, scatter, positive))
    return tuple(stiffness)


def weighted_quantiles(values: Array, weight: Array, probabilities: tuple[float, ...]) -> Array:
    """Quantiles of weighted draws, row by row: shape (rows, len(probabilities)).

    Parameters
    ----------
    values, weight
        Shape (rows, n); the weights of a row sum to one.
    probabilities
        Of the quantiles.
    """
    order = np.argsort(values, axis=1)
    ranked = np.take_along_axis(values, order, axis=1)
    share = np.take_along_axis(weight, order, axis=1)
    middle = np.cumsum(share, axis=1) - share / 2
    return np.array([np.interp(probabilities, at, row) for at, row in zip(middle, ranked, strict=True)])
