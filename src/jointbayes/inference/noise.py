"""Noise models: how standardised residuals are distributed."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["GaussianNoise", "NoiseModel"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


class NoiseModel(Protocol):
    """Distribution of standardised residuals z, (n, lines, pairs), with parameters hyper, (n, len(names))."""

    names: tuple[str, ...]
    needs_chi2_only: bool

    def log_likelihood(self, z: ComplexArray, hyper: Array) -> Array: ...
    def from_chi2(self, chi2: Array, n_values: int, hyper: Array) -> Array: ...
    def whiten(self, z: ComplexArray, hyper: Array) -> ComplexArray: ...
    def pointwise(self, z: ComplexArray, hyper: Array) -> Array: ...
    def draw(self, rng: np.random.Generator, hyper: Array, lines: int, pairs: int) -> ComplexArray: ...


class GaussianNoise:
    """Known variance."""

    names: tuple[str, ...] = ()
    needs_chi2_only = True

    def __init__(self, parts: int = 2) -> None:
        self.parts = parts

    def log_likelihood(self, z: ComplexArray, hyper: Array) -> Array:
        return -(np.abs(z) ** 2).sum(axis=(1, 2))

    def from_chi2(self, chi2: Array, n_values: int, hyper: Array) -> Array:
        return -chi2

    def whiten(self, z: ComplexArray, hyper: Array) -> ComplexArray:
        return z

    def pointwise(self, z: ComplexArray, hyper: Array) -> Array:
        return -(np.abs(z) ** 2)

    def draw(self, rng: np.random.Generator, hyper: Array, lines: int, pairs: int) -> ComplexArray:
        raise NotImplementedError
