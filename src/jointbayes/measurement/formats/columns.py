"""What the names of columns and channels say, in English, German and French: one table of words for every reader."""

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, cast

from jointbayes.frf import Quantity
from jointbayes.measurement.formats.units import frequency_factor, parse_unit, read_sensor_unit

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
    "magnitude": (r"magnitude|amplitude|betrag|modulus|module|gain", "mag|abs"),
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
_QUOTIENT = re.compile(r"(\S+) ?/ ?(\S+)|(.*?) ?\bin (\S+)")  # f/Hz, Kraft / N, Zeit in s
#: Units of time and their factors to s.
TIME_S: dict[str, float] = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds", "sekunden"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs"), 1e-6),
}


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
    header = " ".join(header.split())
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
    if role == "phase":
        return word.lower() in ("deg", "rad")
    return role in ("frequency", "time") and axis_role(word.replace("_", "/")) == role


def listed(columns: Sequence[Column], numbers: Sequence[int]) -> str:
    """Some of the columns by number, name and role, with the nearest word where there is none: for messages."""
    words = [word for long, _ in WORDS.values() for word in re.findall(r"[a-z]{4,}", long)]

    def described(column: Column) -> str:
        if column.role != "other":
            return column.role
        near = difflib.get_close_matches(column.header.lower()[:30], words, 1, 0.7)
        return f"unknown, perhaps {near[0]}" if near else "unknown"

    shown = ", ".join(f"column {i + 1} {columns[i].header[:24]!r} ({described(columns[i])})" for i in numbers[:8])
    return shown + (f" and {len(numbers) - 8} more" if len(numbers) > 8 else "")


def spectrum_kind(column: Column) -> str:
    """Which spectrum a column says it is, in its own words."""
    words = list(
        dict.fromkeys(match.upper() if len(match) < 4 else match for match in _SPECTRUM.findall(column.header))
    )
    return ", ".join(words) or "spectrum"
