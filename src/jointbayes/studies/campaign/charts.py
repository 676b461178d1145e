"""Figures of a campaign's report: ranking and population; small and legible for ten joints and 5000."""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axis import Axis
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import FuncFormatter, MaxNLocator, NullFormatter
from numpy.typing import NDArray

from jointbayes.posterior.rounding import number
from jointbayes.report.canvas import legend_above, margin_labels, panels, svg
from jointbayes.report.line_plot import SERIES_COLOURS
from jointbayes.report.markup import format_numbers
from jointbayes.studies.campaign.outliers import ComparedQuantity
from vibrecords.arrays import Array

Flags = NDArray[np.bool_]
Curve = tuple[Array, Array, Array, Array]

_MOST_NAMED = 40  # joints that a figure names
_STRETCHES = 300  # of ranks, where there are more joints
_BINS = 40
_BLUE, _ORANGE, _GREEN = SERIES_COLOURS[:3]
_GREY = "0.45"


def _value_axis(axis: Axis, set_scale: Callable[[str], None], quantity: ComparedQuantity) -> None:
    """An axis of values: logarithmic with plain labels at 1, 2 and 5 where the quantity is."""
    if not quantity.logarithmic:
        axis.set_major_locator(MaxNLocator(6))
        return
    set_scale("log")
    axis.set_major_locator(_RoundValues())
    axis.set_major_formatter(FuncFormatter(lambda value, _: format_numbers(number(value, 3))))
    axis.set_minor_formatter(NullFormatter())


class _RoundValues(MaxNLocator):
    """Round values on an axis: on a logarithmic one 1, 2, 5 of each decade, evenly spaced ones within less than 5."""

    def __init__(self, logarithmic: bool = True, most: int | None = None) -> None:
        super().__init__(5 if most is None else most - 1)
        self._logarithmic, self._most = logarithmic, most

    def tick_values(self, vmin: float, vmax: float) -> list[float]:
        low, high = sorted((vmin, vmax))
        if not self._logarithmic or low <= 0 or high / low < 5:
            return list(super().tick_values(low, high))
        decades = np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
        steps = [1.0, 2.0, 5.0] if len(decades) < 5 else [1.0]
        ticks = [float(10.0**decade * step) for decade in decades for step in steps]
        if self._most is None:
            return ticks
        inside = [tick for tick in ticks if low <= tick <= high]
        return inside[:: max(1, -(-len(inside) // self._most))]


def ranking_figure(quantity: ComparedQuantity, labels: Sequence[str]) -> str:
    """All joints from the softest up, each given all the others, with its 95 % interval; named where they have room."""
    order = np.argsort(quantity.shrunken[:, 1])
    ends = quantity.shrunken[order]
    if len(order) > _MOST_NAMED:
        return _ranked_curve(quantity, ends)

    def draw(canvas: Canvas) -> None:
        named, margin = margin_labels([labels[i] for i in order])
        axes = panels(canvas, left=margin)[0, 0]
        place = np.arange(len(order))
        axes.hlines(place, ends[:, 0], ends[:, 2], color=_BLUE, lw=1.2)
        axes.plot(ends[:, 1], place, "o", ms=4, color=_BLUE)
        axes.set_yticks(place, named, fontsize=7)
        axes.set_ylim(-0.6, len(order) - 0.4)
        _value_axis(axes.xaxis, axes.set_xscale, quantity)
        axes.set_xlabel(quantity.label + quantity.in_unit)

    return svg(draw, 7.2, 0.8 + 0.16 * len(order))


def _ranked_curve(quantity: ComparedQuantity, ends: Array) -> str:
    def draw(canvas: Canvas) -> None:
        axes = panels(canvas, left=1.05, top=0.3)[0, 0]
        groups = np.array_split(np.arange(len(ends)), min(_STRETCHES, len(ends)))
        place = [group.mean() + 1 for group in groups]
        low, middle, high = np.array([ends[group].mean(axis=0) for group in groups]).T
        axes.fill_between(place, low, high, color=_BLUE, alpha=0.25, lw=0, label="95 % interval")
        axes.plot(place, middle, color=_BLUE, lw=1.2, label="median given all joints")
        axes.set_xlim(1, len(ends))
        axes.set_xlabel("Rank of the median")
        _value_axis(axes.yaxis, axes.set_yscale, quantity)
        axes.set_ylabel(quantity.label + quantity.in_unit)
        legend_above(axes)

    return svg(draw, 7.2, 2.4)


def population_figure(
    quantities: Sequence[ComparedQuantity], curves: Sequence[tuple[Array, Array, Array, Array]]
) -> str:
    """Estimates of the joints by themselves, and the population's density with its 95 % band, side by side.

    Each curve is abscissa on the scale of the spread and lower, middle and upper density there.
    """

    def draw(canvas: Canvas) -> None:
        row = panels(canvas, columns=len(quantities), left=0.35, top=0.3, apart=(0.1, 0.25))[0]
        for axes, quantity, (x, low, middle, high) in zip(row, quantities, curves, strict=True):
            value = quantity.spread.value
            edges = np.linspace(x[0], x[-1], min(_BINS, max(8, int(2 * np.sqrt(len(value)))) + 1))
            count, _ = np.histogram(np.clip(value, x[0], x[-1]), edges)
            height = count / (len(value) * (edges[1] - edges[0]))
            for (left, right), top in zip(pairwise(quantity.value_in_unit(edges)), height, strict=True):
                axes.fill([left, left, right, right], [0, top, top, 0], color="0.8", lw=0)
            at = quantity.value_in_unit(x)
            axes.fill_between(at, low, high, color=_BLUE, alpha=0.3, lw=0)
            axes.plot(at, middle, color=_BLUE, lw=1.2)
            _value_axis(axes.xaxis, axes.set_xscale, quantity)
            axes.xaxis.set_major_locator(_RoundValues(quantity.logarithmic, 4))
            axes.set_xlim(at[0], at[-1])
            axes.set_ylim(0, 1.4 * max(float(height.max()), float(middle.max())))
            axes.set_yticks([])
            axes.set_xlabel(quantity.label + quantity.in_unit)
        row[0].fill([], [], color="0.8", label="joints by themselves")
        row[0].plot([], [], color=_BLUE, label="population")
        row[0].legend(ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)

    return svg(draw, 7.4, 2.4)
