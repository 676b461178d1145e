"""Curves in a report: thinned, and true on paper and zoomed in."""

import base64
import datetime
import json
import re

import numpy as np
import pytest

from jointbayes.report.canvas import extremes, points_of_polyline
from jointbayes.report.html import render_html
from jointbayes.report.model import Figure, LinePlot, Report, ReportSection, Series
from jointbayes.report.sections.fit_to_data import shown_lines
from vibrecords import FrfSet

LINES = 0.25 * np.arange(1, 9922)
RESONANT = 1 / np.abs(900.0**2 - LINES**2 + 1j * 0.004 * 900.0 * LINES)


def test_extremes_keep_every_peak_of_a_stretch_and_nothing_that_is_no_number():
    curve = np.random.default_rng(1).standard_normal(9000)
    curve[4321], curve[77] = 40.0, np.nan
    kept = extremes(curve, 500)
    assert kept.size <= 1000
    assert {4321, int(np.nanargmin(curve))} <= set(kept.tolist())
    assert 77 not in kept
    assert extremes(curve[:10], 500).tolist() == list(range(10))


def test_a_figure_of_many_lines_keeps_the_peaks_of_all_its_frfs():
    lines = 0.02 * np.arange(1, 60_001)
    peaks = np.array([311.0, 900.0])
    values = 1 / (peaks**2 - lines[:, None] ** 2 + 0.004j * peaks * lines[:, None])
    frf = FrfSet(lines, values[:, :, None], ("2:y", "3:y"), ("3:y",), "receptance")
    kept = shown_lines(frf)
    assert 500 < kept.size <= 4000
    assert set(np.abs(values).argmax(axis=0).tolist()) <= set(kept.tolist())
    assert shown_lines(frf.at_lines(slice(0, 4000))).tolist() == list(range(4000))


@pytest.mark.parametrize("tolerance", [1e-4, 1e-2])
def test_a_polyline_misses_no_point_by_more_than_its_tolerance(tolerance):
    curve = np.log10(RESONANT)
    kept = points_of_polyline(LINES, curve, tolerance)
    assert np.abs(np.interp(LINES, LINES[kept], curve[kept]) - curve).max() <= tolerance
    assert kept.size < 0.2 * curve.size
    assert int(curve.argmax()) in kept or curve.max() - curve[kept].max() <= tolerance


def test_a_polyline_through_noise_keeps_all_of_it():
    noise = np.random.default_rng(2).standard_normal(3000)
    assert points_of_polyline(LINES[:3000], noise, 1e-6).size == 3000


def _decoded(one: dict, name: str) -> np.ndarray:
    """What the page's script makes of a packed column."""
    packed = one[name]
    if isinstance(packed, list):
        return np.array(packed)
    if name == "x":
        gaps = np.frombuffer(base64.b64decode(packed["gaps"]), np.uint8)
        return packed["first"] + packed["step"] * np.cumsum(gaps, dtype=int)
    scaled = packed["low"] + packed["span"] * np.frombuffer(base64.b64decode(packed["codes"]), "<u2") / 65535
    return 10**scaled if packed["log"] else scaled


def _page(*series: Series) -> tuple[str, list[dict]]:
    plot = LinePlot("Frequency (Hz)", "|H|", series, log_y=True)
    figure = Figure("frf", "An FRF.", "An FRF", "<svg xmlns='http://www.w3.org/2000/svg'/>", plot)
    page = render_html(Report("FRF", "", (), (ReportSection("s", "S", (figure,)),), datetime.date(2026, 1, 5), "0.1.0"))
    found = re.search(r'<script type="application/json" class="plot">(.*?)</script>', page, re.DOTALL)
    return page, json.loads(found.group(1))["series"]


def test_a_page_holds_every_line_of_a_noisy_frf_and_few_of_a_smooth_one():
    noisy = RESONANT * np.exp(0.05 * np.random.default_rng(3).standard_normal(LINES.size))
    page, (measured, smooth, band) = _page(
        Series("measured", LINES, noisy),
        Series("MAP", LINES, RESONANT),
        Series("95 %", LINES, (), "band", 0.9 * RESONANT, 1.1 * RESONANT),
    )
    x, y = _decoded(measured, "x"), _decoded(measured, "y")
    assert x.size > 0.9 * LINES.size
    np.testing.assert_allclose(np.interp(LINES, x, np.log10(y)), np.log10(noisy), atol=3e-4 * np.ptp(np.log10(noisy)))
    for one, name, curve in (
        (smooth, "y", RESONANT),
        (band, "y_low", 0.9 * RESONANT),
        (band, "y_high", 1.1 * RESONANT),
    ):
        x, y = _decoded(one, "x"), _decoded(one, name)
        assert x.size < 0.2 * LINES.size
        np.testing.assert_allclose(np.interp(LINES, x, np.log10(y)), np.log10(curve), atol=2e-3)
    assert y.max() == pytest.approx(1.1 * RESONANT.max(), rel=2e-3)
    assert len(page) < 150_000


def test_uneven_lines_and_records_without_end_fit_a_page_too():
    _, (uneven,) = _page(Series("uneven", np.sqrt(LINES), RESONANT))
    x = _decoded(uneven, "x")
    np.testing.assert_allclose(x, np.sqrt(LINES)[np.searchsorted(np.sqrt(LINES), x - 1e-4)], rtol=1e-8)
    many = np.arange(1.0, 100_001.0)
    noise = np.exp(np.random.default_rng(4).standard_normal(many.size))
    noise[54_321] = 1e9
    page, (long,) = _page(Series("long", many, noise))
    assert _decoded(long, "x").size <= 20_000
    assert _decoded(long, "y").max() == pytest.approx(1e9, rel=1e-3)
    assert len(page) < 200_000
