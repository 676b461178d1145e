"""Variance of measured FRFs: by a stated law, from coherence and averages, or from repeated measurements."""

from dataclasses import dataclass

import numpy as np

from vibrecords.arrays import Array, ComplexArray, quantity_factor
from vibrecords.errors import MeasurementError, refusal
from vibrecords.frf_set import FrfSet

#: Coherence this close to 1 is 1 to the last bits.
_ONE = 1 - 1e-12


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
            found = f"found relative {self.relative:g} and floor {self.floor:g}"
            raise MeasurementError.of("noise", ("relative",), found, "both 0 or more, not both 0", "correct them")

    def sd_of_part(self, magnitude: Array) -> Array:
        """Standard deviation of real and of imaginary part, shape as |H| (lines first)."""
        return self.relative * magnitude + self.floor * np.median(magnitude, axis=0)

    def variance(self, values: ComplexArray) -> Array:
        """σ² = E|δH|², both parts together, shape as `values` (lines, outputs, inputs)."""
        return 2 * self.sd_of_part(np.abs(values)) ** 2

    def variance_of_accelerance(self, frf: FrfSet) -> Array:
        """σ² by the law of the accelerance, for FRFs kept in any quantity; shape as ``frf.values``."""
        factor = np.abs(quantity_factor(frf.frequency_hz, "accelerance", frf.quantity))[:, None, None]
        return np.asarray(2 * (self.sd_of_part(np.abs(frf.values) * factor) / factor) ** 2)


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
            found = f"coherence {self.coherence:g}, {self.averages} averages, floor {self.floor:g}"
            expected = "a coherence between 0 and 1, at least 2 averages and a floor of at least 0"
            raise refusal("noise", found, expected, "correct them")

    def variance(self, values: ComplexArray) -> Array:
        """σ² = E|δH|², both parts together, shape as `values` (lines, outputs, inputs)."""
        relative = np.sqrt((1 - self.coherence) / (2 * self.averages * self.coherence))
        return RelativeNoise(float(relative), self.floor).variance(values)


NoiseLaw = RelativeNoise | CoherenceNoise


def coherence_variance(frf: FrfSet) -> Array:
    """Variance σ² = E|δH|² of H1 estimates at each line, σ² = |H|²(1 − γ²)/((n − 1)γ²).

    Bendat and Piersol give 1/n with the true coherence γ². With the *estimated* one, which is what an analyser writes,
    |H|²(1 − γ²)/γ² is the residual sum of squares of a regression on n averages over Σ|x|², and n − 1 makes it unbiased
    for any n and any input. It counts random noise at the output only: not bias, leakage, noise at the input or
    nonlinearity.

    Each variance is an estimate from n − 1 degrees of freedom, so that residuals over it are Student-t, not Gaussian:
    `StudentNoise(dof=2 * (n - 1))` is exact.

    Parameters
    ----------
    frf
        FRFs with coherence and number of averages, independent ones: overlapping windows count for less.

    Returns
    -------
    ndarray, shape (lines, outputs, inputs)
        Variance of both parts together, in the square of the FRFs' unit.

    Raises
    ------
    MeasurementError
        If the FRFs do not tell coherence and averages, there is one average only, the coherence of an FRF is 1
        throughout, or zero somewhere.

    References
    ----------
    Bendat, J. S., Piersol, A. G. (2010). Random Data, 4th ed., section 9.2. DOI 10.1002/9781118032428
    """
    where = "noise from coherence"
    if frf.coherence is None or frf.averages is None:
        found = "no coherence" if frf.coherence is None else "no number of averages"
        remedy = 'add them, or write in [data.variance] source = "relative", relative = 0.02, floor = 0.01'
        raise refusal(where, found, "both coherence and averages", remedy)
    if frf.averages < 2:
        expected = "2 or more, since coherence of one average is 1 whatever the noise"
        raise refusal(where, f"{frf.averages} average", expected, "average more or state the noise as relative")
    coherence, magnitude = frf.coherence, np.abs(frf.values)
    perfect = np.argwhere((coherence >= _ONE).all(axis=0))
    if perfect.size:
        pair = f"{frf.outputs[perfect[0][0]]!r} over {frf.inputs[perfect[0][1]]!r}"
        found = f"a coherence of 1 at every line of {pair}"
        expected = "values below 1, since this one tells nothing of the noise"
        raise refusal(where, found, expected, "check how it was estimated or state the noise as relative")
    if not (coherence > 0).all():
        line = int(np.argwhere(~(coherence > 0))[0][0])
        raise refusal(where, f"a coherence of 0 at {frf.frequency_hz[line]:g} Hz", "values above 0", "drop the line")
    return magnitude**2 * (1 - coherence) / ((frf.averages - 1) * coherence)
