"""The `[structure]` tables of a straight beam and of small structures: chains of masses and springs, given matrices."""

from __future__ import annotations

from collections.abc import Iterator
from operator import itemgetter
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, Field, Strict

from jointbayes.case.spec.fields import (
    Finding,
    Fraction,
    Labels,
    Positive,
    Spec,
    count_field,
    even,
    key_field,
    max_length,
    not_negative,
    positive,
)
from jointbayes.case.spec.structure_table import (
    DAMPING,
    KIND,
    LAW,
    LAWS,
    POINT,
    Absence,
    BeamsSpec,
    DampingSpec,
    Direction,
    PointName,
    SectionSpec,
    StructureBase,
    force_stated,
    metres,
)

if TYPE_CHECKING:
    from jointbayes.structure import BeamRecipe, MatrixRecipe, ViscousMatrix
    from vibrecords.arrays import Array

_AT = Field(
    description="further points between the nodes: name and distance from node 1 in mm, above 0, as { tip = 250.0 }",
    examples=[{"tip": 250.0}],
    max_length=100,
)
_DIRECTIONS = {2: ("y", "rz"), 5: ("x", "y", "z", "ry", "rz")}
_SHEAR = key_field('the shear coefficient, "cowper" or a number above 0 and at most 1', "cowper")
_ELEMENT = key_field(
    '"converged" (elements so fine that no mesh shows) or "paper" (its two-node elements, one for each span)',
    "converged",
)


class BeamSpec(BeamsSpec, StructureBase):
    """The structure without its joint: a uniform Timoshenko beam along x, nodes counted from 1 at x = 0."""

    field_keys = {"points": "at_mm"}  # noqa: RUF012 (no field)

    kind: Annotated[Literal["beam"], KIND] = "beam"
    length_mm: Annotated[float, positive("the length of the beam in mm", 383.0)]
    elements: Annotated[int, count_field("the number of equal spans between numbered points", 10, 1, 500)] = 10
    element: Annotated[Literal["converged", "paper"], _ELEMENT] = "converged"
    dofs_per_node: Annotated[Literal[2, 5], key_field("2 (y, rz) or 5 (x, y, z, ry, rz) DOFs per node", 2)] = 2
    shear_coefficient: Annotated[Literal["cowper"] | Fraction, _SHEAR] = "cowper"
    at_mm: Annotated[dict[PointName, Positive], _AT] = {}  # noqa: RUF012 (pydantic copies it)
    section: SectionSpec
    damping: Annotated[LAWS, DAMPING]

    @property
    def directions(self) -> tuple[str, ...]:
        """Directions of the DOFs of each node."""
        return _DIRECTIONS[self.dofs_per_node]

    @property
    def places_mm(self) -> dict[str, float]:
        """Distance of every point from node 1, mm, in their order along the beam."""
        numbered = [(str(i + 1), self.length_mm * i / self.elements) for i in range(self.elements + 1)]
        return dict(sorted((*numbered, *self.at_mm.items()), key=itemgetter(1)))

    @property
    def points_in_order(self) -> tuple[str, ...]:
        """Numbers of all nodes and names of all points between, along the beam."""
        return tuple(self.places_mm)

    @property
    def spans(self) -> int:
        """Equal spans between the numbered points."""
        return self.elements

    @property
    def stated(self) -> dict[str, tuple[str, float]]:
        """Unit and value of each quantity that may be uncertain."""
        return {
            "youngs_modulus": ("GPa", self.youngs_modulus_gpa),
            "density": ("kg/m³", self.density_kg_m3),
            "length": ("mm", self.length_mm),
            "length_offset": ("mm", 1000.0),  # that are a metre
            "section_size": ("× stated", 1.0),
            "shear_coefficient": ("× stated", 1.0),
            "accelerometer_mass": ("g", self.accelerometer_mass_g),
            **force_stated([self.axial_force_n]),
        } | super().stated

    def absent(self, label: str) -> Absence | None:
        """What to say of a DOF that does not exist."""
        (node, _, direction), last = label.rpartition(":"), self.elements + 1
        if node not in self.at_mm and (not node.isdecimal() or int(node) > last):
            expected = f"a node from 1 to {last} (elements + 1), or a point that structure.at_mm names"
            return f'"{label}": there is no node {node}', expected, f'write for example "{last}:{direction}"'
        if direction not in self.directions:
            fault = f'"{label}": no direction {direction} with dofs_per_node = {self.dofs_per_node}'
            remedy = "set structure.dofs_per_node = 5" if direction in _DIRECTIONS[5] else "choose one of these"
            return fault, f"one of {', '.join(self.directions)}", remedy
        return None

    def place(self, label: str) -> str:
        """Where a node is along the beam."""
        return f"{self.places_mm[label.rpartition(':')[0]]:.4g} mm"

    def recipe(self, loaded: tuple[str, ...]) -> BeamRecipe:
        """The beam, with accelerometers where they sit."""
        from jointbayes.structure import BeamMaterial, BeamRecipe

        return BeamRecipe(
            self.length_mm * 1e-3,
            self.section.section,
            BeamMaterial(self.youngs_modulus_gpa * 1e9, self.poissons_ratio, self.density_kg_m3),
            self.damping.built(),
            elements=self.elements,
            dofs_per_node=self.dofs_per_node,
            shear_coefficient=None if self.shear_coefficient == "cowper" else float(self.shear_coefficient),
            supports=self.supports,
            accelerometer_mass=self.accelerometer_mass_g * 1e-3,
            accelerometer_dofs=loaded,
            element=self.element,
            axial_force=self.axial_force_n,
            points=tuple((name, place * 1e-3) for name, place in self.at_mm.items()),
        )


_GROUND = "ground"
_MOST = 2000  # rows of a matrix, masses, springs

_BETWEEN = key_field('the two masses, or a mass and "ground"', ["1", "2"])


class SpringSpec(Spec):
    """A spring between two masses, or between one and the ground."""

    between: Annotated[tuple[PointName, PointName], Strict(False), _BETWEEN]
    stiffness_n_per_m: Annotated[float, not_negative("the stiffness in N/m", 1e5)]


class DamperSpec(Spec):
    """A viscous damper between two masses, or between one and the ground."""

    between: Annotated[tuple[PointName, PointName], Strict(False), _BETWEEN]
    damping_n_s_per_m: Annotated[float, not_negative("the damping constant in N s/m", 10.0)]


class DampersSpec(DampingSpec):
    """Dampers between the masses of a chain."""

    law: Annotated[Literal["dampers"], LAW]
    dampers: Annotated[
        tuple[DamperSpec, ...], Strict(False), max_length(_MOST), Field(min_length=1, description="a list of dampers")
    ]


_Rows = Annotated[tuple[Annotated[tuple[float, ...], Strict(False)], ...], Strict(False), max_length(_MOST)]
_Diagonal = Annotated[tuple[float, ...], Strict(False), max_length(_MOST)]
Matrix = Annotated[str | _Diagonal | _Rows, AfterValidator(even)]
_MATRIX_TEXT = "a list of rows, a list of the diagonal, or the name of a .npy or .csv file"


class MatrixDampingSpec(DampingSpec):
    """Viscous damping by its matrix C."""

    field_keys = {"viscous_matrix": "damping_matrix"}  # noqa: RUF012 (no field)

    law: Annotated[Literal["matrix"], LAW]
    damping_matrix: Annotated[Matrix, key_field(f"C in SI units (N s/m): {_MATRIX_TEXT}", "C.npy")]

    def built(self) -> ViscousMatrix:
        """The law of the matrix."""
        from jointbayes.structure import ViscousMatrix

        return ViscousMatrix(_array(self.damping_matrix))

    def try_objects(self) -> None:
        """The law, once its file is read."""
        if not isinstance(self.damping_matrix, str):
            self.built()


class ChainSpec(StructureBase):
    """The structure without its joints: masses that move along one line, with springs between them."""

    kind: Annotated[Literal["chain"], KIND]
    masses_kg: Annotated[
        dict[str, Positive], Field(description="the masses in kg, each by its name or number", min_length=1)
    ]
    springs: Annotated[
        tuple[SpringSpec, ...], Strict(False), max_length(_MOST), Field(description="a list of springs")
    ] = ()
    direction: Annotated[Direction, key_field("the direction of the DOFs", "x")] = "x"
    damping: Annotated[LAWS | DampersSpec, DAMPING]

    field_keys = {"dampers": "damping.dampers"}  # noqa: RUF012 (no field)

    @property
    def points_in_order(self) -> tuple[str, ...]:
        """Names of the masses."""
        return tuple(self.masses_kg)

    @property
    def directions(self) -> tuple[str, ...]:
        """The one."""
        return (self.direction,)

    def place(self, label: str) -> str:
        """The mass itself."""
        return f"mass {label.rpartition(':')[0]}"

    def recipe(self, loaded: tuple[str, ...]) -> MatrixRecipe:
        """The chain, with accelerometers where they sit."""
        from jointbayes.structure import MatrixRecipe, chain

        springs = [(*spring.between, spring.stiffness_n_per_m) for spring in self.springs]
        given = self.damping.dampers if isinstance(self.damping, DampersSpec) else ()
        dampers = [(*damper.between, damper.damping_n_s_per_m) for damper in given]
        law = None if given else self.damping.built()
        whole = chain(self.masses_kg, springs, law, dampers=dampers, direction=self.direction)
        return MatrixRecipe(
            whole.stiffness,
            whole.mass,
            whole.dofs,
            whole.damping,
            self.supports,
            accelerometer_mass=self.accelerometer_mass_g * 1e-3,
            accelerometer_dofs=loaded,
        )

    def _findings(self) -> Iterator[Finding]:
        for name in self.masses_kg:
            if not POINT.fullmatch(name) or name == _GROUND:
                expected = "a number from 1, or a word of letters, digits, _ and - other than ground"
                yield Finding(("masses_kg",), f'found the name "{name[:40]}"', expected, "rename the mass")
        yield from super()._findings()


class MatricesSpec(StructureBase):
    """The structure without its joints, given by its stiffness and mass matrices."""

    kind: Annotated[Literal["matrices"], KIND]
    dofs: Annotated[Labels, Field(min_length=1), key_field("the DOF labels of the rows, in order", ["1:x", "2:x"])]
    stiffness: Annotated[Matrix, key_field(f"K in SI units (N/m): {_MATRIX_TEXT}", "K.npy")]
    mass: Annotated[Matrix, key_field(f"M in SI units (kg): {_MATRIX_TEXT}", "M.npy")]
    points: Annotated[
        dict[str, Annotated[tuple[float, float, float], Strict(False)]],
        Field(description="the places of points in mm by their names, where they are known"),
    ] = {}  # noqa: RUF012 (pydantic copies it)
    damping: Annotated[LAWS | MatrixDampingSpec, DAMPING]

    field_keys = {"damping": "damping.damping_matrix"}  # noqa: RUF012 (no field)

    @property
    def matrices(self) -> dict[tuple[str, ...], Matrix]:
        """Its matrices by their keys below the table."""
        stated: dict[tuple[str, ...], Matrix] = {("stiffness",): self.stiffness, ("mass",): self.mass}
        if isinstance(self.damping, MatrixDampingSpec):
            stated["damping", "damping_matrix"] = self.damping.damping_matrix
        return stated

    @property
    def points_in_order(self) -> tuple[str, ...]:
        """What stands before the colon of the labels, each once."""
        return tuple(dict.fromkeys(label.rpartition(":")[0] for label in self.dofs))

    @property
    def free_dofs(self) -> int:
        """Number of DOFs that are not held."""
        return len(self.dofs) - len(self.supports)

    def absent(self, label: str) -> Absence | None:
        """What to say of a DOF that does not exist."""
        if label in self.dofs:
            return None
        return f'"{label}" is not one of structure.dofs', f"one of {', '.join(self.dofs[:12])}", "correct the label"

    def recipe(self, loaded: tuple[str, ...]) -> MatrixRecipe:
        """The structure, with accelerometers where they sit."""
        from jointbayes.structure import MatrixRecipe

        return MatrixRecipe(
            _array(self.stiffness),
            _array(self.mass),
            self.dofs,
            self.damping.built(),
            self.supports,
            {name: metres(place) for name, place in self.points.items()},
            self.accelerometer_mass_g * 1e-3,
            accelerometer_dofs=loaded,
        )

    def try_objects(self) -> None:
        """The structure, once its files are read."""
        if not any(isinstance(matrix, str) for matrix in self.matrices.values()):
            super().try_objects()


def _array(matrix: Matrix) -> Array:
    import numpy as np

    array = np.array(matrix, dtype=float)
    return np.diag(array) if array.ndim == 1 else array
