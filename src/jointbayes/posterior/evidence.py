"""The evidence Z = ∫ p(data | θ) p(θ) dθ of a model: by importance sampling, else by way of nested sampling."""

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from jointbayes.errors import SamplingError
from jointbayes.inference import LogPosterior
from jointbayes.reproducibility import one_blas_thread
from jointbayes.sampling import (
    Coordinates,
    LogDensity,
    Proposal,
    Start,
    WeightedDraws,
    fit_proposal,
    proposal_from_draws,
)
from jointbayes.sampling.coordinate_maps import Identity
from jointbayes.sampling.diagnostics import pareto_k
from vibrecords.arrays import Array

Method = Literal["exact", "importance sampling", "nested sampling"]

PARETO_LIMIT = 0.7
"""Pareto k of importance weights above which their mean is not trusted."""

_LEAST_SHARE = 0.25  # of the draws, effective
_DRAWS = 20_000
_LIVE = 400
_STOP = 0.01  # ln Z that the live points may still add
_IMPOSSIBLE = -1e300  # dynesty knows no −inf
_REFITTED = 8000  # draws of nested sampling to which another proposal is fitted
_AGREE = 4.0  # of its standard errors, to which the evidence of that proposal's draws must agree with its own


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """ln Z and how far to trust it.

    Parameters
    ----------
    log_z : float
        ln of the evidence; −inf where no draw has any likelihood.
    error : float
        Monte Carlo standard error of ``log_z``.
    pareto_k : float
        Shape of the tail of the importance weights: above 0.7 neither ``log_z`` nor ``error`` can be trusted. NaN
        where no importance weights were drawn.
    method : {"exact", "importance sampling", "nested sampling"}
        How it was found; exact where there is no parameter.
    evaluations : int
        Number of evaluations of the density, the fit of the proposal included.
    ess : float
        Effective number of the weighted draws.
    draws : WeightedDraws or None
        The draws; None where there is no parameter.
    """

    log_z: float
    error: float
    pareto_k: float
    method: Method
    evaluations: int
    ess: float
    draws: WeightedDraws | None = None


def importance_evidence(
    log_density: LogDensity, proposal: Proposal, rng: np.random.Generator, draws: int = _DRAWS
) -> Evidence:
    """Evidence as the mean importance weight of draws from a fitted proposal.

    Parameters
    ----------
    log_density : callable
        ln of likelihood times normalised prior over θ, (n, d) array to (n,) array.
    proposal : Proposal
        From `jointbayes.sampling.fit_proposal`; whatever it is, the estimate has no bias, but the farther it is from
        the posterior the larger is the error.
    rng : numpy.random.Generator
        Source of the draws.
    draws : int
        Number of draws.

    Returns
    -------
    Evidence
        Its error is that of a mean of independent weights, to first order in ln Z.

    Raises
    ------
    jointbayes.errors.SamplingError
        If the log-density returns NaN, +inf or an array of the wrong shape.

    References
    ----------
    Geweke, J. (1989). Econometrica 57(6), 1317-1339. DOI 10.2307/1913710
    """
    theta, log_weight = proposal.weighted_draws(log_density, rng, draws)
    evaluations = proposal.evaluations + draws
    if not len(log_weight):
        return Evidence(-math.inf, math.inf, math.inf, "importance sampling", evaluations, 0.0)
    weighted = WeightedDraws(theta, log_weight)
    ess = weighted.effective
    return Evidence(
        log_z=float(np.logaddexp.reduce(log_weight)) - math.log(draws),
        error=math.sqrt(max(1 / ess - 1 / draws, 0.0)),
        pareto_k=pareto_k(log_weight),
        method="importance sampling",
        evaluations=evaluations,
        ess=ess,
        draws=weighted,
    )


def nested_evidence(
    log_likelihood: LogDensity,
    prior_transform: Callable[[Array], Array],
    dimension: int,
    rng: np.random.Generator,
    live: int = _LIVE,
) -> Evidence:
    """Evidence by nested sampling, which needs neither a mode nor a proposal, and finds modes by itself.

    Parameters
    ----------
    log_likelihood : callable
        ln L, (n, d) array to (n,) array; −inf where the data are impossible.
    prior_transform : callable
        Uniform points of the unit cube, (n, d), to draws from the prior, (n, d): `JointPrior.transform`.
    dimension : int
        d; 0 for a model without parameters.
    rng : numpy.random.Generator
        Source of randomness.
    live : int
        Number of live points: the error falls with its root, the time grows with it.

    Raises
    ------
    jointbayes.errors.SamplingError
        If the log-likelihood is NaN or +inf somewhere.

    References
    ----------
    Skilling, J. (2006). Nested sampling for general Bayesian computation. Bayesian Analysis 1(4), 833-859.
    DOI 10.1214/06-BA127
    Speagle, J. S. (2020). dynesty. Monthly Notices of the Royal Astronomical Society 493(3), 3132-3158.
    DOI 10.1093/mnras/staa278
    """
    if dimension == 0:
        return _constant_evidence(log_likelihood)
    import dynesty

    def bounded_log_likelihood(theta: Array) -> float:
        value = float(log_likelihood(theta[None])[0])
        if not value < math.inf:
            raise SamplingError(
                f"nested sampling: found ln L = {value} at θ = {theta.tolist()}; expected a finite number, or −inf "
                "where the data are impossible; correct the likelihood"
            )
        return max(value, _IMPOSSIBLE)

    sampler = dynesty.NestedSampler(
        bounded_log_likelihood, lambda u: prior_transform(u[None])[0], dimension, nlive=live, sample="rwalk", rstate=rng
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of its own efficiency, and of logarithms of zero where ln L is flat
        sampler.run_nested(dlogz=_STOP, print_progress=False)
    results = sampler.results
    weighted = WeightedDraws(np.array(results.samples, dtype=float), np.array(results.logwt, dtype=float))
    return Evidence(
        log_z=float(results.logz[-1]),
        error=float(results.logzerr[-1]),
        pareto_k=math.nan,
        method="nested sampling",
        evaluations=int(np.sum(results.ncall)),
        ess=weighted.effective,
        draws=weighted,
    )


@one_blas_thread()
def evidence(
    log_posterior: LogPosterior,
    systems: Sequence[Coordinates | None],
    starts: Sequence[Start],
    rng: np.random.Generator,
    draws: int = _DRAWS,
) -> Evidence:
    """Evidence by importance sampling from a proposal fitted here; where not trusted, by way of nested sampling.

    Importance sampling is not trusted where the Pareto k of the weights is above 0.7, nor where fewer than a quarter of
    the draws are effective: a density that the fit did not come near to may have parts where no draw ever fell, of
    which k knows nothing. Nested sampling finds these parts, but knows ln Z to ± 0.1 at best; a mixture fitted to its
    draws is proposed from once more. The evidence is that of these weights where their k is good, their error is the
    smaller one and the two agree; else that of nested sampling.

    Parameters
    ----------
    log_posterior : LogPosterior
        Likelihood and normalised prior.
    systems : sequence of Coordinates or None
        Coordinates for the proposal, see `jointbayes.sampling.fit_proposal`.
    starts : sequence of (theta, covariance)
        One for each mode, the highest first; none is needed where there is no parameter.
    rng : numpy.random.Generator
        Source of randomness.
    draws : int
        Number of importance draws.

    Raises
    ------
    jointbayes.errors.SamplingError
        As from `fit_proposal`.
    """
    prior = log_posterior.prior
    if not prior.names:
        return _constant_evidence(log_posterior)
    estimate = importance_evidence(log_posterior, fit_proposal(log_posterior, systems, starts, rng), rng, draws)
    if estimate.pareto_k <= PARETO_LIMIT and estimate.ess >= _LEAST_SHARE * draws:
        return estimate

    def log_likelihood(theta: Array) -> Array:
        density = np.full(len(theta), -np.inf)
        inside = np.isfinite(prior.log_density(theta))
        if inside.any():
            density[inside] = log_posterior.log_likelihood(theta[inside])
        return density

    nested = nested_evidence(log_likelihood, prior.transform, len(prior.names), rng)
    assert nested.draws is not None
    maps, seen = [coordinates or Identity() for coordinates in systems], nested.draws.resample(rng, _REFITTED)
    refitted = importance_evidence(log_posterior, proposal_from_draws(log_posterior, maps, seen, rng), rng, draws)
    agrees = abs(refitted.log_z - nested.log_z) < _AGREE * nested.error
    if refitted.pareto_k <= PARETO_LIMIT and refitted.error < nested.error and agrees:
        return replace(refitted, evaluations=estimate.evaluations + nested.evaluations + refitted.evaluations)
    return nested


def _constant_evidence(log_density: LogDensity) -> Evidence:
    return Evidence(float(log_density(np.zeros((1, 0)))[0]), 0.0, -math.inf, "exact", 1, 1.0)
