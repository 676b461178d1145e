"""Every stiffness by its logarithm."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.joint.parametrisation import CondensedChart, Cone, Parametrisation

__all__ = ["PARAMETRISATION", "LogStiffness"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LogStiffness(Parametrisation):
    """Coordinates θ = (ln k11, ln k12, ln k22), so that every stiffness is positive."""

    key: ClassVar[str] = "log"
    expected: ClassVar[str] = "all above zero; use the signed parametrisation for a coupling of either sign"
    cone: ClassVar[Cone | None] = Cone(0, 1, 2)
    ridge: ClassVar[CondensedChart | None] = CondensedChart()
    least_coupling: ClassVar[float] = 0.1

    def stiffness(self, theta: ArrayLike) -> Array:
        """(k11, k12, k22), shape (..., 3), from θ, shape (..., 3)."""
        stiffness: Array = np.exp(np.asarray(theta, dtype=float))
        return stiffness

    def describes(self, stiffness: ArrayLike) -> NDArray[np.bool_]:
        """Whether all are above zero."""
        return np.asarray((np.asarray(stiffness, dtype=float) > 0).all(axis=-1))

    def _coordinates(self, stiffness: Array) -> Array:
        theta: Array = np.log(stiffness)
        return theta

    def derivative(self, theta: ArrayLike) -> Array:
        """∂(k11, k12, k22)/∂θ, shape (..., 3, 3): stiffness down, coordinate across."""
        derivative: Array = np.exp(np.asarray(theta, dtype=float))[..., None] * np.eye(3)
        return derivative

    def log_slope(self, theta: Array) -> Array:
        """ln |∂(k11, k12, k22)/∂θ|, shape (...), at θ, shape (..., 3)."""
        slope: Array = theta.sum(axis=-1)
        return slope

    def log_determinant(self, theta: Array) -> Array:
        """ln det K^J, shape (...), at feasible θ, shape (..., 3)."""
        diagonal = theta[..., 0] + theta[..., 2]
        determinant: Array = diagonal + np.log1p(-np.exp(2 * theta[..., 1] - diagonal))
        return determinant


PARAMETRISATION = LogStiffness()
