"""The verdict on a stiffness: failed runs have none, priors cannot identify, and numbers carry their errors."""

import dataclasses
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.phrases import PHRASES, Reason
from jointbayes.posterior import summarise, verdicts
from jointbayes.posterior.identifiability import ExactInputs, Verdict, assess, with_ends
from jointbayes.posterior.sampled import by_ensemble, recall
from jointbayes.posterior.verdicts import DECADE, REACH, bounds_within_reach, line_of, reason_lines, region_of
from jointbayes.report.markup import badge
from jointbayes.rounding import factor, quantity_text, rounded, rounded_interval
from jointbayes.verdict_rule import RULE, VerdictRule
from tests.conftest import TO_CONVERGE, edited, first_in_ci, judged_as, of_case, shipped_text, unsettled

DOCS = Path(__file__).resolve().parents[2] / "docs"


def with_cached(posterior: jb.Posterior, **cached: object) -> jb.Posterior:
    """A copy of a posterior in which studies found something else; its likelihood is the same."""
    copy = dataclasses.replace(posterior)
    recall(copy, {"region_of": region_of(posterior)} | cached)
    return copy


# ---- digits


@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [
        (1.4552e10, 2.1e8, "1.46e10"),
        (1.4552e10, 9.9e8, "1.46e10"),
        (1.4552e10, 1.01e9, "1.5e10"),
        (3.5321e9, 5.1e6, "3.532e9"),
        (-1.883e8, 4e6, "-1.88e8"),
        (0.9302, 0.0012, "0.930"),
        (1234.5, 0.4, "1234.5"),
        (1234.5, 30.0, "1.23e3"),
        (5.0, 80.0, "5"),
        (8.7e7, math.nan, "8.70e7"),
        (8.7e7, math.inf, "8.70e7"),
        (8.654321e7, 1e-9, "8.6543e7"),
        (0.0, 1.0, "0"),
        (math.nan, 1.0, "–"),
    ],
)
def test_a_number_has_the_digits_that_its_error_supports(value, error, shown):
    assert rounded(value, error) == shown


def test_each_end_has_its_own_digits_and_a_factor_near_one_shows_its_excess():
    assert rounded_interval((3.5321e9, 1.4552e10), (5.1e6, 2.1e8)) == "3.532e9 to 1.46e10"
    assert [factor(ratio) for ratio in (1.0, 1.00083, 1.0423, 1.25, 4.053)] == ["1", "1.00083", "1.042", "1.25", "4.05"]


def test_errors_of_median_and_ends_are_of_the_size_that_the_effective_draws_allow(cheap_posterior):
    known = cheap_posterior.verdict("k22")
    values = cheap_posterior.values("k22")
    errors = (known.interval_error[0], known.median_error, known.interval_error[1])
    for probability, error in zip((0.025, 0.5, 0.975), errors, strict=True):
        step = math.sqrt(probability * (1 - probability) / values.size)  # of independent draws
        independent = np.ptp(np.quantile(values, [probability - step, probability + step])) / 2
        assert 0.9 * independent < error < 3 * independent
    assert max(errors) < 0.03 * (known.interval[1] - known.interval[0])


# ---- failed runs

COULD_CHANGE = "the calculation has not converged, and its error could change the verdict"


@pytest.mark.parametrize("inwards", [-2.0, 2.0])
def test_a_run_that_has_not_settled_has_a_class_that_twice_the_errors_of_the_ends_cannot_change(
    cheap_posterior, inwards
):
    run = unsettled(cheap_posterior)
    known = run.verdict("k22")
    assert (known.cls, known.reasons[-1].reason) == ("identified", Reason.HOLDS_UNSETTLED)
    low, high = np.array(known.interval) + inwards * np.array(known.interval_error) * (1, -1)
    for times, cls in ((1.0001, "identified"), (0.9999, "weakly identified")):
        stated = of_case(run, verdict_rules={"k22": VerdictRule(identified=times * high / low)})
        holds = (times > 1) == (inwards < 0)  # moved outwards below the threshold, or inwards above it
        assert stated.verdict("k22") == (cls if holds else "no verdict")
        assert (stated.verdict("k22").reasons[0].reason is Reason.NOT_CONVERGED) != holds


def test_ensembles_that_found_other_joints_leave_no_verdict_whatever_the_scatter_inside_each(cheap_posterior):
    apart = unsettled(cheap_posterior, apart=1.5).verdict("k22")
    assert (apart.cls, apart.reasons[0].reason) == ("no verdict", Reason.NOT_CONVERGED)
    each = np.quantile(by_ensemble(unsettled(cheap_posterior, apart=1.5), "k22"), 0.975, axis=(1, 2))
    assert apart.interval_error[1] == pytest.approx(each.std(ddof=1) / math.sqrt(len(each)))


def test_the_contraction_of_a_moved_interval_changes_as_the_square_of_its_width():
    drawn = assess(np.exp(np.linspace(0.0, 1.0, 4001)), np.exp(np.linspace(-1.0, 1.0, 4001)))
    low, high = drawn.interval
    wider = with_ends(drawn, (low / math.exp(0.1), high * math.exp(0.1)))
    width = math.log(high / low)
    assert wider.contraction == pytest.approx(1 - (1 - drawn.contraction) * ((width + 0.2) / width) ** 2)
    assert (drawn.cls, wider.cls) == ("weakly identified", "not identified")
    both = assess(np.linspace(-1.0, 1.0, 4001), np.linspace(-9.0, 9.0, 4001))
    assert (with_ends(both, (-2.0, 1.0)).cls, with_ends(both, (0.5, 0.6)).cls) == ("not identified", "identified")


def test_a_run_without_a_verdict_names_the_bound_that_its_draws_reach(cheap_posterior):
    prior = cheap_posterior.problem.prior
    high = float(cheap_posterior.theta[:, 2].max())
    low11, low22 = prior.marginals[0], jb.Uniform(prior.marginals[2].low, high)
    problem = dataclasses.replace(
        cheap_posterior.problem, prior=dataclasses.replace(prior, marginals=(low11, prior.marginals[1], low22))
    )
    failed = unsettled(dataclasses.replace(cheap_posterior, problem=problem), apart=1.5)
    bound = f"its draws reach the prior's upper bound {quantity_text(math.exp(high), 'N·m/rad')}"
    assert failed.verdict("k22").because == f"{COULD_CHANGE}; {bound}"
    assert failed.verdict("k11").because == COULD_CHANGE
    default = of_case(failed, default_priors={"k22"})
    reach = f"its draws reach the end of the default range {quantity_text(math.exp(high), 'N·m/rad')}"
    assert default.verdict("k22").because == f"{COULD_CHANGE}; {reach}"


# ---- a model that does not explain the data


def judged(verdict, **more):
    return Verdict(verdict, (1.0, 2.0), 1.5, **more)


@pytest.mark.parametrize("verdict", ["identified", "weakly identified", "bounded below", "bounded above"])
def test_a_verdict_says_under_which_conditions_it_holds(verdict):
    plain, right = judged(verdict), judged(verdict, if_model_right=True)
    assert (str(plain), plain.conditions, badge(plain.words).kind) == (
        verdict, (), "good" if verdict == "identified" else "caution",
    )  # fmt: skip
    assert (right.conditions, badge(right.words).kind) == (("model",), "bad")
    exact = judged(verdict, exact=ExactInputs(("length",), None))
    assert (exact.words, exact.conditions) == (f"{verdict}, if length is exact", ("length",))
    assert badge(exact.words) is None  # a page says the condition in the head of its column
    same = judged(verdict, exact=ExactInputs(("length",), plain))
    assert (same.words, same.conditions) == (verdict, ())
    assert same.next_to_it == f"with length uncertain {plain.value}"


def test_a_verdict_equals_the_name_of_its_class():
    assert judged("identified") == "identified" != judged("bounded below")
    assert judged("identified") == judged("identified")
    assert judged("identified") != judged("identified", limit=3.0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        judged("identified").cls = "not identified"


def test_every_reason_has_a_phrase_and_a_code_of_its_own():
    assert set(PHRASES) == set(Reason)
    assert len({reason.value for reason in Reason}) == len(Reason)


# ---- thresholds


def test_a_case_states_the_thresholds_of_a_stiffness(cheap_posterior):
    ratio = cheap_posterior.verdict("k22").ratio
    for identified, verdict in ((1.001 * ratio, "identified"), (0.999 * ratio, "weakly identified")):
        stated = of_case(cheap_posterior, verdict_rules={"k22": VerdictRule(identified=identified)})
        known = stated.verdict("k22")
        assert known == verdict
        assert known.reasons[0].numbers["most"] == identified
        assert f"(limit {identified:g})" in known.because
        assert stated.verdict("k11").cls == cheap_posterior.verdict("k11").cls
    contracted = of_case(cheap_posterior, verdict_rules={"k22": VerdictRule(contraction=0.99999)})
    assert contracted.verdict("k22") == "not identified"
    assert contracted.verdict("k22").reasons[0].reason is Reason.LITTLE


def test_a_case_file_states_them(cheap_case):
    text = f"{cheap_case.source.text}\n[verdict.k22]\nidentified = 1.02\n"
    case = jb.case_from_text("strict", text)
    assert case.verdict_rules == {"k22": VerdictRule(identified=1.02)}
    assert cheap_case.verdict_rules == {}


# ---- in numbers


def test_a_failed_run_has_no_verdict_in_the_summary(cheap_posterior):
    failed = judged_as(unsettled(cheap_posterior, apart=1.5), cheap_posterior)
    summary = summarise(failed, (1e8, 0.0, 0.0)).to_dict()
    assert summary["no_verdict"] == [COULD_CHANGE]
    assert {p["verdict"] for p in summary["parameters"].values()} == {"no verdict"}


# ---- bounds of the prior


@pytest.mark.parametrize("column", [0, 1])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_bound_is_within_reach_by_the_mass_at_it_and_not_by_the_mode(column, sign):
    prior = jb.JointPrior(jb.SignedCoupling(), (jb.Uniform(-6.0, 6.0), jb.Uniform(-6.0, 6.0), jb.Uniform(-1.0, 1.0)))
    theta = np.random.default_rng(1).normal(scale=0.2, size=(20000, 3))
    assert not bounds_within_reach(prior, theta)
    edge = 0.1 * DECADE
    for share, reached in ((0.5, False), (1.5, True)):
        theta[:, column] = 0.0
        count = round(share * REACH * edge / DECADE * len(theta))
        theta[:count, column] = sign * (6.0 - edge / 2)
        expected = ((("k11", "k22")[column], "upper" if sign > 0 else "lower"),) if reached else ()
        assert bounds_within_reach(prior, theta) == expected


def test_the_limits_of_rho_are_physics_and_no_bound_of_a_prior():
    theta = np.column_stack([np.zeros((500, 2)), np.full(500, 0.999)])
    prior = jb.JointPrior(jb.SignedCoupling(), (jb.Uniform(-6.0, 6.0), jb.Uniform(-6.0, 6.0), jb.Uniform(-1.0, 1.0)))
    assert not bounds_within_reach(prior, theta)
    narrow = dataclasses.replace(prior, marginals=(*prior.marginals[:2], jb.Uniform(-1.0, 0.5)))
    assert bounds_within_reach(narrow, np.where(theta == 0.999, 0.499, theta))


def bound_at_draws(posterior, *sides, low=math.nan, high=math.nan):
    """A posterior whose k22 has bounds at its outer draws, and these likelihood limits, NaN where it is open."""
    prior, draws = posterior.problem.prior, posterior.theta[:, 2]
    ends = {"lower": float(np.quantile(draws, 0.001)), "upper": float(np.quantile(draws, 0.999))}
    held = jb.Uniform(*(ends[s] if s in sides else e for s, e in zip(ends, prior.marginals[2].support, strict=True)))
    problem = dataclasses.replace(
        posterior.problem, prior=dataclasses.replace(prior, marginals=(*prior.marginals[:2], held))
    )
    known = region_of(posterior)

    def limits(index):
        return (low, high) if index == 2 else known.limits(index)

    region = SimpleNamespace(limits=limits)
    return with_cached(dataclasses.replace(posterior, problem=problem), region_of=region)


@pytest.mark.parametrize(("side", "verdict"), [("upper", "bounded below"), ("lower", "bounded above")])
def test_an_end_that_the_likelihood_leaves_open_at_a_bound_makes_a_one_sided_limit(cheap_posterior, side, verdict):
    closed = {"low": 1.4e6} if side == "upper" else {"high": 1.7e6}
    known = bound_at_draws(cheap_posterior, side, **closed).verdict("k22")
    assert known == verdict
    (limit,) = closed.values()
    assert known.limit == limit
    assert known.interval == cheap_posterior.interval("k22")  # of the draws, whatever is printed
    (because,) = known.reasons
    assert (because.reason, because.numbers["side"]) == (Reason.OPEN, side)
    assert str(because).startswith(f"the test sets no {side} limit before the prior's {side} bound ")
    beyond = "above" if side == "upper" else "below"
    assert line_of("k22", known).startswith(f"k22 {beyond} {quantity_text(limit, 'N·m/rad')}: {verdict}")


def test_a_bound_that_the_likelihood_does_not_need_changes_nothing_and_two_open_ends_identify_nothing(cheap_posterior):
    known = bound_at_draws(cheap_posterior, "upper", low=1.4e6, high=1.7e6).verdict("k22")
    assert known.cls == cheap_posterior.verdict("k22").cls == "identified"
    assert math.isnan(known.limit)
    known = bound_at_draws(cheap_posterior, "lower", "upper").verdict("k22")
    assert (known.cls, known.reasons[0].reason) == ("not identified", Reason.OPEN_BOTH)


def test_of_many_unknowns_a_bound_that_the_draws_reach_counts_as_open(cheap_posterior, monkeypatch):
    monkeypatch.setattr(verdicts, "MOST_UNKNOWNS", 2)
    posterior = with_cached(bound_at_draws(cheap_posterior, "upper"), region_of=None)
    assert posterior.verdict("k22") == "bounded below"
    assert posterior.verdict("k22").limit == cheap_posterior.interval("k22")[0]
    assert posterior.verdict("k11").cls == "not identified"


_BEYOND = [
    ("k22", [("k22 = 1.52e6", "k22 = 1.0e9")]),  # ten times above its bound
    ("k11", [("low = 1.0e6\nhigh = 1.0e11", "low = 5.05e10\nhigh = 1.0e15")]),
    ("k12", [("k12 = 3.44e7", "k12 = 100.0")]),
]


@pytest.mark.science
@pytest.mark.parametrize(("name", "edits"), first_in_ci(_BEYOND, 1))
def test_a_stiffness_beyond_its_prior_is_never_identified(name, edits):
    text = edited(shipped_text("clamped_beam"), ("f_step_hz = 1.0", "f_step_hz = 4.0"), *edits)
    # on one machine or another the same seed takes other draws, of which some need many steps
    settings = dataclasses.replace(TO_CONVERGE, max_steps=20_000)
    posterior = jb.sample(jb.case_from_text("beyond", text), seed=1, settings=settings)
    known = posterior.verdict(name)
    assert known.cls in ("bounded below", "bounded above", "not identified")
    assert "bound" in f"{known.words} {' '.join(reason_lines(known))}"


# ---- words


@pytest.mark.docs
def test_the_page_on_verdicts_has_the_constants_of_the_rule():
    page = (DOCS / "identifiability.md").read_text(encoding="utf-8")
    for words in (f"{100 * REACH:g} % of the mass", f"{100 * RULE.excluded:g} % of the"):
        assert words in page
    assert f": identified up to {RULE.identified:g}, weakly identified up to {RULE.weakly_identified:g}." in page
