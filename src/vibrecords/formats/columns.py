"""What names of columns say, in English, German and French, and which columns are axes where names do not say it."""

import difflib
import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, cast

import numpy as np

from vibrecords.arrays import Array
from vibrecords.errors import MeasurementError
from vibrecords.formats.units import frequency_factor, parse_unit, read_sensor_unit
from vibrecords.frf_set import Quantity

Role = Literal[
    "frequency", "time", "real", "imaginary", "magnitude", "phase", "coherence", "spectrum", "index", "other"
]
#: Words for each role, looked for at the beginning or end of a name: those that an underscore may join to others, and
#: short ones that it may not ("RE_11" is a channel).
WORDS: dict[Role, tuple[str, str]] = {
    "frequency": (r"frequency|frequenz|fr[eé]quence|freq\.?|frq|omega", "f|ω"),
    "time": (r"time|zeit|temps", "t"),
    "coherence": (r"coherence|koh[äa]e?renz|coh[eé]rence|gamma2|γ²|γ2", "coh"),
    "real": (r"real ?part|realteil|partie r[eé]elle|r[eé]elle|real", "re"),
    "imaginary": (
        r"imaginary ?part|imag\.? ?part|imagin[äa]e?rteil|partie imaginaire|imaginary|imaginaire|imag\.?",
        "im",
    ),
    "magnitude": (r"magnitude|amplitude|betrag|modulus|module|gain|mag", "abs"),
    "phase": (r"phasenwinkel|phase|angle|winkel", "arg|phi|φ"),
}
#: Roles of the columns of an FRF, of which it needs real and imaginary part, or magnitude and phase.
FRF_ROLES: tuple[Role, ...] = ("real", "imaginary", "magnitude", "phase", "coherence")
QUANTITY_WORDS: tuple[tuple[Quantity, str], ...] = (
    ("accelerance", r"accelerance|inertance|a[kc][zc]eleranz|inertanz|acc[eé]l[eé]rance"),
    ("mobility", r"mobility|mobilit[äa]e?t|mobilit[eé]"),
    ("receptance", r"receptance|compliance|admittance|nachgiebigkeit|rezeptanz|r[eé]ceptance|souplesse"),
)
_QUANTITIES = tuple((quantity, re.compile(rf"\b(?:{words})\b", re.IGNORECASE)) for quantity, words in QUANTITY_WORDS)
_LONG = "|".join(f"(?P<{role}>{long})" for role, (long, _) in WORDS.items())
_SHORT = "|".join(f"(?P<{role}_>{short})" for role, (_, short) in WORDS.items())
_FIRST = re.compile(rf"(?:{_LONG})(?![^\W_]|:)|(?:{_SHORT})(?![\w:])", re.IGNORECASE)
_LAST = re.compile(rf"(?:(?<![^\W_])(?<!:)(?:{_LONG})|(?<![\w:])(?:{_SHORT}))$", re.IGNORECASE)
#: Words that every FRF may have in its name.
_FRF = re.compile(r"\b(?:frequency response(?: function)?|transfer function|frf|frequenzgang)\b", re.IGNORECASE)
_SPECTRUM = re.compile(
    r"(?<![^\W_])(?:fft|rms|psd|asd|[a-z]{0,9}sp(?:e[ck]|éc)tr(?:um|al|e)|(?:auto|cross)[ -]?(?:power|spectr\w{1,3})|"
    r"leistungsdichte|peak ?hold)(?![^\W_])",
    re.IGNORECASE,
)
_HINT = re.compile(r"fft|rms|sd|tr|pow|pea|dichte", re.IGNORECASE)
_SPECTRAL_UNIT = re.compile(r"(?:\^2|²|2|\))\s*/\s*Hz|Hz\^?-1|(?:√|sqrt\(?|rt)\s*Hz|^dB", re.IGNORECASE)
_INDEX = re.compile(
    r"(?:spectral )?(?:line|linie|ligne|index|idx|row|zeile|point|punkt|samples?|bin|marker|event|n[ro°]|number|#)"
    r"\.?(?: ?(?:n[ro°]|number|#)\.?)?",
    re.IGNORECASE,
)
_UNIT = re.compile(r"^(?P<name>.*?)\s*(?:\[(?P<square>[^\]]*)\]|\((?P<round>.*)\))\s*$")
#: A part that stands in brackets, as LabVIEW writes it: Frequency Response (Magnitude).
_PARTS = "|".join(long for role, (long, _) in WORDS.items() if role not in ("frequency", "time"))
_IN_BRACKETS = re.compile(rf"\(\s*({_PARTS})\s*\)(?=$|\s*[\[(])", re.IGNORECASE)
#: A coherence of a number, which is that of the FRF of this number.
_NUMBERED = re.compile(r"(?:coherence|coh|gamma2)[ _]?(\d{1,4})", re.IGNORECASE)
_QUOTIENT = re.compile(r"(\S+) ?/ ?(\S+)|(.*?) ?\bin (\S+)")  # f/Hz, Kraft / N, Zeit in s
#: Units of time and their factors to s.
TIME_S: dict[str, float] = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds", "sekunden"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs"), 1e-6),
}

#: Steps in s below which a column that begins at 0 is time, and steps that time histories of vibration do not have.
TIME_STEP, FREQUENCY_STEP = 0.01, 0.1
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
    return "frequency" if frequency_factor(unit) is not None else None


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
    for candidate, words in _QUANTITIES:
        shorter = words.sub(" ", name)
        if shorter != name:
            quantity, name = candidate, " ".join(shorter.split())
    if _HINT.search(name) and _SPECTRUM.search(name):
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
        if not unit and _is_unit_of(role, rest):  # frequency_hz, phase_deg
            rest, unit = "", rest.replace("_", "/")
        if not (role in ("frequency", "time") and len(match[0]) == 1 and unit and axis_role(unit) != role):  # f [N]
            rest = rest[1:-1] if rest[:1] == "(" and rest[-1] == ")" else rest
            return Column(role, rest, unit, quantity, whole)
    if _INDEX.fullmatch(name) and not unit:
        return Column("index", name, "", header=whole)
    return Column("spectrum" if _SPECTRAL_UNIT.search(unit) else "other", name, unit, quantity, whole)


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


def _is_unit_of(role: Role, word: str) -> bool:
    if role in ("phase", "magnitude"):
        return word.lower() in (("deg", "rad") if role == "phase" else ("db",))
    return role in ("frequency", "time") and axis_role(word.replace("_", "/")) == role


def describe(columns: Sequence[Column], numbers: Sequence[int] | None = None) -> str:
    """Columns, all or some, by number, name and role, with the nearest word where there is none: for messages."""
    words = [word for long, _ in WORDS.values() for word in re.findall(r"[a-z]{4,}", long)]

    def role_of(column: Column) -> str:
        if column.role != "other":
            return column.role
        near = difflib.get_close_matches(column.header.lower()[:30], words, 1, 0.7)
        return f"unknown, perhaps {near[0]}" if near else "unknown"

    which = range(len(columns)) if numbers is None else numbers
    shown = ", ".join(f"column {i + 1} {columns[i].header[:24]!r} ({role_of(columns[i])})" for i in which[:8])
    return shown + (f" and {len(which) - 8} more" if len(which) > 8 else "")


def spectrum_kind(column: Column) -> str:
    """Which spectrum a column says it is, in its own words."""
    words = dict.fromkeys(word.upper() if len(word) < 4 else word for word in _SPECTRUM.findall(column.header))
    return ", ".join(words) or "spectrum"


def layout_axis(layout: Mapping[str, str] | None) -> str | None:
    """What the layout says of the first column of a table: time or frequency_hz; nothing else can be said of one."""
    axis, *others = (layout or {}).get("axis"), *(key for key in layout or {} if key != "axis")
    if others or axis not in (None, "time", "frequency_hz"):
        raise MeasurementError(
            f"[data.layout]: found {', '.join(others)[:60] or axis!r} for a table; expected axis, which is time or "
            "frequency_hz; name columns in the file's header"
        )
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
        raise MeasurementError(
            f"header: found {describe(columns)}; expected frequency or time, and what was measured; name the columns"
        )
    pairs = [
        _XY.fullmatch(f"{columns[i].header} {columns[k].header}") for i, k in zip(used[::2], used[1::2], strict=False)
    ]
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
        raise MeasurementError(
            f"column {axes[0] + 1}: found {columns[axes[0]].header!r}, and axis = {axis!r} in the layout; expected one "
            "of the two; correct the layout"
        )
    rest = [i for i in used if i >= axes[0] or columns[i].header or not _counts(values[:, i])]
    if len(axes) == 1:
        return [([axes[0], *(i for i in rest if i != axes[0])], note)]
    if rest[0] != axes[0]:
        raise MeasurementError(
            f"column {rest[0] + 1}: found {columns[rest[0]].header!r} before the first axis; expected frequency or "
            "time before the channels that belong to it; move the column"
        )
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
    even = rises and bool(np.abs(x - x[0] - step * np.arange(x.size)).max() < step)
    because = f"from {x[0]:g} in steps of {step:g}" if x.size else ""
    if even and (x[0] < 0 or (x[0] == 0 and step < TIME_STEP)):
        return Column("time", "", "s"), (f"no name: {named} taken as time in s, since it goes {because}",)
    if rises and x[0] >= 0 and (step >= FREQUENCY_STEP or (x[0] > 0 and not even)):
        return Column("frequency", "", "Hz"), (f"no name: {named} taken as frequency in Hz, since it goes {because}",)
    if not rises:
        raise MeasurementError(
            f"{named}: found {because or 'nothing'}, and no column of frequency or time; expected one whose numbers "
            "rise; name the column"
        )
    raise MeasurementError(
        f"{named}: found numbers {because} and no name; expected to know whether they are time in s ({1 / step:g} "
        f"samples a second) or frequency (lines up to {x[-1]:g} Hz); say {_AXIS_KEY}, or name the column"
    )
