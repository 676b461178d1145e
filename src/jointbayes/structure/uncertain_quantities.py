"""A beam as a recipe: everything its matrices are made from, each quantity open to a factor."""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Literal

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.structure.beam import BeamMaterial, beam
from jointbayes.structure.damping import DampingLaw
from jointbayes.structure.high_order import MANY_POINTS
from jointbayes.structure.matrices import Structure
from jointbayes.structure.mesh import BeamMesh, BeamShape, mesh_through, meshed_beam
from jointbayes.structure.section import Section

#: ``"converged"``: elements of high order, so many that no mesh shows.  ``"paper"``: the paper's two-node element.
ElementKind = Literal["converged", "paper"]

_LEAST, _MOST, _MOST_SPANS = 1e-6, 1e6, 10_000  # of a length in m, a mass in kg, a coefficient; and equal spans
_DOF = re.compile(r"([1-9]\d{0,6}(?:\.\d+)?):(?:x|y|z|rx|ry|rz)")
_HALF_WAVES = 10.0  # along the beam: what a mesh without a stated frequency is made for
_RICHER, _RICHER_OF_MANY = 4, 1  # polynomial orders that a reference has more; between many points one says enough

#: Quantities of a beam that may be uncertain, beside ``damping_ratio_1``, ``mode_frequency_1`` and so on.
STRUCTURE_QUANTITIES = (
    "youngs_modulus",
    "density",
    "length",
    "length_offset",
    "section_size",
    "shear_coefficient",
    "accelerometer_mass",
    "damping_ratio",
    "loss_factor",
)


def is_additive(name: str) -> bool:
    """Whether a quantity is no factor but a length that is added: an offset in m, whose factor is e to that power.

    So the offset's own value is the coordinate, and may be of either sign.
    """
    return name.rpartition(".")[2] == "length_offset"


def is_damping_ratio(name: str) -> bool:
    """Whether a quantity is the damping ratio of all modes, or of one."""
    return name == "damping_ratio" or name.startswith("damping_ratio_")


def is_mode_frequency(name: str) -> bool:
    """Whether a quantity is the error of one natural frequency of the assembled structure."""
    return name.startswith("mode_frequency_")


@dataclass(frozen=True, slots=True)
class BeamRecipe:
    """What a uniform straight beam is made from, see `jointbayes.structure.beam`.

    Parameters
    ----------
    length
        Length, m.
    section, material, damping
        Cross-section, material and damping law.
    elements
        Equal spans between the numbered points 1 to elements + 1; with the paper's element also the finite elements.
    dofs_per_node, shear_coefficient
        As for `beam`; None takes Cowper's κ.
    supports
        DOFs held fixed.
    accelerometer_mass
        Mass of each accelerometer, kg.
    added_mass
        Mass that is exactly known, beside that of each accelerometer, kg.
    accelerometer_dofs
        Where one sits: its mass moves in all translations of the node of each of these DOFs that is a translation.
    element
        How it is discretised.
    richer
        Whether elements are four orders richer than it takes, one where points are many: a reference for others. No
        matter to the paper's element.
    """

    length: float
    section: Section
    material: BeamMaterial
    damping: DampingLaw
    elements: int = 10
    dofs_per_node: Literal[2, 5] = 2
    shear_coefficient: float | None = None
    supports: tuple[str, ...] = ()
    accelerometer_mass: float = 0.0
    added_mass: float = 0.0
    accelerometer_dofs: tuple[str, ...] = ()
    element: ElementKind = "converged"
    richer: bool = False

    def __post_init__(self) -> None:
        masses, kappa = (self.accelerometer_mass, self.added_mass), self.shear_coefficient
        if not (_LEAST <= self.length <= _MOST and all(0 <= mass <= _MOST for mass in masses)):
            raise ModelError(
                f"beam: found a length of {self.length:g} m and accelerometers of {masses[0]:g} + {masses[1]:g} kg; "
                "expected a finite length above 0 and masses of at least 0; correct them"
            )
        if not (kappa is None or _LEAST <= kappa <= _MOST):
            raise ModelError(
                f"beam: found a shear coefficient of {kappa:g}; expected one above 0, about 0.9; correct it"
            )
        if not (isinstance(self.elements, Integral) and 1 <= self.elements <= _MOST_SPANS):
            raise ModelError(
                f"beam: found {self.elements} elements; expected a whole number from 1 to {_MOST_SPANS}; correct it"
            )
        for label in (*self.supports, *self.accelerometer_dofs):
            named = _DOF.fullmatch(label)
            if named is None or float(named[1]) > self.elements + 1:
                raise ModelError(
                    f"beam: found the DOF {label!r}; expected node:direction with a node from 1 to "
                    f"{self.elements + 1}; correct it"
                )

    @property
    def lumped(self) -> "BeamRecipe":
        """The same beam, all mass at an accelerometer's place taken for the accelerometer's."""
        return replace(self, accelerometer_mass=self.accelerometer_mass + self.added_mass, added_mass=0.0)

    def lumped_factor(self, factor: Array) -> Array:
        """Factors on all mass at an accelerometer's place, from those on the accelerometer alone."""
        own, added = self.accelerometer_mass, self.added_mass
        return (own * factor + added) / (own + added) if added else factor

    @property
    def positions(self) -> dict[str, tuple[float, float, float]]:
        """Place of every numbered point, m."""
        return {str(i + 1): (self.length * i / self.elements, 0.0, 0.0) for i in range(self.elements + 1)}

    def own_stiffness(self, row: str, column: str) -> float:
        """EI/L³ (N/m), EI/L² (N) or EI/L (N·m/rad) of two DOFs, of bending in the plane of the first."""
        across_y = row.rpartition(":")[2] in ("z", "ry")
        inertia = self.section.inertia_y if across_y else self.section.inertia_z
        each = self.material.youngs_modulus * inertia / self.length ** np.array([3.0, 2.0, 1.0])
        return float(each[(":r" in row) + (":r" in column)])

    def own_inertia(self, dof: str) -> float:
        """ρAL (kg), or for a rotation ρAL³/3 (kg·m²), about an end."""
        mass = self.material.density * self.section.area * self.length
        return float(mass * self.length**2 / 3 if ":r" in dof else mass)

    @property
    def extent(self) -> float:
        """Length, m."""
        return self.length

    def has_quantity(self, name: str) -> bool:
        """Whether a quantity is one of a beam's."""
        return name in STRUCTURE_QUANTITIES or is_damping_ratio(name) or is_mode_frequency(name)

    def require_quantity(self, name: str) -> None:
        """Refuse a quantity that no beam has.

        Raises
        ------
        ModelError
            If the name is unknown.
        """
        if not self.has_quantity(name):
            raise ModelError(
                f"beam: found uncertain quantity {name!r}; expected one of {', '.join(STRUCTURE_QUANTITIES)}"
            )

    @property
    def shape(self) -> BeamShape:
        """Length, section and material."""
        return BeamShape(self.length, self.section, self.material, self.shear_coefficient)

    def mesh(self, dofs: Iterable[str] | None = None, top_hz: float | None = None) -> BeamMesh | None:
        """Elements that are exact up to a frequency and end where something acts or is observed.

        Parameters
        ----------
        dofs
            Labels of such DOFs, beside supports and accelerometers; None takes all points.
        top_hz
            Highest frequency, Hz; None that of ten half waves along the beam.

        Returns
        -------
        BeamMesh, or None for the paper's element

        Raises
        ------
        ModelError
            If the frequency is too high for the beam.
        """
        if self.element == "paper":
            return None
        if dofs is None:
            numbers = set(range(1, self.elements + 2))
        else:
            labels = (*dofs, *self.supports, *self.accelerometer_dofs)
            numbers = {int(label.split(":")[0]) for label in labels} & set(range(1, self.elements + 2))
        top = self.shape.bending_frequency_hz(_HALF_WAVES) if top_hz is None else top_hz
        extra = (_RICHER_OF_MANY if len(numbers) > MANY_POINTS else _RICHER) if self.richer else 0
        return mesh_through(self.shape, self.elements + 1, numbers, top, self.dofs_per_node, extra)

    def structure(self, factors: Mapping[str, float] | None = None, mesh: BeamMesh | None = None) -> Structure:
        """Assemble the beam with its quantities multiplied by factors, 1 where none is given.

        Parameters
        ----------
        factors
            By name, see `STRUCTURE_QUANTITIES`. ``length_offset`` is no factor on a value: its logarithm, in m, is
            added to the length. ``section_size`` multiplies every dimension of the section,
            ``damping_ratio`` every ratio, ``damping_ratio_2`` that of the second mode. Errors of natural frequencies,
            ``mode_frequency_1`` and so on, are those of the assembled structure, and change nothing here.
        mesh
            Elements, as `mesh` gives them; None takes those through all points.

        Raises
        ------
        ModelError
            If a name is unknown or a quantity becomes impossible.
        """
        given = dict(factors or {})
        for name in given:
            self.require_quantity(name)
        material = replace(
            self.material,
            youngs_modulus=self.material.youngs_modulus * given.get("youngs_modulus", 1.0),
            density=self.material.density * given.get("density", 1.0),
        )
        shear = given.get("shear_coefficient", 1.0)
        section = self.section.scaled(given.get("section_size", 1.0), shear)
        kappa = None if self.shear_coefficient is None else self.shear_coefficient * shear
        length = self.length * given.get("length", 1.0) + math.log(given.get("length_offset", 1.0))
        damping = self.damping.scaled(given)
        mesh = mesh or self.mesh()
        if mesh is None:
            free = beam(
                length,
                section,
                material,
                damping,
                elements=self.elements,
                dofs_per_node=self.dofs_per_node,
                shear_coefficient=kappa,
            )
        else:
            free = meshed_beam(BeamShape(length, section, material, kappa), damping, mesh, self.dofs_per_node)
        loaded = self._loaded(free, self.accelerometer_mass * given.get("accelerometer_mass", 1.0) + self.added_mass)
        held = loaded.fixed(self.supports) if self.supports else loaded
        return replace(held, positions=self.positions)

    def _loaded(self, free: Structure, mass: float) -> Structure:
        if mass < 0:
            raise ModelError(f"accelerometer: found a mass of {mass:g} kg; expected 0 or more; correct it")
        if mass == 0 or not self.accelerometer_dofs:
            return free
        total = free.mass.copy()
        nodes = {dof.split(":")[0] for dof in self.accelerometer_dofs if ":r" not in dof}
        at = [i for i, dof in enumerate(free.dofs) if dof.split(":")[0] in nodes and ":r" not in dof]
        total[at, at] += mass
        return replace(free, mass=total)
