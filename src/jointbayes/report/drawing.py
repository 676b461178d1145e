"""What each figure shows: drawn onto axes of a notebook's cell, or as SVG text for a page of a report.

No file, no screen, and the same bytes in every run. Functions ``draw_…`` take axes and describe the arguments; what
lays out axes on a page is at the end.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator, ScalarFormatter
from numpy.typing import NDArray

from jointbayes.posterior.storage import imported_arviz
from jointbayes.report.canvas import add_strokes, extremes, legend_above, logarithmic, panels, svg
from jointbayes.report.model import SERIES_COLOURS, FrfPlot, Wireframe
from vibrecords.arrays import Array

#: Axes of a figure with several panels, an array of any shape.
AxesArray: TypeAlias = Any

_BLUE, _ORANGE, _GREEN = SERIES_COLOURS[:3]
#: Of a figure over frequency: pairs of points to a curve, one or two for each point of the page's width.
_STRETCHES = 450
_TRACE_POINTS, _BINS = 40, 40
_TICK_INCHES, _DIGIT_INCHES = 0.2, 0.08  # a tick, and a character of the labels
_MOST_TICKS = 16  # of DOFs along an axis
#: Lines that a figure shows as one point each.
_POINTS = 3000
#: Curves that one figure can tell apart by colour.
MOST_CURVES = len(SERIES_COLOURS)
_COLUMNS = 4  # of panels that are alike
#: Rows of panels: profile likelihoods, and the paper's Fig. 8.
PROFILES: dict[str, Any] = {"height": 2.4, "apart": (0.5, 0.1), "sharey": True}
HISTORIES: dict[str, Any] = {"height": 2.5, "left": 0.45, "top": 0.3, "apart": (0.75, 0.45)}


def draw_frf(axes: Axes, plot: FrfPlot, *, phase: bool = False) -> None:
    """Magnitude or phase of an FRF, measured and predicted, with its 95 % band; colours of the interactive twin."""
    view: Callable[[NDArray[np.complex128]], Array] = plot.phase_deg if phase else np.abs
    f, (low, high) = plot.frequency_hz, map(view, plot.band)
    edge = np.union1d(extremes(low, _STRETCHES // 2), extremes(high, _STRETCHES // 2))
    axes.fill_between(f[edge], low[edge], high[edge], color=SERIES_COLOURS[0], alpha=0.35, lw=0, label="95 % band")
    for curve in plot.curves:
        if not curve.hidden:
            shown = extremes(view(curve.values), _STRETCHES)
            style = "--" if curve.dashed else "-"
            axes.plot(f[shown], view(curve.values)[shown], style, color=curve.colour, lw=0.9, label=curve.name)
    if not phase:
        logarithmic(axes)
    axes.set_xlabel("Frequency (Hz)")
    axes.set_ylabel("Phase (°)" if phase else f"|H| ({plot.unit})")
    legend_above(axes)


def draw_wireframes(row: AxesArray, frame: Wireframe) -> None:
    """Each mode at both of its largest swings, over the structure at rest; as many axes as there are modes, or more."""
    swings: Any = ((0, {"color": "0.6"}), (-1, {"color": _BLUE, "alpha": 0.3}), (1, {"color": _BLUE, "lw": 1.6}))
    for axes in row:
        axes.set_axis_off()
    for axes, name, shape in zip(row, frame.names, frame.shapes, strict=False):
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(name.replace(" (", "\n("), fontsize=8)
        for share, style in swings:
            axes.plot(*(frame.points + share * shape).T, **({"lw": 0.8} | style))


def draw_squares_by_line(axes: Axes, frequency_hz: Array, square: Array) -> None:
    """Squared residuals over their expectation by frequency, of shape (lines,), with a running mean.

    A point for each line, or where there are too many a stroke from the lowest to the highest of each stretch.
    """
    stretches = square.size if square.size <= _POINTS else _STRETCHES
    ends = np.array([[s[0], s[-1]] for s in np.array_split(np.arange(square.size), stretches)])
    shown = np.maximum(square, 1e-4)
    low, high = (f.reduceat(shown, ends[:, 0]) for f in (np.minimum, np.maximum))
    add_strokes(axes, frequency_hz[ends].mean(axis=1), low, high, ec=_BLUE, alpha=0.5, lw=1.2)
    logarithmic(axes)
    axes.set_xlim(frequency_hz[0], frequency_hz[-1])
    axes.set_ylim(shown.min() / 1.5, shown.max() * 1.5)
    middle, mean, name = running_mean(frequency_hz, square)
    if mean.size:
        kept = extremes(mean, _STRETCHES)
        axes.plot(middle[kept], mean[kept], lw=1.2, color=_ORANGE, label=name)
        legend_above(axes)
    axes.axhline(1.0, color=_GREEN, ls="--", lw=1)
    axes.set_xlabel("Frequency (Hz)")
    axes.set_ylabel("Squared residual")


def running_mean(frequency_hz: Array, values: Array) -> tuple[Array, Array, str]:
    """Mean over 1 % of the lines and its middle, shape (n,), with its name; of too few lines n is 0."""
    width = max(5, values.size // 100)
    share = np.full(width if values.size > 3 * width else 0, 1 / width)
    if not share.size:
        return share, share, ""
    middle, mean = (np.convolve(column, share, "valid") for column in (frequency_hz, values))
    return middle, mean, f"mean of {width} lines"


def draw_curve(axes: Axes, frequency_hz: Array, values: Array, y_label: str, *, log: bool) -> None:
    """One measured curve over frequency, shape (lines,)."""
    shown = extremes(values, _STRETCHES)
    axes.plot(frequency_hz[shown], values[shown], color=SERIES_COLOURS[1], lw=0.8)
    if log:
        logarithmic(axes)
    axes.set_xlabel("Frequency (Hz)")
    axes.set_ylabel(y_label)


def draw_intervals(axes: Axes, labels: Sequence[str], ends: Array) -> None:
    """Ends of the prior's 95 % interval, then lower end, median and upper end of the posterior's, shape (n, 5)."""
    relative, place = (ends / np.abs(ends[:, 3:4])).T, np.arange(len(labels))
    axes.hlines(place, *relative[:2], color="0.75", lw=7, label="prior, 95 %")
    axes.hlines(place, relative[2], relative[4], color=_BLUE, lw=3, label="posterior, 95 %")
    axes.plot(relative[3], place, "o", color=_ORANGE, ms=5, label="median")
    if (relative > 0).all():
        axes.set_xscale("log")
    axes.set_yticks(place, labels)
    axes.set_ylim(len(labels) - 0.5, -0.5)
    axes.set_xlabel("Value over its median")
    legend_above(axes)


def draw_profiles(row: AxesArray, curves: Sequence[tuple[str, Array, Array]]) -> None:
    """Profile likelihoods side by side: label of the axis, values on it and ln ratio, each of shape (points,)."""
    for axes, (label, value, log_ratio) in zip(row, curves, strict=True):
        axes.plot(value, log_ratio, "o-", ms=2.5, lw=1, color=_BLUE)
        axes.axhline(-1.92, color=_ORANGE, ls="--", lw=1)  # half the 95 % point of χ² with one degree of freedom
        axes.set_ylim(-5, 0.3)
        axes.xaxis.set_major_locator(MaxNLocator(2))
        axes.ticklabel_format(axis="x", useOffset=False)
        axes.set_xlabel(label)
    row[0].set_ylabel("ln likelihood ratio")


def draw_residual_norm(axes: Axes, norm: Array) -> None:
    """The paper's Fig. 7: norm of the residual FRF over iteration steps."""
    logarithmic(axes)
    axes.plot(np.arange(norm.size), norm, "o-", ms=3, lw=1, color=_BLUE)
    axes.set_xlabel("Iteration step")
    axes.set_ylabel("‖ε‖ / ‖Hˣ‖")


def draw_histories(row: AxesArray, titles: Sequence[str], history: Array, published: Array | None) -> None:
    """The paper's Fig. 8: each stiffness over iteration steps; `history` of shape (steps + 1, parameters)."""
    for i, axes in enumerate(row):
        axes.plot(np.arange(len(history)), history[:, i], "o-", ms=2.5, lw=1, color=_BLUE)
        if published is not None:
            axes.axhline(published[i], color=_ORANGE, ls="--", lw=1, label="published")
        axes.set_title(titles[i], fontsize=9, loc="right")  # the power of ten stands at the left
        axes.set_xlabel("Iteration step")
    if published is not None:
        row[-1].legend(loc="lower right")


def draw_corner(
    grid: AxesArray, labels: Sequence[str], posterior: Array, prior: Array, published: Array | None, mode: Array
) -> None:
    """Marginals and pairs of draws, shape (n, parameters), with prior, mode and published values in the same terms.

    The axes, shape (parameters, parameters), are all that their figure has; those above the diagonal are removed.

    References
    ----------
    Foreman-Mackey, D. (2016). corner.py: Scatterplot matrices in Python. DOI 10.21105/joss.00024
    """
    imported_arviz()  # half a second, for this figure alone: corner loads it, and it would announce what we know
    from corner import corner

    count = len(labels)
    ranges = [_range(posterior[:, i], None if published is None else published[i]) for i in range(count)]
    corner(
        posterior,
        bins=_BINS,
        range=ranges,
        levels=(0.393, 0.68, 0.95),
        smooth=1.0,  # bins
        color=_BLUE,
        hist_kwargs={"density": True},
        contour_kwargs={"linewidths": 1.0},
        labels=labels,
        max_n_ticks=4 if count < 4 else 3,
        plot_datapoints=False,
        plot_density=False,
        no_fill_contours=True,
        fig=grid[0, 0].figure,
    )
    for i, j in np.ndindex(count, count):
        axes = grid[i, j]
        if j > i:
            axes.remove()
            continue
        if i == j:
            # bins as wide as the prior needs, not as narrow as the posterior: its density is smooth on that scale
            axes.stairs(*np.histogram(prior[:, i], bins=60, density=True), color="0.35", lw=1, ls=":")
        _mark(axes, j, i, mode, _ORANGE, "-", "o")
        if published is not None:
            _mark(axes, j, i, published, _GREEN, "--", "s")
        axes.grid(visible=False)
        for axis in (axes.xaxis, axes.yaxis):
            if isinstance(axis.get_major_formatter(), ScalarFormatter):
                axis.get_major_formatter().set_useOffset(False)
    # Put the labels of axes in line beyond the longest of their slanted tick labels
    below, beside = [axes.xaxis for axes in grid[-1]], [axes.yaxis for axes in grid[1:, 0]]
    axes = below[0].axes
    width = axes.get_window_extent().width / axes.figure.dpi  # inches
    for line in (below, beside):
        ticks = [text for axis in line for text in axis.get_major_formatter().format_ticks(axis.get_major_locator()())]
        beyond = -(_TICK_INCHES + 0.707 * _DIGIT_INCHES * max(map(len, ticks), default=0)) / width
        for axis in line:
            text = axis.get_label_text()
            axis.set_label_text(text.replace(" ", "\n", 1) if len(text) * _DIGIT_INCHES > width else text)
            axis.set_label_coords(*((0.5, beyond) if line is below else (beyond, 0.5)))


def _range(values: Array, reference: float | None) -> tuple[float, float]:
    low, high = np.quantile(values, [0.004, 0.996])
    if reference is not None:
        low, high = min(low, reference), max(high, reference)
    margin = 0.08 * (high - low)
    return float(low - margin), float(high + margin)


def _mark(axes: Axes, column: int, row: int, point: Array, colour: str, style: str, marker: str) -> None:
    axes.axvline(point[column], color=colour, ls=style, lw=0.9)
    if row != column:
        axes.axhline(point[row], color=colour, ls=style, lw=0.9)
        axes.plot(point[column], point[row], marker, color=colour, ms=4)


def draw_traces(column: AxesArray, names: Sequence[str], theta: Array, ensemble: NDArray[np.intp]) -> None:
    """Draws over steps, shape (chains, draws, parameters): the median and 95 % range of each ensemble's walkers."""
    groups = np.array_split(np.arange(theta.shape[1]), min(theta.shape[1], _TRACE_POINTS))
    steps = [group.mean() for group in groups]
    for e in np.unique(ensemble):
        parts = (theta[ensemble == e][:, group] for group in groups)
        ranges = np.transpose([np.quantile(draws, [0.025, 0.5, 0.975], axis=(0, 1)) for draws in parts])
        colour = SERIES_COLOURS[int(e) % len(SERIES_COLOURS)]
        for axes, name, (low, middle, high) in zip(column, names, ranges, strict=True):
            axes.fill_between(steps, low, high, color=colour, alpha=0.12, lw=0)
            axes.plot(steps, middle, color=colour, lw=0.8, label=f"ensemble {int(e) + 1}")
            axes.set_ylabel(name)
            axes.yaxis.set_major_locator(MaxNLocator(3))
            axes.ticklabel_format(axis="y", useOffset=False)
    column[-1].set_xlabel("Kept draw")
    column[0].legend(ncols=4, loc="upper right")


def draw_autocorrelation(axes: Axes, names: Sequence[str], theta: Array, thin: int) -> None:
    """Autocorrelation over lags in steps, averaged over walkers, from draws of shape (chains, draws, parameters).

    More than `len(SERIES_COLOURS)` parameters share colours.
    """
    lags = min(theta.shape[1] - 1, 60)
    for i, name in enumerate(names):
        centred = theta[..., i] - theta[..., i].mean()
        covariance = np.array([(centred[:, : centred.shape[1] - k] * centred[:, k:]).mean() for k in range(lags + 1)])
        steps, values = thin * np.arange(lags + 1), covariance / covariance[0]
        axes.plot(steps, values, "o-", ms=2.5, lw=1, label=name, color=SERIES_COLOURS[i % len(SERIES_COLOURS)])
    axes.axhline(0, color="0.4", lw=0.6)
    axes.set_xlabel("Lag (steps)")
    axes.set_ylabel("Autocorrelation")
    axes.legend()


def draw_mode_shape(
    axes: Axes, labels: Sequence[str], measured: Array, sd: Array, best: Array, low: Array, high: Array,
    *, over: str = "the reference",
) -> None:  # fmt: skip
    """Components of one mode at DOFs with these labels, each array of shape (DOFs,): measured, MAP and its interval."""
    place = np.arange(len(labels))
    if np.isfinite(measured).any():
        axes.errorbar(place, measured, yerr=1.96 * sd, fmt="o", ms=4, color="0.4", elinewidth=1, label="measured, 95 %")
    axes.plot(place + 0.12, best, "D", ms=3, color=_BLUE, label="MAP")
    axes.vlines(place + 0.2, low, high, color=_ORANGE, lw=2, label="95 % interval")
    axes.axhline(0, color="0.4", lw=0.6)
    shown = place[:: max(1, -(-len(labels) // _MOST_TICKS))]
    axes.set_xticks(shown, [labels[i] for i in shown])
    axes.set_xlim(-0.5, len(labels) - 0.3)
    axes.set_ylabel(f"Component over {over}'s")
    legend_above(axes)


def draw_frequency_errors(
    axes: Axes, measured: Array, sd: Array | None, rows: dict[str, Any], kind: str = "measured"
) -> None:
    """Deviation of predicted from measured or published natural frequencies, as `kind` says, in per cent, by mode.

    `rows` maps a legend entry to frequencies (modes,) or to their (lower, upper) interval.
    """
    mode = np.arange(1, measured.size + 1)
    if sd is not None:
        axes.errorbar(mode, 0 * mode, yerr=196 * sd / measured, fmt="none", ecolor="0.6", elinewidth=8, alpha=0.5,
                      label="measured, 95 %")  # fmt: skip
    for i, (label, value) in enumerate(rows.items()):
        colour, x = SERIES_COLOURS[i], mode + 0.08 * i
        if isinstance(value, tuple):
            low, high = (100 * (v / measured - 1) for v in value)
            axes.vlines(x, low, high, color=colour, lw=2, label=label)
        else:
            axes.plot(x, 100 * (value / measured - 1), "o", ms=4, color=colour, label=label)
    axes.axhline(0, color="0.4", lw=0.6)
    axes.set_xticks(mode)
    axes.set_xlabel("Mode")
    axes.set_ylabel(f"Deviation from {kind} (%)")
    legend_above(axes)


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


def in_rows(
    draw: Callable[..., None],
    *values: Any,  # noqa: ANN401 (those of `draw`)
    height: float,
    **layout: Any,  # noqa: ANN401 (that of `panels`)
) -> str:
    """SVG text of what is drawn onto axes for each of the first values, four to a row of this height in inches."""
    count = len(values[0])
    rows = -(-count // _COLUMNS)

    def onto(grid: AxesArray) -> None:
        for spare in grid.ravel()[count:]:
            spare.remove()
        draw(grid.ravel()[:count], *values)

    return _page(onto, (7.4, rows * height), rows=rows, columns=min(count, _COLUMNS), **layout)


def frf_overlay(plot: FrfPlot, share: float = 1.0) -> str:
    """Magnitude of an FRF, its phase below, and coherence where there is one; a share of the full height."""
    heights = [2.5 * share, 1.4 * share, *([] if plot.coherence is None else [0.9 * share])]

    def draw(column: AxesArray) -> None:
        draw_frf(column[0], plot)
        draw_frf(column[1], plot, phase=True)
        column[1].get_legend().remove()
        if plot.coherence is not None:
            draw_curve(column[2], plot.frequency_hz, plot.coherence, "Coherence", log=False)
        for axes in column:
            axes.axvline(plot.worst_hz, color="0.4", ls=":", lw=0.9)
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
    return _page(lambda axes: draw_wireframes(axes.ravel(), frame), (7.4, rows * height), **layout)


def corner_plot(labels: Sequence[str], posterior: Array, prior: Array, published: Array | None, mode: Array) -> str:
    """Marginals and pairs of draws."""
    layout: Any = {"rows": len(labels), "columns": len(labels), "left": 0.85, "bottom": 0.9, "apart": (0.08, 0.08)}
    side = min(6.2, 4.1 + 0.5 * len(labels))  # inches
    return _page(lambda a: draw_corner(a, labels, posterior, prior, published, mode), (side, side), **layout)


def traces(names: Sequence[str], theta: Array, ensemble: NDArray[Any]) -> str:
    """Draws over steps."""
    layout: Any = {"rows": len(names), "left": 0.9, "bottom": 0.42, "sharex": True}
    size = (7.2, max(4.6, 0.9 + 0.8 * len(names)))
    return _page(lambda a: draw_traces(a[:, 0], names, theta, ensemble), size, **layout)
