"""Fit a Student-t distribution, or a mixture of such, in other coordinates to a density."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import SamplingError
from jointbayes.sampling.coordinate_maps import Coordinates
from jointbayes.sampling.density import Checked, LogDensity, covariance_roots, newton_climb
from jointbayes.sampling.distributions import Pool, StudentMixture, StudentT, importance_efficiency, resampled, tempered
from vibrecords.arrays import Array

DOF = 5.0  # heavier tails than a posterior's keep the weights bounded
_DRAWS = 2000
_STUDENT_ROUNDS = 4
_GOOD = 0.8  # a further round would cost more than it gains
_STUDENT_EM_STEPS = 10  # each brings the fit four times nearer
_FLOOR = 1e-3  # of the scale before, or of the overall covariance, added to a new one: few draws still span the space


@dataclass(slots=True)
class Whitened:
    """The density over z, where φ = origin + factor · z and z is of order one."""

    log_density: Checked
    coordinates: Coordinates
    origin: Array
    factor: Array
    evaluations: int = 0

    def __call__(self, z: Array) -> Array:
        """Log-density over z up to a constant, shape (n,), at z, shape (n, d)."""
        theta, inside = self.coordinates.inverse(self.origin + z @ self.factor.T)
        values = np.full(len(z), -np.inf)
        if inside.any():
            theta = theta[inside]
            self.evaluations += len(theta)
            densities = self.log_density(theta)
            possible = np.isfinite(densities)
            densities[possible] += self.coordinates.log_volume(theta[possible])
            # rounding at the very edge of the region may leave a volume that is no number
            values[inside] = np.where(np.isfinite(densities), densities, -np.inf)
        return values


def whitened(log_density: LogDensity, coordinates: Coordinates, theta: ArrayLike, covariance: ArrayLike) -> Whitened:
    """Carry a covariance of θ over into φ by the derivative of φ, and whiten with it."""
    mean, spread = np.asarray(theta, dtype=float), np.asarray(covariance, dtype=float)
    if mean.ndim != 1 or spread.shape != (mean.size, mean.size):
        raise SamplingError(
            f"proposal: found θ of shape {mean.shape} and a covariance of shape {spread.shape}; "
            "expected (d,) and (d, d); correct the arrays"
        )
    origin = coordinates.forward(mean[None])[0]
    if not (np.isfinite(origin).all() and np.isfinite(spread).all()):
        raise SamplingError(
            f"proposal: found θ = {mean.tolist()} with covariance {spread.tolist()}; "
            "expected finite numbers inside the region of the coordinates; correct them"
        )
    step = 1e-4 * covariance_roots(spread, 1e-10).T
    factor = (coordinates.forward(mean + step) - coordinates.forward(mean - step)).T / 2e-4
    size = np.linalg.norm(factor, axis=1, keepdims=True)
    if not (np.isfinite(size).all() and size.all() and np.linalg.cond(factor / size) < 1e7):
        # at the edge of the region the derivative says nothing: each coordinate is taken at its own size
        factor = np.diag(np.where(origin == 0.0, 1.0, np.abs(origin)))
    return Whitened(Checked(log_density), coordinates, origin, factor)


def laplace(target: Whitened) -> tuple[Array, Array]:
    """Mode and covariance from the curvature there, in z."""
    dimension = len(target.origin)
    # a gain below a thousandth in log-density no longer matters beside a refinement
    mode, _, covariance = newton_climb(
        target, np.zeros(dimension), np.eye(dimension), step=0.2, steps=20, gain=1e-3, least=1e-3, settled=4.0
    )
    return mode, covariance


def good_efficiency(dimension: int) -> float:
    """Efficiency at which a fit ends.

    A t distribution of 5 degrees of freedom reaches 0.97^(d − 1) times 0.97 for a Gaussian in d dimensions: 0.91 in
    three, 0.80 in seven, 0.65 in fifteen. Less than nine tenths of that may be mended.

    Examples
    --------
    >>> [round(good_efficiency(d), 2) for d in (1, 3, 7, 15)]
    [0.8, 0.8, 0.73, 0.57]
    """
    return min(_GOOD, 0.9 * 0.97**dimension)


@dataclass(frozen=True, slots=True, eq=False)
class Round:
    """One candidate in z, its draws with the log-density there, and its efficiency."""

    distribution: StudentT
    draws: Array
    values: Array
    efficiency: float


def refined_student(
    target: Whitened, mean: Array, scale: Array, rng: np.random.Generator, enough: float
) -> list[Round]:
    """Rounds of Student-t distributions in z from a first centre and scale, until one has an efficiency of `enough`.

    The last one is not always the best.
    """
    rounds: list[Round] = []
    for _ in range(1 + _STUDENT_ROUNDS):
        candidate = StudentT(mean, scale, DOF)
        draws = candidate.draw(rng, _DRAWS)
        values = target(draws)
        log_weight = values - candidate.log_density(draws)
        efficiency = importance_efficiency(log_weight)
        rounds.append(Round(candidate, draws, values, efficiency))
        if efficiency > enough:
            break
        mean, scale = _refitted(candidate, draws, log_weight)
    return rounds


def _refitted(candidate: StudentT, draws: Array, log_weight: Array) -> tuple[Array, Array]:
    """Centre and scale of the next candidate from weighted draws of the last."""
    d = candidate.mean.size
    alive = np.isfinite(log_weight)
    enough = 10 * (d + 1)
    if alive.sum() < enough:
        return candidate.mean, candidate.scale / 4  # the density lies somewhere nearer to the centre
    return _most_likely(candidate, draws[alive], tempered(log_weight[alive], enough))


def _most_likely(candidate: StudentT, draws: Array, weight: Array) -> tuple[Array, Array]:
    """Centre and scale of the t distribution most likely for weighted draws.

    Moments would fit a t distribution too narrow to a Gaussian: matching the covariance at 5 degrees of freedom costs
    a tenth of the efficiency that the likelihood has there.
    """
    mean = weight @ draws
    centred = draws - mean
    floor = _FLOOR * candidate.scale
    scale = (centred.T * weight) @ centred + floor
    for _ in range(_STUDENT_EM_STEPS):
        distance = np.einsum("ni,ij,nj->n", centred, np.linalg.inv(scale), centred)
        share = weight * (DOF + mean.size) / (DOF + distance)  # far draws count for less: their tails are expected
        mean = share @ draws / share.sum()
        centred = draws - mean
        scale = (centred.T * share) @ centred + floor
    return mean, scale


_EM_STEPS = 8
_MOST = 12  # components besides the wide one
_DEFENSIVE = 0.05  # weight of one wide component, which bounds the importance weights
_WIDER = 3.0  # it than all others together
_STARVED = 2  # effective draws per parameter of a component, below which it is dropped


def first_mixture(x: Array, weight: Array, components: int, rng: np.random.Generator) -> StudentMixture:
    """Equal components centred at weighted draws, x of shape (n, d) with normalised weights, to start from.

    Each centre is drawn in proportion to weight times squared distance from those before, so that no mode far from
    the others is left out.

    References
    ----------
    D. Arthur, S. Vassilvitskii, k-means++: the advantages of careful seeding (2007), SODA, 1027-1035.
    """
    mean, overall = _moments(x, weight)
    whitened = (x - mean) @ np.linalg.inv(np.linalg.cholesky(overall)).T
    chosen = [int(rng.choice(len(x), p=weight))]
    nearest = np.full(len(x), np.inf)
    for _ in range(components - 1):
        nearest = np.minimum(nearest, ((whitened - whitened[chosen[-1]]) ** 2).sum(axis=1))
        chance = weight * nearest
        if chance.sum() <= 0:
            break
        chosen.append(int(rng.choice(len(x), p=chance / chance.sum())))
    scale = overall * len(chosen) ** (-2 / x.shape[1])
    narrow = [StudentT(x[k], scale, DOF) for k in chosen]
    return _widened(narrow, np.full(len(narrow), 1 / len(narrow)), mean, overall)


def most_likely_mixture(mixture: StudentMixture, x: Array, weight: Array) -> StudentMixture:
    """Weights, centres and scales most likely for weighted draws, by some steps of expectation-maximisation.

    Components that few draws belong to are dropped; the wide one is set by the draws' covariance.

    Parameters
    ----------
    mixture : StudentMixture
        From which to start; its last component is the wide one.
    x : ndarray, shape (n, d)
        Draws.
    weight : ndarray, shape (n,)
        Their normalised weights.

    References
    ----------
    O. Cappé et al., Adaptive importance sampling in general mixture classes (2008), section 4 on t distributions,
    DOI 10.1007/s11222-008-9059-x.
    """
    d, columns = x.shape[1], np.ascontiguousarray(x.T)
    mean, overall = _moments(x, weight)
    for _ in range(_EM_STEPS):
        belongs, squared = mixture.log_densities(x)
        belongs -= belongs.max(axis=0)
        np.exp(belongs, out=belongs)
        belongs *= weight / belongs.sum(axis=0)
        narrow, masses = [], []
        for share, distance in zip(belongs[:-1], squared, strict=False):
            mass = float(share.sum())
            if mass <= 0 or mass**2 < _STARVED * (d + 1) * float(share @ share):
                continue
            # far draws count for less: tails are expected
            near = share * (DOF + d) / (DOF + distance)
            centre = columns @ near / near.sum()
            z = columns - centre[:, None]
            narrow.append(StudentT(centre, (z * near) @ z.T / mass + _FLOOR * overall, DOF))
            masses.append(mass)
        if not narrow:
            narrow, masses = [StudentT(mean, overall, DOF)], [1.0]
        mixture = _widened(narrow, np.array(masses), mean, overall)
    return mixture


def split(mixture: StudentMixture) -> StudentMixture:
    """Put two halves in the place of the heavier components, along the longest axis of each."""
    *narrow, wide = mixture.components
    weight = mixture.weights[:-1]
    chosen = set(np.argsort(weight)[::-1][: max(_MOST - len(narrow), 0)].tolist())
    size = np.sqrt(np.diag(wide.scale))
    parts: list[StudentT] = []
    weights: list[float] = []
    for k, component in enumerate(narrow):
        if k not in chosen:
            parts.append(component)
            weights.append(float(weight[k]))
            continue
        values, vectors = np.linalg.eigh(component.scale / np.outer(size, size))
        shift = 0.7 * np.sqrt(values[-1]) * vectors[:, -1] * size
        scale = component.scale - 0.9 * np.outer(shift, shift)
        parts += [StudentT(component.mean + side * shift, scale, DOF) for side in (-1, 1)]
        weights += [float(weight[k]) / 2] * 2
    return StudentMixture((*parts, wide), np.append(weights, mixture.weights[-1]))


def _moments(x: Array, weight: Array) -> tuple[Array, Array]:
    """Mean and covariance, the latter positive definite whatever the draws."""
    mean = weight @ x
    z = x - mean
    covariance = (z.T * weight) @ z
    variance = np.diag(covariance)
    covariance += 1e-9 * np.diag(np.where(variance > 0, variance, np.maximum(mean**2, 1e-300)))
    return mean, covariance


def _widened(narrow: list[StudentT], weight: Array, mean: Array, covariance: Array) -> StudentMixture:
    """Mixture with the wide component at its end."""
    wide = StudentT(mean, _WIDER**2 * covariance, DOF)
    weights = np.append((1 - _DEFENSIVE) * weight / weight.sum(), _DEFENSIVE)
    return StudentMixture((*narrow, wide), weights)


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
