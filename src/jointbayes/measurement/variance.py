"""Variance of measured FRFs from their coherence and number of averages."""

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import MeasurementError
from jointbayes.frf import FrfSet

__all__ = ["coherence_variance"]

Array = NDArray[np.float64]

#: Coherence this close to 1 is 1 to the last bits.
_ONE = 1 - 1e-12


def coherence_variance(frf: FrfSet, floor: float = 1e-3) -> Array:
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
    floor
        Least standard deviation of each part, as a fraction of |H|: a coherence rounded to 1 says no more than this.

    Returns
    -------
    ndarray, shape (lines, outputs, inputs)
        Variance of both parts together, in the square of the FRFs' unit.

    Raises
    ------
    MeasurementError
        If the FRFs do not tell coherence and averages, there is one average only, the coherence of an FRF is 1
        throughout, zero somewhere, or `floor` is negative.

    References
    ----------
    Bendat, J. S., Piersol, A. G. (2010). Random Data, 4th ed., section 9.2. DOI 10.1002/9781118032428
    """
    where = "noise from coherence"
    if not floor >= 0:
        raise MeasurementError(f"{where}: found a floor of {floor:g}; expected 0 or more; correct it")
    if frf.coherence is None or frf.averages is None:
        missing = "no coherence" if frf.coherence is None else "no number of averages"
        raise MeasurementError(
            f"{where}: found {missing}; expected both coherence and averages; add them or state the noise as relative"
        )
    if frf.averages < 2:
        raise MeasurementError(
            f"{where}: found {frf.averages} average; expected 2 or more, since coherence of one average is 1 "
            "whatever the noise; average more or state the noise as relative"
        )
    coherence, magnitude = frf.coherence, np.abs(frf.values)
    perfect = np.argwhere((coherence >= _ONE).all(axis=0))
    if perfect.size:
        pair = f"{frf.outputs[perfect[0][0]]!r} over {frf.inputs[perfect[0][1]]!r}"
        raise MeasurementError(
            f"{where}: found a coherence of 1 at every line of {pair}; expected values below 1, since this one tells "
            "nothing of the noise; check how it was estimated or state the noise as relative"
        )
    if not (coherence > 0).all():
        line = int(np.argwhere(~(coherence > 0))[0][0])
        raise MeasurementError(
            f"{where}: found a coherence of 0 at {frf.frequency_hz[line]:g} Hz; expected values above 0; drop the line"
        )
    variance = magnitude**2 * (1 - coherence) / ((frf.averages - 1) * coherence)
    return np.maximum(variance, 2 * (floor * magnitude) ** 2)
