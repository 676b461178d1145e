"""Joints with damping of their own: dynamic stiffness K + jωC + jH, another complex matrix at every line.

Joint matrices are then K, C and H side by side, shape (..., r, 3r). With A the receptance without the joint and
D = K + jωC + jH, H_ab = A_ab − A_aj D (1 + A_jj D)⁻¹ A_jb. Where damping belongs to the assembled modes these are those
with K, and D = jωC + jH is added to them alike.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["add_joint", "chi2_of", "dynamic_stiffness", "is_damped", "split", "stiffness_of"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


def is_damped(matrices: ArrayLike) -> bool:
    """Whether joint matrices, shape (..., r, r) or (..., r, 3r), state damping."""
    *_, rows, columns = np.shape(matrices)
    return rows != columns


def split(matrices: ArrayLike) -> tuple[Array, Array, Array]:
    """K, C and H, each of shape (..., r, r)."""
    given = np.asarray(matrices, dtype=float)
    r = given.shape[-2]
    return given[..., :r], given[..., r : 2 * r], given[..., 2 * r :]


def stiffness_of(matrices: ArrayLike) -> Array:
    """K alone, shape (..., r, r)."""
    given = np.asarray(matrices, dtype=float)
    return given[..., : given.shape[-2]]


def dynamic_stiffness(matrices: ArrayLike, omega: Array, *, elastic: bool) -> ComplexArray:
    """K + jωC + jH at each line, or jωC + jH alone, shape (..., lines, r, r)."""
    k, c, h = split(matrices)
    dynamic = np.zeros((*k.shape[:-2], omega.size, *k.shape[-2:]), dtype=np.complex128)
    dynamic.imag = omega[:, None, None] * c[..., None, :, :] + h[..., None, :, :]
    if elastic:
        dynamic.real = k[..., None, :, :]
    return dynamic


def add_joint(free: ComplexArray, along: Array, dynamic: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Receptance between ports once a joint is added, and motion of the joint under load at each port.

    Parameters
    ----------
    free
        Receptance without the joint between its r motions and the q ports' other motions, (..., lines, r + q, r + q).
    along
        Part of each port's motion that is the joint's own, shape (r, q) or (..., 1, r, q).
    dynamic
        Of the joint, shape (..., lines, r, r).

    Returns
    -------
    receptance, motion : ndarray, shapes (..., lines, q, q) and (..., lines, r, q)
    """
    r = dynamic.shape[-1]
    at_joint = free[..., :r, :r] @ along + free[..., :r, r:]
    motion = np.asarray(np.linalg.solve(np.eye(r) + free[..., :r, :r] @ dynamic, at_joint), dtype=np.complex128)
    rest = free[..., r:, :r] @ along + free[..., r:, r:] - free[..., r:, :r] @ (dynamic @ motion)
    return np.swapaxes(along, -1, -2) @ motion + rest, motion


def chi2_of(values: ComplexArray, measured: ComplexArray, weight: Array) -> Array:
    """Σ |H − H^x|² w², shape (batch,), of receptances (batch, lines, outputs, inputs)."""
    apart = (values - measured) * weight
    return np.asarray((apart.real**2 + apart.imag**2).sum(axis=(1, 2, 3)))
