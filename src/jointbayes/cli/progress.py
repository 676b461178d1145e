"""Progress of a run: its phases with the time so far, and of sampling a bar on a terminal, plain lines elsewhere."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from jointbayes.cli.output import say

if TYPE_CHECKING:
    from jointbayes.sampling import Progress
    from jointbayes.studies.calibrate import CalibrationProgress


_BEGIN = time.monotonic()

_LINES_AT_LEAST_APART = 5.0  # seconds


def show_phase(name: str, *, on_terminal_only: bool = False) -> None:
    """Print the name of a phase that begins, with the seconds since the program did, on standard error.

    Until the input is read only on a terminal: elsewhere what is wrong with it is the one line that is printed.
    """
    if on_terminal_only and not sys.stderr.isatty():
        return
    say(f"{time.monotonic() - _BEGIN:6.1f} s  {name}", err=True)


@contextmanager
def show_progress() -> Iterator[Callable[["Progress"], None]]:
    """Yield the callback that a run reports to; all of it goes to standard error."""
    if not sys.stderr.isatty():
        yield _plain()
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("sampling"), BarColumn(), TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(),
               TextColumn("{task.description}"))  # fmt: skip
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)

        def report(progress: "Progress") -> None:
            bar.update(task, completed=progress.steps, total=progress.expected_steps, description=_figures(progress))

        yield report


def _plain() -> Callable[["Progress"], None]:
    last = -_LINES_AT_LEAST_APART

    def report(progress: "Progress") -> None:
        nonlocal last
        if progress.elapsed_seconds - last >= _LINES_AT_LEAST_APART or progress.steps >= progress.expected_steps:
            last = progress.elapsed_seconds
            left = progress.elapsed_seconds * (progress.expected_steps / progress.steps - 1)
            say(
                f"sampling: step {progress.steps} of about {progress.expected_steps}, {_figures(progress)}, "
                f"{progress.elapsed_seconds:.0f} s so far, about {left:.0f} s left",
                err=True,
            )

    return report


def _figures(progress: "Progress") -> str:
    return f"τ = {progress.tau:.0f}, R̂ = {progress.r_hat:.3f}"


def show_calibration() -> Callable[["CalibrationProgress"], None]:
    """Give the callback that a calibration reports to: a line on standard error from time to time."""
    began = last = time.monotonic()

    def report(progress: "CalibrationProgress") -> None:
        nonlocal last
        now, fresh = time.monotonic(), progress.done - progress.before
        if fresh and progress.done < progress.count and now - last < _LINES_AT_LEAST_APART:
            return
        last = now
        left = f", about {(now - began) / fresh * (progress.count - progress.done):.0f} s left" if fresh else ""
        say(f"{progress.done} of {progress.count} data sets{left}", err=True)

    return report


def show_steps() -> Callable[[str], None]:
    """Give the callback for lines of text: printed at once where they begin anew, else from time to time.

    Lines that are alike up to their colon are of the same step.
    """
    last, step = 0.0, ""

    def report(line: str) -> None:
        nonlocal last, step
        now, name = time.monotonic(), line.partition(":")[0]
        if name != step or now - last >= _LINES_AT_LEAST_APART:
            last, step = now, name
            say(line, err=True)

    return report
