"""Computed FRFs with noise: what a measurement of a structure with a known joint would give.

Without noise they are solved line by line from the assembled dynamic stiffness: slow, and the reference.
"""

import numpy as np

from jointbayes.errors import require
from jointbayes.frf.coupling import ReceptanceModel, receptance_model
from jointbayes.frf.modal import rigid_body_modes
from jointbayes.frf.ports import Ports
from jointbayes.joint import AnyJoint, AnyJointMatrix, joint_matrix_of
from jointbayes.structure import Body, Structure
from vibrecords import FrfData, FrfSet, NoiseLaw, Quantity, quantity_factor
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


def synthesise_frf(
    structure: Body,
    joint: AnyJoint,
    matrix: AnyJointMatrix,
    ports: Ports,
    noise: NoiseLaw,
    quantity: Quantity = "receptance",
    rng: np.random.Generator | None = None,
    *,
    gain: float = 1.0,
) -> FrfData:
    """FRFs of a structure with a known joint, with noise.

    Parameters
    ----------
    structure, joint
        Body without the joint at its nominal quantities, with elements much richer than those of an analysis; and
        where the joint acts.
    matrix
        True K^J, shape (r, r).
    ports
        Lines, outputs and inputs.
    noise
        Law of the noise; its variance (at the true FRF) is part of the result.
    quantity
        Receptance, mobility or accelerance.
    rng
        Source of the noise; None leaves the FRFs exact, with the variance still stated.
    gain
        Factor by which the whole measurement is off.

    Returns
    -------
    FrfData
        Marked as synthetic.
    """
    model: DirectSolve | ReceptanceModel
    if isinstance(structure, Structure):
        model = DirectSolve(structure, joint, ports)
    else:
        model = receptance_model(structure.reference(), joint, ports)
    true = model.receptance(matrix)[0]
    true = gain * true * quantity_factor(ports.frequency_hz, quantity)[:, None, None]
    variance = noise.variance(true)
    values = true
    if rng is not None:
        # FRF by FRF, so that a further output leaves the noise of the earlier ones as it was
        real, imag = np.moveaxis(rng.standard_normal((*true.shape[1:], 2, true.shape[0])), (2, 3), (0, 1))
        values = true + np.sqrt(variance / 2) * (real + 1j * imag)
    frf = FrfSet(ports.frequency_hz, values, ports.outputs, ports.inputs, quantity)
    return FrfData(frf, variance, synthetic=True)
