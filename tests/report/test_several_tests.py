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
from jointbayes.report.contents import PAGES
from jointbayes.report.inputs import ReportInputs
from jointbayes.report.model import Figure, Paragraph
from jointbayes.report.sections.run_details import starts_section
from jointbayes.report.sections.several_tests import ratios_of_tests, section_of_test
from tests.case.refusal_rows import parts_named
from tests.case.test_several_tests import BASE, CLAMP_EDGE, TWO
from tests.case.test_several_tests import HEARD as OF_PEAKS
from tests.conftest import TABLE_3, cli
from tests.report.conftest import posterior_about
from vibrecords.provenance import Provenance

HEARD = parts_named("rooms")["report/several_tests heard"]
TORQUES = parts_named("rooms")["report/several_tests torques"]
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
    summary = json.loads(json.dumps(summary_of(overhangs).to_dict(), allow_nan=False))
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
    assert posterior.summary().to_dict()["tests"] == {}
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
    assert loaded.summary().to_dict()["tests"] == summary_of(overhangs).to_dict()["tests"]


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
def test_figures_of_each_test_have_identifiers_of_their_own(overhangs):
    sections = [
        section_of_test(n, one, [made for page in PAGES for section in page[3] if (made := section(one)) is not None])
        for n, one in enumerate(inputs_of(overhangs).tests, 1)
    ]
    figures = [block.identifier for one in sections for block in one.blocks if isinstance(block, Figure)]
    assert len(set(figures)) == len(figures)
    assert {"test-1-frf-0-0", "test-2-frf-1-0", "test-3-frequencies-plot"} <= set(figures)
    assert "test-1-frf-1-0" not in figures  # its second output is measured in the other test only


def test_what_is_each_tests_own_has_a_ratio_and_what_they_share_has_none(torques, overhangs):
    assert ratios_of_tests(overhangs) == ()
    (table,) = ratios_of_tests(torques)
    rows = {row[:2]: row[2:] for row in table.rows}
    assert len(rows) == 6  # three quantities of two further tests
    median, ends = rows["k22", "loose over tight"]
    assert float(median) == pytest.approx(0.6e6 / 2.2e6, rel=0.01)
    low, high = map(float, ends.split(" to "))
    assert high / low == pytest.approx(np.exp(2 * 1.96 * 0.01 * np.sqrt(2)), rel=0.02)  # two independent draws
    assert float(rows["k11", "usual over tight"][0]) == pytest.approx(1.0, rel=0.01)


def test_a_quantity_of_either_sign_has_no_ratio(torques):
    tree = torques.tree.copy()
    signed = torques["loose.k12"] * np.where(np.arange(torques["loose.k12"].sizes["draw"]) % 2, 1.0, -1.0)
    tree["posterior"] = xr.DataTree(torques.draws.assign({"loose.k12": signed}))
    (table,) = ratios_of_tests(dataclasses.replace(torques, tree=tree))
    assert ("k12", "loose over tight") not in {row[:2] for row in table.rows}
    assert len(table.rows) == 5


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
