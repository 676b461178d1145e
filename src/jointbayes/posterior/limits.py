"""Joints that fit nearly as well as the best: limits of a quantity by likelihood ratio, and the profile between them.

A credible interval weighs joints by how many of them the prior has; along a ridge that the data leave open that volume
moves its ends. The likelihood ratio asks only whether there is one joint, with all else adjusted, that fits well
enough: no volume counts. Its limits are the ends of the values in {θ: ln L(θ) ≥ ln L_max − fall}, each a maximum under
one constraint. The profile is the greatest ln L with one coordinate held.

References
----------
Neale, M. C., Miller, M. B. (1997). The use of likelihood-based confidence intervals in genetic models. Behavior
Genetics 27(2), 113-120. DOI 10.1023/A:1025681223921
Raue, A. et al. (2009). Structural and practical identifiability analysis of partially observed dynamical models by
exploiting the profile likelihood. Bioinformatics 25(15), 1923-1929. DOI 10.1093/bioinformatics/btp358
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize
from scipy.special import chdtri

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.inference import LogPosterior
from jointbayes.joint import Coordinate

Ends = tuple[float, float]

#: Fall of ln L, half a quantile of χ² with one degree of freedom, to limits at 95 % of two sides and of one side, and
#: to those that are printed.
FALL_TWO_SIDED, FALL_ONE_SIDED, FALL_PRINTED = (float(chdtri(1, p)) / 2 for p in (0.05, 0.10, 0.025))
_LEVEL = 0.95  # confidence of the limits of profiles
#: Step of differences, in standard deviations of the draws.
_STEP = 1e-3
#: By how much ln L may be below the wanted height at an end; above it by more the support ends first.
_SLACK = 0.01
_HIGHER = 1e-4  # standard deviations of a quantity that one unit of ln L is worth: of equal ends the likeliest
_EDGE = 1e-9  # of the support's width: at its very ends ρ is no positive definite joint
_FARTHEST = 40.0  # prior standard deviations from its mean
_FAR_DRAWS = 10  # for each unknown, of which the covariance at an end is worth a try
_WORST = -1e9  # in place of a log likelihood that is not finite
_POINTS = 7  # of a profile from its top to an end
_ITERATIONS, _NEAR = 60, 5.0  # of a climb, and steps of a short one
_AGAIN, _GAIN = 20, 1e-3  # climbs from where another has ended, while they gain so much of a standard deviation
_OF_HEIGHT, _OF_QUANTITY = 1e-6, 1e-8  # gain of ln L, and of a quantity in standard deviations, at which a climb ends
_CLOSE = 20  # draws among which a profile looks for where to climb from


@dataclass(frozen=True, slots=True, eq=False)
class ProfileLikelihood:
    """Greatest likelihood for each value of one coordinate, relative to the greatest of all.

    Parameters
    ----------
    coordinate
        Which.
    value
        Its values in increasing order, shape (n,): ln k, ρ or ln(p/nominal).
    log_ratio
        ln of the profile over its maximum, shape (n,), 0 or less.
    theta
        All coordinates where the maximum is reached, shape (n, d): how the others move along.
    level
        Confidence of the interval.
    interval
        Values between which −2 log ratio stays below the χ²₁ quantile; at an open end, the end of the prior's support.
    open_below, open_above
        Whether the ratio does not fall that far within the prior: there is no lower or upper limit.
    """

    coordinate: Coordinate
    value: Array
    log_ratio: Array
    theta: Array
    level: float
    interval: Ends
    open_below: bool
    open_above: bool

    @property
    def name(self) -> str:
        """Name of the coordinate."""
        return self.coordinate.name

    @property
    def on_axis(self) -> tuple[str, Array, Array]:
        """For a figure: label of the axis, values on it, and the log ratio."""
        return self.coordinate.axis_label, self.value * self.coordinate.axis_scale, self.log_ratio


class LikelihoodRegion:
    """Joints that fit nearly as well as the best.

    The likelihood has the priors of all that is uncertain besides the joint, and those of the joint that are more than
    bounds, such as a normal one: they stand for knowledge from elsewhere. A prior between two bounds counts by these.

    Parameters
    ----------
    log_posterior
        Density of the problem.
    theta
        Modes and draws of θ, shape (n, d); the region is followed from the best of them.
    solution
        Number of the solution that each belongs to, shape (n,), where there are several: each is climbed from, and
        steps are as long as one of them is wide, not as they are apart.
    put
        Values that take the place of those of the joint that θ describes, by place among its quantities. With it, even
        if empty, any prior of the joint counts by its bounds alone.

    Attributes
    ----------
    greatest
        ln L of the best.
    """

    def __init__(
        self,
        log_posterior: LogPosterior,
        theta: Array,
        solution: NDArray[np.intp] | None = None,
        put: Mapping[int, float] | None = None,
    ) -> None:
        prior = log_posterior.prior
        self._log_posterior, self._prior, self._put = log_posterior, prior, put
        names, count = prior.parametrisation.names, len(prior.marginals)
        alone = [i for i in range(count) if put is not None or prior.bounds_of(names[i]) is not None]
        self._weighed = [i for i in range(theta.shape[1]) if i not in alone]
        far, (low, high) = _FARTHEST * prior.sd, prior.support
        low, high = np.maximum(low, prior.mean - far), np.minimum(high, prior.mean + far)
        self._low, self._high = low + _EDGE * (high - low), high - _EDGE * (high - low)
        solution = np.zeros(len(theta), dtype=np.intp) if solution is None else solution
        self._ends: dict[tuple[int, float, float], tuple[Array, Array]] = {}
        away, each = theta.copy(), [np.flatnonzero(solution == number) for number in np.unique(solution)]
        for rows in each:
            away[rows] -= theta[rows].mean(axis=0)
        self._root = _root(away)
        self._draws = np.clip(theta, self._low, self._high)
        self._heights = self._height(self._draws)
        best = self._draws[[rows[np.argmax(self._heights[rows])] for rows in each]]
        self._tops = np.array([self._bettered(start) for start in best])
        heights = self._height(self._tops)
        self._top, self.greatest = self._tops[np.argmax(heights)], float(heights.max())

    def _log_likelihood(self, theta: Array) -> Array:
        """ln L, shape (n,), of θ, shape (n, d)."""
        if self._put is None:
            return self._log_posterior.log_likelihood(theta)
        values = self._prior.values(theta)
        values[:, list(self._put)] = list(self._put.values())
        matrix = self._prior.parametrisation.matrix(values)
        return self._log_posterior.likelihood.log_likelihood(matrix, self._prior.factors(theta))

    def _height(self, theta: Array) -> Array:
        """ln L with the priors that count, shape (n,), of θ, shape (n, d)."""
        with np.errstate(all="ignore"):
            value = self._log_likelihood(theta)
            for i in self._weighed:
                value = value + self._prior.all_marginals[i].log_density(theta[:, i])
        return np.where(np.isfinite(value), value, _WORST)

    def _of(self, index: int, theta: Array) -> Array:
        """A quantity of the joint, or after all of these a coordinate, shape (n,), of θ, shape (n, d)."""
        return np.column_stack([self._prior.values(theta), theta])[:, index]

    def _column(self, coordinate: int) -> int:
        """Place of a coordinate after all quantities."""
        return len(self._prior.parametrisation.quantities) + coordinate

    def limits(self, index: int, fall: float, fall_printed: float) -> tuple[Ends, Ends]:
        """Least and greatest value of a quantity where ln L has fallen from its maximum by no more than so much.

        Parameters
        ----------
        index
            Place of the quantity among those of the joint.
        fall, fall_printed
            The lesser and the greater.

        Returns
        -------
        (low, high), (low, high)
            One pair for each fall, in the quantity's unit. Where the prior's support ends before ln L has fallen so
            far, the first has NaN, and the second the farthest that the support allows.
        """
        name, names = self._prior.parametrisation.stiffness_names[index], self._prior.names
        # where a quantity is a coordinate, its logarithm, that is sought, as for its profile
        near, far = self._points(self._column(names.index(name)) if name in names else index, fall, fall_printed)
        low, high = np.where(self._is_above(near, fall), math.nan, self._of(index, near)).tolist()
        low_printed, high_printed = self._of(index, far).tolist()
        return (low, high), (low_printed, high_printed)

    def profile(self, name: str) -> ProfileLikelihood:
        """Greatest likelihood for each value of a coordinate, as far as to the limits that are printed.

        Raises
        ------
        ModelError
            If there is no such coordinate, or the data do not depend on it.
        """
        parametrisation, names = self._prior.parametrisation, self._prior.names
        if name not in names:
            raise ModelError(
                f"profile: found coordinate {name!r}; expected one of {', '.join(names)}; correct the name"
            )
        at = names.index(name)
        across = np.repeat(self._top[None], 5, axis=0)
        across[:, at] = np.linspace(self._low[at], self._high[at], len(across))
        with np.errstate(all="ignore"):
            if np.ptp(self._log_likelihood(across)) == 0:
                raise ModelError(
                    f"profile: found that no residual depends on {name}; expected a coordinate that the model predicts "
                    "with; profile another one"
                )
        near, far = self._points(self._column(at), FALL_TWO_SIDED, FALL_PRINTED)
        is_open, top, (first, last) = self._is_above(near, FALL_TWO_SIDED), self._top, far[:, at]
        ends = [self._bettered(end, at) for end in far[is_open]]  # whatever fits well enough has led to an open end
        known = np.array([top, *near[~is_open], *far[~is_open], *ends])
        shares = (np.arange(1, _POINTS) / _POINTS) ** 2  # of the way from the top, where the likelihood is round
        between = np.append(top[at] + np.outer(far[:, at] - top[at], shares), self._tops[:, at])
        for value in np.unique(between[(between > first) & (between < last)].round(9)):
            known = np.concatenate([known, self._best_at(at, value, known)])
        known = known[np.unique(known[:, at].round(9), return_index=True)[1]]
        heights = self._height(known)
        low, high = np.where(is_open, (self._low[at], self._high[at]), near[:, at]).tolist()
        coordinate = next((axis for axis in parametrisation.axes if axis.name == name), Coordinate(name, "1", name, ""))
        ratio = heights - heights.max()
        return ProfileLikelihood(coordinate, known[:, at], ratio, known, _LEVEL, (low, high), *is_open.tolist())

    def _best_at(self, at: int, value: float, known: Array) -> Array:
        """θ, shape (1, d), of the best joint with a coordinate at a value, (0, d) if none; from known ones, (n, d)."""
        known = known[known[:, at].argsort()]
        between = [np.interp(value, known[:, at], column) for column in known.T]
        close = self._draws[np.abs(self._draws[:, at] - value).argsort()[:_CLOSE]]
        along = self._root @ self._root[at] / (self._root[at] @ self._root[at])
        starts = np.array([between, *(close + (value - close[:, at, None]) * along)])
        starts = np.clip(starts, self._low, self._high)
        starts = starts[self._prior.feasible(starts)]
        best = starts[self._height(starts).argsort()[-1:]]
        return np.array([self._bettered(start, at) for start in best]).reshape(best.shape)

    def _bettered(self, start: Array, held: int | None = None) -> Array:
        """θ, shape (d,), to which a climb of ln L leads, with a coordinate held; the start where that is no better."""
        root = self._root if held is None else self._root @ linalg.null_space(self._root[held : held + 1])
        end = self._climbed(start, root) if root.size else start
        higher = self._prior.feasible(end) and np.diff(self._height(np.array([start, end])))[0] > 0
        return end if higher else start

    def _points(self, index: int, fall: float, fall_printed: float) -> tuple[Array, Array]:
        """Points θ, shape (2, d), with the least and the greatest value of a quantity at either fall; kept."""
        key = index, fall, fall_printed
        if key not in self._ends:
            near = self._extremes(index, fall, np.array([self._top, self._top]))
            self._ends[key] = near, self._extremes(index, fall_printed, near)
        return self._ends[key]

    def _is_above(self, ends: Array, fall: float) -> NDArray[np.bool_]:
        """Whether ln L has not fallen so far at extremes, shape (n, d)."""
        return self._height(ends) > self.greatest - fall + _SLACK

    def _extremes(self, index: int, fall: float, near: Array) -> Array:
        """Points θ, shape (2, d), with the least and the greatest value, from one near each and the farthest draws."""
        level, spread = self.greatest - fall, float(self._of(index, self._draws).std())
        inside = self._draws[self._heights >= level]
        ends = []
        for sign, first in zip((-1.0, 1.0), near, strict=True):
            farthest = inside[np.argsort(sign * self._of(index, inside))]
            starts = np.array([first, *farthest[-1:]])
            # at the end of a curved ridge the region is far thinner, and elsewhere directed, than all draws are: the
            # draws near it say how it lies, and where there are few the likelihood's own curvature
            few = _FAR_DRAWS * starts.shape[1]
            local = farthest[-max(few, len(farthest) // 20) :]
            by_draws = len(local) >= few
            roots = [_root(local) if by_draws else self._root_at(start) for start in starts]
            climbed = set[bytes]() if by_draws else {start.tobytes() for start in starts}  # by the curvature there
            climbs = [self._climbed(start, root, index, level, sign) for start, root in zip(starts, roots, strict=True)]
            end = self._farthest(np.array([*starts, *climbs]), index, level, sign)
            for _ in range(_AGAIN):
                # a step far along a curved ridge leaves it, and the climb wanders: from where it failed shorter ones
                size = np.inf if end.tobytes() not in climbed else _NEAR
                climbed.add(end.tobytes())
                reached = self._climbed(end, self._root_at(end), index, level, sign, size)
                before, end = end, self._farthest(np.array([end, reached]), index, level, sign)
                if size == _NEAR and abs(np.diff(self._of(index, np.array([before, end])))[0]) <= _GAIN * spread:
                    break
            ends.append(end)
        return np.array(ends)

    def _farthest(self, reached: Array, index: int, level: float, sign: float) -> Array:
        """Of points, shape (n, d), that with the greatest value among those that are high enough."""
        allowed = reached[(self._height(reached) >= level - _SLACK) & self._prior.feasible(reached)]
        farthest: Array = allowed[np.argmax(sign * self._of(index, allowed))]
        return farthest

    def _root_at(self, theta: Array) -> Array:
        """Root of the covariance by the curvature of ln L at a point, no wider anywhere than that of all draws."""
        step = _STEP * self._root
        pairs = np.array([[step.T[i] + step.T, step.T[i] - step.T] for i in range(step.shape[1])])  # (k, 2, k, d)
        margin = 2 * _STEP * self._prior.sd
        around = np.clip(theta + np.concatenate([pairs, -pairs], axis=1), self._low - margin, self._high + margin)
        height = self._height(around.reshape(-1, theta.size)).reshape(around.shape[:-1])
        if height.min() <= _WORST:  # beyond a cone there is no joint
            return self._root
        bent = (height[:, 1] + height[:, 3] - height[:, 0] - height[:, 2]) / (2 * _STEP) ** 2
        values, vectors = np.linalg.eigh((bent + bent.T) / 2)
        return np.asarray(self._root @ vectors / np.sqrt(np.maximum(values, 1.0)))

    def _climbed(
        self,
        start: Array,
        root: Array,
        index: int | None = None,
        level: float = 0.0,
        sign: float = 1.0,
        reach: float = np.inf,
    ) -> Array:
        """θ, shape (d,), of the greatest value of a quantity where ln L is at least `level`; without one of ln L.

        It goes in steps of the columns of `root`, shape (d, k), such as a Cholesky factor of a covariance, no farther
        than `reach` of each.
        """
        size, margin = root.shape[1], 2 * _STEP * self._prior.sd
        steps = np.concatenate([np.zeros((1, size)), _STEP * np.eye(size), -_STEP * np.eye(size)])
        place, spread = index or 0, 1.0
        size_there = float(np.abs(self._of(place, start[None]))[0]) or 1.0

        def measure(theta: Array) -> Array:
            """What is sought; of what may span decades at either sign nearly the logarithm, which is straighter."""
            value = self._of(place, theta)
            return value if place >= self._column(0) else np.arcsinh(value / size_there)

        if index is not None:
            spread = float(measure(self._draws).std()) or 1.0

        @lru_cache(maxsize=4)
        def both(at: bytes) -> tuple[Array, Array]:
            """ln L and what is sought, shape (2,), and their slopes, shape (2, k)."""
            theta = start + (np.frombuffer(at) + steps) @ root.T
            theta = np.clip(theta, self._low - margin, self._high + margin)  # a step may lead to where no model is
            sought = heights = self._height(theta)
            if index is not None:
                sought = sign * measure(theta) / spread + _HIGHER * heights
            pair = np.stack([heights, sought])
            return pair[:, 0], (pair[:, 1 : size + 1] - pair[:, size + 1 :]) / (2 * _STEP)

        sides = np.array([*np.eye(start.size), *(c.normal(start.size) for c in self._prior.parametrisation.cones)])
        edge = -_EDGE - sides[start.size :] @ start
        least, most = np.append(self._low - start, np.full(edge.size, -np.inf)), np.append(self._high - start, edge)
        constraints: list[optimize.LinearConstraint | optimize.NonlinearConstraint]
        constraints = [optimize.LinearConstraint(sides @ root, least, most)]
        bounds = optimize.Bounds(np.full(size, -reach), np.full(size, reach))
        if index is not None:
            height = optimize.NonlinearConstraint(
                lambda u: both(u.tobytes())[0][0], level, np.inf, lambda u: both(u.tobytes())[1][:1]
            )
            constraints.append(height)

        def loss(u: Array) -> float:
            return -float(both(u.tobytes())[0][1])

        def slope(u: Array) -> Array:
            return -both(u.tobytes())[1][1]

        enough = _OF_HEIGHT if index is None else _OF_QUANTITY
        climb = optimize.minimize(
            loss,
            np.zeros(size),
            jac=slope,
            method="SLSQP",
            bounds=bounds,
            constraints=constraints,
            options={"ftol": enough, "maxiter": _ITERATIONS},
        )
        return np.clip(start + root @ climb.x, self._low, self._high)


def _root(theta: Array) -> Array:
    """Cholesky factor of the covariance of points θ, shape (n, d)."""
    covariance = np.atleast_2d(np.cov(theta.T))
    return np.asarray(np.linalg.cholesky(covariance + 1e-10 * np.diag(np.maximum(np.diag(covariance), 1e-12))))
