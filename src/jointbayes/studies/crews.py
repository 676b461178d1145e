"""Who does tasks, by executors of concurrent.futures: processes of this machine, a Dask cluster, or any other executor.

Where one has room for one task only, as each of our own processes and each worker of a cluster, it is known which task
was at work when it dies.
"""

import os
import pickle
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor
from concurrent.futures import wait as wait_for
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.context import BaseContext
from pathlib import Path
from typing import Any, NamedTuple

from jointbayes.errors import JointBayesError, WorkerError
from jointbayes.reproducibility import code_version, one_blas_thread

_GRACE = 5.0  # seconds in which a worker that is told to end may remove what it has half written
_STILLBORN = 3  # processes that may end in a row before any of them was ready
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_LOST = ("KilledWorker", "TimeoutError", "CommClosedError", "FutureCancelledError")  # Dask's words for a dead worker


class Reply(NamedTuple):
    """What became of one attempt: a value, or the error in words; or the other version of a worker that refused it."""

    value: Any = None
    error: str | None = None
    other_version: str = ""


@dataclass(eq=False)
class Task:
    """A task, and what became of it so far.

    Parameters
    ----------
    key, arguments
        Its name, and what the function is called with.
    attempts, kills
        How often it was begun, and how often its worker died of it.
    alone
        Whether a worker died beside it: what it does is seen only where nothing else runs.
    began, worked, reason
        When its last attempt began, the seconds of all, and why its last worker died.
    """

    key: str
    arguments: tuple[Any, ...]
    attempts: int = 0
    kills: int = 0
    alone: bool = False
    began: float = 0.0
    worked: float = 0.0
    reason: str = ""


class Event(NamedTuple):
    """The end of one attempt at a task: its reply, None where the worker died, and then the reason.

    `certain` tells whether nothing else ran where the worker died, and `overdue` whether it was ended because the
    attempt took longer than allowed.
    """

    task: Task
    reply: Reply | None
    reason: str = ""
    certain: bool = True
    overdue: bool = False


def packed(function: Callable[..., Any], arguments: tuple[Any, ...]) -> bytes:
    """A call as bytes: the function, by the name of its module, and its arguments.

    Raises
    ------
    WorkerError
        If function or arguments cannot be sent to another process.
    """
    try:
        return pickle.dumps((code_version(), pickle.dumps((function, arguments))))
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise WorkerError(
            f"run_tasks: found a call that cannot be sent to another process ({error}); expected a function at the top "
            "of a module and arguments that can be pickled; define it there"
        ) from error


@one_blas_thread()
def attempt(call: bytes) -> Reply:
    """Run a call, in a worker. Whatever it raises becomes one error in words."""
    try:
        wanted, inner = pickle.loads(call)
        if wanted != code_version():  # what another version computes looks the same and is not
            return Reply(other_version=code_version())
        function, arguments = pickle.loads(inner)
        return Reply(value=function(*arguments))
    except _Ended:
        os._exit(1)  # what was half written is removed
    except JointBayesError as error:
        return Reply(error=str(error))
    except (Exception, SystemExit) as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        text, where = " ".join(str(error).split()), f"{place.name}, {Path(place.filename).name}:{place.lineno}"
        return Reply(error=f"{type(error).__name__}: {text} (in {where})")


@dataclass(eq=False)
class Seat:
    """An executor with room for so many tasks at once, and those that it has; None stands for getting ready."""

    executor: Executor
    room: int = 1
    name: str = ""
    process: Any = None
    tasks: dict[Future[Reply], Task | None] = field(default_factory=dict)
    since: float = float("inf")


class Crew:
    """Executors that each do so many tasks at a time. Those that break are replaced, and their tasks reported."""

    attempt: Callable[[bytes], Reply] = staticmethod(attempt)

    def __init__(self, seconds: float | None = None) -> None:
        self.seats: list[Seat] = []
        self._seconds = seconds

    @property
    def free(self) -> int:
        """How many more attempts can be started now."""
        return sum(seat.room - len(seat.tasks) for seat in self.seats)

    def start(self, task: Task, call: bytes) -> None:
        """Start an attempt; only where `free` is above 0."""
        seat = next(seat for seat in self.seats if len(seat.tasks) < seat.room)
        seat.since = time.monotonic()
        try:
            future = seat.executor.submit(self.attempt, call)
        except BrokenExecutor as error:
            future = Future()
            future.set_exception(error)
        seat.tasks[future] = task

    def wait(self, seconds: float) -> Sequence[Event]:
        """Wait so long for attempts to end, or for a worker to come free; replace the dead."""
        seats = {future: seat for seat in self.seats for future in seat.tasks}
        if not seats:
            time.sleep(seconds)
        ended = wait_for(seats, seconds, FIRST_COMPLETED).done
        events: list[Event] = []
        for future in sorted(ended, key=lambda future: future.cancelled() or future.exception() is not None):
            if future in seats[future].tasks:  # and did not go with its worker, after all that had replied
                events += self._ended(future, seats[future])
        if self._seconds is not None:
            for seat in [seat for seat in self.seats if seat.tasks and time.monotonic() - seat.since > self._seconds]:
                events += self.lost(seat, overdue=True)
        return [*events, *self.renew()]

    def _ended(self, future: Future[Reply], seat: Seat) -> list[Event]:
        try:
            reply = future.result()
        except (BrokenExecutor, CancelledError):
            return self.lost(seat)
        except Exception as error:  # `attempt` raises nothing: it is the reply that did not arrive
            if type(error).__name__ in _LOST:
                return self.lost(seat)
            reply = Reply(error=f"found a value that cannot be sent to the driver ({type(error).__name__}: {error})")
        task, seat.since = seat.tasks.pop(future), float("inf")
        if task is None:
            self.greet()
            return []
        if reply.other_version:
            self.refuse(seat, reply.other_version)
        return [Event(task, reply)]

    def lost(self, seat: Seat, *, overdue: bool = False) -> list[Event]:
        """Dismiss a worker that is dead, or overdue; the tasks that it had have ended."""
        self.seats.remove(seat)
        reason = self.dismiss(seat, overdue)
        if overdue:
            reason = f"took longer than the {self._seconds:g} s allowed"
        suspects = [task for task in seat.tasks.values() if task is not None]
        seat.tasks.clear()
        return [Event(task, None, reason, len(suspects) == 1, overdue) for task in suspects]

    def greet(self) -> None:
        """Note that a worker is ready."""

    def refuse(self, seat: Seat, version: str) -> None:
        """Give a worker of another version nothing more to do: what it computes looks the same and is not."""
        raise WorkerError(other_version_of_worker(version, seat.name or "workers"))

    def renew(self) -> list[Event]:
        """Replace what is lost; tell of tasks whose worker has gone meanwhile."""
        return []

    def dismiss(self, seat: Seat, kill: bool) -> str:
        """Close an executor, on request with what it is at; why it broke, in words."""
        return "its worker ended by itself"

    def stop(self) -> None:
        """End all workers, and what they are at."""


def other_version_of_worker(version: str, where: str) -> str:
    """The line that refuses a worker of another version."""
    return (
        f"{where}: found jointbayes {version}; expected {code_version()}, with the sources of the driver; install the "
        "same there, and start the same command again, which goes on"
    )


class ExecutorCrew(Crew):
    """The workers of one executor.

    An executor whose worker dies is broken as a whole, and does not tell at which task: all that ran are suspects.

    Parameters
    ----------
    executor
        An executor, which stays open; or a function that makes one, called again each time it breaks.
    workers
        How many tasks may be with the executor at once.
    """

    def __init__(self, executor: Executor | Callable[[], Executor], workers: int | None = None) -> None:
        super().__init__()
        self._make = None if isinstance(executor, Executor) else executor
        self._workers = workers
        self._seat(executor if isinstance(executor, Executor) else executor())

    def _seat(self, executor: Executor) -> None:
        # with one more each than they have processes, none waits for the driver
        room = self._workers or 2 * int(getattr(executor, "_max_workers", os.cpu_count() or 1))
        self.seats.append(Seat(executor, room))

    def renew(self) -> list[Event]:
        """Make the executor anew where it has broken."""
        if self._make is not None and not self.seats:
            self._seat(self._make())
        return []

    def dismiss(self, seat: Seat, kill: bool) -> str:
        """Close an executor that has broken, where another can be made."""
        if self._make is None:
            raise WorkerError(
                f"executor: found that a worker of it ended by itself, with {len(seat.tasks)} tasks under way, so that "
                "it takes no more; expected it to last; pass a function that makes an executor, or use workers"
            )
        _discard(seat.executor)
        return "a worker of its executor ended by itself"

    def stop(self) -> None:
        """Withdraw what has not begun; an executor made here ends with its workers."""
        for seat in self.seats:
            for future in seat.tasks:
                future.cancel()
            if self._make is not None:
                _discard(seat.executor)


def _discard(executor: Executor) -> list[Any]:
    """Close an executor and end its processes: one that it starts as it breaks would keep it waiting for ever."""
    processes = list((getattr(executor, "_processes", None) or {}).values())
    executor.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.terminate()
    return processes


class ProcessCrew(Crew):
    """So many processes of this machine, each an executor, replaced when they die or take too long.

    Parameters
    ----------
    workers
        How many.
    preload
        Modules that each has from the start. Where the system can, one process loads them and the workers are copies
        of it, so that a new one costs milliseconds.
    seconds
        Longest time for one attempt; after it the process is ended.
    """

    def __init__(self, workers: int, preload: Sequence[str] = (), seconds: float | None = None) -> None:
        super().__init__(seconds)
        self._count, self._stillborn = workers, 0
        self._context = _context(preload)
        self.renew()

    def greet(self) -> None:
        """Note that processes can be ready here."""
        self._stillborn = 0

    def renew(self) -> list[Event]:
        """Start as many processes as are missing."""
        if self._stillborn >= _STILLBORN:
            raise WorkerError(
                f"workers: found that {_STILLBORN} processes or more ended before any was ready; expected them "
                'to last; put the calls of a script under if __name__ == "__main__":, and look whether memory is short'
            )
        while len(self.seats) < self._count:
            with _birth():
                executor = ProcessPoolExecutor(1, mp_context=self._context, initializer=_begin)
                seat = Seat(executor, tasks={executor.submit(Reply): None})
                (seat.process,) = executor._processes.values()
            self.seats.append(seat)
        return []

    def dismiss(self, seat: Seat, kill: bool) -> str:
        """Close the executor of a process that has ended, or is to; how it ended."""
        self._stillborn += None in seat.tasks.values()
        if kill:
            seat.process.kill()
        seat.executor.shutdown()
        code = seat.process.exitcode
        if code is not None and code < 0:
            with suppress(ValueError):
                return f"its worker ended by {signal.Signals(-code).name}"
        return f"its worker ended with exit code {code}"

    def stop(self) -> None:
        """End all processes: they get a moment to remove what they have half written."""
        processes = [process for seat in self.seats for process in _discard(seat.executor)]
        until = time.monotonic() + _GRACE
        for process in processes:
            process.join(max(until - time.monotonic(), 0))
            if process.is_alive():
                process.kill()
        for seat in self.seats:
            seat.executor.shutdown()
        self.seats.clear()


def _context(preload: Sequence[str]) -> BaseContext:
    """How processes are started: afresh, never as copies of this one, which may hold locks and threads."""
    if sys.platform == "win32":
        return get_context("spawn")
    context = get_context("forkserver")
    # not the caller's script, as by default: what it starts, threads for one, must not be there when workers are copied
    context.set_forkserver_preload([__name__, *preload])
    return context


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


class _Ended(SystemExit):
    """The driver has told this worker to end, or is gone."""


def _begin() -> None:
    """Make a process a worker: Ctrl-C is the driver's, and it ends with the driver, however that ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a terminal it goes to every process
    if sys.platform != "win32":
        signal.signal(signal.SIGTERM, _stop_here)
    threading.Thread(target=_follow_driver, daemon=True).start()


def _stop_here(_number: int, _frame: object) -> None:
    raise _Ended


def _follow_driver() -> None:
    parent = parent_process()
    if parent is None:
        return
    parent.join()
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_GRACE)
    os._exit(1)
