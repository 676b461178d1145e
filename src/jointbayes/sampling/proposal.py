"""Fit a distribution to propose from to draws of a density, in the coordinates in which this works best."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from jointbayes.sampling.coordinate_maps import Coordinates, Identity, straightened
from jointbayes.sampling.density import Checked, LogDensity
from jointbayes.sampling.distributions import (
    DOF,
    StudentMixture,
    StudentT,
    drawn_without_replacement,
    first_mixture,
    importance_efficiency,
    most_likely_mixture,
    resampled,
    student_efficiency,
    tempered,
    truncated,
)
from jointbayes.sampling.kernels import Kernels
from vibrecords.arrays import Array

_FITTED = 6000  # draws that a mixture is fitted to at first
_COMPONENTS = 12  # of a first mixture: those that few draws belong to are dropped
_WEIGHED = 4000  # draws of each mixture, for its efficiency and for the next one
_ROUNDS = 4  # in the best coordinates
_ENOUGH = 10  # effective draws for each parameter of a component
_FURTHER = 0.1  # of what is proposed, from further kernels
_RARE = 1.0  # ln of an importance weight over their mean: points above it are hardly proposed
_GOOD = 0.8  # further rounds would cost more than they gain
_FAR = 100.0  # ln of an importance weight that is as good as infinite


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """A distribution over θ to propose from, and how good it is.

    Parameters
    ----------
    density : StudentT, StudentMixture or Kernels
        Distribution in the coordinates φ.
    efficiency : float
        Effective fraction of its draws as importance samples of the density, 0 to 1.
    coordinates : Coordinates
        Coordinates φ; θ itself by default.
    further : Kernels, optional
        Over θ: a tenth of what is proposed, where the rest hardly reaches.
    """

    density: StudentT | StudentMixture | Kernels
    efficiency: float
    coordinates: Coordinates = field(default_factory=Identity)
    further: Kernels | None = None

    @property
    def whole(self) -> StudentT:
        """One Student-t in φ as wide as all that is proposed there."""
        return self.density if isinstance(self.density, StudentT) else self.density.whole

    def draw(self, random: np.random.Generator | np.random.RandomState, n: int) -> Array:
        """Independent draws of θ, shape (n, d); NaN where one leaves the region of the coordinates."""
        theta, inside = self.coordinates.inverse(self.density.draw(random, n))
        theta = np.where(inside[:, None], theta, np.nan)
        if self.further is not None:
            there = random.random(n) < _FURTHER
            theta[there] = self.further.draw(random, int(there.sum()))
        return theta

    @np.errstate(all="ignore")
    def log_density(self, theta: Array) -> Array:
        """Log of its normalised density over θ, shape (n,), at θ, shape (n, d); −inf outside its coordinates."""
        over_phi = self.density.log_density(self.coordinates.forward(theta))
        value = over_phi - self.coordinates.log_volume(theta)
        # rounding at the very edge of the region may leave a volume that is no number
        value = np.where(np.isfinite(value), value, -np.inf)
        if self.further is None:
            return value
        return np.logaddexp(math.log(1 - _FURTHER) + value, math.log(_FURTHER) + self.further.log_density(theta))

    def weighted_draws(self, log_density: LogDensity, rng: np.random.Generator, n: int) -> tuple[Array, Array]:
        """Draws of θ from the proposal where the density is above zero, and ln of their importance weights.

        Parameters
        ----------
        log_density : callable
            Log of a density over θ, normalised or not.
        rng : numpy.random.Generator
            Source of the draws.
        n : int
            Number of draws.

        Returns
        -------
        theta, log_weight : ndarray, shapes (m, d) and (m,)
            m ≤ n: the other draws have weight zero. The sum of the weights over n estimates the integral of the
            density.
        """
        theta = self.draw(rng, n)
        theta = theta[np.isfinite(theta).all(axis=1)]
        value = Checked(log_density)(theta) if len(theta) else np.zeros(0)
        proposed = self.log_density(theta) if len(theta) else np.zeros(0)
        alive = np.isfinite(value) & np.isfinite(proposed)
        return theta[alive], value[alive] - proposed[alive]

    def missed(self, log_density: LogDensity, theta: Array, rng: np.random.Generator, most: int) -> Array:
        """At most so many of points θ, shape (n, d), that are hardly proposed, shape (m, d)."""
        _, log_weight = self.weighted_draws(log_density, rng, _WEIGHED)
        over_mean = log_density(theta) - self.log_density(theta) - np.logaddexp.reduce(log_weight) + math.log(_WEIGHED)
        rare = np.flatnonzero(over_mean > _RARE)
        return theta[rare[drawn_without_replacement(over_mean[rare], most, rng)]]

    def efficiency_among(self, theta: Array, value: Array) -> float:
        """Efficiency by draws θ of the density, shape (n, d), and the log of the density there, shape (n,).

        With w = p/q the efficiency is 1/∫ p²/q: one over the mean of w over draws from p, which lie where q has missed.
        """
        log_weight = value - self.log_density(theta)
        middle, n = np.median(log_weight), len(theta)
        log_weight = np.clip(log_weight, middle - _FAR, middle + _FAR)
        over = np.logaddexp.reduce(truncated(log_weight, n)) + np.logaddexp.reduce(-log_weight)
        return float(np.exp(2 * np.log(n) - over))


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def fit_proposal(
    log_density: LogDensity, systems: Sequence[Coordinates], theta: Array, rng: np.random.Generator
) -> Proposal:
    """Fit a mixture of Student-t distributions to draws of a density, in the best of several coordinates.

    1. Fit a mixture to the draws in each of the coordinates, as they are and straightened, until one is good.
    2. Fit that with the best efficiency again to the draws and to its own weighted ones, and so on (population Monte
       Carlo). While few draws carry all the weight a power of the weights below 1 is used, so that they still span the
       space.

    A poor fit is no error: its efficiency says so, and the moves are chosen by it.

    Parameters
    ----------
    log_density : callable
        Log of the unnormalised density over θ, (n, d) array to (n,) array; −inf where the density is zero.
    systems : sequence of Coordinates
        Coordinates to try, the likeliest first.
    theta : ndarray, shape (n, d)
        Equally weighted draws, in any order; some may occur more than once.
    rng : numpy.random.Generator
        Source of all randomness.

    References
    ----------
    O. Cappé et al., Population Monte Carlo (2004), DOI 10.1198/106186004X12803.
    O. Cappé et al., Adaptive importance sampling in general mixture classes (2008), section 4 on t distributions,
    DOI 10.1007/s11222-008-9059-x.
    E. Koblents, J. Míguez, A population Monte Carlo scheme with transformed weights (2015),
    DOI 10.1007/s11222-013-9440-2 (the power of the weights).
    """
    draws = theta[rng.permutation(len(theta))[:_FITTED]]
    good, enough = good_efficiency(draws.shape[1]), _ENOUGH * (draws.shape[1] + 1)

    def every_system() -> Iterator[Coordinates]:
        yield from systems
        yield from (straightened(coordinates, draws) for coordinates in systems)

    def weighed(proposal: Proposal, n: int) -> tuple[Proposal, Array]:
        """The proposal with its efficiency, and n of its draws by their weights."""
        own, log_weight = proposal.weighted_draws(log_density, rng, n)
        if len(own) < enough:
            return proposal, draws
        efficiency = importance_efficiency(log_weight) * len(own) / n
        return replace(proposal, efficiency=efficiency), own[resampled(tempered(log_weight, enough), n, rng)]

    def fitted(points: Array, coordinates: Coordinates, mixture: StudentMixture | None = None) -> StudentMixture:
        phi = coordinates.forward(points)
        phi = phi[np.isfinite(phi).all(axis=1)]
        weight = np.full(len(phi), 1 / len(phi))
        return most_likely_mixture(mixture or first_mixture(phi, weight, _COMPONENTS, rng), phi, weight)

    # 1. in each of the coordinates
    best, pool = Proposal(StudentT(np.zeros(1), np.eye(1), DOF), -1.0), [draws]
    for coordinates in every_system():
        found, own = weighed(Proposal(fitted(draws, coordinates), 0.0, coordinates), _WEIGHED)
        if found.efficiency > best.efficiency:
            best, pool = found, [draws, own]
        if best.efficiency > good:
            return best
    # 2. again in the best of these
    last = best
    for _ in range(_ROUNDS):
        assert isinstance(last.density, StudentMixture)
        mixture = fitted(np.concatenate(pool), last.coordinates, last.density)
        last, own = weighed(replace(last, density=mixture), _WEIGHED)
        pool, best = [*pool, own][-3:], max(best, last, key=lambda each: each.efficiency)
        if best.efficiency > good:
            return best
    return best


def good_efficiency(dimension: int) -> float:
    """Efficiency at which a fit ends.

    Less than nine tenths of that of a Student-t for a Gaussian may be mended.

    Examples
    --------
    >>> [round(good_efficiency(d), 2) for d in (1, 3, 7, 15)]
    [0.8, 0.8, 0.73, 0.57]
    """
    return min(_GOOD, 0.9 * student_efficiency(dimension))
