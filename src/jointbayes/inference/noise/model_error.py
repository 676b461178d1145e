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
)
from jointbayes.inference.prior import Nuisance
from jointbayes.measurement import Data, ModalData

#: Sizes of the error of a frequency over which is integrated, in standard deviations of the prior of its logarithm:
#: of a factor of 3 the steps are small beside what twenty frequencies leave open of the size.
_NODES = np.linspace(-5.0, 5.0, 41)


def noise_of(sizes: ErrorSizes, data: ModalData) -> tuple[NoiseModel, tuple[Nuisance, ...]]:
    """The noise model of measured modes with errors of the model, which has no parameters."""
    return ModelErrorNoise.of(data, sizes), ()


@dataclass(frozen=True, eq=False)
class ModelErrorNoise(NoiseModel):
    """The stated errors of measured modes, and an error of the model in each value that repeats in every test.

    With r the residuals over their standard deviations, E r rᵀ = 1 + Σ_k a_k a_kᵀ. Here k runs over the frequencies,
    antiresonances, damping ratios, components of shapes and modal constants, and a_k holds the size of the model's
    error in k, over the standard deviation, at each place where k was measured: in repetitions, or in several tests of
    one structure. That of a frequency, also of an antiresonance, is s times it, with s unknown; the others are of known
    size. What an error does to several tests alike is no evidence of a change of the joint between them. All is in
    closed form: the covariance is turned once, so that it is diagonal for every s, and the density is the mean over the
    log-normal prior of s. Sampled, s and the residuals would make a funnel where there are as many stiffnesses as
    frequencies.

    Parameters
    ----------
    parts
        1: residuals are real.
    quantity
        What each value is, as `ModalData.value_names`; the same where it is that of one error; shape (m,).
    relative
        What the errors are fractions of, over the standard deviations: values, of eigenvalues twice, of shapes 1; (m,).
    sizes
        Of the errors.

    References
    ----------
    Kennedy, M. C., O'Hagan, A. (2001). Bayesian calibration of computer models. Journal of the Royal Statistical
    Society B 63(3), 425-464. DOI 10.1111/1467-9868.00294
    """

    parts: int
    quantity: tuple[str, ...]
    relative: Array
    sizes: ErrorSizes

    names: ClassVar[tuple[str, ...]] = ()
    takes_white_residuals: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "relative", read_only(self.relative))

    @classmethod
    def of(cls, data: ModalData, sizes: ErrorSizes) -> Self:
        """The model of measured modes."""
        kinds = [name.split()[0] for name in data.value_names]
        unit = np.where(np.equal(kinds, "shape"), 1.0, np.abs(data.values)) * np.where(
            np.equal(kinds, "eigenvalue"), 2, 1
        )
        names = tuple(name.replace("eigenvalue", "frequency") for name in data.value_names)
        return cls(1, names, unit / data.sd, sizes)

    def fitted_to(self, data: Data, parts: int) -> Self:
        """The same law for the values of another measurement."""
        if data.modes is None:
            raise ModelError(f"model error of modes: found {data.words}; expected modes")
        return type(self).of(data.modes, self.sizes)

    @property
    def shares(self) -> ErrorSizes:
        """Tests share errors whose sizes have one prior."""
        return self.sizes

    def shared(self, noises: "Sequence[ModelErrorNoise]", bodies: Sequence[int]) -> "ModelErrorNoise":
        """The model of several tests, one after the other, with one size s; errors are those of one body."""
        pairs = zip(noises, bodies, strict=True)
        quantity = tuple(f"{name} of body {body}" for noise, body in pairs for name in noise.quantity)
        return replace(self, quantity=quantity, relative=np.concatenate([noise.relative for noise in noises]))

    @cached_property
    def _turned(self) -> tuple[Array, Array, float]:
        """W (m, m), g (m,) and ln det W with W (1 + F + s² G) Wᵀ = 1 + s² diag(g), of the errors F of known size."""
        same = np.equal.outer(self.quantity, self.quantity)
        repeated = np.where(same, np.outer(self.relative, self.relative), 0.0)
        known = {"damping": self.sizes.damping, "shape": self.sizes.shape, "constant": self.sizes.constant}
        size = np.array([known.get(name.split()[0], 0.0) for name in self.quantity])
        lower = np.linalg.cholesky(np.eye(len(same)) + np.outer(size, size) * repeated)
        inverse = np.linalg.inv(lower)
        frequency = size == 0
        growth, turn = np.linalg.eigh(inverse @ (np.outer(frequency, frequency) * repeated) @ inverse.T)
        return turn.T @ inverse, np.maximum(growth, 0.0), -float(np.log(np.diag(lower)).sum())

    @cached_property
    def _by_node(self) -> tuple[Array, Array]:
        """Of each s the precision of turned residuals (k, m), and ln of prior weight and peak density (k,)."""
        size = self.sizes.frequency * self.sizes.factor**_NODES
        variance = 1.0 + size[:, None] ** 2 * self._turned[1]
        weight = np.exp(-0.5 * _NODES**2)
        return 1 / variance, np.log(weight / weight.sum()) - 0.5 * np.log(variance).sum(axis=1)

    def _by_size(self, z: Residuals) -> tuple[Array, Array]:
        """Turned residuals (n, m), and ln of prior times likelihood of each size s, (n, k)."""
        turned = z[:, :, 0] @ self._turned[0].T
        precision, peak = self._by_node
        return turned, peak - turned**2 @ precision.T

    def log_likelihood(self, z: Residuals, hyper: ArrayLike) -> Array:
        """ln L (n,) of residuals (n, m, 1), without the constant; −inf where a residual is not finite."""
        with np.errstate(all="ignore"):
            _, by_size = self._by_size(z)
            most = by_size.max(axis=1)
            return finite_or_impossible(self._turned[2] + most + np.log(np.exp(by_size - most[:, None]).sum(axis=1)))

    def _given(self, z: Residuals) -> tuple[Array, Array]:
        """Turned residuals (n, m), and the probability of each size s given them, (n, k)."""
        with np.errstate(invalid="ignore"):
            turned, by_size = self._by_size(z)
            share = np.exp(by_size - by_size.max(axis=1, keepdims=True))
            return turned, share / share.sum(axis=1, keepdims=True)

    def scores(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """Turned residuals, each times the root of its mean precision over the sizes s that all of them leave."""
        turned, share = self._given(z)
        return (turned * np.sqrt(share @ self._by_node[0]))[:, :, None]

    def whiten(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """Residuals and their derivatives (k, m, 1) by the precision of the former: ∇ ln L is then −Jᵀe."""
        _, share = self._given(z[:1])
        return (z[:, :, 0] @ self._turned[0].T * np.sqrt(share @ self._by_node[0]))[:, :, None]

    def draw(self, rng: np.random.Generator, hyper: ArrayLike, lines: int, pairs: int) -> Residuals:
        """Replicated residuals, shape (n, m, 1), one for each row of `hyper`: (n, 1) of that size, (n, 0) of any."""
        size = np.atleast_2d(np.asarray(hyper, dtype=float))
        if not size.shape[1]:
            size = self.sizes.frequency * self.sizes.factor ** rng.standard_normal((len(size), 1))
        turned = math.sqrt(0.5) * rng.standard_normal((len(size), lines)) * np.sqrt(1.0 + size**2 * self._turned[1])
        return np.linalg.solve(self._turned[0], turned.T).T[:, :, None]

    def draw_size(self, rng: np.random.Generator, z: Residuals) -> Array:
        """Size s of the error of a frequency, as a fraction, shape (n,), drawn given each of residuals (n, m, 1)."""
        _, share = self._given(z)
        node = (share.cumsum(axis=1) < rng.random((len(share), 1))).sum(axis=1).clip(max=len(_NODES) - 1)
        within = (_NODES[1] - _NODES[0]) * (rng.random(len(share)) - 0.5)
        return np.asarray(self.sizes.frequency * self.sizes.factor ** (_NODES[node] + within))

    def words(self, values: Mapping[str, float], z: Residuals) -> tuple[str, ...]:
        """The size of the error that residuals at draws show, in a sentence."""
        size = np.median(self.draw_size(np.random.default_rng(0), z))
        return (f"The model's error in a natural frequency was inferred as {100 * size:.2g} %.",)
