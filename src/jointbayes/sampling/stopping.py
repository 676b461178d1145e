"""When to look at the chains, and when they are long enough."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jointbayes.sampling.diagnostics import autocorrelation_time, quantile_spread, quantile_tau, split_r_hat
from jointbayes.sampling.ensemble import SamplerSettings
from vibrecords.arrays import Array

ENDS_ARE_GOOD = "the ends of each 95 % interval are good to {} % of the interval's width"
#: Share of the density that only one origin may have found.
ALONE = 0.005
SEEN_BY_ONE = "{:.2g} % of the density was found from one origin only"
#: Largest error of an end in one of many analyses, as a share of the interval's width.
END_TOLERANCE = 0.05
#: Draws at every end with which the 2.5 % beyond it are known to a tenth of themselves: for that tolerance. An end on a
#: plateau far from the bulk is then as good as it need be, wherever it lies.
ENOUGH = 4000.0
#: Probabilities below the two ends of the 95 % interval.
INTERVAL = (0.025, 0.975)

# A check costs O(N log N). With checks at a fixed distance their sum would grow as N²; with N growing by 5 %
# from one to the next, all checks of a run together cost about 21 times the last one.
_GROWTH = 0.05

# Five τ leave e⁻⁵ of the start in the mean of the draws, if the slowest mode decays as exp(−t/τ).
_BURN_IN_FACTOR = 5.0

_RANKED_DRAWS = 10_000
_OF_ENDS = 0.5  # of `tau_factor`, for τ of "the draw lies below an end"


@dataclass(frozen=True, slots=True)
class Quantities:
    """Functions of θ whose 95 % intervals the stop rule looks at.

    Parameters
    ----------
    names : tuple of str
        One for each of the q quantities.
    values : callable
        (..., d) draws of θ to (..., q) values, each on the scale on which its interval is to be narrowly known.
    """

    names: tuple[str, ...]
    values: Callable[[Array], Array]


@dataclass(frozen=True, slots=True)
class EndError:
    """Monte Carlo standard error of one end of a 95 % interval, as a share of the interval's width.

    ``tau`` is the autocorrelation time of "the draw lies below the end" in steps, of the slowest of all ends: walkers
    may wait far longer in a tail than τ of the whole quantity tells.
    """

    name: str
    end: str
    share: float
    tau: float


@dataclass(frozen=True, slots=True, eq=False)
class Check:
    """What one look at the chains found.

    Parameters
    ----------
    step : int
        Number of steps each ensemble had made.
    burn_in : int
        Number of first steps left out of ``tau`` and ``r_hat``.
    tau : ndarray, shape (d,)
        Integrated autocorrelation time in steps.
    r_hat : ndarray, shape (d,)
        Rank-normalised split R̂ over the ensembles.
    end_error : EndError or None
        The least certain end of a 95 % interval; None where it was not looked at.
    """

    step: int
    burn_in: int
    tau: Array
    r_hat: Array
    end_error: EndError | None = None

    def __post_init__(self) -> None:
        self.tau.setflags(write=False)
        self.r_hat.setflags(write=False)

    @property
    def kept(self) -> int:
        """Number of steps after burn-in."""
        return self.step - self.burn_in

    @property
    def tau_max(self) -> float:
        """τ of the slowest parameter."""
        return float(np.max(self.tau))

    @property
    def r_hat_max(self) -> float:
        """R̂ of the parameter on which the ensembles agree least."""
        return float(np.max(self.r_hat))


@dataclass(frozen=True, slots=True)
class StopDecision:
    """Whether the stop rule is met, and the figures that say so."""

    converged: bool
    reason: str


def diagnose(theta: Array, previous: Check | None, every: int = 1, steps: int | None = None) -> Check:
    """Compute τ and R̂ of the steps after burn-in.

    The burn-in is 5 τ of the previous check, at most half of the steps (and exactly half at the first check,
    when no τ is known), so that τ, R̂ and the draws handed out all leave out the same steps, and τ is computed
    once. R̂ is computed from the draws as they will be handed out, thinned by :func:`thinning`, or from every so many
    steps that ten thousand draws are left: ranking more would cost more than all the rest and tell no more, because
    R̂ of as many draws scatters by less than 0.001.

    Parameters
    ----------
    theta : ndarray, shape (ensembles, held, walkers, d)
        All steps so far, or every so many of a long run.
    previous : Check or None
        The check before this one.
    every : int
        Distance of these in steps.
    steps : int, optional
        Number of all steps; by default the number of these.

    Returns
    -------
    Check
        τ and R̂ at this step.
    """
    burn_in = theta.shape[1] // 2
    if previous is not None and _BURN_IN_FACTOR * previous.tau_max < burn_in * every:
        burn_in = math.ceil(_BURN_IN_FACTOR * previous.tau_max / every)
    kept = theta[:, burn_in:]
    tau = autocorrelation_time(kept)
    ranked = max(thinning(tau), kept[..., 0].size // _RANKED_DRAWS)
    r_hat = split_r_hat(kept[:, ::ranked])
    return Check(
        step=steps or theta.shape[1],
        burn_in=burn_in * every,
        tau=tau * every,
        r_hat=r_hat,
    )


def worst_end_error(kept: Array, quantities: Quantities | None = None, every: int = 1) -> EndError:
    """Find the end of a 95 % interval that is least certain relative to the interval's width.

    Parameters
    ----------
    kept : ndarray, shape (ensembles, steps, walkers, d)
        Draws of θ after burn-in.
    quantities : Quantities, optional
        What has the intervals; by default the coordinates θ themselves.
    every : int
        Distance of these draws in steps.

    Returns
    -------
    EndError
        Its share is infinite where a quantity's draws are all equal.
    """
    values = kept if quantities is None else quantities.values(kept)
    names = quantities.names if quantities else tuple(f"coordinate {k + 1}" for k in range(values.shape[-1]))
    errors = []
    for k, name in enumerate(names):
        draws = values[..., k]
        low, high = np.quantile(draws, INTERVAL)
        for end, probability in zip(("lower", "upper"), INTERVAL, strict=True):
            tau, share = quantile_tau(draws, probability), math.inf
            if high > low and math.isfinite(tau):
                share = quantile_spread(draws, probability, draws.size / tau) / (high - low)
            errors.append(EndError(name, end, share, tau * every))
    worst = max(errors, key=lambda error: error.share)
    return replace(worst, tau=max(error.tau for error in errors))


def add_end_error(
    settings: SamplerSettings,
    checks: Sequence[Check],
    theta: Array,
    quantities: Quantities | None = None,
    every: int = 1,
) -> Check:
    """The last check with the error of the interval ends, if all the rest of the stop rule is met.

    Before that it would cost as much as τ and R̂ together, at every check, and decide nothing.

    Parameters
    ----------
    settings : SamplerSettings
        Limits of the stop rule.
    checks : sequence of Check
        All checks so far, at least one.
    theta : ndarray, shape (ensembles, held, walkers, d)
        All steps so far, or every so many of a long run.
    quantities : Quantities, optional
        As for :func:`worst_end_error`.
    every : int
        Distance of these in steps.
    """
    last = checks[-1]
    if _unmet(settings, checks):
        return last
    return replace(last, end_error=worst_end_error(theta[:, last.burn_in // every :], quantities, every))


def thinning(tau: Array) -> int:
    """Return the distance of handed-out draws in steps: half the smallest τ, at least 1.

    Parameters
    ----------
    tau : ndarray, shape (d,)
        Integrated autocorrelation time in steps.

    Returns
    -------
    int
        Every how many steps a draw is kept; 1 if no τ is finite.

    Examples
    --------
    >>> thinning(np.array([31.0, 80.0]))
    15
    """
    smallest = float(np.min(tau))
    return max(1, math.floor(smallest / 2.0)) if math.isfinite(smallest) else 1


def next_check(step: int, settings: SamplerSettings) -> int:
    """Return the step of the check that follows one at ``step``.

    Parameters
    ----------
    step : int
        Step of the last check, 0 before the first.
    settings : SamplerSettings
        ``check_every`` and ``max_steps`` are used.

    Returns
    -------
    int
        At least 5 % and at least ``check_every`` steps on, in whole blocks; the step limit itself if no full
        distance would be left after the check. (A last check right after another would find τ "stable".)

    Examples
    --------
    >>> [next_check(step, SamplerSettings()) for step in (0, 50, 4000, 18600)]
    [50, 100, 4200, 20000]
    """
    following = _one_distance_on(step, settings)
    return following if _one_distance_on(following, settings) <= settings.max_steps else settings.max_steps


def judge(settings: SamplerSettings, checks: Sequence[Check]) -> StopDecision:
    """Apply the stop rule to the last check.

    The rule is met if the kept steps exceed ``tau_factor`` τ, and half as many τ of each interval end, if τ has changed
    by less than ``tau_tolerance`` since the check before (τ of the slowest parameter), if R̂ of every parameter is below
    ``r_hat_max``, and if the Monte Carlo standard error of each end of each 95 % interval is below ``end_tolerance`` of
    the interval's width, or the end is worth as many draws as `ENOUGH` says. A NaN meets none of them.

    Parameters
    ----------
    settings : SamplerSettings
        The four limits.
    checks : sequence of Check
        All checks so far, at least one; the last as from :func:`add_end_error`.

    Returns
    -------
    StopDecision
        Whether the rule is met, and one sentence with the figures in either case.
    """
    last, unmet = checks[-1], _unmet(settings, checks)
    where = f"after {last.step} steps (limit {settings.max_steps})"
    error = last.end_error
    if not unmet and error is None:
        unmet.append("the errors of the ends of the 95 % intervals are unknown")
    if not unmet and error is not None:
        draws = settings.ensembles * settings.walkers * last.kept / error.tau
        enough = ENOUGH * (END_TOLERANCE / settings.end_tolerance) ** 2
        if not (error.share < settings.end_tolerance or draws >= enough):
            needed = f"below {100 * settings.end_tolerance:.1f} % is needed"
            unmet.append(
                f"the {error.end} end of the 95 % interval of {error.name} has a Monte Carlo error of "
                f"{100 * error.share:.2f} % of the interval's width, {needed}"
            )
    if not unmet and error is not None and not last.kept > _OF_ENDS * settings.tau_factor * error.tau:
        unmet.append(
            f"τ = {error.tau:.1f} steps of an end of a 95 % interval exceeds "
            f"1/{_OF_ENDS * settings.tau_factor:g} of the {last.kept} after burn-in"
        )
    if unmet:
        return StopDecision(False, f"not converged {where}: {'; '.join(unmet)}")
    assert error is not None
    factor, tolerance = f"{settings.tau_factor:g}", f"{100 * settings.tau_tolerance:.1f} %"
    met = f"autocorrelation time τ = {last.tau_max:.1f} steps, below 1/{factor} of the {last.kept} after burn-in"
    agree = f"R̂ ≤ {last.r_hat_max:.4f} over {settings.ensembles} ensembles"
    ends = ENDS_ARE_GOOD.format(f"{100 * error.share:.1f}")
    return StopDecision(True, f"converged {where}: {ends}; {met}, stable within {tolerance}; {agree}")


def expected_steps(settings: SamplerSettings, last: Check) -> int:
    """Estimate the step at which the stop rule will be met.

    Parameters
    ----------
    settings : SamplerSettings
        ``tau_factor``, ``check_every`` and ``max_steps`` are used.
    last : Check
        The last check, which has not met the rule.

    Returns
    -------
    int
        The first step in whole blocks, not before the next check, that is ``tau_factor`` τ past a burn-in of
        5 τ if τ stays as it is, and where the errors of interval ends, which fall with the root of the kept steps,
        are small enough; at most ``max_steps``.
    """
    kept = settings.tau_factor * last.tau_max
    if last.end_error is not None:
        needed = last.kept * (last.end_error.share / settings.end_tolerance) ** 2
        kept = max(kept, needed, _OF_ENDS * settings.tau_factor * last.end_error.tau)
    needed = kept + _BURN_IN_FACTOR * last.tau_max
    if not needed < settings.max_steps:
        return settings.max_steps
    whole_blocks = math.ceil(needed / settings.check_every) * settings.check_every
    return min(max(whole_blocks, next_check(last.step, settings)), settings.max_steps)


def _unmet(settings: SamplerSettings, checks: Sequence[Check]) -> list[str]:
    """What of the stop rule on τ and R̂ the last check does not meet, in words."""
    last = checks[-1]
    change = abs(last.tau_max - checks[-2].tau_max) / last.tau_max if len(checks) > 1 else math.inf
    factor, unmet = f"{settings.tau_factor:g}", []
    if not last.kept > settings.tau_factor * last.tau_max:
        unmet.append(f"τ = {last.tau_max:.1f} steps exceeds 1/{factor} of the {last.kept} after burn-in")
    if not change < settings.tau_tolerance:
        allowed = f"{100 * settings.tau_tolerance:.1f} %"
        unmet.append(f"τ changed by {100 * change:.1f} % since the check before, {allowed} is allowed")
    if not last.r_hat_max < settings.r_hat_max:
        unmet.append(
            f"R̂ = {last.r_hat_max:.4f} over {settings.ensembles} ensembles, below {settings.r_hat_max:g} is needed"
        )
    return unmet


def _one_distance_on(step: int, settings: SamplerSettings) -> int:
    blocks = max(1, math.ceil(_GROWTH * step / settings.check_every))
    return step + blocks * settings.check_every
