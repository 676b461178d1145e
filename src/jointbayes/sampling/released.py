"""Importance draws of a density that is far wider than a restrained one of which there are draws."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jointbayes.progress import Budget
from jointbayes.sampling.chains import Chains
from jointbayes.sampling.coordinate_maps import Coordinates, Identity
from jointbayes.sampling.density import Checked, LogDensity
from jointbayes.sampling.diagnostics import split_r_hat
from jointbayes.sampling.distributions import (
    Pool,
    ProposalDensity,
    WeightedDraws,
    importance_efficiency,
    resampled,
    theta_draws,
    truncated,
)
from jointbayes.sampling.proposal import Finite, OneOfProposals, Proposal, likeliest_mixture
from jointbayes.sampling.stopping import ENDS_ARE_GOOD, INTERVAL, Check, Quantities
from vibrecords.arrays import Array, Indices

#: Largest Monte Carlo standard error of each end of a 95 % interval, as a share of the interval's width.
END_TOLERANCE = 0.05

_TIGHT = 0.003  # of their own spread, to which released coordinates are restrained at first
_WIDER = (6.4, 3.2, 1.6)  # times as much at the next step, the first at which enough of the draws are effective
_STEP_DRAWS = 2000  # proposed at each step
_FITTED = 1200  # draws to which a proposal is fitted
_POOLED = 4000  # proposed in each round without restraint
_HANDED_OUT = 8000
# efficiency below which the next step is no wider, and which it has to have where it is much
_LEAST, _GOOD = 0.05, 0.15
_MOST_STEPS, _ROUNDS = 60, 40
_COMPONENTS = 3  # for each mode, of the mixtures without restraint
_PARTS = 3  # mixtures in a proposal, each but the first for draws that those before it miss
_MISSED = 1.5  # ln of an importance weight: draws above it are hardly ever proposed
_FEW = 5  # such draws for each parameter, below which nothing is fitted to them
_LARGEST_WEIGHT = 0.01  # of all, that one draw may carry
_LEAST_EFFECTIVE = 400.0  # draws at every end
#: Draws at every end with which the 2.5 % beyond it are known to a tenth of themselves. An end on a plateau far from
#: the bulk is then as good as it need be, wherever it lies.
ENOUGH = 4000.0
_PATIENT = 10  # rounds before that is asked: what few of them have not reached has no weight yet
_CHAINS = 4  # in which independent draws are handed out, to tell R̂ from


#: Equally weighted draws of θ, shape (n, d), and ln of the density there, shape (n,).
_Draws = tuple[Array, Array]


class Released(NamedTuple):
    """Equally weighted draws θ, shape (m, d), and how good they are.

    `effective` is the fewest independent draws that an end of a 95 % interval is worth, `error` the largest Monte Carlo
    standard error of an end, as a share of its interval's width.
    """

    theta: Array
    effective: float
    error: float


@dataclass(frozen=True, slots=True, eq=False)
class Restraint:
    """A normal factor of mean zero on some columns of θ, shape (n, d), each to a share of its spread `sd`."""

    columns: Indices
    sd: Array

    def log_factor(self, theta: Array, share: float) -> Array:
        """Its logarithm, shape (n,), where it holds the columns to this share; zero at a share of one."""
        return np.asarray(-0.5 * (share**-2 - 1.0) * ((theta[:, self.columns] / self.sd) ** 2).sum(axis=1))


@np.errstate(over="ignore", invalid="ignore")  # far out in straightened coordinates, which belong to no region
def released_draws(
    log_density: LogDensity,
    systems: Sequence[Coordinates],
    theta: Array,
    rng: np.random.Generator,
    quantities: Quantities,
    *,
    restraint: Restraint | None = None,
    proposal: Proposal | None = None,
    wide: ProposalDensity | None = None,
    modes: int = 1,
    enough: float = ENOUGH,
    tell: Callable[[str], object] = lambda _: None,
    budget: Budget | None = None,
) -> Released | None:
    """Draws of a density, of which some coordinates are narrowly restrained in the draws that there are.

    The restraint is let go step by step. At each the proposal, one Student-t for each mode in coordinates that are
    straightened anew, is fitted to weighted draws of the step before, of which those for the next one are chosen:
    a thin sheet is followed as it opens. Without restraint rounds of draws from mixtures are pooled, and weighted as
    from all of these together, until the ends of all intervals are known to `END_TOLERANCE`, or the probability
    beyond each by `enough` draws. Draws that a mixture would hardly propose have another one, in coordinates of their
    own.

    Parameters
    ----------
    log_density
        Log of the unnormalised density over θ.
    systems
        Coordinates to try, of which the first are those of most draws.
    theta
        Draws of the restrained density, shape (n, d); restrained columns are replaced. Without a restraint, draws that
        lie roughly where the density is.
    rng
        Source of all randomness.
    quantities
        What has the intervals.
    restraint
        On the columns that are released; by default none are.
    proposal
        From which the first draws without restraint come as well, in place of `theta`, if there is one.
    wide
        As wide as the support, over θ: draws of it come first, so that no part far from the others stays unseen.
    modes
        Number of modes of the density.
    enough
        Independent draws at each end with which that is good wherever it lies.
    tell
        Called with a sentence after each round without restraint.
    budget
        Processor time after which the ends have not settled; by default that of any stage, from now on.

    Returns
    -------
    Released or None
        None where the ends do not settle.

    References
    ----------
    P. Del Moral, A. Doucet, A. Jasra, Sequential Monte Carlo samplers (2006), DOI 10.1111/j.1467-9868.2006.00553.x.
    J.-M. Cornuet et al., Adaptive multiple importance sampling (2012), DOI 10.1111/j.1467-9469.2011.00756.x.
    """
    density, dimension, budget = Checked(log_density), theta.shape[1], budget or Budget()
    pool, settled_before = Pool(density, dimension), False
    theta = theta[rng.permutation(len(theta))[:_FITTED]]
    if wide is not None:
        pool.extend(wide, Identity(), rng, _POOLED)
    if proposal is not None:
        pool.extend(proposal.density, proposal.coordinates, rng, _POOLED)
        draws: _Draws | None = pool.theta[:0], pool.value[:0]
        if len(pool.theta):
            draws = _chosen((pool.theta, pool.value), pool.log_weight, _POOLED, rng)
    elif restraint is None:
        value = density(theta)
        draws = theta[np.isfinite(value)], value[np.isfinite(value)]
    else:
        draws = _followed(density, systems, theta, rng, restraint, modes, budget)
    for number in range(1, _ROUNDS + 1):
        if draws is None or not len(draws[0]) or budget.is_spent:
            return None
        fitted = _fitted(systems, *draws, modes * _COMPONENTS, rng)
        pool.extend(fitted.density, fitted.coordinates, rng, _POOLED)
        if not len(pool.theta):
            return None
        weighted = WeightedDraws(pool.theta, pool.log_weight)
        error, effective = interval_errors(quantities.values(weighted.theta), weighted.weight)
        tell(f"round {number} of at most {_ROUNDS}, ends good to {100 * error:.2g} % of their intervals' width")
        known = error <= END_TOLERANCE and effective >= _LEAST_EFFECTIVE
        known |= number >= _PATIENT and effective >= enough
        settled = known and weighted.weight.max() <= _LARGEST_WEIGHT
        if settled and settled_before:
            return Released(weighted.theta[resampled(weighted.weight, _HANDED_OUT, rng)], effective, error)
        settled_before = settled  # once may be by chance: where hardly any draws are proposed their weight shows late
        draws = _chosen((pool.theta, pool.value), weighted.log_weight, number * _POOLED, rng)
    return None


def independent_chains(log_density: LogDensity, released: Released, seconds: float) -> Chains:
    """As many of equally weighted draws as they are worth, as the chains of a run without burn-in.

    Parameters
    ----------
    log_density
        Log of the unnormalised density over θ.
    released
        The draws, in any order.
    seconds
        Wall time that they took.
    """
    theta, effective, error = released
    good = (
        ENDS_ARE_GOOD.format(f"{100 * END_TOLERANCE:g}")
        if error <= END_TOLERANCE
        else f"the 2.5 % beyond each end of a 95 % interval are good to {2.5 * math.sqrt(39 / effective):.1g} %"
    )
    steps = min(int(effective), len(theta)) // _CHAINS
    kept = theta[: _CHAINS * steps]
    draws = kept.reshape(_CHAINS, steps, 1, -1)
    check = Check(step=steps, burn_in=0, tau=np.ones(theta.shape[1]), r_hat=split_r_hat(draws))
    return Chains(
        theta=draws,
        log_density=log_density(kept).reshape(draws.shape[:-1]),
        acceptance=np.ones(_CHAINS),
        move_acceptance={},
        thin=1,
        converged=True,
        reason=f"{_CHAINS * steps} independent draws by importance sampling: {good}",
        evaluations=len(kept),
        singular=0,
        seconds=seconds,
        history=(check,),
    )


def interval_errors(values: Array, weight: Array) -> tuple[float, float]:
    """Monte Carlo error of the least certain end of the 95 % intervals of weighted draws, and what they are worth.

    Parameters
    ----------
    values
        Draws of some quantities, shape (n, q).
    weight
        Their normalised weights, shape (n,).

    Returns
    -------
    error, effective
        The largest standard error as a share of its interval's width, and the fewest independent draws with which the
        probability beyond an end would be as well known.
    """
    largest, fewest = 0.0, math.inf
    for column in values.T:
        order = np.argsort(column)
        below = np.cumsum(weight[order])
        low, high = np.interp(INTERVAL, below, column[order])
        for probability in INTERVAL:
            variance = float((weight[order] ** 2) @ ((below <= probability) - probability) ** 2)
            ends = np.interp(probability + np.sqrt(variance) * np.array([-1.0, 1.0]), below, column[order])
            largest = max(largest, float(ends[1] - ends[0]) / 2 / (high - low) if high > low else math.inf)
            fewest = min(fewest, probability * (1 - probability) / variance)
    return largest, fewest


def _followed(
    density: LogDensity,
    systems: Sequence[Coordinates],
    theta: Array,
    rng: np.random.Generator,
    restraint: Restraint,
    modes: int,
    budget: Budget,
) -> _Draws | None:
    """Draws of the density without restraint, of θ, shape (n, d), with a tight one; None where they get lost."""
    share, theta = _TIGHT, theta.copy()
    theta[:, restraint.columns] = share * restraint.sd * rng.standard_normal((len(theta), restraint.sd.size))
    restrained = np.zeros(len(theta))  # not known at the first of them, which are not of the density
    for _ in range(_MOST_STEPS):
        if budget.is_spent:
            return None
        proposal = _fitted(systems, theta, restrained, modes, rng)
        draws, value, log_proposal, _left = theta_draws(
            density, proposal.density, proposal.coordinates, rng, _STEP_DRAWS
        )
        alive = np.isfinite(value)
        draws, value, log_weight = draws[alive], value[alive], value[alive] - log_proposal[alive]
        if not len(draws):
            return None

        def efficiency(share: float, draws: Array = draws, log_weight: Array = log_weight) -> float:
            weights = truncated(log_weight + restraint.log_factor(draws, share), _STEP_DRAWS)
            return importance_efficiency(weights) * len(draws) / _STEP_DRAWS

        if efficiency(share) > _LEAST:
            if share == 1.0:
                return _chosen((draws, value), log_weight, _STEP_DRAWS, rng)
            *bold, cautious = (min(1.0, factor * share) for factor in _WIDER)
            share = next((wider for wider in bold if efficiency(wider) > _GOOD), cautious)
        factor = restraint.log_factor(draws, share)
        theta, restrained = _chosen((draws, value + factor), log_weight + factor, _STEP_DRAWS, rng)
    return None


def _fitted(
    systems: Sequence[Coordinates], theta: Array, value: Array, components: int, rng: np.random.Generator
) -> Proposal:
    """Mixtures fitted to equally weighted draws θ, shape (n, d), where ln of the density is `value`, shape (n,).

    The first is in the first coordinates. Draws that it would hardly propose have one of their own, in any, and so on.
    """
    parts: list[Proposal] = []
    shares: list[float] = []
    missed = np.ones(len(theta), dtype=bool)
    while len(parts) < _PARTS and (not parts or len(np.unique(theta[missed, 0])) > _FEW * (theta.shape[1] + 1)):
        rest = rng.permutation(theta[missed])
        held_out = len(rest) // 4
        tried = systems if parts else systems[:1]
        coordinates, mixture = likeliest_mixture(tried, rest[held_out:], rest[:held_out], components, rng)
        parts.append(Proposal(mixture, 0.0, 0, coordinates))
        shares.append(float(missed.mean()))
        density = OneOfProposals(tuple(parts), np.array(shares) / sum(shares))
        log_weight = value - density.log_density(theta)
        missed = log_weight + np.logaddexp.reduce(-log_weight) - np.log(len(theta)) > _MISSED
    return Proposal(density, 0.0, 0, Finite())


def _chosen(draws: _Draws, log_weight: Array, proposed: int, rng: np.random.Generator) -> _Draws:
    """Equally weighted draws, of weights that one far out does not rule."""
    (theta, value), cut = draws, truncated(log_weight, proposed)
    rows = resampled(np.exp(cut - cut.max()), _FITTED, rng)
    return theta[rows], value[rows]
