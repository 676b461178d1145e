"""Densities whose moments and marginals are known in closed form, each with an exact sampler."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import stats


@dataclass(frozen=True)
class Target:
    """A density with known mean, covariance, marginal distributions and an exact sampler."""

    log_density: Callable[[np.ndarray], np.ndarray]
    exact: Callable[[int, np.random.Generator], np.ndarray]
    mean: np.ndarray
    covariance: np.ndarray
    marginals: tuple[Callable[[np.ndarray], np.ndarray], ...]


def gaussian(dimension):
    scale = np.linspace(1.0, 3.0, dimension)
    correlation = 0.9 ** np.abs(np.subtract.outer(np.arange(dimension), np.arange(dimension)))
    covariance = correlation * np.outer(scale, scale)
    precision, factor = np.linalg.inv(covariance), np.linalg.cholesky(covariance)
    mean = np.arange(dimension) - 1.0

    def log_density(x):
        return -0.5 * np.einsum("ni,ij,nj->n", x - mean, precision, x - mean)

    def exact(n, rng):
        return mean + rng.normal(size=(n, dimension)) @ factor.T

    marginals = tuple(stats.norm(m, s).cdf for m, s in zip(mean, scale, strict=True))
    return Target(log_density, exact, mean, covariance, marginals)


def student_t(freedom=5, dimension=3):
    def log_density(x):
        return -0.5 * (freedom + dimension) * np.log1p(np.sum(x**2, axis=1) / freedom)

    def exact(n, rng):
        return rng.normal(size=(n, dimension)) / np.sqrt(rng.chisquare(freedom, size=(n, 1)) / freedom)

    covariance = np.eye(dimension) * freedom / (freedom - 2)
    return Target(log_density, exact, np.zeros(dimension), covariance, (stats.t(freedom).cdf,) * dimension)


def banana(width=0.5):
    """x ~ N(0, 1), y | x ~ N(x², width²): E y = 1, var y = 2 + width², cov = 0."""

    def log_density(x):
        return -0.5 * (x[:, 0] ** 2 + ((x[:, 1] - x[:, 0] ** 2) / width) ** 2)

    def exact(n, rng):
        x = rng.normal(size=n)
        return np.column_stack([x, x**2 + width * rng.normal(size=n)])

    grid = np.linspace(-8.0, 80.0, 4001)
    nodes, weights = np.polynomial.hermite_e.hermegauss(200)
    distribution = stats.norm.cdf((grid[:, None] - nodes**2) / width) @ (weights / weights.sum())
    marginals = stats.norm.cdf, lambda y: np.interp(y, grid, distribution)
    return Target(log_density, exact, np.array([0.0, 1.0]), np.diag([1.0, 2.0 + width**2]), marginals)


def truncated_gaussian():
    """Unit Gaussian in 2-D of which only x > 1 is left: a hard wall through the bulk."""

    def exact(n, rng):
        return np.column_stack([stats.truncnorm.rvs(1.0, np.inf, size=n, random_state=rng), rng.normal(size=n)])

    def log_density(x):
        return np.where(x[:, 0] > 1.0, -0.5 * np.sum(x**2, axis=1), -np.inf)

    wall = stats.truncnorm(1.0, np.inf)
    mean, covariance = np.array([wall.mean(), 0.0]), np.diag([wall.var(), 1.0])
    return Target(log_density, exact, mean, covariance, (wall.cdf, stats.norm.cdf))


def two_modes(distance=6.0, weight=0.7):
    """Unit Gaussians at −distance/2 and +distance/2 on the first of two axes, the left one with the given weight."""

    def exact(n, rng):
        side = np.where(rng.random(n) < weight, -distance / 2, distance / 2)
        return rng.normal(size=(n, 2)) + np.column_stack([side, np.zeros(n)])

    def log_density(x):
        left, right = np.log(weight) - distance * x[:, 0] / 2, np.log(1 - weight) + distance * x[:, 0] / 2
        return -0.5 * np.sum(x**2, axis=1) + np.logaddexp(left, right)

    def distribution(x):
        return weight * stats.norm.cdf(x + distance / 2) + (1 - weight) * stats.norm.cdf(x - distance / 2)

    mean, covariance = np.array([(0.5 - weight) * distance, 0.0]), [1.0 + weight * (1 - weight) * distance**2, 1.0]
    return Target(log_density, exact, mean, np.diag(covariance), (distribution, stats.norm.cdf))


TARGETS = {f"gaussian-{d}": gaussian(d) for d in (1, 3, 6)}
TARGETS |= {"student-t": student_t(), "banana": banana(), "truncated": truncated_gaussian(), "two modes": two_modes()}
