"""The report as one HTML file that needs nothing else: no network, no neighbour files.

The content security policy names each inline script and style by its hash. A script that came in with the
data would not run even if the escaping failed.
"""

import base64
import hashlib
import json
from dataclasses import asdict
from importlib.resources import files
from itertools import count
from typing import Any

import jinja2
from markupsafe import Markup, escape

from jointbayes.report.markup import SYMBOLS, badge, clean, parse, plain
from jointbayes.report.model import SERIES_COLOURS, Figure, LinePlot, Report

__all__ = ["render_html"]

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
    return _template().render(
        report=report,
        figure_number=count(1).__next__,
        table_number=count(1).__next__,
        styles=[Markup(text) for text in styles],
        scripts=[Markup(text) for text in scripts],
        policy=_policy(styles, scripts),
    )


def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    environment.filters.update(rich=_rich, plain=plain, clean=clean, data_uri=_data_uri, payload=_payload)
    environment.globals.update(badge=badge, symbols=SYMBOLS, spoken=_SPOKEN)
    return environment.from_string(_asset("templates/report.html.j2"))


def _asset(name: str) -> str:
    return files("jointbayes.report").joinpath(name).read_text(encoding="utf-8")


def _policy(styles: list[str], scripts: list[str]) -> str:
    return (
        "default-src 'none'; "
        f"script-src {_hashes(scripts)}; style-src {_hashes(styles)}; "
        "img-src data:; base-uri 'none'; form-action 'none'"
    )


def _hashes(texts: list[str]) -> str:
    digests = (hashlib.sha256(text.encode()).digest() for text in texts)
    return " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)


def _rich(text: str) -> Markup:
    """HTML of a text with bold and code; every run is escaped before it is wrapped."""
    parts = []
    for run in parse(text):
        part = escape(run.text)
        if run.code:
            part = Markup("<code>{}</code>").format(part)
        if run.bold:
            part = Markup("<strong>{}</strong>").format(part)
        parts.append(part)
    return Markup("").join(parts)


def _data_uri(svg: str) -> str:
    """Address of an SVG as an image: isolated, so that ids and styles of two drawings cannot mix."""
    return "data:image/svg+xml;base64," + base64.b64encode(clean(svg).encode()).decode()


def _payload(plot: LinePlot) -> Markup:
    """JSON of an interactive plot, safe inside a script element."""
    series: list[dict[str, Any]] = []
    for index, one in enumerate(plot.series):
        entry = asdict(one) | {
            "name": plain(one.name),
            "colour": SERIES_COLOURS[index % len(SERIES_COLOURS)],
        }
        for field in ("y", "y_low", "y_high"):
            # Six digits are finer than a pixel at any zoom that makes sense, and halve the file.
            entry[field] = [float(f"{value:.6g}") for value in entry[field]]
        series.append(entry)
    data = {
        "x_label": plain(plot.x_label),
        "y_label": plain(plot.y_label),
        "log_x": plot.log_x,
        "log_y": plot.log_y,
        "series": series,
    }
    text = json.dumps(data, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    # "</script>" and "<!--" are the only ways out of a script element, and both begin with "<".
    return Markup(text.replace("<", "\\u003c"))
