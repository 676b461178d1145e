"""Joints with damping of their own: dynamic stiffness D = K + jωC + jH, another complex matrix at every line.

With A the receptance without the joint H_ab = A_ab − A_aj D (1 + A_jj D)⁻¹ A_jb. Where damping belongs to the assembled
modes these are those with K, and D = jωC + jH is added to them alike.
"""

import numpy as np
import scipy  # its parts load at first use
from numpy.typing import NDArray

from jointbayes.frf.kernels.by_line import add_joints
from jointbayes.joint import JointMatrix
from vibrecords.arrays import Array, ComplexArray, Flags

#: Largest diagonal of the inverse of K, scaled to a unit diagonal, for which digits enough are left.
_STIFFEST = 1e4


def compliance_by_line(matrices: JointMatrix, omega: Array) -> tuple[ComplexArray, NDArray[np.int64], Flags]:
    """Inverse of K + jωC + jH at each line, joint by joint of those that stand side by side; without C at one for all.

    Parameters
    ----------
    matrices
        Of a batch of joints, with damping.
    omega
        Lines, shape (lines,), rad/s.

    Returns
    -------
    compliance, places, possible_joints : ndarray, shapes (batch, entries, lines or 1), (entries, 2) and (batch,)
        Entries in the upper triangle, their rows and columns, and for which of the batch they are numbers.
    """
    if not matrices.sides[1].any():
        omega = omega[:1]
    count, label = scipy.sparse.csgraph.connected_components(matrices.linked, directed=False)
    possible_joints = np.ones(len(matrices), dtype=bool)
    values, places = [], []
    for block in range(count):
        rows = np.flatnonzero(label == block)
        yielding = matrices[:, rows[:, None], rows]
        elastic, dynamic = yielding.stiffness, yielding.dynamic_stiffness(omega)
        size = np.diagonal(dynamic, axis1=-2, axis2=-1)
        possible = (size != 0).all(axis=(1, 2)) & np.isfinite(dynamic).all(axis=(1, 2, 3))
        if rows.size > 1:  # of one row there is nothing to lose
            root = np.sqrt(np.maximum(np.diagonal(elastic, axis1=-2, axis2=-1), np.finfo(float).tiny))
            least = np.linalg.eigvalsh(elastic / root[:, :, None] / root[:, None, :])[:, 0]
            possible &= least > 1 / _STIFFEST
        possible_joints &= possible
        dynamic[~possible] = np.eye(rows.size)
        inverse = np.linalg.inv(dynamic) if rows.size > 1 else 1 / dynamic
        upper = np.triu_indices(rows.size)
        values.append(inverse[..., upper[0], upper[1]].swapaxes(1, 2))
        places.append(np.stack([rows[upper[0]], rows[upper[1]]], axis=1))
    return np.concatenate(values, axis=1), np.concatenate(places).astype(np.int64), possible_joints


def add_joint(
    matrices: JointMatrix, omega: Array, free: ComplexArray, along: Array, n_out: int
) -> tuple[ComplexArray, ComplexArray]:
    """Receptance between ports once a joint is added, and motion of the joint under load at each port.

    Parameters
    ----------
    matrices
        Of a batch of joints, with damping.
    omega
        Lines, shape (lines,), rad/s.
    free
        Receptance without the joint between its r motions and the q ports' other motions, of each joint or of all,
        shape (batch or 1, lines, r + q, r + q).
    along
        Part of each port's motion that is the joint's own, shape (r, q).
    n_out
        The first so many ports are outputs, the others inputs.

    Returns
    -------
    receptance, motion : ndarray, shapes (batch, lines, outputs, inputs) and (batch, lines, r, q)
    """
    batch, lines, (r, q) = len(matrices), len(omega), along.shape
    value = np.empty((batch, lines, n_out, q - n_out), dtype=np.complex128)
    motion = np.empty((batch, lines, r, q), dtype=np.complex128)
    every = np.ascontiguousarray(free)
    with np.errstate(all="ignore"):  # a joint at which nothing is finite: its receptances are not either
        k, c, h = map(np.ascontiguousarray, matrices.sides)
        add_joints(k, c, h, omega, every, np.ascontiguousarray(along), n_out, value, motion)
    return value, motion


def chi2_of(values: ComplexArray, measured: ComplexArray, weight: Array) -> Array:
    """Σ |H − H^x|² w², shape (batch,), of receptances (batch, lines, outputs, inputs)."""
    apart = (values - measured) * weight
    return np.asarray((apart.real**2 + apart.imag**2).sum(axis=(1, 2, 3)))
