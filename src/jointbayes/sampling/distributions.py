"""Student-t distributions and mixtures to propose from, fitted to a density, and the importance weights of draws."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import SamplingError
from jointbayes.sampling.coordinate_maps import Coordinates
from jointbayes.sampling.density import Checked, LogDensity, covariance_roots, newton_climb
from vibrecords.arrays import Array, Indices


def log_peak(dof: float, d: int) -> float:
    """Log density of a Student-t of d dimensions at its centre, with a scale of determinant 1.

    Examples
    --------
    >>> round(log_peak(1.0, 1), 5)  # −ln π, Cauchy
    -1.14473
    """
    return math.lgamma((dof + d) / 2) - math.lgamma(dof / 2) - d / 2 * math.log(dof * math.pi)


@dataclass(frozen=True, slots=True, eq=False)
class StudentT:
    """Multivariate Student-t: a Gaussian with tails heavy enough to propose from.

    Parameters
    ----------
    mean : ndarray, shape (d,)
        Centre.
    scale : ndarray, shape (d, d)
        Scale matrix; the covariance is ``scale · dof / (dof − 2)``.
    dof : float
        Degrees of freedom, above 0.

    Raises
    ------
    jointbayes.errors.SamplingError
        If the shapes do not fit, a number is not finite, or the scale is not positive definite.

    References
    ----------
    S. Kotz, S. Nadarajah, Multivariate t-distributions and their applications (2004), DOI 10.1017/CBO9780511550683.

    Examples
    --------
    >>> StudentT(np.zeros(1), np.eye(1), 1.0).log_density(np.zeros((1, 1)))  # −ln π, Cauchy
    array([-1.14472989])
    """

    mean: Array
    scale: Array
    dof: float
    _factor: Array = field(init=False, repr=False)
    _whiten: Array = field(init=False, repr=False)
    _log_peak: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        mean, scale = np.array(self.mean, dtype=np.float64), np.array(self.scale, dtype=np.float64)
        d = mean.size
        if mean.ndim != 1 or d < 1 or scale.shape != (d, d):
            raise SamplingError(
                f"Student-t: found a mean of shape {mean.shape} and a scale of shape {scale.shape}; "
                "expected (d,) and (d, d); correct the arrays"
            )
        if not (np.isfinite(mean).all() and np.isfinite(scale).all() and 0 < self.dof < math.inf):
            raise SamplingError(
                f"Student-t: found mean {mean.tolist()}, scale {scale.tolist()}, {self.dof} degrees of freedom; "
                "expected finite numbers and degrees of freedom above 0; correct them"
            )
        try:
            factor = np.linalg.cholesky(scale)
        except np.linalg.LinAlgError as error:
            raise SamplingError(
                f"Student-t: found a scale {scale.tolist()}; expected a positive definite matrix; correct it"
            ) from error
        peak = log_peak(self.dof, d)
        derived = {"mean": mean, "scale": scale, "_factor": factor, "_whiten": np.linalg.inv(factor)}
        for name, array in derived.items():
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        object.__setattr__(self, "_log_peak", peak - float(np.log(np.diag(factor)).sum()))

    def draw(self, random: "np.random.Generator | np.random.RandomState", n: int) -> Array:
        """Independent draws, shape (n, d), by either kind of generator: emcee knows only the older one."""
        normal = random.standard_normal((n, self.mean.size)) @ self._factor.T
        stretch = np.sqrt(self.dof / random.chisquare(self.dof, n))
        return self.mean + normal * stretch[:, None]

    def scaled(self, normal: Array) -> Array:
        """Standard normal rows, shape (n, d), as those of covariance `scale`."""
        return np.asarray(normal @ self._factor.T)

    def squared_distance(self, x: Array) -> Array:
        """(x − mean)ᵀ scale⁻¹ (x − mean), shape (n,), at x, shape (n, d)."""
        z = (x - self.mean) @ self._whiten.T
        return np.einsum("ni,ni->n", z, z)

    def log_density(self, x: Array) -> Array:
        """Log of the normalised density, shape (n,), at x, shape (n, d)."""
        exponent = -(self.dof + self.mean.size) / 2
        return self._log_peak + exponent * np.log1p(self.squared_distance(x) / self.dof)


@dataclass(frozen=True, slots=True, eq=False)
class StudentMixture:
    """Several Student-t distributions, each with a weight.

    Parameters
    ----------
    components : tuple of StudentT
        Of one dimension.
    weights : ndarray, shape (components,)
        Probability of each; above 0 and 1 in sum.

    Examples
    --------
    >>> one = StudentT(np.zeros(1), np.eye(1), 1.0)
    >>> StudentMixture((one, one), np.array([0.25, 0.75])).log_density(np.zeros((1, 1)))
    array([-1.14472989])
    """

    components: tuple[StudentT, ...]
    weights: Array
    _means: Array = field(init=False, repr=False)
    _factors: Array = field(init=False, repr=False)
    _whiten: Array = field(init=False, repr=False)
    _dof: Array = field(init=False, repr=False)
    _log_peaks: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        weights = self.weights / self.weights.sum()
        derived = {
            "weights": weights,
            "_means": np.array([c.mean for c in self.components]),
            "_factors": np.array([c._factor for c in self.components]),
            "_whiten": np.array([c._whiten for c in self.components]),
            "_dof": np.array([c.dof for c in self.components]),
            "_log_peaks": np.array([c._log_peak for c in self.components]) + np.log(weights),
        }
        for name, array in derived.items():
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def draw(self, random: "np.random.Generator | np.random.RandomState", n: int) -> Array:
        """Independent draws, shape (n, d), by either kind of generator; their order says nothing of the components."""
        which = random.choice(len(self.weights), n, p=self.weights)
        normal = random.standard_normal((n, self._means.shape[1]))
        stretch = np.sqrt(self._dof[which] / random.chisquare(self._dof[which]))
        return self._means[which] + np.einsum("nij,nj->ni", self._factors[which], normal) * stretch[:, None]

    @property
    def whole(self) -> StudentT:
        """One Student-t as wide as all components together but the last, which is wider than all."""
        narrow, weights = self.components[:-1] or self.components, self.weights[: max(1, len(self.weights) - 1)]
        share = weights / weights.sum()
        mean = share @ np.array([c.mean for c in narrow])
        scale = sum(w * (c.scale + np.outer(c.mean - mean, c.mean - mean)) for w, c in zip(share, narrow, strict=True))
        return StudentT(mean, np.asarray(scale), narrow[0].dof)

    def log_densities(self, x: Array) -> tuple[Array, Array]:
        """Log of weight times density of each component at x, shape (n, d), and squared distance, (components, n)."""
        count, d = self._means.shape
        # one product for all components, about a place among them, so that few digits cancel
        centre = self.weights @ self._means
        z = (self._whiten.reshape(count * d, d) @ np.ascontiguousarray((x - centre).T)).reshape(count, d, len(x))
        z -= self._whiten @ (self._means - centre)[:, :, None]
        z *= z
        squared = z.sum(axis=1)
        fall = np.log(1.0 + squared / self._dof[:, None])
        return self._log_peaks[:, None] - (self._dof[:, None] + d) / 2 * fall, squared

    def log_density(self, x: Array) -> Array:
        """Log of the normalised density, shape (n,), at x, shape (n, d)."""
        each, _ = self.log_densities(x)
        top = each.max(axis=0)
        each -= top
        return np.asarray(top + np.log(np.exp(each, out=each).sum(axis=0)))


def importance_efficiency(log_weight: Array) -> float:
    """Effective fraction of importance samples, (Σw)² / (n Σw²); 0 if all weights are.

    Parameters
    ----------
    log_weight : ndarray, shape (n,)
        ln of the weights up to a constant; −inf for a weight of zero.

    References
    ----------
    A. Kong, J. S. Liu, W. H. Wong, Sequential imputations and Bayesian missing data problems (1994),
    DOI 10.1080/01621459.1994.10476469.

    Examples
    --------
    >>> importance_efficiency(np.array([0.0, 0.0, -np.inf, -np.inf]))
    0.5
    """
    top = float(log_weight.max())
    if top == -np.inf:
        return 0.0
    weight = np.exp(log_weight - top)
    return float(weight.sum() ** 2 / (weight.size * (weight**2).sum()))


@dataclass(frozen=True, slots=True, eq=False)
class WeightedDraws:
    """Draws of θ, shape (n, d), and ln of their weights up to a constant, shape (n,)."""

    theta: Array
    log_weight: Array

    def __post_init__(self) -> None:
        self.theta.setflags(write=False)
        self.log_weight.setflags(write=False)

    @property
    def weight(self) -> Array:
        """Weights that sum to one, shape (n,)."""
        weight = np.exp(self.log_weight - self.log_weight.max())
        return weight / weight.sum()

    @property
    def effective(self) -> float:
        """Effective number of draws, (Σw)²/Σw²; 0 without any."""
        return len(self.theta) * importance_efficiency(self.log_weight) if len(self.theta) else 0.0

    def resample(self, rng: np.random.Generator, n: int) -> Array:
        """Equally weighted draws from the posterior, shape (n, d); some occur more than once."""
        return self.theta[rng.choice(len(self.theta), n, p=self.weight)]


def tempered(log_weight: Array, enough: float) -> Array:
    """Normalised weights, shape (n,), to the largest power that leaves enough effective draws.

    While few draws carry all the weight, a power below 1 lets a fit to them still span the space.

    Parameters
    ----------
    log_weight : ndarray, shape (n,)
        ln of the weights up to a constant, finite.
    enough : float
        Effective number of draws that must be left.

    References
    ----------
    E. Koblents, J. Míguez, A population Monte Carlo scheme with transformed weights (2015),
    DOI 10.1007/s11222-013-9440-2.
    """
    powers = 0.5 ** np.arange(12)
    power = next((p for p in powers if log_weight.size * importance_efficiency(p * log_weight) >= enough), 0.0)
    weight: Array = np.exp(power * (log_weight - log_weight.max()))
    weight /= weight.sum()
    return weight


def resampled(weight: Array, n: int, rng: np.random.Generator) -> Indices:
    """Indices, shape (n,), each drawn as often as its weight asks, to within one: systematic resampling.

    Parameters
    ----------
    weight : ndarray, shape (m,)
        Normalised weights.
    n : int
        Number of indices.
    rng : numpy.random.Generator
        Source of the one random number.

    References
    ----------
    J. Carpenter, P. Clifford, P. Fearnhead, Improved particle filter for nonlinear problems (1999),
    DOI 10.1049/ip-rsn:19990255.

    Examples
    --------
    >>> resampled(np.array([0.5, 0.0, 0.5]), 4, np.random.default_rng(1)).tolist()
    [0, 0, 2, 2]
    """
    steps = np.cumsum(weight)
    return np.searchsorted(steps / steps[-1], (np.arange(n) + rng.random()) / n)


def truncated(log_weight: Array, n: int) -> Array:
    """ln of importance weights cut off at √n times their mean over n draws, shape (m,): one far out counts for less.

    Parameters
    ----------
    log_weight : ndarray, shape (m,)
        ln of the weights of m <= n draws; those of the others are zero.
    n : int
        Number of draws.

    References
    ----------
    E. L. Ionides, Truncated importance sampling (2008), DOI 10.1198/106186008X320456.
    """
    return np.minimum(log_weight, np.logaddexp.reduce(log_weight) - 0.5 * np.log(n))


def drawn_without_replacement(log_weight: Array, count: int, rng: np.random.Generator) -> Indices:
    """Indices of at most `count` draws in proportion to their weights, none twice.

    The largest of ln w plus Gumbel noise are such a sample.
    """
    return np.argsort(-(log_weight + rng.gumbel(size=log_weight.size)))[:count]


class ProposalDensity(Protocol):
    """A distribution over φ to draw from."""

    def draw(self, random: "np.random.Generator | np.random.RandomState", n: int) -> Array:
        """Independent draws, shape (n, d)."""

    def log_density(self, x: Array) -> Array:
        """Log of the normalised density, shape (n,), at x, shape (n, d)."""


def theta_draws(
    log_density: LogDensity, density: ProposalDensity, coordinates: Coordinates, rng: np.random.Generator, n: int
) -> tuple[Array, Array, Array]:
    """Draws that lie in the region of the coordinates, with the log-density and the log of the proposal's there.

    Returns
    -------
    theta, value, log_proposal : ndarray, shapes (m, d), (m,), (m,)
        m ≤ n, because draws may leave the region; both logs are of densities over θ; the value is −inf where the
        density is zero.
    """
    phi = density.draw(rng, n)
    theta, inside = coordinates.inverse(phi)
    theta, phi = theta[inside], phi[inside]
    value = log_density(theta) if len(theta) else np.zeros(0)
    log_proposal = density.log_density(phi)
    finite = np.isfinite(value)
    log_proposal[finite] -= coordinates.log_volume(theta[finite])
    # rounding at the very edge of the region may leave a volume that is no number
    value = np.where(np.isfinite(log_proposal), value, -np.inf)
    return theta, value, log_proposal


class Pool:
    """Draws from several proposals, each weighted as if it came from their mixture.

    References
    ----------
    J.-M. Cornuet et al., Adaptive multiple importance sampling (2012), DOI 10.1111/j.1467-9469.2011.00756.x.
    """

    def __init__(self, log_density: LogDensity, dimension: int) -> None:
        self._log_density = log_density
        self._sources: list[tuple[ProposalDensity, Coordinates, int]] = []
        self._log_mixture = np.zeros(0)
        #: ln of the density at each draw, shape (n,).
        self.value = np.zeros(0)
        self.theta = np.zeros((0, dimension))
        self.evaluations = 0

    def extend(self, density: ProposalDensity, coordinates: Coordinates, rng: np.random.Generator, n: int) -> float:
        """Add draws from a proposal; return its efficiency."""
        theta, value, log_proposal = theta_draws(self._log_density, density, coordinates, rng, n)
        self.evaluations += len(theta)
        alive = np.isfinite(value)
        log_weight = np.concatenate([value[alive] - log_proposal[alive], np.full(n - int(alive.sum()), -np.inf)])
        self.add(density, coordinates, theta[alive], value[alive], n)
        return importance_efficiency(log_weight)

    def add(self, density: ProposalDensity, coordinates: Coordinates, theta: Array, value: Array, n: int) -> None:
        """Add the draws, of n from a proposal, at which the density is above zero."""
        old = np.log(n) + log_density_over_theta(density, coordinates, self.theta)
        self._sources.append((density, coordinates, n))
        # many of them in the same coordinates, the change to which is as dear as a density
        changed = {
            id(c): (c.forward(theta), c.log_volume(theta)) for c in {id(c): c for _, c, _ in self._sources}.values()
        }
        new = [
            np.log(m) + _over_theta(q.log_density(changed[id(c)][0]), changed[id(c)][1]) for q, c, m in self._sources
        ]
        before = np.logaddexp(self._log_mixture, old) if len(self._sources) > 1 else old
        self._log_mixture = np.concatenate([before, np.logaddexp.reduce(np.stack(new), axis=0)])
        self.theta = np.concatenate([self.theta, theta])
        self.value = np.concatenate([self.value, value])

    @property
    def log_weight(self) -> Array:
        """ln of the importance weight of each draw, up to a constant, shape (n,)."""
        return self.value - self._log_mixture


def log_density_over_theta(density: ProposalDensity, coordinates: Coordinates, theta: Array) -> Array:
    """Log of a proposal's density over θ, shape (n,), at θ, shape (n, d); −inf outside its coordinates."""
    return _over_theta(density.log_density(coordinates.forward(theta)), coordinates.log_volume(theta))


def _over_theta(log_density: Array, log_volume: Array) -> Array:
    """Log of a density over θ of that over φ; −inf where that is no number."""
    value = log_density - log_volume
    return np.where(np.isfinite(value), value, -np.inf)


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
    # a gain below a thousandth in log-density no longer matters after a refinement
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
    fewest = 10 * (mean.size + 1)
    for _ in range(1 + _STUDENT_ROUNDS):
        candidate = StudentT(mean, scale, DOF)
        draws = candidate.draw(rng, _DRAWS)
        values = target(draws)
        log_weight = values - candidate.log_density(draws)
        efficiency = importance_efficiency(log_weight)
        rounds.append(Round(candidate, draws, values, efficiency))
        if efficiency > enough:
            break
        alive = np.isfinite(log_weight)
        if alive.sum() < fewest:
            scale = scale / 4  # the density lies somewhere nearer to the centre
        else:
            mean, scale = _most_likely(candidate, draws[alive], tempered(log_weight[alive], fewest))
    return rounds


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
    """Mean and covariance, the latter positive definite for any draws."""
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

    def tried(coordinates: Coordinates, mixture: StudentMixture | StudentT | int) -> Fit | None:
        fit = _round(pool, coordinates, mixture, rng)
        if fit is not None:
            # few draws may miss the one that carries a large weight
            fit = _confirmed(pool, fit, rng) if fit.efficiency > good else fit
            fits.append(fit)
        return fit

    # 1. some rounds in each system
    latest: dict[int, Fit] = {}
    for trial, index in product(range(_TRIALS), range(len(systems))):
        fit = tried(systems[index], latest[index].density if trial and index in latest else components)
        if fit is not None:
            latest[index] = fit
            if fit.efficiency > good:
                return fits
    # 2. further rounds in the best
    gained, last = True, max(latest.values(), key=lambda fit: fit.efficiency, default=None)
    for _ in range(_ROUNDS if last else 0):
        assert last is not None
        assert isinstance(last.density, StudentMixture)
        fit = tried(last.coordinates, last.density if gained else split(last.density))
        if fit is None or fit.efficiency > good:
            break
        gained, last = fit.efficiency > last.efficiency + _GAIN, fit
    # 3. the highest of several figures is too high by chance: the first few are looked at again
    ranked = sorted(fits, key=lambda fit: -fit.efficiency)
    return [_confirmed(pool, fit, rng) for fit in ranked[:_LOOKED_AT_AGAIN]]


def _confirmed(pool: Pool, fit: Fit, rng: np.random.Generator) -> Fit:
    """The fit with the efficiency of more and new draws."""
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
