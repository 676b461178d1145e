"""Derivatives of a log-density of which only values are known, and roots of covariances to take differences along."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["covariance_roots", "derivatives_along"]

Array = NDArray[np.float64]


def derivatives_along(
    log_density: Callable[[Array], Array], place: Array, axes: Array, step: float
) -> tuple[float, Array, Array]:
    """Value, gradient and Hessian along axes, by central differences from one call.

    Parameters
    ----------
    log_density
        (n, d) points to (n,) values, −inf where the density is zero.
    place
        Where, shape (d,).
    axes
        Columns of (d, d).
    step
        Of the differences, as a fraction of the axes.

    Returns
    -------
    value, gradient, hessian : float, ndarray (d,), ndarray (d, d)
        NaN throughout gradient and Hessian where a difference leaves the support.
    """
    d = place.size
    rows, columns = np.triu_indices(d, 1)
    offsets = np.concatenate([axes.T, axes.T[rows] + axes.T[columns]]) * step
    values = log_density(np.concatenate([place[None], place + offsets, place - offsets]))
    centre, up, down = values[0], *np.split(values[1:], 2)
    if not np.isfinite(values).all():
        return float(centre), np.full(d, np.nan), np.full((d, d), np.nan)
    even = up + down - 2 * centre
    hessian = np.diag(even[:d])
    hessian[rows, columns] = hessian[columns, rows] = (even[d:] - even[rows] - even[columns]) / 2
    return float(centre), (up - down)[:d] / (2 * step), hessian / step**2


def covariance_roots(covariance: Array, least: float) -> Array:
    """R, shape (d, d), with R Rᵀ the covariance, its eigenvalues as a correlation matrix raised to the least."""
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    sd[sd == 0.0] = 1.0
    values, vectors = np.linalg.eigh(covariance / np.outer(sd, sd))
    roots: Array = sd[:, None] * vectors * np.sqrt(np.maximum(values, least))
    return roots
