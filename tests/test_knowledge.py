"""How far the numbers carry: a failed check leads, freed quantities are the case's own or said to be assumed."""

import datetime
from dataclasses import replace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.case import case_from_text
from jointbayes.posterior import gather_knowledge, summarise
from jointbayes.report import ReportInputs, build_report, render_html
from jointbayes.report.knowledge_section import coordinate_label
from jointbayes.report.model import Callout, Paragraph, Table
from tests.conftest import cheap_text

INITIAL = (1e8, 0.0, 0.0)
DATE = datetime.date(2026, 1, 5)
SHORT = jb.SamplerSettings(walkers=16, max_steps=200)
#: Data of a beam 23 mm shorter than the one analysed.
WRONG_LENGTH = cheap_text().replace("\n[data.truth]", "\n[data.truth]\nlength_mm = 360.0\n#")
UNCERTAIN = cheap_text() + "\n[uncertain.length]\nsd_percent = 0.5\n[uncertain.gain]\nsd_percent = 1.0\n"


@pytest.fixture(scope="module")
def wrong():
    case = case_from_text("wrong length", WRONG_LENGTH)
    return jb.sample(case, seed=1, settings=SHORT)


@pytest.fixture(scope="module")
def uncertain():
    case = case_from_text("uncertain", UNCERTAIN)
    return jb.sample(case, seed=1, settings=SHORT)


def report(posterior, freed=None):
    inputs = ReportInputs(posterior, "Clamp", INITIAL, freed=freed)
    return build_report(inputs, DATE), inputs.summary


def test_a_model_that_does_not_explain_the_data_leads_the_report(wrong):
    built, summary = report(wrong)
    assert not summary["check"]["explains"]
    first = built.lead[0]
    assert isinstance(first, Callout)
    assert first.kind == "bad"
    assert first.text.startswith("**The model does NOT explain the data**:")
    assert "does NOT explain the data" in render_html(built)


def test_a_model_that_explains_them_says_so_with_its_figures(cheap_posterior):
    built, summary = report(cheap_posterior)
    assert summary["check"]["explains"]
    assert not any("NOT explain" in block.text for block in built.lead if isinstance(block, Callout))
    said = [b.text for b in built.lead if isinstance(b, Paragraph) and "explains the data" in b.text]
    assert f"{summary['check']['chi2_per_line']:.3g} times" in said[0]


def test_a_chain_too_short_for_an_effective_size_is_reported_with_a_dash(wrong, monkeypatch):
    monkeypatch.setattr("jointbayes.posterior.summary.effective_sizes", lambda chains: (float("nan"), float("nan")))
    built, summary = report(wrong)
    assert summary["parameters"]["k22"]["ess_bulk"] is None
    tables = [b for section in built.sections for b in section.blocks if isinstance(b, Table)]
    (numbers,) = (t for t in tables if t.caption == "Posterior in numbers")
    assert all(row[-2:] == ("–", "–") for row in numbers.rows)


def test_the_check_of_a_posterior_is_the_same_each_time(cheap_posterior):
    # a copy has nothing kept from before
    first, second = gather_knowledge(cheap_posterior).check, gather_knowledge(replace(cheap_posterior)).check
    assert first is not second
    assert first.sentence == second.sentence


def test_what_the_case_calls_uncertain_is_freed_in_the_table(uncertain):
    knowledge = gather_knowledge(uncertain)
    assert not knowledge.assumed
    assert [row.freed for row in knowledge.freed] == [(), ("length",), ("gain",), ("length", "gain")]
    known, free = knowledge.freed[0].sd_log, knowledge.freed[-1].sd_log
    assert all(free[name] >= known[name] for name in known)
    assert free["k22"] > 2 * known["k22"]


def test_where_all_is_known_the_usual_uncertainty_is_assumed_and_said_to_be(cheap_case, cheap_posterior):
    knowledge = gather_knowledge(cheap_posterior, cheap_case.workshop_problem)
    assert knowledge.assumed
    assert knowledge.freed[-1].freed == ("youngs_modulus", "density", "length", "damping_ratio")
    built, _ = report(cheap_posterior, cheap_case.workshop_problem)
    text = " ".join(b.text for b in built.blocks() if isinstance(b, Paragraph))
    assert "This case takes everything beside the joint as exactly known" in text
    # the assumed problem is the case's own where its quantities are at their stated values
    whole = np.concatenate([cheap_posterior.estimate.theta, np.zeros(4)])
    found = cheap_case.workshop_problem.log_posterior.log_likelihood(whole)
    own = cheap_case.problem.log_posterior.log_likelihood(cheap_posterior.estimate.theta)
    np.testing.assert_allclose(found, own, rtol=1e-6)


def test_other_quantities_have_a_section_with_prior_and_posterior(uncertain):
    built, summary = report(uncertain)
    section = next(s for s in built.sections if s.identifier == "nuisances")
    (table,) = (b for b in section.blocks if isinstance(b, Table))
    assert [row[0] for row in table.rows] == ["length", "gain"]
    assert set(summary["nuisances"]) == {"length", "gain"}
    assert summary["nuisances"]["length"]["nominal"] == pytest.approx(383.0)
    plain, _ = report(replace(uncertain))
    assert [s.identifier for s in plain.sections] == [s.identifier for s in built.sections]


def test_correlations_are_those_of_the_draws(uncertain):
    built, _ = report(uncertain)
    table = next(b for b in built.blocks() if isinstance(b, Table) and b.caption == "Correlation of the draws")
    assert table.head == ("", "ln k11", "ln k12", "ln k22")
    assert [row[0] for row in table.rows] == ["ln k11", "ln k12", "ln k22", "ln L", "ln gain"]
    found = np.corrcoef(np.log(uncertain.values("k22").ravel()), np.log(uncertain.values("length").ravel()))[0, 1]
    assert float(table.rows[3][3]) == pytest.approx(found, abs=0.006)


def test_the_summary_without_knowledge_still_holds_the_check(cheap_posterior):
    summary = summarise(cheap_posterior, INITIAL)
    assert summary["identifiability"] is None
    assert summary["check"]["explains"] is True


@pytest.mark.parametrize(
    ("name", "label"),
    [("k11", "ln k11"), ("rho", "ρ"), ("damping_ratio_2", "ln ζ2"), ("mode_frequency_1", "ln f1"), ("gain", "ln gain")],
)
def test_coordinates_have_short_labels(name, label):
    assert coordinate_label(name) == label
