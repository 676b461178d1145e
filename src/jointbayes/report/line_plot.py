"""What a figure draws as numbers, for the page's script and a download: curves, an FRF, modes of a structure."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibrecords.arrays import Array

SeriesKind: TypeAlias = Literal["line", "points", "band"]

SERIES_COLOURS = ("#1f5a94", "#c1511b", "#2b7a55", "#8b4a8f", "#8a6d00", "#3d8fb0", "#5b6672", "#b03a5b")
"""Colours of the interactive series in order; a static figure that uses the same order matches its twin."""


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """One curve, set of points or band of an interactive plot.

    Parameters
    ----------
    name : str
        Legend entry.
    x : array_like, shape (n,)
        Strictly increasing, finite abscissae; series of one plot need not share them.
    y : array_like, shape (n,), optional
        Finite ordinates. A band may leave it empty, or give the centre line.
    kind : {"line", "points", "band"}
        How to draw it.
    y_low, y_high : array_like, shape (n,), optional
        Edges of a band, and only of a band.
    dashed : bool
        Draw the line dashed.
    """

    name: str
    x: ArrayLike
    y: ArrayLike = ()
    kind: SeriesKind = "line"
    y_low: ArrayLike = ()
    y_high: ArrayLike = ()
    dashed: bool = False

    @property
    def columns(self) -> tuple[Array, ...]:
        """x, y, y_low and y_high as arrays, shape (n,) each, or (0,) where there are none."""
        x, y, low, high = (np.asarray(values, dtype=float) for values in (self.x, self.y, self.y_low, self.y_high))
        return x, y, low, high


@dataclass(frozen=True, slots=True)
class LinePlot:
    """The interactive twin of a figure: the same numbers, to zoom and read off.

    Parameters
    ----------
    x_label, y_label : str
        Axis titles with units, plain text.
    series : tuple of Series
        Drawn bands first, then lines, then points; colours follow :data:`SERIES_COLOURS` in this order.
    log_y : bool
        Whether the vertical axis is logarithmic; then all ordinates are positive.
    """

    x_label: str
    y_label: str
    series: tuple[Series, ...]
    log_y: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class FrfCurve:
    """One FRF among others: its legend entry, complex values of shape (lines,), and how it is drawn.

    A curve that is `hidden` is drawn once the reader asks for it.
    """

    name: str
    values: NDArray[np.complex128]
    colour: str
    dashed: bool = False
    hidden: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class FrfPlot:
    """One FRF, measured and predicted: magnitude, phase, parts and Nyquist plot are views of the same numbers.

    Parameters
    ----------
    pair : tuple of str
        Labels of output and input.
    place : tuple of int
        Of the pair among outputs and inputs.
    quantity, unit : str
        What it is, such as ``"receptance"``, and its unit.
    frequency_hz : ndarray, shape (lines,)
        Lines, Hz.
    curves : tuple of FrfCurve
        Measured first, median last.
    band : tuple of ndarray, shape (lines,)
        Lower and upper end of the 95 % band as complex numbers: of the magnitude and of the phase.
    misfit : ndarray, shape (lines,)
        Distance of measurement and MAP in standard deviations of the stated noise.
    coherence : ndarray, shape (lines,), optional
        Coherence of the measurement.
    """

    pair: tuple[str, str]
    place: tuple[int, int]
    quantity: str
    unit: str
    frequency_hz: Array
    curves: tuple[FrfCurve, ...]
    band: tuple[NDArray[np.complex128], NDArray[np.complex128]]
    misfit: Array
    coherence: Array | None = None

    @property
    def worst_hz(self) -> float:
        """The line that the MAP explains worst, Hz."""
        return float(self.frequency_hz[np.argmax(self.misfit)])

    def phase_deg(self, values: NDArray[np.complex128]) -> Array:
        """Phase of one of the curves, within half a turn of the median's, degrees."""
        median = self.curves[-1].values
        turned: Array = np.angle(median, deg=True) + np.angle(values * np.conj(median), deg=True)
        return turned


@dataclass(frozen=True, slots=True, eq=False)
class Wireframe:
    """Modes of a structure, on paper.

    Parameters
    ----------
    points : ndarray, shape (lines, points, 2)
        Places at rest of the points that each line connects, m.
    names : tuple of str
        Each mode in words.
    shapes : ndarray, shape (modes, lines, points, 2)
        Displacements at the largest swing, m, as large as is drawn.
    """

    points: Array
    names: tuple[str, ...]
    shapes: Array
