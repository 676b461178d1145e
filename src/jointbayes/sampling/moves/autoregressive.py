"""Move part of the way to a new draw of a fitted distribution."""

import numpy as np

from jointbayes.sampling.coordinate_maps import Coordinates
from jointbayes.sampling.distributions import StudentT
from jointbayes.sampling.moves.base import FittedMove
from vibrecords.arrays import Array


class AutoregressiveMove(FittedMove):
    """Propose each walker part of the way from where it is to a new draw of a Student-t in coordinates φ.

    In many dimensions even a good fit is refused where the whole place changes at once; part of the way is accepted.
    The stretch of the Student-t is first drawn given the place.

    Parameters
    ----------
    coordinates
        Coordinates in which to propose.
    density
        Student-t in these coordinates.
    kept
        Share of the distance from its centre that is kept, 0 to 1: at 0 it is an independence move but for the stretch.

    References
    ----------
    S. L. Cotter et al., MCMC methods for functions: modifying old algorithms to make them faster (2013),
    DOI 10.1214/13-STS421 (preconditioned Crank-Nicolson).
    """

    def __init__(self, coordinates: Coordinates, density: StudentT, kept: float) -> None:
        super().__init__(coordinates, density)
        self._student, self._kept = density, kept

    def new_places(self, here: Array, random: np.random.RandomState) -> Array:
        """New places φ, shape (n, d), for the walkers at others."""
        density, (n, d) = self._student, here.shape
        squared = (density.dof + density.squared_distance(here)) / random.chisquare(density.dof + d, n)
        fresh = density.scaled(random.standard_normal((n, d))) * np.sqrt(squared * (1 - self._kept**2))[:, None]
        return density.mean + self._kept * (here - density.mean) + fresh
