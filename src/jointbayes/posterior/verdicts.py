"""The verdict on each stiffness of a posterior: the rule for its draws, and what may stand against it.

In order: the draws are judged by `jointbayes.posterior.identifiability`; a stiffness to which several modes give
different values is not identified, see `jointbayes.posterior.solutions`; the same posterior with every prior of the
joint a decade wider says whether a bound of the prior holds the stiffness, or the verdict rests on the prior
otherwise; a run that failed has none. Nor has one whose model does not explain measured data, which no structure's
quite does: see `jointbayes.posterior.modes_answer`. Of computed data it makes the verdict conditional.

What is printed beside every verdict but "identified" is, at each end, the more cautious of what the draws say and of
the likelihood-ratio limit, which no volume of the prior moves. The level of the latter is 97.5 %: the data that set a
limit have chosen the verdict as well, so that among joints with one verdict more than 5 % lie beyond a limit at 95 %.
"""

import math
import textwrap
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.posterior.draws import PosteriorDraws
from jointbayes.posterior.identifiability import CERTAINTY, Identifiability, Verdict, assess, ratio_of, verdict_by_rule
from jointbayes.posterior.limits import FALL_ONE_SIDED, FALL_PRINTED, FALL_TWO_SIDED, LikelihoodRegion
from jointbayes.posterior.rounding import join_unit, number, rounded
from jointbayes.posterior.solutions import Solutions
from jointbayes.posterior.widened import Side, WidenedPosterior, bounds_within_reach, widen_posterior
from jointbayes.sampling import INTERVAL, quantile_error, quantile_spread

#: Posterior mass beyond a stated bound, once priors are a decade wider, from which on the bound holds the stiffness.
BEYOND = 0.025
#: Least share of the prior that a one-sided 95 % limit must exclude to be a statement about the data.
LEAST_EXCLUDED = 0.1
#: What is said in place of a verdict where the model does not explain the data, and what sentences open with there.
NO_VALID_VALUE = "no valid value, as the model does not fit the data"
IF_MODEL_RIGHT = "if the model fitted the data"

#: Longest line of a verdict on a terminal.
MOST_CHARACTERS = 200
#: Of more unknowns no likelihood-ratio limits are sought: each would take seconds.
MOST_UNKNOWNS = 10

Error = Callable[[float], float]

_REGION_DRAWS = 4000
_LIMIT: dict[Side, float] = {"upper": 0.05, "lower": 0.95}  # probability of the limit, by the bound opposite
_SAME_DENSITY = 1e-3  # difference in log density of two points that are equally the mode, as `mode_agrees` has it
_WIDER = "priors a decade wider on each side"


class JudgedPosterior(PosteriorDraws):
    """Draws with a verdict on each stiffness."""

    def has_default_prior(self, name: str) -> bool:
        """Whether the range of a quantity is the default one, which the case does not state."""
        return self.case is not None and name in self.case.default_priors

    @cached_property
    def solutions(self) -> Solutions:
        """What each of several modes says; of one mode itself."""
        return Solutions(self)

    @cached_property
    def widened(self) -> WidenedPosterior | None:
        """The posterior with every prior of the joint a decade wider; None where that changes nothing."""
        return widen_posterior(self)

    @cached_property
    def likelihood_region(self) -> LikelihoodRegion:
        """Joints that fit nearly as well as the best, for likelihood-ratio limits, which it keeps once found."""
        modes = [self.estimate.theta, self.mode_theta, *(mode.theta for mode in self.estimate.modes)]
        theta = np.vstack([*modes, self.thinned(_REGION_DRAWS)])
        return LikelihoodRegion(self.problem.log_posterior, theta, self.solutions.nearest(theta))

    def verdict(self, name: str) -> Identifiability:
        """Median, 95 % interval with errors, and verdict with its reason, see `jointbayes.posterior.verdicts`.

        Raises
        ------
        ModelError
            If the joint's coordinates hold the stiffness rigid: there is nothing to judge.
        """
        if np.ptp(self.prior_values(name)) == 0:
            raise ModelError(
                f"posterior: found {name} held rigid; expected a joint whose stiffnesses are all uncertain, for "
                "verdicts, summary and report; use draws, mode and intervals of the others"
            )
        return judge_stiffness(self, name)


def reasons_for_no_verdict(posterior: PosteriorDraws) -> tuple[str, ...]:
    """Why a run gives no verdict on any stiffness, one phrase for each reason; empty where it does."""
    reasons = []
    if not posterior.converged:
        reasons.append("the calculation has not settled")
    if not posterior.mode_agrees:
        gain = posterior.mode_log_density - posterior.estimate.log_posterior
        if gain > _SAME_DENSITY:
            reasons.append(f"the search missed the best fit: a draw leads to one {gain:.3g} higher in log density")
        else:
            reasons.append(
                f"the best fits that draws and search lead to are {posterior.mode_distance:.2g} standard deviations "
                f"apart, that of the draws {-gain:.3g} lower in log density"
            )
    if not posterior.check.explains and not any(test.data.synthetic for test in posterior.problem.tests):
        size, level = math.sqrt(posterior.check.chi2_per_line), posterior.check.level
        misfit = f"it misses them by {number(size, 2)} times their noise"
        misfit = misfit if level == "above" else "the misfit follows a pattern along frequency"
        reasons.append(f"the model does not explain the measured data: {misfit}")
    if posterior.model_error is not None and posterior.model_error.grade == "impossible":
        reasons.append(f"the model is none of this structure: {' and '.join(posterior.model_error.findings)}")
    return tuple(reasons)


def judge_stiffness(posterior: JudgedPosterior, name: str) -> Identifiability:
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
    assessment = assess(posterior.values(name), posterior.prior_values(name))
    draws = posterior.by_ensemble(name)
    low, high = (quantile_error(draws, probability) for probability in INTERVAL)
    assessment = replace(assessment, median_error=quantile_error(draws, 0.5), interval95_error=(low, high))
    reasons = (*reasons_for_no_verdict(posterior), *_moved_by_mesh(posterior, name))
    if reasons:
        reach = bounds_within_reach(posterior.problem.prior, posterior.theta)
        at_bound = [_bound_in_words(posterior, name, side) for held, side in reach if held == name]
        reasons += tuple(f"its draws reach {bound}" for bound in at_bound)
        return replace(assessment, verdict="no verdict", verdict_reason="; ".join(reasons))
    if solutions := posterior.solutions.reason(name):
        assessment = replace(assessment, verdict="not identified", verdict_reason=solutions)
        return _judge_by_likelihood(posterior, name, assessment) if name in posterior.stiffness_names else assessment
    if name in posterior.stiffness_names:
        if posterior.widened is not None:
            assessment = judge_with_wider_priors(
                posterior, posterior.widened, name, assessment, posterior.values(name), partial(quantile_error, draws)
            )
        assessment = _judge_by_likelihood(posterior, name, assessment)
    narrow = posterior.noise_of_bodies.narrow if posterior.noise_of_bodies else ""
    if narrow:
        assessment = replace(assessment, verdict_reason=f"{assessment.verdict_reason}; {narrow}")
    if not posterior.check.explains and assessment.verdict != "not identified":
        assessment = replace(
            assessment, if_model_right=True, verdict_reason=f"{IF_MODEL_RIGHT}: {assessment.verdict_reason}"
        )
    return assessment


def _moved_by_mesh(posterior: JudgedPosterior, name: str) -> tuple[str, ...]:
    """That the elements of the model move a stiffness too far for a verdict, if they do."""
    mesh = posterior.mesh
    if mesh is None or not mesh.moves(name):
        return ()
    return (f"the mesh moves it by {abs(mesh.shift_sd[name]):.2g} posterior standard deviations",)


def verdict_text(verdict: Verdict, *, if_model_right: bool, condition: str = "") -> str:
    """The verdict as it is printed, with the conditions it stands under.

    Examples
    --------
    >>> verdict_text("identified", if_model_right=True)
    'no valid value, as the model does not fit the data'
    """
    return NO_VALID_VALUE if if_model_right else verdict + condition


def verdict_lines(posterior: JudgedPosterior, name: str, condition: str = "", beside: str = "") -> list[str]:
    """Median, 95 % credible interval and verdict of one stiffness with its reason, for the terminal.

    `condition` follows the verdict, and `beside` the reason, see `ExactInputs`.
    """
    assessment = posterior.verdict(name)
    words = verdict_text(assessment.verdict, if_model_right=assessment.if_model_right, condition=condition)
    return lines_of(name, assessment, posterior.unit(name), words, beside)


def lines_of(name: str, assessment: Identifiability, unit: str, words: str = "", beside: str = "") -> list[str]:
    """The same of an assessment, with the verdict in other words if there are any; reasons of a long line below it."""
    words = words or assessment.verdict
    reasons = ["" if assessment.limit else assessment.source.strip("()")]
    reasons += [assessment.verdict_reason.removeprefix(f"{IF_MODEL_RIGHT}: "), assessment.prior_volume, beside]
    median = join_unit(assessment.row[0], unit)
    interval = f"95 % {'' if assessment.source else 'credible '}interval {assessment.interval(' to ')}"
    text = f"{name}: {assessment.limit_in_words or f'median {median}, {interval}'}: {words}"
    given = [reason for reason in reasons if reason]
    line = f"{text} ({'; '.join(given)})"
    if len(line) <= MOST_CHARACTERS:
        return [line]
    return [text, *(f"    {part}" for reason in given for part in textwrap.wrap(reason, MOST_CHARACTERS - 4))]


def mode_sentence(posterior: JudgedPosterior) -> str:
    """Why the joint mode lies outside a 95 % interval; empty where it does not."""
    outside = [name for name in posterior.stiffness_names if not _holds(posterior.interval(name), posterior.mode[name])]
    if not outside:
        return ""
    names = " and ".join(outside)
    return f"The joint mode lies outside the 95 % interval of {names}: the distribution is skewed. Quote the median."


def _holds(interval: tuple[float, float], value: float) -> bool:
    return interval[0] <= value <= interval[1]


def judge_with_wider_priors(
    posterior: JudgedPosterior,
    wide: WidenedPosterior,
    name: str,
    assessment: Identifiability,
    values: Array,
    error: Error,
) -> Identifiability:
    """The verdict after a look at what wider priors make of it: never more certain, and every change has its reason.

    Parameters
    ----------
    posterior
        The run, whose priors of the joint are those that were widened.
    wide
        Draws under wider priors.
    name
        Of the stiffness.
    assessment
        What its draws say.
    values
        These draws, any shape.
    error
        Monte Carlo standard error of their quantile at a probability.
    """
    place = posterior.stiffness_names.index(name)
    beyond = wide.prior.values(wide.theta)[:, place]
    wider = assess(beyond, wide.prior.values(wide.prior_theta)[:, place])
    if not wide.reliable:
        return _less_certain(
            assessment, "not identified", f"it may rest on the prior: with {_WIDER} the calculation did not settle"
        )
    low, high = posterior.problem.prior.bounds_of(name) or (-math.inf, math.inf)
    below, above = float((beyond < low).mean()), float((beyond > high).mean())
    if below > BEYOND and above > BEYOND:
        both = " and ".join(_bound_in_words(posterior, name, side) for side in ("lower", "upper"))
        return replace(assessment, verdict="not identified", verdict_reason=f"{both} limit it on both sides")
    if below > BEYOND or above > BEYOND:
        side: Side = "upper" if above > BEYOND else "lower"
        return _bounded(posterior, name, assessment, wider.verdict, side, values, error)
    if not _holds(assessment.interval95, wider.median):
        ends = [*assessment.interval95, *wider.interval95]
        verdict, _ = verdict_by_rule(ratio_of((min(ends), max(ends))), assessment.contraction)
        moved = f"its median goes from {rounded(assessment.median)} to {rounded(wider.median)} with {_WIDER}"
        return replace(assessment, verdict=verdict, verdict_reason=f"rests on the prior: {moved}")
    if _same_verdict(assessment, wider, _log_ratio_error(assessment, wider, beyond, wide.effective)):
        return assessment
    which = "default priors, which no one stated" if posterior.has_default_prior(name) else "priors as stated"
    changed = f"rests on the prior: {assessment.verdict} with the {which}, {wider.verdict} with {_WIDER}"
    return _less_certain(assessment, wider.verdict, changed)


def _less_certain(assessment: Identifiability, verdict: Verdict, reason: str) -> Identifiability:
    worst = min(assessment.verdict, verdict, key=lambda either: CERTAINTY.get(either, 0))
    return replace(assessment, verdict=worst, verdict_reason=reason)


def _bounded(
    posterior: JudgedPosterior,
    name: str,
    assessment: Identifiability,
    wider: Verdict,
    side: Side,
    values: Array,
    error: Error,
) -> Identifiability:
    """What the draws say of a stiffness that a bound of its prior holds: a 95 % limit to the other side.

    Draws that exclude next to nothing of the prior's draws give none.
    """
    reason = f"{_bound_in_words(posterior, name, side)} limits it"
    limit, prior = float(np.quantile(values, _LIMIT[side])), posterior.prior_values(name)
    excluded = float(((prior < limit) if side == "upper" else (prior > limit)).mean())
    if excluded < LEAST_EXCLUDED:
        reason += f", and the data exclude only {100 * excluded:.0f} % of the prior"
        return replace(assessment, verdict="not identified", verdict_reason=reason)
    reason += f"; with {_WIDER} it would be {wider}" if wider in CERTAINTY else ""
    verdict: Verdict = "bounded below" if side == "upper" else "bounded above"
    assessment = replace(assessment, unit=posterior.unit(name), verdict=verdict, verdict_reason=reason)
    return replace(assessment, limit95=limit, limit95_error=error(_LIMIT[side]))


def _judge_by_likelihood(posterior: JudgedPosterior, name: str, assessment: Identifiability) -> Identifiability:
    """With what is printed: at each end the more cautious of what the draws and what the likelihood say."""
    if assessment.verdict == "identified" or len(posterior.problem.names) > MOST_UNKNOWNS:
        return assessment
    bounded, index = math.isfinite(assessment.limit95), posterior.stiffness_names.index(name)
    fall = FALL_ONE_SIDED if bounded else FALL_TWO_SIDED
    at95, (low, high) = posterior.likelihood_region.limits(index, fall, FALL_PRINTED)
    low, high = min(assessment.drawn95[0], low), max(assessment.drawn95[1], high)
    if bounded:
        low, high = (low, math.nan) if assessment.verdict == "bounded below" else (math.nan, high)
        prior = posterior.prior_values(name)
        excluded = float(((prior < low) | (prior > high)).mean())
        if excluded < LEAST_EXCLUDED:
            few = f"by likelihood the data exclude {100 * excluded:.0f} % of the prior"
            reason = f"{assessment.verdict_reason}, and {few}"
            assessment = replace(assessment, verdict="not identified", verdict_reason=reason, limit95=math.nan)
            return _judge_by_likelihood(posterior, name, assessment)
    elif assessment.verdict_reason == verdict_by_rule(assessment.ratio, assessment.contraction)[1]:
        _, reason = verdict_by_rule(assessment.ratio, assessment.contraction, ratio_of((low, high)))
        assessment = replace(assessment, verdict_reason=reason)
    return replace(assessment, unit=posterior.unit(name), likelihood95=at95, printed95=(low, high))


def _bound_in_words(posterior: JudgedPosterior, name: str, side: Side) -> str:
    """Such as "the prior's upper bound 1e8 N·m/rad"; what nobody stated is named as that."""
    bounds = posterior.problem.prior.bounds_of(name)
    assert bounds is not None
    if posterior.has_default_prior(name):
        reach = "up to" if side == "upper" else "from"
        end = join_unit(number(bounds[side == "upper"]), posterior.unit(name))
        return f"the default range, {reach} {end}, which no one stated,"
    return f"the prior's {side} bound {join_unit(number(bounds[side == 'upper']), posterior.unit(name))}"


def _log_ratio_error(assessment: Identifiability, wider: Identifiability, values: Array, effective: float) -> float:
    """Monte Carlo standard error of the difference of two ln (upper/lower end)."""
    errors = [error / abs(end) for end, error in zip(assessment.interval95, assessment.interval95_error, strict=True)]
    for end, probability in zip(wider.interval95, INTERVAL, strict=True):
        errors.append(quantile_spread(values, probability, effective) / abs(end))
    return math.hypot(*errors)


def _same_verdict(assessment: Identifiability, wider: Identifiability, error: float) -> bool:
    """Whether wider priors leave the verdict, within twice the Monte Carlo error of the ratio it hangs on."""
    near = (wider.ratio * math.exp(step * error) for step in (-2.0, 0.0, 2.0))
    return assessment.verdict in {verdict_by_rule(ratio, wider.contraction)[0] for ratio in near}
