"""Search for the coordinates and the mixture of Student-t distributions in them that propose best."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from jointbayes.sampling.coordinates import Coordinates
from jointbayes.sampling.proposal.mixture_fit import first_mixture, most_likely_mixture, split
from jointbayes.sampling.proposal.student import StudentMixture, StudentT
from jointbayes.sampling.proposal.student_fit import good_efficiency
from jointbayes.sampling.proposal.weights import Pool, resampled, tempered

_DRAWS = 2000
_CONFIRMING = 4000
_LOOKED_AT_AGAIN = 2
_TRIALS = 3  # rounds in each system, before the best is refined
_ROUNDS = 7
_GAIN = 0.02  # in efficiency, below which components are split
GOOD_MIXTURE = 0.9  # of the efficiency at which a single Student-t is good enough: a mixture never gets quite there
_FITTED = 6000  # draws to which a mixture is fitted, so that a round costs the same however many there are
_ENOUGH = 10  # effective draws for each parameter of a component


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A distribution in other coordinates, and its efficiency."""

    density: StudentT | StudentMixture
    coordinates: Coordinates
    efficiency: float


def search(
    pool: Pool, systems: Sequence[Coordinates], components: int, rng: np.random.Generator, enough: float | None = None
) -> list[Fit]:
    """Fit mixtures to a pool of weighted draws, each in turn adding its draws to the pool.

    Every system is tried for three rounds, and that with the better mixture refined. Where a round gains nothing, the
    heavier components are split.

    Parameters
    ----------
    pool : Pool
        Draws that reach wherever the density is; it grows.
    systems : sequence of Coordinates
        Coordinates to try.
    components : int
        Number of components to begin with.
    rng : numpy.random.Generator
        Source of the draws.
    enough : float, optional
        Efficiency at which the search ends; by default nearly that at which a single Student-t is good enough.

    Returns
    -------
    list of Fit
        Those to choose from; none if the pool holds too few draws where the density is above zero.
    """
    good = GOOD_MIXTURE * good_efficiency(pool.theta.shape[1]) if enough is None else enough
    fits: list[Fit] = []
    latest: dict[int, Fit] = {}
    for trial, index in product(range(_TRIALS), range(len(systems))):
        fit = _round(pool, systems[index], latest[index].density if trial and index in latest else components, rng)
        if fit is None:
            continue
        if fit.efficiency > good:
            fit = _confirmed(pool, fit, rng)
        fits.append(fit)
        latest[index] = fit
        if fit.efficiency > good:
            return fits
    if latest:
        fits += _refined(pool, max(latest.values(), key=lambda fit: fit.efficiency), good, rng)
    # the highest of several figures is too high by chance: the first few are looked at again
    ranked = sorted(fits, key=lambda fit: -fit.efficiency)
    return [_confirmed(pool, fit, rng) for fit in ranked[:_LOOKED_AT_AGAIN]]


def _refined(pool: Pool, last: Fit, good: float, rng: np.random.Generator) -> list[Fit]:
    """Further rounds in the coordinates of a fit, until one is good."""
    fits: list[Fit] = []
    gained = True
    for _ in range(_ROUNDS):
        assert isinstance(last.density, StudentMixture)
        fit = _round(pool, last.coordinates, last.density if gained else split(last.density), rng)
        if fit is None:
            break
        if fit.efficiency > good:
            fit = _confirmed(pool, fit, rng)
        gained = fit.efficiency > last.efficiency + _GAIN
        fits.append(fit)
        last = fit
        if fit.efficiency > good:
            break
    return fits


def _confirmed(pool: Pool, fit: Fit, rng: np.random.Generator) -> Fit:
    """The fit with the efficiency of more and new draws: few may miss the one that carries a large weight."""
    return replace(fit, efficiency=pool.extend(fit.density, fit.coordinates, rng, _CONFIRMING))


def _round(
    pool: Pool, coordinates: Coordinates, mixture: StudentMixture | StudentT | int, rng: np.random.Generator
) -> Fit | None:
    """Refit a mixture, or a new one of so many components, to the pool, and draw from it."""
    phi = coordinates.forward(pool.theta)
    log_weight = pool.log_weight
    alive = np.isfinite(phi).all(axis=1) & np.isfinite(log_weight)
    enough = _ENOUGH * (phi.shape[1] + 1)
    if alive.sum() < enough:
        return None
    phi, weight = phi[alive], tempered(log_weight[alive], enough)
    if len(phi) > _FITTED:
        phi, weight = phi[resampled(weight, _FITTED, rng)], np.full(_FITTED, 1 / _FITTED)
    if not isinstance(mixture, StudentMixture):
        assert isinstance(mixture, int)
        mixture = first_mixture(phi, weight, mixture, rng)
    mixture = most_likely_mixture(mixture, phi, weight)
    return Fit(mixture, coordinates, pool.extend(mixture, coordinates, rng, _DRAWS))
