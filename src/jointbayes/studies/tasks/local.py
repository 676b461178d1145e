"""Processes of this machine that each have a pipe of their own: when one dies it is known at what."""

import os
import pickle
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import connection, get_context, parent_process, resource_tracker, util
from multiprocessing.connection import Connection
from multiprocessing.context import BaseContext
from typing import Any

from jointbayes.errors import WorkerError
from jointbayes.studies.tasks.crew import Call, Event, Reply, attempt

_GRACE = 5.0  # seconds in which a worker that is told to end may remove what it has half written
_STILLBORN = 3  # workers that may die in a row before any of them was ready
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(eq=False)
class _Worker:
    """A process, the driver's end of its pipe, and what it is at."""

    process: Any
    pipe: Connection
    ready: bool = False
    ticket: int | None = None
    since: float = 0.0


class LocalCrew:
    """So many processes, replaced when they die or take too long.

    Parameters
    ----------
    workers
        How many.
    preload
        Modules that each worker has from the start. Where the system can, one process loads them and the workers are
        copies of it, so that a new one costs milliseconds.
    seconds
        Longest time for one attempt; after it the worker is ended.
    """

    def __init__(self, workers: int, preload: Sequence[str] = (), seconds: float | None = None) -> None:
        self._count, self._seconds, self._stillborn = workers, seconds, 0
        self._context = _context(preload)
        self._workers: list[_Worker] = []
        # multiprocessing waits at exit for its processes: those of a loop that was never finished end before that
        self._finalizer = util.Finalize(self, _end, (self._workers,), exitpriority=10)
        self._fill()

    @property
    def free(self) -> int:
        """Workers that are ready and have nothing to do."""
        return sum(worker.ready and worker.ticket is None for worker in self._workers)

    def start(self, ticket: int, call: Call) -> None:
        """Give the call to a free worker; one that has died meanwhile is found by `wait`."""
        worker = next(w for w in self._workers if w.ready and w.ticket is None)
        worker.ticket, worker.since = ticket, time.monotonic()
        with suppress(OSError):
            worker.pipe.send_bytes(call)

    def wait(self, seconds: float) -> Sequence[Event]:
        """Wait for replies and deaths; replace the dead."""
        connection.wait([part for w in self._workers for part in (w.pipe, w.process.sentinel)], seconds)
        events: list[Event] = []
        for worker in tuple(self._workers):
            events += self._heard(worker)
        self._fill()
        return events

    def stop(self) -> None:
        """End all workers: they get a moment to remove what they have half written."""
        self._finalizer()

    def _heard(self, worker: _Worker) -> Iterator[Event]:
        gone = False
        try:
            while worker.pipe.poll():
                reply = worker.pipe.recv()
                if worker.ready and worker.ticket is not None:
                    yield Event(worker.ticket, reply)
                worker.ready, worker.ticket, self._stillborn = True, None, 0
        except (EOFError, OSError):
            gone = True
        over = self._seconds is not None and worker.ticket is not None and self._spent(worker) > self._seconds
        if not over and not gone and worker.process.is_alive():
            return
        self._workers.remove(worker)
        if not over:
            worker.process.join(_GRACE)  # else its own end would be taken for ours
        worker.process.kill()
        worker.process.join()
        worker.pipe.close()
        if worker.ticket is not None:
            reason = f"took longer than the {self._seconds:g} s allowed" if over else _end_of(worker)
            yield Event(worker.ticket, None, reason, overdue=over)
        elif not worker.ready:
            self._stillborn += 1

    def _spent(self, worker: _Worker) -> float:
        return time.monotonic() - worker.since

    def _fill(self) -> None:
        if self._stillborn >= _STILLBORN:
            raise WorkerError(
                f"workers: found that {_STILLBORN} processes or more ended before any was ready; expected them "
                'to last; put the calls of a script under if __name__ == "__main__":, and look whether memory is short'
            )
        while len(self._workers) < self._count:
            self._workers.append(_born(self._context))


def _context(preload: Sequence[str]) -> BaseContext:
    """How processes are started: afresh, never as copies of this one, which may hold locks and threads."""
    if sys.platform == "win32":
        return get_context("spawn")
    context: BaseContext = get_context("forkserver")
    # not the caller's script, as by default: what it starts, threads for one, must not be there when workers are copied
    context.set_forkserver_preload(["jointbayes.studies.tasks.local", *preload])
    return context


def _born(context: BaseContext) -> _Worker:
    ours, theirs = connection.Pipe()
    with _birth():
        process = context.Process(target=_serve, args=(theirs, sys.platform != "win32"))  # type: ignore[attr-defined]
        process.start()
    theirs.close()
    return _Worker(process, ours)


@contextmanager
def _birth() -> Iterator[None]:
    """Hold Ctrl-C back while a process is born, and give it one thread: workers inherit both."""
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    masked = None
    if hasattr(signal, "pthread_sigmask"):  # not on Windows
        resource_tracker.ensure_running()  # else that would let Ctrl-C through again
        masked = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT, signal.SIGHUP])
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})
        if masked is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, masked)


def _end_of(worker: _Worker) -> str:
    code = worker.process.exitcode
    if code is not None and code < 0:
        with suppress(ValueError):
            return f"its worker ended by {signal.Signals(-code).name}"
    return f"its worker ended with exit code {code}"


def _end(workers: list[_Worker]) -> None:
    """End workers: those at rest by closing their pipe, the others by a signal, and by force after a while."""
    for worker in workers:
        worker.process.terminate()
        worker.pipe.close()
    until = time.monotonic() + _GRACE
    for worker in workers:
        worker.process.join(max(until - time.monotonic(), 0))
        if worker.process.is_alive():
            worker.process.kill()
            worker.process.join(_GRACE)
    workers.clear()


class _Ended(BaseException):
    """The driver has told this worker to end, or is gone."""


def _serve(pipe: Connection, signals: bool) -> None:
    """Do one task after the other, in the worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a terminal it goes to every process; the driver answers it
    if signals:
        signal.signal(signal.SIGTERM, _stop_here)
    threading.Thread(target=_follow_driver, daemon=True).start()
    with suppress(_Ended, EOFError, OSError):
        pipe.send(Reply())
        while True:
            reply = attempt(pipe.recv_bytes())
            try:
                pipe.send(reply)
            except (pickle.PicklingError, AttributeError, TypeError) as error:
                pipe.send(Reply(error=f"found a value that cannot be sent to the driver ({error})"))


def _stop_here(_number: int, _frame: object) -> None:
    raise _Ended


def _follow_driver() -> None:
    """End with the driver, however it ends."""
    parent = parent_process()
    if parent is None:
        return
    parent.join()
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_GRACE)
    os._exit(1)
