"""One ensemble of walkers: its moves, its state, and its steps as a function of both alone."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.errors import SamplingError
from jointbayes.sampling.coordinates import Coordinates, Identity
from jointbayes.sampling.density import Checked, LogDensity
from jointbayes.sampling.proposal.fit import Proposal
from jointbayes.sampling.settings import SamplerSettings

if TYPE_CHECKING:
    from emcee import State
    from emcee.model import Model


ADAPTED_SHARE = 0.8  # of the local moves; the plain rest explores where the coordinates do not help
LARGEST_SHARE = 0.9  # of the independence move; the rest frees a walker that it cannot reach
GOOD_EFFICIENCY = 0.5  # from here on the independence move has its largest share
USELESS = 0.1  # up to here it has none
MANY_DIMENSIONS = 16  # from here on even a good fit is hardly ever accepted as a whole, but part of the way to it is
PARTIAL_SHARE = 0.8  # of the local moves there
KEPT = (0.6, 0.9)  # shares of the way that are kept
JUMP_SHARE = 0.1  # of all moves, where there are several modes


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


def independence_share(efficiency: float) -> float:
    """Probability of the independence move at a step.

    With an importance efficiency e its τ is about 2/e − 1, that of differential evolution in three dimensions about 10.
    On posteriors of measured natural frequencies it gave 2.6 times the effective draws per evaluation at e = 0.34, and
    a tenth fewer at e = 0.15, where walkers wait in places that the proposal does not reach.

    Examples
    --------
    >>> [round(independence_share(e), 3) for e in (0.9, 0.3, 0.0)]
    [0.9, 0.45, 0.0]
    """
    return LARGEST_SHARE * min(1.0, max(0.0, efficiency - USELESS) / (GOOD_EFFICIENCY - USELESS))


def mixture(coordinates: Coordinates | None = None, proposal: Proposal | None = None) -> tuple[WeightedMove, ...]:
    """Weighted moves of an ensemble.

    With a proposal that is close to the posterior most steps are independence moves. The rest are local.

    Of these, steps along a difference of two walkers had the shortest τ on Gaussian, curved and skewed densities (a
    sixth to a half of that of stretch moves alone). The full step (gamma0 = 1) carries walkers from one mode to
    another. A tenth of stretch moves varies the step length, which is fixed in the other two, for densities whose
    width changes from place to place, and costs little. With coordinates most of these moves are made in them, and
    the others remain for densities that are no closer to a Gaussian there. Where the proposal is one of several modes a
    tenth of what is left carries walkers from one to another.

    Parameters
    ----------
    coordinates : Coordinates, optional
        Coordinates in which the density is closer to a Gaussian.
    proposal : Proposal, optional
        Fitted approximation of the density, in coordinates of its own.

    Returns
    -------
    tuple of WeightedMove
        Their weights sum to 1.
    """
    # emcee takes a while to import, and nobody who reads the settings needs it
    from jointbayes.sampling.jump import JumpMove
    from jointbayes.sampling.moves import AutoregressiveMove, DEMove, HalvesStretchMove, IndependenceMove

    flat = Identity()
    local = [
        WeightedMove("differential evolution", DEMove(flat), 0.8),
        WeightedMove("differential evolution, full step", DEMove(flat, gamma0=1.0), 0.1),
        WeightedMove("stretch", HalvesStretchMove(), 0.1),
    ]
    if coordinates is not None:
        adapted = [
            WeightedMove("differential evolution, adapted coordinates", DEMove(coordinates), 0.9),
            WeightedMove(
                "differential evolution, full step, adapted coordinates", DEMove(coordinates, gamma0=1.0), 0.1
            ),
        ]
        local = _share(adapted, ADAPTED_SHARE) + _share(local, 1 - ADAPTED_SHARE)
    if proposal is not None and proposal.dimension >= MANY_DIMENSIONS:
        fitted, where = proposal.whole, proposal.likeliest.coordinates
        partial = [
            WeightedMove(f"autoregressive, {kept:g} kept", AutoregressiveMove(where, fitted, kept), 0.5)
            for kept in KEPT
        ]
        local = _share(partial, PARTIAL_SHARE) + _share(local, 1 - PARTIAL_SHARE)
    if proposal is not None and proposal.modes is not None:
        local = [WeightedMove("between modes", JumpMove(proposal.modes), JUMP_SHARE), *_share(local, 1 - JUMP_SHARE)]
    share = 0.0 if proposal is None else independence_share(proposal.efficiency)
    if proposal is None or share == 0.0:
        return tuple(local)
    independence = WeightedMove("independence", IndependenceMove(proposal.coordinates, proposal.density), share)
    return (independence, *_share(local, 1 - share))


def _share(moves: list[WeightedMove], share: float) -> list[WeightedMove]:
    return [WeightedMove(m.name, m.move, share * m.weight) for m in moves]


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
    """

    theta: Array
    log_density: Array
    moves: Mapping[str, MoveCount]
    singular: int

    @property
    def end(self) -> EnsembleState:
        """State after the last step."""
        return EnsembleState(self.theta[-1], self.log_density[-1])


def advance(
    log_density: LogDensity,
    state: EnsembleState,
    steps: int,
    seed: np.random.SeedSequence,
    moves: tuple[WeightedMove, ...] | None = None,
) -> Block:
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
    moves : tuple of WeightedMove, optional
        Moves to choose from at each step; by default those of :func:`mixture` without coordinates and proposal.

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

    from jointbayes.sampling.moves import Driver

    walkers, dimension = state.theta.shape
    counted = {one.name: _Counted(one.move) for one in moves or mixture()}
    weighted = [(counted[one.name], one.weight) for one in moves or mixture()]
    sampler = Driver(walkers, dimension, None, moves=weighted, vectorize=True)
    # emcee's own wrapper prints whatever a log-density raises to the terminal; this room never prints.
    sampler.log_prob_fn = Checked(log_density)
    # emcee only knows the Mersenne twister, and takes its state with the positions, else NumPy's global one.
    twister = np.random.RandomState(np.random.MT19937(seed))
    singular = getattr(log_density, "singular", 0)
    before = State(state.theta, log_prob=state.log_density, random_state=twister.get_state())
    sampler.run_mcmc(before, steps, skip_initial_state_check=True)
    return Block(
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


def initial_states(log_density: LogDensity, start: Array, settings: SamplerSettings) -> list[EnsembleState]:
    """Check the start and compute the log-density there."""
    start = np.array(start, dtype=np.float64)
    if start.ndim != 3 or start.shape[:2] != (settings.ensembles, settings.walkers):
        raise SamplingError(
            f"sampler start: found an array of shape {start.shape}, expected "
            f"({settings.ensembles}, {settings.walkers}, parameters)"
        )
    settings.require_dimension(start.shape[2])
    states = []
    for index, theta in enumerate(start):
        _require_spanning(theta, index)
        values = Checked(log_density)(theta)
        outside = np.flatnonzero(np.isneginf(values))
        if outside.size:
            raise SamplingError(
                f"sampler start: the density is zero at walkers {outside.tolist()} of ensemble {index}, the "
                f"first at θ = {theta[outside[0]].tolist()}; expected every walker inside the prior's support"
            )
        states.append(EnsembleState(theta, values))
    return states


def _require_spanning(theta: Array, index: int) -> None:
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
