"""A joint with any symmetric positive definite K^J of up to six DOFs."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import ModelError
from jointbayes.joint.parametrisation import Parametrisation
from jointbayes.joint.quantities import DIRECTIONS, Coordinate, Quantity, full_coordinates, full_stiffnesses
from vibrecords.arrays import Array, Flags, Indices

_SMALLEST_STIFFNESS = float(np.exp(-20.0))
_LARGEST_COUPLING = 0.9  # of the largest partial coefficient, in a start
_ROUNDING = 1e-12  # of a K^J scaled to a unit diagonal: an eigenvalue so far below 0 is 0


@dataclass(frozen=True)
class FullStiffness(Parametrisation):
    """Coordinates ln k_ii of each motion and partial coupling coefficients −1 < ρ_ij < 1, i < j, one after the other.

    K^J = S R S with S = diag(√k_ii) and the Cholesky factor L of R row by row, L_ji = ρ_ij √(1 − ρ_1j²) … and so on up
    to i − 1: ρ_1j is the coupling coefficient k_1j/√(k_11 k_jj), ρ_ij that of the stiffness which is left where
    motions 1 to i − 1 are free. Any coefficients make a positive definite joint and every one has them: there is no
    cone. With two motions these are the coordinates of `jointbayes.joint.SignedCoupling`.

    Parameters
    ----------
    directions
        Directions of its motions, at most six: ``("x", "y", "rz")``.

    Raises
    ------
    ModelError
        If there are none or more than six, or one is no direction.

    References
    ----------
    Lewandowski, D., Kurowicka, D., Joe, H. (2009). Generating random correlation matrices based on vines and extended
    onion method. Journal of Multivariate Analysis 100(9), 1989-2001. DOI 10.1016/j.jmva.2009.04.008
    """

    directions: tuple[str, ...]

    key: ClassVar[str] = "full"

    def __post_init__(self) -> None:
        object.__setattr__(self, "directions", tuple(self.directions))
        unknown = [direction for direction in self.directions if direction not in DIRECTIONS]
        if unknown or not 1 <= len(self.directions) <= len(DIRECTIONS):
            found = f"found directions {self.directions}"
            raise ModelError.of("full joint", (), found, f"one to six of {', '.join(DIRECTIONS)}", "correct them")

    @cached_property
    def axes(self) -> tuple[Coordinate, ...]:
        """ln k of each motion, then the partial coupling coefficients."""
        return full_coordinates(self.directions)

    @cached_property
    def quantities(self) -> tuple[Quantity, ...]:
        """Every entry on and above the diagonal, row by row."""
        return full_stiffnesses(self.directions)

    @property
    def _motions(self) -> int:
        return len(self.directions)

    @cached_property
    def _diagonal(self) -> list[int]:
        return [i for i, quantity in enumerate(self.quantities) if not quantity.may_be_negative]

    @cached_property
    def _couplings(self) -> tuple[Indices, Indices]:
        return np.triu_indices(self._motions, 1)

    def _correlation_factor(self, rho: Array) -> tuple[Array, Array]:
        """L, shape (..., r, r), of partial coefficients, shape (..., p), and these as a matrix, ρ_ij at j, i."""
        r = self._motions
        partial = np.zeros((*rho.shape[:-1], r, r))
        rows, columns = self._couplings
        partial[..., columns, rows] = rho
        left = np.sqrt(1 - partial**2)
        before = np.ones_like(partial)  # Π_{m<i} √(1 − ρ_mj²)
        before[..., 1:] = np.cumprod(left[..., :-1], axis=-1)
        factor = partial * before
        diagonal = np.arange(r)
        factor[..., diagonal, diagonal] = before[..., diagonal, diagonal]
        return factor, partial

    def _scaled(self, values: Array) -> tuple[Array, Array]:
        """√k_ii, shape (..., r), and K^J scaled to a unit diagonal, shape (..., r, r)."""
        size = np.sqrt(values[..., self._diagonal])
        return size, self.matrix(values).stiffness / (size[..., :, None] * size[..., None, :])

    def values(self, theta: ArrayLike) -> Array:
        """Entries of K^J, shape (..., q), from θ, shape (..., d)."""
        t = np.asarray(theta, dtype=float)
        r = self._motions
        factor, _ = self._correlation_factor(t[..., r:])
        size = np.exp(t[..., :r] / 2)
        values = self.values_of_matrix((factor @ factor.swapaxes(-1, -2)) * (size[..., :, None] * size[..., None, :]))
        values[..., self._diagonal] = np.exp(t[..., :r])
        return values

    def describes(self, values: ArrayLike) -> Flags:
        """Whether the joint is positive definite."""
        k = np.asarray(values, dtype=float)
        possible = np.asarray(np.isfinite(k).all(axis=-1) & (k[..., self._diagonal] > 0).all(axis=-1))
        _, scaled = self._scaled(np.where(possible[..., None], k, self._any))
        return np.asarray(possible & (np.linalg.eigvalsh(scaled) > 0).all(axis=-1))

    @cached_property
    def _any(self) -> Array:
        """A joint that stands where there is none."""
        return np.array([0.0 if quantity.may_be_negative else 1.0 for quantity in self.quantities])

    def _coordinates(self, values: Array) -> Array:
        _, scaled = self._scaled(values)
        factor = np.linalg.cholesky(scaled)
        # what is left of row j after columns 1 to i − 1: √(1 − Σ L_jm²) = Π_{m<i} √(1 − ρ_mj²)
        rest = np.cumsum(factor[..., ::-1] ** 2, axis=-1)[..., ::-1]
        rows, columns = self._couplings
        rho = factor[..., columns, rows] / np.sqrt(rest[..., columns, rows])
        return np.concatenate([np.log(values[..., self._diagonal]), rho], axis=-1)

    def derivative(self, theta: ArrayLike) -> Array:
        """∂k/∂θ, shape (..., q, d): stiffness down, coordinate across."""
        t = np.asarray(theta, dtype=float)
        r = self._motions
        factor, partial = self._correlation_factor(t[..., r:])
        size = np.exp(t[..., :r] / 2)
        scale = size[..., :, None] * size[..., None, :]
        matrix = (factor @ factor.swapaxes(-1, -2)) * scale
        slope = np.zeros((*t.shape[:-1], len(self.quantities), t.shape[-1]))
        for i in range(r):
            change = np.zeros_like(matrix)
            change[..., i, :] += matrix[..., i, :] / 2
            change[..., :, i] += matrix[..., :, i] / 2
            slope[..., i] = self.values_of_matrix(change)
        for column, (i, j) in enumerate(zip(*self._couplings, strict=True), r):
            rho = partial[..., j, i]
            turned = np.zeros_like(factor)  # ∂L/∂ρ_ij: row j alone
            turned[..., j, i] = np.prod(np.sqrt(1 - partial[..., j, :i] ** 2), axis=-1)
            turned[..., j, i + 1 : j + 1] = factor[..., j, i + 1 : j + 1] * (-rho / (1 - rho**2))[..., None]
            half = turned @ factor.swapaxes(-1, -2)
            slope[..., column] = self.values_of_matrix((half + half.swapaxes(-1, -2)) * scale)
        return slope

    def _log_left(self, theta: Array) -> Array:
        """ln(1 − ρ²) of each partial coefficient, shape (..., p)."""
        return np.log1p(-(theta[..., self._motions :] ** 2))

    def log_slope(self, theta: Array) -> Array:
        """ln |∂k/∂θ|, shape (...), at θ, shape (..., d)."""
        # ∂k_ij/∂r_ij = √(k_ii k_jj): each k_ii stands in its own row and in r − 1 couplings
        r = self._motions
        scale = (1 + (r - 1) / 2) * theta[..., :r].sum(axis=-1)
        # Lewandowski et al., Eq. (10): ∂r_ij/∂ρ_ij = Π_{m<i} √(1 − ρ_mi²)(1 − ρ_mj²)
        weight = (r - 2 - self._couplings[0]) / 2
        return scale + (weight * self._log_left(theta)).sum(axis=-1)

    def log_determinant(self, theta: Array) -> Array:
        """ln det K^J, shape (...), at feasible θ, shape (..., d)."""
        return theta[..., : self._motions].sum(axis=-1) + self._log_left(theta).sum(axis=-1)

    def nearest(self, values: ArrayLike) -> Array:
        """A joint near one of shape (q,) with smaller partial coefficients; without coupling if it is impossible."""
        k = np.array(values, dtype=float)
        k[self._diagonal] = np.maximum(k[self._diagonal], _SMALLEST_STIFFNESS)
        if not self.describes(k):
            return self.uncoupled(k)
        theta = self.coordinates(k)
        if (np.abs(theta[self._motions :]) <= _LARGEST_COUPLING).all():
            return k
        theta[self._motions :] = np.clip(theta[self._motions :], -_LARGEST_COUPLING, _LARGEST_COUPLING)
        return self.values(theta)

    def is_positive_semidefinite(self, values: ArrayLike) -> Flags:
        """Whether joints, shape (..., q), are positive semidefinite, shape (...), to rounding."""
        k = np.asarray(values, dtype=float)
        matrix = self.matrix(k).stiffness
        diagonal = k[..., self._diagonal]
        size = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        scaled = matrix / (size[..., :, None] * size[..., None, :])
        lowest = np.linalg.eigvalsh(scaled)[..., 0]
        return np.asarray((diagonal >= 0).all(axis=-1) & (lowest >= -_ROUNDING))

    def uncoupled(self, values: ArrayLike) -> Array:
        """The same joints, shape (..., q), with the diagonal of K^J alone."""
        return np.asarray(values, dtype=float) * self._any

    def compliance(self, theta: Array) -> Array:
        """Entries of C = (K^J)⁻¹ on and above the diagonal, shape (n, d), of θ, shape (n, d)."""
        return self._inverse(self.values(theta))

    def coordinates_of_compliance(self, phi: Array) -> tuple[Array, Flags]:
        """θ, shape (n, d), of φ, shape (n, d), and whether φ is a joint that θ can describe, shape (n,)."""
        inside = self.describes(phi)
        values = self._inverse(np.where(inside[:, None], phi, self._any))
        inside = inside & self.describes(values)
        values = np.where(inside[:, None], values, self._any)
        return self.coordinates(values), inside

    def _inverse(self, values: Array) -> Array:
        size, scaled = self._scaled(values)
        inverse = np.linalg.inv(scaled) / (size[..., :, None] * size[..., None, :])
        return self.values_of_matrix((inverse + inverse.swapaxes(-1, -2)) / 2)

    def log_compliance_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,): |∂C/∂K| of a symmetric r × r matrix is (det K)⁻⁽ʳ⁺¹⁾."""
        return (self._motions + 1) * self.log_determinant(theta) - self.log_slope(theta)
