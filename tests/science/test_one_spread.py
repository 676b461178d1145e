"""Every spread that a report prints is that of the draws, and of a stiffness that of page one, wherever it stands."""

import datetime
import math
import re

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.posterior.posterior import gather_knowledge
from jointbayes.report import ReportInputs, build_report
from jointbayes.report.model import Callout, Paragraph, Table
from tests.conftest import CONFIGS, TO_CONVERGE, first_in_ci

pytestmark = pytest.mark.science

SCALE = {"": 1.0, "k": 1e3, "M": 1e6, "G": 1e9}
_LIMIT = r"(k11|k12|k22) is bounded (?:below|above): (?:above|below) (\S+ [GMk]?N\S*)"
_NUMBER = r"-?[\d.]+(?:e-?\d+)?"
_SPREAD = rf"(\S.*?) is ([a-z ]+): {_NUMBER} \(({_NUMBER}) to ({_NUMBER})\),? (SI|[GMk]?N)"
NAMES = ("k11", "k12", "k22")
CASES = ("clamped_beam", "clamped_beam_frequencies")


@pytest.fixture(scope="module", params=first_in_ci(CASES, 1))
def written(request):
    case = jb.load_case(CONFIGS / f"{request.param}.toml")
    posterior = jb.sample(case, seed=1, settings=TO_CONVERGE)
    inputs = ReportInputs(posterior)
    return posterior, build_report(inputs, datetime.date(2026, 1, 5)), inputs.summary.to_dict()


def values_of(quantity, posterior):
    """A printed quantity evaluated on the draws, by reading what is printed."""
    formula = re.sub(r"\s*\(.*\)$", "", quantity) if "moves with" in quantity else quantity
    for sign, code in {"−": "-", "²": "**2", "·": "*", "^": "**", "exp": "np.exp"}.items():
        formula = formula.replace(sign, code)
    formula = re.sub(r"([\d.]+) rho", r"\1*rho", formula)
    k = {name: posterior.values(name).ravel() for name in NAMES}
    return eval(formula, {"np": np}, k | {"rho": k["k12"] / np.sqrt(k["k11"] * k["k22"])})


def figures_of(values):
    """95 % interval and its ratio, infinite where there are draws of both signs."""
    low, high = np.quantile(values, [0.025, 0.975])
    one_sign = (values > 0).all() or (values < 0).all()
    return (low, high), max(high / low, low / high) if one_sign else math.inf


def printed_of(quantity, posterior):
    """Interval and ratio as they are to be printed: of the draws."""
    return figures_of(values_of(quantity, posterior))


def limit_of(name, summary):
    """Limit of a bounded quantity."""
    return summary["parameters"][name]["limit"]


def of_the_rule(ratio):
    return "identified" if ratio <= 1.25 else "weakly identified" if ratio <= 3 else "not identified"


def table_of(report, caption):
    (table,) = (b for b in report.blocks() if isinstance(b, Table) and b.caption == caption)
    return table


def texts(report):
    return [b.text for b in report.blocks() if isinstance(b, Paragraph | Callout)]


@pytest.mark.long
def test_every_combination_in_the_summary_has_the_spread_of_its_own_draws(written):
    posterior, _, summary = written
    directions = summary["identifiability"]["directions"]
    assert len(directions) == 3
    bounded = {name for name, p in summary["parameters"].items() if p["verdict"].startswith("bounded")}
    assert {d["quantity"] for d in directions if d["limit"]} == bounded
    for named in directions:
        values = values_of(named["quantity"], posterior)
        ends, ratio = printed_of(named["quantity"], posterior)
        assert named["limit"] or named["interval95"] == pytest.approx(ends, rel=1e-4)
        if named["quantity"] in NAMES:
            assert named["verdict"] == summary["parameters"][named["quantity"]]["verdict"]
        if math.isinf(ratio):
            assert named["ratio"] is None
            assert named["verdict"] == "not identified"
        else:
            assert named["limit"] or named["ratio"] == pytest.approx(ratio, rel=1e-4)
            assert named["sd_log"] == pytest.approx(np.log(np.abs(values)).std(), rel=1e-9)
            # the class is that of the draws, whose ends may be nearer than those that are printed
            drawn = figures_of(values)[1]
            assert named["limit"] or named["verdict"] in (of_the_rule(ratio), of_the_rule(drawn), "not identified")


def test_every_sentence_about_a_spread_says_what_the_draws_say(written):
    posterior, report, summary = written
    found = 0
    for text in [*texts(report), summary["identifiability"]["sentence"]]:
        for clause in re.split(r"; |\. ", text.replace("**", "")):
            clause = re.sub(r"^With [^:]+ exactly known: ", "", clause)
            if (match := re.match(_LIMIT, clause)) is not None:
                name, printed = match.groups()
                limit, prefixed = printed.split()
                expected = limit_of(name, summary)
                assert float(limit) * SCALE[prefixed.partition("N")[0]] == pytest.approx(expected, rel=0.01)
                found += 1
                continue
            match = re.match(_SPREAD, clause)
            if match is None:
                continue
            quantity, verdict, *printed, unit = match.groups()
            quantity = quantity.removeprefix("The coupling stiffness ")
            ends, ratio = printed_of(quantity, posterior)
            scale = SCALE[unit.removesuffix("SI").removesuffix("N")]
            assert [scale * float(end) for end in printed] == pytest.approx(ends, rel=0.03)  # of two digits
            assert verdict in {of_the_rule(r) for r in (ratio, figures_of(values_of(quantity, posterior))[1])}
            found += 1
    assert found >= 2


def test_the_table_of_combinations_prints_the_same_numbers(written):
    posterior, report, summary = written
    table = table_of(report, "Combinations of the stiffnesses that are determined independently")
    for quantity, interval, ratio, sd, _ in table.rows:
        if " to " not in interval:
            _, limit, unit, *_ = interval.split(" ")
            expected = limit_of(quantity, summary)
            assert float(limit) * SCALE[unit.partition("N")[0]] == pytest.approx(expected, rel=0.01)
            assert (ratio, sd) == ("–", "–")
            continue
        ends, expected = printed_of(quantity, posterior)
        printed = [float(end) for end in interval.split(" to ")]
        assert printed == pytest.approx(ends, rel=0.01)
        assert (ratio == "–") if math.isinf(expected) else float(ratio) == pytest.approx(expected, rel=0.01)
        assert (sd == "–") == math.isinf(expected)


def test_no_spread_is_wider_than_any_within_the_range_of_the_prior(written):
    posterior, _, _ = written
    for row in gather_knowledge(posterior).freed:
        for name, known in row.known.items():
            if math.isfinite(sd := known.sd_log):  # as if all that the prior holds possible were equally likely
                assert sd < np.ptp(np.log(np.abs(posterior.prior_values(name)))) / math.sqrt(12)


def test_nothing_in_the_report_is_linearised_but_the_table_that_says_so(written):
    _, report, _ = written
    tables = [b for b in report.blocks() if isinstance(b, Table)]
    linear = table_of(report, "Effect of one uncertain input at a time")
    assert "linearised" in linear.note
    everything = " ".join([*texts(report), *(b.note or "" for b in tables if b is not linear)])
    assert "Fisher" not in everything
    assert "linearised" not in everything


def test_the_frequencies_case_claims_no_combination_that_its_draws_contradict(written):
    posterior, _, summary = written
    either_sign = bool((posterior.values("k12") < 0).any())
    assert either_sign == (summary["case"] == "clamped_beam_frequencies")
    if either_sign:
        for named in summary["identifiability"]["directions"]:
            assert named["quantity"] in ("k11", "k22", "rho")
            assert named["verdict"] not in ("identified", "weakly identified")
            assert not (named["limit"] and " to " in named["sentence"])
