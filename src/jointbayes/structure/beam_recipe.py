"""A beam as a recipe: what its matrices are made from, and how it is cut into elements.

A user numbers equally spaced points. The elements between them are nobody's business: their ends lie at the joint,
supports, accelerometers, measured and excited points only, and their number and order follow from the highest line.
"""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from numbers import Integral
from typing import ClassVar, Literal

import numpy as np

from jointbayes.errors import ModelError
from jointbayes.structure.beam import DIRECTIONS, BeamMaterial, beam
from jointbayes.structure.damping import DampingLaw
from jointbayes.structure.high_order import (
    MANY_POINTS,
    BeamPlane,
    Span,
    bar_matrices,
    beam_matrices,
    node_positions,
    spans_between,
)
from jointbayes.structure.matrices import Structure
from jointbayes.structure.recipe import HALF_WAVES, ElementKind, Recipe
from jointbayes.structure.section import Section

#: A beam of so many DOFs has a hundred modes below the highest line: no test is made so, but units are mistaken.
MOST_DOFS = 500
_HIGHEST_HZ = 1e20  # with squares and products that stay finite
_MOST_AT_A_POINT = 10  # nodes from one point to the next that are there for the point's sake


@dataclass(frozen=True, slots=True)
class BeamShape:
    """A uniform beam of given length (m), section and material; κ None takes Cowper's for each plane."""

    length: float
    section: Section
    material: BeamMaterial
    shear_coefficient: float | None = None

    def __post_init__(self) -> None:
        kappa = self.shear_coefficient
        if not (self.length > 0 and (kappa is None or kappa > 0)):
            raise ModelError(
                f"beam: found a length of {self.length:g} m and a shear coefficient of {kappa}; expected both above 0"
            )

    @property
    def planes(self) -> tuple[BeamPlane, BeamPlane]:
        """Bending in the x-y and in the x-z plane."""
        along_y, along_z = self.section.shear_coefficient(self.material.poissons_ratio)
        return self._plane(self.section.inertia_z, along_y), self._plane(self.section.inertia_y, along_z)

    def _plane(self, inertia: float, cowper: float) -> BeamPlane:
        e, g, rho = self.material.youngs_modulus, self.material.shear_modulus, self.material.density
        area, kappa = self.section.area, self.shear_coefficient or cowper
        return BeamPlane(e * inertia, kappa * g * area, rho * area, rho * inertia)

    def bending_frequency_hz(self, half_waves: float) -> float:
        """Frequency below which so many half waves of bending fit the length: of a slender beam, or of pure shear."""
        wave_number = half_waves * np.pi / self.length
        return max(
            float(min(wave_number**2 * np.sqrt(p.bending / p.mass), wave_number * np.sqrt(p.shear / p.mass)))
            for p in self.planes
        ) / (2 * np.pi)


@dataclass(frozen=True, slots=True)
class BeamMesh:
    """Elements of a beam as fractions of its length, so that one mesh serves beams of any size.

    Parameters
    ----------
    spans
        Stretches between points, `length` relative to the beam's.
    nodes
        Label of every node along the beam: a point's number, or such as ``"3.25"`` between the points 3 and 4.
    """

    spans: tuple[Span, ...]
    nodes: tuple[str, ...]

    @property
    def elements(self) -> int:
        """Number of elements."""
        return sum(span.elements for span in self.spans)

    @property
    def order(self) -> int:
        """Highest polynomial order of an element."""
        return max(span.order for span in self.spans)


def mesh_through(
    shape: BeamShape, points: int, numbers: Iterable[int], top_hz: float, dofs_per_node: int, extra_order: int = 0
) -> BeamMesh:
    """Elements that are exact up to a frequency and end at given points.

    Parameters
    ----------
    shape
        The beam.
    points
        Number of equally spaced points, the first at one end and the last at the other.
    numbers
        Points, counted from 1, where something acts or is observed; the beam's ends are added.
    top_hz
        Highest frequency, Hz.
    dofs_per_node
        2 or 5; with 5 the second plane counts as well.
    extra_order
        Polynomial orders more than that takes: for a reference.

    Raises
    ------
    ModelError
        If the frequency is too high for the beam.
    """
    places = sorted({1, points, *numbers})
    if not (0 <= top_hz <= _HIGHEST_HZ and places[0] >= 1 and places[-1] <= points):
        raise ModelError(
            f"beam: found the points {places[0]} to {places[-1]} and lines up to {top_hz:g} Hz; expected points from 1 "
            f"to {points} and lines up to {_HIGHEST_HZ:g} Hz; correct them"
        )
    positions = [shape.length * (n - 1) / (points - 1) for n in places]
    planes = shape.planes[: 1 if dofs_per_node == 2 else 2]
    spans = spans_between(positions, planes, 2 * np.pi * top_hz, extra_order)
    nodes = 1 + sum(s.elements * s.order for s in spans)
    most = MOST_DOFS // dofs_per_node + _MOST_AT_A_POINT * len(places)
    if nodes > most:
        raise ModelError(
            f"beam: found a length of {shape.length:g} m and lines up to {top_hz:g} Hz, which take {nodes} nodes; "
            f"expected at most {most}, a hundred natural frequencies; lower the frequencies, or correct the "
            "units of length and material"
        )
    relative = tuple(Span(s.length / shape.length, s.elements, s.order) for s in spans)
    coordinates = 1 + (points - 1) * node_positions(relative)
    return BeamMesh(relative, tuple(f"{c:.9g}" for c in coordinates))


def meshed_beam(shape: BeamShape, damping: DampingLaw, mesh: BeamMesh, dofs_per_node: int) -> Structure:
    """Free-free beam of elements of high order; DOFs as for `jointbayes.structure.beam`, node by node."""
    spans = [Span(s.length * shape.length, s.elements, s.order) for s in mesh.spans]
    in_plane, out_of_plane = shape.planes
    dofs = tuple(f"{node}:{d}" for node in mesh.nodes for d in DIRECTIONS[dofs_per_node])
    if dofs_per_node == 2:
        stiffness, mass = beam_matrices(spans, in_plane)
        return Structure(stiffness, mass, damping, dofs)
    material, area = shape.material, shape.section.area
    along = bar_matrices(spans, material.youngs_modulus * area, material.density * area)
    xy, xz = beam_matrices(spans, in_plane), beam_matrices(spans, out_of_plane)
    sign = np.tile([1.0, -1.0], len(mesh.nodes))  # ry = -∂w/∂x
    base = 5 * np.arange(len(mesh.nodes))
    rows_xy, rows_xz = (np.stack([base + a, base + b], axis=-1).ravel() for a, b in ((1, 4), (2, 3)))
    stiffness, mass = np.zeros((2, len(dofs), len(dofs)))
    for whole, bar, plane_xy, plane_xz in zip((stiffness, mass), along, xy, xz, strict=True):
        whole[np.ix_(base, base)] = bar
        whole[np.ix_(rows_xy, rows_xy)] = plane_xy
        whole[np.ix_(rows_xz, rows_xz)] = plane_xz * np.outer(sign, sign)
    return Structure(stiffness, mass, damping, dofs)


_LEAST, _MOST, _MOST_SPANS = 1e-6, 1e6, 10_000  # of a length in m, a coefficient; and equal spans
_DOF = re.compile(r"([1-9]\d{0,6}(?:\.\d+)?):(?:x|y|z|rx|ry|rz)")
_RICHER, _RICHER_OF_MANY = 4, 1  # polynomial orders that a reference has more; between many points one says enough

#: Quantities of a beam that may be uncertain, beside ``damping_ratio_1`` and so on.
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


@dataclass(frozen=True, slots=True)
class BeamRecipe(Recipe):
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
    richer
        Whether elements are four orders richer than it takes, one where points are many: a reference for others. No
        matter to the paper's element.
    supports, accelerometer_mass, added_mass, accelerometer_dofs, element
        See `Recipe`.
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

    kind: ClassVar[str] = "beam"
    quantities: ClassVar[tuple[str, ...]] = STRUCTURE_QUANTITIES

    def __post_init__(self) -> None:
        if not _LEAST <= self.length <= _MOST:
            raise ModelError(f"beam: found a length of {self.length:g} m; expected a finite length above 0; correct it")
        self._require_masses()
        kappa = self.shear_coefficient
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
    def positions(self) -> dict[str, tuple[float, float, float]]:
        """Place of every numbered point, m."""
        return {str(i + 1): (self.length * i / self.elements, 0.0, 0.0) for i in range(self.elements + 1)}

    def own_stiffness(self, row: str, column: str) -> float:
        """EI/L³ (N/m), EI/L² (N) or EI/L (N·m/rad) of two DOFs, of bending in the plane of the first."""
        across_y = row.rpartition(":")[2] in ("z", "ry")
        inertia = self.section.inertia_y if across_y else self.section.inertia_z
        by_rotations = self.material.youngs_modulus * inertia / self.length ** np.array([3.0, 2.0, 1.0])
        return float(by_rotations[(":r" in row) + (":r" in column)])

    def own_inertia(self, dof: str) -> float:
        """ρAL (kg), or for a rotation ρAL³/3 (kg·m²), about an end."""
        mass = self.material.density * self.section.area * self.length
        return float(mass * self.length**2 / 3 if ":r" in dof else mass)

    @property
    def extent(self) -> float:
        """Length, m."""
        return self.length

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
        numbers = set(range(1, self.elements + 2))
        if dofs is not None:
            points = {label.split(":")[0] for label in (*dofs, *self.supports, *self.accelerometer_dofs)}
            numbers = {number for number in numbers if str(number) in points}
        top = self.shape.bending_frequency_hz(HALF_WAVES) if top_hz is None else top_hz
        extra = (_RICHER_OF_MANY if len(numbers) > MANY_POINTS else _RICHER) if self.richer else 0
        return mesh_through(self.shape, self.elements + 1, numbers, top, self.dofs_per_node, extra)

    def structure(self, factors: Mapping[str, float] | None = None, mesh: BeamMesh | None = None) -> Structure:
        """Assemble the beam with its quantities multiplied by factors, 1 where none is given.

        Parameters
        ----------
        factors
            By name, see `STRUCTURE_QUANTITIES`. ``length_offset`` is no factor on a value: its logarithm, in m, is
            added to the length. ``section_size`` multiplies every dimension of the section,
            ``damping_ratio`` every ratio, ``damping_ratio_2`` that of the second mode.
        mesh
            Elements, as `mesh` gives them; None takes those through all points.

        Raises
        ------
        ModelError
            If a name is unknown or a quantity becomes impossible.
        """
        named = self.checked_factors(factors)
        material = replace(
            self.material,
            youngs_modulus=self.material.youngs_modulus * named.get("youngs_modulus", 1.0),
            density=self.material.density * named.get("density", 1.0),
        )
        shear = named.get("shear_coefficient", 1.0)
        section = self.section.scaled(named.get("section_size", 1.0), shear)
        kappa = None if self.shear_coefficient is None else self.shear_coefficient * shear
        length = self.length * named.get("length", 1.0) + math.log(named.get("length_offset", 1.0))
        damping = self.damping.scaled(named)
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
        held = free.loaded(self.accelerometer_dofs, self.load(named)).fixed(self.supports)
        return replace(held, positions=self.positions)
