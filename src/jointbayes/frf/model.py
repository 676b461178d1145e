"""The forward model that inference uses, chosen by the structure's damping law."""

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.frf.coupling import LowRankCoupling
from jointbayes.frf.modal import AssembledModes
from jointbayes.frf.ports import Misfit, Ports
from jointbayes.joint import Joint
from jointbayes.structure import ModalDamping, Structure

__all__ = ["ReceptanceModel", "receptance_model"]


class ReceptanceModel(Protocol):
    """Receptance of a structure with its joint as a function of K^J; see `LowRankCoupling`, `AssembledModes`."""

    def receptance(self, stiffness: ArrayLike) -> NDArray[np.complex128]:
        """Receptances, shape (batch, lines, outputs, inputs), for joint matrices (r, r) or (batch, r, r)."""
        ...

    def tangent(
        self, stiffness: ArrayLike, directions: ArrayLike
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Receptance (lines, outputs, inputs) and derivative (p, lines, outputs, inputs) of one joint matrix."""
        ...

    def misfit(self, measured: NDArray[np.complex128], weight: NDArray[np.float64]) -> Misfit:
        """χ² against measured receptances (lines, outputs, inputs) with weights 1/σ, as a function of the joint."""
        ...


def receptance_model(structure: Structure, joint: Joint, ports: Ports) -> ReceptanceModel:
    """Return the exact low-rank forward model for the structure's damping law.

    Raises
    ------
    ModelError
        If a DOF does not exist.
    """
    if isinstance(structure.damping, ModalDamping):
        return AssembledModes(structure, joint, ports)
    return LowRankCoupling(structure, joint, ports)
