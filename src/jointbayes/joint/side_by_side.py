"""Parametrisations side by side: their coordinates and quantities one after the other."""

from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.joint.parametrisation import CondensedCoordinates, Cone, Parametrisation
from vibrecords.arrays import Array, Flags

Part = tuple[Parametrisation, slice, slice]
"""A parametrisation with its columns of θ and of the quantities."""


class SideBySide(Parametrisation):
    """Product of parametrisations: θ and quantities of each one after the other."""

    @property
    @abstractmethod
    def product_of(self) -> Sequence[Parametrisation]:
        """The parametrisations, in order."""

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """Each of them with its columns of θ and of the quantities."""
        parts, t, k = list[Part](), 0, 0
        for one in self.product_of:
            parts.append((one, slice(t, t + len(one.axes)), slice(k, k + len(one.quantities))))
            t, k = t + len(one.axes), k + len(one.quantities)
        return tuple(parts)

    @cached_property
    def cones(self) -> tuple[Cone, ...]:
        """Those of all."""
        return tuple(cone.moved(t.start) for one, t, _ in self.parts for cone in one.cones)

    @cached_property
    def ridges(self) -> tuple[CondensedCoordinates, ...]:
        """Those of all."""
        return tuple(CondensedCoordinates(r.cone.moved(t.start)) for one, t, _ in self.parts for r in one.ridges)

    def _of_theta(self, ask: str, theta: ArrayLike) -> list[Array]:
        """What a method gives of each and its part of θ, shape (..., d)."""
        array = np.asarray(theta, dtype=float)
        return [np.asarray(getattr(one, ask)(array[..., t])) for one, t, _ in self.parts]

    def _of_values(self, ask: str, values: ArrayLike) -> list[Array]:
        """What a method gives of each and its part of the quantities, shape (..., q)."""
        array = np.asarray(values, dtype=float)
        return [np.asarray(getattr(one, ask)(array[..., k])) for one, _, k in self.parts]

    @staticmethod
    def _joined(parts: Sequence[Array], numbers: ArrayLike) -> Array:
        none = np.asarray(numbers, dtype=float)[..., :0]  # gives the shape where there are no parts
        return np.concatenate([none, *parts], axis=-1)

    def values(self, theta: ArrayLike) -> Array:
        """Quantities, shape (..., q), from θ, shape (..., d)."""
        return self._joined(self._of_theta("values", theta), theta)

    def describes(self, values: ArrayLike) -> Flags:
        """Whether all have coordinates."""
        return np.logical_and.reduce(self._of_values("describes", values))

    def _coordinates(self, values: Array) -> Array:
        return self._joined(self._of_values("_coordinates", values), values)

    def derivative(self, theta: ArrayLike) -> Array:
        """∂k/∂θ, shape (..., q, d), block by block."""
        t = np.asarray(theta, dtype=float)
        slope = np.zeros((*t.shape[:-1], len(self.quantities), t.shape[-1]))
        for one, columns, rows in self.parts:
            slope[..., rows, columns] = one.derivative(t[..., columns])
        return slope

    def log_slope(self, theta: Array) -> Array:
        """ln |∂k/∂θ|, shape (...): the sum of all."""
        return np.sum(self._of_theta("log_slope", theta), axis=0)

    def log_determinant(self, theta: Array) -> Array:
        """ln det of the blocks, shape (...): the sum of all."""
        return np.sum(self._of_theta("log_determinant", theta), axis=0)

    def nearest(self, values: ArrayLike) -> Array:
        """The nearest joint of each, shape (q,)."""
        return self._joined(self._of_values("nearest", values), values)

    def is_positive_semidefinite(self, values: ArrayLike) -> Flags:
        """Whether every joint is, shape (...)."""
        return np.logical_and.reduce(self._of_values("is_positive_semidefinite", values))

    def uncoupled(self, values: ArrayLike) -> Array:
        """The same joints, shape (..., q), each without coupling."""
        return self._joined(self._of_values("uncoupled", values), values)

    def middle(self, mean: Array) -> Array:
        """The joints, shape (q,), at the means of the priors of their coordinates, shape (d,)."""
        return self._joined(self._of_theta("middle", mean), mean)

    def compliance(self, theta: Array) -> Array:
        """φ of each joint, shape (n, d), of θ, shape (n, d)."""
        return self._joined(self._of_theta("compliance", theta), theta)

    def coordinates_of_compliance(self, phi: Array) -> tuple[Array, Flags]:
        """θ, shape (n, d), of φ, shape (n, d), and whether φ is a joint each, shape (n,)."""
        each = [one.coordinates_of_compliance(phi[:, t]) for one, t, _ in self.parts]
        return self._joined([theta for theta, _ in each], phi), np.logical_and.reduce([inside for _, inside in each])

    def log_compliance_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,): the sum of all."""
        return np.sum(self._of_theta("log_compliance_volume", theta), axis=0)
