"""Many tasks by executors of concurrent.futures: processes of this machine, a Dask cluster, or any other executor.

If a worker dies, its task is done again after all others. A task of which three workers died is set aside by name. On a
cluster the scheduler decides this, by its setting `distributed.scheduler.allowed-failures`.
"""

import logging
import os
import platform
import signal
import sys
import threading
import time
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import active_children, forkserver, get_context, parent_process, resource_tracker
from typing import TYPE_CHECKING, Any

from jointbayes.errors import JointBayesError, WorkerError
from jointbayes.reproducibility import code_version, one_blas_thread

if TYPE_CHECKING:
    from distributed import Client

#: Workers that die of one task until it is set aside.
MOST_DEATHS = 3
_TICK = 0.5  # seconds between two calls of `watch`
_GRACE = 5.0  # seconds in which a worker that has to end may remove half-written files
_CONNECT = 10.0  # seconds to wait for a scheduler
_PATIENCE = 300.0  # seconds without any worker of a cluster
_ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_one_at_a_time = threading.Lock()  # in a worker of a cluster, which may have several threads


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
        Whether the last attempt ended with its worker.
    """

    key: str
    value: Any
    error: str | None
    attempts: int
    killed_worker: bool = False


def run_tasks(
    function: Callable[..., Any],
    tasks: Iterable[tuple[str, tuple[Any, ...]]],
    *,
    workers: int | None = None,
    executor: Executor | None = None,
    scheduler: "str | Client | None" = None,
    preload: Sequence[str] = (),
    watch: Callable[[tuple[str, ...]], None] = lambda _keys: None,
) -> Iterator[Outcome]:
    """Call a function for many tasks side by side; yield the outcome of each, in the order in which they end.

    1. Choose the executor, and how many tasks it may have at once.
    2. Hand out tasks as workers come free. The first runs by itself, so that only one process compiles what is not yet
       compiled. Those whose worker died come last.
    3. Yield the outcomes. A task that raises has ended: its error is its outcome.

    If the loop over the outcomes is left, by Ctrl-C too, all workers end.

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
    if executor is not None and scheduler is not None:
        raise WorkerError("run_tasks: found executor with scheduler; expected one of them; drop the other")
    if workers is not None and not workers > 0:
        raise WorkerError(f"run_tasks: found workers = {workers}; expected a number above 0; correct it")
    with ExitStack() as stack:
        # 1. Choose the executor.
        allowed = getattr(os, "sched_getaffinity", None)  # not on macOS and Windows
        most = workers or (len(allowed(0)) if allowed else os.cpu_count() or 1)
        if executor is not None and workers is None:  # one more each than they have, so that none waits for the driver
            most = 2 * int(getattr(executor, "_max_workers", most))
        own: Processes | None = None
        room: Callable[[], int] = lambda: most  # noqa: E731
        call: Callable[..., tuple[Any, str | None]] = attempt
        if scheduler is not None:
            call = _attempt_on_cluster
            executor, room = stack.enter_context(_cluster(scheduler, workers))
        elif executor is None:
            executor = own = stack.enter_context(Processes(preload))
        source, again = iter(tasks), deque[tuple[str, tuple[Any, ...]]]()
        running: dict[Future[tuple[Any, str | None]], tuple[str, tuple[Any, ...]]] = {}
        ended: dict[Future[tuple[Any, str | None]], str | None] = {}  # and how its worker died, if it did
        attempts, first = Counter[str](), True
        stack.callback(lambda futures: [future.cancel() for future in futures], running)
        while True:
            # 2. Hand out tasks; workers go on while the caller looks at the outcomes.
            broken = None
            try:
                with _executor_lasts():
                    while len(running) - len(ended) < (1 if first else room()):
                        task = next(source, None) or (again.popleft() if again else None)
                        if task is None:
                            break
                        attempts[task[0]] += 1
                        running[executor.submit(call, code_version(), function, *task[1])] = task
            except WorkerError as error:
                broken = error  # what is done is yielded before
            # 3. Yield the outcomes.
            for future, death in ended.items():
                task = running.pop(future)
                if death and attempts[task[0]] < MOST_DEATHS:
                    again.append(task)
                else:
                    yield _outcome(task[0], attempts.pop(task[0]), death, future)
            if broken is not None:
                raise broken
            ended = {}
            if running:
                watch(tuple(key for key, _ in running.values()))
                done = wait(running, _TICK, "FIRST_COMPLETED").done
                replied = sorted(done, key=lambda future: future.cancelled() or future.exception() is not None)
                ended = {future: own.take_back(future) if own else None for future in replied}
                first = first and not ended
            elif not again:
                return


def _outcome(key: str, attempts: int, death: str | None, future: "Future[tuple[Any, str | None]]") -> Outcome:
    """The outcome of a task that has ended, and is not done again."""
    if death:
        return Outcome(key, None, death, attempts, killed_worker=True)
    try:
        with _executor_lasts():
            value, error = future.result()
    except WorkerError:
        raise
    except Exception as fault:  # `attempt` raises nothing else: call or reply did not arrive
        if type(fault).__name__ == "KilledWorker":  # Dask's word for a task that did so too often
            return Outcome(key, None, "its workers died more often than the scheduler allows", attempts, True)
        words = f"found a value that cannot be sent between processes ({type(fault).__name__}: {fault})"
        return Outcome(key, None, words, attempts)
    return Outcome(key, value, error, attempts)


@contextmanager
def _executor_lasts() -> Iterator[None]:
    """Say in one line that an executor, or the scheduler behind it, has gone or has lost a worker of its own."""
    try:
        yield
    except (BrokenExecutor, CancelledError, OSError, TimeoutError) as error:  # Dask's CommClosedError is an OSError
        found = f"executor: found that it has gone, or lost a worker, and takes no more ({type(error).__name__})"
        raise WorkerError(f"{found}; expected it to last; start it again, or use processes of this machine") from error


@one_blas_thread()
def attempt(version: str, function: Callable[..., Any], *arguments: Any) -> tuple[Any, str | None]:  # noqa: ANN401
    """Run a call, in a worker; return its value, or None and its error in words.

    Raises
    ------
    WorkerError
        If the driver has another version: what that computes looks the same and is not.
    """
    if version != code_version():
        found = f"worker on {platform.node()}: found jointbayes {code_version()}; expected {version}"
        raise WorkerError(f"{found}, with the sources of the driver; install the same there, and start again")
    try:
        return function(*arguments), None
    except _Ended:
        os._exit(1)  # what was half written is removed
    except JointBayesError as error:
        return None, str(error)
    except (Exception, SystemExit) as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        text, where = " ".join(str(error).split()), f"{place.name}, {os.path.basename(place.filename)}:{place.lineno}"
        return None, f"{type(error).__name__}: {text} (in {where})"


class Processes(Executor):
    """Processes of this machine, each in a ProcessPoolExecutor of its own.

    A pool of several processes does not say which task a dead one had, and gives up the tasks of all others.

    Parameters
    ----------
    preload
        Modules that each has from the start. Except on Windows one process loads them and the workers are copies of
        it, so that a new one costs milliseconds.
    """

    def __init__(self, preload: Sequence[str] = ()) -> None:
        # never copies of this process, which may hold locks and threads
        self._context: Any = get_context("spawn") if sys.platform == "win32" else _fork_server(preload)
        self._processes: dict[ProcessPoolExecutor, Any] = {}
        self._idle: list[ProcessPoolExecutor] = []
        self._busy: dict[Future[Any], ProcessPoolExecutor] = {}

    def submit(self, function: Callable[..., Any], /, *arguments: Any, **_: Any) -> Future[Any]:  # noqa: ANN401
        """Do a call in a process that has nothing else to do, a new one if there is none.

        Raises
        ------
        WorkerError
            If a new process ends before it is ready.
        """
        if not self._idle:
            pool = ProcessPoolExecutor(1, self._context)
            ready = pool.submit(_begin)
            (self._processes[pool],) = pool._processes.values()
            self._busy[ready] = pool
            if death := self.take_back(ready):
                found = f"workers: found that a process ended before it was ready ({death}); expected it to last; put "
                raise WorkerError(f'{found}the calls of a script under if __name__ == "__main__":, or free memory')
        pool = self._idle.pop()
        try:
            future = pool.submit(function, *arguments)
        except BrokenExecutor:  # it has died since
            return self.submit(function, *arguments)
        self._busy[future] = pool
        return future

    def take_back(self, future: Future[Any]) -> str | None:
        """Wait for a call, and let its process have another; return how the process died, if it did."""
        pool = self._busy.pop(future)
        if not isinstance(future.exception(), BrokenExecutor):
            self._idle.append(pool)
            return None
        pool.shutdown()
        code = self._processes.pop(pool).exitcode
        names = {-number.value: f"by {number.name}" for number in signal.Signals}
        return f"its worker ended {names.get(code, f'with exit code {code}')}"

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes: they get a moment to remove what they have half written."""
        until = time.monotonic() + _GRACE
        for process in self._processes.values():
            process.terminate()
        for pool, process in self._processes.items():
            process.join(max(until - time.monotonic(), 0))
            process.kill()
            pool.shutdown()
        self._processes.clear()


class _Ended(SystemExit):
    """The driver has asked this worker to end, or is gone."""


def _begin() -> None:
    """Prepare a new process: Ctrl-C is the driver's, and the process ends with the driver, however that ends."""
    driver: Any = parent_process()

    def stop(_number: int, _frame: object) -> None:
        raise _Ended

    def follow() -> None:
        driver.join()
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(_GRACE)
        os._exit(1)

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to every process
    if sys.platform != "win32":
        signal.signal(signal.SIGTERM, stop)
    threading.Thread(target=follow, daemon=True).start()
    code_version()


def _fork_server(preload: Sequence[str]) -> Any:  # noqa: ANN401 (a context, which has no type with forkservers)
    """Start the process that workers are copies of, with one thread and deaf to Ctrl-C from its birth, as they are.

    A server that runs already has the modules of then: it is replaced, unless it has children.
    """
    context = get_context("forkserver")
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


def _attempt_on_cluster(*call: Any) -> tuple[Any, str | None]:  # noqa: ANN401
    """Attempt a call in a worker of a cluster, by itself."""
    import dask

    with _one_at_a_time, dask.config.set(scheduler="synchronous"):  # else xarray asks the cluster for locks, in vain
        return attempt(*call)


@contextmanager
def _cluster(scheduler: "str | Client", workers: int | None) -> Iterator[tuple[Executor, Callable[[], int]]]:
    """An executor on the workers of a scheduler, and how many tasks it may have now: one for each worker."""
    try:
        import distributed
    except ImportError:
        raise WorkerError("scheduler: found no distributed; expected it; install jointbayes[cluster]") from None
    kind: Any = distributed.Client  # its methods have no types
    ours = not isinstance(scheduler, kind)
    try:
        client: Any = kind(scheduler, timeout=_CONNECT) if ours else scheduler
    except (OSError, ValueError) as error:
        found = f"scheduler: found none at {scheduler} ({' '.join(str(error).split())}); expected an address such as "
        raise WorkerError(f"{found}tcp://host:8786; start one with: dask scheduler") from error
    if ours:  # what it says of a scheduler that is gone is said here in one line
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    seen = time.monotonic()

    def room() -> int:
        nonlocal seen
        count, now = len(client.nthreads()), time.monotonic()
        if not count and now - seen > _PATIENCE:
            raise WorkerError(f"scheduler: found no worker for {_PATIENCE:.0f} s; expected one at least; start some")
        seen = now if count else seen
        return max(1, min(count, workers or count))

    executor = client.get_executor(pure=False)
    try:
        yield executor, room
    finally:
        with suppress(OSError, TimeoutError):  # of a scheduler that has gone
            executor.shutdown(wait=False)
        if ours:
            client.close()
