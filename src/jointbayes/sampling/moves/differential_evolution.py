"""Differential evolution in the coordinates of a chart."""

import math

import numpy as np
from numpy.typing import NDArray

from jointbayes.sampling.coordinates.chart import Chart
from jointbayes.sampling.moves.halves import HalvesMove

__all__ = ["ChartedDEMove"]

Array = NDArray[np.float64]

_JITTER = 1e-5  # of the factor, as in emcee: no step is exactly the way back of another


class ChartedDEMove(HalvesMove):
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
    C. J. F. ter Braak, Differential evolution MCMC (2006), DOI 10.1007/s11222-006-8769-1.
    B. Nelson et al., RUN DMC (2014), section 2.1.2 on the jitter, DOI 10.1088/0067-0049/210/1/11.
    """

    def __init__(self, chart: Chart, gamma0: float | None = None) -> None:
        super().__init__()
        self._chart, self._gamma0 = chart, gamma0

    def get_proposal(self, s: Array, c: list[Array], random: np.random.RandomState) -> tuple[Array, Array]:
        """Propose θ for the walkers `s` from the other half `c`, with the log of the volume ratio."""
        n, dimension = s.shape
        resting = self._chart.forward(c[0])
        first = random.randint(len(resting), size=n)
        second = random.randint(len(resting) - 1, size=n)
        second += second >= first  # any but the first
        gamma = 2.38 / math.sqrt(2 * dimension) if self._gamma0 is None else self._gamma0
        factor = gamma * (1 + _JITTER * random.standard_normal((n, 1)))
        proposed, inside = self._chart.inverse(self._chart.forward(s) + factor * (resting[first] - resting[second]))
        # a walker sent out of the region is proposed where it is, and refused
        proposed = np.where(inside[:, None], proposed, s)
        ratio = self._chart.log_volume(proposed) - self._chart.log_volume(s)
        return proposed, np.where(inside, ratio, -np.inf)
