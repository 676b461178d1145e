"""Differential evolution in other coordinates than those of the density, where it is closer to a Gaussian."""

from typing import Protocol

import numpy as np
from emcee.moves import DEMove
from numpy.typing import NDArray

__all__ = ["Chart", "ChartedDEMove"]

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


class ChartedDEMove(DEMove):  # type: ignore[misc]  # emcee is not typed
    """ter Braak's move along the difference of two other walkers, taken in the coordinates φ of a chart.

    The proposal is symmetric in φ; in θ it carries the ratio of volumes |∂θ/∂φ| into the acceptance.

    Parameters
    ----------
    chart
        Coordinates in which to move.
    gamma0
        Factor of the difference; 2.38/√2d by default.

    References
    ----------
    ter Braak, C. J. F. (2006). Statistics and Computing 16, 239-249. DOI 10.1007/s11222-006-8769-1
    """

    def __init__(self, chart: Chart, gamma0: float | None = None) -> None:
        super().__init__(gamma0=gamma0)
        self._chart = chart

    def get_proposal(self, s: Array, c: list[Array], random: np.random.RandomState) -> tuple[Array, Array]:
        """Propose θ for the walkers `s` from the other half `c`, with the log of the volume ratio."""
        phi, _ = super().get_proposal(self._chart.forward(s), [self._chart.forward(half) for half in c], random)
        proposed, inside = self._chart.inverse(phi)
        # a walker sent out of the region is proposed where it is, and refused
        proposed = np.where(inside[:, None], proposed, s)
        ratio = self._chart.log_volume(proposed) - self._chart.log_volume(s)
        return proposed, np.where(inside, ratio, -np.inf)
