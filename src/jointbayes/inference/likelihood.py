"""Likelihoods of joint matrices K^J and of what else is uncertain: invariant to how these are parametrised.

Each offers ln L for a batch, and for one point the standardised residuals e, with ln L = constant − eᵀe/2 for Gaussian
noise of known size, and their Jacobian.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.frf import FrfSet, NaturalFrequencies, Ports, ReceptanceModel, quantity_factor, receptance_model
from jointbayes.frf.ports import as_factors
from jointbayes.inference.noise.base import NoiseModel, Residuals, columns_of
from jointbayes.inference.noise.gaussian import GaussianNoise
from jointbayes.inference.residuals import ResidualKind, residual_of
from jointbayes.joint import AnyJoint, symmetric_changes
from jointbayes.measurement import FrequencyMeasurement, FrfMeasurement, Measurement
from jointbayes.structure import Structure, StructureFamily, as_family

__all__ = ["FrequencyLikelihood", "FrfLikelihood", "Likelihood", "likelihood_of"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_GAIN = "gain"
_STEP = 1e-5  # of the logarithm of a quantity, in differences
_AT_ONCE, _VALUES_AT_ONCE = 64, 8_000_000  # joints whose lines are held in memory together, and values of all


class Likelihood(ABC):
    """What the two kinds of data have in common.

    Parameters
    ----------
    names
        Uncertain quantities beside the joint, in the order in which factors come; those of the noise are the last.
    noise
        Noise model.
    constant
        ln L of a perfect fit where the noise is as stated.
    n_data
        Number of measured values.
    """

    def __init__(self, names: Sequence[str], noise: NoiseModel, constant: float, n_data: int) -> None:
        self.names, self.noise, self.constant, self.n_data = tuple(names), noise, constant, n_data
        #: Number of the noise model's parameters.
        self.hyper_count = len(noise.names)
        if self.names[len(self.names) - self.hyper_count :] != noise.names:
            raise ModelError(
                f"likelihood: found uncertain quantities {self.names}; expected {noise.names} last; reorder them"
            )

    @property
    def gaussian(self) -> bool:
        """Whether ln L is −eᵀe/2 of the residuals and a constant: Gaussian noise of known size."""
        return self.noise.as_stated

    def hyper(self, factors: ArrayLike) -> Array:
        """Parameters of the noise model among factors (batch, q), shape (batch, hyper_count)."""
        known = np.atleast_2d(np.asarray(factors, dtype=float))
        return known[:, known.shape[1] - self.hyper_count :]

    @abstractmethod
    def log_likelihood(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> Array:
        """ln L, shape (batch,), of joint matrices, shape (batch, r, r), and factors, shape (batch, q).

        −inf where the model has no finite value: a joint that resonates, undamped, on a line.
        """

    @abstractmethod
    def standardised(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> Residuals:
        """Residuals over σ, shape (batch, lines, pairs), see `jointbayes.inference.residuals`, or (batch, n)."""

    @abstractmethod
    def predicted(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> NDArray[Any]:
        """What is compared with the data: FRFs (batch, lines, outputs, inputs), or natural frequencies (batch, n)."""

    @abstractmethod
    def white(self, stiffness: ArrayLike, factors: ArrayLike) -> Array:
        """Real residuals, shape (batch, m), that are white with unit variance if model and noise hold."""

    @abstractmethod
    def gradient(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """ln L (batch,) and its gradient S (batch, r, r) by the joint: d ln L = Σ S_ij dK_ij for symmetric dK.

        Raises
        ------
        ModelError
            If the noise is not Gaussian of known size.
        """

    @abstractmethod
    def residuals(
        self, stiffness: ArrayLike, directions: ArrayLike, factors: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Standardised residuals e (m,) and their derivative (m, p + q), for one joint.

        Along changes dK^J (p, r, r), exact, and along the logarithms of the factors (q,), by differences. Columns of
        the noise model's parameters are zero: it is held fixed, and whitens residual and derivative alike.
        """


class FrfLikelihood(Likelihood):
    """Likelihood of FRFs under a noise model; complex circular Gaussian of known variance by default.

    ln p = −Σ (ln πσ² + |H − H^x|²/σ²) over all lines and FRFs.

    Parameters
    ----------
    model
        Predicts receptances at the lines and DOFs of the measurement.
    measurement
        FRFs of any quantity with variance σ² = E|δH|².
    names
        Uncertain quantities besides the joint, in the order in which factors come: those of the model's structure,
        then ``gain`` if the measured FRFs are the true ones times an uncertain number, then those of the noise.
    noise
        Noise model; its parameters are the factors themselves.
    kind
        What is compared: ``"complex"`` FRFs or their ``"log_magnitude"``.

    References
    ----------
    Goodman, N. R. (1963). Statistical analysis based on a certain multivariate complex Gaussian distribution.
    Annals of Mathematical Statistics 34(1), 152-177. DOI 10.1214/aoms/1177704250
    """

    def __init__(
        self,
        model: ReceptanceModel,
        measurement: FrfMeasurement,
        names: Sequence[str] = (),
        noise: NoiseModel | None = None,
        kind: ResidualKind = "complex",
    ) -> None:
        frf, self.kind = measurement.frf, kind
        # of the FRF as it was measured
        constant = residual_of(kind, frf.values, measurement.variance).constant
        super().__init__(names, noise or GaussianNoise(), constant, frf.values.size)
        self._gain = _GAIN in self.names
        self._n_structure = len(self.names) - self.hyper_count - self._gain
        # receptance and its measured counterpart carry the same factor (jω)ⁿ: residual/σ does not depend on it
        factor = quantity_factor(frf.frequency_hz, frf.quantity)[:, None, None]
        self._model, self._factor = model, factor
        variance = measurement.variance / np.abs(factor) ** 2
        self._residual = residual_of(kind, frf.values / factor, variance)
        # where a sum of squares says it all, it is summed without any array over lines
        self._squares = self.noise.needs_chi2_only and not self._gain and kind == "complex"
        if self._squares:
            self._misfit = model.misfit(frf.values / factor, 1 / np.sqrt(variance))

    def log_likelihood(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> Array:
        """ln L, shape (batch,), of joint matrices, shape (batch, r, r), and factors, shape (batch, q)."""
        matrices = np.asarray(stiffness, dtype=float)
        known = as_factors(factors, len(matrices))
        if self._squares:
            chi2 = self._misfit.chi2(matrices, self._structural(known))
            value = self.constant + self.noise.from_chi2(chi2, self.n_data, self.hyper(known))
        else:
            value = np.empty(len(matrices))
            at_once = max(1, min(_AT_ONCE, _VALUES_AT_ONCE // self.n_data))
            for start in range(0, len(matrices), at_once):
                part = slice(start, start + at_once)
                z = self.standardised(matrices[part], known[part])
                value[part] = self.constant + self.noise.log_likelihood(z, self.hyper(known[part]))
        value[~np.isfinite(value)] = -np.inf
        return value

    def standardised(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> Residuals:
        """Residuals over σ, shape (batch, lines, pairs), see `jointbayes.inference.residuals`."""
        matrices = np.asarray(stiffness, dtype=float)
        known = as_factors(factors, len(matrices))
        return self._residual.z(self._predicted(matrices, known))

    def predicted(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> ComplexArray:
        """FRFs in the measured quantity, gain included, shape (batch, lines, outputs, inputs)."""
        matrices = np.asarray(stiffness, dtype=float)
        return self._predicted(matrices, as_factors(factors, len(matrices))) * self._factor

    def white(self, stiffness: ArrayLike, factors: ArrayLike) -> Array:
        """Scores of the noise model, shape (batch, m)."""
        # E|z|² = 1 of a complex residual, half of it in each part
        scores = self.noise.scores(self.standardised(stiffness, factors), self.hyper(factors))
        white = columns_of(scores, 2 if self.kind == "complex" else 1)
        white = white.reshape(len(scores), math.prod(white.shape[1:]))  # also of no joint at all
        white *= math.sqrt(2)
        return white

    def pointwise(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> Array:
        """ln L value by value, shape (batch, lines, pairs), where residuals are independent.

        The constant of the data is shared out evenly: it is the same for every joint.

        Raises
        ------
        ModelError
            If the noise model correlates them.
        """
        matrices = np.asarray(stiffness, dtype=float)
        known = as_factors(factors, len(matrices))
        values: Array = self.noise.pointwise(self.standardised(matrices, known), self.hyper(known))
        return values + self.constant / self.n_data

    def gradient(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """ln L (batch,) and its gradient S (batch, r, r) by the joint: d ln L = Σ S_ij dK_ij for symmetric dK."""
        if not (self._squares and self.gaussian):
            raise ModelError("gradient: found a noise model with parameters; expected Gaussian noise of known size")
        matrices = np.asarray(stiffness, dtype=float)
        chi2, slope = self._misfit.chi2_gradient(matrices, self._structural(as_factors(factors, len(matrices))))
        return self.constant - chi2, -slope

    def residuals(
        self, stiffness: ArrayLike, directions: ArrayLike, factors: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Standardised residuals e (m,) and their derivative (m, p + q), for one joint."""
        known = as_factors(factors, 1)
        structural = known[:, : self._n_structure]
        value, derivative = self._model.tangent(stiffness, directions, structural[0])
        if self._gain:
            gain = float(known[0, self._n_structure])
            value, derivative = gain * value, gain * derivative
        moved = _moved(known[:, : known.shape[1] - self.hyper_count])
        along = [derivative]
        if len(moved):
            up, down = np.split(self._predicted(np.repeat(np.asarray(stiffness)[None], len(moved), 0), moved), 2)
            up -= down
            up /= 2 * _STEP
            along.append(up)
        hyper = self.hyper(known)[0]
        here = value[None]
        slopes = [self._residual.tangent(here, some) for some in along]
        parts = 2 if self.kind == "complex" else 1
        rows = np.empty((1 + sum(map(len, slopes)) + self.hyper_count, parts * self.n_data))
        row = 0
        for some in (self._residual.z(here), *filter(len, slopes)):
            white = self.noise.whiten(some, hyper).reshape(len(some), -1)
            for part, values in enumerate((white.real, white.imag)[:parts]):
                columns = rows[row : row + len(some), part * self.n_data : (part + 1) * self.n_data]
                np.multiply(values, math.sqrt(2), out=columns)
            row += len(some)
        rows[row:] = 0.0
        return rows[0], rows[1:].T

    def _predicted(self, matrices: Array, factors: Array) -> ComplexArray:
        predicted = self._model.receptance(matrices, self._structural(factors))
        if self._gain:
            predicted = predicted * factors[:, self._n_structure, None, None, None]
        return predicted

    def _structural(self, factors: Array) -> Array:
        return factors[:, : self._n_structure]


class FrequencyLikelihood(Likelihood):
    """Independent Gaussian likelihood of the lowest natural frequencies.

    Parameters
    ----------
    model
        Predicts as many frequencies as were measured.
    measurement
        Frequencies with standard deviations.
    names
        Uncertain quantities of the structure, in the order in which factors come, then those of the noise.
    noise
        Noise model of real residuals of which their sum of squares says all; Gaussian of known size by default.

    Raises
    ------
    ModelError
        If the noise model is another one.
    """

    def __init__(
        self,
        model: NaturalFrequencies,
        measurement: FrequencyMeasurement,
        names: Sequence[str] = (),
        noise: NoiseModel | None = None,
    ) -> None:
        self._model, self._measured, self._sd = model, measurement.frequency_hz, measurement.sd_hz
        noise = noise or GaussianNoise(1)
        if not noise.needs_chi2_only:
            raise ModelError(f"natural frequencies: found {type(noise).__name__}; expected Gaussian noise")
        constant = -float(np.log(self._sd * math.sqrt(2 * math.pi)).sum())
        super().__init__(names, noise, constant, self._measured.size)

    def log_likelihood(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> Array:
        """ln L, shape (batch,), of joint matrices, shape (batch, r, r), and factors, shape (batch, q)."""
        matrices = np.asarray(stiffness, dtype=float)
        known = as_factors(factors, len(matrices))
        chi2 = 0.5 * (self.standardised(matrices, known) ** 2).sum(axis=-1)
        return self.constant + self.noise.from_chi2(chi2, self.n_data, self.hyper(known))

    def standardised(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> Array:
        """Residuals over their standard deviation, shape (batch, n)."""
        return (self.predicted(stiffness, factors) - self._measured) / self._sd

    def white(self, stiffness: ArrayLike, factors: ArrayLike) -> Array:
        """Residuals over their standard deviation and its factor, shape (batch, n)."""
        z = self.standardised(stiffness, factors)
        return z / self.hyper(factors) if self.hyper_count else z

    def predicted(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> Array:
        """Natural frequencies, shape (batch, n), Hz."""
        matrices = np.asarray(stiffness, dtype=float)
        structural = self._structural(as_factors(factors, len(matrices)))
        return self._model.frequency_hz(matrices, structural)

    def _structural(self, factors: Array) -> Array:
        return factors[:, : factors.shape[1] - self.hyper_count]

    def gradient(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """ln L (batch,) and its gradient S (batch, r, r) by the joint: d ln L = Σ S_ij dK_ij for symmetric dK."""
        matrices = np.asarray(stiffness, dtype=float)
        known = as_factors(factors, len(matrices))
        slope = np.empty_like(matrices)
        changes = symmetric_changes(matrices.shape[-1])
        for one, row, out in zip(matrices, known, slope, strict=True):
            residual, jacobian = self.residuals(one, changes, row)
            out[:] = -(residual @ jacobian[:, : len(changes)]).reshape(one.shape)
        return self.log_likelihood(matrices, known), slope

    def residuals(
        self, stiffness: ArrayLike, directions: ArrayLike, factors: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Standardised residuals e (m,) and their derivative (m, p + q), for one joint."""
        known = as_factors(factors, 1)
        structural, scale = self._structural(known), 1.0
        if self.hyper_count:
            (scale,) = self.hyper(known)[0]
        value, derivative = self._model.tangent(stiffness, directions, structural)
        moved = _moved(structural)
        up, down = np.split(self._model.frequency_hz(np.repeat(np.asarray(stiffness)[None], len(moved), 0), moved), 2)
        slope = np.concatenate([derivative, (up - down) / (2 * _STEP), np.zeros((self.hyper_count, value.size))])
        sd = scale * self._sd
        return (value - self._measured) / sd, (slope / sd).T


def _moved(factors: Array) -> Array:
    """Factors (1, n) with each in turn a little larger, then a little smaller, shape (2n, n)."""
    step = np.exp(_STEP * np.eye(factors.shape[1]))
    return np.concatenate([factors * step, factors / step])


def likelihood_of(
    structure: Structure | StructureFamily,
    joint: AnyJoint,
    measurement: Measurement,
    *,
    gain: bool = False,
    noise: NoiseModel | None = None,
    kind: ResidualKind = "complex",
) -> Likelihood:
    """Return the likelihood that fits the kind of measurement.

    Parameters
    ----------
    structure
        Structure without the joint, or a family of them whose quantities are uncertain.
    joint, measurement
        Where the joint acts, and the data.
    gain
        Whether the measured FRFs may all be off by one factor.
    noise, kind
        Noise model and kind of residual of FRFs.

    Raises
    ------
    ModelError
        If a measured DOF does not exist in the structure, or there are more frequencies than DOFs.
    """
    family = as_family(structure)
    if isinstance(measurement, FrequencyMeasurement):
        model = NaturalFrequencies(family, joint, measurement.frequency_hz.size)
        return FrequencyLikelihood(model, measurement, (*family.names, *(noise.names if noise else ())), noise)
    frf: FrfSet = measurement.frf
    ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
    names = (*family.names, *([_GAIN] if gain else []), *(noise.names if noise else ()))
    return FrfLikelihood(receptance_model(family, joint, ports), measurement, names, noise, kind)
