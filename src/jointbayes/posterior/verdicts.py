"""The verdict on each stiffness of a posterior: the rule for its draws, and what may stand against it.

In order: the draws are judged by `jointbayes.posterior.identifiability`. A stiffness to which several modes give
different values is not identified. Where the likelihood stays open as far as a bound of the prior, that bound and not
the data ends the interval, and the stiffness is bounded on the other side. A run that failed has no verdict. Nor has
one whose model does not explain measured data, which no structure's quite does, see `jointbayes.posterior.decision`;
of computed data it makes the verdict conditional.

What is printed beside every verdict but "identified" is, at each end, the more cautious of what the draws say and of
the likelihood-ratio limit, which no volume of the prior moves. The level of the latter is 97.5 %: the data that set a
limit have chosen the verdict as well, so that among joints with one verdict more than 5 % lie beyond a limit at 95 %.
"""

import math
import textwrap
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np

from jointbayes.inference import JointPrior, OfStiffness
from jointbayes.posterior.any_posterior import AnyPosterior
from jointbayes.posterior.identifiability import (
    CERTAINTY,
    IF_MODEL_RIGHT,
    Error,
    Identifiability,
    assess,
    ratio_of,
    verdict_by_rule,
)
from jointbayes.posterior.limits import FALL_ONE_SIDED, FALL_PRINTED, FALL_TWO_SIDED, LikelihoodRegion
from jointbayes.posterior.phrases import NOT_SETTLED
from jointbayes.rounding import join_unit, number, percent, quantity_text
from jointbayes.sampling import quantile_error
from vibrecords.arrays import Array

#: Least share of the prior that a one-sided 95 % limit must exclude to be a statement about the data.
LEAST_EXCLUDED = 0.1
_TOO_LITTLE = f"less than {percent(LEAST_EXCLUDED)} of the prior"
#: Longest line of a verdict on a terminal.
MOST_CHARACTERS = 200
#: Of more unknowns no likelihood-ratio limits are sought: each would take seconds.
MOST_UNKNOWNS = 10

Side = Literal["lower", "upper"]
_LIMIT: dict[Side, float] = {"upper": 0.05, "lower": 0.95}  # probability of the limit, by the bound opposite
_SAME_DENSITY = 1e-3  # difference in log density of two points that are equally the mode, as `mode_agrees` has it
#: Mass that a further decade would hold if the density stayed as it is at a bound: less cannot matter.
REACH = 0.01
DECADE = math.log(10)
_EDGE = 0.1  # of a decade, or of the prior's range: the part of it that counts as its edge


def reasons_for_no_verdict(posterior: AnyPosterior) -> tuple[str, ...]:
    """Why a run gives no verdict on any stiffness, one phrase for each reason; empty where it does."""
    reasons = []
    if not posterior.converged:
        reasons.append(NOT_SETTLED)
    if not posterior.mode_agrees:
        gain = posterior.mode_log_density - posterior.estimate.log_posterior
        if gain > _SAME_DENSITY:
            reasons.append(f"the search missed the best fit: a draw leads to one {gain:.3g} higher in log density")
        else:
            reasons.append(
                f"the best fits that draws and search lead to are {posterior.mode_distance:.2g} standard deviations "
                f"apart, the draws' {-gain:.3g} lower in log density"
            )
    if not posterior.check.explains and not any(test.data.synthetic for test in posterior.problem.tests):
        size, level = math.sqrt(posterior.check.chi2_per_line), posterior.check.level
        misfit = f"it misses them by {number(size, 2)} times their noise"
        misfit = misfit if level == "above" else "the misfit follows a pattern along frequency"
        reasons.append(f"the model does not explain the measured data: {misfit}")
    if posterior.model_error is not None and posterior.model_error.grade == "impossible":
        reasons.append(f"the model is none of this structure: {' and '.join(posterior.model_error.findings)}")
    return tuple(reasons)


def judge_stiffness(posterior: AnyPosterior, name: str) -> Identifiability:
    """Median, interval with errors, and verdict of one stiffness or other quantity.

    Parameters
    ----------
    posterior
        The posterior.
    name
        Of the quantity, as in its draws.

    Raises
    ------
    ModelError
        If there is no such quantity.
    """
    error = partial(quantile_error, posterior.by_ensemble(name))
    drawn = assess(posterior.values(name), posterior.prior_values(name), error, posterior.unit(name))
    finding = _found(posterior, name, drawn)
    if finding.verdict != "no verdict" and name in posterior.stiffness_names:

        def region() -> LikelihoodRegion:
            return posterior.likelihood_region

        if not posterior.solutions.reason(name):
            finding = bounded_by_data(posterior, region, name, finding, posterior.theta, posterior.values(name), error)
        if finding.verdict != "identified":
            finding = by_likelihood(posterior, region, name, finding)
    narrow = posterior.noise_of_bodies.narrow if posterior.noise_of_bodies else ""
    if narrow and finding.verdict != "no verdict" and not posterior.solutions.reason(name):
        finding = replace(finding, verdict_reason=f"{finding.verdict_reason}; {narrow}")
    return concluded(finding, explained=posterior.check.explains)


def concluded(finding: Identifiability, *, explained: bool) -> Identifiability:
    """What is found of a stiffness, under the model being right where it does not explain the data."""
    if explained or finding.verdict in ("no verdict", "not identified"):
        return finding
    return replace(finding, verdict_reason=f"{IF_MODEL_RIGHT}: {finding.verdict_reason}", if_model_right=True)


def _found(posterior: AnyPosterior, name: str, drawn: Identifiability) -> Identifiability:
    """What the draws say, after a look at all that may stand against it."""
    reasons, mesh = [*reasons_for_no_verdict(posterior)], posterior.mesh
    if mesh is not None and mesh.moves(name):
        reasons.append(f"the mesh moves it by {abs(mesh.shift_sd[name]):.2g} posterior standard deviations")
    if reasons:
        reach = bounds_within_reach(posterior.problem.prior, posterior.theta)
        at_bound = [_bound_in_words(posterior, name, side) for held, side in reach if held == name]
        return drawn.judge("no verdict", "; ".join([*reasons, *(f"its draws reach {bound}" for bound in at_bound)]))
    if solutions := posterior.solutions.reason(name):
        return drawn.judge("not identified", solutions)
    return drawn


def line_of(name: str, assessment: Identifiability) -> str:
    """Median, 95 % interval and verdict of one stiffness, on whatever surface."""
    return f"{name}: {assessment.value}: {assessment.words}"


def lines_of(name: str, assessment: Identifiability) -> list[str]:
    """The same with its reasons; those of a long line below it."""
    reasons = [
        assessment.source,
        assessment.verdict_reason.removeprefix(f"{IF_MODEL_RIGHT}: "),
        assessment.prior_volume,
        assessment.beside,
    ]
    text, given = line_of(name, assessment), [reason for reason in reasons if reason]
    line = f"{text} ({'; '.join(given)})"
    if len(line) <= MOST_CHARACTERS:
        return [line]
    return [text, *(f"    {part}" for reason in given for part in textwrap.wrap(reason, MOST_CHARACTERS - 4))]


def mode_sentence(posterior: AnyPosterior) -> str:
    """Why the joint mode lies outside a 95 % interval; empty where it does not."""
    outside = [name for name in posterior.stiffness_names if not _holds(posterior.interval(name), posterior.mode[name])]
    if not outside:
        return ""
    names = " and ".join(outside)
    return f"The joint mode lies outside the 95 % interval of {names}: the distribution is skewed. Quote the median."


def _holds(interval: tuple[float, float], value: float) -> bool:
    return interval[0] <= value <= interval[1]


def bounded_by_data(
    posterior: AnyPosterior, region: Callable[[], LikelihoodRegion], name: str, finding: Identifiability, theta: Array,
    values: Array, error: Error,
) -> Identifiability:  # fmt: skip
    """The finding, bounded on one side where the data leave the other side open as far as the prior's bound.

    Where draws of θ, shape (n, d), reach a bound, or the draws do not identify the stiffness, the likelihood decides:
    an end that it leaves open within the prior is open. Of more unknowns than `MOST_UNKNOWNS` a bound that the draws
    reach counts as open. `values` are the draws of the stiffness, and `error` that of their quantiles.
    """
    prior = posterior.problem.prior
    reached = {side for held, side in bounds_within_reach(prior, theta) if held == name}
    certain = finding.verdict in CERTAINTY
    if prior.bounds_of(name) is None or (certain and not reached):
        return finding
    if len(prior.names) > MOST_UNKNOWNS:
        sides = reached
    else:
        (low, high), _ = region().limits(posterior.stiffness_names.index(name), FALL_TWO_SIDED, FALL_PRINTED)
        ends: tuple[tuple[Side, float], ...] = (("lower", low), ("upper", high))
        sides = {side for side, end in ends if math.isnan(end)}
    if not sides or (len(sides) == 2 and not certain):
        return finding
    if len(sides) == 2:
        both = " and ".join(_bound_in_words(posterior, name, side) for side in ("lower", "upper"))
        return finding.judge("not identified", f"{both} limit it on both sides")
    (side,) = sides
    bound = _bound_in_words(posterior, name, side)
    of_default = f"the test gives no {side} limit, searched {bound.removeprefix(_DEFAULT)}"
    reason = of_default if bound.startswith(_DEFAULT) else f"{bound} limits it"
    limit, before = float(np.quantile(values, _LIMIT[side])), posterior.prior_values(name)
    excluded = float(((before < limit) if side == "upper" else (before > limit)).mean())
    if excluded < LEAST_EXCLUDED:
        return finding.judge("not identified", f"{reason}, and the data exclude {_TOO_LITTLE}")
    return finding.judge("bounded below" if side == "upper" else "bounded above", reason, (limit, error(_LIMIT[side])))


def by_likelihood(
    posterior: AnyPosterior, region: Callable[[], LikelihoodRegion], name: str, finding: Identifiability
) -> Identifiability:
    """The finding with what is printed: at each end the more cautious of what the draws and what the likelihood say.

    A limit that excludes next to nothing of the prior by the likelihood is none. `region` gives the joints that fit
    nearly as well as the best, which takes seconds to find.
    """
    if len(posterior.problem.names) > MOST_UNKNOWNS:
        return finding
    bounded, index = math.isfinite(finding.limit95), posterior.stiffness_names.index(name)
    fall = FALL_ONE_SIDED if bounded else FALL_TWO_SIDED
    at95, (low, high) = region().limits(index, fall, FALL_PRINTED)
    if not bounded:
        ends = min(finding.interval95[0], low), max(finding.interval95[1], high)
        if finding.verdict_reason == verdict_by_rule(finding.ratio, finding.contraction)[1]:  # that of the draws
            _, reason = verdict_by_rule(finding.ratio, finding.contraction, ratio_of(ends))
            finding = replace(finding, verdict_reason=reason)
        return replace(finding, likelihood95=at95, printed95=ends)
    low, high = min(finding.limit95, low), max(finding.limit95, high)
    ends = (low, math.nan) if finding.verdict == "bounded below" else (math.nan, high)
    prior = posterior.prior_values(name)
    excluded = float(((prior < ends[0]) | (prior > ends[1])).mean())
    if excluded >= LEAST_EXCLUDED:
        return replace(finding, likelihood95=at95, printed95=ends)
    few = f"{finding.verdict_reason}, and by likelihood the data exclude {_TOO_LITTLE}"
    finding = finding.judge("not identified", few)
    return by_likelihood(posterior, region, name, finding)


_DEFAULT = "the default range "


def _bound_in_words(posterior: AnyPosterior, name: str, side: Side) -> str:
    """Such as "the prior's upper bound 1e8 N·m/rad"; what nobody stated is named as that."""
    bounds = posterior.problem.prior.bounds_of(name)
    assert bounds is not None
    if posterior.has_default_prior(name):
        reach = "up to" if side == "upper" else "from"
        return f"{_DEFAULT}{reach} {quantity_text(bounds[side == 'upper'], posterior.unit(name))}"
    return f"the prior's {side} bound {join_unit(number(bounds[side == 'upper']), posterior.unit(name))}"


def bounds_within_reach(prior: JointPrior, theta: Array) -> tuple[tuple[str, Side], ...]:
    """Bounds of uniform priors of the joint beyond which there could be mass of any consequence.

    There could be if the density of the draws at the bound, kept up over a decade beyond it, would hold more than
    `REACH` of the mass; over the prior's own range where a coordinate is no logarithm, and as far as is possible.

    Parameters
    ----------
    prior
        The prior as it is stated.
    theta
        Draws of θ, shape (n, d).

    Returns
    -------
    tuple of (name, side)
        Coordinate and ``"lower"`` or ``"upper"``.
    """
    within_reach: list[tuple[str, Side]] = []
    for column, (axis, marginal) in enumerate(zip(prior.parametrisation.axes, prior.marginals, strict=True)):
        if prior.bounds_of(axis.name) is None:
            continue
        draws, (low, high) = theta[:, column], marginal.support
        step = DECADE if axis.logarithmic else high - low
        least, most = axis.bounds if axis.bounded else (low - step, high + step)
        edge = _EDGE * min(DECADE, high - low)
        below, above = (draws < low + edge).mean(), (draws > high - edge).mean()
        # a prior that is uniform in k keeps its density in k: of ln k it grows on beyond the upper end
        beyond = math.expm1(most - high) if isinstance(marginal, OfStiffness) else most - high
        if math.isfinite(low) and below / edge * (low - least) > REACH:
            within_reach.append((axis.name, "lower"))
        if above / edge * beyond > REACH:
            within_reach.append((axis.name, "upper"))
    return tuple(within_reach)
