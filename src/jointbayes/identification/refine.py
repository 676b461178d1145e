"""Climb from one point to the nearest mode, to the last digit, and its Laplace covariance."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike
from scipy import optimize

from jointbayes.errors import JointBayesError, ModelError
from jointbayes.identification.least_squares import PosteriorSquares, climb_all
from jointbayes.inference import JointPrior, LogPosterior
from jointbayes.joint import CondensedCoordinates
from jointbayes.sampling.density import newton_climb
from vibrecords.arrays import Array, Flags, Indices

#: So often the noise model's parameters and all others are improved in turn.
_TURNS = 3
#: Relative tolerance of a climb that is the last word, and of one that a climb on the density itself follows.
_EXACT, _ROUGH = 1e-12, 1e-5
#: Edges of the support are looked for so often, and a climb along them that gains less has arrived.
_EDGES, _SETTLED = 5, 1e-6
#: Steps inwards from an edge, in prior standard deviations, of which the largest is taken that costs no more than this.
_INWARDS, _COST = (0.5, 0.2, 0.05, 0.01), 1.0
_ALONG = 60  # steps of a climb along an edge
_AT_THE_EDGE = 1e-3  # prior standard deviations: a climb along a ridge may end so far from the edge that it leads to
_FARTHEST = 40.0  # prior standard deviations from its mean
_LONG, _AT_ONCE = 100_000, 65_536  # residuals that are condensed before they are solved, and of these so many at a time


def refine(log_posterior: LogPosterior, theta: ArrayLike) -> tuple[Array, float]:
    """Climb from θ, shape (d,), to the nearest mode: trust-region least squares, exact in the joint's coordinates.

    With a noise model that is not Gaussian of known size its parameters and all others are improved in turn, and the
    end is polished by Newton's method on the density itself.

    Returns
    -------
    theta, log_density : ndarray of shape (d,), float

    Raises
    ------
    ModelError
        If the start lies outside the prior's support.

    References
    ----------
    Branch, M. A., Coleman, T. F., Li, Y. (1999). SIAM Journal on Scientific Computing 21(1), 1-23.
    DOI 10.1137/S1064827595289108
    """
    start = np.asarray(theta, dtype=float)
    if not np.isfinite(log_posterior(start)[0]):
        raise ModelError(f"MAP: found a start at {start.tolist()}; expected a point where the prior is above zero")
    likelihood = log_posterior.likelihood
    if log_posterior.gaussian:
        mode = _least_squares(log_posterior, start, _EXACT)
        return mode, float(log_posterior(mode)[0])
    for _ in range(_TURNS if likelihood.hyper_count else 1):
        start = _noise_improved(log_posterior, start)
        end = _least_squares(log_posterior, start, _ROUGH)
        # what is best for the squares need not be better for the density
        start = end if log_posterior(end)[0] > log_posterior(start)[0] else start
    return _polished(log_posterior, start)


def refine_where_possible(log_posterior: LogPosterior, theta: Array) -> tuple[Array, float]:
    """Place and height of the mode next to a draw θ, shape (d,); of the draw itself where the climb fails.

    Draws that took long must not be lost to it: the mode is then apart from the MAP, and there is no verdict.
    """
    try:
        return refine(log_posterior, theta)
    except (JointBayesError, ArithmeticError, ValueError, np.linalg.LinAlgError):
        return theta.copy(), float(log_posterior(theta)[0])


def _polished(log_posterior: LogPosterior, theta: Array) -> tuple[Array, float]:
    """End of Newton's method on the density itself, along the edges of the support where these hold it."""
    prior = log_posterior.prior
    low, high = prior.support
    value = float(log_posterior(theta)[0])
    for _ in range(_EDGES):
        inwards = np.where(theta <= low, 1.0, -1.0) * 1e-5 * np.minimum(prior.sd, 1.0)
        gains = np.asarray(log_posterior(theta + np.diag(inwards)) > value)
        edge = ((theta <= low) | (theta >= high)) & ~gains
        coordinates = _Coordinates.from_point(theta, ~edge, prior)
        covariance = coordinates.covariance(laplace_covariance(log_posterior, theta))
        start = coordinates.place[coordinates.free]
        moving, density, _ = newton_climb(coordinates.density(log_posterior), start, covariance)
        gain = density - value
        if gain > 0:
            theta, value = coordinates.theta(moving[None])[0], density
        if gain < _SETTLED:
            break
    return theta, value


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
        # a normal prior has no end, but a stiffness of e^800 is no number
        low, high = (prior.mean + sign * _FARTHEST * prior.sd for sign in (-1, 1))
        ends = np.maximum(low, prior.support[0]), np.minimum(high, prior.support[1])
        return cls(place, np.flatnonzero(free), ridges, *ends)

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

    def density(self, log_posterior: LogPosterior) -> Callable[[Array], Array]:
        """Log density as a function of the free coordinates, (n, f) to (n,)."""
        return lambda moving: log_posterior(self.theta(moving))

    def covariance(self, covariance: Array) -> Array:
        """Covariance of the free coordinates, shape (f, f), from that of θ, shape (d, d)."""
        slope = np.eye(len(covariance))
        if self.ridges:  # ∂φ/∂θ by differences
            step = 1e-6 * slope
            theta = self._bent(self.place[None])
            up, down = (_straightened(self.ridges, theta + sign * step) for sign in (1, -1))
            slope = ((up - down) / 2e-6).T
        return (slope @ covariance @ slope.T)[np.ix_(self.free, self.free)]


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
        free = coordinates.place[coordinates.free]
        theta = coordinates.theta(free[None])[0]
        if not np.isfinite(log_posterior(theta)[0]):
            continue
        squares = PosteriorSquares(log_posterior, columns=coordinates.free)
        if squares.linearised is not None:  # differences of a density of many unknowns take minutes
            (theta,), (value,) = climb_all(squares, theta[None], _ALONG)
        else:
            covariance = coordinates.covariance(laplace_covariance(log_posterior, theta))
            free, value, _ = newton_climb(coordinates.density(log_posterior), free, covariance)
            theta = coordinates.theta(free[None])[0]
        if value > best - _COST:
            return theta, laplace_covariance(log_posterior, theta)
    return None


def _noise_improved(log_posterior: LogPosterior, theta: Array) -> Array:
    """Best parameters of the noise model, the last coordinates of θ, for the others as they are."""
    count = log_posterior.likelihood.hyper_count
    if count == 0:
        return theta
    low, high = (end[-count:] for end in log_posterior.prior.support)
    margin = 1e-6 * (high - low)

    def loss(tail: Array) -> float:
        value = -float(log_posterior(np.concatenate([theta[:-count], tail]))[0])
        return value if np.isfinite(value) else np.finfo(float).max

    best = optimize.minimize(
        loss,
        np.clip(theta[-count:], low + margin, high - margin),
        method="Nelder-Mead",
        bounds=list(zip(low + margin, high - margin, strict=True)),
        options={"xatol": 1e-3, "fatol": 1e-3},
    )
    return np.concatenate([theta[:-count], best.x])


def _least_squares(log_posterior: LogPosterior, start: Array, tolerance: float) -> Array:
    """End of a climb on the residuals to a relative tolerance, the parameters of the noise model held as they are."""
    moving = start.size - log_posterior.likelihood.hyper_count
    if moving == 0:  # a rigid joint and a structure that is exactly known
        return start
    low, high = (end[:moving] for end in log_posterior.prior.support)
    feasible = log_posterior.prior.parametrisation.feasible
    tail, joint = start[moving:], log_posterior.prior.joint

    # the solver asks for residual and Jacobian of one point in turn: they come from one evaluation
    last: dict[bytes, tuple[Array, Array]] = {}

    def both(t: Array) -> tuple[Array, Array]:
        key = t.tobytes()
        if key not in last:
            last.clear()
            residual, jacobian = log_posterior.residuals(np.concatenate([t, tail]))
            last[key] = condensed(residual, jacobian[:, :moving])
        return last[key]

    size = both(start[:moving])[0].size

    def residual(t: Array) -> Array:
        # an infinite residual makes the solver shorten its step: the solver knows bounds, but not a cone
        return both(t)[0] if feasible(joint(t)) else np.full(size, np.inf)

    def jacobian(t: Array) -> Array:
        return both(t)[1]

    margin = 1e-9 * (high - low)
    margin[~np.isfinite(margin)] = 0.0
    end = optimize.least_squares(
        residual,
        np.clip(start[:moving], low + margin, high - margin),
        jac=jacobian,
        bounds=(low, high),
        x_scale=log_posterior.prior.sd[:moving],
        xtol=tolerance,
        ftol=max(0.01 * tolerance, 1e-14),
        gtol=tolerance,
        max_nfev=200,
    )
    return np.concatenate([end.x, tail])


def condensed(residual: Array, jacobian: Array) -> tuple[Array, Array]:
    """Many residuals e, shape (m,), and their Jacobian J, shape (m, d), as d + 1 rows with the same eᵀe, Jᵀe and JᵀJ.

    To a solver of least squares they are the same, and take no memory there. Few stay as they are.

    References
    ----------
    Demmel, J. et al. (2012). Communication-optimal parallel and sequential QR and LU factorizations. SIAM Journal on
    Scientific Computing 34(1), A206-A239. DOI 10.1137/080731992
    """
    if residual.size < _LONG:
        return residual, jacobian
    rows = np.empty((0, jacobian.shape[1] + 1))
    for first in range(0, residual.size, _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        further = np.column_stack([jacobian[part], residual[part]])
        rows = np.asarray(np.linalg.qr(np.concatenate([rows, further]), mode="r"))
    return rows[:, -1], rows[:, :-1]


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
