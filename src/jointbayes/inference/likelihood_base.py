"""What likelihoods of FRFs and of natural frequencies have in common, and what of a measured FRF is compared.

Each offers ln L for a batch, and for one point the standardised residuals e, with ln L = constant − eᵀe/2 for Gaussian
noise of known size, and their Jacobian. Of an FRF the complex value is compared, or its logarithmic magnitude: each
kind turns predicted FRFs into standardised residuals z for a noise model, such that the total
ln L = kind.constant + noise.log_likelihood(z, hyper).
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Sequence
from typing import Any, Literal, Self, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import MeasurementError, ModelError
from jointbayes.inference.noise.base import NoiseModel, Residuals
from jointbayes.joint import AnyJointMatrix, JointMatrix, joint_matrix_of
from vibrecords.arrays import Array, ComplexArray, Flags

#: Σ|z|², shape (n,), of joint matrices (n, r, r) and factors (n, q), and whether each may be relied on.
SumOfSquares = Callable[[JointMatrix, Array], tuple[Array, Flags]]
ResidualKind = Literal["complex", "log_magnitude"]

#: Variance of ln|n| for n complex circular Gaussian: what is left of a value that is nothing but noise.
PURE_NOISE = math.pi**2 / 24


class ComplexResidual:
    """z = (H − Hˣ)/σ, complex, E|z|² = 1.

    Parameters
    ----------
    measured
        Hˣ, shape (lines, outputs, inputs).
    variance
        σ² = E|δH|², both parts together, shape as `measured`.
    """

    parts = 2

    def __init__(self, measured: ComplexArray, variance: Array) -> None:
        self._measured, self._weight = measured, 1 / np.sqrt(variance)
        #: −Σ ln πσ².
        self.constant = -float(np.log(math.pi * variance).sum())

    def z(self, predicted: ComplexArray) -> ComplexArray:
        """Residuals, shape (n, lines, pairs), of predicted FRFs, shape (n, lines, outputs, inputs)."""
        return self._weighted(predicted - self._measured)

    def tangent(self, predicted: ComplexArray, derivative: ComplexArray) -> ComplexArray:
        """Derivative of z, shape (p, lines, pairs), from ∂H, shape (p, lines, outputs, inputs), at one prediction."""
        return self._weighted(np.array(derivative))

    def _weighted(self, values: ComplexArray) -> ComplexArray:
        # each part by itself: a product of complex numbers costs more than twice that
        values.real *= self._weight
        values.imag *= self._weight
        return _paired(values)


class LogMagnitudeResidual:
    """z = (ln|H| − ln|Hˣ|)/(√2 sd), real, E z² = 1/2: for data whose phase cannot be trusted.

    sd² = min(σ²/(2|Hˣ|²), π²/24): the noise along Hˣ relative to it, and at most what ln|n| of pure noise n has. Where
    |H| is well above the noise ln|Hˣ| is unbiased; well below it Hˣ is noise and its logarithm lies above ln|H|, by
    E₁(|H|²/σ²)/2 in the mean: leave such lines out. The density is that of ln|Hˣ|, not of Hˣ: evidences of the two
    kinds are not comparable.

    Parameters
    ----------
    measured
        Hˣ, shape (lines, outputs, inputs).
    variance
        σ² = E|δH|², both parts together, shape as `measured`.

    Raises
    ------
    MeasurementError
        If a measured value is zero: it has no logarithm.
    """

    parts = 1

    def __init__(self, measured: ComplexArray, variance: Array) -> None:
        magnitude = np.abs(measured)
        if not (magnitude > 0).all():
            line, output, input_ = np.argwhere(~(magnitude > 0))[0]
            raise MeasurementError(
                f"log-magnitude residuals: found 0 at line {line + 1}, output {output + 1}, input {input_ + 1}; "
                "expected values other than 0; drop the line or use complex residuals"
            )
        sd = np.sqrt(np.minimum(variance / (2 * magnitude**2), PURE_NOISE))
        self._log_measured, self._weight = np.log(magnitude), 1 / (math.sqrt(2) * sd)
        #: −Σ ln(sd √2π).
        self.constant = -float(np.log(sd * math.sqrt(2 * math.pi)).sum())

    def z(self, predicted: ComplexArray) -> Array:
        """Residuals, shape (n, lines, pairs), of predicted FRFs, shape (n, lines, outputs, inputs)."""
        with np.errstate(divide="ignore"):  # a predicted zero is infinitely far from any measured magnitude
            return _paired((np.log(np.abs(predicted)) - self._log_measured) * self._weight)

    def tangent(self, predicted: ComplexArray, derivative: ComplexArray) -> Array:
        """Derivative of z, shape (p, lines, pairs), from ∂H, shape (p, lines, outputs, inputs), at one prediction.

        d ln|H| = Re(dH/H).
        """
        return _paired((derivative / predicted).real * self._weight)


Residual = ComplexResidual | LogMagnitudeResidual


def residual_of(kind: ResidualKind, measured: ComplexArray, variance: Array) -> Residual:
    """Residual of a kind by its name; parameters as of the classes.

    Raises
    ------
    ModelError
        If there is no such kind.
    """
    if kind == "complex":
        return ComplexResidual(measured, variance)
    if kind == "log_magnitude":
        return LogMagnitudeResidual(measured, variance)
    raise ModelError(f"residuals: found kind {kind!r}; expected one of {', '.join(get_args(ResidualKind))}")


def _paired(values: NDArray[Any]) -> NDArray[Any]:
    """Outputs and inputs joined to pairs: shape (n, lines, outputs·inputs)."""
    return values.reshape(*values.shape[:2], math.prod(values.shape[2:]))  # n may be 0: nothing of the joint yields


#: Of the logarithm of a quantity, in differences.
STEP = 1e-5


class Likelihood(ABC):
    """What all kinds of data have in common.

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

    @property
    def has_slope(self) -> bool:
        """Whether `gradient` is there, where the noise is Gaussian of known size."""
        return True

    @property
    def sums_squares(self) -> bool:
        """Whether ln L of measured lines depends on the residuals by the sum of their squares alone."""
        return False

    def with_squares(self, squares: SumOfSquares) -> Self:
        """The same likelihood with the sum of squares computed in another way, where `sums_squares`."""
        raise NotImplementedError

    def hyper(self, factors: ArrayLike) -> Array:
        """Parameters of the noise model among factors (batch, q), shape (batch, hyper_count)."""
        factor_rows = np.atleast_2d(np.asarray(factors, dtype=float))
        return factor_rows[:, factor_rows.shape[1] - self.hyper_count :]

    @abstractmethod
    def log_likelihood(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """ln L, shape (batch,), of joint matrices, shape (batch, r, r), and factors, shape (batch, q).

        −inf where the model has no finite value: a joint that resonates, undamped, on a line.
        """

    @abstractmethod
    def standardised(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Residuals:
        """Residuals over σ, shape (batch, lines, pairs), or (batch, n)."""

    @abstractmethod
    def predicted(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> NDArray[Any]:
        """What is compared with the data: FRFs (batch, lines, outputs, inputs), or natural frequencies (batch, n)."""

    @abstractmethod
    def variance(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """σ² of what is compared, of the shape of `predicted`: as stated, with what else is known to be noise."""

    @abstractmethod
    def white(self, matrices: AnyJointMatrix, factors: ArrayLike) -> Array:
        """Real residuals, shape (batch, m), that are white with unit variance if model and noise hold."""

    def plain_residuals(
        self, matrix: AnyJointMatrix, directions: AnyJointMatrix, factors: ArrayLike | None = None
    ) -> Array:
        """Residuals over their stated deviations, then their derivatives, shape (1 + p + q, m), for one joint.

        Asked where tests share errors, of real values only.
        """
        raise NotImplementedError

    def draw_shared(self, factors: ArrayLike, rng: np.random.Generator) -> dict[int, Residuals]:
        """Noise of tests that share errors, drawn for all of them together: z by the place of each; by default none."""
        return {}

    def draw_error_size(
        self, law: Hashable, matrices: AnyJointMatrix, factors: ArrayLike, rng: np.random.Generator
    ) -> Array | None:
        """Sizes of errors that are `NoiseModel.shares`, shape (batch, q), drawn given the data; None where none are."""
        return None

    def shift_of_edges(self, law: Hashable, matrices: AnyJointMatrix, factors: ArrayLike) -> Array:
        """Mean of the place of each clamp's edge, in its standard deviations, shape (batch, edges)."""
        return np.empty((len(joint_matrix_of(matrices)), 0))

    def typical_squares(self, matrices: AnyJointMatrix, factors: ArrayLike) -> tuple[float, int]:
        """Sum and number of the squared white residuals of one joint, in units of the noise that the data show."""
        residual = self.white(matrices, factors)[0]
        total = float(residual @ residual)
        # where its size is integrated out
        return total / self.noise.typical_scale(total / 2, residual.size // self.noise.parts) ** 2, residual.size

    @abstractmethod
    def add_noise(self, predicted: NDArray[Any], z: NDArray[Any]) -> NDArray[Any]:
        """What would be measured: `predicted` of one joint with noise, z of a noise model, both as the data in shape.

        E|z|² is 1 of complex residuals and 1/2 of real ones.
        """

    @abstractmethod
    def pointwise(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """ln L value by value, shape (batch, …), where residuals are independent.

        Raises
        ------
        ModelError
            If the noise model correlates them, or errors of a measured body do.
        """

    @abstractmethod
    def gradient(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """ln L (batch,) and its gradient S (batch, r, r) by the joint: d ln L = Σ S_ij dK_ij for symmetric dK.

        Raises
        ------
        ModelError
            If the noise is not Gaussian of known size.
        """

    @abstractmethod
    def residuals(
        self, matrix: AnyJointMatrix, directions: AnyJointMatrix, factors: ArrayLike | None = None
    ) -> tuple[Array, Array]:
        """Standardised residuals e (m,) and their derivative (m, p + q), for one joint.

        Along changes dK^J (p, r, r), exact, and along the logarithms of the factors (q,), by differences. Columns of
        the noise model's parameters are zero: it is held fixed, and whitens residual and derivative alike.
        """


def moved_factors(factors: Array) -> Array:
    """Factors (1, n) with each in turn a little larger, then a little smaller, shape (2n, n)."""
    step = np.exp(STEP * np.eye(factors.shape[1]))
    return np.concatenate([factors * step, factors / step])
