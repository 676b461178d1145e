"""Candidates that take out what the body itself leaves uncertain, and those beside modes."""

from dataclasses import replace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.joint import Joints
from jointbayes.posterior.first_look import fisher_information, measurement_information
from jointbayes.studies.planning.case_candidates import candidates_of
from jointbayes.studies.planning.make_plan import WithFurther
from tests.case.refusal_rows import parts_named
from tests.case.test_free_structure_as_test import MATERIAL, TWO
from tests.case.test_several_tests import BASE
from tests.conftest import CONFIGS, cheap_text, edited

FREQUENCIES = BASE.partition("[data]")[0] + parts_named("free_structure")["heard clamped"] + MATERIAL
PLAN = '\n[plan]\nparameter = "k22"\noutputs = ["2:y", "6:y"]\n'
SHORT = "\n[plan.tests.short.structure]\nlength_mm = 200.0\n"
TRUTH = np.array([np.log(2e9), np.log(1e7), np.log(3e5), 0.01, -0.004, 0.001])
ERRORS = "[uncertain.model_error]\nfrequency_error = 0.002\nshape_error = 0.005\n"


def case_of(text):
    return jb.case_from_text("case", text)


def named(text):
    return {candidate.name: candidate for candidate in candidates_of(case_of(text))}


def test_hitting_the_structure_free_is_a_candidate_where_its_material_is_uncertain():
    free = named(BASE + MATERIAL + PLAN)["free"]
    assert (free.words, free.joint) == ("the structure hit free, before it is joined", Joints(()))
    assert "free" not in named(BASE + PLAN)
    assert "free" not in named(
        BASE + MATERIAL + "length_offset = {sd_mm = 1.9}\n" + PLAN
    )  # the bar goes on in the clamp
    assert "free" not in named(BASE.replace("383.0", '383.0\nsupports = ["11:rz"]') + MATERIAL + PLAN)
    proposed = named(BASE + MATERIAL + PLAN + "[plan.tests.hung]\njoined = false\n")
    assert (list(proposed), proposed["hung"].joint) == (["2:y", "6:y", "4 × averages", "hung"], Joints(()))
    assert list(named(TWO + PLAN)) == ["clamped 2:y", "clamped 6:y", "clamped 4 × averages"]


@pytest.mark.parametrize("text", [BASE + MATERIAL, FREQUENCIES])
def test_its_information_is_that_of_two_tests_less_that_of_one(text):
    case, theta = case_of(text + PLAN), TRUTH
    free = named(text + PLAN)["free"]
    simulated = free.problem(case.problem, theta)
    together = jb.Problem([replace(case.problem.test, name="clamped"), simulated.test], case.problem.prior)
    assert simulated.test.name == "free"
    expected = fisher_information(together, theta).data - fisher_information(case.problem, theta).data
    found = measurement_information(free, case.problem, theta)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
    assert not found[:3].any()


@pytest.mark.whole
def test_beside_modes_candidates_are_ratios_at_further_dofs_the_free_structure_and_tests():
    candidates = named(FREQUENCIES + PLAN + SHORT)
    assert list(candidates) == ["2:y", "6:y", "free", "short"]
    first = candidates["2:y"]
    assert first.words == ("an accelerometer on the beam (2:y, 38.3 mm), calibrated with the one at 11:y")
    problem = case_of(FREQUENCIES + PLAN).problem
    exact = first.problem(problem, TRUTH).test.data
    frequencies = problem.natural_frequencies_hz(np.exp(TRUTH[:3]), 3, problem.prior.factors(TRUTH[None]))[0]
    np.testing.assert_allclose(exact.frequency_hz, frequencies, rtol=1e-9)
    ratios = exact.shapes.components
    np.testing.assert_allclose(ratios.sd, 0.01 * np.maximum(np.abs(ratios.values), 0.01))
    drawn = [first.problem(problem, TRUTH, np.random.default_rng(i)).test.data for i in range(100)]
    np.testing.assert_array_equal(drawn[0].frequency_hz, exact.frequency_hz)
    np.testing.assert_allclose(np.std([data.shapes.components.values for data in drawn], axis=0), ratios.sd, rtol=0.2)
    short = candidates["short"].problem(problem, TRUTH).test.data
    assert short.frequency_hz[0] > 2 * exact.frequency_hz[0]
    np.testing.assert_allclose(short.sd_hz, 0.002 * short.frequency_hz)


def test_a_sensor_that_is_there_already_is_none_and_its_reference_is_that_of_all():
    shown = 'shapes = {dofs = ["6:y"], reference = "9:y", components = [[0.6], [-1.2], [0.9]], sd = 0.02}\n'
    candidates = named(edited(FREQUENCIES, ('"natural_frequencies"', '"modes"'), ("sd_hz = 0.0\n", shown)) + PLAN)
    assert (list(candidates), candidates["2:y"].reference) == (["2:y", "free"], "9:y")


def test_what_the_body_left_uncertain_is_what_the_candidates_take_out():
    case = case_of(FREQUENCIES + PLAN)
    now = fisher_information(case.problem, TRUTH)
    sds = {
        name: replace(now, data=now.data + measurement_information(candidate, case.problem, TRUTH)).stiffness_sd()
        for name, candidate in named(FREQUENCIES + PLAN).items()
    }
    before = now.stiffness_sd()
    assert sds["free"]["k22"] < 0.8 * before["k22"]
    assert sds["6:y"]["k22"] < 0.8 * before["k22"]
    assert sds["2:y"]["k11"] < 0.5 * before["k11"]


def test_a_first_look_counts_errors_of_the_model_at_their_usual_size():
    """Data that fit exactly would say that the model has none: three frequencies of a free bar tell E by so much."""
    text = FREQUENCIES + ERRORS
    case, (free,) = case_of(text + PLAN), [one for name, one in named(text + PLAN).items() if name == "free"]
    at = case.problem.names.index("youngs_modulus")
    found = measurement_information(free, case.problem, TRUTH)[at, at]
    assert found == pytest.approx(3 * 0.5**2 / (0.002**2 + 0.002**2), rel=0.01)


def test_keys_of_frfs_are_refused_beside_modes():
    with pytest.raises(
        jb.CaseError, match=r"plan\.averages_factor: found it beside natural frequencies; expected data of"
    ):
        case_of(FREQUENCIES + PLAN + "averages_factor = 4.0\n")


def both(case, further):
    """The present measurement and a further one as two tests of one problem."""
    tests = [replace(case.problem.test, name="clamped"), replace(further, name="further")]
    return jb.Problem(tests, case.problem.prior)


@pytest.mark.parametrize(("text", "name"), [(BASE + MATERIAL, "free"), (FREQUENCIES, "free"), (FREQUENCIES, "6:y")])
def test_the_density_of_which_a_forecast_is_made_is_that_of_two_tests(text, name):
    case, candidate = case_of(text + PLAN), named(text + PLAN)[name]
    further = candidate.problem(case.problem, TRUTH, np.random.default_rng(5))
    theta = TRUTH + 0.01 * np.random.default_rng(6).normal(size=(20, TRUTH.size))
    theta[0, 1] = 50.0  # an impossible joint
    found = WithFurther(case.problem.log_posterior, [further])(theta)
    np.testing.assert_allclose(found, both(case, further.test).log_posterior(theta), rtol=1e-6, atol=1e-3)


@pytest.mark.science
@pytest.mark.long
@pytest.mark.parametrize(("noise", "name"), [("", "free"), (ERRORS, "6:y")])
def test_a_forecast_is_what_sampling_both_measurements_finds(noise, name):
    """Draws of the present posterior weighted by the further data, all of them, against a run of both."""
    case = case_of(FREQUENCIES + noise + PLAN)
    present = jb.sample(case.problem, seed=1)  # as stated, as what both are sampled
    truth = present.theta[np.random.default_rng(2).integers(len(present.theta))]
    further = named(FREQUENCIES + noise + PLAN)[name].problem(case.problem, truth, np.random.default_rng(3))
    log_weight = further.log_posterior.log_likelihood(present.theta)
    weight = np.exp(log_weight - log_weight.max())
    found = jb.sample(both(case, further.test), seed=3)
    assert found.converged
    spread = np.sqrt(np.cov(np.log(present.values("k22")).ravel(), aweights=weight))
    assert spread == pytest.approx(np.log(found.values("k22")).std(), rel=0.1)


@pytest.mark.long
@pytest.mark.science
def test_a_plan_of_modes_ranks_them():
    plan = jb.plan(case_of(FREQUENCIES + PLAN), simulations=9)
    names = [tuple(candidate.name for candidate in data.candidates) for data in plan.measurements]
    assert sorted(names) == [("2:y",), ("6:y",), ("free",)]
    assert "Measure next: an accelerometer" in plan.sentence


def test_of_masses_whose_place_nobody_knows_ratios_are_to_the_last():
    storeys = {candidate.name: candidate for candidate in candidates_of(jb.load_case(CONFIGS / "two_storeys.toml"))}
    assert storeys["1:x"].reference == "2:x"


@pytest.mark.science
def test_measured_frfs_are_planned_by_the_modes_that_a_run_answers_by():
    """Sensors, the free structure, a shorter bar; of a model half a millimetre short averages say nothing."""
    text = cheap_text() + '\n[plan]\nparameter = "k22"\noutputs = ["2:y", "3:y"]\n' + SHORT
    case, longer = case_of(text), case_of(edited(text, ("k11 = 5.05e9", "length_mm = 383.5\nk11 = 5.05e9")))
    data = replace(longer.problem.test.data, synthetic=False)
    problem, test = case.problem.with_test(data=data), replace(case.tests[0], data=data)
    measured = replace(case, problem=problem, stated=problem, tests=(test,))
    posterior = jb.sample(measured, seed=1)
    plan = jb.plan(measured, posterior, simulations=0)
    assert plan.now.verdict == posterior.verdict("k22").verdict
    made = {candidate.name: candidate for one in plan.measurements for candidate in one.candidates}
    assert set(made) == {"2:y", "3:y", "free", "short"}
    for candidate in made.values():
        further = candidate.problem(posterior.problem, posterior.mode_theta, np.random.default_rng(1)).test
        assert further.data.modes is not None
        assert further.structures.names == ("youngs_modulus", "density", "length")
        assert further.noise.sizes == posterior.problem.test.noise.sizes
