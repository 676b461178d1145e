"""Unit labels such as ``g/N``, ``(mm/s²)/lbf`` or ``1/kg`` to a factor to SI and what they measure."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from jointbayes.frf import Quantity
from jointbayes.measurement.records import SensorQuantity

Q = TypeVar("Q")

#: Standard acceleration of gravity, m/s² (exact).
G_STANDARD = 9.80665
_LBF = 4.4482216152605

_FORCE, _ACCELERATION = (1, 1, -2), (1, 0, -2)
#: Factor to SI and powers of metre, kilogram and second. ``g`` is gravity: no analyser weighs in grams.
ATOMS: dict[str, tuple[float, tuple[int, int, int]]] = {
    "1": (1.0, (0, 0, 0)),
    "m": (1.0, (1, 0, 0)),
    "cm": (1e-2, (1, 0, 0)),
    "mm": (1e-3, (1, 0, 0)),
    "um": (1e-6, (1, 0, 0)),
    "nm": (1e-9, (1, 0, 0)),
    "in": (0.0254, (1, 0, 0)),
    "inch": (0.0254, (1, 0, 0)),
    "mil": (2.54e-5, (1, 0, 0)),
    "ft": (0.3048, (1, 0, 0)),
    "s": (1.0, (0, 0, 1)),
    "sec": (1.0, (0, 0, 1)),
    "ms": (1e-3, (0, 0, 1)),
    "kg": (1.0, (0, 1, 0)),
    "rad": (1.0, (0, 0, 0)),
    "N": (1.0, _FORCE),
    "mN": (1e-3, _FORCE),
    "kN": (1e3, _FORCE),
    "MN": (1e6, _FORCE),
    "dyn": (1e-5, _FORCE),
    "lbf": (_LBF, _FORCE),
    "lb": (_LBF, _FORCE),
    "lbs": (_LBF, _FORCE),
    "kgf": (G_STANDARD, _FORCE),
    "kp": (G_STANDARD, _FORCE),
    "g": (G_STANDARD, _ACCELERATION),
    "G": (G_STANDARD, _ACCELERATION),
    "gn": (G_STANDARD, _ACCELERATION),
    "g0": (G_STANDARD, _ACCELERATION),
    "Nm": (1.0, (2, 1, -2)),
}
#: Factor to Hz of the units of a frequency axis, in small letters.
FREQUENCY_HZ: dict[str, float] = {
    "hz": 1.0,
    "1/s": 1.0,
    "s^-1": 1.0,
    "khz": 1e3,
    "rpm": 1 / 60,
    "cpm": 1 / 60,
    **dict.fromkeys(("rad/s", "rad/sec", "rads/s", "rad s^-1", "rad.s-1"), 0.5 / math.pi),
}
_SUPERSCRIPTS = str.maketrans({"²": "^2", "³": "^3", "⁻": "^-", "¹": "1", "µ": "u", "μ": "u", "·": "*", "⋅": "*"})
_TOKEN = re.compile(r"\s*(?:(?P<name>[A-Za-z]+0?|1)(?P<power>(?:\^|\*\*)?(?:-?\d|\(-?\d\)))?|(?P<sign>[*/()]))")
_SENSORS: dict[tuple[int, int, int], SensorQuantity] = {
    _FORCE: "force",
    (1, 0, 0): "displacement",
    (1, 0, -1): "velocity",
    _ACCELERATION: "acceleration",
}
#: What a sensor measures that makes the FRF.
MOTION_OF: dict[Quantity, SensorQuantity] = {
    "receptance": "displacement",
    "mobility": "velocity",
    "accelerance": "acceleration",
}
_SI_SENSOR = {"force": "N", "displacement": "m", "velocity": "m/s", "acceleration": "m/s^2", "unknown": ""}


@dataclass(frozen=True, slots=True)
class Unit:
    """Factor to SI, and powers of metre, kilogram and second."""

    factor: float
    powers: tuple[int, int, int]

    def times(self, other: "Unit", power: int = 1) -> "Unit":
        """Product with a power of another unit."""
        a, b = self.powers, other.powers
        powers = (a[0] + power * b[0], a[1] + power * b[1], a[2] + power * b[2])
        return Unit(self.factor * other.factor**power, powers)


_ONE = Unit(1.0, (0, 0, 0))


def parse_unit(label: str) -> Unit | None:
    """Unit of a label, or None where the label is empty or not understood.

    Examples
    --------
    >>> parse_unit("mm/s^2/N").factor
    0.001
    >>> parse_unit("EU/EU") is None
    True
    """
    text = label.translate(_SUPERSCRIPTS).strip().strip("[]").strip()
    if not text or len(text) > 60:  # nobody's unit is longer; a bound keeps brackets from nesting deeply
        return None
    tokens: list[re.Match[str]] = []
    at = 0
    while at < len(text):
        token = _TOKEN.match(text, at)
        if token is None:
            return None
        tokens.append(token)
        at = token.end()
    try:
        unit, rest = _product(tokens)
    except (KeyError, ValueError):
        return None
    return unit if not rest else None


def _product(tokens: list[re.Match[str]]) -> tuple[Unit, list[re.Match[str]]]:
    unit, power = _ONE, 1
    while tokens:
        token, tokens = tokens[0], tokens[1:]
        match token["sign"]:
            case "*":
                continue  # a product lasts: m/N*s is read as m/N·s, (m/N)s is not written by anyone
            case "/":
                power = -1
            case "(":
                inner, tokens = _product(tokens)
                if not tokens or tokens[0]["sign"] != ")":
                    raise ValueError("bracket")
                tokens = tokens[1:]
                unit = unit.times(inner, power)
            case ")":
                return unit, [token, *tokens]
            case _:
                name = token["name"]
                # old programs write in capitals; MN stays a meganewton
                atom = Unit(*ATOMS[name if name in ATOMS else name.lower()])
                exponent = int(re.sub(r"[()^*]", "", token["power"])) if token["power"] else 1
                unit = unit.times(atom, power * exponent)
    return unit, tokens


def sensor_unit(label: str) -> tuple[float, SensorQuantity] | None:
    """Factor to SI and what is measured, or None where the label does not say.

    Examples
    --------
    >>> sensor_unit("g")
    (9.80665, 'acceleration')
    """
    unit = parse_unit(label)
    quantity = None if unit is None else _SENSORS.get(unit.powers)
    return None if unit is None or quantity is None else (unit.factor, quantity)


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
    unit, reference = parse_unit(label), parse_unit(reference_label)
    if unit is not None and unit.powers[1] == 0 and reference is not None:
        unit = unit.times(reference, -1)
    if unit is None or unit.powers[1] != -1 or unit.powers[0] not in (0, -1, -2) or unit.powers[2] not in (0, 1, 2):
        return None
    return unit.factor, get_args(Quantity)[2 - unit.powers[2]]


def read_frf_unit(label: str) -> tuple[float, Quantity | None, list[str]]:
    """Factor to SI, quantity where the unit of an FRF says it, and notes on what becomes of the values."""
    return _read(label, frf_unit(label), si_frf_unit)


def read_sensor_unit(label: str) -> tuple[float, SensorQuantity | None, list[str]]:
    """The same for the unit of a time history."""
    return _read(label, sensor_unit(label), si_sensor_unit)


def _read(label: str, parsed: tuple[float, Q] | None, si_unit: Callable[[Q], str]) -> tuple[float, Q | None, list[str]]:
    if parsed is None:
        return 1.0, None, [f"unit {label!r} not understood, values left as written"] if label else []
    factor, quantity = parsed
    return factor, quantity, [f"{label} converted to {si_unit(quantity)}"] if factor != 1 else []


def scaled(values: NDArray[Any], factor: float) -> NDArray[Any]:
    """Real or complex values times a factor, each part by itself: an infinite one leaves the other as it was."""
    if factor == 1:
        return values
    parts = np.ascontiguousarray(values)
    with np.errstate(over="ignore", under="ignore"):
        return np.asarray((parts.view(np.float64) * factor).view(parts.dtype))


def frequency_factor(label: str) -> float | None:
    """Factor to Hz of the unit of a frequency axis, or None where it is not understood."""
    return FREQUENCY_HZ.get(label.strip().strip("[]()").strip().lower())


def si_sensor_unit(quantity: SensorQuantity) -> str:
    """Label of the SI unit that the values of a time record have."""
    return _SI_SENSOR[quantity]


def si_frf_unit(quantity: Quantity | None) -> str:
    """Label of the SI unit that the values of an FRF record have."""
    return {"receptance": "m/N", "mobility": "(m/s)/N", "accelerance": "(m/s^2)/N", None: ""}[quantity]
