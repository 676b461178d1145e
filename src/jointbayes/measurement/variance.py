"""Variance of measured FRFs: from coherence and averages, from repeated measurements, or stated."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import MeasurementError
from jointbayes.frf import FrfSet
from jointbayes.measurement.virtual.synthetic import RelativeNoise

__all__ = ["coherence_variance", "mean_of_repeats", "measured_variance"]

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


def mean_of_repeats(frfs: Sequence[FrfSet], floor: float = 1e-3) -> tuple[FrfSet, Array]:
    """Mean of repeated measurements of the same FRFs, and its variance from their scatter.

    σ² = Σ|H_i − H̄|²/(m(m − 1)) for m repetitions, line by line. It counts all that differs from one to the next,
    also what no coherence shows: a sensor taken off and mounted again, a joint tightened anew. But it is the variance
    of the *mean*: what all repetitions have in common, such as a calibration, it does not see. Residuals over it are
    Student-t with 2(m − 1) degrees of freedom: three repetitions leave four of them.

    Parameters
    ----------
    frfs
        At least two sets with the same lines, DOFs and quantity.
    floor
        Least standard deviation of each part, as a fraction of |H̄|.

    Returns
    -------
    mean : FrfSet
        Without coherence: none belongs to a mean of FRFs. Averages are those of all sets together, where all tell.
    variance : ndarray, shape (lines, outputs, inputs)
        Variance of the mean, both parts together.

    Raises
    ------
    MeasurementError
        If there are fewer than two, they do not match, all are the same, or `floor` is negative.
    """
    where = "noise from repeats"
    if not floor >= 0:
        raise MeasurementError(f"{where}: found a floor of {floor:g}; expected 0 or more; correct it")
    if len(frfs) < 2:
        raise MeasurementError(
            f"{where}: found {len(frfs)} measurement; expected two or more; measure again, or state the noise"
        )
    first = frfs[0]
    for number, other in enumerate(frfs[1:], 2):
        for what, same in (
            ("lines", np.array_equal(first.frequency_hz, other.frequency_hz)),
            ("DOFs", (first.outputs, first.inputs) == (other.outputs, other.inputs)),
            ("quantity", first.quantity == other.quantity),
        ):
            if not same:
                raise MeasurementError(
                    f"{where}: found other {what} in measurement {number} than in the first; expected the same; "
                    "leave it out or bring it to the same"
                )
    values = np.stack([frf.values for frf in frfs])
    m, mean = len(frfs), values.mean(axis=0)
    scatter = np.sum(np.abs(values - mean) ** 2, axis=0) / (m * (m - 1))
    if not scatter.any():
        raise MeasurementError(
            f"{where}: found {m} measurements that are the same to the last digit; expected independent ones, which "
            "differ by their noise; do not repeat one file"
        )
    counts = [frf.averages for frf in frfs]
    averages = None if None in counts else sum(n for n in counts if n is not None)
    combined = replace(first, values=mean, coherence=None, averages=averages)
    return combined, np.maximum(scatter, 2 * (floor * np.abs(mean)) ** 2)


def measured_variance(frf: FrfSet, law: RelativeNoise | None = None, floor: float = 1e-3) -> Array:
    """Variance by coherence where it tells something, else by a stated law.

    Parameters
    ----------
    frf
        FRFs, with or without coherence and averages.
    law
        Stated noise for FRFs from one average, or whose coherence or averages the file does not tell; it is of no
        effect otherwise.
    floor
        As for `coherence_variance`.

    Returns
    -------
    ndarray, shape (lines, outputs, inputs)

    Raises
    ------
    MeasurementError
        As `coherence_variance` does; for a single average or missing coherence only without `law`.
    """
    silent = frf.coherence is None or frf.averages is None or frf.averages < 2
    if silent and law is not None:
        return law.variance(frf.values)
    return coherence_variance(frf, floor)
