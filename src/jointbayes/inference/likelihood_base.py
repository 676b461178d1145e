"""What likelihoods of FRFs and of natural frequencies have in common.

Each offers ln L for a batch, and for one point the standardised residuals e, with ln L = constant − eᵀe/2 for Gaussian
noise of known size, and their Jacobian.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.inference.noise.base import NoiseModel, Residuals
from jointbayes.joint import AnyJointMatrix

#: Of the logarithm of a quantity, in differences.
STEP = 1e-5


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
    def log_likelihood(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """ln L, shape (batch,), of joint matrices, shape (batch, r, r), and factors, shape (batch, q).

        −inf where the model has no finite value: a joint that resonates, undamped, on a line.
        """

    @abstractmethod
    def standardised(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Residuals:
        """Residuals over σ, shape (batch, lines, pairs), see `jointbayes.inference.residuals`, or (batch, n)."""

    @abstractmethod
    def predicted(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> NDArray[Any]:
        """What is compared with the data: FRFs (batch, lines, outputs, inputs), or natural frequencies (batch, n)."""

    @abstractmethod
    def variance(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """σ² of what is compared, of the shape of `predicted`: as stated, with what else is known to be noise."""

    @abstractmethod
    def white(self, matrices: AnyJointMatrix, factors: ArrayLike) -> Array:
        """Real residuals, shape (batch, m), that are white with unit variance if model and noise hold."""

    def typical_squares(self, matrices: AnyJointMatrix, factors: ArrayLike) -> tuple[float, int]:
        """Sum and number of the squared white residuals of one joint, in units of the noise that the data show."""
        residual = self.white(matrices, factors)[0]
        total = float(residual @ residual)
        # where its size is integrated out
        return total / self.noise.typical_scale(total / 2, residual.size // self.noise.parts) ** 2, residual.size

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
