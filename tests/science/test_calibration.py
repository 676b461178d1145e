"""A sample of `make science`: ranks of truths from the prior are uniform, and intervals hold them."""

import dataclasses
import json

import numpy as np
import pytest
from benchmarks import calibration, calibration_page
from benchmarks.calibration import DENSITY, KEPT, analyse, outcomes, results, summary
from benchmarks.calibration_data import VARIANTS, case_of, draw_data

from jointbayes.joint import joint_matrix

pytestmark = pytest.mark.science

COUNT = 14


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    return tmp_path_factory.mktemp("calibration") / "joint.jsonl"


@pytest.fixture(scope="module")
def joint(kept):
    return outcomes("joint", COUNT, kept=kept)


def test_ranks_of_truths_are_uniform_and_intervals_hold_them(joint):
    judged = results(joint)
    assert [r.name for r in judged] == ["k11", "k12", "k22", DENSITY]
    for one in judged:
        assert one.p_value > 0.001, one.name
        assert one.coverage.interval95[1] >= 0.95, one.name


def test_every_analysis_of_the_sample_converges(joint):
    assert all(one.converged and not one.error and one.ess > 800 for one in joint)


def test_narrower_posteriors_would_be_noticed_in_as_few_data_sets(joint):
    # each rank made that of a posterior of half the width: further from the middle, in normal scores
    from scipy import stats

    def narrowed(rank):
        score = stats.norm.ppf((np.array(rank) + 0.5) / (KEPT + 1))
        return tuple(np.floor(stats.norm.cdf(3 * score) * (KEPT + 1)).astype(int).tolist())

    wrong = results([dataclasses.replace(one, rank=narrowed(one.rank)) for one in joint])
    assert min(one.p_value for one in wrong) < 0.001


def test_a_run_that_was_cut_off_goes_on_where_it_was(joint, kept, monkeypatch):
    lines = kept.read_text(encoding="utf-8").splitlines()
    kept.write_text("\n".join([*lines[:5], lines[5][:40]]) + "\n", encoding="utf-8")
    asked = []

    def known(task):
        asked.append(task[1])
        return joint[task[1]]

    monkeypatch.setattr(calibration, "analyse", known)
    again = outcomes("joint", 8, kept=kept)
    assert asked == [4, 5, 6, 7]
    assert again == joint[:8]


def test_outcomes_of_another_case_are_not_mixed_in(joint, kept):
    kept.write_text(json.dumps({"case": "another"}) + "\n" + json.dumps(dataclasses.asdict(joint[0])) + "\n")
    assert outcomes("joint", 0, kept=kept) == []
    assert "another" not in kept.read_text(encoding="utf-8")


def test_a_data_set_depends_on_its_number_only(joint):
    assert analyse(("joint", 3)).rank == joint[3].rank
    assert len({one.truth for one in joint}) == COUNT


@pytest.mark.parametrize("variant", list(VARIANTS))
def test_data_come_from_the_prior_and_the_likelihood(variant):
    rng = np.random.default_rng(4)
    fixed = case_of(variant).problem
    chi2 = []
    for _ in range(30):
        data = draw_data(variant, rng)
        problem = data.case.problem
        # the stated variance knows nothing of the truth
        assert (problem.measurement.variance == fixed.measurement.variance).all()
        likelihood, factors = problem.log_posterior.likelihood, problem.prior.factors(data.theta)[None]
        z = likelihood.standardised(joint_matrix(problem.prior.stiffness(data.theta))[None], factors)
        white = likelihood.noise.whiten(z, likelihood.hyper(factors)[0])
        chi2.append(2 * np.sum(np.abs(white) ** 2))
    values = 2 * z.size
    assert np.mean(chi2) == pytest.approx(values, abs=4 * np.sqrt(2 * values / 30))


def test_page_and_figure_say_what_was_found(joint, tmp_path, monkeypatch):
    judged = results(joint)
    data = calibration.merged(None, "joint", summary(joint, judged), False)["joint"]
    text = calibration_page.section("joint", data)
    assert f"{COUNT} data sets" in text
    assert f"| k22 | yes | {judged[2].p_value:.3f} |" in text
    monkeypatch.setattr(calibration_page, "FIGURES", tmp_path / "figures")
    calibration_page.write_figure("joint", judged)
    assert "<svg" in (tmp_path / "figures" / "calibration-joint.svg").read_text(encoding="utf-8")
    page = calibration_page.between(f"a\n{calibration_page.BEGIN}\nearlier\n{calibration_page.END}\nb\n", text)
    assert "earlier" not in page
    assert page.startswith("a\n")
    assert page.endswith("b\n")


FINISHED = 500


@pytest.mark.skipif(not calibration_page.SUMMARY.exists(), reason="`make science` has not been run")
def test_the_published_study_finds_every_parameter_calibrated():
    found = json.loads(calibration_page.SUMMARY.read_text(encoding="utf-8"))
    page = calibration_page.PAGE.read_text(encoding="utf-8")
    finished = {variant: data for variant, data in found.items() if data["count"] >= FINISHED}
    tested = sum(len(one["parameters"]) for one in finished.values())
    assert "joint" in finished
    for variant, data in found.items():
        assert calibration_page.section(variant, data) in page
    # an unfinished variant stands on the page with its figures; it is no verdict yet, for or against
    for variant, data in finished.items():
        for name, row in data["parameters"].items():
            assert row["p_value"] > 0.05 / tested, (variant, name)
            low, high = row["coverage_interval95"]
            assert low <= 0.97, (variant, name)
            assert high >= 0.93, (variant, name)
