"""What commands print of their progress: on a terminal one line that is updated, elsewhere lines now and then."""

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from jointbayes.cli.output import manner, say, show_status
from jointbayes.progress import Progress, ProgressCallback, tell_nobody

_BEGIN = time.monotonic()
_stages: list[tuple[str, float]] = []  # those that began, each with the processor time of the program until then, s

_LINES_AT_LEAST_APART = 5.0  # seconds
_LINES_OF_A_STAGE = 60  # about so many in the second half of a long one


def _processor_seconds() -> float:
    """Processor time of the program so far, its imports and the processes that it started and that ended included."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def _note(stage: str) -> None:
    if not _stages or _stages[-1][0] != stage:
        _stages.append((stage, _processor_seconds()))


def say_stages() -> None:
    """Print the processor time of each stage on standard error, where --verbose asks for it."""
    if not manner().verbose:
        return
    spent, ends = dict[str, float](), [began for _, began in _stages[1:]] + [_processor_seconds()]
    for (stage, began), end in zip(_stages, ends, strict=True):
        spent[stage] = spent.get(stage, 0.0) + end - began
    starting = {"starting": _stages[0][1]} if _stages else {}
    for stage, seconds in (starting | spent).items():
        say(f"{seconds:6.1f} s of processor time  {stage}", err=True)


def show_stage(progress: Progress, *, on_terminal_only: bool = False) -> None:
    """Show a stage that begins, with the seconds since the program did, on standard error.

    Until the input is read only on a terminal: elsewhere what is wrong with it is the one line that is printed.
    """
    text = f"{time.monotonic() - _BEGIN:6.1f} s  {progress}"
    _note(progress.stage)
    if manner().quiet:
        return
    if sys.stderr.isatty():
        show_status(text)
    elif not on_terminal_only:
        say(text, err=True)


@contextmanager
def show_progress() -> Iterator[ProgressCallback]:
    """Yield the callback that a command reports to; all of it goes to standard error."""
    yield tell_nobody if manner().quiet else show_stage if sys.stderr.isatty() else _print_lines()
    show_status("")


def _print_lines() -> ProgressCallback:
    """A callback that prints counts where they begin and end, and from time to time."""
    last, stage = 0.0, ""

    def report(progress: Progress) -> None:
        nonlocal last, stage
        now = time.monotonic()
        _note(progress.stage)
        if progress.total is None:
            last, stage = now, progress.stage
            show_stage(progress)
        elif (
            progress.stage != stage
            or progress.done >= progress.total
            or now - last >= max(_LINES_AT_LEAST_APART, progress.elapsed_seconds / _LINES_OF_A_STAGE)
        ):
            last, stage = now, progress.stage
            say(str(progress), err=True)

    return report
