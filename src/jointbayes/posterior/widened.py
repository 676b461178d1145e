"""Every prior of the joint a decade wider on each side, and the bounds that this can matter at."""

import dataclasses
import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointbayes.inference import JointPrior, LogPosterior, Marginal, Normal, OfStiffness, Problem, Uniform
from jointbayes.joint import Coordinate
from vibrecords.arrays import Array

Side = Literal["lower", "upper"]

#: By how much each bound of ln k is moved out.
DECADE = math.log(10)
_NORMAL_95 = 1.959963984540054

#: Mass that a further decade would hold if the density stayed as it is at the bound: less cannot matter.
REACH = 0.01
_EDGE = 0.1  # of a decade, or of ρ's range: the part of the prior's range that counts as its edge


@dataclass(frozen=True, slots=True, eq=False)
class WidenedPosterior:
    """Draws from the posterior under wider priors of the joint.

    Parameters
    ----------
    prior
        The wider priors.
    theta
        Equally weighted draws of θ, shape (n, d); those of the wider prior where none of the posterior may be trusted.
    prior_theta
        Draws from the wider prior, shape (m, d).
    effective
        Number of independent draws that `theta` is worth.
    reliable
        Whether the draws may be trusted.
    """

    prior: JointPrior
    theta: Array
    prior_theta: Array
    effective: float
    reliable: bool = True

    def __post_init__(self) -> None:
        self.theta.setflags(write=False)
        self.prior_theta.setflags(write=False)


def replace_prior(problem: Problem, prior: JointPrior) -> Problem:
    """The problem under another prior; its likelihood is not built anew."""
    other = dataclasses.replace(problem, prior=prior)
    other.__dict__["log_posterior"] = LogPosterior(
        prior, problem.log_posterior.likelihood, problem.extra_log_likelihood
    )
    return other


def widened_prior(prior: JointPrior) -> JointPrior:
    """The prior with each marginal of the joint a decade wider on each side.

    Bounds of a logarithm, or of a stiffness itself, move by a decade; a normal's standard deviation grows so that its
    95 % range grows by a decade on each side. A bounded coordinate such as ρ becomes uniform over all that is possible;
    one that is neither reaches ten times as far from its middle.
    """
    pairs = zip(prior.parametrisation.axes, prior.marginals, strict=True)
    return dataclasses.replace(prior, marginals=tuple(_wider(axis, marginal) for axis, marginal in pairs))


def _wider(axis: Coordinate, marginal: Marginal) -> Marginal:
    if axis.bounded:
        return Uniform(*axis.bounds)
    if not axis.logarithmic:
        if isinstance(marginal, Uniform):
            reach = 10 * (marginal.high - marginal.low) / 2
            return Uniform(marginal.mean - reach, marginal.mean + reach)
        return Normal(marginal.mean, 10 * marginal.sd)
    if isinstance(marginal, Uniform):
        return Uniform(marginal.low - DECADE, marginal.high + DECADE)
    if isinstance(marginal, OfStiffness) and isinstance(marginal.given, Uniform):
        return OfStiffness(Uniform(max(marginal.given.low, 0.0) / 10, marginal.given.high * 10))
    return Normal(marginal.mean, marginal.sd + DECADE / _NORMAL_95)


def bounds_within_reach(prior: JointPrior, theta: Array) -> tuple[tuple[str, Side], ...]:
    """Bounds of uniform priors of the joint beyond which a wider prior could hold mass of any consequence.

    It could if the density of the draws at the bound, kept up over the decade beyond it, would hold more than
    `REACH` of the mass.

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
    marginals = zip(prior.parametrisation.names, prior.marginals, widened_prior(prior).marginals, strict=True)
    for column, (name, stated, wider) in enumerate(marginals):
        if prior.bounds_of(name) is None:
            continue
        draws, (low, high), (least, most) = theta[:, column], stated.support, wider.support
        edge = _EDGE * min(DECADE, high - low)
        below, above = (draws < low + edge).mean(), (draws > high - edge).mean()
        # a prior that is uniform in k keeps its density in k: of ln k it grows on beyond the upper end
        beyond = math.expm1(most - high) if isinstance(stated, OfStiffness) else most - high
        if math.isfinite(low) and below / edge * (low - least) > REACH:
            within_reach.append((name, "lower"))
        if above / edge * beyond > REACH:
            within_reach.append((name, "upper"))
    return tuple(within_reach)


def moved_beyond_bounds(prior: JointPrior, theta: Array) -> Array:
    """Draws θ, shape (n, d), and those near a bound within reach again, moved beyond it: (m, d), m ≥ n.

    Where data say nothing a density goes on beyond its bound as it is before it, and a proposal that is fitted to draws
    that end there reaches the rest hardly ever.
    """
    moved = [theta]
    for name, side in bounds_within_reach(prior, theta):
        column, end = prior.names.index(name), 0 if side == "lower" else 1
        bound = prior.marginals[column].support[end]
        step = widened_prior(prior).marginals[column].support[end] - bound
        copies = theta[np.abs(theta[:, column] - bound) < abs(step)].copy()
        copies[:, column] += step
        moved.append(copies)
    return np.concatenate(moved)
