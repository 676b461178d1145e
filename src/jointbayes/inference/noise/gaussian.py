"""Gaussian noise: as stated, or with its size unknown."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.inference.marginals import Nuisance
from jointbayes.inference.noise import model_error
from jointbayes.inference.noise.base import (
    GaussianSpread,
    NoiseChoice,
    NoiseModel,
    Residuals,
    check_positive,
    columns_of,
    finite_or_impossible,
    residuals_of_columns,
    rows_of,
    white,
)
from vibrecords import Data
from vibrecords.arrays import Array


def noise_of(choice: NoiseChoice, parts: int, data: Data) -> tuple[NoiseModel, tuple[Nuisance, ...]]:
    """The noise model that a case chooses, and the priors of its hyperparameters."""
    if choice.model_error is not None and data.modes is not None:
        return model_error.noise_of(choice.model_error, data.modes)
    if choice.scale == "integrated":
        return IntegratedScale(parts, choice.scale_dof, choice.scale_guess), ()
    return ScaledNoise(parts) if choice.scale == "sampled" else GaussianNoise(parts), choice.parameters


@dataclass(frozen=True)
class GaussianNoise(GaussianSpread):
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
    as_stated: ClassVar[bool] = True

    def log_likelihood_of_chi2(self, chi2: ArrayLike, n_values: int, hyper: ArrayLike) -> Array:
        """ln L (n,) from Σ|z|² (n,) of `n_values` values, without the constant."""
        return -np.asarray(chi2, dtype=float)

    def spread(self, hyper: ArrayLike, n: int) -> Array:
        """1, as stated."""
        return np.ones((1, 1, 1))

    def scores(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """The residuals themselves."""
        return z


@dataclass(frozen=True)
class ScaledNoise(GaussianSpread):
    """The stated noise times one unknown factor `noise_scale`, ln p = −Σ|z|²/s² − parts·N ln s.

    Parameters
    ----------
    parts
        2 for complex residuals, 1 for real ones.
    """

    parts: int = 2
    names: ClassVar[tuple[str, ...]] = ("noise_scale",)
    needs_chi2_only: ClassVar[bool] = True

    def log_likelihood_of_chi2(self, chi2: ArrayLike, n_values: int, hyper: ArrayLike) -> Array:
        """ln L (n,) from Σ|z|² (n,) of `n_values` values, without the constant; hyper (n, 1)."""
        total = np.asarray(chi2, dtype=float)
        scale = rows_of(hyper, total.size, self.names)[:, 0]
        with np.errstate(all="ignore"):
            return finite_or_impossible(-total / scale**2 - self.parts * n_values * np.log(scale))

    def spread(self, hyper: ArrayLike, n: int) -> Array:
        """Scale of each row, shape (n, 1, 1)."""
        return rows_of(hyper, n, self.names)[:, 0, None, None]


@dataclass(frozen=True)
class IntegratedScale(NoiseModel):
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

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive("integrated noise scale", "degrees of freedom", self.dof)
        check_positive("integrated noise scale", "scale", self.scale)

    def _shape_rate(self) -> tuple[float, float]:
        """Shape a and rate b of the prior of 1/s², a gamma distribution."""
        return self.dof / 2, self.dof * self.scale**2 / 2

    def log_likelihood_of_chi2(self, chi2: ArrayLike, n_values: int, hyper: ArrayLike) -> Array:
        """ln L (n,) from Σ|z|² (n,) of `n_values` values, without the constant."""
        a, b = self._shape_rate()
        m = self.parts * n_values / 2
        constant = math.lgamma(a + m) - math.lgamma(a) + a * math.log(b)
        return finite_or_impossible(constant - (a + m) * np.log(b + np.asarray(chi2, dtype=float)))

    def typical_scale(self, chi2: float, n_values: int) -> float:
        """Scale s at which ln L is curved as with Gaussian noise times s: √((b + Σ|z|²)/(a + m))."""
        a, b = self._shape_rate()
        return math.sqrt((b + chi2) / (a + self.parts * n_values / 2))

    def with_scale(
        self, chi2: ArrayLike, n_values: int, hyper: Array, rng: np.random.Generator | None = None
    ) -> tuple[NoiseModel, Array]:
        """The stated noise times a scale s given the data: drawn from its conditional, or its typical value."""
        total = np.atleast_1d(np.asarray(chi2, dtype=float))
        if rng is None:
            scale = np.array([self.typical_scale(float(sum_of_squares), n_values) for sum_of_squares in total])
        else:
            a, b = self._shape_rate()
            scale = 1 / np.sqrt(rng.standard_gamma(a + self.parts * n_values / 2, total.shape) / (b + total))
        return ScaledNoise(self.parts), scale[:, None]

    def scores(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """Residuals (n, lines, pairs) over the prior's scale; for the data's own scale divide by `typical_scale`."""
        return residuals_of_columns(columns_of(z, self.parts) / self.scale, self.parts)

    def draw(self, rng: np.random.Generator, hyper: ArrayLike, lines: int, pairs: int) -> Residuals:
        """Replicated residuals, shape (n, lines, pairs), each row with a scale of its own from the prior."""
        a, b = self._shape_rate()
        n = len(np.atleast_2d(hyper))
        scale = np.sqrt(b / rng.standard_gamma(a, n))[:, None, None]
        return scale * white(rng, (n, lines, pairs), self.parts)
