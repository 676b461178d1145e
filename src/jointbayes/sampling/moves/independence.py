"""Proposals that do not depend on where a walker stands."""

from typing import TYPE_CHECKING

import numpy as np
from emcee.moves import Move
from numpy.typing import NDArray

from jointbayes.sampling.coordinates.chart import Chart
from jointbayes.sampling.moves.halves import settle
from jointbayes.sampling.proposal.student_mixture import StudentMixture
from jointbayes.sampling.proposal.student_t import StudentT

if TYPE_CHECKING:
    from emcee import State
    from emcee.model import Model

__all__ = ["IndependenceMove"]

Array = NDArray[np.float64]


class IndependenceMove(Move):  # type: ignore[misc]  # emcee is not typed
    """Propose all walkers at once from one fixed distribution in the coordinates φ of a chart.

    Each walker is a chain of its own here. Its acceptance compares the importance weights p/q of the two places,
    with q the proposal's density over θ: that over φ divided by |∂θ/∂φ|. The nearer q is to p, the nearer the draws
    are to independent ones; where q is too narrow a walker waits long, so other moves belong beside this one.

    Parameters
    ----------
    chart
        Coordinates in which to propose.
    density
        Distribution of the proposals in these coordinates.

    References
    ----------
    L. Tierney, Markov chains for exploring posterior distributions (1994), section 2.3.3,
    DOI 10.1214/aos/1176325750.
    """

    def __init__(self, chart: Chart, density: StudentT | StudentMixture) -> None:
        self._chart, self._density = chart, density

    def get_proposal(self, theta: Array, random: np.random.RandomState) -> tuple[Array, Array]:
        """Propose for the walkers at θ, shape (n, d), with ln q(θ) − ln q(proposed), shape (n,)."""
        chart, density = self._chart, self._density
        phi = density.draw(random, len(theta))
        proposed, inside = chart.inverse(phi)
        # a walker sent out of the region is proposed where it is, and refused
        proposed = np.where(inside[:, None], proposed, theta)
        here = density.log_density(chart.forward(theta)) - chart.log_volume(theta)
        there = density.log_density(phi) - chart.log_volume(proposed)
        return proposed, np.where(inside, here - there, -np.inf)

    def propose(self, model: "Model", state: "State") -> "tuple[State, NDArray[np.bool_]]":
        """Move all walkers; return the state and who accepted, shape (walkers,)."""
        proposed, log_factor = self.get_proposal(state.coords, model.random)
        return state, settle(model, state, slice(None), proposed, log_factor)
