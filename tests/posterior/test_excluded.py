"""What is known where each stiffness is known by bounds at most: joints that are excluded, a flexibility at an arm."""

import math
import re
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import special

import jointbayes as jb
from jointbayes.cli.common import print_summary
from jointbayes.inference import hypothesis_problem
from jointbayes.posterior import evidence, gather_knowledge
from jointbayes.posterior.identifiability import assess
from jointbayes.posterior.knowledge import SimplerJoint, UncertainInputsRow, known_by_bounds, weighed_joints
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
        assert inputs.knowledge.weighed
    return inputs


@pytest.fixture(scope="module")
def stated(cheap_posterior):
    """The same of a posterior of which such joints are said, whatever its data say of them."""
    with plain_reports():
        inputs = ReportInputs(judged_as(of_case(cheap_posterior), cheap_posterior))
        simpler = [("rigid", 40.0), ("absent", 50.0), ("uncoupled", 0.2)]
        joints = tuple(SimplerJoint("", *one) for one in simpler)
        inputs.__dict__["knowledge"] = replace(inputs.knowledge, weighed=joints)
        assert inputs.summary
    return inputs


_FROM_PRIOR, _CHAINS = 20_000, 8


def likelihood_over_prior(problem):
    """Draws of θ from the prior, and ln L at each."""
    theta = problem.prior.transform(np.random.default_rng(1).random((_FROM_PRIOR, len(problem.names))))
    return theta, problem.log_posterior.log_likelihood(theta)


def log_z(problem) -> float:
    """ln of the mean likelihood over draws from the prior."""
    return float(special.logsumexp(likelihood_over_prior(problem)[1]) - math.log(_FROM_PRIOR))


def weighed_by_prior_draws(problem, of_run):
    """2 ln B against each simpler joint."""
    kinds = {"rigid": "rigid", "absent": "absent", "uncoupled": "springs"}
    return {kind: 2 * (of_run - log_z(hypothesis_problem(problem, name))) for kind, name in kinds.items()}


def drawn_by_weights(problem):
    """A posterior of which the draws are those from the prior, by their likelihood, and its ln Z."""
    theta, height = likelihood_over_prior(problem)
    rows = np.random.default_rng(2).choice(len(theta), _CHAINS * 500, p=special.softmax(height))
    best = SimpleNamespace(theta=theta[height.argmax()])
    posterior = SimpleNamespace(
        problem=problem,
        converged=True,
        theta=theta[rows],
        log_density=problem.log_posterior(theta[rows]).reshape(_CHAINS, -1),
        draws={"ensemble": SimpleNamespace(values=np.repeat([0, 1], _CHAINS // 2))},
        record=SimpleNamespace(seed=1),
        best=best,
        estimate=SimpleNamespace(modes=(best,)),
        thinned=lambda most: theta[rows][:most],
        _found={},
    )
    return posterior, float(special.logsumexp(height) - math.log(len(theta)))


def by_kind(joints) -> dict[str, SimplerJoint]:
    return {one.kind: one for one in joints}


@pytest.mark.long
@pytest.mark.whole
def test_a_rigid_joint_is_excluded_by_data_that_bound_each_stiffness_from_below(bounded, of_bounded):
    assert {bounded.verdict(k).cls for k in ("k11", "k22")} == {"bounded below"}
    assert known_by_bounds(bounded) == ("",)
    joints = by_kind(of_bounded.knowledge.weighed)
    assert {kind: one.excluded for kind, one in joints.items()} == {"rigid": True, "absent": True, "uncoupled": False}
    expected = weighed_by_prior_draws(bounded.problem, log_z(bounded.problem))
    assert {kind: one.two_log_b for kind, one in joints.items()} == pytest.approx(expected, abs=0.5, rel=1e-3)


#: Two frequencies of a joint that is exactly so, and with a modulus that is uncertain to 1 %.
OF_MODULUS = "\n[uncertain.youngs_modulus]\nsd_percent = 1.0\n"


@pytest.mark.parametrize(("joint", "more"), [(TABLE_3, ""), (RIGID, ""), (TABLE_3, OF_MODULUS)])
def test_twice_the_difference_of_the_log_evidences_tells_whether_a_joint_is_so(joint, more, monkeypatch):
    """Against mean likelihoods over draws from the prior, for data of a published joint and a rigid one."""
    monkeypatch.setattr("jointbayes.posterior.knowledge.known_by_bounds", lambda _: ("",))
    problem = two_lengths(exact(joint), more).problem
    posterior, of_run = drawn_by_weights(problem)
    joints = by_kind(weighed_joints(posterior))
    expected = weighed_by_prior_draws(problem, of_run)
    assert {kind: one.two_log_b for kind, one in joints.items()} == pytest.approx(expected, abs=0.5, rel=1e-3)
    assert joints["rigid"].excluded == (joint is TABLE_3 and not more)
    assert not joints["uncoupled"].excluded


def test_nothing_is_excluded_by_an_evidence_that_is_not_known(monkeypatch):
    """Neither of the run, nor of a simpler joint."""
    monkeypatch.setattr("jointbayes.posterior.knowledge.known_by_bounds", lambda _: ("",))
    posterior, _ = drawn_by_weights(two_lengths(exact(TABLE_3), OF_MODULUS).problem)
    module, known = sys.modules["jointbayes.posterior.knowledge"], evidence
    with monkeypatch.context() as patched:
        patched.setattr(module, "EXCLUDED", 5.0)
        assert by_kind(weighed_joints(posterior))["rigid"].excluded
        posterior._found.clear()
        of_run = posterior.problem.log_posterior
        patched.setattr(
            module, "evidence", lambda p, *a: replace(known(p, *a), error=0.01 if p is of_run else math.inf)
        )
        assert "rigid" not in by_kind(weighed_joints(posterior))
    posterior._found.clear()
    monkeypatch.setattr(sys.modules["jointbayes.posterior.evidence"], "LARGEST_ERROR", 0.0)
    assert weighed_joints(posterior) == ()


@pytest.mark.parametrize(("times", "excluded"), [(999.0, False), (1001.0, True)])
def test_odds_above_1000_to_1_exclude(times, excluded):
    assert SimplerJoint("", "rigid", 2 * math.log(times)).excluded == excluded


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
    assert said.startswith("The data rule out that the joint is rigid (odds more than 10⁶ to 1 against it)")
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
    assert gather_knowledge(older).weighed == knowledge.weighed
    monkeypatch.setattr("jointbayes.posterior.knowledge.known_by_bounds", lambda _: pytest.fail("kept"))
    assert gather_knowledge(judged_as(kept, bounded)).weighed == knowledge.weighed


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
