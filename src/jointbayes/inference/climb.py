"""Climb a log density from several starts side by side, with some coordinates fixed, or a quantity to a level of it.

`climb_all` climbs a density of residuals by damped least squares; `tests/inference/test_climb.py` compares its ends
with those of scipy, in a box, along bent ridges and with fixed coordinates. `LimitClimb` climbs any density, or a
quantity to where the density is just high enough, by Newton's method on differences; `tests/posterior/test_limits.py`
compares its ends with closed forms. Below this room `jointbayes.sampling.density.newton_climb` finds a mode with its
covariance from values alone.
"""

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from jointbayes.inference.log_posterior import LogPosterior
from jointbayes.inference.prior import JointPrior
from jointbayes.sampling.density import from_stencil, stencil
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
    enough: float = 0.0,
) -> tuple[Array, Array]:
    """Climb from each start until its next step promises no more than a thousandth in log density.

    1. Take the slope and the curvature of the squares where each start has come, and add the prior's.
    2. Solve for a step with each of several dampings; no coordinate goes further than most of a prior's deviation.
    3. Look at the density after all of them, and make the best step.
    4. Leave out the starts that have arrived, are stuck, or at their present pace would not come up with the best
       within the steps left.

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
    enough
        Gain in log density: a fine climb whose next step promises less ends before.

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
    columns, prior, factors = squares.columns, squares.prior, _FINE_FACTORS if fine else _FACTORS
    (low, high), sd, diagonal = prior.support, prior.sd[columns], np.arange(columns.size)
    damping = np.full(len(theta), 0.1)
    climbing = np.isfinite(value) & (columns.size > 0)
    for number in range(steps):
        chosen = np.flatnonzero(climbing)
        if not chosen.size:
            break
        if tell(len(theta) - chosen.size, len(theta)):
            break
        # 1. slope and curvature; a coordinate at its end that would go on beyond it stays
        gradient, normal = normal_equations(squares, theta[chosen])
        gradient += (prior.precision * (theta[chosen] - prior.mean))[:, columns]
        normal[:, diagonal, diagonal] += prior.precision[columns]
        here = theta[chosen][:, columns]
        held = ((here <= low[columns]) & (gradient > 0)) | ((here >= high[columns]) & (gradient < 0))
        gradient[held] = 0.0
        normal[held] = 0.0
        normal.swapaxes(1, 2)[held] = 0.0
        size = normal[:, diagonal, diagonal] + 1 / sd**2
        normal[:, diagonal, diagonal] += np.where(held, size, 0.0)
        # 2. steps of each damping, and what the least damped promises
        damped = np.repeat(normal[:, None], factors.size, axis=1)
        by = np.broadcast_to(1 / sd**2, size.shape) if fine else size
        damped[..., diagonal, diagonal] += (damping[chosen, None] * factors)[..., None] * by[:, None]
        damped[..., diagonal, diagonal] += 1e-12 * size[:, None]
        step = -np.linalg.solve(damped, np.repeat(gradient[:, None, :, None], factors.size, axis=1))[..., 0]
        promised = -0.5 * np.einsum("nd,nd->n", step[:, 0], gradient)
        step *= _FARTHEST / np.maximum(np.abs(step / sd).max(axis=-1, keepdims=True), _FARTHEST)
        moves = np.zeros((chosen.size, factors.size, theta.shape[1]))
        moves[:, :, columns] = step
        # 3. the best of them
        trials = np.clip(theta[chosen, None] + moves, low, high)
        values = squares.value(trials.reshape(-1, theta.shape[1])).reshape(trials.shape[:2])
        unseen = fine & (promised < _ROUNDING * (1 + np.abs(value[chosen]))) & (values[:, 0] > value[chosen] - _GAIN)
        best = np.where(unseen, 0, np.argmax(values, axis=1))
        row = np.arange(chosen.size)
        risen = values[row, best] - value[chosen]
        better = (risen > 0) | unseen
        theta[chosen[better]] = trials[row, best][better]
        value[chosen[better]] = values[row, best][better]
        damping[chosen] *= np.where(better, factors[best], 1e5)
        np.maximum(damping, _FINE_LEAST if fine else _LEAST, out=damping)
        # 4. who goes on
        arrived = unseen | (promised < enough) if fine else (promised < _GAIN) & ~(risen > _GAIN)
        stuck = damping[chosen] > _MOST
        behind = np.zeros(chosen.size, dtype=bool)
        if number >= _PATIENCE:
            behind = value[chosen] + np.maximum(risen, 0.0) * (steps - number) < value.max()
        climbing[chosen[arrived | stuck | behind]] = False
    return theta, value


def normal_equations(squares: Squares, theta: Array) -> tuple[Array, Array]:
    """Jᵀe, shape (n, c), and JᵀJ, shape (n, c, c), of the moving columns, by differences inside the support."""
    columns, prior = squares.columns, squares.prior
    n, c = len(theta), columns.size
    step = _STEP * np.minimum(prior.sd, 1.0)[columns]
    offsets = np.zeros((c, theta.shape[1]))
    offsets[np.arange(c), columns] = step
    side = side_inside(prior, theta[:, None], offsets)
    moved, step = theta[:, None] + side[..., None] * offsets, side * step
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


def side_inside(prior: JointPrior, theta: Array, move: Array) -> Array:
    """1, or −1 where a small move up, shape (..., d), would lead from θ, shape (..., d), out of the support."""
    moved = theta + move
    return np.where((moved > prior.support[1]).any(axis=-1) | ~prior.feasible(moved), -1.0, 1.0)


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


#: In place of ln of a density that is no number.
NOWHERE = -1e9
_OF_AXES = 0.01  # of differences, in columns of the axes
_CLOSER, _FAILED = 0.3, 6  # differences that leave the region are made smaller, so many times
_FLATTEST = 0.02  # least curvature: no step makes an axis more than seven times longer
_SETTLED = 0.7  # of its length: an axis that becomes shorter was too long for differences along it
_LENGTHS = 2.0 ** -np.arange(10)
EDGE = 1e-9  # of the support's width: at its very ends ρ is no positive definite joint
_MARGIN = 0.02  # prior standard deviations beyond the support that differences may reach
_FARTHEST_SD = 40.0  # prior standard deviations from its mean
_TOUCHING = 1e-9  # of a face of the support


#: Asks for ln of the density at points θ, shape (n, d), and returns where it ends, shape (d,).
Climb = Generator[Array, Any, Array]


def climb_together(height: Callable[[Array], Array], climbs: Sequence[Climb]) -> list[Array]:
    """What each climb returns; what all of them ask for next is found in one call of `height`."""
    ends: dict[int, Array] = {}
    told: dict[int, Array | None] = dict.fromkeys(range(len(climbs)))
    while told:
        asked: dict[int, Array] = {}
        for number, heights in told.items():
            try:
                asked[number] = climbs[number].send(heights)
            except StopIteration as stop:
                ends[number] = stop.value
        together = height(np.concatenate(list(asked.values()))) if asked else np.empty(0)
        told = dict(zip(asked, np.split(together, np.cumsum([len(theta) for theta in asked.values()])), strict=False))
    return [ends[number] for number in range(len(climbs))]


def reach(prior: JointPrior, inside: float = 0.0) -> tuple[Array, Array]:
    """Ends of a prior's support, shape (d,) each, or 40 standard deviations where it has none, by a share inside.

    A normal prior has no end, but a stiffness of e^800 is no number.
    """
    far, (low, high) = _FARTHEST_SD * prior.sd, prior.support
    low, high = np.maximum(low, prior.mean - far), np.minimum(high, prior.mean + far)
    return low + inside * (high - low), high - inside * (high - low)


@dataclass(frozen=True, slots=True, eq=False)
class LimitClimb:
    """Climb to the greatest value of a quantity where a density is high enough, by Newton's method.

    About a point the density is a paraboloid, by differences of second order, and what is high enough a ball in axes
    that follow its curvature. The farthest point of that ball is the next one; of a whole line of shorter steps to it,
    tried in one call, the farthest that really is high enough is taken. Every point on the way is a joint that fits.

    Parameters
    ----------
    prior
        Its support is not left, but by differences a little.
    sought
        The quantity, (n, d) to (n,); None where the density itself is.
    """

    prior: JointPrior
    sought: Callable[[Array], Array] | None

    def end(self, start: Array, axes: Array, level: float, *, steps: int, gain: float, slack: float) -> Climb:
        """Where a climb ends, shape (d,), in steps that gain so much at least, and `steps` at most.

        Parameters
        ----------
        start
            Point whose density is high enough, shape (d,).
        axes
            First axes, columns of shape (d, k): a root of a covariance. The climb stays in what they span.
        level, slack
            How high the density is to be, and by how much it may miss that.
        """
        place, failed, margin = start, 0, _MARGIN * self.prior.sd
        (low, high), cones = reach(self.prior, EDGE), [c.normal(start.size) for c in self.prior.parametrisation.cones]
        while steps and failed < _FAILED:
            steps -= 1
            # 1. density and quantity about the point
            step = _OF_AXES * _CLOSER**failed
            around = np.clip(stencil(place, axes, step), low - margin, high + margin)
            heights = yield around
            if heights.min() <= NOWHERE:
                failed += 1
                continue
            values = self._values(around, heights)
            # 2. the farthest point of the paraboloid's ball, and the turn (k, k) that rounds it
            here, slope, bent = from_stencil(heights, step)
            _, along, curved = from_stencil(values, step)
            # the quantity bends as well: at the end both slopes are parallel, and their ratio is what that counts
            ratio = max(float(np.linalg.norm(along)) / max(float(np.linalg.norm(slope)), 1.0), 1e-3)
            hessian = bent if self.sought is None else bent + curved / ratio
            curvature, vectors = np.linalg.eigh(-(hessian + hessian.T) / 2)
            turn = vectors / np.sqrt(np.maximum(curvature, _FLATTEST))
            forward = None if self.sought is None else turn.T @ along
            sides = np.array([*np.eye(place.size), *-np.eye(place.size), *cones])
            room = np.maximum(np.concatenate([high, -low, np.full(len(cones), -EDGE)]) - sides @ place, 0.0)
            turned = axes @ turn
            move = turned @ farthest_in_ball(turn.T @ slope, here - level, forward, sides @ turned, room)
            # axes far wider than the density is say little of it: the next ones, which follow its curvature, do
            settled, axes = np.linalg.norm(turn, 2, axis=0).min() > _SETTLED, turned
            # 3. the farthest of shorter steps that is high enough
            trials = np.clip(place + _LENGTHS[:, None] * move, low, high)
            trial_heights = yield trials
            trial_values = self._values(trials, trial_heights)
            allowed = (trial_heights >= level - slack) & self.prior.feasible(trials)
            if not allowed.any():
                failed += 1
                continue
            best = np.flatnonzero(allowed)[np.argmax(trial_values[allowed])]
            gained = trial_values[best] - values[0]
            if gained > 0:
                place, failed = trials[best], 0
            if gained <= gain and settled:
                break
        return place

    def _values(self, theta: Array, heights: Array) -> Array:
        """What is sought, shape (n,)."""
        return heights if self.sought is None else self.sought(theta) + _HIGHER * heights


_HIGHER = 1e-4  # of what is sought that one unit of ln of the density is worth: of equal ends the likeliest


def farthest_in_ball(slope: Array, spare: float, forward: Array | None, sides: Array, room: Array) -> Array:
    """Point z, shape (k,), of the greatest forward·z where slope·z − |z|²/2 ≥ −spare and sides @ z ≤ room.

    Without `forward` of the greatest slope·z − |z|²/2. Faces that the point would cross hold it, one after the other.

    Parameters
    ----------
    slope, forward
        Shape (k,).
    spare
        How far the height may fall.
    sides, room
        Shapes (p, k) and (p,).
    """
    held: list[int] = []
    point: Array = np.zeros(slope.size)
    for _ in range(slope.size + 1):
        foot: Array = np.zeros(slope.size)
        free: Array = np.eye(slope.size)
        if held:
            foot = np.asarray(np.linalg.lstsq(sides[held], room[held], rcond=None)[0])
            _, size, rows = np.linalg.svd(sides[held])
            free = rows[int((size > 1e-10 * size[0]).sum()) :].T
        middle = free.T @ (slope - foot)
        point = foot + free @ middle
        ahead = None if forward is None else free.T @ forward
        if ahead is not None and ahead.any():
            square = float(2 * spare + slope @ slope - (slope - foot) @ (slope - foot) + middle @ middle)
            point = point + free @ ahead * math.sqrt(max(square, 0.0)) / np.linalg.norm(ahead)
        beyond = sides @ point - room
        beyond[held] = -1.0
        if beyond.max() <= _TOUCHING or free.shape[1] == 0:
            break
        held.append(int(np.argmax(beyond)))
    return point
