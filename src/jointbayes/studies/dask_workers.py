"""The workers of a Dask cluster as an executor; what is done where one dies is the scheduler's own rule."""

import logging
import os
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from jointbayes.errors import WorkerError

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
