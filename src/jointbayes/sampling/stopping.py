"""When to look at the chains, and when they are long enough."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointbayes.sampling.diagnostics import autocorrelation_time, split_r_hat
from jointbayes.sampling.settings import SamplerSettings

__all__ = ["Check", "Verdict", "diagnose", "expected_steps", "judge", "next_check", "thinning"]

# A check costs O(N log N). With checks at a fixed distance their sum would grow as N²; with N growing by 5 %
# from one to the next, all checks of a run together cost about 21 times the last one.
_GROWTH = 0.05

# Five τ leave e⁻⁵ of the start in the mean of the draws, if the slowest mode decays as exp(−t/τ).
_BURN_IN_FACTOR = 5.0

_RANKED_DRAWS = 10_000


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
    """

    step: int
    burn_in: int
    tau: NDArray[np.float64]
    r_hat: NDArray[np.float64]

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
class Verdict:
    """Whether the stop rule is met, and the figures that say so."""

    converged: bool
    reason: str


def diagnose(theta: NDArray[np.float64], previous: Check | None) -> Check:
    """Compute τ and R̂ of the steps after burn-in.

    The burn-in is 5 τ of the previous check, at most half of the steps (and exactly half at the first check,
    when no τ is known), so that τ, R̂ and the draws handed out all leave out the same steps, and τ is computed
    once. R̂ is computed from the draws as they will be handed out, thinned by :func:`thinning`, or from every so many
    steps that ten thousand draws are left: ranking more would cost more than all the rest and tell no more, because
    R̂ of as many draws scatters by less than 0.001.

    Parameters
    ----------
    theta : ndarray, shape (ensembles, steps, walkers, d)
        All steps so far.
    previous : Check or None
        The check before this one.

    Returns
    -------
    Check
        τ and R̂ at this step.
    """
    steps = theta.shape[1]
    burn_in = steps // 2
    if previous is not None and _BURN_IN_FACTOR * previous.tau_max < burn_in:
        burn_in = math.ceil(_BURN_IN_FACTOR * previous.tau_max)
    kept = theta[:, burn_in:]
    tau = autocorrelation_time(kept)
    every = max(thinning(tau), kept[..., 0].size // _RANKED_DRAWS)
    return Check(step=steps, burn_in=burn_in, tau=tau, r_hat=split_r_hat(kept[:, ::every]))


def thinning(tau: NDArray[np.float64]) -> int:
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


def judge(settings: SamplerSettings, checks: Sequence[Check]) -> Verdict:
    """Apply the stop rule to the last check.

    The rule is met if the kept steps exceed ``tau_factor`` τ, if τ has changed by less than
    ``tau_tolerance`` since the check before (τ that of the slowest parameter), and if R̂ of every parameter
    is below ``r_hat_max``. A NaN meets none of them.

    Parameters
    ----------
    settings : SamplerSettings
        The three limits.
    checks : sequence of Check
        All checks so far, at least one.

    Returns
    -------
    Verdict
        Whether the rule is met, and one sentence with the figures in either case.
    """
    last = checks[-1]
    change = abs(last.tau_max - checks[-2].tau_max) / last.tau_max if len(checks) > 1 else math.inf
    tau, r_hat, ensembles = f"{last.tau_max:.1f}", f"{last.r_hat_max:.4f}", settings.ensembles
    factor, tolerance = f"{settings.tau_factor:g}", f"{settings.tau_tolerance:.1%}"
    unmet = []
    if not last.kept > settings.tau_factor * last.tau_max:
        unmet.append(f"τ = {tau} exceeds {last.kept}/{factor} (steps after burn-in / {factor})")
    if not change < settings.tau_tolerance:
        unmet.append(f"τ changed by {change:.1%} since the check before, {tolerance} is allowed")
    if not last.r_hat_max < settings.r_hat_max:
        unmet.append(f"R̂ = {r_hat} over {ensembles} ensembles, below {settings.r_hat_max:g} is needed")
    where = f"at {last.step} of {settings.max_steps} steps"
    if unmet:
        return Verdict(False, f"not converged {where}: {'; '.join(unmet)}")
    met = f"τ = {tau} < {last.kept}/{factor} (steps after burn-in / {factor}), stable within {tolerance}"
    return Verdict(True, f"converged {where}: {met}, R̂ ≤ {r_hat} over {ensembles} ensembles")


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
        5 τ if τ stays as it is; at most ``max_steps``.
    """
    needed = (settings.tau_factor + _BURN_IN_FACTOR) * last.tau_max
    if not needed < settings.max_steps:
        return settings.max_steps
    whole_blocks = math.ceil(needed / settings.check_every) * settings.check_every
    return min(max(whole_blocks, next_check(last.step, settings)), settings.max_steps)


def _one_distance_on(step: int, settings: SamplerSettings) -> int:
    blocks = max(1, math.ceil(_GROWTH * step / settings.check_every))
    return step + blocks * settings.check_every
