"""The band that a test drove, as the coherence of its FRFs shows it."""

import numpy as np
import scipy  # its parts load at first use

from vibrecords.arrays import Array

#: Coherence of lines that were driven, and below which a stretch of lines was not, and how the noise rises there.
GOOD, BAD, RISE = 0.9, 0.5, 5.0
#: Fewer lines than this are all judged. One stretch is so large a share of them; a resonance is told by so many.
_FEWEST, _STRETCH, _FEW = 160, 1 / 40, 5


def driven_lines(coherence: Array, noise: Array) -> slice:
    """Lines from the first to the last that were driven.

    Outside these no stretch of the lines has a median of 0.5 and no five lines, as of one resonance, a median of 0.9.
    An end is left out only if it is longer than a stretch and its noise over the force five times that of the rest: else
    it is the response that is small. The median of what is left must be 0.9: other FRFs are too noisy to tell.

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
    wide, narrow = (scipy.ndimage.median_filter(coherence, n, mode="nearest") for n in (stretch, _FEW))
    told = np.flatnonzero((wide >= BAD) | (narrow >= GOOD))
    if not told.size or np.median(coherence[told[0] : told[-1] + 1]) < GOOD:
        return slice(0, count)
    first, last = int(told[0]), int(told[-1]) + 1
    most = RISE * np.median(noise[first:last])
    return slice(
        first if first > stretch and np.median(noise[:first]) > most else 0,
        last if count - last > stretch and np.median(noise[last:]) > most else count,
    )
