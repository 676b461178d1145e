"""Noise with a model discrepancy that is correlated along frequency."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.frf.frf_set import read_only
from jointbayes.inference.noise.base import (
    Absorbed,
    NoiseChoice,
    NoiseModel,
    Residuals,
    columns_of,
    finite_or_impossible,
    log_uniform,
    residuals_of_columns,
    rows_of,
)
from jointbayes.inference.noise.kernels import correlate, innovations, ou_log_likelihood
from jointbayes.inference.prior import Nuisance
from jointbayes.measurement import FrfData

#: A discrepancy below this share of the stated noise adds less than a tenth to the variance of a line.
_SLIGHT = 0.3


def noise_of(choice: NoiseChoice, parts: int, data: FrfData) -> tuple[NoiseModel, tuple[Nuisance, ...]]:
    """The noise model of a case with a model discrepancy, and the priors of its hyperparameters."""
    assert choice.discrepancy is not None
    size, length = choice.discrepancy
    priors = log_uniform("discrepancy_scale", "× noise", *size), log_uniform("discrepancy_length", "Hz", *length)
    noise = CorrelatedNoise(parts, data.frf.frequency_hz, choice.scale == "sampled")
    return noise, (*choice.parameters, *priors)


@dataclass(frozen=True, eq=False)
class CorrelatedNoise(NoiseModel):
    """White noise plus a model discrepancy that is correlated along frequency: z = g + w.

    g is an Ornstein-Uhlenbeck process of standard deviation `discrepancy_scale` (in units of the stated σ) and
    correlation exp(−|Δf|/`discrepancy_length`), length in Hz, independent from pair to pair; w is white with the stated
    σ, times `noise_scale` where `scaled`. The likelihood is exact, by a Kalman filter, at a cost linear in lines.

    Parameters
    ----------
    parts
        2 for complex residuals, 1 for real ones.
    frequency_hz
        Lines, strictly increasing, evenly spaced or not, shape (lines,), Hz.
    scaled
        Whether the white noise has an unknown `noise_scale`.

    Raises
    ------
    ModelError
        If the lines do not increase.

    References
    ----------
    Kennedy, M. C., O'Hagan, A. (2001). Bayesian calibration of computer models. Journal of the Royal Statistical
    Society B 63(3), 425-464. DOI 10.1111/1467-9868.00294
    Hartikainen, J., Särkkä, S. (2010). Kalman filtering and smoothing solutions to temporal Gaussian process regression
    models. IEEE Workshop on Machine Learning for Signal Processing, 379-384. DOI 10.1109/MLSP.2010.5589113
    """

    parts: int
    frequency_hz: Array
    scaled: bool = False
    _spacing: Array = field(init=False, repr=False)
    _kind: NDArray[np.int64] = field(init=False, repr=False)
    averages_out: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        lines = read_only(self.frequency_hz)
        steps = np.diff(lines) if lines.ndim == 1 else np.zeros(1)
        if lines.size == 0 or not (np.isfinite(lines).all() and (steps > 0).all()):
            raise ModelError("correlated noise: expected finite, strictly increasing lines; sort them and drop doubles")
        # steps that differ by rounding only count as one: each costs an exponential
        unit = 1e-10 * float(np.ptp(lines)) or 1.0
        _, first, kind = np.unique(np.round(steps / unit), return_index=True, return_inverse=True)
        object.__setattr__(self, "frequency_hz", lines)
        object.__setattr__(self, "_spacing", np.append(steps[first], 1.0) if lines.size == 1 else steps[first])
        object.__setattr__(self, "_kind", np.concatenate([[0], kind]).astype(np.int64))

    @property
    def names(self) -> tuple[str, ...]:
        """Hyperparameters, in order."""
        return (*(("noise_scale",) if self.scaled else ()), "discrepancy_scale", "discrepancy_length")

    def _variances(self, hyper: ArrayLike, n: int) -> Array:
        """White variance, discrepancy variance and length of each row, shape (n, 3)."""
        rows = rows_of(hyper, n, self.names)
        variances = np.ones((n, 3))
        variances[:, 3 - len(self.names) :] = rows
        variances[:, :2] **= 2
        return variances

    def _lines(self, z: Residuals) -> Array:
        if z.shape[1] != self.frequency_hz.size:
            raise ModelError(
                f"correlated noise: found residuals at {z.shape[1]} lines; expected {self.frequency_hz.size}; "
                "make the noise model with the measurement's lines"
            )
        return columns_of(z, self.parts)

    def log_likelihood(self, z: Residuals, hyper: ArrayLike) -> Array:
        """ln L (n,) of residuals (n, lines, pairs), without the constant; −inf where a residual is not finite."""
        value = np.empty(len(z))
        ou_log_likelihood(self._lines(z), self._kind, self._spacing, self._variances(hyper, len(z)), value)
        return finite_or_impossible(value)

    def scores(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """Residuals that are white with the stated variance if the model holds: each row's normalised innovations."""
        columns = self._lines(z)
        white = np.empty_like(columns)
        innovations(columns, self._kind, self._spacing, self._variances(hyper, len(z)), white)
        return residuals_of_columns(white, self.parts)

    def draw(self, rng: np.random.Generator, hyper: ArrayLike, lines: int, pairs: int) -> Residuals:
        """Replicated residuals, shape (n, lines, pairs), one for each row of `hyper` (n, q)."""
        n = len(np.atleast_2d(hyper))
        rows = self._variances(hyper, n)
        shape = (n, lines, pairs * self.parts)
        noise = np.sqrt(rows[:, 0, None, None] / 2) * rng.standard_normal(shape)
        correlate(math.sqrt(0.5) * rng.standard_normal(shape), self._kind, self._spacing, rows, noise)
        return residuals_of_columns(noise, self.parts)

    @property
    def absorbs(self) -> Absorbed:
        """A model discrepancy."""
        return "discrepancy"

    def words(self, values: Mapping[str, float], z: Residuals) -> tuple[str, ...]:
        """What of the noise was inferred, in sentences."""
        size, length = values["discrepancy_scale"], values["discrepancy_length"]
        return (
            *super().words(values, z),
            f"This includes a model discrepancy of {size:.3g} times the stated noise, correlated over {length:.3g} Hz."
            if size > _SLIGHT
            else f"It includes a model discrepancy that is small, {size:.2g} times the stated noise.",
        )

    def fitted_to(self, data: FrfData, parts: int) -> Self:
        """The same law for the lines of another measurement."""
        return type(self)(parts, data.frf.frequency_hz, self.scaled)
