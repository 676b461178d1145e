"""Climb a log density from many starts at once: damped least squares on batches, with some coordinates fixed.

What climbs by itself has no residuals, or is no climb of a density: a quantity to its limits
(`jointbayes.posterior.limit_climb`), and values alone, below this room (`jointbayes.sampling.density.newton_climb`).
`tests/inference/test_climb.py` compares ends with those of scipy: in a box, along bent ridges, with fixed coordinates.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from jointbayes.inference.log_posterior import LogPosterior
from jointbayes.inference.prior import JointPrior
from vibrecords.arrays import Array, Indices

#: Joints of so many coordinates and more are found in other ways, and climb by exact derivatives.
MANY_UNKNOWNS = 5
_STEP = 1e-6  # of differences, in prior standard deviations
_AT_ONCE = 1_000_000  # residuals held in memory together
_POINTS_AT_ONCE = 16  # points whose residuals over all lines are held in memory, or fewer
_FARTHEST = 0.7  # of one step in any coordinate, in prior standard deviations
_FACTORS = np.array([1e-2, 0.1, 1.0, 10.0, 100.0, 1e4])  # on the damping: all are tried at once, the best is kept
_FINE_FACTORS = np.array([0.0, 0.3, 1.0, 3.0, 30.0, 1e3])  # of a fine climb, whose last step is not damped
_LEAST, _MOST = 1e-10, 1e10  # damping relative to the curvature; beyond, no step is left that gains
_FINE_LEAST = 1e-3
_GAIN = 1e-3  # in log density: a start whose next step promises less has arrived
_ROUNDING = 1e-13  # of the log density: a fine climb's step that promises less is made without a look
_PATIENCE = 10  # steps before a start is given up that would not catch up at its pace


class Squares(Protocol):
    """A density that is −½ Σ e² of residuals e, times a prior."""

    prior: JointPrior
    columns: Indices
    """Coordinates that a climb moves; the others stay."""

    @property
    def linearised(self) -> Callable[[Array], tuple[Array, Array]] | None:
        """Residuals, shape (m,), in any order, and their derivative by the moving columns, (m, c), at one θ (d,).

        None where differences cost no more.
        """

    def residuals(self, theta: Array) -> Array:
        """Residuals e, shape (n, m), without those of the prior, of points inside the support, shape (n, d)."""

    def value(self, theta: Array) -> Array:
        """Log density up to a constant, shape (n,), of points, shape (n, d); −inf outside the support."""


def climb_all(
    squares: Squares,
    starts: Array,
    steps: int,
    tell: Callable[[int, int], bool] = lambda _done, _all: False,
    *,
    fine: bool = False,
) -> tuple[Array, Array]:
    """Climb from each start until its next step promises no more than a thousandth in log density.

    A start that at its present pace would not come up with the best within the steps left is given up.

    Parameters
    ----------
    squares
        What to climb.
    starts
        Points inside the prior's support, shape (n, d).
    steps
        No more steps than these.
    tell
        Called before each step with the number of starts that have arrived, and of all; True ends the climb.
    fine
        Whether to climb until the slope ends: steps are damped by the widths of the prior, which follows bent ridges,
        and one that promises less than rounding shows of the density is made without a look, undamped, as the last.

    Returns
    -------
    theta, value : ndarray, shapes (n, d) and (n,)
        Where each start ended, and the log density there up to the constant of `squares`.

    References
    ----------
    Marquardt, D. W. (1963). An algorithm for least-squares estimation of nonlinear parameters. Journal of the Society
    for Industrial and Applied Mathematics 11(2), 431-441. DOI 10.1137/0111030
    """
    theta, value = np.array(starts, dtype=float), squares.value(np.asarray(starts, dtype=float))
    damping = np.full(len(theta), 0.1)
    climbing = np.isfinite(value) & (squares.columns.size > 0)
    for step in range(steps):
        chosen = np.flatnonzero(climbing)
        if not chosen.size:
            break
        if tell(len(theta) - chosen.size, len(theta)):
            break
        moves, promised = _moves(squares, theta[chosen], damping[chosen], fine)
        low, high = squares.prior.support
        trials = np.clip(theta[chosen, None] + moves, low, high)
        values = squares.value(trials.reshape(-1, theta.shape[1])).reshape(trials.shape[:2])
        unseen = fine & (promised < _ROUNDING * (1 + np.abs(value[chosen]))) & (values[:, 0] > value[chosen] - _GAIN)
        best = np.where(unseen, 0, np.argmax(values, axis=1))
        row = np.arange(chosen.size)
        risen = values[row, best] - value[chosen]
        better = (risen > 0) | unseen
        theta[chosen[better]] = trials[row, best][better]
        value[chosen[better]] = values[row, best][better]
        damping[chosen] *= np.where(better, (_FINE_FACTORS if fine else _FACTORS)[best], 1e5)
        np.maximum(damping, _FINE_LEAST if fine else _LEAST, out=damping)
        arrived = unseen if fine else (promised < _GAIN) & ~(risen > _GAIN)
        stuck = damping[chosen] > _MOST
        behind = np.zeros(chosen.size, dtype=bool)
        if step >= _PATIENCE:
            behind = value[chosen] + np.maximum(risen, 0.0) * (steps - step) < value.max()
        climbing[chosen[arrived | stuck | behind]] = False
    return theta, value


def _moves(squares: Squares, theta: Array, damping: Array, fine: bool) -> tuple[Array, Array]:
    """Steps for each of the dampings tried, shape (n, factors, d), and what the least damped promises, shape (n,)."""
    columns, prior = squares.columns, squares.prior
    gradient, normal = _normal_equations(squares, theta)
    gradient += (prior.precision * (theta - prior.mean))[:, columns]
    diagonal = np.arange(columns.size)
    normal[:, diagonal, diagonal] += prior.precision[columns]
    low, high = (end[columns] for end in prior.support)
    here = theta[:, columns]
    # a coordinate at its end that would go on beyond it stays
    held = ((here <= low) & (gradient > 0)) | ((here >= high) & (gradient < 0))
    gradient[held] = 0.0
    normal[held] = 0.0
    normal.swapaxes(1, 2)[held] = 0.0
    sd = prior.sd[columns]
    factors = _FINE_FACTORS if fine else _FACTORS
    size = normal[:, diagonal, diagonal] + 1 / sd**2
    normal[:, diagonal, diagonal] += np.where(held, size, 0.0)
    damped = np.repeat(normal[:, None], factors.size, axis=1)
    by = np.broadcast_to(1 / sd**2, size.shape) if fine else size
    damped[..., diagonal, diagonal] += (damping[:, None] * factors)[..., None] * by[:, None]
    damped[..., diagonal, diagonal] += 1e-12 * size[:, None]
    step = -np.linalg.solve(damped, np.repeat(gradient[:, None, :, None], factors.size, axis=1))[..., 0]
    promised = -0.5 * np.einsum("nd,nd->n", step[:, 0], gradient)
    longest = np.abs(step / sd).max(axis=-1, keepdims=True)
    step *= _FARTHEST / np.maximum(longest, _FARTHEST)
    moves = np.zeros((len(theta), factors.size, theta.shape[1]))
    moves[:, :, columns] = step
    return moves, promised


def _normal_equations(squares: Squares, theta: Array) -> tuple[Array, Array]:
    """Jᵀe, shape (n, c), and JᵀJ, shape (n, c, c), of the moving columns, by differences inside the support."""
    columns, prior = squares.columns, squares.prior
    n, c = len(theta), columns.size
    _, high = prior.support
    step = _STEP * np.minimum(prior.sd, 1.0)[columns]
    offsets = np.zeros((c, theta.shape[1]))
    offsets[np.arange(c), columns] = step
    moved = theta[:, None] + offsets
    outside = (moved > high).any(axis=-1) | ~prior.feasible(moved)
    moved = np.where(outside[..., None], theta[:, None] - offsets, moved)
    step = np.where(outside, -step, step)
    gradient, normal = np.empty((n, c)), np.empty((n, c, c))
    if squares.linearised is not None:
        for i, point in enumerate(theta):
            here, jacobian = squares.linearised(point)
            gradient[i], normal[i] = jacobian.T @ here, jacobian.T @ jacobian
    begin, rows = 0 if squares.linearised is None else n, 1
    while begin < n:
        chunk = slice(begin, begin + rows)
        points = np.concatenate([theta[chunk, None], moved[chunk]], axis=1)
        values = squares.residuals(points.reshape(-1, theta.shape[1])).reshape(*points.shape[:2], -1)
        here, jacobian = values[:, 0], values[:, 1:]
        jacobian -= here[:, None]
        jacobian /= step[chunk, :, None]
        gradient[chunk] = np.matmul(jacobian, here[..., None])[..., 0]
        normal[chunk] = np.matmul(jacobian, jacobian.swapaxes(1, 2))
        begin += rows
        rows = max(1, _AT_ONCE // values[0].size)
    finite = np.isfinite(gradient).all(axis=1) & np.isfinite(normal).all(axis=(1, 2))
    gradient[~finite], normal[~finite] = 0.0, np.eye(c)
    return gradient, normal


class PosteriorSquares:
    """Residuals that are Gaussian and white if the noise model holds, its parameters held as they are.

    Parameters
    ----------
    log_posterior
        The posterior.
    weight
        Factor on each white residual, shape (m,), for a climb on a density that is flattened; by default 1.
    columns
        Coordinates that move; by default all but the noise model's parameters.
    exact
        Whether derivatives are those of the model; by default of many unknowns, where differences cost more.
    """

    def __init__(
        self,
        log_posterior: LogPosterior,
        weight: Array | None = None,
        columns: Indices | None = None,
        *,
        exact: bool = False,
    ) -> None:
        self.prior = log_posterior.prior
        self._posterior, self._weight = log_posterior, weight
        every = np.arange(self.prior.mean.size - log_posterior.likelihood.hyper_count)
        self.columns = every if columns is None else columns
        many = log_posterior.likelihood.gaussian and weight is None and len(self.prior.marginals) >= MANY_UNKNOWNS
        self.linearised = self._linearised if exact or many else None

    def _linearised(self, theta: Array) -> tuple[Array, Array]:
        residual, jacobian = self._posterior.data_residuals(theta)
        return residual, jacobian if self.columns.size == theta.size else jacobian[:, self.columns]

    def residuals(self, theta: Array) -> Array:
        """Residuals e, shape (n, m), of points inside the support, shape (n, d)."""
        z = self._posterior.white(theta)
        return z if self._weight is None else z * self._weight

    def value(self, theta: Array) -> Array:
        """Log density, shape (n,), up to a constant; −inf outside the support."""
        if self._weight is None:
            return self._posterior(theta)
        log_density = self.prior.log_density(theta)
        inside = np.flatnonzero(np.isfinite(log_density))
        at_once = max(1, min(_POINTS_AT_ONCE, 8 * _AT_ONCE // self._posterior.likelihood.n_data))
        for few in np.array_split(inside, max(1, inside.size // at_once)):
            log_density[few] -= 0.5 * (self.residuals(theta[few]) ** 2).sum(axis=1)
        log_density[~np.isfinite(log_density)] = -np.inf
        return log_density
