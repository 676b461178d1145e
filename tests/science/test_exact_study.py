"""A sample of the study with data of an exact beam: intervals hold the truth, the mode is found, bounds are crossed."""

import json

import numpy as np
import pytest
from benchmarks import exact_study
from benchmarks.exact_data import BOUNDS, NAMES, SUBJECTS, beyond, draw
from scipy import stats

import jointbayes as jb
from jointbayes.identification import refine
from tests.conftest import pair_matrix

pytestmark = pytest.mark.science

#: Fewer lines, and walkers that are enough for three stiffnesses.
STEPS = {"main": 10.0, "small rod": 60.0, "tube": 4.0, "bar": 12.0}
EACH = 3
#: A sample this improbable is no chance.
IMPROBABLE = 1e-3


def _edits(subject):
    return ("f_step_hz", str(STEPS[subject])), ("walkers", "16")


@pytest.mark.long
def test_intervals_hold_the_truth_of_an_exact_beam():
    found = exact_study.summary([exact_study.analysed("main", index, _edits("main")) for index in range(1, EACH + 1)])
    assert found["converged"] == EACH
    assert found["explains"] >= EACH - 1
    for name, held in found["held"].items():
        # a study that misses three of four truths would be noticed
        assert stats.binom.cdf(EACH // 4, EACH, 0.95) < IMPROBABLE < stats.binom.cdf(held, EACH, 0.95), name
        assert found["wrong_identified"][name] == 0, name


@pytest.mark.long
def test_a_stiffness_beyond_its_bound_is_not_called_identified():
    found = exact_study.summary([exact_study.analysed(exact_study.BEYOND, 1, _edits("main"))])
    assert sum(found["beyond"].values()) == 1
    assert found["beyond_identified"] == 0


def test_the_mode_is_found():
    data = draw("main", 0, _edits("main"))
    _, from_truth = refine(data.case.problem.log_posterior, np.log(data.truth))
    assert jb.find_map(data.case).log_posterior > from_truth - 1.0


@pytest.mark.parametrize("subject", SUBJECTS)
def test_data_differ_from_the_true_joints_frf_by_the_stated_noise(subject):
    squares = []
    for index in range(4):
        data = draw(subject, index, _edits(subject))
        problem = data.case.problem
        z = problem.log_posterior.likelihood.standardised(pair_matrix(data.truth)[None], np.ones((1, 0)))
        squares.append(np.mean(np.abs(z) ** 2))
    # 2000 complex values and more; a mesh, section or material that is not the exact beam's shows here
    assert np.mean(squares) == pytest.approx(1.0, abs=0.08)
    assert len({tuple(draw(subject, i, _edits(subject)).truth) for i in (0, 1)}) == 2


@pytest.mark.parametrize("index", range(len(BOUNDS)))
def test_truths_lie_beyond_the_bound_that_is_named_and_inside_the_others(index):
    (name, end, factor), data = beyond(index, _edits("main"))
    support = np.exp(data.case.problem.prior.support)
    truth = dict(zip(NAMES, data.truth, strict=True))
    for low, high, one in zip(*support, NAMES, strict=True):
        if one != name:
            assert low <= truth[one] <= high
        else:
            assert truth[one] == pytest.approx(low / factor if end == "low" else high * factor)
    assert np.linalg.eigvalsh(pair_matrix(data.truth))[0] > 0


def test_the_published_study_holds_what_the_page_asks_for():
    found = json.loads(exact_study.STUDY.record.read_text(encoding="utf-8"))
    beyond_bounds = found.pop(exact_study.BEYOND)
    assert (beyond_bounds["sets"], beyond_bounds["beyond_identified"]) == (40, 0)
    assert found.keys() == SUBJECTS.keys()
    for data in found.values():
        assert (data["sets"], data["converged"]) == (100, 100)
        assert all(92 <= held <= 98 for held in data["held"].values())
        assert not any(data["wrong_identified"].values())
