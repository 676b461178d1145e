"""Many cases by executors of concurrent.futures: processes of this machine, a Dask cluster, or any other executor.

One rule where a worker dies: its case is done again when all others have had their turn, and is set aside by name where
three workers have died of it. On a cluster that is the scheduler's own rule, `distributed.scheduler.allowed-failures`.
"""

import logging
import os
import pickle
import platform
import signal
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent import futures
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import forkserver, get_context, parent_process, resource_tracker
from multiprocessing.context import BaseContext
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from jointbayes.errors import JointBayesError, WorkerError
from jointbayes.reproducibility import code_version, one_blas_thread

if TYPE_CHECKING:
    from distributed import Client


_CONNECT = 10.0  # seconds to wait for a scheduler
_PATIENCE = 300.0  # seconds without any worker
_one_at_a_time = threading.Lock()  # in a worker, which may have several threads


def _on_worker(seconds: float | None, function: Callable[..., Any], *arguments: Any) -> Any:  # noqa: ANN401
    """Do a call in a worker, by itself, and end the worker if it takes too long, for a nanny to start another."""
    import dask

    with _one_at_a_time, dask.config.set(scheduler="synchronous"):  # else xarray asks the cluster for locks, in vain
        limit = threading.Timer(seconds or 0, os._exit, (1,))
        if seconds is not None:
            limit.start()
        try:
            return function(*arguments)
        finally:
            limit.cancel()


class _DaskExecutor(Executor):
    """Dask's own executor, with what surrounds each call on a worker."""

    def __init__(self, executor: Executor, seconds: float | None) -> None:
        self._executor, self._seconds = executor, seconds

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **_: Any) -> Future[Any]:  # noqa: ANN401
        return self._executor.submit(_on_worker, self._seconds, function, *arguments)


@contextmanager
def dask_executor(
    scheduler: "str | Client", workers: int | None, seconds: float | None
) -> Iterator[tuple[Executor, Callable[[], int]]]:
    """An executor on the workers of a scheduler, and how many tasks it may have now: one for each worker.

    Where a worker dies Dask does its task again elsewhere, and gives up one of which more have died than its setting
    ``distributed.scheduler.allowed-failures`` allows.

    Parameters
    ----------
    scheduler
        Address of the scheduler, or a client, which stays open.
    workers
        How many tasks at most; by default one for each worker.
    seconds
        Longest time for one attempt; after it the worker ends itself.

    Raises
    ------
    WorkerError
        If distributed is not installed, no scheduler answers, or there is no worker for long.
    """
    client, ours = _client(scheduler)
    seen = time.monotonic()

    def room() -> int:
        nonlocal seen
        count, now = len(client.nthreads()), time.monotonic()
        if not count and now - seen > _PATIENCE:
            raise WorkerError(
                f"scheduler: found no worker for {_PATIENCE:.0f} s; expected one at least; start some, with one "
                "thread each"
            )
        seen = now if count else seen
        return max(1, min(count, workers or count))

    executor = client.get_executor(pure=False)
    try:
        yield _DaskExecutor(executor, seconds), room
    finally:
        with suppress(OSError, TimeoutError):  # of a scheduler that has gone
            executor.shutdown(wait=False)
        if ours:
            client.close()


def _client(scheduler: "str | Client") -> tuple[Any, bool]:
    """The client, and whether it is ours to close. Its methods have no types."""
    try:
        import distributed
    except ImportError:
        raise WorkerError(
            "scheduler: found no package distributed; expected it for a Dask cluster; install jointbayes[cluster]"
        ) from None
    client: Any = distributed.Client
    if isinstance(scheduler, client):
        return scheduler, False
    try:
        found = client(scheduler, timeout=_CONNECT)
    except (OSError, ValueError) as error:
        raise WorkerError(
            f"scheduler: found none at {scheduler} ({' '.join(str(error).split())}); expected an address such as "
            "tcp://host:8786; start one with: dask scheduler"
        ) from error
    # what it says of a scheduler that is gone is said here in one line
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    return found, True


#: Workers that die of one case until it is set aside.
MOST_DEATHS = 3
_TICK = 0.5  # seconds between two calls of `watch`
_GRACE = 5.0  # seconds in which a worker that is told to end may remove what it has half written
_STILLBORN = 3  # processes that may end in a row before one is ready
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of a task.

    Parameters
    ----------
    key
        Of the task.
    value
        What the function returned; None where it failed.
    error
        What went wrong at the last attempt, in words; None where the function returned.
    attempts
        How often it was begun; on a cluster once, whatever the scheduler repeats.
    killed_worker
        Whether the last attempt ended with its worker, which died or took longer than allowed.
    """

    key: str
    value: Any
    error: str | None
    attempts: int
    killed_worker: bool


class Reply(NamedTuple):
    """What a worker sends: a value, or an error in words."""

    value: Any = None
    error: str | None = None


class _WorkerDiedError(Exception):
    """A worker ended with its task; `overdue` where it was ended because the task took longer than allowed."""

    def __init__(self, reason: str, overdue: bool = False) -> None:
        super().__init__(reason)
        self.overdue = overdue


@dataclass(eq=False, slots=True)
class _Task:
    key: str
    arguments: tuple[Any, ...]
    attempts: int = 0


def run_tasks(
    function: Callable[..., Any],
    tasks: Iterable[tuple[str, tuple[Any, ...]]],
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    scheduler: "str | Client | None" = None,
    seconds: float | None = None,
    preload: Sequence[str] = (),
    watch: Callable[[tuple[str, ...]], None] | None = None,
) -> Iterator[Outcome]:
    """Call a function for many tasks side by side; yield the outcome of each, in the order in which they end.

    A task that raises has ended: its error is its outcome. The first task runs by itself, so that only one process
    compiles what is not yet compiled. Where the loop over the outcomes is left, by Ctrl-C too, all workers end.

    Parameters
    ----------
    function
        Defined at the top of a module; called as ``function(*arguments)``. As a task may run twice, it must not matter
        that it does: it writes files whole, under a name of its own, and returns little.
    tasks
        Key and arguments of each; taken one by one as workers come free, so it may be a generator of very many.
    workers
        Number of processes of this machine; by default one for each processor. With `scheduler` or `executor` the
        largest number of tasks under way.
    executor
        An executor of concurrent.futures in place of own processes; it stays open. One that breaks ends the loop.
    scheduler
        Address of a Dask scheduler, or a client. Each worker gets one task at a time, whatever its threads.
    seconds
        Longest time for a task; its worker is then ended. Not with `executor`.
    preload
        Modules that new processes of this machine have from the start.
    watch
        Called about twice a second with the keys of the tasks that run.

    Yields
    ------
    Outcome
        One for each task.

    Raises
    ------
    WorkerError
        If the settings contradict each other, no worker can be had, or one has another version of this package.
    """
    if executor is not None and (scheduler is not None or seconds is not None):
        raise WorkerError("run_tasks: found executor with scheduler or seconds; expected it without; drop one")
    for name, number in (("workers", workers), ("seconds", seconds)):
        if number is not None and not number > 0:
            raise WorkerError(f"run_tasks: found {name} = {number}; expected a number above 0; correct it")
    source = (_Task(*task) for task in tasks)
    tell = watch or (lambda _keys: None)
    if scheduler is not None:
        with dask_executor(scheduler, workers, seconds) as (cluster, room):
            yield from _outcomes(cluster, room, function, source, tell)
    elif executor is not None:
        # with one more each than they have processes, none waits for the driver
        most = workers or 2 * int(getattr(executor, "_max_workers", os.cpu_count() or 1))
        yield from _outcomes(executor, lambda: most, function, source, tell)
    else:
        count = workers or _processors()
        with ProcessWorkers(count, preload, seconds) as processes:
            yield from _outcomes(processes, lambda: count, function, source, tell)


def _processors() -> int:
    """Processors that this process may use."""
    allowed = getattr(os, "sched_getaffinity", None)  # not on macOS and Windows
    return len(allowed(0)) if allowed else os.cpu_count() or 1


def _outcomes(
    executor: Executor,
    room: Callable[[], int],
    function: Callable[..., Any],
    source: Iterator[_Task],
    watch: Callable[[tuple[str, ...]], None],
) -> Iterator[Outcome]:
    """Outcomes of all tasks, of which `room` may be with the executor at once; those whose worker died come last."""
    again: deque[_Task] = deque()
    running: dict[Future[Reply], _Task] = {}
    first = True

    def submit() -> None:
        while True:
            with _executor_lasts():
                if len(running) >= (1 if first else room()):
                    return
            task = next(source, None) or (again.popleft() if again else None)
            if task is None:
                return
            task.attempts += 1
            call = packed(function, task.arguments)
            with _executor_lasts():
                running[executor.submit(attempt, code_version(), call)] = task

    try:
        submit()
        while running:
            watch(tuple(task.key for task in running.values()))
            done = futures.wait(running, _TICK, futures.FIRST_COMPLETED).done
            ended = [(future, running.pop(future)) for future in sorted(done, key=_lacks_reply)]
            first, broken = first and not ended, None
            try:
                submit()  # workers go on while the caller looks at the outcomes
            except WorkerError as error:
                broken = error  # what is done is handed out before
            for future, task in ended:
                outcome = _outcome(task, future)
                if outcome is None:
                    again.append(task)
                else:
                    yield outcome
            if broken is not None:
                raise broken
            submit()
    finally:
        for future in running:
            future.cancel()


def _lacks_reply(future: Future[Reply]) -> bool:
    return future.cancelled() or future.exception() is not None


@contextmanager
def _executor_lasts() -> Iterator[None]:
    """Say in one line that an executor, or the scheduler behind it, has gone or has lost a worker of its own."""
    try:
        yield
    except (BrokenExecutor, CancelledError, OSError, TimeoutError) as error:  # Dask's CommClosedError is an OSError
        raise WorkerError(
            f"executor: found that it has gone, or lost a worker, and takes no more ({type(error).__name__}); expected "
            "it to last; start it and its workers again, or use processes of this machine"
        ) from error


def _outcome(task: _Task, future: Future[Reply]) -> Outcome | None:
    """The outcome of a task; None where its worker died and it is to be done again."""
    try:
        with _executor_lasts():
            reply = future.result()
    except _WorkerDiedError as death:
        if task.attempts < MOST_DEATHS and not death.overdue:
            return None
        return Outcome(task.key, None, str(death), task.attempts, killed_worker=True)
    except WorkerError:
        raise
    except Exception as error:  # `attempt` raises nothing: the reply did not arrive
        if type(error).__name__ == "KilledWorker":  # Dask's word for a task that did so too often
            reason = "its workers died, or took longer than allowed, more often than the scheduler allows"
            return Outcome(task.key, None, reason, task.attempts, killed_worker=True)
        reply = Reply(error=f"found a value that cannot be sent to the driver ({type(error).__name__}: {error})")
    return Outcome(task.key, reply.value, reply.error, task.attempts, killed_worker=False)


def packed(function: Callable[..., Any], arguments: tuple[Any, ...]) -> bytes:
    """A call as bytes: the function, by the name of its module, and its arguments.

    Raises
    ------
    WorkerError
        If function or arguments cannot be sent to another process.
    """
    try:
        return pickle.dumps((function, arguments))
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise WorkerError(
            f"run_tasks: found a call that cannot be sent to another process ({error}); expected a function at the top "
            "of a module and arguments that can be pickled; define it there"
        ) from error


@one_blas_thread()
def attempt(version: str, call: bytes) -> Reply:
    """Run a call, in a worker. Whatever it raises becomes one error in words.

    Raises
    ------
    WorkerError
        If the driver has another version: what that computes looks the same and is not.
    """
    if version != code_version():
        raise WorkerError(
            f"worker on {platform.node()}: found jointbayes {code_version()}; expected {version}, with the sources of "
            "the driver; install the same there, and start the same command again"
        )
    try:
        function, arguments = pickle.loads(call)
        return Reply(value=function(*arguments))
    except _Ended:
        os._exit(1)  # what was half written is removed
    except JointBayesError as error:
        return Reply(error=str(error))
    except (Exception, SystemExit) as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        text, where = " ".join(str(error).split()), f"{place.name}, {Path(place.filename).name}:{place.lineno}"
        return Reply(error=f"{type(error).__name__}: {text} (in {where})")


class ProcessWorkers(Executor):
    """So many processes of this machine, each with one task at a time, replaced when they die or take too long.

    Each is a pool of one process, and a thread waits for it: so it is known which task was with a process that died.

    Parameters
    ----------
    workers
        How many.
    preload
        Modules that each has from the start. Where the system can, one process loads them and the workers are copies
        of it, so that a new one costs milliseconds.
    seconds
        Longest time for one task; after it the process is ended.
    """

    def __init__(self, workers: int, preload: Sequence[str] = (), seconds: float | None = None) -> None:
        self._seconds, self._stopped = seconds, False
        self._mine = threading.local()
        self._processes: set[Any] = set()
        # afresh, never as copies of this process, which may hold locks and threads
        self._context = get_context("spawn") if sys.platform == "win32" else _fork_server(preload)
        self._threads = ThreadPoolExecutor(workers)

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **_: Any) -> Future[Any]:  # noqa: ANN401
        """Do a call in a process that has nothing else to do.

        The future raises _WorkerDiedError where the process dies of it, WorkerError where none can be had.
        """
        return self._threads.submit(self._done, function, *arguments)

    def _done(self, function: Callable[..., Any], *arguments: Any) -> Any:  # noqa: ANN401
        pool, process = self._worker()
        try:
            return pool.submit(function, *arguments).result(self._seconds)
        except TimeoutError:
            process.kill()
            self._forget(pool, process)
            raise _WorkerDiedError(f"took longer than the {self._seconds:g} s allowed", overdue=True) from None
        except BrokenExecutor:
            self._forget(pool, process)
            code, reason = process.exitcode, f"its worker ended with exit code {process.exitcode}"
            if code is not None and code < 0:
                with suppress(ValueError):
                    reason = f"its worker ended by {signal.Signals(-code).name}"
            raise _WorkerDiedError(reason) from None

    def _worker(self) -> tuple[ProcessPoolExecutor, Any]:
        """The process of this thread, a new one where it has none."""
        if getattr(self._mine, "worker", None) is None:
            for _ in range(0 if self._stopped else _STILLBORN):
                pool = ProcessPoolExecutor(1, mp_context=self._context, initializer=_begin)
                try:
                    pool.submit(_get_ready).result()
                except RuntimeError:  # a BrokenExecutor is one; so is what tells that a script has no guard
                    pool.shutdown()
                    continue
                (process,) = pool._processes.values()
                self._processes.add(process)
                self._mine.worker = pool, process
                if self._stopped:
                    process.kill()
                break
            else:
                raise WorkerError(
                    f"workers: found that {_STILLBORN} processes or more ended before any was ready; expected them "
                    'to last; put the calls of a script under if __name__ == "__main__":, and look whether memory is '
                    "short"
                )
        worker: tuple[ProcessPoolExecutor, Any] = self._mine.worker
        return worker

    def _forget(self, pool: ProcessPoolExecutor, process: Any) -> None:  # noqa: ANN401 (a Process)
        pool.shutdown()
        self._processes.discard(process)
        self._mine.worker = None

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes and what they are at: they get a moment to remove what they have half written."""
        self._stopped = True
        self._threads.shutdown(wait=False, cancel_futures=True)
        processes, until = list(self._processes), time.monotonic() + _GRACE
        for process in processes:
            process.terminate()
        for process in processes:
            process.join(max(until - time.monotonic(), 0))
            if process.is_alive():
                process.kill()
        self._threads.shutdown()


def _fork_server(preload: Sequence[str]) -> BaseContext:
    """Start the process that workers are copies of, with one thread and deaf to Ctrl-C from its birth, as they are."""
    context = get_context("forkserver")
    # not the caller's script, as by default: what it starts, threads for one, must not be there when workers are copied
    context.set_forkserver_preload([__name__, *preload])
    resource_tracker.ensure_running()  # else that would let Ctrl-C through again
    before = {name: os.environ.get(name) for name in _ONE_THREAD}
    masked = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT, signal.SIGHUP])
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))
    try:
        forkserver.ensure_running()
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})
        signal.pthread_sigmask(signal.SIG_SETMASK, masked)
    return context


class _Ended(SystemExit):
    """The driver has told this worker to end, or is gone."""


def _begin() -> None:
    """Make a process a worker: Ctrl-C is the driver's, and it ends with the driver, however that ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a terminal it goes to every process
    if sys.platform != "win32":
        signal.signal(signal.SIGTERM, _stop_here)
    threading.Thread(target=_follow_driver, daemon=True).start()


@one_blas_thread()
def _get_ready() -> None:
    """Load what every task needs: it does not count as the time of the first."""
    code_version()


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
