"""Figures of a report as SVG text, drawn with matplotlib; no file, no screen, the same bytes in every run."""

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from jointbayes.report.model import SERIES_COLOURS

__all__ = [
    "MOST_CURVES",
    "autocorrelation",
    "corner_plot",
    "evidences",
    "frequency_errors",
    "frf_overlay",
    "histories",
    "profiles",
    "residual_norm",
    "squares_by_line",
    "traces",
]

Array = NDArray[np.float64]
_BLUE, _ORANGE, _GREEN = SERIES_COLOURS[:3]
#: Curves that one figure can tell apart by colour.
MOST_CURVES = len(SERIES_COLOURS)
_STYLE: Any = {
    "svg.fonttype": "path",
    "svg.hashsalt": "jointbayes",
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "grid.linewidth": 0.5,
    "legend.frameon": False,
    "legend.fontsize": 8,
}


def svg(
    draw: Callable[[Canvas], None], width: float, height: float, layout: Literal["constrained"] | None = "constrained"
) -> str:
    with rc_context(_STYLE):
        canvas = Canvas(figsize=(width, height), layout=layout)
        draw(canvas)
        buffer = io.StringIO()
        canvas.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


@dataclass(frozen=True, slots=True)
class Overlay:
    """One quantity over frequency, each array of shape (lines,): measured, first guess, MAP and its band."""

    frequency_hz: Array
    measured: Array
    guess: Array
    best: Array
    low: Array
    high: Array


def frf_overlay(data: Overlay, measured_label: str, y_label: str, *, log: bool) -> str:
    """Measured, first guess, and MAP with its 95 % band; colours in the order of the interactive twin."""

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        band, measured, guess, best = SERIES_COLOURS[:4]
        axes.fill_between(data.frequency_hz, data.low, data.high, color=band, alpha=0.35, lw=0, label="95 % band")
        axes.plot(data.frequency_hz, data.measured, color=measured, lw=0.8, label=measured_label)
        axes.plot(data.frequency_hz, data.guess, color=guess, lw=0.9, ls="--", label="first guess")
        axes.plot(data.frequency_hz, data.best, color=best, lw=0.9, label="MAP")
        if log:
            axes.set_yscale("log")
        axes.set_xlabel("Frequency (Hz)")
        axes.set_ylabel(y_label)
        axes.legend(ncols=4, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)

    return svg(draw, 7.2, 3.4 if log else 2.4)


def squares_by_line(frequency_hz: Array, square: Array) -> str:
    """Squared residuals over their expectation by frequency, with a running mean; both of shape (lines,)."""

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        axes.semilogy(frequency_hz, np.maximum(square, 1e-4), ".", ms=1.5, color=_BLUE, alpha=0.5)
        width = max(5, square.size // 100)
        if square.size > 3 * width:
            mean = np.convolve(square, np.full(width, 1 / width), "valid")
            middle = np.convolve(frequency_hz, np.full(width, 1 / width), "valid")
            axes.semilogy(middle, mean, lw=1.2, color=_ORANGE, label=f"mean of {width} lines")
            axes.legend(loc="upper right")
        axes.axhline(1.0, color=_GREEN, ls="--", lw=1)
        axes.set_xlabel("Frequency (Hz)")
        axes.set_ylabel("squared residual")

    return svg(draw, 7.2, 2.4)


def profiles(curves: Sequence[tuple[str, Array, Array]]) -> str:
    """Profile likelihoods side by side: label of the axis, values on it and ln ratio, each of shape (points,)."""

    def draw(canvas: Canvas) -> None:
        panels = np.atleast_1d(canvas.subplots(1, len(curves), sharey=True))
        for axes, (label, value, log_ratio) in zip(panels, curves, strict=True):
            axes.plot(value, log_ratio, "o-", ms=2.5, lw=1, color=_BLUE)
            axes.axhline(-1.92, color=_ORANGE, ls="--", lw=1)  # half the 95 % point of χ² with one degree of freedom
            axes.set_ylim(-5, 0.3)
            axes.set_xlabel(label)
        panels[0].set_ylabel("ln likelihood ratio")

    return svg(draw, 7.4, 2.4)


def residual_norm(norm: Array) -> str:
    """The paper's Fig. 7: norm of the residual FRF over iteration steps."""

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        axes.semilogy(np.arange(norm.size), norm, "o-", ms=3, lw=1, color=_BLUE)
        axes.set_xlabel("Iteration step")
        axes.set_ylabel("‖ε‖ / ‖Hˣ‖")

    return svg(draw, 6.2, 2.6)


def histories(titles: Sequence[str], history: Array, published: Array | None) -> str:
    """The paper's Fig. 8: each stiffness over iteration steps; `history` of shape (steps + 1, parameters)."""

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(1, len(titles))
        for i, axes in enumerate(panels):
            axes.plot(np.arange(len(history)), history[:, i], "o-", ms=2.5, lw=1, color=_BLUE)
            if published is not None:
                axes.axhline(published[i], color=_ORANGE, ls="--", lw=1, label="published")
            axes.set_title(titles[i], fontsize=9)
            axes.set_xlabel("Iteration step")
        if published is not None:
            panels[-1].legend(loc="lower right")

    return svg(draw, 7.4, 2.5)


def corner_plot(labels: Sequence[str], posterior: Array, prior: Array, published: Array | None, mode: Array) -> str:
    """Marginals and pairs of draws, shape (n, parameters), with prior, mode and published values in the same terms."""
    import corner  # late: it brings ArviZ along, a second of import

    def draw(canvas: Canvas) -> None:
        span = [_range(posterior[:, i], None if published is None else published[i]) for i in range(posterior.shape[1])]
        corner.corner(
            posterior,
            fig=canvas,
            labels=list(labels),
            range=span,
            bins=40,
            color=_BLUE,
            plot_datapoints=False,
            plot_density=False,
            smooth=1.0,
            levels=(0.393, 0.675, 0.95),
            hist_kwargs={"density": True},
            max_n_ticks=4,
            label_kwargs={"fontsize": 9},
        )
        axes = np.array(canvas.axes).reshape(posterior.shape[1], -1)
        for i in range(len(axes)):
            _prior_line(axes[i, i], prior[:, i], span[i])
            for j in range(i + 1):
                _mark(axes[i, j], j, i, mode, _ORANGE, "-", "o")
                if published is not None:
                    _mark(axes[i, j], j, i, published, _GREEN, "--", "s")

    return svg(draw, 6.2, 6.2, layout=None)


def _range(values: Array, reference: float | None) -> tuple[float, float]:
    low, high = np.quantile(values, [0.004, 0.996])
    if reference is not None:
        low, high = min(low, reference), max(high, reference)
    margin = 0.08 * (high - low)
    return float(low - margin), float(high + margin)


def _prior_line(axes: Axes, prior: Array, span: tuple[float, float]) -> None:
    # bins as wide as the prior needs, not as narrow as the posterior: its density is smooth on that scale
    density, edges = np.histogram(prior, bins=60, density=True)
    axes.stairs(density, edges, color="0.35", lw=1, ls=":")
    axes.set_xlim(span)


def _mark(axes: Axes, column: int, row: int, point: Array, colour: str, style: str, marker: str) -> None:
    axes.axvline(point[column], color=colour, ls=style, lw=0.9)
    if row != column:
        axes.axhline(point[row], color=colour, ls=style, lw=0.9)
        axes.plot(point[column], point[row], marker, color=colour, ms=4)


def traces(names: Sequence[str], theta: Array, ensemble: NDArray[np.intp]) -> str:
    """Draws over steps, shape (chains, draws, parameters): the median and 95 % range of each ensemble's walkers."""

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        for i, axes in enumerate(panels):
            for e in np.unique(ensemble):
                of_ensemble = theta[ensemble == e, :, i]
                low, middle, high = np.quantile(of_ensemble, [0.025, 0.5, 0.975], axis=0)
                colour = SERIES_COLOURS[int(e) % len(SERIES_COLOURS)]
                steps = np.arange(theta.shape[1])
                axes.fill_between(steps, low, high, color=colour, alpha=0.12, lw=0)
                axes.plot(steps, middle, color=colour, lw=0.8, label=f"ensemble {int(e) + 1}")
            axes.set_ylabel(names[i])
        panels[-1].set_xlabel("Kept draw")
        panels[0].legend(ncols=4, loc="upper right")

    return svg(draw, 7.2, max(4.6, 0.9 + 0.8 * len(names)))


def autocorrelation(names: Sequence[str], theta: Array, thin: int) -> str:
    """Autocorrelation over lags in steps, averaged over walkers, from draws of shape (chains, draws, parameters).

    At most `MOST_CURVES` parameters.
    """

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        lags = min(theta.shape[1] - 1, 60)
        for i, name in enumerate(names):
            axes.plot(
                thin * np.arange(lags + 1), _autocorrelation(theta[..., i], lags), "o-", ms=2.5, lw=1, label=name,
                color=SERIES_COLOURS[i],
            )  # fmt: skip
        axes.axhline(0, color="0.4", lw=0.6)
        axes.set_xlabel("Lag (steps)")
        axes.set_ylabel("Autocorrelation")
        axes.legend()

    return svg(draw, 6.2, 2.6)


def _autocorrelation(chains: Array, lags: int) -> Array:
    centred = chains - chains.mean()
    covariance = np.array([(centred[:, : centred.shape[1] - k] * centred[:, k:]).mean() for k in range(lags + 1)])
    result: Array = covariance / covariance[0]
    return result


def frequency_errors(measured: Array, sd: Array | None, rows: dict[str, Any]) -> str:
    """Deviation of predicted from measured natural frequencies in per cent, by mode.

    `rows` maps a legend entry to frequencies (modes,) or to their (lower, upper) interval.
    """

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
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
        axes.set_ylabel("Deviation from measured (%)")
        axes.legend()

    return svg(draw, 6.2, 3.0)


def evidences(labels: Sequence[str], log_z: Array, error: Array, reach: float) -> str:
    """ln Z of candidates from the best down, with twice its error; an arrow for what lies more than `reach` below.

    Lines mark where 2 ln B against the best is 2, 6 and 10.
    """

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        best, place = log_z.max(), np.arange(log_z.size)
        seen = log_z >= best - reach
        axes.errorbar(log_z[seen], place[seen], xerr=2 * error[seen], fmt="o", ms=5, lw=1.2, capsize=3, color=_BLUE)
        for y in place[~seen]:
            axes.annotate(
                f"ln Z = {log_z[y]:.1f}".replace("-", "−"), (best - reach, y), (best - 0.8 * reach, y), va="center",
                fontsize=8, color=_ORANGE, arrowprops={"arrowstyle": "->", "color": _ORANGE},
            )  # fmt: skip
        for two_log_b in (2, 6, 10):
            axes.axvline(best - two_log_b / 2, color="0.4", lw=0.8, ls="--")
            axes.annotate(f"{two_log_b}", (best - two_log_b / 2, 1.0), xycoords=("data", "axes fraction"), ha="center",
                          va="bottom", fontsize=8, color="0.4")  # fmt: skip
        axes.set_xlim(best - 1.05 * reach, best + 0.08 * reach)
        axes.set_yticks(place, list(labels))
        axes.set_ylim(log_z.size - 0.5, -0.5)
        axes.set_xlabel("ln Z; dashed: 2 ln B against the best")

    return svg(draw, 7.2, 1.0 + 0.3 * len(labels))
