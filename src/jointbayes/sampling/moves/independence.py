"""Move to a new draw of a fitted distribution."""

from typing import Protocol

import numpy as np

from jointbayes.sampling.moves.base import EachAlone
from vibrecords.arrays import Array


class Proposed(Protocol):
    """A distribution over θ."""

    def draw(self, random: np.random.RandomState, n: int) -> Array:
        """Independent draws, shape (n, d); NaN where one lies outside of all that is possible."""

    def log_density(self, theta: Array) -> Array:
        """Log of the normalised density, shape (n,), at θ, shape (n, d)."""


class IndependenceMove(EachAlone):
    """Propose all walkers at once from one fixed distribution.

    Each walker is a chain of its own here. The nearer q is to p, the nearer the draws are to independent ones; where q
    is too narrow a walker waits long, so other moves belong next to this one. The acceptance compares the importance
    weights p/q of the two places.

    Parameters
    ----------
    proposed
        The distribution.

    References
    ----------
    L. Tierney, Markov chains for exploring posterior distributions (1994), section 2.3.3,
    DOI 10.1214/aos/1176325750.
    """

    def __init__(self, proposed: Proposed) -> None:
        self._proposed = proposed
        # of the last step: where walkers were and might have gone, and ln q there. Most of them are at one of these.
        self._known: list[tuple[Array, Array]] = []

    def get_proposal(self, theta: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        """Propose for the walkers at θ, shape (n, d), with ln q(θ) − ln q(proposed), shape (n,)."""
        there = self._proposed.draw(random, len(theta))
        inside = np.asarray(np.isfinite(there).all(axis=1))
        # a walker sent out of the region is proposed where it is, and refused
        there = np.where(inside[:, None], there, theta)
        before, new = np.empty(len(theta)), np.ones(len(theta), dtype=bool)
        for places, log_density in self._known:
            if places.shape == theta.shape:
                same = np.asarray((theta == places).all(axis=1))
                before[same], new[same] = log_density[same], False
        if new.any():
            before[new] = self._proposed.log_density(theta[new])
        after = self._proposed.log_density(there)
        self._known = [(theta.copy(), before), (there, after)]
        return there, np.where(inside, before - after, -np.inf)
