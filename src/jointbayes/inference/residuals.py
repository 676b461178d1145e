"""What is compared with a measured FRF: the complex value, or its logarithmic magnitude.

Each kind turns predicted FRFs into standardised residuals z for a noise model (`noise.py`), such that the total
ln L = kind.constant + noise.log_likelihood(z, hyper).
"""

import math
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError, ModelError

ComplexArray = NDArray[np.complex128]
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
