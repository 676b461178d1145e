"""The resonances that a measurement shows."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from jointbayes.measurement import FrequencyMeasurement, FrfMeasurement, Measurement
from jointbayes.measurement.modal.peaks import prominent_peaks

__all__ = ["resonances_hz"]

Array = NDArray[np.float64]

#: Least prominence of a peak, in ln |H|, and least height, in standard deviations of the noise there. Without the
#: second condition a ripple of the noise between two resonances counts as one.
PROMINENCE, LEAST_SD = 1.0, 8.0
#: Lines within this fraction of the peak's height give its frequency.
_SHOULDER = 0.5
#: Peaks of different FRFs that are nearer than this, in lines and relative to the frequency, are one resonance.
_SAME_LINES, _SAME = 2.0, 0.005


def resonances_hz(measurement: Measurement) -> Array:
    """Natural frequencies that the data show, rising, shape (n,), Hz.

    Of measured natural frequencies these themselves. Of FRFs the peaks of the receptances, those of all pairs of DOFs
    merged: prominent by more than one in ln |H|, and higher than eight standard deviations of the noise. A mode with a
    node at every response shows none.

    Parameters
    ----------
    measurement
        FRFs with variances, or natural frequencies.
    """
    if isinstance(measurement, FrequencyMeasurement):
        return np.array(measurement.frequency_hz)
    frequency = measurement.frf.frequency_hz
    if frequency.size < 3:
        return np.empty(0)
    found = [
        peak
        for output in range(len(measurement.frf.outputs))
        for input_ in range(len(measurement.frf.inputs))
        for peak in _peaks(measurement, output, input_)
    ]
    return _merged(np.array(found).reshape(-1, 2), float(np.median(np.diff(frequency))))


def _peaks(measurement: FrfMeasurement, output: int, input_: int) -> list[tuple[float, float]]:
    """Frequency in Hz and height over the noise of each peak of one FRF."""
    frf = measurement.frf.converted("receptance")
    values, frequency = frf.values[:, output, input_], frf.frequency_hz
    height = np.abs(measurement.frf.values[:, output, input_])
    ratio = height / np.sqrt(measurement.variance[:, output, input_])
    with np.errstate(divide="ignore"):  # a measured zero is no peak
        log_magnitude = np.log(np.abs(values))
    if not np.isfinite(log_magnitude).any():
        return []
    log_magnitude[~np.isfinite(log_magnitude)] = log_magnitude[np.isfinite(log_magnitude)].min()
    peaks = prominent_peaks(log_magnitude, PROMINENCE)
    return [(_between_lines(frequency, values, ratio, int(k)), float(ratio[k])) for k in peaks if ratio[k] > LEAST_SD]


def _between_lines(frequency: Array, values: NDArray[np.complex128], ratio: Array, peak: int) -> float:
    """Frequency of a peak between its lines: the zero of Re 1/H, which near one mode is linear in ω².

    Each line counts by the variance of 1/H, which goes with 1/(|H| ratio)². Lines coarser than the peak is wide miss
    its top by up to half a line.
    """
    magnitude = np.abs(values)
    first = last = peak
    while first > 0 and magnitude[first - 1] > _SHOULDER * magnitude[peak]:
        first -= 1
    while last < len(values) - 1 and magnitude[last + 1] > _SHOULDER * magnitude[peak]:
        last += 1
    part = slice(min(first, peak - 1), max(last, peak + 1) + 1)
    square = (frequency[part] / frequency[peak]) ** 2 - 1
    weight = magnitude[part] * ratio[part] / (magnitude[peak] * ratio[peak])
    inverse = (values[peak] / values[part] / (values[peak] / magnitude[peak])).real
    slope, level = np.polyfit(square, inverse, 1, w=weight)
    found = frequency[peak] * np.sqrt(max(1 - level / slope, 0.0)) if slope != 0 else frequency[peak]
    inside = frequency[part][0] < found < frequency[part][-1]
    return float(found if inside else frequency[peak])


def _merged(peaks: Array, spacing: float) -> Array:
    """One frequency for each group of neighbours, that of the peak which stands out of the noise most."""
    if not len(peaks):
        return np.empty(0)
    peaks = peaks[np.argsort(peaks[:, 0])]
    gap = np.diff(peaks[:, 0]) > np.maximum(_SAME_LINES * spacing, _SAME * peaks[1:, 0])
    cuts = [0, *(np.flatnonzero(gap) + 1).tolist(), len(peaks)]
    return np.array([peaks[a + int(np.argmax(peaks[a:b, 1])), 0] for a, b in pairwise(cuts)])
