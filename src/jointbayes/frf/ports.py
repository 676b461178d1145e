"""Where a structure is excited, observed and joined."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.arrays import Array
from jointbayes.joint import AnyJoint, AnyJointMatrix
from jointbayes.joint.joint import LabelledDofs


@dataclass(frozen=True, slots=True)
class Ports:
    """Frequency lines and DOFs between which receptances are wanted.

    Parameters
    ----------
    frequency_hz
        Frequency lines, shape (lines,), Hz.
    outputs, inputs
        DOF labels of responses and of excitations.
    """

    frequency_hz: Array
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]

    @property
    def omega(self) -> Array:
        """ω = 2πf, shape (lines,), rad/s."""
        return 2 * np.pi * np.asarray(self.frequency_hz, dtype=float)

    def selections(self, structure: LabelledDofs, joint: AnyJoint) -> tuple[Array, Array, Array]:
        """Selection matrices of joint, outputs and inputs, shapes (n, r), (n, outputs), (n, inputs)."""
        unit = np.eye(structure.n_dofs)
        return (
            joint.selection(structure),
            unit[:, structure.index(self.outputs)],
            unit[:, structure.index(self.inputs)],
        )


def split_along(selection: Array, joined: Array) -> tuple[Array, Array]:
    """Split selections (n, q) into joint coordinates (r, q) and the rest (n, q): selection = joined @ along + rest.

    Motion of the joint itself vanishes as the joint becomes rigid. Computed as a difference of large numbers it
    would be rounding error; with its part along the joint kept apart it is not.
    """
    along = np.linalg.pinv(joined) @ selection
    return along, selection - joined @ along


def as_batch(stiffness: ArrayLike) -> Array:
    """Stiffness matrices with a leading batch axis, shape (batch, r, r)."""
    matrices = np.asarray(stiffness, dtype=float)
    return matrices[None] if matrices.ndim == 2 else matrices


def as_factors(factors: ArrayLike | None, batch: int) -> Array:
    """Factors on a structure's uncertain quantities for each of a batch, shape (batch, q); (batch, 0) without any."""
    if factors is None:
        return np.empty((batch, 0))
    rows = np.atleast_2d(np.asarray(factors, dtype=float))
    return rows if len(rows) == batch else np.repeat(rows, batch, axis=0)


class Misfit(Protocol):
    """Weighted distance χ² = Σ |H − H^x|² w² of a forward model from measured receptances."""

    def chi2(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """χ², shape (batch,), of joint matrices, shape (batch, r, r), and factors on the structure, (batch, q).

        Not finite where a line is singular.
        """
        ...

    def chi2_gradient(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """χ² and its gradient S, shape (batch, r, r): dχ² = Σ S_ij dK_ij, of joints without damping."""
        ...


class ReceptanceModel(Protocol):
    """Receptance of a structure with its joint as a function of K^J; see `LowRankCoupling`, `AssembledModes`."""

    def receptance(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> NDArray[np.complex128]:
        """Receptances, shape (batch, lines, outputs, inputs).

        For joint matrices (r, r) or (batch, r, r) and factors on a family's quantities, (q,) or (batch, q).
        """
        ...

    def tangent(
        self, matrix: AnyJointMatrix, directions: AnyJointMatrix, factors: ArrayLike | None = None
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Receptance (lines, outputs, inputs) and derivative (p, lines, outputs, inputs) of one joint matrix."""
        ...

    def misfit(self, measured: NDArray[np.complex128], weight: Array) -> Misfit:
        """χ² against measured receptances (lines, outputs, inputs) with weights 1/σ, as a function of the joint."""
        ...
