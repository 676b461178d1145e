"""What is known where each stiffness is known by bounds at most: joints that are excluded, a flexibility at an arm."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

import jointbayes as jb
from jointbayes.cli.common import print_summary
from jointbayes.posterior import gather_knowledge
from jointbayes.posterior.identifiability import assess
from jointbayes.posterior.knowledge import (
    LEVEL,
    SimplerJoint,
    UncertainInputsRow,
    exclusion_sentences,
    known_by_bounds,
    simpler_joints,
)
from jointbayes.posterior.limits import LikelihoodRegion
from jointbayes.report import ReportInputs
from jointbayes.report.model import Paragraph
from jointbayes.report.sections.identifiable import knowledge_section
from jointbayes.rounding import with_interval
from tests.conftest import TABLE_3, judged_as, of_case, plain_reports, shipped_text, unsettled

RIGID = np.array([1e30, 0.0, 1e30])


def two_lengths(frequencies: tuple[float, float], more: str = "") -> jb.Case:
    """One clamp at two lengths of the beam, one natural frequency each."""
    text = shipped_text("clamped_beam_frequencies")
    text = re.sub(r"(?ms)^\[(compare|reference)\].*?(?=^\[|\Z)", "", text).replace("walkers = 48", "walkers = 16")
    text = re.sub(r"(?m)^frequencies_hz = .*$", "", text).replace("elements = 10", "elements = 4")
    for name, length, frequency in zip(("long", "short"), (383.0, 200.0), frequencies, strict=True):
        text += f"\n[tests.{name}.structure]\nlength_mm = {length}\n"
        text += f"[tests.{name}.data]\nfrequencies_hz = [{frequency}]\n"
    return jb.case_from_text("two lengths", text + more)


def exact(joint: np.ndarray) -> tuple[float, float]:
    return tuple(
        float(part.natural_frequencies_hz(joint, 1)[0, 0]) for part in two_lengths((120.0, 430.0)).problem.parts
    )


@pytest.fixture(scope="module")
def bounded():
    settings = jb.SamplerSettings(
        walkers=8, max_steps=3000, check_every=25, tau_factor=10, r_hat_max=1.1, end_tolerance=0.2
    )
    posterior = jb.sample(two_lengths(exact(TABLE_3)), seed=1, settings=settings)
    assert posterior.converged
    return posterior


@pytest.fixture(scope="module")
def of_bounded(bounded):
    """The report's inputs, which keep what was gathered once."""
    with plain_reports():
        inputs = ReportInputs(bounded)
        assert inputs.knowledge.simpler
    return inputs


@pytest.fixture(scope="module")
def stated(cheap_posterior):
    """The same of a posterior of which such joints are said, whatever its data say of them."""
    with plain_reports():
        inputs = ReportInputs(judged_as(of_case(cheap_posterior), cheap_posterior))
        simpler = [("rigid", 40.0, 16.3), ("absent", 50.0, 16.3), ("uncoupled", 0.2, 10.8)]
        joints = tuple(SimplerJoint("", *one) for one in simpler)
        inputs.__dict__["knowledge"] = replace(inputs.knowledge, simpler=joints)
        assert inputs.summary
    return inputs


def by_kind(joints) -> dict[str, SimplerJoint]:
    return {one.kind: one for one in joints}


@pytest.mark.long
@pytest.mark.whole
def test_a_rigid_joint_is_excluded_by_data_that_bound_each_stiffness_from_below(bounded, of_bounded):
    assert {bounded.verdict(k).cls for k in ("k11", "k22")} == {"bounded below"}
    assert known_by_bounds(bounded) == ("",)
    joints = by_kind(of_bounded.knowledge.simpler)
    # nothing else is uncertain: the likelihood of a rigid joint is one number
    measured = np.array([part.test.data.frequency_hz[0] for part in bounded.problem.parts])
    sd = np.array([part.test.data.sd_hz[0] for part in bounded.problem.parts])
    expected = (((np.array(exact(RIGID)) - measured) / sd) ** 2).sum()
    assert joints["rigid"].ratio == pytest.approx(expected, rel=0.02)
    assert joints["rigid"].limit == pytest.approx(stats.chi2(3).isf(LEVEL))
    assert joints["uncoupled"].limit == pytest.approx(stats.chi2(1).isf(LEVEL))
    assert {kind: one.excluded for kind, one in joints.items()} == {"rigid": True, "absent": True, "uncoupled": False}
    assert joints["uncoupled"].ratio < 1


@pytest.mark.parametrize("joint", [TABLE_3, RIGID])
def test_twice_the_fall_of_the_log_likelihood_is_held_against_the_limit(joint, monkeypatch):
    """Of points about the published joint, for data of it and of a rigid one."""
    monkeypatch.setattr("jointbayes.posterior.knowledge.known_by_bounds", lambda _: ("",))
    problem = two_lengths(exact(joint)).problem
    at = problem.prior.parametrisation.coordinates(TABLE_3 if joint is TABLE_3 else np.array([1e12, 0.0, 1e9]))
    posterior = SimpleNamespace(
        problem=problem,
        estimate=SimpleNamespace(theta=at, modes=(None,), starts_for_draws=((at, np.eye(3)),)),
        best=SimpleNamespace(theta=at),
        thinned=lambda _: at + np.linspace(-0.01, 0.01, 5)[:, None],
        _found={("solutions_of",): SimpleNamespace(nearest=lambda points: np.zeros(len(points), dtype=int))},
    )
    joints = by_kind(simpler_joints(posterior))
    rigid = joints["rigid"]
    # a joint gives up as many numbers as it has stiffnesses, an uncoupled one its coupling alone
    limits = {
        "rigid": stats.chi2(3).isf(LEVEL),
        "absent": stats.chi2(3).isf(LEVEL),
        "uncoupled": stats.chi2(1).isf(LEVEL),
    }
    assert {kind: one.limit for kind, one in joints.items()} == pytest.approx(limits)
    measured = np.array([part.test.data.frequency_hz[0] for part in problem.parts])
    sd = np.array([part.test.data.sd_hz[0] for part in problem.parts])
    expected = (((np.array(exact(RIGID)) - measured) / sd) ** 2).sum()
    assert rigid.ratio == pytest.approx(expected, rel=1e-3, abs=0.1)
    assert rigid.excluded == (joint is TABLE_3)


@pytest.mark.whole
@pytest.mark.long
def test_a_joint_that_is_rigid_is_not_excluded(bounded):
    rigid = two_lengths(exact(RIGID)).problem
    posterior = replace(bounded, problem=rigid, estimate=replace(bounded.estimate, theta=bounded.theta[0]))
    # draws far up, where the likelihood of the rigid joint is reached
    posterior.__dict__["theta"] = bounded.theta + np.array([8.0, 8.0, 0.0])
    joints = by_kind(simpler_joints(posterior))
    assert joints["rigid"].ratio < 0.1
    assert not joints["rigid"].excluded


@pytest.mark.science
@pytest.mark.long
def test_what_else_is_uncertain_is_fitted_anew(bounded, of_bounded, monkeypatch):
    fixed = by_kind(of_bounded.knowledge.simpler)["rigid"]
    uncertain = two_lengths(exact(TABLE_3), "\n[uncertain.youngs_modulus]\nsd_percent = 1.0\n").problem
    modulus = 0.01 * np.random.default_rng(1).normal(size=(len(bounded.theta), 1))
    at = np.append(bounded.estimate.theta, 0.0)
    posterior = replace(
        bounded, problem=uncertain, estimate=replace(bounded.estimate, theta=at), best=replace(bounded.best, theta=at)
    )
    posterior.__dict__["theta"] = np.hstack([bounded.theta, modulus])
    monkeypatch.setattr("jointbayes.posterior.knowledge.known_by_bounds", lambda _: ("",))
    freed = by_kind(simpler_joints(posterior))["rigid"]
    # a modulus that is lower takes up part of what a rigid joint misses, at the price of its own prior
    parts, rigid = bounded.problem.parts, np.array(exact(RIGID))
    measured, sd = (np.array([getattr(p.test.data, name)[0] for p in parts]) for name in ("frequency_hz", "sd_hz"))
    least = min(
        (((rigid * np.exp(x / 2) - measured) / sd) ** 2).sum() + (x / 0.01) ** 2 for x in np.linspace(-0.5, 0.1, 6001)
    )
    assert freed.ratio == pytest.approx(least, abs=0.3)
    assert freed.ratio < fixed.ratio - 1


@pytest.mark.science
@pytest.mark.long
def test_the_flexibility_at_a_lever_arm_is_named_where_each_stiffness_is_bounded(bounded, of_bounded):
    first = of_bounded.knowledge.directions[0]
    arm = float(re.fullmatch(r"flexibility at a lever arm of ([\d.]+) mm", first.quantity)[1]) / 1000
    ends = with_interval(first.interval95, "m/N")
    words = f"under a force at a lever arm of {1000 * arm:g} mm the joint gives {ends} (weakly identified)"
    assert first.as_flexibility == words
    assert f"Best known: {first.as_flexibility}." in of_bounded.knowledge.bounds_sentence
    k11, k12, k22 = bounded.stiffness.T
    # displacement at the arm's end under a unit force there
    draws = (k22 - 2 * arm * k12 + arm**2 * k11) / (k11 * k22 - k12**2)
    assert first.interval95 == pytest.approx(tuple(np.quantile(draws, [0.025, 0.975])))
    assert first.verdict == "weakly identified"
    k = np.array([[TABLE_3[0], TABLE_3[1]], [TABLE_3[1], TABLE_3[2]]])
    true = np.array([1, arm]) @ np.linalg.solve(k, np.array([1, arm]))
    assert first.interval95[0] < true < first.interval95[1]
    assert first.ratio < 3 < min(bounded.verdict(n).ratio for n in ("k11", "k22"))


def test_terminal_page_one_and_summary_say_what_is_excluded(stated, capsys):
    inputs = stated
    said, summary = inputs.knowledge.bounds_sentence, inputs.summary.to_dict()["identifiability"]
    assert said.startswith("The data rule out that the joint is rigid (more than 1e6 times less likely)")
    assert "The data do not rule out that the joint is uncoupled (" in said
    best = inputs.knowledge.directions[0]
    assert f"Best known: {best.sentence}." in said
    assert best.interval95[0] < best.median < best.interval95[1]
    assert inputs.posterior.verdict(best.quantity).value in best.sentence
    assert summary["directions"][0]["median"] == best.median
    assert summary["bounds_sentence"] == said
    assert [one["excluded"] for one in summary["simpler_joints"]] == [True, True, False]
    assert f"**{said}**" in [block.text for block in knowledge_section(inputs).blocks if isinstance(block, Paragraph)]
    print_summary(inputs.posterior, inputs.knowledge)
    assert " ".join(inputs.knowledge.bounds_sentences) == said
    assert set(inputs.knowledge.bounds_sentences) <= set(capsys.readouterr().out.splitlines())


@pytest.mark.whole
def test_what_is_excluded_is_in_a_file_and_found_anew_for_one_that_lacks_it(bounded, of_bounded, tmp_path, monkeypatch):
    knowledge = of_bounded.knowledge
    bounded.save(tmp_path / "draws.nc")
    kept = jb.load_posterior(tmp_path / "draws.nc")
    older = judged_as(replace(bounded), bounded)
    assert gather_knowledge(older).simpler == knowledge.simpler
    monkeypatch.setattr("jointbayes.posterior.knowledge.known_by_bounds", lambda _: pytest.fail("kept"))
    assert gather_knowledge(judged_as(kept, bounded)).simpler == knowledge.simpler


@pytest.mark.parametrize(("verdict", "condition"), [("not identified", True), ("weakly identified", False)])
def test_combinations_rest_on_exact_inputs_unless_freeing_them_was_seen_to_change_nothing(stated, verdict, condition):
    known = {"k11": replace(assess(np.linspace(1.0, 2.0, 100), np.linspace(1.0, 100.0, 100)), cls=verdict)}
    run = UncertainInputsRow((), "this run", known)
    knowledge = replace(
        stated.knowledge, freed=(run, UncertainInputsRow(("length", "density"), "importance sampling", known))
    )
    assert knowledge.exact == {}
    said = knowledge.bounds_sentence
    assert said.startswith("With length and density exactly known: the data rule out that the joint is") == condition
    assert ("Best known, on the same condition: " in said) == condition
    assert knowledge.directions_sentence.startswith("With length and density exactly known: ") == condition
    said = replace(knowledge, freed=(run,)).bounds_sentence
    assert said.startswith("The data rule out")
    assert "Best known: " in said


@pytest.mark.whole
@pytest.mark.usefixtures("plain_reports")
def test_of_a_run_that_did_not_converge_nothing_is_excluded(bounded):
    failed = judged_as(unsettled(bounded), bounded)
    assert gather_knowledge(failed).bounds_sentence == ""


def test_every_mode_is_climbed_from():
    """About the second mode the draws fit worse than about the first, while its best joint fits better."""
    x = np.concatenate([np.linspace(-1, 1, 40), np.linspace(9.98, 10.02, 20)])

    def log_likelihood(theta):
        return np.where(theta[:, 0] < 5, -3 - theta[:, 0] ** 2, -50 * (theta[:, 0] - 10.5) ** 2)

    prior = jb.JointPrior(jb.parametrisation_named("springs", ("x",)), (jb.Uniform(-20.0, 20.0),))
    problem = SimpleNamespace(prior=prior, log_likelihood=log_likelihood)
    assert log_likelihood(x[:, None]).argmax() < 40
    assert LikelihoodRegion(problem, x[:, None], (x > 5).astype(int)).greatest == pytest.approx(0.0, abs=1e-6)


@pytest.mark.usefixtures("plain_reports")
def test_of_joints_that_are_known_nothing_is_said(cheap_posterior):
    assert known_by_bounds(cheap_posterior) == ()
    assert gather_knowledge(judged_as(of_case(cheap_posterior), cheap_posterior)).bounds_sentence == ""


def test_the_sentence_names_each_joint():
    joints = (SimplerJoint("a", "rigid", 30.0, 16.3), SimplerJoint("b", "rigid", 3.0, 16.3))
    assert exclusion_sentences(joints) == (
        "The data rule out that joint a is rigid (more than 1e6 times less likely).",
        "The data do not rule out that joint b is rigid (4.5 times less likely).",
    )
    assert exclusion_sentences(()) == ()
