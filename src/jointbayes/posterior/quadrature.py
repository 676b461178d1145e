"""Integrals over the prior of few unknowns by quadrature, on boxes that are halved where the integrand needs it.

The unit cube, of which the prior makes θ, is cut into boxes with three Gauss points along each axis. A likelihood may
be a ridge thinner than any first box. So its powers L^β are integrated one after the other, β rising fourfold to 1:
each is about half as wide as the one before, whose boxes see it. No value of L is computed twice.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.sampling import LogDensity

#: Of more unknowns boxes along a ridge are too many.
MOST_DIMENSIONS = 3
_FIRST = 4  # boxes along each axis to begin with
_RISE = 4.0  # of the power β from one integral to the next
_SETTLED = (0.02, 0.04, 0.08)
_VAGUE, _WEIGHT = 0.3, 1e-4  # that difference in one box, relative to its integral, and its share in the whole
_ACCURATE = 0.003  # of the last integral: what halving all boxes that count may change
_COUNTS = 1e-3  # share in the sum of these differences, times the number of boxes, below which a box does not count
_MOST_VALUES = 500_000
_POINTS = 0.5 + math.sqrt(0.15) * np.array([-1.0, 0.0, 1.0])
_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18


@dataclass(frozen=True, slots=True, eq=False)
class Quadrature:
    """An integral over the unit cube, and its points.

    Parameters
    ----------
    log_integral
        ln ∫ L du.
    error
        What the last halving of the boxes changed, summed box by box, relative to the integral.
    points
        Points u, shape (n, d).
    log_weight
        ln of L times the volume each stands for, shape (n,).
    evaluations
        Number of values of L.
    """

    log_integral: float
    error: float
    points: Array
    log_weight: Array
    evaluations: int


class _Boxes:
    """Boxes with the values of ln L at their points."""

    def __init__(self, log_likelihood: LogDensity, dimension: int) -> None:
        self._log_likelihood, self._dimension, self.evaluations = log_likelihood, dimension, 0
        each = list(itertools.product(range(3), repeat=dimension))
        self._offsets = _POINTS[np.array(each)]
        by_axis = _WEIGHTS[np.array(each)]
        self.weights = by_axis.prod(axis=1)
        # rules that have one point along an axis, the middle, and three along the others
        middle = np.where(np.array(each) == 1, 1 / _WEIGHTS[1], 0.0)
        self._coarse = self.weights[:, None] * middle
        corners = np.array(list(itertools.product(range(_FIRST), repeat=dimension)), dtype=float)
        self.low, self.size = corners / _FIRST, np.full((len(corners), dimension), 1 / _FIRST)
        self.log_values = self._values(self.low, self.size)

    @property
    def points(self) -> Array:
        """Points of all boxes, shape (boxes, points of one, d)."""
        return self._points(self.low, self.size)

    def _points(self, low: Array, size: Array) -> Array:
        points: Array = low[:, None] + size[:, None] * self._offsets
        return points

    def _values(self, low: Array, size: Array) -> Array:
        points = self._points(low, size)
        self.evaluations += len(low) * len(self.weights)
        return self._log_likelihood(points.reshape(-1, self._dimension)).reshape(points.shape[:2])

    def integrals(self, power: float) -> tuple[Array, Array]:
        """∫ (L/L_max)^β of each box (boxes,), and how far coarser rules along each axis are from it (boxes, d)."""
        value = np.exp(power * (self.log_values - self.log_values.max()))
        value *= self.size.prod(axis=1)[:, None]
        fine = value @ self.weights
        return fine, np.abs(fine[:, None] - value @ self._coarse)

    def halve(self, chosen: NDArray[np.bool_], axis: NDArray[np.intp]) -> None:
        """Replace chosen boxes (boxes,) by their halves along an axis of each; the halves come last, in pairs."""
        low, size = np.repeat(self.low[chosen], 2, axis=0), np.repeat(self.size[chosen], 2, axis=0)
        row, along = np.arange(len(low)), np.repeat(axis[chosen], 2)
        size[row, along] /= 2
        low[row[1::2], along[1::2]] += size[row[1::2], along[1::2]]
        values = self._values(low, size)
        self.low, self.size, self.log_values = (
            np.concatenate([kept[~chosen], new])
            for kept, new in ((self.low, low), (self.size, size), (self.log_values, values))
        )


def integrate(log_likelihood: LogDensity, dimension: int) -> Quadrature | None:
    """∫ L over the unit cube of up to three dimensions.

    Parameters
    ----------
    log_likelihood
        ln L, (n, d) array of points of the unit cube to (n,) array, −inf where the data are impossible.
    dimension
        d, at least 1.

    Returns
    -------
    Quadrature or None
        None where half a million values do not give the integral to 0.3 %, or L is zero at all of the first.
    """
    boxes = _Boxes(log_likelihood, dimension)
    possible = boxes.log_values[np.isfinite(boxes.log_values)]
    if not possible.size:
        return None
    settled = _SETTLED[dimension - 1]
    power = min(1.0, 1 / max(possible.max() - float(np.median(possible)), 1.0))
    while boxes.evaluations < _MOST_VALUES:
        integrals, differences = boxes.integrals(power)
        largest, total = differences.max(axis=1), integrals.sum()
        # a box of some weight that is not seen clearly may hold what counts most at the next power
        chosen = (largest > _VAGUE * integrals) & (integrals > _WEIGHT * total)
        if not chosen.any() and largest.sum() > settled * total:
            # the boxes that differ most, which make up for half of it all
            order = np.argsort(-largest)
            last = int(np.searchsorted(np.cumsum(largest[order]), largest.sum() / 2))
            chosen = largest >= largest[order[last]]
        if chosen.any():
            boxes.halve(chosen, differences.argmax(axis=1))
        elif power < 1:
            power = min(1.0, _RISE * power)
        else:
            chosen = largest > _COUNTS * largest.sum() / len(largest)
            before, top = integrals[chosen], boxes.log_values.max()
            boxes.halve(chosen, differences.argmax(axis=1))
            integrals, _ = boxes.integrals(1.0)
            halves = integrals[len(integrals) - 2 * len(before) :].reshape(-1, 2).sum(axis=1)
            before = before * math.exp(top - boxes.log_values.max())
            error = float(np.abs(halves - before).sum() / integrals.sum())
            if error < _ACCURATE:
                return _result(boxes, float(integrals.sum()), error)
    return None


def _result(boxes: _Boxes, integral: float, error: float) -> Quadrature:
    values = boxes.log_values
    with np.errstate(divide="ignore"):
        log_weight = (values + np.log(boxes.weights) + np.log(boxes.size).sum(axis=1)[:, None]).ravel()
    seen = log_weight > log_weight.max() - 100.0  # the others weigh nothing
    points = boxes.points.reshape(len(log_weight), -1)[seen]
    return Quadrature(math.log(integral) + float(values.max()), error, points, log_weight[seen], boxes.evaluations)
