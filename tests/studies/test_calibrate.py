"""Calibration of a case as a user asks for it: what is refused, what is judged, what is written."""

import csv
import dataclasses
import io
import json
import pickle
from types import SimpleNamespace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.studies import calibration as driver
from jointbayes.studies import data_sets
from jointbayes.studies.calibration import FALSE_ALARM, calibration_lines, calibration_table, ranks_csv
from jointbayes.studies.data_sets import DENSITY, DRAWS, DataSet, analyse
from jointbayes.workflow import sample_quickly
from tests.conftest import cli
from tests.posterior.test_decision import of_another_truth
from tests.studies.calibration_cases import EXACT, FREQUENCIES, Here, small_case, write_case

SETTINGS = jb.SamplerSettings(walkers=16, check_every=20, max_steps=40)
COUNT = 4


def calibrated(count=COUNT, case=None, **options):
    return jb.calibrate(case or small_case(), count, **{"settings": SETTINGS, "executor": Here(), **options})


@pytest.fixture(scope="module")
def done():
    return calibrated()


def synthetic(rank_of, count=400, seed=1, names=("k11", "k12", "k22", DENSITY), **fields):
    """A calibration whose ranks a function draws."""
    rng = np.random.default_rng(seed)
    sets = []
    for i in range(count):
        ranks = tuple(int(rank_of(rng)) for _ in names)
        ones = (1.0,) * len(names)
        sets.append(DataSet(i, 0.1, ones, ranks, (0.5,) * len(names), (1.5,) * len(names), True, True, 900.0, **fields))
    return jb.Calibration("case", "", 1, names, tuple(sets))


def uniform(rng):
    return rng.integers(0, DRAWS + 1)


@pytest.mark.whole
def test_quantities_are_those_that_the_prior_leaves_open(done):
    assert done.names == ("k11", "k12", "k22", DENSITY)
    signed = 'joint.parametrisation = "signed"\n'
    coupling = 'distribution = "log_normal"\nmedian = 5.0e6\nsd_log = 0.5'
    text = small_case().text.replace("[prior.k12]", "[prior.rho]")
    text = text.replace(coupling, 'distribution = "uniform"\nlow = -0.9\nhigh = 0.9')
    case = jb.case_from_text("signed", signed + text)
    assert data_sets.quantity_names(case.problem, case.problem) == ("k11", "k12", "k22", "rho", DENSITY)


def test_a_log_density_is_ranked_only_where_both_cases_have_the_same_coordinates():
    here = small_case("[uncertain.length]\nsd_percent = 0.5\n").problem
    assert data_sets.quantity_names(here, small_case().problem) == ("k11", "k12", "k22")


@pytest.mark.whole
def test_a_data_set_depends_on_seed_and_number_alone(done):
    job = driver._job(small_case(), None, SETTINGS, None, print)
    again, other = analyse(job, 3), analyse(dataclasses.replace(job, seed=2), 3)
    assert (again.rank, again.truth) == (done.data_sets[3].rank, done.data_sets[3].truth)
    assert other.truth != again.truth
    assert len({one.truth for one in done.data_sets}) == COUNT


@pytest.mark.whole
def test_a_rank_is_the_share_of_draws_below_the_truth(done):
    for one in done.data_sets:
        for truth, rank, low, high in zip(one.truth, one.rank, one.low, one.high, strict=True):
            assert (rank < 0.2 * DRAWS) or truth > low
            assert (rank > 0.8 * DRAWS) or truth < high


def analysed_near(case, index, monkeypatch):
    """The problem that is sampled for a data set near the data, and its truth, the middle of the prior."""
    sampled = []

    def sample(problem, **_options):
        sampled.append(problem)
        raise jb.ModelError("seen")

    monkeypatch.setattr(data_sets, "sample", sample)
    job = driver._job(case, None, SETTINGS, None, print)
    analyse(dataclasses.replace(job, truths=np.tile(job.source.prior.mean, (index + 1, 1))), index)
    return sampled[0]


@pytest.mark.parametrize("text", [small_case().text, EXACT])
def test_near_the_data_a_posterior_is_that_of_both_data_sets(text, monkeypatch):
    # of Gaussian noise two measurements are one: their mean, with half the variance
    case = small_case(text=text)
    both, data = analysed_near(case, 2, monkeypatch), case.problem.test.data
    if data.frfs is not None:
        mean = dataclasses.replace(
            data.with_values((data.frf.values + both.test.data.frf.values) / 2), variance=data.variance / 2
        )
    else:
        values = (data.frequency_hz + both.test.data.frequency_hz) / 2
        mean = dataclasses.replace(data, frequency_hz=values, sd_hz=data.sd_hz / np.sqrt(2))
    theta = case.problem.prior.sample(np.random.default_rng(0), 50)
    expected = case.problem.with_test(data=mean).log_posterior(theta)
    apart = both.log_posterior(theta) - expected
    np.testing.assert_allclose(apart, apart[0], atol=1e-8 * np.ptp(expected))


def test_near_the_data_truths_are_draws_of_the_posterior_whatever_their_number(monkeypatch):
    theta, seeds = np.arange(30.0).reshape(10, 3), []

    def sample(case, *, seed, progress):
        seeds.append(seed)
        return SimpleNamespace(theta=theta, converged=case.name != "bad", reason="too short", problem=case.problem)

    monkeypatch.setattr(driver, "sample", sample)
    few, all_, more = (driver._truths_near(small_case(), n, 5, print) for n in (4, 10, 13))
    assert (few == all_[:4]).all()
    assert (more[:10] == all_).all()
    assert (sorted(all_[:, 0]), seeds) == (theta[:, 0].tolist(), [5, 5, 5])
    with pytest.raises(jb.SamplingError, match=r"posterior of bad, .*not converged \(too short\)"):
        driver._truths_near(small_case(name="bad"), 1, 5, print)


@pytest.mark.whole
def test_an_analysis_that_fails_is_counted_and_not_left_out(monkeypatch):
    def sometimes(problem, **options):
        if sometimes.count % 2:
            sometimes.count += 1
            raise jb.MeasurementError("on purpose")
        sometimes.count += 1
        return sample(problem, **options)

    sample, sometimes.count = data_sets.sample, 0
    monkeypatch.setattr(data_sets, "sample", sometimes)
    found = calibrated()
    assert (found.failed, len(found.analysed), len(found.data_sets)) == (2, 2, 4)
    assert found.quantities[0].coverage.total == 4
    assert "2 of 4 analyses failed" in found.notes[0]
    assert found.errors == ("MeasurementError: on purpose",)


def test_samplers_that_do_not_converge_are_ranked_and_counted():
    rng = np.random.default_rng(4)
    ranked = synthetic(uniform, count=60)
    sets = tuple(dataclasses.replace(one, converged=bool(rng.integers(2))) for one in ranked.data_sets)
    found = jb.Calibration("case", "", 1, ranked.names, sets)
    assert 0 < found.not_converged < 60
    assert found.quantities[0].ranks.size == 60
    assert "did not converge" in found.notes[0]
    assert found.summary()["converged"] == 60 - found.not_converged


def test_not_one_posterior_is_an_error_in_a_line():
    with pytest.raises(jb.ModelError, match=r"not one of 1 data sets .* on purpose"):
        jb.Calibration("case", "", 1, ("k11",), (DataSet(0, 0.0, error="on purpose"),))


@pytest.mark.whole
def test_right_analyses_fail_no_more_often_than_stated():
    # independent quantities are the worst case of the bound: 0 to 5 failures of 100 hold all but 1 in 2000 of the cases
    assert sum(not synthetic(uniform, count=30, seed=i).passed for i in range(100)) <= 5


def test_a_wrong_analysis_fails_and_the_verdict_says_how():
    found = synthetic(lambda rng: np.clip(round(31.5 + 1.6 * (uniform(rng) - 31.5)), 0, DRAWS))
    assert not found.passed
    assert found.verdict.startswith("NOT CALIBRATED: over 400 data sets the ranks of 4 of 4 quantities leave their")
    assert "k22: posteriors are too narrow" in found.verdict
    assert "OUTSIDE: posteriors are too narrow" in calibration_table(found).rows[0][1]
    assert found.answer.startswith("The intervals can NOT be trusted: of 400 data sets the 95 % interval held ")
    near = dataclasses.replace(found, near=True)
    assert near.answer.startswith("The intervals can NOT be trusted near these data: of 400 data sets ")


def test_a_suspicious_calibration_passes_and_says_what_to_do():
    seeds = (synthetic(uniform, count=30, seed=i) for i in range(200))
    found = next(one for one in seeds if FALSE_ALARM < one.p_value < 0.05)
    assert found.passed
    assert "look at another seed" in found.verdict


def test_a_directory_holds_report_numbers_and_ranks(done, tmp_path):
    done.write(tmp_path / "out")
    names = {str(p.relative_to(tmp_path / "out")) for p in (tmp_path / "out").rglob("*") if p.is_file()}
    assert names - {".jointbayes"} == {
        "references.bib",
        "report.html",
        "report.pdf",
        "summary.json",
        "ranks.csv",
        "case.toml",
        "figures/ranks.svg",
        "figures/structure.svg",
    }
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert (summary["data_sets"], (summary["answer"], summary["verdict"])) == (COUNT, (done.answer, done.verdict))
    assert calibration_lines(done)[:2] == [done.answer, done.verdict]
    assert done.verdict.split(":")[0] in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


def test_the_table_of_ranks_has_a_row_for_every_data_set_failed_or_not():
    sets = (*synthetic(uniform, count=2).data_sets, DataSet(2, 0.1, error='no, "really"'))
    found = jb.Calibration("case", "", 1, ("k11", "k12", "k22", DENSITY), sets)
    rows = list(csv.DictReader(io.StringIO(ranks_csv(found))))
    assert [row["status"] for row in rows] == ["done", "done", "failed"]
    assert (int(rows[1]["k22.rank"]), rows[2]["error"], rows[2]["k11.rank"]) == (sets[1].rank[2], 'no, "really"', "")


def test_a_job_is_sent_without_what_was_computed_from_it():
    case = small_case()
    case.problem.log_posterior(case.problem.prior.mean)
    packed = driver._packed(driver._job(case, None, SETTINGS, None, print))
    assert "log_posterior" not in vars(pickle.loads(packed).analysis)


def test_natural_frequencies_are_calibrated_as_well():
    found = calibrated(1, case=small_case(text=EXACT))
    assert found.failed == 0
    assert all(len(one.rank) == len(found.names) for one in found.data_sets)
    assert found.names == ("k11", "k12", "k22", DENSITY)


@pytest.mark.whole
@pytest.mark.parametrize("kind", ["typed", "measured"])
def test_what_is_calibrated_is_what_a_run_answers_by(kind, monkeypatch, cheap_case):
    """With an error of the model, all else as in a workshop; of measured FRFs by their modes; drawn as a run draws."""
    case = small_case(text=FREQUENCIES) if kind == "typed" else of_another_truth(cheap_case, "length_mm = 383.5")
    drawn = []

    def quickly(*of, **how):
        drawn.append(sample_quickly(*of, **how))
        return drawn[-1]

    monkeypatch.setattr(data_sets, "sample_quickly", quickly)
    found = calibrated(1, case=case, seed=3)
    assert found.failed == 0, found.data_sets[0].error
    freed = ("youngs_modulus", "density", "length") if kind == "typed" else ()  # the other case declares them exact
    assert set(found.names) == {"k11", "k12", "k22", *freed, DENSITY}
    (posterior,) = drawn
    run = jb.sample(case, seed=3)
    assert posterior.problem.premises == run.problem.premises
    (test,), (its,) = posterior.problem.tests, run.problem.tests
    assert (test.noise.sizes, test.data.modes.numbers) == (its.noise.sizes, its.data.modes.numbers)
    assert (test.data.modes.values != its.data.modes.values).all()
    np.testing.assert_allclose(test.data.modes.values, its.data.modes.values, rtol=0.5)


def test_a_calibration_near_the_data_has_a_directory_and_a_report_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_case(tmp_path / "case.toml", small_case())
    asked = []

    def calibrate(*_args, **options):
        asked.append(options["near"])
        return dataclasses.replace(synthetic(uniform, count=60), near=options["near"])

    monkeypatch.setattr(driver, "calibrate", calibrate)
    result = cli("calibrate", "case.toml", "--near")
    assert result.exit_code == 0, result.output
    assert asked == [True]
    assert "Calibrated near the data: over 60 data sets" in result.output
    directory = tmp_path / "reports" / "case-calibration-near"
    assert json.loads((directory / "summary.json").read_text(encoding="utf-8"))["truths_from"] == "posterior"
    page = (directory / "report.html").read_text(encoding="utf-8")
    assert "2502.03279" in (directory / "references.bib").read_text(encoding="utf-8")
    assert "from the priors of" not in page
