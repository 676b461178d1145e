"""Several charts, one after the other."""

import numpy as np
from numpy.typing import NDArray

from jointbayes.sampling.coordinates.chart import Chart

__all__ = ["ComposedChart"]

Array = NDArray[np.float64]


class ComposedChart:
    """The coordinates that the last of several charts gives to those of the one before it, and so on.

    Parameters
    ----------
    *charts : Chart
        The first takes θ, each further one what the one before it gives.
    """

    def __init__(self, *charts: Chart) -> None:
        self.charts = charts

    def forward(self, theta: Array) -> Array:
        """φ, shape (n, d), of θ, shape (n, d)."""
        phi = theta
        for chart in self.charts:
            phi = chart.forward(phi)
        return phi

    def inverse(self, phi: Array) -> tuple[Array, NDArray[np.bool_]]:
        """θ, shape (n, d), and whether φ belongs to the region of every chart, shape (n,)."""
        theta, inside = phi, np.ones(len(phi), dtype=bool)
        for chart in reversed(self.charts):
            theta, also = chart.inverse(theta)
            inside &= also
        return theta, inside

    def log_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,): the sum over the charts."""
        volume, phi = np.zeros(len(theta)), theta
        for chart in self.charts:
            volume += chart.log_volume(phi)
            phi = chart.forward(phi)
        return volume
