"""Move part of the way to a new draw of a fitted distribution."""

import numpy as np

from jointbayes.sampling.coordinate_maps import Coordinates
from jointbayes.sampling.distributions import StudentT
from jointbayes.sampling.moves.base import EachAlone
from vibrecords.arrays import Array


class AutoregressiveMove(EachAlone):
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
        self._coordinates, self._student, self._kept = coordinates, density, kept

    def get_proposal(self, theta: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        """Propose for the walkers at θ, shape (n, d), with ln q(θ) − ln q(proposed), shape (n,).

        With respect to the Student-t over θ, its density over φ divided by |∂θ/∂φ|, the proposal is reversible.
        """
        coordinates, density, d = self._coordinates, self._student, theta.shape[1]
        here = coordinates.forward(theta)
        squared = (density.dof + density.squared_distance(here)) / random.chisquare(density.dof + d, len(theta))
        fresh = density.scaled(random.standard_normal(theta.shape)) * np.sqrt(squared * (1 - self._kept**2))[:, None]
        there = density.mean + self._kept * (here - density.mean) + fresh
        proposed, inside = coordinates.inverse(there)
        # a walker sent out of the region is proposed where it is, and refused
        proposed = np.where(inside[:, None], proposed, theta)
        before = density.log_density(here) - coordinates.log_volume(theta)
        after = density.log_density(there) - coordinates.log_volume(proposed)
        return proposed, np.where(inside, before - after, -np.inf)
