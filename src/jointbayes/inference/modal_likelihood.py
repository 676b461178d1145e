"""Likelihood of natural frequencies, and of what else is known of modes."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.frf.ports import as_factors
from jointbayes.inference.likelihood_base import STEP, Likelihood, moved_factors
from jointbayes.inference.modes import ModalModel
from jointbayes.inference.noise.base import NoiseModel
from jointbayes.inference.noise.gaussian import GaussianNoise
from jointbayes.joint import AnyJointMatrix, as_joint_matrix, symmetric_changes
from jointbayes.measurement import ModalMeasurement


class ModalLikelihood(Likelihood):
    """Independent Gaussian likelihood of natural frequencies, and of what else is known of modes.

    Parameters
    ----------
    model
        Predicts as many values as were measured.
    measurement
        Values with standard deviations.
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
        model: ModalModel,
        measurement: ModalMeasurement,
        names: Sequence[str] = (),
        noise: NoiseModel | None = None,
    ) -> None:
        self._model, self._measured, self._sd = model, measurement.values, measurement.sd
        noise = noise or GaussianNoise(1)
        if not noise.needs_chi2_only:
            raise ModelError(f"natural frequencies: found {type(noise).__name__}; expected Gaussian noise")
        constant = -float(np.log(self._sd * math.sqrt(2 * math.pi)).sum())
        super().__init__(names, noise, constant, self._measured.size)

    def log_likelihood(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """ln L, shape (batch,), of joint matrices, shape (batch, r, r), and factors, shape (batch, q)."""
        joints = as_joint_matrix(matrices)
        known = as_factors(factors, len(joints))
        chi2 = 0.5 * (self.standardised(joints, known) ** 2).sum(axis=-1)
        chi2[np.isnan(chi2)] = np.inf  # a shape relative to a DOF at rest
        return self.constant + self.noise.from_chi2(chi2, self.n_data, self.hyper(known))

    def standardised(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """Residuals over their standard deviation, shape (batch, n)."""
        return (self.predicted(matrices, factors) - self._measured) / self._sd

    def variance(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """Squared standard deviations as stated, shape (batch, n)."""
        return np.broadcast_to(self._sd**2, (len(as_joint_matrix(matrices)), self._sd.size))

    def white(self, matrices: AnyJointMatrix, factors: ArrayLike) -> Array:
        """Residuals over their standard deviation and its factor, shape (batch, n)."""
        z = self.standardised(matrices, factors)
        return z / self.hyper(factors) if self.hyper_count else z

    def predicted(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """Natural frequencies in Hz, and what else was measured, shape (batch, n)."""
        joints = as_joint_matrix(matrices)
        structural = self._structural(as_factors(factors, len(joints)))
        return self._model.modal_values(joints, structural)

    def pointwise(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """ln L value by value, shape (batch, n)."""
        known = as_factors(factors, len(as_joint_matrix(matrices)))
        values = -0.5 * self.white(matrices, known) ** 2 + self.constant / self.n_data
        return values - np.log(self.hyper(known)) if self.hyper_count else values

    def _structural(self, factors: Array) -> Array:
        return factors[:, : factors.shape[1] - self.hyper_count]

    def gradient(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """ln L (batch,) and its gradient S (batch, r, r) by the joint: d ln L = Σ S_ij dK_ij for symmetric dK."""
        stiffness = as_joint_matrix(matrices).stiffness
        known = as_factors(factors, len(stiffness))
        slope = np.empty_like(stiffness)
        changes = symmetric_changes(stiffness.shape[-1])
        for joint, row, gradient in zip(stiffness, known, slope, strict=True):
            residual, jacobian = self.residuals(joint, changes, row)
            gradient[:] = -(residual @ jacobian[:, : len(changes)]).reshape(joint.shape)
        return self.log_likelihood(stiffness, known), slope

    def residuals(
        self, matrix: AnyJointMatrix, directions: AnyJointMatrix, factors: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Standardised residuals e (m,) and their derivative (m, p + q), for one joint."""
        joint, known = as_joint_matrix(matrix), as_factors(factors, 1)
        structural, scale = self._structural(known), 1.0
        if self.hyper_count:
            (scale,) = self.hyper(known)[0]
        value, derivative = self._model.modal_tangent(joint, directions, structural)
        moved = moved_factors(structural)
        up, down = np.split(self._model.modal_values(joint.repeated(len(moved)), moved), 2)
        slope = np.concatenate([derivative, (up - down) / (2 * STEP), np.zeros((self.hyper_count, value.size))])
        sd = scale * self._sd
        return (value - self._measured) / sd, (slope / sd).T
