"""How far a quantity of the joint reaches while the data are fitted nearly as well as by the best joint.

A credible interval weighs joints by how many of them the prior has; along a ridge that the data leave open that volume
moves its ends. The likelihood ratio asks only whether there is one joint, with all else adjusted, that fits well
enough: no volume counts. Its limits are the ends of the values in {θ: ln L(θ) ≥ ln L_max − fall}, each a maximum under
one constraint.

References
----------
Neale, M. C., Miller, M. B. (1997). The use of likelihood-based confidence intervals in genetic models. Behavior
Genetics 27(2), 113-120. DOI 10.1023/A:1025681223921
"""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from jointbayes.arrays import Array
from jointbayes.inference import LogPosterior

Ends = tuple[float, float]

#: Step of differences, in standard deviations of the draws.
_STEP = 1e-3
#: By how much ln L may be below the wanted height at an end; above it by more the support ends first.
_SLACK = 0.01
_HIGHER = 1e-4  # standard deviations of a quantity that one unit of ln L is worth: of equal ends the likeliest
_EDGE = 1e-9  # of the support's width: at its very ends ρ is no positive definite joint
_AT_EDGE = 1e-6  # the same of a point that a climb has led to its edge
_FARTHEST = 40.0  # prior standard deviations from its mean
_FAR_DRAWS = 10  # for each unknown, of which the covariance at an end is worth a try
_WORST = -1e9  # in place of a log likelihood that is not finite


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
        Number of the solution that each belongs to, shape (n,), where there are several: steps are as long as one of
        them is wide, not as they are apart.
    """

    def __init__(self, log_posterior: LogPosterior, theta: Array, solution: NDArray[np.intp] | None = None) -> None:
        prior = log_posterior.prior
        self._log_likelihood, self._prior = log_posterior.log_likelihood, prior
        names, count = prior.parametrisation.names, len(prior.marginals)
        self._weighed = [i for i in range(theta.shape[1]) if i >= count or prior.bounds_of(names[i]) is None]
        far, (low, high) = _FARTHEST * prior.sd, prior.support
        low, high = np.maximum(low, prior.mean - far), np.minimum(high, prior.mean + far)
        self._low, self._high = low + _EDGE * (high - low), high - _EDGE * (high - low)
        away = theta.copy()
        for number in () if solution is None or np.ptp(solution) == 0 else np.unique(solution):
            away[solution == number] -= theta[solution == number].mean(axis=0)
        self._root = _root(away)
        self._draws = np.clip(theta, self._low, self._high)
        self._heights = self._height(self._draws)
        best = self._draws[np.argmax(self._heights)]
        climbed = self._climbed(best)
        higher = bool(prior.feasible(climbed)) and self._height(climbed[None])[0] > self._height(best[None])[0]
        self._top = climbed if higher else best
        self._limits: dict[tuple[int, float, float], tuple[Ends, Ends]] = {}

    def _height(self, theta: Array) -> Array:
        """ln L with the priors that count, shape (n,), of θ, shape (n, d)."""
        with np.errstate(all="ignore"):
            value = self._log_likelihood(theta)
            for i in self._weighed:
                value = value + self._prior.all_marginals[i].log_density(theta[:, i])
        return np.where(np.isfinite(value), value, _WORST)

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
        key = index, fall, fall_printed
        if key not in self._limits:
            near = self._extremes(index, fall, (self._top, self._top))
            if any(self._stopped_short(end, fall) for end in near):
                near = self._extremes(index, fall, near)
            far = self._extremes(index, fall_printed, near)
            is_open = [self._is_above(end, fall) for end in near]
            low, high = np.where(is_open, math.nan, self._prior.values(near)[:, index]).tolist()
            low_printed, high_printed = self._prior.values(far)[:, index].tolist()
            self._limits[key] = (low, high), (low_printed, high_printed)
        return self._limits[key]

    def _is_above(self, end: Array, fall: float) -> bool:
        """Whether ln L has not fallen so far at an extreme, shape (d,)."""
        return bool(self._height(end[None])[0] > self._height(self._top[None])[0] - fall + _SLACK)

    def _stopped_short(self, end: Array, fall: float) -> bool:
        """Whether that is so although the support does not end there: the climb did."""
        edges = [np.abs(end - self._low), np.abs(self._high - end)] / (self._high - self._low)
        cones = [cone.normal(end.size) @ end for cone in self._prior.parametrisation.cones]
        at_edge = edges.min() < _AT_EDGE or max(cones, default=-1.0) > -_AT_EDGE
        return bool(not at_edge and self._is_above(end, fall))

    def _extremes(self, index: int, fall: float, near: tuple[Array, Array]) -> tuple[Array, Array]:
        """Points θ with the least and the greatest value of a quantity, from one near each and the farthest draws."""
        level = float(self._height(self._top[None])[0]) - fall
        inside = self._draws[self._heights >= level]
        ends = []
        for sign, first in zip((-1.0, 1.0), near, strict=True):
            farthest = inside[np.argsort(sign * self._prior.values(inside)[:, index])]
            starts = np.array([first, *farthest[-1:]])
            # at the end of a curved ridge it is far thinner, and elsewhere directed, than all draws are
            local = farthest[-max(_FAR_DRAWS * starts.shape[1], len(farthest) // 20) :]
            roots = [self._root, *([_root(local)] if len(local) >= _FAR_DRAWS * starts.shape[1] else [])]
            climbs = [self._climbed(start, index, level, sign, root) for start in starts for root in roots]
            reached = np.array([*starts, *climbs])
            allowed = reached[(self._height(reached) >= level - _SLACK) & self._prior.feasible(reached)]
            ends.append(allowed[np.argmax(sign * self._prior.values(allowed)[:, index])])
        return ends[0], ends[1]

    def _climbed(
        self, start: Array, index: int | None = None, level: float = 0.0, sign: float = 1.0, root: Array | None = None
    ) -> Array:
        """θ, shape (d,), of the greatest value of a quantity where ln L is at least `level`; without one of ln L.

        It goes in steps of a Cholesky factor of a covariance, shape (d, d); by default of that of all draws.
        """
        root = self._root if root is None else root
        size, margin = start.size, 2 * _STEP * self._prior.sd
        steps = np.concatenate([np.zeros((1, size)), _STEP * np.eye(size), -_STEP * np.eye(size)])
        drawn = np.ones(2) if index is None else self._prior.values(self._draws)[:, index]
        measure = np.log if (drawn > 0).all() else np.asarray  # what of a quantity is sought: its logarithm, or itself
        spread = float(measure(drawn).std()) or 1.0

        @lru_cache(maxsize=4)
        def both(key: bytes) -> tuple[Array, Array]:
            """ln L and what is sought, shape (2,), and their slopes, shape (2, d)."""
            theta = start + (np.frombuffer(key) + steps) @ root.T
            theta = np.clip(theta, self._low - margin, self._high + margin)  # a step may lead to where no model is
            sought = heights = self._height(theta)
            if index is not None:
                sought = sign * measure(self._prior.values(theta)[:, index]) / spread + _HIGHER * heights
            pair = np.stack([heights, sought])
            return pair[:, 0], (pair[:, 1 : size + 1] - pair[:, size + 1 :]) / (2 * _STEP)

        normals = np.array([cone.normal(size) for cone in self._prior.parametrisation.cones]).reshape(-1, size)
        least = np.append(self._low - start, np.full(len(normals), -np.inf))
        most = np.append(self._high - start, -_EDGE - normals @ start)
        constraints: list[optimize.LinearConstraint | optimize.NonlinearConstraint]
        constraints = [optimize.LinearConstraint(np.concatenate([np.eye(size), normals]) @ root, least, most)]
        if index is not None:
            height = optimize.NonlinearConstraint(
                lambda u: both(u.tobytes())[0][0], level, np.inf, lambda u: both(u.tobytes())[1][:1]
            )
            constraints.append(height)

        def loss(u: Array) -> float:
            return -float(both(u.tobytes())[0][1])

        def slope(u: Array) -> Array:
            return -both(u.tobytes())[1][1]

        climb = optimize.minimize(
            loss, np.zeros(size), jac=slope, method="SLSQP", constraints=constraints, options={"ftol": 1e-8}
        )
        return np.clip(start + root @ climb.x, self._low, self._high)


def _root(theta: Array) -> Array:
    """Cholesky factor of the covariance of points θ, shape (n, d)."""
    covariance = np.atleast_2d(np.cov(theta.T))
    return np.asarray(np.linalg.cholesky(covariance + 1e-10 * np.diag(np.maximum(np.diag(covariance), 1e-12))))
