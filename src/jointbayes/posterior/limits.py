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
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg
from scipy.special import chdtri

from jointbayes.errors import ModelError
from jointbayes.inference import LogPosterior
from jointbayes.inference.climb import EDGE, NOWHERE, Climb, LimitClimb, climb_together, reach
from jointbayes.joint import Coordinate
from jointbayes.stored_values import StoredArray
from vibrecords.arrays import Array

Ends = tuple[float, float]

#: Fall of ln L to its limits, half a quantile of χ² with one degree of freedom: 95 % between both limits, which is
#: 97.5 % on one side of either; and to the ends of a profile, a little beyond.
FALL, _FALL_OF_PROFILE = (float(chdtri(1, p)) / 2 for p in (0.05, 0.025))
_LEVEL = 0.95  # confidence of the limits of profiles
_SLACK = 0.01  # by how much ln L may be below the wanted height at an end
_OPEN = 0.05  # above it by more the support ends first: a climb ends within 0.001 in ln k, where ln L may be steep
_MISSED = 1e-4  # the same at a point on the way there
_POINTS = 7  # of a profile from its top to an end
_ITERATIONS = 60  # of a climb
_AGAIN = 20  # climbs from where another has ended
_GAIN, _PART = 1e-3, 1e-4  # while they gain so much of a standard deviation, or so large a part of the value
_OF_HEIGHT, _OF_QUANTITY = 1e-6, 1e-5  # gain of ln L, and of a quantity in standard deviations, at which a climb ends
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
    value: StoredArray
    log_ratio: StoredArray
    theta: StoredArray
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

    Attributes
    ----------
    greatest
        ln L of the best.
    """

    def __init__(self, log_posterior: LogPosterior, theta: Array, solution: NDArray[np.intp] | None = None) -> None:
        prior = log_posterior.prior
        self._log_posterior, self._prior = log_posterior, prior
        names, count = prior.parametrisation.names, len(prior.marginals)
        alone = [i for i in range(count) if prior.bounds_of(names[i]) is not None]
        self._weighed = [i for i in range(theta.shape[1]) if i not in alone]
        self._low, self._high = reach(prior, EDGE)
        solution = np.zeros(len(theta), dtype=np.intp) if solution is None else solution
        self._ends: dict[tuple[int, float], Array] = {}
        away, each = theta.copy(), [np.flatnonzero(solution == number) for number in np.unique(solution)]
        for rows in each:
            away[rows] -= theta[rows].mean(axis=0)
        self._root = _root(away)
        self._draws = np.clip(theta, self._low, self._high)
        self._heights = self._height(self._draws)
        best = self._draws[[rows[np.argmax(self._heights[rows])] for rows in each]]
        self._tops = np.array(climb_together(self._height, [self._better(start, self._root) for start in best]))
        heights = self._height(self._tops)
        self._top, self.greatest = self._tops[np.argmax(heights)], float(heights.max())

    def _height(self, theta: Array) -> Array:
        """ln L with the priors that count, shape (n,), of θ, shape (n, d)."""
        with np.errstate(all="ignore"):
            value = self._log_posterior.log_likelihood(theta)
            for i in self._weighed:
                value = value + self._prior.all_marginals[i].log_density(theta[:, i])
        return np.where(np.isfinite(value), value, NOWHERE)

    def _of(self, index: int, theta: Array) -> Array:
        """A quantity of the joint, or after all of these a coordinate, shape (n,), of θ, shape (n, d)."""
        return np.column_stack([self._prior.values(theta), theta])[:, index]

    def _column(self, coordinate: int) -> int:
        """Place of a coordinate after all quantities."""
        return len(self._prior.parametrisation.quantities) + coordinate

    def limits(self, index: int) -> Ends:
        """Least and greatest value of a quantity where ln L has fallen from its maximum by no more than `FALL`.

        Parameters
        ----------
        index
            Place of the quantity among those of the joint.

        Returns
        -------
        (low, high)
            In the quantity's unit; NaN where the prior's support ends before ln L has fallen so far.
        """
        name, names = self._prior.parametrisation.stiffness_names[index], self._prior.names
        # where a quantity is a coordinate, its logarithm, that is sought, as for its profile
        ends = self._points(self._column(names.index(name)) if name in names else index, FALL)
        low, high = np.where(self._is_above(ends, FALL), math.nan, self._of(index, ends)).tolist()
        return low, high

    def profile(self, name: str) -> ProfileLikelihood:
        """Greatest likelihood for each value of a coordinate, to a little beyond its limits.

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
            if np.ptp(self._log_posterior.log_likelihood(across)) == 0:
                raise ModelError(
                    f"profile: found that no residual depends on {name}; expected a coordinate that the model predicts "
                    "with; profile another one"
                )
        near, far = (self._points(self._column(at), fall) for fall in (FALL, _FALL_OF_PROFILE))
        is_open, top, (first, last) = self._is_above(near, FALL), self._top, far[:, at]
        root = self._root_across(at)
        # everything that fits well enough has led to an open end
        ends = climb_together(self._height, [self._better(end, root) for end in far[is_open]])
        known = np.array([top, *near[~is_open], *far[~is_open], *ends])
        shares = (np.arange(1, _POINTS) / _POINTS) ** 2  # of the way from the top, where the likelihood is round
        between = np.append(top[at] + np.outer(far[:, at] - top[at], shares), self._tops[:, at])
        values = np.unique(between[(between > first) & (between < last)].round(9))
        sides = (values[values <= top[at]], values[values > top[at]])
        known = np.concatenate(climb_together(self._height, [self._along(at, side, known) for side in sides]))
        known = known[np.unique(known[:, at].round(9), return_index=True)[1]]
        heights = self._height(known)
        low, high = np.where(is_open, (self._low[at], self._high[at]), near[:, at]).tolist()
        coordinate = next((axis for axis in parametrisation.axes if axis.name == name), Coordinate(name, "1", name, ""))
        ratio = heights - heights.max()
        return ProfileLikelihood(coordinate, known[:, at], ratio, known, _LEVEL, (low, high), *is_open.tolist())

    def _along(self, at: int, values: Array, known: Array) -> Climb:
        """Known points θ, shape (n, d), with the best joint at each value of a coordinate, one after the other."""
        along, root = self._root @ self._root[at] / (self._root[at] @ self._root[at]), self._root_across(at)
        for value in values:
            ordered = known[known[:, at].argsort()]
            between = [np.interp(value, ordered[:, at], column) for column in ordered.T]
            close = self._draws[np.abs(self._draws[:, at] - value).argsort()[:_CLOSE]]
            starts = np.clip([between, *(close + (value - close[:, at, None]) * along)], self._low, self._high)
            starts = starts[self._prior.feasible(starts)]
            if len(starts):
                best = starts[np.argmax((yield starts))]
                known = np.array([*known, (yield from self._better(best, root))])
        return known

    def _root_across(self, held: int) -> Array:
        """Columns along which all but one coordinate move, shape (d, d − 1)."""
        return self._root @ linalg.null_space(self._root[held : held + 1])

    def _better(self, start: Array, root: Array) -> Climb:
        """θ, shape (d,), to which a climb of ln L along columns of `root` leads; the start where that is no better."""
        if not root.size:
            return start
        end = yield from self._climb(start, root)
        heights = yield np.array([start, end])
        return end if self._prior.feasible(end) and heights[1] > heights[0] else start

    def _points(self, index: int, fall: float) -> Array:
        """Points θ, shape (2, d), with the least and the greatest value of a quantity at a fall; kept."""
        if (index, fall) not in self._ends:
            lesser = [known for known in self._ends if known[0] == index and known[1] < fall]
            near = self._ends[max(lesser)] if lesser else np.array([self._top, self._top])
            # climb from one near each, and from the farthest draws
            level = self.greatest - fall
            inside = self._draws[self._heights >= level]
            drawn = self._of(index, inside)
            climbs = [
                self._extreme(np.array([first, *inside[np.argsort(sign * drawn)][-1:]]), index, level, sign)
                for sign, first in zip((-1.0, 1.0), near, strict=True)
            ]
            self._ends[index, fall] = np.array(climb_together(self._height, climbs))
        return self._ends[index, fall]

    def _is_above(self, ends: Array, fall: float) -> NDArray[np.bool_]:
        """Whether ln L has not fallen so far at extremes, shape (n, d)."""
        return self._height(ends) > self.greatest - fall + _OPEN

    def _extreme(self, starts: Array, index: int, level: float, sign: float) -> Climb:
        """Climb from each start, and on from the farthest end until that leads nowhere."""
        spread, value, reached = float(self._of(index, self._draws).std()), math.nan, [*starts]
        for start in starts:
            reached.append((yield from self._climb(start, self._root, index, level, sign)))
        points = np.array(reached)
        end = self._farthest(points, (yield points), index, level, sign)
        for _ in range(_AGAIN):
            points = np.array([end, (yield from self._climb(end, self._root, index, level, sign))])
            end = self._farthest(points, (yield points), index, level, sign)
            before, value = value, float(self._of(index, end[None])[0])
            if abs(value - before) <= min(_GAIN * spread, _PART * abs(value)):  # it may span decades
                break
        return end

    def _farthest(self, reached: Array, heights: Array, index: int, level: float, sign: float) -> Array:
        """Of points, shape (n, d), that with the greatest value among those that are high enough."""
        allowed = reached[(heights >= level - _SLACK) & self._prior.feasible(reached)]
        farthest: Array = allowed[np.argmax(sign * self._of(index, allowed))]
        return farthest

    def _climb(
        self, start: Array, root: Array, index: int | None = None, level: float = -math.inf, sign: float = 1.0
    ) -> Climb:
        """θ, shape (d,), of the greatest value of a quantity where ln L is at least `level`; without one of ln L.

        It begins in steps of the columns of `root`, shape (d, k), such as a Cholesky factor of a covariance.
        """
        size_there = 1.0 if index is None else float(np.abs(self._of(index, start[None]))[0]) or 1.0

        def measure(theta: Array) -> Array:
            """What is sought; of what may span decades at either sign nearly the logarithm, which is straighter."""
            value = self._of(index or 0, theta)
            return value if (index or 0) >= self._column(0) else np.arcsinh(value / size_there)

        spread = sign * (float(measure(self._draws).std()) or 1.0)
        climb = LimitClimb(self._prior, None if index is None else lambda theta: measure(theta) / spread)
        gain = _OF_HEIGHT if index is None else _OF_QUANTITY
        return climb.end(start, root, level, steps=_ITERATIONS, gain=gain, slack=_MISSED)


def _root(theta: Array) -> Array:
    """Cholesky factor of the covariance of points θ, shape (n, d)."""
    covariance = np.atleast_2d(np.cov(theta.T))
    return np.asarray(np.linalg.cholesky(covariance + 1e-10 * np.diag(np.maximum(np.diag(covariance), 1e-12))))
