"""Universal files (UFF, UNV): data sets 58 and 58b, with headers 151 and 164, streamed.

Why not pyuff: it holds the whole file in memory, names no line, reads garbled header fields as zero and replaces NaN.
The tests read its files and have it read ours.
"""

import math
import re
from collections import Counter
from collections.abc import Generator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO, TypeVar

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError
from jointbayes.frf import Quantity
from jointbayes.measurement.formats.table_text import float_of
from jointbayes.measurement.formats.uff_data_sets import (
    AXIS_TYPES,
    CORRECTIONS,
    FunctionHeader,
    LineError,
    UffDataSet,
    line_of,
    scan,
)
from jointbayes.measurement.formats.uff_values import Function, decode
from jointbayes.measurement.formats.units import (
    MOTION_OF,
    frequency_factor,
    frf_unit,
    read_frf_unit,
    read_sensor_unit,
    scaled,
)
from jointbayes.measurement.records import (
    MOST_RECORDS,
    FrfRecord,
    Record,
    SensorQuantity,
    TimeRecord,
    dof_label,
    even_rate,
)

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
    if not below or frf_unit(above) is not None:
        return _meaning(above, read_frf_unit(above), named, units.length / units.force, units)
    unit = f"({above})/{below}" if "/" in above else f"{above}/{below}"
    return _meaning(unit if above else "", read_frf_unit(above, below), named, units.length / units.force, units)


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


_TIME, _FRF, _COHERENCE = 1, 4, 6
#: An FRF has up to four: values, coherence, and corrections of both.
_MOST_SETS = 4 * MOST_RECORDS + 100
Pair = tuple[str, str]


def read_uff(path: Path) -> Generator[Record, None, None]:
    """FRFs and time histories of a universal file, in its order, one in memory at a time.

    A first pass finds the data sets, so that a file cut off is refused before anything is read from it, and so that the
    coherence of an FRF is found wherever it stands.

    Raises
    ------
    MeasurementError
        If the file is cut off, a count is wrong or a field is not a number.
    """
    with path.open("rb") as file:
        sets, corrections, units = _index(file)
        coherences: dict[Pair, list[UffDataSet]] = {}
        occurrences: Counter[tuple[Pair, int]] = Counter()
        for data_set in sets:
            if _function(data_set) == _COHERENCE:
                coherences.setdefault(_pair(data_set), []).append(data_set)
            elif _function(data_set) in (_FRF, _TIME):
                occurrences[_signal(data_set)] += 1
        if not occurrences:
            kinds = sorted({data_set.kind for data_set in sets})
            raise MeasurementError(
                f"data sets: found {len(sets)} of the types {', '.join(map(str, kinds[:10])) or 'none'}, and no FRF or "
                "time history among them; expected data sets 58 of function type 4 or 1; export the FRFs"
            )
        seen: Counter[tuple[Pair, int]] = Counter()
        for data_set in sets:
            if _function(data_set) not in (_FRF, _TIME):
                continue
            pair, count = _pair(data_set), occurrences[_signal(data_set)]
            seen[_signal(data_set)] += 1
            nth = seen[_signal(data_set)]
            if _function(data_set) == _TIME:
                yield _time_record(file, data_set, corrections, units, nth if count > 1 else None)
                continue
            of_pair = coherences.get(pair, [])
            paired = len(of_pair) == count
            record = _frf_record(file, data_set, of_pair[nth - 1] if paired else None, corrections, units)
            if of_pair and not paired:
                left = f"{len(of_pair)} coherences for {count} FRFs of this pair: none taken"
                record = replace(record, notes=(*record.notes, left))
            yield record


def _index(file: BinaryIO) -> tuple[list[UffDataSet], dict[int, UffDataSet], FileUnits]:
    sets, corrections, units = [], {}, FileUnits()
    for data_set in scan(file):
        behind = file.tell()
        if data_set.number > _MOST_SETS:
            raise MeasurementError(
                f"data sets: found more than {_MOST_SETS}; expected at most {MOST_RECORDS} FRFs and time histories "
                "with what belongs to them; split the file"
            )
        if data_set.kind == CORRECTIONS:
            corrections[data_set.number - 1] = data_set
        elif data_set.kind == 164:
            if data_set.stop - data_set.start > 4096:
                raise MeasurementError(
                    f"data set {data_set.number}: found {data_set.stop - data_set.start} bytes of units; expected "
                    "3 lines"
                )
            try:
                units = units_of(_body(file, data_set))
            except LineError as error:
                line = line_of(file, data_set.start) + error.line
                raise MeasurementError(f"data set {data_set.number}, line {line}: {error}") from None
        else:
            sets.append(data_set)
        file.seek(behind)
    return sets, corrections, units


def _function(data_set: UffDataSet) -> int | None:
    """Function type, with complex spectra of unknown type over frequency counted as FRFs; None where not a 58."""
    header = data_set.header
    if header is None:
        return None
    return _FRF if header.function == 0 and header.is_complex and header.abscissa.kind == 18 else header.function


def _pair(data_set: UffDataSet) -> Pair:
    assert data_set.header is not None
    return _labels(data_set.header)


def _labels(header: FunctionHeader) -> Pair:
    """Labels of response and reference: from the degrees of freedom, or from ID lines that our writer left."""
    labels = []
    for key, dof in (("response", header.response), ("reference", header.reference)):
        named = next((line for line in header.ids if line.startswith(f"{key}=")), None)
        labels.append(named.removeprefix(f"{key}=") if named else dof_label(dof))
    return labels[0], labels[1]


def _signal(data_set: UffDataSet) -> tuple[Pair, int]:
    """What occurs again with each hit: force and motion of one point are time histories of two kinds."""
    assert data_set.header is not None
    return _pair(data_set), data_set.header.numerator.kind if _function(data_set) == _TIME else 0


def _body(file: BinaryIO, data_set: UffDataSet) -> bytes:
    file.seek(data_set.start)
    return file.read(data_set.stop - data_set.start)


def _read(file: BinaryIO, data_set: UffDataSet, corrections: dict[int, UffDataSet]) -> Function:
    header = data_set.header
    assert header is not None
    try:
        function = decode(header, _body(file, data_set))
    except LineError as error:
        line = line_of(file, data_set.start) + error.line
        raise MeasurementError(f"data set {data_set.number}, line {line}: {error}") from None
    if data_set.number not in corrections:
        return function
    return _corrected(function, _body(file, corrections[data_set.number]), data_set)


def _corrected(function: Function, body: bytes, data_set: UffDataSet) -> Function:
    """Values with the digits that did not fit their columns: steps in units of the last place, for each number."""
    ordinate = function.ordinate.view(float) if np.iscomplexobj(function.ordinate) else function.ordinate
    count = function.abscissa.size + ordinate.size
    text = body.split()
    if len(text) != count or not all(re.fullmatch(rb"[+-]\d{1,18}", step) for step in text):
        raise MeasurementError(
            f"data set {data_set.number + 1}: found {len(text)} corrections; expected {count} whole numbers; "
            "take the data set out or export again"
        )
    steps = np.array(text, dtype="S20").astype(np.int64)
    for numbers, corrections in (
        (function.abscissa, steps[: function.abscissa.size]),
        (ordinate, steps[function.abscissa.size :]),
    ):
        numbers.view(np.int64)[...] += corrections
    return function


def _frf_record(
    file: BinaryIO,
    data_set: UffDataSet,
    coherence: UffDataSet | None,
    corrections: dict[int, UffDataSet],
    units: FileUnits,
) -> FrfRecord:
    header = data_set.header
    assert header is not None
    function = _read(file, data_set, corrections)
    quantity, factor, unit, notes = frf_meaning(header, units)
    if header.function == 0:
        notes.append("function of unknown type taken for an FRF")
    if not header.is_complex:
        notes.append("FRF without imaginary part")
    lines = _frequency_hz(function.abscissa, header, notes)
    squared = None
    if coherence is not None:
        read = _read(file, coherence, corrections)
        assert coherence.header is not None
        squared = np.asarray(read.ordinate.real)
        coherence_lines = _frequency_hz(read.abscissa, coherence.header, [])
        if coherence_lines.size != lines.size or not np.allclose(coherence_lines, lines, rtol=1e-6, equal_nan=True):
            raise MeasurementError(
                f"data set {coherence.number}: found a coherence of {squared.size} lines that are not those of the FRF "
                f"in data set {data_set.number} ({lines.size} lines); expected the same lines; export again"
            )
    response, reference = _labels(header)
    values = scaled(function.ordinate, factor)
    return FrfRecord(
        response,
        reference,
        lines,
        np.asarray(values, complex),
        quantity,
        unit,
        squared,
        _averages(header),
        f"data set {data_set.number}",
        tuple(notes),
        factor,
    )


def _frequency_hz(abscissa: Array, header: FunctionHeader, notes: list[str]) -> Array:
    unit = header.abscissa.unit
    factor = frequency_factor(unit) if unit else 1.0
    if factor is None:
        notes.append(f"unit {unit!r} of the frequency not understood, taken as Hz")
        return abscissa
    if factor == 1:
        return abscissa
    notes.append(f"frequency in {unit} converted to Hz")
    return abscissa * factor


def _averages(header: FunctionHeader) -> int | None:
    """Number of averages, for which the format has no field, where an ID line tells it."""
    for line in header.ids:
        match = re.search(r"\baverages?\s*[:=]?\s*(\d{1,9})\b|\b(\d{1,9})\s+averages?\b", line, re.IGNORECASE)
        if match and int(match[1] or match[2]) > 0:
            return int(match[1] or match[2])
    return None


def _time_record(
    file: BinaryIO, data_set: UffDataSet, corrections: dict[int, UffDataSet], units: FileUnits, nth: int | None
) -> TimeRecord:
    header = data_set.header
    assert header is not None
    function = _read(file, data_set, corrections)
    if header.is_complex:
        raise MeasurementError(
            f"data set {data_set.number}: found complex values of a time history; expected real ones; export again"
        )
    scale = 1e-3 if header.abscissa.unit.lower() in ("ms", "msec") else 1.0
    told = next((line for line in header.ids if line.startswith("sample_rate_hz=")), "")
    rate = even_rate(function.abscissa * scale, f"data set {data_set.number}")
    exact = float_of(told.removeprefix("sample_rate_hz="))
    if exact is not None and abs(exact / rate - 1) < 1e-3:
        rate = exact  # its inverse, the step, is rounded
    quantity, factor, unit, notes = sensor_meaning(header, units)
    hit = next((re.fullmatch(r"hit (\d{1,9})", line) for line in header.ids if line.startswith("hit ")), None)
    values = scaled(function.ordinate.real, factor)
    return TimeRecord(
        _labels(header)[0],
        rate,
        values,
        quantity,
        unit,
        int(hit[1]) if hit else nth,
        f"data set {data_set.number}",
        tuple(notes),
        factor,
    )
