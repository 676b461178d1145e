"""A chart for some coordinates and another one for the rest."""

import numpy as np
from numpy.typing import NDArray

from jointbayes.sampling.coordinates.chart import Chart

__all__ = ["ProductChart"]

Array = NDArray[np.float64]


class ProductChart:
    """One chart for the first coordinates, another for all further ones.

    Parameters
    ----------
    first : Chart
        Of the first `count` coordinates.
    count : int
        How many these are.
    rest : Chart
        Of the others.
    """

    def __init__(self, first: Chart, count: int, rest: Chart) -> None:
        self.first, self.count, self.rest = first, count, rest

    def forward(self, theta: Array) -> Array:
        """φ, shape (n, d), of θ, shape (n, d)."""
        return np.hstack([self.first.forward(theta[:, : self.count]), self.rest.forward(theta[:, self.count :])])

    def inverse(self, phi: Array) -> tuple[Array, NDArray[np.bool_]]:
        """θ, shape (n, d), and whether φ belongs to the region of both, shape (n,)."""
        (first, inside), (rest, also) = (
            self.first.inverse(phi[:, : self.count]),
            self.rest.inverse(phi[:, self.count :]),
        )
        return np.hstack([first, rest]), inside & also

    def log_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,)."""
        return self.first.log_volume(theta[:, : self.count]) + self.rest.log_volume(theta[:, self.count :])
