"""Joints without coupling: springs of their own in chosen directions, and rigid ones.

They are kinds of joint, and the simpler hypotheses that a joint with coupling is compared with: a rigid joint, one that
yields in translation only, in rotation only, and springs without coupling.
"""

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import ModelError, require
from jointbayes.joint.parametrisation import Parametrisation
from jointbayes.joint.quantities import COUPLED, Coordinate, Quantity
from vibrecords.arrays import Array, Flags

_SPRINGS = tuple(quantity.name for quantity in COUPLED if not quantity.may_be_negative)
_SMALLEST_STIFFNESS = float(np.exp(-20.0))


@dataclass(frozen=True)
class PlainSprings(Parametrisation):
    """Coordinates θ = ln k of the springs that are named; a spring that is not is rigid, and couplings are 0.

    Parameters
    ----------
    names
        Springs that yield, in order: ``()``, ``("k11",)``, ``("k22",)`` or ``("k11", "k22")`` of the paper's joint.
        Without any the joint is rigid and has no coordinate.
    of
        The stiffnesses of the joint; by default those of the paper's, whose springs are k11 and k22.
    absent
        Whether springs that are not named are absent, not rigid.

    Raises
    ------
    ModelError
        If a name is no spring, occurs twice or is out of order.

    Examples
    --------
    >>> PlainSprings(("k22",)).values(np.log([2e5])).round().tolist()
    [1e+30, 0.0, 200000.0]
    """

    names: tuple[str, ...] = _SPRINGS
    of: tuple[Quantity, ...] = COUPLED
    absent: bool = False

    key: ClassVar[str] = "plain springs"
    expected: ClassVar[str] = "every spring that yields above zero; raise it"

    def __post_init__(self) -> None:
        springs = tuple(quantity.name for quantity in self.of if not quantity.may_be_negative)
        if self.names != tuple(name for name in springs if name in self.names):
            expected = f"none, one or more of {', '.join(springs)}, in this order"
            raise ModelError.of("plain springs", (), f"found names {self.names}", expected, "correct them")

    @property
    def axes(self) -> tuple[Coordinate, ...]:
        """ln k of each spring."""
        return tuple(Coordinate.logarithm_of(q) for q in self.of if q.name in self.names)

    @property
    def quantities(self) -> tuple[Quantity, ...]:
        """All stiffnesses, also those of rigid motions and couplings."""
        return self.of

    @property
    def _places(self) -> list[int]:
        return [i for i, q in enumerate(self.of) if q.name in self.names]

    def values(self, theta: ArrayLike) -> Array:
        """Stiffnesses, shape (..., q), from θ, shape (..., d)."""
        t = np.asarray(theta, dtype=float)
        values = np.empty((*t.shape[:-1], len(self.of)))
        values[...] = 0.0 if self.absent else self.rigid
        values[..., self._places] = np.exp(t)
        return values

    def describes(self, values: ArrayLike) -> Flags:
        """Whether the springs that yield are above zero; the rest does not count."""
        return np.asarray((np.asarray(values, dtype=float)[..., self._places] > 0).all(axis=-1))

    def _coordinates(self, values: Array) -> Array:
        return np.log(values[..., self._places])

    def derivative(self, theta: ArrayLike) -> Array:
        """∂k/∂θ, shape (..., q, d): stiffness down, coordinate across."""
        t = np.asarray(theta, dtype=float)
        slope = np.zeros((*t.shape[:-1], len(self.of), len(self.names)))
        for coordinate, place in enumerate(self._places):
            slope[..., place, coordinate] = np.exp(t[..., coordinate])
        return slope

    def log_slope(self, theta: Array) -> Array:
        """ln |∂k/∂θ| of the named springs k, shape (...), at θ, shape (..., d)."""
        return theta.sum(axis=-1)

    def log_determinant(self, theta: Array) -> Array:
        """ln of the product of the named springs, shape (...), at θ, shape (..., d): det K^J without rigid motions."""
        return self.log_slope(theta)

    def nearest(self, values: ArrayLike) -> Array:
        """The same joint, shape (q,), with springs above zero."""
        k = np.array(values, dtype=float)
        k[self._places] = np.maximum(k[self._places], _SMALLEST_STIFFNESS)
        return k

    def is_positive_semidefinite(self, values: ArrayLike) -> Flags:
        """Whether no spring is below zero and nothing is coupled, shape (...)."""
        k = np.asarray(values, dtype=float)
        coupling = np.array([quantity.may_be_negative for quantity in self.of], dtype=bool)
        return np.asarray((k[..., ~coupling] >= 0).all(axis=-1) & (k[..., coupling] == 0).all(axis=-1))

    def _semidefinite(self, values: Array) -> tuple[str, str]:
        return "springs of 0 or more without coupling", "correct the stiffness below 0, or choose coupled springs"

    def uncoupled(self, values: ArrayLike) -> Array:
        """The same joints, shape (..., q): nothing is coupled."""
        return np.asarray(values, dtype=float)

    def compliance(self, theta: Array) -> Array:
        """φ = 1/k of each named spring, shape (..., d), of θ, shape (..., d)."""
        return np.exp(-theta)

    def coordinates_of_compliance(self, phi: Array) -> tuple[Array, Flags]:
        """θ, shape (n, d), of φ = 1/k, shape (n, d), and whether φ is positive, shape (n,)."""
        inside = np.asarray((phi > 0).all(axis=-1))
        return -np.log(np.where(inside[:, None], phi, 1.0)), inside

    def log_compliance_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (...), at θ, shape (..., d): each θ = −ln φ gives a factor 1/φ = k."""
        return self.log_slope(theta)


@dataclass(frozen=True)
class Rigid(PlainSprings):
    """A joint that holds its motions rigid: it has neither coordinates nor quantities.

    Parameters
    ----------
    motions
        Number of its DOFs.
    """

    names: tuple[str, ...] = field(default=(), init=False)
    of: tuple[Quantity, ...] = field(default=(), init=False)
    absent: bool = field(default=False, init=False)
    motions: int = 1

    key: ClassVar[str] = "rigid"

    def __post_init__(self) -> None:
        require(self.motions, int, "rigid joint: found", "how many DOFs it holds, a whole number")

    @property
    def held(self) -> tuple[int, ...]:
        """All rows of K^J."""
        return tuple(range(self.motions))
