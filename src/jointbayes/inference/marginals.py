"""Distributions of one coordinate: what the prior of each is made of."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from jointbayes.errors import ModelError
from jointbayes.structure import is_additive
from vibrecords.arrays import Array

_NORMAL_95 = 1.959963984540054
_OWN_DRAWS = 2**16
_FEWEST = 1e-9  # probability above zero of a prior on a stiffness: of less no digits are left


_WIDEST = 1e100  # of a coordinate: squares of what is below stay finite


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
    #: Where the density is above zero.
    support: ClassVar[tuple[float, float]] = (-math.inf, math.inf)

    def __post_init__(self) -> None:
        if not (abs(self.mean) < _WIDEST and 1 / _WIDEST < self.sd < _WIDEST):
            raise ModelError.of("prior", (), f"found mean {self.mean:g}, sd {self.sd:g}", "a finite mean and sd > 0")

    @classmethod
    def from_decades(cls, guess: float, decades: float) -> Self:
        """Half-informative prior: a guess of k that is right to within so many decades either way, 95 % sure."""
        if not (0 < guess < math.inf and 0 < decades < math.inf):
            raise ModelError.of("prior", (), f"found guess {guess:g}, decades {decades:g}", "both above 0")
        return cls(math.log(guess), decades * math.log(10) / _NORMAL_95)

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


def _wrong_ends(low: float, high: float, also: str = "") -> ModelError:
    expected = f"finite numbers {also}low < high"
    return ModelError.of("prior", ("high",), f"found low {low:g}, high {high:g}", expected, "exchange or correct them")


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
    #: −∂² ln p/∂θ²: zero inside.
    precision: ClassVar[float] = 0.0

    def __post_init__(self) -> None:
        if not -_WIDEST < self.low < self.high < _WIDEST:
            raise _wrong_ends(self.low, self.high)

    @classmethod
    def of_logarithm(cls, low: float, high: float) -> Self:
        """Uniform in ln k between two stiffnesses: nothing is known but the range."""
        if not 0 < low < high < math.inf:
            raise _wrong_ends(low, high, "above 0 and ")
        return cls(math.log(low), math.log(high))

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


@dataclass(frozen=True, eq=False)
class OwnMarginal:
    """A prior of one's own on one coordinate: a frozen distribution of scipy.stats.

    Its middle and width are those of 2¹⁶ draws with a fixed seed.

    Parameters
    ----------
    given
        The distribution.

    Raises
    ------
    ModelError
        If it is something else, or its draws are not finite numbers.
    """

    given: Any

    def __post_init__(self) -> None:
        if not all(hasattr(self.given, name) for name in ("dist", "args", "kwds", "logpdf", "ppf")):
            found = f"found {type(self.given).__name__}"
            remedy = "give one of these, for a law of your own a subclass of scipy.stats.rv_continuous"
            raise ModelError.of("prior", (), found, "Normal, Uniform or a frozen distribution of scipy.stats", remedy)
        if self._drawn.shape != (_OWN_DRAWS,) or not np.isfinite(self._drawn).all() or not self.sd > 0:
            found = f"found draws of shape {self._drawn.shape} that are not all finite, or all alike"
            raise ModelError.of(f"prior {self!r}", (), found, f"{_OWN_DRAWS} different finite numbers of its rvs")

    def __repr__(self) -> str:
        arguments = [*map(str, self.given.args), *(f"{name}={value}" for name, value in self.given.kwds.items())]
        return f"scipy.stats.{self.given.dist.name}({', '.join(arguments)})"

    @cached_property
    def _drawn(self) -> Array:
        """Draws in rising order."""
        return np.sort(np.asarray(self.sample(np.random.default_rng(0), _OWN_DRAWS), dtype=float))

    @cached_property
    def mean(self) -> float:
        """Median: a long tail has no part in it."""
        return float(np.median(self._drawn))

    @cached_property
    def sd(self) -> float:
        """Half the width of the central 68.3 %, which a long tail leaves finite."""
        low, high = np.quantile(self._drawn, ndtr([-1.0, 1.0]))
        return float(high - low) / 2

    @cached_property
    def support(self) -> tuple[float, float]:
        """Where the density is above zero, as far as the distribution says."""
        low, high = self.given.support()
        return float(low), float(high)

    @property
    def precision(self) -> float:
        """Curvature of a normal distribution of the same width: where a search takes its steps from."""
        return 1 / self.sd**2

    def log_density(self, theta: Array) -> Array:
        """Log density; θ of any shape."""
        flat = np.ravel(theta)
        return np.asarray(self.given.logpdf(flat), dtype=float).reshape(np.shape(theta))

    def cdf(self, theta: Array) -> Array:
        """Probability below θ; of any shape."""
        return np.asarray(self.given.cdf(theta))

    def ppf(self, probability: Array) -> Array:
        """θ below which there is so much probability; of any shape."""
        return np.asarray(self.given.ppf(probability))

    def sample(self, rng: np.random.Generator, size: int) -> Array:
        """Independent draws, shape (size,)."""
        return np.asarray(self.given.rvs(size=size, random_state=rng))


@dataclass(frozen=True)
class OfStiffness:
    """A prior on a stiffness itself, in its unit, as the prior on its logarithm that it amounts to.

    The density of θ = ln k is k's own times dk/dθ = k, cut off where k is not above zero. A uniform prior on k has
    nine tenths of its probability in the uppermost decade.

    Parameters
    ----------
    given
        The distribution of k: `Normal`, `Uniform`, or a distribution of one's own.

    Raises
    ------
    ModelError
        If it leaves no stiffness above zero.

    Examples
    --------
    >>> import numpy as np
    >>> prior = OfStiffness(Uniform(1e6, 3e6))  # N/m
    >>> round(float(np.exp(prior.ppf(np.array(0.5)))), 3)
    2000000.0
    """

    given: "Normal | Uniform | OwnMarginal"

    def __post_init__(self) -> None:
        marginal = marginal_of(self.given)
        object.__setattr__(self, "given", marginal)
        if isinstance(marginal, OfStiffness):
            raise ModelError.of("prior", (), "found OfStiffness of OfStiffness", "a distribution of k", "give it once")
        if not (self._above > _FEWEST and marginal.support[1] > 0 and math.isfinite(self.sd) and self.sd > 0):
            found = f"found {marginal!r}, which leaves none above zero"
            expected = "a distribution of k, in its unit, with values above 0"
            raise ModelError.of("prior of a stiffness", (), found, expected, "correct it, or state a prior on ln k")

    @cached_property
    def _below(self) -> float:
        """Probability that the given distribution has below zero."""
        return float(self.given.cdf(np.array(0.0)))

    @property
    def _above(self) -> float:
        return 1.0 - self._below

    @cached_property
    def mean(self) -> float:
        """Median: a long tail, here towards small stiffnesses, has no part in it."""
        return float(self.ppf(np.array(0.5)))

    @cached_property
    def sd(self) -> float:
        """Half the width of the central 68.3 % in ln k."""
        low, high = self.ppf(ndtr(np.array([-1.0, 1.0])))
        return float(high - low) / 2

    @property
    def support(self) -> tuple[float, float]:
        """Ends of ln k between which the density is above zero."""
        low, high = self.given.support
        return math.log(low) if low > 0 else -math.inf, math.log(high)

    @property
    def precision(self) -> float:
        """Curvature of a normal distribution of the same width: where a search takes its steps from."""
        return 1 / self.sd**2

    def log_density(self, theta: Array) -> Array:
        """Log density of ln k; θ of any shape."""
        t = np.asarray(theta, dtype=float)
        with np.errstate(over="ignore"):
            k = np.exp(t)
        # an end that was taken to its logarithm and back may lie beyond itself by rounding
        low, high = self.given.support
        near = np.where((t >= self.support[0]) & (t <= self.support[1]), np.clip(k, low, high), k)
        return self.given.log_density(near) + t - math.log(self._above)

    def cdf(self, theta: Array) -> Array:
        """Probability below θ = ln k; of any shape."""
        with np.errstate(over="ignore"):
            below = self.given.cdf(np.exp(np.asarray(theta, dtype=float)))
        return np.maximum(below - self._below, 0.0) / self._above

    def ppf(self, probability: Array) -> Array:
        """ln k below which there is so much probability; of any shape."""
        k = self.given.ppf(self._below + np.asarray(probability, dtype=float) * self._above)
        return np.log(np.maximum(k, np.finfo(float).tiny))

    def sample(self, rng: np.random.Generator, size: int) -> Array:
        """Independent draws of ln k, shape (size,)."""
        return self.ppf(rng.uniform(size=size))


Marginal = Normal | Uniform | OwnMarginal | OfStiffness


@dataclass(frozen=True, eq=False)
class Independent:
    """Independent marginals, one for each coordinate, as a distribution to propose from: a prior without its cut."""

    marginals: tuple[Marginal, ...]

    def draw(self, random: np.random.Generator | np.random.RandomState, n: int) -> Array:
        """Independent draws, shape (n, d)."""
        assert isinstance(random, np.random.Generator)
        return np.stack([marginal.sample(random, n) for marginal in self.marginals], axis=1)

    def log_density(self, x: Array) -> Array:
        """Log of the normalised density, shape (n,), at x, shape (n, d)."""
        return np.sum([m.log_density(column) for m, column in zip(self.marginals, x.T, strict=True)], axis=0)


def marginal_of(given: object) -> Marginal:
    """A prior on one coordinate as it is, or a distribution of one's own as `OwnMarginal`."""
    return given if isinstance(given, Marginal) else OwnMarginal(given)


@dataclass(frozen=True, slots=True)
class Nuisance:
    """A quantity besides the joint that is not exactly known; its coordinate is ln(value/nominal).

    The coordinate of an offset, ``length_offset``, is value/nominal itself: the offset in m, of either sign.

    Parameters
    ----------
    name
        Such as ``youngs_modulus``, see `jointbayes.structure.STRUCTURE_QUANTITIES`, or one of the noise model's.
    unit
        Unit of the value.
    nominal
        Value at coordinate 0, above zero; of an offset what a metre is in the unit: 1000 for mm.
    prior
        Prior on the coordinate: `Normal`, `Uniform`, or a distribution of one's own as for `JointPrior`.

    Raises
    ------
    ModelError
        If the nominal value is not positive, or the prior is one on a stiffness.
    """

    name: str
    unit: str
    nominal: float
    prior: Marginal

    def __post_init__(self) -> None:
        object.__setattr__(self, "prior", marginal_of(self.prior))
        if isinstance(self.prior, OfStiffness):
            expected = f"a prior on ln({self.name}/nominal), since OfStiffness is for stiffnesses of the joint"
            raise ModelError.of(f"{self.name}", (), f"found {self.prior!r}", expected, "give Normal or Uniform")
        if not 0 < self.nominal < math.inf:
            found = f"found a nominal value of {self.nominal:g}"
            expected = "a number above 0 for a quantity that is uncertain by a factor"
            raise ModelError.of(f"{self.name}", (), found, expected, "correct it, or leave the quantity certain")

    @property
    def additive(self) -> bool:
        """Whether it is an offset, whose coordinate is no logarithm."""
        return is_additive(self.name)

    @property
    def label(self) -> str:
        """How its coordinate is written: ``"ln length"``, ``"length_offset"``."""
        return self.name if self.additive else f"ln {self.name}"

    def value(self, coordinate: ArrayLike) -> Array:
        """Value in its unit, of the shape of the coordinates."""
        x = np.asarray(coordinate, dtype=float)
        return self.nominal * (x if self.additive else np.exp(x))

    def coordinate(self, value: ArrayLike) -> Array:
        """Coordinate of a value in its unit."""
        relative = np.asarray(value, dtype=float) / self.nominal
        return relative if self.additive else np.log(relative)

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest coordinate that the forward model is made for: six standard deviations of a normal."""
        low, high = self.prior.support
        wide = 6 * self.prior.sd
        return max(low, self.prior.mean - wide), min(high, self.prior.mean + wide)
