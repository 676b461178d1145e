"""Noise models: how measured FRFs scatter about the model's, given the stated standard deviation σ of each value.

All take standardised residuals z = (H − Hˣ)/σ of shape (n, lines, pairs). With `parts` = 2 they are complex and the
stated noise gives E|z|² = 1; with `parts` = 1 they are real, z = r/(√2 sd), and E z² = 1/2. In both cases the stated
Gaussian is ln p = constant − Σ|z|²; the constant, which no model contains, belongs to the residual (`residuals.py`).
Hyperparameters are positive physical values, one column for each name.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from jointbayes.inference.noise.correlated import CorrelatedNoise
from jointbayes.inference.noise.kernels import log1p_sum
from jointbayes.inference.noise.values import (
    Residuals,
    check_parts,
    check_positive,
    chi2_of,
    columns_of,
    finite_or_impossible,
    from_columns,
    no_pointwise,
    rows_of,
    squares_of,
    white,
)

__all__ = ["CorrelatedNoise", "GaussianNoise", "IntegratedScale", "NoiseModel", "ScaledNoise", "StudentNoise"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class GaussianNoise:
    """The stated noise and nothing else: independent Gaussian, ln p = −Σ|z|².

    Parameters
    ----------
    parts
        2 for complex residuals, 1 for real ones.

    References
    ----------
    Goodman, N. R. (1963). Statistical analysis based on a certain multivariate complex Gaussian distribution.
    Annals of Mathematical Statistics 34(1), 152-177. DOI 10.1214/aoms/1177704250
    """

    parts: int = 2
    needs_chi2_only: ClassVar[bool] = True
    names: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        check_parts(self.parts)

    def from_chi2(self, chi2: ArrayLike, n_values: int, hyper: ArrayLike) -> Array:
        """ln L (n,) from Σ|z|² (n,) of `n_values` values, without the constant."""
        return -np.asarray(chi2, dtype=float)

    def log_likelihood(self, z: Residuals, hyper: ArrayLike) -> Array:
        """ln L (n,) of residuals (n, lines, pairs), without the constant; −inf where a residual is not finite."""
        return finite_or_impossible(-chi2_of(z, self.parts))

    def pointwise(self, z: Residuals, hyper: ArrayLike) -> Array:
        """Log density of each value, shape (n, lines, pairs), without the constant."""
        return -squares_of(z)

    def whiten(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """The residuals as they are."""
        return from_columns(columns_of(z, self.parts), self.parts)

    def scores(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """Residuals that are white with the stated variance if the model holds: as they are."""
        return self.whiten(z, hyper)

    def draw(self, rng: np.random.Generator, hyper: ArrayLike, lines: int, pairs: int) -> Residuals:
        """Replicated residuals, shape (n, lines, pairs), one for each row of `hyper` (n, 0)."""
        return white(rng, (len(np.atleast_2d(hyper)), lines, pairs), self.parts)


@dataclass(frozen=True, slots=True)
class ScaledNoise:
    """The stated noise times one unknown factor `noise_scale`, ln p = −Σ|z|²/s² − parts·N ln s.

    Parameters
    ----------
    parts
        2 for complex residuals, 1 for real ones.
    """

    parts: int = 2
    needs_chi2_only: ClassVar[bool] = True
    names: ClassVar[tuple[str, ...]] = ("noise_scale",)

    def __post_init__(self) -> None:
        check_parts(self.parts)

    def from_chi2(self, chi2: ArrayLike, n_values: int, hyper: ArrayLike) -> Array:
        """ln L (n,) from Σ|z|² (n,) of `n_values` values, without the constant; hyper (n, 1)."""
        total = np.asarray(chi2, dtype=float)
        scale = rows_of(hyper, total.size, self.names)[:, 0]
        with np.errstate(all="ignore"):
            return finite_or_impossible(-total / scale**2 - self.parts * n_values * np.log(scale))

    def log_likelihood(self, z: Residuals, hyper: ArrayLike) -> Array:
        """ln L (n,) of residuals (n, lines, pairs), without the constant; −inf where a residual is not finite."""
        return self.from_chi2(chi2_of(z, self.parts), math.prod(z.shape[1:]), hyper)

    def pointwise(self, z: Residuals, hyper: ArrayLike) -> Array:
        """Log density of each value, shape (n, lines, pairs), without the constant."""
        scale = rows_of(hyper, len(z), self.names)[:, 0, None, None]
        value: Array = -squares_of(z) / scale**2 - self.parts * np.log(scale)
        return value

    def whiten(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """Residuals (k, lines, pairs) over the scale of one set of hyperparameters (1,)."""
        return self.scores(z, hyper)

    def scores(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """Residuals that are white with the stated variance if the model holds: each row over its own scale."""
        scale = rows_of(hyper, len(z), self.names)[:, 0, None, None]
        return from_columns(columns_of(z, self.parts) / scale, self.parts)

    def draw(self, rng: np.random.Generator, hyper: ArrayLike, lines: int, pairs: int) -> Residuals:
        """Replicated residuals, shape (n, lines, pairs), one for each row of `hyper` (n, 1)."""
        scale = rows_of(hyper, len(np.atleast_2d(hyper)), self.names)[:, 0, None, None]
        replicated: Residuals = scale * white(rng, (len(scale), lines, pairs), self.parts)
        return replicated


@dataclass(frozen=True, slots=True)
class IntegratedScale:
    """The stated noise times an unknown factor s that is integrated out: the residuals are jointly Student-t.

    The prior is scaled inverse χ² on the variance factor: dof·scale²/s² ~ χ² with `dof` degrees of freedom. With
    a = dof/2, b = dof·scale²/2 and m = parts·N/2,
    ln p = ln Γ(a + m) − ln Γ(a) + a ln b − (a + m) ln(b + Σ|z|²).

    Parameters
    ----------
    parts
        2 for complex residuals, 1 for real ones.
    dof
        Degrees of freedom of the prior: how many real values it is worth. 1 or 2 says little.
    scale
        Factor on the stated standard deviation that the prior is centred on.

    Raises
    ------
    ModelError
        If a number is not finite and above zero.

    References
    ----------
    Gelman, A. et al. (2013). Bayesian Data Analysis, 3rd ed., section 3.2. DOI 10.1201/b16018
    """

    parts: int = 2
    dof: float = 2.0
    scale: float = 1.0
    needs_chi2_only: ClassVar[bool] = True
    names: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        check_parts(self.parts)
        check_positive("integrated noise scale", "degrees of freedom", self.dof)
        check_positive("integrated noise scale", "scale", self.scale)

    def _shape_rate(self) -> tuple[float, float]:
        """Shape a and rate b of the prior of 1/s², a gamma distribution."""
        return self.dof / 2, self.dof * self.scale**2 / 2

    def from_chi2(self, chi2: ArrayLike, n_values: int, hyper: ArrayLike) -> Array:
        """ln L (n,) from Σ|z|² (n,) of `n_values` values, without the constant."""
        a, b = self._shape_rate()
        m = self.parts * n_values / 2
        constant = math.lgamma(a + m) - math.lgamma(a) + a * math.log(b)
        return finite_or_impossible(constant - (a + m) * np.log(b + np.asarray(chi2, dtype=float)))

    def log_likelihood(self, z: Residuals, hyper: ArrayLike) -> Array:
        """ln L (n,) of residuals (n, lines, pairs), without the constant; −inf where a residual is not finite."""
        return self.from_chi2(chi2_of(z, self.parts), math.prod(z.shape[1:]), hyper)

    def draw_scale(self, rng: np.random.Generator, chi2: ArrayLike, n_values: int) -> Array:
        """Draws of `noise_scale` given the data, shape (n, 1), from Σ|z|² (n,): the hyperparameter of `ScaledNoise`."""
        a, b = self._shape_rate()
        total = np.asarray(chi2, dtype=float)
        precision = rng.standard_gamma(a + self.parts * n_values / 2, total.shape) / (b + total)
        return 1 / np.sqrt(precision)[:, None]

    def typical_scale(self, chi2: float, n_values: int) -> float:
        """Scale s at which the curvature of ln L equals that of Gaussian noise times s: √((b + Σ|z|²)/(a + m))."""
        a, b = self._shape_rate()
        return math.sqrt((b + chi2) / (a + self.parts * n_values / 2))

    def pointwise(self, z: Residuals, hyper: ArrayLike) -> Array:
        """Not defined: the unknown scale ties all values together.

        Raises
        ------
        ModelError
            Always.
        """
        raise no_pointwise("an integrated noise scale", "sample noise_scale instead")

    def whiten(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """Residuals (k, lines, pairs) over the prior's scale; for the data's own scale divide by `typical_scale`."""
        return from_columns(columns_of(z, self.parts) / self.scale, self.parts)

    def draw(self, rng: np.random.Generator, hyper: ArrayLike, lines: int, pairs: int) -> Residuals:
        """Replicated residuals, shape (n, lines, pairs), each row with a scale of its own from the prior."""
        a, b = self._shape_rate()
        n = len(np.atleast_2d(hyper))
        scale = np.sqrt(b / rng.standard_gamma(a, n))[:, None, None]
        replicated: Residuals = scale * white(rng, (n, lines, pairs), self.parts)
        return replicated


@dataclass(frozen=True, slots=True)
class StudentNoise:
    """Independent Student-t residuals: like the stated noise at the core, but a few lines may be far off.

    A complex value has one t distribution of both its parts, since what spoils a line spoils both:
    ln p = −(dof + 2)/2 · ln(1 + 2|z|²/dof). The stated σ is the scale of the core; the variance is dof/(dof − 2) times
    σ².

    Parameters
    ----------
    parts
        2 for complex residuals, 1 for real ones.
    dof
        Degrees of freedom; 4 is a robust choice, 2(n − 1) is exact for σ estimated line by line from n averages.
    scaled
        Whether σ is multiplied by an unknown `noise_scale`.

    Raises
    ------
    ModelError
        If `dof` is not finite and above zero.

    References
    ----------
    Lange, K. L., Little, R. J. A., Taylor, J. M. G. (1989). Robust statistical modeling using the t distribution.
    Journal of the American Statistical Association 84(408), 881-896. DOI 10.1080/01621459.1989.10478852
    """

    parts: int = 2
    dof: float = 4.0
    scaled: bool = False
    needs_chi2_only: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_parts(self.parts)
        check_positive("Student-t noise", "degrees of freedom", self.dof)

    @property
    def names(self) -> tuple[str, ...]:
        """Hyperparameters, in order."""
        return ("noise_scale",) if self.scaled else ()

    def _scale(self, hyper: ArrayLike, n: int) -> Array:
        """Scale of each row, shape (n, 1, 1)."""
        rows = rows_of(hyper, n, self.names)
        return (rows[:, 0] if self.scaled else np.ones(n))[:, None, None]

    def _peak_exponent(self) -> tuple[float, float]:
        """Log density at z = 0 above that of the stated Gaussian, and minus the exponent of 1 + 2|z|²/dof."""
        half = self.dof / 2
        if self.parts == 2:
            return 0.0, half + 1  # both densities are 1/π at their peak
        return math.lgamma(half + 0.5) - math.lgamma(half) - 0.5 * math.log(half), half + 0.5

    def pointwise(self, z: Residuals, hyper: ArrayLike) -> Array:
        """Log density of each value, shape (n, lines, pairs), without the constant of the stated Gaussian."""
        scale = self._scale(hyper, len(z))
        peak, exponent = self._peak_exponent()
        tail = np.log1p(squares_of(z) / (scale**2 * self.dof / 2))
        value: Array = peak - exponent * tail - self.parts * np.log(scale)
        return value

    def log_likelihood(self, z: Residuals, hyper: ArrayLike) -> Array:
        """ln L (n,) of residuals (n, lines, pairs), without the constant; −inf where a residual is not finite."""
        scale, tail = self._scale(hyper, len(z))[:, 0, 0], np.empty(len(z))
        peak, exponent = self._peak_exponent()
        with np.errstate(all="ignore"):
            log1p_sum(columns_of(z, self.parts), self.parts, 2 / (self.dof * scale**2), tail)
            each = peak - self.parts * np.log(scale)
            return finite_or_impossible(math.prod(z.shape[1:]) * each - exponent * tail)

    def whiten(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """Residuals (k, lines, pairs) over the scale of one set of hyperparameters."""
        return from_columns(columns_of(z, self.parts) / self._scale(hyper, len(z)), self.parts)

    def scores(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """Gaussian residuals of the same probability and direction: white with the stated variance if the model holds.

        A residual as improbable under the t as 3σ is under a Gaussian becomes 3σ, so that outliers that the model
        allows do not count as misfit.
        """
        scale = self._scale(hyper, len(z))
        size = np.sqrt(squares_of(z)) / scale
        if self.parts == 2:
            equal = np.sqrt(self.dof / 2 * np.log1p(2 * size**2 / self.dof))  # P(|z| > size) = (1 + 2 size²/ν)^(−ν/2)
        else:
            beyond = np.maximum(special.stdtr(self.dof, -math.sqrt(2) * size), 1e-300)
            equal = -special.ndtri(beyond) / math.sqrt(2)
        ratio = np.divide(equal, size * scale, out=np.zeros_like(size), where=size > 0)
        scored: Residuals = from_columns(columns_of(z, self.parts), self.parts) * ratio
        return scored

    def draw(self, rng: np.random.Generator, hyper: ArrayLike, lines: int, pairs: int) -> Residuals:
        """Replicated residuals, shape (n, lines, pairs), one for each row of `hyper` (n, 0 or 1)."""
        shape = (len(np.atleast_2d(hyper)), lines, pairs)
        stretch = self._scale(hyper, shape[0]) / np.sqrt(rng.chisquare(self.dof, shape) / self.dof)
        replicated: Residuals = stretch * white(rng, shape, self.parts)
        return replicated


NoiseModel = GaussianNoise | ScaledNoise | IntegratedScale | StudentNoise | CorrelatedNoise
