"""Coordinates θ that joints are inferred in, and everything that is asked about them.

A `Parametrisation` is one file of this room: its quantities and where they stand in K^J, its coordinates with names,
labels, units and bounds, and where joints are positive definite. No code outside this room asks which one it is, or
whether it is of one joint or of several, see `jointbayes.joint.blocks`.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import ModelError
from jointbayes.joint.matrix import AnyJointMatrix, JointMatrix, joint_matrix_of
from jointbayes.joint.quantities import Coordinate, Quantity
from vibrecords.arrays import Array, Flags, Indices
from vibrecords.errors import array_of


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

    def inverse(self, phi: Array) -> tuple[Array, Flags]:
        """θ, shape (n, d), and True for each, shape (n,): any φ is a joint."""
        theta = np.array(phi, dtype=np.float64)
        first, coupling, last = (phi[:, column] for column in (self.cone.first, self.cone.coupling, self.cone.last))
        theta[:, self.column] = np.logaddexp(last, 2 * coupling - first)
        return theta, np.ones(len(phi), dtype=bool)

    def log_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,)."""
        return self.forward(theta)[:, self.column] - theta[:, self.column]


#: Stiffness (N/m, N·m/rad) of a motion that is held: every forward model takes it for rigid to rounding, and its square
#: is still a number.
RIGID = 1e30
_MOST = 1e150  # of a stiffness: its square stays finite
LOWER_COUPLINGS = "lower its couplings, or raise the stiffnesses next to them"  # of a joint that gives off energy
_ABSENT, _HELD = -1, -2  # entries of K^J that are no quantity


class Parametrisation(ABC):
    """Coordinates θ of the stiffnesses of one joint or several.

    A further kind is a subclass that states what is abstract here, in a file of its own.
    """

    #: Its name in case files.
    key: ClassVar[str]
    #: What is expected of a joint that it can describe, and what to do.
    expected: ClassVar[str] = "a positive definite joint; lower its couplings, or raise the stiffnesses beside them"

    @property
    @abstractmethod
    def axes(self) -> tuple[Coordinate, ...]:
        """The d coordinates, in order."""

    @property
    @abstractmethod
    def quantities(self) -> tuple[Quantity, ...]:
        """The q quantities, in the order of `values`."""

    @property
    def held(self) -> tuple[int, ...]:
        """Rows of K^J that are rigid and no quantity."""
        return ()

    @cached_property
    def size(self) -> int:
        """Number R of rows of K^J: the DOFs of all joints side by side."""
        rows = [place[1] for quantity in self.quantities for place in quantity.places]
        return 1 + max((*rows, *self.held), default=-1)

    @property
    def cones(self) -> tuple[Cone, ...]:
        """Where joints are positive definite, unless the bounds of each coordinate say so."""
        return ()

    @property
    def ridges(self) -> tuple[CondensedCoordinates, ...]:
        """Coordinates in which joints with hardly known stiffnesses lie on straight ridges; none where they do in θ."""
        return ()

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return tuple(axis.name for axis in self.axes)

    @cached_property
    def stiffness_names(self) -> tuple[str, ...]:
        """Names of the quantities."""
        return tuple(quantity.name for quantity in self.quantities)

    @property
    def derived(self) -> tuple[str, ...]:
        """Names of the stiffnesses that θ moves but that are no coordinates."""
        return tuple(axis.quantity for axis in self.axes if axis.quantity != axis.name)

    def standing_for(self, quantity: str) -> str:
        """Name of the coordinate that is a stiffness, or that stands for it."""
        return next(axis.name for axis in self.axes if axis.quantity == quantity)

    @property
    def exchanges(self) -> Indices:
        """Columns of θ after each exchange of joints with the same quantities, shape (n, d), the first as they are."""
        return np.arange(len(self.axes))[None]

    @cached_property
    def pattern(self) -> Array:
        """∂K^J/∂k of each quantity, the paper's K_i, shape (q, R, R)."""
        pattern = np.zeros((len(self.quantities), self.size, self.size))
        for matrix, quantity in zip(pattern, self.quantities, strict=True):
            for i, j in quantity.places:
                matrix[i, j] = matrix[j, i] = 1.0
        pattern.setflags(write=False)
        return pattern

    @cached_property
    def damped(self) -> bool:
        """Whether some of the quantities are damping."""
        return any(quantity.role != "stiffness" for quantity in self.quantities)

    @cached_property
    def _entries(self) -> tuple[Indices, ...]:
        """Numbers of the quantities that entries are, each (R, R), of K^J, and of dashpots and loss factors if any."""
        roles = ("stiffness", "viscous", "loss factor") if self.damped else ("stiffness",)
        of_role = {role: np.full((self.size, self.size), _ABSENT) for role in roles}
        for number, (quantity, places) in enumerate(zip(self.quantities, self.pattern, strict=True)):
            of_role[quantity.role][places != 0] = number
        of_role["stiffness"][self.held, self.held] = _HELD
        return tuple(of_role.values())

    @property
    def rigid(self) -> Array:
        """Quantities, shape (q,), of joints that are rigid."""
        springs = (quantity.role == "stiffness" and not quantity.may_be_negative for quantity in self.quantities)
        return np.array([RIGID if spring else 0.0 for spring in springs])

    def matrix(self, values: ArrayLike) -> JointMatrix:
        """Joint matrices, shape (..., R, R), of quantities, shape (..., q).

        Examples
        --------
        >>> from jointbayes.joint import LogStiffness
        >>> LogStiffness().matrix([3.0, 1.0, 2.0]).stiffness.tolist()
        [[3.0, 1.0], [1.0, 2.0]]
        """
        k = np.asarray(values, dtype=float)
        if any((entries < 0).any() for entries in self._entries):
            beyond = np.broadcast_to([RIGID, 0.0], (*k.shape[:-1], 2))
            k = np.concatenate([k, beyond], axis=-1)
        parts = [np.take(k, entries, axis=-1) for entries in self._entries]
        if len(parts) == 1:
            return JointMatrix(parts[0])
        stiffness, viscous, loss = parts
        return JointMatrix(stiffness, viscous, loss * stiffness)

    def changes(self, theta: Array) -> JointMatrix:
        """Change of `matrix` along each coordinate, shape (d, R, R), at one θ, shape (d,)."""
        derivative = self.derivative(theta)
        if not self.damped:
            return JointMatrix(np.einsum("kt,kij->tij", derivative, self.pattern))
        parts = []
        for role in ("stiffness", "viscous", "loss factor"):
            of_role = np.array([quantity.role == role for quantity in self.quantities])
            parts.append(np.einsum("kt,kij->tij", derivative[of_role], self.pattern[of_role]))
        k, loss = self.values(theta), self._entries[2]
        factor = np.where(loss < 0, 0.0, k[np.maximum(loss, 0)])
        parts[2] = parts[2] * self.matrix(k).stiffness + factor * parts[0]
        return JointMatrix(*parts)

    def values_of_matrix(self, matrix: AnyJointMatrix) -> Array:
        """Quantities, shape (..., q), of joint matrices, see `matrix`: at their first places."""
        joints = joint_matrix_of(matrix)
        whole = np.concatenate(joints.sides, axis=-1) if self.damped else joints.stiffness
        rows, columns = np.array([q.places[0] for q in self.quantities], dtype=int).reshape(-1, 2).T
        side = {"stiffness": 0, "viscous": self.size, "loss factor": 2 * self.size}
        entries = whole[..., rows, columns + np.array([side[q.role] for q in self.quantities], dtype=int)]
        loss = [i for i, q in enumerate(self.quantities) if q.role == "loss factor"]
        entries[..., loss] /= whole[..., rows[loss], columns[loss]]
        return entries

    @abstractmethod
    def values(self, theta: ArrayLike) -> Array:
        """Quantities, shape (..., q), from θ, shape (..., d)."""

    @abstractmethod
    def describes(self, values: ArrayLike) -> Flags:
        """Whether quantities, shape (..., q), have coordinates, shape (...)."""

    @abstractmethod
    def _coordinates(self, values: Array) -> Array:
        """θ, shape (..., d), of quantities that have coordinates, shape (..., q)."""

    @abstractmethod
    def derivative(self, theta: ArrayLike) -> Array:
        """∂k/∂θ, shape (..., q, d): quantity down, coordinate across."""

    @abstractmethod
    def log_slope(self, theta: Array) -> Array:
        """ln |∂k/∂θ|, shape (...), of the stiffnesses k that θ moves, at θ, shape (..., d)."""

    @abstractmethod
    def log_determinant(self, theta: Array) -> Array:
        """ln det K^J, shape (...), at feasible θ, shape (..., d).

        Without motions that are held rigid; of joints that share their quantities only one counts.
        """

    @abstractmethod
    def nearest(self, values: ArrayLike) -> Array:
        """A joint near one of shape (q,) that has coordinates, well inside the positive definite ones."""

    @abstractmethod
    def is_positive_semidefinite(self, values: ArrayLike) -> Flags:
        """Whether joints, shape (..., q), are positive semidefinite, shape (...)."""

    @abstractmethod
    def uncoupled(self, values: ArrayLike) -> Array:
        """The same joints, shape (..., q), without what couples their motions."""

    @abstractmethod
    def compliance(self, theta: Array) -> Array:
        """Compliance φ, entries of C = (K^J)⁻¹, shape (n, d), of θ, shape (n, d)."""

    @abstractmethod
    def coordinates_of_compliance(self, phi: Array) -> tuple[Array, Flags]:
        """θ, shape (n, d), of φ, shape (n, d), and whether φ is a joint that θ can describe, shape (n,)."""

    @abstractmethod
    def log_compliance_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,), at θ, shape (n, d)."""

    def coordinates(self, values: ArrayLike) -> Array:
        """θ, shape (..., d), of quantities, shape (..., q).

        Raises
        ------
        ModelError
            If a joint has no such coordinates.
        """
        k = np.asarray(values, dtype=float)
        with np.errstate(all="ignore"):
            theta = self._coordinates(k) if self.describes(k).all() else None
        if theta is None or not np.isfinite(theta).all():
            raise ModelError(f"joint in {self.key} coordinates: found stiffness {k.tolist()}; expected {self.expected}")
        return theta

    def feasible(self, theta: ArrayLike) -> Flags:
        """Whether K^J is positive definite, shape (...); θ has shape (..., d)."""
        t = np.asarray(theta, dtype=float)
        inside = np.ones(t.shape[:-1], dtype=np.bool_)
        for cone in self.cones:
            first, coupling, last = t[..., cone.first], t[..., cone.coupling], t[..., cone.last]
            inside = inside & (2 * coupling < first + last)
        for i, axis in enumerate(self.axes):
            if axis.bounded:
                inside = inside & (t[..., i] > axis.bounds[0]) & (t[..., i] < axis.bounds[1])
        return np.asarray(inside)

    def middle(self, mean: Array) -> Array:
        """The joint, shape (q,), at the means of the priors of its coordinates, shape (d,).

        Independent priors may have their middle where no joint is: one without coupling is possible.
        """
        middle = self.values(mean)
        return middle if self.is_positive_semidefinite(middle) else self.uncoupled(middle)

    def check(self, values: ArrayLike) -> None:
        """Refuse a joint that could give off energy.

        Parameters
        ----------
        values
            Quantities, shape (q,).

        Raises
        ------
        ModelError
            If there are not as many, a number is not finite, or K^J is not positive semidefinite.
        """
        k = array_of(values, float, "joint", ModelError)
        names, count = ", ".join(self.stiffness_names) or "no stiffness", len(self.quantities)
        if k.shape != (count,):
            raise ModelError.of("joint", (), f"found stiffnesses of shape {k.shape}", f"{names}: shape ({count},)")
        if not (np.abs(k) < _MOST).all():
            listed = ", ".join(
                f"{name} = {value:g}" for name, value in zip(self.stiffness_names, k.tolist(), strict=True)
            )
            raise ModelError.of("joint", (), f"found {listed}", "finite numbers")
        if not self.is_positive_semidefinite(k):
            pairs = zip(self.quantities, k.tolist(), strict=True)
            listed = ", ".join(f"{quantity.name} = {value:g} {quantity.unit}" for quantity, value in pairs)
            coupling = next((quantity.name for quantity in self.quantities if quantity.may_be_negative), "")
            raise ModelError.of("joint", (coupling,), f"found {listed}", *self._semidefinite(k))

    def _semidefinite(self, values: Array) -> tuple[str, str]:
        """What is expected of a joint, shape (q,), that is not positive semidefinite, and what to do."""
        return "a positive semidefinite matrix", LOWER_COUPLINGS


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

    def inverse(self, phi: Array) -> tuple[Array, Flags]:
        """θ, shape (n, d), and whether φ is a joint that θ can describe, shape (n,)."""
        return self.parametrisation.coordinates_of_compliance(phi)

    def log_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,)."""
        return self.parametrisation.log_compliance_volume(theta)
