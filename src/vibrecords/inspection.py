"""What a measurement file holds and what is doubtful about it, the resonances of its FRFs, and both in words."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain, islice, starmap
from pathlib import Path
from typing import TypeVar

import numpy as np

from vibrecords.arrays import Array, Band
from vibrecords.errors import MeasurementError
from vibrecords.formats.grid import join_frfs
from vibrecords.modal_doubt import DoubtfulMode
from vibrecords.modal_fit import fit_modes
from vibrecords.provenance import MeasuredMode, MeasurementWarning
from vibrecords.records import (
    CoherenceRecord,
    FrfRecord,
    ModeRecord,
    Record,
    SpectrumRecord,
    TimeRecord,
    dof_label,
    labels_of,
    parse_dof,
)
from vibrecords.signals.hits import Hit, hits_of
from vibrecords.warnings.clear_frf import ClearFrf, pair_of, usable
from vibrecords.warnings.collector import WarningCollector

#: FRFs kept whole, of drive points and of others, for resonances and figure.
_KEPT = 3
#: Hits kept for the figure, and samples kept of time histories for FRFs.
_HITS_DRAWN, _SAMPLES_KEPT = 24, 5_000_000
#: Modes kept of those that a file states.
_MODES_KEPT = 40


@dataclass(frozen=True, slots=True, eq=False)
class HitTrace:
    """One hit: its channel, what was found, and the force about it; `time_s` from the trigger on, s, `force_n`, N."""

    channel: str
    hit: Hit
    time_s: Array
    force_n: Array


@dataclass(slots=True)
class ChannelCount:
    """How often a channel is response and force of an FRF, has time histories and spectra, and of which quantity."""

    as_response: int = 0
    as_force: int = 0
    histories: int = 0
    spectra: int = 0
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
        Some FRFs whole, for the figure and for resonances: drive points first.
    conjugated
        Whether the FRFs are complex conjugates of what they should be, which their resonances are sought in.
    hits
        All hits of hammers, the first ones with the force to draw.
    listed_modes
        Modes that the file itself states.
    warnings
        What contradicts itself.
    modes, modes_of, modes_note, doubtful
        Resonances, of which FRFs they are, why there are none, and what looks like one and is left out.
    driven_hz
        Ends of the band that was driven, in which resonances are sought; None where that is the end of the lines.
    """

    source: str = ""
    form: str = ""
    channels: dict[str, ChannelCount] = field(default_factory=dict)
    kinds: Counter[str] = field(default_factory=Counter)
    averages: tuple[int, ...] = ()
    coherence: tuple[float, float] | None = None
    notes: Counter[str] = field(default_factory=Counter)
    frfs: tuple[FrfRecord, ...] = ()
    conjugated: bool = False
    hits: tuple[HitTrace, ...] = ()
    listed_modes: tuple[ModeRecord, ...] = ()
    warnings: tuple[MeasurementWarning, ...] = ()
    modes: tuple[MeasuredMode, ...] = ()
    modes_of: tuple[str, ...] = ()
    modes_note: str = ""
    doubtful: tuple[DoubtfulMode, ...] = ()
    driven_hz: Band = (None, None)


def inspect_file(
    path: Path,
    mass_kg: float | None = None,
    *,
    conjugate: bool = False,
    band_hz: Band = (None, None),
    layout: Mapping[str, str] | None = None,
    resonances: bool = True,
) -> Inspection:
    """Look through a measurement file and fit the resonances of its FRFs.

    Of a universal file no more than a few records are in memory at once.

    Parameters
    ----------
    path
        File of any format that is read.
    mass_kg
        Mass of the structure if it hangs free, kg, to hold drive points against.
    conjugate
        Whether the complex conjugates of the FRFs are looked at.
    band_hz
        Lowest and highest frequency at which resonances are sought, Hz; None is the end of the lines. The resonances in
        this band tell whether FRFs are complex conjugates.
    layout
        What the variables of the file stand for, as `vibrecords.formats.iter_records` takes it.
    resonances
        Whether resonances are fitted at once; otherwise `with_resonances` does it.

    Raises
    ------
    MeasurementError
        If the file cannot be read.
    """
    from vibrecords.formats.read import detect_format, iter_records

    form = detect_format(path)
    records = (r.conjugate if conjugate and isinstance(r, FrfRecord) else r for r in iter_records(path, layout))
    found = replace(contents_of_records(records, mass_kg, band_hz), source=str(path), form=form)
    return with_resonances(found, band_hz) if resonances else found


@np.errstate(all="ignore")  # a file may hold any number
def contents_of_records(
    records: Iterable[Record], mass_kg: float | None = None, band_hz: Band = (None, None)
) -> Inspection:
    """Look through records that come one by one, without resonances: each is counted, and a few are kept."""
    found, collector = Inspection(), WarningCollector(mass_kg, band_hz)
    averages: set[int] = set()
    coherences: list[tuple[float, float]] = []
    drive_points: list[FrfRecord] = []
    others: list[FrfRecord] = []
    hits: list[HitTrace] = []
    histories: list[TimeRecord] = []
    modes: list[ModeRecord] = []
    samples = 0

    def keep(frf: FrfRecord) -> None:
        response, reference, _ = pair_of(frf)
        kept = drive_points if response == reference else others
        if len(kept) < _KEPT and frf.frequency_hz.size > 1:
            kept.append(frf)

    for record in records:
        collector.add(record)
        found.notes.update(record.notes)
        uses = [found.channels.setdefault(label, ChannelCount()) for label in labels_of(record)]
        coherence = None
        match record:
            case TimeRecord():
                size, rate = record.values.size, record.sample_rate_hz
                span = f"{size} samples, {size / rate:.6g} s at {rate:.6g} Hz"
                kind = f"time history: {record.quantity}{_unit(record.unit)}; {span}"
                uses[0].histories += 1
                uses[0].quantities[record.quantity] += 1
                hits += [
                    _trace(record, hit, drawn=len(hits) + i < _HITS_DRAWN) for i, hit in enumerate(hits_of(record))
                ]
                samples += size
                histories += [record] * (samples <= _SAMPLES_KEPT)
            case ModeRecord():
                kind = "mode"
                modes += [record] * (len(modes) < _MODES_KEPT)
            case SpectrumRecord():
                kind = f"spectrum, no FRF: {record.kind}{_unit(record.unit)}; {_span(record.frequency_hz)}"
                uses[0].spectra += 1
            case CoherenceRecord():
                kind, coherence = f"coherence, without its FRF; {_span(record.frequency_hz)}", record.values
            case FrfRecord():
                words = f"FRF: {record.quantity or 'unknown quantity'}{_unit(record.unit)}"
                kind, coherence = f"{words}; {_span(record.frequency_hz)}", record.coherence
                uses[0].as_response += 1
                uses[1].as_force += 1
                uses[0].quantities[record.quantity or "unknown"] += 1
                keep(record)
        found.kinds[kind] += 1
        if isinstance(record, (FrfRecord, CoherenceRecord)) and record.averages is not None:
            averages.add(record.averages)
        if coherence is not None and (finite := coherence[np.isfinite(coherence)]).size:
            coherences.append((float(finite.min()), float(np.median(finite))))
    made, note = ([], "") if drive_points or others else _frfs_of_hits(histories, samples)
    for frf in made:
        collector.add(frf)
        keep(frf)
    warnings, conjugated = collector.warnings(), bool(collector.conjugated)
    if conjugated:
        found.notes["the resonances are those of the complex conjugates of the FRFs"] += 1
    lows, medians = zip(*coherences, strict=True) if coherences else ((), ())
    return replace(
        found,
        averages=tuple(sorted(averages)),
        coherence=(min(lows), float(np.median(medians))) if lows else None,
        frfs=(*drive_points, *others),
        conjugated=conjugated,
        hits=tuple(hits),
        listed_modes=tuple(modes),
        warnings=warnings,
        modes_note=note,
    )


@np.errstate(all="ignore")
def with_resonances(inspection: Inspection, band_hz: Band = (None, None)) -> Inspection:
    """Return the inspection with the resonances of its FRFs, or why there are none.

    Parameters
    ----------
    inspection
        Without resonances.
    band_hz
        As for `inspect_file`.
    """
    if not inspection.frfs:
        return inspection
    kept = tuple(record.conjugate for record in inspection.frfs) if inspection.conjugated else inspection.frfs
    clean = [usable(r) for r in kept if r.quantity is not None]
    if not clean:
        return replace(inspection, modes_note="no FRF of a known quantity")
    group: dict[str, FrfRecord] = {}  # on the same lines over the same force
    for record in clean:
        same = (record.reference, record.quantity) == (clean[0].reference, clean[0].quantity)
        if same and np.array_equal(record.frequency_hz, clean[0].frequency_hz):
            group.setdefault(record.response, record)
    members = list(group.values())[:_KEPT]
    # ends of the band that was driven, by the FRF that shows most of it; None where that is the end of the lines
    lines = members[0].frequency_hz
    driven = [whole.driven(record).frequency_hz for record in members if (whole := ClearFrf.of(record))]
    first, last = min((f[0] for f in driven), default=0.0), max((f[-1] for f in driven), default=np.inf)
    driven_low = float(first) if lines.size and first > lines[0] else None
    driven_high = float(last) if lines.size and last < lines[-1] else None
    driven_hz = driven_low, driven_high
    low = max((end for end in (band_hz[0], driven_low) if end is not None), default=None)
    high = min((end for end in (band_hz[1], driven_high) if end is not None), default=None)
    modes_of = tuple(f"{r.response}/{r.reference}" for r in members)
    inspection = replace(inspection, modes_of=modes_of, driven_hz=driven_hz)
    coherences = [r.coherence for r in members if r.averages and r.coherence is not None]
    told = len(coherences) == len(members) and all(((c >= 0) & (c <= 1)).all() for c in coherences)
    try:
        frf = join_frfs(members if told else [replace(r, coherence=None) for r in members], "modes")
        fit = fit_modes(frf, f_min_hz=low, f_max_hz=high)
    except MeasurementError as error:
        return replace(inspection, modes_note=str(error))
    note = "" if fit.modes else "none stands out of the noise"
    return replace(inspection, modes=fit.modes, doubtful=fit.doubtful, modes_note=note)


def _span(frequency_hz: Array) -> str:
    f = frequency_hz
    step = f" every {(f[-1] - f[0]) / (f.size - 1):.6g} Hz" if f.size > 1 else ""
    return f"{f.size} lines, {f[0]:.6g} to {f[-1]:.6g} Hz{step}" if f.size else "no lines"


def _unit(unit: str) -> str:
    return f", unit {unit}" if unit else ", no unit"


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


def _frfs_of_hits(histories: list[TimeRecord], samples: int) -> tuple[list[FrfRecord], str]:
    """FRFs of a hammer's records that hold one hit each, and why there are none."""
    from vibrecords.signals.impact import impact_frfs
    from vibrecords.signals.spectra import sort_by_force

    if not histories:
        return [], "there is no FRF"
    if samples > _SAMPLES_KEPT:
        return [], f"the records have more than {_SAMPLES_KEPT} samples: of these only `run` makes FRFs"
    forces = [r for r in histories if r.quantity == "force"]
    if not forces or any(len(hits_of(r)) != 1 for r in forces):
        return [], "the records are not one hit each: a case makes FRFs of them"
    try:
        results = [impact_frfs(force, responses) for force, responses in sort_by_force(histories) if responses]
    except MeasurementError as error:
        return [], f"no FRFs could be made of the hits: {error}"
    return [result.frf for result in chain.from_iterable(results)], ""


T = TypeVar("T")

#: Longer lists are cut here.
_LISTED = 40


def contents_text(inspection: Inspection) -> Iterator[str]:
    """What to do with the file, then contents, channels, hits, notes, warnings: what needs no fit."""
    count = len(inspection.warnings)
    first = "".join(f": {warning.sentence}." for warning in inspection.warnings[:1])
    yield f"{count} warning{'s, the first' * (count > 1)}{first}" if count else "Nothing in it looks wrong."
    yield f"{inspection.source} ({inspection.form})" if inspection.form else inspection.source or "records"
    yield from _first_lines(inspection.kinds, lambda kind, count: f"  {count} × {kind}")
    if inspection.averages:
        yield f"  averages: {', '.join(str(n) for n in inspection.averages[:10])}"
    if inspection.coherence is not None:
        yield f"  coherence: smallest {inspection.coherence[0]:.4f}, median {inspection.coherence[1]:.4f}"
    yield from ("", f"Channels ({len(inspection.channels)})")
    width = max((len(label) for label in inspection.channels), default=0)
    yield from _first_lines(inspection.channels, lambda label, use: f"  {label:<{width}}  {_use(label, use)}")
    if inspection.listed_modes:
        yield from ("", f"Modes in the file ({inspection.kinds['mode']})")
    for mode in inspection.listed_modes:
        sd = "" if mode.frequency_sd_hz is None else f" ± {mode.frequency_sd_hz:.2g}"
        damping = "" if mode.damping_ratio is None else f"   damping {100 * mode.damping_ratio:.4g} %"
        spread = "" if mode.damping_sd is None or not damping else f" ± {100 * mode.damping_sd:.2g} %"
        where = f"   shape at {len(mode.shape)} DOFs" if mode.shape else ""
        yield f"  {mode.number:>3}  {mode.frequency_hz:>10.6g}{sd} Hz{damping}{spread}{where}"
    yield from _more_line(inspection.kinds.get("mode", 0))
    if inspection.hits:
        yield from ("", f"Hits ({len(inspection.hits)})")
    for trace in inspection.hits[:_LISTED]:
        hit, fate = trace.hit, "kept" if trace.hit.kept else f"LEFT OUT: {trace.hit.reason}"
        pulse = f"{hit.peak_n:.4g} N, {1e3 * hit.width_s:.3g} ms{_reach(trace)}"
        yield f"  {trace.channel} hit {hit.number}: {pulse}, {fate}"
    yield from _more_line(len(inspection.hits))
    if inspection.notes:
        yield from ("", "Done on reading")
        yield from _first_lines(inspection.notes, lambda note, count: f"  {note}" + f" ({count} times)" * (count > 1))
    yield from ("", f"Warnings ({count})" if count else "No warnings.")
    for number, warning in enumerate(inspection.warnings, 1):
        yield f"  {number}. [{warning.key}] {warning.where}: {warning.sentence}."
        yield f"     What to do: {warning.remedy}."


def resonances_text(inspection: Inspection) -> Iterator[str]:
    """Resonances that the FRFs show, and what is left out of them."""
    shown = f"Resonances of {', '.join(inspection.modes_of)} (± one standard deviation)"
    yield from ("", shown if inspection.modes else f"Resonances: {inspection.modes_note}")
    low, high = inspection.driven_hz
    if low or high:
        ends = (f"from {low:.6g} " if low else "") + (f"to {high:.6g} " if high else "")
        yield f"  sought {ends}Hz only: the test drove nothing else, as coherence or noise shows"
    for number, mode in enumerate(inspection.modes, 1):
        digits = _digits(mode.frequency_sd_hz)
        percent, sd = 100 * mode.damping_ratio, 100 * mode.damping_sd
        line = f"  {number:>3}  {mode.frequency_hz:>10.{digits}f} ± {mode.frequency_sd_hz:.{digits}f} Hz   "
        yield line + f"damping {percent:.{_digits(sd)}f} ± {sd:.{_digits(sd)}f} %"
    if inspection.doubtful:
        yield "Left out of the resonances"
    for doubt in inspection.doubtful:
        yield f"  {doubt.frequency_hz:.6g} Hz: {doubt.reason}"


def _reach(trace: HitTrace) -> str:
    """From which frequency on the force of a hit is less than a tenth of its largest spectral line."""
    if trace.force_n.size < 2:
        return ""
    samples = max(4096, trace.force_n.size)
    spectrum = np.abs(np.fft.rfft(trace.force_n - np.median(trace.force_n), samples))
    top = int(spectrum.argmax())
    below = np.flatnonzero(spectrum[top:] < 0.1 * spectrum[top])
    step_hz = 1 / (samples * (trace.time_s[1] - trace.time_s[0]))
    return f", 20 dB down at {(top + below[0]) * step_hz:.3g} Hz" if below.size else ""


def _use(label: str, use: ChannelCount) -> str:
    """What a channel is: its node and direction, and what it is used for."""
    dof = parse_dof(label)
    place = f"node {dof.node}, direction {dof_label(dof).rpartition(':')[2]}; " if dof and dof.direction else ""
    roles = (("response", use.as_response), ("force", use.as_force))
    parts = [f"{role} of {count} FRF{'s' * (count > 1)}" for role, count in roles if count]
    parts += [f"{n} {what}" for what, n in (("time histories", use.histories), ("spectra", use.spectra)) if n]
    quantities = f" ({', '.join(use.quantities)})" if use.quantities else ""
    return (place or "no direction; ") + ", ".join(parts) + quantities


def _digits(sd: float) -> int:
    """Decimals that show a standard deviation with two digits."""
    return int(np.clip(np.ceil(np.log10(9.5 / sd)), 0, 8)) if sd > 0 else 2


def _first_lines(entries: dict[str, T], line: Callable[[str, T], str]) -> Iterator[str]:
    """A line for each of the first entries, and how many more there are."""
    yield from starmap(line, islice(entries.items(), _LISTED))
    yield from _more_line(len(entries))


def _more_line(count: int) -> Iterator[str]:
    if count > _LISTED:
        yield f"  and {count - _LISTED} more"
