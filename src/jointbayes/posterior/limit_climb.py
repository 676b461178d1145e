"""Climb to the greatest value of a quantity where a density is high enough, by Newton's method.

About a point the density is a paraboloid, by differences of second order, and what is high enough a ball in axes that
follow its curvature. The farthest point of that ball is the next one; of a whole line of shorter steps to it, tried in
one call, the farthest that really is high enough is taken. Every point on the way is a joint that fits. Several climbs
go side by side: a call for the points of all costs little more than one for those of each.
"""

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jointbayes.sampling.density import from_stencil, stencil
from vibrecords.arrays import Array, Flags

_STEP = 0.01  # of the differences, in columns of the axes
_CLOSER, _FAILED = 0.3, 6  # differences that leave the region are made smaller, so many times
_FLATTEST = 0.02  # least curvature: no step makes an axis more than seven times longer
_SETTLED = 0.7  # of its length: an axis that becomes shorter was too long for differences along it
_LENGTHS = 2.0 ** -np.arange(10)
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


@dataclass(frozen=True, slots=True, eq=False)
class LimitClimb:
    """What is climbed, and where.

    Parameters
    ----------
    sought
        The quantity, (n, d) to (n,); None where the density itself is.
    sides, ends
        Faces of the support: sides @ θ ≤ ends, shapes (p, d) and (p,).
    possible
        Whether points θ, shape (n, d), are inside the support, (n,).
    margin
        How far differences may leave it, shape (d,), beyond the first d faces and the next d, those of a box.
    nowhere
        The height, ln of the density, where that is no number.
    """

    sought: Callable[[Array], Array] | None
    sides: Array
    ends: Array
    possible: Callable[[Array], Flags]
    margin: Array
    nowhere: float

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
        d, place, failed = start.size, start, 0
        low, high = -self.ends[d : 2 * d], self.ends[:d]
        while steps and failed < _FAILED:
            steps -= 1
            step = _STEP * _CLOSER**failed
            around = np.clip(stencil(place, axes, step), low - self.margin, high + self.margin)
            heights = yield around
            if heights.min() <= self.nowhere:
                failed += 1
                continue
            values = self._values(around, heights)
            move, turn = self._move(place, axes, heights, values, step, level)
            # axes far wider than the density is say little of it: the next ones, which follow its curvature, do
            settled, axes = np.linalg.norm(turn, 2, axis=0).min() > _SETTLED, axes @ turn
            trials = np.clip(place + _LENGTHS[:, None] * move, low, high)
            trial_heights = yield trials
            trial_values = self._values(trials, trial_heights)
            allowed = (trial_heights >= level - slack) & self.possible(trials)
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

    def _move(
        self, place: Array, axes: Array, heights: Array, values: Array, step: float, level: float
    ) -> tuple[Array, Array]:
        """Step to the farthest point of the paraboloid's ball, shape (d,), and the turn (k, k) that rounds it."""
        here, slope, bent = from_stencil(heights, step)
        _, along, curved = from_stencil(values, step)
        # the quantity bends as well: at the end both slopes are parallel, and their ratio is what that counts
        ratio = max(float(np.linalg.norm(along)) / max(float(np.linalg.norm(slope)), 1.0), 1e-3)
        hessian = bent if self.sought is None else bent + curved / ratio
        curvature, vectors = np.linalg.eigh(-(hessian + hessian.T) / 2)
        turn = vectors / np.sqrt(np.maximum(curvature, _FLATTEST))
        turned = axes @ turn
        forward = None if self.sought is None else turn.T @ along
        room = np.maximum(self.ends - self.sides @ place, 0.0)
        return turned @ farthest_in_ball(turn.T @ slope, here - level, forward, self.sides @ turned, room), turn


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
