"""Many independent tasks on processes, a Dask cluster or any executor: workers may die, tasks are not lost.

Tasks whose worker died are tried again, and those that go on killing are named.
"""

import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from scipy import special

from jointbayes.errors import WorkerError
from jointbayes.studies.crews import Crew, Event, ExecutorCrew, ProcessCrew, Task, packed

if TYPE_CHECKING:
    from distributed import Client


_TICK = 0.5  # seconds between two calls of `watch`
_CHANCE = 1e-4  # probability below which so many deaths are no chance
_MOST_DEATHS = 1 / 20  # of a worker in a second that may be somebody else's doing


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a task.

    Parameters
    ----------
    key
        Of the task.
    value
        What the function returned; None where it failed.
    error
        What went wrong at the last attempt, in words; None where the function returned.
    attempts
        How often it was begun; where a whole executor broke, only those count that ran alone.
    killed_worker
        Whether the last attempt ended with its worker, which died or took longer than allowed.
    """

    key: str
    value: Any
    error: str | None
    attempts: int
    killed_worker: bool


def run_tasks(
    function: Callable[..., Any],
    tasks: Iterable[tuple[str, tuple[Any, ...]]],
    *,
    workers: int | None = None,
    executor: Executor | Callable[[], Executor] | None = None,
    scheduler: "str | Client | None" = None,
    attempts: int = 2,
    seconds: float | None = None,
    preload: Sequence[str] = (),
    watch: Callable[[tuple[str, ...]], None] | None = None,
) -> Iterator[Outcome]:
    """Call a function for many tasks side by side; yield what became of each, in the order in which they end.

    A task that raises is begun again at once, `attempts` times in all; the others go on. One whose worker dies is begun
    again when all others have had their turn. Where workers also die of tasks that end well in the end, somebody else
    kills them: beyond its `attempts` a task is then forgiven as many deaths as chance would bring, at the rate of those
    others, in the time that it has worked.
    The first task runs by itself, so that only one process compiles what is not yet compiled. Where the loop over the
    outcomes is left, by Ctrl-C too, all workers end.

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
        An executor of concurrent.futures in place of own processes, or a function that makes one, which is called
        again when a worker has died and the executor with it.
    scheduler
        Address of a Dask scheduler, or a client. Each worker gets one task at a time, whatever its threads.
    attempts
        How often a task is begun at most.
    seconds
        Longest time for one attempt; its worker is then ended as if it had died. Not with `executor`.
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
        If the settings contradict each other, or no worker can be had.
    """
    if executor is not None and (scheduler is not None or seconds is not None):
        raise WorkerError("run_tasks: found executor with scheduler or seconds; expected it without; drop one")
    for name, number in (("workers", workers), ("attempts", attempts), ("seconds", seconds)):
        if number is not None and not number > 0:
            raise WorkerError(f"run_tasks: found {name} = {number}; expected a number above 0; correct it")

    def crew() -> Crew:
        if executor is not None:
            return ExecutorCrew(executor, workers)
        if scheduler is not None:
            from jointbayes.studies.dask_crew import DaskCrew

            return DaskCrew(scheduler, workers, seconds)
        return ProcessCrew(workers or _processors(), preload, seconds)

    return _Driver(function, iter(tasks), attempts, watch).outcomes(crew)


def _processors() -> int:
    """Processors that this process may use."""
    allowed = getattr(os, "sched_getaffinity", None)  # not on macOS and Windows
    return len(allowed(0)) if allowed else os.cpu_count() or 1


class _Driver:
    """Tasks that wait, tasks that run, and what is decided when one ends."""

    def __init__(
        self,
        function: Callable[..., Any],
        source: Iterator[tuple[str, tuple[Any, ...]]],
        attempts: int,
        watch: Callable[[tuple[str, ...]], None] | None,
    ) -> None:
        self._function, self._source, self._attempts = function, source, attempts
        self._watch = watch or (lambda _keys: None)
        self._again: deque[Task] = deque()
        self._killed: list[Task] = []  # tried again at the end
        self._set_aside: list[Outcome] = []
        self._innocent_seconds, self._innocent_deaths = 0.0, 0  # of workers at tasks that ended well
        self._running: list[Task] = []
        self._warm = False

    def outcomes(self, crew: Callable[[], Crew]) -> Iterator[Outcome]:
        """Run all tasks."""
        at_work = crew()
        try:
            while self._hand_out(at_work):
                self._watch(tuple(task.key for task in self._running))
                ended = [outcome for event in at_work.wait(_TICK) if (outcome := self._judged(event))]
                if ended:
                    self._hand_out(at_work)  # workers go on while the caller looks at the outcomes
                yield from ended
            yield from self._set_aside
        finally:
            at_work.stop()

    def _hand_out(self, crew: Crew) -> bool:
        """Start what can be started; tell whether anything runs, or has still to."""
        while True:
            task = self._next()
            if task is None:
                return bool(self._running)
            apart = task.alone or not self._warm or any(other.alone for other in self._running)
            if crew.free <= 0 or (self._running and apart):
                self._again.appendleft(task)
                return True
            task.attempts += 1
            task.began = time.monotonic()
            self._running.append(task)
            crew.start(task, packed(self._function, task.arguments))

    def _next(self) -> Task | None:
        """The next task; in the end one whose worker died and that is to be tried again, and the others set aside."""
        if self._again:
            return self._again.popleft()
        fresh = next(self._source, None)
        if fresh is not None:
            return Task(*fresh)
        for task in self._killed:
            if task.kills < self._allowed(task):
                self._killed.remove(task)
                return task
        if not self._running:  # nothing more will be known
            self._set_aside += [Outcome(task.key, None, task.reason, task.attempts, True) for task in self._killed]
            self._killed.clear()
        return None

    def _allowed(self, task: Task) -> int:
        """How many of its workers may die: `attempts`, and more where workers die that tasks have no part in.

        These are deaths by chance, a Poisson process whose rate is seen at tasks that ended well: so many more that a
        further one in the time that the task has worked has a probability below 1e-4.
        """
        rate = self._innocent_deaths / self._innocent_seconds if self._innocent_deaths else 0.0
        expected, forgiven = min(rate, _MOST_DEATHS) * task.worked, 0
        while special.pdtrc(forgiven, expected) >= _CHANCE:
            forgiven += 1
        return self._attempts + forgiven

    def _judged(self, event: Event) -> Outcome | None:
        """The outcome of a task that has ended for good; one that has not waits again, before all others."""
        task, reply = event.task, event.reply
        self._running.remove(task)
        if reply is not None and reply.other_version:
            task.attempts -= 1
            self._again.appendleft(task)
            return None
        self._warm = True
        task.worked += time.monotonic() - task.began
        if reply is not None and reply.error is None:
            self._innocent_deaths += task.kills
            self._innocent_seconds += task.worked
            return Outcome(task.key, reply.value, None, task.attempts, False)
        if not event.certain:
            task.alone = True
            task.attempts -= 1
            self._again.appendleft(task)
        elif reply is None and not event.overdue:
            task.kills, task.reason = task.kills + 1, event.reason
            self._killed.append(task)
        elif task.attempts - task.kills < self._attempts:
            self._again.appendleft(task)
        else:
            return Outcome(task.key, None, event.reason if reply is None else reply.error, task.attempts, reply is None)
        return None
