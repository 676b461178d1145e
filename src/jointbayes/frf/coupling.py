"""Receptances by exact low-rank coupling of a joint to the structure without it.

H_ab = A_ab − A_aj (C + A_jj)⁻¹ A_jb with A the receptance without the joint and C = (K^J)⁻¹ (Woodbury),
written with K^J itself, A_aj K^J (1 + A_jj K^J)⁻¹ A_jb, so that an absent joint is as good as a stiff one.
An r × r problem per line, whatever the number of FE DOFs.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.frf.direct import solve_lines
from jointbayes.frf.pair import PairCoupling
from jointbayes.frf.ports import Misfit, Ports, split_along
from jointbayes.frf.sweep import SweepCoupling
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
        free = solve_lines(structure, ports.omega, driven, driven)
        # reciprocity holds to the last bits if it holds here
        free = (free + free.swapaxes(-1, -2)) / 2
        form = PairCoupling if joined.shape[1] <= 2 else SweepCoupling
        self._form: PairCoupling | SweepCoupling = form(free, along, len(ports.outputs))

    def receptance(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> NDArray[np.complex128]:
        """Receptances for joint matrices of shape (r, r) or (batch, r, r): shape (batch, lines, outputs, inputs).

        The structure is exactly known here: `factors` have no columns.
        """
        return self._form.receptance(stiffness)

    def tangent(
        self, stiffness: ArrayLike, directions: ArrayLike, factors: ArrayLike | None = None
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
        return self._form.tangent(stiffness, directions)

    def misfit(self, measured: NDArray[np.complex128], weight: NDArray[np.float64]) -> Misfit:
        """Weighted distance from measured receptances, Σ |H − H^x|² w², as a function of the joint.

        Parameters
        ----------
        measured
            H^x, shape (lines, outputs, inputs), m/N and so on.
        weight
            1/σ, same shape.
        """
        return self._form.misfit(measured, weight)
