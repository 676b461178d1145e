"""Other coordinates than those of a density, in which it is closer to a Gaussian or a bent cloud is straight."""

import math
from collections.abc import Sequence
from itertools import combinations_with_replacement
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import SamplingError
from vibrecords.arrays import Array, Flags

_EDGE = 1e-12  # of a width: nearer to an end a difference has no digits left
_FARTHEST = 7.0  # score there
_LOG_ROOT_2PI = 0.5 * math.log(2 * math.pi)
_RIDGE = 1e-11  # of each term's square, added to it
_LEAST = 0.2  # share of a coordinate's variance that the others must explain, for it to be straightened


class Coordinates(Protocol):
    """Smooth one-to-one map φ(θ) of the region where the density is above zero."""

    def forward(self, theta: Array) -> Array:
        """φ, shape (n, d), of θ, shape (n, d)."""

    def inverse(self, phi: Array) -> tuple[Array, Flags]:
        """θ, shape (n, d), and whether φ belongs to the region, shape (n,); θ is meaningless where not."""

    def log_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,)."""


class Identity:
    """The coordinates of the density themselves, φ = θ."""

    def forward(self, theta: Array) -> Array:
        """θ as it is."""
        return theta

    def inverse(self, phi: Array) -> tuple[Array, Flags]:
        """φ as it is; all of it belongs to the region but what is no number."""
        return phi, np.asarray(np.isfinite(phi).all(axis=1))

    def log_volume(self, theta: Array) -> Array:
        """Zeros."""
        return np.zeros(len(theta))


class NormalScores:
    """Normal scores of the place between two ends: φ = Φ⁻¹((θ − low)/(high − low)), φ = θ without finite ends.

    What is uniform in θ is standard normal in φ. A density that data leave flat up to the ends of its support, which
    no Gaussian in θ resembles, is near Gaussian in φ, or part of one.

    Parameters
    ----------
    low, high : array_like, shape (d,)
        Ends of the support; −inf and inf where a coordinate has none.

    Raises
    ------
    jointbayes.errors.SamplingError
        If the shapes differ or an interval is empty.

    Examples
    --------
    >>> NormalScores([0.0, -np.inf], [4.0, np.inf]).forward(np.array([[0.6346, 7.0]])).round(3)
    array([[-1.,  7.]])
    """

    def __init__(self, low: ArrayLike, high: ArrayLike) -> None:
        self.low, self.high = np.array(low, dtype=np.float64), np.array(high, dtype=np.float64)
        if self.low.ndim != 1 or self.low.shape != self.high.shape or not (self.low < self.high).all():
            raise SamplingError(
                f"normal scores: found ends {self.low.tolist()} and {self.high.tolist()}; expected two vectors of one "
                "length, low below high; correct them"
            )
        self._boxed = np.isfinite(self.low) & np.isfinite(self.high)
        self._width = np.where(self._boxed, self.high - self.low, 1.0)

    def forward(self, theta: Array) -> Array:
        """φ, shape (n, d), of θ, shape (n, d); a point at an end goes where the last 10⁻¹² of the width begin."""
        from scipy.special import ndtri  # reading the settings of a sampler does not wait for scipy

        boxed, phi = self._boxed, np.array(theta, dtype=np.float64)
        inside = phi[:, boxed]
        # counted from the nearer end, where the fraction keeps its digits
        up, down = (inside - self.low[boxed]) / self._width[boxed], (self.high[boxed] - inside) / self._width[boxed]
        score = ndtri(np.maximum(np.minimum(up, down), _EDGE))
        phi[:, boxed] = np.where(up < down, score, -score)
        return phi

    def inverse(self, phi: Array) -> tuple[Array, Flags]:
        """θ, shape (n, d), and whether it lies within the ends, shape (n,)."""
        from scipy.special import ndtr

        boxed, theta = self._boxed, np.array(phi, dtype=np.float64)
        score = theta[:, boxed]
        step = ndtr(-np.abs(score)) * self._width[boxed]
        theta[:, boxed] = np.where(score < 0, self.low[boxed] + step, self.high[boxed] - step)
        return theta, np.all(np.abs(score) < _FARTHEST, axis=1)

    def log_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,): the width times the normal density of each score."""
        score = self.forward(theta)[:, self._boxed]
        return (np.log(self._width[self._boxed]) - 0.5 * score**2 - _LOG_ROOT_2PI).sum(axis=1)


class ComposedCoordinates:
    """Several changes of coordinates, one after the other.

    Parameters
    ----------
    *systems : Coordinates
        The first takes θ, each further one what the one before it gives.
    """

    def __init__(self, *systems: Coordinates) -> None:
        self.systems = systems

    def forward(self, theta: Array) -> Array:
        """φ, shape (n, d), of θ, shape (n, d)."""
        phi = theta
        for coordinates in self.systems:
            phi = coordinates.forward(phi)
        return phi

    def inverse(self, phi: Array) -> tuple[Array, Flags]:
        """θ, shape (n, d), and whether φ belongs to the region of each, shape (n,)."""
        theta, inside = phi, np.ones(len(phi), dtype=bool)
        for coordinates in reversed(self.systems):
            theta, also = coordinates.inverse(theta)
            inside &= also
        return theta, inside

    def log_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,): the sum over the steps."""
        volume, phi = np.zeros(len(theta)), theta
        for coordinates in self.systems:
            volume += coordinates.log_volume(phi)
            phi = coordinates.forward(phi)
        return volume


class ProductCoordinates:
    """Some coordinates in place of the first ones, others in place of all further ones.

    Parameters
    ----------
    first : Coordinates
        Of the first `count` coordinates.
    count : int
        How many these are.
    rest : Coordinates
        Of the others.
    """

    def __init__(self, first: Coordinates, count: int, rest: Coordinates) -> None:
        self.first, self.count, self.rest = first, count, rest

    def forward(self, theta: Array) -> Array:
        """φ, shape (n, d), of θ, shape (n, d)."""
        return np.hstack([self.first.forward(theta[:, : self.count]), self.rest.forward(theta[:, self.count :])])

    def inverse(self, phi: Array) -> tuple[Array, Flags]:
        """θ, shape (n, d), and whether φ belongs to the region of both, shape (n,)."""
        first, inside = self.first.inverse(phi[:, : self.count])
        rest, also = self.rest.inverse(phi[:, self.count :])
        return np.hstack([first, rest]), inside & also

    def log_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,)."""
        return self.first.log_volume(theta[:, : self.count]) + self.rest.log_volume(theta[:, self.count :])


class StraightCoordinates:
    """Other coordinates, less what a quadratic in those before predicts of each.

    Parameters
    ----------
    base : Coordinates
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
        self, base: Coordinates, centre: Array, scale: Array, order: Sequence[int], coefficients: Sequence[Array]
    ) -> None:
        self._base, self._centre, self._scale = base, centre, scale
        self._order, self._coefficients = tuple(order), tuple(coefficients)

    def forward(self, theta: Array) -> Array:
        """φ, shape (n, d), of θ, shape (n, d)."""
        z = (self._base.forward(theta) - self._centre) / self._scale
        straight = z.copy()
        for k, (column, coefficient) in enumerate(zip(self._order, self._coefficients, strict=True)):
            if coefficient.size:
                straight[:, column] -= _terms(z[:, sorted(self._order[:k])]) @ coefficient
        return straight

    def inverse(self, phi: Array) -> tuple[Array, Flags]:
        """θ, shape (n, d), and whether φ lies in the region of the base, shape (n,)."""
        z = np.array(phi, dtype=np.float64)
        for k, (column, coefficient) in enumerate(zip(self._order, self._coefficients, strict=True)):
            if coefficient.size:
                z[:, column] += _terms(z[:, sorted(self._order[:k])]) @ coefficient
        return self._base.inverse(self._centre + self._scale * z)

    def log_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,), of the base and of its scale; straightening keeps volumes."""
        return self._base.log_volume(theta) + np.log(self._scale).sum()


def straightened(base: Coordinates, theta: Array) -> StraightCoordinates:
    """The coordinates in which draws θ, shape (n, d), are straightest.

    That which a quadratic in all others predicts best is put last, and so on with the rest.
    """
    phi = base.forward(theta)
    phi = phi[np.isfinite(phi).all(axis=1)]
    centre, scale = phi.mean(axis=0), phi.std(axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    z = (phi - centre) / scale
    products = _terms(z)
    products = products.T @ products / len(z)
    left, order, coefficients = list(range(z.shape[1])), list[int](), list[Array]()
    while len(left) > 1:
        fits = {k: _fit(products, [j for j in left if j != k], k, z.shape[1]) for k in left}
        best = max(left, key=lambda k: fits[k][0])
        left.remove(best)
        order.insert(0, best)
        coefficients.insert(0, fits[best][1] if fits[best][0] > _LEAST else np.zeros(0))
    return StraightCoordinates(base, centre, scale, (*left, *order), (np.zeros(0), *coefficients))


def _fit(products: Array, others: list[int], column: int, count: int) -> tuple[float, Array]:
    """Share of the variance of one coordinate that a quadratic in the others explains, and its coefficients.

    From mean products of all terms of so many coordinates. A ridge bears terms that are alike.
    """
    pairs = {pair: 1 + count + i for i, pair in enumerate(combinations_with_replacement(range(count), 2))}
    used = [0, *(1 + k for k in others), *(pairs[pair] for pair in combinations_with_replacement(others, 2))]
    own, mixed = products[np.ix_(used, used)], products[used, 1 + column]
    coefficient = np.asarray(np.linalg.solve(own + _RIDGE * np.diag(np.diag(own)), mixed), dtype=np.float64)
    return float((2 * mixed - own @ coefficient) @ coefficient), coefficient


def _terms(z: Array) -> Array:
    """1, each column, and each product of two, shape (n, terms), of z, shape (n, columns)."""
    first, second = np.array([*combinations_with_replacement(range(z.shape[1]), 2)], dtype=np.intp).reshape(-1, 2).T
    columns = np.ascontiguousarray(z.T)
    return np.concatenate([np.ones((1, len(z))), columns, columns[first] * columns[second]]).T
