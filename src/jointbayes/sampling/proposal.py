"""Fit a distribution to propose from, knowing nothing but the log-density and a first Laplace approximation."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import SamplingError
from jointbayes.sampling.chart import Chart, Identity
from jointbayes.sampling.density import Checked, LogDensity
from jointbayes.sampling.student_t import StudentT

__all__ = ["Proposal", "fit_proposal", "importance_efficiency"]

Array = NDArray[np.float64]

_DOF = 5.0  # heavier tails than a posterior's keep the weights bounded
_DRAWS = 2000
_ROUNDS = 4
_GOOD = 0.8  # a further round would cost more than it gains
_STEP = 0.2  # of the finite differences, in standard deviations
_NEWTON_STEPS = 20
_CONVERGED = 1e-3  # gain in log-density that no longer matters beside a refinement
_FLATTEST = 1 / 16  # least curvature: no step of the search makes a direction more than four times wider
_EM_STEPS = 10  # each brings the fit four times nearer
_FLOOR = 1e-3  # of the scale before that is added to a new one, so that few draws still span the space


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """A distribution to propose from, and how good it is.

    Parameters
    ----------
    density : StudentT
        Distribution in the coordinates φ of the chart it was fitted in.
    efficiency : float
        Effective fraction of its draws as importance samples of the density, 0 to 1.
    evaluations : int
        Number of points at which the log-density was computed for the fit.
    """

    density: StudentT
    efficiency: float
    evaluations: int


def importance_efficiency(log_weight: Array) -> float:
    """Effective fraction of importance samples, (Σw)² / (n Σw²); 0 if all weights are.

    Parameters
    ----------
    log_weight : ndarray, shape (n,)
        ln of the weights up to a constant; −inf for a weight of zero.

    References
    ----------
    A. Kong, J. S. Liu, W. H. Wong, Sequential imputations and Bayesian missing data problems (1994),
    DOI 10.1080/01621459.1994.10476469.

    Examples
    --------
    >>> importance_efficiency(np.array([0.0, 0.0, -np.inf, -np.inf]))
    0.5
    """
    top = float(log_weight.max())
    if top == -np.inf:
        return 0.0
    weight = np.exp(log_weight - top)
    return float(weight.sum() ** 2 / (weight.size * (weight**2).sum()))


def fit_proposal(
    log_density: LogDensity, chart: Chart | None, theta: Array, covariance: Array, rng: np.random.Generator
) -> Proposal:
    """Fit a Student-t distribution to a density in the coordinates φ of a chart.

    The first candidate is the Laplace approximation in φ: mode and curvature of ln p(θ(φ)) + ln |∂θ/∂φ|, which is
    another than that in θ. Its draws are weighted by p/q, and the t distribution most likely for the weighted draws is
    the next candidate, a few rounds long (population Monte Carlo); the one with the most effective draws is kept. While
    few draws carry all the weight, a power of the weights below 1 is used, so that the next candidate still spans the
    space.

    A poor fit is no error: the efficiency says so, and the moves are chosen by it.

    Parameters
    ----------
    log_density : callable
        Log of the unnormalised density over θ, (n, d) array to (n,) array; −inf where the density is zero.
    chart : Chart or None
        Coordinates; θ itself without one.
    theta : ndarray, shape (d,)
        A point near the mode, inside the support.
    covariance : ndarray, shape (d, d)
        Rough covariance of θ.
    rng : numpy.random.Generator
        Source of the draws.

    Returns
    -------
    Proposal
        The best candidate, with 5 degrees of freedom.

    Raises
    ------
    jointbayes.errors.SamplingError
        If the shapes do not fit or a number is not finite, or if the log-density returns NaN or +inf.

    References
    ----------
    L. Tierney, J. B. Kadane, Accurate approximations for posterior moments (1986),
    DOI 10.1080/01621459.1986.10478240.
    O. Cappé et al., Population Monte Carlo (2004), DOI 10.1198/106186004X12803.
    O. Cappé et al., Adaptive importance sampling in general mixture classes (2008), section 4 on t distributions,
    DOI 10.1007/s11222-008-9059-x.
    E. Koblents, J. Míguez, A population Monte Carlo scheme with transformed weights (2015),
    DOI 10.1007/s11222-013-9440-2 (the power of the weights).
    """
    target = _whitened(log_density, chart or Identity(), theta, covariance)
    mean, scale = _laplace(target)
    best: tuple[StudentT, float] | None = None
    for _ in range(1 + _ROUNDS):
        candidate = StudentT(mean, scale, _DOF)
        draws = candidate.draw(rng, _DRAWS)
        log_weight = target(draws) - candidate.log_density(draws)
        efficiency = importance_efficiency(log_weight)
        if best is None or efficiency > best[1]:
            best = candidate, efficiency
        if efficiency > _GOOD:
            break
        mean, scale = _refitted(candidate, draws, log_weight)
    assert best is not None
    density, efficiency = best
    factor = target.factor
    return Proposal(
        StudentT(target.origin + factor @ density.mean, factor @ density.scale @ factor.T, _DOF),
        efficiency,
        target.evaluations,
    )


@dataclass(slots=True)
class _Whitened:
    """The density over z, where φ = origin + factor · z and z is of order one."""

    log_density: Checked
    chart: Chart
    origin: Array
    factor: Array
    evaluations: int = 0

    def __call__(self, z: Array) -> Array:
        """Log-density over z up to a constant, shape (n,), at z, shape (n, d)."""
        theta, inside = self.chart.inverse(self.origin + z @ self.factor.T)
        values = np.full(len(z), -np.inf)
        if inside.any():
            theta = theta[inside]
            self.evaluations += len(theta)
            found = self.log_density(theta)
            possible = np.isfinite(found)
            found[possible] += self.chart.log_volume(theta[possible])
            # rounding at the very edge of the region may leave a volume that is no number
            values[inside] = np.where(np.isfinite(found), found, -np.inf)
        return values


def _whitened(log_density: LogDensity, chart: Chart, theta: Array, covariance: Array) -> _Whitened:
    """Carry a covariance of θ over into φ by the chart's derivative, and whiten with it."""
    mean, spread = np.asarray(theta, dtype=float), np.asarray(covariance, dtype=float)
    if mean.ndim != 1 or spread.shape != (mean.size, mean.size):
        raise SamplingError(
            f"proposal: found θ of shape {mean.shape} and a covariance of shape {spread.shape}; "
            "expected (d,) and (d, d); correct the arrays"
        )
    origin = chart.forward(mean[None])[0]
    if not (np.isfinite(origin).all() and np.isfinite(spread).all()):
        raise SamplingError(
            f"proposal: found θ = {mean.tolist()} with covariance {spread.tolist()}; "
            "expected finite numbers inside the chart's region; correct them"
        )
    sd = np.sqrt(np.maximum(np.diag(spread), 0.0))
    sd[sd == 0.0] = 1.0
    values, vectors = np.linalg.eigh(spread / np.outer(sd, sd))
    roots = sd[:, None] * vectors * np.sqrt(np.maximum(values, 1e-10))
    step = 1e-4 * roots.T
    factor = (chart.forward(mean + step) - chart.forward(mean - step)).T / 2e-4
    size = np.linalg.norm(factor, axis=1, keepdims=True)
    if not (np.isfinite(size).all() and size.all() and np.linalg.cond(factor / size) < 1e7):
        # at the edge of the chart its derivative says nothing: each coordinate is taken at its own size
        factor = np.diag(np.where(origin == 0.0, 1.0, np.abs(origin)))
    return _Whitened(Checked(log_density), chart, origin, factor)


def _laplace(target: _Whitened) -> tuple[Array, Array]:
    """Mode and covariance from the curvature there, in z, by Newton's method with a whole line of trial steps at once.

    Differences are taken along axes that follow the curvature, so that a first covariance of another size is no harm.
    Where the density is cut off within their reach, the search ends with what it has.
    """
    dimension = len(target.origin)
    place, axes = np.zeros(dimension), np.eye(dimension)
    lengths = 0.5 ** np.arange(8)
    for _ in range(_NEWTON_STEPS):
        value, gradient, hessian = _derivatives(target, place, axes)
        if not (np.isfinite(gradient).all() and np.isfinite(hessian).all()):
            break
        curvature, vectors = np.linalg.eigh(-hessian)
        turned = axes @ vectors / np.sqrt(np.maximum(curvature, _FLATTEST))
        trials = place + lengths[:, None] * (turned @ (turned.T @ np.linalg.solve(axes.T, gradient)))
        found = target(trials)
        best = int(np.argmax(found))
        axes = turned
        if found[best] > value + _CONVERGED:
            place = trials[best]
        elif (curvature > 0.25).all() and (curvature < 4.0).all():
            break  # at the mode, and the differences were taken over about a standard deviation
    return place, axes @ axes.T


def _derivatives(target: _Whitened, place: Array, axes: Array) -> tuple[float, Array, Array]:
    """Value, gradient and Hessian along axes, the columns of (d, d), at z, shape (d,): differences from one call."""
    d = place.size
    rows, columns = np.triu_indices(d, 1)
    offsets = np.concatenate([axes.T, axes.T[rows] + axes.T[columns]]) * _STEP
    values = target(np.concatenate([place[None], place + offsets, place - offsets]))
    centre, up, down = values[0], *np.split(values[1:], 2)
    if not np.isfinite(values).all():
        return float(centre), np.full(d, np.nan), np.full((d, d), np.nan)
    even = up + down - 2 * centre
    hessian = np.diag(even[:d])
    hessian[rows, columns] = hessian[columns, rows] = (even[d:] - even[rows] - even[columns]) / 2
    return float(centre), (up - down)[:d] / (2 * _STEP), hessian / _STEP**2


def _refitted(candidate: StudentT, draws: Array, log_weight: Array) -> tuple[Array, Array]:
    """Centre and scale of the next candidate from weighted draws of the last."""
    d = candidate.mean.size
    alive = np.isfinite(log_weight)
    enough = 10 * (d + 1)
    if alive.sum() < enough:
        return candidate.mean, candidate.scale / 4  # the density lies somewhere nearer to the centre
    draws, log_weight = draws[alive], log_weight[alive]
    powers = 0.5 ** np.arange(12)
    power = next((p for p in powers if log_weight.size * importance_efficiency(p * log_weight) >= enough), 0.0)
    weight = np.exp(power * (log_weight - log_weight.max()))
    weight /= weight.sum()
    return _most_likely(candidate, draws, weight)


def _most_likely(candidate: StudentT, draws: Array, weight: Array) -> tuple[Array, Array]:
    """Centre and scale of the t distribution most likely for weighted draws.

    Moments would fit a t distribution too narrow to a Gaussian: matching the covariance at 5 degrees of freedom costs
    a tenth of the efficiency that the likelihood has there.
    """
    mean = weight @ draws
    centred = draws - mean
    floor = _FLOOR * candidate.scale
    scale = (centred.T * weight) @ centred + floor
    for _ in range(_EM_STEPS):
        distance = np.einsum("ni,ij,nj->n", centred, np.linalg.inv(scale), centred)
        share = weight * (_DOF + mean.size) / (_DOF + distance)  # far draws count for less: their tails are expected
        mean = share @ draws / share.sum()
        centred = draws - mean
        scale = (centred.T * share) @ centred + floor
    return mean, scale
