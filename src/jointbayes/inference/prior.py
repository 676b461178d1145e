"""Priors on the coordinates of a joint: normal or uniform in each, cut off where K^J is not positive definite.

A parametrisation says where: by bounds of a coordinate, |ρ| < 1, or by cones, 2 ln k12 < ln k11 + ln k22. The
probability left, and draws by their quantiles, work on midpoints of the marginals' probability, so that they are the
same in every run.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import ModelError
from jointbayes.inference.marginals import Marginal, Normal, Nuisance, OfStiffness, Uniform, marginal_of
from jointbayes.joint import JointMatrix, Parametrisation
from vibrecords.arrays import Array, Flags

_CELLS = 1000  # of probability, in each of the two stiffnesses of a coupled pair
_GRAIN = 2.0**-30
#: What is to be done about priors that contradict each other.
NO_JOINT = (
    "expected marginals that overlap with positive definite joints, k12² <= k11·k22; lower the prior of the coupling "
    "or raise those of the other stiffnesses"
)


def log_probability_inside(parametrisation: Parametrisation, marginals: tuple[Marginal, ...]) -> float:
    """ln of the probability that independent draws give a positive definite joint; 0 where all do.

    It is rounded to a multiple of 2⁻³⁰: subtracting it from log densities, whose last digits are larger, then shifts
    them without rounding them again, and no draw depends on it.

    Parameters
    ----------
    parametrisation
        Of the joint.
    marginals
        One prior for each of its coordinates.

    Returns
    -------
    float
        Within 1e-3.

    Raises
    ------
    ModelError
        If the marginals leave no joint, or so few that a million places show none.
    """
    value = _log_probability(parametrisation, marginals)
    if value == -math.inf:
        raise ModelError(f"prior: found no positive definite joint that it allows; {NO_JOINT}")
    return round(value / _GRAIN) * _GRAIN


def cut_quantiles(parametrisation: Parametrisation, marginals: tuple[Marginal, ...], u: Array) -> Array:
    """Coordinates, shape (n, j), of points u of the unit cube, shape (n, j): uniform u give draws of the cut priors.

    Independent marginals give their quantiles, those of a bounded coordinate within its bounds. In a cone the coupling
    comes last, within what the stiffnesses leave it; these follow their distributions under the cut, interpolated
    between 1000 quantiles.

    References
    ----------
    Rosenblatt, M. (1952). Remarks on a multivariate transformation. Annals of Mathematical Statistics 23(3), 470-472.
    DOI 10.1214/aoms/1177729394
    """
    theta = np.empty(u.shape)
    for i, (axis, marginal) in enumerate(zip(parametrisation.axes, marginals, strict=True)):
        low, high = marginal.cdf(np.array(axis.bounds)) if axis.bounded else (0.0, 1.0)
        theta[:, i] = marginal.ppf(low + u[:, i] * (high - low))
    for cone in parametrisation.cones:
        columns = [cone.first, cone.coupling, cone.last]
        first, coupling, last = (marginals[column] for column in columns)
        edges = np.arange(_CELLS + 1) / _CELLS
        middle = _middles(last)
        first_values = first.ppf(np.interp(u[:, cone.first], _first_steps(first, coupling, last), edges))
        room = coupling.cdf((first_values[:, None] + middle) / 2)
        steps = np.concatenate([np.zeros((len(u), 1)), np.cumsum(room, axis=1)], axis=1)
        asked = u[:, cone.last] * steps[:, -1]
        share = np.array([np.interp(a, s, edges) for a, s in zip(asked, steps, strict=True)])
        last_values = last.ppf(share)
        coupling_values = coupling.ppf(u[:, cone.coupling] * coupling.cdf((first_values + last_values) / 2))
        theta[:, columns] = np.stack([first_values, coupling_values, last_values], axis=-1)
    return theta


@lru_cache(maxsize=64)
def _log_probability(parametrisation: Parametrisation, marginals: tuple[Marginal, ...]) -> float:
    probability = 1.0
    for axis, marginal in zip(parametrisation.axes, marginals, strict=True):
        if axis.bounded:
            low, high = marginal.cdf(np.array(axis.bounds))
            probability *= max(float(high - low), 0.0)
    for cone in parametrisation.cones:
        probability *= float(_room(marginals[cone.first], marginals[cone.coupling], marginals[cone.last]).mean())
    return math.log(probability) if probability > 0 else -math.inf


@lru_cache(maxsize=8)
def _first_steps(first: Marginal, coupling: Marginal, last: Marginal) -> Array:
    """Distribution of the first stiffness under the cut at the edges of its cells, shape (cells + 1,)."""
    steps = np.concatenate([[0.0], np.cumsum(_room(first, coupling, last).mean(axis=1))])
    steps /= steps[-1]
    steps.setflags(write=False)
    return steps


def _room(first: Marginal, coupling: Marginal, last: Marginal) -> Array:
    """Probability of a coupling inside the cone at the middles of all cells, shape (cells, cells)."""
    return coupling.cdf((_middles(first)[:, None] + _middles(last)) / 2)


def _middles(marginal: Marginal) -> Array:
    return marginal.ppf((np.arange(_CELLS) + 0.5) / _CELLS)


@dataclass(frozen=True, slots=True)
class JointPrior:
    """Independent priors on the coordinates θ of a joint and of all else that is uncertain.

    They are cut off where K^J is not positive definite, and where a quantity leaves the range of the forward model.

    Parameters
    ----------
    parametrisation
        Gives the first coordinates, those of the joint, their meaning.
    marginals
        One prior per coordinate of the joint, in the parametrisation's order: `Normal`, `Uniform`, or a distribution
        of one's own, which is a frozen one of scipy.stats or an object with ``log_density(x)`` and ``sample(rng, n)``;
        or, where a coordinate is the logarithm of a stiffness, `OfStiffness` of one of these.
    nuisances
        The other uncertain quantities, whose coordinates follow.

    Raises
    ------
    ModelError
        If there are not as many marginals as coordinates of the joint, or one on a stiffness is that of a coordinate
        which is no logarithm.
    """

    parametrisation: Parametrisation
    marginals: tuple[Marginal, ...]
    nuisances: tuple[Nuisance, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "marginals", tuple(map(marginal_of, self.marginals)))
        if len(self.marginals) != len(self.parametrisation.names):
            found = f"found {len(self.marginals)} marginals"
            raise ModelError.of("prior", (), found, f"one for each of {', '.join(self.parametrisation.names)}")
        for axis, marginal in zip(self.parametrisation.axes, self.marginals, strict=True):
            if isinstance(marginal, OfStiffness) and not axis.logarithmic:
                found = f"found {marginal!r}"
                expected = f"a prior on {axis.label} itself, which is not the logarithm of a stiffness"
                raise ModelError.of(f"prior of {axis.name}", (), found, expected, "give it without OfStiffness")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the d coordinates: the joint's, then the nuisances'."""
        return self.parametrisation.names + tuple(n.name for n in self.nuisances)

    @property
    def labels(self) -> tuple[str, ...]:
        """How the d coordinates are written: ``"ln k11"``, ``"ρ"``, ``"ln length"``."""
        return tuple(axis.label for axis in self.parametrisation.axes) + tuple(n.label for n in self.nuisances)

    @property
    def all_marginals(self) -> tuple[Marginal, ...]:
        """One prior for each of the d coordinates."""
        return self.marginals + tuple(n.prior for n in self.nuisances)

    @property
    def gaussian(self) -> bool:
        """Whether ln p is −½ Σ precision·(θ − mean)² and a constant inside the support: each normal or uniform in θ."""
        return all(isinstance(m, Normal | Uniform) for m in self.all_marginals)

    @property
    def mean(self) -> Array:
        """Mean of each marginal before the cut, shape (d,)."""
        return np.array([m.mean for m in self.all_marginals])

    @property
    def sd(self) -> Array:
        """Standard deviation of each marginal before the cut, shape (d,)."""
        return np.array([m.sd for m in self.all_marginals])

    @property
    def precision(self) -> Array:
        """−∂² ln p/∂θ² of each marginal, shape (d,)."""
        return np.array([m.precision for m in self.all_marginals])

    @property
    def support(self) -> tuple[Array, Array]:
        """Lower and upper ends of the box outside which the density is zero, each shape (d,)."""
        ends = [m.support for m in self.marginals] + [n.range for n in self.nuisances]
        low, high = np.array(ends).reshape(-1, 2).T
        return low, high

    def bounds_of(self, name: str) -> tuple[float, float] | None:
        """Ends of a uniform prior of the joint in the unit of its coordinate; None where it has no ends."""
        for axis, marginal in zip(self.parametrisation.axes, self.marginals, strict=True):
            if axis.name == name and isinstance(marginal, Uniform):
                return axis.value(marginal.low), axis.value(marginal.high)
            if axis.name == name and isinstance(marginal, OfStiffness) and isinstance(marginal.given, Uniform):
                return max(marginal.given.low, 0.0), marginal.given.high
        return None

    def joint(self, theta: ArrayLike) -> Array:
        """Coordinates of the joint, the first columns of θ, shape (..., j)."""
        return np.asarray(theta, dtype=float)[..., : len(self.marginals)]

    def values(self, theta: ArrayLike) -> Array:
        """The joint's quantities, shape (..., q), of θ, shape (..., d)."""
        return self.parametrisation.values(self.joint(theta))

    def matrix(self, theta: ArrayLike) -> JointMatrix:
        """Joint matrices, shape (..., R, R), of θ, shape (..., d)."""
        return self.parametrisation.matrix(self.values(theta))

    def factors(self, theta: ArrayLike) -> Array:
        """Value over nominal value of each nuisance, shape (..., q), of θ, shape (..., d); e^offset of an offset."""
        return np.exp(np.asarray(theta, dtype=float)[..., len(self.marginals) :])

    def nuisance_values(self, theta: ArrayLike) -> Array:
        """Value of each nuisance in its unit, shape (..., q), of θ, shape (..., d)."""
        values = self.factors(theta) * np.array([n.nominal for n in self.nuisances])
        for i, nuisance in enumerate(self.nuisances):
            if nuisance.additive:
                values[..., i] = nuisance.value(np.asarray(theta, dtype=float)[..., len(self.marginals) + i])
        return values

    def feasible(self, theta: ArrayLike) -> Flags:
        """Whether K^J is positive definite and every nuisance within its range, shape (...)."""
        t = np.asarray(theta, dtype=float)
        inside = self.parametrisation.feasible(self.joint(t))
        for i, nuisance in enumerate(self.nuisances, len(self.marginals)):
            low, high = nuisance.range
            inside = inside & (t[..., i] >= low) & (t[..., i] <= high)
        return inside

    def nearest(self, values: ArrayLike, rest: ArrayLike | None = None) -> Array:
        """Return the point θ of the support, shape (d,), nearest to a joint.

        Parameters
        ----------
        values
            Quantities of the joint, shape (q,).
        rest
            Coordinates of all else that is uncertain, shape (d − j,); by default the means of their priors.
        """
        low, high = self.support
        inner = 1e-6 * np.where(np.isfinite(high - low), high - low, 0.0)
        of_rest = self.mean[len(self.marginals) :] if rest is None else np.asarray(rest, dtype=float)

        def inside(joint: ArrayLike) -> Array:
            coordinates = self.parametrisation.coordinates(self.parametrisation.nearest(joint))
            return np.clip(np.concatenate([coordinates, of_rest]), low + inner, high - inner)

        theta = inside(values)
        # moving a stiffness to the edge may leave the coupling too large
        return theta if self.feasible(theta) else inside(self.values(theta))

    def coordinates_at_edge(self, theta: Array) -> tuple[str, ...]:
        """Names of the coordinates of θ, shape (d,), that lie on an edge of the support, within 1e-4 of their sd."""
        low, high = self.support
        on_edge = np.minimum(theta - low, high - theta) < 1e-4 * self.sd
        return tuple(name for name, edge in zip(self.names, on_edge, strict=True) if edge)

    def moved(self, theta: Array, moves: Array) -> Array:
        """θ, shape (d,), after each of several moves, shape (n, d), that stops at the support's edge, shape (n, d).

        At the edge of the box; a move out of the cone of possible joints, which is no box, is not made at all.
        """
        low, high = self.support
        ends = np.clip(theta + moves, low, high)
        return np.where(self.feasible(ends)[:, None], ends, theta)

    def log_density(self, theta: ArrayLike) -> Array:
        """ln p(θ), shape (n,), for θ of shape (n, d); −inf where impossible. The density integrates to one."""
        t = np.atleast_2d(np.asarray(theta, dtype=float))
        total = sum((m.log_density(t[:, i]) for i, m in enumerate(self.all_marginals)), np.zeros(len(t)))
        inside = self.feasible(t)
        return np.where(inside, total - self.log_normalisation, -np.inf)

    @property
    def log_normalisation(self) -> float:
        """ln of the probability that the independent marginals leave to positive definite joints, within 1e-3.

        The ranges of normal nuisances are so wide (2e-9 lies outside) that their cut does not count.
        """
        return log_probability_inside(self.parametrisation, self.marginals)

    def transform(self, u: ArrayLike) -> Array:
        """θ, shape (n, d), of points of the unit cube, shape (n, d): uniform points give draws from the prior.

        Nested sampling asks for this. Where the cut binds, the draws are exact to about a thousandth of a marginal's
        probability.
        """
        points = np.atleast_2d(np.asarray(u, dtype=float))
        count = len(self.marginals)
        joint = cut_quantiles(self.parametrisation, self.marginals, points[:, :count])
        rest = [np.clip(n.prior.ppf(points[:, count + i]), *n.range) for i, n in enumerate(self.nuisances)]
        return np.column_stack([joint, *rest])

    def sample(self, rng: np.random.Generator, size: int) -> Array:
        """Independent draws of θ from the prior, cut included, shape (size, d).

        Raises
        ------
        ModelError
            If hardly any draw gives a positive definite joint: the marginals contradict each other.
        """
        kept: list[Array] = []
        for _ in range(1000):
            columns = [*(m.sample(rng, size) for m in self.all_marginals), np.empty(size)]  # a rigid joint has none
            theta = np.stack(columns, axis=-1)[:, :-1]
            kept.append(theta[self.feasible(theta)])
            if sum(map(len, kept)) >= size:
                return np.concatenate(kept)[:size]
        raise ModelError(f"prior: found almost no positive definite joint among its draws; {NO_JOINT}")
