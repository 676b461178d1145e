"""Move from one mode to another."""

import numpy as np

from jointbayes.sampling.density import SeveralModes
from jointbayes.sampling.moves.base import EachAlone
from vibrecords.arrays import Array


class JumpMove(EachAlone):
    """Carry each walker from the mode nearest to it to the same place about another one.

    Another mode j is chosen with equal probability, and the map from i to j is the inverse of that from j to i, so
    that p'/p and the ratio of volumes |∂θ'/∂θ| decide. Where the map is an exchange of like quantities that ratio is 1.
    A walker that would end nearer to a third mode stays: from there the map would not lead back.

    Parameters
    ----------
    modes
        Two or more.

    References
    ----------
    E. Pompe, C. Holmes, K. Łatuszyński, A framework for adaptive MCMC targeting multimodal distributions (2020),
    section 2 (deterministic jumps), DOI 10.1214/19-AOS1916.
    """

    def __init__(self, modes: SeveralModes) -> None:
        self._modes = modes

    def get_proposal(self, theta: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        """Propose for the walkers at θ, shape (n, d), with the log of the volume ratio, shape (n,)."""
        here = self._modes.nearest(theta)
        there = random.randint(len(self._modes.centres) - 1, size=len(theta))
        there += there >= here  # any but the nearest
        proposed, log_volume = self._modes.carried(theta, here, there)
        leads_back = self._modes.nearest(proposed) == there
        # a walker that cannot come back is proposed where it is, and refused
        return np.where(leads_back[:, None], proposed, theta), np.where(leads_back, log_volume, -np.inf)
