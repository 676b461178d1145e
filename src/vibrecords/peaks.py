"""The resonances that a measurement shows: peaks that stand out of the noise."""

from itertools import pairwise

import numpy as np
import scipy  # its parts load at first use

from vibrecords.arrays import Array, ComplexArray, stretch_about
from vibrecords.data import Data, FrfData

#: Least prominence of a peak, in ln |H|, and least height, in standard deviations of the noise there. Without the
#: second condition a ripple of the noise between two resonances counts as one.
PROMINENCE, LEAST_SD = 1.0, 8.0
#: Lines within this fraction of the peak's height belong to it.
_SHOULDER = 0.5
#: Peaks of different FRFs that are nearer than this, in lines and relative to the frequency, are one resonance.
_SAME_LINES, _SAME = 2.0, 0.005


def resonances_hz(data: Data) -> Array:
    """Natural frequencies that the data show, rising, shape (n,), Hz.

    Of measured natural frequencies these themselves. Of FRFs the peaks of the receptances, those of all pairs of DOFs
    merged: prominent by more than one in ln |H|, and higher than eight standard deviations of the noise. A mode with a
    node at every response shows none.

    Parameters
    ----------
    data
        FRFs with variances, natural frequencies, or modes; of other data there are none.
    """
    if data.modes is not None:
        return np.sort(data.modes.frequency_hz)
    frfs = data.frfs
    if frfs is None or frfs.frf.n_lines < 3:
        return np.empty(0)
    frequency, receptances = frfs.frf.frequency_hz, frfs.frf.converted("receptance").values
    ratios, roots = np.abs(frfs.frf.values) / np.sqrt(frfs.variance), []
    for o, i in np.ndindex(receptances.shape[1:]):
        values, ratio = receptances[:, o, i], ratios[:, o, i]
        places = peak_places(frfs, values, o, i)
        roots += [(_interpolate_frequency(frequency, values, ratio, k), float(ratio[k])) for k in places]
    if not roots:
        return np.empty(0)
    # one frequency for each group of neighbours, of the peak which stands out of the noise most
    peaks = np.array(sorted(roots, key=lambda root: root[0]))
    near = np.maximum(_SAME_LINES * float(np.median(np.diff(frequency))), _SAME * peaks[1:, 0])
    cuts = [0, *(np.flatnonzero(np.diff(peaks[:, 0]) > near) + 1).tolist(), len(peaks)]
    return np.array([peaks[a + int(np.argmax(peaks[a:b, 1])), 0] for a, b in pairwise(cuts)])


def peak_places(data: FrfData, values: ComplexArray, output: int, input_: int) -> list[int]:
    """Lines of the peaks of one FRF, with its receptance (lines,), that stand out of the noise."""
    ratio = np.abs(data.frf.values[:, output, input_]) / np.sqrt(data.variance[:, output, input_])
    with np.errstate(divide="ignore"):  # a measured zero is no peak
        log_magnitude = np.log(np.abs(values))
    if not np.isfinite(log_magnitude).any():
        return []
    log_magnitude[~np.isfinite(log_magnitude)] = log_magnitude[np.isfinite(log_magnitude)].min()
    peaks = scipy.signal.find_peaks(log_magnitude, prominence=PROMINENCE)[0]
    return [int(k) for k in peaks if ratio[k] > LEAST_SD]


def _interpolate_frequency(frequency: Array, values: ComplexArray, ratio: Array, peak: int) -> float:
    """Frequency of a peak between its lines: the zero of Re 1/H, which near one mode is linear in ω².

    Each line counts by the variance of 1/H, which goes with 1/(|H| ratio)². Lines coarser than the peak is wide miss
    its top by up to half a line.
    """
    magnitude = np.abs(values)
    first, last = shoulders(magnitude, peak)
    near = slice(min(first, peak - 1), max(last, peak + 1) + 1)
    square = (frequency[near] / frequency[peak]) ** 2 - 1
    weight = magnitude[near] * ratio[near] / (magnitude[peak] * ratio[peak])
    inverse = (values[peak] / values[near] / (values[peak] / magnitude[peak])).real
    slope, level = np.polyfit(square, inverse, 1, w=weight)
    at = frequency[peak] * np.sqrt(max(1 - level / slope, 0.0)) if slope != 0 else frequency[peak]
    return float(at if frequency[near][0] < at < frequency[near][-1] else frequency[peak])


def shoulders(magnitude: Array, peak: int) -> tuple[int, int]:
    """First and last line about a peak between which the magnitude stays above half of the peak's."""
    first, end = stretch_about(magnitude <= _SHOULDER * magnitude[peak], peak)
    return first, end - 1
