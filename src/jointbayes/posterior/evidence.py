"""The evidence Z = ∫ p(data | θ) p(θ) dθ of a model: by importance sampling, else by quadrature or nested sampling.

Quadrature cuts the unit cube, of which the prior makes θ, into boxes with three Gauss points along each axis, which are
halved where the integrand needs it. A likelihood may be a ridge thinner than any first box. So its powers L^β are
integrated one after the other, β rising fourfold to 1: each is about half as wide as the one before, whose boxes see
it. No value of L is computed twice.
"""

import itertools
import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import SamplingError
from jointbayes.inference import LogPosterior
from jointbayes.reproducibility import one_blas_thread
from jointbayes.sampling import Coordinates, LogDensity, Proposal, Start, WeightedDraws, fit_proposal
from jointbayes.sampling.diagnostics import pareto_k
from vibrecords.arrays import Array

Method = Literal["exact", "importance sampling", "quadrature", "nested sampling"]

PARETO_LIMIT = 0.7
"""Pareto k of importance weights above which their mean is not trusted."""

_LEAST_SHARE = 0.25  # of the draws, effective
_DRAWS = 20_000
_MISSED = 0.05  # ln Z
_LIVE = 400
_STOP = 0.01  # ln Z that the live points may still add
_IMPOSSIBLE = -1e300  # dynesty knows no −inf

#: Of more unknowns boxes along a ridge are too many.
MOST_DIMENSIONS = 3
_FIRST = 4  # boxes along each axis to begin with
_RISE = 4.0  # of the power β from one integral to the next
_SETTLED = (0.02, 0.04, 0.08)
_VAGUE, _WEIGHT = 0.3, 1e-4  # that difference in one box, relative to its integral, and its share in the whole
_ACCURATE = 0.003  # of the last integral: what halving all boxes that count may change
_COUNTS = 1e-3  # share in the sum of these differences, times the number of boxes, below which a box does not count
_MOST_VALUES = 500_000
_POINTS = 0.5 + math.sqrt(0.15) * np.array([-1.0, 0.0, 1.0])
_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """ln Z and how far to trust it.

    Parameters
    ----------
    log_z : float
        ln of the evidence; −inf where no draw has any likelihood.
    error : float
        Monte Carlo standard error of ``log_z``; of quadrature what the last halving of its boxes changed.
    pareto_k : float
        Shape of the tail of the importance weights: above 0.7 neither ``log_z`` nor ``error`` can be trusted. NaN
        where no importance weights were drawn.
    method : {"exact", "importance sampling", "quadrature", "nested sampling"}
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
    """Evidence by importance sampling from a proposal fitted here; where that cannot be trusted by other methods.

    Of up to three unknowns by quadrature; of more, or where that does not settle either, by nested sampling.
    Importance sampling is not trusted where the Pareto k of the weights is above 0.7, nor where fewer than a quarter of
    the draws are effective: a density that the fit did not come near to may have parts where no draw ever fell, of
    which k knows nothing.

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

    if len(prior.names) <= MOST_DIMENSIONS:
        integral = integrate(lambda u: log_likelihood(prior.transform(u)), len(prior.names))
        # where it holds much less than these draws saw it has missed a mode
        if integral is not None and integral.log_integral > estimate.log_z - 4 * estimate.error - _MISSED:
            nodes = WeightedDraws(prior.transform(integral.points), integral.log_weight)
            count = estimate.evaluations + integral.evaluations
            return Evidence(
                integral.log_integral, integral.error, math.nan, "quadrature", count, nodes.effective, nodes
            )
    return nested_evidence(log_likelihood, prior.transform, len(prior.names), rng)


def _constant_evidence(log_density: LogDensity) -> Evidence:
    return Evidence(float(log_density(np.zeros((1, 0)))[0]), 0.0, -math.inf, "exact", 1, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Quadrature:
    """An integral over the unit cube, and its points.

    Parameters
    ----------
    log_integral
        ln ∫ L du.
    error
        What the last halving of the boxes changed, summed box by box, relative to the integral.
    points
        Points u, shape (n, d).
    log_weight
        ln of L times the volume each stands for, shape (n,).
    evaluations
        Number of values of L.
    """

    log_integral: float
    error: float
    points: Array
    log_weight: Array
    evaluations: int


class _Boxes:
    """Boxes with the values of ln L at their points."""

    def __init__(self, log_likelihood: LogDensity, dimension: int) -> None:
        self._log_likelihood, self._dimension, self.evaluations = log_likelihood, dimension, 0
        each = np.array(list(itertools.product(range(3), repeat=dimension)))
        self._offsets, self.weights = _POINTS[each], _WEIGHTS[each].prod(axis=1)
        # rules that have one point along an axis, the middle, and three along the others
        self._coarse = self.weights[:, None] * np.where(each == 1, 1 / _WEIGHTS[1], 0.0)
        corners = np.array(list(itertools.product(range(_FIRST), repeat=dimension)), dtype=float)
        self.low, self.size = corners / _FIRST, np.full((len(corners), dimension), 1 / _FIRST)
        self.log_values = self._values(self.low, self.size)

    def points(self, low: Array, size: Array) -> Array:
        """Points of boxes, shape (boxes, points of one, d)."""
        return low[:, None] + size[:, None] * self._offsets

    def _values(self, low: Array, size: Array) -> Array:
        points = self.points(low, size)
        self.evaluations += len(low) * len(self.weights)
        return self._log_likelihood(points.reshape(-1, self._dimension)).reshape(points.shape[:2])

    def integrals(self, power: float) -> tuple[Array, Array]:
        """∫ (L/L_max)^β of each box (boxes,), and how far coarser rules along each axis are from it (boxes, d)."""
        value = np.exp(power * (self.log_values - self.log_values.max()))
        value *= self.size.prod(axis=1)[:, None]
        fine = value @ self.weights
        return fine, np.abs(fine[:, None] - value @ self._coarse)

    def halve(self, chosen: NDArray[np.bool_], axis: NDArray[np.intp]) -> None:
        """Replace chosen boxes (boxes,) by their halves along an axis of each; the halves come last, in pairs."""
        low, size = np.repeat(self.low[chosen], 2, axis=0), np.repeat(self.size[chosen], 2, axis=0)
        row, along = np.arange(len(low)), np.repeat(axis[chosen], 2)
        size[row, along] /= 2
        low[row[1::2], along[1::2]] += size[row[1::2], along[1::2]]
        values = self._values(low, size)
        self.low, self.size, self.log_values = (
            np.concatenate([kept[~chosen], new])
            for kept, new in ((self.low, low), (self.size, size), (self.log_values, values))
        )


def integrate(log_likelihood: LogDensity, dimension: int) -> Quadrature | None:
    """∫ L over the unit cube of up to three dimensions.

    Parameters
    ----------
    log_likelihood
        ln L, (n, d) array of points of the unit cube to (n,) array, −inf where the data are impossible.
    dimension
        d, at least 1.

    Returns
    -------
    Quadrature or None
        None where half a million values do not give the integral to 0.3 %, or L is zero at all of the first.
    """
    boxes = _Boxes(log_likelihood, dimension)
    possible = boxes.log_values[np.isfinite(boxes.log_values)]
    if not possible.size:
        return None
    settled = _SETTLED[dimension - 1]
    power = min(1.0, 1 / max(possible.max() - float(np.median(possible)), 1.0))
    while boxes.evaluations < _MOST_VALUES:
        integrals, differences = boxes.integrals(power)
        largest, total = differences.max(axis=1), integrals.sum()
        # a box of some weight that is not seen clearly may hold what counts most at the next power
        chosen = (largest > _VAGUE * integrals) & (integrals > _WEIGHT * total)
        if not chosen.any() and largest.sum() > settled * total:
            # the boxes that differ most, which make up for half of it all
            order = np.argsort(-largest)
            last = int(np.searchsorted(np.cumsum(largest[order]), largest.sum() / 2))
            chosen = largest >= largest[order[last]]
        if chosen.any():
            boxes.halve(chosen, differences.argmax(axis=1))
        elif power < 1:
            power = min(1.0, _RISE * power)
        else:
            chosen = largest > _COUNTS * largest.sum() / len(largest)
            before, top = integrals[chosen], boxes.log_values.max()
            boxes.halve(chosen, differences.argmax(axis=1))
            integrals, _ = boxes.integrals(1.0)
            halves = integrals[len(integrals) - 2 * len(before) :].reshape(-1, 2).sum(axis=1)
            before = before * math.exp(top - boxes.log_values.max())
            error = float(np.abs(halves - before).sum() / integrals.sum())
            if error < _ACCURATE:
                return _result(boxes, float(integrals.sum()), error)
    return None


def _result(boxes: _Boxes, integral: float, error: float) -> Quadrature:
    values = boxes.log_values
    with np.errstate(divide="ignore"):
        log_weight = (values + np.log(boxes.weights) + np.log(boxes.size).sum(axis=1)[:, None]).ravel()
    seen = log_weight > log_weight.max() - 100.0  # the others weigh nothing
    points = boxes.points(boxes.low, boxes.size).reshape(len(log_weight), -1)[seen]
    return Quadrature(math.log(integral) + float(values.max()), error, points, log_weight[seen], boxes.evaluations)
