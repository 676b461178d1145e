"""Likelihoods of joint matrices K^J and of what else is uncertain: invariant to how these are parametrised.

Each offers ln L for a batch, and for one point the standardised residuals e, with ln L = constant − eᵀe/2 for Gaussian
noise of known size, and their Jacobian.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.frf import FrfSet, NaturalFrequencies, Ports, ReceptanceModel, quantity_factor, receptance_model
from jointbayes.frf.ports import as_factors
from jointbayes.inference.noise import GaussianNoise, NoiseModel
from jointbayes.inference.residuals import ResidualKind, residual_constant, standardised_residuals
from jointbayes.joint import Joint, symmetric_changes
from jointbayes.measurement import FrequencyMeasurement, FrfMeasurement, Measurement
from jointbayes.structure import Structure, StructureFamily, as_family

__all__ = ["FrequencyLikelihood", "FrfLikelihood", "Likelihood", "likelihood_of"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_GAIN = "gain"
_STEP = 1e-5  # of the logarithm of a quantity, in differences
_AT_ONCE = 64  # joints whose lines are held in memory together


class FrfLikelihood:
    """Likelihood of FRFs under a noise model; complex circular Gaussian of known variance by default.

    ln p = −Σ (ln πσ² + |H − H^x|²/σ²) over all lines and FRFs.

    Parameters
    ----------
    model
        Predicts receptances at the lines and DOFs of the measurement.
    measurement
        FRFs of any quantity with variance σ² = E|δH|².
    names
        Uncertain quantities beside the joint, in the order in which factors come: those of the model's structure,
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
        frf = measurement.frf
        #: Noise model.
        self.noise: NoiseModel = noise or GaussianNoise()
        self.names, self.kind = tuple(names), kind
        self._gain = _GAIN in self.names
        self._n_structure = len(self.names) - len(self.noise.names) - self._gain
        if self.names[len(self.names) - len(self.noise.names) :] != self.noise.names:
            raise ModelError(
                f"likelihood: found uncertain quantities {self.names}; expected {self.noise.names} last; reorder them"
            )
        # receptance and its measured counterpart carry the same factor (jω)ⁿ: residual/σ does not depend on it
        factor = quantity_factor(frf.frequency_hz, frf.quantity)[:, None, None]
        self._model, self._measurement = model, measurement
        self._measured = frf.values / factor
        self._variance = measurement.variance / np.abs(factor) ** 2
        self._plain = not self._gain and kind == "complex" and self.noise.needs_chi2_only
        if self._plain:
            self._misfit = model.misfit(self._measured, 1 / np.sqrt(self._variance))
        #: ln L of a perfect fit where the noise is Gaussian of known size; of the FRF as it was measured.
        self.constant = float(residual_constant(kind, frf.values, measurement.variance))
        #: Number of complex values.
        self.n_data = frf.values.size

    @property
    def hyper_count(self) -> int:
        """Number of the noise model's parameters, the last of `names`."""
        return len(self.noise.names)

    @property
    def gaussian(self) -> bool:
        """Whether ln L is −eᵀe/2 of the residuals and a constant: Gaussian noise of known size."""
        return isinstance(self.noise, GaussianNoise)

    def log_likelihood(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> Array:
        """ln L, shape (batch,), of joint matrices, shape (batch, r, r), and factors, shape (batch, q).

        −inf where the model has no finite value: a joint that resonates, undamped, on a line.
        """
        matrices = np.asarray(stiffness, dtype=float)
        known = as_factors(factors, len(matrices))
        if self._plain:
            chi2 = self._misfit.chi2(matrices, self._structural(known))
            value = self.constant + self.noise.from_chi2(chi2, self.n_data, self._hyper(known))
        else:
            value = np.empty(len(matrices))
            for start in range(0, len(matrices), _AT_ONCE):
                part = slice(start, start + _AT_ONCE)
                z = self.standardised(matrices[part], known[part])
                value[part] = self.constant + self.noise.log_likelihood(z, self._hyper(known[part]))
        value[~np.isfinite(value)] = -np.inf
        return value

    def standardised(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> ComplexArray:
        """Residuals over σ, shape (batch, lines, pairs), see `jointbayes.inference.residuals`."""
        matrices = np.asarray(stiffness, dtype=float)
        known = as_factors(factors, len(matrices))
        return self._residual_of(self._predicted(matrices, known))

    def whitened(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> ComplexArray:
        """Residuals that are independent and of unit variance if the model holds, shape (batch, lines, pairs)."""
        matrices = np.asarray(stiffness, dtype=float)
        known = as_factors(factors, len(matrices))
        z = self.standardised(matrices, known)
        hyper = self._hyper(known)
        return np.concatenate([self.noise.whiten(one[None], row) for one, row in zip(z, hyper, strict=True)])

    def pointwise(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> Array:
        """ln L value by value, shape (batch, lines, pairs), where residuals are independent.

        Raises
        ------
        ModelError
            If the noise model correlates them.
        """
        matrices = np.asarray(stiffness, dtype=float)
        known = as_factors(factors, len(matrices))
        values = self.noise.pointwise(self.standardised(matrices, known), self._hyper(known))
        data = self._measurement
        pointwise: Array = values + residual_constant(self.kind, data.frf.values, data.variance, pointwise=True)
        return pointwise

    def gradient(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """ln L (batch,) and its gradient S (batch, r, r) by the joint: d ln L = Σ S_ij dK_ij for symmetric dK.

        Raises
        ------
        ModelError
            If the noise is not Gaussian of known size.
        """
        if not (self._plain and self.gaussian):
            raise ModelError("gradient: found a noise model with parameters; expected Gaussian noise of known size")
        matrices = np.asarray(stiffness, dtype=float)
        chi2, slope = self._misfit.chi2_gradient(matrices, self._structural(as_factors(factors, len(matrices))))
        return self.constant - chi2, -slope

    def residuals(
        self, stiffness: ArrayLike, directions: ArrayLike, factors: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Standardised residuals e (m,) and their derivative (m, p + q), for one joint.

        Along changes dK^J (p, r, r), exact, and along the logarithms of the factors (q,), by differences. Columns of
        the noise model's parameters are zero: it is held fixed, and whitens residual and derivative alike.
        """
        known = as_factors(factors, 1)
        structural = known[:, : self._n_structure]
        gain = float(known[0, self._n_structure]) if self._gain else 1.0
        value, derivative = self._model.tangent(stiffness, directions, structural[0])
        n = known.shape[1] - self.hyper_count
        moved = np.repeat(known, 2 * n, axis=0)
        rows = np.arange(n)
        moved[rows, rows] *= math.exp(_STEP)
        moved[n + rows, rows] *= math.exp(-_STEP)
        up, down = np.split(self._predicted(np.repeat(np.asarray(stiffness)[None], 2 * n, axis=0), moved), 2)
        along = np.concatenate([gain * derivative, (up - down) / (2 * _STEP)])
        hyper = self._hyper(known)[0]
        residual, slope = self._linearised((gain * value)[None], along)
        white = self.noise.whiten(np.concatenate([residual, slope]), hyper) * math.sqrt(2)
        flat = white.reshape(len(white), -1)
        parts = np.concatenate([flat.real, flat.imag], axis=1) if self.kind == "complex" else flat.real
        columns = np.zeros((parts.shape[1], len(parts) - 1 + self.hyper_count))
        columns[:, : len(parts) - 1] = parts[1:].T
        return parts[0], columns

    def draw(self, rng: np.random.Generator, factors: ArrayLike | None, batch: int) -> ComplexArray:
        """Standardised residuals of data made by the noise model, shape (batch, lines, pairs)."""
        lines, pairs = self._measured.shape[0], self._measured[0].size
        return self.noise.draw(rng, self._hyper(as_factors(factors, batch)), lines, pairs)

    def _predicted(self, matrices: Array, factors: Array) -> ComplexArray:
        predicted = self._model.receptance(matrices, self._structural(factors))
        if self._gain:
            predicted = predicted * factors[:, self._n_structure, None, None, None]
        return predicted

    def _residual_of(self, predicted: ComplexArray) -> ComplexArray:
        return standardised_residuals(self.kind, predicted, self._measured, self._variance)

    def _linearised(self, value: ComplexArray, along: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Standardised residual (1, lines, pairs) and its derivative (p, lines, pairs) along changes of H."""
        residual = self._residual_of(value)
        if self.kind == "complex":
            slope = along / np.sqrt(self._variance)
        else:
            # d ln|H| = Re(dH/H), standardised as the residual is
            unit = self._residual_of(value * math.e) - residual
            slope = (along / value).real * unit.reshape(value.shape)
        return residual, slope.reshape(len(along), *residual.shape[1:]).astype(complex)

    def _structural(self, factors: Array) -> Array:
        return factors[:, : self._n_structure]

    def _hyper(self, factors: Array) -> Array:
        return factors[:, factors.shape[1] - self.hyper_count :]


class FrequencyLikelihood:
    """Independent Gaussian likelihood of the lowest natural frequencies.

    Parameters
    ----------
    model
        Predicts as many frequencies as were measured.
    measurement
        Frequencies with standard deviations.
    names
        Uncertain quantities of the structure, in the order in which factors come.
    """

    hyper_count = 0
    gaussian = True

    def __init__(self, model: NaturalFrequencies, measurement: FrequencyMeasurement, names: Sequence[str] = ()) -> None:
        self._model, self._measured, self._sd = model, measurement.frequency_hz, measurement.sd_hz
        self.names = tuple(names)
        self.constant = -float(np.log(self._sd * math.sqrt(2 * math.pi)).sum())
        #: Number of frequencies.
        self.n_data = self._measured.size

    def log_likelihood(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> Array:
        """ln L, shape (batch,), of joint matrices, shape (batch, r, r), and factors, shape (batch, q)."""
        standardised = self.standardised(stiffness, factors)
        value: Array = self.constant - 0.5 * (standardised**2).sum(axis=-1)
        return value

    def standardised(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> Array:
        """Residuals over their standard deviation, shape (batch, n)."""
        return (self._model.frequency_hz(stiffness, factors) - self._measured) / self._sd

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
        """Standardised residuals e (m,) and their derivative (m, p + q), for one joint.

        Along changes dK^J (p, r, r), exact, and along the logarithms of the factors (q,), by differences.
        """
        known = as_factors(factors, 1)
        value, derivative = self._model.tangent(stiffness, directions, known)
        n = known.shape[1]
        moved = np.repeat(known, 2 * n, axis=0)
        rows = np.arange(n)
        moved[rows, rows] *= math.exp(_STEP)
        moved[n + rows, rows] *= math.exp(-_STEP)
        up, down = np.split(self._model.frequency_hz(np.repeat(np.asarray(stiffness)[None], 2 * n, axis=0), moved), 2)
        slope = np.concatenate([derivative, (up - down) / (2 * _STEP)])
        return (value - self._measured) / self._sd, (slope / self._sd).T


Likelihood = FrfLikelihood | FrequencyLikelihood


def likelihood_of(
    structure: Structure | StructureFamily,
    joint: Joint,
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
        return FrequencyLikelihood(model, measurement, family.names)
    frf: FrfSet = measurement.frf
    ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
    names = (*family.names, *([_GAIN] if gain else []), *(noise.names if noise else ()))
    return FrfLikelihood(receptance_model(family, joint, ports), measurement, names, noise, kind)
