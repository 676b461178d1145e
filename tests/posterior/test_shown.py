"""What a notebook shows of a result: short, with names, units and the digits that its interval supports."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from jointbayes.notebook_view import frf_svg, table_html
from jointbayes.posterior.summary_tables import value_rows


@pytest.fixture(scope="module")
def shown(cheap_case, cheap_posterior, frequency_posterior):
    """All that a user of a notebook holds, by what it is."""
    data = cheap_case.problem.test.data
    estimate = cheap_posterior.estimate
    return {
        "case": cheap_case, "problem": cheap_case.problem, "data": data, "frf": data.frf, "posterior": cheap_posterior,
        "estimate": estimate, "iteration": estimate.iteration, "summary": cheap_posterior.summary(),
        "prediction": cheap_posterior.predict_frf(max_draws=8), "of frequencies": frequency_posterior,
        "frequencies": frequency_posterior.problem.test.data,
    }  # fmt: skip


def test_all_is_short(shown):
    lines = {name: repr(one).splitlines() for name, one in shown.items()}
    assert {name: len(each) for name, each in lines.items() if len(each) > 12} == {}
    assert {name: sum(map(len, each)) for name, each in lines.items() if sum(map(len, each)) > 1200} == {}
    assert not [name for name, each in lines.items() if "array(" in "".join(each)]


def test_quantities_have_names_units_and_digits(shown, cheap_posterior):
    text = repr(shown["posterior"])
    for name, unit in (("k11", "GN/m"), ("k12", "MN"), ("k22", "MN·m/rad")):
        line = re.search(rf"  {name}: median (\S+), 95 % interval (\S+) to (\S+) {unit}\n", f"{text}\n")
        median, low, high = line.groups()
        scale = {"G": 1e9, "M": 1e6}[unit[0]]
        assert low != high
        quantiles = np.quantile(cheap_posterior.values(name), [0.5, 0.025, 0.975])
        np.testing.assert_allclose(np.array([median, low, high], dtype=float) * scale, quantiles, rtol=0.06)
    named = r"\(k11 = \S+ N/m, k12 = \S+ N, k22 = \S+ N·m/rad; "
    assert re.match(f"MapEstimate{named}log posterior ", repr(shown["estimate"]))
    assert re.match(f"IterationHistory{named}", repr(shown["iteration"]))
    assert repr(shown["prediction"]) == f"FrfPrediction(median and 95 % band of {shown['frf']!r})"


def test_the_ends_of_a_narrow_interval_differ():
    # of 1.9996e7 and 2.0002e7 both ends were "2e+07"
    draws = np.random.default_rng(1).normal(2e7, 1.5e3, size=(4, 500, 16))
    ((name, median, ends, unit),) = value_rows({"k": (draws, "N/m")})
    assert (name, unit) == ("k", "MN/m")
    low, high = ends.split(" to ")
    assert float(low) < float(median) < float(high)


def test_the_last_line_of_a_cell_is_a_fit_report(shown):
    summary = shown["summary"]
    assert repr(summary) == str(summary)
    assert repr(summary).startswith("[[Posterior of 'cheap']]\n")


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
    assert frame.loc["k22", "unit"] == "N·m/rad"
    low, high = cheap_posterior.interval("k22")
    assert (frame.loc["k22", "low95"], frame.loc["k22", "high95"]) == pytest.approx((low, high))
    assert frame["verdict"].tolist() == [p.known.verdict for p in shown["summary"].parameters.values()]
    assert frame["r_hat"].dtype == float
    draws = cheap_posterior.to_dataframe()
    assert len(draws) == cheap_posterior.log_density.size
    np.testing.assert_array_equal(draws["k11"].to_numpy(), cheap_posterior.values("k11").ravel())
