"""Peaks of a curve that stand out from their surroundings."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def prominent_peaks(curve: ArrayLike, least: float) -> NDArray[np.intp]:
    """Numbers of the maxima of a curve whose prominence is `least` or more.

    Prominence: by how much the curve falls, on both sides, before it rises above the peak or ends. As
    `scipy.signal.find_peaks` finds them (of a flat top here the first point), which takes 0.3 s to load.

    Parameters
    ----------
    curve
        Values, shape (n,), all finite.
    least
        Least prominence, in the unit of the curve, above 0.

    Examples
    --------
    >>> prominent_peaks([0.0, 3.0, 2.5, 4.0, 1.0, 1.2, 0.0], 1.0)
    array([3])
    """
    values = np.asarray(curve, dtype=float).tolist()
    peaks = []
    rising, low, top, at = True, np.inf, -np.inf, 0
    for i, value in enumerate(values):
        if rising:
            if value > top:
                top, at = value, i
            elif top - low < least and value < low:  # what rose so far was a ripple on the way down
                low, top = value, value
            elif top - low >= least and top - value >= least:
                peaks.append(at)
                rising, low = False, value
            low = min(low, value) if top - low < least else low
        elif value < low:
            low = value
        elif value - low >= least:
            rising, top, at = True, value, i
    return np.array(peaks, dtype=np.intp)
