"""Fit a distribution to propose from, about one mode or several, knowing nothing but the log-density."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from jointbayes.errors import SamplingError
from jointbayes.sampling.coordinate_maps import Coordinates, Identity, straightened
from jointbayes.sampling.density import Checked, LogDensity, SeveralModes, covariance_roots
from jointbayes.sampling.distributions import (
    DOF,
    Fit,
    Pool,
    StudentMixture,
    StudentT,
    Whitened,
    first_mixture,
    good_efficiency,
    importance_efficiency,
    laplace,
    log_density_over_theta,
    most_likely_mixture,
    refined_student,
    search,
    theta_draws,
    truncated,
    whitened,
)
from vibrecords.arrays import Array

_SCATTERED = 1000  # draws about each start
_WIDER = 2.0  # than a start's covariance are these
_LEAST = 1e-4  # eigenvalue of its correlations
_COMPONENTS = 12  # of a first mixture, or two for each start: those that few draws belong to are dropped
_NOWHERE = -1000.0  # ln of the density at a draw that has no place in other coordinates

Start = tuple[Array, Array]
"""A point near a mode, shape (d,), and a rough covariance of θ there, shape (d, d)."""


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """A distribution to propose from, and how good it is.

    Parameters
    ----------
    density : StudentT, StudentMixture or OneOfProposals
        Distribution in the coordinates φ.
    efficiency : float
        Effective fraction of its draws as importance samples of the density, 0 to 1.
    evaluations : int
        Number of points at which the log-density was computed for the fit.
    coordinates : Coordinates
        Coordinates φ; θ itself by default.
    modes : SeveralModes, optional
        Those that the density has, if there are several: `density` is then of a proposal for each.
    """

    density: "StudentT | StudentMixture | OneOfProposals"
    efficiency: float
    evaluations: int
    coordinates: Coordinates = field(default_factory=Identity)
    modes: SeveralModes | None = None

    @property
    def parts(self) -> "tuple[Proposal, ...]":
        """The proposal for each mode; of one mode this one itself."""
        return (self,) if isinstance(self.density, StudentT | StudentMixture) else self.density.parts

    @property
    def shares(self) -> Array | None:
        """Probability of each of several modes among what is proposed, shape (m,); None of one mode."""
        return None if isinstance(self.density, StudentT | StudentMixture) else self.density.weights

    @property
    def likeliest(self) -> "Proposal":
        """The proposal for the mode with the largest share."""
        return self if self.shares is None else self.parts[int(np.argmax(self.shares))]

    @property
    def whole(self) -> StudentT:
        """One Student-t as wide as all that is proposed for the likeliest mode."""
        density = self.likeliest.density
        assert isinstance(density, StudentT | StudentMixture)
        return density.whole if isinstance(density, StudentMixture) else density

    @property
    def dimension(self) -> int:
        """Number of coordinates."""
        return self.whole.mean.size

    def confirmed_efficiency(self, log_density: LogDensity, rng: np.random.Generator, n: int) -> float:
        """Efficiency of so many new draws, where one far out does not make the fit look useless.

        There a walker stays for long, but hardly ever comes.
        """
        _, log_weight = self.weighted_draws(log_density, rng, n)
        dead = np.full(n - log_weight.size, -np.inf)
        return importance_efficiency(np.concatenate([truncated(log_weight, n), dead]))

    def log_density(self, theta: Array) -> Array:
        """Log of its normalised density over θ, shape (n,), at θ, shape (n, d); −inf outside its coordinates."""
        return log_density_over_theta(self.density, self.coordinates, theta)

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
        theta, value, log_proposal = theta_draws(Checked(log_density), self.density, self.coordinates, rng, n)
        alive = np.isfinite(value)
        return theta[alive], value[alive] - log_proposal[alive]


def fit_proposal(
    log_density: LogDensity,
    systems: Sequence[Coordinates | None],
    starts: Sequence[Start],
    rng: np.random.Generator,
    *,
    enough: float | None = None,
) -> Proposal:
    """Fit a Student-t distribution, or a mixture of such, to a density in the coordinates φ of one of several systems.

    From one start, the first candidate is the Laplace approximation in φ: mode and curvature of
    ln p(θ(φ)) + ln |∂θ/∂φ|, which is another than that in θ. Its draws are weighted by p/q, and the t distribution
    most likely for the weighted draws is the next candidate, a few rounds long (population Monte Carlo). While few
    draws carry all the weight, a power of the weights below 1 is used, so that the next candidate still spans the
    space.

    Where one Student-t is not good enough in the first system, and always from several starts, mixtures are fitted in
    every one to all weighted draws so far, and the best one is refined
    (:func:`jointbayes.sampling.distributions.search`). A wide component bounds the weights.

    A poor fit is no error: the efficiency says so, and the moves are chosen by it.

    Parameters
    ----------
    log_density : callable
        Log of the unnormalised density over θ, (n, d) array to (n,) array; −inf where the density is zero.
    systems : sequence of Coordinates or None
        Coordinates to try, the likeliest first; None is θ itself.
    starts : sequence of (theta, covariance)
        For each mode a point near it, shape (d,), inside the support, and a rough covariance, shape (d, d); the
        highest first.
    rng : numpy.random.Generator
        Source of the draws.
    enough : float, optional
        Efficiency at which the fit ends; by default `good_efficiency`. A lower one saves time where a few hundred
        effective draws will do.

    Returns
    -------
    Proposal
        The best candidate; its components have 5 degrees of freedom.

    Raises
    ------
    jointbayes.errors.SamplingError
        If there are no coordinates or no start, the shapes do not fit or a number is not finite, or if the log-density
        returns NaN or +inf.

    References
    ----------
    L. Tierney, J. B. Kadane, Accurate approximations for posterior moments (1986),
    DOI 10.1080/01621459.1986.10478240.
    O. Cappé et al., Population Monte Carlo (2004), DOI 10.1198/106186004X12803.
    O. Cappé et al., Adaptive importance sampling in general mixture classes (2008), section 4 on t distributions,
    DOI 10.1007/s11222-008-9059-x.
    E. Koblents, J. Míguez, A population Monte Carlo scheme with transformed weights (2015),
    DOI 10.1007/s11222-013-9440-2 (the power of the weights).
    """
    if not systems or not starts:
        raise SamplingError(
            f"proposal: found {len(systems)} systems of coordinates and {len(starts)} starts; "
            "expected at least one of each; name them"
        )
    maps = [coordinates or Identity() for coordinates in systems]
    target = whitened(log_density, maps[0], *starts[0])
    dimension = len(target.origin)
    least = good_efficiency(dimension) if enough is None else enough
    pool = Pool(target.log_density, dimension)
    fits: list[Fit] = []
    if len(starts) == 1:
        rounds = refined_student(target, *laplace(target), rng, least)
        best = max(rounds, key=lambda trial: trial.efficiency)
        fits.append(Fit(_carried_back(target, best.distribution), target.coordinates, best.efficiency))
        if best.efficiency > least:
            return _proposal(fits, target.evaluations)
        for trial in rounds:  # their draws in z
            alive = np.isfinite(trial.values)
            theta, _ = target.coordinates.inverse(target.origin + trial.draws[alive] @ target.factor.T)
            value = trial.values[alive] - target.coordinates.log_volume(theta)
            over_phi = _carried_back(target, trial.distribution)
            pool.add(over_phi, target.coordinates, theta, value, len(trial.draws))
    for theta, covariance in starts:
        roots = covariance_roots(np.asarray(covariance, dtype=float), _LEAST)
        around = StudentT(np.asarray(theta, dtype=float), _WIDER * roots @ roots.T, DOF)
        pool.extend(around, Identity(), rng, _SCATTERED)
        if len(starts) > 1:
            local = whitened(log_density, maps[0], theta, covariance)
            pool.extend(_carried_back(local, StudentT(*laplace(local), DOF)), maps[0], rng, _SCATTERED)
            target.evaluations += local.evaluations
    fits += search(pool, maps, max(_COMPONENTS, 2 * len(starts)), rng, enough)
    if not fits:
        fits.append(Fit(_carried_back(target, StudentT(*laplace(target), DOF)), target.coordinates, 0.0))
    return _proposal(fits, target.evaluations + pool.evaluations)


def _carried_back(target: Whitened, over_z: StudentT) -> StudentT:
    """Distribution over φ of one over z."""
    factor = target.factor
    return StudentT(target.origin + factor @ over_z.mean, factor @ over_z.scale @ factor.T, over_z.dof)


def _proposal(fits: list[Fit], evaluations: int) -> Proposal:
    best = max(fits, key=lambda fit: fit.efficiency)
    return Proposal(best.density, best.efficiency, evaluations, best.coordinates)


def likeliest_mixture(
    systems: Sequence[Coordinates], fitted: Array, held_out: Array, components: int, rng: np.random.Generator
) -> tuple[Coordinates, StudentMixture]:
    """Mixture of Student-t distributions fitted to draws θ, shape (n, d), in the best of several coordinates.

    Each system is tried as it is and straightened (:func:`straightened`); the best is that in which other draws, held
    out, are the likeliest.
    """
    candidates = []
    for coordinates in (*systems, *(straightened(coordinates, fitted) for coordinates in systems)):
        phi = coordinates.forward(fitted)
        phi = phi[np.isfinite(phi).all(axis=1)]
        weight = np.full(len(phi), 1 / len(phi))
        mixture = most_likely_mixture(first_mixture(phi, weight, components, rng), phi, weight)
        likely = mixture.log_density(coordinates.forward(held_out)) - coordinates.log_volume(held_out)
        candidates.append((float(np.where(np.isfinite(likely), likely, _NOWHERE).mean()), coordinates, mixture))
    _, coordinates, mixture = max(candidates, key=lambda candidate: candidate[0])
    return coordinates, mixture


_WEIGHED = 2000  # draws of each proposal, for the share of its mode
_CONFIRMING = 4000
_EVEN = 0.05  # of all that is proposed goes to each mode alike, however small one's share


def _about_mode(log_density: LogDensity, modes: SeveralModes, number: int) -> LogDensity:
    """A density about one of several modes: zero where another one is nearer."""
    return lambda theta: np.where(modes.nearest(theta) == number, log_density(theta), -np.inf)


@dataclass(frozen=True, slots=True, eq=False)
class OneOfProposals:
    """A mixture of proposals, each in coordinates of its own, as a distribution over θ.

    Parameters
    ----------
    parts
        One for each mode.
    weights
        Probability of each, shape (m,).
    """

    parts: tuple[Proposal, ...]
    weights: Array

    def draw(self, random: np.random.Generator | np.random.RandomState, n: int) -> Array:
        """Independent draws of θ, shape (n, d); NaN where one leaves the region of its coordinates."""
        which = random.choice(len(self.parts), n, p=self.weights)
        theta = np.full((n, self.parts[0].dimension), np.nan)
        for number, proposal in enumerate(self.parts):
            rows = np.flatnonzero(which == number)
            drawn, inside = proposal.coordinates.inverse(proposal.density.draw(random, rows.size))
            theta[rows[inside]] = drawn[inside]
        return theta

    def log_density(self, theta: Array) -> Array:
        """Log of the normalised density over θ, shape (n,), at θ, shape (n, d)."""
        each = []
        for weight, proposal in zip(self.weights, self.parts, strict=True):
            with np.errstate(all="ignore"):  # at the very edge of a region a volume may be no number
                over_phi = proposal.density.log_density(proposal.coordinates.forward(theta))
                over_theta = np.log(weight) + over_phi - proposal.coordinates.log_volume(theta)
            each.append(np.where(np.isfinite(over_theta), over_theta, -np.inf))
        return np.asarray(np.logaddexp.reduce(each, axis=0))


_DIP = 2.0  # ln of a density: across a valley no deeper a fit about one mode reaches the other
_PLACES = np.linspace(0.0, 1.0, 21)[1:-1, None]  # of the way between two


def starts_of_hills(log_density: LogDensity, starts: Sequence[Start]) -> tuple[Start, ...]:
    """Of starts that no deep valley parts that with the most probability about it: a fit there has the others too.

    Along the straight way between two the density falls at least as deep as between their modes.

    Parameters
    ----------
    log_density, starts
        As for `fit_proposal`; those that are left have the same order.
    """
    height = log_density(np.array([place for place, _ in starts]))
    mass = height + np.array([np.linalg.slogdet(covariance)[1] for _, covariance in starts]) / 2

    def is_parted(one: int, other: int) -> bool:
        between = starts[one][0] + _PLACES * (starts[other][0] - starts[one][0])
        return bool(log_density(between).min() < min(height[one], height[other]) - _DIP)

    left: list[int] = []
    for number in np.argsort(-mass, kind="stable").tolist():
        if all(is_parted(number, other) for other in left):
            left.append(number)
    return tuple(starts[number] for number in sorted(left))


def fit_each_mode(
    log_density: LogDensity,
    systems: Sequence[Coordinates],
    starts: Sequence[Start],
    images: Array | None,
    rng: np.random.Generator,
    *,
    enough: float | None = None,
) -> Proposal:
    """Fit a proposal to the density about each mode as if there were no other, and mix them by the modes' shares.

    One mixture over all modes would need components as narrow as each of them, far apart from one another. Of one mode
    it is that of `fit_proposal`.

    Parameters
    ----------
    log_density, systems, starts, rng, enough
        As for `fit_proposal`.
    images
        As for `SeveralModes.from_starts`.
    """
    if len(starts) == 1:
        return fit_proposal(log_density, systems, starts, rng, enough=enough)
    modes = SeveralModes.from_starts(starts, images)
    densities = [_about_mode(log_density, modes, number) for number in range(len(starts))]
    pairs = zip(densities, starts, strict=True)
    parts = [fit_proposal(density, systems, [start], rng, enough=enough) for density, start in pairs]
    return joined(log_density, parts, modes, rng)


def joined(
    log_density: LogDensity, parts: Sequence[Proposal], modes: SeveralModes, rng: np.random.Generator
) -> Proposal:
    """Mixture of the proposals of each mode in proportion to the modes' shares, which they estimate by their draws."""
    log_mass = []
    for number, proposal in enumerate(parts):
        _, log_weight = proposal.weighted_draws(_about_mode(log_density, modes, number), rng, _WEIGHED)
        log_mass.append(np.logaddexp.reduce(log_weight) if log_weight.size else -np.inf)
    highest = max(log_mass)
    mass = np.exp(np.array(log_mass) - highest) if np.isfinite(highest) else np.ones(len(parts))
    weights = (1 - _EVEN) * mass / mass.sum() + _EVEN / len(parts)
    evaluations = sum(proposal.evaluations for proposal in parts) + len(parts) * _WEIGHED + _CONFIRMING
    mixture = Proposal(OneOfProposals(tuple(parts), weights), 0.0, evaluations, modes=modes)
    return replace(mixture, efficiency=mixture.confirmed_efficiency(log_density, rng, _CONFIRMING))


_FITTED = 6000  # draws to which a mixture is fitted
_HELD_OUT = 2000  # others than these, by which the coordinates are chosen
#: Both together.
DRAWS_OF_A_FIT = _FITTED + _HELD_OUT
_MISSED = 1.5  # ln of an importance weight: draws above it are hardly ever proposed
_FEWEST = 5  # such draws for each parameter, for components to be added for them
_MORE, _MOST = 3.0, 0.3  # times their share of all draws is the weight of what is added, but no more than this
_ADDED, _ROUNDS = 4, 8  # components in each round


def proposal_from_draws(
    log_density: LogDensity, systems: Sequence[Coordinates], theta: Array, rng: np.random.Generator
) -> Proposal:
    """Fit a mixture of Student-t distributions to draws of a density, in the best of several coordinates.

    Each system is tried as it is and straightened (:func:`straightened`); the best is that in which draws held back are
    the likeliest. Components are added for draws that the mixture hardly proposes.

    Parameters
    ----------
    log_density : callable
        Log of the unnormalised density over θ.
    systems : sequence of Coordinates
        Coordinates to choose from.
    theta : ndarray, shape (n, d)
        Equally weighted draws, in any order.
    rng : numpy.random.Generator
        Source of all randomness.
    """
    theta = theta[rng.permutation(len(theta))]
    held_out, fitted = theta[:_HELD_OUT], theta[_HELD_OUT : _HELD_OUT + _FITTED]
    coordinates, mixture = likeliest_mixture(systems, fitted, held_out, _COMPONENTS, rng)
    mixture = _reaching(mixture, coordinates, fitted, log_density(fitted), rng)
    proposal = Proposal(mixture, 0.0, len(fitted) + _CONFIRMING, coordinates)
    return replace(proposal, efficiency=proposal.confirmed_efficiency(log_density, rng, _CONFIRMING))


def refit_proposal(
    log_density: LogDensity, systems: Sequence[Coordinates], proposal: Proposal, theta: Array, rng: np.random.Generator
) -> Proposal:
    """Fit a proposal to draws θ, shape (n, d); with several modes to each mode that has enough draws."""
    modes = proposal.modes
    if modes is None:
        return proposal_from_draws(log_density, systems, theta, rng)
    nearest, parts = modes.nearest(theta), list(proposal.parts)
    for number in range(len(parts)):
        draws = theta[nearest == number]
        if len(draws) >= 2 * _HELD_OUT:
            parts[number] = proposal_from_draws(_about_mode(log_density, modes, number), systems, draws, rng)
    return joined(log_density, parts, modes, rng)


def _reaching(
    mixture: StudentMixture, coordinates: Coordinates, theta: Array, value: Array, rng: np.random.Generator
) -> StudentMixture:
    """Mixture with components added where draws θ lie that it hardly proposes: there a walker would wait for long.

    `value` is the log of the density at θ, normalised or not.
    """
    phi = coordinates.forward(theta)
    volume = coordinates.log_volume(theta)
    for _ in range(_ROUNDS):
        log_weight = value - (mixture.log_density(phi) - volume)
        # the mean of q/p over draws from p is 1/Z
        log_weight += np.logaddexp.reduce(-log_weight) - np.log(log_weight.size)
        missed = phi[(log_weight > _MISSED) & np.isfinite(phi).all(axis=1)]
        if len(missed) < _FEWEST * (phi.shape[1] + 1):
            break
        weight = np.full(len(missed), 1 / len(missed))
        added = most_likely_mixture(first_mixture(missed, weight, _ADDED, rng), missed, weight)
        share = min(_MORE * len(missed) / len(theta), _MOST)
        mixture = StudentMixture(
            (*added.components[:-1], *mixture.components),
            np.concatenate([share * added.weights[:-1] / added.weights[:-1].sum(), (1 - share) * mixture.weights]),
        )
    return mixture
