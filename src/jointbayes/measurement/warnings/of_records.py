"""What a time history of a test contradicts: overload, double hits, an offset."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from jointbayes.measurement.provenance import MeasurementWarning
from jointbayes.measurement.records import TimeRecord
from jointbayes.measurement.signals.hits import Hit, HitSettings, find_hits, is_clipped
from jointbayes.measurement.warnings.of_frfs import warnings_of_notes

__all__ = ["hits_of", "warnings_of_history"]

#: A second contact within this time after the first is one hit gone wrong; later it is the next hit. s
_REBOUND_S = 0.15
#: A hammer's force is at rest nearly always.
_AT_REST = 0.9
#: Offsets smaller than this fraction of the largest value do no harm.
_OFFSET = 0.01


def hits_of(record: TimeRecord) -> tuple[Hit, ...]:
    """Hits in a record of a hammer's force; none where it is another channel or no hammer's.

    A record of more than a second may hold several hits; each is looked at for 0.15 s.
    """
    if record.quantity != "force" or record.values.size < 16 or not np.isfinite(record.values).all():
        return ()
    x = np.abs(record.values - np.median(record.values))
    largest = float(x.max())
    if largest == 0 or np.mean(x < 0.1 * largest) < _AT_REST:
        return ()
    several = record.hit is None and record.values.size / record.sample_rate_hz > 1.0
    return find_hits([record], HitSettings(block_s=_REBOUND_S if several else None))


def warnings_of_history(record: TimeRecord) -> Iterator[MeasurementWarning]:
    """What one time history contradicts."""
    x = record.values
    if not np.isfinite(x).all():
        yield MeasurementWarning(
            "not_finite", f"{int((~np.isfinite(x)).sum())} of {x.size} samples are NaN or infinite", "drop the record"
        )
        return
    if x.size < 16:
        return
    if record.quantity == "unknown":
        yield MeasurementWarning(
            "quantity_missing",
            "neither unit nor type says whether it is a force or a motion",
            "name the unit of the channel",
        )
    if np.ptp(x) == 0:
        yield MeasurementWarning("dead_channel", f"all samples are {x[0]:g}", "look at cable and channel")
        return
    yield from warnings_of_notes(record.notes)
    if is_clipped(x) or _at_its_ends(x):
        yield MeasurementWarning(
            "overload",
            f"the signal stays at its largest value, {np.abs(x).max():.4g}, again and again: it was cut off",
            "leave this hit out, and measure with a larger range",
        )
    for hit in hits_of(record):
        if hit.reason.startswith("double hit"):
            number = hit.number if record.hit is None else record.hit
            yield MeasurementWarning("double_hit", f"hit {number} is a {hit.reason}", "leave this hit out")
    yield from _offset(x)


def _at_its_ends(x: NDArray[np.float64]) -> bool:
    """Whether one end is taken again and again, and the value next to it is not: a random signal cut off."""
    for side in (x, -x):
        values, counts = np.unique(side[side > 0.5 * side.max()], return_counts=True)
        if values.size > 1 and counts[-1] >= 5 and counts[-1] > 3 * counts[-2]:
            return True
    return False


def _offset(x: NDArray[np.float64]) -> Iterator[MeasurementWarning]:
    largest = float(np.abs(x - np.median(x)).max())
    spread = float(np.median(np.abs(x - np.median(x))))
    # a decaying or random signal has its median within its own spread; an offset shows in mean and median alike
    level = min(np.median(x), np.mean(x), key=abs)
    if largest > 0 and np.median(x) * np.mean(x) > 0 and abs(level) > _OFFSET * largest + spread:
        yield MeasurementWarning(
            "offset",
            f"the signal rests at {level:.4g}, {100 * abs(level) / largest:.2g} % of its largest swing, and not at 0",
            "take the offset away, or couple the channel AC",
        )
