"""The matrices of joints: stiffness, dashpots and imaginary stiffness."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibrecords.arrays import Array, ComplexArray, Flags

Index = int | slice | tuple[Any, ...] | NDArray[Any] | None


@dataclass(frozen=True, slots=True, eq=False)
class JointMatrix:
    """Stiffness K, dashpots C and imaginary stiffness H of joints, whose dynamic stiffness is K + jωC + jH.

    All of one shape, (r, r) of one joint or (batch, r, r) of many.

    Parameters
    ----------
    stiffness
        K, symmetric.
    viscous, hysteretic
        C and H; None of joints without damping. Where only one is given the other is zero.

    Examples
    --------
    >>> joint = JointMatrix(np.array([[2.0]]), hysteretic=np.array([[0.5]]))
    >>> joint.damped, joint.dynamic_stiffness(np.array([10.0])).tolist()
    (True, [[[(2+0.5j)]]])
    """

    stiffness: Array
    viscous: Array | None = None
    hysteretic: Array | None = None

    def __post_init__(self) -> None:
        if (self.viscous is None) != (self.hysteretic is None):
            missing = "viscous" if self.viscous is None else "hysteretic"
            object.__setattr__(self, missing, np.zeros_like(self.stiffness))

    @property
    def damped(self) -> bool:
        """Whether dashpots or an imaginary stiffness are stated, be they zero."""
        return self.viscous is not None

    @property
    def size(self) -> int:
        """Number r of DOFs."""
        return self.stiffness.shape[-1]

    @property
    def sides(self) -> tuple[Array, Array, Array]:
        """K, C and H, zeros where there is no damping."""
        if self.viscous is None or self.hysteretic is None:
            zero = np.zeros_like(self.stiffness)
            return self.stiffness, zero, zero
        return self.stiffness, self.viscous, self.hysteretic

    def __len__(self) -> int:
        return len(self.stiffness)

    def __getitem__(self, index: Index) -> "JointMatrix":
        """Some of a batch, or with None or several indices along its axes, as of an array."""
        return self._change_each(lambda side: side[index])

    @property
    def batch(self) -> "JointMatrix":
        """The same with a batch axis: of one joint a batch of one."""
        return self if self.stiffness.ndim > 2 else self[None]

    def repeated(self, count: int) -> "JointMatrix":
        """One joint so many times, shape (count, r, r)."""
        return self._change_each(lambda side: np.repeat(side[None], count, axis=0))

    def block(self, rows: slice) -> "JointMatrix":
        """Rows and columns of some of the DOFs."""
        return self._change_each(lambda side: np.ascontiguousarray(side[..., rows, rows]))

    def moved(self, changes: "JointMatrix", step: float) -> "JointMatrix":
        """These plus a step along changes, of which there may be a batch."""
        moved = (side + step * change for side, change in zip(self.sides, changes.sides, strict=True))
        return JointMatrix(*moved) if self.damped or changes.damped else JointMatrix(next(moved))

    @property
    def dissipative(self) -> "JointMatrix":
        """The damping alone, K = 0."""
        return JointMatrix(np.zeros_like(self.stiffness), self.viscous, self.hysteretic)

    @property
    def linked(self) -> Flags:
        """Entries that are not zero in all of a batch, shape (r, r)."""
        k, c, h = self.batch.sides
        return np.asarray(((k != 0) | (c != 0) | (h != 0)).any(axis=0))

    def dynamic_stiffness(self, omega: Array) -> ComplexArray:
        """K + jωC + jH at each line ω, shape (lines,) in rad/s: shape (..., lines, r, r)."""
        k, c, h = self.sides
        dynamic = np.zeros((*k.shape[:-2], omega.size, *k.shape[-2:]), dtype=np.complex128)
        dynamic.imag = omega[:, None, None] * c[..., None, :, :] + h[..., None, :, :]
        dynamic.real = k[..., None, :, :]
        return dynamic

    def _change_each(self, change: Callable[[Array], Array]) -> "JointMatrix":
        return JointMatrix(*map(change, self.sides if self.damped else (self.stiffness,)))


#: Matrices of joints: with damping an object, without it an array K, shape (r, r) or (batch, r, r), is enough.
AnyJointMatrix = JointMatrix | ArrayLike


def joint_matrix_of(matrices: AnyJointMatrix) -> JointMatrix:
    """Matrices of joints as an object, of one joint or of a batch."""
    return matrices if isinstance(matrices, JointMatrix) else JointMatrix(np.asarray(matrices, dtype=float))


def symmetric_changes(r: int) -> Array:
    """Symmetric change dK^J for each entry in turn, shape (r², r, r): one on the diagonal, two halves off it."""
    unit = np.eye(r * r).reshape(r * r, r, r)
    return (unit + unit.swapaxes(1, 2)) / 2
