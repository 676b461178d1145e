"""How far the numbers carry: a failed check leads, freed quantities are the case's own or said to be assumed."""

import dataclasses
import datetime
import math
from dataclasses import replace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.cli.common import print_summary
from jointbayes.inference import workshop
from jointbayes.posterior import gather_knowledge
from jointbayes.posterior.identifiability import assess
from jointbayes.posterior.knowledge import (
    UncertainInputsRow,
    assumed_beyond,
    effect_of_uncertain_inputs,
    effect_sentence,
    inputs_taken_as_exact,
)
from jointbayes.posterior.verdicts import line_of, reason_lines
from jointbayes.report import ReportInputs, build_report
from jointbayes.report.model import Paragraph, Table
from jointbayes.report.sections import lead
from jointbayes.report.sections.identifiable import freed_blocks
from tests.conftest import CONFIGS, TO_CONVERGE, cheap_text, edited, judged_as, of_case

DATE = datetime.date(2026, 1, 5)
#: Data of a beam 23 mm shorter than the one analysed.
WRONG_LENGTH = cheap_text().replace("\n[data.truth]", "\n[data.truth]\nlength_mm = 360.0\n#")
UNCERTAIN = cheap_text() + "\n[uncertain.length]\nsd_percent = 0.1\n[uncertain.gain]\nsd_percent = 1.0\n"


@pytest.fixture(scope="module")
def uncertain():
    """A converged run: one that has not converged has no verdict, and then nothing is said of what it rests on."""
    case = jb.case_from_text("uncertain", UNCERTAIN)
    posterior = jb.sample(case, seed=1, settings=TO_CONVERGE)
    assert posterior.converged
    return posterior


@pytest.fixture(scope="module")
def gathered(uncertain):
    """What is known with what the case takes as exact freed as well."""
    return gather_knowledge(uncertain)


@pytest.fixture(scope="module")
def of_uncertain(uncertain, gathered):
    """The report's inputs of a case that assumes nothing, with the rows that its own quantities have."""
    inputs = ReportInputs(judged_as(of_case(uncertain), uncertain))
    inputs.__dict__["knowledge"] = replace(gathered, freed=gathered.freed[:2], assumed=())
    return inputs


def report(inputs):
    return build_report(inputs, DATE), inputs.summary.to_dict()


@pytest.fixture(scope="module")
def of_cheap(cheap_inputs):
    return report(cheap_inputs)


@pytest.mark.usefixtures("plain_reports")
def test_a_chain_too_short_for_an_effective_size_is_reported_with_a_dash(cheap_posterior, monkeypatch):
    monkeypatch.setattr("jointbayes.posterior.summary.effective_sizes", lambda chains: (float("nan"), float("nan")))
    built, summary = report(ReportInputs(of_case(cheap_posterior)))
    assert summary["parameters"]["k22"]["ess_bulk"] is None
    (numbers,) = (b for b in built.blocks() if isinstance(b, Table) and b.caption == "Posterior in numbers")
    assert [set(row[1:]) for row in numbers.rows[-2:]] == [{"–"}, {"–"}]


@pytest.mark.long
@pytest.mark.whole
def test_the_first_row_of_what_uncertain_quantities_cost_is_the_run(uncertain, gathered, monkeypatch):
    for name in ("k11", "k12", "k22"):
        verdict = replace(uncertain.verdict(name), exact=None)  # which the rows themselves show
        assert repr(gathered.freed[0].known[name]) == repr(verdict)  # NaN is not itself
    assert gathered.freed[0].source == "this run"
    # of a case that assumes nothing there are no further rows
    monkeypatch.setattr(
        "jointbayes.posterior.knowledge._row", lambda _, __, names, *___: UncertainInputsRow(names, "none", {})
    )
    assert [row.uncertain for row in effect_of_uncertain_inputs(uncertain)] == [("length", "gain"), ()]
    assert assumed_beyond(uncertain.problem, None) == ()


@pytest.mark.whole
@pytest.mark.long
def test_what_all_else_known_would_give_is_what_sampling_that_case_gives(of_uncertain, cheap_posterior):
    # the same data, and a case of its own in which length and gain are exactly known
    known = next(row for row in of_uncertain.knowledge.freed if not row.uncertain)
    assert known.source == "sampling"
    for name in ("k11", "k12", "k22"):
        alone = cheap_posterior.verdict(name)
        assert known.known[name].sd_log == pytest.approx(alone.sd_log, rel=0.12)
        low, high = alone.interval
        assert known.known[name].interval == pytest.approx((low, high), abs=0.1 * (high - low))


@pytest.mark.science
def test_freeing_what_a_case_takes_as_known_gives_what_sampling_it_uncertain_gives(cheap_posterior):
    case = jb.case_from_text("gain", cheap_text() + "\n[uncertain.gain]\nsd_percent = 5.0\n")
    sampled = jb.sample(case, seed=1, settings=TO_CONVERGE)
    assert sampled.converged
    run, freed = effect_of_uncertain_inputs(cheap_posterior, case.problem)
    assert (run.uncertain, freed.uncertain) == ((), ("gain",))
    for name in ("k11", "k12", "k22"):
        ends = np.log([freed.known[name].interval, sampled.interval(name)])
        assert ends[0] == pytest.approx(ends[1], abs=0.1 * np.ptp(ends[1]))
        assert freed.verdict[name] == sampled.verdict(name).cls


@pytest.mark.whole
def test_a_freed_row_is_bounded_by_its_prior_as_a_run_is():
    text = edited(cheap_text(), ("high = 1.0e11", "high = 1.0e10"), ("relative = 0.008", "relative = 0.0085"))
    sampled = jb.sample(jb.case_from_text("held", text), settings=TO_CONVERGE)
    assert sampled.converged
    uncertain = jb.case_from_text("gain", text + "\n[uncertain.gain]\nsd_percent = 0.5\n").problem
    run, freed = effect_of_uncertain_inputs(sampled, uncertain)
    for row in (run, freed):
        assert row.known["k11"].because.startswith(
            "the test sets no upper limit before the prior's upper bound 10.0 GN/m"
        )
    assert freed.verdict == run.verdict


def row_of(uncertain, **sd):
    """A row whose stiffnesses are known to these standard deviations of their logarithms."""
    score, prior = np.linspace(-3, 3, 2001), np.exp(np.linspace(-10, 10, 2001))
    score = score * np.sqrt(1 / score.var())
    return UncertainInputsRow(uncertain, "this run", {n: assess(np.exp(s * score), prior) for n, s in sd.items()})


def row_of_intervals(uncertain, **ends):
    """A row whose stiffnesses have these 95 % intervals, equal-tailed about their geometric middle, within 1 %."""
    score, prior = np.linspace(-1, 1, 4001) / 0.95, np.exp(np.linspace(-40, 40, 2001))
    known = {}
    for name, (low, high) in ends.items():
        draws = np.exp((math.log(high / low) * score + math.log(high * low)) / 2)
        known[name] = replace(assess(draws, prior), unit="N/m")
    return UncertainInputsRow(uncertain, "this run", known)


@pytest.mark.parametrize(
    ("freed", "holds"),
    [
        ((100.0, 110.0), True),
        ((97.8, 112.4), True),  # 1.46 times as wide
        ((97.3, 112.9), False),  # 1.56 times
        ((104.6, 114.9), True),  # moved by 0.46 of its width
        ((105.1, 115.5), False),  # by 0.52
        ((95.8, 105.0), True),
        ((95.0, 104.6), False),
        ((94.5, 108.5), False),  # one end further out by 0.59, 1.45 times as wide, the median inside
        ((101.5, 115.9), False),  # the other by 0.55
        ((104.9, 105.0), True),  # narrower, inside
        ((109.9, 111.0), False),  # narrower, its median outside
        ((100.0, 130.0), False),  # identified no more
    ],
)
def test_a_verdict_is_unconditional_where_freed_inputs_leave_its_interval(freed, holds):
    run, row = row_of_intervals((), k=(100.0, 110.0)), row_of_intervals(("density", "length"), k=freed)
    exact = inputs_taken_as_exact((run, row))
    assert ("k" not in exact) == holds
    if not holds:
        assert exact["k"].quantities == ("density", "length")
        other = "" if row.verdict == run.verdict else f", {row.verdict['k']}"
        conditional = replace(run.known["k"], exact=exact["k"])
        assert conditional.next_to_it == f"with density and length uncertain {row.known['k'].value}{other}"
    # a change that the Monte Carlo errors of the ends explain is none
    noisy = replace(row, known={"k": replace(row.known["k"], interval_error=(8.0, 8.0))})
    within = run.verdict == row.verdict and 100 < row.known["k"].median < 110
    assert ("k" not in inputs_taken_as_exact((run, noisy))) == (holds or within)


def test_what_could_not_be_shown_is_no_reason_to_say_less():
    run = row_of_intervals((), k=(100.0, 110.0), open=(1.0, 1e6))
    none = UncertainInputsRow(("length",), "none", {})
    exact = inputs_taken_as_exact((run, none))
    assert list(exact) == ["k"]  # nothing is claimed of the other
    assert str(replace(run.known["k"], exact=exact["k"])) == "identified, if length is exact"
    said = replace(run.known["k"], exact=exact["k"]).next_to_it
    assert said == "what is known with length uncertain could not be shown"
    # what is uncertain in the run itself is no condition, and where nothing else is there is none
    own = replace(run, uncertain=("length",))
    assert inputs_taken_as_exact((own, none, replace(run, uncertain=()))) == {}
    assert inputs_taken_as_exact((own, replace(none, uncertain=("length", "density"))))["k"].quantities == ("density",)
    assert inputs_taken_as_exact(()) == {}


def test_a_one_sided_limit_is_compared_as_one():
    def bounded(uncertain, limit, verdict="bounded below"):
        row = row_of_intervals(uncertain, k=(100.0, 1e6))
        return replace(row, known={"k": replace(row.known["k"], cls=verdict, limit=limit)})

    run = bounded((), 100.0)
    for limit, holds in ((99.0, True), (67.0, True), (66.0, False), (500.0, True)):
        assert (inputs_taken_as_exact((run, bounded(("length",), limit))) == {}) == holds
    assert inputs_taken_as_exact((run, bounded(("length",), 100.0, "bounded above")))
    above = bounded((), 100.0, "bounded above")
    for limit, holds in ((101.0, True), (149.0, True), (151.0, False), (20.0, True)):
        assert (inputs_taken_as_exact((above, bounded(("length",), limit, "bounded above"))) == {}) == holds


@pytest.mark.whole
@pytest.mark.parametrize("computed", [True, False])
def test_of_what_was_measured_page_one_gives_the_answer_of_a_workshop_first(computed, cheap_inputs):
    inputs = ReportInputs(cheap_inputs.posterior)
    fit = dataclasses.replace(cheap_inputs.summary.fit, synthetic_data=computed)
    inputs.__dict__["knowledge"] = cheap_inputs.knowledge
    inputs.__dict__["summary"] = dataclasses.replace(cheap_inputs.summary, fit=fit)
    table = next(block for block in lead.lead(inputs) if isinstance(block, Table))
    titles = ["Inputs exact", "Inputs as in a workshop"]
    assert list(table.head[1:3]) == (titles if computed else titles[::-1])
    rests = next(b.text for b in lead.lead(inputs) if getattr(b, "text", "").startswith("**Rests on.**"))
    assert ", ".join(inputs.knowledge.assumed) in rests


@pytest.mark.whole
def test_page_one_terminal_and_summary_say_what_a_verdict_rests_on(cheap_inputs, of_cheap, capsys):
    inputs, posterior = cheap_inputs, cheap_inputs.posterior
    built, summary = of_cheap
    freed = inputs.knowledge.freed[-1].known["k22"]
    assert summary["parameters"]["k22"]["conditions"] == ["youngs_modulus", "density", "length", "damping_ratio"]
    workshop = summary["under"]["workshop"]["k22"]
    assert (workshop["interval95"], workshop["verdict"]) == (list(freed.interval), freed.cls)
    table = next(b for b in built.lead if isinstance(b, Table) and b.caption.startswith("Stiffness of the joint"))
    row = next(row for row in table.rows if row[0].startswith("**k22**"))
    known = inputs.summary.parameters["k22"].known
    assert row[1:3] == (f"{known.value}\nidentified", f"{freed.value}\n{freed.cls}")
    inputs_of = "Young's modulus, density, length and damping ratio"
    only_if = f"identified, if {inputs_of} are exact"
    beside = f"with {inputs_of} uncertain {freed.value}"
    assert f"**k22**: {only_if} (" in " ".join(b.text for b in built.blocks() if isinstance(b, Paragraph))
    assert summary["identifiability"]["sentence"].startswith(f"With {inputs_of}")
    print_summary(posterior, inputs.knowledge)
    lines = capsys.readouterr().out.splitlines()
    assert not any(beside in line for line in lines)  # only with --verbose
    assert any(text.startswith(beside) for text in reason_lines(posterior.verdict("k22")))
    assert max(map(len, lines)) <= 200
    print_summary(replace(posterior))  # without a report nobody looked
    said = capsys.readouterr().out
    assert f": {only_if}" in said
    assert f"What is known with {inputs_of} uncertain: posterior.under" in said


@pytest.mark.whole
def test_what_a_case_takes_as_exact_beside_its_own_uncertain_quantities_is_freed_too(gathered):
    rows = gathered.freed
    names = ("youngs_modulus", "density", "length", "damping_ratio", "gain")
    assert [row.uncertain for row in rows[:2]] == [("length", "gain"), ()]
    assert set(rows[2].uncertain) == set(names)
    assert inputs_taken_as_exact(rows)["k22"].quantities == ("youngs_modulus", "density", "damping_ratio")
    assert [word.split(" to ")[0] for word in gathered.assumed] == ["Young's modulus", "density", "damping ratio"]


@pytest.mark.whole
@pytest.mark.parametrize(
    ("limit", "value"), [("sampling.sampler.ALONE", -1.0), ("posterior.knowledge._AFFORDABLE", 100)]
)
def test_where_no_draws_can_be_trusted_or_afforded_a_row_says_nothing(
    limit, value, of_uncertain, cheap_posterior, uncertain, monkeypatch
):
    monkeypatch.setattr(f"jointbayes.{limit}", value)
    rows = effect_of_uncertain_inputs(cheap_posterior, uncertain.problem)
    assert len(rows) == 2
    assert rows[-1].source == "none"
    assert rows[-1].known == {}
    assert (
        effect_sentence(rows)
        == "Whether other uncertain quantities matter is open: the calculation that would show it did not settle."
    )
    _, table = freed_blocks(replace(of_uncertain.knowledge, freed=(rows[0], *rows)))
    assert isinstance(table, Table)
    assert table.rows[-1] == ("length, gain", "–", "–", "–", "–", "–")


@pytest.mark.whole
def test_of_many_stiffnesses_each_has_a_row_of_what_uncertain_inputs_do_to_it(of_uncertain):
    freed = (*of_uncertain.knowledge.freed, of_uncertain.knowledge.freed[-1])  # a third row, so that there is a table
    many = tuple(replace(row, known={f"{n}.kx": next(iter(row.known.values())) for n in "ABCDEF"}) for row in freed)
    few, turned = (freed_blocks(replace(of_uncertain.knowledge, freed=rows))[1] for rows in (freed, many))
    assert [row[0] for row in turned.rows][:6] == [f"{n}.kx, 95 % interval" for n in "ABCDEF"]
    assert turned.head[1:] == tuple(row[0] for row in few.rows)
    assert [row[1:] for row in turned.rows[:6]] == [tuple(row[1] for row in few.rows)] * 6


def test_where_all_is_known_the_usual_uncertainty_is_assumed_and_said_to_be(cheap_case, cheap_posterior, of_cheap):
    built, summary = of_cheap
    assert list(summary["under"]) == ["workshop"]
    assert list(summary["under"]["workshop"]) == ["k11", "k12", "k22"]
    text = " ".join(b.text for b in built.blocks() if isinstance(b, Paragraph))
    said = (
        "Young's modulus to 3 %, density to 1 %, length to 0.5 %, damping ratio to between 0.1 and 10 times the stated"
    )
    assert "Young's modulus, density, length and damping ratio are taken as exact. With inputs as in a" in text
    assert f"as in a workshop ({said})" in text
    assert said in (CONFIGS.parent / "docs" / "identifiability.md").read_text(encoding="utf-8").replace("\n> ", " ")
    assert ", ".join(summary["identifiability"]["freed_assumptions"]) == said
    # the assumed problem is the case's own where its quantities are at their stated values
    whole = np.concatenate([cheap_posterior.estimate.theta, np.zeros(4)])
    found = cheap_case.workshop_problem.log_posterior.log_likelihood(whole)
    own = cheap_case.problem.log_posterior.log_likelihood(cheap_posterior.estimate.theta)
    np.testing.assert_allclose(found, own, rtol=1e-6)


def test_other_premises_have_verdicts_and_draws_of_their_own_that_are_kept(cheap_posterior, cheap_inputs, tmp_path):
    cheap_posterior.save(tmp_path / "posterior.nc")
    under = jb.load_posterior(tmp_path / "posterior.nc").under
    (workshop,) = under.values()
    assert list(under) == ["workshop"]
    found = cheap_inputs.knowledge.freed[-1]
    assert 1000 <= workshop.draws.sizes["draw"] <= 2000
    of_arviz = workshop.to_arviz()["posterior"]
    for column, (name, known) in enumerate(cheap_inputs.knowledge.workshop.items()):
        np.testing.assert_array_equal(workshop.draws[name], found.draws[:, column][None])
        np.testing.assert_array_equal(of_arviz[name], workshop.draws[name])
        assert workshop.draws[name].attrs["units"] == cheap_posterior.unit(name)
        assert (workshop.verdict(name).value, workshop.verdict(name).cls) == (known.value, known.cls)
        assert workshop.interval(name) == workshop.verdict(name).interval
        assert line_of(name, workshop.verdict(name)) in repr(workshop)
        np.testing.assert_allclose(np.log(workshop.interval(name, 0.9501)), np.log(known.interval), atol=0.3)
        narrow, wide = cheap_posterior.interval(name), workshop.interval(name, 0.999)
        assert wide[0] < narrow[0] < narrow[1] < wide[1]
    assert repr(workshop).startswith("With Young's modulus, density, length and damping ratio uncertain:\n")
    for wrong, message in (
        (("k33",), "found no draws of 'k33'; expected one of k11, k12, k22"),
        (("k22", 1.0), "found"),
    ):
        with pytest.raises(jb.ModelError, match=message):
            workshop.interval(*wrong)


def test_what_is_assumed_is_said_from_the_priors_that_are_used(monkeypatch):
    case = jb.case_from_text("cheap", cheap_text())
    assert assumed_beyond(case.problem, case.workshop_problem)[0] == "Young's modulus to 3 %"
    monkeypatch.setitem(workshop.WORKSHOP_SD_PERCENT, "youngs_modulus", 4.0)
    case = jb.case_from_text("cheap", cheap_text())
    assert assumed_beyond(case.problem, case.workshop_problem)[0] == "Young's modulus to 4 %"
