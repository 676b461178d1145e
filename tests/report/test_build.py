"""The report's content: verdict first, numbers that are those of the summary, banners that cannot be missed."""

import dataclasses
import datetime
import math
import pkgutil
import re
import subprocess
from types import SimpleNamespace

import numpy as np
import pytest

import jointbayes.report.sections
from jointbayes.posterior import summarise
from jointbayes.posterior.diagnosis import diagnosis_of
from jointbayes.report import Figure, ReportInputs, build_report, drawing, render_pdf
from jointbayes.report.contents import APPENDIX, PAGES, one_page
from jointbayes.report.methods import terms_section
from jointbayes.report.model import Table
from jointbayes.report.sections.lead import _bar
from jointbayes.report.sections.natural_frequencies import frequency_section
from jointbayes.report.sections.run_details import chain_figures
from tests.conftest import of_case

DATE = datetime.date(2026, 1, 5)
INITIAL = (1e8, 0.0, 0.0)
TABLE_3 = np.array([5.05e9, 3.44e7, 1.52e6])
MEASURED_HZ = (120.0, 762.0, 2101.0)


def inputs_of(posterior, **changes):
    stated = {"reference": TABLE_3, "reference_source": "Table 3", "measured_frequencies_hz": MEASURED_HZ}
    return ReportInputs(of_case(posterior, **(stated | changes)))


@pytest.fixture(scope="module")
def inputs(cheap_posterior):
    """What the cheap case's report is written from; nobody may change it."""
    return inputs_of(cheap_posterior)


@pytest.fixture(scope="module")
def whole(inputs):
    """The cheap case's report with everything in it."""
    return build_report(inputs, DATE)


def test_the_page_for_a_customer_says_what_page_one_says_and_who_tested_what_and_when(inputs, whole, tmp_path):
    page = one_page(inputs, DATE)
    table, *rest = page.lead
    assert table.head == ("Specimen", "Date of test", "Operator", "Instruments")
    assert table.rows == (("not stated",) * 4,)
    assert [block for block in rest if block not in whole.lead] == []
    assert of_kind(rest, Table) == of_kind(whole.lead, Table)
    assert (page.title, page.subtitle, page.sections) == (whole.title, whole.subtitle, ())
    (tmp_path / "page.pdf").write_bytes(render_pdf(page))
    told = subprocess.run(["pdfinfo", tmp_path / "page.pdf"], capture_output=True, text=True, check=True).stdout
    assert re.search(r"^Pages: +1$", told, re.MULTILINE)
    assert re.search(r"^Page size: .*A4", told, re.MULTILINE)


def of_kind(blocks, kind):
    return [block for block in blocks if isinstance(block, kind)]


def test_a_bar_is_the_interval_within_the_prior_s(whole, cheap_posterior):
    answer = of_kind(whole.lead, Table)[0]
    for name, row, bars in zip(("k11", "k12", "k22"), answer.rows, answer.bars, strict=True):
        first, last = np.log(np.quantile(cheap_posterior.prior_values(name), [0.025, 0.975]))
        low, high = cheap_posterior.verdict(name).interval
        ends = [(np.log(end) - first) / (last - first) for end in (low, cheap_posterior.verdict(name).median, high)]
        assert bars == (pytest.approx(tuple(np.clip(ends, 0, 1))),)
        assert float(row[-1].removesuffix(" %")) == pytest.approx(100 * (bars[0][2] - bars[0][0]), rel=0.06)
    bounded = dataclasses.replace(cheap_posterior.verdict("k22"), cls="bounded below", limit=1e6)
    assert _bar(bounded, (1e5, 1e7)) == pytest.approx((0.5, math.log(bounded.median / 1e5) / math.log(100), 1.0))
    above = dataclasses.replace(bounded, cls="bounded above")
    assert _bar(above, (1e5, 1e7))[::2] == pytest.approx((0.0, 0.5))
    assert _bar(dataclasses.replace(bounded, limit=math.nan, median=0.0, interval=(-1.0, 1.0)), (-2.0, 2.0)) == (
        0.25, 0.5, 0.75)  # fmt: skip


def test_every_file_of_a_section_is_in_the_report():
    files = {info.name for info in pkgutil.iter_modules(jointbayes.report.sections.__path__)}
    listed = {section for page in PAGES for section in (*page[2], *page[3])} | set(APPENDIX)
    not_of_pages = {"lead", "trust", "methods"}
    assert files - not_of_pages == {section.__module__.rsplit(".", 1)[1] for section in listed} - not_of_pages


def test_pages_stand_before_the_appendix_and_hold_every_block_once(whole, inputs, monkeypatch):
    monkeypatch.setattr(drawing, "svg", lambda *_: "<svg/>")
    pages = [one.identifier for one in whole.sections if not one.appendix]
    assert pages == ["fit", "modes", "posterior", "known"]  # nothing was measured to files
    assert [one.appendix for one in whole.sections] == sorted(one.appendix for one in whole.sections)
    sections = [section(inputs.tests[0]) for page in PAGES for section in page[3]]
    sections += [section(inputs) for page in PAGES for section in page[2]] + [section(inputs) for section in APPENDIX]
    captions = [b.caption for one in sections if one is not None for b in one.blocks if isinstance(b, Table | Figure)]
    shown = [b.caption for one in whole.sections[:-1] for b in one.blocks if isinstance(b, Table | Figure)]
    assert sorted(shown) == sorted(captions)


def test_every_figure_says_what_it_shows(whole):
    shown = of_kind(whole.blocks(), Figure)
    assert {figure.identifier for figure in shown} == {
        "residuals", "profiles", "frf-0-0", "mode-shapes", "frequencies-plot", "corner", "traces", "autocorrelation",
        "iteration-norm", "iteration-stiffness", "structure",
    }  # fmt: skip
    assert all(len(figure.alt) > 30 and len(figure.caption) > 20 for figure in shown)
    assert len({figure.alt for figure in shown}) == len(shown)


def test_each_line_has_its_point_among_the_residuals(whole, cheap_posterior):
    drawn = next(f.svg for f in of_kind(whole.blocks(), Figure) if f.identifier == "residuals")
    strokes = max(re.findall(r'<path d="([^"]*)"', drawn), key=lambda path: path.count("M"))
    lines = cheap_posterior.problem.test.data.frf.frequency_hz.size
    assert (strokes.count("M"), strokes.count("L")) == (lines, lines)  # a stroke of no length is a point


def test_the_mean_of_the_residuals_is_on_the_page_as_in_print(whole, cheap_posterior):
    (plot,) = (b.plot for b in whole.blocks() if getattr(b, "identifier", "") == "residuals")
    mean, squares = plot.series[1], cheap_posterior.check.chi2_by_line
    width = int(re.fullmatch(r"mean of (\d+) lines", mean.name)[1])
    assert mean.y[7] == pytest.approx(np.mean(squares[7 : 7 + width]))
    lines = cheap_posterior.problem.test.data.frf.frequency_hz
    assert mean.x[7] == pytest.approx(np.mean(lines[7 : 7 + width]))


def test_the_interactive_twin_shows_the_data_and_the_band(whole, cheap_posterior):
    frf = cheap_posterior.problem.test.data.frf
    plot = next(f.plot for f in of_kind(whole.blocks(), Figure) if f.identifier == "frf-0-0")
    curves, lines = {curve.name: curve.values for curve in plot.curves}, frf.frequency_hz
    assert list(curves) == ["computed", "first guess", "MAP", "paper's iteration", "median"]
    np.testing.assert_array_equal(plot.frequency_hz, lines)
    np.testing.assert_array_equal(curves["computed"], frf.values[:, 0, 0])
    low, high = map(np.abs, plot.band)
    best = np.abs(curves["MAP"])
    assert ((low <= best) & (best <= high)).mean() > 0.9
    assert not np.allclose(curves["first guess"], best)
    assert np.sqrt(np.mean(plot.misfit**2)) == pytest.approx(1.0, abs=0.1)  # the data are synthetic, the noise is known


def test_mode_shapes_are_those_of_a_clamped_beam(whole):
    figure = next(f for f in of_kind(whole.blocks(), Figure) if f.identifier == "mode-shapes")
    assert [name.partition(":")[0] for name in figure.plot.names] == ["Mode 1", "Mode 2", "Mode 3"]
    stretches = figure.svg.count('<path d="M') - 1  # and the ground
    assert stretches == 3 * 3 * len(figure.plot.points)  # of each mode at rest and at both ends of its swing
    along, across = figure.plot.points.reshape(-1, 2).T
    assert (along.min(), along.max()) == pytest.approx((0.0, 0.383))
    assert not across.any()
    for nodes, shape in enumerate(figure.plot.shapes.reshape(3, -1, 2)):
        motion = shape[np.abs(shape[:, 1]) > 0.03 * np.abs(shape[:, 1]).max(), 1]
        assert np.count_nonzero(np.diff(np.sign(motion))) == nodes  #  between the ends
        assert np.abs(shape[0]).max() < 0.01 * np.abs(shape).max()  # at the clamp, which is stiff
        assert abs(np.abs(shape).max() / (0.15 * 0.383) - 1) < 1e-9


@pytest.mark.usefixtures("plain_reports")
def test_frequencies_are_set_beside_the_measured_ones(whole, cheap_posterior):
    table = next(b for b in of_kind(whole.blocks(), Table) if b.caption.startswith("Natural frequencies"))
    summary = summarise(cheap_posterior, INITIAL, MEASURED_HZ).to_dict()["natural_frequencies_hz"]
    columns = dict(zip(table.head, zip(*table.rows, strict=True), strict=True))
    assert columns["Published (Hz)"] == ("120.0", "762.0", "2101.0")
    assert columns["MAP (Hz)"] == tuple(f"{f:.2f}" for f in summary["map"])
    peaks = [(f"{p.measured_hz:.2f}", f"{p.error_percent:+.2f}") for p in diagnosis_of(cheap_posterior).modes]
    assert list(zip(columns["Peak of the data (Hz)"], columns["Error (%)"], strict=True)) == peaks
    alone = frequency_section(inputs_of(cheap_posterior, measured_frequencies_hz=None).tests[0])
    table = next(b for b in of_kind(alone.blocks, Table) if b.caption.startswith("Natural frequencies"))
    assert "Published (Hz)" not in table.head
    assert not [b for b in of_kind(alone.blocks, Figure) if b.identifier == "frequencies-plot"]


@pytest.mark.usefixtures("plain_reports")
def test_any_number_of_uncertain_quantities_is_drawn_a_few_on_each_figure(cheap_posterior):
    # eleven more columns of the joint's own draws stand for eleven uncertain quantities
    names = tuple(f"damping_ratio_{i}" for i in range(1, 12))
    known = cheap_posterior.problem
    many = SimpleNamespace(
        problem=SimpleNamespace(names=(*known.names, *names), parametrisation=known.parametrisation),
        theta=np.concatenate([cheap_posterior.theta, *(cheap_posterior.theta[:, :1] + i for i in range(11))], axis=1),
        log_density=cheap_posterior.log_density,
        draws=cheap_posterior.draws,
    )
    drawn = chain_figures(many, 3)
    assert [f.identifier for f in drawn] == ["traces", "traces-2", "autocorrelation", "autocorrelation-2"]
    for first, second in (drawn[:2], drawn[2:]):
        assert " of ln k11, ln k12, ln k22, ln ζ1, ln ζ2, ln ζ3, ln ζ4" in first.caption
        assert " of ln ζ5, ln ζ6, ln ζ7, ln ζ8, ln ζ9, ln ζ10, ln ζ11" in second.caption  # as many on either


def test_a_report_ends_with_the_terms_that_it_uses(whole):
    said = [str(block) for one in whole.sections[:-1] for block in one.blocks if not isinstance(block, Figure)]
    assert whole.sections[-1].blocks == terms_section(" ".join([*map(str, whole.lead), *said])).blocks
