"""Which columns of a table are frequency or time, and which belong to them: by name, by numbers, or by the layout."""

import itertools
import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError
from jointbayes.measurement.formats.columns import Column, listed

#: Steps in s below which a column that begins at 0 is time, and steps that time histories of vibration do not have.
TIME_STEP, FREQUENCY_STEP = 0.01, 0.1
#: Names of a column and its axis, as oscilloscopes and plots write them: x0000 y0000, Ch 0 - Voltage_0_x and _y.
_XY = re.compile(r"(?P<name>(?:.*[ _.-])?)x(?P<number>\d*) (?P=name)y(?P=number)", re.IGNORECASE)
_AXIS_KEY = '`axis = "time"` or `axis = "frequency_hz"` in [data.layout] (or --layout axis=time)'


def layout_axis(layout: Mapping[str, str] | None) -> str | None:
    """What the layout says of the first column of a table: time or frequency_hz; nothing else can be said of one."""
    axis, *others = (layout or {}).get("axis"), *(key for key in layout or {} if key != "axis")
    if others or axis not in (None, "time", "frequency_hz"):
        raise MeasurementError(
            f"[data.layout]: found {', '.join(others)[:60] or axis!r} for a table; expected axis, which is time or "
            "frequency_hz; name columns in the file's header"
        )
    return axis


def filled_length(values: Array) -> int:
    """Rows up to the last that holds a number in one of the columns, and in the axis."""
    filled = np.flatnonzero(~np.isnan(values[:, 0]) & (values.shape[1] == 1 or ~np.isnan(values[:, 1:]).all(axis=1)))
    return int(filled[-1]) + 1 if filled.size else len(values)


def groups_of(
    columns: list[Column], values: Array, used: list[int], axis: str | None
) -> list[tuple[list[int], tuple[str, ...]]]:
    """Numbers of the columns that belong together, their axis first, with notes; roles are written into `columns`."""
    note: tuple[str, ...] = ()
    if not used:
        raise MeasurementError(
            f"header: found {listed(columns, range(len(columns)))}; expected frequency or time, and what was measured; "
            "name the columns"
        )
    pairs = [
        _XY.fullmatch(f"{columns[i].header} {columns[k].header}") for i, k in zip(used[::2], used[1::2], strict=False)
    ]
    if pairs and all(pairs) and len(used) == 2 * len(pairs):
        axes = used[::2]
        columns[:] = [replace(c, role="other", name=c.header) for c in columns]
        for i, k, match in zip(axes, used[1::2], pairs, strict=True):
            columns[k] = replace(columns[k], name=match["name"].strip(" _.-") or columns[k].header if match else "")
            columns[i], note = _told_axis(columns[i], values[:, i], i, axis)
    else:
        axes = [i for i in used if columns[i].role in ("frequency", "time") and (i == used[0] or _rises(values[:, i]))]
    if not axes:
        if len(used) > 2 and _counts(values[:, used[0]]) and _rises(values[:, used[1]]):
            note = (f"column {used[0] + 1}, which counts rows, passed over",)
            used = used[1:]
        columns[used[0]], told = _told_axis(columns[used[0]], values[:, used[0]], used[0], axis)
        axes, note = [used[0]], (*note, *told)
    elif axis is not None and not columns[axes[0]].unit and columns[axes[0]].role != axis.partition("_")[0]:
        raise MeasurementError(
            f"column {axes[0] + 1}: found {columns[axes[0]].header!r}, and axis = {axis!r} in the layout; expected one "
            "of the two; correct the layout"
        )
    rest = [i for i in used if i >= axes[0] or columns[i].header or not _counts(values[:, i])]
    if len(axes) == 1:
        return [([axes[0], *(i for i in rest if i != axes[0])], note)]
    if rest[0] != axes[0]:
        raise MeasurementError(
            f"column {rest[0] + 1}: found {columns[rest[0]].header!r} before the first axis; expected frequency or "
            "time before the channels that belong to it; move the column"
        )
    bounds = [*(rest.index(i) for i in axes), len(rest)]
    groups = [rest[first:last] for first, last in itertools.pairwise(bounds)]
    return [(group, note) for group in groups if len(group) > 1] or [(groups[0], note)]


@np.errstate(all="ignore")
def _rises(x: Array) -> bool:
    x = x[~np.isnan(x)]
    return x.size > 1 and bool((np.diff(x) > 0).all())


@np.errstate(all="ignore")
def _counts(x: Array) -> bool:
    """Whether a column counts its rows from 0 or 1."""
    return x[0] in (0, 1) and bool((np.diff(x) == 1).all())


@np.errstate(all="ignore")
def _told_axis(column: Column, x: Array, number: int, axis: str | None) -> tuple[Column, tuple[str, ...]]:
    """Column of frequency or time where no name says which: by its numbers, or by the layout."""
    x = x[~np.isnan(x)]
    named = f"column {number + 1}" + (f" {column.header!r}" if column.header else "")
    if axis is not None:
        told = Column("time", "", "s") if axis == "time" else Column("frequency", "", "Hz")
        return told, (f"{named} taken as {told.role} in {told.unit}, as the layout says",)
    step = (x[-1] - x[0]) / (x.size - 1) if x.size > 1 else 0.0
    rises = _rises(x)
    even = rises and bool(np.abs(x - x[0] - step * np.arange(x.size)).max() < step)
    because = f"from {x[0]:g} in steps of {step:g}" if x.size else ""
    if even and (x[0] < 0 or (x[0] == 0 and step < TIME_STEP)):
        return Column("time", "", "s"), (f"no name: {named} taken as time in s, since it goes {because}",)
    if rises and x[0] >= 0 and (step >= FREQUENCY_STEP or (x[0] > 0 and not even)):
        return Column("frequency", "", "Hz"), (f"no name: {named} taken as frequency in Hz, since it goes {because}",)
    if not rises:
        raise MeasurementError(
            f"{named}: found {because or 'nothing'}, and no column of frequency or time; expected one whose numbers "
            "rise; name the column"
        )
    raise MeasurementError(
        f"{named}: found numbers {because} and no name; expected to know whether they are time in s ({1 / step:g} "
        f"samples a second) or frequency (lines up to {x[-1]:g} Hz); say {_AXIS_KEY}, or name the column"
    )
