"""Units of a universal file: what its axes and its data set 164 say."""

import math
import re
from dataclasses import dataclass
from typing import TypeVar

from jointbayes.frf import Quantity
from jointbayes.measurement.formats.uff_data_sets import AXIS_TYPES, FunctionHeader, LineError
from jointbayes.measurement.formats.units import MOTION_OF, frf_unit, read_frf_unit, read_sensor_unit
from jointbayes.measurement.records import SensorQuantity

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
    alone = not below or frf_unit(above) is not None
    read = read_frf_unit(above) if alone else read_frf_unit(above, below)
    joined = f"({above})/{below}" if "/" in above else f"{above}/{below}"
    unit = above if alone or not above else joined
    if header.numerator.kind in (9, 13) and header.denominator.kind in _QUANTITIES:
        read[2].append("axis types say force over motion: the inverse of an FRF")
    return _meaning(unit, read, named, units.length / units.force, units)


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
