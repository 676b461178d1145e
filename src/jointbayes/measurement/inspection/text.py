"""An inspection in words, line by line, for a terminal."""

from collections.abc import Iterator
from typing import TypeVar

from jointbayes.measurement.inspection.inspection import ChannelUse, Inspection
from jointbayes.measurement.records import parse_dof

T = TypeVar("T")

#: Longer lists are cut here.
_LISTED = 40


def text_of(found: Inspection) -> Iterator[str]:
    """Lines to print: contents, channels, resonances, hits, notes, warnings."""
    yield f"{found.source} ({found.form})" if found.form else found.source or "records"
    for kind, count in _first(found.kinds):
        yield f"  {count} × {kind}"
    yield from _more(len(found.kinds))
    if found.averages:
        yield f"  averages: {', '.join(str(n) for n in found.averages[:10])}"
    if found.coherence is not None:
        yield f"  coherence: smallest {found.coherence[0]:.4f}, median {found.coherence[1]:.4f}"
    yield ""
    yield f"Channels ({len(found.channels)})"
    width = max((len(label) for label in found.channels), default=0)
    for label, use in _first(found.channels):
        yield f"  {label:<{width}}  {_dof(label)}{_use(use)}"
    yield from _more(len(found.channels))
    yield from _resonances(found)
    yield from _hits(found)
    if found.notes:
        yield ""
        yield "Done on reading"
        for note, count in _first(found.notes):
            yield f"  {note}" + (f" ({count} times)" if count > 1 else "")
        yield from _more(len(found.notes))
    yield ""
    if not found.warnings:
        yield "No warnings."
        return
    yield f"Warnings ({len(found.warnings)})"
    for number, warning in enumerate(found.warnings, 1):
        yield f"  {number}. {warning.where}: {warning.sentence}. What to do: {warning.remedy}. [{warning.key}]"


def _resonances(found: Inspection) -> Iterator[str]:
    yield ""
    if not found.modes:
        yield f"Resonances: {found.modes_note}"
        return
    yield f"Resonances of {', '.join(found.modes_of)} (± one standard deviation)"
    for number, mode in enumerate(found.modes, 1):
        digits = _digits(mode.frequency_sd_hz)
        percent, sd = 100 * mode.damping_ratio, 100 * mode.damping_sd
        yield (
            f"  {number:>3}  {mode.frequency_hz:>10.{digits}f} ± {mode.frequency_sd_hz:.{digits}f} Hz   "
            f"damping {percent:.{_digits(sd)}f} ± {sd:.{_digits(sd)}f} %"
        )


def _hits(found: Inspection) -> Iterator[str]:
    if not found.hits:
        return
    yield ""
    yield f"Hits ({len(found.hits)})"
    for trace in found.hits[:_LISTED]:
        hit = trace.hit
        verdict = "kept" if hit.kept else f"LEFT OUT: {hit.reason}"
        yield f"  {trace.channel} hit {hit.number}: {hit.peak_n:.4g} N, {1e3 * hit.width_s:.3g} ms, {verdict}"
    yield from _more(len(found.hits))


def _dof(label: str) -> str:
    dof = parse_dof(label)
    if dof is None or dof.direction == 0:
        return "no direction; "
    axis = ("", "X", "Y", "Z", "RX", "RY", "RZ")[abs(dof.direction)]
    return f"node {dof.node}, direction {axis}{'-' if dof.direction < 0 else '+'}; "


def _use(use: ChannelUse) -> str:
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
