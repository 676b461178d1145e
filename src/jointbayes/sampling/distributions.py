"""Student-t distributions and mixtures to propose from, fitted to a density, and the importance weights of draws."""

import math
from dataclasses import dataclass, field

import numpy as np

from jointbayes.errors import SamplingError
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


DOF = 5.0  # heavier tails than a posterior's keep the weights bounded


def student_efficiency(dimension: int) -> float:
    """Importance efficiency of a t distribution of 5 degrees of freedom for a Gaussian: 0.97 for each dimension.

    Examples
    --------
    >>> [round(student_efficiency(d), 2) for d in (3, 7, 15)]
    [0.91, 0.81, 0.63]
    """
    return 0.97**dimension


_FLOOR = 1e-3  # of the scale before, or of the overall covariance, added to a new one: few draws still span the space


_EM_STEPS = 8
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
