"""The directory of a study: what is done of it, one line of JSON each and on the disk at once, and its report."""

import datetime
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from jointbayes.errors import CaseError, WriteError
from jointbayes.inference import Problem
from jointbayes.posterior import package_versions
from jointbayes.report import Report
from jointbayes.report.markup import foreign
from jointbayes.report.model import Figure, ReportSection, Table
from jointbayes.report.run_directory import write_into
from jointbayes.report.structure_sketch import sketch
from vibrecords.errors import printable
from vibrecords.files import OwnDirectory, open_regular

T = TypeVar("T")

_SHOWN = 3  # differences in a message


def append_line(file: Path, value: object) -> None:
    """Append one line and force it to the disk; one that was cut off before it stays a line of its own.

    Parameters
    ----------
    file
        The file, made if there is none.
    value
        JSON, or with dates, which become text.

    Raises
    ------
    WriteError
        If it cannot be written.
    """
    line = json.dumps(value, default=datetime.datetime.isoformat).encode() + b"\n"
    try:
        with open_regular(file, "a+b") as stream:
            if stream.tell():
                stream.seek(-1, os.SEEK_END)
                line = line if stream.read(1) == b"\n" else b"\n" + line
            stream.write(line)
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as error:
        raise WriteError(
            f"{file}: found that it cannot be written ({error.strerror or error}); expected a place with room; make "
            "room, and start again: what is done is not done again"
        ) from error


def read_lines(file: Path) -> list[Any]:
    """What each line holds, in order, and None of one that was cut off; nothing where there is no file.

    Raises
    ------
    WriteError
        If it is a link, a pipe or a device, which might never end.
    """
    try:
        with open_regular(file, "rb") as stream:
            return [_parsed(line) for line in stream.read().split(b"\n")]
    except FileNotFoundError:
        return []


def kept_lines(file: Path | None, head: Mapping[str, str], line_type: type[T], kind: str, study: str) -> list[T]:
    """What is done of a study that goes on: all lines but the first, which says what they depend on.

    A line that was cut off, or holds something else, is left out: what it stands for is done again.

    Parameters
    ----------
    file
        The file; begun where there is none, or no whole line in it. Nothing is kept in None.
    head
        What its lines must depend on, part by part.
    line_type
        What each further line holds: a dataclass.
    kind, study
        What a line is, in the plural, and what it is a part of, for the message.

    Raises
    ------
    CaseError
        If they depend on something else: on what; or if the first line is damaged.
    WriteError
        If the file cannot be begun, or is no regular file.
    """
    if file is None:
        return []
    stored_head, *rest = read_lines(file) or [None]
    if stored_head is None and all(line is None for line in rest):
        file.unlink(missing_ok=True)
        append_line(file, dict(head))
    elif stored_head != head:
        what = "whose first line is damaged" if stored_head is None else f"of another {_difference(stored_head, head)}"
        raise CaseError(
            f"{file}: found {kind} {what}; expected those of this {study}; choose "
            "another --out, or delete the directory"
        )
    adapter, kept = TypeAdapter(line_type), []
    for line in rest:
        with suppress(ValidationError):
            kept.append(adapter.validate_python(line))
    return kept


def _difference(stored_head: Any, head: Mapping[str, Any]) -> str:  # noqa: ANN401 (whatever JSON the file holds)
    if not isinstance(stored_head, dict):
        return "kind"
    names = sorted(name for name in {*head, *stored_head} if stored_head.get(name) != head.get(name))
    return " and ".join(printable(name) for name in names[:_SHOWN]) + (" and more" if len(names) > _SHOWN else "")


def _parsed(line: bytes) -> Any:  # noqa: ANN401 (any JSON)
    try:
        return json.loads(line)
    except ValueError:
        return None


def sketch_figure(tested: Problem | None) -> tuple[Figure, ...]:
    """The sketch of a test as a figure of a study's page; none where nobody knows what its structure looks like."""
    drawing, text = sketch(tested) if tested else "", "The structure with its joint, sensors and force."
    return (Figure("structure", text, text, drawing),) if drawing else ()


def settings_section(*settings: tuple[str, str]) -> ReportSection:
    """The last section of a study's page: settings by name, and the version of all that its numbers depend on."""
    versions = [(foreign(name), foreign(version)) for name, version in package_versions().items()]
    table = Table("Settings and versions", ("Item", "Value"), (*settings, *versions), align="ll")
    return ReportSection("settings", "Settings", (table,))


def write_study(directory: str | os.PathLike[str], kind: str, report: Report, files: Mapping[str, str]) -> Path:
    """Write the report of a study into its directory, and the files in their order, each whole or absent.

    Parameters
    ----------
    directory
        New, or of an earlier start.
    kind
        What the directory holds: ``"a plan"``.
    report
        ``report.html``, ``report.pdf`` and ``figures/*.svg``.
    files
        Text of further files by name; the last one tells that all are there.

    Raises
    ------
    WriteError
        If a file cannot be written, the directory holds something else, or another process is at work in it.
    """
    with OwnDirectory(directory, kind) as locked:
        write_into(locked.path, report, files)
    return locked.path
