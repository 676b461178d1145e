"""Where the data sets of a universal file begin and end, in one pass that keeps no data."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

from jointbayes.errors import MeasurementError
from jointbayes.measurement.formats.uff.header import FieldError, FunctionHeader, body_bytes, function_header

_CHUNK = 1 << 16
_LONGEST_LINE = 4096
_DELIMITER = re.compile(rb"[ \t]*-1[ \t]*\r?\n?")
_CLOSING = re.compile(rb"\n[ \t]*-1[ \t]*(?:\r?\n|\r?$)")
#: A delimiter with its blanks up to column 80 and both line ends is no longer.
_OVERLAP = 128


@dataclass(frozen=True, slots=True)
class DataSet:
    """A data set of a universal file.

    Parameters
    ----------
    number
        Counted from 1.
    kind
        Number of the data set's type, such as 58.
    start, stop
        First byte of its content and of its closing delimiter.
    header
        Header of a data set 58, None for other types.
    """

    number: int
    kind: int
    start: int
    stop: int
    header: FunctionHeader | None = None


def line_of(file: BinaryIO, offset: int) -> int:
    """Line of the file, counted from 1, in which a byte stands."""
    file.seek(0)
    line = 1
    while offset > 0 and (chunk := file.read(min(offset, _CHUNK))):
        line += chunk.count(b"\n")
        offset -= len(chunk)
    return line


def scan(file: BinaryIO) -> Iterator[DataSet]:
    """Data sets of a universal file in their order.

    Raises
    ------
    MeasurementError
        If a data set has no end, text stands between data sets, or a header cannot be read.
    """
    number = 0
    if file.read(3) != b"\xef\xbb\xbf":
        file.seek(0)
    while True:
        here = file.tell()
        line = file.readline(_LONGEST_LINE)
        if not line:
            return
        if not line.strip():
            continue
        if not _DELIMITER.fullmatch(line):
            raise MeasurementError(
                f"line {line_of(file, here)}: found {_shown(line)} between data sets; expected the delimiter -1; "
                "the file is damaged or cut off, export it again"
            )
        number += 1
        yield _data_set(file, number)


def _data_set(file: BinaryIO, number: int) -> DataSet:
    here = file.tell()
    line = file.readline(_LONGEST_LINE)
    match = re.match(rb"[ \t]*(\d{1,6})([bB]?)(?=\s|$)", line)
    if match is None:
        found = "the end of the file" if not line else _shown(line)
        raise MeasurementError(
            f"data set {number}, line {line_of(file, here)}: found {found}; expected the number of the data set's "
            "type, such as 58; the file is damaged or cut off, export it again"
        )
    kind, binary = int(match[1]), bool(match[2])
    start = file.tell()
    if kind != 58:
        return DataSet(number, kind, start, _closing(file, number, start))
    header = _header(file, number, line if binary else None)
    start = file.tell()
    if not binary:
        # the line end of the header may be the one before the delimiter
        return DataSet(number, kind, start, _closing(file, number, start - 1), header)
    stop = start + body_bytes(header)
    file.seek(stop)
    tail = file.read(_OVERLAP)
    end = re.match(rb"\r?\n?[ \t]*-1[ \t]*(?:\r?\n|$)", tail)
    if end is None:
        raise MeasurementError(
            f"data set {number}, line {line_of(file, here)}: found no delimiter -1 after the {body_bytes(header)} "
            f"bytes of {header.count} values; expected it there; the file is cut off or its counts are wrong, export "
            "it again"
        )
    file.seek(stop + end.end())
    return DataSet(number, kind, start, stop, header)


def _header(file: BinaryIO, number: int, binary: bytes | None) -> FunctionHeader:
    """Header of a data set 58 from the eleven lines at the position of the file."""
    at, lines = [], []
    for _ in range(11):
        at.append(file.tell())
        lines.append(file.readline(_LONGEST_LINE))
        if not lines[-1].endswith(b"\n") or _DELIMITER.fullmatch(lines[-1]):
            raise MeasurementError(
                f"data set {number}, line {line_of(file, at[-1])}: found {len(lines) - 1} lines of header; expected "
                "11; the file is cut off, export it again"
            )
    try:
        return function_header([line.decode("utf-8", errors="replace") for line in lines], binary)
    except FieldError as error:
        raise MeasurementError(f"data set {number}, line {line_of(file, at[error.line])}: {error}") from None


def _closing(file: BinaryIO, number: int, start: int) -> int:
    """Offset of the closing delimiter; leaves the file behind it."""
    file.seek(start)
    base, buffer = start, b""
    while True:
        chunk = file.read(_CHUNK)
        buffer += chunk
        match = _CLOSING.search(buffer)
        # a match that reaches the end of what was read may be a longer line, such as " -1 …"
        if match is not None and (match.end() < len(buffer) or not chunk or match[0].endswith(b"\n")):
            file.seek(base + match.end())
            return base + match.start() + 1
        if not chunk:
            raise MeasurementError(
                f"data set {number}, line {line_of(file, base + len(buffer))}: found the end of the file; expected the "
                "delimiter -1 that ends the data set; the file is cut off, export it again"
            )
        keep = min(len(buffer), _OVERLAP)
        base += len(buffer) - keep
        buffer = buffer[len(buffer) - keep :]


def _shown(line: bytes) -> str:
    return repr(line[:30].decode("ascii", errors="replace").strip())
