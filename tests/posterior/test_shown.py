"""What a notebook shows of a result: short, with names, units and the digits that its interval supports."""

import math
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.identification import SearchEffort
from jointbayes.posterior.identifiability import LIMIT_NOTE
from jointbayes.posterior.summary import NuisanceSummary, value_rows
from tests.conftest import cheap_frequencies_text, on_one_line
from vibrecords.notebook_view import frf_svg, table_html


@pytest.fixture(scope="module")
def shown(cheap_case, cheap_posterior, frequency_posterior):
    """All that a user of a notebook holds, by what it is."""
    data = cheap_case.problem.test.data
    estimate = cheap_posterior.estimate
    return {
        "case": cheap_case, "problem": cheap_case.problem, "data": data, "frf": data.frf,
        "posterior": replace(cheap_posterior),
        "estimate": estimate, "iteration": estimate.iteration, "summary": replace(cheap_posterior).summary(),
        "prediction": cheap_posterior.predict_frf(max_draws=8), "of frequencies": frequency_posterior,
        "frequencies": frequency_posterior.problem.test.data,
    }  # fmt: skip


def unwrapped(text):
    """The text with each line that goes on below, deeper, as one."""
    return re.sub(r"\n {6,}", " ", text)


def test_a_summary_has_what_lmfit_reports(shown, cheap_posterior):
    text, summary = str(shown["summary"]), shown["summary"]
    fewest = min(cheap_posterior.record.sampler["ess"].values())
    assert (found := re.search(r"^    Converged: (\S+ \S+) independent draws\. Seed 1\.$", text, re.M))
    assert float(found[1].replace(" ", "")) == pytest.approx(fewest, rel=0.05)
    matrix, names = np.corrcoef(cheap_posterior.theta.T), cheap_posterior.problem.names
    expected = {(a, b): matrix[i, j] for j, b in enumerate(names) for i, a in enumerate(names[:j])}
    assert summary.correlations == pytest.approx({pair: r for pair, r in expected.items() if abs(r) > 0.1})
    strongest = max(summary.correlations, key=lambda pair: abs(summary.correlations[pair]))
    head = "[[Correlations of the draws (above 0.1)]]"
    assert f"{head}\n    C({', '.join(strongest)}) = {summary.correlations[strongest]:+.2f}" in text


def test_all_is_short(shown):
    lines = {name: repr(one).splitlines() for name, one in shown.items()}
    summary = lines.pop("summary")
    assert len(summary) <= 24
    assert {name: len(each) for name, each in lines.items() if len(each) > 12} == {}
    for each in (summary, lines["posterior"], lines["of frequencies"]):
        assert max(map(len, each)) <= 100
    assert {name: sum(map(len, each)) for name, each in lines.items() if sum(map(len, each)) > 1200} == {}
    assert not [name for name, each in lines.items() if "array(" in "".join(each)]


def test_what_else_is_held_is_named_by_what_it_is_of(shown):
    named = r"\(k11 = \S+ N/m, k12 = \S+ N, k22 = \S+ N·m/rad; "
    assert re.match(f"IterationHistory{named}", repr(shown["iteration"]))
    assert repr(shown["prediction"]) == f"FrfPrediction(median and 95 % band of {shown['frf']!r})"


def test_the_ends_of_a_narrow_interval_differ():
    # of 1.9996e7 and 2.0002e7 both ends were "2e+07"
    draws = np.random.default_rng(1).normal(2e7, 1.5e3, size=(4, 500, 16))
    ((name, value),) = value_rows({"k": (draws, "N/m")})
    median, low, high = map(float, re.fullmatch(r"(\S+) \((\S+) to (\S+)\) MN/m", value).groups())
    assert (name, low < median < high) == ("k", True)


@pytest.mark.parametrize("name", ["posterior", "summary", "estimate", "frf", "of frequencies"])
def test_a_notebook_shows_a_table_and_no_script(shown, name):
    html = shown[name]._repr_html_()
    tree = ElementTree.fromstring(html)
    assert tree.find("table") is not None
    assert {element.tag for element in tree.iter()} <= {"div", "p", "table", "tr", "th", "td", "pre", "svg", "polyline"}
    attributes = {attribute for element in tree.iter() for attribute in element.attrib}
    assert not [name for name in attributes if name.startswith("on") or name in ("style", "href", "src")]
    assert len(html) < 20_000
    assert (tree.find("svg") is not None) == (name in ("posterior", "frf"))
    colours = set(re.findall(r'(?:stroke|fill)="([^"]+)"', html))
    assert colours <= {"none", "currentColor", "#d9622b"}  # seen on white and on black


def test_the_drawing_keeps_every_peak():
    f = np.arange(1.0, 20_001.0)
    values = np.ones(f.size, dtype=complex)
    values[12_345] = 1e3
    svg = ElementTree.fromstring(f"<div>{frf_svg(f, {'tip <x>': values})}</div>").find("svg")
    (line,) = svg
    points = np.array([point.split(",") for point in line.get("points").split()], dtype=float)
    assert len(points) <= 400
    assert points[:, 1].min() == 0
    assert points[np.argmin(points[:, 1]), 0] == pytest.approx(480 * 12_345 / 19_999, abs=0.1)
    assert svg.get("aria-label") == "tip <x>, 1 to 20000 Hz, 60 dB from top to bottom"
    ElementTree.fromstring(f"<div>{frf_svg(np.array([5.0]), {'one line': np.array([1j])})}</div>")


def test_foreign_names_stay_text():
    html = table_html("<script>alert(1)</script>", ("a & b",), [("<b>",)])
    assert "<script" not in html
    assert [element.text for element in ElementTree.fromstring(html).iter("td")] == ["<b>"]


def test_tables_of_pandas(shown, cheap_posterior):
    frame = shown["summary"].to_dataframe()
    assert list(frame.index) == ["k11", "k12", "k22"]
    assert (frame.loc["k22", "unit"], frame["r_hat"].dtype) == ("N·m/rad", float)
    draws = cheap_posterior.to_dataframe()
    np.testing.assert_array_equal(draws["k11"].to_numpy(), cheap_posterior.values("k11").ravel())
    assert not [cell for row in frame.to_numpy() for cell in row if cell is None or isinstance(cell, list | dict)]
    known = shown["summary"].parameters["k11"].known
    assert tuple(frame.loc["k11", ["likelihood_low95", "likelihood_high95"]]) == known.likelihood95
    assert frame.loc["k11", "reasons"] == known.because
    assert tuple(frame.loc["k11", ["low95_error", "high95_error"]]) == known.interval_error
    assert math.isnan(frame.loc["k22", "limit"])


LENGTH = NuisanceSummary("mm", 383.0, 384.0, 384.2, 0.001, (382.0, 386.0), (380.0, 386.0), 0.6, 1.0, 900.0, 800.0)


def texts(html, tag):
    return [element.text for element in ElementTree.fromstring(html).iter(tag)]


def test_a_notebook_shows_all_blocks_of_a_summary_and_no_brackets(shown):
    summary = replace(shown["summary"], nuisances={"length": LENGTH})
    html = summary._repr_html_()
    assert "[[" not in html
    assert texts(html, "p")[0].startswith("Posterior of 'cheap'\n")
    (rest,) = texts(html, "pre")
    assert re.match(r"Other quantities: .*\n    length:  384.2 \(382.0 to 386.0\) mm\nData\n", rest)
    assert summary.to_dataframe().loc["length", ["unit", "low95", "prior_high95"]].tolist() == ["mm", 382.0, 386.0]


def test_a_limit_has_its_unit_once(shown):
    stiffness = shown["summary"].parameters["k22"]
    known = replace(stiffness.known, cls="bounded below", limit=1.5e6, unit="N·m/rad")
    summary = replace(shown["summary"], parameters={"k22": replace(stiffness, known=known)})
    assert texts(summary._repr_html_(), "td")[1] == known.value == "above 1.50 MN·m/rad"
    assert LIMIT_NOTE in on_one_line(summary)


def test_a_fit_that_failed_says_so_wherever_it_is_shown(shown, cheap_posterior):
    effort = SearchEffort(squares=400.0, limit=1.2, starts=20, agreeing=12)
    estimate = replace(shown["estimate"], effort=effort)
    assert effort.sentence.startswith("The best fit misses the data by 20 times their noise")
    for one in (estimate, replace(cheap_posterior, estimate=estimate)):
        assert unwrapped(repr(one)).endswith(effort.sentence)
        assert texts(one._repr_html_(), "p")[-1] == effort.sentence


def test_a_mode_shows_what_else_is_uncertain():
    case = jb.case_from_text("uncertain", cheap_frequencies_text() + "\n[uncertain.length]\nsd_percent = 0.5\n")
    estimate, prior = jb.find_map(case, seed=1), case.problem.prior
    (value,) = prior.nuisance_values(estimate.theta)
    assert dict(estimate.others) == {"length": (value, prior.nuisances[0].unit)}
    assert f", length = {value:.4g} {prior.nuisances[0].unit}; log posterior" in repr(estimate)
    assert "length" in texts(estimate._repr_html_(), "td")
