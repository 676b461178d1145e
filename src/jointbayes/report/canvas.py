"""A canvas for figures as SVG text, and what goes onto every one of them: style, margins, logarithmic axes, legends."""

import io
import re
import warnings
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib import rc_context, rcParams
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.text import Text
from matplotlib.ticker import Formatter, FuncFormatter, LogFormatterSciNotation, NullFormatter
from numpy.typing import NDArray

from jointbayes.report.markup import SUPERSCRIPTS, clean
from vibrecords.arrays import Array

Indices = NDArray[np.intp]

_FIRST_STRIDE = 64


_POWER = re.compile(r"\^\{([-\d]+)\}")
_BEYOND_HUNDREDTHS = re.compile(r"(?<=\.\d\d)\d+(?=[ \"\n])")
_BEFORE_POINT = re.compile(r"\s*([MLQC]) (?=-?\d)")
_NO_METADATA = dict.fromkeys(("Creator", "Date", "Format", "Type"))
_ENTRY = 0.12  # inches for each point of the font's size, of a legend
_RIGHT = 0.2  # inches: half a tick label may stand beyond the axes
_STYLE: Any = {
    "svg.fonttype": "path",
    "text.parse_math": False,  # a label may be a user's, and dollars in it are dollars
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


def extremes(values: Array, stretches: int) -> Indices:
    """Places of the lowest and the highest value of each stretch of a curve, in order, so that no peak is lost.

    Parameters
    ----------
    values
        The curve, shape (n,); what is not finite is left out.
    stretches
        Number of stretches. A curve of at most twice as many points keeps all.
    """
    places = np.flatnonzero(np.isfinite(values))
    if places.size <= 2 * stretches:
        return places
    edges = np.linspace(0, places.size, stretches + 1).astype(int)
    finite = values[places]
    kept = [start + pick(finite[start:end]) for start, end in pairwise(edges) for pick in (np.argmin, np.argmax)]
    return places[np.unique(kept)]


def points_of_polyline(x: Array, values: Array, tolerance: float) -> Indices:
    """Places of points whose connecting lines miss none of the others by more than `tolerance`, in order.

    Noise keeps every point, a smooth curve few.

    Parameters
    ----------
    x
        Abscissae, shape (n,), increasing.
    values
        One or more curves over them, shape (n,) or (n, curves), all finite.
    tolerance
        Largest deviation, in the unit of the curves.
    """
    curves = values.reshape(len(values), -1).T
    keep = np.arange(len(x)) % _FIRST_STRIDE == 0
    keep[-1] = True
    while True:
        at = np.flatnonzero(keep)
        missed = np.zeros(len(x), dtype=bool)
        for curve in curves:
            missed |= np.abs(np.interp(x, x[at], curve[at]) - curve) > tolerance
        if not missed.any():
            return at
        left = np.unique(np.searchsorted(at, np.flatnonzero(missed), "right")) - 1
        keep[(at[left] + at[left + 1]) // 2] = True


def svg(draw: Callable[[Canvas], None], width: float, height: float) -> str:
    """SVG text of what `draw` puts on a canvas of so many inches."""
    with rc_context(_STYLE):
        canvas = Canvas(figsize=(width, height))
        draw(canvas)
        for axis in (axis for axes in canvas.axes for axis in (axes.xaxis, axes.yaxis)):
            if isinstance(axis.get_major_formatter(), LogFormatterSciNotation):
                axis.set_major_formatter(_character_formatter(axis.get_major_formatter()))
                axis.set_minor_formatter(_character_formatter(axis.get_minor_formatter()))
        for text in canvas.findobj(Text):
            text.set_text(clean(text.get_text()))  # else a control character in a label breaks the drawing
        buffer = io.StringIO()
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Glyph .* missing", UserWarning)  # a box stands for it
            canvas.savefig(buffer, format="svg", metadata=_NO_METADATA)
    # a hundredth of a point is finer than any page shows, and a path needs no blanks around its letters
    return _BEFORE_POINT.sub(r"\1", _BEYOND_HUNDREDTHS.sub("", clean(buffer.getvalue())))


def _character_formatter(formatter: Any) -> Formatter:  # noqa: ANN401 (matplotlib is untyped here)
    """A formatter whose formulas, powers of ten, are written in characters."""
    if not isinstance(formatter, LogFormatterSciNotation):
        return formatter

    def text(value: float, place: int | None) -> str:
        formula = formatter(value, place).removeprefix("$\\mathdefault{").removesuffix("}$").replace("\\times", "×")
        return _POWER.sub(lambda power: power[1].translate(SUPERSCRIPTS), formula)

    shown = FuncFormatter(text)
    shown.set_locs = formatter.set_locs  # type: ignore[method-assign]  # by which it decides what to label
    return shown


def panels(
    canvas: Canvas,
    rows: int = 1,
    columns: int = 1,
    *,
    left: float = 0.72,
    bottom: float = 0.45,
    top: float = 0.12,
    apart: tuple[float, float] = (0.1, 0.1),
    heights: Sequence[float] | None = None,
    **options: Any,  # noqa: ANN401 (those of Figure.subplots)
) -> Any:  # noqa: ANN401 (array of Axes, shape (rows, columns))
    """Axes on a canvas, shape (rows, columns), with margins and room between rows and columns in inches.

    Rows are equally high, or have these heights relative to each other.

    Laid out by hand: a layout that looks for itself draws every figure a second time.
    """
    width, height = canvas.get_size_inches()
    each = (height - bottom - top - (rows - 1) * apart[0]) / rows
    wide = (width - left - _RIGHT - (columns - 1) * apart[1]) / columns
    place = {"left": left / width, "right": 1 - _RIGHT / width, "bottom": bottom / height, "top": 1 - top / height}
    room = {"hspace": apart[0] / each, "wspace": apart[1] / wide, "height_ratios": heights}
    return canvas.subplots(rows, columns, squeeze=False, gridspec_kw=place | room, **options)


def logarithmic(axes: Axes) -> None:
    """Make the vertical axis logarithmic, its powers of ten written in characters: formulas take long to set."""
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(lambda value, _: "10" + f"{np.log10(value):.0f}".translate(SUPERSCRIPTS))
    axes.yaxis.set_minor_formatter(NullFormatter())


def add_strokes(axes: Axes, place: Array, low: Array, high: Array, **style: float | str) -> None:
    """Draw a stroke from low to high at each place, one of no length as a dot; one path for all, for there may be many.

    What limits the axes is set by the caller: following each stroke to find it would take long.
    """
    # a screen shows nothing of a stroke whose ends are one point
    ends = [low, np.where(high > low, high, low + 1e-9 * np.abs(low))]
    corners = np.stack([np.repeat(place, 2), np.ravel(ends, "F")], axis=1)
    path = Path(corners, np.tile([Path.MOVETO, Path.LINETO], len(place)))
    path.should_simplify = False  # or strokes of no length, the dots, are left out
    axes.add_artist(PathPatch(path, fc="none", capstyle="round", snap=False, **style))


def legend_above(axes: Axes) -> None:
    """A legend in one line above the axes, which need a top margin of 0.3 inches; in more where they are narrow."""
    width = axes.get_window_extent().width / axes.figure.dpi / rcParams["font.size"]
    axes.legend(
        ncols=int(np.clip(width / _ENTRY, 1, 4)), loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2
    )
