"""Damping of a joint in addition to its stiffnesses: dashpots and loss factors."""

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import ModelError
from jointbayes.joint.parametrisation import Parametrisation
from jointbayes.joint.plain_springs import PlainSprings
from jointbayes.joint.quantities import Coordinate, Quantity, damping_quantities
from jointbayes.joint.side_by_side import SideBySide
from vibrecords.arrays import Array, Flags, convert_fields


@dataclass(frozen=True)
class Damped(SideBySide):
    """Coordinates of a joint, then ln c of its dashpots and ln η of its loss factors.

    The joint's dynamic stiffness is K + jωC + jH: C of the dashpots, H of the stiffnesses times their loss factors.

    Parameters
    ----------
    of
        Parametrisation of the stiffnesses.
    viscous
        Springs that have a dashpot in parallel, by name: k11 has c11, ky has cy.
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
    def product_of(self) -> tuple[Parametrisation, Parametrisation]:
        """Stiffnesses and damping."""
        damping = damping_quantities(self.of.quantities, self.viscous, self.loss_factors)
        return self.of, _Damping(tuple(quantity.name for quantity in damping), damping)

    @cached_property
    def axes(self) -> tuple[Coordinate, ...]:
        """The coordinates of the stiffnesses, then the logarithms of the damping."""
        return tuple(axis for one in self.product_of for axis in one.axes)

    @cached_property
    def quantities(self) -> tuple[Quantity, ...]:
        """The stiffnesses, then the damping."""
        return tuple(quantity for one in self.product_of for quantity in one.quantities)

    @property
    def held(self) -> tuple[int, ...]:
        """Rows of K^J that are rigid and no quantity."""
        return self.of.held

    def _semidefinite(self, values: Array) -> tuple[str, str]:
        at_fault = (
            one._semidefinite(values[k]) for one, _, k in self.parts if not one.is_positive_semidefinite(values[k])
        )
        return next(at_fault)


class _Damping(PlainSprings):
    """Dashpots and loss factors by their logarithms, as springs that add nothing to K^J.

    An FRF is nearly linear in a loss factor, as it is in the compliance: where data leave one wide, its draws are near
    Gaussian, those of its logarithm have a long tail. So the damping itself stands next to the compliance.
    """

    def log_determinant(self, theta: Array) -> Array:
        """0: ln det K^J depends on the stiffnesses alone."""
        return np.zeros(theta.shape[:-1])

    def nearest(self, values: ArrayLike) -> Array:
        """The same, shape (q,), above zero."""
        return np.maximum(np.asarray(values, dtype=float), np.finfo(float).tiny)

    def _semidefinite(self, values: Array) -> tuple[str, str]:
        return "damping of 0 or more", "correct what is below 0"

    def compliance(self, theta: Array) -> Array:
        """φ, the damping itself, shape (n, d)."""
        return np.exp(theta)

    def coordinates_of_compliance(self, phi: Array) -> tuple[Array, Flags]:
        """θ, shape (n, d), of φ, shape (n, d), and whether φ is above zero, shape (n,)."""
        return np.log(np.maximum(phi, np.finfo(float).tiny)), np.asarray((phi > 0).all(axis=1))

    def log_compliance_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,): 1/φ of each."""
        return -theta.sum(axis=-1)
