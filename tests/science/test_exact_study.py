"""A sample of the study with data of an exact beam: intervals hold the truth, the mode is found, bounds are crossed."""

import json
from dataclasses import replace

import numpy as np
import pytest
from benchmarks import exact_page, exact_study
from benchmarks.exact_data import BOUNDS, NAMES, SUBJECTS, base_case, beyond, draw
from benchmarks.exact_study import PARTS, outcomes
from scipy import stats

from tests.conftest import pair_matrix

pytestmark = pytest.mark.science

#: Fewer lines, and walkers that are enough for three stiffnesses.
STEPS = {"main": 10.0, "small rod": 60.0, "tube": 4.0, "bar": 12.0}
EACH = 3
#: A sample this improbable is no chance.
IMPROBABLE = 1e-3


def _edits(subject):
    return ("f_step_hz", str(STEPS[subject])), ("walkers", "16")


@pytest.fixture(scope="module")
def sample():
    """Outcomes of the part "coverage" for the main case."""
    return outcomes("coverage", "main", EACH, edits=_edits("main"))


@pytest.fixture(scope="module")
def judged(sample):
    return exact_page.coverage_summary(sample)


@pytest.mark.long
def test_intervals_hold_the_truth_of_an_exact_beam(judged):
    assert judged["failed"] == []
    for name, row in judged["stiffness"].items():
        assert stats.binom.cdf(row["held95"], judged["count"], 0.95) > IMPROBABLE, name
        assert row["wrong_identified"] == 0, name


@pytest.mark.long
def test_intervals_that_miss_three_of_four_truths_would_be_noticed(judged):
    assert stats.binom.cdf(judged["count"] // 4, judged["count"], 0.95) < IMPROBABLE


@pytest.mark.long
def test_every_run_of_the_sample_converges_and_explains_the_data(judged):
    assert judged["converged"] == judged["mode_agrees"] == judged["count"]
    # the check is wrong in one of twenty by its own level
    assert stats.binom.cdf(judged["explains"], judged["count"], 0.95) > IMPROBABLE


def test_the_mode_is_found():
    found = exact_page.mode_summary(outcomes("mode", "main", 1, edits=_edits("main")))
    assert found["failed"] == []
    assert found["missed"] == {}


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


def test_a_run_that_was_cut_off_goes_on_where_it_was(tmp_path, monkeypatch):
    kept, edits = tmp_path / "coverage.jsonl", _edits("main")
    asked = []
    one = exact_study.Outcome(0, 2.0, {})

    def known(task):
        asked.append(task.index)
        return replace(one, index=task.index)

    monkeypatch.setattr(exact_study, "run", known)
    whole = outcomes("coverage", "main", 4, edits=edits, kept=kept)
    lines = kept.read_text(encoding="utf-8").splitlines()
    kept.write_text("\n".join([*lines[:3], lines[3][:40]]), encoding="utf-8")
    for again in ([2, 3], []):
        asked.clear()
        assert outcomes("coverage", "main", 4, edits=edits, kept=kept) == whole
        assert asked == again
    # outcomes of another case are not mixed in
    assert len(outcomes("coverage", "main", 1, edits=_edits("bar"), kept=kept)) == 1
    assert asked == [0]


def test_a_key_that_is_not_in_the_case_is_refused():
    with pytest.raises(ValueError, match="found no_such_key 0 times"):
        base_case("main", (("no_such_key", "1"),))


def _stiffness(verdict, low, high, error=None):
    ends = {"interval95": [low, high], "interval999": [low / 1.1, high * 1.1], "error95": error}
    said = {"verdict": verdict, "verdict_reason": "", "if_model_right": verdict == "weakly identified"}
    return {"truth": 1.0} | ends | said


def _outcome(index, *stiffness, **more):
    known = {"index": index, "seconds": 2.0, "error": "", "converged": True, "mode_agrees": True, "explains": True}
    return known | {"stiffness": dict(zip(NAMES, stiffness, strict=True))} | more


def test_summaries_count_what_they_say():
    good, near, far = (_stiffness("identified", *ends) for ends in ((0.9, 1.1), (1.05, 1.2), (1.5, 1.6)))
    held = exact_page.coverage_summary([_outcome(0, good, near, far), _outcome(1, good, good, good)])["stiffness"]
    assert [held[name]["held95"] for name in NAMES] == [2, 1, 1]
    assert [held[name]["wrong_identified"] for name in NAMES] == [0, 0, 1]
    ran = {"seconds": 1.0, "found": -10.0, "error": ""}
    mode = exact_page.mode_summary([ran | {"index": i, "from_truth": t} for i, t in enumerate((-9.5, 5))])
    assert (mode["found"], mode["missed"]) == (1, {"1": 15.0})
    bounded = _stiffness("bounded below", 0.5, 0.6)
    over = [_outcome(i, far, bounded, good, bound=["k12", "high", 10.0]) for i in range(2)]
    over += [_outcome(2, far, bounded, good, bound=["k11", "low", 100.0])]
    over += [_outcome(3, _stiffness("weakly identified", 0.5, 0.9), good, good, bound=["k11", "low", 10.0])]
    bounds = exact_page.bounds_summary(over)
    # also a verdict under the condition that the model is right counts
    assert (bounds["called_identified"], bounds["bounded"]) == (2, 2)
    ends = [_outcome(i, *[_stiffness("identified", 0.9 + 0.01 * i, 2 + i, [0.01, 2.0])] * 3) for i in (-1, 0, 1)]
    upper = exact_page.seeds_summary(ends)["ends"]["k11, upper end"]
    assert (upper["scatter"], upper["stated"], upper["ratio"]) == pytest.approx((1.0, 2.0, 2.0))
    data = {"bounds": bounds, "mode": mode}
    where = {"environment": exact_study.merged(None, "x", {}, False)["x"]["environment"]}
    text = exact_page.page_text({part: {**where, "subjects": {"main": one}} for part, one in data.items()})
    for words in (
        "In 1 of 2 data sets", "- Missed, main, data set 1: 15.0 below.", "bounded below 2",
        "weakly identified, if the model were right 1",
    ):  # fmt: skip
        assert words in text


@pytest.mark.skipif(not exact_study.RESULTS.exists(), reason="`make science` has not been run")
def test_the_published_study_holds_what_the_page_asks_for():
    found = json.loads(exact_study.RESULTS.read_text(encoding="utf-8"))
    assert found.keys() <= PARTS.keys()
    assert exact_page.page_text(found) in exact_page.PAGE.read_text(encoding="utf-8")
    assert found["coverage"]["subjects"].keys() == SUBJECTS.keys()
    for data in _subjects(found, "coverage"):
        assert (data["count"], data["converged"], data["failed"]) == (100, 100, [])
        for row in data["stiffness"].values():
            assert 92 <= row["held95"] <= 98
            assert row["wrong_identified"] == 0
    modes = _subjects(found, "mode")
    assert sum(one["found"] for one in modes) >= 0.99 * sum(one["count"] for one in modes)
    (bounds,) = _subjects(found, "bounds")
    assert (bounds["count"], bounds["called_identified"], bounds["failed"]) == (40, 0, [])
    for one in _subjects(found, "seeds"):
        assert all(0.75 <= end["ratio"] <= 1.25 for end in one["ends"].values())


def _subjects(found, part):
    return list(found.get(part, {}).get("subjects", {}).values())
