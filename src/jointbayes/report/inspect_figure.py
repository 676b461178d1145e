"""Quick look at measured FRFs and hits: magnitude, phase, coherence, and each hit's force."""

from collections.abc import Sequence
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Canvas

from jointbayes.report.canvas import extremes, legend_above, svg
from jointbayes.report.model import SERIES_COLOURS
from vibrecords.arrays import Array
from vibrecords.errors import printable
from vibrecords.formats.units import si_frf_unit
from vibrecords.provenance import MeasuredMode
from vibrecords.records import HIGHEST_HZ, FrfRecord, measurable

#: Name of a hit, why it is left out (empty where it is kept), time from the trigger, s, and force, N.
HitCurve = tuple[str, str, Array, Array]

#: A curve of more than two points each is drawn by the lowest and highest of so many stretches.
_STRETCHES = 750
_HITS_IN_A_ROW = 4
#: A coherence beyond this is far off the panel.
_IN_SIGHT = 10.0


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

    height = max(sum(heights) + 1.5 * rows, 1.0)

    def draw(canvas: Canvas) -> None:
        if not heights and not rows:
            canvas.text(0.5, 0.5, "no FRF and no hit to draw", ha="center", va="center")
        if heights:
            place = {"left": 0.11, "right": 0.98, "top": 1 - 0.3 / height, "bottom": (1.5 * rows + 0.45) / height}
            grid = canvas.add_gridspec(len(heights), 1, height_ratios=heights, hspace=0.08, **place)
            panels = grid.subplots(sharex=True, squeeze=False)[:, 0]
            for i, record in enumerate(frfs):
                colour = SERIES_COLOURS[i % len(SERIES_COLOURS)]
                f = np.where(np.abs(record.frequency_hz) <= HIGHEST_HZ, record.frequency_hz, np.nan)
                good = measurable(record.values) & (record.values != 0)
                curves = [
                    np.where(good, np.abs(record.values), np.nan),
                    np.where(good, np.angle(record.values, deg=True), np.nan),
                ]
                if record.coherence is not None and len(panels) > 2:
                    curves.append(np.where(np.abs(record.coherence) < _IN_SIGHT, record.coherence, np.nan))
                for j, (panel, curve) in enumerate(zip(panels, curves, strict=False)):
                    # the phase jumps between −180° and 180°: points, not lines
                    style = {"ls": "none", "marker": ".", "ms": 1.2} if j == 1 else {"lw": 0.8}
                    kept = extremes(curve, _STRETCHES)
                    name = _plain(f"{record.response}/{record.reference}")
                    panel.plot(f[kept], curve[kept], color=colour, label=name, **style)
            panels[0].set_yscale("log")
            kinds = dict.fromkeys(r.quantity for r in frfs)
            units = [si_frf_unit(kind).replace("^2", "²") or "unknown quantity" for kind in kinds]
            panels[0].set_ylabel(" or ".join(f"{k or 'H'} ({unit})" for k, unit in zip(kinds, units, strict=True)))
            panels[1].set_ylabel("phase (°)")
            panels[1].set_yticks([-180, -90, 0, 90, 180])
            if len(panels) > 2:
                panels[2].set_ylabel("coherence")
                panels[2].set_ylim(-0.02, 1.05)
            for mode in modes:
                panels[0].axvline(mode.frequency_hz, color="0.5", lw=0.6, ls=":")
            panels[-1].set_xlabel("Frequency (Hz)")
            legend_above(panels[0])
        if rows:
            place = {"left": 0.08, "right": 0.98, "top": (1.5 * rows - 0.35) / height, "bottom": 0.35 / height}
            grid = canvas.add_gridspec(rows, _HITS_IN_A_ROW, hspace=0.7, wspace=0.3, **place)
            _draw_hits(grid.subplots(squeeze=False), drawn)

    return svg(draw, 7.4, height)


_TITLE = 34  # characters of a line above the panel of a hit


def _draw_hits(grid: Any, hits: Sequence[HitCurve]) -> None:  # noqa: ANN401 (array of Axes)
    panels = np.ravel(grid)
    for panel, (name, reason, time, force) in zip(panels, hits, strict=False):
        kept = extremes(force, _STRETCHES)
        panel.plot(1e3 * time[kept], force[kept], lw=0.8, color=SERIES_COLOURS[1 if reason else 0])
        state = fill(_plain(reason), _TITLE) if reason else "kept"
        panel.set_title(f"{_plain(name)}\n{state}", fontsize=7, color=SERIES_COLOURS[1] if reason else "black")
        panel.tick_params(labelsize=7)
    for panel in panels[len(hits) :]:
        panel.set_visible(False)
    for panel in panels[max(len(hits) - _HITS_IN_A_ROW, 0) : len(hits)]:
        panel.set_xlabel("ms", fontsize=7)
    panels[0].set_ylabel("force (N)", fontsize=7)


def _plain(label: str) -> str:
    """A label that Matplotlib draws, also where it begins with what hides it."""
    text = printable(label)
    return f" {text}" if text.startswith("_") else text
