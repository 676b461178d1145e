"""The resonances that measured FRFs share with predicted ones, each fitted in both alike, and lines enough to see them.

References
----------
Ewins, D. J. (2000). Modal testing: theory, practice and application, 2nd ed., section 4.3 (fits of one mode).
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy  # its parts load at first use

from jointbayes.inference import Problem
from vibrecords.arrays import Array, ComplexArray, Indices
from vibrecords.data import FrfData
from vibrecords.peaks import LEAST_SD, PROMINENCE, peak_places, shoulders

_FEWEST = 5  # lines of the fit of a mode, at least
#: Measured and predicted resonances belong together within this fraction of their frequency.
_TOGETHER = 0.2
#: Values of a test that a search needs, and lines that it keeps: of all, and on each peak above half of its height.
_ENOUGH_VALUES, _FEWEST_LINES, _ON_A_PEAK = 10_000, 500, 8
#: Lines in place of which one stands at most, and widths of a peak to both sides of it where they stay.
_IN_A_GROUP, _ABOUT_A_PEAK = 8, 2
_ALMOST_ALL = 1.5  # lines for each that is kept, below which leaving them out saves nothing
_ROUNDING = 1e-6  # of sums of one over whole numbers
_REPLICATES = 30


def on_fewer_lines(problem: Problem) -> Problem:
    """The problem with some of the lines of FRFs that have far more than a search needs; itself where none has.

    Each peak keeps lines enough for its shape: between lines that resolve the resonances a search learns nothing.
    """
    return _thinned(problem, lambda lines, pairs: lines // max(_FEWEST_LINES, _ENOUGH_VALUES // pairs), 0)


def with_lines_in_groups(problem: Problem) -> Problem:
    """The problem with one line in place of a few neighbours, as sure as they are together; itself where none has any.

    Near a joint that fits, its density has the slopes and bends of the whole to a few percent. Not its height: what the
    noise of a line says counts as often as the line does.
    """
    return _thinned(problem, lambda _lines, _pairs: _IN_A_GROUP, _ABOUT_A_PEAK, grouped=True)


def _thinned(problem: Problem, widest: Callable[[int, int], int], about: int, *, grouped: bool = False) -> Problem:
    tests, changed = list(problem.tests), False
    for place, test in enumerate(tests):
        if (frfs := test.data.frfs) is None or test.measured_bodies:
            continue
        lines, outputs, inputs = frfs.frf.values.shape
        kept = _lines_that_resolve(frfs, widest(lines, outputs * inputs), about)
        if _ALMOST_ALL * kept.size <= lines:
            few, count = frfs.at_lines(kept), np.diff(kept, append=lines) if grouped else np.ones(kept.size)
            data = replace(few, variance=few.variance / count[:, None, None])
            noise = test.noise and test.noise.fitted_to(data, test.noise.parts)
            tests[place] = replace(test, data=data, noise=noise)
            changed = True
    return replace(problem, tests=tuple(tests)) if changed else problem


def _lines_that_resolve(frfs: FrfData, widest: int, about: int) -> Indices:
    """Places of lines `widest` apart, and closer on peaks and so many of their widths to both sides of them."""
    if widest < 2:
        return np.arange(frfs.frf.n_lines)
    receptances = frfs.frf.converted("receptance").values
    step = np.full(frfs.frf.n_lines, widest)
    for output, input_ in np.ndindex(receptances.shape[1:]):
        values = receptances[:, output, input_]
        for peak in peak_places(frfs, values, output, input_):
            first, last = shoulders(np.abs(values), peak)
            width = last - first + 1
            on_peak = slice(max(0, first - about * width), last + 1 + about * width)
            step[on_peak] = np.minimum(step[on_peak], max(1, width // _ON_A_PEAK))
    # each line is one over the step of the way to the next that is kept; the first is
    way = np.cumsum(1 / step) - 1 / step[0]
    return np.flatnonzero(np.diff(np.floor(way + _ROUNDING), prepend=-1.0))


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

    def __init__(self, frequency_hz: Array, measured: ComplexArray, predicted: ComplexArray, sd: Array) -> None:
        self._f, self._want, self._sd = frequency_hz, predicted, sd
        lines = []
        for values in (measured, predicted):  # the resonances of all FRFs together
            scaled = np.abs(values) / np.median(np.abs(values), axis=0)
            power = np.log((scaled**2).mean(axis=1)) / 2
            peaks = scipy.signal.find_peaks(power, prominence=PROMINENCE)[0]
            lines.append(peaks[(np.abs(values[peaks]) > LEAST_SD * sd[peaks]).any(axis=1)])
        self._matched = _matched(frequency_hz, *lines)
        fits = np.array([self._fits(predicted, p) for _, p in self._matched]).reshape(-1, predicted.shape[1], 3)
        keep = np.isfinite(fits[..., 0]).any(axis=1) if len(fits) else np.zeros(0, dtype=bool)
        self._matched = [pair for pair, kept in zip(self._matched, keep, strict=True) if kept]
        self._predicted = fits[keep]
        #: Frequency of each in the predicted FRFs, shape (modes,), Hz.
        self.predicted_hz: Array = np.exp(median_seen(self._predicted[..., 0], axis=1))
        #: ln of its damping ratio, shape (modes,).
        self.log_damping: Array = median_seen(self._predicted[..., 1], axis=1)

    def ratios(self, values: ComplexArray) -> Array:
        """ln of frequency, damping and level over the predicted ones, shape (modes, pairs, 3); NaN where unseen."""
        fits = np.array([self._fits(values, m) for m, _ in self._matched]).reshape(self._predicted.shape)
        return fits - self._predicted

    def scatter(self, rng: np.random.Generator) -> Array:
        """Standard deviation of the same from noise alone, shape (modes, pairs, 3)."""
        fits = []
        for _ in range(_REPLICATES):  # one after the other: those of a large test would fill the memory
            white = rng.standard_normal((*self._want.shape, 2)) @ [1, 1j] / math.sqrt(2)
            noisy = self._want + self._sd * white
            fits.append(np.array([self._fits(noisy, p) for _, p in self._matched]).reshape(self._predicted.shape))
        with np.errstate(invalid="ignore"):
            spread: Array = np.std(fits, axis=0)
        return spread

    def _fits(self, values: ComplexArray, peak: int) -> Array:
        """ln of frequency, damping and level of one resonance in each FRF, shape (pairs, 3)."""
        return np.array([fit_resonance(self._f, np.abs(values[:, i]) ** 2, peak) for i in range(values.shape[1])])


def _matched(f: Array, measured: Indices, predicted: Indices) -> list[tuple[int, int]]:
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
    curvature the level, for any values of the other two.
    """
    here = peak + int(np.argmax(power[max(peak - 2, 0) : peak + 3])) - min(peak, 2)
    low, high = shoulders(np.sqrt(power), here)
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
