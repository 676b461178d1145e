"""Data sets of a universal file: where each begins and ends, in one pass that keeps no data, and the header of a 58.

References
----------
Structural Dynamics Research Lab, University of Cincinnati: Universal File Formats, data sets 58 and 58b.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

from vibrecords.errors import MeasurementError
from vibrecords.formats.table_text import plain_text
from vibrecords.records import Dof, SensorQuantity

#: Specific data types of the format.
AXIS_TYPES: dict[SensorQuantity, int] = {
    "unknown": 0,
    "displacement": 8,
    "velocity": 11,
    "acceleration": 12,
    "force": 13,
}
#: Ordinate types: real single, real double, complex single, complex double.
_TYPES = (2, 4, 5, 6)
#: Function, version and degrees of freedom, columns apart by blanks: whatever the widths of columns, it is read alike.
_DOFS = re.compile(r"(\d+)\s+\d+\s+(\d+)\s+\d+" + r"\s+(\S+)\s+(\d{1,9})\s+([+-]?\d+)" * 2)
_MORE_ID_LINES = 5
#: No FRF has more values, and no count beyond it is worth a multiplication.
_MOST_VALUES = 10**10


class LineError(Exception):
    """A line of a data set that cannot be read; `line` counts those of its header, or those after it, from 0."""

    def __init__(self, line: int, message: str) -> None:
        super().__init__(message)
        self.line = line


@dataclass(frozen=True, slots=True)
class Axis:
    """Specific data type (8 displacement, 11 velocity, 12 acceleration, 13 force, 18 frequency, …) and labels."""

    kind: int
    label: str
    unit: str


@dataclass(frozen=True, slots=True)
class FunctionHeader:
    """What stands above the values of a data set 58.

    Parameters
    ----------
    ids
        The five ID lines.
    function
        1 time response, 4 frequency response, 6 coherence and so on.
    version
        Version or sequence number.
    response, reference
        Degrees of freedom.
    ordinate
        2 and 4 real, 5 and 6 complex; 2 and 5 single precision.
    count
        Values, or pairs of abscissa and value.
    even
        True where no abscissa is stored.
    minimum, increment
        Abscissa where `even`.
    abscissa, numerator, denominator
        Axes.
    byte_order
        ``"<"`` or ``">"`` in a binary data set, empty in text.
    said_bytes
        Bytes of values that a binary header announces; some programs write a wrong number.
    """

    ids: tuple[str, ...]
    function: int
    version: int
    response: Dof
    reference: Dof
    ordinate: int
    count: int
    even: bool
    minimum: float
    increment: float
    abscissa: Axis
    numerator: Axis
    denominator: Axis
    byte_order: str = ""
    said_bytes: int = 0

    @property
    def is_complex(self) -> bool:
        """True for complex ordinates."""
        return self.ordinate in (5, 6)

    @property
    def is_double(self) -> bool:
        """True for double precision."""
        return self.ordinate in (4, 6)

    @property
    def per_value(self) -> int:
        """Numbers stored for each value: one or two, and the abscissa where spacing is uneven."""
        return (2 if self.is_complex else 1) + (0 if self.even else 1)


def body_bytes(header: FunctionHeader) -> int:
    """Bytes of the values of a binary data set.

    The abscissa of uneven spacing is stored as wide as the values by most programs, in single precision by the letter
    of the format; the announced number of bytes tells which.
    """
    width = 8 if header.is_double else 4
    full = header.count * header.per_value * width
    narrow = header.count * (4 + (header.per_value - 1) * width)
    return narrow if not header.even and header.said_bytes == narrow else full


def function_header(lines: list[str], binary: str | bytes | None) -> FunctionHeader:
    """Header of a data set 58 from its eleven lines, and the line of the set's number where it is binary.

    Raises
    ------
    LineError
        If a field is no number or impossible.
    """
    loose = _DOFS.fullmatch(lines[5].strip())
    columns = ((0, 5), (15, 20), (41, 51), (51, 55), (66, 76), (76, 80))
    dof = [int(loose[i]) for i in (1, 2, 4, 5, 7, 8)] if loose else _fields(lines, 5, columns)
    if any(abs(direction) > 6 for direction in (dof[3], dof[5])):
        raise LineError(5, f"found directions {dof[3]} and {dof[5]}; expected -6 to 6; export it again")
    entities = (loose[3], loose[6]) if loose else (lines[5][30:41], lines[5][55:66])
    form = _fields(lines, 6, ((0, 10), (10, 20), (20, 30)))
    minimum, increment = _real(lines, 6, 30, 43), _real(lines, 6, 43, 56)
    ordinate, count, spacing = form
    if ordinate not in _TYPES:
        raise LineError(6, f"found ordinate data type {ordinate}; expected 2, 4, 5 or 6; export it again")
    if not 0 < count <= _MOST_VALUES:
        raise LineError(6, f"found {count} values; expected 1 or more; export the function again")
    if spacing not in (0, 1):
        raise LineError(6, f"found abscissa spacing {spacing}; expected 0 (uneven) or 1 (even); export it again")
    if spacing == 1 and not (math.isfinite(minimum) and math.isfinite(increment) and increment > 0) and count > 1:
        raise LineError(6, f"found abscissa increment {increment:g}; expected it above 0; export it again")
    ids = tuple(line.strip() for line in lines[:5])
    dofs = Dof(_entity(entities[0]), dof[2], dof[3]), Dof(_entity(entities[1]), dof[4], dof[5])
    axes = _axis(lines, 7), _axis(lines, 8), _axis(lines, 9)
    even, (order, stated_bytes) = spacing == 1, _binary(binary)
    return FunctionHeader(
        ids, dof[0], dof[1], *dofs, ordinate, count, even, minimum, increment, *axes, order, stated_bytes
    )


def _fields(lines: list[str], line: int, columns: tuple[tuple[int, int], ...]) -> list[int]:
    text = lines[line].rstrip("\r\n")
    numbers = []
    for first, last in columns:
        field = text[first:last].strip()
        if not re.fullmatch(r"[+-]?\d*", field):
            raise LineError(
                line,
                f"found {field!r} in columns {first + 1} to {last}; expected a whole number; the header is damaged, "
                "export it again",
            )
        numbers.append(int(field) if field.strip("+-") else 0)
    return numbers


def _real(lines: list[str], line: int, first: int, last: int) -> float:
    field = lines[line].rstrip("\r\n")[first:last].strip()
    if re.fullmatch(r"[+-]?[\d.]+[dD][+-]?\d+", field):
        raise LineError(line, f"found {field!r}, an exponent D; expected E in its place; replace D by E in the numbers")
    try:
        return float(field.replace("_", "?") or "0")
    except ValueError:
        raise LineError(
            line, f"found {field!r} in columns {first + 1} to {last}; expected a number; export it again"
        ) from None


def _axis(lines: list[str], line: int) -> Axis:
    kind = _fields(lines, line, ((0, 10),))[0]
    text = lines[line].rstrip("\r\n")
    label, unit = text[26:46], text[47:67]
    if text[46:47].strip():  # longer than its columns: the unit is what comes last
        label, _, unit = text[26:].rstrip().rpartition(" ")
    elif unit[19:].strip():
        unit += text[67:].partition(" ")[0]
    return Axis(kind, _entity(label), _entity(unit))


def _entity(text: str) -> str:
    text = text.strip()
    return "" if text.upper() == "NONE" else text


def _binary(line: str | bytes | None) -> tuple[str, int]:
    if line is None:
        return "", 0
    text = line.decode("ascii", errors="replace") if isinstance(line, bytes) else line
    fields = (text[7:13].strip(), text[13:19].strip(), text[19:31].strip(), text[31:43].strip())
    if not all(re.fullmatch(r"\d*", field) for field in fields):
        raise LineError(0, f"found {text.strip()[:40]!r} as binary header; expected numbers; export it again")
    order, form, _, stated_bytes = (int(field or 0) for field in fields)
    if order not in (1, 2) or form not in (0, 2):
        raise LineError(
            0,
            f"found byte order {order} and floating-point format {form}; expected 1 or 2, and 2 (IEEE 754); export as "
            "IEEE numbers or as text",
        )
    return "<" if order == 1 else ">", stated_bytes


_CHUNK = 1 << 16
_LONGEST_LINE = 4096
#: DOS ends a text with Ctrl-Z.
_DELIMITER = re.compile(rb"[ \t]*-1[ \t\x1a]*\r?\n?")
_CLOSING = re.compile(rb"\n[ \t]*-1[ \t\x1a]*(?:\r?\n|\r?$)")
#: Where the first data set begins: lines above it say what the program that wrote the file was.
BEGINNING = re.compile(rb"^[ \t]*-1[ \t]*\r?\n[ \t]*\d{2,6}(?:[ \t]*|[bB][ \d]*)\r?$", re.MULTILINE)
#: A delimiter with its blanks up to column 80 and both line ends is no longer.
_OVERLAP = 128


@dataclass(frozen=True, slots=True)
class UffDataSet:
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


def scan(file: BinaryIO) -> Iterator[UffDataSet]:
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
        if not line.strip(b" \t\r\n\x1a") or (number == 0 and not _DELIMITER.fullmatch(line)):
            continue
        if not _DELIMITER.fullmatch(line):
            raise MeasurementError(
                f"line {line_of(file, here)}: found {_shown(line)} between data sets; expected the delimiter -1; "
                "the file is damaged or cut off, export it again"
            )
        number += 1
        yield _data_set(file, number)


def _data_set(file: BinaryIO, number: int) -> UffDataSet:
    here = file.tell()
    line = file.readline(_LONGEST_LINE)
    match = re.match(rb"[ \t]*(\d{1,6})([bB]?)(?=\s|$)", line)
    if match is None:
        actual = "the end of the file" if not line else _shown(line)
        raise MeasurementError(
            f"data set {number}, line {line_of(file, here)}: found {actual}; expected the number of the data set's "
            "type, such as 58; the file is damaged or cut off, export it again"
        )
    kind, binary = int(match[1]), bool(match[2])
    start = file.tell()
    if kind != 58:
        return UffDataSet(number, kind, start, _closing(file, number, start - 1))
    header = _header(file, number, line if binary else None)
    start = file.tell()
    if not binary:
        # the line end of the header may be the one before the delimiter
        return UffDataSet(number, kind, start, _closing(file, number, start - 1), header)
    stop = start + body_bytes(header)
    file.seek(stop)
    end = re.match(rb"\r?\n?[ \t]*-1[ \t\x1a]*(?:\r?\n|$)", file.read(_OVERLAP))
    if end is None:
        raise MeasurementError(
            f"data set {number}, line {line_of(file, here)}: found no delimiter -1 after the {body_bytes(header)} "
            f"bytes of {header.count} values; expected it there; the file is cut off or its counts are wrong, export "
            "it again"
        )
    file.seek(stop + end.end())
    return UffDataSet(number, kind, start, stop, header)


def _header(file: BinaryIO, number: int, binary: bytes | None) -> FunctionHeader:
    """Header of a data set 58 from the eleven lines at the position of the file, or more where ID lines are more."""
    at: list[int] = []
    lines: list[str] = []
    fault = None
    while len(lines) < 11 + _MORE_ID_LINES:
        at.append(file.tell())
        line = file.readline(_LONGEST_LINE)
        if not line.endswith(b"\n") or _DELIMITER.fullmatch(line):
            words = f"found {len(lines)} lines of header; expected 11; the file is cut off, export it again"
            fault = fault or (at[-1], words)
            break
        lines.append(plain_text(line))
        if len(lines) < 11:
            continue
        try:
            return function_header(lines[:5] + lines[-6:], binary)
        except LineError as error:
            fault = fault or (at[error.line], str(error))
            if error.line != 5:
                break
    assert fault is not None
    raise MeasurementError(f"data set {number}, line {line_of(file, fault[0])}: {fault[1]}")


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
