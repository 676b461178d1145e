"""A sample of `make science`: ranks of truths from the prior are uniform, and a wrong analysis is found out."""

import dataclasses
import json

import numpy as np
import pytest
from benchmarks import calibration_page
from benchmarks.calibration_data import VARIANTS, case_of
from benchmarks.record import merged
from scipy import stats

import jointbayes as jb
from jointbayes.frf import DirectSolve, Ports
from jointbayes.posterior.prediction import simulated_values
from jointbayes.studies import data_sets
from jointbayes.studies.data_sets import DENSITY
from tests.conftest import cli, first_in_ci, pair_matrix
from tests.studies.calibration_cases import EXACT, FREQUENCIES, Here, noisier_case, small_case, write_case

pytestmark = pytest.mark.science

COUNT = 30


@pytest.fixture(scope="module")
def right():
    return jb.calibrate(small_case(), COUNT, seed=3, workers=2)


def test_ranks_of_truths_are_uniform_and_intervals_hold_them(right):
    assert right.passed, right.verdict
    assert [one.name for one in right.quantities] == ["k11", "k12", "k22", DENSITY]
    assert all(one.coverage.interval95[1] >= 0.95 for one in right.quantities)
    assert (right.failed, right.not_converged) == (0, 0)
    assert min(one.ess for one in right.data_sets) > 800


@pytest.mark.long
def test_a_case_whose_data_have_three_times_the_noise_exits_1(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_case(tmp_path / "small.toml", small_case())
    write_case(tmp_path / "noisier.toml", noisier_case(3.0))
    arguments = ["calibrate", "small.toml", "--data-from", "noisier.toml", "--n", str(COUNT), "--workers", "2"]
    result = cli(*arguments)
    assert result.exit_code == 1, result.output
    assert "posteriors are too narrow" in result.output
    summary = json.loads((tmp_path / "reports/small-calibration-by-noisier/summary.json").read_text(encoding="utf-8"))
    assert summary["data_from"] == "noisier"
    assert not summary["passed"]


@pytest.mark.long
def test_a_simulator_with_twice_the_noise_is_noticed(monkeypatch):
    def louder(problem, theta, rng, noise):
        exact = simulated_values(problem, theta, Silent())
        return exact + 2 * (simulated_values(problem, theta, rng, noise) - exact)

    monkeypatch.setattr(data_sets, "simulated_values", louder)
    found = jb.calibrate(small_case(), COUNT, executor=Here())
    assert not found.passed
    assert DENSITY in {one.name for one in found.outside}


FEW = 12


def precise_frequencies(extra="", text=EXACT):
    """Natural frequencies to 0.2 %, far more than the prior says."""
    text = text.replace("sd_relative = 0.02\nsd_hz = 1.0", "sd_relative = 0.002")
    assert "sd_relative = 0.002\n" in text
    return small_case(extra, text=text)


@pytest.mark.long
@pytest.mark.parametrize("text", [EXACT, FREQUENCIES])
def test_near_the_data_a_right_analysis_is_calibrated(text):
    found = jb.calibrate(precise_frequencies(text=text), FEW, near=True, seed=3, workers=2)
    assert found.passed, found.verdict
    assert (found.failed, found.not_converged) == (0, 0)
    assert min(one.p_value for one in found.quantities) > 0.01


@pytest.mark.long
def test_near_the_data_one_process_or_two_give_the_same():
    case, settings = precise_frequencies(), jb.SamplerSettings(walkers=16, check_every=20, max_steps=40)
    options = {"near": True, "settings": settings}
    one, two = (jb.calibrate(case, n, **options, **of) for n, of in ((2, {"executor": Here()}), (3, {"workers": 2})))
    for first, second in zip(one.data_sets, two.data_sets, strict=False):
        assert dataclasses.replace(first, seconds=0.0) == dataclasses.replace(second, seconds=0.0)


@pytest.mark.parametrize(("factor", "scatter"), first_in_ci([(1.0, 3.0), (1.01, 1.0)], 1))
def test_near_the_data_a_factor_of_one_per_cent_or_too_narrow_a_noise_is_noticed(factor, scatter, monkeypatch):
    def simulated(problem, theta, rng, noise):
        exact = simulated_values(problem, theta, Silent())
        return factor * (exact + scatter * (simulated_values(problem, theta, rng, noise) - exact))

    monkeypatch.setattr(data_sets, "simulated_values", simulated)
    found = jb.calibrate(precise_frequencies(), FEW, near=True, executor=Here())
    assert not found.passed
    assert "NOT CALIBRATED near the data" in found.verdict


class Silent:
    """A generator of no noise."""

    def standard_normal(self, shape):
        return np.zeros(shape)


def test_sampled_draws_that_are_a_little_too_narrow_are_noticed_in_the_ranks(right):
    # each rank made that of a posterior of half the width: further from the middle, in normal scores
    def narrowed(rank):
        score = stats.norm.ppf((np.array(rank) + 0.5) / (data_sets.DRAWS + 1))
        return tuple(np.floor(stats.norm.cdf(3 * score) * (data_sets.DRAWS + 1)).astype(int).tolist())

    each = tuple(dataclasses.replace(one, rank=narrowed(one.rank)) for one in right.data_sets)
    assert not dataclasses.replace(right, data_sets=each).passed


@pytest.mark.parametrize("variant", ["nuisances", "all"])
def test_data_lie_about_the_dense_solution(variant):
    problem = case_of(variant).problem
    theta = problem.prior.sample(np.random.default_rng(4), 1)[0]
    structure = problem.test.structures.structure(problem.structural(problem.prior.factors(theta)))
    frf = problem.test.data.frf
    dense = DirectSolve(structure, problem.test.joints, Ports(frf.frequency_hz, frf.outputs, frf.inputs))
    expected = dense.receptance(pair_matrix(problem.prior.values(theta)))[0]
    np.testing.assert_allclose(simulated_values(problem, theta, Silent()), expected, rtol=1e-6)


def test_page_and_figure_say_what_was_found(right, tmp_path, monkeypatch):
    data = merged(None, "joint", right.summary(), False)["joint"]
    assert calibration_page.row_of("joint", data)[:3] == ("joint", f"{COUNT} ({data['converged']})", "none of 4")
    text = calibration_page.page_text({"joint": data})
    assert f"| joint | {COUNT} ({data['converged']}) | none of 4 |" in text
    monkeypatch.setattr(calibration_page, "FIGURES", tmp_path / "figures")
    calibration_page.write_figure("joint", right.quantities)
    assert "<svg" in (tmp_path / "figures" / "calibration-joint.svg").read_text(encoding="utf-8")
    page = calibration_page.between(f"a\n{calibration_page.BEGIN}\nearlier\n{calibration_page.END}\nb\n", text)
    assert "earlier" not in page
    assert page.startswith("a\n")
    assert page.endswith("b\n")


FINISHED = 500


@pytest.mark.skipif(not calibration_page.SUMMARY.exists(), reason="`make science` has not been run")
def test_the_published_study_finds_every_variant_calibrated():
    found = json.loads(calibration_page.SUMMARY.read_text(encoding="utf-8"))
    page = calibration_page.PAGE.read_text(encoding="utf-8")
    assert {"joint"} <= found.keys() <= VARIANTS.keys()
    assert calibration_page.page_text(found) in page
    for variant, data in found.items():
        if data["data_sets"] < FINISHED:
            continue  # it stands on the page with its figures; it is no verdict yet, for or against
        assert data["passed"], variant
        for name, row in data["quantities"].items():
            low, high = row["coverage_interval95"]
            assert low <= 0.97, (variant, name)
            assert high >= 0.93, (variant, name)
