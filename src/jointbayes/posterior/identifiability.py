"""Which stiffness do the data determine? One documented rule, for draws of one stiffness."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from jointbayes.rounding import factor, one_sided, quantity_text, with_interval
from vibrecords.arrays import Array

#: Monte Carlo standard error of a quantile of draws at a probability.
Error = Callable[[float], float]
Verdict = Literal["identified", "weakly identified", "not identified", "bounded below", "bounded above", "no verdict"]

#: Largest upper/lower ratio of the 95 % interval of an identified stiffness.
IDENTIFIED_RATIO = 1.25
#: The same for a weakly identified one.
WEAK_RATIO = 3.0
#: Least contraction 1 − var(posterior)/var(prior) of ln k: below it the prior speaks, not the data.
LEAST_CONTRACTION = 0.5
#: Contraction below which the data are said to add next to nothing.
NOTHING = 0.05
#: Share of the credible interval by which likelihood-ratio limits differ from its ends where the prior's volume speaks.
VOLUME_SHARE = 0.1
NO_ENDS = (math.nan, math.nan)

#: The rule in words, as reports print it.
RULE = (
    f"Identified (weakly): upper end of the 95 % interval at most {IDENTIFIED_RATIO:g} ({WEAK_RATIO:g}) times the "
    f"lower end, and the variance of ln k at least {100 * LEAST_CONTRACTION:g} % less than the prior's"
)


#: What is said in place of a verdict where the model does not explain the data, and what sentences open with there.
NO_VALID_VALUE = "no valid value, as the model does not fit the data"
IF_MODEL_RIGHT = "if the model fitted the data"

#: How certain a verdict is; those that are not named, not at all.
CERTAINTY: dict[Verdict, int] = {"identified": 2, "weakly identified": 1}


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
    freed: "Identifiability | None"
    looked_at: bool = True

    @property
    def condition(self) -> str:
        """What follows the verdict."""
        only = "only if" if self.looked_at else "if"
        return f" {only} {listed(self.quantities)} {'are' if len(self.quantities) > 1 else 'is'} exact"

    @property
    def words_if_uncertain(self) -> str:
        """The interval with them uncertain, in words."""
        them = "them" if len(self.quantities) > 1 else "it"
        if not self.looked_at:
            return ""
        if self.freed is None:
            return f"what is known with {them} uncertain could not be shown"
        return f"with {them} uncertain {self.freed.value}, {self.freed.verdict}"

    def as_json(self) -> dict[str, Any]:
        """What ``parameters.<name>.only_if_exact`` of ``summary.json`` holds."""
        known = {name: getattr(self.freed, name, None) for name in ("interval95", "limit95", "verdict")}
        return {"quantities": list(self.quantities), **known}


@dataclass(frozen=True, slots=True)
class Identifiability:
    """What draws of one stiffness say about how well it is known.

    Parameters
    ----------
    interval95
        Equal-tailed 95 % credible interval, in the stiffness's unit.
    ratio
        Upper end over lower end; infinite where the interval holds zero or both signs.
    sd_log
        Posterior standard deviation of ln |k|; NaN where draws have both signs.
    contraction
        1 − var(posterior)/var(prior) of ln |k| (of k itself where draws have both signs).
    verdict
        By the rule of this module, and of `jointbayes.posterior.verdicts` where a whole posterior was judged.
    verdict_reason
        Why, in one sentence without full stop.
    median
        Posterior median, in the stiffness's unit.
    median_error, interval95_error
        Monte Carlo standard errors of the median and of the two ends, in the stiffness's unit; NaN where nothing is
        known of the draws' order.
    limit95
        For a stiffness that is bounded below (above): it is larger (smaller) with 95 % probability; else NaN.
    limit95_error
        Monte Carlo standard error of the limit.
    unit
        Unit of the limits.
    if_model_right
        Whether the verdict holds only if the model were right: the model does not explain the data.
    likelihood95
        Likelihood-ratio limits at 95 %, one-sided of a stiffness that is bounded; NaN at an end that the likelihood
        leaves open within the prior, and where none were sought.
    printed95
        What is printed, see `jointbayes.posterior.verdicts`: at each end the more cautious of draws and likelihood;
        NaN at the open end of a stiffness that is bounded, and where the draws alone are printed.
    exact
        Inputs that the verdict takes as exact and does not hold without; None where there are none such.
    """

    interval95: tuple[float, float]
    ratio: float
    sd_log: float
    contraction: float
    verdict: Verdict
    verdict_reason: str
    median: float
    median_error: float = math.nan
    interval95_error: tuple[float, float] = (math.nan, math.nan)
    limit95: float = math.nan
    limit95_error: float = math.nan
    unit: str = ""
    if_model_right: bool = False
    likelihood95: tuple[float, float] = NO_ENDS
    printed95: tuple[float, float] = NO_ENDS
    exact: ExactInputs | None = None

    def judge(self, verdict: Verdict, reason: str, limit: tuple[float, float] = NO_ENDS) -> "Identifiability":
        """The same with another verdict than its draws', and with a one-sided limit and its error where it has one."""
        return replace(self, verdict=verdict, verdict_reason=reason, limit95=limit[0], limit95_error=limit[1])

    def with_exact(self, exact: ExactInputs | None) -> "Identifiability":
        """The same with what it takes as exact, where it says anything."""
        return replace(self, exact=None if self.verdict in ("no verdict", "not identified") else exact)

    @property
    def plain_words(self) -> str:
        """The verdict as it is printed where what it takes as exact is said already."""
        return NO_VALID_VALUE if self.if_model_right else self.verdict

    @property
    def words(self) -> str:
        """The verdict as it is printed, with the conditions it stands under."""
        conditional = self.exact is not None and not self.if_model_right and not self._holds_without
        return self.plain_words + (self.exact.condition if self.exact and conditional else "")

    @property
    def _holds_without(self) -> bool:
        """Whether the verdict, if not the interval, is the same without what it takes as exact."""
        return self.exact is not None and self.exact.freed is not None and self.exact.freed.verdict == self.verdict

    @property
    def beside(self) -> str:
        """What is known without what it takes as exact, in words; empty where that is nothing, or not known."""
        if self.exact and self.exact.freed and self._holds_without:
            return f"with {listed(self.exact.quantities)} uncertain {self.exact.freed.value}"
        return self.exact.words_if_uncertain if self.exact else ""

    @property
    def drawn95(self) -> tuple[float, float]:
        """Ends of the draws' interval; of a stiffness that is bounded twice its limit."""
        return (self.limit95, self.limit95) if math.isfinite(self.limit95) else self.interval95

    @property
    def printed_by_likelihood(self) -> tuple[bool, bool]:
        """Whether each printed end is a likelihood-ratio limit."""
        pairs = zip(self.printed95, self.drawn95, strict=True)
        low, high = (math.isfinite(printed) and printed != drawn for printed, drawn in pairs)
        return low, high

    @property
    def ends(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Ends of the 95 % interval as they are printed, and their Monte Carlo errors, in the unit; NaN of a limit."""
        moved = self.printed_by_likelihood
        low, high = (p if m else d for m, p, d in zip(moved, self.printed95, self.interval95, strict=True))
        first, second = (math.nan if m else error for m, error in zip(moved, self.interval95_error, strict=True))
        return (low, high), (first, second)

    @property
    def value(self) -> str:
        """Median and 95 % interval with the unit, or the one-sided limit, as they are printed everywhere."""
        ends, errors = self.ends
        return self.limit or with_interval((self.median, *ends), self.unit, (self.median_error, *errors))

    @property
    def printed_limit(self) -> float:
        """The one-sided limit as it is printed, in the unit; NaN where there is none."""
        end = 0 if self.verdict == "bounded below" else 1
        return self.printed95[end] if math.isfinite(self.limit95) and self.printed_by_likelihood[end] else self.limit95

    @property
    def limit(self) -> str:
        """The one-sided limit of a stiffness that is bounded: ``"above 3.2 MN·m/rad (95 %)"``; empty without one."""
        side = "above" if self.verdict == "bounded below" else "below"
        return one_sided(side, self.printed_limit, self.unit) if math.isfinite(self.limit95) else ""

    @property
    def source(self) -> str:
        """What the printed ends rest on where it is not the draws alone, and what these say; empty where it is."""
        if not any(self.printed_by_likelihood):
            return ""
        if self.limit:
            return f"by likelihood ratio; by the draws {one_sided(self.limit.split()[0], self.limit95, self.unit)}"
        drawn = with_interval((self.median, *self.interval95), self.unit, (self.median_error, *self.interval95_error))
        ends = list(zip(self.printed_by_likelihood, self.likelihood95, strict=True))
        closed = [moved and not math.isnan(limit) for moved, limit in ends]
        reached = [moved and math.isnan(limit) for moved, limit in ends]
        sentences = [
            f"{'both ends' if all(which) else 'lower end' if which[0] else 'upper end'} {words}"
            for which, words in ((closed, "by likelihood ratio"), (reached, "as far as the priors reach"))
            if any(which)
        ]
        return f"{', '.join(sentences)}; by the draws {drawn}"

    @property
    def prior_volume(self) -> str:
        """Which ends draws and likelihood put apart by more than `VOLUME_SHARE` of the interval; empty where none."""
        measure = float if any(end <= 0 for end in (*self.interval95, *self.likelihood95)) else math.log
        low, high = map(measure, self.interval95)
        sentences = []
        ends = zip(("lower", "upper"), self.printed95, self.drawn95, self.likelihood95, strict=True)
        for side, printed, drawn, limit in ends:  # where the likelihood leaves an end open its limit is NaN
            if math.isfinite(printed) and not abs(measure(limit) - measure(drawn)) <= VOLUME_SHARE * (high - low):
                value, alone = (quantity_text(end, self.unit) for end in (drawn, limit))
                by_data = f"no {side} end" if math.isnan(limit) else f"the {side} end at {alone}"
                sentences.append(f"the test alone sets {by_data}, the draws at {value}")
        return f"part of this rests on the prior: {'; '.join(sentences)}" if sentences else ""


def ratio_of(ends: tuple[float, float]) -> float:
    """Upper over lower end of an interval of |k|; infinite where it holds zero."""
    low, high = ends
    return max(high / low, low / high) if low * high > 0 else math.inf


def verdict_by_rule(ratio: float, contraction: float, printed: float | None = None) -> tuple[Verdict, str]:
    """Verdict on a stiffness and the reason for it, from the ends' ratio and the contraction.

    The reason states the ratio of the ends that are printed beside it where these are not those of the draws.

    Examples
    --------
    >>> verdict_by_rule(1.1, 0.99)[0], verdict_by_rule(1.1, 0.3)[0]
    ('identified', 'not identified')
    """
    if not contraction >= LEAST_CONTRACTION:
        if not contraction >= NOTHING:
            return "not identified", "the test tells nothing about it"
        removed = f"removes {100 * contraction:.0f} % of the prior's variance; {100 * LEAST_CONTRACTION:g} % is needed"
        return "not identified", f"the test tells little about it (it {removed})"
    if math.isinf(ratio):
        return "not identified", "its 95 % credible interval contains zero"
    shown = ratio if printed is None else printed
    spread = f"the upper end is {factor(shown)} times the lower end"
    if math.isinf(shown):
        spread = "its 95 % interval contains zero"
    limits: tuple[tuple[Verdict, float], ...] = (("identified", IDENTIFIED_RATIO), ("weakly identified", WEAK_RATIO))
    for verdict, most in limits:
        if ratio <= most:
            return verdict, f"{spread}, {'' if shown <= most else 'by the draws alone '}at most {most:g}"
    return "not identified", f"{spread}, more than {WEAK_RATIO:g}"


def assess(posterior: Array, prior: Array, error: Error = lambda _: math.nan, unit: str = "") -> Identifiability:
    """Judge one stiffness from posterior and prior draws, any shapes, in the stiffness's unit.

    A stiffness is *identified* if the upper end of its 95 % interval is at most 1.25 times the lower end, *weakly
    identified* if at most 3 times, and otherwise *not identified*; it is not identified either if the variance of
    its logarithm has contracted by less than half from prior to posterior.

    `error` gives the Monte Carlo standard error of the draws' quantile at a probability.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> assess(np.exp(0.01 * rng.normal(size=4000)), np.exp(rng.normal(size=4000))).verdict
    'identified'
    """
    low, median, high = (float(q) for q in np.quantile(posterior, [0.025, 0.5, 0.975]))
    one_sign = bool((posterior > 0).all() or (posterior < 0).all())
    if one_sign:
        ratio = ratio_of((low, high))
        sd_log = float(np.log(np.abs(posterior)).std())
        contraction = 1 - (sd_log / float(np.log(np.abs(prior)).std())) ** 2
    else:
        ratio, sd_log = math.inf, math.nan
        contraction = 1 - float(posterior.var() / prior.var())
    verdict, reason = verdict_by_rule(ratio, contraction)
    return Identifiability(
        (low, high),
        ratio,
        sd_log,
        contraction,
        verdict,
        reason,
        median,
        median_error=error(0.5),
        interval95_error=(error(0.025), error(0.975)),
        unit=unit,
    )


def listed(names: Sequence[str]) -> str:
    """Names in a sentence: ``"density, length and gain"``."""
    readable = [name.replace("youngs", "Young's").replace("_", " ") for name in names]
    return "".join(readable) if len(readable) < 2 else f"{', '.join(readable[:-1])} and {readable[-1]}"
