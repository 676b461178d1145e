"""Fit a proposal to each of several modes, and propose from all of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.sampling.coordinates import Coordinates, Identity
from jointbayes.sampling.density import LogDensity
from jointbayes.sampling.proposal.fit import Proposal, Start, fit_proposal
from jointbayes.sampling.several_modes import SeveralModes

_WEIGHED = 2000  # draws of each proposal, for the share of its mode
_CONFIRMING = 4000
_EVEN = 0.05  # of all that is proposed goes to each mode alike, however small one's share


@dataclass(frozen=True, slots=True, eq=False)
class AboutModes:
    """A density about one of several modes: zero where another one is nearer."""

    log_density: LogDensity
    modes: SeveralModes
    number: int

    def __call__(self, theta: Array) -> Array:
        """Log density, shape (n,), at θ, shape (n, d)."""
        return np.where(self.modes.nearest(theta) == self.number, self.log_density(theta), -np.inf)


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
        for number, part in enumerate(self.parts):
            rows = np.flatnonzero(which == number)
            drawn, inside = part.coordinates.inverse(part.density.draw(random, rows.size))
            theta[rows[inside]] = drawn[inside]
        return theta

    def log_density(self, theta: Array) -> Array:
        """Log of the normalised density over θ, shape (n,), at θ, shape (n, d)."""
        each = []
        for weight, part in zip(self.weights, self.parts, strict=True):
            with np.errstate(all="ignore"):  # at the very edge of a region a volume may be no number
                over_phi = part.density.log_density(part.coordinates.forward(theta))
                over_theta = np.log(weight) + over_phi - part.coordinates.log_volume(theta)
            each.append(np.where(np.isfinite(over_theta), over_theta, -np.inf))
        return np.asarray(np.logaddexp.reduce(each, axis=0))


class _Finite(Identity):
    """θ itself, of which numbers that are none belong to no region."""

    def inverse(self, phi: Array) -> tuple[Array, NDArray[np.bool_]]:
        """φ as it is, and whether it is finite."""
        return phi, np.asarray(np.isfinite(phi).all(axis=1))


def fit_each_mode(
    log_density: LogDensity,
    systems: Sequence[Coordinates],
    starts: Sequence[Start],
    images: Array | None,
    rng: np.random.Generator,
) -> Proposal:
    """Fit a proposal to the density about each mode as if there were no other, and mix them by the modes' shares.

    One mixture over all modes would need components as narrow as each of them, far apart from one another. Of one mode
    it is that of `fit_proposal`.

    Parameters
    ----------
    log_density, systems, starts, rng
        As for `fit_proposal`.
    images
        As for `SeveralModes.of`.
    """
    if len(starts) == 1:
        return fit_proposal(log_density, systems, starts, rng)
    modes = SeveralModes.of(starts, images)
    densities = [AboutModes(log_density, modes, number) for number in range(len(starts))]
    parts = [fit_proposal(density, systems, [start], rng) for density, start in zip(densities, starts, strict=True)]
    return joined(log_density, parts, modes, rng)


def joined(
    log_density: LogDensity, parts: Sequence[Proposal], modes: SeveralModes, rng: np.random.Generator
) -> Proposal:
    """Mixture of the proposals of each mode in proportion to the modes' shares, which they estimate by their draws."""
    log_mass = []
    for number, part in enumerate(parts):
        _, log_weight = part.weighted_draws(AboutModes(log_density, modes, number), rng, _WEIGHED)
        log_mass.append(np.logaddexp.reduce(log_weight) if log_weight.size else -np.inf)
    highest = max(log_mass)
    mass = np.exp(np.array(log_mass) - highest) if np.isfinite(highest) else np.ones(len(parts))
    weights = (1 - _EVEN) * mass / mass.sum() + _EVEN / len(parts)
    evaluations = sum(part.evaluations for part in parts) + len(parts) * _WEIGHED + _CONFIRMING
    mixture = Proposal(OneOfProposals(tuple(parts), weights), 0.0, evaluations, _Finite(), modes)
    return replace(mixture, efficiency=mixture.confirmed_efficiency(log_density, rng, _CONFIRMING))
