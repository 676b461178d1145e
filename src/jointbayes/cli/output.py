"""What commands print: one way out, on which nothing in a foreign name steers the terminal."""

import os
import sys
from typing import TextIO

import click

from jointbayes.errors import printable


def say(line: str, *, err: bool = False) -> None:
    """Print a line on standard output, or on standard error.

    Characters that do not print are escaped. A closed standard error, as in ``2>&1 | head -1``, is no reason to lose a
    run: what follows for it is dropped.

    Raises
    ------
    BrokenPipeError
        If nobody reads standard output any more; `commands` ends quietly then.
    """
    try:
        click.echo(printable(line), err=err)
    except BrokenPipeError:
        if not err:
            raise
        let_go(sys.stderr)


def is_closed(stream: TextIO) -> bool:
    """True if the stream is a pipe or socket that nobody reads any more."""
    import select

    try:
        poll = select.poll()
        poll.register(stream.fileno(), 0)  # POLLERR and POLLHUP are always told
        return bool(poll.poll(0))
    except (AttributeError, OSError, ValueError):  # no poll on this system, no file behind the stream
        return False


def let_go(stream: TextIO) -> None:
    """Drop what is still written to a stream that nobody reads, also when Python flushes it at its end."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, stream.fileno())
    except (OSError, ValueError):
        pass  # no file behind the stream
    finally:
        os.close(nowhere)
