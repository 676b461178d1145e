"""A start for many unknowns: FRFs smoothed along frequency, widely at first, less and less.

Smoothing an FRF along frequency with a Lorentzian of half-width δ is looking at it with so much more damping: what was
a forest of resonances is a few broad hills, and the density of their misfit has few summits. The smoothing is linear:
that of the predicted FRFs is compared with that of the measured ones.
"""

import numpy as np
import scipy  # its parts load at first use
from numpy.typing import NDArray

from jointbayes.identification.least_squares import climb_all
from jointbayes.identification.starts import apart
from jointbayes.inference import JointPrior, Problem
from jointbayes.measurement import FrfMeasurement

__all__ = ["FROM_UNKNOWNS", "SmoothedSquares", "smoothed_starts"]

Array = NDArray[np.float64]

#: With fewer coordinates of the joint natural frequencies and screened draws find the mode.
FROM_UNKNOWNS = 5
#: Half-widths of the smoothing relative to the frequency, one climb after the other, and from how many points.
WIDTHS = ((0.2, 16), (0.06, 8), (0.02, 6))
_ERROR = 0.1  # of a smoothed FRF that counts as one standard deviation, of its size and of its median
_STEP = 0.5  # distance of the smoothed lines, in half-widths
_POINTS, _STEPS = 256, 20
_APART = 0.5  # prior standard deviations between points that are climbed
_SAME = 0.02  # and between ends that are one
_AT_ONCE = 4_000_000  # values of predicted FRFs held in memory together


class SmoothedSquares:
    """Residuals of smoothed FRFs in units of a tenth of their size, see `jointbayes.identification.least_squares`.

    Parameters
    ----------
    problem
        The problem; natural frequencies among its data do not count.
    width
        Half-width of the smoothing relative to the frequency.
    """

    def __init__(self, problem: Problem, width: float) -> None:
        self.prior: JointPrior = problem.prior
        self.columns = np.arange(len(problem.names) - problem.log_posterior.likelihood.hyper_count)
        self._parts = [(part, *_smoothing(measured, width)) for part, measured in _with_frfs(problem)]

    def residuals(self, theta: Array) -> Array:
        """Residuals, shape (n, m), of points inside the support, shape (n, d)."""
        return np.concatenate([self._of_part(theta, *part) for part in self._parts], axis=1)

    def _of_part(self, theta: Array, part: Problem, rows: Array, data: NDArray[np.complex128], size: Array) -> Array:
        at_once = max(1, _AT_ONCE // part.log_posterior.likelihood.n_data)
        residuals = []
        for begin in range(0, len(theta), at_once):
            predicted = part.log_posterior.predicted(theta[begin : begin + at_once])
            off = (rows @ predicted.reshape(*predicted.shape[:2], -1) - data) / size
            residuals.append(np.concatenate([off.real, off.imag], axis=1).reshape(len(off), -1))
        return np.concatenate(residuals)

    def value(self, theta: Array) -> Array:
        """Log density, shape (n,), up to a constant; −inf outside the support."""
        out = self.prior.log_density(theta)
        inside = np.isfinite(out)
        if inside.any():
            out[inside] -= 0.5 * (self.residuals(theta[inside]) ** 2).sum(axis=1)
        out[~np.isfinite(out)] = -np.inf
        return out


def _with_frfs(problem: Problem) -> list[tuple[Problem, FrfMeasurement]]:
    return [(part, part.measurement) for part in problem.parts if isinstance(part.measurement, FrfMeasurement)]


def _smoothing(measurement: FrfMeasurement, width: float) -> tuple[Array, NDArray[np.complex128], Array]:
    """Weights (rows, lines) of each line, smoothed data (rows, pairs), and the size of their errors."""
    lines = measurement.frf.frequency_hz
    low, high = np.log(lines[lines > 0][[0, -1]])
    centre = np.exp(np.linspace(low, high, 2 + int((high - low) / (_STEP * width))))[:, None]
    spacing = np.gradient(lines) if lines.size > 1 else np.ones(1)
    kernel = spacing / (1 + ((lines - centre) / (width * centre)) ** 2)
    rows = kernel / kernel.sum(axis=1, keepdims=True)
    data = rows @ measurement.frf.values.reshape(len(lines), -1)
    magnitude = np.abs(data)
    return rows, data, _ERROR * np.hypot(magnitude, np.median(magnitude, axis=0))


def smoothed_starts(problem: Problem, rng: np.random.Generator, further: Array) -> Array:
    """Points from which to climb the posterior, shape (n, d); none where few unknowns or no FRFs call for them.

    Parameters
    ----------
    problem
        The problem.
    rng
        Scrambles the points of the prior that are looked at.
    further
        Points that climb as well, shape (n, d).
    """
    prior, count = problem.prior, len(problem.parametrisation.names)
    if count < FROM_UNKNOWNS or not _with_frfs(problem):
        return np.empty((0, len(problem.names)))
    unit = np.full((_POINTS, len(problem.names)), 0.5)
    unit[:, :count] = scipy.stats.qmc.Sobol(count, seed=rng).random(_POINTS)
    points = np.concatenate([further, prior.transform(unit)])
    ends, distance = points, _APART
    for width, climbed in WIDTHS:
        squares = SmoothedSquares(problem, width)
        picked = apart(ends[:, :count] / prior.sd[:count], squares.value(ends), distance, climbed)
        ends, _ = climb_all(squares, ends[picked], _STEPS)
        distance = _SAME
    return ends
