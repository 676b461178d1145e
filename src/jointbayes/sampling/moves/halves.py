"""Accept or refuse what a move proposes, for many walkers at once."""

from typing import TYPE_CHECKING

import numpy as np
from emcee.moves import RedBlueMove
from numpy.typing import NDArray

if TYPE_CHECKING:
    from emcee import State
    from emcee.model import Model

__all__ = ["HalvesMove", "settle"]

Array = NDArray[np.float64]
Walkers = NDArray[np.intp] | slice


def settle(model: "Model", state: "State", walkers: Walkers, proposed: Array, log_factor: Array) -> NDArray[np.bool_]:
    """Accept or refuse proposals by the rule of Metropolis and Hastings, in place.

    emcee's own moves do this walker by walker in Python, which costs more than a fast log-density.

    Parameters
    ----------
    model, state
        As emcee hands them to a move; the log-density is asked directly, which the sampler has wrapped in its check.
    walkers : ndarray of int, shape (n,), or slice
        Those that move.
    proposed : ndarray, shape (n, d)
        Where to.
    log_factor : ndarray, shape (n,)
        ln of the ratio q(back)/q(forth) of the proposal's densities.

    Returns
    -------
    ndarray of bool, shape (n,)
        Which proposals were accepted.

    References
    ----------
    W. K. Hastings, Monte Carlo sampling methods using Markov chains (1970), DOI 10.1093/biomet/57.1.97.
    """
    log_density = np.asarray(model.log_prob_fn(proposed))
    # minus an exponential variate is the log of a uniform one
    gain = log_factor + log_density - state.log_prob[walkers]
    accepted: NDArray[np.bool_] = gain > -model.random.standard_exponential(len(proposed))
    state.coords[walkers] = np.where(accepted[:, None], proposed, state.coords[walkers])
    state.log_prob[walkers] = np.where(accepted, log_density, state.log_prob[walkers])
    return accepted


class HalvesMove(RedBlueMove):  # type: ignore[misc]  # emcee is not typed
    """Move each random half of the walkers by the positions of the other half, all of a half at once.

    Subclasses give `get_proposal`, as those of emcee's own move of two halves do.

    References
    ----------
    D. Foreman-Mackey et al., emcee: the MCMC hammer (2013), section 3, DOI 10.1086/670067.
    """

    def propose(self, model: "Model", state: "State") -> "tuple[State, NDArray[np.bool_]]":
        """Move both halves in turn; return the state and who accepted, shape (walkers,)."""
        walkers = len(state.coords)
        order = model.random.permutation(walkers)
        halves = order[: walkers // 2], order[walkers // 2 :]
        accepted = np.zeros(walkers, dtype=bool)
        for moving, resting in (halves, halves[::-1]):
            proposed, log_factor = self.get_proposal(state.coords[moving], [state.coords[resting]], model.random)
            accepted[moving] = settle(model, state, moving, proposed, log_factor)
        return state, accepted
