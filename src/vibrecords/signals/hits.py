"""The hits of a hammer in time records: where each begins, and whether it may be used."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts load at first use

from vibrecords.arrays import Array, stretch_about
from vibrecords.errors import refusal
from vibrecords.records import TimeRecord, measurable

#: So many equal samples in a row at the very top are a clipped signal.
_FLAT = 3
#: Below this fraction of the largest value the other end of a signal is rest, not range.
_SMALL = 0.1
#: A second contact within this time after the first is one hit gone wrong; later it is the next hit. s
_REBOUND_S = 0.15
#: A hammer's force is at rest nearly always.
_AT_REST = 0.9


@dataclass(frozen=True, slots=True)
class HitSettings:
    """How hits are found and judged.

    Parameters
    ----------
    block_s
        Length of the block of each hit, s; None where each record is the block of one hit.
    pretrigger_s
        How long before its trigger a block begins, s; of no effect without `block_s`.
    trigger_level
        Force that triggers, as a fraction of the largest force of all records.
    double_hit_level
        A second peak in a block above this fraction of the first makes the hit a double one.
    force_range_n
        Full scale of the force, N; None where it is not known: then only a flat top shows that it was overloaded.

    Raises
    ------
    MeasurementError
        If a number is impossible.
    """

    block_s: float | None = None
    pretrigger_s: float = 0.0
    trigger_level: float = 0.1
    double_hit_level: float = 0.05
    force_range_n: float | None = None

    def samples(self, record: TimeRecord) -> int:
        """Samples of a block of a record."""
        return record.values.size if self.block_s is None else round(self.block_s * record.sample_rate_hz)

    def __post_init__(self) -> None:
        if not (0 < self.trigger_level < 1 and 0 < self.double_hit_level < 1):
            found = f"a trigger level of {self.trigger_level:g} and a level of double hits of {self.double_hit_level:g}"
            raise refusal("hits", found, "fractions between 0 and 1", "correct them")
        if (self.block_s is not None and not self.block_s > 0) or not self.pretrigger_s >= 0:
            found = f"blocks of {self.block_s} s that begin {self.pretrigger_s:g} s before the trigger"
            raise refusal("hits", found, "a length above 0 and a pretrigger of at least 0", "correct them")


@dataclass(frozen=True, slots=True)
class Hit:
    """One hit.

    Parameters
    ----------
    number
        Counted from 1 over all records.
    record
        Number of the record among those that were looked at, from 0.
    start, trigger
        Samples of the record at which its block begins, and at which the force rises above the trigger.
    peak_n
        Largest force, with the sign it has, N.
    width_s
        How long the force stays above half of it, s.
    reason
        Why it is left out; empty where it is kept.
    """

    number: int
    record: int
    start: int
    trigger: int
    peak_n: float
    width_s: float
    reason: str = ""

    @property
    def kept(self) -> bool:
        """Whether it counts."""
        return not self.reason


def find_hits(forces: Sequence[TimeRecord], settings: HitSettings) -> tuple[Hit, ...]:
    """Find the hits in records of a hammer's force, and reject double, overloaded and incomplete ones.

    Parameters
    ----------
    forces
        Records of the force, of the same hammer and sample rate.
    settings
        Trigger, block and levels.

    Returns
    -------
    tuple of Hit
        In order of time. A record without any hit gives one that is rejected, where each record is a block.

    Raises
    ------
    MeasurementError
        If no record holds any force.
    """
    # a hammer is at rest nearly always, so that the median is the offset and no hit moves it
    quiet = [r.values - np.median(r.values) if r.values.size else r.values for r in forces]
    largest = max((float(np.abs(x).max(initial=0.0)) for x in quiet), default=0.0)
    if not largest > 0:
        raise refusal("hits", f"no force in {len(forces)} records", "a hammer's", "check the channel")
    hits: list[Hit] = []
    for i, (record, x) in enumerate(zip(forces, quiet, strict=True)):
        above = np.flatnonzero(np.abs(x) > settings.trigger_level * largest)
        if settings.block_s is None and above.size:
            hits.append(_judge(i, record, x, 0, int(above[0]), x.size, settings))
        elif settings.block_s is None:
            hits.append(Hit(0, i, 0, 0, 0.0, 0.0, "no force above the trigger"))
        else:
            rate, position = record.sample_rate_hz, 0
            samples, before = max(round(settings.block_s * rate), 1), round(settings.pretrigger_s * rate)
            while (later := above[above >= position]).size:
                trigger = int(later[0])
                hits.append(_judge(i, record, x, trigger - before, trigger, samples, settings))
                position = max(trigger - before + samples, trigger + 1)
    return tuple(replace(hit, number=number) for number, hit in enumerate(hits, 1))


def _judge(
    index: int, record: TimeRecord, x: Array, start: int, trigger: int, samples: int, settings: HitSettings
) -> Hit:
    rate = record.sample_rate_hz
    block = x[max(start, 0) : start + samples]
    # the first pulse ends where the force, once triggered, changes its sign
    at = trigger - max(start, 0)
    back = np.flatnonzero(np.sign(block[at]) * block[at:] <= 0)
    top = int(np.argmax(np.abs(block[: at + int(back[0]) if back.size else block.size])))
    peak = float(block[top])
    upright = np.sign(peak) * block
    rise, fall = stretch_about(upright < 0.5 * upright[top], top)
    width = (fall - rise) / rate
    reason = ""
    if start < 0:
        reason = f"its block would begin {-start / rate:.3g} s before the record"
    elif start + samples > x.size:
        reason = f"its block would end {(start + samples - x.size) / rate:.3g} s after the record"
    elif is_clipped(record.values[start : start + samples], settings.force_range_n):
        reason = "force overloaded"
    else:
        level = settings.double_hit_level * abs(peak)
        # a second contact comes after the force was gone: most of its height is prominence
        peaks, facts = scipy.signal.find_peaks(upright[top:], height=level, prominence=level / 2)
        apart = facts["prominences"] > 0.5 * facts["peak_heights"]
        second = peaks[apart & (peaks > 0)]
        if second.size:
            reason = f"double hit, again after {second[0] / rate * 1e3:.3g} ms"
    return Hit(0, index, start, trigger, peak, width, reason)


def is_clipped(values: Array, full_scale: float | None = None) -> bool:
    """Whether a signal was cut off: it reaches the full scale, or its top is flat over three samples or more."""
    largest = float(np.abs(values).max(initial=0.0))
    if largest == 0:
        return False
    if full_scale is not None:
        return largest >= full_scale * (1 - 1e-6)
    # either end by itself: it is the amplifier that is cut off, and an offset may lie before it
    ends = [side for side in (values, -values) if float(side.max()) > _SMALL * largest]
    flat = [np.convolve(side >= side.max() - 1e-9 * largest, np.ones(_FLAT)).max() for side in ends]
    return bool(max(flat) > _FLAT - 0.5)


def reject_overloads(hits: Sequence[Hit], responses: Sequence[TimeRecord], settings: HitSettings) -> tuple[Hit, ...]:
    """Reject hits during which a response was overloaded.

    Parameters
    ----------
    hits
        Of `find_hits`.
    responses
        Records of one response, in the order of those of the force.
    settings
        As for `find_hits`.
    """

    def judge(hit: Hit) -> Hit:
        record = responses[hit.record]
        block = record.values[max(hit.start, 0) : hit.start + settings.samples(record)]
        return replace(hit, reason=f"response {record.channel} overloaded") if hit.kept and is_clipped(block) else hit

    return tuple(map(judge, hits))


def is_cut_off(values: Array) -> bool:
    """Whether a signal was cut off: it is clipped, or one end is taken often and the value next to it hardly ever."""
    if is_clipped(values):
        return True
    for side in (values, -values):
        levels, counts = np.unique(side[side > 0.5 * side.max()], return_counts=True)
        if levels.size > 1 and counts[-1] >= 5 and counts[-1] > 3 * counts[-2]:
            return True
    return False


def hits_of(record: TimeRecord) -> tuple[Hit, ...]:
    """Hits in a record of a hammer's force; none where it is another channel or no hammer's.

    A record of more than a second may hold several hits; each is looked at for 0.15 s.
    """
    if record.quantity != "force" or record.values.size < 16 or not measurable(record.values).all():
        return ()
    x = np.abs(record.values - np.median(record.values))
    largest = float(x.max())
    if largest == 0 or np.mean(x < 0.1 * largest) < _AT_REST:
        return ()
    several = record.hit is None and record.values.size / record.sample_rate_hz > 1.0
    return find_hits([record], HitSettings(block_s=_REBOUND_S if several else None))
