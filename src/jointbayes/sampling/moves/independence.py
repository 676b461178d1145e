"""Move to a new draw of a fitted distribution."""

import numpy as np

from jointbayes.sampling.moves.base import FittedMove
from vibrecords.arrays import Array


class IndependenceMove(FittedMove):
    """Propose all walkers at once from one fixed distribution in coordinates φ.

    Each walker is a chain of its own here. The nearer q is to p, the nearer the draws are to independent ones; where q
    is too narrow a walker waits long, so other moves belong next to this one.

    References
    ----------
    L. Tierney, Markov chains for exploring posterior distributions (1994), section 2.3.3,
    DOI 10.1214/aos/1176325750.
    """

    def new_places(self, here: Array, random: np.random.RandomState) -> Array:
        """New places φ, shape (n, d), for the walkers at others."""
        return self._density.draw(random, len(here))
