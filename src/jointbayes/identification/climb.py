"""Climb a log-density of which only values are known: Newton's method by differences, for what is no least squares."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from jointbayes.sampling.differences import covariance_roots, derivatives_along

__all__ = ["newton_climb"]

Array = NDArray[np.float64]
LogDensity = Callable[[Array], Array]

_STEP = 0.1  # of the differences, in the scale's standard deviations
_STEPS = 30
_LEAST = 1e-12  # of a direction that has no width at all
_GAIN = 1e-7  # in log density: a climb that gains less has arrived
_FLATTEST = 1 / 16  # no step makes a direction more than four times wider
_FARTHEST = 50.0  # in any coordinate, most of them logarithms: what lies beyond has no finite stiffness
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
    place, axes = np.array(start, dtype=float), covariance_roots(covariance, _LEAST)
    value = float(log_density(place[None])[0])
    for _ in range(_STEPS):
        _, gradient, hessian = derivatives_along(log_density, place, axes, _STEP)
        if not (np.isfinite(gradient).all() and np.isfinite(hessian).all()):
            break  # the support ends within reach
        curvature, vectors = np.linalg.eigh(-hessian)
        turned = axes @ vectors / np.sqrt(np.maximum(curvature, _FLATTEST))
        step = turned @ (turned.T @ np.linalg.solve(axes.T, gradient))
        step *= min(1.0, _FARTHEST / np.abs(step).max(initial=_FARTHEST))
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
