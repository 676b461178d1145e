"""What an inspection of a measurement file found, in words, line by line, for a terminal."""

from collections.abc import Callable, Iterator
from itertools import islice, starmap
from typing import TypeVar

import numpy as np

from vibrecords.inspection import ChannelCount, HitTrace, Inspection
from vibrecords.records import dof_label, parse_dof

T = TypeVar("T")

#: Longer lists are cut here.
_LISTED = 40


def contents_text(inspection: Inspection) -> Iterator[str]:
    """Contents, channels, hits, notes, warnings: what needs no fit."""
    yield f"{inspection.source} ({inspection.form})" if inspection.form else inspection.source or "records"
    yield from _listed(inspection.kinds, lambda kind, count: f"  {count} × {kind}")
    if inspection.averages:
        yield f"  averages: {', '.join(str(n) for n in inspection.averages[:10])}"
    if inspection.coherence is not None:
        yield f"  coherence: smallest {inspection.coherence[0]:.4f}, median {inspection.coherence[1]:.4f}"
    yield ""
    yield f"Channels ({len(inspection.channels)})"
    width = max((len(label) for label in inspection.channels), default=0)
    yield from _listed(inspection.channels, lambda label, use: f"  {label:<{width}}  {_dof(label)}{_use(use)}")
    yield from _listed_modes(inspection)
    yield from _hits(inspection)
    if inspection.notes:
        yield ""
        yield "Done on reading"
        yield from _listed(inspection.notes, lambda note, count: f"  {note}" + f" ({count} times)" * (count > 1))
    yield ""
    if not inspection.warnings:
        yield "No warnings."
        return
    yield f"Warnings ({len(inspection.warnings)})"
    for number, warning in enumerate(inspection.warnings, 1):
        yield f"  {number}. [{warning.key}] {warning.where}: {warning.sentence}."
        yield f"     What to do: {warning.remedy}."


def resonances_text(inspection: Inspection) -> Iterator[str]:
    """Resonances that the FRFs show, and what is left out of them."""
    yield ""
    if not inspection.modes:
        yield f"Resonances: {inspection.modes_note}"
    else:
        yield f"Resonances of {', '.join(inspection.modes_of)} (± one standard deviation)"
    low, high = inspection.driven_hz
    if low or high:
        ends = (f"from {low:.6g} " if low else "") + (f"to {high:.6g} " if high else "")
        yield f"  sought {ends}Hz only: the test drove nothing else, as coherence or noise shows"
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


def _listed_modes(inspection: Inspection) -> Iterator[str]:
    """Modes that the file itself states."""
    if inspection.listed_modes:
        yield ""
        yield f"Modes in the file ({inspection.kinds['mode']})"
    for mode in inspection.listed_modes:
        sd = "" if mode.frequency_sd_hz is None else f" ± {mode.frequency_sd_hz:.2g}"
        damping = "" if mode.damping_ratio is None else f"   damping {100 * mode.damping_ratio:.4g} %"
        spread = "" if mode.damping_sd is None or not damping else f" ± {100 * mode.damping_sd:.2g} %"
        where = f"   shape at {len(mode.shape)} DOFs" if mode.shape else ""
        yield f"  {mode.number:>3}  {mode.frequency_hz:>10.6g}{sd} Hz{damping}{spread}{where}"
    yield from _more(inspection.kinds.get("mode", 0))


def _hits(inspection: Inspection) -> Iterator[str]:
    if not inspection.hits:
        return
    yield ""
    yield f"Hits ({len(inspection.hits)})"
    for trace in inspection.hits[:_LISTED]:
        hit = trace.hit
        verdict = "kept" if hit.kept else f"LEFT OUT: {hit.reason}"
        pulse = f"{hit.peak_n:.4g} N, {1e3 * hit.width_s:.3g} ms{_reach(trace)}"
        yield f"  {trace.channel} hit {hit.number}: {pulse}, {verdict}"
    yield from _more(len(inspection.hits))


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


def _dof(label: str) -> str:
    dof = parse_dof(label)
    if dof is None or dof.direction == 0:
        return "no direction; "
    return f"node {dof.node}, direction {dof_label(dof).rpartition(':')[2]}; "


def _use(use: ChannelCount) -> str:
    parts = [
        f"response of {use.as_response} FRF{'s' * (use.as_response > 1)}" if use.as_response else "",
        f"force of {use.as_force} FRF{'s' * (use.as_force > 1)}" if use.as_force else "",
        f"{use.histories} time histories" if use.histories else "",
        f"{use.spectra} spectra" if use.spectra else "",
    ]
    kinds = ", ".join(use.quantities)
    return ", ".join(filter(None, parts)) + (f" ({kinds})" if kinds else "")


def _digits(sd: float) -> int:
    """Decimals that show a standard deviation with two digits."""
    if not sd > 0:
        return 2
    decimals = 0
    while sd < 9.5 and decimals < 8:
        sd, decimals = 10 * sd, decimals + 1
    return decimals


def _listed(entries: dict[str, T], line: Callable[[str, T], str]) -> Iterator[str]:
    """A line for each of the first entries, and how many more there are."""
    yield from starmap(line, islice(entries.items(), _LISTED))
    yield from _more(len(entries))


def _more(count: int) -> Iterator[str]:
    if count > _LISTED:
        yield f"  and {count - _LISTED} more"
