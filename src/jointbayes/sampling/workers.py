"""The steps of ensembles, one after the other or side by side in processes, and signals that wait for them."""

import os
import pickle
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from types import FrameType
from typing import TYPE_CHECKING

import numpy as np

from jointbayes.errors import SamplingError
from jointbayes.sampling.density import Checked, LogDensity
from jointbayes.sampling.ensemble import EnsembleState, Move, MoveCount, MoveOn, StepBlock, WeightedMove
from vibrecords.arrays import Flags

if TYPE_CHECKING:
    from emcee import State
    from emcee.model import Model

# What a worker works on. It is sent once when the worker starts; a task then carries a state and a seed only.
_work: tuple[LogDensity, tuple[WeightedMove, ...]]


@contextmanager
def mover(log_density: LogDensity, moves: tuple[WeightedMove, ...], processes: int) -> Iterator[MoveOn]:
    """Give a function that moves ensembles on, in this process or in several; the draws are the same bit for bit.

    Parameters
    ----------
    log_density : callable
        Log of the unnormalised density, (n, d) array to (n,) array; picklable if there are several processes.
    moves : tuple of WeightedMove
        Moves of each ensemble.
    processes : int
        Number of processes; with 1 no other is started.

    Raises
    ------
    jointbayes.errors.SamplingError
        If the log-density cannot be sent to another process, or if a process ends by itself. Whatever the
        log-density raises in a worker is raised here.
    """
    if processes == 1:
        yield lambda states, steps, seeds: [
            advance(log_density, state, steps, seed, moves) for state, seed in zip(states, seeds, strict=True)
        ]
        return
    try:
        work = pickle.dumps((log_density, moves))
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise SamplingError(
            f"sampler setting processes: found {processes} with a log-density that cannot be sent to another process "
            f"({error}); expected one that can be pickled; define it at the top of a module or use processes = 1"
        ) from error
    # A forked process would inherit locks in whatever state they are: each starts afresh on every system.
    pool = ProcessPoolExecutor(processes, get_context("spawn"), _receive, (work,))
    try:
        yield partial(_move_on, pool)
    except BrokenProcessPool as error:
        raise SamplingError(
            f"sampler setting processes: found that one of {processes} processes ended by itself; expected all to "
            'last; put the script\'s calls under if __name__ == "__main__": or use processes = 1'
        ) from error
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _move_on(
    pool: ProcessPoolExecutor, states: list[EnsembleState], steps: int, seeds: list[np.random.SeedSequence]
) -> list[StepBlock]:
    with _interrupts_held():  # the pool starts its processes when it gets tasks
        blocks = pool.map(_advance, states, [steps] * len(states), seeds)
    return list(blocks)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back for the moment; processes started in it inherit that and never see one, not even at birth."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT, signal.SIGHUP])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _receive(work: bytes) -> None:
    """Start a worker."""
    global _work
    # Ctrl-C goes to every process of a terminal; the caller's answers it and ends the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_caller, daemon=True).start()
    _work = pickle.loads(work)


def _end_with_caller() -> None:
    """End this process when the one that started it does, however that ends: a killed one tells nobody."""
    caller = parent_process()
    assert caller is not None
    wait([caller.sentinel])
    os._exit(1)


def _advance(state: EnsembleState, steps: int, seed: np.random.SeedSequence) -> StepBlock:
    return advance(_work[0], state, steps, seed, _work[1])


_Handler = Callable[[int, FrameType | None], object]


@contextmanager
def finished_first(*, wait: bool = True) -> Iterator[list[int]]:
    """Let SIGINT, SIGTERM and SIGHUP wait for the end of the body, where Python answers them; a second one does not.

    Whatever the body raises after a signal gives way to what the signal's own handler raises: worker processes get the
    signals of a terminal or a batch system as well, and may be gone before the body is.

    Parameters
    ----------
    wait
        Whether they wait at all.

    Yields
    ------
    list of int
        Signals that have come so far.
    """
    if not wait or threading.current_thread() is not threading.main_thread():
        yield []  # signals come to the main thread only
        return
    answered: dict[int, _Handler] = {}
    for number in (int(signal.SIGINT), int(signal.SIGTERM), int(getattr(signal, "SIGHUP", signal.SIGTERM))):
        handler = signal.getsignal(number)
        if callable(handler):
            answered[number] = handler
    waiting: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        waiting.append(number)
        if len(waiting) > 1:
            answered[number](number, frame)

    for number in answered:
        signal.signal(number, note)
    try:
        yield waiting
    finally:
        for number, handler in answered.items():
            signal.signal(number, handler)
        if waiting:
            answered[waiting[0]](waiting[0], None)


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

    from jointbayes.sampling.moves.base import Driver

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

    def propose(self, model: "Model", state: "State") -> "tuple[State, Flags]":
        """Pass the move's step on."""
        state, accepted = self._move.propose(model, state)
        self.accepted += int(np.count_nonzero(accepted))
        self.proposed += accepted.size
        return state, accepted
