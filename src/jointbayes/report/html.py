"""The report as one HTML file that needs nothing else: no network, no neighbour files.

The content security policy names each inline script and style by its hash. A script that came in with the
data would not run even if the escaping failed.
"""

import base64
import hashlib
import json
import re
from importlib.resources import files
from itertools import count, cycle
from typing import Any
from urllib.parse import quote

import jinja2
import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

from jointbayes.report.canvas import extremes, points_of_polyline
from jointbayes.report.markup import ISOLATED, SYMBOLS, badge, clean, parse, plain
from jointbayes.report.methods import guide_of
from jointbayes.report.model import SERIES_COLOURS, Figure, FrfCurve, FrfPlot, LinePlot, Report, Wireframe
from vibrecords.arrays import Array

#: Of the vertical range of an interactive plot: by this a curve may miss points that are left out.
_TOLERANCE = 2e-4
#: Points of a curve beyond which the lowest and highest of each stretch stand for it, even zoomed in.
_MOST_POINTS = 20_000
#: Numbers from which they are packed into bytes.
_LONG = 100
_COMMENT, _BLANKS = re.compile("<!--.*?-->", re.DOTALL), re.compile(r"\s+")
_SPOKEN = {"good": "Good:", "caution": "Caution:", "bad": "Problem:"}


def render_html(report: Report) -> str:
    r"""Render a report as a self-contained web page.

    Parameters
    ----------
    report : Report
        The report.

    Returns
    -------
    str
        The page. Write it as UTF-8 with ``newline="\n"``.

    Examples
    --------
    >>> import datetime
    >>> page = render_html(Report("Clamp", "", (), (), datetime.date(2026, 1, 5), "0.1.0"))
    >>> page.startswith("<!DOCTYPE html>")
    True
    """
    interactive = any(isinstance(block, Figure) and block.plot for block in report.blocks())
    styles = [_asset("assets/report.css")]
    scripts = [_asset("assets/report.js")]
    if interactive:
        styles.insert(0, _asset("assets/uPlot.min.css"))
        scripts.insert(0, _asset("assets/uPlot.iife.min.js"))
    strict = jinja2.StrictUndefined
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=strict)
    environment.filters.update(rich=_rich, plain=plain, clean=clean, data_uri=_data_uri, payload=_payload)
    environment.globals.update(badge=badge, guide_of=guide_of, symbols=SYMBOLS, spoken=_SPOKEN)
    policy = f"default-src 'none'; script-src {_hashes(scripts)}; style-src {_hashes(styles)}; "
    policy += "img-src data:; base-uri 'none'; form-action 'none'"
    numbers = {"figure_number": count(1).__next__, "table_number": count(1).__next__}
    assets = {"styles": list(map(Markup, styles)), "scripts": list(map(Markup, scripts))}
    template = environment.from_string(_asset("templates/report.html.j2"))
    return template.render(report=report, policy=policy, **numbers, **assets)


def _asset(name: str) -> str:
    return files("jointbayes.report").joinpath(name).read_text(encoding="utf-8")


def _hashes(texts: list[str]) -> str:
    digests = (hashlib.sha256(text.encode()).digest() for text in texts)
    return " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)


def _rich(text: str) -> Markup:
    """HTML of a text with bold and code; every run is escaped before it is wrapped."""
    parts = []
    for run in parse(text):
        markup = Markup(ISOLATED.sub(r"<bdi>\1</bdi>", str(escape(run.text))))  # escaped before, and never nested
        if run.code:
            markup = Markup("<code>{}</code>").format(markup)
        if run.bold:
            markup = Markup("<strong>{}</strong>").format(markup)
        parts.append(markup)
    return Markup("").join(parts)


def _data_uri(svg: str) -> str:
    """Address of an SVG as an image: isolated, so that ids and styles of two drawings cannot mix."""
    drawn = _COMMENT.sub("", clean(svg))
    if "'" not in drawn:  # it takes a character where the other quote takes three
        drawn = drawn.replace('"', "'")
    return "data:image/svg+xml," + quote(_BLANKS.sub(" ", drawn), safe=" /:;=,.()!-_'")


def _payload(plot: LinePlot | FrfPlot | Wireframe) -> Markup:
    """JSON of an interactive plot, safe inside a script element."""
    numbers: dict[str, Any]
    match plot:
        case FrfPlot():
            x, band = plot.frequency_hz, [FrfCurve("95 % band", end, SERIES_COLOURS[0]) for end in plot.band]
            sizes = [np.abs(curve.values) for curve in (*band, *plot.curves)]
            sizes = [np.maximum(size, 1e-15 * np.max(sizes)) for size in sizes]  # none is 0 on a logarithmic axis
            span = float(np.ptp(np.log10(sizes))) or 1.0
            curves = [
                {"name": plain(curve.name), "colour": curve.colour, "dashed": curve.dashed, "hidden": curve.hidden}
                | _packed_columns(
                    x, {"size": (size, True, span), "angle": (plot.phase_deg(curve.values), False, 360.0)}
                )
                for curve, size in zip((*band, *plot.curves), sizes, strict=True)
            ]
            given = {"Error (sd)": plot.misfit} | ({} if plot.coherence is None else {"Coherence": plot.coherence})
            strips = [
                {"name": name} | _packed_columns(x, {"y": (values, False, 1.0)}, all_points=True)
                for name, values in given.items()
            ]
            numbers = {"kind": "frf", "unit": plot.unit, "worst": plot.worst_hz}
            numbers |= {"band": curves[:2], "curves": curves[2:], "strips": strips}
        case Wireframe():
            size = float(np.ptp(plot.points, axis=(0, 1)).max())
            points, shapes = (np.rint(10_000 * places / size).astype(int) for places in (plot.points, plot.shapes))
            each = zip(plot.names, shapes, strict=True)
            modes = [{"name": name, "shape": shape.ravel().tolist()} for name, shape in each]
            numbers = {"kind": "modes", "size": size, "points": points.ravel().tolist()}
            numbers |= {"run": points.shape[1], "modes": modes}
        case LinePlot():
            ordinates = np.concatenate([column for line in plot.series for column in line.columns[1:]])
            span, series = float(np.ptp(np.log10(ordinates) if plot.log_y else ordinates)) or 1.0, []
            for line, colour in zip(plot.series, cycle(SERIES_COLOURS), strict=False):
                x, *ends = line.columns
                columns = {name: (y, plot.log_y, span) for name, y in zip(("y", "y_low", "y_high"), ends, strict=True)}
                packed = _packed_columns(x, columns, all_points=line.kind == "points")
                said = {"name": plain(line.name), "kind": line.kind, "dashed": line.dashed, "colour": colour}
                series.append(said | packed)
            numbers = {"x_label": plain(plot.x_label), "y_label": plain(plot.y_label)}
            numbers |= {"log_y": plot.log_y, "series": series}
    text = json.dumps(numbers, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    # "</script>" and "<!--" are the only ways out of a script element, and both begin with "<".
    return Markup(text.replace("<", "\\u003c"))


def _packed_columns(
    x: Array, columns: dict[str, tuple[Array, bool, float]], *, all_points: bool = False
) -> dict[str, Any]:
    """Curves over x as the page's script reads them, without the points that a straight line passes.

    Each column has its values, whether they are drawn as logarithms, and the range that is drawn. Zoomed in by ten, a
    curve is off by less than a pixel; peaks are always there.
    """
    drawn = [(np.log10(values) if log else values) / span for values, log, span in columns.values() if values.size]
    kept = np.arange(x.size) if all_points else points_of_polyline(x, np.stack(drawn, axis=1), _TOLERANCE)
    if kept.size > _MOST_POINTS:
        kept = np.unique(np.concatenate([extremes(column, _MOST_POINTS // (2 * len(drawn))) for column in drawn]))
    packed = {
        name: _packed(values[kept] if values.size else values, log=log) for name, (values, log, _) in columns.items()
    }
    return {"x": _packed_x(x, kept), **packed}


def _packed_x(x: Array, kept: NDArray[np.intp]) -> Any:  # noqa: ANN401 (JSON)
    """Abscissae of the kept points: of evenly spaced ones the gaps between them, a byte each."""
    if x.size >= _LONG:
        step = (x[-1] - x[0]) / (x.size - 1)
        gaps = np.diff(kept, prepend=0)
        if np.abs(x - x[0] - step * np.arange(x.size)).max() < 1e-6 * step and gaps.max() < 256:
            return {"first": float(x[0]), "step": float(step), "gaps": _base64(gaps.astype(np.uint8))}
    return [float(f"{value:.9g}") for value in x[kept]]


def _packed(values: Array, *, log: bool) -> Any:  # noqa: ANN401 (JSON)
    """Ordinates: a few as they are, many as 16-bit fractions of their range, which is finer than four digits."""
    if values.size < _LONG:
        return [float(f"{value:.6g}") for value in values]
    scaled = np.log10(values) if log else values
    low, span = float(scaled.min()), float(np.ptp(scaled)) or 1.0
    return {
        "low": low,
        "span": span,
        "log": log,
        "codes": _base64(np.rint(65535 * (scaled - low) / span).astype("<u2")),
    }


def _base64(array: NDArray[Any]) -> str:
    return base64.b64encode(array.tobytes()).decode()
