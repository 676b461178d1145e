"""The `[structure]` table of a case file: a straight beam, or another kind of structure, without its joints."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import BeforeValidator, Field

from jointbayes.case.errors import Finding
from jointbayes.case.schema.damping import DampingSpec, LossFactorDampingSpec
from jointbayes.case.schema.fields import Fraction, Labels, count_field, key_field, positive
from jointbayes.case.schema.frame import FrameSpec
from jointbayes.case.schema.matrices import ChainSpec, MatricesSpec
from jointbayes.case.schema.section import SectionSpec
from jointbayes.case.schema.structure_parts import (
    KIND,
    MASS,
    SUPPORTS,
    Absence,
    AnyStructureSpec,
    absent_dofs,
    changed_by,
    point_and_direction,
)

if TYPE_CHECKING:
    from jointbayes.case.schema.data import TruthSpec


_DIRECTIONS = {2: ("y", "rz"), 5: ("x", "y", "z", "ry", "rz")}
_POISSON = Field(gt=-1, lt=0.5, description="Poisson's ratio, above -1 and below 0.5", examples=[0.3])
_SHEAR = key_field('the shear coefficient, "cowper" or a number above 0 and at most 1', "cowper")
_ELEMENT = key_field(
    '"converged" (elements so fine that no mesh shows) or "paper" (its two-node elements, one for each span)',
    "converged",
)


class BeamSpec(AnyStructureSpec):
    """The structure without its joint: a uniform Timoshenko beam along x, nodes counted from 1 at x = 0."""

    kind: Annotated[Literal["beam"], KIND] = "beam"
    length_mm: Annotated[float, positive("the length of the beam in mm", 383.0)]
    elements: Annotated[int, count_field("the number of equal spans between numbered points", 10, 1, 500)] = 10
    element: Annotated[Literal["converged", "paper"], _ELEMENT] = "converged"
    dofs_per_node: Annotated[Literal[2, 5], key_field("2 (y, rz) or 5 (x, y, z, ry, rz) DOFs per node", 2)] = 2
    youngs_modulus_gpa: Annotated[float, positive("Young's modulus in GPa", 210.0)]
    poissons_ratio: Annotated[float, _POISSON] = 0.3
    density_kg_m3: Annotated[float, positive("the density in kg/m³", 7800.0)]
    shear_coefficient: Annotated[Literal["cowper"] | Fraction, _SHEAR] = "cowper"
    supports: Annotated[Labels, SUPPORTS] = ()
    accelerometer_mass_g: Annotated[float, MASS] = 0.0
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

    @property
    def points_in_order(self) -> tuple[str, ...]:
        """Numbers of all nodes."""
        return tuple(str(node) for node in range(1, self.nodes + 1))

    @property
    def free_dofs(self) -> int:
        """Number of DOFs at the nodes that are not held."""
        return self.nodes * len(self.directions) - len(self.supports)

    @property
    def spans(self) -> int:
        """Equal spans between the numbered points."""
        return self.elements

    @property
    def stated(self) -> dict[str, tuple[str, float]]:
        """Unit and value of each quantity that may be uncertain."""
        found = {
            "youngs_modulus": ("GPa", self.youngs_modulus_gpa),
            "density": ("kg/m³", self.density_kg_m3),
            "length": ("mm", self.length_mm),
            "length_offset": ("mm", 1000.0),  # that are a metre
            "section_size": ("× stated", 1.0),
            "shear_coefficient": ("× stated", 1.0),
            "accelerometer_mass": ("g", self.accelerometer_mass_g),
        }
        if isinstance(self.damping, LossFactorDampingSpec):
            found["loss_factor"] = ("1", self.damping.loss_factor)
        return found

    def absent(self, label: str) -> Absence | None:
        """What to say of a DOF that does not exist."""
        node, direction = point_and_direction(label)
        if not node.isdecimal() or int(node) > self.nodes:
            expected = f"a node from 1 to {self.nodes} (elements + 1)"
            return f'"{label}": there is no node {node}', expected, f'write for example "{self.nodes}:{direction}"'
        if direction not in self.directions:
            found = f'"{label}": no direction {direction} with dofs_per_node = {self.dofs_per_node}'
            remedy = "set structure.dofs_per_node = 5" if direction in _DIRECTIONS[5] else "choose one of these"
            return found, f"one of {', '.join(self.directions)}", remedy
        return None

    def place(self, label: str) -> str:
        """Where a node is along the beam."""
        node, _ = point_and_direction(label)
        return f"{self.length_mm * ((int(node) - 1) / self.elements):.4g} mm"

    def of_truth(self, truth: TruthSpec) -> Self:
        """The beam that makes the data."""
        stated = {
            "youngs_modulus_gpa": truth.youngs_modulus_gpa,
            "density_kg_m3": truth.density_kg_m3,
            "length_mm": truth.length_mm,
        }
        own = {name: value for name, value in stated.items() if value is not None}
        return self.model_copy(update=own | changed_by(truth))

    def _findings(self) -> Iterator[Finding]:
        yield from absent_dofs(self, self.supports, ("supports",))


def _beam_unless_stated(table: object) -> object:
    return {"kind": "beam", **table} if isinstance(table, dict) else table


StructureSpec = Annotated[
    BeamSpec | FrameSpec | ChainSpec | MatricesSpec,
    Field(discriminator="kind", description="the structure without its joint"),
    BeforeValidator(_beam_unless_stated),
]
