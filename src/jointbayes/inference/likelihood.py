"""Likelihoods of joint matrices K^J and of what else is uncertain: invariant to how these are parametrised.

Where bodies of the structure are themselves measured the noise depends on the joint. At a line the measured FRFs differ
from the predicted ones by their own errors and by what the errors of the measured bodies make of the prediction,
Σ = diag(σ²) + J Σ_A Jᴴ with J = ∂H/∂A at the joint and factors at hand, so that ln L = −Σ (ln det πΣ + rᴴ Σ⁻¹ r) with
r = H − Hˣ. What the errors of the bodies have in common makes FRFs of different outputs and inputs at one line depend
on each other; lines do not.

References
----------
Goodman, N. R. (1963). Statistical analysis based on a certain multivariate complex Gaussian distribution. Annals of
Mathematical Statistics 34(1), 152-177. DOI 10.1214/aoms/1177704250
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.frf import LowRankCoupling, NoisePropagation, Ports, ReceptanceModel
from jointbayes.frf.kernels.by_line import noise_roots
from jointbayes.frf.measured_body import substructures
from jointbayes.frf.ports import factors_batch
from jointbayes.inference.likelihood_base import STEP, ComplexResidual, Likelihood, moved_factors
from jointbayes.inference.noise.base import NoiseModel, Residuals, columns_of
from jointbayes.inference.noise.gaussian import GaussianNoise
from jointbayes.inference.test import Test, likelihood_of
from jointbayes.joint import AnyJointMatrix, JointMatrix, joint_matrix_of
from vibrecords import FrfData, quantity_factor
from vibrecords.arrays import Array, ComplexArray


class PropagatedNoise:
    """Covariance of residuals at each line, and residuals that are white by it.

    Parameters
    ----------
    model
        Forward model with measured bodies.
    variance
        σ² of the measured receptances, shape (lines, outputs, inputs).
    """

    def __init__(self, model: LowRankCoupling, variance: Array) -> None:
        self.propagation = NoisePropagation(model)
        self._variance = variance.reshape(len(variance), -1)

    def roots(self, matrices: AnyJointMatrix, factors: Array, gain: Array) -> ComplexArray:
        """Lower triangular L with L Lᴴ = Σ, shape (batch, lines, pairs, pairs).

        Of joint matrices (batch, r, r), factors on the structure (batch, f) and on all measured FRFs (batch,).
        """
        added = self.propagation.roots(matrices, factors)
        roots = np.empty((*added.shape[:3], added.shape[2]), dtype=complex)
        noise_roots(added, np.ascontiguousarray(gain), self._variance, roots)
        return roots

    def white(self, roots: ComplexArray, residuals: ComplexArray) -> ComplexArray:
        """L⁻¹ r, shape (n, lines, pairs), E|z|² = 1, of residuals (n, lines, outputs, inputs); roots of one or n."""
        flat = residuals.reshape(*residuals.shape[:2], -1)
        white = np.empty(flat.shape, dtype=complex)
        for p in range(flat.shape[2]):
            explained = (roots[..., p, :p] * white[..., :p]).sum(axis=-1)
            white[..., p] = (flat[..., p] - explained) / roots[..., p, p]
        return white

    def excess(self, roots: ComplexArray) -> Array:
        """Part of each value in ln det Σ above the part of the data's own noise, shape (batch, lines, pairs)."""
        return 2 * np.log(np.diagonal(roots, axis1=2, axis2=3).real) - np.log(self._variance)

    def variance(self, roots: ComplexArray) -> Array:
        """Diagonal of Σ, shape (batch, lines, pairs)."""
        return (np.abs(roots) ** 2).sum(axis=-1)


_GAIN = "gain"
_AT_ONCE, _VALUES_AT_ONCE = 64, 8_000_000  # joints whose lines are held in memory together, and values of all


class FrfLikelihood(Likelihood):
    """Likelihood of FRFs under a noise model; complex circular Gaussian of known variance by default.

    ln p = −Σ (ln πσ² + |H − H^x|²/σ²) over all lines and FRFs.

    Parameters
    ----------
    model
        Predicts receptances at the lines and DOFs of the measurement.
    data
        FRFs of any quantity with variance σ² = E|δH|².
    names
        Uncertain quantities besides the joint, in the order in which factors come: those of the model's structure,
        then ``gain`` if the measured FRFs are the true ones times an uncertain number, then those of the noise.
    noise
        Noise model; its parameters are the factors themselves.
    propagate
        Whether errors of measured bodies, which the model then has, are part of the noise.

    Raises
    ------
    ModelError
        If they are to be and the noise model is one that does without.

    References
    ----------
    Goodman, N. R. (1963). Statistical analysis based on a certain multivariate complex Gaussian distribution.
    Annals of Mathematical Statistics 34(1), 152-177. DOI 10.1214/aoms/1177704250
    """

    def __init__(
        self,
        model: ReceptanceModel,
        data: FrfData,
        names: Sequence[str] = (),
        noise: NoiseModel | None = None,
        *,
        propagate: bool = False,
    ) -> None:
        frf = data.frf
        # of the FRF as it was measured
        constant = ComplexResidual(frf.values, data.variance).constant
        super().__init__(names, noise or GaussianNoise(), constant, frf.values.size)
        self._gain = _GAIN in self.names
        self._n_structure = len(self.names) - self.hyper_count - self._gain
        # receptance and its measured counterpart carry the same factor (jω)ⁿ: residual/σ does not depend on it
        factor = quantity_factor(frf.frequency_hz, frf.quantity)[:, None, None]
        self._model, self._factor, self._data = model, factor, data
        variance = data.variance / np.abs(factor) ** 2
        self._measured = frf.values / factor
        self._residual = ComplexResidual(self._measured, variance)
        #: What errors of measured bodies make of the noise; None where there are none, or they are ignored.
        self.propagated: PropagatedNoise | None = None
        if propagate:
            if not self.noise.takes_white_residuals or not isinstance(model, LowRankCoupling):
                found = f"found {type(self.noise).__name__}"
                expected = "Gaussian or Student-t noise, to which the noise of the body is added"
                raise ModelError.of("measured body", (), found, expected, "choose one of these")
            self.propagated = PropagatedNoise(model, variance)
        # where a sum of squares says it all, it is summed without any array over lines
        self._squares = self.noise.needs_chi2_only and not (self._gain or propagate)
        if self._squares:
            self._misfit = model.misfit(self._measured, 1 / np.sqrt(variance))

    @property
    def gaussian(self) -> bool:
        """Whether ln L is −eᵀe/2 of the residuals and a constant: Gaussian noise of known size, the same for all θ."""
        return super().gaussian and self.propagated is None

    @property
    def has_slope(self) -> bool:
        """Whether `gradient` is there."""
        return self._squares

    def log_likelihood(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """ln L, shape (batch,), of joint matrices, shape (batch, r, r), and factors, shape (batch, q)."""
        joints = joint_matrix_of(matrices)
        factor_rows = factors_batch(factors, len(joints))
        if self._squares:
            chi2 = self._misfit.chi2(joints, self._structural(factor_rows))
            value = self.constant + self.noise.log_likelihood_of_chi2(chi2, self.n_data, self.hyper(factor_rows))
        else:
            value = np.empty(len(joints))
            at_once = max(1, min(_AT_ONCE, _VALUES_AT_ONCE // self.n_data))
            for start in range(0, len(joints), at_once):
                batch = slice(start, start + at_once)
                z, excess = self._compared(joints[batch], factor_rows[batch])
                value[batch] = self.constant + self.noise.log_likelihood(z, self.hyper(factor_rows[batch])) - excess
        value[~np.isfinite(value)] = -np.inf
        return value

    def standardised(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Residuals:
        """Residuals over σ, shape (batch, lines, pairs), see `ComplexResidual`."""
        joints = joint_matrix_of(matrices)
        return self._compared(joints, factors_batch(factors, len(joints)))[0]

    def _compared(self, matrices: JointMatrix, factor_rows: Array) -> tuple[Residuals, Array]:
        """Residuals over σ, and what a noise that depends on the joint takes from ln L, shape (batch,)."""
        predicted = self._predicted(matrices, factor_rows)
        if self.propagated is None:
            return self._residual.z(predicted), np.zeros(len(matrices))
        roots = self._roots(matrices, factor_rows)
        return self.propagated.white(roots, predicted - self._measured), self.propagated.excess(roots).sum(axis=(1, 2))

    def _roots(self, matrices: JointMatrix, factor_rows: Array) -> ComplexArray:
        """Roots of the noise's covariance at each line, see `PropagatedNoise`."""
        assert self.propagated is not None
        gain = factor_rows[:, self._n_structure] if self._gain else np.ones(len(factor_rows))
        return self.propagated.roots(matrices, self._structural(factor_rows), gain)

    def variance(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """σ² of the measured FRFs with what measured bodies add, in their quantity, (batch, lines, outputs, inputs)."""
        joints = joint_matrix_of(matrices)
        stated = self._data.variance
        if self.propagated is None:
            return np.broadcast_to(stated, (len(joints), *stated.shape))
        roots = self._roots(joints, factors_batch(factors, len(joints)))
        whole = self.propagated.variance(roots).reshape(len(joints), *stated.shape)
        return whole * np.abs(self._factor) ** 2

    def predicted(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> ComplexArray:
        """FRFs in the measured quantity, gain included, shape (batch, lines, outputs, inputs)."""
        joints = joint_matrix_of(matrices)
        return self._predicted(joints, factors_batch(factors, len(joints))) * self._factor

    def add_noise(self, predicted: ComplexArray, z: NDArray[Any]) -> ComplexArray:
        """What would be measured: predicted FRFs of one joint and noise z, both (lines, outputs, inputs)."""
        return predicted + np.sqrt(self._data.variance) * z

    def white(self, matrices: AnyJointMatrix, factors: ArrayLike) -> Array:
        """Scores of the noise model, shape (batch, m)."""
        # E|z|² = 1 of a complex residual, half of it in each part
        scores = self.noise.scores(self.standardised(matrices, factors), self.hyper(factors))
        white = columns_of(scores, 2)
        white = white.reshape(len(scores), math.prod(white.shape[1:]))  # also of no joint at all
        white *= math.sqrt(2)
        return white

    def pointwise(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """ln L value by value, shape (batch, lines, pairs), where residuals are independent.

        The constant of the data is shared out evenly: it is the same for every joint.

        Raises
        ------
        ModelError
            If the noise model correlates them.
        """
        joints = joint_matrix_of(matrices)
        factor_rows = factors_batch(factors, len(joints))
        z = self.standardised(joints, factor_rows)
        values: Array = self.noise.pointwise(z, self.hyper(factor_rows))
        if self.propagated is not None:
            if z.shape[2] > 1:
                found, expected = "found FRFs that share the noise of a measured body", "independent values"
                raise ModelError.of("pointwise", (), found, expected, "compare models by their evidence instead")
            values = values - self.propagated.excess(self._roots(joints, factor_rows))
        return values + self.constant / self.n_data

    def gradient(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """ln L (batch,) and its gradient S (batch, r, r) by the joint: d ln L = Σ S_ij dK_ij for symmetric dK."""
        if not (self._squares and self.gaussian):
            raise ModelError.of("gradient", (), "found a noise model with parameters", "Gaussian noise of known size")
        joints = joint_matrix_of(matrices)
        chi2, slope = self._misfit.chi2_gradient(joints, self._structural(factors_batch(factors, len(joints))))
        return self.constant - chi2, -slope

    def residuals(
        self, matrix: AnyJointMatrix, directions: AnyJointMatrix, factors: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Standardised residuals e (m,) and their derivative (m, p + q), for one joint."""
        joint, factor_rows = joint_matrix_of(matrix), factors_batch(factors, 1)
        value, derivative = self._model.tangent(joint, directions, factor_rows[0, : self._n_structure])
        if self._gain:
            gain = float(factor_rows[0, self._n_structure])
            value, derivative = gain * value, gain * derivative
        moved = moved_factors(factor_rows[:, : factor_rows.shape[1] - self.hyper_count])
        along = [derivative]
        if len(moved):
            up, down = np.split(self._predicted(joint.repeated(len(moved)), moved), 2)
            up -= down
            up /= 2 * STEP
            along.append(up)
        hyper = self.hyper(factor_rows)[0]
        here = value[None]
        if self.propagated is None:
            z, slopes = self._residual.z(here), [self._residual.tangent(here, some) for some in along]
        else:
            roots, whiten = self._roots(joint.batch, factor_rows), self.propagated.white
            z, slopes = whiten(roots, here - self._measured), [whiten(roots, some) for some in along]
        rows = np.empty((1 + sum(map(len, slopes)) + self.hyper_count, 2 * self.n_data))
        row = 0
        for some in (z, *filter(len, slopes)):
            white = self.noise.whiten(some, hyper).reshape(len(some), -1)
            for side, values in enumerate((white.real, white.imag)):
                columns = rows[row : row + len(some), side * self.n_data : (side + 1) * self.n_data]
                np.multiply(values, math.sqrt(2), out=columns)
            row += len(some)
        rows[row:] = 0.0
        return rows[0], rows[1:].T

    def _predicted(self, matrices: JointMatrix, factors: Array) -> ComplexArray:
        predicted = self._model.receptance(matrices, self._structural(factors))
        if self._gain:
            predicted = predicted * factors[:, self._n_structure, None, None, None]
        return predicted

    def _structural(self, factors: Array) -> Array:
        return factors[:, : self._n_structure]


@likelihood_of.register
def _frf_likelihood(data: FrfData, test: Test, *, gain: bool = False) -> FrfLikelihood:
    whole = substructures(test.structure)
    family = whole.modelled
    frf = data.frf
    ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
    names = (*family.names, *([_GAIN] if gain else []), *(test.noise.names if test.noise else ()))
    model, propagate = test.receptance_model(ports), bool(whole.measured) and whole.propagate
    return FrfLikelihood(model, data, names, test.noise, propagate=propagate)
