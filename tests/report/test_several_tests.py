"""Several tests in posterior, summary, file and report: each has its data, its check, its fit, and its place."""

import dataclasses
import json
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import xarray as xr
from benchmarks.written_files import write_frf
from numpy.testing import assert_allclose, assert_array_equal

import jointbayes as jb
from jointbayes.errors import ModelError
from jointbayes.identification import missing_for_iteration, part_to_iterate
from jointbayes.posterior import data_sha256
from jointbayes.posterior.curves import Curve, _change, curves_of
from jointbayes.posterior.homogeneity import ModeShift
from jointbayes.report.contents import PAGES
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.model import Figure, Paragraph, Table
from jointbayes.report.sections.run_details import starts_section
from jointbayes.report.sections.several_tests import curve_section, overview_section, section_of_test
from tests.case.test_several_tests import BASE, CLAMP_EDGE, TWO
from tests.case.test_several_tests import HEARD as OF_PEAKS
from tests.conftest import TABLE_3, cli, unsettled
from tests.report.conftest import posterior_about
from vibrecords.provenance import Provenance

HEARD = """
[tests.heard]
remove = ["data"]
[tests.heard.structure]
length_mm = 200.0
[tests.heard.data]
kind = "natural_frequencies"
frequencies_hz = [437.5, 2623.0]
sd_relative = 0.0
sd_hz = 3.0
"""
TORQUES = """
[level]
name = "torque"
unit = "N m"
[tests.tight]
level = 20.0
[tests.tight.data.truth]
k22 = 2.2e6
[tests.loose]
level = 5.0
[tests.loose.data.truth]
k22 = 0.6e6
[tests.usual]
level = 10.0
"""
OWN = BASE.replace("[joint]", "[joint]\nown = true")


def posterior_of(case, sd=0.01):
    """Made-up draws about the truth."""
    prior = case.problem.prior
    truth = [one.spec.data.truth.stiffness_by_name for one in case.tests if hasattr(one.spec.data, "truth")]
    own = len(case.problem.parametrisation.stiffness_names) > 3
    joints = [list(k.values()) for k in truth] if own else [TABLE_3]
    middle = np.concatenate([*np.log(joints), np.zeros(len(prior.nuisances))])
    widths = np.concatenate([np.full(3 * len(joints), sd), 0.03 * prior.sd[3 * len(joints) :]])
    return posterior_about(case, middle, widths)


@pytest.fixture(scope="module")
def overhangs():
    return posterior_of(jb.case_from_text("overhangs", BASE + CLAMP_EDGE + TWO + HEARD))


@pytest.fixture(scope="module")
def torques():
    return posterior_of(jb.case_from_text("torques", OWN + TORQUES))


@cache
def summary_of(posterior):
    return posterior.summary()


def inputs_of(posterior):
    inputs = ReportInputs(posterior)
    inputs.__dict__["summary"] = summary_of(posterior)  # without what no test has for itself
    return inputs


@pytest.mark.whole
def test_the_summary_says_of_each_test_what_it_says_of_a_lone_test(overhangs):
    summary = json.loads(json.dumps(summary_of(overhangs).to_json(), allow_nan=False))
    assert list(summary["tests"]) == ["long", "short", "heard"]
    parts = overhangs.problem.parts
    for part, said in zip(parts, summary["tests"].values(), strict=True):
        z = part.log_posterior.standardised(overhangs.estimate.theta)
        assert said["fit"]["n_data"] == z[0].size
        assert_allclose(said["fit"]["chi2_per_line"], (np.abs(z) ** 2).mean(), rtol=1e-12)
        assert said["data_sha256"] == data_sha256(part)
        assert said["check"]["sentence"].startswith(f"Test {part.test.name}: ")
        best = part.natural_frequencies_hz(TABLE_3, len(said["natural_frequencies_hz"]["map"]))[0]
        assert_allclose(said["natural_frequencies_hz"]["map"], best, rtol=1e-12)
    assert summary["tests"]["heard"]["natural_frequencies_hz"]["measured"] == [437.5, 2623.0]
    assert summary["tests"]["long"]["natural_frequencies_hz"]["measured"] is None
    n_data = [said["fit"]["n_data"] for said in summary["tests"].values()]
    assert summary["fit"]["n_data"] == sum(n_data)
    chi2 = [said["fit"]["chi2_per_line"] for said in summary["tests"].values()]
    assert_allclose(summary["fit"]["chi2_per_line"], np.average(chi2, weights=n_data), rtol=1e-12)
    assert summary["data_sha256"] == data_sha256(overhangs.problem)
    assert len({summary["data_sha256"], *(said["data_sha256"] for said in summary["tests"].values())}) == 4


def test_a_lone_test_has_no_tests_in_its_summary():
    posterior = posterior_of(jb.case_from_text("alone", BASE))
    assert posterior.summary().to_json()["tests"] == {}
    assert set(posterior.tree.children) == {"posterior", "sample_stats", "prior", "observed_data"}


@pytest.mark.whole
def test_a_posterior_of_tests_comes_back_from_its_file(overhangs, tmp_path):
    overhangs.save(tmp_path / "posterior.nc")
    loaded = jb.load_posterior(tmp_path / "posterior.nc")
    names = ["observed_data_long", "observed_data_short", "observed_data_heard"]
    assert set(names) <= set(loaded.tree.children)
    for name, part in zip(names, overhangs.problem.parts, strict=True):
        stored = loaded.tree[name].to_dataset()
        if name.endswith("heard"):
            assert stored["frequency_hz"].values.tolist() == [437.5, 2623.0]
        else:
            assert_array_equal(stored["values_real"] + 1j * stored["values_imag"], part.test.data.frf.values)
    assert_array_equal(loaded.theta, overhangs.theta)
    assert [one.name for one in loaded.case.tests] == ["long", "short", "heard"]
    assert loaded.summary().to_json()["tests"] == summary_of(overhangs).to_json()["tests"]


def test_tests_with_measurement_files_are_kept_with_their_data(tmp_path):
    """The files may be gone when the posterior is read."""
    case = jb.case_from_text("source", BASE)
    measured = case.problem.test.data
    for name in ("one", "two"):
        write_frf(measured.frf, tmp_path / f"{name}.npz", "npz")
    text = BASE.split("[data]")[0]
    for name in ("one", "two"):
        text += f"""
[tests.{name}.data]
kind = "measured_frf"
file = ["{name}.npz"]
channels = {{"11:y" = "11:y"}}
variance = {{source = "relative", relative = 0.03, floor = 0.01}}
"""
    case = jb.case_from_text("files", text, directory=tmp_path)
    posterior = posterior_about(case, np.log(TABLE_3), np.full(3, 0.01))
    posterior.save(tmp_path / "posterior.nc")
    for name in ("one", "two"):
        (tmp_path / f"{name}.npz").unlink()
    loaded = jb.load_posterior(tmp_path / "posterior.nc")
    for part, other in zip(loaded.problem.parts, case.problem.parts, strict=True):
        assert_array_equal(part.test.data.frf.values, other.test.data.frf.values)
        assert part.test.data.provenance.files == other.test.data.provenance.files


@pytest.mark.whole
@pytest.mark.usefixtures("plain_reports")
def test_the_report_has_a_section_for_each_test(overhangs):
    inputs = inputs_of(overhangs)
    (table,) = overview_section(inputs).blocks
    assert [row[0] for row in table.rows] == ["long", "short", "heard"]
    assert "2 natural frequencies" in table.rows[2][1]
    sections = [
        section_of_test(n, one, [made for page in PAGES for section in page[3] if (made := section(one)) is not None])
        for n, one in enumerate(inputs.tests, 1)
    ]
    assert [one.title for one in sections] == [f"Test {row[0]}" for row in table.rows]
    figures = [block.identifier for one in sections for block in one.blocks if isinstance(block, Figure)]
    assert len(set(figures)) == len(figures)
    assert {"test-1-frf-0-0", "test-2-frf-1-0", "test-3-frequencies-plot"} <= set(figures)
    assert "test-1-frf-1-0" not in figures  # its second output is measured in the other test only
    for section, part in zip(sections, overhangs.problem.parts, strict=True):
        said = [block.text for block in section.blocks if isinstance(block, Paragraph)]
        assert sum(text.startswith("Test ") for text in said) == 1
        frequencies = next(b for b in section.blocks if isinstance(b, Table) and b.caption.startswith("Natural"))
        assert f"{part.natural_frequencies_hz(TABLE_3, 1)[0, 0]:.2f}" in frequencies.rows[0]


def test_a_curve_has_the_quantity_of_each_test_in_the_order_of_the_levels(torques):
    curve = torques.curve("k22")
    assert curve.level.tolist() == [5.0, 10.0, 20.0]
    assert curve.tests == ("loose", "usual", "tight")
    assert curve.quantities == ("loose.k22", "usual.k22", "tight.k22")
    for i, name in enumerate(curve.quantities):
        assert (curve.low[i], curve.high[i]) == torques.interval(name)
        assert curve.median[i] == np.median(torques.values(name))
    assert_allclose(curve.median, [0.6e6, 1.52e6, 2.2e6], rtol=0.01)
    ratio = torques.values("tight.k22") / torques.values("loose.k22")
    assert (curve.pair, curve.pairs, curve.relative) == ((0, 2), 1, True)
    assert_allclose(curve.change, np.quantile(ratio, [0.5, 0.025, 0.975]))
    assert curve.sentence.startswith("k22 at 20 N m over that at 5 N m: median 3.6")
    assert curve.sentence.endswith("it rises between 5 N m and 20 N m.")
    narrow = torques.curve("k22", 0.5)
    assert (narrow.low > curve.low).all()
    assert (narrow.high < curve.high).all()
    assert re.search(r"; no change between \d+ N m and \d+ N m is shown\.$", torques.curve("k11").sentence)


def test_levels_that_are_all_the_same_make_no_curve(torques):
    tests = [dataclasses.replace(one, level=jb.Level(5.0, "torque", "N m")) for one in torques.problem.tests]
    alike = dataclasses.replace(torques, problem=jb.Problem(tests=tests, prior=torques.problem.prior))
    assert curves_of(alike) == ()
    with pytest.raises(jb.ModelError, match="curve: found 1 levels of tests with 'k22'"):
        alike.curve("k22")


def torques_with(torques, **values):
    """The same posterior with other draws of k22: of each test a mean and a standard deviation."""
    rng = np.random.default_rng(1)
    shape = torques.values("loose.k22").shape
    draws = {f"{name}.k22": (("chain", "draw"), rng.normal(*at, shape)) for name, at in values.items()}
    tree = torques.tree.copy()
    tree["posterior"] = xr.DataTree(torques.draws.assign(draws))
    return dataclasses.replace(torques, tree=tree)


def test_a_curve_that_turns_names_the_levels_that_differ_most(torques):
    turned = torques_with(torques, loose=(1e5, 1e3), usual=(1e7, 1e5), tight=(1e5, 1e3)).curve("k22")
    assert turned.pairs == 3
    assert set(turned.pair) in ({0, 1}, {1, 2})
    assert "of 3 pairs of levels the one that differs most clearly: median" in turned.sentence
    assert turned.sentence.endswith(("it rises between 5 N m and 10 N m.", "it falls between 10 N m and 20 N m."))


@pytest.mark.science
def test_a_curve_that_turns_by_chance_is_seldom_said_to_change():
    """Three levels that are alike: the interval is that of all pairs, so that 5 % of the runs at most say otherwise."""
    rng, said, turned = np.random.default_rng(3), 0, 0
    for _ in range(1000):
        draws = rng.normal(size=3) + rng.normal(size=(2000, 3))  # estimates of one value, each with an sd of 1
        _, pairs, (_, low, high) = _change(draws, np.arange(3.0), relative=False, tail=0.025)
        turned += pairs > 1
        said += pairs > 1 and not low <= 0 <= high
    assert 600 < turned < 730
    assert said <= 0.05 * 1000


def test_a_quantity_that_may_be_negative_changes_by_a_difference():
    rng = np.random.default_rng(2)
    values = np.stack([rng.normal(mean, 1e3, 4000) for mean in (-2e5, -1.5e5, -1e5)], axis=-1)
    pair, pairs, change = _change(values, np.array([1.0, 2.0, 3.0]), relative=False, tail=0.025)
    assert (pair, pairs) == ((0, 2), 1)
    assert_allclose(change, np.quantile(values[:, 2] - values[:, 0], [0.5, 0.025, 0.975]))
    level = jb.Level(1.0, "torque", "N m")
    curve = Curve(
        "k12", "N", level, ("a",) * 3, ("k12",) * 3, np.arange(3.0), *values[:3], 0.95, pair, pairs, False, change
    )
    assert curve.sentence.startswith("k12 at 2 N m minus that at 0 N m: median 1e+05 N, 95 % credible interval ")
    assert curve.sentence.endswith("it rises between 0 N m and 2 N m.")


def test_a_run_without_verdict_says_nothing_of_a_change(torques):
    sentence = unsettled(torques).curve("k22").sentence
    assert sentence == "k22 between 5 N m and 20 N m: nothing is said of a change, for the calculation has not settled."


@pytest.mark.whole
@pytest.mark.usefixtures("plain_reports")
def test_the_curve_is_a_table_and_a_figure_of_each_quantity(torques, overhangs):
    section = curve_section(inputs_of(torques))
    assert [block.identifier for block in section.blocks if isinstance(block, Figure)] == [
        f"curve-{i}" for i in (1, 2, 3)
    ]
    tables = [block for block in section.blocks if isinstance(block, Table)]
    assert [row[0] for row in tables[2].rows] == ["5", "10", "20"]
    assert curve_section(inputs_of(overhangs)) is None


def test_levels_whose_data_are_equal_show_no_change(torques):
    """Whatever made-up draws far apart say."""
    same = jb.case_from_text("same", (OWN + TORQUES).replace("k22 = 2.2e6", "k22 = 1.52e6").replace("0.6e6", "1.52e6"))
    posterior = dataclasses.replace(torques, problem=same.problem)
    curve, other = posterior.curve("k22"), torques.curve("k22")
    assert curve.change == other.change
    assert curve.change[1] > 1
    assert (curve.equal_data, curve.changes) == (True, False)
    assert (other.equal_data, other.changes) == (False, True)
    assert curve.sentence.endswith("is shown, for the data of the two are equal within their noise.")


def test_the_report_says_which_tests_measured_the_same_and_how_far_modes_move(torques):
    inputs = inputs_of(torques)
    summary = json.loads(json.dumps(inputs.summary.to_json(), allow_nan=False))
    assert [(each["first"], each["second"]) for each in summary["homogeneity"]] == [
        ("loose", "usual"),
        ("loose", "tight"),
    ]
    assert not any(each["equal"] for each in summary["homogeneity"])
    _, first, *_ = overview_section(inputs).blocks
    assert first.text.startswith("Tests loose and usual differ by more than their noise. 50 FRF values differ by ")
    modes = ModeShift(80.0, -0.1, 0.02, (0.004, 0.012), 5.0), ModeShift(210.0, 0.01, 0.02)
    compared = dataclasses.replace(inputs.summary.homogeneity[0], modes=modes)
    inputs.__dict__["summary"] = dataclasses.replace(inputs.summary, homogeneity=(compared,))
    table = overview_section(inputs).blocks[-1]
    assert table.rows[0] == ("80", "-0.1", "0.02", "0.4", "1.2", "3", "5")
    assert table.rows[1] == ("210", "+0.01", "0.02", "–", "–", "–", "–")


@pytest.mark.parametrize(("name", "which"), [("k22", "overhangs"), ("k99", "torques")])
def test_what_is_no_curve_is_refused_in_one_line(name, which, request):
    with pytest.raises(ModelError, match=r"curve: found .*; expected .*; give") as caught:
        request.getfixturevalue(which).curve(name)
    assert "\n" not in str(caught.value)


HEARD_FIRST = f"""{OF_PEAKS}
[tests.calm]
[tests.loud]
"""


def test_the_papers_iteration_is_told_of_the_test_and_the_quantities_that_it_iterated(tmp_path, monkeypatch):
    """Nothing of what the others have for themselves may look settled; the first test has no FRFs at the joint."""
    exact = OWN.replace("seed = 1", "seed = 1, added = false")
    case = jb.case_from_text("case", exact + HEARD_FIRST)
    names = case.problem.parametrisation.stiffness_names
    history = jb.identify(case)
    assert (history.test, [names[i] for i in history.iterated]) == ("calm", ["calm.k11", "calm.k12", "calm.k22"])
    assert history.converged
    assert_allclose(history.stiffness[3:6], TABLE_3, rtol=1e-4)
    assert (history.stiffness_history[:, [0, 1, 2, 6, 7, 8]] == case.problem.first_guess[[0, 1, 2, 6, 7, 8]]).all()

    middle = posterior_of(built_own := jb.case_from_text("case", OWN + "[tests.calm]\n[tests.loud]\n"))
    history = jb.identify(built_own)
    told = replace(middle, estimate=replace(middle.estimate, iteration=history))
    blocks = starts_section(ReportInputs(told)).blocks
    (text,) = (block.text for block in blocks if isinstance(block, Paragraph) and "s iteration" in block.text)
    assert "on test calm" in text
    assert "calm.k22 " in text
    assert "loud" not in text
    assert "Quantities that do not act in that test stay at the first guess." in text
    figure = next(block for block in blocks if getattr(block, "identifier", "") == "iteration-stiffness")
    assert "loud" not in figure.alt
    assert figure.svg.count('id="axes_') == 3

    (tmp_path / "case.toml").write_text(OWN + "[tests.calm]\n[tests.loud]\n")
    monkeypatch.setattr("jointbayes.workflow.find_map", lambda *_, **__: told.estimate)
    printed = cli("identify", tmp_path / "case.toml", "--paper").stdout
    head = next(line for line in printed.splitlines() if "iteration" not in line and line.count(" (") == 3)
    assert re.findall(r"\S+ \(", head) == ["calm.k11 (", "calm.k12 (", "calm.k22 ("]
    assert "The paper's iteration on test calm " in printed


def test_what_files_lack_for_the_papers_iteration_is_told_whichever_test_has_them():
    case = jb.case_from_text("case", BASE + HEARD_FIRST)
    known = Provenance((), "receptance", 3, (1.0, 2.0), None, (), (), "stated", iteration="found no FRF at 1:rz")
    tests = [
        replace(one, data=replace(one.data, joint_frf=None, provenance=known if n else None))
        if one.name != "heard"
        else one
        for n, one in enumerate(case.problem.tests)
    ]
    problem = replace(case.problem, tests=tuple(tests))
    assert part_to_iterate(case.problem).test.name == "calm"
    assert part_to_iterate(problem) is None
    assert missing_for_iteration(problem) == "found no FRF at 1:rz"
    with pytest.raises(ModelError, match="found no FRF at 1:rz; use find_map instead"):
        jb.identify(problem)
