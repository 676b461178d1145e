"""Two answers of measured FRFs: that of the modes, with an error of the model, and which of the two is believed."""

import datetime
import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import linalg

import jointbayes as jb
from jointbayes.case.case import case_from_text
from jointbayes.errors import CaseError
from jointbayes.inference import ErrorSizes, JointPrior, ModelErrorNoise, Uniform
from jointbayes.joint import PlainSprings
from jointbayes.measurement import ModeData, Observed
from jointbayes.posterior.modes_answer import (
    ModesProblem,
    UsedMode,
    is_of_measured_frfs,
    modes_problem,
    which_to_believe,
)
from jointbayes.report import ReportInputs, build_report
from jointbayes.report.sections.lead import answer_text
from jointbayes.workflow import sample_quickly
from tests.conftest import CLAMP, TABLE_3, cheap_text, edited, pair_matrix, plain_reports, rod

EXACT = ErrorSizes(frequency=1e-9)


def as_measured(posterior, **changes):
    """The same posterior of FRFs that nobody computed."""
    data = replace(posterior.problem.test.data, synthetic=False)
    problem = posterior.problem.with_test(**({"data": data} | changes))
    return replace(posterior, problem=problem, case=None)


@pytest.fixture(scope="module")
def measured(cheap_posterior):
    return as_measured(cheap_posterior)


def of_another_truth(cheap_case, line):
    """Analysed as ever, of measured FRFs that this line of the truth makes."""
    text = edited(cheap_text(), ("k11 = 5.05e9", f"{line}\nk11 = 5.05e9"))
    data = case_from_text("another", text).problem.test.data
    problem = cheap_case.problem.with_test(data=replace(data, synthetic=False))
    settings = jb.SamplerSettings(walkers=16, max_steps=1500, tau_factor=20, end_tolerance=0.05)
    return jb.sample(problem, settings=settings, seed=1)


@pytest.fixture(scope="module")
def longer(cheap_case):
    """Of a beam half a millimetre longer than the one that is analysed, which another joint explains."""
    return of_another_truth(cheap_case, "length_mm = 383.5")


@pytest.fixture(scope="module")
def heavier(cheap_case):
    """Of a beam that is heavier at its end than the one that is analysed, which no joint explains."""
    return of_another_truth(cheap_case, "accelerometer_mass_g = 20.0")


@pytest.fixture(scope="module")
def inputs(heavier):
    return ReportInputs(heavier)


def test_the_modes_of_the_model_are_numbered_as_they_are(measured):
    asked = modes_problem(measured, ErrorSizes())
    predicted = measured.problem.natural_frequencies_hz(TABLE_3, 4)[0]
    resonances, zeros = asked.used[:3], asked.used[3:]
    assert [mode.number for mode in resonances] == [1, 2, 3]
    for mode in resonances:
        assert abs(mode.frequency_hz / predicted[mode.number - 1] - 1) < 0.002
    body = rod(elements=20)
    clamped, clamp, tip = body.stiffness.copy(), body.index(CLAMP.labels), body.index(("21:y",))
    clamped[np.ix_(clamp, clamp)] += pair_matrix(TABLE_3)
    kept = np.delete(np.arange(body.n_dofs), tip)
    squares = linalg.eigh(clamped[np.ix_(kept, kept)], body.mass[np.ix_(kept, kept)], eigvals_only=True)
    of_held = np.sqrt(squares[:4]) / (2 * np.pi)
    assert [(mode.number, mode.held) for mode in zeros] == [(1, "5:y"), (2, "5:y")]
    for zero in zeros:
        assert abs(zero.frequency_hz / of_held[zero.number - 1] - 1) < 0.002
    assert asked.problem.test.data.zeros.dofs == ("5:y", "5:y")
    assert asked.left_out == ()
    assert asked.problem.names == measured.problem.names


def test_a_mode_that_was_not_seen_leaves_the_numbers_of_the_others(measured):
    data = measured.problem.test.data
    asked = modes_problem(as_measured(measured, data=replace(data.split([(0.0, 400.0)])[0], synthetic=False)), EXACT)
    assert [mode.number for mode in asked.used if not mode.held] == [2, 3]


def test_a_resonance_that_the_model_does_not_have_is_named_and_not_used(measured):
    frf = measured.problem.test.data.frf
    ripple = 3e-6 / (1 - (frf.frequency_hz / 1500) ** 2 + 0.02j * frf.frequency_hz / 1500)
    data = replace(measured.problem.test.data, frf=replace(frf, values=frf.values + ripple[:, None, None]))
    asked = modes_problem(as_measured(measured, data=replace(data, synthetic=False)), ErrorSizes())
    (left_out,) = asked.left_out
    assert left_out.startswith("The resonance at 150") or left_out.startswith("The resonance at 149")
    assert [mode.number for mode in asked.used if not mode.held] == [1, 2, 3]


@pytest.mark.parametrize("computed", ["synthetic", "modes"])
def test_computed_frfs_and_modes_have_one_answer(computed, cheap_posterior, frequency_posterior):
    posterior = cheap_posterior if computed == "synthetic" else frequency_posterior
    assert not is_of_measured_frfs(posterior.problem)
    assert jb.ask_modes(posterior) is None


def test_a_joint_whose_only_test_shows_no_mode_leaves_the_answer_to_the_frfs(measured):
    test, prior = measured.problem.test, measured.problem.prior
    dark = replace(test.data.split([(200.0, 600.0)])[1], synthetic=False)  # between two resonances
    tests = [replace(test, name="seen"), replace(test, name="dark", data=dark)]
    both = jb.JointPrior(jb.blocks_of(dict.fromkeys(("seen", "dark"), prior.parametrisation)), prior.marginals * 2)
    posterior = SimpleNamespace(
        problem=jb.Problem(tests, both),
        estimate=SimpleNamespace(theta=np.tile(measured.estimate.theta, 2), modes=()),
        record=measured.record,
    )
    assert modes_problem(posterior, ErrorSizes()) is None
    posterior.problem = jb.Problem(tests, prior)  # one joint in both
    posterior.estimate = measured.estimate
    assert {mode.setup for mode in modes_problem(posterior, ErrorSizes()).used} == {"seen"}


@pytest.mark.science
@pytest.mark.long
def test_an_exact_model_that_nobody_says_is_exact_has_the_wider_answer_of_its_modes(measured):
    inputs = ReportInputs(measured)
    answer = inputs.knowledge.modes
    assert answer.believed
    assert {parameter.verdict for parameter in inputs.summary.parameters.values()} == {"no verdict"}
    assert "the model itself may be wrong by 0.3 % of a natural frequency, more than" in answer.reason
    for name, known in answer.known.items():
        low, high = known.interval95
        assert low < TABLE_3[measured.stiffness_names.index(name)] < high
    sharp, wide = measured.interval("k22"), answer.known["k22"].interval95
    assert math.log(wide[1] / wide[0]) > 5 * math.log(sharp[1] / sharp[0])
    middle, low, high = answer.model_error
    assert low < middle < high < 0.003  # nothing was wrong, as three resonances and two antiresonances say


@pytest.mark.science
def test_a_model_that_is_stated_to_be_exact_and_explains_the_frfs_keeps_their_answer(measured):
    answer = jb.ask_modes(measured, EXACT)
    assert not answer.believed
    assert measured.identifiability("k22").verdict == "identified"


@pytest.mark.long
@pytest.mark.science
def test_a_wrong_model_that_explains_the_frfs_is_sure_of_a_wrong_joint_and_the_modes_are_believed(longer):
    assert longer.check.explains
    low, high = longer.interval("k22")
    assert longer.identifiability("k22").verdict == "identified"
    assert high < 0.9 * TABLE_3[2]
    answer = jb.ask_modes(longer)
    assert answer.believed
    low, high = answer.known["k22"].interval95
    assert low < TABLE_3[2] < high


@pytest.mark.long
@pytest.mark.science
def test_a_wrong_model_that_does_not_explain_the_frfs_has_the_verdicts_of_the_modes_on_page_one(heavier, inputs):
    assert not heavier.check.explains
    assert {heavier.identifiability(name).verdict for name in heavier.stiffness_names} == {"no verdict"}
    assert "it misses them by" in heavier.identifiability("k22").verdict_reason
    answer = inputs.knowledge.believed_modes
    page_one = str(build_report(inputs, datetime.date(2026, 1, 1)).lead)
    assert f"{answer.reason[1:]}, so the answer is that of their modes." in page_one
    assert "no valid value" not in page_one
    # at the margin of a verdict it is a limit: another NumPy's last bits decide
    known = answer.known["k22"]
    assert answer_text(known, known.unit) in page_one
    assert answer_text(heavier.identifiability("k22"), known.unit) not in page_one
    summary = json.loads(json.dumps(inputs.summary.to_json()))
    assert summary["answers"]["believed"] == "modes"
    assert summary["answers"]["modes"]["parameters"]["k22"]["interval95"] == list(answer.known["k22"].interval95)
    assert summary["answers"]["frfs"]["parameters"]["k22"]["verdict"] == "no verdict"


@pytest.mark.whole
def test_both_answers_are_kept_with_the_draws(measured, tmp_path):
    with plain_reports():
        knowledge = replace(ReportInputs(measured).knowledge, modes=jb.ask_modes(measured, EXACT))
    measured.save(tmp_path / "posterior.nc", knowledge)
    again = ReportInputs(jb.load_posterior(tmp_path / "posterior.nc", measured.problem)).knowledge
    assert again.modes.known
    assert repr(again.modes) == repr(knowledge.modes)


def test_what_nobody_stated_is_as_uncertain_as_in_a_workshop_and_what_is_declared_exact_is_exact(cheap_posterior):
    data = replace(cheap_posterior.problem.test.data, synthetic=False)
    declared = case_from_text("cheap", f'{cheap_text()}\n[uncertain]\nexact = ["density", "length"]\n')
    for case, names in ((None, {"youngs_modulus", "density", "length"}), (declared, {"youngs_modulus"})):
        stated = case or case_from_text("cheap", cheap_text())
        freed = stated.workshop_problem.with_test(data=data)
        asked = modes_problem(as_measured(cheap_posterior), ErrorSizes(), freed)
        assert names <= set(asked.problem.names)
        assert not {"density", "length"} - names & set(asked.problem.names)
        assert [mode.number for mode in asked.used if not mode.held] == [1, 2, 3]


def test_what_is_declared_exact_has_no_prior_beside():
    text = edited(
        cheap_text(),
        ("[data.noise]", "[uncertain]\nexact = ['density']\n[uncertain.density]\nsd_percent = 1.0\n[data.noise]"),
    )
    with pytest.raises(
        CaseError, match=r'uncertain\.exact: found "density", whose prior \[uncertain\.density\] states'
    ):
        case_from_text("twice", text)


@pytest.mark.science
def test_quick_draws_of_two_springs_in_a_thin_sheet_have_the_quantiles_of_a_grid():
    data = ModeData(Observed(np.array([116.8, 726.5]), np.array([0.02, 0.1])))
    prior = JointPrior(PlainSprings(), (Uniform(18.0, 26.0), Uniform(11.0, 19.0)))
    test = jb.Test("clamped", rod(), CLAMP, data, ModelErrorNoise.of(data, ErrorSizes()))
    problem = jb.Problem([test], prior)
    quick = sample_quickly(problem, seed=1)
    # the middles of cells, which the prior's edges bound
    axes = 18.0 + 8.0 * (np.arange(80) + 0.5) / 80, 12.2 + 2.0 * (np.arange(1500) + 0.5) / 1500
    points = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)
    density = np.concatenate([problem.log_posterior(rows) for rows in np.array_split(points, 200)])
    mass = np.exp(density - density.max()).reshape(80, 1500)
    for column, axis in enumerate(axes):
        share = mass.sum(axis=1 - column) / mass.sum()
        below = np.cumsum(share) - share / 2
        for probability in (0.025, 0.5, 0.975):
            drawn = float((quick.theta[:, column] <= np.interp(probability, below, axis)).mean())
            assert abs(drawn - probability) < 4 * math.sqrt(probability * (1 - probability) / len(quick.theta))


@pytest.mark.parametrize(
    ("stated", "explains", "believed", "reason"),
    [
        # the best of three resonances has an sd of 2⁻¹⁰ of it; that of the antiresonance does not count
        (2**-10, True, False, "is stated to be wrong by 0.098 % of a natural frequency at most, less than the 0.098 %"),
        (np.nextafter(2**-10, 1), True, True, "may be wrong by 0.098 % of a natural frequency, more than the 0.098 %"),
        (2**-9, True, True, "may be wrong by 0.2 % of a natural frequency, more than the 0.098 %"),
        (1e-9, False, True, "the model does not explain the FRFs within their noise"),
    ],
)
def test_the_modes_are_believed_where_their_noise_is_below_the_models_error_or_the_frfs_are_not_explained(
    stated, explains, believed, reason
):
    seen = [(64.0, 2**-3, ""), (256.0, 2**-2, ""), (512.0, 2.0, ""), (32.0, 2**-20, "5:y")]
    used = tuple(UsedMode("", i, hz, sd, held) for i, (hz, sd, held) in enumerate(seen, 1))
    asked = ModesProblem(problem=None, sizes=ErrorSizes(frequency=stated), used=used, left_out=())
    answer = which_to_believe(SimpleNamespace(check=SimpleNamespace(explains=explains)), asked)
    assert answer[0] is believed
    assert reason in answer[1]
