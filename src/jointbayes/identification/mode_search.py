"""The search for the posterior mode: climbs from many starts and images of their ends, and the modes they lead to."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import ModelError
from jointbayes.identification.map_estimate import GAIN, LocalMode, MapEstimate, StartOutcome
from jointbayes.identification.refine import inside_the_edges, laplace_covariance, refine
from jointbayes.inference import LogPosterior, Problem
from jointbayes.inference.climb import PosteriorSquares, climb_all
from jointbayes.joint import Joints
from jointbayes.joint.quantities import is_rotation
from jointbayes.progress import Budget, Progress, ProgressCallback, tell_nobody
from vibrecords.arrays import Array, Indices

#: What is being done, for whoever looks.
SEARCHING = "searching for the best fit"
#: Two modes are the same when they lie this close, in prior standard deviations and in log density.
_SAME_POINT = 1e-3
_SAME_DENSITY = 1e-3
#: A mode this much lower in log density than the best matters no more.
_LOWEST = 12.0
_MOST_MODES = 24  # all orders of four like joints
#: Two ends are two modes when the log density falls by this much between them, looked at in so many places.
_VALLEY = 0.5
_LINE = 21
#: Steps of the rough climb. Two rough ends are one when they are nearer than this, in prior standard deviations and in
#: log density.
_ROUGH_STEPS = 40
_NEAR, _NEARLY = 0.01, 0.05
#: A rough end from which the density falls no more than this on the way to a mode leads there.
_FALL = 0.01
#: Rough ends that are lower than the best by `_LOWEST` and this are not refined, and no more than so many in one go.
_UNREFINED, _REFINED = 20.0, 8
_IMAGES = 8  # of a mode, from which to climb
#: Of one coordinate with the others as they are, between its ends or so many prior standard deviations from its mean;
#: of all coordinates so many climb at once.
_PLACES, _WIDE = (0.03, 0.2, 0.4, 0.6, 0.8, 0.97), 2.0
MANY_MOVED = 72


class ModeSearch:
    """Climbs from more and more starts, and what they found.

    All starts climb together, roughly and under Gaussian noise of the stated size; the distinct ends that may matter
    are then climbed to the last digit, under the noise model itself.

    Parameters
    ----------
    log_posterior
        Density to climb.
    progress
        Called with the number of starts that have arrived.
    budget
        Evaluations after which climbs end where they are and no more are begun; by default those of any stage.
    """

    def __init__(
        self, log_posterior: LogPosterior, progress: ProgressCallback = tell_nobody, budget: Budget | None = None
    ) -> None:
        self._posterior, self._progress, self.budget = log_posterior, progress, budget or Budget()
        #: Whether the search has to end with what it has; all evaluations of the density count.
        self.is_spent = self.budget.watch(lambda: log_posterior.evaluations)
        self._begun: dict[str, Array] = {}  # quantities of the joint by the start's name
        self._ends: dict[str, tuple[Array, float]] = {}
        self._refined: list[_Refined] = []
        self._examined = 0  # of these, whether to climb from their images
        self._imaged: list[_Refined] = []

    @property
    def best(self) -> tuple[Array, float]:
        """Highest end so far, θ of shape (d,), and its log density.

        Raises
        ------
        ModelError
            If no start lies inside the prior's support.
        """
        if not self._refined:
            found = "found no start inside the prior's support"
            raise ModelError.of("MAP", (), found, "priors that contain a positive definite joint", "widen them")
        highest = max(end.log_density for end in self._refined)
        # of ends that are equally good the first: a further start that leads to a known mode changes nothing
        first = next(end for end in self._refined if end.log_density >= highest - _SAME_DENSITY)
        return first.theta, first.log_density

    def reached(self) -> dict[str, bool]:
        """Whether each start, by name, ended at the best mode; of those at which the density has a value."""
        theta, best = self.best
        sd = self._posterior.prior.sd
        return {
            # along a ridge that data and prior leave flat many points are equally the mode
            name: bool((np.abs((end - theta) / sd) < _SAME_POINT).all()) or best - density < _SAME_DENSITY
            for name, (end, density) in self._ends.items()
        }

    def climb_stiffnesses(self, starts: Mapping[str, ArrayLike]) -> None:
        """Climb from joints, shape (q,), by name, each moved into the prior's support."""
        inside = {name: into_support(self._posterior, k) for name, k in starts.items()}
        self._begun |= {name: np.asarray(k, dtype=float) for name, k in starts.items()}
        self.climb({name: theta for name, theta in inside.items() if theta is not None})

    def climb(self, starts: Mapping[str, Array], weights: Sequence[Array] = ()) -> None:
        """Climb from points θ, each shape (d,), by name.

        Parameters
        ----------
        starts
            Points inside the support.
        weights
            Factors on the white residuals, shape (m,), with which they climb first, one after the other.
        """
        prior = self._posterior.prior
        self._begun |= {name: prior.values(theta) for name, theta in starts.items() if name not in self._begun}
        if not starts:
            return
        rough = self._climbed(np.array(list(starts.values())), weights)
        density = self._posterior(rough)
        possible = {name: i for i, name in enumerate(starts) if np.isfinite(density[i])}
        self._ends |= {name: (rough[i], float(density[i])) for name, i in possible.items()}
        self._ends |= dict(zip(possible, self._refine_distinct([self._ends[name] for name in possible]), strict=True))

    def climb_on(self, weights: Sequence[Array]) -> None:
        """Climb from the modes found so far, first with these factors on the residuals: they are no new starts."""
        self._climb_from(np.array([end.theta for end in self._refined]), weights)

    def climb_images(self, images: Callable[[Array], Array]) -> None:
        """Climb from the highest images of each mode that may matter, until none is new: they are no new starts.

        Parameters
        ----------
        images
            Gives the images, shape (n, d), of a mode, shape (d,), see `jointbayes.identification.mode_search`.
        """
        sd = self._posterior.prior.sd
        while self._examined < len(self._refined) and len(self._imaged) < _MOST_MODES and not self.is_spent():
            mode = self._refined[self._examined]
            self._examined += 1
            pairs = ((end.theta, mode.theta, min(end.log_density, mode.log_density)) for end in self._imaged)
            if mode.log_density < self.best[1] - _LOWEST or not all(_parted(self._posterior, *pair) for pair in pairs):
                continue
            self._imaged.append(mode)
            modes = np.array([end.theta for end in self._refined])
            theta = images(mode.theta)
            theta = theta[(np.abs((theta[:, None] - modes) / sd) > _NEAR).any(axis=-1).all(axis=-1)]
            density = self._posterior(theta)
            highest = np.argsort(-density, kind="stable")[:_IMAGES]
            theta = theta[highest[np.isfinite(density[highest])]]
            self._climb_from(theta)

    def climb_moved(self, most: int) -> None:
        """Climb from the best mode with one coordinate of the joint moved elsewhere, as long as that leads higher.

        Summits of many springs differ in one or two of them. Of all places no more than so many are climbed from; these
        are no new starts.
        """
        prior, gained = self._posterior.prior, True
        low, high = (np.clip(end, *prior.mean + _WIDE * np.outer((-1, 1), prior.sd)) for end in prior.support)
        while gained and not self.is_spent():
            theta, density = self.best
            moved = np.tile(theta, (len(prior.marginals), len(_PLACES), 1))
            for column, rows in enumerate(moved):
                rows[:, column] = low[column] + np.array(_PLACES) * (high - low)[column]
            moved = moved.reshape(-1, theta.size)
            value = self._posterior(moved)
            best = np.argsort(-value, kind="stable")[:most]
            self._climb_from(moved[best[np.isfinite(value[best])]])
            gained = self.best[1] - density > GAIN

    def _climb_from(self, theta: Array, weights: Sequence[Array] = ()) -> None:
        """Climb from points, shape (n, d), that are no new starts; there may be none."""
        if not len(theta):
            return
        rough = self._climbed(theta, weights)
        density = self._posterior(rough)
        self._refine_distinct([(rough[i], float(density[i])) for i in np.flatnonzero(np.isfinite(density))])

    def _climbed(self, theta: Array, weights: Sequence[Array]) -> Array:
        def tell(done: int, count: int) -> bool:
            self._progress(Progress(SEARCHING, done=done, total=count, unit="starts"))
            return self.is_spent()

        for weight in weights:
            theta, _ = climb_all(PosteriorSquares(self._posterior, weight), theta, _ROUGH_STEPS, tell)
        return climb_all(PosteriorSquares(self._posterior), theta, _ROUGH_STEPS, tell)[0]

    def _refine_distinct(self, ends: Sequence[tuple[Array, float]]) -> list[tuple[Array, float]]:
        """Refine those rough ends that are new and may matter; each gets the end of its mode, or stays as it is.

        A rough end belongs to a known mode if it is where the mode's own was, or no valley lies between them.
        """
        left, refined = _REFINED, list(ends)
        for i in sorted(range(len(ends)), key=lambda i: -ends[i][1]):
            (theta, density), mode = ends[i], None
            for known in self._refined:
                same = bool((np.abs((known.rough - theta) / self._posterior.prior.sd) < _NEAR).all())
                same = same and abs(known.rough_density - density) < _NEARLY
                # from far below the straight line passes other summits, and says nothing
                below = -_SAME_DENSITY < known.log_density - density < _LOWEST
                if same or (below and not _parted(self._posterior, known.theta, theta, density, _FALL)):
                    mode = known
                    break
            # before the noise model's parameters are improved a density says little
            sure = self._posterior.likelihood.hyper_count == 0 and bool(self._refined)
            left = 0 if self._refined and self.is_spent() else left
            if mode is None and left and not (sure and density < self.best[1] - _LOWEST - _UNREFINED):
                mode = _Refined(theta, density, *refine(self._posterior, theta))
                self._refined.append(mode)
                left -= 1
            if mode is not None:
                refined[i] = mode.theta, mode.log_density
        return refined

    def estimate(self) -> MapEstimate:
        """Best mode so far, its covariance, and where each start led.

        Raises
        ------
        ModelError
            If no start led anywhere.
        """
        theta, best = self.best
        prior = self._posterior.prior
        others = prior.nuisance_values(theta).tolist()
        reached, outcomes = self.reached(), []
        for name, stiffness in self._begun.items():
            end, density = self._ends.get(name, (None, -np.inf))
            last = stiffness if end is None else prior.values(end)  # a start that leads nowhere is its own end
            outcomes.append(StartOutcome(name, stiffness, last, density, reached.get(name, False)))
        return MapEstimate(
            theta,
            prior.values(theta),
            laplace_covariance(self._posterior, theta),
            best,
            tuple(outcomes),
            local_modes(self._posterior, [(end.theta, end.log_density) for end in self._refined]),
            units={quantity.name: quantity.unit for quantity in prior.parametrisation.quantities},
            others={n.name: (value, n.unit) for n, value in zip(prior.nuisances, others, strict=True)},
        )


@dataclass(frozen=True, slots=True)
class _Refined:
    """A rough end of a climb with its log density, and the mode it was refined to."""

    rough: Array
    rough_density: float
    theta: Array
    log_density: float


def local_modes(log_posterior: LogPosterior, ends: Sequence[tuple[Array, float]]) -> tuple[LocalMode, ...]:
    """Ends of climbs that are modes of their own, the highest first.

    Two ends belong to one mode where the density along the straight line between them hardly falls below the lower
    one: a flat ridge has many ends and one mode.

    Parameters
    ----------
    log_posterior
        Density that was climbed.
    ends
        Place, shape (d,), and log density of each.
    """
    best = max(density for _, density in ends)
    modes: list[LocalMode] = []
    for theta, density in sorted(ends, key=lambda end: -end[1]):
        if density < best - _LOWEST or len(modes) == _MOST_MODES:
            break
        if all(_parted(log_posterior, mode.theta, theta, density) for mode in modes):
            inside = inside_the_edges(log_posterior, theta)
            modes.append(LocalMode(theta, laplace_covariance(log_posterior, theta), density, inside))
    return tuple(modes)


def _parted(log_posterior: LogPosterior, higher: Array, lower: Array, density: float, valley: float = _VALLEY) -> bool:
    """Whether the density falls by that much between two ends, below the lower one."""
    if (np.abs((higher - lower) / log_posterior.prior.sd) < _SAME_POINT).all():
        return False
    fraction = np.linspace(0, 1, _LINE)[1:-1, None]
    straight = higher + fraction * (lower - higher)
    return bool(log_posterior(straight).min() < density - valley)


def into_support(log_posterior: LogPosterior, stiffness: ArrayLike) -> Array | None:
    """Coordinates of the joint nearest to one of shape (q,) at which the prior is above zero; None if there is none."""
    theta = log_posterior.prior.nearest(stiffness)
    return theta if np.isfinite(log_posterior(theta)[0]) else None


@dataclass(frozen=True, slots=True, eq=False)
class Images:
    """Signed permutations of the coordinates θ, the first of which leaves them as they are.

    Parameters
    ----------
    columns
        For each image the column of θ that each coordinate is taken from, shape (n, d).
    signs
        1, or −1 where a coordinate changes its sign, shape (n, d).
    """

    columns: Indices
    signs: Array

    @classmethod
    def from_problem(cls, problem: Problem) -> "Images":
        """Every exchange of like joints together with every reflection of the structure, and each coupling turned.

        A plane of symmetry exchanges joints and turns the couplings between motions along and across it. Joints are
        like each other where they have the same quantities, see `jointbayes.joint.Parametrisation.exchanges`.
        """
        exchanges = problem.parametrisation.exchanges
        nuisances = np.arange(exchanges.shape[1], len(problem.names))
        columns = np.array([[*exchange, *nuisances] for exchange in exchanges], dtype=np.intp)
        reflections = _reflections(problem)
        turned = 1 - 2 * np.eye(reflections.shape[1])[(reflections < 0).any(axis=0)]
        pairs = [(c, s) for c in columns for s in reflections] + [(columns[0], s) for s in turned]
        whole = np.array([np.concatenate(pair) for pair in pairs])
        _, first = np.unique(whole, axis=0, return_index=True)
        columns, signs = np.split(whole[np.sort(first)], 2, axis=1)
        return cls(columns.astype(np.intp), signs)

    def __call__(self, theta: Array) -> Array:
        """Images of a point θ, shape (d,), shape (n, d)."""
        return self.signs * theta[self.columns]

    @property
    def matrices(self) -> Array:
        """The same as matrices, shape (n, d, d)."""
        return self.signs[:, :, None] * np.eye(self.columns.shape[1])[self.columns]


def _reflections(problem: Problem) -> Array:
    """Sign of each coordinate, shape (n, d), after reflections of all joints across their own planes."""
    joints = [test.joints for test in problem.tests]
    each = [joint for several in joints for joint in (several.joints if isinstance(several, Joints) else (several,))]
    directions = [direction for joint in each for direction in joint.directions]
    # across the plane at right angles to x the motions x, ry and rz change their signs
    mirrors = np.array([[-1.0 if (d[-1:] != a) == is_rotation(d) else 1.0 for d in directions] for a in "xyz"])
    places = {quantity.name: quantity.places for quantity in problem.quantities if quantity.may_be_negative}
    signs = np.ones((8, len(problem.names)))
    for row, crossed in zip(signs, product((False, True), repeat=3), strict=True):
        motion = np.prod(mirrors[list(crossed)], axis=0)
        for column, axis in enumerate(problem.parametrisation.axes):
            if not axis.logarithmic and places.get(axis.quantity):
                first, second = places[axis.quantity][0]
                row[column] = motion[first] * motion[second]
    return signs
