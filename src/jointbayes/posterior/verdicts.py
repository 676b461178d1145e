"""The verdict on each stiffness of a posterior: the rule for its draws, and what may stand against it.

In order: the draws are judged by `VerdictRule`. A run that has not settled has no verdict where its Monte Carlo error
could change the class. Nor has one whose model does not explain measured data, which no structure's quite does, see
`jointbayes.posterior.decision`; of computed data it makes the verdict conditional. A stiffness to which several modes
give different values is not identified. Where the likelihood stays open as far as a bound of the prior, that bound and
not the data ends the interval, and the stiffness is bounded on the other side.
"""

import math
from collections.abc import Callable, Collection
from dataclasses import replace
from functools import partial

import numpy as np

from jointbayes.inference import JointPrior, OfStiffness
from jointbayes.phrases import Because, Reason, counted
from jointbayes.posterior.checks import check_of
from jointbayes.posterior.identifiability import (
    CERTAINTY,
    Side,
    Verdict,
    VerdictClass,
    assess,
    with_ends,
    with_test_alone,
)
from jointbayes.posterior.limits import LikelihoodRegion
from jointbayes.posterior.model_errors import measured_bodies_of, mesh_of, model_error_of
from jointbayes.posterior.prediction import further_measurement
from jointbayes.posterior.sampled import Sampled, by_ensemble, once
from jointbayes.posterior.solutions import solutions_of
from jointbayes.sampling import quantile_error
from jointbayes.verdict_rule import RULE, VerdictRule
from vibrecords.arrays import Array

#: Skip likelihood-ratio limits for more unknowns than this, because each limit would take seconds.
MOST_UNKNOWNS = 10
_SAME_DENSITY = 1e-3  # difference in log density of two points that are equally the mode, as `mode_agrees` has it
_REGION_DRAWS = 4000
#: Mass that a further decade would hold if the density stayed as it is at a bound: less cannot matter.
REACH = 0.01
DECADE = math.log(10)
_EDGE = 0.1  # of a decade, or of the prior's range: the part of it that counts as its edge


def mode_distance(posterior: Sampled) -> float:
    """Return the largest distance of joint mode and MAP in Laplace standard deviations: 0 where they agree."""
    sd = np.sqrt(np.diag(posterior.estimate.covariance))
    return float(np.abs((posterior.best.theta - posterior.estimate.theta) / sd).max())


def mode_agrees(posterior: Sampled) -> bool:
    """Whether joint mode and MAP are one point: within 0.01 standard deviations, or equal in density to 0.001.

    Along a direction that the data leave flat many points are equally the mode.
    """
    gain = posterior.best.log_density - posterior.estimate.log_posterior
    return mode_distance(posterior) <= 0.01 or abs(gain) <= _SAME_DENSITY


def default_priors(posterior: Sampled) -> Collection[str]:
    """Coordinates whose range is the default one, which the case does not state."""
    return () if posterior.case is None else posterior.case.default_priors


def rule_of(posterior: Sampled, name: str) -> VerdictRule:
    """Thresholds by which a stiffness is judged: those that the case states in ``[verdict]``, or the usual ones."""
    return RULE if posterior.case is None else posterior.case.verdict_rules.get(name, RULE)


@once
def region_of(posterior: Sampled) -> LikelihoodRegion:
    """Find joints that fit nearly as well as the best, for likelihood-ratio limits, which it keeps once found."""
    modes = [posterior.estimate.theta, posterior.best.theta, *(mode.theta for mode in posterior.estimate.modes)]
    theta = np.vstack([*modes, posterior.thinned(_REGION_DRAWS)])
    return LikelihoodRegion(posterior.problem.log_posterior, theta, solutions_of(posterior).nearest(theta))


def solution_sentences(posterior: Sampled) -> tuple[str, ...]:
    """Say what the solutions are and what would tell them apart; empty where there is one."""
    return tuple(filter(None, (describe_solutions(posterior), advice_on_solutions(posterior))))


def describe_solutions(posterior: Sampled) -> str:
    """Say how many solutions there are, and in what they differ; empty where there is one."""
    solutions = solutions_of(posterior)
    if not solutions.split:
        return ""
    shares = f"probability {', '.join(f'{solutions.shares[modes].sum():.2f}' for modes in solutions.distinct)}"
    if not posterior.converged:
        shares = "their probabilities are not settled, as the sampler has not converged"
    # of a model that does not explain the data the solutions only fit best
    fit = "explain the data" if check_of(posterior).explains else "fit the data best"
    what = f"{counted(len(solutions.distinct)).capitalize()} solutions {fit} ({shares}): {', '.join(solutions.split)}"
    return f"{what} differ between them."


@once
def advice_on_solutions(posterior: Sampled) -> str:
    """Say what measurement would tell the solutions apart; empty where there is one, or no measurement is known."""
    solutions = solutions_of(posterior)
    if not solutions.split:
        return ""
    theta = np.array([posterior.estimate.starts_for_draws[modes[0]][0] for modes in solutions.distinct])
    return further_measurement(posterior.problem, theta)


def reasons_for_no_verdict(posterior: Sampled) -> tuple[Because, ...]:
    """Why a run gives no verdict on any stiffness; empty where it does on one."""
    each = [judge_stiffness(posterior, name) for name in posterior.stiffness_names]
    if not each or any(verdict.cls != "no verdict" for verdict in each):
        return ()
    return tuple(reason for reason in each[0].reasons if all(reason in verdict.reasons for verdict in each))


@once
def judge_stiffness(posterior: Sampled, name: str) -> Verdict:
    """Judge one stiffness or other quantity by the draws of a run.

    1. Judge the draws by the rule.
    2. Collect what forbids a verdict: the search, the misfit, the mesh, and a run that has not settled where its Monte
       Carlo error could change the class.
    3. Hold the verdict against the solutions, the prior's bounds and the likelihood.

    Raises
    ------
    ModelError
        If there is no such quantity.
    """
    # 1. the draws
    rule, draws, converged = rule_of(posterior, name), by_ensemble(posterior, name), posterior.converged
    error = partial(quantile_error if converged else _error_of_unsettled, draws)
    drawn = assess(posterior.values(name), posterior.prior_values(name), error, posterior.unit(name), rule)
    # 2. what forbids a verdict
    against, check, mesh = list[Because](), check_of(posterior), mesh_of(posterior)
    model_error, bodies = model_error_of(posterior), measured_bodies_of(posterior)
    coarse = mesh is not None and mesh.moves(name)
    if not (converged or _holds_unsettled(posterior, name, drawn)):
        against.append(Because(Reason.NOT_CONVERGED))
    if not mode_agrees(posterior):
        gain = posterior.best.log_density - posterior.estimate.log_posterior
        if gain > _SAME_DENSITY:
            against.append(Because(Reason.BEST_FIT_MISSED, {"gain": gain}))
        else:
            against.append(Because(Reason.BEST_FITS_APART, {"distance_sd": mode_distance(posterior), "loss": -gain}))
    if not check.explains and not any(test.data.synthetic for test in posterior.problem.tests):
        misfit = Because(Reason.MISFIT, {"times": math.sqrt(check.chi2_per_line)})
        against.append(misfit if check.level == "above" else Because(Reason.PATTERN))
    if model_error is not None and model_error.grade == "impossible":
        against.append(Because(Reason.NO_MODEL, {"findings": model_error.findings}))
    if mesh is not None and coarse:
        against.append(Because(Reason.MESH, {"shift_sd": abs(mesh.shift_sd[name])}))
    if against:
        reach = bounds_within_reach(posterior.problem.prior, posterior.theta)
        at = [Because(Reason.AT_BOUND, _bound(posterior, name, side)) for held, side in reach if held == name]
        return replace(drawn, cls="no verdict", reasons=(*against, *at))
    # 3. solutions, bounds and likelihood
    found = conclude(posterior, name, drawn)
    if bodies is not None and bodies.ignored and not solutions_of(posterior).reason(name):
        found = replace(found, reasons=(*found.reasons, Because(Reason.BODIES, {"noise": bodies.noise})))
    return found if converged else replace(found, reasons=(*found.reasons, Because(Reason.HOLDS_UNSETTLED)))


def _error_of_unsettled(draws: Array, probability: float) -> float:
    """Monte Carlo error of a quantile of draws, (ensembles, steps, walkers), no less than the ensembles scatter."""
    each = np.quantile(draws, probability, axis=(1, 2))
    scatter = float(each.std(ddof=1)) / math.sqrt(len(each)) if len(each) > 1 else 0.0
    return max(quantile_error(draws, probability), scatter)


def _holds_unsettled(posterior: Sampled, name: str, drawn: Verdict) -> bool:
    """Whether the class of a run that has not settled is the same wherever its Monte Carlo error may have put the ends.

    Each end is moved outwards and inwards by twice its error, and each ensemble is judged by its own draws as well.
    Of several modes the probabilities are not settled, and the class depends on them.
    """
    if len(posterior.estimate.starts_for_draws) > 1 or not np.isfinite(drawn.interval_error).all():
        return False
    low, high = drawn.interval
    errors = np.array(drawn.interval_error)
    theta, ensemble = posterior.theta, np.repeat(posterior.draws["ensemble"].values, posterior.log_density.shape[1])
    classes = set[VerdictClass]()
    for side in (0.0, -2.0, 2.0):
        ends = low + side * errors[0], high - side * errors[1]
        if not ends[0] < ends[1]:
            return False
        moved = with_ends(drawn, ends, rule_of(posterior, name))
        for part in (theta, *(theta[ensemble == number] for number in np.unique(ensemble))):
            classes.add(conclude(posterior, name, moved, part).cls)
    return len(classes) == 1


def conclude(
    posterior: Sampled,
    name: str,
    drawn: Verdict,
    theta: Array | None = None,
    region: Callable[[], LikelihoodRegion] | None = None,
) -> Verdict:
    """Judge one stiffness by its draws, its solutions, the prior's bounds and the likelihood.

    1. A stiffness to which several solutions give different values is not identified.
    2. Find the ends that the data leave open, which no volume of the prior moves.
    3. With one open end: bounded on the other side, where that excludes more than a little of the prior.
    4. Add what the test alone says, where that differs from the draws.
    5. Where the model does not explain the data, the verdict holds only if the model were right.

    Parameters
    ----------
    posterior
        The run.
    name
        Of the quantity.
    drawn
        What the draws say, of the run itself or under other premises.
    theta
        These draws of θ, shape (n, d), by default those of the run.
    region
        Gives the joints that fit nearly as well as the best, by default those of the run; it takes seconds to find.
    """
    prior, certain, found = posterior.problem.prior, drawn.cls in CERTAINTY, drawn
    reach = bounds_within_reach(prior, posterior.theta if theta is None else theta)
    reached = {side for held, side in reach if held == name}
    # 1. Solutions
    if several := solutions_of(posterior).reason(name):
        found = replace(drawn, cls="not identified", reasons=(several,))
    elif name in posterior.stiffness_names and (drawn.cls != "identified" or reached):
        # 2. Open ends; of many unknowns those at which draws reach the prior's bound
        sought, ends, sides = len(prior.names) <= MOST_UNKNOWNS, drawn.interval, reached
        if sought:
            ends = (region() if region else region_of(posterior)).limits(posterior.stiffness_names.index(name))
            pairs: tuple[tuple[Side, float], ...] = (("lower", ends[0]), ("upper", ends[1]))
            sides = {side for side, end in pairs if math.isnan(end)}
        # 3. One of them, or both
        if prior.bounds_of(name) is not None and sides and (reached or not certain):
            if len(sides) == 1:
                (side,) = sides
                limit, before = ends[0] if side == "upper" else ends[1], posterior.prior_values(name)
                excluded = float(((before < limit) if side == "upper" else (before > limit)).mean())
                least = rule_of(posterior, name).excluded
                is_open = Because(Reason.OPEN, _bound(posterior, name, side))
                bounded: VerdictClass = "bounded below" if side == "upper" else "bounded above"
                if excluded >= least:
                    found = replace(drawn, cls=bounded, reasons=(is_open,), limit=limit)
                else:
                    little = Because(Reason.EXCLUDES_LITTLE, {"least": least})
                    found = replace(drawn, cls="not identified", reasons=(is_open, little))
            elif certain:
                low, high = prior.bounds_of(name) or (math.nan, math.nan)
                bounds = {"lower": low, "upper": high, "unit": drawn.unit}
                found = replace(drawn, cls="not identified", reasons=(Because(Reason.OPEN_BOTH, bounds),))
        # 4. The test alone
        found = with_test_alone(found, ends) if sought else found
    # 5. The model
    right = check_of(posterior).explains or found.cls == "not identified"
    return found if right else replace(found, if_model_right=True)


def _bound(posterior: Sampled, name: str, side: Side) -> dict[str, object]:
    """One bound of a prior, and whether the case states it, as the numbers of a reason."""
    bounds = posterior.problem.prior.bounds_of(name)
    assert bounds is not None
    default = name in default_priors(posterior)
    return {"side": side, "bound": bounds[side == "upper"], "unit": posterior.unit(name), "default": default}


def line_of(name: str, verdict: Verdict) -> str:
    """Median, 95 % interval and verdict of one stiffness, the same on every surface.

    Examples
    --------
    >>> line_of("k22", Verdict("identified", (1.51e6, 1.58e6), 1.52e6, "N·m/rad"))
    'k22 = 1.52 (1.51 to 1.58) MN·m/rad: identified'
    """
    return f"{name}{'' if math.isfinite(verdict.limit) else ' ='} {verdict.value}: {verdict.words}"


def reason_lines(verdict: Verdict) -> list[str]:
    """Why, a line each, with what is known without what the verdict takes as exact."""
    return [text for text in (*map(str, verdict.reasons), verdict.next_to_it) if text]


def mode_sentence(posterior: Sampled) -> str:
    """Why the joint mode lies outside a 95 % interval; empty where it does not."""
    ends = {name: posterior.interval(name) for name in posterior.stiffness_names}
    outside = [name for name, (low, high) in ends.items() if not low <= posterior.mode[name] <= high]
    if not outside:
        return ""
    names = " and ".join(outside)
    return f"The joint mode lies outside the 95 % interval of {names}: the distribution is skewed. Quote the median."


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
