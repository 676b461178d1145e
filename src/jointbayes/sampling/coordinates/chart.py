"""Other coordinates than those of the density, in which it is closer to a Gaussian."""

import math
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import SamplingError

__all__ = ["BoxChart", "Chart", "Identity"]

Array = NDArray[np.float64]

_EDGE = 1e-12  # of a width: nearer to an end a difference has no digits left
_FARTHEST = 7.0  # score there
_LOG_ROOT_2PI = 0.5 * math.log(2 * math.pi)


class Chart(Protocol):
    """Smooth one-to-one map φ(θ) of the region where the density is above zero."""

    def forward(self, theta: Array) -> Array:
        """φ, shape (n, d), of θ, shape (n, d)."""
        ...

    def inverse(self, phi: Array) -> tuple[Array, NDArray[np.bool_]]:
        """θ, shape (n, d), and whether φ belongs to the region, shape (n,); θ is meaningless where not."""
        ...

    def log_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,)."""
        ...


class Identity:
    """The coordinates of the density themselves, φ = θ."""

    def forward(self, theta: Array) -> Array:
        """θ as it is."""
        return theta

    def inverse(self, phi: Array) -> tuple[Array, NDArray[np.bool_]]:
        """φ as it is; all of it belongs to the region."""
        return phi, np.ones(len(phi), dtype=bool)

    def log_volume(self, theta: Array) -> Array:
        """Zeros."""
        return np.zeros(len(theta))


class BoxChart:
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
    >>> BoxChart([0.0, -np.inf], [4.0, np.inf]).forward(np.array([[0.6346, 7.0]])).round(3)
    array([[-1.,  7.]])
    """

    def __init__(self, low: ArrayLike, high: ArrayLike) -> None:
        self.low, self.high = np.array(low, dtype=np.float64), np.array(high, dtype=np.float64)
        if self.low.ndim != 1 or self.low.shape != self.high.shape or not (self.low < self.high).all():
            raise SamplingError(
                f"box chart: found ends {self.low.tolist()} and {self.high.tolist()}; expected two vectors of one "
                "length, low below high; correct them"
            )
        self._boxed = np.isfinite(self.low) & np.isfinite(self.high)
        self._width = np.where(self._boxed, self.high - self.low, 1.0)

    def forward(self, theta: Array) -> Array:
        """φ, shape (n, d), of θ, shape (n, d); a point at an end goes where the last 10⁻¹² of the width begin."""
        from scipy.special import ndtri  # nobody who reads the settings of a sampler waits for scipy

        boxed, phi = self._boxed, np.array(theta, dtype=np.float64)
        inside = phi[:, boxed]
        # counted from the nearer end, where the fraction keeps its digits
        up, down = (inside - self.low[boxed]) / self._width[boxed], (self.high[boxed] - inside) / self._width[boxed]
        score = ndtri(np.maximum(np.minimum(up, down), _EDGE))
        phi[:, boxed] = np.where(up < down, score, -score)
        return phi

    def inverse(self, phi: Array) -> tuple[Array, NDArray[np.bool_]]:
        """θ, shape (n, d), and whether it lies within the ends, shape (n,)."""
        from scipy.special import ndtr

        boxed, theta = self._boxed, np.array(phi, dtype=np.float64)
        score = theta[:, boxed]
        step = ndtr(-np.abs(score)) * self._width[boxed]
        theta[:, boxed] = np.where(score < 0, self.low[boxed] + step, self.high[boxed] - step)
        inside: NDArray[np.bool_] = np.all(np.abs(score) < _FARTHEST, axis=1)
        return theta, inside

    def log_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,): the width times the normal density of each score."""
        score = self.forward(theta)[:, self._boxed]
        each = np.log(self._width[self._boxed]) - 0.5 * score**2 - _LOG_ROOT_2PI
        return each.sum(axis=1)
