"""Two origins of draws, which are kept apart until both have found the same of a density."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from jointbayes.errors import SamplingError
from jointbayes.sampling.density import Checked, LogDensity
from jointbayes.sampling.distributions import drawn_without_replacement, resampled, student_efficiency, truncated
from jointbayes.sampling.kernels import Kernels
from jointbayes.sampling.stopping import ALONE, SEEN_BY_ONE
from vibrecords.arrays import Array

_FEW, _MANY = 32, 256  # climbs of each origin: at first, and where these have ended in many places
_PLACES = 8  # are many
_TRIALS = 6  # each with twice as many climbs as the one before
_HIGH = 25.0  # below the best in log density: what ended lower is not where the density is
_ROUNDS, _DRAWS = 6, 2000  # in which an origin's kernels are adapted
_LIKE_GAUSSIAN = 0.95  # of the efficiency of a Student-t for a Gaussian, with which the rounds end
_UNCHANGED = 2  # last rounds, after which no kernel is added
_ADDED = 150  # kernels in a round
_OF_ADDED = 0.3  # largest share of what is proposed that goes to added kernels
_MISSED = 1.0  # ln of an importance weight over their mean: draws above it are rarely proposed
_KEPT = 0.1  # of all that is proposed goes to all kernels alike
_WIDE = 0.15  # prior standard deviations: along wider axes a sheet is followed
_MOST_BENT = 5
_NEAREST, _FARTHEST = 0.01, 1.0  # reach of a kernel, in prior standard deviations
_WEIGHED = 4000  # draws of each origin
_HANDED_OUT, _LOOKED_AT = 8000, 2000
_AS_OFTEN = math.log(100.0)  # ln of how much rarer than the other an origin may propose a place that it has found
_NARROWER = 30  # times that kernels are halved, near a corner of the support
#: Efficiency of both origins from which on the weights of their draws say what only one has found.
RESEMBLES = 0.01


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


class Origins(NamedTuple):
    """What two origins have found of a density.

    `kernels` are those of each origin that came down on it, and `starts` draws of each, shape (m, d), none twice, the
    likeliest first. `theta` are equally weighted draws of both, shape (n, d), as from both together, and `efficiency`
    the share of the weighted ones that is effective. `alone` is the share of the density that one origin only has
    found, NaN where the second came down on nothing.
    """

    kernels: Sequence[Kernels]
    starts: Sequence[Array]
    theta: Array
    efficiency: float
    alone: float

    @property
    def places(self) -> Array:
        """All that is known of where the density is: draws, and where kernels are, shape (n, d)."""
        return np.concatenate([self.theta, *(kernels.places for kernels in self.kernels)])


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def two_origins(
    ground: Ground,
    modes: Array,
    rng: np.random.Generator,
    walkers: int = 0,
    *,
    tell: Callable[[str], object] = lambda _: None,
    is_spent: Callable[[], bool] = lambda: False,
) -> Origins:
    """Look for a density from two origins that know nothing of each other. It may be a sheet, or several, in its prior.

    1. Each origin climbs from quasi-random points of the prior of its own; the first has the modes that are known as
       well.
    2. Where its climbs ended each has kernels, and adapts them in rounds of draws: by their weights, and by further
       kernels at draws that they hardly propose.
    3. Draws of both are weighted as from both together. What both have found is told by `seen_by_one`.
    4. Where more than `ALONE` of the density was found by one origin only, both climb from twice as many further
       points.

    No draw says anything of a part that neither origin came down on.

    Parameters
    ----------
    ground
        The density, and the way down to it.
    modes
        Modes that are known, shape (m, d).
    rng
        Source of all randomness.
    walkers
        Starting places that are needed from each origin.
    tell
        Called with a sentence before each further look.
    is_spent
        Whether the origins must do with what they have.

    References
    ----------
    O. Cappé et al., Adaptive importance sampling in general mixture classes (2008), DOI 10.1007/s11222-008-9059-x.
    A. Owen, Y. Zhou, Safe and effective importance sampling (2000), DOI 10.1080/01621459.2000.10473909.
    """
    density = Checked(ground.log_density)
    highest, ends, climbs, n = float(density(modes).max()), [modes, modes[:0]], _FEW, max(_WEIGHED, 4 * walkers)
    for trial in range(_TRIALS):
        # 1. climb down from all of the prior
        highest = _climb(ground, ends, climbs, highest, rng)
        if not trial and len(_distinct(ground, np.concatenate(ends))[0]) > _PLACES:
            highest = _climb(ground, ends, _MANY, highest, rng)
        climbs = 2 * _MANY if climbs == _FEW else 2 * climbs
        # 2. adapt the kernels of each origin by draws of its own
        places, bends = zip(*(_distinct(ground, each) for each in ends if len(each)), strict=True)
        each_adapted = [adapted(ground, _at(ground, each, each, max(bends)), rng)[0] for each in places]
        # 3. draws of both, weighted as from both together
        kernels, drawn, heights = zip(*(_inside(density, each, rng, n) for each in each_adapted), strict=True)
        theta, value = np.concatenate(drawn), np.concatenate(heights)
        by_each = np.stack([each.log_density(theta) for each in kernels])
        weight = _normalised(truncated(value - np.logaddexp.reduce(by_each, axis=0), len(value)))
        handed = theta[resampled(weight, _HANDED_OUT, rng)[rng.permutation(_HANDED_OUT)]]
        # 4. what only one of them has found
        alone = seen_by_one(handed[:_LOOKED_AT], kernels, ground.sd) if len(kernels) > 1 else math.nan
        if not alone > ALONE or is_spent():
            break
        tell(SEEN_BY_ONE.format(100 * alone))
    starts = []
    for own, theta, value in zip(kernels, drawn, heights, strict=True):
        log_weight = truncated(value - own.log_density(theta), n)
        starts.append(theta[drawn_without_replacement(log_weight, n, rng)])
    return Origins(kernels, starts, handed, 1 / float(weight @ weight) / len(weight), alone)


def _climb(ground: Ground, ends: list[Array], climbs: int, highest: float, rng: np.random.Generator) -> float:
    """Add to the ends of each origin those of further climbs that are not far below the highest; return its height."""
    landings = [ground.land(climbs, rng) for _ in ends]
    highest = max([highest, *(float(value.max(initial=-math.inf)) for _, value in landings)])
    for number, (theta, value) in enumerate(landings):
        ends[number] = np.concatenate([ends[number], theta[value > highest - _HIGH]])
    return highest


def _inside(density: LogDensity, kernels: Kernels, rng: np.random.Generator, n: int) -> tuple[Kernels, Array, Array]:
    """Draws of kernels where the density is above zero, at most n, with its logarithm there.

    Near a corner of the support, where hardly a draw lies inside, kernels are narrowed until enough do.
    """
    fewest = n // 4
    for _ in range(_NARROWER):
        theta = kernels.draw(rng, n)
        value = density(theta)
        inside = np.isfinite(value)
        if inside.sum() >= fewest:
            return kernels, theta[inside], value[inside]
        kernels = Kernels(kernels.places, kernels.axes / 2, kernels.bend / 4, kernels.weights)
    raise SamplingError(
        f"start: found only {int(inside.sum())} of {fewest} starting points where the prior is above zero; "
        "expected a mode inside the prior's support; widen the priors"
    )


def seen_by_one(theta: Array, origins: Sequence[Kernels], sd: Array) -> float:
    """Return the share of equally weighted draws, shape (n, d), that not all origins have found.

    An origin has found a draw if one of its kernels is close to it, or if it proposes the place nearly as often as the
    others do: in a tail both do, whose kernels lie elsewhere.
    """
    each = np.stack([kernels.log_density(theta) for kernels in origins])
    proposed = each > each.max(axis=0) - _AS_OFTEN
    return 1 - float(np.all([kernels.covers(theta, sd) for kernels in origins] | proposed, axis=0).mean())


def kernels_at(ground: Ground, points: Array, origins: Sequence[Kernels]) -> Kernels:
    """Kernels of equal weight at points, shape (n, d), as long as it is to some of the others and of the origins'."""
    points, bent = _distinct(ground, points)
    return _at(ground, points, np.concatenate([points, *(kernels.places for kernels in origins)]), bent)


def _distinct(ground: Ground, points: Array) -> tuple[Array, int]:
    """Return points that are apart, shape (n, d), and the number of axes along which the density bends at most of them.

    Climbs that end at one point make one kernel: as neighbours of each other they would make each too short.
    """
    _, first = np.unique(np.round(points / (_NEAREST * ground.sd)), axis=0, return_index=True)
    points = points[np.sort(first)]
    wide = int(np.median((ground.widths(points) > _WIDE).sum(axis=1)))
    return points, min(wide, _MOST_BENT, ground.sd.size - 1)


def _at(ground: Ground, points: Array, others: Array, bent: int) -> Kernels:
    """Kernels at points, shape (n, d), as long as it is to some others, shape (m, d), which these are among."""
    from scipy.spatial import cKDTree  # settings of a sampler are read without scipy

    count, distance = min(2**bent + 2, len(others) - 1), np.full(len(points), _FARTHEST)
    if bent and count:
        distance = np.asarray(cKDTree(others / ground.sd).query(points / ground.sd, k=[count + 1])[0])[:, 0]
    reach = np.clip(distance, _NEAREST, _FARTHEST)
    return Kernels(points, *ground.shapes(points, reach, bent), np.ones(len(points)))


def adapted(
    ground: Ground, kernels: Kernels, rng: np.random.Generator, *, most: int = _ROUNDS, n: int = _DRAWS
) -> tuple[Kernels, float]:
    """Kernels with weights and further ones by at most so many rounds of n draws, and their efficiency in the last one.

    They end where the kernels can hardly become better: draws of too few say nothing of a tail beyond. In the last ones
    none is added.
    """
    density, efficiency = Checked(ground.log_density), 0.0
    for number in range(1, most + 1):
        theta = kernels.draw(rng, n)
        value = density(theta)
        theta, value = theta[np.isfinite(value)], value[np.isfinite(value)]
        if not len(theta):
            break
        each = kernels.log_densities(theta)
        proposed = kernels.mixed(each)
        log_weight = truncated(value - proposed, n)
        weight = _normalised(log_weight)
        efficiency = 1 / (n * float(weight @ weight))
        if efficiency > _LIKE_GAUSSIAN * student_efficiency(theta.shape[1]):
            break
        # population Monte Carlo: a kernel's weight is the share of the density that is likely its own
        shares = np.exp(each - proposed) @ weight * kernels.weights
        shares = (1 - _KEPT) * shares / shares.sum() + _KEPT / len(shares)
        kernels = Kernels(kernels.places, kernels.axes, kernels.bend, shares)
        missed = np.flatnonzero(value - proposed > np.logaddexp.reduce(log_weight) - math.log(n) + _MISSED)
        if number <= most - _UNCHANGED and missed.size > 1:
            chosen = theta[missed[drawn_without_replacement(log_weight[missed], n * _ADDED // _DRAWS, rng)]]
            added = _at(ground, chosen, np.concatenate([kernels.places, chosen]), kernels.bend.shape[1])
            kernels = kernels.joined(added, min(_OF_ADDED, float(weight[missed].sum())))
    return kernels, efficiency


def _normalised(log_weight: Array) -> Array:
    """Weights that sum to one, shape (n,), of their logarithms."""
    return np.exp(log_weight - np.logaddexp.reduce(log_weight))
