"""Universal files (UFF, UNV): data sets 58, 58b and 55, with headers 151 and 164, streamed.

Why not pyuff: it holds the whole file in memory, names no line, reads garbled header fields as zero and replaces NaN.
The tests read its files and have it read ours.
"""

import re
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np

from vibrecords.arrays import Array, ComplexArray
from vibrecords.errors import MeasurementError
from vibrecords.formats.columns import TIME_S
from vibrecords.formats.table_text import float_of
from vibrecords.formats.uff_data_sets import (
    MOST_MODE_BYTES,
    FileUnits,
    FunctionHeader,
    LineError,
    UffDataSet,
    decode,
    even_abscissa,
    frf_meaning,
    line_of,
    read_mode,
    scan,
    sensor_meaning,
    units_of,
)
from vibrecords.formats.units import frequency_factor, scaled
from vibrecords.records import (
    MOST_BYTES,
    MOST_RECORDS,
    CoherenceRecord,
    FrfRecord,
    Record,
    SpectrumRecord,
    TimeRecord,
    dof_label,
    even_rate,
)

_TIME, _FRF, _COHERENCE, _MODES = 1, 4, 6, 55
#: Functions that are listed and no data, by their types.
_LISTED = {
    0: "function of unknown type",
    2: "auto spectrum",
    3: "cross spectrum",
    5: "transmissibility",
    7: "auto correlation",
    8: "cross correlation",
    9: "power spectral density",
    10: "energy spectral density",
    12: "spectrum",
}
_PART = 2**22  # bytes of a function that are decoded at once
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
        if size > most:
            raise MeasurementError(
                f"data set {data_set.number}: found {size} bytes of type {data_set.kind}; expected at most {most}; "
                "export less"
            )
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
        """Those of the last data set 164 before it, or else of the first in the file."""
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
        source = _index(file)
        empty = True
        for data_set, place, nth in source.sets:
            record = _record(source, data_set, place, nth)
            if record is not None:
                empty = False
                yield record
                del record  # before the next is read
        if empty:
            kinds = sorted({data_set.kind for data_set, _, _ in source.sets})
            raise MeasurementError(
                f"data sets: found {len(source.sets)} of the types {', '.join(map(str, kinds[:10])) or 'none'}, and no "
                "FRF, time history or mode among them; expected data sets 58 of function type 4 or 1, or 55 of modes; "
                "export the FRFs"
            )


def _index(file: BinaryIO) -> _UniversalFile:
    source = _UniversalFile(file)
    for data_set in scan(file):
        behind = file.tell()
        if data_set.number > _MOST_SETS:
            raise MeasurementError(
                f"data sets: found more than {_MOST_SETS}; expected at most {MOST_RECORDS} FRFs and time histories "
                "with what belongs to them; split the file"
            )
        if data_set.kind == 164:
            with source.located(data_set):
                source.units[data_set.number] = units_of(source.body(data_set, 4096))
        else:
            place = _place(data_set)
            source.places.setdefault(place, []).append(data_set)
            source.sets.append((data_set, place, len(source.places[place])))
        file.seek(behind)
    return source


def _place(data_set: UffDataSet) -> Place:
    """Type and labels, with complex functions of unknown type over frequency counted as FRFs."""
    header = data_set.header
    if header is None:
        return _MODES if data_set.kind == 55 else -data_set.kind, "", "", 0
    is_frf = header.function == 0 and header.is_complex and header.abscissa.kind == 18
    labels = []
    for key, dof in (("response", header.response), ("reference", header.reference)):
        named = next((line for line in header.ids if line.startswith(f"{key}=")), None)  # as our writer leaves it
        labels.append(named.removeprefix(f"{key}=") if named else dof_label(dof))
    # force and motion of one point are time histories of two kinds
    sensor = header.numerator.kind if header.function == _TIME else 0
    return _FRF if is_frf else header.function, labels[0], labels[1], sensor


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
        words, none = _LISTED.get(kind, f"function of type {kind}"), np.empty(0)
        told = header.even and header.abscissa.kind == 18 and header.count <= data_set.stop - data_set.start
        lines = _frequency_hz(even_abscissa(header), header, []) if told else none
        return SpectrumRecord(response, words, lines, none, header.numerator.unit, where, ("values not read",))
    axis_kind, axis_unit = header.abscissa.kind, header.abscissa.unit
    over_time = axis_kind == 17 or (axis_kind != 18 and axis_unit.lower() in TIME_S)
    over_frequency = axis_kind == 18 or (axis_kind != 17 and frequency_factor(axis_unit) is not None)
    if over_frequency if kind == _TIME else over_time:
        axis = f"an abscissa of type {axis_kind} and unit {axis_unit or 'none'}"
        expected = "time (17, s)" if kind == _TIME else "frequency (18, Hz)"
        raise MeasurementError(
            f"{where}: found a function of type {kind} over {axis}; expected {expected}; correct the type of function "
            "or the axis"
        )
    if kind == _TIME:
        return _time(source, data_set, response, nth if len(source.places[place]) > 1 else None)
    if kind == _FRF:
        return _frf(source, data_set, place, nth)
    if (_FRF, response, reference, 0) in source.places:
        return None
    header, abscissa, squared = source.function(data_set)
    notes: list[str] = []
    lines = _frequency_hz(abscissa, header, notes)
    return CoherenceRecord(response, reference, lines, squared.real, _averages(header), where, tuple(notes))


def _frf(source: _UniversalFile, data_set: UffDataSet, place: Place, nth: int) -> FrfRecord:
    header, abscissa, ordinate = source.function(data_set)
    _, response, reference, _ = place
    quantity, factor, unit, notes = frf_meaning(header, source.units_of(data_set))
    if header.function == 0:
        notes.append("function of unknown type taken for an FRF")
    if not header.is_complex:
        notes.append("FRF without imaginary part")
    lines = _frequency_hz(abscissa, header, notes)
    of_pair, squared = source.places.get((_COHERENCE, response, reference, 0), []), None
    if of_pair and len(of_pair) != len(source.places[place]):
        notes.append(f"{len(of_pair)} coherences for {len(source.places[place])} FRFs of this pair: none taken")
    elif of_pair:
        coherence = of_pair[nth - 1]
        coherence_header, coherence_abscissa, gamma2 = source.function(coherence)
        squared, coherence_lines = gamma2.real, _frequency_hz(coherence_abscissa, coherence_header, [])
        if coherence_lines.size != lines.size or not np.allclose(coherence_lines, lines, rtol=1e-6, equal_nan=True):
            raise MeasurementError(
                f"data set {coherence.number}: found a coherence of {squared.size} lines that are not those of the FRF "
                f"in data set {data_set.number} ({lines.size} lines); expected the same lines; export again"
            )
    values, where = scaled(ordinate, factor).astype(complex, copy=False), f"data set {data_set.number}"
    pair, averages = (response, reference), _averages(header)
    return FrfRecord(*pair, lines, values, quantity, unit, squared, averages, where, tuple(notes), factor)


def _frequency_hz(abscissa: Array, header: FunctionHeader, notes: list[str]) -> Array:
    unit = header.abscissa.unit
    factor = frequency_factor(unit) if unit else 1.0
    if factor is None:
        notes.append(f"unit {unit!r} of the frequency not understood, taken as Hz")
    elif factor != 1:
        notes.append(f"frequency in {unit} converted to Hz")
    return abscissa * (factor or 1.0)


def _averages(header: FunctionHeader) -> int | None:
    """Number of averages, for which the format has no field, where an ID line tells it."""
    for line in header.ids:
        match = re.search(r"\baverages?\s*[:=]?\s*(\d{1,9})\b|\b(\d{1,9})\s+averages?\b", line, re.IGNORECASE)
        if match and int(match[1] or match[2]) > 0:
            return int(match[1] or match[2])
    return None


def _time(source: _UniversalFile, data_set: UffDataSet, channel: str, nth: int | None) -> TimeRecord:
    header, abscissa, ordinate = source.function(data_set)
    if header.is_complex:
        raise MeasurementError(
            f"data set {data_set.number}: found complex values of a time history; expected real ones; export again"
        )
    scale = TIME_S.get(header.abscissa.unit.lower(), 1.0)
    told = next((line for line in header.ids if line.startswith("sample_rate_hz=")), "")
    instants = header.increment * np.arange(min(header.count, 2)) if header.even else abscissa
    rate = even_rate(np.asarray(instants * scale, dtype=float), f"data set {data_set.number}")
    exact = float_of(told.removeprefix("sample_rate_hz="))
    if exact is not None and abs(exact / rate - 1) < 1e-3:
        rate = exact  # its inverse, the step, is rounded
    quantity, factor, unit, notes = sensor_meaning(header, source.units_of(data_set))
    hit = next((re.fullmatch(r"hit (\d{1,9})", line) for line in header.ids if line.startswith("hit ")), None)
    values = scaled(ordinate.real, factor)
    place = f"data set {data_set.number}"
    return TimeRecord(channel, rate, values, quantity, unit, int(hit[1]) if hit else nth, place, tuple(notes), factor)
