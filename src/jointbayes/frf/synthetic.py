"""Computed FRFs with noise: what a measurement of a structure with a known joint would give."""

import numpy as np

from jointbayes.frf.coupling import receptance_model
from jointbayes.frf.direct import DirectSolve
from jointbayes.frf.ports import Ports, ReceptanceModel
from jointbayes.joint import AnyJoint, AnyJointMatrix
from jointbayes.structure import Body, Structure
from vibrecords import FrfData, FrfSet, NoiseLaw, Quantity, quantity_factor


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
