"""Unit labels such as ``g/N``, ``(mm/s²)/lbf`` or ``1/kg`` to a factor to SI and what they measure."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from vibrecords.arrays import Quantity, SensorQuantity
from vibrecords.errors import refusal
from vibrecords.formats.names import NAMES, factors_of

Q = TypeVar("Q")

#: Units of time and their factors to s.
TIME_S = factors_of(NAMES["seconds"])
#: Factor to Hz of the units of a frequency axis, in small letters; a blank is an underscore in the table.
FREQUENCY_HZ = {name.replace("_", " "): factor for name, factor in factors_of(NAMES["hertz"]).items()}
Powers = tuple[int, ...]
_FORCE, _ACCELERATION, _LENGTH, _NOTHING = (1, 1, -2, 0), (1, 0, -2, 0), (1, 0, 0, 0), (0, 0, 0, 0)
#: Factor to SI and powers of metre, kilogram, second and volt.
ATOMS: dict[str, tuple[float, Powers]] = {
    name: (factor, tuple(unit["powers"]))
    for unit in NAMES["units"]
    for name, factor in factors_of(unit["factors"]).items()
}
_SUPERSCRIPTS = str.maketrans(
    {"²": "^2", "³": "^3", "⁻": "^-", "¹": "1", "µ": "u", "μ": "u", "·": "*", "⋅": "*", "[": "(", "]": ")", "’": "'"}
)
_TOKEN = re.compile(
    r"\s*(?:(?P<name>[A-Za-z]+0?|1)(?P<power>(?:\^|\*\*)?(?:-?\d|\(-?\d\)))?|(?P<sign>[*/(]|\)(?:(?:\^|\*\*)(?P<raised>-?\d))?))"
)
#: A plural as programs write it, ``g's`` and ``Pound(s)``; and metres by seconds run together, ``ms-2``.
_PLURAL = re.compile(r"(?<=[A-Za-z])(?:'s\b|(?<=[A-Za-z]{3})\(s\))")
_RUN_TOGETHER = re.compile(r"(?<![A-Za-z])ms(?=\^?\(?-\d)")
_SENSORS: dict[Powers, SensorQuantity] = {
    _FORCE: "force",
    _LENGTH: "displacement",
    (1, 0, -1, 0): "velocity",
    _ACCELERATION: "acceleration",
}
#: What a sensor measures that makes the FRF.
MOTION_OF: dict[Quantity, SensorQuantity] = {
    "receptance": "displacement",
    "mobility": "velocity",
    "accelerance": "acceleration",
}
#: Label of the SI unit that the values of a time record have.
SI_SENSOR = {"force": "N", "displacement": "m", "velocity": "m/s", "acceleration": "m/s^2", "unknown": ""}


@dataclass(frozen=True, slots=True)
class Unit:
    """Factor to SI, and powers of metre, kilogram, second and volt."""

    factor: float
    powers: Powers

    def times(self, other: "Unit", power: int = 1) -> "Unit":
        """Product with a power of another unit."""
        powers = tuple(a + power * b for a, b in zip(self.powers, other.powers, strict=True))
        return Unit(self.factor * other.factor**power, powers)


_ONE = Unit(1.0, _NOTHING)


def parse_unit(label: str, *, lasting: bool = True) -> Unit | None:
    """Unit of a label, or None where the label is empty or not understood.

    Parameters
    ----------
    label
        As a file has it.
    lasting
        Whether a stroke lasts to the end, as in ``m/N*s`` for m/(N·s); else up to the next sign, as in ``1/N*(m/s²)``.

    Examples
    --------
    >>> parse_unit("mm/s^2/N").factor
    0.001
    >>> parse_unit("EU/EU") is None
    True
    """
    try:
        unit, rest = _product(_tokens(label), lasting)
    except (KeyError, ValueError, OverflowError):
        return None
    return None if rest else unit


def _tokens(label: str) -> list[re.Match[str]]:
    text = label.translate(_SUPERSCRIPTS).replace("^-^", "^-").strip()
    if not text or len(text) > 60:  # no unit is longer; a bound keeps brackets from nesting deeply
        raise ValueError(label)
    text = _RUN_TOGETHER.sub("m*s", _PLURAL.sub("", text))
    tokens = list(_TOKEN.finditer(text))
    if sum(len(token[0]) for token in tokens) < len(text):  # something between them is none
        raise ValueError(label)
    return tokens


def _product(tokens: list[re.Match[str]], lasting: bool) -> tuple[Unit, list[re.Match[str]]]:
    unit, power = _ONE, 1
    while tokens:
        token, tokens = tokens[0], tokens[1:]
        match token["sign"]:
            case "*":
                power = power if lasting else 1
            case "/":
                power = -1
            case "(":
                inner, tokens = _product(tokens, lasting)
                if not tokens:
                    raise ValueError("bracket")
                unit = unit.times(inner, power * int(tokens[0]["raised"] or 1))
                tokens = tokens[1:]
            case str() as sign if sign.startswith(")"):
                return unit, [token, *tokens]
            case _:
                name = token["name"]
                # old programs write in capitals; MN stays a meganewton
                atom = Unit(*ATOMS[name if name in ATOMS else name.lower()])
                exponent = int(re.sub(r"[()^*]", "", token["power"])) if token["power"] else 1
                unit = unit.times(atom, power * exponent)
    return unit, tokens


def two_readings(label: str) -> tuple[str, str] | None:
    """The two units that a label with one stroke and no bracket can stand for, or None where it stands for one.

    Examples
    --------
    >>> two_readings("m/s^2*N")
    ('(m/s^2)*N', 'm/(s^2*N)')
    >>> two_readings("m/s^2/N") is two_readings("m/(s^2*N)") is None
    True
    """
    if parse_unit(label) is None:
        return None
    tokens = _tokens(label)
    while len(tokens) > 2 and (tokens[0]["sign"], tokens[-1]["sign"]) == ("(", ")"):
        tokens = tokens[1:-1]
    words = [token[0].strip() for token in tokens]
    if words.count("/") != 1 or set(words) & {"(", ")"}:
        return None
    stroke = words.index("/")
    above, (first, *others) = "".join(words[:stroke]), [word for word in words[stroke + 1 :] if word != "*"]
    if not others or any("-" in word for word in others):  # a negative power divides without a stroke
        return None
    rest = "*".join(others)
    return f"({above}/{first})*{rest}", f"{above}/({first}*{rest})"


def sensor_unit(label: str) -> tuple[float, SensorQuantity] | None:
    """Factor to SI and what is measured, or None where the label does not say.

    Examples
    --------
    >>> sensor_unit("g")
    (9.80665, 'acceleration')
    """
    unit = None if two_readings(label) else parse_unit(label)
    return (unit.factor, _SENSORS[unit.powers]) if unit and unit.powers in _SENSORS else None


def is_of_two_signals(label: str) -> bool:
    """Whether a unit is the square of a force's or motion's or the product of two, per Hz or not: of no FRF.

    Examples
    --------
    >>> is_of_two_signals("(m/s^2)*N"), is_of_two_signals("N^2/Hz"), is_of_two_signals("g/N")
    (True, True, False)
    """
    unit = parse_unit(label, lasting=False)
    if unit is None or two_readings(label):
        return False
    metres, kilograms, seconds, volts = unit.powers
    seconds -= "hz" in label.lower()
    torque = (kilograms, seconds) == (1, -2)
    return (metres, volts) == (2, 0) and 0 <= kilograms <= 2 and -4 <= seconds <= 0 and not torque


def frf_unit(label: str, reference_label: str = "") -> tuple[float, Quantity] | None:
    """Factor to SI and quantity that the unit of an FRF says, or None where it does not say.

    Parameters
    ----------
    label
        Unit of the FRF, or of the response alone.
    reference_label
        Unit of the force where it stands apart.

    Examples
    --------
    >>> frf_unit("1/kg")
    (1.0, 'accelerance')
    >>> frf_unit("m/s", "lbf")[1]
    'mobility'
    """
    if two_readings(label) or "hz" in label.lower():  # no FRF is a density over frequency
        return None
    units = _readings(label, reference_label)
    meant = [u for u in units if (p := u.powers)[1::2] == (-1, 0) and p[0] in (0, -1, -2) and p[2] in (0, 1, 2)]
    if len(meant) != 1:
        return None
    unit = meant[0]
    return unit.factor, get_args(Quantity)[2 - unit.powers[2]]


def _readings(label: str, reference_label: str) -> set[Unit]:
    """Return the units that a label can stand for, divided by the unit of the force if it stands apart."""
    reference = parse_unit(reference_label)
    units = {unit for lasting in (True, False) if (unit := parse_unit(label, lasting=lasting)) is not None}
    return {u if u.powers[1] or u.powers[3] or reference is None else u.times(reference, -1) for u in units}


def is_force_over_motion(label: str) -> bool:
    """Say whether a unit belongs to dynamic stiffness, impedance or apparent mass.

    Examples
    --------
    >>> is_force_over_motion("N/mm"), is_force_over_motion("kg"), is_force_over_motion("m/N")
    (True, True, False)
    """
    unit = parse_unit(label)
    return unit is not None and unit.powers[:2] == (0, 1) and unit.powers[2] in (0, -1, -2) and unit.powers[3] == 0


def read_frf_unit(label: str, reference_label: str = "") -> tuple[float | None, Quantity | None, list[str]]:
    """Factor to SI, quantity where the unit of an FRF says it, and notes on what becomes of the values.

    The factor is None where the unit is not understood, or none of an FRF over a force; 1 where there is no unit. The
    quantity of an FRF over volts is that of its response: its modes are those of the structure.
    """
    if readings := two_readings(label):
        return None, None, [f"unit {label!r} can be {' or '.join(readings)}, values left as written"]
    parsed = frf_unit(label, reference_label)
    volts = {-u.powers[2] for u in _readings(label, reference_label) if u.powers[:2] == (1, 0) and u.powers[3] == -1}
    if parsed is None and len(volts) == 1 and (power := volts.pop()) in (0, 1, 2):
        return None, get_args(Quantity)[power], [f"unit {label!r} is over volts, values left as written"]
    if parsed is None and not reference_label and parse_unit(label) is not None:
        return None, None, [f"unit {label!r} is that of no FRF over a force, values left as written"]
    return _read(label, parsed, si_frf_unit)


def read_sensor_unit(label: str) -> tuple[float | None, SensorQuantity | None, list[str]]:
    """The same for the unit of a time history."""
    if readings := two_readings(label):
        return None, None, [f"unit {label!r} can be {' or '.join(readings)}, values left as written"]
    if parse_unit(label) is not None and sensor_unit(label) is None:
        return None, None, [f"unit {label!r} is that of no force or motion, values left as written"]
    return _read(label, sensor_unit(label), SI_SENSOR.__getitem__)


def _read(
    label: str, parsed: tuple[float, Q] | None, si_unit: Callable[[Q], str]
) -> tuple[float | None, Q | None, list[str]]:
    if parsed is None:
        return (None, None, [f"unit {label!r} not understood, values left as written"]) if label else (1.0, None, [])
    factor, quantity = parsed
    return factor, quantity, [f"{label} converted to {si_unit(quantity)}"] if factor != 1 else []


def unit_attribute(attributes: Mapping[str, Any]) -> Any:  # noqa: ANN401
    """What the attributes of a channel state as its unit, whatever the case of their names; None where they do not."""
    small = {key.strip().lower(): value for key, value in attributes.items()}
    stated = (small[key] for key in NAMES["arrays"]["unit"].split() if key in small)
    return next((value for value in stated if np.asarray(value).astype(str).any()), None)


def scaled(values: NDArray[Any], factor: float | None) -> NDArray[Any]:
    """Real or complex values times a factor, each part by itself: an infinite one leaves the other as it was."""
    if factor is None or factor == 1:
        return values
    parts = np.ascontiguousarray(values)
    with np.errstate(all="ignore"):
        return np.asarray((parts.view(np.float64) * factor).view(parts.dtype))


def hertz_factor(label: str) -> float | None:
    """Factor to Hz of the unit of a frequency axis, or None where it is not understood."""
    return FREQUENCY_HZ.get(label.strip().strip("[]()").strip().lower())


def in_hz(lines: NDArray[np.float64], unit: str, where: str, remedy: str) -> tuple[NDArray[np.float64], list[str]]:
    """A frequency axis in Hz, with a note where its unit is another.

    Raises
    ------
    MeasurementError
        If the unit is not understood.
    """
    factor = hertz_factor(unit)
    if factor is None:
        raise refusal(where, f"the unit {unit!r}", "Hz or rad/s", remedy)
    with np.errstate(over="ignore"):
        return lines * factor, [f"frequency in {unit} converted to Hz"] if factor != 1 else []


def si_frf_unit(quantity: Quantity | None) -> str:
    """Label of the SI unit that the values of an FRF record have."""
    return {"receptance": "m/N", "mobility": "(m/s)/N", "accelerance": "(m/s^2)/N", None: ""}[quantity]
