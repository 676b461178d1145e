"""Records in the units and quantities that a case states for its channels, against what their file says."""

from dataclasses import dataclass, replace
from typing import get_args

from vibrecords.arrays import Quantity, SensorQuantity
from vibrecords.errors import MeasurementError, refusal
from vibrecords.formats.units import MOTION_OF, SI_SENSOR, frf_unit, parse_unit, scaled, sensor_unit
from vibrecords.records import FrfRecord, TimeRecord

_EXAMPLE = 'write for example { dof = "11:y", unit = "g" } in [data.channels]'


@dataclass(frozen=True, slots=True)
class ChannelUnit:
    """What a channel measures and in which unit, where the case states it.

    Parameters
    ----------
    unit
        Unit of what it measures, such as ``"g"``; empty: that of the file.
    quantity
        What it measures; None: what the unit says.
    sensitivity
        Volts for one of `unit`, where the file holds volts; None where it holds the unit itself.

    Raises
    ------
    MeasurementError
        If the unit is of no force or motion, lacks next to a sensitivity, or is one of another quantity.
    """

    unit: str = ""
    quantity: SensorQuantity | None = None
    sensitivity: float | None = None

    def __post_init__(self) -> None:
        measured, key = sensor_unit(self.unit), "unit"
        expected = 'the unit of a force or a motion, such as "N", "lbf", "g", "m/s^2", "mm/s" or "um"'
        if measured is None and (self.unit or self.sensitivity is not None):
            found = f'found "{self.unit}"' if self.unit else "found a sensitivity without a unit"
        elif measured and self.quantity not in (None, measured[1]):
            found, key = f'found "{self.quantity}" beside the unit "{self.unit}", one of {measured[1]}', "quantity"
            expected = "two that fit"
        else:
            return
        raise MeasurementError.of("channel", (key,), found, expected, "correct the channel")

    @property
    def stated(self) -> bool:
        """Whether the case says anything."""
        return bool(self.unit or self.quantity or self.sensitivity)


#: Nothing stated.
AS_THE_FILE_SAYS = ChannelUnit()


def restate_history(record: TimeRecord, stated: ChannelUnit) -> TimeRecord:
    """A time history in SI units by what the case states of its channel.

    Raises
    ------
    MeasurementError
        If what the case states does not fit the file, or does not tell the SI unit.
    """
    if not stated.stated:
        return record
    factor, quantity = _side(stated, record.unit, record.factor, f"{record.where} ({record.channel})")
    values = scaled(record.values, factor / (record.factor or 1.0))
    quantity = quantity or record.quantity
    notes = (*record.notes, *_note(record.channel, record.unit, stated, quantity))
    return replace(record, values=values, quantity=quantity, factor=factor, notes=notes)


def restate_frf(record: FrfRecord, response: ChannelUnit, force: ChannelUnit) -> FrfRecord:
    """An FRF in SI units per newton by what the case states of its channels.

    Raises
    ------
    MeasurementError
        As `restate_history`; and if the file's own unit, of which one part is needed, does not come apart.
    """
    if not (response.stated or force.stated):
        return record
    of_response, of_force = sides_of(record.unit)
    place = f"{record.where} ({record.response} over {record.reference})"
    above, motion = _side(response, of_response, _factor(of_response), place)
    below, source = _side(force, of_force, _factor(of_force), place)
    quantity = next((name for name in get_args(Quantity) if MOTION_OF[name] == motion), record.quantity)
    if motion == "force" or source not in (None, "force"):
        remedy = "correct unit and quantity of its channels in [data.channels]"
        raise refusal(place, f"{motion or 'a motion'} over {source or 'a force'}", "a motion over a force", remedy)
    values, factor = scaled(record.values, above / below / (record.factor or 1.0)), above / below
    notes = _note(record.response, of_response, response, motion) + _note(record.reference, of_force, force, source)
    kept = tuple(note for note in record.notes if "left as written" not in note and "converted to" not in note)
    return replace(record, values=values, quantity=quantity, factor=factor, notes=(*kept, *notes))


def sides_of(unit: str) -> tuple[str, str]:
    """Units of response and force as a file writes them together: they part at the last stroke outside of brackets."""
    depth = 0
    for i in range(len(unit) - 1, -1, -1):
        depth += (unit[i] in ")]") - (unit[i] in "([")
        if unit[i] == "/" and depth == 0 and frf_unit(unit[:i]) is None:
            return unit[:i], unit[i + 1 :]
    return unit, ""


def unknown_sides(unit: str) -> tuple[set[str], set[str]]:
    """Return the keys that a case must state if the unit of an FRF is no motion over a force."""
    response, force = (
        set() if not part or sensor_unit(part) else {"unit", "sensitivity"} if _volts(part) else {"unit"}
        for part in sides_of(unit)
    )
    return response, force


def _volts(unit: str) -> float | None:
    """Volts of a unit, 1 where the file says nothing; None where it is another unit."""
    parsed = parse_unit(unit)
    return parsed.factor if parsed and parsed.powers == (0, 0, 0, 1) else None if unit else 1.0


def _factor(unit: str) -> float | None:
    """Factor to SI of what the file says of one side, 1 where it says nothing."""
    parsed = sensor_unit(unit)
    return parsed[0] if parsed else None if unit else 1.0


def _side(stated: ChannelUnit, unit: str, factor: float | None, place: str) -> tuple[float, SensorQuantity | None]:
    """Factor to SI of one channel and what it measures, by the case where it says so, else by the file."""
    of_file, of_case = sensor_unit(unit), sensor_unit(stated.unit)
    if stated.sensitivity is not None and of_case is not None:
        in_volts = _volts(unit)
        if in_volts is None:
            remedy = "take the sensitivity away, the file holds the unit already"
            raise refusal(place, f"the unit {unit!r} and a sensitivity", "volts, which a sensitivity divides", remedy)
        return in_volts / stated.sensitivity * of_case[0], of_case[1]
    if of_case is not None:
        return of_case
    if factor is None:
        found, expected = f"the unit {unit!r}, which is none of a force or motion", "the unit of each channel"
        raise refusal(place, found, expected, f"{_EXAMPLE}, with sensitivity = 0.01 where the file holds volts")
    if stated.quantity and of_file and of_file[1] != stated.quantity:
        found = f'{of_file[1]} by the unit {unit!r} and quantity = "{stated.quantity}" in the case'
        raise refusal(place, found, "one", f"{_EXAMPLE} if the file is wrong")
    return factor, stated.quantity or (of_file[1] if of_file else None)


def _note(label: str, unit: str, stated: ChannelUnit, quantity: SensorQuantity | None) -> list[str]:
    """What the case made of a channel."""
    if not stated.stated:
        return []
    volts = f", {stated.sensitivity:g} V for each" if stated.sensitivity else ""
    of_file = f" in place of the file's {unit}" if unit and unit != stated.unit else ""
    words = f"{stated.unit or SI_SENSOR[quantity or 'unknown'] or 'no unit'}{volts}{of_file}"
    return [f"channel {label} taken as {quantity or 'unknown'} in {words}, as the case states"]
