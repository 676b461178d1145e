"""Receptances by solving the assembled dynamic stiffness at each line: slow, and the reference."""

import numpy as np

from jointbayes.errors import require
from jointbayes.frf.modal import rigid_body_modes
from jointbayes.frf.ports import Ports
from jointbayes.joint import AnyJoint, AnyJointMatrix, joint_matrix_of
from jointbayes.structure import Structure
from vibrecords.arrays import ComplexArray


class DirectSolve:
    """Assembled receptance by a dense solve per line.

    Parameters
    ----------
    structure
        Structure without the joint; any damping law.
    joint
        Where the joint acts.
    ports
        Lines, outputs and inputs.
    """

    def __init__(self, structure: Structure, joint: AnyJoint, ports: Ports) -> None:
        self._structure, self._omega = structure, ports.omega
        require(structure, Structure, "direct solve: found", "a Structure, with matrices; use receptance_model")
        self._joined = joint.selection(structure)
        self._outputs, self._inputs = map(structure.unit_forms, (ports.outputs, ports.inputs))
        # of a joint that happens to be absent, the motions that it would hold are modes all the same
        self._rigid = rigid_body_modes(structure, joint) if structure.damping.of_assembled_modes else None

    def receptance(self, matrices: AnyJointMatrix) -> ComplexArray:
        """Receptances for joint matrices of shape (r, r) or (batch, r, r): shape (batch, lines, outputs, inputs)."""
        batch = joint_matrix_of(matrices).batch
        each = []
        for i in range(len(batch)):
            k, c, h = (self._joined @ side @ self._joined.T for side in batch[i].sides)
            each.append(self._structure.solve_lines(self._omega, self._outputs, self._inputs, k, c, h, self._rigid))
        return np.stack(each)
