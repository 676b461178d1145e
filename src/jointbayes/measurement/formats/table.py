"""CSV and TSV tables: columns with names and units as FRFs or time histories, read and written."""

import csv
import re
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError
from jointbayes.frf import Quantity
from jointbayes.measurement.formats.table_text import float_of, read_text_table
from jointbayes.measurement.formats.units import (
    frequency_factor,
    read_frf_unit,
    read_sensor_unit,
    scaled,
    si_frf_unit,
    si_sensor_unit,
)
from jointbayes.measurement.records import MOST_AVERAGES, FrfRecord, Record, TimeRecord, even_rate

Role = Literal["frequency", "time", "real", "imaginary", "magnitude", "phase", "coherence", "other"]
#: Words for each role; looked for at the beginning or end of a name.
_WORDS: tuple[tuple[Role, str], ...] = (
    ("frequency", r"frequency|frequenz|freq|omega|f|ω"),
    ("time", r"time|zeit|t"),
    ("coherence", r"coherence|coh|kohärenz|gamma2|γ²|γ2"),
    ("real", r"real ?part|real|re"),
    ("imaginary", r"imaginary ?part|imag\.? ?part|imaginary|imag|im"),
    ("magnitude", r"magnitude|mag|amplitude|abs|betrag|modulus"),
    ("phase", r"phase|angle|arg"),
)
_QUANTITY_WORDS: tuple[tuple[Quantity, str], ...] = (
    ("accelerance", r"accelerance|inertance"),
    ("mobility", r"mobility"),
    ("receptance", r"receptance|compliance|admittance"),
)
_UNIT = re.compile(r"^(?P<name>.*?)\s*(?:\[(?P<square>[^\]]*)\]|\((?P<round>.*)\))\s*$")


@dataclass(frozen=True, slots=True)
class Column:
    """Role, channel name and unit of a column."""

    role: Role
    name: str
    unit: str
    quantity: Quantity | None = None


def column_of(header: str) -> Column:
    """Role, name and unit of a column from its header.

    Examples
    --------
    >>> column_of("Real 11:y / 11:y [g/N]")
    Column(role='real', name='11:y / 11:y', unit='g/N', quantity=None)
    >>> column_of("Frequency (rad/s)").unit
    'rad/s'
    """
    header = " ".join(header.split())
    # looked for where there can be one: a search for a bracket that is not there takes quadratic time
    match = _UNIT.match(header) if header.endswith(("]", ")")) else None
    name = header if match is None else match["name"]
    unit = "" if match is None else (match["square"] if match["square"] is not None else match["round"]).strip()
    if match is None and (slash := re.fullmatch(r"(\S+) ?/ ?(Hz|rad/s|s|ms)", header)):
        name, unit = slash[1], slash[2]
    quantity: Quantity | None = None
    for candidate, words in _QUANTITY_WORDS:
        shorter = re.sub(rf"\b(?:{words})\b", " ", name, flags=re.IGNORECASE)
        if shorter != name:
            quantity, name = candidate, shorter
    for role, words in _WORDS:
        # a word glued to digits or letters is part of a channel's name: "force" is not f
        for pattern in (rf"^\s*(?:{words})(?![\w:])[\s_.:,-]*", rf"(?<![\w:])[\s_.,-]*(?:{words})\s*$"):
            rest = re.sub(pattern, "", name, flags=re.IGNORECASE)
            if rest != name:
                return Column(role, " ".join(rest.split()), unit, quantity)
    return Column("other", " ".join(name.split()), unit, quantity)


def column_records(
    columns: Sequence[Column], values: Array, comments: Mapping[str, str], notes: tuple[str, ...] = ()
) -> Iterator[Record]:
    """FRFs or time histories of a table; the first column must be frequency or time.

    Parameters
    ----------
    columns
        Of the table, one for each column of `values`.
    values
        Numbers, shape (rows, columns).
    comments
        ``averages``, ``quantity`` and ``sample_rate_hz`` where the file tells them.
    notes
        What was done so far.

    Raises
    ------
    MeasurementError
        If columns do not pair up, or a unit of the axis is not known.
    """
    if columns[0].role == "time":
        yield from _time_records(columns, values, comments, notes)
        return
    if columns[0].role != "frequency":
        raise MeasurementError(
            f"column 1: found {columns[0].name or 'no name'!r}; expected frequency or time; name the column"
        )
    axis = columns[0]
    unit = axis.unit or ("rad/s" if axis.role == "frequency" and "omega" in axis.name.lower() else "")
    factor = 1.0 if not unit else frequency_factor(unit)
    if factor is None:
        raise MeasurementError(f"column 1: found the unit {unit!r}; expected Hz or rad/s; correct the header")
    if factor != 1:
        notes = (*notes, f"frequency in {unit} converted to Hz")
    lines = values[:, 0] * factor
    frfs = _pair_up(columns)
    averages = _averages(comments, len(frfs))
    for (name, parts), n in zip(frfs, averages, strict=True):
        yield _frf(columns, parts, values, lines, name, n, comments, notes)


def _pair_up(columns: Sequence[Column]) -> list[tuple[str, dict[Role, int]]]:
    """FRFs by name with their columns: those of one name belong together, a role that comes again begins the next."""
    frfs: list[tuple[str, dict[Role, int]]] = []
    of_name: dict[str, list[dict[Role, int]]] = {}
    times: dict[tuple[str, Role], int] = {}
    for i, column in enumerate(columns[1:], start=1):
        if column.role not in ("real", "imaginary", "magnitude", "phase", "coherence"):
            raise MeasurementError(
                f"column {i + 1}: found {column.name!r}; expected real, imaginary, magnitude, phase or coherence in "
                "the name; name the column"
            )
        nth = times[column.name, column.role] = times.get((column.name, column.role), -1) + 1
        alike = of_name.setdefault(column.name, [])
        if nth == len(alike):
            alike.append({})
            frfs.append((column.name, alike[nth]))
        alike[nth][column.role] = i
    for name, parts in frfs:
        roles = set(parts) - {"coherence"}
        if roles not in ({"real", "imaginary"}, {"magnitude", "phase"}):
            first = min(parts.values()) + 1
            raise MeasurementError(
                f"column {first}: found {' and '.join(sorted(parts))} of {name!r}; expected real and "
                "imaginary, or magnitude and phase; complete the columns"
            )
    if not frfs:
        raise MeasurementError("header: found a frequency column only; expected real and imaginary columns; add them")
    return frfs


def _averages(comments: Mapping[str, str], count: int) -> list[int | None]:
    text = comments.get("averages", "")
    if not text:
        return [None] * count
    numbers = [number.strip() for number in text.split(",")]
    if any(not number.isdecimal() or len(number) > 9 or not 1 <= int(number) <= MOST_AVERAGES for number in numbers):
        raise MeasurementError(
            f"header: found averages {text[:30]!r}; expected whole numbers from 1 to {MOST_AVERAGES}; correct it"
        )
    if len(numbers) not in (1, count):
        raise MeasurementError(f"header: found {len(numbers)} numbers of averages; expected 1 or {count}; correct it")
    return [*map(int, numbers)] * (count if len(numbers) == 1 else 1)


def _frf(
    columns: Sequence[Column],
    parts: Mapping[Role, int],
    values: Array,
    lines: Array,
    name: str,
    averages: int | None,
    comments: Mapping[str, str],
    notes: tuple[str, ...],
) -> FrfRecord:
    record_notes = list(notes)
    first = columns[parts["real" if "real" in parts else "magnitude"]]
    unit = first.unit
    if "real" in parts:
        complex_ = np.empty(lines.size, complex)
        complex_.real, complex_.imag = values[:, parts["real"]], values[:, parts["imaginary"]]
    else:
        magnitude, unit = _magnitude(values[:, parts["magnitude"]], unit, record_notes)
        phase = _phase(values[:, parts["phase"]], columns[parts["phase"]].unit, record_notes)
        with np.errstate(invalid="ignore"):
            complex_ = magnitude * np.exp(1j * phase)
    factor, of_unit, converted = read_frf_unit(unit)
    complex_ = scaled(complex_, factor)
    record_notes += converted
    word = comments.get("quantity", "").lower()
    named = next((candidate for candidate, words in _QUANTITY_WORDS if word and re.fullmatch(words, word)), None)
    response, _, reference = (label.strip() for label in re.sub(r"\s+over\s+", " / ", name).rpartition(" / "))
    if not response:
        response, reference = (reference or "output 1"), "input 1"
        record_notes.append("the header does not name response and reference")
    numbers = sorted(parts.values())
    place = f"columns {', '.join(str(i + 1) for i in numbers[:-1])} and {numbers[-1] + 1}"
    coherence = values[:, parts["coherence"]] if "coherence" in parts else None
    quantity = first.quantity or named or of_unit
    return FrfRecord(
        response,
        reference,
        lines,
        complex_,
        quantity,
        first.unit,
        coherence,
        averages,
        place,
        tuple(record_notes),
        factor,
    )


def _magnitude(values: Array, unit: str, notes: list[str]) -> tuple[Array, str]:
    if not re.match(r"dB\b", unit, re.IGNORECASE):
        return values, unit
    reference = re.sub(r"^dB\s*(?:,|re\.?|ref\.?)?\s*1?\s*", "", unit, flags=re.IGNORECASE)
    notes.append(f"decibels taken as 20 log10 of the magnitude over 1 {reference}".rstrip())
    with np.errstate(over="ignore"):
        return 10 ** (values / 20), reference


def _phase(values: Array, unit: str, notes: list[str]) -> Array:
    word = unit.strip().lower()
    if word in ("rad", "radian", "radians"):
        return values
    if word in ("deg", "°", "degree", "degrees", "grad"):
        return np.deg2rad(values)
    if word:
        raise MeasurementError(f"header: found the phase in {unit!r}; expected deg or rad; correct the header")
    # no column of radians reaches beyond a few turns, no column of degrees of a resonance stays within them
    degrees = bool(np.max(np.abs(values[np.isfinite(values)]), initial=0.0) > 4 * np.pi)
    if not degrees:
        raise MeasurementError("header: found a phase without unit; expected [deg] or [rad]; add it to the header")
    notes.append("phase without unit taken as degrees, since it passes 4π")
    return np.deg2rad(values)


def _time_records(
    columns: Sequence[Column], values: Array, comments: Mapping[str, str], notes: tuple[str, ...]
) -> Iterator[TimeRecord]:
    scale = {"": 1.0, "s": 1.0, "sec": 1.0, "ms": 1e-3}.get(columns[0].unit.lower())
    if scale is None:
        raise MeasurementError(f"column 1: found the unit {columns[0].unit!r}; expected s or ms; correct the header")
    rate = even_rate(values[:, 0] * scale, "column 1")
    told = float_of(comments.get("sample_rate_hz", ""))
    if told is not None and abs(told / rate - 1) < 1e-3:
        rate = told  # exact, where the instants are rounded
    for i, column in enumerate(columns[1:], start=1):
        factor, quantity, converted = read_sensor_unit(column.unit)
        hit = re.search(r"\bhit (\d{1,6})$", column.name)
        name = column.name[: hit.start()].strip() if hit else column.name
        yield TimeRecord(
            name or f"column {i + 1}",
            rate,
            scaled(values[:, i], factor),
            quantity or "unknown",
            column.unit,
            int(hit[1]) if hit else None,
            f"column {i + 1}",
            (*notes, *converted),
            factor,
        )


def read_table(path: Path) -> Generator[Record, None, None]:
    """FRFs or time histories of a CSV or TSV file.

    Raises
    ------
    MeasurementError
        If a row or the header cannot be understood.
    """
    table = read_text_table(path)
    columns = [column_of(name) for name in table.header]
    notes: tuple[str, ...] = ()
    if not any(table.header):
        if len(columns) % 2 == 0:
            raise MeasurementError(
                f"line {table.first_line}: found {len(columns)} columns without a header; expected frequency, then "
                "pairs of real and imaginary part; name the columns in a first line"
            )
        pairs = len(columns) // 2
        columns = [Column("frequency", "", "Hz")]
        for i in range(pairs):
            name = f"output {i + 1} / input 1"
            columns += [Column("real", name, ""), Column("imaginary", name, "")]
        notes = ("no header: taken as frequency in Hz, real and imaginary parts",)
    elif columns[0].role == "frequency" and not columns[0].unit and "omega" in table.header[0].lower():
        columns[0] = replace(columns[0], unit="rad/s")
    yield from column_records(columns, table.values, table.comments, notes)


def table_columns(records: Sequence[Record]) -> tuple[list[str], list[Array], dict[str, str]]:
    """Headers, columns and comments of a table that holds the records.

    Raises
    ------
    MeasurementError
        If the records do not share their lines, or their sampling rate and length.
    """
    frfs = [record for record in records if isinstance(record, FrfRecord)]
    times = [record for record in records if isinstance(record, TimeRecord)]
    if bool(frfs) == bool(times):
        raise MeasurementError(
            "table: found FRFs and time histories, or neither; expected one kind; write one file for each"
        )
    if frfs:
        return _frf_columns(frfs)
    rate, size = times[0].sample_rate_hz, times[0].values.size
    if any((r.sample_rate_hz, r.values.size) != (rate, size) for r in times):
        raise MeasurementError(
            "table: found time histories of different rates or lengths; expected one time axis; write uff58 or hdf5"
        )
    names = ["time [s]"]
    for r in times:
        hit = f" hit {r.hit}" if r.hit is not None else ""
        names.append(f"{r.channel}{hit} [{si_sensor_unit(r.quantity)}]")
    return names, [np.arange(size) / rate, *(r.values for r in times)], {"sample_rate_hz": repr(float(rate))}


def _frf_columns(frfs: Sequence[FrfRecord]) -> tuple[list[str], list[Array], dict[str, str]]:
    lines = frfs[0].frequency_hz
    names, columns = ["frequency [Hz]"], [lines]
    for r in frfs:
        if not np.array_equal(r.frequency_hz, lines):
            raise MeasurementError(
                "table: found FRFs on different lines; expected one frequency axis; write uff58 or hdf5"
            )
        pair = f"{r.response} / {r.reference}"
        unit = f" [{si_frf_unit(r.quantity)}]" if r.quantity else ""
        names += [f"real {pair}{unit}", f"imaginary {pair}{unit}"]
        columns += [r.values.real, r.values.imag]
        if r.coherence is not None:
            names.append(f"coherence {pair}")
            columns.append(r.coherence)
    told = [r.averages for r in frfs]
    comments = {}
    if None not in told:
        comments["averages"] = str(told[0]) if len(set(told)) == 1 else ", ".join(map(str, told))
    return names, columns, comments


def write_table(records: Sequence[Record], path: Path, delimiter: str) -> None:
    """Write records as a table; numbers with as many digits as it takes to read them back exactly."""
    names, columns, comments = table_columns(records)
    with path.open("w", encoding="utf-8", newline="") as file:
        for key, value in comments.items():
            file.write(f"# {key}: {value}\n")
        writer = csv.writer(file, delimiter=delimiter, lineterminator="\n")
        writer.writerow(names)
        for row in zip(*(column.tolist() for column in columns), strict=True):
            writer.writerow(map(repr, row))
