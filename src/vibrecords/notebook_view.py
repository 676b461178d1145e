"""What Jupyter shows of a result: a table, and a small drawing of FRFs, in the colours of the page around them."""

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

_STRETCHES = 200  # of a curve, each drawn by its lowest and its highest value
_WIDTH, _HEIGHT = 480, 120
#: In the colour of the text, and in one that is seen on black and on white.
_STROKES = ('stroke="currentColor" stroke-opacity="0.6"', 'stroke="#d9622b" stroke-width="1.5"')


def table_html(title: str, head: Sequence[str], rows: Iterable[Sequence[str]], after: str = "") -> str:
    """HTML of a table with its title; what comes after it is HTML already."""
    lines = [("th", head), *(("td", row) for row in rows)]
    cells = ("".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in row) for tag, row in lines)
    table = "".join(f"<tr>{row}</tr>" for row in cells)
    return f"<div><p>{escape(title)}</p><table>{table}</table>{after}</div>"


def paragraph_html(text: str) -> str:
    """HTML of a paragraph; of no text none."""
    return f"<p>{escape(text)}</p>" if text else ""


def frf_svg(frequency_hz: NDArray[np.float64], curves: Mapping[str, NDArray[Any]]) -> str:
    """SVG of at most two FRFs over frequency by what they are called, each shape (lines,), in decibels."""
    levels = [20 * np.log10(np.maximum(np.abs(curve), np.finfo(float).tiny)) for curve in curves.values()]
    low, high = np.min(levels), np.max(levels)
    f = frequency_hz - frequency_hz[0]
    places, lines = np.array_split(np.arange(f.size), min(f.size, _STRETCHES)), []
    for level, stroke in zip(levels, _STROKES, strict=False):
        kept = np.unique([some[pick(level[some])] for some in places for pick in (np.argmin, np.argmax)])
        x, y = _WIDTH * f[kept] / (f[-1] or 1), _HEIGHT * (high - level[kept]) / ((high - low) or 1)
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
        lines.append(f'<polyline points="{points}" fill="none" {stroke}/>')
    band = f"{frequency_hz[0]:g} to {frequency_hz[-1]:g} Hz"
    title = f"{' and '.join(curves)}, {band}, {high - low:.0f} dB from top to bottom"
    size = f'viewBox="-2 -2 {_WIDTH + 4} {_HEIGHT + 4}" width="{_WIDTH}" height="{_HEIGHT}"'
    return f'<svg role="img" {size} aria-label="{escape(title)}">{"".join(lines)}</svg><p>{escape(title)}</p>'
