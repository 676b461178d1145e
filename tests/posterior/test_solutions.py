"""Modes that are apart are said to be several solutions, with what would tell them apart."""

import dataclasses
import json

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.posterior.knowledge import effect_of_uncertain_inputs, known_by_bounds
from jointbayes.posterior.prediction import further_measurement
from jointbayes.posterior.sampled import recall
from jointbayes.posterior.solutions import LEAST_SHARE, Solutions, _are_apart, solutions_of
from jointbayes.posterior.verdicts import advice_on_solutions, describe_solutions, region_of, solution_sentences
from jointbayes.report import ReportInputs
from jointbayes.report.sections.lead import lead
from tests import models
from tests.conftest import CONFIGS, TO_CONVERGE, on_one_line, unsettled


@pytest.fixture(scope="module")
def portal():
    return jb.sample(jb.case_from_text("portal", models.portal()), seed=1, settings=TO_CONVERGE)


@pytest.fixture(scope="module")
def storeys():
    """The same of two unknowns."""
    return jb.sample(jb.load_case(CONFIGS / "two_storeys.toml"), seed=1, settings=TO_CONVERGE)


@pytest.mark.long
@pytest.mark.science
def test_no_stiffness_that_differs_between_the_feet_is_identified(portal):
    assert portal.converged
    assert solutions_of(portal).shares == pytest.approx([0.5, 0.5], abs=0.05)
    low, high = models.FEET
    for index, name in enumerate(portal.stiffness_names):
        known = portal.verdict(name)
        assert known.cls == "not identified"
        assert known.because.startswith("two solutions: ")
        values = [float(value.split()[0]) for value, _ in known.reasons[0].numbers["solutions"]]
        assert values == pytest.approx([low[index % 3], high[index % 3]], rel=0.06)
        assert known.because.count("with probability 0.") == 2


@pytest.mark.long
@pytest.mark.science
def test_the_terminal_page_one_and_the_summary_say_it(portal, capsys):
    from jointbayes.cli.common import print_summary

    sentence = " ".join(solution_sentences(portal))
    assert sentence.startswith("Two solutions explain the data (probability 0.5")
    assert "A.kx, A.ky, A.krz, B.kx, B.ky, B.krz differ between them" in sentence
    print_summary(portal)
    assert set(solution_sentences(portal)) <= set(capsys.readouterr().out.splitlines())
    summary = portal.summary()
    assert sentence in on_one_line(summary)
    inputs = ReportInputs(portal)
    inputs.__dict__["summary"] = summary
    limits, step = (block.text for block in lead(inputs)[-2:])
    assert describe_solutions(portal) in limits
    assert step == f"**Next.** {advice_on_solutions(portal)}"
    assert sentence == f"{describe_solutions(portal)} {advice_on_solutions(portal)}"
    found = json.loads(json.dumps(summary.to_dict(), allow_nan=False))
    assert found["solutions"] == sentence
    assert [mode["share"] for mode in found["modes"]] == pytest.approx(solutions_of(portal).shares)
    for mode in found["modes"]:
        feet = models.FEET if mode["values"]["A.kx"]["median"] < 5e7 else models.FEET[::-1]
        for name, value in zip(portal.stiffness_names, np.ravel(feet), strict=True):
            low, high = mode["values"][name]["interval95"]
            assert low < mode["values"][name]["median"] < high
            assert low / 1.05 < value < high * 1.05


@pytest.mark.science
@pytest.mark.long
def test_the_sensor_that_would_tell_the_feet_apart_is_one_that_does(portal):
    """With a sensor across the beam's middle too the mirror image no longer fits: its FRF has the other sign."""
    assert "A sensor at mid:y with the force at mid:x would tell them apart" in " ".join(solution_sentences(portal))
    text = models.portal().replace('outputs = ["mid:x"]', 'outputs = ["mid:x", "mid:y"]')
    problem = jb.case_from_text("told apart", text).problem
    theta = np.array([mode.theta for mode in portal.estimate.modes])
    heights = problem.log_posterior(theta)
    assert abs(heights[0] - heights[1]) > 1000
    assert len(jb.find_map(problem).modes) == 1


@pytest.mark.whole
def test_two_storeys_of_the_same_two_frequencies_are_two_solutions(storeys):
    assert storeys.converged
    assert storeys.verdict("first.kx").because.startswith("two solutions: 1.4")
    assert "An FRF at 2:x would tell them apart" in " ".join(solution_sentences(storeys))
    assert known_by_bounds(storeys) == ()


@pytest.mark.science
@pytest.mark.long
def test_what_is_said_beside_the_solutions_knows_of_both(portal):
    region = region_of(portal)
    for index, name in enumerate(portal.stiffness_names):
        known = portal.verdict(name)
        assert known.cls == "not identified"
        assert region.limits(index) == pytest.approx(region.limits((index + 3) % 6), rel=0.01)
    assert known_by_bounds(portal) == ()


@pytest.mark.science
@pytest.mark.long
def test_two_solutions_stay_two_with_other_inputs_uncertain(portal):
    run, freed = effect_of_uncertain_inputs(portal, portal.case.workshop_problem)
    assert freed.known
    assert set(freed.verdict.values()) == {"not identified"}
    for name, known in freed.known.items():
        assert np.log(known.interval) == pytest.approx(np.log(run.known[name].interval), abs=0.1)


def test_solutions_of_a_model_that_fails_do_not_explain_the_data(storeys):
    misfit = dataclasses.replace(storeys)
    recall(misfit, {"checks_of": (dataclasses.replace(storeys.check, chi2_per_line=40.0),)})
    assert not misfit.check.explains
    assert describe_solutions(misfit).startswith("Two solutions fit the data best (probability 0.")


def test_solutions_of_a_run_that_did_not_converge_have_no_probabilities(storeys):
    failed = unsettled(storeys)
    sentence = " ".join(solution_sentences(failed))
    assert sentence.startswith("Two solutions explain the data (their probabilities are not settled, as the sampler")
    assert "(probability" not in sentence
    assert sentence.partition("): ")[2] == " ".join(solution_sentences(storeys)).partition("): ")[2] != ""
    assert failed.verdict("first.kx") == "no verdict"
    assert "probability" not in failed.verdict("first.kx").because


def test_a_posterior_with_one_mode_has_one_solution(cheap_posterior):
    solutions = solutions_of(cheap_posterior)
    assert solutions.shares.tolist() == [1.0]
    assert solutions.split == ()
    assert (solution_sentences(cheap_posterior), solutions.reason("k11")) == ((), None)
    assert solutions.summaries() == ()
    assert cheap_posterior.summary().to_dict()["modes"] == []


def test_a_mode_that_no_interval_reaches_is_no_solution(storeys):
    """The draws of one building alone, and so few of the other as lie outside every 95 % interval."""
    few = dataclasses.replace(storeys)
    solutions = Solutions(few)
    rare = np.flatnonzero(solutions._nearest == 1)[int(0.8 * LEAST_SHARE * len(few.theta)) :]
    solutions._nearest[rare] = 0
    solutions.shares = np.bincount(solutions._nearest) / len(few.theta)
    assert solutions.shares[1] < LEAST_SHARE
    assert solutions.values_of("first.kx") == [[0]]
    assert solutions.reason("first.kx") is None


def test_halves_of_one_ridge_are_not_two_solutions():
    rng = np.random.default_rng(1)
    flat, bell = rng.uniform(0, 1, 20_000), rng.normal(size=20_000)
    assert not _are_apart(flat[flat < 0.5], flat[flat >= 0.5])
    assert not _are_apart(flat[flat < 0.05], flat[flat >= 0.05])
    assert not _are_apart(bell[bell < 0], bell[bell >= 0])
    assert not _are_apart(bell[bell < 1.5], bell[bell >= 1.5])
    assert not _are_apart(bell, bell + 3)  # the intervals meet
    assert _are_apart(bell, bell + 6)
    assert _are_apart(bell, 6 + 0.1 * bell)
    assert _are_apart(bell, 6 + 0.01 * bell[:600])


def test_where_no_single_sensor_tells_them_apart_it_says_so():
    problem = jb.load_case(CONFIGS / "two_storeys.toml").problem
    same = np.tile(problem.prior.mean, (2, 1))
    assert further_measurement(problem, same) == "No single sensor at another point of the model would tell them apart."
