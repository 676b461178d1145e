"""A joint of one translation and one rotation that are coupled: K^J = [[k11, k12], [k12, k22]], as in the paper.

References
----------
Cao, H., Li, B., He, Z. A joint stiffness identification method based on finite element modeling and
frequency response functions, section 3 (K^J with k11, k12, k22 at one translation and one rotation).
"""

import math
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.joint.parametrisation import Parametrisation
from jointbayes.joint.quantities import COORDINATES, COUPLED, Coordinate, Quantity
from vibrecords.arrays import Array, Flags

_ADJUGATE_SIGNS = np.array([1.0, -1.0, 1.0])
_ANY_JOINT = np.array([1.0, -0.5, 1.0])  # compliance and stiffness that stand where there is no joint
_SMALLEST_STIFFNESS = math.exp(-20.0)
_ROUNDING = 1 + 1e-12  # of a coupling that is stated as √(k11 k22)
_LARGEST_COUPLING = 0.9  # of √(k11 k22), in a start


class CoupledPair(Parametrisation):
    """Coordinates θ of (k11, k12, k22).

    A further one is a subclass in a file of its own, which has the name that its coordinates have in
    `jointbayes.joint.quantities.COORDINATES`.
    """

    #: Those that there are, by that name.
    kinds: ClassVar[dict[str, "type[CoupledPair]"]] = {}

    expected: ClassVar[str] = "a positive definite joint; lower |k12|, or raise k11 and k22"
    #: k11, k12 and k22.
    quantities: ClassVar[tuple[Quantity, ...]] = COUPLED
    #: Least coupling of a start, as a share of the largest.
    least_coupling: ClassVar[float] = -1.0

    def __init_subclass__(cls) -> None:
        CoupledPair.kinds[cls.key] = cls

    @property
    def axes(self) -> tuple[Coordinate, ...]:
        """The coordinates, in order."""
        return COORDINATES[self.key]

    def is_positive_semidefinite(self, values: ArrayLike) -> Flags:
        """Whether joints (k11, k12, k22), shape (..., 3), are positive semidefinite, shape (...)."""
        k11, k12, k22 = np.moveaxis(np.asarray(values, dtype=float), -1, 0)
        bound = np.sqrt(np.maximum(k11, 0.0)) * np.sqrt(np.maximum(k22, 0.0)) * _ROUNDING
        return np.asarray((k11 >= 0) & (k22 >= 0) & (np.abs(k12) <= bound))

    def _semidefinite(self, values: Array) -> tuple[str, str]:
        k11, _, k22 = values.tolist()
        return (
            f"a positive semidefinite matrix (k11 >= 0, k22 >= 0, k12² <= k11·k22 = {k11 * k22:g})",
            f"lower |k12| to {math.sqrt(max(k11, 0)) * math.sqrt(max(k22, 0)):.6g} N or less, or raise k11 or k22",
        )

    def uncoupled(self, values: ArrayLike) -> Array:
        """The same joints, shape (..., 3), with k12 = 0."""
        return np.asarray(values, dtype=float) * np.array([1.0, 0.0, 1.0])

    def nearest(self, values: ArrayLike) -> Array:
        """A joint near (k11, k12, k22), shape (3,), that has coordinates, well inside the positive definite ones."""
        k11, k12, k22 = np.asarray(values, dtype=float)
        k11, k22 = max(k11, _SMALLEST_STIFFNESS), max(k22, _SMALLEST_STIFFNESS)
        limit = _LARGEST_COUPLING * np.sqrt(k11 * k22)
        return np.array([k11, np.clip(k12, self.least_coupling * limit, limit), k22])

    def compliance(self, theta: Array) -> Array:
        """Compliance φ = (c11, c12, c22), C = (K^J)⁻¹, shape (n, d), of θ, shape (n, d)."""
        return _inverse_2x2(self.values(theta))

    def coordinates_of_compliance(self, phi: Array) -> tuple[Array, Flags]:
        """θ, shape (n, d), of φ, shape (n, d), and whether φ is a joint that θ can describe, shape (n,)."""
        c11, c12, c22 = phi.T
        inside = (c11 > 0) & (c22 > 0) & (c11 * c22 > c12 * c12)
        values = _inverse_2x2(phi if inside.all() else np.where(inside[:, None], phi, _ANY_JOINT))
        inside &= self.describes(values)
        if not inside.all():
            values = np.where(inside[:, None], values, _inverse_2x2(_ANY_JOINT))
        return self.coordinates(values), inside

    def log_compliance_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,): |∂C/∂K| of a symmetric 2 × 2 matrix is (det K)⁻³."""
        return 3 * self.log_determinant(theta) - self.log_slope(theta)


def _inverse_2x2(matrix: Array) -> Array:
    """(m11, m12, m22) of the inverse, shape (..., 3)."""
    m12 = matrix[..., 1]
    determinant = matrix[..., 0] * matrix[..., 2] - m12 * m12
    return matrix[..., ::-1] * _ADJUGATE_SIGNS / determinant[..., None]
