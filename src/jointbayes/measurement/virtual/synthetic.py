"""Synthetic FRFs: of the forward model or as an analyser writes them, with seeded noise of a stated law."""

import numpy as np

from jointbayes.errors import MeasurementError
from jointbayes.frf import DirectSolve, FrfSet, Ports, Quantity, ReceptanceModel, quantity_factor, receptance_model
from jointbayes.joint import AnyJoint, AnyJointMatrix
from jointbayes.measurement.data import FrfMeasurement
from jointbayes.measurement.variance import NoiseLaw
from jointbayes.structure import Structure, StructureFamily


def synthesise_frf(
    structure: Structure | StructureFamily,
    joint: AnyJoint,
    matrix: AnyJointMatrix,
    ports: Ports,
    noise: NoiseLaw,
    quantity: Quantity = "receptance",
    rng: np.random.Generator | None = None,
    *,
    gain: float = 1.0,
) -> FrfMeasurement:
    """FRFs of a structure with a known joint, with noise.

    Parameters
    ----------
    structure, joint
        Structure without the joint, or a family of them whose nominal one is taken, with elements much richer than
        those of an analysis; and where the joint acts.
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
    FrfMeasurement
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
    return FrfMeasurement(frf, variance, synthetic=True)


def noisy_frf(true: FrfSet, law: NoiseLaw, averages: int, rng: np.random.Generator) -> FrfSet:
    """H1 estimates and their coherence from `averages` averages with noise at the output.

    The noise of each average is n times that of the result, the input the same in each, as for a hammer. Then the mean
    and the sum of squares about it are independent (Cochran), so that the averages themselves need not be drawn:
    H1 = H + noise of variance σ², and γ² = |H1|²/(|H1|² + r) with r/σ² from a gamma distribution of shape n − 1.

    Parameters
    ----------
    true
        Exact FRFs.
    law
        Law of the noise that is left after averaging; its σ² is taken at the exact FRF.
    averages
        Number n of averages; a single one has no coherence that says anything, and gets none.
    rng
        Source of the noise.

    Returns
    -------
    FrfSet
        With coherence and averages.

    Raises
    ------
    MeasurementError
        If there is not at least one average.

    References
    ----------
    Bendat, J. S., Piersol, A. G. (2010). Random Data, 4th ed., section 9.2. DOI 10.1002/9781118032428
    """
    if averages < 1:
        raise MeasurementError(f"virtual test: found {averages} averages; expected 1 or more; correct it")
    variance = law.variance(true.values)
    real, imag = rng.standard_normal((2, *true.values.shape))
    values = true.values + np.sqrt(variance / 2) * (real + 1j * imag)
    coherence = None
    if averages > 1:
        rest = variance * rng.standard_gamma(averages - 1, true.values.shape)
        coherence = np.abs(values) ** 2 / (np.abs(values) ** 2 + rest)
    return FrfSet(true.frequency_hz, values, true.outputs, true.inputs, true.quantity, coherence, averages)


def channel_label(dof: str) -> str:
    """Label of a DOF as files of universal format have it.

    Examples
    --------
    >>> channel_label("11:y"), channel_label("1:rz")
    ('Point:11:Y+', 'Point:1:RZ+')
    """
    node, direction = dof.split(":")
    return f"Point:{node}:{direction.upper()}+"
