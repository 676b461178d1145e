"""Golden pages: what terminal, summary, page one and reports say of made-up results, a sentence a line.

`GOLDEN=update pytest -n 0 tests/report/test_golden.py` keeps what they say now; read the diff.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.cli.common import print_summary
from jointbayes.identification import SearchEffort
from jointbayes.posterior.checks import checks_of
from jointbayes.posterior.sampled import BestDraw, recall
from jointbayes.posterior.verdicts import mode_sentence
from jointbayes.report import Report, ReportInputs, render_html
from jointbayes.report.model import Table
from jointbayes.report.sections.identifiable import verdict_sentences
from jointbayes.report.sections.lead import lead
from tests.case.test_several_tests import BASE, TWO
from tests.conftest import TABLE_3, cheap_text, of_case, plain_reports, unsettled
from tests.golden import require_kept
from tests.posterior.test_decision import as_measured
from tests.posterior.test_verdicts import bound_at_draws, with_cached
from tests.report import conftest as kinds
from tests.report import test_several_tests as several
from tests.same.record import sentences

GOLDEN = Path(__file__).parent / "golden"
#: Lines whose numbers may differ: they tell how small an error is or where a failed iteration went.
LOOSE = ("It moves k", "The paper's iteration", "Step ")
PASSING = re.compile(r"\b\d{4}-\d\d-\d\d(?=jointbayes)|\b[0-9a-f]{16,64}\b")


def moved(posterior, gain, *sds):
    """The posterior whose draws lead to a mode so many standard deviations away, so much higher."""
    sd = np.sqrt(np.diag(posterior.estimate.covariance))
    at = posterior.estimate.log_posterior + gain
    return replace(posterior, best=BestDraw(posterior.estimate.theta + sd * np.array(sds), at))


def unfit(posterior, chi2=9.0):
    """The very posterior with another misfit per line."""
    check = replace(checks_of(posterior)[0], chi2_per_line=chi2)
    recall(posterior, {"checks_of": (check,)})
    return posterior


def excluding(posterior, share):
    """The posterior of which the draws beyond its limit are so small a share of the prior's."""
    tree, limit = posterior.tree.copy(deep=True), np.quantile(posterior.values("k22"), 0.05)
    drawn = tree["prior"].to_dataset()["k22"]
    below = np.arange(drawn.size) < share * drawn.size
    tree["prior/k22"] = drawn.copy(data=np.where(below, limit / 2, limit * 20.0)[None])
    return bound_at_draws(replace(posterior, tree=tree), "upper", low=limit)


def failed_search(posterior):
    effort = SearchEffort(squares=400.0, limit=1.2, starts=20, agreeing=12)
    return replace(posterior, estimate=replace(posterior.estimate, effort=effort))


ABOUT = {
    "title": "Clamp", "specimen": "Clamp **12**", "date": "2026-11-25", "operator": "A. Miller",
    "instruments": "hammer 086C03",
}  # fmt: skip
#: States of one result, by what is the matter with it.
STATES = {
    "settled": lambda p: p,
    "measured": as_measured,
    "measured_does_not_fit": lambda p: unfit(as_measured(p)),
    "stopped": lambda p: unsettled(p, "not converged at 9 of 9 steps", apart=1.5),
    "stopped_without_a_doubt": lambda p: unsettled(p, "not converged at 9 of 9 steps"),
    "missed_the_best_fit": lambda p: moved(p, 7.25, 1.0, 1.0, 1.0),
    "mode_apart": lambda p: moved(p, -3.0, 0.0, 2.5, 0.0),
    "mode_outside_an_interval": lambda p: replace(p, best=replace(p.best, theta=p.best.theta + np.eye(3)[2])),
    "model_does_not_fit": lambda p: unfit(with_cached(p), 9.0),
    "model_fits_badly": lambda p: unfit(with_cached(p), 4.0),
    "noise_stated_too_large": lambda p: unfit(with_cached(p), 0.3),
    "model_fits": lambda p: unfit(with_cached(p), 1.0),
    "both_bounds_and_does_not_fit": lambda p: unfit(bound_at_draws(p, "lower", "upper")),
    "upper_bound_and_does_not_fit": lambda p: unfit(bound_at_draws(p, "upper", low=1.4e6)),
    "mode_apart_and_does_not_fit": lambda p: unfit(moved(p, -3.0, 0.0, 2.5, 0.0)),
    "stopped_and_does_not_fit": lambda p: unfit(unsettled(p)),
    "upper_bound": lambda p: bound_at_draws(p, "upper", low=1.4e6),
    "lower_bound": lambda p: bound_at_draws(p, "lower", high=1.7e6),
    "both_bounds": lambda p: bound_at_draws(p, "lower", "upper"),
    "limit_of_the_prior": lambda p: excluding(p, 0.09),
    "limit_of_the_data": lambda p: excluding(p, 0.11),
    "search_missed_the_data": failed_search,
    "with_what_was_tested": lambda p: of_case(p, about=ABOUT),
}


@pytest.fixture(scope="module")
def made():
    """A result of made-up draws about the best fit: of k11 little is known, and k22 is known well."""
    case = jb.case_from_text("cheap", cheap_text())
    best = jb.find_map(case, seed=1)
    return replace(kinds.posterior_about(case, best.theta, np.linalg.cholesky(best.covariance)), estimate=best)


#: Marks of a sentence whose parts were joined badly, and of numbers in a wrong form.
GARBLED = re.compile(r",;|,\)| \)|\( |: ;|;;|\.\.(?!\.)|,\.|×\s10[⁰¹²³⁴-⁹]+ %|\de\d %|(?<![\d.])0 % of|\bnan\b|\binf\b")


def in_sentences(text):
    """Lines of a terminal, broken at the ends of sentences."""
    return [part for line in text.splitlines() for part in re.split(r"(?<=[.!?:;]) (?=[A-Z*])", line.strip()) if part]


def page_of_state(posterior, capsys):
    """All that is said of a result in short: on the terminal, in the summary and on page one."""
    inputs = ReportInputs(posterior)
    summary = inputs.__dict__["summary"] = posterior.summary()
    print_summary(posterior)
    blocks = tuple(lead(inputs))
    colours = ", ".join(kind for block in blocks if isinstance(block, Table) for kind in block.row_kinds)
    report = Report("Clamp", "", blocks, (), kinds.DATE, "1")
    parts = {
        "terminal": in_sentences(f"{capsys.readouterr().out}{mode_sentence(posterior)}"),
        "summary": in_sentences(f"{summary}\n{posterior!r}\n{posterior.estimate!r}"),
        "page one": [
            *sentences(render_html(report)),
            f"Rows of the table: {colours}",
            *in_sentences(verdict_sentences(summary)),
        ],
    }
    return [line for title, lines in parts.items() for line in (f"# {title}", *lines)]


def require_golden(name, found):
    """The page is the one that is kept, word by word, and its numbers are near; of a variant what its base lacks."""
    found = [PASSING.sub(lambda m: "DATE" if "-" in m[0] else "HASH", line) for line in found]
    if name in VARIANTS:
        base = {*(GOLDEN / f"{VARIANTS[name]}.txt").read_text(encoding="utf-8").splitlines()}
        found = [line for line in found if line not in base]
    require_kept(GOLDEN / f"{name}.txt", found, LOOSE)


def with_published(posterior, values):
    return kinds.report_of(of_case(posterior, reference=np.array(values), reference_source="Table 3"))


#: Whole reports, by what they are about; what only one of several tests says stands in the pages of tests.
REPORTS = {
    "report": lambda p: with_published(p, TABLE_3),
    "report_published_disagree": lambda p: with_published(p, (5.05e9, -3.44e7, 1.52e6)),
    "report_missed_the_best_fit": lambda p: kinds.report_of(of_case(moved(p, 9.0, 1.0, 1.0, 1.0))),
    "report_measured": lambda p: kinds.report_of(as_measured(p)),
    "report_model_does_not_fit": lambda p: kinds.report_of(unfit(of_case(p))),
    "report_uncertain": lambda _: kinds.report_of(
        kinds.with_coherence(kinds.made_up("uncertain", cheap_text() + kinds.UNCERTAIN, TABLE_3))
    ),
    "report_overhangs": lambda _: of_tests(BASE + TWO + several.HEARD),
    "report_torques": lambda _: of_tests(several.OWN + several.TORQUES),
    "comparison": lambda _: kinds.comparison(),
}


#: Of these only the lines are kept that the page of another name does not have.
VARIANTS = {
    "report_published_disagree": "report",
    "report_missed_the_best_fit": "report",
    "report_measured": "report",
    "report_model_does_not_fit": "report",
}


def of_tests(text, sd=0.01):
    return kinds.report_of(several.posterior_of(jb.case_from_text("tests", text), sd))


@pytest.mark.parametrize("name", REPORTS)
def test_what_a_report_says(name, made):
    with plain_reports():
        require_golden(name, sentences(render_html(REPORTS[name](made))))


@pytest.mark.parametrize("name", STATES)
def test_what_is_said_of_a_result(name, made, capsys):
    with plain_reports():
        posterior = STATES[name](made)
        require_golden(name, page_of_state(posterior, capsys))
        if name == "with_what_was_tested":
            assert posterior.summary().to_dict()["about"] == ABOUT


def test_every_golden_page_is_compared():
    assert {path.stem for path in GOLDEN.glob("*.txt")} == {*STATES, *REPORTS}


@pytest.mark.parametrize("page", sorted(GOLDEN.glob("*.txt")), ids=lambda page: page.stem)
def test_no_page_holds_a_garbled_sentence(page):
    lines = page.read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if GARBLED.search(line)] == []


@pytest.mark.parametrize(
    "text",
    ["moves: ; 0 steps", "up to 71.7 GN/m,)", "GN/m,; its draws", "1 × 10² %", "1e2 %", "exclude only 0 % of the"],
)
def test_garbled_sentences_are_seen(text):
    assert GARBLED.search(text)
