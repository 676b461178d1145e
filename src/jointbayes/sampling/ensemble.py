"""One ensemble of walkers: its state, its steps, its moves and its seeds."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array

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
