"""Priors on the coordinates of a joint: normal or uniform in each, truncated to possible joints."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.joint import Parametrisation

__all__ = ["JointPrior", "Marginal", "Normal", "Uniform"]

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

    def sample(self, rng: np.random.Generator, size: int) -> Array:
        """Independent draws, shape (size,)."""
        return rng.uniform(self.low, self.high, size)


Marginal = Normal | Uniform


@dataclass(frozen=True, slots=True)
class JointPrior:
    """Independent priors on the coordinates θ of a joint, cut off where K^J is not positive definite.

    Parameters
    ----------
    parametrisation
        Gives θ its meaning.
    marginals
        One prior per coordinate, in the parametrisation's order.

    Raises
    ------
    ModelError
        If there are not as many marginals as coordinates.
    """

    parametrisation: Parametrisation
    marginals: tuple[Marginal, ...]

    def __post_init__(self) -> None:
        if len(self.marginals) != len(self.parametrisation.names):
            raise ModelError(
                f"prior: found {len(self.marginals)} marginals; expected one for each of "
                f"{', '.join(self.parametrisation.names)}"
            )

    @property
    def mean(self) -> Array:
        """Mean of each marginal before the cut, shape (d,)."""
        return np.array([m.mean for m in self.marginals])

    @property
    def sd(self) -> Array:
        """Standard deviation of each marginal before the cut, shape (d,)."""
        return np.array([m.sd for m in self.marginals])

    @property
    def precision(self) -> Array:
        """−∂² ln p/∂θ² of each marginal, shape (d,)."""
        return np.array([m.precision for m in self.marginals])

    @property
    def support(self) -> tuple[Array, Array]:
        """Lower and upper ends of the box outside which the density is zero, each shape (d,)."""
        ends = np.array([m.support for m in self.marginals]).reshape(-1, 2)  # a rigid joint has no coordinate
        return ends[:, 0], ends[:, 1]

    def log_density(self, theta: ArrayLike) -> Array:
        """ln p(θ), shape (n,), for θ of shape (n, d); −inf where impossible.

        The constant that the cut adds is left out: it matters only for evidence.
        """
        t = np.atleast_2d(np.asarray(theta, dtype=float))
        total = sum((m.log_density(t[:, i]) for i, m in enumerate(self.marginals)), np.zeros(len(t)))
        return np.where(self.parametrisation.feasible(t), total, -np.inf)

    def sample(self, rng: np.random.Generator, size: int) -> Array:
        """Independent draws of θ from the prior, cut included, shape (size, d).

        Raises
        ------
        ModelError
            If hardly any draw gives a positive definite joint: the marginals contradict each other.
        """
        kept: list[Array] = []
        for _ in range(1000):
            theta = np.stack([*(m.sample(rng, size) for m in self.marginals), np.empty(size)], axis=-1)[:, :-1]
            kept.append(theta[self.parametrisation.feasible(theta)])
            if sum(map(len, kept)) >= size:
                return np.concatenate(kept)[:size]
        raise ModelError(
            "prior: found almost no joint with k12² <= k11·k22 among its draws; expected priors that overlap with "
            "positive definite joints; lower the prior of k12 or raise those of k11 and k22"
        )
