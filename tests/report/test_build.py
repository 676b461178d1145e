"""The report's content: verdict first, numbers that are those of the summary, banners that cannot be missed."""

import dataclasses
import datetime
import math
import os
import pkgutil
import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import jointbayes.report.sections
from jointbayes.case.case import case_from_text
from jointbayes.posterior import Identifiability, summarise
from jointbayes.posterior.rounding import number, rounded, rounded_interval
from jointbayes.posterior.verdicts import mode_sentence
from jointbayes.report import Figure, ReportInputs, build_report, render_html, render_pdf
from jointbayes.report.contents import SECTIONS, SECTIONS_OF_DATA
from jointbayes.report.model import Callout, Code, Paragraph, Table
from jointbayes.report.sections.lead import coupling_sentence
from jointbayes.report.sections.run_details import chain_figures
from jointbayes.workflow import sample
from tests.conftest import PAIR, TO_CONVERGE, cheap_text, edited, of_case

DATE = datetime.date(2026, 1, 5)
INITIAL = (1e8, 0.0, 0.0)
TABLE_3 = np.array([5.05e9, 3.44e7, 1.52e6])
MEASURED_HZ = (120.0, 762.0, 2101.0)


def report_of(posterior, **changes):
    stated = {"reference": TABLE_3, "reference_source": "Table 3", "measured_frequencies_hz": MEASURED_HZ}
    return build_report(ReportInputs(of_case(posterior, **(stated | changes))), DATE)


@pytest.fixture(scope="module")
def whole(cheap_posterior):
    """The cheap case's report with everything in it."""
    return report_of(cheap_posterior)


@pytest.fixture(scope="module")
def of_frequencies(frequency_posterior):
    return report_of(frequency_posterior)


def of_kind(blocks, kind):
    return [block for block in blocks if isinstance(block, kind)]


def section(report, identifier):
    return next(s for s in report.sections if s.identifier == identifier)


def test_the_verdict_table_is_the_first_table_and_holds_the_summary_s_numbers(whole, cheap_posterior):
    summary = summarise(cheap_posterior, INITIAL, MEASURED_HZ).to_json()
    verdicts = of_kind(whole.blocks(), Table)[0]
    assert verdicts in whole.lead
    head = ("Stiffness", "Published", "Median", "95 % interval", "Unit", "Verdict")
    assert verdicts.head == head
    for row, published, (name, p) in zip(verdicts.rows, TABLE_3, summary["parameters"].items(), strict=True):
        by_likelihood = p["printed_by_likelihood"]
        printed = [p["printed95"][i] if changed else p["interval95"][i] for i, changed in enumerate(by_likelihood)]
        errors = [math.nan if changed else p["interval95_error"][i] for i, changed in enumerate(by_likelihood)]
        expected = (name, number(published), rounded(p["median"], p["median_error"]))
        assert row == (*expected, rounded_interval(printed, errors), p["unit"], p["verdict"])
        if any(by_likelihood):  # the sentences name the end, and the draws' own interval
            sentences = next(block.text for block in of_kind(whole.lead, Paragraph) if f"**{name}**" in block.text)
            drawn = rounded_interval(p["interval95"], p["interval95_error"], " to ")
            assert re.search(rf"\*\*{name}\*\* \(\w+ ends? by likelihood ratio; 95 % credible interval ", sentences)
            assert drawn in sentences
    assert any(any(p["printed_by_likelihood"]) for p in summary["parameters"].values())
    assert verdicts.row_kinds == ("bad", "caution", "good")
    assert [row[-1] for row in verdicts.rows] == ["not identified", "weakly identified", "identified"]
    assert "Table 3" in verdicts.note


def test_the_sentence_on_the_coupling_carries_the_summary_s_numbers(whole, cheap_posterior):
    summary = summarise(cheap_posterior, INITIAL).to_json()
    k12, k22 = summary["parameters"]["k12"], summary["parameters"]["k22"]
    _, sentence, explains = of_kind(whole.lead, Paragraph)
    assert explains.text.replace("*", "") == summary["check"]["sentence"]
    found = re.fullmatch(
        r"\*\*The coupling stiffness k12 is (?P<verdict>[a-z ]+)\*\*: its 95 % interval spans a factor of "
        r"(?P<factor>\S+) \((?P<low>\S+) … (?P<high>\S+) N\); the relative standard deviation is (?P<sd12>\S+) %, "
        r"(?P<times>\S+) times that of k22 \((?P<sd22>\S+) %\)\.",
        sentence.text,
    )
    assert found["verdict"] == k12["verdict"] == "weakly identified"
    low, high = k12["printed95"]
    assert f"{found['low']} … {found['high']}" == cheap_posterior.identifiability("k12").interval()
    for group, exact, digits in (
        ("factor", high / low, 3),
        ("sd12", 100 * k12["sd_log"], 2),
        ("sd22", 100 * k22["sd_log"], 2),
        ("times", k12["sd_log"] / k22["sd_log"], 2),
    ):
        assert float(found[group]) == float(f"{exact:.{digits}g}"), group


def parameter(low, high, sd_log, verdict="identified"):
    known = Identifiability((low, high), math.nan, sd_log, 1.0, verdict, "", (low + high) / 2)
    return SimpleNamespace(known=known, verdict=verdict)


def test_the_sentence_on_the_coupling_fits_every_outcome():
    k22 = parameter(1.5e6, 1.6e6, 0.02)

    def sentence(**k12):
        return coupling_sentence(
            SimpleNamespace(parameters={"k12": parameter(**k12), "k22": k22}), *PAIR.quantities[1:]
        )

    both = sentence(low=-1e7, high=2e7, sd_log=math.nan, verdict="not identified")
    assert both.startswith("**The coupling stiffness k12 is not identified**")
    assert "contains zero, so that not even its sign is known" in both
    assert "only 0.5 times that of k22 (2 %)" in sentence(low=3e7, high=3.1e7, sd_log=0.01)
    assert "spans a factor of 2 (-4.00e7 … -2.00e7 N)" in sentence(low=-4e7, high=-2e7, sd_log=0.1)


def test_synthetic_data_are_called_synthetic_and_measured_ones_are_not(whole, of_frequencies):
    banner = "**The FRF data are synthetic**"
    assert sum(block.text.startswith(banner) for block in of_kind(whole.lead, Callout)) == 1
    assert "synthetic data" in whole.subtitle
    measured = of_frequencies
    assert not any("synthetic" in block.text for block in of_kind(measured.blocks(), Callout))
    assert "synthetic" not in measured.subtitle
    titles = [block.plot for block in of_kind(whole.blocks(), Figure) if block.plot]
    assert all("synthetic" in [one.name for one in plot.series] for plot in titles)
    assert all("measured" not in [one.name for one in plot.series] for plot in titles)


@pytest.mark.usefixtures("plain_reports")
def test_the_first_block_says_whether_the_sampler_converged(whole, cheap_posterior):
    first = whole.lead[0]
    assert (first.kind, first.text) == ("good", f"**The sampler** {cheap_posterior.reason}")
    record = dataclasses.replace(cheap_posterior.record, converged=False, reason="not converged at 9 of 9 steps")
    stopped = report_of(dataclasses.replace(cheap_posterior, record=record)).lead[0]
    assert stopped.kind == "bad"
    assert "has NOT converged, do not use these numbers**: at 9 of 9 steps" in stopped.text


@pytest.mark.usefixtures("plain_reports")
def test_a_mode_that_the_map_search_missed_has_a_banner(whole, cheap_posterior):
    assert not any("another mode" in block.text for block in of_kind(whole.lead, Callout))
    missed = dataclasses.replace(
        cheap_posterior,
        mode_theta=cheap_posterior.mode_theta + 1.0,
        mode_log_density=cheap_posterior.mode_log_density + 9,
    )
    banners = [block for block in of_kind(report_of(missed).lead, Callout) if "another mode" in block.text]
    assert [block.kind for block in banners] == ["bad"]


def test_every_file_of_a_section_is_in_the_report():
    files = {info.name for info in pkgutil.iter_modules(jointbayes.report.sections.__path__)} - {"lead"}
    assert files == {section.__module__.rsplit(".", 1)[1] for section in (*SECTIONS_OF_DATA, *SECTIONS)}


def test_sections_stand_in_the_order_in_which_they_are_listed(whole, cheap_posterior):
    inputs = ReportInputs(of_case(cheap_posterior, reference=TABLE_3))
    sections = [
        *(section(inputs.setups[0]) for section in SECTIONS_OF_DATA),
        *(section(inputs) for section in SECTIONS),
    ]
    written = [one for one in sections if one is not None]
    assert [one.identifier for one in written] == [one.identifier for one in whole.sections]
    assert len(written) < len(sections)  # nothing was measured to files, nothing else was uncertain


def test_every_figure_says_what_it_shows(whole):
    figures = of_kind(whole.blocks(), Figure)
    names = {figure.identifier for figure in figures}
    assert names == {
        "residuals",
        "profiles",
        "frf-0-0",
        "phase-0-0",
        "frequencies-plot",
        "corner",
        "traces",
        "autocorrelation",
        "iteration-norm",
        "iteration-stiffness",
    }
    assert all(len(figure.alt) > 30 and len(figure.caption) > 20 for figure in figures)
    assert len({figure.alt for figure in figures}) == len(figures)


def test_each_line_has_its_point_among_the_residuals(whole, cheap_posterior):
    drawn = next(f.svg for f in of_kind(whole.blocks(), Figure) if f.identifier == "residuals")
    strokes = max(re.findall(r'<path d="([^"]*)"', drawn), key=lambda path: path.count("M"))
    lines = cheap_posterior.problem.test.data.frf.frequency_hz.size
    assert (strokes.count("M"), strokes.count("L")) == (lines, lines)  # a stroke of no length is a point


def test_the_interactive_twin_shows_the_data_and_the_band(whole, cheap_posterior):
    frf = cheap_posterior.problem.test.data.frf
    plot = next(f.plot for f in of_kind(whole.blocks(), Figure) if f.identifier == "frf-0-0")
    band, measured, guess, best = plot.series
    assert plot.log_y
    np.testing.assert_array_equal(measured.x, frf.frequency_hz)
    assert measured.y == pytest.approx(tuple(abs(frf.values[:, 0, 0]).tolist()), rel=1e-4)
    within = [low <= y <= high for low, y, high in zip(band.y_low, best.y, band.y_high, strict=True)]
    assert sum(within) > 0.9 * len(within)
    assert not np.allclose(guess.y, best.y)


@pytest.mark.usefixtures("plain_reports")
def test_frequencies_are_set_beside_the_measured_ones(whole, cheap_posterior):
    (table,) = of_kind(section(whole, "frequencies").blocks, Table)
    summary = summarise(cheap_posterior, INITIAL, MEASURED_HZ).to_json()["natural_frequencies_hz"]
    assert [row[1] for row in table.rows] == ["120.0", "762.0", "2101.0"]
    assert [row[3] for row in table.rows] == [f"{f:.2f}" for f in summary["map"]]
    alone = report_of(cheap_posterior, measured_frequencies_hz=None)
    (table,) = of_kind(section(alone, "frequencies").blocks, Table)
    assert "Measured (Hz)" not in table.head
    assert not of_kind(section(alone, "frequencies").blocks, Figure)


def test_the_report_holds_all_that_repeats_the_run(whole, cheap_posterior):
    settings = section(whole, "settings")
    (code,) = of_kind(settings.blocks, Code)
    assert code.text == cheap_text()
    mesh, fingerprint = of_kind(settings.blocks, Paragraph)
    summary = summarise(cheap_posterior, INITIAL).to_json()
    assert mesh.text == summary["mesh"]["sentence"]
    assert summary["data_sha256"] in fingerprint.text
    versions = dict(of_kind(settings.blocks, Table)[0].rows)
    assert versions == dict(cheap_posterior.record.versions)
    assert (whole.date, whole.version, whole.title) == (DATE, versions["jointbayes"], "Clamp")


def test_every_start_of_the_map_search_is_listed_with_its_fate(whole, cheap_posterior):
    starts = section(whole, "starts")
    table = of_kind(starts.blocks, Table)[0]
    estimate = cheap_posterior.estimate
    assert [row[0] for row in table.rows] == [s.name for s in estimate.starts]
    assert {row[0] for row in table.rows if row[-1] == "no"} == set(estimate.failed_starts)
    text = of_kind(starts.blocks, Paragraph)[0].text
    assert text.startswith(
        f"{len(table.rows) - len(estimate.failed_starts)} of {len(table.rows)} starts reach the mode"
    )


def test_the_package_corner_draws_the_corner_plot_without_loading_arviz():
    script = """
import sys, numpy as np
from jointbayes.report import figures
drawn = []
package = figures._corner_package()
figures._corner_package = lambda: package
whole = package.corner
package.corner = lambda values, **options: drawn.append(values.shape) or whole(values, **options)
draws = np.random.default_rng(1).normal(size=(500, 2))
figures.corner_plot(["a", "b"], draws, draws, None, draws[0])
assert drawn == [(500, 2)] and "arviz" not in sys.modules
import corner
assert sys.modules["corner.corner"].arviz_corner is not None  # what a user imports later is whole
"""
    subprocess.run([sys.executable, "-W", "ignore", "-c", script], check=True, env=os.environ | {"MPLBACKEND": "Agg"})


def test_the_report_is_the_same_for_the_same_posterior(whole, cheap_posterior):
    assert render_html(report_of(cheap_posterior)) == render_html(whole)


def test_a_report_on_natural_frequencies_builds_and_renders(of_frequencies):
    report = of_frequencies
    said = [paragraph.text for paragraph in of_kind(report.lead, Paragraph)]
    assert sum("contains zero, so that not even its sign is known" in text for text in said) == 1
    assert sum(text.startswith("**The data exclude that the joint is rigid (") for text in said) == 1
    assert {f.identifier for f in of_kind(report.blocks(), Figure)} == {
        "frequencies-plot",
        "profiles",
        "corner",
        "traces",
        "autocorrelation",
    }
    numbers = of_kind(section(report, "posterior").blocks, Table)[0]
    assert numbers.rows[1][4] == "–"  # sd of ln k12 does not exist
    page = render_html(report)
    assert "nan" not in re.sub(r"svg\+xml,[^\"]*|<script.*?</script>", "", page, flags=re.DOTALL).lower().split()
    assert render_pdf(report).startswith(b"%PDF-")


@pytest.mark.usefixtures("plain_reports")
def test_a_report_without_published_values_names_none(cheap_posterior):
    report = report_of(cheap_posterior, reference=None, reference_source="")
    assert "Published" not in of_kind(report.lead, Table)[0].head
    said = " ".join(block.text for block in of_kind(report.blocks(), Paragraph))
    assert "published" not in said.lower()


@pytest.mark.usefixtures("plain_reports")
@pytest.mark.parametrize("k12", [0.0, -3.44e7])
def test_a_published_coupling_that_has_no_logarithm_is_no_obstacle(cheap_posterior, k12):
    report = report_of(cheap_posterior, reference=np.array([5.05e9, k12, 1.52e6]))
    said = [block.text for block in of_kind(section(report, "posterior").blocks, Paragraph)]
    on_edge = "The published point lies on the edge of the 100.0 % highest-density region."
    assert said == [mode_sentence(cheap_posterior), on_edge]


@pytest.mark.usefixtures("plain_reports")
def test_a_coupling_of_free_sign_from_frfs_builds_too():
    text = edited(cheap_text(), ('parametrisation = "log"', 'parametrisation = "signed"'))
    at, end = text.index("[prior.k12]"), text.index("[prior.k22]")
    rho = '[prior.rho]\ndistribution = "uniform"\nlow = -1.0\nhigh = 1.0\n\n'
    case = case_from_text("signed", text[:at] + rho + text[end:])
    posterior = sample(case, settings=TO_CONVERGE)
    assert posterior.converged  # or there is no sentence on the coupling
    assert (posterior.values("k12") > 0).all()  # although the prior allows either sign
    assert (posterior.prior_values("k12") < 0).any()
    report = report_of(posterior)
    assert "spans a factor of" in of_kind(report.lead, Paragraph)[1].text


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
        assert " of ln k11, ln k12, ln k22, ln ζ1, ln ζ2, ln ζ3, ln ζ4, ln ζ5" in first.caption
        assert " of ln ζ6, ln ζ7, ln ζ8, ln ζ9, ln ζ10, ln ζ11" in second.caption
