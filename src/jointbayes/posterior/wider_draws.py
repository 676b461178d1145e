"""Draws under wider priors of the joint: those at hand reweighted where they suffice, else drawn anew."""

from collections.abc import Callable
from functools import partial

import numpy as np

from jointbayes.identification import refine, refine_where_possible
from jointbayes.identification.mode_search import local_modes
from jointbayes.inference import Independent, JointPrior
from jointbayes.posterior.any_posterior import AnyPosterior
from jointbayes.posterior.coordinates import coordinate_systems, judged_quantities
from jointbayes.posterior.widened import (
    WidenedPosterior,
    bounds_within_reach,
    moved_beyond_bounds,
    replace_prior,
    widened_prior,
)
from jointbayes.reproducibility import one_blas_thread
from jointbayes.sampling import WeightedDraws, fit_each_mode, fit_proposal, released_draws
from vibrecords.arrays import Array

#: Draws of θ, and how many independent ones they are worth; None where none were found that may be trusted.
DrawsOfWorth = tuple[Array, float] | None
DrawnAnew = Callable[[JointPrior], DrawsOfWorth]

_DRAWS = 8000
_ENOUGH_SHARE = 0.25  # effective, of draws that are reweighted
_UNCHANGED_SHARE = 0.99  # effective: the weights are all but equal
_ENOUGH = 0.1  # efficiency of a proposal from which rounds of importance draws begin
#: Independent draws at each end that are enough for a class: the 2.5 % beyond it are known to a fifth.
ENOUGH_FOR_CLASS = 1000.0
_PRIOR_DRAWS = 8000
_STREAM = 3  # of random numbers, so that no other draws depend on these


@one_blas_thread()
def widen_posterior(posterior: AnyPosterior) -> WidenedPosterior | None:
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


def _drawn_anew(posterior: AnyPosterior, rng: np.random.Generator, wide: JointPrior) -> DrawsOfWorth:
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
