"""The Laplace approximation of a density in the coordinates of a chart, from values of the density alone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import SamplingError
from jointbayes.sampling.coordinates.chart import Chart
from jointbayes.sampling.density import Checked, LogDensity
from jointbayes.sampling.differences import covariance_roots, derivatives_along

__all__ = ["Whitened", "laplace", "whitened"]

Array = NDArray[np.float64]

_STEP = 0.2  # of the finite differences, in standard deviations
_NEWTON_STEPS = 20
_CONVERGED = 1e-3  # gain in log-density that no longer matters beside a refinement
_FLATTEST = 1 / 16  # least curvature: no step of the search makes a direction more than four times wider


@dataclass(slots=True)
class Whitened:
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


def whitened(log_density: LogDensity, chart: Chart, theta: ArrayLike, covariance: ArrayLike) -> Whitened:
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
    roots = covariance_roots(spread, 1e-10)
    step = 1e-4 * roots.T
    factor = (chart.forward(mean + step) - chart.forward(mean - step)).T / 2e-4
    size = np.linalg.norm(factor, axis=1, keepdims=True)
    if not (np.isfinite(size).all() and size.all() and np.linalg.cond(factor / size) < 1e7):
        # at the edge of the chart its derivative says nothing: each coordinate is taken at its own size
        factor = np.diag(np.where(origin == 0.0, 1.0, np.abs(origin)))
    return Whitened(Checked(log_density), chart, origin, factor)


def laplace(target: Whitened) -> tuple[Array, Array]:
    """Mode and covariance from the curvature there, in z, by Newton's method with a whole line of trial steps at once.

    Differences are taken along axes that follow the curvature, so that a first covariance of another size is no harm.
    Where the density is cut off within their reach, the search ends with what it has.
    """
    dimension = len(target.origin)
    place, axes = np.zeros(dimension), np.eye(dimension)
    lengths = 0.5 ** np.arange(8)
    for _ in range(_NEWTON_STEPS):
        value, gradient, hessian = derivatives_along(target, place, axes, _STEP)
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
