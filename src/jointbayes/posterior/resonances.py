"""Resonances that measured and predicted FRFs share, each fitted in both alike.

References
----------
Ewins, D. J. (2000). Modal testing: theory, practice and application, 2nd ed., section 4.3 (fits of one mode).
"""

import math

import numpy as np
from numpy.typing import NDArray

from jointbayes.measurement.modal.peaks import prominent_peaks

__all__ = ["SharedResonances", "fit_resonance", "median_seen"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: A resonance stands out by this in ln |H|, and by so many standard deviations of its noise.
_PROMINENCE, _ABOVE_NOISE = 1.0, 8.0
#: Lines taken for the fit of one resonance: those above this share of its peak |H|, and so many at least.
_SHARE, _FEWEST = 0.5, 5
#: Measured and predicted resonances belong together within this fraction of their frequency.
_TOGETHER = 0.2
_REPLICATES = 30


class SharedResonances:
    """Resonances that measured and predicted FRFs share, and how to fit them.

    Parameters
    ----------
    frequency_hz
        Lines, shape (lines,), Hz.
    measured, predicted
        Receptances, shape (lines, pairs), m/N.
    sd
        Standard deviation √(E|δH|²) of the measured ones, same shape.
    """

    def __init__(self, frequency_hz: Array, measured: Complex, predicted: Complex, sd: Array) -> None:
        self._f, self._want, self._sd = frequency_hz, predicted, sd
        here, there = (_peaks(values, sd) for values in (measured, predicted))
        self._matched = _matched(frequency_hz, here, there)
        fits = np.array([self._fits(predicted, p) for _, p in self._matched]).reshape(-1, predicted.shape[1], 3)
        keep = np.isfinite(fits[..., 0]).any(axis=1) if len(fits) else np.zeros(0, dtype=bool)
        self._matched = [pair for pair, kept in zip(self._matched, keep, strict=True) if kept]
        self._predicted = fits[keep]
        #: Frequency of each in the predicted FRFs, shape (modes,), Hz.
        self.predicted_hz: Array = np.exp(median_seen(self._predicted[..., 0], axis=1))
        #: ln of its damping ratio, shape (modes,).
        self.log_damping: Array = median_seen(self._predicted[..., 1], axis=1)

    def ratios(self, values: Complex) -> Array:
        """ln of frequency, damping and level over the predicted ones, shape (modes, pairs, 3); NaN where unseen."""
        fits = np.array([self._fits(values, m) for m, _ in self._matched]).reshape(self._predicted.shape)
        return fits - self._predicted

    def scatter(self, rng: np.random.Generator) -> Array:
        """Standard deviation of the same from noise alone, shape (modes, pairs, 3)."""
        white = rng.standard_normal((_REPLICATES, *self._want.shape, 2)) @ [1, 1j] / math.sqrt(2)
        copies = self._want + self._sd * white
        found = [
            np.array([self._fits(one, p) for _, p in self._matched]).reshape(self._predicted.shape) for one in copies
        ]
        with np.errstate(invalid="ignore"):
            spread: Array = np.std(found, axis=0)
        return spread

    def _fits(self, values: Complex, peak: int) -> Array:
        """ln of frequency, damping and level of one resonance in each FRF, shape (pairs, 3)."""
        return np.array([fit_resonance(self._f, np.abs(values[:, i]) ** 2, peak) for i in range(values.shape[1])])


def _peaks(values: Complex, sd: Array) -> NDArray[np.intp]:
    """Lines of the resonances, of all FRFs together."""
    scaled = np.abs(values) / np.median(np.abs(values), axis=0)
    power = np.log((scaled**2).mean(axis=1)) / 2
    found = prominent_peaks(power, _PROMINENCE)
    clear = (np.abs(values[found]) > _ABOVE_NOISE * sd[found]).any(axis=1)
    return found[clear]


def _matched(f: Array, measured: NDArray[np.intp], predicted: NDArray[np.intp]) -> list[tuple[int, int]]:
    """Lines of resonances that are each other's nearest, by rising frequency."""
    if not (measured.size and predicted.size):
        return []
    apart = np.abs(np.log(f[measured][:, None] / f[predicted]))
    return [
        (int(measured[i]), int(predicted[j]))
        for i, j in enumerate(apart.argmin(axis=1))
        if apart[:, j].argmin() == i and apart[i, j] < _TOGETHER
    ]


def fit_resonance(f: Array, power: Array, peak: int) -> Array:
    """ln of natural frequency, damping ratio and level of one mode from |H|² about a line, shape (3,); NaN if none.

    1/|H|² of a single mode is a parabola in f², whose least value is the damping, whose place the frequency and whose
    curvature the level, whatever the other two are.
    """
    here = peak + int(np.argmax(power[max(peak - 2, 0) : peak + 3])) - min(peak, 2)
    low = high = here
    while low > 0 and power[low - 1] > _SHARE**2 * power[here]:
        low -= 1
    while high < len(f) - 1 and power[high + 1] > _SHARE**2 * power[here]:
        high += 1
    short = max(0, _FEWEST - (high - low + 1))
    low, high = max(0, low - (short + 1) // 2), min(len(f) - 1, high + (short + 1) // 2)
    x = (f[low : high + 1] ** 2 - f[here] ** 2) / f[here] ** 2
    y = power[here] / power[low : high + 1]
    if len(x) < 3:
        return np.full(3, np.nan)
    square, slope, least = np.polyfit(x, y, 2, w=1 / y)
    place = -slope / (2 * square) if square > 0 else np.nan
    floor = least - slope**2 / (4 * square) if square > 0 else np.nan
    # a broad flank may put the place below 0 Hz (x = −1): that is no resonance
    if not (floor > 0 and abs(place) < min(np.ptp(x), 1.0)):
        return np.full(3, np.nan)
    frequency = f[here] * math.sqrt(1 + place)
    damping = math.sqrt(floor / square) * (f[here] / frequency) ** 2 / 2
    return np.array([math.log(frequency), math.log(damping), math.log(power[here] * f[here] ** 4 / square) / 2])


def median_seen(values: Array, axis: int) -> Array:
    """Median without NaN along an axis; NaN where there is nothing else."""
    some = np.isfinite(values).any(axis=axis)
    filled = np.where(np.expand_dims(some, axis), values, 0.0)
    return np.where(some, np.nanmedian(filled, axis=axis), np.nan)
