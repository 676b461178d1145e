"""Units of a universal file: data set 164 and the labels of the axes."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from jointbayes.frf import Quantity
from jointbayes.measurement.formats.uff.header import FunctionHeader
from jointbayes.measurement.formats.uff.values import LineError
from jointbayes.measurement.formats.units import MOTION_OF, frf_unit, sensor_unit, si_frf_unit, si_sensor_unit
from jointbayes.measurement.records import SensorQuantity

Q = TypeVar("Q")

#: Specific data types of the format.
AXIS_TYPES: dict[SensorQuantity, int] = {
    "unknown": 0,
    "displacement": 8,
    "velocity": 11,
    "acceleration": 12,
    "force": 13,
}
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
    return FileUnits(1 / length, 1 / force, lines[0][10:30].strip())


def _fields(line: str) -> list[str]:
    """Numbers of a line, separated by blanks or in columns 25 wide that touch."""
    return line.split() if " " in line.strip() else [line[i : i + 25].strip() for i in range(0, len(line), 25)]


def frf_meaning(header: FunctionHeader, units: FileUnits) -> tuple[Quantity | None, float, str, list[str]]:
    """Quantity, factor to SI, unit as written and notes of a frequency response.

    The quantity is what the types of the axes say, else what the units say. The factor is that of the units written at
    the axes, which take precedence by the format's own words, else that of data set 164.
    """
    unit, parsed = _written(header)
    named = _QUANTITIES.get(header.numerator.kind) if header.denominator.kind in (0, 1, 9, 13) else None
    return _meaning(unit, parsed, named, units.length / units.force, units.name, si_frf_unit)


def sensor_meaning(header: FunctionHeader, units: FileUnits) -> tuple[SensorQuantity, float, str, list[str]]:
    """Quantity, factor to SI, unit as written and notes of a time response."""
    axis = header.numerator
    named: SensorQuantity | None = _SENSORS.get(axis.kind)
    of_file = units.force if named == "force" else units.length
    said = sensor_unit(axis.unit)
    quantity, factor, unit, notes = _meaning(axis.unit, said, named, of_file, units.name, si_sensor_unit)
    return quantity or "unknown", factor, unit, notes


def _meaning(
    unit: str, parsed: tuple[float, Q] | None, named: Q | None, of_file: float, file_name: str, si: Callable[[Any], str]
) -> tuple[Q | None, float, str, list[str]]:
    """What a unit that was written, the type of an axis and the units of the file say together."""
    notes: list[str] = []
    if parsed is not None:
        factor, said = parsed
        if factor != 1:
            notes.append(f"{unit} converted to {si(said)}")
        if named not in (None, said):
            notes.append(f"axis types say {named}, the unit {unit} says {said}")
        if file_name and named is not None and not math.isclose(factor, of_file, rel_tol=1e-3):
            notes.append(f"unit {unit} taken; data set 164 ({file_name}) says otherwise")
        return named or said, factor, unit, notes
    if unit:
        notes.append(f"unit {unit!r} not understood")
    if named is None or of_file == 1:
        return named, 1.0, unit, notes
    return named, of_file, unit, [*notes, f"converted to {si(named)} by data set 164 ({file_name})"]


def _written(header: FunctionHeader) -> tuple[str, tuple[float, Quantity] | None]:
    above, below = header.numerator.unit, header.denominator.unit
    whole = frf_unit(above)
    if whole is not None or not below:
        return above, whole
    bracketed = f"({above})" if "/" in above else above
    return (f"{bracketed}/{below}" if above else ""), frf_unit(above, below)
