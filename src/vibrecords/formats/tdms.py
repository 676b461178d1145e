"""LabVIEW's binary files (``.tdms``), by npTDMS: channels of groups with their own clocks."""

import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrecords.errors import refusal, require_at_most
from vibrecords.formats.table_text import Column, ColumnTable, Role, column_of, describe
from vibrecords.formats.units import unit_attribute
from vibrecords.records import MOST_COLUMNS, reading_package, refuse_damage, require_short

#: Scales of a channel: npTDMS looks at each, however many a damaged file promises.
_MOST_SCALES = 100


def read_tdms(path: Path, layout: Mapping[str, str] | None = None) -> Iterator[ColumnTable]:
    """Tables of the groups; groups with the same channels are hits.

    Sensitivities are applied where DAQmx wrote its scaling, once: npTDMS gives engineering units.

    Raises
    ------
    MeasurementError
        If npTDMS is missing, the file is damaged, or channels have neither an increment nor an axis.
    """
    nptdms = reading_package("npTDMS", "a LabVIEW TDMS file", "export the measurement as LVM")
    logging.getLogger("nptdms").addHandler(logging.NullHandler())
    nptdms.log.log_manager.set_level(logging.CRITICAL)  # what it says of damaged files is said below
    damage = refuse_damage("content", "a TDMS file; copy or export it again")
    with damage, path.open("rb") as handle, nptdms.TdmsFile.open(handle) as file:
        channels = [channel for group in file.groups() for channel in group.channels()]
        size = path.stat().st_size
        if len(channels) > MOST_COLUMNS or sum(map(len, channels)) > size:
            found = f"{sum(map(len, channels))} values in {size} bytes"
            raise refusal("content", found, "fewer", "copy the file again")
        scales = (o.properties.get("NI_Number_Of_Scales", 0) for o in (file, *file.groups(), *channels))
        require_at_most(_MOST_SCALES, max(map(int, scales)), "content", "scales of a channel", "copy it again")
        status = file.file_status
        notes = ("cut off: channels hold what was written before",) if status.incomplete_final_segment else ()
        groups: dict[str, list[_Channel]] = {}
        for channel in channels:
            if not len(channel) or channel.dtype is None or channel.dtype.kind not in "iufc":
                continue
            told = channel.properties
            unit = str(unit_attribute(told) or "")
            axis_name = f"{told.get('wf_xname', '')} {told.get('wf_xunit_string', '')}".lower()
            is_frequency = "hz" in axis_name or "freq" in axis_name
            step, start = float(told.get("wf_increment", 0.0)), float(told.get("wf_start_offset", 0.0))
            begun = told.get("wf_start_time")
            begun_ns = int(begun.astype("datetime64[ns]").astype(np.int64)) if isinstance(begun, np.datetime64) else 0
            # of channels without a clock LabVIEW writes a step of 1 s
            known = np.isfinite([step, start]).all() and step > 0 and (is_frequency or step < 1)
            axis: Role = "frequency" if is_frequency else "time"
            clock = (axis, start, step, begun_ns) if known else None
            of_group = groups.setdefault(channel.group_name, [])
            of_group.append(_Channel(channel.name, unit, channel[:], clock))
    alike = len(groups) > 1 and len({tuple(c.name for c in channels) for channels in groups.values()}) == 1
    for number, (name, members) in enumerate(groups.items(), start=1):
        require_short("group", name, *(text for c in members for text in (c.name, c.unit)))
        yield _group_table(name, members, layout, notes, number if alike else None)


@dataclass(frozen=True, slots=True, eq=False)
class _Channel:
    """Values of a channel, and its clock if the file tells it: axis, start and step in s or Hz, and beginning.

    The recording began at so many ns of some epoch.
    """

    name: str
    unit: str
    values: NDArray[Any]
    clock: tuple[Role, float, float, int] | None


def _group_table(
    name: str, channels: list[_Channel], layout: Mapping[str, str] | None, notes: tuple[str, ...], hit: int | None
) -> ColumnTable:
    """Table of a group: channels of one clock stand behind a column of frequency or time."""
    place = f"group {name[:60]!r}"
    columns: list[Column] = []
    arrays: list[NDArray[Any]] = []
    clocks = dict.fromkeys(c.clock for c in channels if c.clock)
    first_ns = min((clock[3] for clock in clocks), default=0)
    for clock in clocks or [None]:
        members = [c for c in channels if c.clock == clock]
        if clock:
            axis, start, step, begun_ns = clock
            columns.append(Column(axis, "", "Hz" if axis == "frequency" else "s"))
            start += 1e-9 * (begun_ns - first_ns) if axis == "time" else 0.0
            arrays.append(start + step * np.arange(max(c.values.size for c in members)))
        for c in members:
            parts = {"real": c.values.real, "imaginary": c.values.imag} if np.iscomplexobj(c.values) else {"": c.values}
            for part, values in parts.items():
                columns.append(column_of(f"{part} {c.name} [{c.unit}]" if c.unit else f"{part} {c.name}"))
                arrays.append(values)
    if not clocks and not any(column.role in ("time", "frequency") for column in columns) and not layout:
        found, remedy = f"{describe(columns)} without a wf_increment", "export the channels as waveforms"
        raise refusal(place, found, "the time between samples, or a channel named time or frequency", remedy)
    table = np.full((max(a.size for a in arrays), len(arrays)), np.nan)
    for i, array in enumerate(arrays):
        table[: array.size, i] = array
    left = [c.name for c in channels if clocks and not c.clock]
    notes += (f"without a wf_increment, passed over: {', '.join(left)[:200]}",) if left else ()
    return ColumnTable(columns, table, {}, notes, place, hit)
