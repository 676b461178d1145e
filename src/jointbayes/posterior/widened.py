"""The posterior with every prior of the joint a decade wider on each side: what of a verdict rests on the prior."""

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from jointbayes.identification import refine, refine_where_possible
from jointbayes.identification.mode_search import local_modes
from jointbayes.inference import Independent, JointPrior, LogPosterior, Marginal, Normal, OfStiffness, Problem, Uniform
from jointbayes.joint import Coordinate
from jointbayes.posterior.coordinates import coordinate_systems, judged_quantities
from jointbayes.posterior.run_record import AnyDraws
from jointbayes.reproducibility import one_blas_thread
from jointbayes.sampling import WeightedDraws, fit_each_mode, fit_proposal, released_draws
from vibrecords.arrays import Array

Side = Literal["lower", "upper"]
#: Draws of θ, and how many independent ones they are worth; None where none were found that may be trusted.
DrawsOfWorth = tuple[Array, float] | None
DrawnAnew = Callable[[JointPrior], DrawsOfWorth]

#: By how much each bound of ln k is moved out.
DECADE = math.log(10)
_NORMAL_95 = 1.959963984540054

#: Mass that a further decade would hold if the density stayed as it is at the bound: less cannot matter.
REACH = 0.01
_EDGE = 0.1  # of a decade, or of ρ's range: the part of the prior's range that counts as its edge

_DRAWS = 8000
_ENOUGH_SHARE = 0.25  # effective, of draws that are reweighted
_UNCHANGED_SHARE = 0.99  # effective: the weights are all but equal
_ENOUGH = 0.1  # efficiency of a proposal from which rounds of importance draws begin
#: Independent draws at each end that are enough for a class: the 2.5 % beyond it are known to a fifth.
ENOUGH_FOR_CLASS = 1000.0
_PRIOR_DRAWS = 8000
_STREAM = 3  # of random numbers, so that no other draws depend on these


@dataclass(frozen=True, slots=True, eq=False)
class WidenedPosterior:
    """Draws from the posterior under wider priors of the joint.

    Parameters
    ----------
    prior
        The wider priors.
    theta
        Equally weighted draws of θ, shape (n, d); those of the wider prior where none of the posterior may be trusted.
    prior_theta
        Draws from the wider prior, shape (m, d).
    effective
        Number of independent draws that `theta` is worth.
    reliable
        Whether the draws may be trusted.
    """

    prior: JointPrior
    theta: Array
    prior_theta: Array
    effective: float
    reliable: bool = True

    def __post_init__(self) -> None:
        self.theta.setflags(write=False)
        self.prior_theta.setflags(write=False)


def replace_prior(problem: Problem, prior: JointPrior) -> Problem:
    """The problem under another prior; its likelihood is not built anew."""
    other = dataclasses.replace(problem, prior=prior)
    other.__dict__["log_posterior"] = LogPosterior(
        prior, problem.log_posterior.likelihood, problem.extra_log_likelihood
    )
    return other


def widened_prior(prior: JointPrior) -> JointPrior:
    """The prior with each marginal of the joint a decade wider on each side.

    Bounds of a logarithm, or of a stiffness itself, move by a decade; a normal's standard deviation grows so that its
    95 % range grows by a decade on each side. A bounded coordinate such as ρ becomes uniform over all that is possible;
    one that is neither reaches ten times as far from its middle.
    """
    pairs = zip(prior.parametrisation.axes, prior.marginals, strict=True)
    return dataclasses.replace(prior, marginals=tuple(_wider(axis, marginal) for axis, marginal in pairs))


def _wider(axis: Coordinate, marginal: Marginal) -> Marginal:
    if axis.bounded:
        return Uniform(*axis.bounds)
    if not axis.logarithmic:
        if isinstance(marginal, Uniform):
            reach = 10 * (marginal.high - marginal.low) / 2
            return Uniform(marginal.mean - reach, marginal.mean + reach)
        return Normal(marginal.mean, 10 * marginal.sd)
    if isinstance(marginal, Uniform):
        return Uniform(marginal.low - DECADE, marginal.high + DECADE)
    if isinstance(marginal, OfStiffness) and isinstance(marginal.given, Uniform):
        return OfStiffness(Uniform(max(marginal.given.low, 0.0) / 10, marginal.given.high * 10))
    return Normal(marginal.mean, marginal.sd + DECADE / _NORMAL_95)


def bounds_within_reach(prior: JointPrior, theta: Array) -> tuple[tuple[str, Side], ...]:
    """Bounds of uniform priors of the joint beyond which a wider prior could hold mass of any consequence.

    It could if the density of the draws at the bound, kept up over the decade beyond it, would hold more than
    `REACH` of the mass.

    Parameters
    ----------
    prior
        The prior as it is stated.
    theta
        Draws of θ, shape (n, d).

    Returns
    -------
    tuple of (name, side)
        Coordinate and ``"lower"`` or ``"upper"``.
    """
    within_reach: list[tuple[str, Side]] = []
    marginals = zip(prior.parametrisation.names, prior.marginals, widened_prior(prior).marginals, strict=True)
    for column, (name, stated, wider) in enumerate(marginals):
        if prior.bounds_of(name) is None:
            continue
        draws, (low, high), (least, most) = theta[:, column], stated.support, wider.support
        edge = _EDGE * min(DECADE, high - low)
        below, above = (draws < low + edge).mean(), (draws > high - edge).mean()
        # a prior that is uniform in k keeps its density in k: of ln k it grows on beyond the upper end
        beyond = math.expm1(most - high) if isinstance(stated, OfStiffness) else most - high
        if math.isfinite(low) and below / edge * (low - least) > REACH:
            within_reach.append((name, "lower"))
        if above / edge * beyond > REACH:
            within_reach.append((name, "upper"))
    return tuple(within_reach)


@one_blas_thread()
def widen_posterior(posterior: AnyDraws) -> WidenedPosterior | None:
    """Draws under wider priors: reweighted where the draws at hand suffice, drawn anew where they do not.

    Uniform priors whose bounds are out of the posterior's reach, and normal priors that hardly vary over it, change
    nothing when they are widened; then nothing is done.

    Returns
    -------
    WidenedPosterior or None
        None where wider priors give the same posterior.

    References
    ----------
    Kallioinen, N. et al. (2024). Detecting and diagnosing prior and likelihood sensitivity with power-scaling.
    Statistics and Computing 34, 57. DOI 10.1007/s11222-023-10366-5
    """

    def effective() -> float:
        return min(float(e) for e in posterior.record.sampler["ess"].values())

    rng = np.random.default_rng([posterior.record.seed, _STREAM])
    return widen(posterior.problem.prior, posterior.theta, effective, rng, partial(_drawn_anew, posterior, rng))


def widen(
    prior: JointPrior, theta: Array, effective: Callable[[], float], rng: np.random.Generator, drawn_anew: DrawnAnew
) -> WidenedPosterior | None:
    """The same for draws θ, shape (n, d), that are worth so many independent ones.

    `drawn_anew` gives those under a wider prior.
    """
    wide = widened_prior(prior)
    if wide.marginals == prior.marginals:
        return None
    if not bounds_within_reach(prior, theta):
        weighted = WeightedDraws(theta, wide.log_density(theta) - prior.log_density(theta))
        share = weighted.effective / len(theta)
        if share > _UNCHANGED_SHARE:
            return None
        if share >= _ENOUGH_SHARE:
            draws = weighted.resample(rng, _DRAWS)
            return WidenedPosterior(wide, draws, wide.sample(rng, _PRIOR_DRAWS), max(1.0, share * effective()))
    anew, before = drawn_anew(wide), wide.sample(rng, _PRIOR_DRAWS)
    theta, worth = anew or (before, 0.0)
    return WidenedPosterior(wide, theta, before, worth, anew is not None)


def _drawn_anew(posterior: AnyDraws, rng: np.random.Generator, wide: JointPrior) -> DrawsOfWorth:
    """Importance draws in rounds, from a proposal fitted to the wider posterior or from the draws."""
    problem = replace_prior(posterior.problem, wide)
    log_posterior, systems = problem.log_posterior, coordinate_systems(problem)
    ends = [refine(log_posterior, posterior.mode_theta)]
    if len(posterior.estimate.modes) > 1:
        ends += [refine_where_possible(log_posterior, mode.theta) for mode in posterior.estimate.modes]
    modes = local_modes(log_posterior, ends) if len(ends) > 1 else ()
    if len(modes) > 1:
        starts = [mode.start for mode in modes]
        proposal = fit_each_mode(log_posterior, systems, starts, None, rng, enough=_ENOUGH)
    else:
        covariance = np.atleast_2d(np.cov(posterior.theta.T))
        # The mode may stand at the end of a plateau, where no curvature tells its size; the middle of the draws not.
        away = (posterior.theta - np.median(posterior.theta, axis=0)) / np.sqrt(np.diag(covariance))
        middle = posterior.theta[np.argmin((away**2).sum(axis=1))]
        starts = [(ends[0][0], covariance), (middle, covariance)]
        proposal = fit_proposal(log_posterior, systems, starts, rng, enough=_ENOUGH)
    beyond = moved_beyond_bounds(posterior.problem.prior, posterior.theta)
    judged, count, everywhere = judged_quantities(wide), max(1, len(modes)), Independent(wide.all_marginals)
    for first in (proposal, None):
        adapted = released_draws(
            log_posterior, systems, beyond, rng, judged,
            proposal=first, wide=everywhere, modes=count, enough=ENOUGH_FOR_CLASS,
        )  # fmt: skip
        if adapted is not None:
            return adapted.theta, adapted.effective
    return None


def moved_beyond_bounds(prior: JointPrior, theta: Array) -> Array:
    """Draws θ, shape (n, d), and those near a bound within reach again, moved beyond it: (m, d), m ≥ n.

    Where data say nothing a density goes on beyond its bound as it is before it, and a proposal that is fitted to draws
    that end there reaches the rest hardly ever.
    """
    moved = [theta]
    for name, side in bounds_within_reach(prior, theta):
        column, end = prior.names.index(name), 0 if side == "lower" else 1
        bound = prior.marginals[column].support[end]
        step = widened_prior(prior).marginals[column].support[end] - bound
        copies = theta[np.abs(theta[:, column] - bound) < abs(step)].copy()
        copies[:, column] += step
        moved.append(copies)
    return np.concatenate(moved)
