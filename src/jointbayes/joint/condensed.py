"""Where three logarithms describe a joint, and the condensed stiffness in place of the last of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array


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

    def moved(self, columns: int) -> "Cone":
        """The same cone so many columns further."""
        return Cone(self.first + columns, self.coupling + columns, self.last + columns)


@dataclass(frozen=True, slots=True)
class CondensedCoordinates:
    """ln(k22 − k12²/k11) in place of ln k22, for θ with ln k11, ln k12 and ln k22 in it; the rest stays as it is.

    That is the rotational stiffness with the translation free to follow, 1/c22, which vibration tells best. Where k11
    and k12 are hardly known, k22 must follow them along a curved sheet that is flat in these coordinates.

    Parameters
    ----------
    cone
        Columns of ln k11, ln k12 and ln k22, of which the last is replaced.
    """

    cone: Cone

    @property
    def column(self) -> int:
        """Where the coordinate stands that is replaced."""
        return self.cone.last

    def forward(self, theta: Array) -> Array:
        """φ, shape (n, d), of θ, shape (n, d)."""
        phi = np.array(theta, dtype=np.float64)
        first, coupling, last = (phi[:, column] for column in (self.cone.first, self.cone.coupling, self.cone.last))
        share = np.minimum(np.exp(2 * coupling - first - last), 1 - np.finfo(float).eps)
        phi[:, self.column] += np.log1p(-share)
        return phi

    def inverse(self, phi: Array) -> tuple[Array, NDArray[np.bool_]]:
        """θ, shape (n, d), and True for each, shape (n,): any φ is a joint."""
        theta = np.array(phi, dtype=np.float64)
        first, coupling, last = (phi[:, column] for column in (self.cone.first, self.cone.coupling, self.cone.last))
        theta[:, self.column] = np.logaddexp(last, 2 * coupling - first)
        return theta, np.ones(len(phi), dtype=bool)

    def log_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,)."""
        return self.forward(theta)[:, self.column] - theta[:, self.column]
