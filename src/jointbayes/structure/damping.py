"""Damping laws of a structure without its joints, whose own damping stands with their stiffness."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from jointbayes.errors import ModelError, require
from vibrecords.arrays import Array, Indices
from vibrecords.errors import array_of

NOT_NEGATIVE = 1e-9  # part of the largest eigenvalue of a scaled matrix that rounding may leave below zero


def lowest_eigenvalue(matrix: Array, where: str) -> float:
    """Lowest eigenvalue of a symmetric matrix with its diagonal scaled to 1.

    Raises
    ------
    ModelError
        If entries are too far apart to be scaled; `where` begins the message.
    """
    diagonal = np.diag(matrix)
    scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    with np.errstate(all="ignore"):  # numbers at the ends of double precision
        scaled = matrix / np.outer(scale, scale)
    if not np.isfinite(scaled).all():
        raise ModelError(f"{where} whose entries are too far apart; expected one machine's; correct its units")
    return float(np.linalg.eigvalsh(scaled).min()) if scaled.size else 0.0


def require_symmetric(
    matrix: Any,  # noqa: ANN401 (sparse arrays have no common type)
    where: str,
    key: str,
    what: str,
    most: float = 1e-10,
    remedy: str = "correct one of the two entries",
) -> None:
    """Refuse a matrix, dense or sparse, that is not symmetric to `most` of its largest entry.

    The message says where it stands, which field it is, what was found, and what to do.

    Raises
    ------
    ModelError
        If it is none: the entries that differ most.
    """
    with np.errstate(over="ignore"):
        gap = abs(matrix - matrix.T)
    if matrix.shape[0] and gap.max() > most * abs(matrix).max():
        row, column = divmod(int(gap.argmax()), matrix.shape[0])
        pair = f"{matrix[row, column]:g} and {matrix[column, row]:g} at row {row + 1}, column {column + 1}"
        raise ModelError.of(where, (key,), f"found {what}, {pair} and across the diagonal", "a symmetric one", remedy)


class DampingLaw:
    """What forward models ask of any damping law."""

    __slots__ = ()
    #: Whether its ratios are those of the assembled structure's modes, so that they follow the joint.
    of_assembled_modes: ClassVar[bool] = False

    @property
    def hysteretic(self) -> float:
        """Loss factor η of the stiffness."""
        return 0.0

    @property
    def viscous(self) -> tuple[float, float]:
        """α in 1/s and β in s of C = αM + βK."""
        return 0.0, 0.0

    @property
    def matrix(self) -> Array | None:
        """A matrix C of its own, shape (n, n), in the place of αM + βK; None without."""
        return None

    def kept(self, rows: Indices) -> "DampingLaw":
        """The law of a structure of which only some DOFs move."""
        return self

    def per_mode(self, count: int) -> Array:
        """Damping ratio of each of the first `count` modes of the assembled structure, shape (count,)."""
        return np.zeros(count)

    def scaled(self, factors: Mapping[str, float]) -> "DampingLaw":
        """The law with its quantities multiplied by factors, by name."""
        return self


@dataclass(frozen=True, slots=True)
class ModalDamping(DampingLaw):
    """Modal damping ratios ζ of the *assembled* structure (joint included), as in the paper.

    Parameters
    ----------
    ratios
        ζ of the first modes in order of frequency; the last one holds for all higher modes.
    """

    ratios: tuple[float, ...]
    of_assembled_modes: ClassVar[bool] = True

    def __post_init__(self) -> None:
        sequence = "a sequence of ratios, such as (0.01,)"
        require(self.ratios, tuple | list | np.ndarray, "modal damping: found", sequence)
        if not self.ratios or not all(0.0 <= z < 1.0 for z in self.ratios):
            found = f"found ratios {self.ratios}"
            raise ModelError.of("modal damping", (), found, "one or more in [0, 1)", "correct the ratios")

    def per_mode(self, count: int) -> Array:
        """Damping ratio of each of the first `count` modes, shape (count,)."""
        stated = np.asarray(self.ratios[:count], dtype=float)
        return np.concatenate([stated, np.full(count - stated.size, self.ratios[-1])])

    def scaled(self, factors: Mapping[str, float]) -> DampingLaw:
        """The law with all ratios times ``damping_ratio`` and the second mode's times ``damping_ratio_2``."""
        ratios = np.array(self.ratios) * factors.get("damping_ratio", 1.0)
        for i in range(ratios.size):
            ratios[i] *= factors.get(f"damping_ratio_{i + 1}", 1.0)
        return ModalDamping(tuple(ratios.tolist()))


@dataclass(frozen=True, slots=True)
class LossFactor(DampingLaw):
    """Structural (hysteretic) damping: the structure's stiffness is K(1 + jη)."""

    loss_factor: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.loss_factor < math.inf:
            raise ModelError.of("loss factor", (), f"found {self.loss_factor:g}", "0 or more", "correct it")

    @property
    def hysteretic(self) -> float:
        """η."""
        return self.loss_factor

    def scaled(self, factors: Mapping[str, float]) -> DampingLaw:
        """The law with its ``loss_factor`` multiplied."""
        return LossFactor(self.loss_factor * factors.get("loss_factor", 1.0))


@dataclass(frozen=True, slots=True)
class Rayleigh(DampingLaw):
    """Viscous damping C = αM + βK of the structure without the joint; α in 1/s, β in s."""

    alpha: float
    beta: float

    def __post_init__(self) -> None:
        if not (0.0 <= self.alpha < math.inf and 0.0 <= self.beta < math.inf):
            found = f"found alpha {self.alpha:g} 1/s and beta {self.beta:g} s"
            raise ModelError.of("Rayleigh damping", (), found, "both 0 or more", "correct them")

    @property
    def viscous(self) -> tuple[float, float]:
        """α and β."""
        return self.alpha, self.beta


@dataclass(frozen=True, slots=True, eq=False)
class ViscousMatrix(DampingLaw):
    """Viscous damping by its matrix C of the structure without the joint, shape (n, n), N·s/m.

    Raises
    ------
    ModelError
        If it is not a square, symmetric, finite matrix, or has a negative eigenvalue: it would feed energy in.
    """

    viscous_matrix: Array

    def __post_init__(self) -> None:
        matrix = array_of(self.viscous_matrix, float, "damping matrix", ModelError)
        object.__setattr__(self, "viscous_matrix", matrix)
        if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or not np.isfinite(matrix).all():
            found = f"found an array of shape {matrix.shape}"
            raise ModelError.of("damping matrix", (), found, "a square one of finite numbers")
        require_symmetric(matrix, "damping matrix", "viscous_matrix", "an unsymmetric one")
        lowest = lowest_eigenvalue(matrix, "damping matrix: found one")
        if lowest < -NOT_NEGATIVE:
            found = f"found one with {lowest:.3g} as lowest eigenvalue, diagonal scaled to 1"
            expected = "a positive semidefinite one, which takes energy out"
            raise ModelError.of("damping matrix", ("viscous_matrix",), found, expected, "correct it")

    @property
    def matrix(self) -> Array:
        """C."""
        return self.viscous_matrix

    def kept(self, rows: Indices) -> DampingLaw:
        """The law of a structure of which only some DOFs move."""
        return ViscousMatrix(self.viscous_matrix[np.ix_(rows, rows)])
