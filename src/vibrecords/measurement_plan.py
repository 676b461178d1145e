"""What is asked for of measurement files: which channels stand for which DOFs, lines, variance, masses, rotations."""

import difflib
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from vibrecords.arrays import Quantity
from vibrecords.errors import MeasurementError, placed, refusal
from vibrecords.formats.channel_units import AS_THE_FILE_SAYS, ChannelUnit, restate_frf
from vibrecords.provenance import ChannelUse, Role
from vibrecords.records import CoherenceRecord, FrfRecord, Record, SpectrumRecord, coherence_on
from vibrecords.rotations import Rotation
from vibrecords.signals.spectra import ImpactSettings, ShakerSettings
from vibrecords.variance import RelativeNoise
from vibrecords.virtual_points import VirtualPoint


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
    unit
        What it measures and in which unit, where that is stated.
    """

    dof: str
    sign: float = 1.0
    gain: float = 1.0
    accelerometer_mass: float = 0.0
    unit: ChannelUnit = AS_THE_FILE_SAYS


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


def find_channel(channels: Mapping[str, Channel], label: str) -> tuple[Channel, bool] | None:
    """The channel that a label of a file stands for, and whether the file has it the other way round.

    None if it is not mapped. A label that differs from one of the channels in its last sign only (``Point:12:Z-`` for
    ``Point:12:Z+``) is the same channel the other way round.
    """
    if label in channels:
        return channels[label], False
    channel = channels.get(_opposite(label))
    return None if channel is None else (replace(channel, sign=-channel.sign), True)


def _opposite(label: str) -> str:
    return label[:-1] + {"+": "-", "-": "+"}.get(label[-1:], "")


def require_channels(channels: Mapping[str, Channel], labels: Iterable[str], where: str) -> None:
    """Refuse a mapped channel that the file, which has these labels, does not have.

    Raises
    ------
    MeasurementError
        Naming the channels that the file has and that are not mapped, and the nearest of these.
    """
    present = tuple(dict.fromkeys(labels))
    accepted = {*present, *map(_opposite, present)}
    for label in (label for label in channels if label not in accepted):
        free = [p for p in present if find_channel(channels, p) is None]
        near = free if len(free) == 1 else difflib.get_close_matches(label, free, 1, 0.6)
        listed = ", ".join(f'"{p}"' for p in free[:8]) + (f" and {len(free) - 8} more" * (len(free) > 8))
        expected = f"one of {listed}" if free else "one that the file has: all of these are mapped"
        remedy = f'did you mean "{near[0]}"?' if near else "correct the label" if free else "remove it"
        message = f'{where}: found no channel "{label}" of [data.channels]; expected {expected}; {remedy}'
        raise MeasurementError(message, "channels", label)


def map_records(records: Iterable[Record], channels: Mapping[str, Channel], where: str) -> MappedRecords:
    """Relabel FRFs by DOFs of the model, with the signs and gains of their channels.

    An FRF is response over force: it is multiplied by the response's factor and divided by the force's.

    Parameters
    ----------
    records
        As the files give them; may be a stream, of which only mapped FRFs are kept, and coherences apart from them.
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
    # 1. FRFs between mapped channels
    kept: list[FrfRecord] = []
    pairs: list[tuple[str, str]] = []
    apart: list[CoherenceRecord] = []
    uses: dict[tuple[str, Role], ChannelUse] = {}
    labels: dict[str, None] = {}
    spectra: list[str] = []
    for record in records:
        if isinstance(record, SpectrumRecord):
            spectra.append(record.channel)
        if isinstance(record, CoherenceRecord):
            apart.append(record)
        if not isinstance(record, FrfRecord):
            continue
        labels |= dict.fromkeys((record.response, record.reference))
        above, below = find_channel(channels, record.response), find_channel(channels, record.reference)
        if above is None or below is None:
            continue
        pairs.append((record.response, record.reference))
        (response, turned), (force, force_turned) = above, below
        of_response, of_force = response.sign * response.gain, force.sign * force.gain
        mass = response.accelerometer_mass
        as_response = ChannelUse(record.response, response.dof, "response", of_response, turned, mass)
        uses[record.response, "response"] = as_response
        uses[record.reference, "force"] = ChannelUse(record.reference, force.dof, "force", of_force, force_turned)
        with placed(where):
            record = restate_frf(record, response.unit, force.unit)
        factor = of_response / of_force
        values = record.values if factor == 1 else factor * record.values
        kept.append(replace(record, response=response.dof, reference=force.dof, values=values))
    if spectra and not labels:
        remedy = "export it, or divide the cross spectrum by the auto spectrum of the force"
        raise refusal(where, f"no FRF, but {len(spectra)} spectra ({', '.join(spectra[:3])})", "an FRF", remedy)
    if not labels:
        raise refusal(where, "no FRF", "one", "for time histories add a table [data.records]")
    require_channels(channels, labels, where)
    if not kept:
        found = "no FRF whose response and force are both in [data.channels]"
        raise refusal(where, found, "both", f"map the other channel of {' and '.join(channels)} as well")
    # 2. one channel for each DOF
    by_dof: dict[tuple[Role, str], list[str]] = defaultdict(list)
    for use in uses.values():
        by_dof[use.role, use.dof].append(use.channel)
    for (role, dof), several in by_dof.items():
        if len(several) > 1:
            found = f"{role} channels {' and '.join(several)} for the one DOF {dof}"
            raise refusal(where, found, "one channel for it", "take one of them out of [data.channels]")
    # 3. the coherences that stand apart: of the same channels, or the only one of the only FRF
    waiting: dict[tuple[str, str], list[CoherenceRecord]] = defaultdict(list)
    for alone in apart:
        waiting[pairs[0] if len(kept) == len(apart) == 1 else (alone.response, alone.reference)].append(alone)
    counts = Counter(pairs)
    for pair, of_pair in waiting.items():
        if pair in counts and counts[pair] != len(of_pair):
            found = f"{len(of_pair)} coherences of {pair[0]} over {pair[1]} and {counts[pair]} FRFs"
            raise refusal(where, found, "as many", "leave the surplus out")
    for i, (frf, pair) in enumerate(zip(kept, pairs, strict=True)):
        coherence = waiting[pair].pop(0) if pair in waiting else None
        if coherence and frf.coherence is None:
            with placed(where):
                squared = coherence_on(frf.frequency_hz, coherence, frf.where)
            notes = (*frf.notes, f"coherence taken from {coherence.where}")
            averages = frf.averages or coherence.averages
            kept[i] = replace(frf, coherence=squared, averages=averages, notes=notes)
    used = {label for label, _ in uses}
    return MappedRecords(tuple(kept), tuple(uses.values()), tuple(label for label in labels if label not in used))


@dataclass(frozen=True, slots=True)
class VarianceSource:
    """Where the variance of FRFs comes from.

    Parameters
    ----------
    source
        ``"coherence"`` and averages, ``"repeats"`` of the same measurement, or ``"relative"``: the law alone.
    law
        Law of the accelerance's noise: all of it, or the least that is believed; None where nothing is too little.
    averages
        Number of averages, where the file does not say or is wrong.
    law_for_one_average
        Whether the law is also all of the noise of FRFs of one average, of which coherence says nothing.
    """

    source: Literal["coherence", "repeats", "relative"]
    law: RelativeNoise | None
    averages: int | None = None
    law_for_one_average: bool = False


@dataclass(frozen=True, slots=True)
class FrequencyPlan:
    """Natural frequencies in place of FRFs: how many, the lowest ones, and what is added to the sd of the fit."""

    modes: int | None = None
    sd_relative: float = 0.0
    sd_hz: float = 0.0


@dataclass(frozen=True, slots=True)
class MeasurementPlan:
    """How a measurement is assembled from records.

    Parameters
    ----------
    channels
        What each channel stands for, by its label in the file.
    variance
        None leaves it open; FRFs that are data need it.
    quantity
        What the FRFs are, against what the file says; None takes the file's word.
    f_min_hz, f_max_hz
        Band of the lines that are used.
    exclude_hz
        Bands, lowest and highest frequency each, whose lines are left out.
    conjugate
        Whether the files hold complex conjugates: FRFs with the time factor exp(−iωt).
    window_tau_s
        Time constant of an exponential window on the FRFs of the files, s; None takes the file's word.
    free_gain
        Whether the scale of the FRFs is uncertain, so that they need no SI unit.
    line_step
        Every how many lines one is kept; None keeps all, or with windows those that are independent.
    roving
        Whether one accelerometer moved from output to output; otherwise all stayed on.
    signals
        How FRFs are made of time histories; None takes the FRFs of the files.
    outputs, inputs
        DOFs that are used; empty: all.
    rotations
        Rotations from translations at stations.
    joint_dofs
        DOFs of the joint on both of its sides, at which the paper's iteration needs FRFs.
    frequencies
        Set where natural frequencies are the data.
    virtual_points
        Points of rigid faces, whose DOFs take the place of the sensors and hits on them.
    layout
        What the variables of the files stand for, as `vibrecords.formats.iter_records` takes it.
    """

    channels: Mapping[str, Channel]
    variance: VarianceSource | None
    quantity: Quantity | None = None
    f_min_hz: float | None = None
    f_max_hz: float | None = None
    line_step: int | None = None
    roving: bool = False
    signals: ImpactSettings | ShakerSettings | None = None
    outputs: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    rotations: tuple[Rotation, ...] = ()
    joint_dofs: tuple[str, ...] = ()
    frequencies: FrequencyPlan | None = None
    exclude_hz: tuple[tuple[float, float], ...] = ()
    conjugate: bool = False
    window_tau_s: float | None = None
    free_gain: bool = False
    virtual_points: tuple[VirtualPoint, ...] = ()
    layout: Mapping[str, str] = field(default_factory=dict)
