"""Figures of a report as SVG text, drawn with matplotlib; no file, no screen, the same bytes in every run.

What is here lays out axes on a page. What they show is drawn by :mod:`jointbayes.report.drawing`, which describes the
arguments, for pages and notebooks alike.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointbayes.report import drawing
from jointbayes.report.canvas import panels, svg
from jointbayes.report.drawing import AxesArray
from jointbayes.report.line_plot import SERIES_COLOURS, FrfPlot, Wireframe
from vibrecords.arrays import Array

#: Curves that one figure can tell apart by colour.
MOST_CURVES = len(SERIES_COLOURS)
_COLUMNS = 4  # of panels that are alike


def _page(draw: Callable[[AxesArray], None], size: tuple[float, float], **layout: Any) -> str:  # noqa: ANN401
    """SVG text of what is drawn onto axes, shape (rows, columns), on a canvas of so many inches."""
    return svg(lambda canvas: draw(panels(canvas, **layout)), *size)


def draw_alone(
    draw: Callable[..., None],
    *values: Any,  # noqa: ANN401 (those of `draw`)
    width: float = 6.2,
    height: float = 2.6,
    top: float = 0.12,
) -> str:
    """SVG text of what one function of `drawing` puts onto axes of their own: inches, with the margin above."""
    return _page(lambda grid: draw(grid[0, 0], *values), (width, height), top=top)


def _in_rows(draw: Callable[[AxesArray], None], count: int, height: float, **layout: Any) -> str:  # noqa: ANN401
    """SVG text of what is drawn onto so many axes, shape (count,), four to a row of this height in inches."""
    rows = -(-count // _COLUMNS)

    def onto(grid: AxesArray) -> None:
        for spare in grid.ravel()[count:]:
            spare.remove()
        draw(grid.ravel()[:count])

    return _page(onto, (7.4, rows * height), rows=rows, columns=min(count, _COLUMNS), **layout)


def frf_overlay(plot: FrfPlot, share: float = 1.0) -> str:
    """Magnitude of an FRF, its phase below, and coherence where there is one; a share of the full height."""
    heights = [2.5 * share, 1.4 * share, *([] if plot.coherence is None else [0.9 * share])]

    def draw(column: AxesArray) -> None:
        drawing.draw_frf(column[0], plot)
        drawing.draw_frf(column[1], plot, phase=True)
        column[1].get_legend().remove()
        if plot.coherence is not None:
            drawing.draw_curve(column[2], plot.frequency_hz, plot.coherence, "Coherence", log=False)
        for axes in column[:-1]:
            axes.set_xlabel("")
        column[0].figure.align_ylabels()

    layout: Any = {"rows": len(heights), "heights": heights, "top": 0.3, "sharex": True}
    return _page(lambda axes: draw(axes[:, 0]), (7.2, 0.8 + sum(heights)), **layout)


def wireframes(frame: Wireframe) -> str:
    """Each mode at both of its largest swings, over the structure at rest."""
    columns = min(len(frame.names), 3)
    rows = -(-len(frame.names) // columns)
    size = np.ptp(frame.points + frame.shapes, axis=(0, 1, 2))
    height = float(np.clip(size[1] / size[0] * 7.2 / columns, 0.7, 2.2)) + 0.4
    layout: Any = {"rows": rows, "columns": columns, "left": 0.2, "bottom": 0.05, "top": 0.35, "apart": (0.4, 0.15)}
    return _page(lambda axes: drawing.draw_wireframes(axes.ravel(), frame), (7.4, rows * height), **layout)


def profiles(curves: Sequence[tuple[str, Array, Array]]) -> str:
    """Profile likelihoods side by side."""
    return _in_rows(lambda axes: drawing.draw_profiles(axes, curves), len(curves), 2.4, apart=(0.5, 0.1), sharey=True)


def tornado(names: Sequence[str], labels: Sequence[str], ends: Array) -> str:
    """Widths of intervals with one input uncertain at a time, a panel for each stiffness."""
    left = 0.2 + 0.075 * max(map(len, labels))  # inches of the longest label
    layout: Any = {"columns": len(names), "left": left, "apart": (0.2, 0.1), "sharey": True}
    size = (7.2, 0.75 + 0.24 * len(labels))
    return _page(lambda axes: drawing.draw_tornado(axes[0], names, labels, ends), size, **layout)


def histories(titles: Sequence[str], history: Array, published: Array | None) -> str:
    """The paper's Fig. 8."""
    layout: Any = {"left": 0.45, "top": 0.3, "apart": (0.75, 0.45)}
    return _in_rows(lambda a: drawing.draw_histories(a, titles, history, published), len(titles), 2.5, **layout)


def corner_plot(labels: Sequence[str], posterior: Array, prior: Array, published: Array | None, mode: Array) -> str:
    """Marginals and pairs of draws."""
    layout: Any = {"rows": len(labels), "columns": len(labels), "left": 0.85, "bottom": 0.9, "apart": (0.08, 0.08)}
    side = min(6.2, 4.1 + 0.5 * len(labels))  # inches
    return _page(lambda a: drawing.draw_corner(a, labels, posterior, prior, published, mode), (side, side), **layout)


def traces(names: Sequence[str], theta: Array, ensemble: NDArray[Any]) -> str:
    """Draws over steps."""
    layout: Any = {"rows": len(names), "left": 0.9, "bottom": 0.42, "sharex": True}
    size = (7.2, max(4.6, 0.9 + 0.8 * len(names)))
    return _page(lambda a: drawing.draw_traces(a[:, 0], names, theta, ensemble), size, **layout)
