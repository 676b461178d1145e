"""One ensemble of walkers: its state, its seeds, and its steps as a function of both alone."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.sampling.density import Checked, LogDensity

if TYPE_CHECKING:
    from emcee import State
    from emcee.model import Model

_STEPS, _REFIT = 0, 1


class Move(Protocol):
    """What emcee asks of a move."""

    def propose(self, model: "Model", state: "State") -> "tuple[State, NDArray[np.bool_]]":
        """Make one step of all walkers; return the state and who accepted, shape (walkers,)."""
        ...


@dataclass(frozen=True, slots=True)
class WeightedMove:
    """A move, its name in the report, and its probability at each step."""

    name: str
    move: Move
    weight: float


@dataclass(frozen=True, slots=True)
class MoveCount:
    """How many of a move's proposals were accepted."""

    accepted: int
    proposed: int


@dataclass(frozen=True, slots=True, eq=False)
class EnsembleState:
    """One ensemble between two blocks of steps.

    Parameters
    ----------
    theta : ndarray, shape (walkers, d)
        Positions.
    log_density : ndarray, shape (walkers,)
        Log-density at the positions.
    """

    theta: Array
    log_density: Array


@dataclass(frozen=True, slots=True, eq=False)
class StepBlock:
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
    """

    theta: Array
    log_density: Array
    moves: Mapping[str, MoveCount]
    singular: int

    @property
    def end(self) -> EnsembleState:
        """State after the last step."""
        return EnsembleState(self.theta[-1], self.log_density[-1])


MoveOn = Callable[[list[EnsembleState], int, list[np.random.SeedSequence]], list[StepBlock]]
"""Moves each ensemble on by so many steps, each with a seed of its own."""


def advance(
    log_density: LogDensity,
    state: EnsembleState,
    steps: int,
    seed: np.random.SeedSequence,
    moves: tuple[WeightedMove, ...],
) -> StepBlock:
    """Move one ensemble on by some steps.

    A pure function of its arguments: the same state and seed give the same block in any process and in any order.

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
    from emcee import State

    from jointbayes.sampling.moves import Driver

    walkers, dimension = state.theta.shape
    counted = {chosen.name: _Counted(chosen.move) for chosen in moves}
    weighted = [(counted[chosen.name], chosen.weight) for chosen in moves]
    sampler = Driver(walkers, dimension, None, moves=weighted, vectorize=True)
    # emcee's own wrapper prints whatever a log-density raises to the terminal; this room never prints.
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

    def propose(self, model: "Model", state: "State") -> "tuple[State, NDArray[np.bool_]]":
        """Pass the move's step on."""
        state, accepted = self._move.propose(model, state)
        self.accepted += int(np.count_nonzero(accepted))
        self.proposed += accepted.size
        return state, accepted


@dataclass(frozen=True, slots=True)
class Streams:
    """Seeds of everything that is drawn in a run: one for each stage, ensemble and block of steps.

    No two are alike, and each can be had without those before it: a block drawn by another process, or after the
    process that drew the block before has died, is the same.

    Parameters
    ----------
    root : numpy.random.SeedSequence
        From which all others are derived.
    stage : int
        Stage of the run, counted from zero.

    Examples
    --------
    >>> first, second = (Streams.from_generator(np.random.default_rng(1)) for _ in range(2))
    >>> first.block(2, 7).generate_state(1) == second.block(2, 7).generate_state(1)
    array([ True])
    """

    root: np.random.SeedSequence
    stage: int = 0

    @classmethod
    def from_generator(cls, rng: np.random.Generator) -> "Streams":
        """Streams of the next child of a generator, which itself is not drawn from."""
        (child,) = rng.spawn(1)
        seed = child.bit_generator.seed_seq
        assert isinstance(seed, np.random.SeedSequence)
        return cls(seed)

    def with_stage(self, stage: int) -> "Streams":
        """Streams of another stage."""
        return replace(self, stage=stage)

    def block(self, ensemble: int, block: int) -> np.random.SeedSequence:
        """Seed of one block of steps of one ensemble, both counted from zero."""
        return self._seed(_STEPS, self.stage, ensemble, block)

    def refit(self) -> np.random.Generator:
        """Generator for the fit of a proposal to the draws of this stage."""
        return np.random.default_rng(self._seed(_REFIT, self.stage))

    def _seed(self, *place: int) -> np.random.SeedSequence:
        return np.random.SeedSequence(self.root.entropy, spawn_key=(*self.root.spawn_key, *place))
