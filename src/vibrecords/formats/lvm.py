"""LabVIEW measurement files (``.lvm``): time histories, spectra, and FRFs as columns of real and imaginary part."""

import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from vibrecords.arrays import Array
from vibrecords.errors import refusal, require_at_most
from vibrecords.formats.names import float_of
from vibrecords.formats.table_text import Column, ColumnTable, Lines, bad_number, column_of, read_rows, text_lines
from vibrecords.records import MOST_COLUMNS, require_short

_END = "***End_of_Header***"


#: What the header of the file says of all segments: separator, decimal_separator, x_columns.
_Layout = dict[str, str]


@dataclass(slots=True)
class _Segment:
    """Header of a segment: fields by name, each with one value for each column behind the first."""

    line: int
    fields: dict[str, list[str]] = field(default_factory=dict)

    def each(self, key: str, count: int) -> list[str]:
        """Values of a field, one for each column, empty where there are fewer."""
        return [*self.fields.get(key, []), *[""] * count][:count]


def read_lvm(path: Path) -> Iterator[ColumnTable]:
    """Tables of a LabVIEW measurement file; a segment or block that comes again counts as the next hit.

    Raises
    ------
    MeasurementError
        If the header has no end, the file is cut off, or a field is not a number.
    """
    with path.open("rb") as file:
        file.seek(-1, 2)
        is_cut = file.read(1) not in b"\r\n\0"
    lines = _without_special_blocks(text_lines(path))
    layout = _file_header(lines)
    blocks = enumerate(_blocks(lines, layout), start=1)
    block = next(blocks, None)
    if block is None:
        raise refusal("header", "no segment of data", "at least one", "export the measurement again")
    while block is not None:
        number, (segment, names, values) = block
        following = next(blocks, None)
        samples = _samples(segment)
        if following is None and is_cut and len(values) < samples:
            remedy = "the file is cut off within a number, export it again"
            raise refusal(f"line {segment.line}", f"{len(values)} rows of the segment", f"{samples} samples", remedy)
        hit = number if number > 1 or following is not None else None
        yield _table(segment, names, values, layout, f"segment {number}", hit)
        block = following


def _without_special_blocks(lines: Lines) -> Lines:
    for number, line in lines:
        if line.startswith("***Start_Special***"):
            next((True for _, inside in lines if inside.startswith("***End_Special***")), None)
        else:
            yield number, line


def _file_header(lines: Lines) -> _Layout:
    layout, number, separators = {"separator": "tab", "x_columns": "one"}, 0, {"tab": "\t", "comma": ","}
    for number, line in lines:
        if line.startswith(_END):
            return {**layout, "separator": separators[layout["separator"]]}
        key, value = [*re.split(r"[\t,]", line, maxsplit=1), ""][:2]
        layout[key.strip().lower()] = value.strip("\t ").lower()
        if layout["separator"] not in separators:
            raise refusal(f"line {number}", f"separator {value[:20]!r}", "Tab or Comma")
    raise refusal(f"line {number}", "the end of the file", _END, "it is cut off, export again")


def _blocks(lines: Lines, layout: _Layout) -> Iterator[tuple[_Segment, list[str], Array]]:
    """Segments with the names of their columns and their rows; several blocks may stand under one header."""
    segment, names = None, []
    while first := next(((number, line) for number, line in lines if line.strip()), None):
        rows: Lines = lines
        if segment is not None and first[1].lstrip()[0] in "0123456789+-.":
            rows = itertools.chain([first], lines)
        else:
            segment = _segment_header(first, lines, layout)
            number, line = next(lines, (segment.line, ""))
            names = [name.strip() for name in line.split(layout["separator"])]
            if names[0].lower() != "x_value":
                raise refusal(f"line {number}", f"{line[:30]!r}", "the names of columns, X_Value first")
            while names[-1].lower() in ("", "comment"):
                names.pop()
            require_at_most(MOST_COLUMNS, len(names), f"line {number}", "columns", "split the file")
            require_short(f"line {number}", *names)
        values, gaps = read_rows(_split_rows(rows, layout, len(names)), len(names))
        if not len(values):
            raise refusal(f"line {segment.line}", "no row of numbers in the segment", "the samples", "export it again")
        if axes := [line for i, line in gaps.items() if names[i].lower() == "x_value"]:
            raise bad_number("", f"line {min(axes)}")
        values[:, list(gaps)] = np.nan  # a channel of another rate, whose samples do not fill the rows
        samples = _samples(segment)
        with np.errstate(invalid="ignore"):
            bounds = np.flatnonzero(np.diff(values[:, 0]) < 0) + 1  # where the axis begins again
        if layout["x_columns"] == "no" and samples and len(values) % samples == 0:
            bounds = np.arange(samples, len(values), samples)
        for block in np.split(values, bounds):
            yield segment, names, block


def _samples(segment: _Segment) -> int:
    """Samples that the header promises; 0 where it does not say."""
    return max((int(n) for n in segment.fields.get("samples", []) if n.isdecimal() and len(n) < 19), default=0)


def _segment_header(first: tuple[int, str], lines: Lines, layout: _Layout) -> _Segment:
    segment = _Segment(first[0])
    for _, line in itertools.chain([first], lines):
        if line.startswith(_END):
            if layout["x_columns"] == "multi" and any(segment.each("x_dimension", 2)[1:]):  # no cell for an X column
                segment.fields = {k: [c for cell in cells for c in (cell, "")] for k, cells in segment.fields.items()}
            return segment
        key, *values = line.split(layout["separator"])
        segment.fields[key.strip().lower()] = [value.strip() for value in values]
        if len(segment.fields) > 1000:
            break
    raise refusal(f"line {segment.line}", "no end of the segment's header", _END, "the file is cut off, export again")


def _split_rows(lines: Lines, layout: _Layout, count: int) -> Iterator[tuple[int, list[str]]]:
    """Rows up to a blank line or the end, without comments."""
    decimal = layout.get("decimal_separator")
    comma = decimal == "," or (not decimal and layout["separator"] != ",")
    for number, line in lines:
        if not line.strip():
            return
        fields = (line.replace(",", ".") if comma else line).split(layout["separator"])[:count]
        if layout["x_columns"] == "no":
            fields[0] = "nan"
        yield number, fields


@np.errstate(all="ignore")
def _table(
    segment: _Segment, names: list[str], values: Array, layout: _Layout, place: str, hit: int | None
) -> ColumnTable:
    """Columns of a segment, with notes on counts and steps; an axis that is not written out is made from the header."""
    # 1. counts of samples
    notes = []
    samples, counts = _samples(segment), segment.each("samples", len(names) - 1)
    if layout["x_columns"] != "multi" and counts[:1] == [str(samples)]:  # X_Value is that of the first channel
        side = [i for i, count in enumerate(counts, start=1) if count.isdecimal() and int(count) != samples]
        values[:, side] = np.nan
        notes += [f"'{names[i]}' not read: {counts[i - 1]} samples, where {names[1]!r} has {samples}" for i in side]
    filled = np.asarray(~np.isnan(values).all(axis=0))
    if samples > 1 and samples != len(values):
        notes.append(f"{len(values)} rows, where the header says {samples} samples")
    # 2. the clock
    told_of = zip(names[1:], filled[1:], *(segment.each(k, len(names) - 1) for k in ("x0", "delta_x")), strict=True)
    clocks = [(name, x0, step) for name, some, x0, step in told_of if some and step and name.lower() != "x_value"]
    if layout["x_columns"] != "multi":
        for before, other in itertools.pairwise(clocks):
            if before[1:] != other[1:]:
                both = (f"{x0[:20]!r} and Delta_X {step[:20]!r} of {name!r}" for name, x0, step in (other, before))
                remedy = "export with an X column for each channel"
                raise refusal(f"line {segment.line}", f"X0 {', '.join(both)}", "one clock for one X column", remedy)
    clock = clocks[0][1:] if clocks else ("", "")
    x0, step = (float_of(text.replace(",", ".") or "0") for text in clock)
    if layout["x_columns"] == "no":
        if x0 is None or not step:
            found = f"X0 {clock[0][:20]!r} and Delta_X {clock[1][:20]!r}"
            raise refusal(f"line {segment.line}", found, "numbers", "export it again")
        values[:, 0] = x0 + step * np.arange(len(values))
        digits = len(re.sub(r"^[0.]+|\.|e.*", "", clock[1].replace(",", ".").lower()).rstrip("0"))
        if digits in (2, 3):
            notes.append(f"sampling rate {1 / step:g} Hz from a Delta_X of {digits} digits, {clock[1]}")
    elif step and len(values) > 1:
        own = (values[-1, 0] - values[0, 0]) / (len(values) - 1)
        if abs(own / step - 1) > 0.01:
            notes.append(f"X_Value goes in steps of {own:g}, where Delta_X says {step:g}: X_Value taken")
    # 3. columns and comments
    count = len(names)
    units, dimensions, axis_units = (segment.each(k, count) for k in ("y_unit_label", "x_dimension", "x_unit_label"))
    columns: list[Column] = []
    empty = np.asarray(np.isnan(values).all(axis=0))
    for i, name in enumerate(names):  # the header has a cell for each column behind the first
        if name.lower() == "x_value" and empty[i] and not empty[i + 1 : i + 2].all():
            raise refusal(f"line {segment.line}", f"an empty X_Value of {names[i + 1]!r}", "numbers")
        if name.lower() != "x_value":
            columns.append(column_of(f"{name} [{units[i - 1]}]" if units[i - 1] else name))
        elif dimensions[i].lower() == "frequency":
            columns.append(Column("frequency", "", axis_units[i] or "Hz", header=name))
        else:
            columns.append(Column("time", "", "s", header=name))
    comments = {}
    for note in segment.each("notes", 1)[0].split(";"):
        key, _, value = note.partition(":")
        comments[key.strip().lower()] = value.strip()
    if told := float_of(next(filter(None, segment.each("delta_x", count)), "").replace(",", ".")):
        comments.setdefault("sample_rate_hz", repr(1 / told))
    return ColumnTable(columns, values, comments, tuple(notes), place, hit)
