"""A coupling of either sign, by its coefficient ρ."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.joint.coupled import CoupledPair
from vibrecords.arrays import Array, Flags


@dataclass(frozen=True)
class SignedCoupling(CoupledPair):
    """Coordinates θ = (ln k11, ln k22, ρ) with k12 = ρ √(k11 k22), −1 < ρ < 1, of either sign."""

    key: ClassVar[str] = "signed"
    expected: ClassVar[str] = "k11 and k22 above zero; raise them"

    def values(self, theta: ArrayLike) -> Array:
        """(k11, k12, k22), shape (..., 3), from θ, shape (..., 3)."""
        t = np.asarray(theta, dtype=float)
        k11, k22 = np.exp(t[..., 0]), np.exp(t[..., 1])
        return np.stack([k11, t[..., 2] * np.sqrt(k11 * k22), k22], axis=-1)

    def describes(self, values: ArrayLike) -> Flags:
        """Whether k11 and k22 are above zero."""
        return np.asarray((np.asarray(values, dtype=float)[..., [0, 2]] > 0).all(axis=-1))

    def _coordinates(self, values: Array) -> Array:
        log11, log22 = np.log(values[..., 0]), np.log(values[..., 2])
        return np.stack([log11, log22, values[..., 1] * np.exp(-(log11 + log22) / 2)], axis=-1)

    def derivative(self, theta: ArrayLike) -> Array:
        """∂(k11, k12, k22)/∂θ, shape (..., 3, 3): stiffness down, coordinate across."""
        t = np.asarray(theta, dtype=float)
        k11, k12, k22 = np.moveaxis(self.values(t), -1, 0)
        slope = np.zeros((*t.shape[:-1], 3, 3))
        slope[..., 0, 0], slope[..., 2, 1] = k11, k22
        slope[..., 1, 0] = slope[..., 1, 1] = k12 / 2
        slope[..., 1, 2] = np.sqrt(k11 * k22)
        return slope

    def log_slope(self, theta: Array) -> Array:
        """ln |∂(k11, k12, k22)/∂θ|, shape (...), at θ, shape (..., 3)."""
        return 1.5 * (theta[..., 0] + theta[..., 1])

    def log_determinant(self, theta: Array) -> Array:
        """ln det K^J, shape (...), at feasible θ, shape (..., 3)."""
        return theta[..., 0] + theta[..., 1] + np.log1p(-(theta[..., 2] ** 2))
