"""What is compared of measured and predicted FRFs: the complex numbers, or the logarithms of their magnitudes."""

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["ResidualKind", "residual_constant", "standardised_residuals"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
ResidualKind = Literal["complex", "log_magnitude"]

#: Variance of ln|z| of complex noise alone, without any signal: more than that it never is.
_NOISE_ALONE = math.pi**2 / 24


def standardised_residuals(kind: ResidualKind, predicted: ComplexArray, measured: ComplexArray, variance: Array) -> ComplexArray:
    """Residuals over their standard deviation.

    Parameters
    ----------
    kind
        ``"complex"``: (H − H^x)/σ.  ``"log_magnitude"``: (ln|H| − ln|H^x|)/(√2 s), a real number, s² being the variance
        of ln|H^x|; for data whose phase cannot be trusted.
    predicted
        H, shape (n, lines, outputs, inputs).
    measured, variance
        H^x and σ² = E|δH|², shape (lines, outputs, inputs).

    Returns
    -------
    ndarray, shape (n, lines, outputs·inputs)
        z, in either case such that −|z|² is the exponent of the Gaussian density.
    """
    if kind == "complex":
        z = (predicted - measured) / np.sqrt(variance)
    else:
        z = (np.log(np.abs(predicted)) - np.log(np.abs(measured))) / np.sqrt(2 * _log_variance(measured, variance))
    return np.asarray(z, dtype=complex).reshape(*predicted.shape[:2], -1)


def residual_constant(
    kind: ResidualKind, measured: ComplexArray, variance: Array, *, pointwise: bool = False
) -> "Array | float":
    """Logarithm of the Gaussian density where the residual is zero, of H^x or of ln|H^x|; the sum, or value by value.

    Arrays as for `standardised_residuals`; value by value the shape is (lines, outputs·inputs).
    """
    if kind == "complex":
        each = -np.log(math.pi * variance)
    else:
        each = -0.5 * np.log(2 * math.pi * _log_variance(measured, variance))
    return each.reshape(len(each), -1) if pointwise else float(each.sum())


def _log_variance(measured: ComplexArray, variance: Array) -> Array:
    """Variance of ln|H^x|: σ²/2 of the part along H^x, over |H^x|²."""
    magnitude = np.maximum(np.abs(measured), np.finfo(float).tiny)
    return np.minimum(variance / (2 * magnitude**2), _NOISE_ALONE)
