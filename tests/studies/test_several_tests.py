"""Studies of a case with several tests: each works, or says in one line that it does not."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import jointbayes as jb
from jointbayes.inference import hypothesis_problem
from jointbayes.studies.campaign import read_cases
from jointbayes.studies.compare import require_same_data
from tests.case.refusal_rows import parts_named
from tests.case.test_several_tests import BASE, CLAMP_EDGE, TWO
from tests.conftest import cli, without_stages
from tests.one_line import refused
from tests.report.test_several_tests import HEARD, OWN, TORQUES
from tests.science.calibration import simulated_problem
from tests.studies.test_calibration_simulation import require_no_score


def case_of(more, base=BASE):
    return jb.case_from_text("case", base + more)


@pytest.mark.science
def test_the_score_at_the_truth_of_simulated_tests_is_zero_in_the_mean():
    """E ∇ ln L = 0 where the data of every test come from its own likelihood."""
    narrow = BASE.replace("low = 1e8, high = 1e12", "low = 4e9, high = 6e9")
    narrow = narrow.replace("low = 1e5, high = 1e9", "low = 3e7, high = 4e7")
    narrow = narrow.replace("low = 1e4, high = 1e8", "low = 1.4e6, high = 1.6e6")
    problem = case_of(CLAMP_EDGE + '[noise]\nscale = "sampled"\nown = true\n' + TWO + HEARD, narrow).problem
    require_no_score(problem, lambda theta, rng: simulated_problem(problem, problem, theta, rng), 200, 1e-6)


def test_hypotheses_are_those_of_every_test():
    springs = hypothesis_problem(case_of(TWO).problem, "springs")
    assert ([part.test.name for part in springs.parts], len(springs.names)) == (["long", "short"], 2)
    own = hypothesis_problem(case_of(TORQUES, OWN).problem, "springs")
    assert len(own.names) == 6
    for one in (springs, own):
        assert np.isfinite(one.log_posterior(one.prior.mean)).all()


def test_cases_are_compared_on_the_data_of_all_their_tests():
    first, same = case_of(TWO), jb.case_from_text("same", CLAMP_EDGE + BASE + TWO)
    require_same_data([first, same])
    other = jb.case_from_text("other", BASE + TWO.replace("200.0", "201.0"))
    refused(lambda: require_same_data([first, other]), jb.CaseError, "found other data in other")


#: Quick to sample: little noise, and few walkers.
SEVERAL = BASE.replace("relative = 0.03", "relative = 0.003") + TWO + "[sampling]\nensembles = 4\nwalkers = 16\n"
MEASURED_TESTS = BASE[: BASE.index("[data]")] + parts_named("several_tests")["measured"]


def campaign(tmp_path, table, base=SEVERAL):
    (tmp_path / "base.toml").write_text(base, encoding="utf-8")
    (tmp_path / "joints.csv").write_text(table, encoding="utf-8")
    command = ["campaign", str(tmp_path / "joints.csv"), "--base", str(tmp_path / "base.toml"), "--workers", "1"]
    return cli(*command, "--out", tmp_path / "out")


@pytest.mark.long
@pytest.mark.science
def test_a_campaign_of_cases_with_tests_samples_each_as_by_itself(tmp_path):
    columns = "key,data.truth.k22,data.noise.seed,tests.short.structure.length_mm"
    ended = campaign(tmp_path, f"{columns}\na,1.40e6,1,200\nb,1.45e6,2,201\nc,1.5e6,3,\n")
    assert ended.exit_code == 0, ended.output
    assert "3 cases: 3 done, 0 failed, 0 not converged" in ended.stdout
    done = jb.Campaign(tmp_path / "out")
    posterior = done.posterior("b")
    lengths = [test.structures.recipe.length for test in posterior.problem.tests]
    assert [test.name for test in posterior.problem.tests] == ["long", "short"]
    assert lengths == pytest.approx([0.383, 0.201])
    for key, truth in (("a", 1.40e6), ("b", 1.45e6), ("c", 1.5e6)):
        assert done.index.loc[key, "k22.low95"] < truth < done.index.loc[key, "k22.high95"]
    settings = posterior.case.sampler.for_one_of_many()
    again = jb.sample(posterior.case, seed=int(done.index.loc["b"]["seed"]), settings=settings)
    assert_array_equal(again.theta, posterior.theta)


def test_a_fault_in_a_test_of_a_campaign_names_row_and_column(tmp_path):
    ended = campaign(tmp_path, "key,tests.short.structure.length_mm\na,200\nb,-3\n")
    assert ended.exit_code == 2
    (line,) = without_stages(ended.stderr)
    assert line.startswith(f"jointbayes: {tmp_path}/joints.csv:3: tests.short.structure.length_mm: found -3; expected")


def test_files_of_tests_make_a_campaigns_case_and_stay_inside(tmp_path):
    case_file = tmp_path / "case.toml"
    case_file.write_text(MEASURED_TESTS, encoding="utf-8")
    (case,) = read_cases([case_file])
    before = case.work(1, False)
    (tmp_path / "second.uff").write_text("other", encoding="utf-8")
    assert case.work(1, False)[2] != before[2]
    case_file.write_text(MEASURED_TESTS.replace("second.uff", "../second.uff"), encoding="utf-8")
    with pytest.raises(jb.CaseError, match=r'tests.second.data.file: found "../second.uff", which leads out'):
        read_cases([case_file])


def test_published_values_are_those_of_joints_that_tests_share():
    reference = '[reference]\nk11 = 5e9\nk12 = 3e7\nk22 = 1.5e6\nsource = "a paper"\n'
    assert case_of(reference + TWO).reference is not None
    refused(lambda: case_of(reference + TORQUES, OWN), jb.CaseError, "reference: found stiffnesses to compare with")
