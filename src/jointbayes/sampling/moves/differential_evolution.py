"""Move along the difference of two other walkers."""

import math

import numpy as np

from jointbayes.sampling.coordinate_maps import Coordinates
from jointbayes.sampling.moves.base import HalvesMove
from vibrecords.arrays import Array

_JITTER = 1e-5  # of the factor, as in emcee: no step is exactly the way back of another


class DEMove(HalvesMove):
    """ter Braak's move along the difference of two other walkers, taken in coordinates φ.

    The proposal is symmetric in φ; in θ it carries the ratio of volumes |∂θ/∂φ| into the acceptance.

    Parameters
    ----------
    coordinates
        Coordinates in which to move.
    gamma0
        Factor of the difference; 2.38/√2d by default.

    References
    ----------
    C. J. F. ter Braak, Differential evolution MCMC (2006), DOI 10.1007/s11222-006-8769-1.
    B. Nelson et al., RUN DMC (2014), section 2.1.2 on the jitter, DOI 10.1088/0067-0049/210/1/11.
    """

    def __init__(self, coordinates: Coordinates, gamma0: float | None = None) -> None:
        super().__init__()
        self._coordinates, self._gamma0 = coordinates, gamma0

    def get_proposal(self, s: Array, c: list[Array], random: np.random.RandomState) -> tuple[Array, Array]:
        """Propose θ for the walkers `s` from the other half `c`, with the log of the volume ratio."""
        n, dimension = s.shape
        resting = self._coordinates.forward(c[0])
        first = random.randint(len(resting), size=n)
        second = random.randint(len(resting) - 1, size=n)
        second += second >= first  # any but the first
        gamma = 2.38 / math.sqrt(2 * dimension) if self._gamma0 is None else self._gamma0
        factor = gamma * (1 + _JITTER * random.standard_normal((n, 1)))
        proposed, inside = self._coordinates.inverse(
            self._coordinates.forward(s) + factor * (resting[first] - resting[second])
        )
        # a walker sent out of the region is proposed where it is, and refused
        proposed = np.where(inside[:, None], proposed, s)
        ratio = self._coordinates.log_volume(proposed) - self._coordinates.log_volume(s)
        return proposed, np.where(inside, ratio, -np.inf)
