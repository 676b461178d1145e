"""Student-t distributions and mixtures of them, to propose from: tails heavy enough to keep weights bounded."""

import math
from dataclasses import dataclass, field

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import SamplingError


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
        peak = math.lgamma((self.dof + d) / 2) - math.lgamma(self.dof / 2) - d / 2 * math.log(self.dof * math.pi)
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

    Raises
    ------
    jointbayes.errors.SamplingError
        If there is no component, their dimensions differ, or the weights are no probabilities.

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
    _dof: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        weights = np.array(self.weights, dtype=np.float64)
        sizes = {component.mean.size for component in self.components}
        if len(sizes) != 1 or weights.shape != (len(self.components),):
            raise SamplingError(
                f"Student-t mixture: found {len(self.components)} components of dimensions {sorted(sizes)} and weights "
                f"of shape {weights.shape}; expected one dimension and a weight for each; correct them"
            )
        if not ((weights > 0).all() and abs(weights.sum() - 1.0) < 1e-9):
            raise SamplingError(
                f"Student-t mixture: found weights {weights.tolist()}; expected all above 0 and 1 in sum; correct them"
            )
        derived = {
            "weights": weights / weights.sum(),
            "_means": np.array([c.mean for c in self.components]),
            "_factors": np.array([np.linalg.cholesky(c.scale) for c in self.components]),
            "_dof": np.array([c.dof for c in self.components]),
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

    def log_densities(self, x: Array) -> Array:
        """Log of weight times density of each component, shape (n, components), at x, shape (n, d)."""
        each = np.stack([component.log_density(x) for component in self.components], axis=1)
        return each + np.log(self.weights)

    def log_density(self, x: Array) -> Array:
        """Log of the normalised density, shape (n,), at x, shape (n, d)."""
        each = self.log_densities(x)
        top = each.max(axis=1)
        return top + np.log(np.exp(each - top[:, None]).sum(axis=1))
