"""Values of a data set 58, columns of fixed width in text, IEEE numbers in binary, with their units; modes of a 55.

References
----------
Structural Dynamics Research Lab, University of Cincinnati: Universal File Formats, data sets 55 and 58.
"""

import io
import math
import re
from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import TypeVar

import numpy as np

from vibrecords.arrays import Array, ComplexArray
from vibrecords.formats.table_text import bad_number, float_of
from vibrecords.formats.uff_data_sets import AXIS_TYPES, FunctionHeader, LineError, body_bytes
from vibrecords.formats.units import MOTION_OF, frf_unit, read_frf_unit, read_sensor_unit
from vibrecords.frf_set import Quantity
from vibrecords.records import Dof, ModeRecord, SensorQuantity, dof_label

#: With these alone, NumPy reads a field as we do; it would also take 1_000 for a number.
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
    numbers = _binary(header, b"".join(body)) if header.byte_order else _text(header, body, size)
    numbers = numbers.reshape(header.count, header.per_value)
    abscissa = even_abscissa(header) if header.even else numbers[:, 0].copy()
    ordinate = np.ascontiguousarray(numbers[:, 0 if header.even else 1 :])
    # not a + 1j·b, which turns an infinite part into NaN and loses the sign of a zero
    return abscissa, ordinate.view(complex)[:, 0] if header.is_complex else ordinate[:, 0]


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
        some = None if part.translate(None, _OF_NUMBERS) else _columns(header, part, expected - read, line)
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
_SENSORS: dict[int, SensorQuantity] = {9: "force", **{kind: sensor for sensor, kind in AXIS_TYPES.items() if kind}}
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
    quantity: SensorQuantity | None
    quantity, factor, unit, notes = _meaning(axis.unit, read_sensor_unit(axis.unit), named, of_file, units)
    return quantity or "unknown", factor, unit, notes


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
    lines = body.decode("utf-8", errors="replace").splitlines()
    if len(lines) < 8:
        raise LineError(
            max(len(lines) - 1, 0),
            f"found {len(lines)} lines of a data set 55; expected 8 and the nodes; export the modes again",
        )
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
        nodes, values = _shape(lines, end, count)
    except LineError:
        if (free := _free_columns(lines, n_real, count)) is None:
            raise
        stated, nodes, values = free
    shape = values.view(complex) if kind in (5, 6) else values
    labels = [dof_label(Dof("", node, direction)) for node in nodes for direction in _DIRECTIONS[per_node]]
    notes = [f"shape in {_MOTIONS[motion]}"] if _MOTIONS.get(motion) else []
    frequency, ratio, mass = _parameters(analysis, [*stated, *[0.0] * 4], notes)
    told = re.search(r"(?:mode|freq)[^=]*?(\d+\.\d+)\s*Hz", " ".join(lines[:5]), re.IGNORECASE)
    if told and not math.isclose(float(told[1]), frequency, rel_tol=0.02, abs_tol=0.02):
        notes.append(f"frequency {frequency:.6g} Hz, and {told[1]} Hz in an ID line")
    sds = dict(word.split("=") for line in lines[:5] for word in line.split() if re.fullmatch(r"\w+_sd\w*=\S+", word))
    frequency_sd, ratio_sd = (float_of(sds.get(key, "")) for key in ("frequency_sd_hz", "damping_sd"))
    motions, where = dict(zip(labels, shape.ravel().astype(complex).tolist(), strict=True)), f"data set {number}"
    return ModeRecord(mode, frequency, frequency_sd, ratio, ratio_sd, motions, mass, where, tuple(notes))


def _parameters(analysis: int, stated: list[float], notes: list[str]) -> tuple[float, float | None, float | None]:
    """Frequency, damping ratio and modal mass; what is doubtful goes to the notes."""
    if analysis == NORMAL_MODES:
        frequency, mass, ratio, loss = stated[:4]
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
    return frequency, None if ratio == 0 or ratio >= 1 else ratio, mass or None


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
            raise LineError(
                min(at, len(lines) - 1),
                f"found {len(cells)} numbers; expected {wanted}; the data set is cut off or its counts are wrong, "
                "export the modes again",
            )
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


def _shape(lines: list[str], at: int, count: int) -> tuple[list[int], Array]:
    """Numbers of the nodes, and their values, shape (nodes, count)."""
    nodes: dict[int, int] = {}
    values: list[float] = []
    per_node = 1 + -(-count // 6)
    while at < len(lines):
        field = lines[at].strip()
        if not re.fullmatch(r"\d{1,9}", field) or int(field) in nodes:
            why = "a second time" if re.fullmatch(r"\d{1,9}", field) else "for a node"
            raise LineError(at, f"found {field[:30]!r} {why}; expected a new node's number; export the modes again")
        nodes[int(field)] = at
        values += _mode_numbers(lines, at + 1, at + per_node, count)
        at += per_node
    return list(nodes), np.array(values).reshape(len(nodes), count)
