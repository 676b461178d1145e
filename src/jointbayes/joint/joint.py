"""A joint: a small symmetric stiffness K^J between DOFs, and the coordinates it is inferred in.

References
----------
Cao, H., Li, B., He, Z. A joint stiffness identification method based on finite element modeling and
frequency response functions, section 3 (K^J with k11, k12, k22 at one translation and one rotation).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.joint.plain_springs import RIGID, PlainSprings

__all__ = [
    "RIGID",
    "STIFFNESS_NAMES",
    "STIFFNESS_PATTERN",
    "STIFFNESS_UNITS",
    "ComplianceChart",
    "CondensedChart",
    "Joint",
    "LogStiffness",
    "Parametrisation",
    "PlainSprings",
    "SignedCoupling",
    "check_positive_semidefinite",
    "is_positive_semidefinite",
    "joint_matrix",
    "symmetric_changes",
]

Array = NDArray[np.float64]

STIFFNESS_NAMES = ("k11", "k12", "k22")
#: The paper prints N/m for all three; a translation-rotation joint has these.
STIFFNESS_UNITS = ("N/m", "N", "N·m/rad")

_ADJUGATE_SIGNS = np.array([1.0, -1.0, 1.0])

#: ∂K^J/∂(k11, k12, k22), the paper's K_i, shape (3, 2, 2).
STIFFNESS_PATTERN = np.array([[[1.0, 0.0], [0.0, 0.0]], [[0.0, 1.0], [1.0, 0.0]], [[0.0, 0.0], [0.0, 1.0]]])
STIFFNESS_PATTERN.setflags(write=False)


class LabelledDofs(Protocol):
    """Whatever has DOFs with labels: a structure."""

    @property
    def n_dofs(self) -> int:
        """Number of DOFs."""
        ...

    def index(self, labels: Sequence[str]) -> NDArray[np.intp]:
        """Row numbers of DOF labels, shape (len(labels),)."""
        ...


@dataclass(frozen=True, slots=True)
class Joint:
    """Where a joint acts.

    Parameters
    ----------
    dofs
        Labels of the r DOFs on the structure's side, e.g. ``("1:y", "1:rz")``.
    against
        Labels of the r DOFs on the other side; empty means ground.

    Raises
    ------
    ModelError
        If a DOF occurs twice or the two sides differ in number.
    """

    dofs: tuple[str, ...]
    against: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        both = self.dofs + self.against
        if not self.dofs or len(set(both)) != len(both):
            raise ModelError(f"joint: found DOFs {both}; expected one or more, each once; correct the labels")
        if self.against and len(self.against) != len(self.dofs):
            raise ModelError(
                f"joint: found {len(self.dofs)} DOFs against {len(self.against)}; "
                "expected as many on both sides, or none (ground) on the other; correct the labels"
            )

    def selection(self, structure: LabelledDofs) -> Array:
        """Matrix B, shape (n, r), so that Bᵀx is the joint's deformation and B K^J Bᵀ its stiffness.

        Raises
        ------
        ModelError
            If a DOF does not exist in the structure.
        """
        selection = np.zeros((structure.n_dofs, len(self.dofs)))
        selection[structure.index(self.dofs), np.arange(len(self.dofs))] = 1.0
        if self.against:
            selection[structure.index(self.against), np.arange(len(self.dofs))] = -1.0
        return selection


def joint_matrix(stiffness: ArrayLike) -> Array:
    """K^J, shape (..., 2, 2), from (k11, k12, k22), shape (..., 3).

    Examples
    --------
    >>> joint_matrix([3.0, 1.0, 2.0]).tolist()
    [[3.0, 1.0], [1.0, 2.0]]
    """
    k = np.asarray(stiffness, dtype=float)
    return k[..., [0, 1, 1, 2]].reshape(*k.shape[:-1], 2, 2)


def symmetric_changes(r: int) -> Array:
    """Symmetric change dK^J for each entry in turn, shape (r², r, r): one on the diagonal, two halves off it."""
    unit = np.eye(r * r).reshape(-1, r, r)
    changes: Array = (unit + unit.swapaxes(1, 2)) / 2
    return changes


def is_positive_semidefinite(stiffness: ArrayLike) -> NDArray[np.bool_]:
    """Whether a joint (k11, k12, k22), shape (..., 3), releases no energy, shape (...)."""
    k11, k12, k22 = np.moveaxis(np.asarray(stiffness, dtype=float), -1, 0)
    possible: NDArray[np.bool_] = (k11 >= 0) & (k22 >= 0) & (k12**2 <= k11 * k22)
    return possible


def check_positive_semidefinite(stiffness: ArrayLike) -> None:
    """Refuse a joint that could release energy.

    Parameters
    ----------
    stiffness
        (k11, k12, k22), shape (3,).

    Raises
    ------
    ModelError
        If a number is not finite, k11 or k22 is negative, or k12² > k11 k22.
    """
    k11, k12, k22 = (float(k) for k in np.asarray(stiffness, dtype=float))
    if not np.isfinite([k11, k12, k22]).all():
        raise ModelError(f"joint: found k11 = {k11:g}, k12 = {k12:g}, k22 = {k22:g}; expected finite numbers")
    if not is_positive_semidefinite(stiffness):
        raise ModelError(
            f"joint: found k11 = {k11:g} N/m, k12 = {k12:g} N, k22 = {k22:g} N·m/rad; expected a positive "
            f"semidefinite matrix (k11 >= 0, k22 >= 0, k12² <= k11·k22 = {k11 * k22:g}); lower |k12| or raise k11, k22"
        )


@dataclass(frozen=True, slots=True)
class LogStiffness:
    """Coordinates θ = (ln k11, ln k12, ln k22), so that every stiffness is positive."""

    names: tuple[str, ...] = STIFFNESS_NAMES

    def stiffness(self, theta: ArrayLike) -> Array:
        """(k11, k12, k22), shape (..., 3), from θ, shape (..., 3)."""
        stiffness: Array = np.exp(np.asarray(theta, dtype=float))
        return stiffness

    def coordinates(self, stiffness: ArrayLike) -> Array:
        """θ, shape (..., 3), of (k11, k12, k22), shape (..., 3).

        Raises
        ------
        ModelError
            If a stiffness is not positive.
        """
        k = np.asarray(stiffness, dtype=float)
        if not (k > 0).all():
            raise ModelError(
                f"log-stiffness coordinates: found stiffness {k.tolist()}; expected all above zero; "
                "use the signed parametrisation for a coupling of either sign"
            )
        theta: Array = np.log(k)
        return theta

    def derivative(self, theta: ArrayLike) -> Array:
        """∂(k11, k12, k22)/∂θ, shape (..., 3, 3): stiffness down, coordinate across."""
        derivative: Array = np.exp(np.asarray(theta, dtype=float))[..., None] * np.eye(3)
        return derivative

    def log_slope(self, theta: Array) -> Array:
        """ln |∂(k11, k12, k22)/∂θ|, shape (...), at θ, shape (..., 3)."""
        slope: Array = theta.sum(axis=-1)
        return slope

    def log_determinant(self, theta: Array) -> Array:
        """ln det K^J, shape (...), at feasible θ, shape (..., 3)."""
        diagonal = theta[..., 0] + theta[..., 2]
        determinant: Array = diagonal + np.log1p(-np.exp(2 * theta[..., 1] - diagonal))
        return determinant

    def feasible(self, theta: ArrayLike) -> NDArray[np.bool_]:
        """Whether K^J is positive definite, shape (...); θ has shape (..., 3)."""
        t = np.asarray(theta, dtype=float)
        inside: NDArray[np.bool_] = 2 * t[..., 1] < t[..., 0] + t[..., 2]
        return inside


@dataclass(frozen=True, slots=True)
class SignedCoupling:
    """Coordinates θ = (ln k11, ln k22, ρ) with k12 = ρ √(k11 k22), −1 < ρ < 1, of either sign."""

    names: tuple[str, ...] = ("k11", "k22", "rho")

    def stiffness(self, theta: ArrayLike) -> Array:
        """(k11, k12, k22), shape (..., 3), from θ, shape (..., 3)."""
        t = np.asarray(theta, dtype=float)
        k11, k22 = np.exp(t[..., 0]), np.exp(t[..., 1])
        return np.stack([k11, t[..., 2] * np.sqrt(k11 * k22), k22], axis=-1)

    def coordinates(self, stiffness: ArrayLike) -> Array:
        """θ, shape (..., 3), of (k11, k12, k22), shape (..., 3).

        Raises
        ------
        ModelError
            If k11 or k22 is not positive.
        """
        k = np.asarray(stiffness, dtype=float)
        if not (k[..., [0, 2]] > 0).all():
            raise ModelError(
                f"signed coordinates: found stiffness {k.tolist()}; expected k11 and k22 above zero; raise them"
            )
        log11, log22 = np.log(k[..., 0]), np.log(k[..., 2])
        return np.stack([log11, log22, k[..., 1] * np.exp(-(log11 + log22) / 2)], axis=-1)

    def derivative(self, theta: ArrayLike) -> Array:
        """∂(k11, k12, k22)/∂θ, shape (..., 3, 3): stiffness down, coordinate across."""
        t = np.asarray(theta, dtype=float)
        k11, k12, k22 = np.moveaxis(self.stiffness(t), -1, 0)
        out = np.zeros((*t.shape[:-1], 3, 3))
        out[..., 0, 0], out[..., 2, 1] = k11, k22
        out[..., 1, 0] = out[..., 1, 1] = k12 / 2
        out[..., 1, 2] = np.sqrt(k11 * k22)
        return out

    def log_slope(self, theta: Array) -> Array:
        """ln |∂(k11, k12, k22)/∂θ|, shape (...), at θ, shape (..., 3)."""
        slope: Array = 1.5 * (theta[..., 0] + theta[..., 1])
        return slope

    def log_determinant(self, theta: Array) -> Array:
        """ln det K^J, shape (...), at feasible θ, shape (..., 3)."""
        determinant: Array = theta[..., 0] + theta[..., 1] + np.log1p(-(theta[..., 2] ** 2))
        return determinant

    def feasible(self, theta: ArrayLike) -> NDArray[np.bool_]:
        """Whether K^J is positive definite, shape (...); θ has shape (..., 3)."""
        inside: NDArray[np.bool_] = np.abs(np.asarray(theta, dtype=float)[..., 2]) < 1.0
        return inside


Parametrisation = LogStiffness | SignedCoupling | PlainSprings


@dataclass(frozen=True, slots=True)
class ComplianceChart:
    """Joint compliance φ = (c11, c12, c22), C = (K^J)⁻¹, as coordinates beside θ; φ = 1/k for plain springs.

    An FRF depends on the joint through C + A_jj and is nearly linear in C, so that a posterior which is skewed in
    ln k is nearly Gaussian here.
    """

    parametrisation: Parametrisation

    def forward(self, theta: Array) -> Array:
        """φ, shape (n, d), of θ, shape (n, d)."""
        if isinstance(self.parametrisation, PlainSprings):
            return self.parametrisation.compliance(theta)
        return _inverse_2x2(self.parametrisation.stiffness(theta))

    def inverse(self, phi: Array) -> tuple[Array, NDArray[np.bool_]]:
        """θ, shape (n, d), and whether φ is a joint that θ can describe, shape (n,)."""
        if isinstance(self.parametrisation, PlainSprings):
            return self.parametrisation.from_compliance(phi)
        c11, c12, c22 = phi.T
        inside = (c11 > 0) & (c22 > 0) & (c11 * c22 > c12 * c12)
        if "k12" in self.parametrisation.names:
            inside &= c12 < 0  # k12 > 0
        possible = phi if inside.all() else np.where(inside[:, None], phi, [1.0, -0.5, 1.0])
        return self.parametrisation.coordinates(_inverse_2x2(possible)), inside

    def log_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,): |∂C/∂K| of a symmetric 2 × 2 matrix is (det K)⁻³."""
        if isinstance(self.parametrisation, PlainSprings):
            return self.parametrisation.log_compliance_volume(theta)
        return 3 * self.parametrisation.log_determinant(theta) - self.parametrisation.log_slope(theta)


@dataclass(frozen=True, slots=True)
class CondensedChart:
    """ln(k22 − k12²/k11) in place of ln k22, for θ = (ln k11, ln k12, ln k22, …); the rest stays as it is.

    That is the rotational stiffness with the translation free to follow, 1/c22, which vibration tells best. Where k11
    and k12 are hardly known, k22 must follow them along a curved sheet that is flat in these coordinates.
    """

    def forward(self, theta: Array) -> Array:
        """φ, shape (n, d), of θ, shape (n, d)."""
        phi = np.array(theta, dtype=np.float64)
        share = np.minimum(np.exp(2 * phi[:, 1] - phi[:, 0] - phi[:, 2]), 1 - np.finfo(float).eps)
        phi[:, 2] += np.log1p(-share)
        return phi

    def inverse(self, phi: Array) -> tuple[Array, NDArray[np.bool_]]:
        """θ, shape (n, d), and True for each, shape (n,): any φ is a joint."""
        theta = np.array(phi, dtype=np.float64)
        theta[:, 2] = np.logaddexp(phi[:, 2], 2 * phi[:, 1] - phi[:, 0])
        return theta, np.ones(len(phi), dtype=bool)

    def log_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,)."""
        volume: Array = self.forward(theta)[:, 2] - theta[:, 2]
        return volume


def _inverse_2x2(matrix: Array) -> Array:
    """(m11, m12, m22) of the inverse, shape (..., 3)."""
    m12 = matrix[..., 1]
    determinant = matrix[..., 0] * matrix[..., 2] - m12 * m12
    inverse: Array = matrix[..., ::-1] * _ADJUGATE_SIGNS / determinant[..., None]
    return inverse
