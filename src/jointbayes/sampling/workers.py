"""Ensembles side by side in processes, and signals that wait until a block of steps is whole."""

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

import numpy as np

from jointbayes.errors import SamplingError
from jointbayes.sampling.density import LogDensity
from jointbayes.sampling.ensemble import EnsembleState, MoveOn, StepBlock, WeightedMove, advance

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
