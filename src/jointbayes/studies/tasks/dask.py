"""The workers of a Dask cluster, each with one task at a time: so it is known which task was on one that is gone."""

import logging
import queue
import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from jointbayes.errors import WorkerError
from jointbayes.studies.tasks.crew import Call, Event, Reply, attempt, other_version

if TYPE_CHECKING:
    from distributed import Client


_LOOK = 0.5  # seconds between two looks at which workers there are
_CONNECT = 10.0  # seconds to wait for a scheduler
_FETCH = 10.0  # seconds after which a result that does not arrive has gone with its worker
_PATIENCE = 300.0  # seconds without any worker


class DaskCrew:
    """The workers of a scheduler, as they come and go.

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
    patience
        Seconds to wait where there is no worker at all.

    Raises
    ------
    WorkerError
        If distributed is not installed, or no scheduler answers.
    """

    def __init__(
        self,
        scheduler: "str | Client",
        workers: int | None = None,
        seconds: float | None = None,
        patience: float = _PATIENCE,
    ) -> None:
        self._client, self._own = _client(scheduler)
        if self._own:  # what it says of a scheduler that is gone is said here in one line
            logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        self._most, self._seconds, self._patience = workers, seconds, patience
        self._ended: queue.SimpleQueue[int] = queue.SimpleQueue()
        self._running: dict[int, tuple[Any, str, float]] = {}  # future, worker and start of each ticket
        self._addresses: set[str] = set()
        self._refused: dict[str, str] = {}  # version of each worker that has another than the driver
        self._seen = self._looked = time.monotonic()
        self._look()

    @property
    def free(self) -> int:
        """Workers with nothing of ours to do."""
        room = len(self._idle())
        return room if self._most is None else min(room, self._most - len(self._running))

    def _idle(self) -> set[str]:
        return self._addresses - {address for _, address, _ in self._running.values()}

    def start(self, ticket: int, call: Call) -> None:
        """Send the call to an idle worker, and to no other."""
        address = min(self._idle())
        with _scheduler_there():
            future = self._client.submit(
                _attempt,
                call,
                key=f"jointbayes-{uuid4().hex}",
                workers=[address],
                allow_other_workers=False,
                pure=False,
            )
        self._running[ticket] = (future, address, time.monotonic())
        future.add_done_callback(lambda _: self._ended.put(ticket))

    def wait(self, seconds: float) -> Sequence[Event]:
        """Wait for a task to end, then look which workers are gone and which are new."""
        events: list[Event] = []
        until = time.monotonic() + seconds
        while not events:
            with suppress(queue.Empty):
                events += self._finished(self._ended.get(timeout=min(_LOOK, max(until - time.monotonic(), 0))))
                while True:
                    events += self._finished(self._ended.get_nowait())
            if time.monotonic() - self._looked > _LOOK:
                idle = self.free
                events += self._look()
                if self.free > idle:
                    break
            if time.monotonic() >= until:
                break
        return events

    def _finished(self, ticket: int) -> list[Event]:
        if ticket not in self._running:
            return []
        future, address, _ = self._running.pop(ticket)
        try:
            reply = future.result(timeout=_FETCH)
        except Exception as error:  # Dask's own, of many kinds: the result is gone, or never came
            if type(error).__name__ in ("KilledWorker", "TimeoutError", "CommClosedError", "FutureCancelledError"):
                return [Event(ticket, None, "its worker ended by itself")]
            return [Event(ticket, Reply(error=f"{type(error).__name__}: {' '.join(str(error).split())}"))]
        finally:
            future.release()
        if reply.other_version:
            self._refuse(address, reply.other_version)
            return [Event(ticket, None, never_began=True)]
        return [Event(ticket, reply)]

    def _refuse(self, address: str, version: str) -> None:
        """Give a worker of another version nothing more to do: what it computes looks the same and is not."""
        self._refused[address] = version
        self._addresses.discard(address)
        line = other_version(version, f"worker {address}")
        if not self._addresses:
            raise WorkerError(line)
        warnings.warn(f"{line}; it gets nothing to do", RuntimeWarning, stacklevel=2)

    def _look(self) -> list[Event]:
        """Ask the scheduler for its workers; attempts on those that are gone have ended."""
        self._looked = time.monotonic()
        with _scheduler_there():
            self._addresses = set(self._client.nthreads()) - self._refused.keys()
        if self._addresses:
            self._seen = self._looked
        elif self._looked - self._seen > self._patience:
            raise WorkerError(
                f"scheduler: found no worker for {self._patience:.0f} s; expected one at least; start some, with one "
                "thread each"
            )
        events = []
        for ticket, (future, address, since) in tuple(self._running.items()):
            over = self._seconds is not None and self._looked - since > self._seconds
            if address in self._addresses and not over:
                continue
            if over and address in self._addresses:
                with _scheduler_there():
                    self._client.restart_workers([address], raise_for_error=False)
                self._addresses.discard(address)
            self._running.pop(ticket)
            future.cancel()
            reason = f"took longer than the {self._seconds:g} s allowed" if over else "its worker ended by itself"
            events.append(Event(ticket, None, reason, overdue=over))
        return events

    def stop(self) -> None:
        """Withdraw all tasks; workers stay, and end what they have begun."""
        for future, _, _ in self._running.values():
            future.cancel()
        self._running.clear()
        if self._own:
            self._client.close()


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


def _attempt(call: Call) -> Reply:
    """Run a call on a worker as anywhere else: xarray would ask the cluster for a lock for each file, in vain."""
    import dask

    with dask.config.set(scheduler="synchronous"):
        return attempt(call)


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
