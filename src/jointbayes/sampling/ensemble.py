"""One ensemble of walkers: its state, and its steps as a function of that state alone."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import SamplingError
from jointbayes.sampling.density import Checked, LogDensity
from jointbayes.sampling.moves.mixture import Move, WeightedMove, mixture
from jointbayes.sampling.settings import SamplerSettings

if TYPE_CHECKING:
    from emcee import State
    from emcee.model import Model

__all__ = ["Block", "EnsembleState", "MoveCount", "advance", "initial_states"]


@dataclass(frozen=True, slots=True)
class MoveCount:
    """How many of a move's proposals were accepted."""

    accepted: int
    proposed: int


@dataclass(frozen=True, slots=True, eq=False)
class EnsembleState:
    """One ensemble between two steps: all that its next steps depend on.

    Parameters
    ----------
    theta : ndarray, shape (walkers, d)
        Positions.
    log_density : ndarray, shape (walkers,)
        Log-density at the positions.
    random_state : tuple
        State of the Mersenne twister that emcee draws from, as `RandomState.get_state` gives it.
    """

    theta: NDArray[np.float64]
    log_density: NDArray[np.float64]
    random_state: tuple[Any, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """A few steps of one ensemble.

    Parameters
    ----------
    theta : ndarray, shape (steps, walkers, d)
        Positions after each step.
    log_density : ndarray, shape (steps, walkers)
        Log-density at the positions.
    moves : mapping of str to MoveCount
        Accepted proposals of each move, by its name.
    singular : int
        Number of points at which the log-density says (by its counter ``singular``) that it had no finite value.
    end : EnsembleState
        State after the last step.
    """

    theta: NDArray[np.float64]
    log_density: NDArray[np.float64]
    moves: Mapping[str, MoveCount]
    singular: int
    end: EnsembleState


def advance(
    log_density: LogDensity, state: EnsembleState, steps: int, moves: tuple[WeightedMove, ...] | None = None
) -> Block:
    """Move one ensemble on by some steps.

    A pure function of its arguments: the same state gives the same block in any process and in any order.

    Parameters
    ----------
    log_density : callable
        Log of the unnormalised density, (n, d) array to (n,) array.
    state : EnsembleState
        Where the ensemble stands.
    steps : int
        Number of steps.
    moves : tuple of WeightedMove, optional
        Moves to choose from at each step; by default those of :func:`mixture` without chart and proposal.

    Returns
    -------
    Block
        The steps and the state after the last one.

    Raises
    ------
    jointbayes.errors.SamplingError
        If the log-density returns NaN, +inf or an array of the wrong shape.
    """
    from emcee import State

    from jointbayes.sampling.moves.driver import Driver

    walkers, dimension = state.theta.shape
    counted = {one.name: _Counted(one.move) for one in moves or mixture()}
    weighted = [(counted[one.name], one.weight) for one in moves or mixture()]
    sampler = Driver(walkers, dimension, None, moves=weighted, vectorize=True)
    # emcee's own wrapper prints whatever a log-density raises to the terminal; this room never prints.
    sampler.log_prob_fn = Checked(log_density)
    # The generator's state must travel with the positions: emcee otherwise copies NumPy's global one.
    singular = getattr(log_density, "singular", 0)
    before = State(state.theta, log_prob=state.log_density, random_state=state.random_state)
    after = sampler.run_mcmc(before, steps, skip_initial_state_check=True)
    return Block(
        theta=sampler.get_chain(),
        log_density=sampler.get_log_prob(),
        moves={name: MoveCount(move.accepted, move.proposed) for name, move in counted.items()},
        singular=getattr(log_density, "singular", 0) - singular,
        end=EnsembleState(after.coords, after.log_prob, sampler.final_random_state),
    )


class _Counted:
    """A move of emcee that counts; one per block, so that the steps depend on the state alone."""

    def __init__(self, move: Move) -> None:
        self.accepted = self.proposed = 0
        self._move = move

    def propose(self, model: "Model", state: "State") -> "tuple[State, NDArray[np.bool_]]":
        """Pass the move's step on."""
        state, accepted = self._move.propose(model, state)
        self.accepted += int(np.count_nonzero(accepted))
        self.proposed += accepted.size
        return state, accepted


def initial_states(
    log_density: LogDensity, start: NDArray[np.float64], rng: np.random.Generator, settings: SamplerSettings
) -> list[EnsembleState]:
    """Check the start and give each ensemble its own stream of random numbers."""
    start = np.array(start, dtype=np.float64)
    if start.ndim != 3 or start.shape[:2] != (settings.ensembles, settings.walkers):
        raise SamplingError(
            f"sampler start: found an array of shape {start.shape}, expected "
            f"({settings.ensembles}, {settings.walkers}, parameters)"
        )
    settings.require_dimension(start.shape[2])
    states = []
    for index, (theta, child) in enumerate(zip(start, rng.spawn(settings.ensembles), strict=True)):
        _require_spanning(theta, index)
        values = Checked(log_density)(theta)
        outside = np.flatnonzero(np.isneginf(values))
        if outside.size:
            raise SamplingError(
                f"sampler start: the density is zero at walkers {outside.tolist()} of ensemble {index}, the "
                f"first at θ = {theta[outside[0]].tolist()}; expected every walker inside the prior's support"
            )
        # emcee only knows the Mersenne twister; eight words of the child stream seed it.
        twister = np.random.MT19937(child.integers(2**32, size=8, dtype=np.uint32))
        states.append(EnsembleState(theta, values, tuple(np.random.RandomState(twister).get_state())))
    return states


def _require_spanning(theta: NDArray[np.float64], index: int) -> None:
    from emcee.ensemble import walkers_independent

    bad = np.flatnonzero(~np.isfinite(theta).all(axis=1))
    if bad.size:
        raise SamplingError(
            f"sampler start: the position of walkers {bad.tolist()} of ensemble {index} is not finite, "
            "expected finite numbers"
        )
    if not walkers_independent(theta):
        raise SamplingError(
            f"sampler start: the walkers of ensemble {index} do not span the {theta.shape[1]} parameters, "
            "expected them scattered in every direction: the moves never leave the subspace they start in"
        )
