"""Other coordinates than those of the density, in which it is closer to a Gaussian."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["Chart", "Identity"]

Array = NDArray[np.float64]


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
