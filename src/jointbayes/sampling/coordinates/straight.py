"""Coordinates in which a bent cloud of draws is straight."""

from collections.abc import Sequence
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from jointbayes.sampling.coordinates.chart import Chart

__all__ = ["StraightChart", "straightened"]

Array = NDArray[np.float64]

_LEAST = 0.2  # share of a coordinate's variance that the others must explain, for it to be straightened


class StraightChart:
    """Coordinates of another chart, less what a quadratic in those before predicts of each.

    Parameters
    ----------
    base : Chart
        Its φ are standardised first.
    centre, scale : ndarray, shape (d,)
        Of φ.
    order : sequence of int
        Order in which coordinates follow from those before.
    coefficients : sequence of ndarray
        For each coordinate in that order, of the terms that `_terms` gives of those before; empty: it stays.

    References
    ----------
    M. D. Parno, Y. M. Marzouk, Transport map accelerated Markov chain Monte Carlo (2018), DOI 10.1137/17M1134640
    (triangular polynomial maps; here of unit diagonal, so that the volume stays).
    """

    def __init__(
        self, base: Chart, centre: Array, scale: Array, order: Sequence[int], coefficients: Sequence[Array]
    ) -> None:
        self._base, self._centre, self._scale = base, centre, scale
        self._order, self._coefficients = tuple(order), tuple(coefficients)

    def forward(self, theta: Array) -> Array:
        """φ, shape (n, d), of θ, shape (n, d)."""
        z = (self._base.forward(theta) - self._centre) / self._scale
        out = z.copy()
        for k, (column, coefficient) in enumerate(zip(self._order, self._coefficients, strict=True)):
            if coefficient.size:
                out[:, column] -= _terms(z[:, sorted(self._order[:k])]) @ coefficient
        return out

    def inverse(self, phi: Array) -> tuple[Array, NDArray[np.bool_]]:
        """θ, shape (n, d), and whether φ lies in the other chart's region, shape (n,)."""
        z = np.array(phi, dtype=np.float64)
        for k, (column, coefficient) in enumerate(zip(self._order, self._coefficients, strict=True)):
            if coefficient.size:
                z[:, column] += _terms(z[:, sorted(self._order[:k])]) @ coefficient
        return self._base.inverse(self._centre + self._scale * z)

    def log_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,): that of the other chart and of its scale; straightening keeps volumes."""
        return self._base.log_volume(theta) + np.log(self._scale).sum()


def straightened(base: Chart, theta: Array) -> StraightChart:
    """The coordinates in which draws θ, shape (n, d), are straightest.

    That which a quadratic in all others predicts best is put last, and so on with the rest.
    """
    phi = base.forward(theta)
    phi = phi[np.isfinite(phi).all(axis=1)]
    centre, scale = phi.mean(axis=0), phi.std(axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    z = (phi - centre) / scale
    left, order, coefficients = list(range(z.shape[1])), list[int](), list[Array]()
    while len(left) > 1:
        fits = {k: _fit(z[:, [j for j in left if j != k]], z[:, k]) for k in left}
        best = max(left, key=lambda k: fits[k][0])
        left.remove(best)
        order.insert(0, best)
        coefficients.insert(0, fits[best][1] if fits[best][0] > _LEAST else np.zeros(0))
    return StraightChart(base, centre, scale, (*left, *order), (np.zeros(0), *coefficients))


def _fit(others: Array, one: Array) -> tuple[float, Array]:
    """Share of the variance of one coordinate that a quadratic in the others explains, and its coefficients."""
    terms = _terms(others)
    coefficient = np.asarray(np.linalg.lstsq(terms, one, rcond=1e-10)[0], dtype=np.float64)
    return 1.0 - float(np.var(one - terms @ coefficient)), coefficient


def _terms(z: Array) -> Array:
    """1, each column, and each product of two, shape (n, terms), of z, shape (n, columns)."""
    pairs = [z[:, i] * z[:, j] for i, j in combinations_with_replacement(range(z.shape[1]), 2)]
    return np.column_stack([np.ones(len(z)), z, *pairs])
