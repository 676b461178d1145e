"""Errors of the model in each mode, shared by all tests of one structure: no structure is exactly as it is modelled."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.frf.frf_set import read_only
from jointbayes.inference.noise.base import (
    ErrorSizes,
    NoiseModel,
    Residuals,
    finite_or_impossible,
    rows_of,
)
from jointbayes.inference.prior import Nuisance
from jointbayes.measurement import Data, ModalData


def noise_of(sizes: ErrorSizes, data: ModalData) -> tuple[NoiseModel, tuple[Nuisance, ...]]:
    """The noise model of measured modes with errors of the model, and the prior of their size."""
    return ModelErrorNoise.of(data, sizes.damping, sizes.shape, sizes.constant), (sizes.prior,)


@dataclass(frozen=True, eq=False)
class ModelErrorNoise(NoiseModel):
    """The stated errors of measured modes, and an error of the model in each value that repeats in every test.

    With r the residuals over their standard deviations, E r rᵀ = 1 + Σ_k a_k a_kᵀ. Here k runs over the frequencies,
    antiresonances, damping ratios, components of shapes and modal constants, and a_k holds the size of the model's
    error in k, over the standard deviation, at each place where k was measured: in repetitions, or in several tests of
    one structure. That of a frequency, also of an antiresonance, is `model_error` times it, which is inferred; the
    others are of known size. What an error does to several tests alike is no evidence of a change of the joint between
    them. All is in closed form: the covariance is turned once, so that for every size it is diagonal.

    Parameters
    ----------
    parts
        1: residuals are real.
    quantity
        What each value is, as `ModalData.value_names`; the same where it is that of one error; shape (m,).
    relative
        What the errors are fractions of, over the standard deviations: values, of eigenvalues twice, of shapes 1; (m,).
    damping, shape, constant
        Error of a damping ratio, of a component of a shape, and of a modal constant, see `ErrorSizes`.

    References
    ----------
    Kennedy, M. C., O'Hagan, A. (2001). Bayesian calibration of computer models. Journal of the Royal Statistical
    Society B 63(3), 425-464. DOI 10.1111/1467-9868.00294
    """

    parts: int
    quantity: tuple[str, ...]
    relative: Array
    damping: float = 0.3
    shape: float = 0.05
    constant: float = 0.1

    names: ClassVar[tuple[str, ...]] = ("model_error",)
    averages_out: ClassVar[bool] = False
    takes_white_residuals: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "relative", read_only(self.relative))

    @classmethod
    def of(cls, data: ModalData, damping: float = 0.3, shape: float = 0.05, constant: float = 0.1) -> Self:
        """The model of measured modes."""
        kinds = [name.split()[0] for name in data.value_names]
        unit = np.where(np.equal(kinds, "shape"), 1.0, np.abs(data.values)) * np.where(
            np.equal(kinds, "eigenvalue"), 2, 1
        )
        names = tuple(name.replace("eigenvalue", "frequency") for name in data.value_names)
        return cls(1, names, unit / data.sd, damping, shape, constant)

    def fitted_to(self, data: Data, parts: int) -> Self:
        """The same law for the values of another measurement."""
        if data.modes is None:
            raise ModelError(f"model error of modes: found {data.words}; expected modes")
        return type(self).of(data.modes, self.damping, self.shape, self.constant)

    def shared(self, noises: Sequence[NoiseModel]) -> "ModelErrorNoise | None":
        """The model of tests of one structure, one after the other; None where there is but one, or another model."""
        own = [noise for noise in noises if isinstance(noise, ModelErrorNoise)]
        if len(own) < 2 or len(own) < len(noises):
            return None
        quantity = tuple(name for noise in own for name in noise.quantity)
        return replace(self, quantity=quantity, relative=np.concatenate([noise.relative for noise in own]))

    @cached_property
    def _turned(self) -> tuple[Array, Array, float]:
        """W (m, m), g (m,) and ln det W with W (1 + F + s² G) Wᵀ = 1 + s² diag(g), of the errors F of known size."""
        same = np.equal.outer(self.quantity, self.quantity)
        repeated = np.where(same, np.outer(self.relative, self.relative), 0.0)
        known = {"damping": self.damping, "shape": self.shape, "constant": self.constant}
        size = np.array([known.get(name.split()[0], 0.0) for name in self.quantity])
        lower = np.linalg.cholesky(np.eye(len(same)) + np.outer(size, size) * repeated)
        inverse = np.linalg.inv(lower)
        frequency = size == 0
        growth, turn = np.linalg.eigh(inverse @ (np.outer(frequency, frequency) * repeated) @ inverse.T)
        return turn.T @ inverse, np.maximum(growth, 0.0), -float(np.log(np.diag(lower)).sum())

    def _variance(self, hyper: ArrayLike, n: int) -> Array:
        """Variance of turned residuals, shape (n, m)."""
        return 1.0 + rows_of(hyper, n, self.names)[:, :1] ** 2 * self._turned[1]

    def log_likelihood(self, z: Residuals, hyper: ArrayLike) -> Array:
        """ln L (n,) of residuals (n, m, 1), without the constant; −inf where a residual is not finite."""
        turn, _, log_det = self._turned
        with np.errstate(all="ignore"):
            variance = self._variance(hyper, len(z))
            turned = z[:, :, 0] @ turn.T
            return finite_or_impossible(log_det - (turned**2 / variance + 0.5 * np.log(variance)).sum(axis=1))

    def scores(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """Turned residuals over their standard deviations."""
        with np.errstate(invalid="ignore"):
            return ((z[:, :, 0] @ self._turned[0].T) / np.sqrt(self._variance(hyper, len(z))))[:, :, None]

    def draw(self, rng: np.random.Generator, hyper: ArrayLike, lines: int, pairs: int) -> Residuals:
        """Replicated residuals, shape (n, m, 1), one for each row of `hyper` (n, 1)."""
        n = len(np.atleast_2d(hyper))
        turned = math.sqrt(0.5) * rng.standard_normal((n, lines)) * np.sqrt(self._variance(hyper, n))
        return np.linalg.solve(self._turned[0], turned.T).T[:, :, None]

    def words(self, values: Mapping[str, float]) -> tuple[str, ...]:
        """What of the noise was inferred, in sentences."""
        return (f"The model's error in a natural frequency was inferred as {100 * values['model_error']:.2g} %.",)
