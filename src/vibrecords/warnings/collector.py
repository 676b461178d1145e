"""Warnings about measured records: what in a file contradicts itself or physics, in words."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from vibrecords.arrays import Array, Band, ComplexArray
from vibrecords.provenance import MeasurementWarning
from vibrecords.records import FrfRecord, Record, TimeRecord, measurable
from vibrecords.signals.hits import hits_of, is_cut_off
from vibrecords.warnings.clear_frf import ClearFrf, Peaks, are_conjugates, shift_warning
from vibrecords.warnings.frf_warnings import conjugated_warning, warnings_of_frf, warnings_of_notes
from vibrecords.warnings.kinds import warn

#: Lines kept of each FRF, so that a file of many thousands can be compared within little memory.
_KEPT = 128
#: A ratio is constant if ln|ratio| and its phase scatter by less than this.
_CONSTANT = 0.1
_G = 9.80665
#: Factors with a name, and how far a calibration may be off.
_NEAR = 0.04


@dataclass(frozen=True, slots=True, eq=False)
class Sketch:
    """A few lines of an FRF as mobility with signs of directions taken out, and their noise; and where it is from."""

    record: str
    where: str
    frequency_hz: Array
    mobility: ComplexArray
    noise: Array

    @classmethod
    def of(cls, record: FrfRecord, clear: ClearFrf) -> "Sketch":
        """Sketch of a record and of what can be judged of it."""
        kept = np.unique(np.linspace(0, clear.frequency_hz.size - 1, _KEPT).astype(int))
        # single precision is enough and half as large
        mobility, noise = clear.mobility[kept].astype(np.complex64), clear.noise[kept].astype(np.float32)
        return cls(f"{record.response}/{record.reference}", record.where, clear.frequency_hz[kept], mobility, noise)


def disagreement(first: Sketch, other: Sketch) -> MeasurementWarning | None:
    """Warning where two FRFs that should be equal are not; None where they are or cannot be compared.

    Its key is ``"sign"``, ``"g"``, ``"rad_per_s"``, ``"quantity"``, ``"factor"`` or ``"shape"``.
    """
    if first.frequency_hz.shape != other.frequency_hz.shape or not np.allclose(first.frequency_hz, other.frequency_hz):
        return None
    a, b = first.mobility.astype(complex), other.mobility.astype(complex)
    clear = (np.abs(a) > 5 * first.noise) & (np.abs(b) > 5 * other.noise)
    if clear.sum() >= 16 and (warning := _named_ratio(first.frequency_hz[clear], b[clear] / a[clear])):
        return warning
    larger = np.maximum(np.abs(a), np.abs(b))
    noise = np.hypot(first.noise.astype(float), other.noise.astype(float))
    apart = np.abs(a - b) > 4 * noise + 0.15 * larger
    return warn("shape", percent=100 * apart.mean()) if apart.mean() > 0.1 else None


def _named_ratio(f: Array, ratio: ComplexArray) -> MeasurementWarning | None:
    """What a ratio that is constant, or a power of jω, says."""
    omega = 2 * np.pi * f
    for power in (0, 1, -1, 2, -2):
        rest = ratio / (1j * omega) ** power
        level = float(np.median(np.abs(rest)))
        turn = np.median(rest.real) + 1j * np.median(rest.imag)
        scatter = np.log(np.abs(rest) / level)
        phase = np.angle(rest / turn) if turn != 0 else np.full(rest.size, np.pi)
        if np.median(np.abs(scatter)) > _CONSTANT or np.median(np.abs(phase)) > _CONSTANT:
            continue
        if power:
            return warn("quantity", power=power)
        level, opposite = max(level, 1 / level), " and the opposite sign" if turn.real < 0 else ""
        if abs(math.log(level / _G)) < _NEAR:
            return warn("g", level=level, opposite=opposite)
        for factor, value in (("2π", 2 * np.pi), ("(2π)²", 4 * np.pi**2)):
            if abs(math.log(level / value)) < _NEAR:
                found = f"one is {factor} times the other once both are the same quantity{opposite}"
                return warn("rad_per_s", found=found)
        if math.log(level) > 0.15:
            return warn("factor", level=level, opposite=opposite)
        return warn("sign") if opposite else None
    return None


#: Places named in one warning; the rest are counted.
_NAMED = 3
#: Offsets smaller than this fraction of the largest value do no harm.
_OFFSET = 0.01
#: A ring-down is looked at in so many parts of so many samples; it is cut off above this fraction of its largest value.
_PARTS, _FEWEST_SAMPLES, _CUT_OFF = 8, 200, 0.05
#: Resolved resonances from which on one FRF, and all of a file, tell whether they are conjugates.
_ALONE, _TOGETHER = 0.8, 0.5
#: FRFs kept whole, which do not tell, until those of the whole file have told it.
_WAITING = 64


def find_warnings(records: Record | Iterable[Record], mass_kg: float | None = None) -> tuple[MeasurementWarning, ...]:
    """Look for contradictions in records of one file.

    What cannot be told is not claimed: one FRF alone does not show g against m/s², or receptance against accelerance
    with the opposite sign. See the documentation for what each warning rests on.

    Parameters
    ----------
    records
        A record or records, as readers give them.
    mass_kg
        Mass of the structure if it hangs free: drive points are then held against its mass line, kg.

    Returns
    -------
    tuple of MeasurementWarning
        In the order of the file; the same about several records is one warning.
    """
    collector = WarningCollector(mass_kg)
    for record in [records] if isinstance(records, Record) else records:
        collector.add(record)
    return collector.warnings()


#: What FRFs are that should be equal, by the key of the warning.
_TWICE = "repeats_differ", "the same FRF is there twice"
_EXCHANGED = "reciprocity", "with response and force exchanged the FRFs should be equal"
#: The ratio of two quantities of one sensor, g and rad/s have warnings of their own.
_OWN_WARNINGS = {"g": "g_against_ms2", "rad_per_s": "rad_per_s", "quantity": "quantity_phase"}


class WarningCollector:
    """Warnings about records that come one by one; of each only a sketch is kept.

    Parameters
    ----------
    mass_kg
        As in `find_warnings`.
    band_hz
        Band whose resonances tell whether FRFs are complex conjugates, Hz.
    """

    def __init__(self, mass_kg: float | None = None, band_hz: Band = (None, None)) -> None:
        self._mass_kg, self._band_hz = mass_kg, band_hz
        self._raw: dict[tuple[str, str], list[MeasurementWarning]] = {}
        self._counts = Counter[tuple[str, str]]()
        self._sketches: dict[tuple[str, str], list[Sketch]] = {}
        self._peaks: dict[tuple[str, str], Peaks] = {}
        self._turns = np.zeros(2)
        self._waiting: list[tuple[str, FrfRecord, ClearFrf]] = []
        self._highest_hz = 0.0
        self._highest_where = ""
        self._nyquist_hz = np.inf

    def add(self, record: Record) -> None:
        """Look at one record."""
        if isinstance(record, TimeRecord):
            where = _place(record.channel, record.where)
            self._nyquist_hz = min(self._nyquist_hz, record.sample_rate_hz / 2)
            self._keep(where, *_history_warnings(record))
            return
        if not isinstance(record, FrfRecord):
            return
        where, whole = _place(f"{record.response}/{record.reference}", record.where), ClearFrf.of(record)
        if whole is None:
            self._tell(where, record, None, turned=False)
        else:
            clear = whole.driven(record)
            turns = clear.turns(self._band_hz)
            self._turns += turns
            turned = are_conjugates(turns, _ALONE)
            if turned is None and len(self._waiting) < _WAITING:  # for the others to tell
                self._waiting.append((where, record, clear))
            else:
                self._tell(where, record, clear, turned=bool(turned))
            pair = clear.response, clear.reference
            # resonances against those of the same FRF before, or else of the first response to the same force
            peaks = Peaks.of(where, clear)
            for key, same_frf in ((pair, True), (("", pair[1]), False)):
                first = self._peaks.setdefault(key, peaks)
                if first is not peaks:
                    if warning := shift_warning(first, peaks, same_frf=same_frf):
                        self._keep(f"{first.where} and {peaks.where}", warning)
                    break
            # values against the same FRF before, and that with response and force exchanged; whole, on equal lines
            sketch, before = Sketch.of(record, whole), self._sketches.setdefault(pair, [])
            across = self._sketches.get((pair[1], pair[0]), []) if pair[0] != pair[1] else []
            for others, kind, what in ((before, *_TWICE), (across, *_EXCHANGED)):
                for other in others:
                    if warning := disagreement(other, sketch):
                        sentence = f"{what}, but {warning.sentence}"
                        warning = replace(warning, key=_OWN_WARNINGS.get(warning.key, kind), sentence=sentence)
                        self._keep(f"{_place(other.record, other.where)} and {sketch.where}", warning)
            before += [sketch] * (len(before) < 2)  # two of a kind are enough to compare with
        highest = float(np.max(record.frequency_hz, initial=0.0))
        if highest > self._highest_hz:
            self._highest_hz, self._highest_where = highest, where

    @property
    def conjugated(self) -> bool | None:
        """Whether the FRFs so far are complex conjugates; None where they do not tell, or not with one voice."""
        return are_conjugates(self._turns, _TOGETHER)

    def _tell(self, where: str, record: FrfRecord, clear: ClearFrf | None, *, turned: bool) -> None:
        if clear is not None and turned:
            self._keep(where, conjugated_warning(clear))
            clear = clear.conjugate
        self._keep(where, *warnings_of_frf(record, clear, self._mass_kg))

    def warnings(self) -> tuple[MeasurementWarning, ...]:
        """All warnings so far, equal ones put together."""
        for where, record, clear in self._waiting:
            self._tell(where, record, clear, turned=bool(self.conjugated))
        self._waiting.clear()
        if self._highest_hz > 1.01 * self._nyquist_hz:
            most = f"the time histories of the file can show {self._nyquist_hz:.6g} Hz at most"
            found = f"the lines reach {self._highest_hz:.6g} Hz, but {most}"
            self._keep(self._highest_where, warn("rad_per_s", found=found))
        merged = []
        for group, alike in self._raw.items():
            count = self._counts[group]
            more = f" and {count - len(alike)} more" if count > len(alike) else ""
            where = ", ".join(warning.where for warning in alike) + more
            differ = len({warning.sentence for warning in alike}) > 1
            sentence = alike[0].sentence + (" (here the first of them)" if differ else "")
            merged.append(replace(alike[0], where=where, sentence=sentence))
        return tuple(merged)

    def _keep(self, where: str, *warnings: MeasurementWarning) -> None:
        for warning in warnings:
            group = (warning.key, warning.remedy)
            self._counts[group] += 1
            kept = self._raw.setdefault(group, [])
            if len(kept) < _NAMED:
                kept.append(replace(warning, where=where))


def _place(channel: str, where: str) -> str:
    return f"{where} ({channel})" if where else channel


def _history_warnings(record: TimeRecord) -> Iterator[MeasurementWarning]:
    """What one time history contradicts."""
    x = record.values
    broken = ~measurable(x)
    if broken.any():
        yield warn("not_finite", count=int(broken.sum()), size=x.size, what="samples")
        return
    if x.size < 16:
        return
    if record.quantity == "unknown":
        yield warn("quantity_missing", which="a force or a motion")
    if np.ptp(x) == 0:
        yield warn("dead_channel", value=x[0])
        return
    yield from warnings_of_notes(record.notes)
    if is_cut_off(x):
        yield warn("overload", largest=np.abs(x).max())
    for hit in hits_of(record):
        if hit.reason.startswith("double hit"):
            number = hit.number if record.hit is None else record.hit
            yield warn("double_hit", number=number, reason=hit.reason)
    # a decaying or random signal has its median within its own spread; an offset shows in mean and median alike
    swing = np.abs(x - np.median(x))
    largest, spread = float(swing.max()), float(np.median(swing))
    level = min(np.median(x), np.mean(x), key=abs)
    if largest > 0 and np.median(x) * np.mean(x) > 0 and abs(level) > _OFFSET * largest + spread:
        yield warn("offset", level=level, percent=100 * abs(level) / largest)
    # a ring-down that the end of the record cuts off falls from part to part, as no noise or steady response does
    x = x - np.median(x)
    top = int(np.argmax(np.abs(x)))
    after = np.array_split(x[top:], _PARTS)
    if record.quantity == "force" or after[0].size < _FEWEST_SAMPLES:
        return
    parts = np.array([np.sqrt(np.mean(part**2)) for part in after])
    left = float(np.abs(after[-1]).max() / np.abs(x[top]))
    if (np.diff(parts) < 0).all() and parts[-1] < 0.9 * parts[-2] and left > _CUT_OFF:
        yield warn("truncated_ring_down", percent=100 * left)
