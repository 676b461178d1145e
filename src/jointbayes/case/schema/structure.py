"""The `[structure]` table of a case file: geometry, material, cross-section, damping and supports."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Annotated, Literal

from pydantic import Field, ValidatorFunctionWrapHandler, WrapValidator

from jointbayes.case.errors import Finding
from jointbayes.case.schema.fields import Fraction, Labels, Ratios, Spec, count_field, key_field, not_negative, positive

__all__ = [
    "BoxSpec",
    "CircleSpec",
    "DampingSpec",
    "LossFactorDampingSpec",
    "ModalDampingSpec",
    "RayleighDampingSpec",
    "RectangleSpec",
    "SectionSpec",
    "StructureSpec",
    "TubeSpec",
    "absent_dofs",
]

_DIRECTIONS = {2: ("y", "rz"), 5: ("x", "y", "z", "ry", "rz")}

_SHAPE = key_field('the shape of the section, "circle", "tube", "rectangle" or "box"', "circle")


class CircleSpec(Spec):
    """Solid circular cross-section."""

    shape: Annotated[Literal["circle"], _SHAPE]
    diameter_mm: Annotated[float, positive("the diameter in mm", 25.0)]


class TubeSpec(Spec):
    """Circular tube."""

    shape: Annotated[Literal["tube"], _SHAPE]
    outer_diameter_mm: Annotated[float, positive("the outer diameter in mm", 40.0)]
    inner_diameter_mm: Annotated[float, positive("the inner diameter in mm", 30.0)]

    def _findings(self) -> Iterator[Finding]:
        if self.inner_diameter_mm >= self.outer_diameter_mm:
            found = f"found {self.inner_diameter_mm!r}, which leaves no wall"
            expected = f"an inner diameter in mm below the outer one, {self.outer_diameter_mm!r}"
            yield Finding(("inner_diameter_mm",), found, expected, "correct one of the two diameters")


class RectangleSpec(Spec):
    """Solid rectangle; the height lies along y, the width along z."""

    shape: Annotated[Literal["rectangle"], _SHAPE]
    width_mm: Annotated[float, positive("the width (along z) in mm", 40.0)]
    height_mm: Annotated[float, positive("the height (along y) in mm", 20.0)]


class BoxSpec(Spec):
    """Rectangular tube of constant wall."""

    shape: Annotated[Literal["box"], _SHAPE]
    width_mm: Annotated[float, positive("the outer width (along z) in mm", 40.0)]
    height_mm: Annotated[float, positive("the outer height (along y) in mm", 20.0)]
    wall_mm: Annotated[float, positive("the thickness of the wall in mm", 2.0)]

    def _findings(self) -> Iterator[Finding]:
        half = min(self.width_mm, self.height_mm) / 2
        if self.wall_mm >= half:
            found, expected = f"found {self.wall_mm!r}, which leaves no hollow", f"a wall below {half!r} mm"
            yield Finding(("wall_mm",), found, f"{expected} (half the smaller side)", "make the wall thinner")


_LAW = key_field('the damping law, "modal", "loss_factor" or "rayleigh"', "modal")
_RATIO = key_field("the damping ratio, a number from 0 to below 1 (0.01 is 1 %), or a list of them", 0.01)


def _or_measured(value: object, ratios: ValidatorFunctionWrapHandler) -> object:
    """No ratio where they are to be those that the data show."""
    return () if value == "measured" else ratios(value)


class ModalDampingSpec(Spec):
    """Damping ratios of the modes of structure with joint; the last one holds for all further modes.

    ``ratio = "measured"`` leaves them empty until the data have been read.
    """

    law: Annotated[Literal["modal"], _LAW]
    ratio: Annotated[Ratios, WrapValidator(_or_measured), _RATIO]

    @property
    def measured(self) -> bool:
        """Whether the ratios are those that the data show."""
        return not self.ratio


class LossFactorDampingSpec(Spec):
    """Structural (hysteretic) damping, K(1 + jη)."""

    law: Annotated[Literal["loss_factor"], _LAW]
    loss_factor: Annotated[float, not_negative("the structural loss factor", 0.01)]


class RayleighDampingSpec(Spec):
    """Viscous damping, C = alpha M + beta K."""

    law: Annotated[Literal["rayleigh"], _LAW]
    alpha_per_s: Annotated[float, not_negative("the factor of the mass matrix in 1/s", 1.0)]
    beta_s: Annotated[float, not_negative("the factor of the stiffness matrix in s", 1e-6)]


SectionSpec = Annotated[
    CircleSpec | TubeSpec | RectangleSpec | BoxSpec,
    Field(discriminator="shape", description="the cross-section: its shape and dimensions"),
]
DampingSpec = Annotated[
    ModalDampingSpec | LossFactorDampingSpec | RayleighDampingSpec,
    Field(discriminator="law", description="the damping: its law and constants"),
]
_POISSON = Field(gt=-1, lt=0.5, description="Poisson's ratio, above -1 and below 0.5", examples=[0.3])
_SHEAR = key_field('the shear coefficient, "cowper" or a number above 0 and at most 1', "cowper")
_ELEMENT = key_field(
    '"converged" (elements so fine that no mesh shows) or "paper" (its two-node elements, one for each span)',
    "converged",
)
_MASS = not_negative("the mass in g added at each measured translation", 2.0)


class StructureSpec(Spec):
    """The structure without its joint: a uniform Timoshenko beam along x, nodes counted from 1 at x = 0."""

    kind: Annotated[Literal["beam"], key_field('the kind of structure, "beam"', "beam")] = "beam"
    length_mm: Annotated[float, positive("the length of the beam in mm", 383.0)]
    elements: Annotated[int, count_field("the number of equal spans between numbered points", 10, 1, 500)] = 10
    element: Annotated[Literal["converged", "paper"], _ELEMENT] = "converged"
    dofs_per_node: Annotated[Literal[2, 5], key_field("2 (y, rz) or 5 (x, y, z, ry, rz) DOFs per node", 2)] = 2
    youngs_modulus_gpa: Annotated[float, positive("Young's modulus in GPa", 210.0)]
    poissons_ratio: Annotated[float, _POISSON] = 0.3
    density_kg_m3: Annotated[float, positive("the density in kg/m³", 7800.0)]
    shear_coefficient: Annotated[Literal["cowper"] | Fraction, _SHEAR] = "cowper"
    supports: Annotated[Labels, key_field("a list of the DOFs held fixed", ["1:y"])] = ()
    accelerometer_mass_g: Annotated[float, _MASS] = 0.0
    section: SectionSpec
    damping: DampingSpec

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return self.elements + 1

    @property
    def directions(self) -> tuple[str, ...]:
        """Directions of the DOFs of each node."""
        return _DIRECTIONS[self.dofs_per_node]

    def _findings(self) -> Iterator[Finding]:
        yield from absent_dofs(self, self.supports, ("supports",))


def absent_dofs(structure: StructureSpec, labels: Iterable[str], loc: tuple[str, ...]) -> Iterator[Finding]:
    """Yield the DOF labels that the structure does not have."""
    for i, label in enumerate(labels):
        node, direction = label.split(":")
        if int(node) > structure.nodes:
            expected = f"a node from 1 to {structure.nodes} (elements + 1)"
            remedy = f'write for example "{structure.nodes}:{direction}"'
            yield Finding((*loc, i), f'"{label}": there is no node {node}', expected, remedy)
        elif direction not in structure.directions:
            found = f'"{label}": no direction {direction} with dofs_per_node = {structure.dofs_per_node}'
            remedy = "set structure.dofs_per_node = 5" if direction in _DIRECTIONS[5] else "choose one of these"
            yield Finding((*loc, i), found, f"one of {', '.join(structure.directions)}", remedy)
