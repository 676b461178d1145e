"""Which stiffness do the data determine? One documented rule, and the verdict by it: frozen, made in one pass."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from jointbayes.phrases import NO_VALID_VALUE, Because, Reason, listed
from jointbayes.rounding import attributes_of, quantity_text, with_interval
from jointbayes.verdict_rule import RULE, VerdictRule
from vibrecords.arrays import Array

#: Monte Carlo standard error of a quantile of draws at a probability.
Error = Callable[[float], float]
VerdictClass = Literal[
    "identified", "weakly identified", "not identified", "bounded below", "bounded above", "no verdict"
]
Side = Literal["lower", "upper"]
NO_ENDS = (math.nan, math.nan)
#: How certain a verdict is; those that are not named, not at all.
CERTAINTY: dict[VerdictClass, int] = {"identified": 2, "weakly identified": 1}
#: Verdicts that say something, best first.
RANK: dict[VerdictClass, int] = {
    "identified": 0, "weakly identified": 1, "bounded below": 2, "bounded above": 2, "not identified": 3,
}  # fmt: skip
#: Share of the interval's width in ln k by which likelihood and draws differ where the prior decides.
_VOLUME_SHARE = 0.1


#: What is said once next to one-sided limits.
LIMIT_LEVEL = f"{100 * VerdictRule.LIMIT:g} %"
LIMIT_NOTE = f"Above, below: the one-sided limit at {LIMIT_LEVEL}, by likelihood ratio."


@dataclass(frozen=True, slots=True)
class ExactInputs:
    """Inputs that a verdict takes as exact, and does not hold without.

    Parameters
    ----------
    quantities
        Their names.
    freed
        What is known with them uncertain; None where this could not be shown.
    looked_at
        Whether it was looked at what is known with them uncertain; where not the verdict may hold without them.
    """

    quantities: tuple[str, ...]
    freed: "Verdict | None"
    looked_at: bool = True


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is known of one stiffness; `str` gives the class with its conditions.

    It compares equal to the string of its class: ``posterior.verdict("k22") == "identified"``.

    Parameters
    ----------
    cls
        The class, by `VerdictRule` on the numbers that are printed.
    interval
        Equal-tailed 95 % credible interval of the draws, in `unit`.
    median
        Posterior median, in `unit`.
    unit
        Unit of the stiffness.
    reasons
        Why, with numbers, the deciding one first.
    limit
        Of a bounded stiffness the one-sided limit at 97.5 %, in `unit`: by likelihood ratio, by the draws where no
        likelihood limits are sought; else NaN.
    ratio
        Upper over lower end of the interval; infinite where it holds zero or both signs.
    sd_log
        Posterior standard deviation of ln |k|; NaN where draws have both signs.
    contraction
        1 − var(posterior)/var(prior) of ln |k| (of k itself where draws have both signs).
    median_error, interval_error
        Monte Carlo standard errors of the median and of both ends, in `unit`; NaN where not known.
    likelihood95
        Likelihood-ratio limits at 95 %, in `unit`; NaN at an end that the likelihood leaves open within the prior, and
        where none were sought.
    if_model_right
        Whether the verdict holds only if the model were right: the model does not explain the data.
    exact
        Inputs that the verdict takes as exact and does not hold without; None where there are none such.
    """

    cls: VerdictClass
    interval: tuple[float, float]
    median: float
    unit: str = ""
    reasons: tuple[Because, ...] = ()
    limit: float = math.nan
    ratio: float = math.nan
    sd_log: float = math.nan
    contraction: float = math.nan
    median_error: float = math.nan
    interval_error: tuple[float, float] = NO_ENDS
    likelihood95: tuple[float, float] = NO_ENDS
    if_model_right: bool = False
    exact: ExactInputs | None = field(default=None, compare=False)

    def __eq__(self, other: object) -> bool:
        if isinstance(other, str):
            return self.cls == other
        if not isinstance(other, Verdict):
            return NotImplemented
        return (self.cls, self.interval, self.limit, self.reasons) == (
            other.cls, other.interval, other.limit, other.reasons,
        )  # fmt: skip

    def __hash__(self) -> int:
        return hash(self.cls)

    def __str__(self) -> str:
        return self.words

    @property
    def conditions(self) -> tuple[str, ...]:
        """Premises under which the class holds: names of inputs that are exact, and ``"model"``."""
        inputs = self.exact.quantities if self.exact is not None and not self._holds_without else ()
        return (*(("model",) if self.if_model_right else ()), *inputs)

    @property
    def because(self) -> str:
        """The reasons in words."""
        return "; ".join(map(str, self.reasons))

    @property
    def plain_words(self) -> str:
        """The class as it is printed where what it takes as exact is said already."""
        return NO_VALID_VALUE if self.if_model_right else self.cls

    @property
    def words(self) -> str:
        """The class as it is printed, with the conditions it stands under."""
        return ", ".join(filter(None, (self.plain_words, self.if_exact)))

    @property
    def if_exact(self) -> str:
        """The inputs that have to be exact for the class to hold, in words; empty without any."""
        if self.if_model_right or not self.conditions:
            return ""
        return f"if {listed(self.conditions)} {'are' if len(self.conditions) > 1 else 'is'} exact"

    @property
    def _holds_without(self) -> bool:
        """Whether the class, if not the interval, is the same without what it takes as exact."""
        return self.exact is not None and self.exact.freed is not None and self.exact.freed.cls == self.cls

    @property
    def next_to_it(self) -> str:
        """What is known without what it takes as exact, in words; empty where that is nothing, or not known."""
        if self.exact is None or not self.exact.looked_at:
            return ""
        them = listed(self.exact.quantities)
        if self.exact.freed is None:
            return f"what is known with {them} uncertain could not be shown"
        other = "" if self._holds_without else f", {self.exact.freed.cls}"
        return f"with {them} uncertain {self.exact.freed.value}{other}"

    @property
    def value(self) -> str:
        """Median and 95 % interval with the unit, or the one-sided limit, as they are printed everywhere."""
        if math.isfinite(self.limit):
            return limit_in_words(self.cls, self.limit, self.unit)
        return with_interval((self.median, *self.interval), self.unit, (self.median_error, *self.interval_error))

    def as_json(self) -> dict[str, Any]:
        """What ``parameters.<name>`` of ``summary.json`` holds of it; NaN where a number does not exist."""
        return attributes_of(self, "median", "sd_log", "contraction", "limit", "conditions", "likelihood95") | {
            "interval95": self.interval,
            "interval95_error": self.interval_error,
            "verdict": self.cls,
            "reasons": [because.as_json() for because in self.reasons],
        }


def limit_in_words(cls: VerdictClass, limit: float, unit: str) -> str:
    """One-sided limit of a bounded stiffness.

    Examples
    --------
    >>> limit_in_words("bounded below", 4.482e5, "N·m/rad")
    'above 448 kN·m/rad'
    """
    return f"{'above' if cls == 'bounded below' else 'below'} {quantity_text(limit, unit)}"


def ratio_of(ends: tuple[float, float]) -> float:
    """Upper over lower end of an interval of |k|; infinite where it holds zero."""
    low, high = ends
    return max(high / low, low / high) if low * high > 0 else math.inf


def judge_by_rule(rule: VerdictRule, ratio: float, contraction: float) -> tuple[VerdictClass, Because]:
    """Class and reason, from upper over lower end of the interval, and 1 − var(posterior)/var(prior) of ln k.

    Examples
    --------
    >>> judge_by_rule(RULE, 1.1, 0.99)[0], judge_by_rule(RULE, 1.1, 0.3)[0]
    ('identified', 'not identified')
    """
    if not contraction >= rule.contraction:
        if not contraction >= rule.nothing:
            return "not identified", Because(Reason.NOTHING)
        return "not identified", Because(Reason.LITTLE, {"removed": contraction, "needed": rule.contraction})
    if math.isinf(ratio):
        return "not identified", Because(Reason.ZERO)
    if ratio <= rule.weakly_identified:  # a weakly identified stiffness is held against what would be better
        found: VerdictClass = "identified" if ratio <= rule.identified else "weakly identified"
        return found, Because(Reason.SPAN, {"ratio": ratio, "most": rule.identified})
    return "not identified", Because(Reason.SPAN, {"ratio": ratio, "most": rule.weakly_identified})


def assess(
    posterior: Array, prior: Array, error: Error = lambda _: math.nan, unit: str = "", rule: VerdictRule = RULE
) -> Verdict:
    """Judge one stiffness from posterior and prior draws, any shapes, in the stiffness's unit.

    A stiffness is *identified* if the upper end of its 95 % interval is at most 1.25 times the lower end, *weakly
    identified* if at most 3 times, and otherwise *not identified*; it is not identified either if the variance of
    its logarithm has contracted by less than half from prior to posterior.

    `error` gives the Monte Carlo standard error of the draws' quantile at a probability.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> assess(np.exp(0.01 * rng.normal(size=4000)), np.exp(rng.normal(size=4000))).cls
    'identified'
    """
    low, median, high = (float(q) for q in np.quantile(posterior, [0.025, 0.5, 0.975]))
    if (posterior > 0).all() or (posterior < 0).all():
        ratio = ratio_of((low, high))
        sd_log = float(np.log(np.abs(posterior)).std())
        contraction = 1 - (sd_log / float(np.log(np.abs(prior)).std())) ** 2
    else:
        ratio, sd_log = math.inf, math.nan
        contraction = 1 - float(posterior.var() / prior.var())
    cls, because = judge_by_rule(rule, ratio, contraction)
    errors = error(0.5), (error(0.025), error(0.975))
    return Verdict(cls, (low, high), median, unit, (because,), math.nan, ratio, sd_log, contraction, *errors)


def with_ends(drawn: Verdict, ends: tuple[float, float], rule: VerdictRule = RULE) -> Verdict:
    """What the rule says of the draws if their interval had other ends; its standard deviation changes as its width."""
    log = drawn.interval[0] * drawn.interval[1] > 0 and ends[0] * ends[1] > 0 and math.isfinite(drawn.ratio)
    before, after = (abs(math.log(high / low)) if log else high - low for low, high in (drawn.interval, ends))
    ratio = math.inf if math.isinf(drawn.ratio) and drawn.interval[0] * drawn.interval[1] > 0 else ratio_of(ends)
    contraction = 1 - (1 - drawn.contraction) * (after / before) ** 2
    cls, because = judge_by_rule(rule, ratio, contraction)
    return replace(drawn, cls=cls, interval=ends, ratio=ratio, contraction=contraction, reasons=(because,))


def with_test_alone(found: Verdict, likelihood95: tuple[float, float]) -> Verdict:
    """The verdict with likelihood limits, and a reason where they differ from the draws by a tenth of the width."""
    measure = float if any(end <= 0 for end in (*found.interval, *likelihood95)) else math.log
    low, high = map(measure, found.interval)
    outside, inside = set[str](), set[str]()
    for side, sign, drawn, limit in zip(("lower", "upper"), (-1, 1), found.interval, likelihood95, strict=True):
        away = sign * (measure(drawn) - measure(limit))  # NaN where the likelihood leaves the end open
        if not abs(away) <= _VOLUME_SHARE * (high - low):
            (outside if away > 0 else inside).add(side)
    found = replace(found, likelihood95=likelihood95)
    if math.isfinite(found.limit) or not outside | inside:
        return found
    if inside:
        prior = "the prior narrows it"
    else:
        where = {"lower": "below that", "upper": "above that"}
        prior = f"{where[outside.pop()] if len(outside) == 1 else 'outside that'} the prior decides"
    ends = tuple(None if math.isnan(end) else end for end in likelihood95)
    alone = Because(Reason.TEST_ALONE, {"likelihood95": ends, "prior": prior, "unit": found.unit})
    return replace(found, reasons=(*found.reasons, alone))
