"""Student-t noise: a few lines may be far off."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from jointbayes.frf.kernels.compiled import compiled
from jointbayes.inference.marginals import Nuisance
from jointbayes.inference.noise.base import (
    Absorbed,
    NoiseChoice,
    NoiseModel,
    Residuals,
    check_positive,
    columns_of,
    finite_or_impossible,
    residuals_of_columns,
    rows_of,
    squares_of,
    white,
)
from vibrecords import Data
from vibrecords.arrays import Array

#: A product is turned into its logarithm before it leaves the range of numbers.
_LARGE = 1e140


def noise_of(choice: NoiseChoice, parts: int, data: Data) -> tuple[NoiseModel, tuple[Nuisance, ...]]:
    """The noise model that a case chooses, and the priors of its hyperparameters."""
    return StudentNoise(parts, choice.dof, choice.scale == "sampled"), choice.parameters


@dataclass(frozen=True)
class StudentNoise(NoiseModel):
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

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive("Student-t noise", "degrees of freedom", self.dof)

    @property
    def names(self) -> tuple[str, ...]:
        """Hyperparameters, in order."""
        return ("noise_scale",) if self.scaled else ()

    @property
    def absorbs(self) -> Absorbed:
        """Single lines that are far off, and the size of the noise where it is inferred."""
        return "size" if self.scaled else "outliers"

    def _scale(self, hyper: ArrayLike, n: int) -> Array:
        """Scale of each row, shape (n, 1, 1)."""
        rows = rows_of(hyper, n, self.names)
        return (rows[:, 0] if self.scaled else np.ones(n))[:, None, None]

    def _peak_exponent(self) -> tuple[float, float]:
        """Log density at z = 0 above the stated Gaussian's, and minus the exponent of 1 + 2|z|²/dof."""
        half = self.dof / 2
        if self.parts == 2:
            return 0.0, half + 1  # both densities are 1/π at their peak
        return math.lgamma(half + 0.5) - math.lgamma(half) - 0.5 * math.log(half), half + 0.5

    def pointwise(self, z: Residuals, hyper: ArrayLike) -> Array:
        """Log density of each value, shape (n, lines, pairs), without the constant of the stated Gaussian."""
        scale = self._scale(hyper, len(z))
        peak, exponent = self._peak_exponent()
        tail = np.log1p(squares_of(z) / (scale**2 * self.dof / 2))
        return peak - exponent * tail - self.parts * np.log(scale)

    def log_likelihood(self, z: Residuals, hyper: ArrayLike) -> Array:
        """ln L (n,) of residuals (n, lines, pairs), without the constant; −inf where a residual is not finite."""
        scale, tail = self._scale(hyper, len(z))[:, 0, 0], np.empty(len(z))
        peak, exponent = self._peak_exponent()
        with np.errstate(all="ignore"):
            log1p_sum(columns_of(z, self.parts), self.parts, 2 / (self.dof * scale**2), tail)
            constant = peak - self.parts * np.log(scale)
            return finite_or_impossible(math.prod(z.shape[1:]) * constant - exponent * tail)

    def whiten(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """Residuals (k, lines, pairs) over the scale of one set of hyperparameters."""
        return residuals_of_columns(columns_of(z, self.parts) / self._scale(hyper, len(z)), self.parts)

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
        return residuals_of_columns(columns_of(z, self.parts), self.parts) * ratio

    def draw(self, rng: np.random.Generator, hyper: ArrayLike, lines: int, pairs: int) -> Residuals:
        """Replicated residuals, shape (n, lines, pairs), one for each row of `hyper` (n, 0 or 1)."""
        shape = (len(np.atleast_2d(hyper)), lines, pairs)
        stretch = self._scale(hyper, shape[0]) / np.sqrt(rng.chisquare(self.dof, shape) / self.dof)
        return stretch * white(rng, shape, self.parts)


@compiled
def log1p_sum(z: Array, parts: int, factor: Array, out: Array) -> None:
    """Σ ln(1 + factor·|z|²) (n,) over z (n, lines, pairs·parts), by the logarithm of products of a few factors."""
    n, lines, columns = z.shape
    for i in range(n):
        f, total, product = factor[i], 0.0, 1.0
        for k in range(lines):
            for c in range(0, columns, parts):
                square = z[i, k, c] * z[i, k, c]
                if parts == 2:
                    square += z[i, k, c + 1] * z[i, k, c + 1]
                product *= 1.0 + f * square
                if not product < _LARGE:
                    total += math.log(product)
                    product = 1.0
        out[i] = total + math.log(product)
