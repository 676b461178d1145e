"""FRFs, time histories and spectra of tables in any file: what the columns are is told by evidence."""

import re
from collections.abc import Generator, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from vibrecords.arrays import Array, ComplexArray, complex_of
from vibrecords.errors import MeasurementError, refusal
from vibrecords.formats import table_text as headers
from vibrecords.formats.names import WINDOW_NOTE, float_of, stated_decay_rate
from vibrecords.formats.table_text import Column, ColumnTable, Role, describe
from vibrecords.formats.units import TIME_S, in_hz, read_frf_unit, read_sensor_unit, scaled
from vibrecords.records import MOST_AVERAGES, CoherenceRecord, FrfRecord, Record, SpectrumRecord, TimeRecord, even_rate

_WHOLE: tuple[set[Role], ...] = ({"real", "imaginary"}, {"magnitude", "phase"})
_UNITLESS = "no unit, where other columns have one: values left as written, and not taken as SI"
_EXAMPLE = "'frequency [Hz],real tip / hammer [g/N],imaginary tip / hammer [g/N]'"
#: Estimates of an FRF, as a word of a column's name.
_ESTIMATE = re.compile(r"(?<![^\W_])h[1234vsc](?![^\W_])", re.IGNORECASE)
_DOFS = re.compile(
    r"((?:[A-Za-z]\w*:)?\d+:?[+-]?R?[XYZ][+-]?)/((?:[A-Za-z]\w*:)?\d+:?[+-]?R?[XYZ][+-]?)", re.IGNORECASE
)
_DEGREES = "degrees as [deg] or radians as [rad]; correct the header"


def records_of_tables(
    tables: Iterable[ColumnTable], layout: Mapping[str, str] | None = None
) -> Generator[Record, None, None]:
    """FRFs, time histories and spectra of tables with a column of frequency or time, or one of each channel.

    Parameters
    ----------
    tables
        Of a file, each with the part of it that stands before the places of its records, and with their hit.
    layout
        May say that the first column is ``axis``, where its name does not: time or frequency_hz.

    Raises
    ------
    MeasurementError
        If columns do not pair up, a unit of the axis is not known, or a column can be read in two ways.
    """
    axis = headers.layout_axis(layout)
    for table in tables:
        for record in _records(table, axis):
            if table.hit is not None and isinstance(record, TimeRecord) and record.hit is None:
                record = replace(record, hit=table.hit)
            yield replace(record, where=f"{table.place}, {record.where}") if table.place else record


def _records(table: ColumnTable, axis: str | None) -> Iterator[Record]:
    columns, values, notes = list(table.columns), table.values, table.notes
    empty = np.asarray(np.isnan(values).all(axis=0))
    passed = [i for i, c in enumerate(columns) if c.role == "index" or empty[i]]
    groups = headers.groups_of(columns, values, sorted(set(range(len(columns))) - set(passed)), axis)
    if passed:
        notes = (*notes, f"passed over: {describe(columns, passed)}")
    starts = []
    for numbers, note in groups:
        rows = values[: headers.filled_length(values[:, numbers])]
        over_frequency, instants = columns[numbers[0]].role == "frequency", rows[:2, numbers[0]]
        group = _Group(columns, rows, numbers, table.comments, (*notes, *note))
        yield from group.over_frequency() if over_frequency else group.over_time()
        if over_frequency or len(rows) < 2 or not np.isfinite(instants).all():
            continue
        starts.append((float(instants[0]), float(instants[1] - instants[0])))
        if abs(starts[-1][0] - starts[0][0]) > 0.01 * starts[0][1]:
            found = f"a channel that begins at {starts[-1][0]:g}, the first at {starts[0][0]:g}"
            raise refusal(f"column {numbers[0] + 1}", found, "channels that begin together", "cut them to one start")


@dataclass(slots=True)
class _Group:
    """Columns of a table, of which those of these numbers belong together, the axis first; and notes so far."""

    columns: list[Column]
    values: Array
    numbers: list[int]
    comments: Mapping[str, str]
    notes: tuple[str, ...]

    def with_role(self, *roles: Role) -> list[int]:
        """Numbers of columns behind the axis that have one of these roles."""
        return [i for i in self.numbers[1:] if self.columns[i].role in roles]

    def over_frequency(self) -> Iterator[Record]:
        """FRFs, coherences and spectra."""
        columns, (axis, *rest) = self.columns, self.numbers
        unit = columns[axis].unit or ("rad/s" if "omega" in columns[axis].header.lower() else "Hz")
        lines, converted = in_hz(self.values[:, axis], unit, f"column {axis + 1}", "correct the header")
        self.notes += tuple(converted)
        if columns[axis].header and not columns[axis].unit and not converted:
            self.notes += ("frequency without unit taken as Hz",)
        channel, unit = self.comments.get("channel", ""), self.comments.get("unit", "")
        if rest and not any(columns[i].header or columns[i].unit or columns[i].role != "other" for i in rest):
            _name_parts(columns, self.values, rest, channel or "output", unit)
        self.notes += _take_one_estimate(columns, self.values, rest)
        frfs, spectra = _pair_up(columns, rest), self.with_role("spectrum")
        others = sorted({*rest} - {*spectra, *self.with_role(*headers.FRF_ROLES)})
        if not frfs and not spectra:  # one real column of a sensor over frequency is a spectrum, by any name
            spectra = [i for i in others if read_sensor_unit(columns[i].unit)[1]]
            if not spectra:
                found, remedy = f"found {describe(columns, self.numbers)}", f"name the columns as {_EXAMPLE}"
                if any("damp" in columns[i].header.lower() for i in others):
                    found += ", a list of modes"
                    remedy = 'write the modes into the case: kind = "modes", frequencies_hz = [...] in [data]'
                expected = "frequency, real and imaginary part (or magnitude, phase)"
                raise MeasurementError.of("header", (), found, expected, remedy)
            others = [i for i in others if i not in spectra]
        self.pass_over(others)
        yield from self.spectra(spectra, lines)
        averages = iter(_averages(self.comments, sum([*parts] != ["coherence"] for _, parts in frfs)))
        with_units = any(columns[i].unit for i in self.with_role("real", "imaginary", "magnitude"))
        for name, parts in frfs:
            if set(parts) == {"coherence"}:
                response, reference, unnamed = _channels(name, channel)
                where, g2 = f"column {parts['coherence'] + 1}", self.coherence(parts["coherence"])
                yield CoherenceRecord(response, reference, lines, g2, None, where, (*self.notes, *unnamed))
            else:
                yield self.frf(parts, lines, name, next(averages), with_units=with_units)

    @np.errstate(all="ignore")
    def coherence(self, number: int) -> Array:
        """γ² of a column, which may hold γ and say so."""
        is_root = re.fullmatch(r"[(|]?(?:gamma|γ)[)|]?", self.columns[number].unit, re.IGNORECASE)
        return self.values[:, number] ** 2 if is_root else self.values[:, number]

    def pass_over(self, numbers: list[int]) -> None:
        """Note columns that are not read."""
        self.notes += (f"passed over: {describe(self.columns, numbers)}",) if numbers else ()

    def spectra(self, numbers: list[int], lines: Array) -> Iterator[SpectrumRecord]:
        """Spectra, each of one column."""
        for i in numbers:
            column, where = self.columns[i], f"column {i + 1}"
            kind, values = headers.spectrum_kind(column), self.values[:, i]
            yield SpectrumRecord(column.header or where, kind, lines, values, column.unit, where, self.notes)

    @np.errstate(all="ignore")  # a file may hold any number
    def frf(
        self, parts: Mapping[Role, int], lines: Array, name: str, averages: int | None, *, with_units: bool
    ) -> FrfRecord:
        """The FRF of some columns, among which some have a unit or none has."""
        notes = list(self.notes)
        cartesian = {"real", "imaginary"} <= set(parts)
        roles: tuple[Role, Role] = ("real", "imaginary") if cartesian else ("magnitude", "phase")
        first, second = (parts[role] for role in roles)
        unit, other_unit = (self.columns[i].unit for i in (first, second))
        numbers, other_numbers = self.values[:, first], self.values[:, second]
        meant = unit.replace(")(", ")/(")  # SignalCalc's (m/s2)(N)
        if cartesian:
            if other_unit and read_frf_unit(other_unit)[:2] != read_frf_unit(unit)[:2]:
                found, expected = f"the units {unit!r} and {other_unit!r}", "one unit of both parts"
                raise refusal(f"columns {first + 1} and {second + 1}", found, expected, "correct the header")
            meant, values = meant or other_unit, complex_of(numbers, other_numbers)
        else:
            magnitude, meant = _magnitude(numbers, meant, f"column {first + 1}", notes)
            values = magnitude * np.exp(1j * _phase(other_numbers, other_unit, f"column {second + 1}", notes))
        factor, of_unit, converted = read_frf_unit(meant)
        if not meant and with_units:
            factor, converted = None, [_UNITLESS]
        word = self.comments.get("quantity", "").lower()
        named = next((quantity for quantity, words in headers.QUANTITIES.items() if words.fullmatch(word)), None)
        response, reference, unnamed = _channels(name, self.comments.get("channel", ""))
        used = sorted(parts[role] for role in (*roles, "coherence") if role in parts)
        where = f"columns {', '.join(str(i + 1) for i in used[:-1])} and {used[-1] + 1}"
        coherence = self.coherence(parts["coherence"]) if "coherence" in parts else None
        about = (self.columns[first].quantity or named or of_unit, unit, coherence, averages, where)
        rate = stated_decay_rate("; ".join(map(": ".join, self.comments.items())), lines)
        stated = (WINDOW_NOTE.format(1 / rate),) if rate > 0 else ()
        said = (*notes, *converted, *unnamed, *stated)
        return FrfRecord(response, reference, lines, scaled(values, factor), *about, said, factor, rate)

    def over_time(self) -> Iterator[Record]:
        """Time histories."""
        axis, *channels = self.numbers
        spectra = self.with_role("spectrum")
        where, unit, instants = f"column {axis + 1}", self.columns[axis].unit, self.values[:, axis]
        if spectra and len(spectra) == len(channels):
            self.notes += ("its first column is taken as frequency in Hz, since the file names spectra",)
            yield from self.spectra(spectra, instants)
            return
        scale = TIME_S.get(unit.lower() or "s")
        if scale is None:
            raise refusal(where, f"the unit {unit!r}", "s or ms", "correct the header")
        told = float_of(self.comments.get("sample_rate_hz", ""))
        rate = even_rate(instants * scale, where, told)
        doubtful = not unit and rate != told
        if doubtful and rate < 1.001 / headers.FREQUENCY_STEP:
            found, remedy = f"time without a unit in steps of {1 / rate:g}", "write [s] or [ms] behind its name"
            raise refusal(where, found, f"s ({rate:g} samples a second) or ms ({1000.0 * rate:g} a second)", remedy)
        if doubtful and rate < 1.001 / headers.TIME_STEP:
            self.notes += (f"time without unit taken as s, {rate:g} samples a second",)
        self.pass_over(spectra)
        with_units = any(self.columns[i].unit for i in channels)
        for i in channels:
            if self.columns[i].role != "spectrum":
                yield self.history(i, rate, with_units=with_units)

    def history(self, number: int, rate: float, *, with_units: bool) -> TimeRecord:
        """The time history of a column, among which some have a unit or none has."""
        column, where = self.columns[number], f"column {number + 1}"
        factor, quantity, converted = read_sensor_unit(column.unit)
        if not column.unit and with_units:
            factor, converted = None, [_UNITLESS]
        label = column.name if column.role == "other" else column.header
        hit = re.search(r"\bhit (\d{1,6})$", label)
        name = label[: hit.start()].strip() if hit else label
        values, nth = scaled(self.values[:, number], factor), int(hit[1]) if hit else None
        about = (quantity or "unknown", column.unit, nth, where, (*self.notes, *converted), factor)
        return TimeRecord(name or where, rate, values, *about)


@np.errstate(all="ignore")
def _name_parts(columns: list[Column], values: Array, numbers: list[int], output: str, unit: str) -> None:
    """Columns without names as real and imaginary parts, unless they may be something else."""
    expected = "expected frequency, then pairs of real and imaginary part; name the columns in a first line"
    if len(numbers) % 2 or not numbers:
        raise MeasurementError(f"header: found {len(numbers) + 1} columns without a header; {expected}")
    for k, (a, b) in enumerate(zip(numbers[::2], numbers[1::2], strict=True), start=1):
        first, second = values[:, a], values[:, b]
        largest, jump = np.abs(second).max(), np.abs(np.diff(second)).max(initial=0.0)
        one_sign = (first >= 0).all() or (first <= 0).all()
        degrees, radians = 3.2 < largest <= 360, 3 < largest <= 3.1416 and jump > 5
        if one_sign and len(values) > 3 and (degrees or radians):
            word, where = "degrees" if degrees else "radians", f"columns {a + 1} and {b + 1}"
            found = f"found numbers of one sign, and numbers up to {largest:g}"
            expected = f"to know whether they are real and imaginary part, or magnitude and phase in {word}"
            names = f"'frequency [Hz],real,imaginary' or 'frequency [Hz],magnitude,phase [{word[:3]}]'"
            raise MeasurementError.of(where, (), found, expected, f"name the columns: {names}")
        name = output if len(numbers) == 2 and output != "output" else f"{output} {k}"
        columns[a] = Column("real", f"{name} / input 1", unit)
        columns[b] = Column("imaginary", f"{name} / input 1", unit)


@np.errstate(all="ignore")
def _take_one_estimate(columns: list[Column], values: Array, numbers: list[int]) -> tuple[str, ...]:
    """Keep one of the estimates H1, H2, Hv of an FRF, H1 where it is there; a note says which.

    Names that differ by this word alone may be those of channels as well. Estimates have the same phase on all lines,
    since H1/H2 = γ² is real, and channels do not.
    """
    of_frf: dict[str, dict[str, list[int]]] = {}  # by the name without the estimate, then by the estimate
    for i in numbers:
        word = _ESTIMATE.search(columns[i].name)
        if word and columns[i].role in headers.FRF_ROLES:
            rest = " ".join(_ESTIMATE.sub(" ", columns[i].name, count=1).strip(" _,;:-").split())
            of_frf.setdefault(rest, {}).setdefault(word[0].capitalize(), []).append(i)
    notes: tuple[str, ...] = ()
    for rest, estimates in of_frf.items():
        turns = [_turn({columns[i].role: values[:, i] for i in of_one}) for of_one in estimates.values()]
        alike = all(np.nanmedian(np.abs(turn / turns[0] - 1)) < 0.01 for turn in turns)
        if len(estimates) < 2 or not (alike or estimates.keys() >= {"Hv"}):
            continue
        taken = min(estimates)
        for estimate, of_one in estimates.items():
            for i in of_one:
                role: Role = columns[i].role if estimate == taken else "other"
                columns[i] = replace(columns[i], role=role, name=rest)
        notes += (f"{', '.join(sorted(estimates))} are estimates of one FRF: {taken} taken",)
    return notes


def _turn(parts: Mapping[Role, Array]) -> ComplexArray:
    """e^(iφ) of an FRF by its parts; NaN without phase."""
    if parts.keys() >= {"real", "imaginary"}:
        frf = complex_of(parts["real"], parts["imaginary"])
        return np.asarray(frf / np.abs(frf))
    first = next(iter(parts.values()))
    return np.asarray(np.exp(1j * np.deg2rad(parts.get("phase", first * np.nan))))


def _pair_up(columns: list[Column], numbers: list[int]) -> list[tuple[str, dict[Role, int]]]:
    """FRFs by name with their columns: those of one name belong together, a role that comes again begins the next.

    Columns of an FRF's unit or in decibels go to as many phases that have no magnitude: FRF (dB), phase.
    """
    phases = [i for i in numbers if columns[i].role == "phase"]
    levels = []
    for i in (i for i in numbers if columns[i].role in ("other", "spectrum")):
        header, unit = columns[i].header, columns[i].unit
        if headers.names_spectrum(header):
            continue
        if re.fullmatch(r"\|[^|]+\|", header) or unit.lower().startswith("db") or read_frf_unit(unit)[1]:
            levels.append(i)
    if not levels and any(column.role == "spectrum" for column in columns):  # phases of cross spectra
        for i in phases if not any(columns[i].role == "magnitude" for i in numbers) else ():
            columns[i] = replace(columns[i], role="other")
    if len(levels) == len(phases) and not any(columns[i].role in ("magnitude", "real") for i in numbers):
        for level, phase in zip(levels, phases, strict=True):
            name = columns[level if columns[level].role == "other" else phase].name
            columns[level] = replace(columns[level], role="magnitude", name=name)
            columns[phase] = replace(columns[phase], name=name)
    frfs: list[tuple[str, dict[Role, int]]] = []
    of_name: dict[str, list[dict[Role, int]]] = {}
    times: dict[tuple[str, Role], int] = {}
    for i in numbers:
        column = columns[i]
        if column.role not in headers.FRF_ROLES:
            continue
        nth = times[column.name, column.role] = times.get((column.name, column.role), -1) + 1
        alike = of_name.setdefault(column.name, [])
        if nth == len(alike):
            alike.append({})
            frfs.append((column.name, alike[nth]))
        alike[nth][column.role] = i
    if len(frfs) == 2 and not all(of_name) and not set(frfs[0][1]) & set(frfs[1][1]):
        frfs = [(frfs[0][0] or frfs[1][0], frfs[0][1] | frfs[1][1])]  # one FRF, some of whose columns do not name it
    for number, parts in [(name, parts) for name, parts in frfs if [*parts] == ["coherence"] and name.isdecimal()]:
        alike = [other for name, other in frfs if re.search(r"\d*$", name)[0] == number and "coherence" not in other]  # type: ignore[index]
        if len(alike) == 1:  # Coh1 of FRF1
            alike[0]["coherence"] = parts["coherence"]
            frfs.remove((number, parts))
    for name, parts in frfs:
        if not any(whole <= set(parts) for whole in _WHOLE) and [*parts] != ["coherence"]:
            found, expected = f"{' and '.join(sorted(parts))} of {name!r}", "real and imaginary, or magnitude and phase"
            raise refusal(f"column {min(parts.values()) + 1}", found, expected, "complete the columns")
    return frfs


def _averages(comments: Mapping[str, str], count: int) -> list[int | None]:
    text = comments.get("averages", "")
    if not text:
        return [None] * count
    numbers = [number.strip() for number in text.split(",")]
    if any(not number.isdecimal() or len(number) > 9 or not 1 <= int(number) <= MOST_AVERAGES for number in numbers):
        raise refusal("header", f"averages {text[:30]!r}", f"whole numbers from 1 to {MOST_AVERAGES}", "correct it")
    if len(numbers) not in (1, count):
        raise refusal("header", f"{len(numbers)} numbers of averages", f"1 or {count}", "correct it")
    return [*map(int, numbers)] * (count if len(numbers) == 1 else 1)


def _channels(name: str, channel: str) -> tuple[str, str, tuple[str, ...]]:
    """Response and reference that a name says, or a response of the table's channel, and a note where it does not."""
    if pair := _DOFS.fullmatch(name):  # 3:-Z/1:+Z without blanks
        return pair[1], pair[2], ()
    response, _, reference = (label.strip() for label in re.sub(r"\s+over\s+", " / ", name).rpartition(" / "))
    if response:
        return response, reference, ()
    output, unnamed = reference or channel or "output 1", "the header does not say which column is the hammer"
    return output, "input 1", (f"{unnamed}; they are called {output} and input 1",)


def _magnitude(values: Array, unit: str, where: str, notes: list[str]) -> tuple[Array, str]:
    decibels = re.match(r"dB\b\s*(?:,|re\.?|ref\.?)?\s*(?P<level>[\d.]+(?:e[+-]?\d+)?)?\s*", unit, re.IGNORECASE)
    if decibels is None:
        if (values < 0).any():
            found, expected = f"a magnitude below 0 in {unit or 'no unit'!r}", "magnitudes, or decibels named so"
            raise refusal(where, found, expected, "write [dB re 1 m/s²/N] or the like behind the name")
        return values, unit
    level, reference = float_of(decibels["level"] or "1"), unit[decibels.end() :]
    if not level or not 1e-30 < level < 1e30:
        raise refusal(where, f"{unit[:40]!r}", "decibels over a number and unit", "correct it")
    notes.append(f"decibels taken as 20 log10 of the magnitude over {level:g} {reference}".rstrip())
    return level * 10 ** (values / 20), reference


def _phase(values: Array, unit: str, where: str, notes: list[str]) -> Array:
    word = unit.strip().lower()
    finite = values[np.isfinite(values)]
    largest, jump = (float(np.max(np.abs(x), initial=0.0)) for x in (finite, np.diff(finite)))
    if word in ("rad", "radian", "radians"):
        if jump > 6.6:  # wrapped radians jump by 2π
            raise refusal(where, f"a phase in {unit!r} that jumps by {jump:.3g}", _DEGREES)
        return values
    if word in ("deg", "°", "degree", "degrees", "grad"):
        if 3.1 < largest < 3.1416 and jump > 6:
            raise refusal(where, f"a phase in {unit!r} from -π to π", _DEGREES)
        return np.deg2rad(values)
    if word:
        raise refusal(where, f"the phase in {unit!r}", "deg or rad", "correct the header")
    # no column of radians reaches beyond a few turns, no column of degrees of a resonance stays within them
    if largest <= 4 * np.pi:
        raise refusal(where, "a phase without unit", "[deg] or [rad]", "add it to the header")
    notes.append("phase without unit taken as degrees, since it passes 4π")
    return np.deg2rad(values)
