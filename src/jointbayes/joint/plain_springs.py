"""Joints of fewer coordinates: plain springs, with every other motion of the joint held rigid.

They are the simpler hypotheses that a joint with coupling is compared with: a rigid joint, one that yields in
translation only, in rotation only, and two springs without coupling.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.joint.parametrisation import Parametrisation
from jointbayes.joint.quantities import STIFFNESS_NAMES, STIFFNESSES, Coordinate

__all__ = ["RIGID", "PlainSprings"]

Array = NDArray[np.float64]

#: Stiffness (N/m, N·m/rad) of a motion that is held: every forward model takes it for rigid to rounding, and its square
#: is still a number.
RIGID = 1e30

_SPRINGS = tuple(q.name for q in STIFFNESSES if not q.may_be_negative)


@dataclass(frozen=True)
class PlainSprings(Parametrisation):
    """Coordinates θ = ln k of the springs that are named; a spring that is not is rigid, and k12 = 0.

    Parameters
    ----------
    names
        Springs that yield, in order: ``()``, ``("k11",)``, ``("k22",)`` or ``("k11", "k22")``. Without any the joint is
        rigid and has no coordinate.

    Raises
    ------
    ModelError
        If a name is no spring, occurs twice or is out of order.

    Examples
    --------
    >>> PlainSprings(("k22",)).stiffness(np.log([2e5])).round().tolist()
    [1e+30, 0.0, 200000.0]
    """

    names: tuple[str, ...] = _SPRINGS

    key: ClassVar[str] = "plain springs"
    expected: ClassVar[str] = "every spring that yields above zero; raise it"

    def __post_init__(self) -> None:
        if self.names != tuple(name for name in _SPRINGS if name in self.names):
            raise ModelError(
                f"plain springs: found names {self.names}; expected none, one or both of {', '.join(_SPRINGS)}, in "
                "this order; correct them"
            )

    @property
    def axes(self) -> tuple[Coordinate, ...]:
        """ln k of each spring."""
        return tuple(Coordinate.logarithm_of(q) for q in STIFFNESSES if q.name in self.names)

    @property
    def _places(self) -> list[int]:
        return [STIFFNESS_NAMES.index(name) for name in self.names]

    def stiffness(self, theta: ArrayLike) -> Array:
        """(k11, k12, k22), shape (..., 3), from θ, shape (..., d)."""
        t = np.asarray(theta, dtype=float)
        out = np.empty((*t.shape[:-1], 3))
        out[...] = [RIGID, 0.0, RIGID]
        out[..., self._places] = np.exp(t)
        return out

    def describes(self, stiffness: ArrayLike) -> NDArray[np.bool_]:
        """Whether the springs that yield are above zero; the rest does not count."""
        return np.asarray((np.asarray(stiffness, dtype=float)[..., self._places] > 0).all(axis=-1))

    def _coordinates(self, stiffness: Array) -> Array:
        return np.log(stiffness[..., self._places])

    def derivative(self, theta: ArrayLike) -> Array:
        """∂(k11, k12, k22)/∂θ, shape (..., 3, d): stiffness down, coordinate across."""
        t = np.asarray(theta, dtype=float)
        out = np.zeros((*t.shape[:-1], 3, len(self.names)))
        for coordinate, place in enumerate(self._places):
            out[..., place, coordinate] = np.exp(t[..., coordinate])
        return out

    def log_slope(self, theta: Array) -> Array:
        """ln |∂k/∂θ| of the named springs k, shape (...), at θ, shape (..., d)."""
        return theta.sum(axis=-1)

    def log_determinant(self, theta: Array) -> Array:
        """ln of the product of the named springs, shape (...), at θ, shape (..., d): det K^J without rigid motions."""
        return self.log_slope(theta)

    def compliance(self, theta: Array) -> Array:
        """φ = 1/k of each named spring, shape (..., d), of θ, shape (..., d)."""
        return np.exp(-theta)

    def from_compliance(self, phi: Array) -> tuple[Array, NDArray[np.bool_]]:
        """θ, shape (n, d), of φ = 1/k, shape (n, d), and whether φ is positive, shape (n,)."""
        inside = np.asarray((phi > 0).all(axis=-1))
        return -np.log(np.where(inside[:, None], phi, 1.0)), inside

    def log_compliance_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (...), at θ, shape (..., d): each θ = −ln φ gives a factor 1/φ = k."""
        return self.log_slope(theta)
