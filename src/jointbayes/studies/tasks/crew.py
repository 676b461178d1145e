"""What runs tasks, whatever it is: the crew's side of the talk with the driver, and one attempt at a task."""

import pickle
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from jointbayes.code_version import code_version
from jointbayes.errors import JointBayesError, WorkerError
from jointbayes.threads import one_blas_thread

Call = bytes
"""A function, by the name of its module, and its arguments, as they are sent to a worker."""


class Reply(NamedTuple):
    """What became of one attempt: a value, or the error in words; or the other version of a worker that refused it."""

    value: Any = None
    error: str | None = None
    other_version: str = ""


class Event(NamedTuple):
    """The end of one attempt.

    Parameters
    ----------
    ticket
        The number under which the attempt was started.
    reply
        Its reply; None where the worker died.
    reason
        Of the death, where it is known.
    certain
        Whether nothing else ran on the worker that died.
    overdue
        Whether the worker was ended because the attempt took longer than allowed.
    never_began
        Whether the attempt was refused where it was sent.
    """

    ticket: int
    reply: Reply | None
    reason: str = ""
    certain: bool = True
    overdue: bool = False
    never_began: bool = False


class Crew(Protocol):
    """Workers that each do one task at a time. Those that die are replaced, and their tasks reported."""

    @property
    def free(self) -> int:
        """How many more attempts can be started now."""

    def start(self, ticket: int, call: Call) -> None:
        """Start an attempt; only where `free` is above 0."""

    def wait(self, seconds: float) -> Sequence[Event]:
        """Wait so long for attempts to end, or for a worker to come free."""

    def stop(self) -> None:
        """End all workers, and what they are at."""


def packed(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Call:
    """A call as bytes.

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


def other_version(found: str, where: str = "workers") -> str:
    """The line that refuses workers of another version."""
    return (
        f"{where}: found jointbayes {found}; expected {code_version()}, with the sources of the driver; install the "
        "same there, and start the same command again, which goes on"
    )


@one_blas_thread()
def attempt(call: Call) -> Reply:
    """Run a call, in a worker. Whatever it raises becomes one error in words."""
    try:
        wanted, inner = pickle.loads(call)
        if wanted != code_version():  # what another version computes looks the same and is not
            return Reply(other_version=code_version())
        function, arguments = pickle.loads(inner)
        return Reply(value=function(*arguments))
    except JointBayesError as error:
        return Reply(error=str(error))
    except (Exception, SystemExit) as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        text = " ".join(str(error).split())
        return Reply(
            error=f"{type(error).__name__}: {text} (in {place.name}, {Path(place.filename).name}:{place.lineno})"
        )
