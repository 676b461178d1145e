"""What this room knows of a posterior: its log-density, and the way uphill."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from jointbayes.errors import SamplingError
from vibrecords.arrays import Array

LogDensity = Callable[[Array], Array]
"""Log of an unnormalised density: (n, d) points to (n,) values, −inf where the density is zero."""

_LEAST = 1e-12  # of the width of a direction that has none at all
_FLATTEST = 1 / 16  # least curvature: no step of a climb makes a direction more than four times wider
_FARTHEST = 50.0  # of one step in any coordinate, most of them logarithms: what lies beyond has no finite stiffness
_LENGTHS = 2.0 ** -np.arange(10)


@dataclass(frozen=True, slots=True)
class Checked:
    """A log-density whose values are looked at before the sampler may use them."""

    log_density: LogDensity

    def __call__(self, theta: Array) -> Array:
        """Values, shape (n,), at θ, shape (n, d), or a `SamplingError`."""
        values = np.asarray(self.log_density(theta), dtype=np.float64)
        if values.shape != theta.shape[:1]:
            raise SamplingError(
                f"log-density: found values of shape {values.shape} for {len(theta)} points, expected ({len(theta)},)"
            )
        # A NaN is no number and less than nothing: one comparison finds it and +inf.
        possible = values < np.inf
        if not possible.all():
            first = int(np.argmin(possible))
            raise SamplingError(
                f"log-density: found {values[first]} at θ = {theta[first].tolist()}, "
                "expected a finite number, or −inf where the density is zero"
            )
        return values


def newton_climb(
    log_density: LogDensity,
    start: Array,
    covariance: Array,
    *,
    step: float = 0.1,
    steps: int = 30,
    gain: float = 1e-7,
    least: float = 0.0,
    settled: float = 2.0,
) -> tuple[Array, float, Array]:
    """Climb to the nearest mode by Newton's method with differences and a whole line of trial steps at once.

    Differences are taken along axes that follow the curvature, so that a first covariance of another size is no harm.
    Where the density is cut off within their reach, or the axes have become parallel, the climb ends with what it has.

    Parameters
    ----------
    log_density
        (n, d) points to (n,) values, −inf outside the support.
    start
        Where to begin, inside the support, shape (d,).
    covariance
        Rough covariance there, shape (d, d), for the size of steps and differences.
    step
        Of the differences, in standard deviations.
    steps
        No more steps than these.
    gain, least
        In log density: a climb whose step gains no more than the first has arrived, if the curvature is settled; a step
        that gains no more than the second is not made.
    settled
        The curvature along every axis must be 1 to within this factor.

    Returns
    -------
    theta, log_density, covariance : ndarray (d,), float, ndarray (d, d)
        Mode, density there, and the inverse of the curvature, no flatter than sixteen times the last scale.
    """
    place, axes = np.array(start, dtype=float), covariance_roots(covariance, _LEAST)
    for _ in range(steps):
        value, gradient, hessian = from_stencil(log_density(stencil(place, axes, step)), step)
        if not (np.isfinite(gradient).all() and np.isfinite(hessian).all()):
            break  # the support ends within reach
        curvature, vectors = np.linalg.eigh(-hessian)
        turned = axes @ vectors / np.sqrt(np.maximum(curvature, _FLATTEST))
        try:
            move = turned @ (turned.T @ np.linalg.solve(axes.T, gradient))
        except np.linalg.LinAlgError:
            break  # axes that have become parallel lead nowhere
        move *= min(1.0, _FARTHEST / np.abs(move).max(initial=_FARTHEST))
        trials = place + _LENGTHS[:, None] * move
        values = log_density(trials)
        best = int(np.argmax(values))
        axes, gained = turned, float(values[best]) - value
        if gained > least:
            place, value = trials[best], float(values[best])
        if not gained > gain and (curvature > 1 / settled).all() and (curvature < settled).all():
            break
    return place, value, axes @ axes.T


def stencil(place: Array, axes: Array, step: float) -> Array:
    """Points about a place, shape (d,), of which `from_stencil` takes differences along axes, columns of (d, k)."""
    rows, columns = np.triu_indices(axes.shape[1], 1)
    offsets = np.concatenate([axes.T, axes.T[rows] + axes.T[columns]]) * step
    return np.concatenate([place[None], place + offsets, place - offsets])


def from_stencil(values: Array, step: float) -> tuple[float, Array, Array]:
    """Value, gradient (k,) and Hessian (k, k) along axes from values at the points of their `stencil`.

    Gradient and Hessian are NaN where a difference leaves the support.
    """
    centre, up, down = values[0], *np.split(values[1:], 2)
    d = (math.isqrt(8 * up.size + 1) - 1) // 2  # of d axes and the sums of two of them
    if not np.isfinite(values).all():
        return float(centre), np.full(d, np.nan), np.full((d, d), np.nan)
    rows, columns = np.triu_indices(d, 1)
    even = up + down - 2 * centre
    hessian = np.diag(even[:d])
    hessian[rows, columns] = hessian[columns, rows] = (even[d:] - even[rows] - even[columns]) / 2
    return float(centre), (up - down)[:d] / (2 * step), hessian / step**2


def covariance_roots(covariance: Array, least: float) -> Array:
    """R, shape (d, d), with R Rᵀ the covariance, its eigenvalues as a correlation matrix raised to the least."""
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    sd[sd == 0.0] = 1.0
    values, vectors = np.linalg.eigh(covariance / np.outer(sd, sd))
    return sd[:, None] * vectors * np.sqrt(np.maximum(values, least))
