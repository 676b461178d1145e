"""LabVIEW measurement files (``.lvm``): time histories, and FRFs as columns of real and imaginary part."""

import itertools
import re
from array import array
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError
from jointbayes.measurement.formats.table import Column, column_of, column_records
from jointbayes.measurement.formats.table_text import bad_number, text_lines
from jointbayes.measurement.records import MOST_COLUMNS, Record, TimeRecord, require_short

_END = "***End_of_Header***"
Lines = Iterator[tuple[int, str]]


@dataclass(slots=True)
class _Layout:
    """What the header of the file says of all segments."""

    separator: str = "\t"
    decimal: str = "."
    x_columns: str = "one"


@dataclass(slots=True)
class _Segment:
    """Header of a segment: fields by name, each with one value for each channel."""

    line: int
    fields: dict[str, list[str]] = field(default_factory=dict)

    def each(self, key: str, count: int) -> list[str]:
        """Values of a field, one for each channel, empty where there are fewer."""
        values = self.fields.get(key, [])
        return [*values, *[""] * count][:count]


def read_lvm(path: Path) -> Generator[Record, None, None]:
    """Records of a LabVIEW measurement file; a segment that comes again counts as the next hit.

    Raises
    ------
    MeasurementError
        If the header has no end, counts do not agree with the rows, or a field is not a number.
    """
    lines = text_lines(path)
    layout = _file_header(lines)
    segment = _segment_header(lines, layout)
    number = 0
    while segment is not None:
        number += 1
        following, records = _segment(segment, lines, layout)
        for record in records:
            several = number > 1 or following is not None
            if isinstance(record, TimeRecord) and record.hit is None and several:
                record = replace(record, hit=number)
            yield replace(record, where=f"segment {number}, {record.where}")
        segment = following
    if number == 0:
        raise MeasurementError("header: found no segment of data; expected at least one; export the measurement again")


def _file_header(lines: Lines) -> _Layout:
    layout, number = _Layout(), 0
    for number, line in lines:
        if line.startswith(_END):
            return layout
        key, *values = re.split(r"[\t,]", line, maxsplit=1)
        value = values[0].strip("\t ") if values else ""
        match key.strip().lower():
            case "separator":
                separators = {"tab": "\t", "comma": ","}
                if value.lower() not in separators:
                    raise MeasurementError(f"line {number}: found separator {value[:20]!r}; expected Tab or Comma")
                layout.separator = separators[value.lower()]
            case "decimal_separator":
                layout.decimal = value or ","
            case "x_columns":
                layout.x_columns = value.lower()
    raise MeasurementError(
        f"line {number}: found the end of the file; expected {_END}; the file is cut off, export again"
    )


def _segment_header(lines: Lines, layout: _Layout) -> _Segment | None:
    """Header of the next segment, or None at the end of the file."""
    first = next(((number, line) for number, line in lines if line.strip()), None)
    if first is None:
        return None
    segment = _Segment(first[0])
    for _, line in itertools.chain([first], lines):
        if line.startswith(_END):
            return segment
        key, *values = line.split(layout.separator)
        segment.fields[key.strip().lower()] = [value.strip() for value in values]
        if len(segment.fields) > 1000:
            break
    raise MeasurementError(
        f"line {segment.line}: found no end of the segment's header; expected {_END}; the file is cut off, export again"
    )


def _segment(segment: _Segment, lines: Lines, layout: _Layout) -> tuple[_Segment | None, Iterator[Record]]:
    """Records of a segment, and the header of the next one."""
    number, line = next(lines, (segment.line, ""))
    names = [name.strip() for name in line.split(layout.separator)]
    if not names or names[0].lower() != "x_value":
        raise MeasurementError(f"line {number}: found {line[:30]!r}; expected the names of columns, X_Value first")
    while names and (not names[-1] or names[-1].lower() == "comment"):
        names.pop()
    if len(names) > MOST_COLUMNS:
        raise MeasurementError(f"line {number}: found {len(names)} columns; expected at most {MOST_COLUMNS}; split it")
    require_short(f"line {number}", *names)
    values, following = _rows(len(names), number, lines, layout)
    units = segment.each("y_unit_label", len(names))
    samples = segment.each("samples", 1)[0][:18]
    if samples.isdecimal() and int(samples) != len(values):
        raise MeasurementError(
            f"line {segment.line}: found {len(values)} rows of the segment; expected {samples} samples; the file is "
            "cut off, export it again"
        )
    if layout.x_columns == "multi":
        names, values = _one_axis(names, values, segment.line)
    channels = [column_of(f"{name} [{unit}]" if unit else name) for name, unit in zip(names[1:], units, strict=False)]
    frequency = segment.each("x_dimension", 1)[0].lower() == "frequency"
    axis = Column("frequency", "", segment.each("x_unit_label", 1)[0] or "Hz") if frequency else Column("time", "", "s")
    if layout.x_columns == "no":
        values[:, 0] = _axis(segment, len(values))
    comments = {}
    for note in segment.each("notes", 1)[0].split(";"):
        key, _, value = note.partition(":")
        comments[key.strip().lower()] = value.strip()
    return following, column_records([axis, *channels], values, comments)


def _axis(segment: _Segment, count: int) -> Array:
    start, step = (segment.each(key, 1)[0].replace(",", ".") for key in ("x0", "delta_x"))
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            return np.asarray(float(start or "0") + np.arange(count) * float(step), dtype=np.float64)
    except ValueError:
        raise MeasurementError(
            f"line {segment.line}: found X0 {start[:20]!r} and Delta_X {step[:20]!r}; expected numbers; export it again"
        ) from None


def _one_axis(names: list[str], values: Array, line: int) -> tuple[list[str], Array]:
    """Columns with one axis where each channel has its own."""
    axes = [i for i, name in enumerate(names) if name.lower() == "x_value"]
    if not np.array_equal(values[:, axes], np.repeat(values[:, :1], len(axes), axis=1), equal_nan=True):
        raise MeasurementError(
            f"line {line}: found channels with different axes; expected one for all; export with one X column"
        )
    keep = [0, *(i for i, name in enumerate(names) if name.lower() != "x_value")]
    return [names[i] for i in keep], values[:, keep]


def _rows(count: int, number: int, lines: Lines, layout: _Layout) -> tuple[Array, _Segment | None]:
    """Rows of numbers up to a blank line or the end, and the header of the next segment."""
    numbers = array("d")
    following: _Segment | None = None
    for number, line in lines:
        if not line.strip():
            following = _segment_header(lines, layout)
            break
        fields = line.split(layout.separator)[:count]
        if len(fields) != count:
            raise MeasurementError(
                f"line {number}: found {len(fields)} fields; expected {count}; the file is cut off, export it again"
            )
        if layout.x_columns == "no":
            fields[0] = "0"
        for text in fields:
            plain = text.strip().replace(",", ".") if layout.decimal == "," else text.strip()
            try:
                numbers.append(float(plain))
            except ValueError:
                raise bad_number(text, f"line {number}") from None
            if "_" in plain:
                raise bad_number(text, f"line {number}")
    if not numbers:
        raise MeasurementError(f"line {number}: found no row of numbers; expected the samples; export it again")
    return np.frombuffer(numbers, dtype=float).reshape(-1, count).copy(), following
