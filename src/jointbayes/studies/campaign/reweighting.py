"""Draws of many joints, reweighted from each joint's own prior to a population that all of them come from.

This knows nothing of beams, files or reports: coordinates and densities only.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import log_ndtr, ndtr

from jointbayes.joint import Parametrisation
from vibrecords.arrays import Array

_AT_ONCE = 4_000_000  # weights in memory
_LN_2PI = float(np.log(2 * np.pi))


@dataclass(frozen=True, slots=True, eq=False)
class JointDraws:
    """Posterior draws of many joints in the same coordinates, as many of each.

    Parameters
    ----------
    theta
        Draws, shape (joints, n, d). Those of a joint with fewer are filled up, with any finite numbers.
    log_prior
        ln of the density over these coordinates that each was drawn under, shape (joints, n), up to a constant for each
        joint; +inf where there is no draw.
    """

    theta: Array
    log_prior: Array

    @classmethod
    def stacked(cls, theta: list[Array], log_prior: list[Array]) -> Self:
        """From draws (n_j, d) and log priors (n_j,) of each joint."""
        whole = np.zeros((len(theta), max(map(len, theta)), theta[0].shape[-1]))
        density = np.full(whole.shape[:2], np.inf)
        for j, (draws, value) in enumerate(zip(theta, log_prior, strict=True)):
            whole[j] = draws[:1]
            whole[j, : len(draws)], density[j, : len(draws)] = draws, value
        return cls(whole, density)

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number of draws of each joint, shape (joints,)."""
        return (self.log_prior < np.inf).sum(axis=1)

    @property
    def mean(self) -> Array:
        """Mean of each joint's draws under its own prior, shape (joints, d)."""
        there = (self.log_prior < np.inf)[..., None]
        return np.asarray((self.theta * there).sum(axis=1) / self.counts[:, None])

    @property
    def variance(self) -> Array:
        """Variance of each joint's draws under its own prior, shape (joints, d)."""
        there = (self.log_prior < np.inf)[..., None]
        apart = (self.theta - self.mean[:, None]) * there
        return np.asarray((apart**2).sum(axis=1) / self.counts[:, None])


@dataclass(frozen=True, eq=False)
class Reweighting:
    """Probability of all data given a population's mean and scatter, from draws made without knowing the population.

    The population is normal and independent in each coordinate, cut off where there is no positive definite joint. A
    joint's data have, up to a constant, the probability ∫ p(data | θ) p(θ | μ, σ) dθ, which is the mean over its
    posterior draws of p(θ | μ, σ)/π(θ), π being the prior they were drawn under (Hogg, Myers and Bovy 2010, Eq. 9).

    Parameters
    ----------
    draws
        Of all joints.
    parametrisation
        Says where joints are positive definite; None where every θ is possible.

    References
    ----------
    D. W. Hogg, A. D. Myers, J. Bovy, Inferring the eccentricity distribution (2010),
    DOI 10.1088/0004-637X/725/2/2166.
    """

    draws: JointDraws
    parametrisation: Parametrisation | None = None
    _centre: Array = field(init=False, repr=False)
    _powers: Array = field(init=False, repr=False)
    _log_prior: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        theta = self.draws.theta
        centre = np.median(self.draws.mean, axis=0)
        apart = np.ascontiguousarray((theta - centre).reshape(-1, theta.shape[2]).T)
        object.__setattr__(self, "_centre", centre)
        # ln p(θ | μ, σ) is linear in θ² and θ: one matrix product for all draws and many populations
        object.__setattr__(self, "_powers", np.concatenate([apart**2, apart]))
        object.__setattr__(self, "_log_prior", self.draws.log_prior.ravel())

    def log_likelihood(self, mean: ArrayLike, scatter: ArrayLike) -> Array:
        """ln of the probability of all data, up to a constant, shape (p,).

        A mean of few weights is on average too low in its logarithm by half of its relative variance; that is added.

        Parameters
        ----------
        mean, scatter
            Of the populations, in each coordinate: shape (p, d).
        """
        mu, sigma = np.atleast_2d(np.asarray(mean, float)), np.atleast_2d(np.asarray(scatter, float))
        total = np.empty(len(mu))
        share = 1 / self.draws.counts
        for rows, log_weight in self._blocks(mu, sigma):
            top = log_weight.max(axis=2)
            weight = _exponential(log_weight, top)
            first = weight.sum(axis=2)
            np.multiply(weight, weight, out=weight)
            error = np.maximum(weight.sum(axis=2) / first**2 - share, 0.0)
            total[rows] = (top + np.log(first * share) + error / 2).sum(axis=1)
        return total - len(share) * self.log_possible(mu, sigma)

    def weights(self, mean: Array, scatter: Array) -> tuple[Array, Array]:
        """Weight of each draw, averaged over populations, and each joint's effective number of draws.

        Parameters
        ----------
        mean, scatter
            Equally probable populations, shape (p, d).

        Returns
        -------
        weight : ndarray, shape (joints, n)
            Sums to one for each joint.
        effective : ndarray, shape (joints,)
            1/Σw² of the weights under one population, on average over the populations.
        """
        mixed, effective = np.zeros(self.draws.log_prior.shape), np.zeros(len(self.draws.theta))
        for _, log_weight in self._blocks(mean, scatter):
            weight = _exponential(log_weight, log_weight.max(axis=2))
            weight /= weight.sum(axis=2, keepdims=True)
            mixed += weight.sum(axis=0)
            effective += (1 / (weight**2).sum(axis=2)).sum(axis=0)
        return mixed / len(mean), effective / len(mean)

    def score_covariance(self, mean: Array, scatter: Array) -> Array:
        """Monte Carlo covariance of the slope of `log_likelihood` over (μ, ln σ) at one population, shape (2d, 2d).

        What so few draws of each joint leave uncertain about the slope, and so about the place of the maximum.
        """
        weight, _ = self.weights(mean[None], scatter[None])
        z = (self.draws.theta - mean) / scatter
        slope = np.concatenate([z / scatter, z**2 - 1], axis=2)
        slope -= np.einsum("jn,jnk->jk", weight, slope)[:, None]
        slope *= weight[..., None]
        flat = slope.reshape(-1, slope.shape[2])
        return np.asarray(flat.T @ flat)

    def moments(self, mean: Array, scatter: Array) -> tuple[Array, Array]:
        """Mean and scatter, each (d,), that joints have if they come from this population: one step of EM."""
        weight, _ = self.weights(mean[None], scatter[None])
        middle = np.einsum("jn,jnk->k", weight, self.draws.theta) / len(weight)
        square = np.einsum("jn,jnk->k", weight, (self.draws.theta - middle) ** 2) / len(weight)
        return middle, np.sqrt(square)

    def log_possible(self, mean: Array, scatter: Array) -> Array:
        """ln of the probability of a positive definite joint in populations of shape (p, d), shape (p,)."""
        total = np.zeros(len(mean))
        if self.parametrisation is None:
            return total
        for cone in self.parametrisation.cones:
            normal = cone.normal(mean.shape[1])
            total += log_ndtr(-(mean @ normal) / np.sqrt(scatter**2 @ normal**2))
        for i, axis in enumerate(self.parametrisation.axes):
            if axis.bounded:
                low, high = ((end - mean[:, i]) / scatter[:, i] for end in axis.bounds)
                total += np.log(np.maximum(ndtr(high) - ndtr(low), np.finfo(float).tiny))
        return total

    def _blocks(self, mean: Array, scatter: Array) -> Iterator[tuple[slice, Array]]:
        """Rows of populations and ln of the weight of each draw under them, shape (rows, joints, n)."""
        joints, n, d = self.draws.theta.shape
        step = max(1, _AT_ONCE // (joints * n))
        mu, precision = mean - self._centre, 1 / scatter**2
        factors = np.concatenate([-precision / 2, mu * precision], axis=1)
        constant = -(mu**2 * precision).sum(axis=1) / 2 - np.log(scatter).sum(axis=1) - d * _LN_2PI / 2
        for first in range(0, len(mu), step):
            rows = slice(first, first + step)
            log_weight = factors[rows] @ self._powers
            log_weight += constant[rows, None]
            log_weight -= self._log_prior
            yield rows, log_weight.reshape(-1, joints, n)


def _exponential(log_weight: Array, top: Array) -> Array:
    """exp(ln w − its largest), written over ln w: memory is what this is short of."""
    log_weight -= top[..., None]
    return np.asarray(np.exp(log_weight, out=log_weight))
