"""The band that a test drove, as the coherence of its FRFs shows it."""

import numpy as np
import scipy  # its parts load at first use

from vibrecords.arrays import Array

#: Coherence of lines that were driven, and below which a stretch of lines was not, and how the noise rises there.
GOOD, BAD, RISE = 0.9, 0.5, 5.0
#: Fewer lines than this are all judged. One stretch is so large a share of them; coherence of three lines of a mode.
_FEWEST, _STRETCH, _MODE = 160, 1 / 40, 0.8


def driven_lines(coherence: Array, noise: Array) -> slice:
    """Lines from the first to the last that were driven.

    Outside these no stretch of the lines has a median of 0.5 and no three lines, as of one mode, a mean of 0.8.
    An end is left out only if it is longer than a stretch and its noise over the force five times the rest's:
    else it is the response that is small. The median of what is left must be 0.9: other FRFs are too noisy.

    Parameters
    ----------
    coherence
        γ² of an FRF, or the largest of several, shape (lines,).
    noise
        Standard deviation of the FRF in the quantity that was measured, in any unit, shape (lines,).
    """
    count = coherence.size
    stretch = 2 * int(count * _STRETCH / 2) + 1
    if count < _FEWEST:
        return slice(0, count)
    wide = scipy.ndimage.median_filter(coherence, stretch, mode="reflect")
    narrow = scipy.ndimage.uniform_filter1d(coherence, 3, mode="nearest")
    told = np.flatnonzero((wide >= BAD) | (narrow >= _MODE))
    if not told.size or np.median(coherence[told[0] : told[-1] + 1]) < GOOD:
        return slice(0, count)
    first, last = int(told[0]), int(told[-1]) + 1
    most = RISE * np.median(noise[first:last])
    return slice(
        first if first > stretch and np.median(noise[:first]) > most else 0,
        last if count - last > stretch and np.median(noise[last:]) > most else count,
    )
