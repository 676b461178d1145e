"""A case run, and what is kept of it: the draws' hash, the summary, and the report's text as a person reads it."""

import datetime
import hashlib
import html
import platform
import re
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from html.parser import HTMLParser
from importlib.metadata import version
from typing import Any
from unittest.mock import patch

import llvmlite.binding
import numba
import numpy as np
from threadpoolctl import threadpool_info

import jointbayes as jb
from jointbayes.report import ReportInputs, build_report, drawing, render_html
from jointbayes.reproducibility import one_blas_thread
from tests.conftest import plain_reports
from tests.same.cases import DEAR, made, quick, quick_run

#: Keys of a summary that say when, where and how fast, not what.
_PASSING = ("seconds", "ess_per_second", "versions")
#: A number as a summary or a report prints it; 1.2 × 10⁷ is one.
NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d+)?(?:[eE][-+]?\d+|\s×\s10[⁻⁰¹²³⁴-⁹]+)?")
_SUPERSCRIPT = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−", "-0123456789-")
_PASSING_TEXT = (
    (re.compile(r"\b\d+\.\d+\.\d+(\+[0-9a-f]+)?\b"), "VERSION"),
    (re.compile(r"(?:(?<=effective draws in )|(?<=importance sampling in ))[\d.]+ s\b"), "TIME"),
)
_BLOCKS = {"p", "li", "tr", "div", "h1", "h2", "h3", "h4", "figcaption", "caption", "dt", "dd", "section", "summary"}
_UNREAD = {"script", "style", "pre", "title"}  # the listing of the case is what was read, not what was found
_BLANK = '<svg xmlns="http://www.w3.org/2000/svg" width="72pt" height="36pt"/>'
Record = dict[str, Any]


@contextmanager
def shortened(name: str) -> Iterator[None]:
    """Short runs wherever the report makes one, and no pictures."""
    with (
        patch.object(drawing, "svg", lambda *_: _BLANK),
        patch.object(jb.SamplerSettings, "for_one_of_many", quick),
        plain_reports() if name in DEAR else nullcontext(),
    ):
        yield


def record(name: str) -> Record:
    """Run a case with few steps, and return what is kept of it."""
    with shortened(name), made(name) as case:
        posterior = jb.sample(case, settings=quick_run(case))
        with one_blas_thread():  # as `write_report`
            inputs = ReportInputs(posterior)
            page = render_html(build_report(inputs, datetime.date(2026, 1, 1)))
            summary = inputs.summary.to_dict()
    return {
        "made_with": arithmetic(),
        "draws_sha256": hash_of(posterior),
        "summary": without_passing(summary),
        "report": sentences(page),
    }


def arithmetic() -> dict[str, str]:
    """What decides about the last bits: Python, packages, processor, C library and kernels of the linear algebra."""
    libraries = (one for one in threadpool_info() if one["user_api"] == "blas")
    blas = sorted({f"{one['internal_api']} {one['version']} {one.get('architecture', '')}" for one in libraries})
    features = llvmlite.binding.get_host_cpu_features().flatten()
    processor = numba.config.CPU_NAME or llvmlite.binding.get_host_cpu_name()
    return {
        "python": ".".join(platform.python_version_tuple()[:2]),
        **{name: version(name) for name in ("numpy", "scipy", "numba", "emcee")},
        "processor": f"{processor} {hashlib.sha256(features.encode()).hexdigest()[:8]}",
        "libc": " ".join(platform.libc_ver()),
        "blas": ", ".join(blas),
    }


def hash_of(posterior: jb.Posterior) -> str:
    """Of the bytes of all draws and of their log densities, name by name."""
    digest = hashlib.sha256()
    for name in sorted(posterior.draws):
        digest.update(name.encode() + np.ascontiguousarray(posterior.draws[name].values).tobytes())
    return digest.hexdigest()


def without_passing(value: Any) -> Any:
    """A part of a summary without times and versions, its numbers of five significant digits."""
    match value:
        case dict():
            return {key: without_passing(part) for key, part in value.items() if key not in _PASSING}
        case list() | tuple():
            return [without_passing(part) for part in value]
        case float():
            return float(f"{value:.5g}")
        case str():
            return _five_digits(value)
    return value


def number(text: str) -> float:
    """Value of a number that `NUMBER` has found."""
    return float(re.sub(r"\s×\s10", "e", text).translate(_SUPERSCRIPT))


def _five_digits(text: str) -> str:
    """The text with numbers of more than five significant digits rounded to five."""

    def rounded(found: re.Match[str]) -> str:
        digits = re.sub(r"[eE×].*|\D", "", found[0]).lstrip("0")
        return found[0] if len(digits) <= 5 or "." not in found[0] else f"{number(found[0]):.5g}"

    return NUMBER.sub(rounded, text)


class _Text(HTMLParser):
    """The text of a page, a line for each paragraph, item of a list and row of a table."""

    def __init__(self) -> None:
        super().__init__()
        self.parts: list[str] = []
        self._unread = 0

    def handle_starttag(self, tag: str, _: object) -> None:
        self._unread += tag in _UNREAD
        self.parts.append("\n" if tag in _BLOCKS else " | " if tag in {"td", "th"} else "")

    def handle_endtag(self, tag: str) -> None:
        self._unread -= tag in _UNREAD
        self.parts.append("\n" if tag in _BLOCKS else "")

    def handle_data(self, data: str) -> None:
        if not self._unread:
            self.parts.append(re.sub(r"\s+", " ", data))


def sentences(page: str) -> list[str]:
    """Sentences, headings and rows of tables that a page shows, times and versions left out."""
    reader = _Text()
    reader.feed(page)
    text = html.unescape("".join(reader.parts))
    for pattern, stands_for in _PASSING_TEXT:
        text = pattern.sub(stands_for, text)
    parts = (part.strip(" |") for line in text.split("\n") for part in re.split(r"(?<=[.!?:]) (?=[A-Z])", line))
    return [_five_digits(part) for part in parts if part]
