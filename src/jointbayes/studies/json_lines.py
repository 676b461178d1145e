"""What is done of a long study, one line of JSON each: on the disk at once, at a cost that does not grow."""

import datetime
import json
import os
from pathlib import Path
from typing import Any

from jointbayes.errors import WriteError
from jointbayes.own_directory import open_regular

__all__ = ["append_line", "read_lines"]


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
    """What each line holds, in order, and None of one that was cut off; nothing where there is no file."""
    return [_parsed(line) for line in file.read_bytes().split(b"\n")] if file.exists() else []


def _parsed(line: bytes) -> Any:  # noqa: ANN401 (any JSON)
    try:
        return json.loads(line)
    except ValueError:
        return None
