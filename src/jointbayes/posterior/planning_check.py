"""Whether a forecast holds: further measurements simulated, and their posteriors found, many times over.

Fisher information is of one point, and takes the posterior for Gaussian. Here the truth is drawn from the present
posterior, the further measurement is simulated with noise, and the posterior of the measurement in hand together with
the simulated one is found by importance sampling (nested Monte Carlo).

References
----------
Ryan, E. G. et al. (2016). A review of modern computational algorithms for Bayesian optimal design. International
Statistical Review 84(1), 128-154. DOI 10.1111/insr.12107
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import optimize

from jointbayes.errors import JointBayesError, ModelError
from jointbayes.inference import LogPosterior, Problem
from jointbayes.joint import STIFFNESS_NAMES
from jointbayes.posterior.candidates import Candidate
from jointbayes.posterior.fisher import fisher_information
from jointbayes.posterior.planning import measurement_information
from jointbayes.sampling import Chart, fit_proposal

__all__ = ["Confirmation", "Spread", "WithFurther", "assumed_truth", "confirm", "spread_after", "weighted_posterior"]

Array = NDArray[np.float64]

#: Fewer effective importance draws than this say too little about a standard deviation: 7 % of it at best.
LEAST_EFFECTIVE = 100.0
#: So many times the draws are taken where the first ones leave fewer.
MORE = 4
#: A confirmation that lost more than this share of its simulated measurements is none.
MOST_LOST = 0.25


class WithFurther:
    """ln p(θ | present data, further data) up to the evidence: measurements independent given θ.

    Parameters
    ----------
    present
        Posterior density of the measurement in hand.
    further
        Problems over the same parameters, of whose densities only the likelihood is added.
    """

    def __init__(self, present: LogPosterior, further: Sequence[Problem]) -> None:
        self._present, self._further = present, [one.log_posterior for one in further]

    def __call__(self, theta: ArrayLike) -> Array:
        """Log density, shape (n,), of θ, shape (n, d)."""
        t = np.atleast_2d(np.asarray(theta, dtype=float))
        out = self._present(t)
        inside = np.isfinite(out)
        if inside.any():
            out[inside] += sum(one.log_likelihood(t[inside]) for one in self._further)
        return out


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """A posterior in a few numbers.

    Parameters
    ----------
    sd
        Standard deviation of ln |k| of the chosen stiffness.
    covariance
        Of the joint's coordinates, shape (p, p).
    effective, drawn
        Effective number of importance draws behind it, and their number.
    """

    sd: float
    covariance: Array
    effective: float
    drawn: int


@dataclass(frozen=True, slots=True, eq=False)
class Confirmation:
    """What simulated measurements say about a set of candidates.

    Parameters
    ----------
    sd_before
        Posterior standard deviation of ln of the chosen stiffness now.
    sds
        The same after each simulated measurement, shape (found,). The truth decides it, and so does the noise.
    gains_nats
        Information about the joint that each brought, ½ ln det of the covariances before over after, shape (found,).
    simulated
        Measurements that were simulated; more than found where importance sampling did not find the posterior of some.
    efficiency
        Median efficiency of the importance sampling of those found.
    """

    sd_before: float
    sds: Array
    gains_nats: Array
    simulated: int
    efficiency: float

    @property
    def lost(self) -> int:
        """Simulated measurements whose posterior was not found well enough."""
        return self.simulated - self.sds.size

    @property
    def valid(self) -> bool:
        """Whether enough of the simulated posteriors were found: three in four, and two at least."""
        return self.sds.size >= 2 and self.lost <= MOST_LOST * self.simulated

    @property
    def sd_after(self) -> float:
        """Expected standard deviation after the measurement."""
        return float(self.sds.mean()) if self.sds.size else math.nan

    @property
    def sd_after_error(self) -> float:
        """Monte Carlo standard error of `sd_after`."""
        return _error_of_mean(self.sds)

    @property
    def sd_range(self) -> tuple[float, float]:
        """Central 80 % of the standard deviations found."""
        low, high = np.quantile(self.sds, [0.1, 0.9]) if self.sds.size else (math.nan, math.nan)
        return float(low), float(high)

    @property
    def gain_bits(self) -> float:
        """Expected information gain about the joint, bits."""
        return float(self.gains_nats.mean()) / math.log(2) if self.sds.size else math.nan

    @property
    def gain_bits_error(self) -> float:
        """Monte Carlo standard error of `gain_bits`."""
        return _error_of_mean(self.gains_nats) / math.log(2)


def confirm(
    problem: Problem,
    candidates: Sequence[Candidate],
    parameter: str,
    draws: Array,
    charts: Sequence[Chart],
    rng: np.random.Generator,
    *,
    truth: Array | None = None,
    simulations: int = 12,
    inner: int = 2000,
) -> Confirmation:
    """Expected posterior after a set of further measurements, by nested Monte Carlo.

    Parameters
    ----------
    problem
        The problem in hand.
    candidates
        The set.
    parameter
        ``"k11"``, ``"k12"`` or ``"k22"``.
    draws
        Draws of θ from the present posterior, shape (n, d), equally weighted.
    charts
        Coordinates in which the posterior is near a bell.
    rng
        Source of truths, noise and importance draws.
    truth
        θ that makes every simulated measurement, shape (d,), if it is assumed; by default drawn from `draws`.
    simulations
        How many further measurements to simulate.
    inner
        Importance draws for each.

    Raises
    ------
    ModelError
        If there are no candidates, no simulations, or too few draws.
    """
    if not candidates or simulations < 2 or len(draws) < 2:
        raise ModelError(
            f"planning: found {len(candidates)} candidates, {simulations} simulations, {len(draws)} draws; expected "
            "at least one candidate and two of the others"
        )
    before = _spread(problem, draws, np.zeros(len(draws)), parameter, len(draws))
    found: list[Spread] = []
    if truth is None:
        truths = draws[rng.choice(len(draws), simulations, replace=len(draws) < simulations)]
    else:
        truths = np.repeat(truth[None], simulations, axis=0)
    for one_truth in truths:
        one = spread_after(problem, candidates, parameter, one_truth, charts, rng, inner=inner)
        if one is not None:
            found.append(one)
    _, old = np.linalg.slogdet(before.covariance)
    gains = [(old - np.linalg.slogdet(one.covariance)[1]) / 2 for one in found]
    share = [one.effective / one.drawn for one in found]
    return Confirmation(
        before.sd,
        np.array([one.sd for one in found]),
        np.array(gains),
        simulations,
        float(np.median(share)) if share else 0.0,
    )


def spread_after(
    problem: Problem,
    candidates: Sequence[Candidate],
    parameter: str,
    truth: Array,
    charts: Sequence[Chart],
    rng: np.random.Generator,
    *,
    noisy: bool = True,
    inner: int = 2000,
) -> Spread | None:
    """Posterior after further measurements of a known truth; None where importance sampling does not find it.

    Parameters
    ----------
    problem, candidates, parameter, charts, rng, inner
        As for `confirm`.
    truth
        θ that makes the further data, shape (d,).
    noisy
        Whether these carry noise.
    """
    further = [c.problem(problem, truth, rng if noisy else None) for c in candidates]
    fisher = fisher_information(problem, truth)
    whole = replace(fisher, data=fisher.data + sum(measurement_information(c, problem, truth) for c in candidates))
    density = WithFurther(problem.log_posterior, further)
    rough = _bounded(whole.covariance(), whole.prior_sd)
    for count in (inner, MORE * inner):
        try:
            theta, log_weight = weighted_posterior(density, truth, rough, charts, rng, count)
        except JointBayesError:
            return None  # a truth at the very edge of the coordinates
        found = _spread(problem, theta, log_weight, parameter, count) if len(theta) else None
        if found is not None and found.effective >= LEAST_EFFECTIVE:
            return found
    return None


def weighted_posterior(
    log_density: Callable[[Array], Array],
    theta: Array,
    covariance: Array,
    charts: Sequence[Chart],
    rng: np.random.Generator,
    count: int,
) -> tuple[Array, Array]:
    """Importance draws of a posterior.

    Parameters
    ----------
    log_density
        Density over θ.
    theta, covariance
        A point near its mode, shape (d,), and a rough covariance, shape (d, d).
    charts
        Coordinates of the proposal, the likeliest first.
    rng
        Source of the draws.
    count
        Number of draws.

    Returns
    -------
    theta, log_weight : ndarray, shapes (m, d) and (m,)
        m ≤ count draws where the density is above zero, and ln of their weights up to a constant.
    """
    proposal = fit_proposal(log_density, charts, ((theta, covariance),), rng)
    return proposal.weighted_draws(log_density, rng, count)


def _bounded(covariance: Array, prior_sd: Array) -> Array:
    """Covariance scaled down, direction by direction, to be no wider than the prior."""
    variance = np.where(np.isfinite(np.diag(covariance)), np.diag(covariance), prior_sd**2)
    finite = np.where(np.isfinite(covariance), covariance, 0.0)
    np.fill_diagonal(finite, variance)
    shrink = np.minimum(1.0, prior_sd / np.sqrt(variance))
    bounded: Array = finite * np.outer(shrink, shrink)
    return bounded


def _spread(problem: Problem, theta: Array, log_weight: Array, parameter: str, drawn: int) -> Spread:
    weight = np.exp(log_weight - log_weight.max())
    effective = float(weight.sum() ** 2 / (weight**2).sum())
    weight /= weight.sum()
    joint = problem.prior.joint(theta)
    with np.errstate(divide="ignore"):
        value = np.log(np.abs(problem.prior.stiffness(theta)[:, STIFFNESS_NAMES.index(parameter)]))
    centred = joint - weight @ joint
    sd = math.sqrt(float(weight @ (value - weight @ value) ** 2))
    return Spread(sd, (centred.T * weight) @ centred, effective, drawn)


def assumed_truth(problem: Problem, theta: Array, stiffness: ArrayLike) -> Array:
    """θ, shape (d,), of an assumed joint, all else as the present data have it, given that joint.

    Parameters
    ----------
    problem
        The problem in hand.
    theta
        Mode of its posterior, shape (d,), from which the other quantities start.
    stiffness
        (k11, k12, k22), shape (3,).

    Raises
    ------
    ModelError
        If the prior thinks that joint impossible.
    """
    prior, log_posterior = problem.prior, problem.log_posterior
    joint = prior.parametrisation.coordinates(stiffness)
    low, high = prior.support
    start = np.concatenate([joint, theta[joint.size :]])
    if not (prior.feasible(start) and (start >= low).all() and (start <= high).all()):
        given = ", ".join(f"{k:g}" for k in np.asarray(stiffness, dtype=float))
        raise ModelError(f"planning: found an assumed joint ({given}) outside the prior; expected one inside it")
    moving = slice(joint.size, start.size - log_posterior.likelihood.hyper_count)
    if moving.start == moving.stop:
        return start

    def whole(part: Array) -> Array:
        return np.concatenate([joint, part, start[moving.stop :]])

    def residual(part: Array) -> Array:
        return log_posterior.residuals(whole(part))[0]

    def jacobian(part: Array) -> Array:
        return log_posterior.residuals(whole(part))[1][:, moving]

    inner = 1e-9 * (high - low)[moving]
    inner[~np.isfinite(inner)] = 0.0
    found = optimize.least_squares(
        residual,
        np.clip(start[moving], low[moving] + inner, high[moving] - inner),
        jac=jacobian,
        bounds=(low[moving], high[moving]),
        x_scale=prior.sd[moving],
    )
    return whole(found.x)


def _error_of_mean(values: Array) -> float:
    return float(values.std(ddof=1) / math.sqrt(values.size)) if values.size > 1 else math.nan
