"""Climb from one point to the nearest mode, to the last digit, and its Laplace covariance."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import JointBayesError, ModelError
from jointbayes.inference import JointPrior, LogPosterior
from jointbayes.inference.climb import PosteriorSquares, climb_all, reach
from jointbayes.joint import CondensedCoordinates
from jointbayes.sampling.density import newton_climb
from vibrecords.arrays import Array, Flags, Indices

_STEPS = 200  # of a climb
#: Edges of the support are looked for so often, and a climb along them that gains less has arrived.
_EDGES, _SETTLED = 5, 1e-6
#: Steps inwards from an edge, in prior standard deviations, of which the largest is taken that costs no more than this.
_INWARDS, _COST = (0.5, 0.2, 0.05, 0.01), 1.0
_ALONG = 60  # steps of a climb along an edge
_AT_THE_EDGE = 1e-3  # prior standard deviations: a climb along a ridge may end so far from the edge that it leads to


def refine(log_posterior: LogPosterior, theta: ArrayLike) -> tuple[Array, float]:
    """Climb from θ, shape (d,), to the nearest mode: by damped least squares, exact in the joint's coordinates.

    With a noise model that is not Gaussian of known size its parameters are improved first, and the end is polished by
    Newton's method on the density itself.

    Returns
    -------
    theta, log_density : ndarray of shape (d,), float

    Raises
    ------
    ModelError
        If the start lies outside the prior's support.
    """
    start = np.asarray(theta, dtype=float)
    if not np.isfinite(log_posterior(start)[0]):
        raise ModelError.of("MAP", (), f"found a start at {start.tolist()}", "a point where the prior is above zero")
    prior, of_noise = log_posterior.prior, np.arange(start.size) >= start.size - log_posterior.likelihood.hyper_count
    squares = PosteriorSquares(log_posterior, exact=True)
    if log_posterior.gaussian:
        value = -np.inf
        for _ in range(_EDGES):  # far from data that no joint explains, steps of least squares are short
            before, ((start,), (value,)) = value, climb_all(squares, start[None], _STEPS, fine=True)
            if value - before < _SETTLED:
                break
        return start, float(value)
    if of_noise.any():
        start, _ = _Coordinates.from_point(start, of_noise, prior).climb(log_posterior, np.diag(prior.sd**2))
    (end,), _ = climb_all(squares, start[None], _STEPS, fine=True)
    # Newton's method on the density itself, along the edges of the support where these hold the point
    low, high = prior.support
    height = float(log_posterior(end)[0])
    for _ in range(_EDGES):
        inwards = np.where(end <= low, 1.0, -1.0) * 1e-5 * np.minimum(prior.sd, 1.0)
        gains = np.asarray(log_posterior(end + np.diag(inwards)) > height)
        edge = ((end <= low) | (end >= high)) & ~gains
        coordinates = _Coordinates.from_point(end, ~edge, prior)
        before, (end, height) = height, coordinates.climb(log_posterior, laplace_covariance(log_posterior, end))
        if height - before < _SETTLED:
            break
    return end, height


def refine_where_possible(log_posterior: LogPosterior, theta: Array) -> tuple[Array, float]:
    """Place and height of the mode next to a draw θ, shape (d,); of the draw itself where the climb fails.

    Draws that took long must not be lost to it: the mode is then apart from the MAP, and there is no verdict.
    """
    try:
        return refine(log_posterior, theta)
    except (JointBayesError, ArithmeticError, ValueError, np.linalg.LinAlgError):
        return theta.copy(), float(log_posterior(theta)[0])


@dataclass(frozen=True, slots=True, eq=False)
class _Coordinates:
    """Coordinates φ of those that are free of θ, in which a joint with hardly known stiffnesses has a straight ridge.

    Where the parametrisation has such coordinates, but for those of which an edge holds the one that they replace.
    """

    place: Array
    free: Indices
    ridges: tuple[CondensedCoordinates, ...]
    low: Array
    high: Array

    @classmethod
    def from_point(cls, theta: Array, free: Flags, prior: JointPrior) -> Self:
        """About a point θ, shape (d,)."""
        ridges = tuple(ridge for ridge in prior.parametrisation.ridges if free[ridge.column])
        place = _straightened(ridges, theta[None])[0]
        return cls(place, np.flatnonzero(free), ridges, *reach(prior))

    def theta(self, moving: Array) -> Array:
        """θ, shape (n, d), of the free coordinates, shape (n, f); beyond an edge of the support the edge."""
        whole = np.tile(self.place, (len(moving), 1))
        whole[:, self.free] = moving
        return np.clip(self._bent(whole), self.low, self.high)

    def _bent(self, whole: Array) -> Array:
        """θ, shape (n, d), of φ, shape (n, d)."""
        for ridge in self.ridges:
            whole, _ = ridge.inverse(whole)
        return whole

    def climb(self, log_posterior: LogPosterior, covariance: Array) -> tuple[Array, float]:
        """End θ, shape (d,), and height of Newton's method in the free coordinates, from a covariance of θ."""
        slope = np.eye(len(covariance))
        if self.ridges:  # ∂φ/∂θ by differences
            step = 1e-6 * slope
            theta = self._bent(self.place[None])
            up, down = (_straightened(self.ridges, theta + sign * step) for sign in (1, -1))
            slope = ((up - down) / 2e-6).T
        moved = (slope @ covariance @ slope.T)[np.ix_(self.free, self.free)]
        start = self.place[self.free]
        end, value, _ = newton_climb(lambda moving: log_posterior(self.theta(moving)), start, moved)
        return self.theta(end[None])[0], value


def _straightened(ridges: tuple[CondensedCoordinates, ...], theta: Array) -> Array:
    """φ, shape (n, d), of θ, shape (n, d)."""
    phi = np.array(theta)
    for ridge in ridges:
        phi = ridge.forward(phi)
    return phi


def inside_the_edges(log_posterior: LogPosterior, mode: Array) -> tuple[Array, Array] | None:
    """A point inside the support near a mode, shape (d,), that lies on edges of it, and the Laplace covariance there.

    At an edge the curvature says nothing of the width of a posterior that a ridge leads up to. The point lies on that
    ridge: the other coordinates are at their best. None for a mode inside, and where no such point is nearly as high.
    """
    prior = log_posterior.prior
    low, high = prior.support
    near = _AT_THE_EDGE * prior.sd
    edge = (mode <= low + near) | (mode >= high - near)
    if not edge.any():
        return None
    best = float(log_posterior(mode)[0])
    towards = np.where(mode <= low + near, 1.0, -1.0) * edge * prior.sd
    for share in _INWARDS:
        coordinates = _Coordinates.from_point(mode, ~edge, prior)
        coordinates.place[edge] += share * towards[edge]
        theta = coordinates.theta(coordinates.place[None, coordinates.free])[0]
        if not np.isfinite(log_posterior(theta)[0]):
            continue
        squares = PosteriorSquares(log_posterior, columns=coordinates.free)
        if squares.linearised is not None:  # differences of a density of many unknowns take minutes
            (theta,), (value,) = climb_all(squares, theta[None], _ALONG)
        else:
            theta, value = coordinates.climb(log_posterior, laplace_covariance(log_posterior, theta))
        if value > best - _COST:
            return theta, laplace_covariance(log_posterior, theta)
    return None


def laplace_covariance(log_posterior: LogPosterior, theta: Array) -> Array:
    """Inverse of −∇∇ ln p at a mode, shape (d, d).

    The Hessian is a central difference of the exact gradient. Directions in which it is flatter than the prior
    (a mode at the edge of its support, data that do not see a combination) get the prior's width.
    """
    prior = log_posterior.prior
    sd = prior.sd
    _, jacobian = log_posterior.residuals(theta)
    scaled = jacobian * sd
    step = 1e-3 * sd / np.sqrt(np.maximum((scaled**2).sum(axis=0), 1.0))
    hessian = np.zeros((theta.size, theta.size))
    ups, downs = (prior.moved(theta, np.diag(sign * step)) for sign in (1, -1))
    apart = np.diag(ups - downs)
    (has_room,) = np.nonzero(apart > 0)
    above, below = np.split(log_posterior.gradient(np.concatenate([ups[has_room], downs[has_room]])), 2)
    hessian[has_room] = -(above - below) / apart[has_room, None]
    values, vectors = np.linalg.eigh((hessian + hessian.T) / 2 * np.outer(sd, sd))
    return (vectors / np.maximum(values, 1.0)) @ vectors.T * np.outer(sd, sd)
