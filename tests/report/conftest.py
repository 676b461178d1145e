"""Reports of nine different kinds, for claims about all of them: page, PDF and what page one says."""

import datetime
from dataclasses import replace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.posterior import RunRecord, package_versions
from jointbayes.posterior.evidence import Evidence
from jointbayes.posterior.sampled import BestDraw
from jointbayes.posterior.storage import draws_tree
from jointbayes.report import ReportInputs, build_report
from jointbayes.sampling import Draws
from jointbayes.studies.campaign import campaign_page
from jointbayes.studies.compare import Comparison, WeighedModel, build_comparison_report
from tests.case.test_several_tests import BASE, CLAMP_EDGE, TWO
from tests.conftest import CONFIGS, TABLE_3, cheap_text, edited, of_case, shipped_text
from tests.studies.test_campaign import row_of

DATE = datetime.date(2026, 1, 5)
UNCERTAIN = "\n[uncertain.youngs_modulus]\nsd_percent = 2.0\n\n[uncertain.length]\nsd_percent = 0.5\n"
SAMPLER = {
    "ensembles": 4, "walkers": 4, "steps": 50, "max_steps": 50, "burn_in": 0, "thin": 1, "acceptance": 0.5,
    "move_acceptance": {"stretch": 0.3}, "proposal_efficiency": 0.5, "evaluations": 1, "singular": 0,
    "seconds": 1.0, "ess_per_second": 1.0,
}  # fmt: skip


def posterior_about(case, middle, widths):
    """A posterior of made-up draws about a point: only where they go matters. Widths may be a root of a covariance."""
    problem, rng, root = case.problem, np.random.default_rng(1), np.diag(widths) if np.ndim(widths) == 1 else widths
    theta = middle + rng.normal(size=(4, 25, middle.size)) @ root.T
    density = problem.log_posterior(theta.reshape(100, -1)).reshape(4, 25)
    tree = draws_tree(problem, Draws(theta, density, np.arange(4)), problem.prior.sample(rng, 100))
    at = float(problem.log_posterior(middle)[0])
    estimate = jb.MapEstimate(middle, problem.prior.values(middle), root @ root.T, at, ())
    ones = dict.fromkeys(problem.names, 1.0)
    sampler = SAMPLER | {"tau": ones, "ess": ones}
    record = RunRecord(case.name, case.text, 1, True, "made up", sampler, ones, package_versions())
    return jb.Posterior(problem, tree, estimate, BestDraw(middle, at), record, case)


def made_up(name, text, joint):
    """The same of a case's text about a joint, for its pages."""
    case = jb.case_from_text(name, text, directory=CONFIGS)
    prior = case.problem.prior
    middle = np.concatenate([prior.parametrisation.coordinates(joint), np.zeros(len(prior.nuisances))])
    widths = np.concatenate([np.full(len(joint), 0.02), 0.3 * prior.sd[len(joint) :]])
    return of_case(posterior_about(case, middle, widths), title=case.title, stated=None)


def report_of(posterior):
    """Its report, without profiles and the effect of uncertain inputs."""
    inputs = ReportInputs(posterior)
    inputs.__dict__["summary"] = posterior.summary()
    return build_report(inputs, DATE)


def with_coherence(posterior):
    """The same of FRFs that were measured with a coherence."""
    data = posterior.problem.test.data
    gain = np.abs(data.frf.values) ** 2
    frf = replace(data.frf, coherence=gain / (gain + data.variance))
    return replace(posterior, problem=posterior.problem.with_test(data=replace(data, frf=frf)))


def comparison(text=""):
    """A report of two joints, with a text wherever a user may put one."""
    evidence, joint = Evidence(-3.0, 0.01, text or "made up", 100), np.array([5e9, 3e7, 1.5e6])
    names = (text or "clamped_beam_frequencies_360mm", "springs_without_coupling_at_the_clamp")
    models = (WeighedModel(name, text or name, "rotation", ("k22",), joint, evidence, ()) for name in names)
    return build_comparison_report(Comparison(tuple(models), 1, text or "frequencies").summary())


def campaign(text="SN-7"):
    rows = [row_of(serial=text), row_of(key="b", converged=False), row_of(key="c", status="failed", error=text)]
    return campaign_page(f"campaign {text}", rows)


@pytest.fixture(scope="session")
def reports(cheap_case, cheap_inputs, frequency_posterior, tmp_path_factory, once):
    """Reports of each kind by name; nobody may change them."""
    return once("reports", lambda: every_report(cheap_case, cheap_inputs, frequency_posterior, tmp_path_factory))


def every_report(cheap_case, cheap_inputs, frequency_posterior, tmp_path_factory):
    frame = edited(
        shipped_text("portal_frame"),
        ('"lowA:x", "lowC:x", ', ""),
        ('"headA:x", ', ""),
        ("_step_hz = 2", "_step_hz = 8"),
    )
    truth = jb.case_from_text("frame", frame).tests[0].spec.data.truth.stiffness_by_name
    return {
        "main": build_report(cheap_inputs, DATE),
        "uncertain": report_of(with_coherence(made_up("uncertain", cheap_text() + UNCERTAIN, TABLE_3))),
        "tests": report_of(made_up("tests", BASE + CLAMP_EDGE + TWO, TABLE_3)),
        "frequencies": report_of(frequency_posterior),
        "frame": report_of(made_up("frame", frame, tuple(truth.values()))),
        "comparison": comparison(),
        "campaign": campaign(),
    }
