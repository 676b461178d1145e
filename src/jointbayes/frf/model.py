"""The forward model that inference uses, chosen by the structure's damping law."""

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.frf.coupling import LowRankCoupling
from jointbayes.frf.modal import AssembledModes
from jointbayes.frf.ports import Misfit, Ports
from jointbayes.frf.uncertain_coupling import UncertainCoupling
from jointbayes.joint import Joint
from jointbayes.structure import Structure, StructureFamily, as_family

__all__ = ["ReceptanceModel", "receptance_model"]


class ReceptanceModel(Protocol):
    """Receptance of a structure with its joint as a function of K^J; see `LowRankCoupling`, `AssembledModes`."""

    def receptance(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> NDArray[np.complex128]:
        """Receptances, shape (batch, lines, outputs, inputs).

        For joint matrices (r, r) or (batch, r, r) and factors on a family's quantities, (q,) or (batch, q).
        """
        ...

    def tangent(
        self, stiffness: ArrayLike, directions: ArrayLike, factors: ArrayLike | None = None
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Receptance (lines, outputs, inputs) and derivative (p, lines, outputs, inputs) of one joint matrix."""
        ...

    def misfit(self, measured: NDArray[np.complex128], weight: NDArray[np.float64]) -> Misfit:
        """χ² against measured receptances (lines, outputs, inputs) with weights 1/σ, as a function of the joint."""
        ...


def receptance_model(structure: Structure | StructureFamily, joint: Joint, ports: Ports) -> ReceptanceModel:
    """Return the exact low-rank forward model for the damping law of a structure or of a family of them.

    Raises
    ------
    ModelError
        If a DOF does not exist.
    """
    dofs = dict.fromkeys((*joint.dofs, *joint.against, *ports.outputs, *ports.inputs))
    family = as_family(structure).at(dofs, float(np.max(ports.frequency_hz)))
    if family.nominal.damping.of_assembled_modes:
        return AssembledModes(family, joint, ports)
    if family.names:
        return UncertainCoupling(family, joint, ports)
    return LowRankCoupling(family, joint, ports)
