"""A table of numbers in text or cells: where its numbers begin, what stands above them, and the numbers themselves.

Names of columns are read in English, German and French; which are axes is told by numbers where names do not say it.
"""

import csv
import itertools
import re
import warnings
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, cast

import numpy as np

from vibrecords.arrays import Array, Quantity
from vibrecords.errors import MeasurementError, refusal, require_at_most
from vibrecords.formats.names import NAMES, NUMBER, float_of
from vibrecords.formats.units import TIME_S, hertz_factor, is_of_two_signals, parse_unit, read_sensor_unit
from vibrecords.records import MOST_COLUMNS, half_a_digit, require_short

Role = Literal[
    "frequency", "time", "real", "imaginary", "magnitude", "phase", "coherence", "spectrum", "index", "other"
]
#: Words for each role, looked for at the beginning or end of a name: long ones and short ones.
WORDS: dict[Role, tuple[str, str]] = {cast(Role, role): tuple(words) for role, words in NAMES["columns"].items()}
#: Roles of the columns of an FRF, of which it needs real and imaginary part, or magnitude and phase.
FRF_ROLES: tuple[Role, ...] = ("real", "imaginary", "magnitude", "phase", "coherence")
#: Words for the quantity of an FRF.
QUANTITIES: dict[Quantity, re.Pattern[str]] = {
    cast(Quantity, quantity): re.compile(rf"\b(?:{words})\b", re.IGNORECASE)
    for quantity, words in NAMES["column_quantities"].items()
}
_LONG = "|".join(f"(?P<{role}>{long})" for role, (long, _) in WORDS.items())
_SHORT = "|".join(f"(?P<{role}_>{short})" for role, (_, short) in WORDS.items())
_FIRST = re.compile(rf"(?:{_LONG})(?![^\W_]|:)|(?:{_SHORT})(?![\w:])", re.IGNORECASE)
_LAST = re.compile(rf"(?:(?<![^\W_])(?<!:)(?:{_LONG})|(?<![\w:])(?:{_SHORT}))$", re.IGNORECASE)
#: Words that every FRF may have in its name.
_FRF = re.compile(r"\b(?:frequency response(?: function)?|transfer function|frf|frequenzgang)\b", re.IGNORECASE)
_SPECTRUM, _SPECTRAL_UNIT, _INDEX = (
    re.compile(NAMES["spectra"][what], re.IGNORECASE | re.VERBOSE) for what in ("name", "unit", "index")
)
_UNIT = re.compile(r"^(?P<name>.*?)\s*(?:\[(?P<square>[^\]]*)\]|\((?P<round>.*)\))\s*$")
#: A part that stands in brackets, as LabVIEW writes it: Frequency Response (Magnitude).
_PARTS = "|".join(long for role, (long, _) in WORDS.items() if role not in ("frequency", "time"))
_IN_BRACKETS = re.compile(rf"\(\s*({_PARTS})\s*\)(?=$|\s*[\[(])", re.IGNORECASE)
#: A coherence of a number, which is that of the FRF of this number.
_NUMBERED = re.compile(r"(?:coherence|coh|gamma2)[ _]?(\d{1,4})", re.IGNORECASE)
_QUOTIENT = re.compile(r"(\S+) ?/ ?(\S+)|(.*?) ?\bin (\S+)")  # f/Hz, Kraft / N, Zeit in s

#: Steps in s below which a column that begins at 0 is time, and steps that time histories of vibration do not have.
TIME_STEP, FREQUENCY_STEP = 0.01, 0.1
_HIGHEST_LINE = 1e6  # Hz of a column without a name that is taken as frequency
#: Names of a column and its axis, as oscilloscopes and plots write them: x0000 y0000, Ch 0 - Voltage_0_x and _y.
_XY = re.compile(r"(?P<name>(?:.*[ _.-])?)x(?P<number>\d*) (?P=name)y(?P=number)", re.IGNORECASE)
_AXIS_KEY = '`axis = "time"` or `axis = "frequency_hz"` in [data.layout] (or --layout axis=time)'


@dataclass(frozen=True, slots=True)
class Column:
    """Role, channel name and unit of a column; `header` is its name whole, without the unit."""

    role: Role
    name: str
    unit: str
    quantity: Quantity | None = None
    header: str = field(default="", repr=False, compare=False)


def axis_role(unit: str) -> Role | None:
    """Whether a unit is one of frequency or time."""
    if unit.strip("[]() ").lower() in TIME_S:
        return "time"
    return "frequency" if hertz_factor(unit) is not None else None


def column_of(header: str) -> Column:
    """Role, name and unit of a column from its header.

    Examples
    --------
    >>> column_of("Real 11:y / 11:y [g/N]")
    Column(role='real', name='11:y / 11:y', unit='g/N', quantity=None)
    >>> column_of("Frequency (rad/s)").unit
    'rad/s'
    """
    header = _IN_BRACKETS.sub(r" \1", " ".join(header.split()))
    name, unit = _name_and_unit(header)
    whole = name
    if not unit and (axis := axis_role(name)):
        return Column(axis, "", name, header=name)
    quantity: Quantity | None = None
    for candidate, words in QUANTITIES.items():
        shorter = words.sub(" ", name)
        if shorter != name:
            quantity, name = candidate, " ".join(shorter.split())
    if names_spectrum(name):
        return Column("spectrum", name, unit, quantity, whole)
    name = " ".join(_FRF.sub(" ", name).split()) or name
    if numbered := _NUMBERED.fullmatch(name):
        return Column("coherence", numbered[1], unit, quantity, whole)
    if match := _FIRST.match(name):
        rest = name[match.end() :].lstrip(" _.:,-")
    elif match := _LAST.search(name, max(0, len(name) - 30)):
        rest = name[: match.start()].rstrip(" _.,-")
    if match:
        role = cast(Role, (match.lastgroup or "").rstrip("_"))
        of_value = {"phase": ("deg", "rad"), "magnitude": ("db",)}.get(role, ())
        is_axis = role in ("frequency", "time")
        if not unit and (rest.lower() in of_value or (is_axis and axis_role(rest.replace("_", "/")) == role)):
            rest, unit = "", rest.replace("_", "/")
        if not (is_axis and len(match[0]) == 1 and unit and axis_role(unit) != role):  # f [N]
            rest = rest[1:-1] if rest[:1] == "(" and rest[-1] == ")" else rest
            if role == "coherence" and re.fullmatch(r"[(|]?(?:gamma|γ)[)|]?(?:2|²|\^2)?", rest, re.IGNORECASE):
                rest, unit = "", rest
            if role in FRF_ROLES and is_spectral(unit) and not unit.lower().startswith("db"):
                return Column("spectrum", name, unit, quantity, whole)
            return Column(role, rest, unit, quantity, whole)
    if _INDEX.fullmatch(name) and not unit:
        return Column("index", name, "", header=whole)
    return Column("spectrum" if is_spectral(unit) else "other", name, unit, quantity, whole)


def names_spectrum(header: str) -> bool:
    """Whether a name is one of a spectrum: FFT, Gxf, cross power."""
    return _SPECTRUM.search(header) is not None


def is_spectral(unit: str) -> bool:
    """Whether a unit is one of a spectrum: per Hz, a square or a product of two signals, or in decibels."""
    # SignalCalc writes (m/s2)(N) for an FRF
    return _SPECTRAL_UNIT.search(unit) is not None or is_of_two_signals(unit.replace(")(", ")/("))


def _name_and_unit(header: str) -> tuple[str, str]:
    # looked for where there can be one: a search for a bracket that is not there takes quadratic time
    match = _UNIT.match(header) if header.endswith(("]", ")")) else None
    if match is not None:
        unit = (match["square"] if match["square"] is not None else match["round"]).strip()
        # Re(H11) is a part of H11, Re (g/N) one in g/N
        function = match["round"] is not None and header[len(match["name"])] == "(" and re.match(r"[A-Za-z]+\d", unit)
        if not (_SPECTRUM.fullmatch(unit) or (function and parse_unit(unit) is None)):
            return match["name"], unit
    elif match := _QUOTIENT.fullmatch(header) if "/" in header or " in " in header else None:
        name, unit = match[1] or match[3] or "", match[2] or match[4]
        if axis_role(unit) or read_sensor_unit(unit)[1] is not None:
            return name, unit
    return header, ""


def describe(columns: Sequence[Column], numbers: Sequence[int] | None = None) -> str:
    """Columns, all or some, by number, name and role, for messages."""
    which = [(i, columns[i]) for i in (range(len(columns)) if numbers is None else numbers)]
    roles = ["unknown" if column.role == "other" else column.role for _, column in which]
    shown = [f"column {i + 1} {c.header[:24]!r} ({role})" for (i, c), role in zip(which[:8], roles, strict=False)]
    return ", ".join(shown) + (f" and {len(which) - 8} more" if len(which) > 8 else "")


def spectrum_kind(column: Column) -> str:
    """Which spectrum a column says it is, in its own words."""
    words = dict.fromkeys(word.upper() if len(word) < 4 else word for word in _SPECTRUM.findall(column.header))
    return ", ".join(words) or "spectrum"


def layout_axis(layout: Mapping[str, str] | None) -> str | None:
    """What the layout says of the first column of a table: time or frequency_hz; nothing else can be said of one."""
    axis, *others = (layout or {}).get("axis"), *(key for key in layout or {} if key != "axis")
    if others or axis not in (None, "time", "frequency_hz"):
        found, expected = f"{', '.join(others)[:60] or axis!r} for a table", "axis, which is time or frequency_hz"
        raise refusal("[data.layout]", found, expected, "name columns in the file's header")
    return axis


def filled_length(values: Array) -> int:
    """Rows up to the last that holds a number in one of the columns, and in the axis."""
    filled = np.flatnonzero(~np.isnan(values[:, 0]) & (values.shape[1] == 1 or ~np.isnan(values[:, 1:]).all(axis=1)))
    return int(filled[-1]) + 1 if filled.size else len(values)


def groups_of(
    columns: list[Column], values: Array, used: list[int], axis: str | None
) -> list[tuple[list[int], tuple[str, ...]]]:
    """Numbers of the columns that belong together, their axis first, with notes; roles are written into `columns`."""
    note: tuple[str, ...] = ()
    if not used:
        raise refusal("header", describe(columns), "frequency or time, and what was measured", "name the columns")
    names = [columns[i].header for i in used]
    pairs = [_XY.fullmatch(f"{x} {y}") for x, y in zip(names[::2], names[1::2], strict=False)]
    if pairs and all(pairs) and len(used) == 2 * len(pairs):
        axes = used[::2]
        columns[:] = [replace(c, role="other", name=c.header) for c in columns]
        for i, k, match in zip(axes, used[1::2], pairs, strict=True):
            columns[k] = replace(columns[k], name=match["name"].strip(" _.-") or columns[k].header if match else "")
            columns[i], note = _infer_axis(columns[i], values[:, i], i, axis)
    else:
        axes = [i for i in used if columns[i].role in ("frequency", "time") and (i == used[0] or _rises(values[:, i]))]
    if not axes:
        if len(used) > 2 and _counts(values[:, used[0]]) and _rises(values[:, used[1]]):
            note = (f"column {used[0] + 1}, which counts rows, passed over",)
            used = used[1:]
        columns[used[0]], told = _infer_axis(columns[used[0]], values[:, used[0]], used[0], axis)
        axes, note = [used[0]], (*note, *told)
    elif axis is not None and not columns[axes[0]].unit and columns[axes[0]].role != axis.partition("_")[0]:
        found = f"{columns[axes[0]].header!r}, and axis = {axis!r} in the layout"
        raise refusal(f"column {axes[0] + 1}", found, "one of the two", "correct the layout")
    rest = [i for i in used if i >= axes[0] or columns[i].header or not _counts(values[:, i])]
    if len(axes) == 1:
        return [([axes[0], *(i for i in rest if i != axes[0])], note)]
    if rest[0] != axes[0]:
        found, remedy = f"{columns[rest[0]].header!r} before the first axis", "move the column"
        raise refusal(f"column {rest[0] + 1}", found, "frequency or time before the channels that belong to it", remedy)
    groups = [rest[first:last] for first, last in itertools.pairwise([*(rest.index(i) for i in axes), len(rest)])]
    return [(group, note) for group in groups if len(group) > 1] or [(groups[0], note)]


@np.errstate(all="ignore")
def _rises(x: Array) -> bool:
    x = x[~np.isnan(x)]
    return x.size > 1 and bool((np.diff(x) > 0).all())


@np.errstate(all="ignore")
def _counts(x: Array) -> bool:
    """Whether a column counts its rows from 0 or 1."""
    return x[0] in (0, 1) and bool((np.diff(x) == 1).all())


@np.errstate(all="ignore")
def _infer_axis(column: Column, x: Array, number: int, axis: str | None) -> tuple[Column, tuple[str, ...]]:
    """Column of frequency or time where no name says which: by its numbers, or by the layout."""
    x = x[~np.isnan(x)]
    named = f"column {number + 1}" + (f" {column.header!r}" if column.header else "")
    if axis is not None:
        told = Column("time", "", "s") if axis == "time" else Column("frequency", "", "Hz")
        return told, (f"{named} taken as {told.role} in {told.unit}, as the layout says",)
    step = (x[-1] - x[0]) / (x.size - 1) if x.size > 1 else 0.0
    rises = _rises(x)
    off = x - x[0] - step * np.arange(x.size)
    even = rises and bool((np.abs(off) <= np.maximum(0.01 * step, 2 * half_a_digit(x))).all())
    because = f"from {x[0]:g} in steps of {step:g}" if x.size else ""
    if even and (x[0] < 0 or (x[0] == 0 and step < TIME_STEP)):
        return Column("time", "", "s"), (f"no name: {named} taken as time in s, since it goes {because}",)
    if rises and x[0] >= 0 and x[-1] <= _HIGHEST_LINE and (step >= FREQUENCY_STEP if even else _are_lines(x)):
        return Column("frequency", "", "Hz"), (f"no name: {named} taken as frequency in Hz, since it goes {because}",)
    if not rises:
        found = f"{because or 'nothing'}, and no column of frequency or time"
        raise refusal(named, found, "one whose numbers rise", "name the column")
    raise MeasurementError(
        f"{named}: found numbers {because} and no name; expected to know whether they are time in s ({1 / step:g} "
        f"samples a second) or frequency (lines up to {x[-1]:g} Hz); say {_AXIS_KEY}, or name the column"
    )


def _are_lines(x: Array) -> bool:
    """Whether uneven numbers above 0 are lines of a sweep, whose steps grow or shrink, or even ones with some left out.

    The instants of a telemetry record scatter.
    """
    steps = np.diff(x)
    counts = steps / steps.min()
    scatter = np.maximum(0.01 * steps, 4 * half_a_digit(x)[1:])
    grow, shrink = (bool((sign * np.diff(steps) >= -scatter[1:]).all()) for sign in (1, -1))
    left_out = bool((np.abs(counts - np.rint(counts)) < 0.01 * counts).all())
    return bool(x[0] > 0) and (grow or shrink or left_out)


#: A complex number as Python, MATLAB and Fortran write it: (1+2j), 1 - 2i, 1e-3+i2, -2j, (1,2).
_PART = r"(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?|nan|inf"
_COMPLEX = re.compile(
    rf"(?<![\w.])(?:[(\[]\s*)?(?:(?P<re>[+-]?(?:{_PART}))\s*(?P<sign>[+-])\s*)?"
    rf"(?:(?P<im>(?(sign)|[+-]?)(?:{_PART}))\*?[ij]|(?(sign)|(?!))[ij]\*?(?P<behind>{_PART}))(?:\s*[)\]])?(?![\w.])"
    rf"|[(\[]\s*(?P<first>[+-]?(?:{_PART}))(?:\s*[,;]\s*|\s+)(?P<second>[+-]?(?:{_PART}))\s*[)\]]",
    re.IGNORECASE,
)
_LONGEST_LINE = 8 * 2**20
_LONGEST_HEADER = 1000
_BLOCK = 1000  # lines that are parsed at once: as text they take several times the memory of their numbers
#: Signs that begin a comment.
_COMMENT = ("#", "%", "*", "!")
#: Words that blanks part, each with its unit in brackets.
_NAME = re.compile(r"[^\s\[(]+(?: ?[\[(][^\])]*[\])])?")
Lines = Iterator[tuple[int, str]]


@dataclass(frozen=True, slots=True, eq=False)
class ColumnTable:
    """Columns that make records together, and where in the file they stand.

    Parameters
    ----------
    columns
        One for each column of `values`.
    values
        Numbers, shape (rows, columns); NaN where a field is empty at the end of a column, or a whole column is.
    comments
        ``key: value`` lines above the numbers, keys in lower case: ``averages``, ``quantity``, ``sample_rate_hz``.
    notes
        What was done so far.
    place
        Part of the file: ``"segment 2"``.
    hit
        Number of the hit that it holds; None where it holds no single one.
    """

    columns: Sequence[Column]
    values: Array
    comments: Mapping[str, str]
    notes: tuple[str, ...] = ()
    place: str = ""
    hit: int | None = None


@dataclass(frozen=True, slots=True)
class _TableHead:
    """A line above the numbers, without the sign of a comment."""

    number: int
    text: str
    is_comment: bool = False


def text_lines(path: Path) -> Lines:
    """Lines of a text file with their numbers, without line ends, which may be LF, CR LF or CR.

    UTF-16 where a mark says so, else UTF-8, or Windows' Latin-1 where it is not: numbers are the same in both.

    Raises
    ------
    MeasurementError
        If a line is longer than 8 MiB or holds a NUL byte.
    """
    with path.open("rb") as file:
        wide = file.read(2) in (b"\xff\xfe", b"\xfe\xff")
    encoding, errors = ("utf-16", "replace") if wide else ("utf-8", "surrogateescape")
    with path.open(encoding=encoding, errors=errors) as file:
        number = 0
        while text := file.readline(_LONGEST_LINE):
            number += 1
            if text.lstrip().startswith("\x1a"):  # Ctrl-Z ends a text of DOS
                return
            if len(text) == _LONGEST_LINE:
                found = f"a line longer than {_LONGEST_LINE >> 20} MiB"
                raise refusal(f"line {number}", found, "rows of a table", "export the file again")
            if "\0" in text:
                raise refusal(f"line {number}", "a NUL byte", "text", "save as plain text in UTF-8")
            if not wide and not text.isascii():
                text = plain_text(text.encode("utf-8", "surrogateescape"))
            yield number, text.removeprefix("\ufeff" if number == 1 else "").rstrip("\n")


def plain_text(raw: bytes) -> str:
    """Text in UTF-8, or in Latin-1 where it is not."""
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def bad_number(field: str, where: str) -> MeasurementError:
    """Error for a field that is not a number, with its cause where it is a known one."""
    shown = field.strip()[:30]
    fault = f"{shown!r}; expected a number; correct the file or export it again"
    if re.fullmatch(r"[+-]?[\d.,]+[dDqQ][+-]?\d+", shown):
        letter = shown.strip("+-.,0123456789")[:1]
        fault = f"{shown!r}, an exponent of Fortran's; expected E in its place; replace {letter} by E in the numbers"
    elif not shown:
        fault = "an empty field; expected a number; export the file again"
    elif re.fullmatch(r"[+-]?\d{1,3}([ .,'\u00a0\u2019]\d{3})+([.,]\d*)?", shown):
        fault = f"{shown!r}; expected a number without separators of thousands; export the file again"
    return MeasurementError(f"{where}: found {fault}")


def read_text_table(lines: Lines) -> ColumnTable:
    """Read a table; delimiter (tab, semicolon, comma, blanks) and decimal sign from its first row of numbers.

    Raises
    ------
    MeasurementError
        If there is no row of numbers, a row has another number of fields, or a field is not a number.
    """
    comments: dict[str, str] = {}
    complex_at: dict[tuple[int, ...], int] = {}
    apart = _split_complex(lines, complex_at)
    head, first, delimiter = _head(apart, comments)
    pairs = next((columns for columns, number in complex_at.items() if number >= first[0][0]), ())
    lines = apart if pairs else lines
    count = len(_fields(first[0][1], delimiter))
    if head and first[0][1].rstrip(" ").endswith(delimiter) and len(_fields(head[-1].text, delimiter)) == count + 1:
        count += 1  # the last column begins empty
    require_at_most(MOST_COLUMNS, count, f"line {first[0][0]}", "columns", "split the file")
    # the first row of a CutPro file, behind whose numbers name and unit of each column stand
    fields = [field.strip() for field in _fields(head[-1].text, delimiter)] if head else []
    if len(fields) == 3 * count and all(NUMBER.fullmatch(f) for f in fields[:count]):
        first.insert(0, (head[-1].number, delimiter.join(fields[:count])))
        units = ["" if column_of(unit).role in FRF_ROLES else unit for unit in fields[count + 1 :: 2]]
        header = tuple(map(_with_unit, fields[count::2], units))
    else:
        header = _header(head, delimiter, count - len(pairs), comments)
    values, gaps = _numbers(itertools.chain(first, lines), delimiter, count)
    if gaps:
        raise bad_number("", f"line {min(gaps.values())}")
    if delimiter == "," and not any(header) and count > 2 and (values == np.rint(values)).all():
        expected = "to know whether the comma parts columns or is the decimal sign"
        remedy = "name the columns in a first line, or part them by semicolons"
        raise refusal(f"line {first[0][0]}", f"{count} columns of whole numbers without names", expected, remedy)
    if pairs:
        others = [number for columns, number in complex_at.items() if number >= first[0][0] and columns != pairs]
        if others or (0 in pairs and (values[:, 1] != 0).any()):
            found = "complex numbers in the first column or changing ones"
            expected = "a frequency, then complex FRFs in the same columns throughout"
            raise refusal(f"line {max(others, default=first[0][0])}", found, expected, "export it again")
        names = [name or f"output {i} / input 1" if i in pairs and i else name for i, name in enumerate(header)]
        parts = (("real ", "imaginary ") if i in pairs and i else ("",) for i in range(len(names)))
        header = tuple(part + name for name, of_name in zip(names, parts, strict=True) for part in of_name)
        values = np.delete(values, 1, axis=1) if 0 in pairs else values
    columns = [column_of(name) for name in header]
    start, step = (float_of(comments.get(key, "")) for key in ("start", "increment"))  # of an oscilloscope
    if columns[0].header.lower() in ("x", "sequence") and start is not None and step is not None:
        values[:, 0] = start + step * values[:, 0]
        columns[0] = Column("time", "", "s")
    _apply_stated(columns, comments)
    return ColumnTable(columns, values, comments)


def _apply_stated(columns: list[Column], comments: dict[str, str]) -> None:
    """Put what stands above the numbers as a key and its value into columns that say nothing themselves.

    Unit of the axis; unit of the function, whole or of response and force apart; class of the function. The number of
    averages goes to the comments under its own name.
    """
    sides = {"": "", "response": "", "force": ""}
    for key, value in [*comments.items()]:
        if re.search(r"\b(?:averages?|avg|average count|mittel(?:ung(?:en)?)?|moyennes)\b", key) and value.isdecimal():
            comments.setdefault("averages", value)
        elif re.search(r"\b(?:units?|einheit|unité)\b", key):
            of_axis = re.search(r"\b(?:x|freq\w*|time|zeit|temps|abszisse|abscissa)\b", key)
            if of_axis and axis_role(value) and not columns[0].unit and columns[0].role in (axis_role(value), "other"):
                columns[0] = replace(columns[0], role=cast(Role, axis_role(value)), name="", unit=value)
            elif not of_axis and (parse_unit(value) is not None or value.lower().startswith("db")):
                side = next((side for side, words in NAMES["sides"].items() if re.search(rf"\b(?:{words})\b", key)), "")
                sides[side] = sides[side] or value
    unit = sides[""] or (f"({sides['response']})/({sides['force']})" if sides["response"] and sides["force"] else "")
    shared = "vertical units" in comments or columns[0].role != "time" or len(columns) == 2
    if unit and shared and not any(column.unit for column in columns[1:]):
        comments["unit"] = unit
        told = ("phase", "coherence", "index")
        columns[1:] = [c if c.role in told or not c.header else replace(c, unit=unit) for c in columns[1:]]
    kind = next((value for key, value in comments.items() if re.search(r"\bfun[ck]tion\b|\bfonction\b", key)), "")
    if names_spectrum(kind):
        columns[1:] = [replace(c, role="spectrum", name=c.header or kind) for c in columns[1:]]
    elif column_of(kind).role == "coherence" and len(columns) == 2 and columns[1].role == "other":
        columns[1] = replace(columns[1], role="coherence", name=columns[1].header)


def _split_complex(lines: Lines, found: dict[tuple[int, ...], int]) -> Lines:
    """Lines in which a complex number is two numbers; in `found` columns of such, and the last line that has them."""
    for number, line in lines:
        if any(sign in line for sign in "ijIJ([") and line.lstrip()[:1] not in _COMMENT:
            marked = _COMPLEX.sub("j", line)
            delimiter = next((sign for sign in "\t;," if sign in marked), " ")
            parted = _COMPLEX.sub(_two_numbers, line).replace("\0", delimiter)
            if parted != line and _delimiter(parted) == delimiter:
                cells = _fields(marked, delimiter)
                found[tuple(i for i, cell in enumerate(cells) if cell.strip() == "j")] = number
                line = parted
        yield number, line


def _two_numbers(match: re.Match[str]) -> str:
    """Real and imaginary part of a complex number, with a NUL between."""
    imaginary = match["second"] or (match["sign"] or "") + (match["im"] or match["behind"])
    return f"{match['first'] or match['re'] or '0'}\0{imaginary}"


def _head(lines: Lines, comments: dict[str, str]) -> tuple[list[_TableHead], list[tuple[int, str]], str]:
    """Lines above the numbers, the first two rows of numbers (or one), and the delimiter."""
    head: list[_TableHead] = []
    row: tuple[int, str] | None = None
    delimiter: str | None = None
    for number, line in lines:
        if not line.strip():
            continue
        if line.lstrip().startswith(_COMMENT):
            text = line.lstrip("".join(_COMMENT) + " \t")
            key, colon, value = text.partition(":")
            if colon and re.fullmatch(r"[\w .-]{1,60}", key):
                comments[key.strip().lower()] = value.strip()
            elif row is None:
                head.append(_TableHead(number, text, is_comment=True))
            continue
        if row is not None and delimiter is not None:
            fields = [field for field in _fields(line, delimiter) if field.strip()]
            if len(fields) < 2 or any(NUMBER.fullmatch(field.strip()) for field in fields):
                return head, [row, (number, line)], delimiter
            head.append(_TableHead(*row))  # numbers above the names of columns
        delimiter = _delimiter(line)
        row = None if delimiter is None else (number, line)
        if row is None:
            head.append(_TableHead(number, line))
        if len(head) > _LONGEST_HEADER:
            raise refusal(f"line {number}", "no row of numbers so far", "a table", "correct the file")
    if row is None or delimiter is None:
        found, expected = "no row of two numbers or more in the file", "a table of frequency, real and imaginary part"
        raise refusal(f"line {head[-1].number if head else 1}", found, expected, "export the FRF as text")
    return head, [row], delimiter


def _delimiter(line: str) -> str | None:
    """Delimiter under which the fields of the line are numbers, two or more, or empty; or None."""
    for delimiter in ("\t", ";", ",", " "):
        fields = [field.strip() for field in _fields(line, delimiter)]
        numbers = [field for field in fields if field]
        decimal_comma_clash = delimiter == "," and any("," in field for field in fields)
        if len(numbers) > 1 and not decimal_comma_clash and all(NUMBER.fullmatch(f) for f in numbers):
            return delimiter
    return None


def _fields(line: str, delimiter: str) -> list[str]:
    line = line.replace('"', "")
    fields = line.split() if delimiter == " " else line.split(delimiter)
    # a delimiter at the end of each row is common, and stands for nothing
    return fields[:-1] if len(fields) > 1 and not fields[-1].strip() else fields


def _with_unit(name: str, unit: str) -> str:
    inner = re.fullmatch(r"[\[(]([^\[\]()]*)[\])]", unit)
    return f"{name} [{inner[1] if inner else unit}]" if unit else name


def _header(head: list[_TableHead], delimiter: str, count: int, comments: dict[str, str]) -> tuple[str, ...]:
    """Name and unit of each column; pairs of a key and a value above them go to the comments."""
    rows: list[tuple[int, list[str]]] = []
    for entry in head:
        cells = _cells(entry, delimiter, count)
        if re.search(r"\bexpo", entry.text, re.IGNORECASE):
            comments.setdefault("said", entry.text)
        broken = next((cell for cell in cells if not NUMBER.fullmatch(cell)), None)
        if broken is None and entry.is_comment:
            continue  # a row that was taken out
        if broken is not None and entry is head[-1] and len(cells) == count and NUMBER.fullmatch(cells[0]):
            raise bad_number(broken, f"line {entry.number}")
        pair = cells if len(cells) > 1 else re.split(r"\s*[:=]\s*", cells[0], maxsplit=1)
        if len(pair) == 1 and column_of(cells[0]).role == "coherence":  # the title of such a table
            comments.setdefault("function", cells[0])
        if len(cells) > 1:
            rows.append((entry.number, cells))
        if 1 < len(pair) < 4 and (pair[1].isdecimal() or pair[0].lower() != "averages"):
            comments.setdefault(pair[0].strip(" :=").lower(), pair[1].strip())
    units = [""] * count
    if len(rows) > 1 and rows[-2][1][-1].lower() == "increment":  # of Rigol's
        *units, comments["start"], comments["increment"] = rows.pop()[1]
        units = ["", *units[1:], *[""] * count][:count]
        rows[-1] = (rows[-1][0], [*rows[-1][1][:-2], *[""] * count][:count])
    elif rows and _are_units(rows[-1][1], rows[:-1], count):
        units = [*rows.pop()[1], *units][:count]
    if not rows:
        return tuple(_with_unit("", unit) for unit in units)
    number, names = rows[-1]
    if len(names) != count:
        roles = [column_of(name).role for name in names if name]
        if (len(names) > 2 and set(roles) != {"other"}) or (roles[:1] in (["frequency"], ["time"]) and roles[1:]):
            comma = ", and commas that are no decimal signs" if delimiter == "," and len(names) < count else ""
            found = f"{len(names)} names above {count} columns of numbers"
            raise refusal(f"line {number}", found, f"one for each column{comma}", "correct the header")
        names = [""] * count
    elif count == 2 and not any(units) and NUMBER.fullmatch(names[1]):
        names = [""] * count  # a key and its value
    require_short(f"line {number}", *names, *units)
    above = rows[-2][1] if len(rows) > 1 and column_of(names[0]).role in ("frequency", "time") else []
    if above and not above[0] and len(above) <= count:  # the signals, each above the first of its columns
        signal = ""
        for i, cell in enumerate([*above, *[""] * count][:count]):
            signal = cell or signal
            names[i] = f"{signal} {names[i]}".strip()
    return tuple(map(_with_unit, names, units))


def _are_units(cells: list[str], above: list[tuple[int, list[str]]], count: int) -> bool:
    """Say whether a row above the numbers holds units: first of an axis; below names, or known units only."""
    first = next((i for i, cell in enumerate(cells) if cell), 0)
    if not 0 < len(cells) <= count or axis_role(cells[first]) is None:
        return False
    names = above[-1][1] if above else []
    named = len(names) == count and column_of(names[first]).role in ("frequency", "time")
    known = all(not cell or parse_unit(cell.strip("[]()")) is not None for cell in cells[first + 1 :])
    others = (column_of(cell).role in ("other", "spectrum") for cell in cells[first + 1 :])
    return known or (named and all(others))


def _cells(line: _TableHead, delimiter: str, count: int) -> list[str]:
    """Cells of a line above the numbers; blanks part them as well as they may."""
    try:
        if delimiter != " ":
            cells = next(csv.reader([line.text], delimiter=delimiter, skipinitialspace=True), [])
        else:
            splits = (line.text.split(), re.split(r"\s{2,}|[\t;,]", line.text.strip()), _NAME.findall(line.text))
            cells = next((split for split in splits if len(split) == count), splits[0])
    except csv.Error as error:
        found, expected = f"a header that cannot be read ({error})", "a name for each column"
        raise refusal(f"line {line.number}", found, expected, "correct the header or save the file again") from None
    cells = [cell.strip() for cell in cells]
    while len(cells) > max(count, 1) and not cells[-1]:
        cells.pop()
    return cells


def _numbers(lines: Iterator[tuple[int, str]], delimiter: str, count: int) -> tuple[Array, dict[int, int]]:
    """As `read_rows`: by NumPy, four times as fast, up to the first block of lines that holds more than plain rows."""
    plain = array("d")
    point, block = False, []
    while block := list(itertools.islice(lines, _BLOCK)):
        texts = [text for _, text in block]
        try:
            with warnings.catch_warnings(action="error"):  # blank lines alone
                numbers = np.loadtxt(texts, delimiter=delimiter.strip(" ") or None, comments=None, ndmin=2)
        except (ValueError, UserWarning):
            break
        if numbers.shape != (len(block), count):
            break
        plain.frombytes(numbers.tobytes())
        point = point or any("." in text for text in texts)
    rows = _split_rows(itertools.chain(block, lines), delimiter, count, point=point)
    return read_rows(rows, count, plain)


def _split_rows(
    lines: Iterable[tuple[int, str]], delimiter: str, count: int, *, point: bool
) -> Iterator[tuple[int, list[str]]]:
    """Rows of numbers in fields, with a decimal point; `point` says whether rows before have one."""
    comma = False
    for number, line in lines:
        if not line.strip() or line.lstrip().startswith(_COMMENT):
            continue
        if delimiter != ",":
            comma, point = comma or "," in line, point or "." in line
            if comma and point:
                found = f"{line.strip()[:40]!r}, points and commas in one table's numbers"
                expected = "one decimal sign and no separators of thousands"
                raise refusal(f"line {number}", found, expected, "export the file again")
            line = line.replace(",", ".") if comma else line
        if '"' in line:
            line = line.replace('"', "")
        fields = line.split() if delimiter == " " else line.split(delimiter)
        if len(fields) == count + 1 and not fields[-1].strip():
            fields.pop()
        yield number, fields


def read_rows(
    rows: Iterable[tuple[int, list[str]]], count: int, before: "array[float] | None" = None
) -> tuple[Array, dict[int, int]]:
    """All rows as one array, NaN for empty fields; and by column the line of an empty field that numbers follow.

    Text is not kept, so that memory stays below the file's size. Rows are added to the numbers of rows before.

    Raises
    ------
    MeasurementError
        If a row has another number of fields, or a field is neither empty nor a number.
    """
    numbers = array("d") if before is None else before
    empty: dict[int, int] = {}
    gaps: dict[int, int] = {}
    for number, fields in rows:
        if len(fields) != count:
            remedy = "the file is cut off or damaged, export it again"
            raise refusal(f"line {number}", f"{len(fields)} fields", f"{count} as in the rows before", remedy)
        try:
            numbers.extend(list(map(float, fields)))
        except ValueError:
            for i, field in enumerate(fields):
                if not field.strip():
                    empty.setdefault(i, number)
                elif "," in field or not NUMBER.fullmatch(field.strip()):
                    raise bad_number(field, f"line {number}") from None
            numbers.extend(float(field.strip() or "nan") for field in fields)
        if "_" in "".join(fields):  # Python's own spelling of long numbers
            raise bad_number(next(f for f in fields if "_" in f), f"line {number}")
        if empty:
            gaps.update({i: line for i, line in empty.items() if i not in gaps and fields[i].strip()})
    return np.frombuffer(numbers, dtype=float).reshape(-1, count), gaps
