"""How a beam is cut into elements: through the points where something acts or is observed, and fine enough.

A user numbers equally spaced points. The elements between them are nobody's business: their ends lie at the joint,
supports, accelerometers, measured and excited points only, and their number and order follow from the highest line.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from jointbayes.errors import ModelError
from jointbayes.structure.beam import DIRECTIONS, BeamMaterial
from jointbayes.structure.damping import DampingLaw
from jointbayes.structure.high_order import (
    BeamPlane,
    Span,
    bar_matrices,
    beam_matrices,
    node_positions,
    spans_between,
)
from jointbayes.structure.matrices import Structure
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
        material, section = self.material, self.section
        along_y, along_z = section.shear_coefficient(material.poissons_ratio)
        return (
            self._plane(section.inertia_z, self.shear_coefficient or along_y),
            self._plane(section.inertia_y, self.shear_coefficient or along_z),
        )

    def _plane(self, inertia: float, kappa: float) -> BeamPlane:
        material, area = self.material, self.section.area
        return BeamPlane(
            material.youngs_modulus * inertia,
            kappa * material.shear_modulus * area,
            material.density * area,
            material.density * inertia,
        )

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
