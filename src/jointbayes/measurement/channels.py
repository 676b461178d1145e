"""From the channels of a measurement file to the DOFs of the model: names, signs and gains."""

import difflib
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

from jointbayes.errors import MeasurementError
from jointbayes.measurement.records import FrfRecord

Role = Literal["response", "force"]
_OPPOSITE = {"+": "-", "-": "+"}


@dataclass(frozen=True, slots=True)
class Channel:
    """What a channel of a file measures, in terms of the model.

    Parameters
    ----------
    dof
        DOF label such as ``"11:y"``.
    sign
        1, or −1 where the channel's positive direction is the DOF's negative one.
    gain
        Factor by which the channel's signal is multiplied.
    accelerometer_mass
        Mass of the sensor whose effect is to be taken out of the FRFs, kg.
    """

    dof: str
    sign: float = 1.0
    gain: float = 1.0
    accelerometer_mass: float = 0.0


@dataclass(frozen=True, slots=True)
class ChannelUse:
    """How a channel of a file was used.

    Parameters
    ----------
    channel, dof
        Label in the file, and DOF it stands for.
    role
        Whether it is the response or the force of FRFs.
    factor
        Factor on its signal: sign times gain.
    reversed_direction
        Whether the file's direction is opposite to that of the mapped channel, so that the sign was changed for it.
    accelerometer_mass
        Mass whose effect is taken out of the FRFs, kg.
    """

    channel: str
    dof: str
    role: Role
    factor: float
    reversed_direction: bool
    accelerometer_mass: float = 0.0


@dataclass(frozen=True, slots=True)
class MappedRecords:
    """FRFs between DOFs of the model.

    Parameters
    ----------
    records
        FRFs with DOF labels as `response` and `reference`, signs and gains applied.
    uses
        How each channel was used, in the order of the file.
    left_out
        Labels of channels whose FRFs were left out, because they or the other channel are not mapped.
    """

    records: tuple[FrfRecord, ...]
    uses: tuple[ChannelUse, ...]
    left_out: tuple[str, ...]


class ChannelMap:
    """Finds the channel that a label of a file stands for.

    Parameters
    ----------
    channels
        By label. A label of the file that differs from one of these in its last sign only (``Point:12:Z-`` for
        ``Point:12:Z+``) is the same channel the other way round.
    """

    def __init__(self, channels: Mapping[str, Channel]) -> None:
        self._channels = dict(channels)

    def find(self, label: str) -> tuple[Channel, bool] | None:
        """The channel, and whether the file has it the other way round; None if it is not mapped."""
        if label in self._channels:
            return self._channels[label], False
        opposite = label[:-1] + _OPPOSITE.get(label[-1:], "")
        if opposite != label and opposite in self._channels:
            channel = self._channels[opposite]
            return replace(channel, sign=-channel.sign), True
        return None

    def use(self, label: str, role: Role) -> ChannelUse | None:
        """How a label of the file is used in a role; None if it is not mapped."""
        mapped = self.find(label)
        if mapped is None:
            return None
        channel, turned = mapped
        mass = channel.accelerometer_mass if role == "response" else 0.0
        return ChannelUse(label, channel.dof, role, channel.sign * channel.gain, turned, mass)

    def require_all(self, labels: Iterable[str], where: str) -> None:
        """Refuse a mapped channel that the file does not have.

        Raises
        ------
        MeasurementError
            Naming the channels that the file has, and the nearest one.
        """
        present = tuple(dict.fromkeys(labels))
        known = {label[:-1] + _OPPOSITE.get(label[-1:], "") for label in present} | set(present)
        for label in self._channels:
            if label in known:
                continue
            near = difflib.get_close_matches(label, present, 1, 0.6)
            listed = ", ".join(f'"{p}"' for p in present[:8]) + (f" and {len(present) - 8} more" * (len(present) > 8))
            remedy = f'did you mean "{near[0]}"?' if near else "correct the label in [data.channels]"
            raise MeasurementError(
                f'{where}: found no channel "{label}" of [data.channels]; expected one of {listed}; {remedy}'
            )


def map_records(records: Iterable[FrfRecord], channels: Mapping[str, Channel], where: str) -> MappedRecords:
    """Relabel FRFs by DOFs of the model, with the signs and gains of their channels.

    An FRF is response over force: it is multiplied by the response's factor and divided by the force's.

    Parameters
    ----------
    records
        FRFs as the files give them; may be a stream, of which only mapped FRFs are kept.
    channels
        By label of the file.
    where
        The file, for messages.

    Raises
    ------
    MeasurementError
        If a mapped channel is in no FRF, no FRF has both of its channels mapped, or two response (force) channels are
        mapped to one DOF.
    """
    known = ChannelMap(channels)
    kept: list[FrfRecord] = []
    uses: dict[tuple[str, Role], ChannelUse] = {}
    labels: dict[str, None] = {}
    for record in records:
        labels |= dict.fromkeys((record.response, record.reference))
        response, force = known.use(record.response, "response"), known.use(record.reference, "force")
        if response is None or force is None:
            continue
        uses[record.response, "response"], uses[record.reference, "force"] = response, force
        factor = response.factor / force.factor
        values = record.values if factor == 1 else factor * record.values
        kept.append(replace(record, response=response.dof, reference=force.dof, values=values))
    if not labels:
        raise MeasurementError(
            f"{where}: found no FRF; expected at least one; for time histories add a table [data.records]"
        )
    known.require_all(labels, where)
    if not kept:
        raise MeasurementError(
            f"{where}: found no FRF whose response and force are both in [data.channels]; expected both; map the other "
            f"channel of {' and '.join(channels)} as well"
        )
    _refuse_doubles(uses.values(), where)
    used = {label for label, _ in uses}
    return MappedRecords(tuple(kept), tuple(uses.values()), tuple(label for label in labels if label not in used))


def _refuse_doubles(uses: Iterable[ChannelUse], where: str) -> None:
    by_dof: dict[tuple[Role, str], list[str]] = defaultdict(list)
    for use in uses:
        by_dof[use.role, use.dof].append(use.channel)
    for (role, dof), labels in by_dof.items():
        if len(labels) > 1:
            raise MeasurementError(
                f"{where}: found {role} channels {' and '.join(labels)} for the one DOF {dof}; expected one channel "
                "for it; take one of them out of [data.channels]"
            )
