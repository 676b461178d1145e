"""Two origins of draws, which are kept apart until both have found the same of a density.

Importance draws come from two origins of their own, see `draws_from_two_origins`. Ensembles of walkers are the first
origin of a run by them, and climbs from the prior the second one, see `second_opinion`. Both ask the same rule,
`jointbayes.sampling.stopping.unmet_by`.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol

import numpy as np

from jointbayes.progress import Budget
from jointbayes.sampling.chains import Chains
from jointbayes.sampling.density import Checked, LogDensity
from jointbayes.sampling.diagnostics import split_r_hat
from jointbayes.sampling.distributions import drawn_without_replacement, resampled, truncated
from jointbayes.sampling.ensemble import SamplerSettings
from jointbayes.sampling.kernels import Kernels
from jointbayes.sampling.stopping import (
    ALONE,
    END_TOLERANCE,
    ENDS_ARE_GOOD,
    ENOUGH,
    INTERVAL,
    LEAST_EFFECTIVE,
    Check,
    Quantities,
    unmet_by,
)
from vibrecords.arrays import Array

_LANDED = 256  # climbs of each origin, twice as many at each further trial
_TRIALS = 6
_HIGH = 25.0  # below the best in log density: what ended lower is not where the density is
_ROUNDS, _DRAWS = 7, 2000  # in which an origin's kernels are adapted
_UNCHANGED = 2  # last rounds, after which no kernel is added
_ADDED = 150  # kernels in a round
_OF_ADDED = 0.3  # largest share of what is proposed that goes to added kernels
_MISSED = 1.0  # ln of an importance weight over their mean: draws above it are rarely proposed
_KEPT = 0.1  # of all that is proposed goes to all kernels alike
_WIDE = 0.15  # prior standard deviations: along wider axes a sheet is followed
_MOST_BENT = 5
_NEAREST, _FARTHEST = 0.01, 1.0  # reach of a kernel, in prior standard deviations
_POOLED, _BATCHES, _FEW = 4000, 12, 2  # draws of each origin at a time; more than a few where these will do
_LARGEST_WEIGHT = 0.01  # of all, that one draw may carry
_HANDED_OUT, _LOOKED_AT = 8000, 2000
_USELESS = 100.0  # effective draws, below which nothing is said
_CHAINS = 4  # in which independent draws are handed out, to tell R̂ from
#: Of a second opinion: climbs at first, kernels at draws of the run, draws of each origin's kernels, and the share of
#: the run's evaluations after which no more climbs begin.
_CLIMBS, _AT_DRAWS, _WEIGHED, _OF_THE_RUN = 32, 32, 1000, 0.1
_UNCONFIRMED = "no climb from the prior came down on them, so that no second origin confirms that these are all"


class Ground(Protocol):
    """A density as seen from all of its prior."""

    @property
    def sd(self) -> Array:
        """Widths of the prior, shape (d,)."""

    @property
    def evaluations(self) -> int:
        """Number of points at which the density was evaluated so far."""

    def log_density(self, theta: Array) -> Array:
        """Log of the unnormalised density, shape (n,), at θ, shape (n, d)."""

    def land(self, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Where climbs from n points of the prior end, shape (m, d), and ln of the density there, shape (m,)."""

    def widths(self, theta: Array) -> Array:
        """Widths of the density about points, shape (n, d), along its axes, in widths of the prior."""

    def shapes(self, theta: Array, reach: Array, bent: int) -> tuple[Array, Array]:
        """Axes of the density about points, (n, d, d), none longer than its reach, (n,), and its bend along some."""


class Found(NamedTuple):
    """Equally weighted draws θ, shape (m, d), and how good they are.

    `effective` is the fewest independent draws that an end of a 95 % interval is worth, `error` the largest Monte Carlo
    standard error of an end, as a share of its interval's width, `alone` the share of the density that was found from
    one origin only, and `log_z` ln of the density's integral, with its error. `efficiency` is the share of the draws
    that are effective, and `settled` says whether the ends are known and both origins found the same.
    """

    theta: Array
    effective: float
    error: float
    alone: float
    log_z: float
    log_z_error: float
    evaluations: int
    efficiency: float
    settled: bool


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def draws_from_two_origins(
    ground: Ground,
    modes: Array,
    rng: np.random.Generator,
    quantities: Quantities,
    *,
    tell: Callable[[str], object] = lambda _: None,
    budget: Budget | None = None,
) -> Found | None:
    """Draws of a density that may be a thin curved sheet, or several, across its prior.

    1. Each of two origins climbs from quasi-random points of the prior of its own; the first has the modes that are
       known as well.
    2. Where the climbs ended each has kernels, and adapts them in rounds of draws: by their weights, and by further
       kernels at draws that they hardly propose. What is then proposed does not change any more.
    3. Draws of both are weighted as from both together, until the ends of all intervals are known to `END_TOLERANCE`,
       or the probability beyond each by `ENOUGH` draws; or until the weights say that too many more would be needed.
    4. An origin has found a draw that one of its kernels is close to, see `Kernels.covers`. Where more than `ALONE` of
       the density was found by one origin only, both climb from twice as many further points; where nothing is missing
       and the ends are not known, kernels are added at draws that are rarely proposed.

    No draw says anything of a part that neither origin came down on.

    Parameters
    ----------
    ground
        The density, and the way down to it.
    modes
        Modes that are known, shape (m, d).
    rng
        Source of all randomness.
    quantities
        What has the intervals.
    tell
        Called with a sentence after each look.
    budget
        Evaluations of the density after which the ends have not settled, looked at between the steps; by default those
        of any stage.

    Returns
    -------
    Found or None
        None where kernels do not resemble the density: of many coordinates, of which a sheet has many as well; and
        where the budget ends before there are draws.

    References
    ----------
    O. Cappé et al., Adaptive importance sampling in general mixture classes (2008), DOI 10.1007/s11222-008-9059-x.
    A. Owen, Y. Zhou, Safe and effective importance sampling (2000), DOI 10.1080/01621459.2000.10473909.
    """
    density, begun = Checked(ground.log_density), ground.evaluations
    is_spent = (budget or Budget()).watch(lambda: ground.evaluations)
    ends, found, climbs, origins = [modes, modes[:0]], None, _LANDED, list[Kernels]()
    for _ in range(_TRIALS):
        # 1. climb down from all of the prior
        if climbs:
            landings = [ground.land(climbs, rng) for _ in ends]
            highest = max(
                [float(value.max()) for _, value in landings if value.size] + density(modes).tolist(), default=0
            )
            landed = [theta[value > highest - _HIGH] for theta, value in landings]
            ends = places = [np.concatenate(pair) for pair in zip(ends, landed, strict=True)]
        climbs = 2 * max(climbs, _LANDED)
        if is_spent():
            break
        if not all(map(len, ends)):
            continue
        # 2. adapt the kernels of each origin by draws of its own
        before: list[Kernels | None] = [*origins] or [None] * len(places)
        origins = [_adapted(density, ground, *pair, rng) for pair in zip(places, before, strict=True)]
        if is_spent():
            break
        # 3. draws of both, weighted as from both together, until the ends are known
        theta, value, proposed = modes[:0], np.empty(0), np.empty((len(origins), 0))
        for batch in range(1, _BATCHES + 1):
            drawn = np.concatenate([kernels.draw(rng, _POOLED) for kernels in origins])
            height = density(drawn)
            drawn, height = drawn[np.isfinite(height)], height[np.isfinite(height)]
            by_each = np.stack([kernels.log_density(drawn) for kernels in origins])
            theta, value = np.concatenate([theta, drawn]), np.concatenate([value, height])
            proposed = np.concatenate([proposed, by_each], axis=1)
            total = len(origins) * _POOLED * batch
            log_weight = value - (np.logaddexp.reduce(proposed, axis=0) - math.log(len(origins)))
            if not log_weight.size:
                break
            log_z = float(np.logaddexp.reduce(log_weight)) - math.log(total)
            weight = _normalised(log_weight)
            independent = 1 / float(weight @ weight)
            error, effective = interval_errors(quantities.values(theta), weight)
            unmet = unmet_by(error, effective, 0.0, tolerance=END_TOLERANCE, least=LEAST_EFFECTIVE, enough=ENOUGH)
            known = not unmet and float(weight.max()) <= _LARGEST_WEIGHT
            needed = max((error / END_TOLERANCE) ** 2, float(weight.max()) / _LARGEST_WEIGHT) * batch
            if known or is_spent() or (batch >= _FEW and needed > _BATCHES):
                break
        if not log_weight.size:
            origins = []
            continue
        # 4. what only one of them has found
        handed = theta[resampled(weight, _HANDED_OUT, rng)[rng.permutation(_HANDED_OUT)]]
        alone = seen_by_one(handed[:_LOOKED_AT], origins, ground.sd)
        missing = unmet_by(error, effective, alone, tolerance=END_TOLERANCE, least=LEAST_EFFECTIVE, enough=ENOUGH)
        settled = known and not missing
        tell(f"ends good to {100 * error:.2g} % of their intervals' width, {100 * alone:.2g} % seen by one origin only")
        log_z_error = math.sqrt(max(1 / independent - 1 / total, 0.0))
        figures = ground.evaluations - begun, independent / total, settled
        found = Found(handed, effective, error, alone, log_z, log_z_error, *figures)
        if settled or is_spent():
            break
        if alone <= ALONE:  # nothing is missing, but some places are rarely proposed
            climbs, missed = 0, np.flatnonzero(log_weight > log_z + _MISSED)
            more = drawn_without_replacement(log_weight[missed], 2 * _ADDED, rng)
            places = np.array_split(theta[missed[more]], 2)
        else:
            origins = []
    return found if found is not None and found.effective >= _USELESS else None


def seen_by_one(theta: Array, origins: Sequence[Kernels], sd: Array) -> float:
    """Return the share of equally weighted draws, shape (n, d), that not all origins have a kernel close to."""
    return 1 - float(np.all([kernels.covers(theta, sd) for kernels in origins], axis=0).mean())


class Opinion(NamedTuple):
    """What climbs from the prior say of draws of ensembles.

    `alone` is the share of the density that either of them has not found, NaN where no climb came down on the density.
    `missed` are points, shape (m, d), to which climbs led and where the ensembles have no draws. There are none where
    that share is no more than `ALONE`.
    """

    alone: float
    missed: Array

    def of(self, chains: Chains, settings: SamplerSettings) -> Chains:
        """Return chains that have converged, or that have not where one origin missed more than `ALONE`.

        Where no climb came down nothing is missing either, and the reason says that nothing confirms it.
        """
        if math.isnan(self.alone):
            return replace(chains, reason=f"{chains.reason}; {_UNCONFIRMED}")
        error = chains.history[-1].end_error
        assert error is not None
        unmet = unmet_by(error.share, chains.history[-1].kept / error.tau, self.alone, tolerance=settings.end_tolerance)
        if not unmet:
            return chains
        return replace(chains, converged=False, reason=f"not {chains.reason}; {'; '.join(unmet)}")


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def second_opinion(ground: Ground, chains: Chains, rng: np.random.Generator) -> Opinion:
    """Compare draws of ensembles, which began at known modes, with what climbs from the prior find by themselves.

    1. Climb from quasi-random points of the prior, which know nothing of the modes.
    2. Put kernels at some of the draws, and at the ends of the climbs, each as long as the density is there. Where
       the density has long tails, put further ones at the climbs' own weighted draws.
    3. Weigh draws of both kinds of kernels as from both together. What lies far from the draws was found by the climbs
       only. What lies far from the ends of the climbs is counted among the draws.
    4. Where only the draws know a part of the density, climb from twice as many points, if that is cheap for the run.

    Parameters
    ----------
    ground
        The density, and the way down to it.
    chains
        The ensembles. Further climbs may cost a tenth of the evaluations that they have made.
    rng
        Source of all randomness.
    """
    density, begun, climbs = Checked(ground.log_density), ground.evaluations, _CLIMBS
    draws = chains.theta[:, chains.held_burn_in :].reshape(-1, chains.theta.shape[-1])
    some = draws[rng.permutation(len(draws))[:_LOOKED_AT]]
    highest = float(density(some).max())

    def about(places: Array) -> Kernels:
        points, bent = _distinct(ground, places)
        return Kernels(points, *ground.shapes(points, np.full(len(points), _FARTHEST), bent), np.ones(len(points)))

    ends, run = draws[:0], about(some[:_AT_DRAWS])
    while True:
        # 1. climb from the prior
        theta, value = ground.land(climbs, rng)
        ends = np.concatenate([ends, theta[value > max(highest, float(value.max(initial=-np.inf))) - _HIGH]])
        opinion, climbs = Opinion(math.nan, draws[:0]), 2 * climbs
        if len(ends):
            # 2. kernels of both
            second = about(ends)
            # 3. weigh what only the climbs have found, and count what only the draws have
            drawn = np.concatenate([kernels.draw(rng, _WEIGHED) for kernels in (second, run)])
            height = density(drawn)
            height[~np.isfinite(height)] = -np.inf
            by_second, by_run = second.log_density(drawn), run.log_density(drawn)
            weight = _normalised(height - np.logaddexp(by_second, by_run))
            further = float(weight @ ~run.covers(drawn, ground.sd))
            if seen_by_one(some, [second], ground.sd) > ALONE:  # a tail is longer than the curvature says
                weight = _normalised(truncated((height - by_second)[:_WEIGHED], _WEIGHED))
                second = about(np.concatenate([ends, drawn[resampled(weight, _AT_DRAWS, rng)]]))
            alone = further + (1 - further) * seen_by_one(some, [second], ground.sd)
            missed = ends[~run.covers(ends, ground.sd) & (alone > ALONE)]
            opinion = Opinion(alone, missed)
            if alone <= ALONE or len(missed):
                return opinion
        # 4. further climbs
        if ground.evaluations - begun > _OF_THE_RUN * chains.evaluations:
            return opinion


def _distinct(ground: Ground, points: Array) -> tuple[Array, int]:
    """Return points that are apart, shape (n, d), and the number of axes along which the density bends at most of them.

    Climbs that end at one point make one kernel: as neighbours of each other they would make each too short.
    """
    _, first = np.unique(np.round(points / (_NEAREST * ground.sd)), axis=0, return_index=True)
    points = points[np.sort(first)]
    wide = int(np.median((ground.widths(points) > _WIDE).sum(axis=1)))
    return points, min(wide, _MOST_BENT, ground.sd.size - 1)


def _adapted(
    density: LogDensity, ground: Ground, points: Array, known: Kernels | None, rng: np.random.Generator
) -> Kernels:
    """Kernels about points where the density is, shape (n, d), with weights and further ones by rounds of draws.

    Next to kernels that are known already these are all, and the last rounds weigh them.
    """
    from scipy.spatial import cKDTree  # settings of a sampler are read without scipy

    sd, (points, bent) = ground.sd, _distinct(ground, points)
    bent = bent if known is None else known.bend.shape[1]
    neighbours = 2**bent + 2

    def about(chosen: Array, all_of_them: Array) -> Kernels:
        count = min(neighbours, len(all_of_them) - 1)
        distance = np.full(len(chosen), _FARTHEST)
        if bent and count:
            distance = np.asarray(cKDTree(all_of_them / sd).query(chosen / sd, k=[count + 1])[0])[:, 0]
        reach = np.clip(distance, _NEAREST, _FARTHEST)
        return Kernels(chosen, *ground.shapes(chosen, reach, bent), np.ones(len(chosen)))

    if known is None:
        kernels, begin = about(points, points), 1
    else:
        added = about(points, np.concatenate([known.places, points]))
        kernels, begin = known.joined(added, _OF_ADDED), _ROUNDS - _UNCHANGED + 1
    for number in range(begin, _ROUNDS + 1):
        theta = kernels.draw(rng, _DRAWS)
        value = density(theta)
        theta, value = theta[np.isfinite(value)], value[np.isfinite(value)]
        if not len(theta):
            break
        each = kernels.log_densities(theta)
        proposed = kernels.mixed(each)
        log_weight = truncated(value - proposed, _DRAWS)
        weight = np.exp(log_weight - np.logaddexp.reduce(log_weight))
        # population Monte Carlo: a kernel's weight is the share of the density that is likely its own
        shares = np.exp(each - proposed) @ weight * kernels.weights
        shares = (1 - _KEPT) * shares / shares.sum() + _KEPT / len(shares)
        kernels = Kernels(kernels.places, kernels.axes, kernels.bend, shares)
        missed = np.flatnonzero(value - proposed > np.logaddexp.reduce(log_weight) - math.log(_DRAWS) + _MISSED)
        if number <= _ROUNDS - _UNCHANGED and missed.size > 1:
            chosen = theta[missed[drawn_without_replacement(log_weight[missed], _ADDED, rng)]]
            added = about(chosen, np.concatenate([kernels.places, chosen]))
            kernels = kernels.joined(added, min(_OF_ADDED, float(weight[missed].sum())))
    return kernels


def _normalised(log_weight: Array) -> Array:
    """Weights that sum to one, shape (n,), of their logarithms."""
    return np.exp(log_weight - np.logaddexp.reduce(log_weight))


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


def independent_chains(log_density: LogDensity, found: Found, seconds: float) -> Chains:
    """As many of equally weighted draws as they are worth, as the chains of a run without burn-in.

    Parameters
    ----------
    log_density
        Log of the unnormalised density over θ.
    found
        The draws, in any order.
    seconds
        Wall time that they took.
    """
    theta, effective, error = found.theta, found.effective, found.error
    good = (
        ENDS_ARE_GOOD.format(f"{100 * max(END_TOLERANCE if found.settled else 0.0, error):.2g}")
        if error <= END_TOLERANCE or not found.settled
        else f"the 2.5 % beyond each end of a 95 % interval are good to {2.5 * math.sqrt(39 / effective):.1g} %"
    )
    steps = max(4, min(int(effective), len(theta)) // _CHAINS)
    kept = theta[: _CHAINS * steps]
    draws = kept.reshape(_CHAINS, steps, 1, -1)
    check = Check(step=steps, burn_in=0, tau=np.ones(theta.shape[1]), r_hat=split_r_hat(draws))
    reason = f"{_CHAINS * steps} independent draws by importance sampling from two origins: {good}"
    if not found.settled:
        one = f"{100 * found.alone:.2g} % of the density was found from one origin only"
        reason = f"not converged after {found.evaluations} evaluations: {reason}; {one}"
    return Chains(
        theta=draws,
        log_density=log_density(kept).reshape(draws.shape[:-1]),
        acceptance=np.ones(_CHAINS),
        move_acceptance={},
        thin=1,
        converged=found.settled,
        reason=reason,
        evaluations=found.evaluations,
        singular=0,
        seconds=seconds,
        history=(check,),
    )
