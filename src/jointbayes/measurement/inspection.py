"""What a measurement file holds and what is doubtful about it, and that in words, line by line, for a terminal."""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path
from typing import TypeVar

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError
from jointbayes.measurement.formats.grid import join_frfs
from jointbayes.measurement.modal_doubt import DoubtfulMode
from jointbayes.measurement.modal_fit import fit_modes
from jointbayes.measurement.provenance import MeasuredMode, MeasurementWarning
from jointbayes.measurement.records import FrfRecord, Record, TimeRecord, labels_of, parse_dof
from jointbayes.measurement.signals.hits import Hit, hits_of
from jointbayes.measurement.warnings.clear_frf import pair_of, usable
from jointbayes.measurement.warnings.collector import WarningCollector

#: FRFs kept whole, of drive points and of others, for resonances and figure.
_KEPT = 3
#: Hits kept for the figure, and samples kept of time histories for FRFs.
_HITS_DRAWN, _SAMPLES_KEPT = 24, 5_000_000
#: More lines than this are not fitted at once.
_MOST_LINES = 20_000


@dataclass(frozen=True, slots=True, eq=False)
class HitTrace:
    """One hit: its channel, what was found, and the force about it; `time_s` from the trigger on, s, `force_n`, N."""

    channel: str
    hit: Hit
    time_s: Array
    force_n: Array


@dataclass(slots=True)
class ChannelCount:
    """How often a channel is response and force of an FRF, how many time histories it has, and of which quantity."""

    as_response: int = 0
    as_force: int = 0
    histories: int = 0
    quantities: Counter[str] = field(default_factory=Counter)


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """What a file holds.

    Parameters
    ----------
    source, form
        File and its format; the format is empty where there is no file.
    channels
        Channel labels in the order of the file.
    kinds
        For each kind of record, in words, how many there are.
    averages, coherence
        Numbers of averages, and smallest and median coherence; None where there is none.
    notes
        What readers did, each with how often.
    frfs
        Some FRFs whole, for the figure: drive points first.
    modes, modes_of, modes_note, doubtful
        Resonances, of which FRFs they are, why there are none, and what looks like one and is left out.
    hits
        All hits of hammers, the first ones with the force to draw.
    warnings
        What contradicts itself.
    """

    source: str
    form: str
    channels: dict[str, ChannelCount]
    kinds: dict[str, int]
    averages: tuple[int, ...]
    coherence: tuple[float, float] | None
    notes: dict[str, int]
    frfs: tuple[FrfRecord, ...]
    modes: tuple[MeasuredMode, ...]
    modes_of: tuple[str, ...]
    modes_note: str
    doubtful: tuple[DoubtfulMode, ...]
    hits: tuple[HitTrace, ...]
    warnings: tuple[MeasurementWarning, ...]


def inspect_file(path: Path, mass_kg: float | None = None, *, conjugate: bool = False) -> Inspection:
    """Look through a measurement file; of a universal file no more than a few records are in memory at once.

    Parameters
    ----------
    path
        File of any format that is read.
    mass_kg
        Mass of the structure if it hangs free, kg, to hold drive points against.
    conjugate
        Whether the complex conjugates of the FRFs are looked at.

    Raises
    ------
    MeasurementError
        If the file cannot be read.
    """
    from jointbayes.measurement.formats.read import detect_format, iter_records

    form = detect_format(path)
    records = (r.conjugate if conjugate and isinstance(r, FrfRecord) else r for r in iter_records(path))
    return replace(inspect_records(records, mass_kg), source=str(path), form=form)


def inspect_records(records: Iterable[Record], mass_kg: float | None = None) -> Inspection:
    """As `inspect_file`, for records that come one by one."""
    with np.errstate(all="ignore"):  # a file may hold any number
        return _inspected(records, mass_kg)


def _inspected(records: Iterable[Record], mass_kg: float | None) -> Inspection:
    seen = _Seen(WarningCollector(mass_kg))
    for record in records:
        seen.add(record)
    made, note = ([], "") if seen.frf_kept() else _frfs_of_hits(seen.histories if seen.complete else [])
    for record in made:
        seen.warnings.add(record)
        seen.keep_frf(record)
    kept = seen.frf_kept()
    warnings = seen.warnings.warnings()
    fitted = kept
    if seen.warnings.conjugated:
        seen.notes["the resonances are those of the complex conjugates of the FRFs"] += 1
        fitted = tuple(record.conjugate for record in kept)
    modes, doubtful, modes_of, modes_note = _modes(fitted) if kept else ((), (), (), note)
    coherences = seen.coherence
    return Inspection(
        "",
        "",
        seen.channels,
        dict(seen.kinds),
        tuple(sorted(seen.averages)),
        (min(low for low, _ in coherences), float(np.median([m for _, m in coherences]))) if coherences else None,
        dict(seen.notes),
        kept,
        modes,
        modes_of,
        modes_note,
        doubtful,
        tuple(seen.hits),
        warnings,
    )


@dataclass(slots=True)
class _Seen:
    """Running summary of the records that went by."""

    warnings: WarningCollector
    channels: dict[str, ChannelCount] = field(default_factory=dict)
    kinds: Counter[str] = field(default_factory=Counter)
    averages: set[int] = field(default_factory=set)
    coherence: list[tuple[float, float]] = field(default_factory=list)
    notes: Counter[str] = field(default_factory=Counter)
    drive_points: list[FrfRecord] = field(default_factory=list)
    others: list[FrfRecord] = field(default_factory=list)
    hits: list[HitTrace] = field(default_factory=list)
    histories: list[TimeRecord] = field(default_factory=list)
    samples: int = 0
    complete: bool = True

    def add(self, record: Record) -> None:
        self.warnings.add(record)
        self.notes.update(record.notes)
        if isinstance(record, TimeRecord):
            self._add_history(record)
            return
        if not isinstance(record, FrfRecord):
            self.kinds[type(record).__name__.removesuffix("Record").lower()] += 1
            for label in labels_of(record):
                self._use(label)
            return
        f = record.frequency_hz
        step = f" every {(f[-1] - f[0]) / (f.size - 1):.6g} Hz" if f.size > 1 else ""
        span = f"{f.size} lines, {f[0]:.6g} to {f[-1]:.6g} Hz{step}" if f.size else "no lines"
        unit = f", unit {record.unit}" if record.unit else ", no unit"
        self.kinds[f"FRF: {record.quantity or 'unknown quantity'}{unit}; {span}"] += 1
        self._use(record.response).as_response += 1
        self._use(record.reference).as_force += 1
        self._use(record.response).quantities[record.quantity or "unknown"] += 1
        if record.averages is not None:
            self.averages.add(record.averages)
        if record.coherence is not None and np.isfinite(record.coherence).any():
            finite = record.coherence[np.isfinite(record.coherence)]
            self.coherence.append((float(finite.min()), float(np.median(finite))))
        self.keep_frf(record)

    def keep_frf(self, record: FrfRecord) -> None:
        response, reference, _ = pair_of(record)
        kept = self.drive_points if response == reference else self.others
        if len(kept) < _KEPT and record.frequency_hz.size > 1:
            kept.append(record)

    def frf_kept(self) -> tuple[FrfRecord, ...]:
        return (*self.drive_points, *self.others)

    def _use(self, label: str) -> ChannelCount:
        return self.channels.setdefault(label, ChannelCount())

    def _add_history(self, record: TimeRecord) -> None:
        use = self._use(record.channel)
        use.histories += 1
        use.quantities[record.quantity] += 1
        seconds = record.values.size / record.sample_rate_hz
        unit = f", unit {record.unit}" if record.unit else ", no unit"
        self.kinds[
            f"time history: {record.quantity}{unit}; {record.values.size} samples, {seconds:.6g} s at "
            f"{record.sample_rate_hz:.6g} Hz"
        ] += 1
        for hit in hits_of(record):
            self.hits.append(_trace(record, hit, drawn=len(self.hits) < _HITS_DRAWN))
        self.samples += record.values.size
        if self.samples <= _SAMPLES_KEPT:
            self.histories.append(record)
        else:
            self.complete = False


def _trace(record: TimeRecord, hit: Hit, *, drawn: bool) -> HitTrace:
    hit = replace(hit, number=hit.number if record.hit is None else record.hit)
    if not drawn:
        return HitTrace(record.channel, hit, np.empty(0), np.empty(0))
    rate = record.sample_rate_hz
    # twenty widths show the pulse and a rebound; a rebound that comes later is shown as well
    after = max(round(20 * max(hit.width_s, 2 / rate) * rate), 40)
    if hit.reason.startswith("double hit"):
        x = np.abs(record.values - np.median(record.values))
        above = np.flatnonzero(x[hit.trigger :] > 0.05 * abs(hit.peak_n))
        after = max(after, min(int(above[-1]) + after // 4, round(0.2 * rate)))
    first, last = max(hit.trigger - after // 4, 0), min(hit.trigger + after, record.values.size)
    time = (np.arange(first, last) - hit.trigger) / rate
    return HitTrace(record.channel, hit, time, np.array(record.values[first:last]))


def _frfs_of_hits(histories: list[TimeRecord]) -> tuple[list[FrfRecord], str]:
    """FRFs of a hammer's records that hold one hit each, and why there are none."""
    from jointbayes.measurement.signals.impact import impact_frfs
    from jointbayes.measurement.signals.spectra import sort_by_force

    forces = [r for r in histories if r.quantity == "force"]
    if not forces or any(len(hits_of(r)) != 1 for r in forces):
        return [], "the records are not one hit each: make FRFs of them first"
    try:
        tests = sort_by_force(histories)
        results = [impact_frfs(force, responses) for force, responses in tests if responses]
    except MeasurementError as error:
        return [], f"no FRFs could be made of the hits: {error}"
    return [result.frf for result in chain.from_iterable(results)], ""


_Modes = tuple[tuple[MeasuredMode, ...], tuple[DoubtfulMode, ...], tuple[str, ...], str]


def _modes(kept: tuple[FrfRecord, ...]) -> _Modes:
    """Resonances of FRFs on the same lines over the same force; doubtful ones; which FRFs; and why there are none."""
    clean = [usable(r) for r in kept if r.quantity is not None]
    if not clean:
        return (), (), (), "no FRF of a known quantity"
    first = clean[0]
    group: dict[str, FrfRecord] = {}
    for record in clean:
        same = record.reference == first.reference and record.quantity == first.quantity
        if same and np.array_equal(record.frequency_hz, first.frequency_hz):
            group.setdefault(record.response, record)
    members = list(group.values())[:_KEPT]
    names = tuple(f"{r.response}/{r.reference}" for r in members)
    if first.frequency_hz.size > _MOST_LINES:
        return (), (), names, f"{first.frequency_hz.size} lines are too many to fit at once: choose a band"
    coherences = [r.coherence for r in members if r.averages and r.coherence is not None]
    told = len(coherences) == len(members) and all(((c >= 0) & (c <= 1)).all() for c in coherences)
    try:
        fit = fit_modes(join_frfs(members if told else [replace(r, coherence=None) for r in members], "modes"))
    except MeasurementError as error:
        return (), (), names, str(error)
    return fit.modes, fit.doubtful, names, "" if fit.modes else "none stands out of the noise"


T = TypeVar("T")

#: Longer lists are cut here.
_LISTED = 40


def text_of(inspection: Inspection) -> Iterator[str]:
    """Lines to print: contents, channels, resonances, hits, notes, warnings."""
    yield f"{inspection.source} ({inspection.form})" if inspection.form else inspection.source or "records"
    for kind, count in _first(inspection.kinds):
        yield f"  {count} × {kind}"
    yield from _more(len(inspection.kinds))
    if inspection.averages:
        yield f"  averages: {', '.join(str(n) for n in inspection.averages[:10])}"
    if inspection.coherence is not None:
        yield f"  coherence: smallest {inspection.coherence[0]:.4f}, median {inspection.coherence[1]:.4f}"
    yield ""
    yield f"Channels ({len(inspection.channels)})"
    width = max((len(label) for label in inspection.channels), default=0)
    for label, use in _first(inspection.channels):
        yield f"  {label:<{width}}  {_dof(label)}{_use(use)}"
    yield from _more(len(inspection.channels))
    yield from _resonances(inspection)
    yield from _hits(inspection)
    if inspection.notes:
        yield ""
        yield "Done on reading"
        for note, count in _first(inspection.notes):
            yield f"  {note}" + (f" ({count} times)" if count > 1 else "")
        yield from _more(len(inspection.notes))
    yield ""
    if not inspection.warnings:
        yield "No warnings."
        return
    yield f"Warnings ({len(inspection.warnings)})"
    for number, warning in enumerate(inspection.warnings, 1):
        yield f"  {number}. {warning.where}: {warning.sentence}. What to do: {warning.remedy}. [{warning.key}]"


def _resonances(inspection: Inspection) -> Iterator[str]:
    yield ""
    if not inspection.modes:
        yield f"Resonances: {inspection.modes_note}"
    else:
        yield f"Resonances of {', '.join(inspection.modes_of)} (± one standard deviation)"
    for number, mode in enumerate(inspection.modes, 1):
        digits = _digits(mode.frequency_sd_hz)
        percent, sd = 100 * mode.damping_ratio, 100 * mode.damping_sd
        yield (
            f"  {number:>3}  {mode.frequency_hz:>10.{digits}f} ± {mode.frequency_sd_hz:.{digits}f} Hz   "
            f"damping {percent:.{_digits(sd)}f} ± {sd:.{_digits(sd)}f} %"
        )
    if inspection.doubtful:
        yield "Left out of the resonances"
    for doubt in inspection.doubtful:
        yield f"  {doubt.frequency_hz:.6g} Hz: {doubt.reason}"


def _hits(inspection: Inspection) -> Iterator[str]:
    if not inspection.hits:
        return
    yield ""
    yield f"Hits ({len(inspection.hits)})"
    for trace in inspection.hits[:_LISTED]:
        hit = trace.hit
        verdict = "kept" if hit.kept else f"LEFT OUT: {hit.reason}"
        yield f"  {trace.channel} hit {hit.number}: {hit.peak_n:.4g} N, {1e3 * hit.width_s:.3g} ms, {verdict}"
    yield from _more(len(inspection.hits))


def _dof(label: str) -> str:
    dof = parse_dof(label)
    if dof is None or dof.direction == 0:
        return "no direction; "
    axis = ("", "X", "Y", "Z", "RX", "RY", "RZ")[abs(dof.direction)]
    return f"node {dof.node}, direction {axis}{'-' if dof.direction < 0 else '+'}; "


def _use(use: ChannelCount) -> str:
    parts = []
    if use.as_response:
        parts.append(f"response of {use.as_response} FRFs")
    if use.as_force:
        parts.append(f"force of {use.as_force} FRFs")
    if use.histories:
        parts.append(f"{use.histories} time histories")
    kinds = ", ".join(use.quantities)
    return ", ".join(parts) + (f" ({kinds})" if kinds else "")


def _digits(sd: float) -> int:
    """Decimals that show a standard deviation with two digits."""
    if not sd > 0:
        return 2
    decimals = 0
    while sd < 9.5 and decimals < 8:
        sd, decimals = 10 * sd, decimals + 1
    return decimals


def _first(entries: dict[str, T]) -> list[tuple[str, T]]:
    return list(entries.items())[:_LISTED]


def _more(count: int) -> Iterator[str]:
    if count > _LISTED:
        yield f"  and {count - _LISTED} more"
