"""What is done of a long study, one line of JSON each: on the disk at once, at a cost that does not grow."""

import datetime
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jointbayes.errors import CaseError, WriteError, printable
from jointbayes.own_directory import open_regular

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
        with os.fdopen(open_regular(file, os.O_RDWR | os.O_CREAT | os.O_APPEND), "a+b") as stream:
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
        descriptor = open_regular(file, os.O_RDONLY)
    except FileNotFoundError:
        return []
    with os.fdopen(descriptor, "rb") as stream:
        return [_parsed(line) for line in stream.read().split(b"\n")]


def kept_lines(file: Path, head: Mapping[str, str], kind: str, study: str) -> list[Any]:
    """What is done of a study that goes on: all lines but the first, which says what they depend on.

    Parameters
    ----------
    file
        The file; begun where there is none, or no whole line in it.
    head
        What its lines must depend on, part by part.
    kind, study
        What a line is, in the plural, and what it is a part of, for the message.

    Raises
    ------
    CaseError
        If they depend on something else: on what; or if the first line is damaged.
    WriteError
        If the file cannot be begun, or is no regular file.
    """
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
    return rest


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
