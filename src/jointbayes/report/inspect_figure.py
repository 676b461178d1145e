"""Quick look at measured FRFs and hits: magnitude, phase, coherence, and each hit's force."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from jointbayes.measurement.provenance import MeasuredMode
from jointbayes.measurement.records import FrfRecord
from jointbayes.report.figures import svg
from jointbayes.report.model import SERIES_COLOURS

__all__ = ["HitCurve", "inspect_figure"]

Array = NDArray[np.float64]
#: Name of a hit, why it is left out (empty where it is kept), time from the trigger, s, and force, N.
HitCurve = tuple[str, str, Array, Array]

#: A curve of more points is drawn by the lowest and highest of each stretch.
_POINTS = 1500
_HITS_IN_A_ROW = 4
_UNITS = {"receptance": "m/N", "mobility": "(m/s)/N", "accelerance": "(m/s²)/N", None: "unknown quantity"}


def inspect_figure(frfs: Sequence[FrfRecord], modes: Sequence[MeasuredMode], hits: Sequence[HitCurve]) -> str:
    """SVG text of FRFs with their resonances, and of hits.

    Parameters
    ----------
    frfs
        FRFs to draw over each other.
    modes
        Resonances, marked in the magnitude.
    hits
        Hits; those without samples are passed over.
    """
    drawn = [hit for hit in hits if hit[2].size]
    rows = -(-len(drawn) // _HITS_IN_A_ROW)
    with_coherence = any(r.coherence is not None for r in frfs)
    heights = [2.6, 1.3, *([1.2] if with_coherence else [])] if frfs else []

    def draw(canvas: Canvas) -> None:
        parts = [sum(heights)] * bool(frfs) + [1.5 * rows] * bool(rows)
        if not parts:
            canvas.text(0.5, 0.5, "no FRF and no hit to draw", ha="center", va="center")
            return
        panels: Any = canvas.subfigures(len(parts), 1, height_ratios=parts, squeeze=False)
        if frfs:
            _draw_frfs(panels[0, 0], frfs, modes, heights)
        if rows:
            _draw_hits(panels[-1, 0], drawn, rows)

    return svg(draw, 7.4, max(sum(heights) + 1.5 * rows, 1.0))


def _draw_frfs(part: Any, frfs: Sequence[FrfRecord], modes: Sequence[MeasuredMode], heights: list[float]) -> None:  # noqa: ANN401
    panels = part.subplots(len(heights), 1, sharex=True, height_ratios=heights)
    for i, record in enumerate(frfs):
        colour = SERIES_COLOURS[i % len(SERIES_COLOURS)]
        f, good = record.frequency_hz, np.isfinite(record.values) & (record.values != 0)
        curves = [np.where(good, np.abs(record.values), np.nan), np.where(good, _degrees(record), np.nan)]
        if record.coherence is not None and len(heights) > 2:
            curves.append(record.coherence)
        for j, (panel, curve) in enumerate(zip(panels, curves, strict=False)):
            # the phase jumps between −180° and 180°: points, not lines
            style = {"ls": "none", "marker": ".", "ms": 1.2} if j == 1 else {"lw": 0.8}
            panel.plot(*_thinned(f, curve), color=colour, label=f"{record.response}/{record.reference}", **style)
    panels[0].set_yscale("log")
    kinds = dict.fromkeys(r.quantity for r in frfs)
    panels[0].set_ylabel(" or ".join(f"{k or 'H'} ({_UNITS[k]})" for k in kinds))
    panels[1].set_ylabel("phase (°)")
    panels[1].set_yticks([-180, -90, 0, 90, 180])
    if len(heights) > 2:
        panels[2].set_ylabel("coherence")
        panels[2].set_ylim(-0.02, 1.05)
    for mode in modes:
        panels[0].axvline(mode.frequency_hz, color="0.5", lw=0.6, ls=":")
    panels[-1].set_xlabel("Frequency (Hz)")
    panels[0].legend(ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)


def _draw_hits(part: Any, hits: Sequence[HitCurve], rows: int) -> None:  # noqa: ANN401
    panels = np.ravel(part.subplots(rows, _HITS_IN_A_ROW, squeeze=False))
    for panel, (name, reason, time, force) in zip(panels, hits, strict=False):
        panel.plot(*_thinned(1e3 * time, force), lw=0.8, color=SERIES_COLOURS[1 if reason else 0])
        verdict = reason.split(",")[0] if reason else "kept"
        panel.set_title(f"{name}\n{verdict}", fontsize=7, color=SERIES_COLOURS[1] if reason else "black")
        panel.tick_params(labelsize=7)
    for panel in panels[len(hits) :]:
        panel.set_visible(False)
    for panel in panels[max(len(hits) - _HITS_IN_A_ROW, 0) : len(hits)]:
        panel.set_xlabel("ms", fontsize=7)
    panels[0].set_ylabel("force (N)", fontsize=7)


def _degrees(record: FrfRecord) -> Array:
    degrees: Array = np.degrees(np.angle(record.values))
    return degrees


def _thinned(x: Array, y: Array) -> tuple[Array, Array]:
    """Lowest and highest point of each stretch of a long curve, so that no peak is lost."""
    if x.size <= _POINTS:
        return x, y
    kept: list[int] = []
    for stretch in np.array_split(np.arange(x.size), _POINTS // 2):
        finite = stretch[np.isfinite(y[stretch])]
        if finite.size:
            kept += sorted({int(finite[np.argmin(y[finite])]), int(finite[np.argmax(y[finite])])})
    return x[kept], y[kept]
