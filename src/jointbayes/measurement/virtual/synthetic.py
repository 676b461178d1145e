"""Synthetic measurements: the forward model by direct solve, plus seeded noise of a stated law."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import MeasurementError
from jointbayes.frf import DirectSolve, FrfSet, Ports, Quantity, ReceptanceModel, quantity_factor, receptance_model
from jointbayes.joint import Joint
from jointbayes.measurement.data import FrfMeasurement
from jointbayes.structure import Structure, StructureFamily

__all__ = ["CoherenceNoise", "NoiseLaw", "RelativeNoise", "synthesise_frf"]


@dataclass(frozen=True, slots=True)
class RelativeNoise:
    """Noise whose standard deviation, in each of real and imaginary part, is a fraction of |H| plus a floor.

    Parameters
    ----------
    relative
        Fraction of |H| at the line.
    floor
        Fraction of the median of |H| over the lines of the same FRF.

    Raises
    ------
    MeasurementError
        If a fraction is negative or both are zero.
    """

    relative: float
    floor: float

    def __post_init__(self) -> None:
        if not (self.relative >= 0 and self.floor >= 0 and self.relative + self.floor > 0):
            raise MeasurementError(
                f"noise: found relative {self.relative:g} and floor {self.floor:g}; "
                "expected both 0 or more and not both 0; correct them"
            )

    def variance(self, values: NDArray[np.complex128]) -> NDArray[np.float64]:
        """σ² = E|δH|², both parts together, shape as `values` (lines, outputs, inputs)."""
        magnitude = np.abs(values)
        sd_of_part = self.relative * magnitude + self.floor * np.median(magnitude, axis=0)
        return 2 * sd_of_part**2


@dataclass(frozen=True, slots=True)
class CoherenceNoise:
    """Noise that a coherence leaves after averaging: σ² = |H|²(1 − γ²)/(nγ²), both parts together.

    Parameters
    ----------
    coherence
        γ² at every line, between 0 and 1.
    averages
        Number n of averages, at least 2.
    floor
        Standard deviation added in each part, as a fraction of the median of |H| over the lines of the same FRF.

    Raises
    ------
    MeasurementError
        If a number is impossible.

    References
    ----------
    Bendat, J. S., Piersol, A. G. (2010). Random Data, 4th ed., section 9.2. DOI 10.1002/9781118032428
    """

    coherence: float
    averages: int
    floor: float = 0.0

    def __post_init__(self) -> None:
        if not (0 < self.coherence < 1 and self.averages >= 2 and self.floor >= 0):
            raise MeasurementError(
                f"noise: found coherence {self.coherence:g}, {self.averages} averages, floor {self.floor:g}; expected "
                "a coherence between 0 and 1, at least 2 averages and a floor of at least 0; correct them"
            )

    def variance(self, values: NDArray[np.complex128]) -> NDArray[np.float64]:
        """σ² = E|δH|², both parts together, shape as `values` (lines, outputs, inputs)."""
        magnitude = np.abs(values)
        relative = np.sqrt((1 - self.coherence) / (2 * self.averages * self.coherence))
        sd_of_part = relative * magnitude + self.floor * np.median(magnitude, axis=0)
        variance: NDArray[np.float64] = 2 * sd_of_part**2
        return variance


NoiseLaw = RelativeNoise | CoherenceNoise


def synthesise_frf(
    structure: Structure | StructureFamily,
    joint: Joint,
    stiffness: NDArray[np.float64],
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
    stiffness
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
    true = model.receptance(stiffness)[0]
    true = gain * true * quantity_factor(ports.frequency_hz, quantity)[:, None, None]
    variance = noise.variance(true)
    values = true
    if rng is not None:
        # FRF by FRF, so that a further output leaves the noise of the earlier ones as it was
        real, imag = np.moveaxis(rng.standard_normal((*true.shape[1:], 2, true.shape[0])), (2, 3), (0, 1))
        values = true + np.sqrt(variance / 2) * (real + 1j * imag)
    frf = FrfSet(ports.frequency_hz, values, ports.outputs, ports.inputs, quantity)
    return FrfMeasurement(frf, variance, synthetic=True)
