"""Units of a universal file: data set 164 and the labels of the axes."""

import math
import re
from dataclasses import dataclass

from jointbayes.errors import MeasurementError
from jointbayes.frf import Quantity
from jointbayes.measurement.formats.uff.header import Axis, FunctionHeader
from jointbayes.measurement.formats.units import frf_unit, sensor_unit, si_frf_unit, si_sensor_unit
from jointbayes.measurement.records import SensorQuantity

__all__ = ["FileUnits", "frf_meaning", "sensor_meaning", "units_of"]

_QUANTITIES: dict[int, Quantity] = {8: "receptance", 11: "mobility", 12: "accelerance"}
_SENSORS: dict[int, SensorQuantity] = {8: "displacement", 9: "force", 11: "velocity", 12: "acceleration", 13: "force"}


@dataclass(frozen=True, slots=True)
class FileUnits:
    """Data set 164: metres and newtons for one unit of the file, and what the file calls its system of units."""

    length: float = 1.0
    force: float = 1.0
    name: str = ""


def units_of(body: bytes, place: str) -> FileUnits:
    """Units from the content of a data set 164, whose factors turn SI into the file's units.

    Raises
    ------
    MeasurementError
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
        raise MeasurementError(
            f"{place}: found units {' '.join(factors[:2])[:60]!r}; expected factors of length and force above 0; "
            "correct the data set 164 or take it out"
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
    quantity = _QUANTITIES.get(header.numerator.kind) if header.denominator.kind in (0, 1, 9, 13) else None
    of_file = units.length / units.force if quantity is not None else 1.0
    notes: list[str] = []
    if parsed is not None:
        factor, said = parsed
        if factor != 1:
            notes.append(f"{unit} converted to {si_frf_unit(said)}")
        if quantity is not None and said != quantity:
            notes.append(f"axis types say {quantity}, the unit {unit} says {said}")
        if units.name and not math.isclose(factor, of_file, rel_tol=1e-3):
            notes.append(f"unit {unit} taken; data set 164 ({units.name}) says otherwise")
        return quantity or said, factor, unit, notes
    if unit:
        notes.append(f"unit {unit!r} not understood")
    if of_file != 1:
        notes.append(f"converted to {si_frf_unit(quantity)} by data set 164 ({units.name})")
    return quantity, of_file, unit, notes


def _written(header: FunctionHeader) -> tuple[str, tuple[float, Quantity] | None]:
    above, below = header.numerator.unit, header.denominator.unit
    whole = frf_unit(above)
    if whole is not None or not below:
        return above, whole
    bracketed = f"({above})" if "/" in above else above
    return (f"{bracketed}/{below}" if above else ""), frf_unit(above, below)


def sensor_meaning(header: FunctionHeader, units: FileUnits) -> tuple[SensorQuantity, float, str, list[str]]:
    """Quantity, factor to SI, unit as written and notes of a time response."""
    axis: Axis = header.numerator
    quantity = _SENSORS.get(axis.kind, "unknown")
    of_file = {"unknown": 1.0, "force": units.force}.get(quantity, units.length)
    parsed = sensor_unit(axis.unit)
    notes: list[str] = []
    if parsed is not None:
        factor, said = parsed
        if factor != 1:
            notes.append(f"{axis.unit} converted to {si_sensor_unit(said)}")
        if quantity not in ("unknown", said):
            notes.append(f"axis type says {quantity}, the unit {axis.unit} says {said}")
        if units.name and quantity != "unknown" and not math.isclose(factor, of_file, rel_tol=1e-3):
            notes.append(f"unit {axis.unit} taken; data set 164 ({units.name}) says otherwise")
        return (said if quantity == "unknown" else quantity), factor, axis.unit, notes
    if axis.unit:
        notes.append(f"unit {axis.unit!r} not understood")
    if of_file != 1:
        notes.append(f"converted to {si_sensor_unit(quantity)} by data set 164 ({units.name})")
    return quantity, of_file, axis.unit, notes
