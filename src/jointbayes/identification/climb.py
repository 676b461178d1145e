"""Climb a log-density of which only values are known: Newton's method by differences, for what is no least squares."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["curvature_at", "newton_climb"]

Array = NDArray[np.float64]
LogDensity = Callable[[Array], Array]

_STEP = 0.1  # of the differences, in the scale's standard deviations
_STEPS = 30
_GAIN = 1e-7  # in log density: a climb that gains less has arrived
_FLATTEST = 1 / 16  # no step makes a direction more than four times wider
_LENGTHS = 2.0 ** -np.arange(10)


def newton_climb(log_density: LogDensity, start: Array, covariance: Array) -> tuple[Array, float, Array]:
    """Climb from a point inside the support to the nearest mode.

    Parameters
    ----------
    log_density
        (n, d) points to (n,) values, −inf outside the support.
    start
        Where to begin, shape (d,).
    covariance
        Rough covariance there, shape (d, d), for the size of steps and differences.

    Returns
    -------
    theta, log_density, covariance : ndarray (d,), float, ndarray (d, d)
        Mode, density there, and the inverse of the curvature, no flatter than sixteen times the last scale.
    """
    place, axes = np.array(start, dtype=float), _root(covariance)
    value = float(log_density(place[None])[0])
    for _ in range(_STEPS):
        _, gradient, hessian = curvature_at(log_density, place, axes)
        if not (np.isfinite(gradient).all() and np.isfinite(hessian).all()):
            break  # the support ends within reach
        curvature, vectors = np.linalg.eigh(-hessian)
        turned = axes @ vectors / np.sqrt(np.maximum(curvature, _FLATTEST))
        step = turned @ (turned.T @ np.linalg.solve(axes.T, gradient))
        trials = place + _LENGTHS[:, None] * step
        found = log_density(trials)
        best = int(np.argmax(found))
        axes = turned
        settled = bool((curvature > 0.5).all() and (curvature < 2.0).all())
        if found[best] > value:
            gain, place, value = found[best] - value, trials[best], float(found[best])
            if gain > _GAIN:
                continue
        if settled:
            break
    return place, value, axes @ axes.T


def curvature_at(log_density: LogDensity, place: Array, axes: Array) -> tuple[float, Array, Array]:
    """Value, gradient and Hessian along axes, the columns of (d, d), by central differences from one call."""
    d = place.size
    rows, columns = np.triu_indices(d, 1)
    offsets = np.concatenate([axes.T, axes.T[rows] + axes.T[columns]]) * _STEP
    values = log_density(np.concatenate([place[None], place + offsets, place - offsets]))
    if not np.isfinite(values).all():
        return float(values[0]), np.full(d, np.nan), np.full((d, d), np.nan)
    centre, up, down = values[0], *np.split(values[1:], 2)
    even = up + down - 2 * centre
    hessian = np.diag(even[:d])
    hessian[rows, columns] = hessian[columns, rows] = (even[d:] - even[rows] - even[columns]) / 2
    return float(centre), (up - down)[:d] / (2 * _STEP), hessian / _STEP**2


def _root(covariance: Array) -> Array:
    """A root of the covariance, directions that have no width at all given a little."""
    sd = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(sd, sd))
    root: Array = sd[:, None] * vectors * np.sqrt(np.maximum(values, 1e-12))
    return root
