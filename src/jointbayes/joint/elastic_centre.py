"""A joint seen from its elastic centre: one spring at a lever arm, and a rotational spring about that point."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.joint.coupled import CoupledPair
from vibrecords.arrays import Array, Flags


@dataclass(frozen=True)
class ElasticCentre(CoupledPair):
    """Coordinates θ = (ln k11, a, ln k22c) with k12 = a k11 and k22 = k22c + a² k11.

    A clamp that holds a beam over a length acts as a spring k11 somewhere along that length, at a lever arm a from the
    node of the joint, and a rotational spring k22c about that point, where the two are uncoupled. Force and moment at
    the node are k11 (y + a φ) and a k11 (y + a φ) + k22c φ. Any a and any positive springs make a positive definite
    K^J, and k22c = k22 − k12²/k11, which vibration tells best, is a coordinate: there is no edge and no curved ridge.
    """

    key: ClassVar[str] = "elastic_centre"

    def values(self, theta: ArrayLike) -> Array:
        """(k11, k12, k22), shape (..., 3), from θ, shape (..., 3)."""
        t = np.asarray(theta, dtype=float)
        k11, arm = np.exp(t[..., 0]), t[..., 1]
        return np.stack([k11, arm * k11, np.exp(t[..., 2]) + arm**2 * k11], axis=-1)

    def describes(self, values: ArrayLike) -> Flags:
        """Whether the joint is positive definite."""
        k = np.asarray(values, dtype=float)
        k11 = np.where(k[..., 0] > 0, k[..., 0], np.nan)  # no number is larger or smaller than NaN
        return np.asarray(k[..., 2] - k[..., 1] ** 2 / k11 > 0)

    def _coordinates(self, values: Array) -> Array:
        k11, k12, k22 = np.moveaxis(values, -1, 0)
        return np.stack([np.log(k11), k12 / k11, np.log(k22 - k12**2 / k11)], axis=-1)

    def derivative(self, theta: ArrayLike) -> Array:
        """∂(k11, k12, k22)/∂θ, shape (..., 3, 3): stiffness down, coordinate across."""
        t = np.asarray(theta, dtype=float)
        k11, arm = np.exp(t[..., 0]), t[..., 1]
        slope = np.zeros((*t.shape[:-1], 3, 3))
        slope[..., 0, 0], slope[..., 1, 0], slope[..., 2, 0] = k11, arm * k11, arm**2 * k11
        slope[..., 1, 1], slope[..., 2, 1] = k11, 2 * arm * k11
        slope[..., 2, 2] = np.exp(t[..., 2])
        return slope

    def log_slope(self, theta: Array) -> Array:
        """ln |∂(k11, k12, k22)/∂θ|, shape (...), at θ, shape (..., 3): k11 · k11 · k22c."""
        return 2 * theta[..., 0] + theta[..., 2]

    def log_determinant(self, theta: Array) -> Array:
        """ln det K^J, shape (...), at θ, shape (..., 3): k11 · k22c, wherever the centre lies."""
        return theta[..., 0] + theta[..., 2]
