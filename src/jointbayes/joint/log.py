"""Every stiffness by its logarithm."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.joint.coupled import CoupledPair
from jointbayes.joint.parametrisation import CondensedCoordinates, Cone
from vibrecords.arrays import Array, Flags


@dataclass(frozen=True)
class LogStiffness(CoupledPair):
    """Coordinates θ = (ln k11, ln k12, ln k22), so that every stiffness is positive."""

    key: ClassVar[str] = "log"
    expected: ClassVar[str] = "all above zero; use the signed parametrisation for a coupling of either sign"
    least_coupling: ClassVar[float] = 0.1

    #: Joints are positive definite where 2 ln k12 < ln k11 + ln k22.
    cones: ClassVar[tuple[Cone, ...]] = (Cone(0, 1, 2),)
    #: ln(k22 − k12²/k11) in place of ln k22.
    ridges: ClassVar[tuple[CondensedCoordinates, ...]] = (CondensedCoordinates(*cones),)

    def values(self, theta: ArrayLike) -> Array:
        """(k11, k12, k22), shape (..., 3), from θ, shape (..., 3)."""
        return np.exp(np.asarray(theta, dtype=float))

    def describes(self, values: ArrayLike) -> Flags:
        """Whether all are above zero."""
        return np.asarray((np.asarray(values, dtype=float) > 0).all(axis=-1))

    def _coordinates(self, values: Array) -> Array:
        return np.log(values)

    def derivative(self, theta: ArrayLike) -> Array:
        """∂(k11, k12, k22)/∂θ, shape (..., 3, 3): stiffness down, coordinate across."""
        return np.exp(np.asarray(theta, dtype=float))[..., None] * np.eye(3)

    def log_slope(self, theta: Array) -> Array:
        """ln |∂(k11, k12, k22)/∂θ|, shape (...), at θ, shape (..., 3)."""
        return theta.sum(axis=-1)

    def log_determinant(self, theta: Array) -> Array:
        """ln det K^J, shape (...), at feasible θ, shape (..., 3)."""
        diagonal = theta[..., 0] + theta[..., 2]
        return diagonal + np.log1p(-np.exp(2 * theta[..., 1] - diagonal))
