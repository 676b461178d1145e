"""What a noise model is, and the residuals and hyperparameters that all of them take.

Residuals are standardised, z = (H − Hˣ)/σ of shape (n, lines, pairs). With `parts` = 2 they are complex and the stated
noise gives E|z|² = 1; with `parts` = 1 they are real, z = r/(√2 sd), and E z² = 1/2. In both cases the stated Gaussian
is ln p = constant − Σ|z|²; the constant, which no model contains, belongs to the residual (`likelihood_base.py`).
Hyperparameters are positive physical values, one column for each name.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, is_dataclass, replace
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.inference.marginals import Nuisance, Uniform
from vibrecords import FrfData
from vibrecords.arrays import Array

#: Residuals, complex where `parts` is 2, real where it is 1.
Residuals = NDArray[Any]


@dataclass(frozen=True, slots=True)
class ErrorSizes:
    """Standard deviations of the model's errors.

    Updated models of real structures miss measured natural frequencies by 0.1 % to 3 %, see docs/what-can-be-wrong.md.

    Parameters
    ----------
    frequency, factor
        Of a natural frequency, as a fraction of it, with a log-normal prior: the median, and the factor (one standard
        deviation of its logarithm) by which it may be larger or smaller. Never flat: few frequencies say little of it.
    damping
        Of a damping ratio, as a fraction of it.
    shape
        Of a component of a mode shape, which is 1 at the reference, as a fraction of it, or of 0.3 where it is less.
    constant
        Of a modal constant, as a fraction of it.
    edge
        Of the place where a clamp's edge holds, as a fraction of the overhang: one for all modes; 0 leaves it out.
    spring, spring_factor
        Of what a spring to ground anywhere does to the lowest natural frequency, as a fraction of it, with a
        log-normal prior: the median, and the factor by which it may be larger or smaller; a median of 0 leaves it out.

    Raises
    ------
    ModelError
        If one is not a finite number above zero, edge and spring not below it, or a factor not above 1.
    """

    frequency: float = 0.003
    factor: float = 3.0
    damping: float = 0.3
    shape: float = 0.05
    constant: float = 0.1
    edge: float = 0.01
    spring: float = 0.003
    spring_factor: float = 10.0

    def __post_init__(self) -> None:
        for name in ("frequency", "damping", "shape", "constant"):
            check_positive("model error", name, getattr(self, name))
        for name in ("edge", "spring"):
            if getattr(self, name):
                check_positive("model error", f"{name}, which may be 0,", getattr(self, name))
        for name in ("factor", "spring_factor"):
            check_positive("model error", f"{name} above 1, less 1,", getattr(self, name) - 1)


@dataclass(frozen=True, slots=True)
class NoiseChoice:
    """What a case says of the noise, see `[noise]` in docs/case-file.md: a model looks at what it knows.

    Parameters
    ----------
    scale, scale_range
        Whether the size of the stated noise is known, sampled or integrated out, and the factors on it if sampled.
    scale_dof, scale_guess
        Prior of the factor that is integrated out.
    dof
        Degrees of freedom of heavy tails.
    model_error
        Sizes of the model's errors in modes; None without any.
    """

    scale: Literal["known", "sampled", "integrated"] = "known"
    scale_range: tuple[float, float] = (0.1, 10.0)
    scale_dof: float = 4.0
    scale_guess: float = 1.0
    dof: float = 4.0
    model_error: ErrorSizes | None = None

    @property
    def parameters(self) -> tuple[Nuisance, ...]:
        """The prior of the factor on the stated noise, where it is sampled."""
        return (log_uniform("noise_scale", "× stated", *self.scale_range),) if self.scale == "sampled" else ()


def log_uniform(name: str, unit: str, low: float, high: float) -> Nuisance:
    """A hyperparameter of which every order of magnitude from `low` to `high` is equally probable."""
    return Nuisance(name, unit, 1.0, Uniform(math.log(low), math.log(high)))


#: What a noise model takes up of a misfit: a wrong size of the noise, single lines that are far off; of natural
#: frequencies nobody asks.
Absorbed = Literal["nothing", "outliers", "size", "frequencies"]


class NoiseModel(ABC):
    """How measured values scatter about the model's, given the stated standard deviation σ of each.

    A model is a frozen dataclass with a field `parts`. It gives `scores` and `draw`, `log_likelihood` or
    `log_likelihood_of_chi2`, and `pointwise` where values are independent; the rest has defaults.
    """

    parts: int
    #: Whether ln L depends on residuals by Σ|z|² alone, so that no array over lines is needed.
    needs_chi2_only: ClassVar[bool] = False
    #: Whether it is the stated noise and nothing else.
    as_stated: ClassVar[bool] = False
    #: Whether residuals may be white by another noise than the stated one, as with bodies that are measured.
    takes_white_residuals: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if self.parts not in (1, 2):
            raise ModelError.of("noise", (), f"found {self.parts} parts", "2 (complex residuals) or 1 (real ones)")

    @property
    def names(self) -> tuple[str, ...]:
        """Hyperparameters, in order; none by default."""
        return ()

    def log_likelihood_of_chi2(self, chi2: ArrayLike, n_values: int, hyper: ArrayLike) -> Array:
        """ln L (n,) from Σ|z|² (n,) of `n_values` values, without the constant, where this is all that it needs."""
        found = f"found {type(self).__name__} without log_likelihood"
        raise ModelError.of("noise", (), found, "log_likelihood(z, hyper)")

    def log_likelihood(self, z: Residuals, hyper: ArrayLike) -> Array:
        """ln L (n,) of residuals (n, lines, pairs), without the constant; −inf where a residual is not finite."""
        flat = columns_of(z, self.parts).reshape(len(z), -1)
        chi2 = np.einsum("ni,ni->n", flat, flat)
        return finite_or_impossible(self.log_likelihood_of_chi2(chi2, math.prod(z.shape[1:]), hyper))

    def pointwise(self, z: Residuals, hyper: ArrayLike) -> Array:
        """Log density of each value, shape (n, lines, pairs), without the constant.

        Raises
        ------
        ModelError
            If the values depend on each other, which is the default.
        """
        found = f"found {type(self).__name__}, whose values depend on each other"
        expected = "independent values for pointwise densities"
        raise ModelError.of("noise", (), found, expected, "compare models by their evidence instead")

    @abstractmethod
    def scores(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """Residuals that are white Gaussian with the stated variance if the model holds, each row by its own hyper."""

    def whiten(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """Linear map of residuals (k, lines, pairs), for one set of hyperparameters (q,), for least squares."""
        return self.scores(z, hyper)

    @abstractmethod
    def draw(self, rng: np.random.Generator, hyper: ArrayLike, lines: int, pairs: int) -> Residuals:
        """Replicated residuals, shape (n, lines, pairs), one for each row of `hyper` (n, q)."""

    def typical_scale(self, chi2: float, n_values: int) -> float:
        """Size of the noise that Σ|z|² of so many values shows, in units of that in `scores`; 1 by default."""
        return 1.0

    def with_scale(
        self, chi2: ArrayLike, n_values: int, hyper: Array, rng: np.random.Generator | None = None
    ) -> "tuple[NoiseModel, Array]":
        """The model with a scale that it integrates out made a hyperparameter, and the rows of all, shape (n, q).

        Drawn given Σ|z|², shape (n,), or its typical value where there is no `rng`. By default nothing is integrated.
        """
        return self, hyper

    @property
    def absorbs(self) -> Absorbed:
        """What of a misfit it takes up."""
        return "size" if "noise_scale" in self.names else "nothing"

    def words(self, values: Mapping[str, float], z: Residuals) -> tuple[str, ...]:
        """What of the noise was inferred, in sentences, from values of the hyperparameters by name, and residuals."""
        if "noise_scale" not in values:
            return ()
        return (
            f"The noise was inferred as {values['noise_scale']:.3g} times the stated, "
            "so the size of the residuals is no test of the model.",
        )

    @property
    def shares(self) -> Hashable:
        """What tests have in common that share errors, so that `shared` gives their noise; None where none do."""
        return None

    def shared(self, noises: "Sequence[Any]", bodies: Sequence[int]) -> "NoiseModel":
        """The model, without parameters, of several tests, one after the other, that have `shares` in common.

        Tests of one structure have the same number among `bodies`.
        """
        raise NotImplementedError

    def draw_size(self, rng: np.random.Generator, z: Residuals) -> Array:
        """Sizes of the errors that `shares` is about, shape (n, q), drawn given residuals (n, lines, pairs)."""
        raise NotImplementedError

    def shift_of_edges(self, z: Residuals) -> Array:
        """Mean of the place of each clamp's edge given residuals, in its standard deviations, shape (n, edges)."""
        return np.empty((len(z), 0))

    def fitted_to(self, data: FrfData, parts: int) -> Self:
        """The same law for the lines and values of another measurement, with residuals of so many parts."""
        return replace(self, parts=parts) if is_dataclass(self) else self


class GaussianSpread(NoiseModel):
    """Independent Gaussian values whose standard deviation, in units of the stated one, hyperparameters set."""

    @abstractmethod
    def spread(self, hyper: ArrayLike, n: int) -> Array:
        """Standard deviation over the stated one, of a shape that goes with (n, lines, pairs)."""

    def pointwise(self, z: Residuals, hyper: ArrayLike) -> Array:
        """Log density of each value, shape (n, lines, pairs), without the constant."""
        spread = self.spread(hyper, len(z))
        return -squares_of(z) / spread**2 - self.parts * np.log(spread)

    def log_likelihood(self, z: Residuals, hyper: ArrayLike) -> Array:
        """ln L (n,) of residuals (n, lines, pairs), without the constant; −inf where a residual is not finite."""
        if self.needs_chi2_only:
            return super().log_likelihood(z, hyper)
        with np.errstate(all="ignore"):
            return finite_or_impossible(self.pointwise(z, hyper).sum(axis=(1, 2)))

    def scores(self, z: Residuals, hyper: ArrayLike) -> Residuals:
        """Residuals over their own standard deviations."""
        spread = self.spread(hyper, len(z))
        wide = spread if spread.shape[2] == 1 else np.repeat(spread, self.parts, axis=2)
        return residuals_of_columns(columns_of(z, self.parts) / wide, self.parts)

    def draw(self, rng: np.random.Generator, hyper: ArrayLike, lines: int, pairs: int) -> Residuals:
        """Replicated residuals, shape (n, lines, pairs), one for each row of `hyper` (n, q)."""
        n = len(np.atleast_2d(hyper))
        return self.spread(hyper, n) * white(rng, (n, lines, pairs), self.parts)


def check_positive(where: str, what: str, value: float) -> None:
    """Refuse a number that is not finite and above zero (ModelError)."""
    if not 0 < value < math.inf:
        raise ModelError.of(f"{where}", (), f"found {what} {value:g}", "a finite number above 0", "correct it")


def rows_of(hyper: ArrayLike, n: int, names: tuple[str, ...]) -> Array:
    """Hyperparameters (n, q), or one set (q,) for all rows, as (n, q)."""
    values = np.asarray(hyper, dtype=float)
    if values.ndim not in (1, 2) or values.shape[-1] != len(names) or (values.ndim == 2 and len(values) not in (1, n)):
        found = f"found hyperparameters of shape {values.shape}"
        raise ModelError.of("noise", (), found, f"({n}, {len(names)}), columns {', '.join(names) or 'none'}")
    return np.broadcast_to(values, (n, len(names)))


def columns_of(z: Residuals, parts: int) -> Array:
    """Residuals as reals, shape (n, lines, pairs·parts)."""
    if parts == 2:
        return np.ascontiguousarray(z, dtype=np.complex128).view(np.float64)
    return np.ascontiguousarray(z.real, dtype=np.float64)


def residuals_of_columns(columns: Array, parts: int) -> Residuals:
    """Reals (n, lines, pairs·parts) as residuals (n, lines, pairs)."""
    return columns.view(np.complex128) if parts == 2 else columns


def residuals_of_values(values: Array) -> Residuals:
    """Real residuals over their standard deviations, shape (n, m), as z of shape (n, m, 1)."""
    return values[:, :, None] / math.sqrt(2)


def values_of_residuals(z: Residuals) -> Array:
    """Real z, shape (n, m, 1), as residuals over their standard deviations, shape (n, m)."""
    return math.sqrt(2) * np.asarray(z[:, :, 0])


def squares_of(z: Residuals) -> Array:
    """|z|², shape as z."""
    return z.real**2 + z.imag**2 if np.iscomplexobj(z) else z**2


def finite_or_impossible(value: Array) -> Array:
    """ln L, −inf where it is not a number: an undamped joint that resonates on a line, a scale of zero."""
    return np.where(np.isfinite(value), value, -np.inf)


def white(rng: np.random.Generator, shape: tuple[int, int, int], parts: int) -> Residuals:
    """Independent residuals under the stated noise: variance 1/2 in each part."""
    return residuals_of_columns(math.sqrt(0.5) * rng.standard_normal((*shape[:2], shape[2] * parts)), parts)
