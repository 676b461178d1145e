"""What moves have in common, and emcee's loop that makes them."""

from typing import Any

import emcee
import numpy as np
from emcee import State
from emcee.model import Model
from emcee.moves import Move, RedBlueMove

from jointbayes.sampling.density import Checked, LogDensity
from jointbayes.sampling.ensemble import EnsembleState, MoveCount, StepBlock, WeightedMove
from vibrecords.arrays import Array, Flags, Indices

Walkers = Indices | slice


class Driver(emcee.EnsembleSampler):  # type: ignore[misc]  # emcee is not typed
    """emcee's sampler, whose state of random numbers is never read.

    emcee copies the 624 words of the generator's state at every step. With vectorised moves that would be a fourth of
    the time of a step.
    """

    @property
    def random_state(self) -> None:
        """Nothing: the next block has a seed of its own."""
        return

    @random_state.setter
    def random_state(self, state: tuple[Any, ...]) -> None:
        self._random.set_state(state)


def settle(model: Model, state: State, walkers: Walkers, proposed: Array, log_factor: Array) -> Flags:
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
    accepted: Flags = gain > -model.random.standard_exponential(len(proposed))
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

    def propose(self, model: Model, state: State) -> tuple[State, Flags]:
        """Move both halves in turn; return the state and who accepted, shape (walkers,)."""
        walkers = len(state.coords)
        order = model.random.permutation(walkers)
        halves = order[: walkers // 2], order[walkers // 2 :]
        accepted = np.zeros(walkers, dtype=bool)
        for moving, resting in (halves, halves[::-1]):
            proposed, log_factor = self.get_proposal(state.coords[moving], [state.coords[resting]], model.random)
            accepted[moving] = settle(model, state, moving, proposed, log_factor)
        return state, accepted


class EachAlone(Move):  # type: ignore[misc]  # emcee is not typed
    """Move all walkers at once, each by its own place alone; subclasses give `get_proposal`."""

    def propose(self, model: Model, state: State) -> tuple[State, Flags]:
        """Move all walkers; return the state and who accepted, shape (walkers,)."""
        proposed, log_factor = self.get_proposal(state.coords, model.random)
        return state, settle(model, state, slice(None), proposed, log_factor)


def advance(
    log_density: LogDensity,
    state: EnsembleState,
    steps: int,
    seed: np.random.SeedSequence,
    moves: tuple[WeightedMove, ...],
) -> StepBlock:
    """Move one ensemble on by some steps.

    A pure function of its arguments: the same state and seed give the same block, also in a run that goes on.

    Parameters
    ----------
    log_density : callable
        Log of the unnormalised density, (n, d) array to (n,) array.
    state : EnsembleState
        Where the ensemble stands.
    steps : int
        Number of steps.
    seed : numpy.random.SeedSequence
        Of all random numbers of these steps.
    moves : tuple of WeightedMove
        Moves to choose from at each step.

    Returns
    -------
    StepBlock
        The steps and the state after the last one.

    Raises
    ------
    jointbayes.errors.SamplingError
        If the log-density returns NaN, +inf or an array of the wrong shape.
    """
    walkers, dimension = state.theta.shape
    counted = {chosen.name: _Counted(chosen.move) for chosen in moves}
    weighted = [(counted[chosen.name], chosen.weight) for chosen in moves]
    sampler = Driver(walkers, dimension, None, moves=weighted, vectorize=True)
    # emcee's own wrapper prints every error of a log-density to the terminal; this room never prints.
    sampler.log_prob_fn = Checked(log_density)
    # emcee only knows the Mersenne twister, and takes its state with the positions, else NumPy's global one.
    twister = np.random.RandomState(np.random.MT19937(seed))
    singular = getattr(log_density, "singular", 0)
    before = State(state.theta, log_prob=state.log_density, random_state=twister.get_state())
    sampler.run_mcmc(before, steps, skip_initial_state_check=True)
    return StepBlock(
        theta=sampler.get_chain(),
        log_density=sampler.get_log_prob(),
        moves={name: MoveCount(move.accepted, move.proposed) for name, move in counted.items()},
        singular=getattr(log_density, "singular", 0) - singular,
    )


class _Counted:
    """A move of emcee that counts; one per block, so that the steps depend on the state alone."""

    def __init__(self, move: Move) -> None:
        self.accepted = self.proposed = 0
        self._move = move

    def propose(self, model: Model, state: State) -> tuple[State, Flags]:
        """Pass the move's step on."""
        state, accepted = self._move.propose(model, state)
        self.accepted += int(np.count_nonzero(accepted))
        self.proposed += accepted.size
        return state, accepted
