"""Receptances by exact low-rank coupling of a joint to the structure without it.

H_ab = A_ab − A_aj (C + A_jj)⁻¹ A_jb with A the receptance without the joint and C = (K^J)⁻¹ (Woodbury),
written with K^J itself, A_aj K^J (1 + A_jj K^J)⁻¹ A_jb, so that an absent joint is as good as a stiff one.
An r × r problem per line, whatever the number of FE DOFs.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.frf.direct import dynamic_stiffness
from jointbayes.frf.ports import Ports, as_batch, split_along
from jointbayes.joint import Joint
from jointbayes.structure import ModalDamping, Structure

__all__ = ["LowRankCoupling"]


class LowRankCoupling:
    """Assembled receptance where damping belongs to the structure without the joint.

    Parameters
    ----------
    structure
        Structure with loss-factor or Rayleigh damping.
    joint
        Where the joint acts, r DOFs.
    ports
        Lines, outputs and inputs.

    Raises
    ------
    ModelError
        If the damping law is modal: its modes are those of the assembled structure, see `AssembledModes`.
    """

    def __init__(self, structure: Structure, joint: Joint, ports: Ports) -> None:
        if isinstance(structure.damping, ModalDamping):
            raise ModelError(
                "low-rank coupling: found modal damping of the assembled structure; expected a loss factor or "
                "Rayleigh damping; use the modal sum instead"
            )
        joined, outputs, inputs = ports.selections(structure, joint)
        along, rest = split_along(np.hstack([outputs, inputs]), joined)
        driven = np.hstack([joined, rest])
        blocks = dynamic_stiffness(structure, ports.omega)
        free = np.concatenate([driven.T @ np.linalg.solve(z, driven.astype(complex)) for z in blocks])
        free = _symmetric(free)
        r, self._n_out = joined.shape[1], len(ports.outputs)
        self._jj, self._jp, self._pp = free[:, :r, :r], free[:, :r, r:], free[:, r:, r:]
        self._along = along

    def receptance(self, stiffness: ArrayLike) -> NDArray[np.complex128]:
        """Receptances for joint matrices of shape (r, r) or (batch, r, r): shape (batch, lines, outputs, inputs)."""
        value, _ = self._solve(as_batch(stiffness)[:, None])
        return value

    def tangent(
        self, stiffness: ArrayLike, directions: ArrayLike
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Receptance and its derivative along p changes of one joint matrix.

        Parameters
        ----------
        stiffness
            K^J, shape (r, r).
        directions
            Changes dK^J, shape (p, r, r).

        Returns
        -------
        receptance, derivative : ndarray, shapes (lines, outputs, inputs) and (p, lines, outputs, inputs)
        """
        value, at_joint = self._solve(np.asarray(stiffness, dtype=float))
        change = np.asarray(directions, dtype=float)[:, None]
        from_joint = at_joint[..., : self._n_out].swapaxes(-1, -2)
        return value, -from_joint @ change @ at_joint[..., self._n_out :]

    def _solve(self, matrices: NDArray[np.float64]) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Assembled receptance outputs × inputs, and from all ports (outputs, then inputs) to the joint."""
        # products that are symmetric in exact arithmetic are made so, which keeps reciprocity to the last bits
        remaining = np.linalg.inv(np.eye(matrices.shape[-1]) + self._jj @ matrices)
        h_jj = _symmetric(remaining @ self._jj)  # (1 + A_jj K)⁻¹ A_jj
        h_jp = remaining @ self._jp
        n = self._n_out
        at_joint = h_jj @ self._along + h_jp
        out, into = self._along[:, :n].T, self._along[:, n:]
        coupled = _symmetric(matrices @ remaining)
        rest = self._pp[:, :n, n:] - self._jp[..., :n].swapaxes(-1, -2) @ coupled @ self._jp[..., n:]
        crossed = h_jp[..., :n].swapaxes(-1, -2) @ into
        return out @ at_joint[..., n:] + crossed + rest, at_joint


def _symmetric(matrices: NDArray[np.complex128]) -> NDArray[np.complex128]:
    return (matrices + matrices.swapaxes(-1, -2)) / 2
