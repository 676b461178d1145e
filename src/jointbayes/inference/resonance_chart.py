"""Natural frequencies as coordinates, in place of the errors of their model."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["ResonanceChart"]

Array = NDArray[np.float64]


class ResonanceChart:
    """Replaces each ln(error of a predicted natural frequency) by ln(frequency with that error).

    FRFs fix a resonance to a fraction of a per mille, and so the sum of what the model predicts and of its error,
    however wide each of the two is: a thin curved sheet in θ, which is flat here. The prediction depends on the other
    coordinates only, so that the change has volume 1.

    Parameters
    ----------
    log_frequency : callable
        ln of the predicted natural frequencies without their errors, shape (n, m), at θ, shape (n, d); must not
        depend on the errors themselves.
    columns : ndarray of int, shape (m,)
        Where the errors stand in θ.
    support : tuple of ndarray, each shape (d,)
        Lower and upper ends of θ.
    """

    def __init__(
        self, log_frequency: Callable[[Array], Array], columns: NDArray[np.intp], support: tuple[Array, Array]
    ) -> None:
        self._log_frequency, self._columns = log_frequency, columns
        self._low, self._high = (end[columns] for end in support)

    def forward(self, theta: Array) -> Array:
        """φ, shape (n, d), of θ, shape (n, d)."""
        phi = np.array(theta, dtype=np.float64)
        phi[:, self._columns] += self._log_frequency(theta)
        return phi

    def inverse(self, phi: Array) -> tuple[Array, NDArray[np.bool_]]:
        """θ, shape (n, d), and whether the errors lie within their ends, shape (n,)."""
        theta = np.array(phi, dtype=np.float64)
        theta[:, self._columns] -= self._log_frequency(phi)
        error = theta[:, self._columns]
        inside: NDArray[np.bool_] = np.all((error > self._low) & (error < self._high), axis=1)
        return theta, inside

    def log_volume(self, theta: Array) -> Array:
        """Zeros, shape (n,)."""
        return np.zeros(len(theta))
