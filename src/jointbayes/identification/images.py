"""Images of a posterior mode in which another mode may lie: like joints exchanged, couplings reflected."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.inference import Problem
from jointbayes.joint import Joints
from jointbayes.joint.quantities import is_rotation


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

    columns: NDArray[np.intp]
    signs: Array

    @classmethod
    def of(cls, problem: Problem) -> "Images":
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
    joints = [part.joints for part in problem.parts]
    each = [joint for one in joints for joint in (one.joints if isinstance(one, Joints) else (one,))]
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
