"""Likelihoods of joint matrices K^J: invariant to how the joint is parametrised.

Each is Gaussian and offers ln L for a batch of joints, its gradient, and for one joint the standardised residuals e,
with ln L = constant − eᵀe/2, and their exact Jacobian.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.frf import NaturalFrequencies, Ports, ReceptanceModel, quantity_factor, receptance_model
from jointbayes.joint import Joint, symmetric_changes
from jointbayes.measurement import FrequencyMeasurement, FrfMeasurement, Measurement
from jointbayes.structure import Structure

__all__ = ["FrequencyLikelihood", "FrfLikelihood", "Likelihood", "likelihood_of"]

Array = NDArray[np.float64]


class FrfLikelihood:
    """Complex circular Gaussian likelihood, ln p = −Σ (ln πσ² + |H − H^x|²/σ²) over all lines and FRFs.

    Parameters
    ----------
    model
        Predicts receptances at the lines and DOFs of the measurement.
    measurement
        FRFs of any quantity with variance σ² = E|δH|².

    References
    ----------
    Goodman, N. R. (1963). Statistical analysis based on a certain multivariate complex Gaussian distribution.
    Annals of Mathematical Statistics 34(1), 152-177. DOI 10.1214/aoms/1177704250
    """

    def __init__(self, model: ReceptanceModel, measurement: FrfMeasurement) -> None:
        frf = measurement.frf
        # receptance and its measured counterpart carry the same factor (jω)ⁿ: residual/σ does not depend on it
        factor = quantity_factor(frf.frequency_hz, frf.quantity)[:, None, None]
        self._model = model
        self._measured = frf.values / factor
        self._weight = np.abs(factor) / np.sqrt(measurement.variance)
        self._misfit = model.misfit(self._measured, self._weight)
        self.constant = -float(np.log(math.pi * measurement.variance).sum())
        #: Number of complex values.
        self.n_data = frf.values.size

    def log_likelihood(self, stiffness: ArrayLike) -> Array:
        """ln L, shape (batch,), of joint matrices, shape (batch, r, r).

        −inf where the model has no finite value: a joint that resonates, undamped, on a line.
        """
        value = self.constant - self._misfit.chi2(np.asarray(stiffness, dtype=float))
        value[~np.isfinite(value)] = -np.inf
        return value

    def gradient(self, stiffness: ArrayLike) -> tuple[Array, Array]:
        """ln L (batch,) and its gradient S (batch, r, r): d ln L = Σ S_ij dK_ij for symmetric dK."""
        chi2, slope = self._misfit.chi2_gradient(np.asarray(stiffness, dtype=float))
        return self.constant - chi2, -slope

    def residuals(self, stiffness: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
        """Standardised residuals e (m,) and their derivative (m, p) along changes dK^J (p, r, r) of one joint."""
        value, derivative = self._model.tangent(stiffness, directions)
        weight = math.sqrt(2) * self._weight  # σ²/2 is the variance of each part
        residual = ((value - self._measured) * weight).ravel()
        slope = (derivative * weight).reshape(len(derivative), -1).T
        return np.concatenate([residual.real, residual.imag]), np.concatenate([slope.real, slope.imag])


class FrequencyLikelihood:
    """Independent Gaussian likelihood of the lowest natural frequencies.

    Parameters
    ----------
    model
        Predicts as many frequencies as were measured.
    measurement
        Frequencies with standard deviations.
    """

    def __init__(self, model: NaturalFrequencies, measurement: FrequencyMeasurement) -> None:
        self._model, self._measured, self._sd = model, measurement.frequency_hz, measurement.sd_hz
        self.constant = -float(np.log(self._sd * math.sqrt(2 * math.pi)).sum())
        #: Number of frequencies.
        self.n_data = self._measured.size

    def log_likelihood(self, stiffness: ArrayLike) -> Array:
        """ln L, shape (batch,), of joint matrices, shape (batch, r, r)."""
        standardised = (self._model.frequency_hz(stiffness) - self._measured) / self._sd
        value: Array = self.constant - 0.5 * (standardised**2).sum(axis=-1)
        return value

    def gradient(self, stiffness: ArrayLike) -> tuple[Array, Array]:
        """ln L (batch,) and its gradient S (batch, r, r): d ln L = Σ S_ij dK_ij for symmetric dK."""
        matrices = np.asarray(stiffness, dtype=float)
        slope = np.empty_like(matrices)
        changes = symmetric_changes(matrices.shape[-1])
        for one, out in zip(matrices, slope, strict=True):
            residual, jacobian = self.residuals(one, changes)
            out[:] = -(residual @ jacobian).reshape(one.shape)
        return self.log_likelihood(matrices), slope

    def residuals(self, stiffness: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
        """Standardised residuals e (m,) and their derivative (m, p) along changes dK^J (p, r, r) of one joint."""
        value, derivative = self._model.tangent(stiffness, directions)
        return (value - self._measured) / self._sd, (derivative / self._sd).T


Likelihood = FrfLikelihood | FrequencyLikelihood


def likelihood_of(structure: Structure, joint: Joint, measurement: Measurement) -> Likelihood:
    """Return the likelihood that fits the kind of measurement.

    Raises
    ------
    ModelError
        If a measured DOF does not exist in the structure, or there are more frequencies than DOFs.
    """
    if isinstance(measurement, FrequencyMeasurement):
        model = NaturalFrequencies(structure, joint, measurement.frequency_hz.size)
        return FrequencyLikelihood(model, measurement)
    frf = measurement.frf
    ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
    return FrfLikelihood(receptance_model(structure, joint, ports), measurement)
