"""Damping beside the stiffnesses of a joint: dashpots and loss factors."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import ModelError
from jointbayes.joint.parametrisation import CondensedCoordinates, Cone, Parametrisation
from jointbayes.joint.quantities import Coordinate, Quantity, damping_quantities
from vibrecords.arrays import Array, Flags, convert_fields


@dataclass(frozen=True)
class Damped(Parametrisation):
    """Coordinates of a joint, then ln c of its dashpots and ln η of its loss factors.

    The joint's dynamic stiffness is K + jωC + jH: C of the dashpots, H of the stiffnesses times their loss factors.

    Parameters
    ----------
    of
        Parametrisation of the stiffnesses.
    viscous
        Springs that have a dashpot beside them, by name: k11 has c11, ky has cy.
    loss_factors
        Springs that have a loss factor, by name: k11 has eta11, ky has etay; ``"all"`` is one factor eta on the whole
        matrix, couplings included.

    Raises
    ------
    ModelError
        If a name is no spring of the joint or occurs twice, ``"all"`` stands beside others, or nothing is damped.
    """

    of: Parametrisation
    viscous: tuple[str, ...] = ()
    loss_factors: tuple[str, ...] = ()

    key: ClassVar[str] = "damped"

    def __post_init__(self) -> None:
        convert_fields(self, tuple, "viscous", "loss_factors")
        springs = [quantity.name for quantity in self.of.quantities if not quantity.may_be_negative]
        for what, names, allowed in (
            ("viscous", self.viscous, springs),
            ("loss_factors", self.loss_factors, [*springs, "all"]),
        ):
            alone = "all" not in names or len(names) == 1
            if len(set(names)) != len(names) or not set(names) <= set(allowed) or not alone:
                expected = f"each once of {', '.join(allowed) or 'none'}, all by itself"
                found = f"found {what} {', '.join(names)}"
                raise ModelError.of("damped joint", (what,), found, expected, "correct the names")
        if not (self.viscous or self.loss_factors):
            raise ModelError.of("damped joint", (), "found no damping", "a dashpot or a loss factor", "name a spring")

    @cached_property
    def _damping(self) -> tuple[Quantity, ...]:
        return damping_quantities(self.of.quantities, self.viscous, self.loss_factors)

    @cached_property
    def axes(self) -> tuple[Coordinate, ...]:
        """The coordinates of the stiffnesses, then the logarithms of the damping."""
        return (*self.of.axes, *map(Coordinate.logarithm_of, self._damping))

    @cached_property
    def quantities(self) -> tuple[Quantity, ...]:
        """The stiffnesses, then the damping."""
        return (*self.of.quantities, *self._damping)

    @property
    def held(self) -> tuple[int, ...]:
        """Rows of K^J that are rigid and no quantity."""
        return self.of.held

    @property
    def cones(self) -> tuple[Cone, ...]:
        """Those of the stiffnesses."""
        return self.of.cones

    @property
    def ridges(self) -> tuple[CondensedCoordinates, ...]:
        """Those of the stiffnesses."""
        return self.of.ridges

    @property
    def rigid(self) -> Array:
        """Quantities, shape (q,), of a joint that is rigid, without damping."""
        return np.concatenate([self.of.rigid, np.zeros(len(self._damping))])

    @cached_property
    def _d(self) -> int:
        return len(self.of.axes)

    @cached_property
    def _q(self) -> int:
        return len(self.of.quantities)

    def values(self, theta: ArrayLike) -> Array:
        """Quantities, shape (..., q), from θ, shape (..., d)."""
        t = np.asarray(theta, dtype=float)
        return np.concatenate([self.of.values(t[..., : self._d]), np.exp(t[..., self._d :])], axis=-1)

    def describes(self, values: ArrayLike) -> Flags:
        """Whether the stiffnesses have coordinates and all damping is above zero."""
        k = np.asarray(values, dtype=float)
        return np.asarray(self.of.describes(k[..., : self._q]) & (k[..., self._q :] > 0).all(axis=-1))

    def _coordinates(self, values: Array) -> Array:
        springs = self.of._coordinates(values[..., : self._q])
        return np.concatenate([springs, np.log(values[..., self._q :])], axis=-1)

    def derivative(self, theta: ArrayLike) -> Array:
        """∂k/∂θ, shape (..., q, d): quantity down, coordinate across."""
        t = np.asarray(theta, dtype=float)
        slope = np.zeros((*t.shape[:-1], len(self.quantities), t.shape[-1]))
        slope[..., : self._q, : self._d] = self.of.derivative(t[..., : self._d])
        damping = np.arange(len(self._damping))
        slope[..., self._q + damping, self._d + damping] = np.exp(t[..., self._d :])
        return slope

    def log_slope(self, theta: Array) -> Array:
        """ln |∂k/∂θ|, shape (...)."""
        return self.of.log_slope(theta[..., : self._d]) + theta[..., self._d :].sum(axis=-1)

    def log_determinant(self, theta: Array) -> Array:
        """ln det K^J, shape (...)."""
        return self.of.log_determinant(theta[..., : self._d])

    def nearest(self, values: ArrayLike) -> Array:
        """A joint near one of shape (q,) that has coordinates; damping above zero."""
        k = np.asarray(values, dtype=float)
        return np.concatenate([self.of.nearest(k[: self._q]), np.maximum(k[self._q :], np.finfo(float).tiny)])

    def is_positive_semidefinite(self, values: ArrayLike) -> Flags:
        """Whether joints, shape (..., q), store and lose energy but give off none, shape (...)."""
        k = np.asarray(values, dtype=float)
        return np.asarray(self.of.is_positive_semidefinite(k[..., : self._q]) & (k[..., self._q :] >= 0).all(axis=-1))

    def _semidefinite(self, values: Array) -> str:
        if self.of.is_positive_semidefinite(values[: self._q]):
            return "damping of 0 or more; correct what is below 0"
        return self.of._semidefinite(values[: self._q])

    def uncoupled(self, values: ArrayLike) -> Array:
        """The same joints, shape (..., q), without what couples their motions."""
        k = np.asarray(values, dtype=float)
        return np.concatenate([self.of.uncoupled(k[..., : self._q]), k[..., self._q :]], axis=-1)

    def compliance(self, theta: Array) -> Array:
        """Compliance of the stiffnesses, then the damping itself, shape (n, d).

        An FRF is nearly linear in a loss factor, as it is in the compliance: where data leave one wide, its draws are
        near Gaussian, those of its logarithm have a long tail.
        """
        return np.concatenate([self.of.compliance(theta[..., : self._d]), np.exp(theta[..., self._d :])], axis=-1)

    def coordinates_of_compliance(self, phi: Array) -> tuple[Array, Flags]:
        """θ, shape (n, d), of φ, shape (n, d), and whether φ is a joint that θ can describe, shape (n,)."""
        theta, inside = self.of.coordinates_of_compliance(phi[:, : self._d])
        damping = phi[:, self._d :]
        logarithm = np.log(np.maximum(damping, np.finfo(float).tiny))
        return np.concatenate([theta, logarithm], axis=-1), inside & (damping > 0).all(axis=1)

    def log_compliance_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,): that of the stiffnesses, and 1/η of each damping η."""
        return self.of.log_compliance_volume(theta[..., : self._d]) - theta[..., self._d :].sum(axis=-1)
