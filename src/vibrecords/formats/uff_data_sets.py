"""Universal files (UFF, UNV): data sets 58, 58b and 55, with headers 151 and 164, streamed.

Where each begins and ends is found in one pass that keeps no data. Values of a 58 are columns of fixed width in text or
IEEE numbers in binary, with their units; modes are those of a 55.

Why not pyuff: it holds the whole file in memory, names no line, reads garbled header fields as zero and replaces NaN.
The tests read its files and have it read ours.

References
----------
Structural Dynamics Research Lab, University of Cincinnati: Universal File Formats, data sets 55, 58 and 58b.
"""

import io
import math
import re
from array import array
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import accumulate
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np

from vibrecords.arrays import Array, ComplexArray, Quantity, SensorQuantity
from vibrecords.errors import MeasurementError, refusal, require_at_most
from vibrecords.formats.names import NAMES, WINDOW_NOTE, float_of, stated_decay_rate
from vibrecords.formats.table_text import axis_role, bad_number, plain_text
from vibrecords.formats.units import MOTION_OF, TIME_S, frf_unit, hertz_factor, read_frf_unit, read_sensor_unit, scaled
from vibrecords.records import (
    MOST_BYTES,
    MOST_RECORDS,
    CoherenceRecord,
    Dof,
    FrfRecord,
    ModeRecord,
    Record,
    SpectrumRecord,
    TimeRecord,
    coherence_on,
    dof_label,
    even_rate,
    refuse_damage,
)

#: Specific data types of the format.
AXIS_TYPES: dict[SensorQuantity, int] = {"displacement": 8, "velocity": 11, "acceleration": 12, "force": 13}
#: Ordinate types: real single, real double, complex single, complex double.
_TYPES = (2, 4, 5, 6)
#: Function, version and degrees of freedom, columns apart by blanks: columns of any width are read alike.
_DOFS = re.compile(r"(\d+)\s+\d+\s+\d+\s+\d+" + r"\s+(\S+)\s+(\d{1,9})\s+([+-]?\d+)" * 2)
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
    """Specific data type (8 displacement, 11 velocity, 12 acceleration, 13 force, 18 frequency, …) and unit."""

    kind: int
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
        return 2 + self.is_complex - self.even

    def said(self, key: str) -> str:
        """What an ID line has behind a key, as our writer leaves it; empty where none begins with it."""
        return next((line.removeprefix(key) for line in self.ids if line.startswith(key)), "")

    @property
    def row(self) -> np.dtype[Any]:
        """What a binary data set stores of each value: its abscissa where spacing is uneven, and one number or two.

        Most programs store the abscissa as wide as the values, the letter of the format is in single precision; the
        announced number of bytes tells which.
        """
        wide, single = (f"{self.byte_order}f{size}" for size in (8 if self.is_double else 4, 4))
        full, narrow = (np.dtype([("x", x, 1 - self.even), ("y", wide, 1 + self.is_complex)]) for x in (wide, single))
        return narrow if self.said_bytes == self.count * narrow.itemsize else full


def function_header(lines: list[str], binary: bytes | None) -> FunctionHeader:
    """Header of a data set 58 from its eleven lines, and the line of the set's number where it is binary.

    Raises
    ------
    LineError
        If a field is no number or impossible.
    """
    loose = _DOFS.fullmatch(lines[5].strip())
    columns = ((0, 5), (41, 51), (51, 55), (66, 76), (76, 80))
    function, *dof = [int(loose[i]) for i in (1, 3, 4, 6, 7)] if loose else _fields(lines, 5, columns)
    if any(abs(direction) > 6 for direction in dof[1::2]):
        raise LineError(5, f"found directions {dof[1]} and {dof[3]}; expected -6 to 6; export it again")
    entities = (loose[2], loose[5]) if loose else (lines[5][30:41], lines[5][55:66])
    ordinate, count, spacing = _fields(lines, 6, ((0, 10), (10, 20), (20, 30)))
    minimum, increment = _real(lines, 6, 30, 43), _real(lines, 6, 43, 56)
    if ordinate not in _TYPES:
        raise LineError(6, f"found ordinate data type {ordinate}; expected 2, 4, 5 or 6; export it again")
    if not 0 < count <= _MOST_VALUES:
        raise LineError(6, f"found {count} values; expected 1 or more; export the function again")
    if spacing not in (0, 1):
        raise LineError(6, f"found abscissa spacing {spacing}; expected 0 (uneven) or 1 (even); export it again")
    if spacing == 1 and not (math.isfinite(minimum) and math.isfinite(increment) and increment > 0) and count > 1:
        raise LineError(6, f"found abscissa increment {increment:g}; expected it above 0; export it again")
    ids = tuple(line.strip() for line in lines[:5])
    dofs = Dof(_entity(entities[0]), dof[0], dof[1]), Dof(_entity(entities[1]), dof[2], dof[3])
    axes = _axis(lines, 7), _axis(lines, 8), _axis(lines, 9)
    order, size = 0, 0
    if binary is not None:
        text = binary.decode("ascii", errors="replace")
        fields = (text[7:13].strip(), text[13:19].strip(), text[19:31].strip(), text[31:43].strip())
        if not all(re.fullmatch(r"\d*", field) for field in fields):
            raise LineError(0, f"found {text.strip()[:40]!r} as binary header; expected numbers; export it again")
        order, floating, _, size = (int(field or 0) for field in fields)
        if order not in (1, 2) or floating not in (0, 2):
            found = f"found byte order {order} and floating-point format {floating}"
            raise LineError(0, f"{found}; expected 1 or 2, and 2 (IEEE 754); export as IEEE numbers or as text")
    even, mark = spacing == 1, ("", "<", ">")[order]
    return FunctionHeader(ids, function, *dofs, ordinate, count, even, minimum, increment, *axes, mark, size)


def _fields(lines: list[str], line: int, columns: tuple[tuple[int, int], ...]) -> list[int]:
    numbers = []
    for first, last in columns:
        field = lines[line][first:last].strip()
        if not re.fullmatch(r"[+-]?\d*", field):
            found = f"found {field!r} in columns {first + 1} to {last}; expected a whole number"
            raise LineError(line, f"{found}; the header is damaged, export it again")
        numbers.append(int(field) if field.strip("+-") else 0)
    return numbers


def _real(lines: list[str], line: int, first: int, last: int) -> float:
    field = lines[line][first:last].strip() or "0"
    if not _NUMBER.fullmatch(field):
        raise _no_number(field, line)
    return float(field)


def _axis(lines: list[str], line: int) -> Axis:
    text, (kind,) = lines[line], _fields(lines, line, ((0, 10),))
    unit = text[47:67]
    if text[46:47].strip():  # the name is longer than its columns: the unit is what comes last
        unit = text[26:].rstrip().rpartition(" ")[2]
    elif unit[19:].strip():
        unit += text[67:].partition(" ")[0]
    return Axis(kind, _entity(unit))


def _entity(text: str) -> str:
    text = text.strip()
    return "" if text.upper() == "NONE" else text


_CHUNK = 1 << 16
_LONGEST_LINE = 4096
#: DOS ends a text with Ctrl-Z.
_DELIMITER = re.compile(rb"[ \t]*-1[ \t]*\r?\n?")
_CLOSING = re.compile(rb"\n[ \t]*-1[ \t]*(?:(?=\x1a)|\r?\n|\r?$)")
#: Where the first data set begins: lines above it say what the program that wrote the file was.
BEGINNING = re.compile(rb"^[ \t]*-1[ \t]*\r?\n[ \t]*\d{2,6}(?:[ \t]*|[bB][ \d]*)\r?$", re.MULTILINE)
#: A delimiter with its blanks up to column 80 and both line ends is no longer.
_OVERLAP = 128
_DAMAGED = "the file is damaged or cut off, export it again"


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
    number, is_ended = 0, False
    if file.read(3) != b"\xef\xbb\xbf":
        file.seek(0)
    while True:
        here = file.tell()
        line = file.readline(_LONGEST_LINE)
        if not line:
            return
        is_ended = is_ended or b"\x1a" in line  # Ctrl-Z ends a text of DOS, unless another data set follows
        line = line.lstrip(b"\x1a")
        if not line.strip() or ((number == 0 or is_ended) and not _DELIMITER.fullmatch(line)):
            continue
        if not _DELIMITER.fullmatch(line):
            raise refusal(
                f"line {line_of(file, here)}", f"{_shown(line)} between data sets", "the delimiter -1", _DAMAGED
            )
        number += 1
        here, line = file.tell(), file.readline(_LONGEST_LINE)
        match = re.match(rb"[ \t]*(\d{1,6})([bB]?)(?=\s|$)", line)
        if match is None:
            actual = "the end of the file" if not line else _shown(line)
            expected = "the number of the data set's type, such as 58"
            raise refusal(f"data set {number}, line {line_of(file, here)}", actual, expected, _DAMAGED)
        header = _header(file, number, line if match[2] else None) if int(match[1]) == 58 else None
        start = file.tell()
        if header is None or not match[2]:
            # the line end of the header may be the one before the delimiter
            yield UffDataSet(number, int(match[1]), start, _closing(file, number, start - 1), header)
            continue
        size = header.count * header.row.itemsize
        file.seek(start + size)
        end = re.match(rb"\r?\n?[ \t]*-1[ \t]*(?:(?=\x1a)|\r?\n|$)", file.read(_OVERLAP))
        if end is None:
            found = f"no delimiter -1 after the {size} bytes of {header.count} values"
            remedy = "the file is cut off or its counts are wrong, export it again"
            raise refusal(f"data set {number}, line {line_of(file, here)}", found, "it there", remedy)
        file.seek(start + size + end.end())
        yield UffDataSet(number, 58, start, start + size, header)


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
        lines.append(plain_text(line).rstrip("\r\n"))
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
            found = "the end of the file"
            expected, remedy = "the delimiter -1 that ends the data set", "the file is cut off, export it again"
            raise refusal(f"data set {number}, line {line_of(file, base + len(buffer))}", found, expected, remedy)
        keep = min(len(buffer), _OVERLAP)
        base += len(buffer) - keep
        buffer = buffer[len(buffer) - keep :]


def _shown(line: bytes) -> str:
    return repr(line[:30].decode("ascii", errors="replace").strip())


#: With these alone, Python reads a field as we do; it would also take 1_000 for a number.
_OF_NUMBERS = b"0123456789eE+-. \r\n"
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.IGNORECASE)


def even_abscissa(header: FunctionHeader) -> Array:
    """Frequencies or instants, shape (count,), in the file's unit."""
    with np.errstate(over="ignore"):
        return np.arange(header.count, dtype=np.float64) * header.increment + header.minimum


def decode(header: FunctionHeader, body: Iterable[bytes], size: int) -> tuple[Array, Array | ComplexArray]:
    """Abscissa, in the file's unit, and ordinate of a data set 58, each of shape (count,).

    Parameters
    ----------
    header
        Header of the data set.
    body
        Content after the header, up to the delimiter: of text parts that end with a line, so that memory stays near the
        size of the numbers.
    size
        Bytes of all of it.

    Raises
    ------
    LineError
        If a field is not a number, or there are more or fewer than the header says.
    """
    if header.byte_order:
        rows = np.frombuffer(b"".join(body), header.row)
        numbers = rows["y"].astype(float) if header.even else np.hstack([rows["x"], rows["y"].astype(float)])
    else:
        expected = header.count * header.per_value
        # each number takes a digit and, but for columns that touch, a blank: a count beyond that is wrong
        if expected > size:
            raise LineError(0, _count_message(header, f"at most {size} numbers"))
        numbers, read, line = np.empty(expected), 0, 0
        for part in body:
            some = _numbers(header, part, expected - read, line)
            numbers[read : read + some.size] = some
            read, line = read + some.size, line + part.count(b"\n")
        if read != expected:
            raise LineError(max(line - 1, 0), _count_message(header, f"{read} numbers"))
    numbers = numbers.reshape(header.count, header.per_value)
    abscissa = even_abscissa(header) if header.even else numbers[:, 0].copy()
    ordinate = np.ascontiguousarray(numbers[:, 0 if header.even else 1 :])
    # not a + 1j·b, which turns an infinite part into NaN and loses the sign of a zero
    return abscissa, ordinate.view(complex)[:, 0] if header.is_complex else ordinate[:, 0]


def _widths(header: FunctionHeader) -> tuple[int, ...]:
    """Widths of the columns of a full line: 6E13.5, 4E20.12, 2(E13.5,E20.12) or E13.5,2E20.12."""
    if not header.is_double:
        return (13,) * 6
    if header.even:
        return (20,) * 4
    return (13, 20, 20) if header.is_complex else (13, 20) * 2


def _numbers(header: FunctionHeader, body: bytes, most: int, skipped: int) -> Array:
    """Numbers of whole lines: all at once where blanks part them, else line by line by the format's columns."""
    with suppress(ValueError):
        if len(fields := [] if body.translate(None, _OF_NUMBERS) else body.split()) in range(1, most + 1):
            return np.fromiter(map(float, fields), float, len(fields))
    numbers = array("d")
    for line, raw in enumerate(io.BytesIO(body), start=skipped):
        for cell in _cells_of(raw.decode("ascii", errors="replace"), _widths(header), _NUMBER):
            if not _NUMBER.fullmatch(cell):
                raise _no_number(cell, line)
            numbers.append(float(cell))
        if padding := numbers[most:]:
            if any(padding) or len(padding) >= len(_widths(header)):  # the last line may be filled up with zeros
                raise LineError(line, _count_message(header, "more numbers"))
            del numbers[most:]
    return np.frombuffer(numbers, dtype=float) if numbers else np.empty(0)


def _cells_of(line: str, widths: Sequence[int], number: re.Pattern[str]) -> list[str]:
    """Numbers of a line by the format's columns, or separated by blanks where the columns do not hold numbers."""
    text, ends = line.rstrip(), list(accumulate(widths))
    cells = [text[end - wide : end].strip() for wide, end in zip(widths, ends, strict=True) if end - wide < len(text)]
    return cells if len(text) <= ends[-1] and all(map(number.fullmatch, cells)) else text.split()


def _no_number(cell: str, line: int) -> LineError:
    """Error of a cell that holds none."""
    return LineError(line, str(bad_number(cell, "")).removeprefix(": "))


def _count_message(header: FunctionHeader, actual: str) -> str:
    expected = header.count * header.per_value
    return (
        f"found {actual}; expected {expected} for the {header.count} values that the header says; the file "
        "is cut off or its counts are wrong, export it again"
    )


# ---- units: what the axes and the data set 164 say

Q = TypeVar("Q")

#: 9 is an excitation force.
_SENSORS: dict[int, SensorQuantity] = {9: "force", **{kind: sensor for sensor, kind in AXIS_TYPES.items()}}
_QUANTITIES = {AXIS_TYPES[motion]: quantity for quantity, motion in MOTION_OF.items()}


@dataclass(frozen=True, slots=True)
class FileUnits:
    """Data set 164: metres and newtons for one unit of the file, and what the file calls its system of units."""

    length: float = 1.0
    force: float = 1.0
    name: str = ""
    stated: bool = False


def units_of(body: bytes) -> FileUnits:
    """Units from the content of a data set 164, whose factors turn SI into the file's units.

    Raises
    ------
    LineError
        If a factor is missing or not positive.
    """
    lines = body.decode("utf-8", errors="replace").splitlines()
    # the format itself writes these factors as D25.17, which may touch
    rows = (line.split() if " " in line.strip() else re.findall("(?s).{1,25}", line) for line in lines[1:])
    factors = [re.sub("[dD]", "e", field.strip()) for row in rows for field in row]
    try:
        length, force = float(factors[0]), float(factors[1])
        if not (0 < length < math.inf and 0 < force < math.inf):
            raise ValueError
    except (IndexError, ValueError):
        found = f"found units {' '.join(factors[:2])[:60]!r}; expected factors of length and force above 0"
        raise LineError(0, f"{found}; correct the data set 164 or take it out") from None
    return FileUnits(1 / length, 1 / force, lines[0][10:30].strip(), stated=True)


def frf_meaning(header: FunctionHeader, units: FileUnits) -> tuple[Quantity | None, float | None, str, list[str]]:
    """Quantity, factor to SI (None where not known), unit as written and notes of a frequency response.

    The quantity is what the types of the axes say, else what the units say. The factor belongs to the units written at
    the axes, which take precedence by the format's own words, else that of data set 164.
    """
    above, below = header.numerator.unit, header.denominator.unit
    named = _QUANTITIES.get(header.numerator.kind) if header.denominator.kind in (0, 1, 9, 13) else None
    alone = not below or frf_unit(above) is not None
    read = read_frf_unit(above) if alone else read_frf_unit(above, below)
    joined = f"({above})/{below}" if "/" in above else f"{above}/{below}"
    unit = above if alone or not above else joined
    if header.numerator.kind in (9, 13) and header.denominator.kind in _QUANTITIES:
        read[2].append("axis types say force over motion: the inverse of an FRF")
    return _meaning(unit, read, named, units.length / units.force, units)


def _meaning(
    unit: str, read: tuple[float | None, Q | None, list[str]], named: Q | None, of_file: float, units: FileUnits
) -> tuple[Q | None, float | None, str, list[str]]:
    """What a unit that was written, the type of an axis and the units of the file say together."""
    factor, unit_quantity, notes = read
    if unit and factor is not None:
        if named not in (None, unit_quantity):
            notes.append(f"axis types say {named}, the unit {unit} says {unit_quantity}")
        if units.name and named is not None and not math.isclose(factor, of_file, rel_tol=1e-3):
            notes.append(f"unit {unit} taken; data set 164 ({units.name}) says otherwise")
        return named or unit_quantity, factor, unit, notes
    if named is None or not units.stated or unit_quantity is not None:  # over volts, with any lengths
        return named or unit_quantity, factor, unit, notes
    notes = [note.removesuffix(", values left as written") for note in notes]
    if of_file != 1:
        notes.append(f"converted to SI units by data set 164 ({units.name})")
    return named, of_file, unit, notes


# ---- modes: data at nodes of a data set 55

#: Bytes of one mode; the largest finite-element model has 10⁶ nodes in it.
MOST_MODE_BYTES = 2**27
NORMAL_MODES, _COMPLEX = 2, (3, 7)  # analysis types with modes: normal, complex of first and of second order
_DIRECTIONS = {1: (0,), 3: (1, 2, 3), 6: (1, 2, 3, 4, 5, 6)}  # by the number of values at a node
_MOTIONS = {8: "", 11: "velocities", 12: "accelerations"}
_LIKELY_DAMPING = 0.2
_MODE_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+|[+-]\d{3})?")


def read_mode(body: bytes, number: int) -> ModeRecord | None:
    """The mode of a data set 55; None where it holds something else: static deflections, stresses, time steps.

    Parameters
    ----------
    body
        Content of the data set.
    number
        Of the data set, counted from 1.

    Raises
    ------
    LineError
        If a field is no number or impossible, or a line is missing.
    """
    # 1. the header, the parameters and the shape
    lines = body.decode("utf-8", errors="replace").splitlines()
    if len(lines) < 8:
        found = f"found {len(lines)} lines of a data set 55"
        raise LineError(max(len(lines) - 1, 0), f"{found}; expected 8 and the nodes; export the modes again")
    _, analysis, _, motion, kind, per_node = _integers(lines, 5, 6)
    if analysis not in (NORMAL_MODES, *_COMPLEX) or motion not in (0, 1, *_MOTIONS) or per_node not in _DIRECTIONS:
        return None
    if kind not in (2, 4, 5, 6):
        raise LineError(5, f"found data type {kind}; expected 2 (real) or 5 (complex); export the modes again")
    counts = _integers(lines, 6, 4)
    mode, n_real = counts[3], counts[1]
    if not (1 <= n_real <= 12 and n_real >= (2 if analysis in _COMPLEX else 1)):
        raise LineError(6, f"found {n_real} real parameters; expected those of a mode, 4 or 6; export the modes again")
    end, count = 7 + -(-n_real // 6), per_node * (2 if kind in (5, 6) else 1)
    try:
        stated = list(_mode_numbers(lines, 7, end, n_real))
        places, numbers, at = dict[int, int](), list[float](), end
        while at < len(lines):
            field = lines[at].strip()
            if not re.fullmatch(r"\d{1,9}", field) or int(field) in places:
                why = "a second time" if re.fullmatch(r"\d{1,9}", field) else "for a node"
                raise LineError(at, f"found {field[:30]!r} {why}; expected a new node's number; export the modes again")
            places[int(field)] = at
            following = at + 1 - (-count // 6)
            numbers += _mode_numbers(lines, at + 1, following, count)
            at = following
        nodes, values = list(places), np.array(numbers).reshape(len(places), count)
    except LineError:
        if (free := _free_columns(lines, n_real, count)) is None:
            raise
        stated, nodes, values = free
    shape = values.view(complex) if kind in (5, 6) else values
    labels = [dof_label(Dof("", node, direction)) for node in nodes for direction in _DIRECTIONS[per_node]]
    notes = [f"shape in {_MOTIONS[motion]}"] if _MOTIONS.get(motion) else []
    # 2. frequency, damping ratio and modal mass; what is doubtful goes to the notes
    if analysis == NORMAL_MODES:
        frequency, mass, ratio, loss = [*stated, *[0.0] * 4][:4]
        if ratio == 0 and loss != 0:
            ratio = loss / 2
            notes.append(f"damping ratio half the hysteretic damping, {loss:g}")
    else:
        pole, mass = complex(stated[0], stated[1]), 0.0
        frequency = abs(pole) / (2 * math.pi)
        ratio = -pole.real / abs(pole) if pole else 0.0
    if not 0 <= frequency <= 1e9 or math.isnan(ratio):
        raise LineError(7, f"found {frequency:g} Hz and damping {ratio:g}; expected a mode's; export the modes again")
    if ratio < 0:
        notes.append(f"negative damping ratio {ratio:.3g}: the sign of the eigenvalue's real part, or unstable")
    if ratio > _LIKELY_DAMPING:
        taken = "not taken: above critical, or in percent" if ratio >= 1 else "is high: some programs write percent"
        notes.append(f"damping ratio {ratio:.3g} {taken}")
    told = re.search(r"(?:mode|freq)[^=]*?(\d+\.\d+)\s*Hz", " ".join(lines[:5]), re.IGNORECASE)
    if told and not math.isclose(float(told[1]), frequency, rel_tol=0.02, abs_tol=0.02):
        notes.append(f"frequency {frequency:.6g} Hz, and {told[1]} Hz in an ID line")
    sds = dict(word.split("=") for line in lines[:5] for word in line.split() if re.fullmatch(r"\w+_sd\w*=\S+", word))
    frequency_sd, ratio_sd = (float_of(sds.get(key, "")) for key in ("frequency_sd_hz", "damping_sd"))
    motions, where = dict(zip(labels, shape.ravel().astype(complex).tolist(), strict=True)), f"data set {number}"
    damping = (None if ratio == 0 or ratio >= 1 else ratio, ratio_sd)
    return ModeRecord(mode, frequency, frequency_sd, *damping, motions, mass or None, where, tuple(notes))


def _integers(lines: list[str], at: int, count: int) -> list[int]:
    fields = lines[at].split()[:count]
    if len(fields) < count or not all(re.fullmatch(r"[+-]?\d{1,10}", field) for field in fields):
        raise LineError(at, f"found {lines[at].strip()[:40]!r}; expected {count} whole numbers; export the modes again")
    return list(map(int, fields))


def _mode_numbers(lines: list[str], first: int, end: int, count: int) -> Iterator[float]:
    """Numbers of a record, 13 columns each or separated by blanks."""
    for at in range(first, end):
        wanted = min(6, count - 6 * (at - first))
        cells = _cells_of(lines[at], (13,) * wanted, _MODE_NUMBER) if at < len(lines) else []
        if len(cells) != wanted:
            fault = "the data set is cut off or its counts are wrong, export the modes again"
            raise LineError(min(at, len(lines) - 1), f"found {len(cells)} numbers; expected {wanted}; {fault}")
        for cell in cells:
            value = float(re.sub(r"(?<=\d)([+-]\d{3})$", r"E\1", cell)) if _MODE_NUMBER.fullmatch(cell) else math.nan
            if not math.isfinite(value):
                raise _no_number(cell, at)
            yield value


def _free_columns(lines: list[str], n_real: int, count: int) -> tuple[list[float], list[int], Array] | None:
    """Parameters, nodes and values wherever lines end; None where they do not come out even."""
    cells = " ".join(lines[7:]).split()
    numbers = np.array([math.nan if (number := float_of(cell)) is None else number for cell in cells])
    nodes, rows = cells[n_real :: 1 + count], numbers[n_real:]
    if not (len(nodes) and rows.size == len(nodes) * (1 + count) and np.isfinite(numbers).all()):
        return None
    if not all(re.fullmatch(r"\d{1,9}", node) for node in nodes) or len({*map(int, nodes)}) < len(nodes):
        return None
    return numbers[:n_real].tolist(), list(map(int, nodes)), rows.reshape(len(nodes), -1)[:, 1:].copy()


_TIME, _FRF, _COHERENCE, _MODES = 1, 4, 6, 55
_PART = 2**20  # bytes of a function that are decoded at once
#: An FRF has up to four: values and coherence, each with one of another type behind it in files of earlier versions.
_MOST_SETS = 4 * MOST_RECORDS + 100
#: Type of function, labels of response and reference, and of time histories what the sensor measures.
Place = tuple[int, str, str, int]


@dataclass(slots=True)
class _UniversalFile:
    """An open file and what its first pass found: units by the number of their data set.

    Each data set comes with its place, and which of that place it is.
    """

    file: BinaryIO
    sets: list[tuple[UffDataSet, Place, int]] = field(default_factory=list)
    places: dict[Place, list[UffDataSet]] = field(default_factory=dict)
    units: dict[int, FileUnits] = field(default_factory=dict)

    def body(self, data_set: UffDataSet, most: int = MOST_BYTES) -> bytes:
        """Content of a data set of at most so many bytes."""
        size = data_set.stop - data_set.start
        require_at_most(most, size, f"data set {data_set.number}", f"bytes of type {data_set.kind}", "export less")
        self.file.seek(data_set.start)
        return self.file.read(size)

    def lines(self, data_set: UffDataSet) -> Iterator[bytes]:
        """The same in parts that end with a line."""
        self.file.seek(data_set.start)
        while (left := data_set.stop - self.file.tell()) > 0:
            part = self.file.read(min(left, _PART))
            yield part + self.file.readline(left - len(part))

    @contextmanager
    def located(self, data_set: UffDataSet) -> Iterator[None]:
        """Name data set and line of what cannot be read."""
        try:
            yield
        except LineError as error:
            line = line_of(self.file, data_set.start) + error.line
            raise MeasurementError(f"data set {data_set.number}, line {line}: {error}") from None

    def function(self, data_set: UffDataSet) -> tuple[FunctionHeader, Array, Array | ComplexArray]:
        """Header, abscissa and ordinate of a data set 58."""
        header = data_set.header
        assert header is not None
        with self.located(data_set):
            return header, *decode(header, self.lines(data_set), data_set.stop - data_set.start)

    def units_of(self, data_set: UffDataSet) -> FileUnits:
        """Units of the last data set 164 before it, or else of the first in the file."""
        before = [number for number in self.units if number < data_set.number]
        return self.units[max(before) if before else min(self.units)] if self.units else FileUnits()


def read_uff(path: Path) -> Generator[Record, None, None]:
    """What a universal file holds, in its order, one record in memory at a time; spectra without their values.

    A first pass finds the data sets, so that a file cut off is refused before anything is read from it, and so that the
    coherence of an FRF is found wherever it stands.

    Raises
    ------
    MeasurementError
        If the file is cut off, a count is wrong or a field is not a number.
    """
    with path.open("rb") as file:
        # 1. the first pass
        source, empty = _UniversalFile(file), True
        for data_set in scan(file):
            behind = file.tell()
            if data_set.number > _MOST_SETS:
                expected = f"at most {MOST_RECORDS} FRFs and time histories with what belongs to them"
                raise refusal("data sets", f"more than {_MOST_SETS}", expected, "split the file")
            if data_set.kind == 164:
                with source.located(data_set):
                    source.units[data_set.number] = units_of(source.body(data_set, 4096))
            else:
                place = _place(data_set)
                source.places.setdefault(place, []).append(data_set)
                source.sets.append((data_set, place, len(source.places[place])))
            file.seek(behind)
        # 2. the records
        for data_set, place, nth in source.sets:
            record = _record(source, data_set, place, nth)
            if record is not None:
                empty = False
                yield record
                del record  # before the next is read
        if empty:
            kinds = ", ".join(map(str, sorted({data_set.kind for data_set, _, _ in source.sets})[:10])) or "none"
            found = f"{len(source.sets)} of the types {kinds}, and no FRF, time history or mode among them"
            raise refusal("data sets", found, "data sets 58 of function type 4 or 1, or 55 of modes", "export the FRFs")


def places_of_points(path: Path) -> dict[int, Array]:
    """Places of the measured points by their numbers, each shape (3,), in the file's own unit: data sets 15 and 2411.

    Raises
    ------
    MeasurementError
        If data sets have no end, or a field is not a number.
    """
    places: dict[int, Array] = {}
    with path.open("rb") as file:
        source = _UniversalFile(file)
        for data_set in scan(file):
            behind = file.tell()
            if data_set.kind in (15, 2411):
                text = source.body(data_set).decode("latin-1").upper().replace("D", "E")
                words = re.sub(r"(E[+-]\d+)-", r"\1 -", text).split()  # fields may touch
                with refuse_damage(f"data set {data_set.number}", "numbers and places of points; export it again"):
                    for at in range(0, len(words) - 6, 7):  # number, two coordinate systems, colour, x, y, z
                        places[int(words[at])] = np.array([float(word) for word in words[at + 4 : at + 7]])
            file.seek(behind)
    return places


def _place(data_set: UffDataSet) -> Place:
    """Type and labels, with complex functions of unknown type over frequency counted as FRFs."""
    header = data_set.header
    if header is None:
        return _MODES if data_set.kind == 55 else -data_set.kind, "", "", 0
    is_frf = header.function == 0 and header.is_complex and header.abscissa.kind == 18
    response = header.said("response=") or dof_label(header.response)
    reference = header.said("reference=") or dof_label(header.reference)
    # force and motion of one point are time histories of two kinds
    sensor = header.numerator.kind if header.function == _TIME else 0
    return _FRF if is_frf else header.function, response, reference, sensor


def _record(source: _UniversalFile, data_set: UffDataSet, place: Place, nth: int) -> Record | None:
    """The record of a data set, the nth of its place; None where it holds none, or belongs to another."""
    kind, response, reference, _ = place
    where = f"data set {data_set.number}"
    header = data_set.header
    if header is None:
        if kind != _MODES:
            return None
        with source.located(data_set):
            return read_mode(source.body(data_set, MOST_MODE_BYTES), data_set.number)
    if kind not in (_TIME, _FRF, _COHERENCE):
        words, none = NAMES["functions"].get(str(kind), f"function of type {kind}"), np.empty(0)
        told = header.even and header.abscissa.kind == 18 and header.count <= data_set.stop - data_set.start
        lines = _frequency_hz(even_abscissa(header), header, []) if told else none
        return SpectrumRecord(response, words, lines, none, header.numerator.unit, where, ("values not read",))
    axis_kind, axis_unit = header.abscissa.kind, header.abscissa.unit
    role = {17: "time", 18: "frequency"}.get(axis_kind) or axis_role(axis_unit)
    if role == ("frequency" if kind == _TIME else "time"):
        over = f"an abscissa of type {axis_kind} and unit {axis_unit or 'none'}"
        found, remedy = f"a function of type {kind} over {over}", "correct the type of function or the axis"
        raise refusal(where, found, "time (17, s)" if kind == _TIME else "frequency (18, Hz)", remedy)
    if kind == _COHERENCE:
        return None if (_FRF, response, reference, 0) in source.places else _coherence(source, data_set, place)
    header, abscissa, ordinate = source.function(data_set)
    count, units = len(source.places[place]), source.units_of(data_set)
    if kind == _TIME:
        if header.is_complex:
            raise refusal(where, "complex values of a time history", "real ones", "export again")
        scale = TIME_S.get(header.abscissa.unit.lower(), 1.0)
        instants = header.increment * np.arange(min(header.count, 2)) if header.even else abscissa
        exact = float_of(header.said("sample_rate_hz="))
        rate = even_rate(np.asarray(instants * scale, dtype=float), where, exact)
        named: SensorQuantity | None = _SENSORS.get(header.numerator.kind)
        written = header.numerator.unit
        of_file = units.force if named == "force" else units.length
        sensor: SensorQuantity | None
        sensor, factor, unit, notes = _meaning(written, read_sensor_unit(written), named, of_file, units)
        values, hit = scaled(ordinate.real, factor), header.said("hit ")
        number = int(hit) if re.fullmatch(r"\d{1,9}", hit) else nth if count > 1 else None
        about = (unit, number, where, tuple(notes), factor)
        return TimeRecord(response, rate, values, sensor or "unknown", *about)
    quantity, factor, unit, notes = frf_meaning(header, units)
    if header.function == 0:
        notes.append("function of unknown type taken for an FRF")
    if not header.is_complex:
        notes.append("FRF without imaginary part")
    lines = _frequency_hz(abscissa, header, notes)
    of_pair = source.places.get((_COHERENCE, response, reference, 0), [])
    if of_pair and len(of_pair) != count:
        notes.append(f"{len(of_pair)} coherences for {count} FRFs of this pair: none taken")
    values = scaled(ordinate, factor).astype(complex, copy=False)
    complete = len(of_pair) == count
    squared = coherence_on(lines, _coherence(source, of_pair[nth - 1], place), where) if complete else None
    decay = stated_decay_rate("; ".join(header.ids), lines)
    notes += [WINDOW_NOTE.format(1 / decay)] if decay > 0 else []
    said = (quantity, unit, squared, _averages(header), where, tuple(notes), factor, decay)
    return FrfRecord(response, reference, lines, values, *said)


def _coherence(source: _UniversalFile, data_set: UffDataSet, place: Place) -> CoherenceRecord:
    notes: list[str] = []
    header, abscissa, squared = source.function(data_set)
    lines, where = _frequency_hz(abscissa, header, notes), f"data set {data_set.number}"
    return CoherenceRecord(*place[1:3], lines, squared.real, _averages(header), where, tuple(notes))


def _frequency_hz(abscissa: Array, header: FunctionHeader, notes: list[str]) -> Array:
    unit = header.abscissa.unit
    factor = hertz_factor(unit) if unit else 1.0
    if factor is None:
        notes.append(f"unit {unit!r} of the frequency not understood, taken as Hz")
    elif factor != 1:
        notes.append(f"frequency in {unit} converted to Hz")
    return abscissa * (factor or 1.0)


def _averages(header: FunctionHeader) -> int | None:
    """Number of averages, for which the format has no field, where an ID line tells it."""
    words = re.compile(r"\baverages?\s*[:=]?\s*(\d{1,9})\b|\b(\d{1,9})\s+averages?\b", re.IGNORECASE)
    found = (int(match[1] or match[2]) for line in header.ids if (match := words.search(line)))
    return next(filter(None, found), None)
