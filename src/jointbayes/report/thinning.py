"""Fewer points for a curve that looks the same: on paper, and zoomed in."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array

Indices = NDArray[np.intp]

_FIRST_STRIDE = 64


def extremes(values: Array, stretches: int) -> Indices:
    """Places of the lowest and the highest value of each stretch of a curve, in order, so that no peak is lost.

    Parameters
    ----------
    values
        The curve, shape (n,); what is not finite is left out.
    stretches
        Number of stretches. A curve of at most twice as many points keeps all.
    """
    places = np.flatnonzero(np.isfinite(values))
    if places.size <= 2 * stretches:
        return places
    edges = np.linspace(0, places.size, stretches + 1).astype(int)
    finite = values[places]
    kept = [start + pick(finite[start:end]) for start, end in pairwise(edges) for pick in (np.argmin, np.argmax)]
    return places[np.unique(kept)]


def points_of_polyline(x: Array, values: Array, tolerance: float) -> Indices:
    """Places of points whose connecting lines miss none of the others by more than `tolerance`, in order.

    Noise keeps every point, a smooth curve few.

    Parameters
    ----------
    x
        Abscissae, shape (n,), increasing.
    values
        One or more curves over them, shape (n,) or (n, curves), all finite.
    tolerance
        Largest deviation, in the unit of the curves.
    """
    curves = values.reshape(len(values), -1).T
    keep = np.arange(len(x)) % _FIRST_STRIDE == 0
    keep[-1] = True
    while True:
        at = np.flatnonzero(keep)
        missed = np.zeros(len(x), dtype=bool)
        for curve in curves:
            missed |= np.abs(np.interp(x, x[at], curve[at]) - curve) > tolerance
        if not missed.any():
            return at
        left = np.unique(np.searchsorted(at, np.flatnonzero(missed), "right")) - 1
        keep[(at[left] + at[left + 1]) // 2] = True
