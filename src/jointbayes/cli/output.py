"""What commands print: one way out, on which nothing in a foreign name steers the terminal and no line is endless."""

import io
import json
import os
import re
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

import click

from vibrecords.errors import printable

#: Characters of a warning that stands on one line; a longer one takes two. No message is cut: the terminal wraps it.
LONGEST = 200
_SHOWN_BYTES = 1e7  # no line of a larger file is shown
#: A name, a path from here, and one from the root that no system takes.
_LONG_NAME = re.compile(r"[^\s/]{200,}|(?<!\S)[^\s/]\S{300,}|\S{1000,}")
_VALUE = r"\s*=\s*(?:\[[^\]]*\]?|\{[^}]*\}?|\"[^\"]*\"?|[^,}#\s]*)"
_FAULT = re.compile(r"(?P<file>.+?):(?P<line>\d+): (?P<key>\S.*?): (?P<message>.*)")


@dataclass
class Manner:
    """How the command that runs was asked to speak and to end, and what it has to say where that is one JSON object."""

    quiet: bool = False
    verbose: bool = False
    json: bool = False
    open: bool = False
    allow_outside: bool = False
    force: bool = False
    read: list[Path] = field(default_factory=list)  # what must not be written over
    written: Path | None = None
    unfinished: str = "nothing was written"
    told: dict[str, Any] = field(default_factory=lambda: {"messages": [], "warnings": [], "errors": []})
    result: dict[str, Any] = field(default_factory=dict)


def manner() -> Manner:
    """How the command that runs speaks."""
    context = click.get_current_context(silent=True)
    return Manner() if context is None else context.meta.setdefault("jointbayes.manner", Manner())


def manner_option(flag: str, words: str) -> Callable[[Any], Any]:
    """An option without a value that is kept in `Manner`."""

    def keep(_context: click.Context, option: click.Parameter, value: bool) -> None:
        setattr(manner(), str(option.name), value)

    return click.option(flag, is_flag=True, expose_value=False, callback=keep, help=words)


#: Options of every command.
EVERYWHERE = (
    manner_option("--quiet", "No progress: only results, warnings and errors."),
    manner_option("--verbose", "Why each verdict is what it is, and the time that each stage of a run took."),
    manner_option("--json", "Print one JSON object on standard output; progress stays on standard error."),
)
open_option = manner_option("--open", "Open the report in the browser.")


def shortened(text: str) -> str:
    """Return a message in which of each endless name only both ends stay; no other part is cut."""
    return _LONG_NAME.sub(lambda name: f"{name[0][:40]}…{name[0][-30:]}", text)


def say(*lines: str, err: bool = False, whole: bool = False) -> None:
    """Print lines on standard output, or on standard error.

    Characters that do not print are escaped, and endless names are shortened unless the line is to stay `whole`. A
    closed standard error, as in ``2>&1 | head -1``, is no reason to lose a run: what follows for it is dropped. Where
    the command prints JSON, what is for standard output becomes a part of that.

    Raises
    ------
    BrokenPipeError
        If standard output is not read any more; `commands` ends quietly then.
    """
    how = manner()
    if how.json and not err:
        how.told["messages"] += lines
        return
    show_status("")
    for line in lines:
        _write(printable(line) if whole else shortened(printable(line)), err=err)


def _write(text: str, *, err: bool, nl: bool = True) -> None:
    try:
        click.echo(text, err=err, nl=nl)
    except OSError as error:
        if err:
            let_go(sys.stderr)
        elif isinstance(error, BrokenPipeError):
            raise
        else:
            raise OSError(error.errno, error.strerror, "standard output") from error


_shown = 0  # characters of the line that is updated on the terminal


def show_status(text: str) -> None:
    """Put a text in the place of the line that is updated on a terminal; an empty one removes it."""
    global _shown
    text = printable(text)[: shutil.get_terminal_size().columns - 1]
    if text or _shown:
        _write(f"\r{text.ljust(_shown)}\r{text}", err=True, nl=False)
        _shown = len(text)


def warn(found: str, advice: str = "", *, code: str, file: str = "", line: int = 0, key: str = "") -> None:
    """Print a warning on standard error, in two lines where it is long, and keep it for JSON.

    Parameters
    ----------
    found
        What was found.
    advice
        What is expected and what to do.
    code
        Kind of the warning, by which programs know it.
    file, line, key
        Where it was found, if that is one place of a file.
    """
    message = "; ".join(filter(None, (found, advice)))
    place = {"file": file, "line": line, "key": key} if file else {}
    manner().told["warnings"].append({"code": code, **place, "message": message})
    where = f"jointbayes: warning: {f'{file}:{line}: {key}: ' if file else ''}"
    if len(where) + len(message) <= LONGEST:
        say(f"{where}{message}", err=True)
        return
    say(f"{where}{found}", err=True)
    if advice:
        say(f"    {advice}", err=True)


def fail(faults: str, *, show_source: bool = False, whole: bool = False) -> None:
    """Print what ended a command, a line for each fault; on a terminal, or if told so, with the line of the file.

    Names are shortened unless the message is to stay `whole`, as one that says where hours of work are kept.
    """
    for number, fault in enumerate(faults.split("\n")):
        manner().told["errors"].append(located(fault))
        say(f"{'' if number else 'jointbayes: '}{fault}", err=True, whole=whole)
        say(*(source_lines(fault) if show_source or sys.stderr.isatty() else ()), err=True)


def located(message: str) -> dict[str, Any]:
    """File, line, key and text of a fault or a warning; its text alone where it names no line."""
    place = _FAULT.fullmatch(message)
    return {**place.groupdict(), "line": int(place["line"])} if place else {"message": message}


def source_lines(fault: str) -> list[str]:
    """The line of a file that a fault names, and one that underlines its key with the value; none without a line."""
    place = located(fault)
    try:
        file = Path(place["file"])
        is_shown = file.is_file() and file.stat().st_size < _SHOWN_BYTES
        rows = file.read_text(encoding="utf-8-sig").split("\n") if is_shown else []
        row = printable(rows[place["line"] - 1].rstrip().expandtabs(4))[: LONGEST - 10]
    except (KeyError, OSError, ValueError, IndexError):
        return []
    spot, at, names = re.search(r"\S.*|$", row), 0, re.findall(r'"(?:[^"\\]|\\.)*"|[^.]+', place["key"])
    for number, name in enumerate(names, 1):  # each inside the one before, where that stands in this line
        word = re.escape(name.strip('"'))
        found = re.compile(rf"(?<!\w)[\"']?{word}[\"']?(?!\w)({_VALUE})?").search(row, at)
        if found and (found[1] or number == len(names)):
            spot, at = found, found.start() + 1
    begin, end = spot.span() if spot else (0, 0)
    return [f"{place['line']:>6} | {row}", f"{'':>6} | {' ' * begin}{'^' * (end - begin)}"]


def print_json(whole: Any) -> None:  # noqa: ANN401 (what JSON knows)
    """Print one JSON object."""
    from jointbayes.rounding import json_ready

    _write(json.dumps(json_ready(whole), indent=2, allow_nan=False), err=False)  # in ASCII, which steers no terminal


def report_written(directory: Path) -> None:
    """Say where the report is, and open it where that was asked for."""
    page = directory / "report.html"
    manner().result["report"] = str(page)
    say(f"Report: {page} and {directory / 'report.pdf'}")
    if manner().open:
        click.launch(str(page))


def open_closed_streams() -> None:
    """Put a stream that goes nowhere in the place of one that is closed, as by ``2>&-``, for all that writes to it."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_WRONLY)  # at the lowest free number, mostly its own
            os.set_inheritable(nowhere, True)
            setattr(sys, name, io.TextIOWrapper(io.FileIO(nowhere, "w"), encoding="utf-8"))


def is_closed(stream: TextIO) -> bool:
    """True if the stream is a pipe or socket that is not read any more."""
    import select

    try:
        poll = select.poll()
        poll.register(stream.fileno(), 0)  # POLLERR and POLLHUP are always told
        return bool(poll.poll(0))
    except (AttributeError, OSError, ValueError):  # no poll on this system, no file behind the stream
        return False


def let_go(stream: TextIO) -> None:
    """Drop what is still written to a stream that is not read, also when Python flushes it at its end."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, stream.fileno())
    except (OSError, ValueError):
        pass  # no file behind the stream
    finally:
        os.close(nowhere)
