"""The workers of a Dask cluster, each with one task at a time: so it is known which task was on one that is gone."""

import logging
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from jointbayes.errors import WorkerError
from jointbayes.studies.crews import Crew, Event, Reply, Seat, attempt, other_version_of_worker

if TYPE_CHECKING:
    from distributed import Client

_LOOK = 0.5  # seconds between two looks at which workers there are
_CONNECT = 10.0  # seconds to wait for a scheduler
_PATIENCE = 300.0  # seconds without any worker


def _attempt(call: bytes) -> Reply:
    """Run a call on a worker as anywhere else: xarray would ask the cluster for a lock for each file, in vain."""
    import dask

    with dask.config.set(scheduler="synchronous"):
        return attempt(call)


class DaskCrew(Crew):
    """The workers of a scheduler, as they come and go, each as Dask's own executor for that worker alone.

    Dask itself would compute the tasks of a lost worker again elsewhere, but does not say which of them ran. So each
    task is tied to one worker that has nothing else of ours, and tied anew by us when that is gone.

    Parameters
    ----------
    scheduler
        Address of the scheduler, or a client, which stays open.
    workers
        How many workers to use at most; by default all.
    seconds
        Longest time for one attempt; after it the worker is restarted, where a nanny watches it.

    Raises
    ------
    WorkerError
        If distributed is not installed, or no scheduler answers.
    """

    attempt = staticmethod(_attempt)

    def __init__(self, scheduler: "str | Client", workers: int | None = None, seconds: float | None = None) -> None:
        super().__init__(seconds)
        self._client, self._close = _client(scheduler)
        if self._close:  # what it says of a scheduler that is gone is said here in one line
            logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        self._most = workers
        self._refused: set[str] = set()  # workers of another version
        self._seen, self._looked = time.monotonic(), float("-inf")
        self.renew()

    def renew(self) -> list[Event]:
        """Look which workers are gone and which are new."""
        if time.monotonic() - self._looked < _LOOK:
            return []
        self._looked = time.monotonic()
        addresses = self._addresses()
        if addresses:
            self._seen = self._looked
        elif self._looked - self._seen > _PATIENCE:
            raise WorkerError(
                f"scheduler: found no worker for {_PATIENCE:.0f} s; expected one at least; start some, with one "
                "thread each"
            )
        gone = [seat for seat in self.seats if seat.name not in addresses]
        events = [event for seat in gone for event in self.lost(seat)]
        for address in sorted(addresses - {seat.name for seat in self.seats}):
            if self._most is None or len(self.seats) < self._most:
                executor = self._client.get_executor(workers=[address], allow_other_workers=False, pure=False)
                self.seats.append(Seat(executor, name=address))
        return events

    def _addresses(self) -> set[str]:
        with _scheduler_there():
            return set(self._client.nthreads()) - self._refused

    def start(self, task: Any, call: bytes) -> None:  # noqa: ANN401 (a Task)
        """Send the call to an idle worker, and to no other."""
        with _scheduler_there():
            super().start(task, call)

    def refuse(self, seat: Seat, version: str) -> None:
        """Give a worker of another version nothing more to do."""
        self._refused.add(seat.name)
        self.seats.remove(seat)
        line = other_version_of_worker(version, f"worker {seat.name}")
        if not self._addresses():
            raise WorkerError(line)
        warnings.warn(f"{line}; it gets nothing to do", RuntimeWarning, stacklevel=2)

    def dismiss(self, seat: Seat, kill: bool) -> str:
        """Withdraw what a worker had; restart one that is overdue."""
        if kill:
            with _scheduler_there():
                self._client.restart_workers([seat.name], raise_for_error=False)
        _withdraw(seat)
        return "its worker ended by itself"

    def stop(self) -> None:
        """Withdraw all tasks; workers stay, and end what they have begun."""
        for seat in self.seats:
            _withdraw(seat)
        if self._close:
            self._client.close()


def _withdraw(seat: Seat) -> None:
    with suppress(OSError, TimeoutError):  # of a scheduler that has gone
        seat.executor.shutdown(wait=False)


@contextmanager
def _scheduler_there() -> Iterator[None]:
    """Say in one line that the scheduler has gone."""
    try:
        yield
    except (OSError, TimeoutError) as error:  # Dask's CommClosedError is an OSError
        raise WorkerError(
            "scheduler: found that it has gone; expected it to last; what is done is kept: start it and its workers, "
            "and the same command again, which goes on"
        ) from error


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
        return client(scheduler, timeout=_CONNECT), True
    except (OSError, ValueError) as error:
        raise WorkerError(
            f"scheduler: found none at {scheduler} ({' '.join(str(error).split())}); expected an address such as "
            "tcp://host:8786; start one with: dask scheduler"
        ) from error
