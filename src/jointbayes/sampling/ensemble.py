"""Ensembles of walkers: their settings, moves, states, steps and seeds."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from numbers import Integral
from typing import TYPE_CHECKING, Protocol

import numpy as np

from jointbayes.errors import SamplingError
from jointbayes.progress import Budget
from vibrecords.arrays import Array, Flags

if TYPE_CHECKING:
    from emcee import State
    from emcee.model import Model

_STEPS, _REFIT = 0, 1

_LEAST_FACTOR = 20.0  # of τ, of steps that know it from however many walkers


@dataclass(frozen=True, slots=True)
class SamplerSettings:
    """Size of the ensembles, length of the run and rule by which it stops.

    Parameters
    ----------
    ensembles : int
        Number of independent ensembles, at least 4. R̂ compares ensembles with each other.
    walkers : int
        Number of walkers in each ensemble; even, at least 4 and at least twice the number of parameters.
    max_steps : int
        Number of steps after which the run ends whether it has converged or not; at least two checks long.
    check_every : int
        Number of steps per block; progress is reported after each block, and two checks of the stop rule
        are never closer than this. At least 10.
    tau_factor : float
        The kept steps (those after burn-in) must outnumber the autocorrelation time by this factor. At
        least 5, because the estimate of τ sums the autocorrelation over a window of 5 τ.
    tau_tolerance : float
        Largest relative change of the largest τ between two successive checks, which are at least 5 % of
        the steps apart, for τ to count as stable; between 0 and 1. At 50 τ, with 96 walkers in all, the
        estimate of τ itself scatters by about 1.4 % from one such check to the next. The default of 2 % is
        above that scatter; the 1 % of emcee's tutorial, where checks lie closer together, is below it and
        would leave the end of the run to chance. Where τ is 1.6 the default size found it stable after 100 to
        250 steps, with 11 000 effective draws or more.
    r_hat_max : float
        R̂ of every parameter must be below this; above 1.
    end_tolerance : float
        Monte Carlo standard error of each end of each 95 % interval, as a share of the interval's width on the
        scale of the coordinate (ln k), must be below this; above 0. A Gaussian asks for 1200 effective draws at
        0.02, a density with a long tail for ten times as many.
    max_evaluations : int or None
        Evaluations of the density after which the search for the mode ends, and the run at its next check, whether it
        has converged or not. None is 4 million, or 330 000 for each parameter where that is more.

    Raises
    ------
    jointbayes.errors.SamplingError
        If a value is out of its range.

    Examples
    --------
    >>> SamplerSettings(walkers=32).ensembles
    4
    """

    ensembles: int = 4
    walkers: int = 48
    max_steps: int = 20_000
    check_every: int = 50
    tau_factor: float = 50.0
    tau_tolerance: float = 0.02
    r_hat_max: float = 1.01
    end_tolerance: float = 0.02
    max_evaluations: int | None = None

    def __post_init__(self) -> None:
        self._require_integer("ensembles", 4, "R̂ compares independent ensembles with each other")
        self._require_integer("walkers", 4, "each half of the walkers moves along differences within the other")
        self._require_integer("check_every", 10, "fewer steps say nothing about the autocorrelation")
        self._require_integer("max_steps", 2 * self.check_every, "the stop rule compares two checks")
        if self.walkers % 2:
            raise SamplingError(
                f"sampler setting walkers: found {self.walkers}, expected an even number: "
                "the ensemble is moved in two equal halves"
            )
        self._require_between("tau_factor", 5.0, math.inf, closed=True)
        self._require_between("tau_tolerance", 0.0, 1.0)
        self._require_between("r_hat_max", 1.0, math.inf)
        self._require_between("end_tolerance", 0.0, math.inf)
        if self.max_evaluations is not None:
            self._require_integer("max_evaluations", 1, "the search for the mode begins with some")

    def budget(self, dimension: int) -> Budget:
        """Evaluations of a density of some number of parameters that a stage may make."""
        return Budget.usual(dimension) if self.max_evaluations is None else Budget(self.max_evaluations)

    def for_one_of_many(self, *, full: bool = False) -> "SamplerSettings":
        """The same for one of many analyses: a stop rule that asks for some 2000 effective draws.

        The ends of a 95 % credible interval are then known to 5 % of its half width, where a run of its own asks for
        2 %; it takes half of the time or less. With `full` the stop rule stays the rule of a whole run.
        """
        if full:
            return self
        return replace(self, check_every=25, tau_factor=10.0, tau_tolerance=0.1, end_tolerance=0.05)

    def for_dimension(self, dimension: int) -> "SamplerSettings":
        """The same with as many walkers as a density of so many parameters needs, if it has fewer.

        More walkers know τ from fewer steps: `tau_factor` falls so that as many draws are kept for each τ, to 20.

        Examples
        --------
        >>> [SamplerSettings().for_dimension(d).walkers for d in (3, 24, 36)]
        [48, 48, 72]
        >>> [SamplerSettings().for_dimension(d).tau_factor for d in (3, 24, 36, 100)]
        [50.0, 50.0, 34.0, 20.0]
        """
        walkers = 2 * dimension
        if walkers <= self.walkers:
            return self
        factor = float(math.ceil(self.tau_factor * self.walkers / walkers))
        return replace(self, walkers=walkers, tau_factor=max(min(self.tau_factor, _LEAST_FACTOR), factor))

    def require_dimension(self, dimension: int) -> None:
        """Check that the walkers are enough for a density of this many parameters.

        Parameters
        ----------
        dimension : int
            Number of parameters of the log-density.

        Raises
        ------
        jointbayes.errors.SamplingError
            If there is no parameter, or fewer than two walkers per parameter.
        """
        if dimension < 1:
            raise SamplingError("sampler start: found no parameter, expected at least one")
        if self.walkers < 2 * dimension:
            raise SamplingError(
                f"sampler setting walkers: found {self.walkers} for {dimension} parameters, expected at "
                f"least {2 * dimension}: each half of the ensemble must span the parameter space"
            )

    def _require_integer(self, name: str, least: int, why: str) -> None:
        value = getattr(self, name)
        if not isinstance(value, Integral) or value < least:
            raise SamplingError(
                f"sampler setting {name}: found {value!r}, expected an integer of at least {least}: {why}"
            )

    def _require_between(self, name: str, low: float, high: float, *, closed: bool = False) -> None:
        value = getattr(self, name)
        if not (low < value < high or (closed and value == low)):
            bound = "at least" if closed else "above"
            limit = "finite" if math.isinf(high) else f"below {high:g}"
            raise SamplingError(
                f"sampler setting {name}: found {value!r}, expected a number {bound} {low:g} and {limit}"
            )


class Move(Protocol):
    """What emcee asks of a move."""

    def propose(self, model: "Model", state: "State") -> "tuple[State, Flags]":
        """Make one step of all walkers; return the state and who accepted, shape (walkers,)."""


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


Advance = Callable[[EnsembleState, int, np.random.SeedSequence], StepBlock]
"""Moves an ensemble on by so many steps, with a seed of their own."""


@dataclass(frozen=True, slots=True)
class Streams:
    """Seeds of everything that is drawn in a run: one for each stage, ensemble and block of steps.

    No two are alike, and each can be had without those before it: a block drawn after the process that drew the
    block before has died is the same.

    Parameters
    ----------
    root : numpy.random.SeedSequence
        From which all others are derived.
    stage : int
        Stage of the run, counted from zero.

    Examples
    --------
    >>> first, second = (Streams.from_generator(np.random.default_rng(1)) for _ in range(2))
    >>> (first.block(2, 7).generate_state(1) == second.block(2, 7).generate_state(1)).tolist()
    [True]
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
