"""Coordinates θ that a joint is inferred in, and everything that is asked about them.

A `Parametrisation` is one file of this room: its coordinates with names, labels, units and bounds, the stiffnesses that
they describe, and where these are positive definite. Nobody outside this room asks which parametrisation it is.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.joint.quantities import COORDINATES, STIFFNESSES, Coordinate, Quantity

__all__ = ["ComplianceCoordinates", "CondensedCoordinates", "Cone", "Parametrisation", "parametrisation_named"]

Array = NDArray[np.float64]

_ADJUGATE_SIGNS = np.array([1.0, -1.0, 1.0])
_ANY_JOINT = np.array([1.0, -0.5, 1.0])  # compliance and stiffness that stand where there is no joint
_SMALLEST_STIFFNESS = math.exp(-20.0)
_LARGEST_COUPLING = 0.9  # of √(k11 k22), in a start


@dataclass(frozen=True, slots=True)
class Cone:
    """Where three logarithms describe a positive definite joint: 2 θ[coupling] < θ[first] + θ[last].

    Parameters
    ----------
    first, coupling, last
        Columns of θ.
    """

    first: int
    coupling: int
    last: int

    def normal(self, size: int) -> Array:
        """Vector n, shape (size,), of n · θ < 0."""
        normal = np.zeros(size)
        normal[[self.first, self.coupling, self.last]] = -1.0, 2.0, -1.0
        return normal


class Parametrisation(ABC):
    """Coordinates θ of a joint of one translation and one rotation.

    A further one is a subclass that states what is abstract here, in a file named as its entry in
    `jointbayes.joint.quantities.COORDINATES`, of which the file's ``PARAMETRISATION`` is an instance.
    """

    #: Its name in case files.
    key: ClassVar[str]
    #: What is wrong with a joint that it cannot describe.
    expected: ClassVar[str] = "a positive definite joint; lower |k12|, or raise k11 and k22"
    #: Its stiffnesses, in the order of `stiffness`.
    quantities: ClassVar[tuple[Quantity, ...]] = STIFFNESSES
    #: Where joints are positive definite, unless the bounds of each coordinate say so.
    cone: ClassVar[Cone | None] = None
    #: Coordinates in which a joint with hardly known k11 and k12 lies on a straight ridge; None where it does in θ.
    ridge: ClassVar["CondensedCoordinates | None"] = None
    #: Least coupling of a start, as a share of the largest.
    least_coupling: ClassVar[float] = -1.0

    @property
    def axes(self) -> tuple[Coordinate, ...]:
        """The coordinates, in order."""
        return COORDINATES[self.key]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return tuple(axis.name for axis in self.axes)

    @property
    def derived(self) -> tuple[str, ...]:
        """Names of the stiffnesses that θ moves but that are no coordinates."""
        return tuple(axis.quantity for axis in self.axes if axis.quantity != axis.name)

    def standing_for(self, quantity: str) -> str:
        """Name of the coordinate that is a stiffness, or that stands for it."""
        return next(axis.name for axis in self.axes if axis.quantity == quantity)

    @abstractmethod
    def stiffness(self, theta: ArrayLike) -> Array:
        """(k11, k12, k22), shape (..., 3), from θ, shape (..., d)."""

    @abstractmethod
    def describes(self, stiffness: ArrayLike) -> NDArray[np.bool_]:
        """Whether (k11, k12, k22), shape (..., 3), have coordinates, shape (...)."""

    @abstractmethod
    def _coordinates(self, stiffness: Array) -> Array:
        """θ, shape (..., d), of stiffnesses that have coordinates, shape (..., 3)."""

    @abstractmethod
    def derivative(self, theta: ArrayLike) -> Array:
        """∂(k11, k12, k22)/∂θ, shape (..., 3, d): stiffness down, coordinate across."""

    @abstractmethod
    def log_slope(self, theta: Array) -> Array:
        """ln |∂k/∂θ|, shape (...), of the stiffnesses k that θ moves, at θ, shape (..., d)."""

    @abstractmethod
    def log_determinant(self, theta: Array) -> Array:
        """ln det K^J, shape (...), at feasible θ, shape (..., d); without motions that are held rigid."""

    def coordinates(self, stiffness: ArrayLike) -> Array:
        """θ, shape (..., d), of (k11, k12, k22), shape (..., 3).

        Raises
        ------
        ModelError
            If a joint has no such coordinates.
        """
        k = np.asarray(stiffness, dtype=float)
        with np.errstate(all="ignore"):
            theta = self._coordinates(k) if self.describes(k).all() else None
        if theta is None or not np.isfinite(theta).all():
            raise ModelError(f"joint in {self.key} coordinates: found stiffness {k.tolist()}; expected {self.expected}")
        return theta

    def feasible(self, theta: ArrayLike) -> NDArray[np.bool_]:
        """Whether K^J is positive definite, shape (...); θ has shape (..., d)."""
        t = np.asarray(theta, dtype=float)
        inside = np.ones(t.shape[:-1], dtype=np.bool_)
        if self.cone is not None:
            first, coupling, last = t[..., self.cone.first], t[..., self.cone.coupling], t[..., self.cone.last]
            inside = inside & (2 * coupling < first + last)
        for i, axis in enumerate(self.axes):
            if axis.bounded:
                inside = inside & (t[..., i] > axis.bounds[0]) & (t[..., i] < axis.bounds[1])
        return np.asarray(inside)

    def nearest(self, stiffness: ArrayLike) -> Array:
        """A joint near (k11, k12, k22), shape (3,), that has coordinates, well inside the positive definite ones."""
        k11, k12, k22 = np.asarray(stiffness, dtype=float)
        k11, k22 = max(k11, _SMALLEST_STIFFNESS), max(k22, _SMALLEST_STIFFNESS)
        limit = _LARGEST_COUPLING * np.sqrt(k11 * k22)
        return np.array([k11, np.clip(k12, self.least_coupling * limit, limit), k22])

    def limiting_joints(self, mean: Array, sd: Array) -> Mapping[str, Array]:
        """Joints (k11, k12, k22) near limits of θ, where modes of their own may be, by name; none by default.

        Parameters
        ----------
        mean, sd
            Of the prior of each coordinate, shape (d,).
        """
        return {}

    def compliance(self, theta: Array) -> Array:
        """Compliance φ = (c11, c12, c22), C = (K^J)⁻¹, shape (n, d), of θ, shape (n, d)."""
        return _inverse_2x2(self.stiffness(theta))

    def from_compliance(self, phi: Array) -> tuple[Array, NDArray[np.bool_]]:
        """θ, shape (n, d), of φ, shape (n, d), and whether φ is a joint that θ can describe, shape (n,)."""
        c11, c12, c22 = phi.T
        inside = (c11 > 0) & (c22 > 0) & (c11 * c22 > c12 * c12)
        stiffness = _inverse_2x2(phi if inside.all() else np.where(inside[:, None], phi, _ANY_JOINT))
        inside &= self.describes(stiffness)
        if not inside.all():
            stiffness = np.where(inside[:, None], stiffness, _inverse_2x2(_ANY_JOINT))
        return self.coordinates(stiffness), inside

    def log_compliance_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,): |∂C/∂K| of a symmetric 2 × 2 matrix is (det K)⁻³."""
        return 3 * self.log_determinant(theta) - self.log_slope(theta)


def parametrisation_named(key: str) -> Parametrisation:
    """The coordinates that a case file calls so, one of `COORDINATES`."""
    return import_module(f"jointbayes.joint.{key}").PARAMETRISATION


@dataclass(frozen=True, slots=True)
class ComplianceCoordinates:
    """Joint compliance φ as coordinates in place of θ: (c11, c12, c22), C = (K^J)⁻¹, or 1/k of plain springs.

    An FRF depends on the joint through C + A_jj and is nearly linear in C, so that a posterior which is skewed in
    ln k is nearly Gaussian here.
    """

    parametrisation: Parametrisation

    def forward(self, theta: Array) -> Array:
        """φ, shape (n, d), of θ, shape (n, d)."""
        return self.parametrisation.compliance(theta)

    def inverse(self, phi: Array) -> tuple[Array, NDArray[np.bool_]]:
        """θ, shape (n, d), and whether φ is a joint that θ can describe, shape (n,)."""
        return self.parametrisation.from_compliance(phi)

    def log_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,)."""
        return self.parametrisation.log_compliance_volume(theta)


@dataclass(frozen=True, slots=True)
class CondensedCoordinates:
    """ln(k22 − k12²/k11) in place of ln k22, for θ = (ln k11, ln k12, ln k22, …); the rest stays as it is.

    That is the rotational stiffness with the translation free to follow, 1/c22, which vibration tells best. Where k11
    and k12 are hardly known, k22 must follow them along a curved sheet that is flat in these coordinates.
    """

    #: Where the coordinate stands that is replaced.
    column: ClassVar[int] = 2

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
        return self.forward(theta)[:, 2] - theta[:, 2]


def _inverse_2x2(matrix: Array) -> Array:
    """(m11, m12, m22) of the inverse, shape (..., 3)."""
    m12 = matrix[..., 1]
    determinant = matrix[..., 0] * matrix[..., 2] - m12 * m12
    return matrix[..., ::-1] * _ADJUGATE_SIGNS / determinant[..., None]
