"""Values of a data set 58, columns of fixed width in text, IEEE numbers in binary, and their units."""

import io
import math
import re
from array import array
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.frf import Quantity
from jointbayes.measurement.formats.table_text import bad_number
from jointbayes.measurement.formats.uff_data_sets import AXIS_TYPES, FunctionHeader, LineError, body_bytes
from jointbayes.measurement.formats.units import MOTION_OF, frf_unit, read_frf_unit, read_sensor_unit
from jointbayes.measurement.records import SensorQuantity

#: With these alone, NumPy reads a field as we do; it would also take 1_000 for a number.
_OF_NUMBERS = b"0123456789eE+-. \r\n"
_NUMBER = re.compile(rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class Function:
    """Abscissa and ordinate, shape (count,); an even abscissa is made when it is asked for."""

    header: FunctionHeader
    stated: Array | None
    ordinate: Array | NDArray[np.complex128]

    @cached_property
    def abscissa(self) -> Array:
        """Frequencies or instants in the file's unit."""
        if self.stated is not None:
            return self.stated
        abscissa = np.arange(self.header.count, dtype=np.float64)
        with np.errstate(over="ignore"):
            abscissa *= self.header.increment
            abscissa += self.header.minimum
        return abscissa


def decode(header: FunctionHeader, body: Iterable[bytes], size: int) -> Function:
    """Values of a data set 58.

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
    numbers = _binary(header, b"".join(body)) if header.byte_order else _text(header, body, size)
    numbers = numbers.reshape(header.count, header.per_value)
    stated = None if header.even else numbers[:, 0].copy()
    numbers = numbers[:, 0 if header.even else 1 :]
    if not header.is_complex:
        return Function(header, stated, np.ascontiguousarray(numbers[:, 0]))
    ordinate = np.empty(header.count, complex)
    # not a + 1j·b, which turns an infinite part into NaN and loses the sign of a zero
    ordinate.real, ordinate.imag = numbers[:, 0], numbers[:, 1]
    return Function(header, stated, ordinate)


def _binary(header: FunctionHeader, body: bytes) -> Array:
    kind = header.byte_order + ("f8" if header.is_double else "f4")
    if len(body) == header.count * header.per_value * int(kind[-1]):
        return np.frombuffer(body, dtype=kind).astype(float)
    assert len(body) == body_bytes(header)
    narrow = np.dtype([("x", header.byte_order + "f4"), ("y", kind, (header.per_value - 1,))])
    rows = np.frombuffer(body, dtype=narrow)
    return np.concatenate([rows["x"][:, None].astype(float), rows["y"].astype(float)], axis=1)


def _text(header: FunctionHeader, body: Iterable[bytes], size: int) -> Array:
    expected = header.count * header.per_value
    # each number takes a digit and, but for columns that touch, a blank: a count beyond that is wrong
    if expected > size:
        raise LineError(0, _count_message(header, f"at most {size} numbers"))
    numbers, read, line = np.empty(expected), 0, 0
    for part in body:
        plain = not part.translate(None, _OF_NUMBERS)
        some = _columns(header, part, expected - read, line) if plain else None
        some = _numbers(header, part, expected - read, line) if some is None else some
        numbers[read : read + some.size] = some
        read, line = read + some.size, line + part.count(b"\n")
    if read != expected:
        raise LineError(max(line - 1, 0), _count_message(header, f"{read} numbers"))
    return numbers


def _widths(header: FunctionHeader) -> tuple[int, ...]:
    """Widths of the columns of a full line: 6E13.5, 4E20.12, 2(E13.5,E20.12) or E13.5,2E20.12."""
    if not header.is_double:
        return (13,) * 6
    if header.even:
        return (20,) * 4
    return (13, 20, 20) if header.is_complex else (13, 20) * 2


def _columns(header: FunctionHeader, body: bytes, most: int, line: int) -> Array | None:
    """All numbers at once where every full line is as long as the first; None where one differs."""
    widths = _widths(header)
    per_line, width, length = len(widths), sum(widths), body.find(b"\n") + 1
    full = min(most // per_line, len(body) // max(length, 1))
    if length <= width:
        return None
    cells = np.frombuffer(body, "S1", count=full * length).reshape(full, length)
    ends = cells[:, width:]
    if not ((ends == b"\n") | (ends == b"\r") | (ends == b" ")).all() or not (ends[:, -1] == b"\n").all():
        return None
    rest = _numbers(header, body[full * length :], most - full * per_line, line + full)
    numbers = np.empty(full * per_line + rest.size)
    first = 0
    for i, wide in enumerate(widths):
        field = np.ascontiguousarray(cells[:, first : first + wide]).view(f"S{wide}")[:, 0]
        try:
            numbers[i : full * per_line : per_line] = field.astype(float)
        except ValueError:
            return None
        first += wide
    numbers[full * per_line :] = rest
    return numbers


def _numbers(header: FunctionHeader, body: bytes, most: int, skipped: int) -> Array:
    """Numbers by the format's columns, or separated by blanks where the columns do not hold numbers."""
    numbers = array("d")
    for line, raw in enumerate(io.BytesIO(body), start=skipped):
        text = raw.rstrip()
        cells, first = [], 0
        for wide in _widths(header):
            if first < len(text):
                cells.append(text[first : first + wide].strip())
            first += wide
        if len(text) > first or not all(_NUMBER.fullmatch(cell) for cell in cells):
            cells = text.split()
        for cell in cells:
            if not _NUMBER.fullmatch(cell):
                raise LineError(line, str(bad_number(cell.decode("ascii", errors="replace"), "")).removeprefix(": "))
            numbers.append(float(cell))
        if len(numbers) > most:
            raise LineError(line, _count_message(header, "more numbers"))
    return np.frombuffer(numbers, dtype=float) if numbers else np.empty(0)


def _count_message(header: FunctionHeader, actual: str) -> str:
    expected = header.count * header.per_value
    return (
        f"found {actual}; expected {expected} for the {header.count} values that the header says; the file "
        "is cut off or its counts are wrong, export it again"
    )


# ---- units: what the axes and the data set 164 say

Q = TypeVar("Q")

_SENSORS: dict[int, SensorQuantity] = {kind: sensor for sensor, kind in AXIS_TYPES.items() if kind} | {
    9: "force"
}  # 9: excitation force
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
    # the format itself writes these factors as D25.17
    factors = [re.sub("[dD]", "e", field) for line in lines[1:] for field in _fields(line)]
    try:
        length, force = float(factors[0]), float(factors[1])
        if not (0 < length < math.inf and 0 < force < math.inf):
            raise ValueError
    except (IndexError, ValueError):
        raise LineError(
            0,
            f"found units {' '.join(factors[:2])[:60]!r}; expected factors of length and force above 0; correct the "
            "data set 164 or take it out",
        ) from None
    return FileUnits(1 / length, 1 / force, lines[0][10:30].strip(), stated=True)


def _fields(line: str) -> list[str]:
    """Numbers of a line, separated by blanks or in columns 25 wide that touch."""
    return line.split() if " " in line.strip() else [line[i : i + 25].strip() for i in range(0, len(line), 25)]


def frf_meaning(header: FunctionHeader, units: FileUnits) -> tuple[Quantity | None, float | None, str, list[str]]:
    """Quantity, factor to SI (None where not known), unit as written and notes of a frequency response.

    The quantity is what the types of the axes say, else what the units say. The factor is that of the units written at
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


def sensor_meaning(header: FunctionHeader, units: FileUnits) -> tuple[SensorQuantity, float | None, str, list[str]]:
    """Quantity, factor to SI (None where not known), unit as written and notes of a time response."""
    axis = header.numerator
    named: SensorQuantity | None = _SENSORS.get(axis.kind)
    of_file = units.force if named == "force" else units.length
    read = read_sensor_unit(axis.unit)
    meaning: tuple[SensorQuantity | None, float | None, str, list[str]] = _meaning(
        axis.unit, read, named, of_file, units
    )
    return meaning[0] or "unknown", *meaning[1:]


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
    if named is None or not units.stated or unit_quantity is not None:  # over volts, whatever the lengths are
        return named or unit_quantity, factor, unit, notes
    notes = [note.removesuffix(", values left as written") for note in notes]
    if of_file != 1:
        notes.append(f"converted to SI units by data set 164 ({units.name})")
    return named, of_file, unit, notes
