"""Many tasks by executors of concurrent.futures: processes of this machine, a Dask cluster, or any other executor.

If a worker dies, its task is done again after all others. A task of which three workers died is set aside by name. On a
cluster the scheduler decides this, by its setting `distributed.scheduler.allowed-failures`.
"""

import atexit
import logging
import os
import platform
import shutil
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent import futures
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import active_children, forkserver, get_context, parent_process, resource_tracker, util
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from jointbayes.errors import JointBayesError, WorkerError
from jointbayes.reproducibility import code_version, one_blas_thread
from vibrecords.files import lock_file

if TYPE_CHECKING:
    from distributed import Client

#: Workers that die of one task until it is set aside.
MOST_DEATHS = 3
_TICK = 0.5  # seconds between two calls of `watch`
_GRACE = 5.0  # seconds in which a worker that is told to end may remove what it has half written
_CONNECT = 10.0  # seconds to wait for a scheduler
_PATIENCE = 300.0  # seconds without any worker of a cluster
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_SOCKETS_LOCK = "jointbayes.lock"  # in the directory of sockets that multiprocessing makes; held while its owner lives
_one_at_a_time = threading.Lock()  # in a worker of a cluster, which may have several threads
_kept: list[BinaryIO] = []  # locks that this process holds until it ends


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of a task.

    Parameters
    ----------
    key
        Of the task.
    value
        What the function returned; None if it failed.
    error
        What went wrong at the last attempt, in words; None if the function returned.
    attempts
        How often it was begun; on a cluster once, even if the scheduler repeats it.
    killed_worker
        Whether the last attempt ended with its worker, which died or took longer than allowed.
    """

    key: str
    value: Any
    error: str | None
    attempts: int
    killed_worker: bool = False


class _WorkerDiedError(Exception):
    """A worker ended with its task; `overdue` if it was ended because the task took longer than allowed."""

    def __init__(self, reason: str, overdue: bool = False) -> None:
        super().__init__(reason)
        self.overdue = overdue


def run_tasks(
    function: Callable[..., Any],
    tasks: Iterable[tuple[str, tuple[Any, ...]]],
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    scheduler: "str | Client | None" = None,
    seconds: float | None = None,
    preload: Sequence[str] = (),
    watch: Callable[[tuple[str, ...]], None] = lambda _keys: None,
) -> Iterator[Outcome]:
    """Call a function for many tasks side by side; yield the outcome of each, in the order in which they end.

    A task that raises has ended: its error is its outcome. The first task runs by itself, so that only one process
    compiles what is not yet compiled. If the loop over the outcomes is left, by Ctrl-C too, all workers end.

    Parameters
    ----------
    function
        Defined at the top of a module; called as ``function(*arguments)``. A task may run twice.
    tasks
        Key and arguments of each; taken one by one as workers come free.
    workers
        Number of processes of this machine; by default one for each processor. With `scheduler` or `executor` the
        largest number of tasks under way.
    executor
        An executor of concurrent.futures in place of own processes; it stays open. One that breaks ends the loop.
    scheduler
        Address of a Dask scheduler, or a client. Each worker gets one task at a time.
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
    if scheduler is not None:
        with _dask_executor(scheduler, workers, seconds) as (cluster, room):
            yield from _outcomes(cluster, room, function, tasks, watch)
    elif executor is not None:
        # one more each than they have processes, so that none waits for the driver
        most = workers or 2 * int(getattr(executor, "_max_workers", os.cpu_count() or 1))
        yield from _outcomes(executor, lambda: most, function, tasks, watch)
    else:
        allowed = getattr(os, "sched_getaffinity", None)  # not on macOS and Windows
        count = workers or (len(allowed(0)) if allowed else os.cpu_count() or 1)
        with ProcessWorkers(count, preload, seconds) as processes:
            yield from _outcomes(processes, lambda: count, function, tasks, watch)


def _outcomes(
    executor: Executor,
    room: Callable[[], int],
    function: Callable[..., Any],
    tasks: Iterable[tuple[str, tuple[Any, ...]]],
    watch: Callable[[tuple[str, ...]], None],
) -> Iterator[Outcome]:
    """Outcomes of all tasks; at most `room` are with the executor at once. Those whose worker died come last."""
    source, again = iter(tasks), deque[tuple[str, tuple[Any, ...]]]()
    running: dict[Future[tuple[Any, str | None]], tuple[str, tuple[Any, ...]]] = {}
    attempts: dict[str, int] = {}  # of the tasks that run or run again
    first = True
    broken: WorkerError | None = None

    def submit() -> None:
        while len(running) < (1 if first else room()):
            task = next(source, None) or (again.popleft() if again else None)
            if task is None:
                return
            attempts[task[0]] = attempts.get(task[0], 0) + 1
            running[executor.submit(attempt, code_version(), function, *task[1])] = task

    try:
        with _executor_lasts():
            submit()
        while running:
            watch(tuple(key for key, _ in running.values()))
            done = futures.wait(running, _TICK, futures.FIRST_COMPLETED).done
            ended = [(future, running.pop(future)) for future in sorted(done, key=_lacks_reply)]
            first = first and not ended
            try:
                with _executor_lasts():
                    submit()  # workers go on while the caller looks at the outcomes
            except WorkerError as error:
                broken = error  # what is done is yielded before
            for future, task in ended:
                outcome = _outcome(task[0], attempts[task[0]], future)
                if outcome is None:
                    again.append(task)
                else:
                    del attempts[task[0]]
                    yield outcome
            if broken is not None:
                raise broken
            with _executor_lasts():
                submit()
    finally:
        for future in running:
            future.cancel()


def _lacks_reply(future: Future[Any]) -> bool:
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


def _outcome(key: str, attempts: int, future: "Future[tuple[Any, str | None]]") -> Outcome | None:
    """The outcome of a task; None if its worker died and it is to be done again."""
    try:
        with _executor_lasts():
            value, error = future.result()
    except _WorkerDiedError as death:
        if attempts < MOST_DEATHS and not death.overdue:
            return None
        return Outcome(key, None, str(death), attempts, killed_worker=True)
    except WorkerError:
        raise
    except Exception as fault:  # `attempt` raises nothing else: call or reply did not arrive
        if type(fault).__name__ == "KilledWorker":  # Dask's word for a task that did so too often
            reason = "its workers died, or took longer than allowed, more often than the scheduler allows"
            return Outcome(key, None, reason, attempts, killed_worker=True)
        words = f"found a value that cannot be sent between processes ({type(fault).__name__}: {fault})"
        return Outcome(key, None, words, attempts)
    return Outcome(key, value, error, attempts)


@one_blas_thread()
def attempt(version: str, function: Callable[..., Any], *arguments: Any) -> tuple[Any, str | None]:  # noqa: ANN401
    """Run a call, in a worker; return its value, or None and its error in words.

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
        return function(*arguments), None
    except _Ended:
        raise
    except JointBayesError as error:
        return None, str(error)
    except (Exception, SystemExit) as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        text, where = " ".join(str(error).split()), f"{place.name}, {Path(place.filename).name}:{place.lineno}"
        return None, f"{type(error).__name__}: {text} (in {where})"


class ProcessWorkers(Executor):
    """Processes of this machine, each with one task at a time, replaced if they die or take too long.

    A thread waits for each process, so that it is known which task a dead process had.

    Parameters
    ----------
    workers
        How many run at once.
    preload
        Modules that each has from the start. Except on Windows one process loads them and the workers are copies of
        it, so that a new one costs milliseconds.
    seconds
        Longest time for one task; after it the process is ended.
    """

    def __init__(self, workers: int, preload: Sequence[str] = (), seconds: float | None = None) -> None:
        self._seconds, self._stopped = seconds, False
        self._mine = threading.local()
        self._processes: set[Any] = set()
        # never copies of this process, which may hold locks and threads
        self._context: Any = get_context("spawn") if sys.platform == "win32" else _fork_server(preload)
        self._threads = ThreadPoolExecutor(workers)

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **_: Any) -> Future[Any]:  # noqa: ANN401
        """Do a call in a process that has nothing else to do.

        The future raises _WorkerDiedError if the process dies of it, WorkerError if none can be had.
        """
        return self._threads.submit(self._done, function, arguments)

    def _done(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:  # noqa: ANN401
        process, pipe = self._worker()
        pipe.send((function, arguments))
        try:
            if not pipe.poll(self._seconds):
                process.kill()
                self._forget(process, pipe)
                raise _WorkerDiedError(f"took longer than the {self._seconds:g} s allowed", overdue=True)
            reply, error = pipe.recv()
        except (EOFError, ConnectionError):
            self._forget(process, pipe)
            names = {-number.value: f"by {number.name}" for number in signal.Signals}
            reason = names.get(process.exitcode, f"with exit code {process.exitcode}")
            raise _WorkerDiedError(f"its worker ended {reason}") from None
        if error is not None:
            raise error
        return reply

    def _worker(self) -> tuple[Any, Any]:
        """The process of this thread and the pipe to it, a new one if it has none."""
        if getattr(self._mine, "worker", None) is None:
            pipe, there = self._context.Pipe()
            process = self._context.Process(target=_work, args=(there,), daemon=True)
            process.start()
            there.close()
            self._processes.add(process)
            if self._stopped:
                process.kill()
            try:
                pipe.recv()
            except (EOFError, ConnectionError):
                self._forget(process, pipe)
                raise WorkerError(
                    f"workers: found that a process ended before it was ready (exit code {process.exitcode}); expected "
                    'it to last; put the calls of a script under if __name__ == "__main__":, and look whether memory '
                    "is short"
                ) from None
            self._mine.worker = process, pipe
        worker: tuple[Any, Any] = self._mine.worker
        return worker

    def _forget(self, process: Any, pipe: Any) -> None:  # noqa: ANN401 (a Process, a Connection)
        process.join()
        pipe.close()
        self._processes.discard(process)
        self._mine.worker = None

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes: they get a moment to remove what they have half written."""
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


class _Ended(SystemExit):
    """The driver has told this worker to end, or is gone."""


@one_blas_thread()
def _work(driver: Connection) -> None:
    """Do calls in a new process. Ctrl-C is the driver's, and the process ends with the driver, however that ends."""

    def stop(_number: int, _frame: object) -> None:
        raise _Ended

    def follow(parent: Any) -> None:  # noqa: ANN401 (a Process)
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(_GRACE)
        os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to every process
    if sys.platform != "win32":
        signal.signal(signal.SIGTERM, stop)
    threading.Thread(target=follow, args=(parent_process(),), daemon=True).start()
    code_version()  # it does not count as time of the first task
    driver.send(True)
    while True:
        try:
            function, arguments = driver.recv()
            driver.send((function(*arguments), None))
        except _Ended:
            os._exit(1)  # what was half written is removed
        except (EOFError, ConnectionError):
            return
        except Exception as error:  # what cannot be pickled raises many kinds
            kept = error if isinstance(error, JointBayesError) else TypeError(" ".join(str(error).split()))
            driver.send((None, kept))


def _fork_server(preload: Sequence[str]) -> Any:  # noqa: ANN401 (a context, which has no type with forkservers)
    """Start the process that workers are copies of, with one thread and deaf to Ctrl-C from its birth, as they are.

    A server that runs already has the modules of then: it is replaced, unless it has children.
    """
    context = get_context("forkserver")
    _own_sockets()
    wanted = [__name__, *preload]  # not the caller's script, as by default: it may start threads
    server = forkserver._forkserver
    if getattr(server, "_preload_modules", wanted) != wanted and not active_children():
        server._stop()  # type: ignore[attr-defined]
    context.set_forkserver_preload(wanted)
    resource_tracker.ensure_running()  # otherwise it would let Ctrl-C through again
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


def _own_sockets() -> None:
    """Lock the directory of sockets that multiprocessing makes, and remove those of drivers that were killed."""
    with suppress(OSError, JointBayesError):  # a disk without locks
        own = Path(util.get_temp_dir())
        if not _kept and (lock := lock_file(own / _SOCKETS_LOCK, surely=True)):
            _kept.append(lock)
            atexit.register(lock.close)
        for left in Path(tempfile.gettempdir()).glob(f"pymp-*/{_SOCKETS_LOCK}"):
            if left.parent != own and (free := lock_file(left, surely=True)):
                with free:
                    shutil.rmtree(left.parent)


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
def _dask_executor(
    scheduler: "str | Client", workers: int | None, seconds: float | None
) -> Iterator[tuple[Executor, Callable[[], int]]]:
    """An executor on the workers of a scheduler, and how many tasks it may have now: one for each worker."""
    try:
        import distributed
    except ImportError:
        raise WorkerError(
            "scheduler: found no package distributed; expected it for a Dask cluster; install jointbayes[cluster]"
        ) from None
    kind: Any = distributed.Client  # its methods have no types
    ours = not isinstance(scheduler, kind)
    try:
        client: Any = kind(scheduler, timeout=_CONNECT) if ours else scheduler
    except (OSError, ValueError) as error:
        raise WorkerError(
            f"scheduler: found none at {scheduler} ({' '.join(str(error).split())}); expected an address such as "
            "tcp://host:8786; start one with: dask scheduler"
        ) from error
    if ours:  # what it says of a scheduler that is gone is said here in one line
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
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
