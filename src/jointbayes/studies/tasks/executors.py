"""Any executor of concurrent.futures, so also that of mpi4py."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait

from jointbayes.errors import WorkerError
from jointbayes.studies.tasks.crew import Call, Event, Reply, attempt


class ExecutorCrew:
    """The workers of an executor.

    An executor whose worker dies is broken as a whole, and does not tell at which task: all that ran are suspects.

    Parameters
    ----------
    executor
        An executor, which stays open; or a function that makes one, called again each time it breaks.
    workers
        How many tasks may be with the executor at once.
    """

    def __init__(self, executor: Executor | Callable[[], Executor], workers: int | None = None) -> None:
        self._make = None if isinstance(executor, Executor) else executor
        self._executor = executor if isinstance(executor, Executor) else executor()
        # with one more each than they have processes, none waits for the driver
        self._most = workers or 2 * int(getattr(self._executor, "_max_workers", os.cpu_count() or 1))
        self._futures: dict[Future[Reply], int] = {}
        self._unstarted: list[int] = []

    @property
    def free(self) -> int:
        """Room for further attempts."""
        return self._most - len(self._futures) - len(self._unstarted)

    def start(self, ticket: int, call: Call) -> None:
        """Hand the call to the executor."""
        try:
            self._futures[self._executor.submit(attempt, call)] = ticket
        except BrokenExecutor:
            self._unstarted.append(ticket)

    def wait(self, seconds: float) -> Sequence[Event]:
        """Wait for one attempt or more; a broken executor is made anew, or is an error where it cannot be."""
        done = wait(self._futures, seconds, FIRST_COMPLETED).done if self._futures else set()
        events, broken = [], bool(self._unstarted)
        for future in done:
            ticket = self._futures.pop(future)
            try:
                events.append(Event(ticket, future.result()))
            except (BrokenExecutor, CancelledError):
                broken = True
                self._unstarted.append(ticket)
            except Exception as error:  # a reply that could not be sent
                events.append(Event(ticket, Reply(error=f"{type(error).__name__}: {error}")))
        return [*events, *self._rebuilt()] if broken else events

    def _rebuilt(self) -> list[Event]:
        suspects = sorted([*self._futures.values(), *self._unstarted])
        if self._make is None:
            raise WorkerError(
                f"executor: found that a worker of it ended by itself, with {len(suspects)} tasks under way, so that "
                "it takes no more; expected it to last; pass a function that makes an executor, or use workers"
            )
        _discard(self._executor)
        self._futures, self._unstarted, self._executor = {}, [], self._make()
        reason = "a worker of its executor ended by itself"
        return [Event(ticket, None, reason, len(suspects) == 1) for ticket in suspects]

    def stop(self) -> None:
        """Withdraw what has not begun; an executor made here ends with its workers."""
        for future in self._futures:
            future.cancel()
        if self._make is not None:
            _discard(self._executor)


def _discard(executor: Executor) -> None:
    """Close an executor and end its processes: a process that it starts as it breaks would keep it waiting for ever."""
    processes = tuple((getattr(executor, "_processes", None) or {}).values())
    executor.shutdown(wait=False, cancel_futures=True)
    for process in processes:
        process.terminate()
