"""Residuals and hyperparameters as the noise models take them: shapes, checks, reals and complex numbers."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError

__all__ = [
    "Residuals",
    "check_parts",
    "check_positive",
    "chi2_of",
    "columns_of",
    "finite_or_impossible",
    "from_columns",
    "no_pointwise",
    "rows_of",
    "squares_of",
    "white",
]

Array = NDArray[np.float64]
#: Residuals, complex where `parts` is 2, real where it is 1.
Residuals = NDArray[Any]


def check_parts(parts: int) -> None:
    """Refuse values that have neither one nor two parts (ModelError)."""
    if parts not in (1, 2):
        raise ModelError(f"noise: found {parts} parts; expected 2 (complex residuals) or 1 (real ones)")


def check_positive(where: str, what: str, value: float) -> None:
    """Refuse a number that is not finite and above zero (ModelError)."""
    if not 0 < value < math.inf:
        raise ModelError(f"{where}: found {what} {value:g}; expected a finite number above 0; correct it")


def no_pointwise(what: str, remedy: str) -> ModelError:
    """Error of a noise model whose values depend on each other."""
    return ModelError(f"noise: found {what}; expected independent values for pointwise densities; {remedy}")


def rows_of(hyper: ArrayLike, n: int, names: tuple[str, ...]) -> Array:
    """Hyperparameters (n, q), or one set (q,) for all rows, as (n, q)."""
    values = np.asarray(hyper, dtype=float)
    if values.ndim not in (1, 2) or values.shape[-1] != len(names) or (values.ndim == 2 and len(values) not in (1, n)):
        raise ModelError(
            f"noise: found hyperparameters of shape {values.shape}; expected ({n}, {len(names)}), columns "
            f"{', '.join(names) or 'none'}"
        )
    return np.broadcast_to(values, (n, len(names)))


def columns_of(z: Residuals, parts: int) -> Array:
    """Residuals as reals, shape (n, lines, pairs·parts)."""
    if parts == 2:
        return np.ascontiguousarray(z, dtype=np.complex128).view(np.float64)
    return np.ascontiguousarray(z.real, dtype=np.float64)


def from_columns(columns: Array, parts: int) -> Residuals:
    """Reals (n, lines, pairs·parts) as residuals (n, lines, pairs)."""
    return columns.view(np.complex128) if parts == 2 else columns


def chi2_of(z: Residuals, parts: int) -> Array:
    """Σ|z|², shape (n,)."""
    flat = columns_of(z, parts).reshape(len(z), -1)
    total: Array = np.einsum("ni,ni->n", flat, flat)
    return total


def squares_of(z: Residuals) -> Array:
    """|z|², shape as z."""
    value: Array = z.real**2 + z.imag**2 if np.iscomplexobj(z) else z**2
    return value


def finite_or_impossible(value: Array) -> Array:
    """ln L, −inf where it is not a number: an undamped joint that resonates on a line, a scale of zero."""
    return np.where(np.isfinite(value), value, -np.inf)


def white(rng: np.random.Generator, shape: tuple[int, int, int], parts: int) -> Residuals:
    """Independent residuals under the stated noise: variance 1/2 in each part."""
    return from_columns(math.sqrt(0.5) * rng.standard_normal((*shape[:2], shape[2] * parts)), parts)
