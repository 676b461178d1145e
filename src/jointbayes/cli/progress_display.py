"""What commands print of their progress: stages with the time so far, and a bar, or lines now and then, of counts."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from jointbayes.cli.output import say
from jointbayes.errors import printable
from jointbayes.progress import Progress, ProgressCallback

_BEGIN = time.monotonic()

_LINES_AT_LEAST_APART = 5.0  # seconds
_LINES_OF_A_STAGE = 60  # about so many in the second half of a long one


def show_stage(progress: Progress, *, on_terminal_only: bool = False) -> None:
    """Print a stage that begins, with the seconds since the program did, on standard error.

    Until the input is read only on a terminal: elsewhere what is wrong with it is the one line that is printed.
    """
    if on_terminal_only and not sys.stderr.isatty():
        return
    say(f"{time.monotonic() - _BEGIN:6.1f} s  {progress}", err=True)


@contextmanager
def show_progress() -> Iterator[ProgressCallback]:
    """Yield the callback that a command reports to; all of it goes to standard error."""
    if not sys.stderr.isatty():
        yield _print_lines()
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("{task.fields[stage]}", markup=False), BarColumn(), TimeElapsedColumn(),
               TextColumn("{task.description}", markup=False))  # fmt: skip
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:

        def report(progress: Progress) -> None:
            if progress.total is None:
                show_stage(progress)
                return
            if not bar.tasks or bar.tasks[-1].fields["stage"] != progress.stage:
                for task in bar.tasks:
                    bar.remove_task(task.id)
                bar.add_task("", total=None, stage=progress.stage)
            bar.update(
                bar.tasks[-1].id,
                completed=progress.done,
                total=progress.total,
                description=printable(progress.details),
            )

        yield report


def _print_lines() -> ProgressCallback:
    """A callback that prints counts where they begin and end, and from time to time."""
    last, stage = 0.0, ""

    def report(progress: Progress) -> None:
        nonlocal last, stage
        now = time.monotonic()
        if progress.total is None:
            show_stage(progress)
        elif (
            progress.stage != stage
            or progress.done >= progress.total
            or now - last >= max(_LINES_AT_LEAST_APART, progress.elapsed_seconds / _LINES_OF_A_STAGE)
        ):
            last, stage = now, progress.stage
            say(str(progress), err=True)

    return report
