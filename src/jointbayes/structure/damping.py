"""Damping laws of a structure; a joint itself carries no damping, as in the paper."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import ModelError

__all__ = ["DampingLaw", "LossFactor", "ModalDamping", "Rayleigh"]


@dataclass(frozen=True, slots=True)
class ModalDamping:
    """Modal damping ratios ζ of the *assembled* structure (joint included), as in the paper.

    Parameters
    ----------
    ratios
        ζ of the first modes in order of frequency; the last one holds for all higher modes.
    """

    ratios: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.ratios or not all(0.0 <= z < 1.0 for z in self.ratios):
            raise ModelError(
                f"modal damping: found ratios {self.ratios}; expected one or more in [0, 1); correct the ratios"
            )

    def per_mode(self, count: int) -> NDArray[np.float64]:
        """Damping ratio of each of the first `count` modes, shape (count,)."""
        given = np.asarray(self.ratios[:count], dtype=float)
        return np.concatenate([given, np.full(count - given.size, self.ratios[-1])])


@dataclass(frozen=True, slots=True)
class LossFactor:
    """Structural (hysteretic) damping: the structure's stiffness is K(1 + jη)."""

    loss_factor: float

    def __post_init__(self) -> None:
        if not self.loss_factor >= 0.0:
            raise ModelError(f"loss factor: found {self.loss_factor:g}; expected 0 or more; correct it")


@dataclass(frozen=True, slots=True)
class Rayleigh:
    """Viscous damping C = αM + βK of the structure without the joint; α in 1/s, β in s."""

    alpha: float
    beta: float

    def __post_init__(self) -> None:
        if not (self.alpha >= 0.0 and self.beta >= 0.0):
            raise ModelError(
                f"Rayleigh damping: found alpha {self.alpha:g} 1/s and beta {self.beta:g} s; "
                "expected both 0 or more; correct them"
            )


DampingLaw = ModalDamping | LossFactor | Rayleigh
