"""Modes of the assembled structure from the modes of the structure without its joint, spring by spring.

In the free modes (eigenvalues Λ, shapes φ_j at the joint) the assembled eigenproblem is Λ + φ_jᵀ K^J φ_j:
diagonal plus rank r, with as many rows as modes kept and no FE matrix in sight.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.frf.kernels.secular import add_springs, workspace
from jointbayes.frf.kernels.springs import springs
from jointbayes.frf.ports import as_factors
from jointbayes.joint import Joint
from jointbayes.structure import Structure, StructureFamily, as_family, mode_shift

__all__ = ["JoinedModes"]

Array = NDArray[np.float64]


class JoinedModes:
    """Assembled eigenvalues, and motions in the assembled modes, for any joint matrix from absent to rigid.

    Parameters
    ----------
    structure, joint
        Structure without the joint, or a family of them, and where the joint acts, r DOFs.
    motions
        What else to know of each mode, as forms on the DOFs, shape (DOFs, q).
    """

    def __init__(self, structure: Structure | StructureFamily, joint: Joint, motions: Array) -> None:
        family = as_family(structure)
        self._shift = mode_shift(family.nominal)
        joined = joint.selection(family.nominal)
        self._r = joined.shape[1]
        self._free = family.free_modes(np.hstack([joined, motions]))

    def solve(self, matrices: Array, factors: ArrayLike | None = None) -> tuple[Array, Array, Array]:
        """Assembled modes for joint matrices (batch, r, r), symmetric, and factors on the structure (batch, f).

        Returns
        -------
        eigenvalues, rows, directions : ndarray, shapes (batch, m), (batch, r + q, m), (batch, r, r)
            Eigenvalues rising; in each mode of unit modal mass the stretch δ of each of the joint's springs and the q
            motions; and the directions L of the springs, δ = Lᵀx with x the joint's motion.
        """
        directions, stiffness = springs(matrices)
        free, motions = self._free(as_factors(factors, len(matrices)))
        joined, rest = np.ascontiguousarray(motions[:, : self._r]), np.ascontiguousarray(motions[:, self._r :])
        batch, m = len(matrices), free.shape[1]
        lam = np.empty((batch, m))
        rows = np.empty((batch, motions.shape[1], m))
        work, w = workspace(m, rows.shape[1])
        add_springs(free, joined, rest, directions, stiffness, self._shift, lam, rows, work, w)
        for i in np.flatnonzero((stiffness < 0).any(axis=1)):
            # a joint that releases energy is met on the way to another one only: the plain eigenproblem will do
            j = i if len(free) > 1 else 0
            dense = np.diag(free[j]) + joined[j].T @ matrices[i] @ joined[j]
            lam[i], vectors = np.linalg.eigh(dense)
            rows[i] = np.vstack([directions[i].T @ joined[j], rest[j]]) @ vectors
        return lam, rows, directions
