"""Modes of the assembled structure from the modes of the structure without its joint, spring by spring.

In the free modes (eigenvalues Λ, shapes φ_j at the joint) the assembled eigenproblem is Λ + φ_jᵀ K^J φ_j:
diagonal plus rank r, with as many rows as modes kept and no FE matrix in sight.
"""

import numpy as np
from numpy.typing import NDArray

from jointbayes.frf.secular import add_springs, workspace
from jointbayes.frf.springs import springs
from jointbayes.joint import Joint
from jointbayes.structure import Structure, mode_shift

__all__ = ["JoinedModes"]

Array = NDArray[np.float64]


class JoinedModes:
    """Assembled eigenvalues, and motions in the assembled modes, for any joint matrix from absent to rigid.

    Parameters
    ----------
    structure, joint
        Structure without the joint, and where the joint acts, r DOFs.
    motions
        What else to know of each mode, as forms on the DOFs, shape (DOFs, q).
    """

    def __init__(self, structure: Structure, joint: Joint, motions: Array) -> None:
        modes = structure.modes()
        self._shift = mode_shift(structure)
        self._free = modes.eigenvalues
        self._joined = np.ascontiguousarray((modes.shapes.T @ joint.selection(structure)).T)
        self._rest = np.ascontiguousarray((modes.shapes.T @ motions).T)

    def solve(self, matrices: Array) -> tuple[Array, Array, Array]:
        """Assembled modes for joint matrices (batch, r, r), symmetric.

        Returns
        -------
        eigenvalues, rows, directions : ndarray, shapes (batch, m), (batch, r + q, m), (batch, r, r)
            Eigenvalues rising; in each mode of unit modal mass the stretch δ of each of the joint's springs and the q
            motions; and the directions L of the springs, δ = Lᵀx with x the joint's motion.
        """
        directions, stiffness = springs(matrices)
        (r, m), batch = self._joined.shape, len(matrices)
        lam = np.empty((batch, m))
        rows = np.empty((batch, r + len(self._rest), m))
        work, w = workspace(m, rows.shape[1])
        add_springs(self._free, self._joined, self._rest, directions, stiffness, self._shift, lam, rows, work, w)
        for i in np.flatnonzero((stiffness < 0).any(axis=1)):
            # a joint that releases energy is met on the way to another one only: the plain eigenproblem will do
            dense = np.diag(self._free) + self._joined.T @ matrices[i] @ self._joined
            lam[i], vectors = np.linalg.eigh(dense)
            rows[i] = np.vstack([directions[i].T @ self._joined, self._rest]) @ vectors
        return lam, rows, directions
