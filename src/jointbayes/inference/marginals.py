"""Distributions of one coordinate: what the prior of each is made of."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from jointbayes.errors import ModelError

__all__ = ["Marginal", "Normal", "Uniform"]

Array = NDArray[np.float64]

_NORMAL_95 = 1.959963984540054


@dataclass(frozen=True, slots=True)
class Normal:
    """Normal prior on one coordinate (ln k, so log-normal in k).

    Raises
    ------
    ModelError
        If the standard deviation is not positive.
    """

    mean: float
    sd: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.mean) and math.isfinite(self.sd) and self.sd > 0):
            raise ModelError(f"prior: found mean {self.mean:g}, sd {self.sd:g}; expected a finite mean and sd > 0")

    @classmethod
    def from_decades(cls, guess: float, decades: float) -> Self:
        """Half-informative prior: a guess of k that is right to within so many decades either way, 95 % sure."""
        if not (guess > 0 and decades > 0):
            raise ModelError(f"prior: found guess {guess:g}, decades {decades:g}; expected both above 0")
        return cls(math.log(guess), decades * math.log(10) / _NORMAL_95)

    @property
    def support(self) -> tuple[float, float]:
        """Where the density is above zero."""
        return -math.inf, math.inf

    @property
    def precision(self) -> float:
        """−∂² ln p/∂θ²."""
        return 1 / self.sd**2

    def log_density(self, theta: Array) -> Array:
        """Log density; θ of any shape."""
        return -0.5 * ((theta - self.mean) / self.sd) ** 2 - math.log(self.sd * math.sqrt(2 * math.pi))

    def cdf(self, theta: Array) -> Array:
        """Probability below θ; of any shape."""
        return ndtr((theta - self.mean) / self.sd)

    def ppf(self, probability: Array) -> Array:
        """θ below which there is so much probability; of any shape."""
        return self.mean + self.sd * ndtri(probability)

    def sample(self, rng: np.random.Generator, size: int) -> Array:
        """Independent draws, shape (size,)."""
        return rng.normal(self.mean, self.sd, size)


@dataclass(frozen=True, slots=True)
class Uniform:
    """Uniform prior on one coordinate between `low` and `high`.

    Raises
    ------
    ModelError
        If not low < high.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        if not -math.inf < self.low < self.high < math.inf:
            raise ModelError(f"prior: found low {self.low:g}, high {self.high:g}; expected finite low < high")

    @property
    def mean(self) -> float:
        """Middle of the interval."""
        return (self.low + self.high) / 2

    @property
    def sd(self) -> float:
        """Standard deviation, (high − low)/√12."""
        return (self.high - self.low) / math.sqrt(12)

    @property
    def support(self) -> tuple[float, float]:
        """Where the density is above zero."""
        return self.low, self.high

    @property
    def precision(self) -> float:
        """−∂² ln p/∂θ²: zero inside."""
        return 0.0

    def log_density(self, theta: Array) -> Array:
        """Log density; θ of any shape."""
        inside = (theta >= self.low) & (theta <= self.high)
        return np.where(inside, -math.log(self.high - self.low), -np.inf)

    def cdf(self, theta: Array) -> Array:
        """Probability below θ; of any shape."""
        return np.clip((theta - self.low) / (self.high - self.low), 0.0, 1.0)

    def ppf(self, probability: Array) -> Array:
        """θ below which there is so much probability; of any shape."""
        return self.low + (self.high - self.low) * probability

    def sample(self, rng: np.random.Generator, size: int) -> Array:
        """Independent draws, shape (size,)."""
        return rng.uniform(self.low, self.high, size)


Marginal = Normal | Uniform
