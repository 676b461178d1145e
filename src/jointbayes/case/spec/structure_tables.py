"""The `[structure]` tables of all kinds: straight beams, frames, chains, given matrices, imported models.

What computes is imported where it is built: a case is read and checked without NumPy.
"""

from __future__ import annotations

import itertools
import math
import re
from abc import abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PrivateAttr,
    Strict,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)

from jointbayes.case.spec.fields import (
    Finding,
    Fraction,
    Labels,
    Later,
    ListOf,
    Positive,
    Ratios,
    Spec,
    Vector,
    Word,
    count_field,
    distinct,
    even,
    key_field,
    listed,
    max_length,
    metres,
    not_negative,
    positive,
    table_field,
)
from jointbayes.errors import ModelError
from jointbayes.joint import DIRECTIONS

if TYPE_CHECKING:
    import jointbayes.structure as structures
    from jointbayes.structure import ImportedRecipe
    from vibrecords.arrays import Array
else:
    structures = Later("jointbayes.structure")

LAW = key_field('the damping law, "modal", "loss_factor" or "rayleigh"', "modal")
_RATIO = key_field("the damping ratio, a number from 0 to below 1 (0.01 is 1 %), or a list of them", 0.01)


def _or_measured(value: object, ratios: ValidatorFunctionWrapHandler) -> object:
    """No ratio where they are to be those that the data show; the JSON schema knows it by its name."""
    return () if value == "measured" else ratios(value)


class DampingSpec(Spec):
    """What is asked of a damping law's table."""

    law: Annotated[str, LAW]

    @property
    def values(self) -> dict[str, tuple[float, ...]]:
        """Its damping ratios or its loss factor by the name of the uncertain quantity; other laws have none."""
        return {}

    @property
    def measured(self) -> bool:
        """Whether its damping ratios are those that the data show."""
        return self.values.get("damping_ratio") == ()

    def try_objects(self) -> None:
        """Nothing: the law is tried with its structure, as some are known once files are read."""


class ModalDampingSpec(DampingSpec):
    """Damping ratios of the modes of structure with joint; the last one holds for all further modes.

    ``ratio = "measured"`` leaves them empty until the data have been read.
    """

    law: Annotated[Literal["modal"], LAW]
    ratio: Annotated[Ratios, WrapValidator(_or_measured), _RATIO]

    @property
    def values(self) -> dict[str, tuple[float, ...]]:
        """The ratios."""
        return {"damping_ratio": self.ratio}

    def built(self) -> structures.DampingLaw:
        """Modal damping."""
        return structures.ModalDamping(self.ratio)


class LossFactorDampingSpec(DampingSpec):
    """Structural (hysteretic) damping, K(1 + jη)."""

    law: Annotated[Literal["loss_factor"], LAW]
    loss_factor: float = not_negative("the structural loss factor", 0.01)

    @property
    def values(self) -> dict[str, tuple[float, ...]]:
        """The loss factor."""
        return {"loss_factor": (self.loss_factor,)}

    def built(self) -> structures.DampingLaw:
        """Structural damping."""
        return structures.LossFactor(self.loss_factor)


class RayleighDampingSpec(DampingSpec):
    """Viscous damping, C = alpha M + beta K."""

    law: Annotated[Literal["rayleigh"], LAW]
    alpha_per_s: float = not_negative("the factor of the mass matrix in 1/s", 1.0)
    beta_s: float = not_negative("the factor of the stiffness matrix in s", 1e-6)

    def built(self) -> structures.DampingLaw:
        """Rayleigh damping."""
        return structures.Rayleigh(self.alpha_per_s, self.beta_s)


_UNDAMPED = LossFactorDampingSpec(law="loss_factor", loss_factor=0.0)
LAWS = ModalDampingSpec | LossFactorDampingSpec | RayleighDampingSpec
DAMPING = Field(discriminator="law", description="the damping: its law and constants")
_SHAPE = key_field('the shape of the section, "circle", "tube", "rectangle" or "box"', "circle")


class _ShapeSpec(Spec):
    """A shape is the name of a constructor of `Section`, its sizes in mm that one's arguments in their order."""

    shape: Annotated[str, _SHAPE]

    @property
    def sizes_mm(self) -> dict[str, float]:
        """Its sizes by key."""
        return {key: getattr(self, key) for key in type(self).model_fields if key != "shape"}

    @property
    def section(self) -> structures.Section:
        """The section that it describes."""
        return getattr(structures.Section, self.shape)(*(size * 1e-3 for size in self.sizes_mm.values()))

    def try_objects(self) -> None:
        """The section."""
        _ = self.section


class CircleSpec(_ShapeSpec):
    """Solid circular cross-section."""

    shape: Annotated[Literal["circle"], _SHAPE]
    diameter_mm: float = positive("the diameter in mm", 25.0)


class TubeSpec(_ShapeSpec):
    """Circular tube."""

    shape: Annotated[Literal["tube"], _SHAPE]
    outer_diameter_mm: float = positive("the outer diameter in mm", 40.0)
    inner_diameter_mm: float = positive("the inner diameter in mm", 30.0)


class RectangleSpec(_ShapeSpec):
    """Solid rectangle; the height lies along y, the width along z."""

    shape: Annotated[Literal["rectangle"], _SHAPE]
    width_mm: float = positive("the width (along z) in mm", 40.0)
    height_mm: float = positive("the height (along y) in mm", 20.0)


class BoxSpec(_ShapeSpec):
    """Rectangular tube of constant wall."""

    shape: Annotated[Literal["box"], _SHAPE]
    width_mm: float = positive("the outer width (along z) in mm", 40.0)
    height_mm: float = positive("the outer height (along y) in mm", 20.0)
    wall_mm: float = positive("the thickness of the wall in mm", 2.0)


SectionSpec = Annotated[
    CircleSpec | TubeSpec | RectangleSpec | BoxSpec,
    Field(discriminator="shape", description="the cross-section: its shape and dimensions"),
]

KIND = key_field('the kind of structure, "beam", "frame", "chain", "matrices" or "imported"', "beam")
MODULUS, DENSITY = positive("Young's modulus in GPa", 210.0), positive("the density in kg/m³", 7800.0)
POISSON = Field(gt=-1, lt=0.5, description="Poisson's ratio, above -1 and below 0.5", examples=[0.3])
FORCE = key_field("the axial force at rest in N, tension positive, compression negative", 2000.0)
Direction = Literal[DIRECTIONS]  # type: ignore[valid-type]
#: Names of points: numbers from 1, or words.
POINT = re.compile(r"[1-9][0-9]{0,6}|[A-Za-z][A-Za-z0-9_-]{0,59}")


def _point_name(name: object) -> object:
    """Digits of a number; the JSON schema knows it by its name."""
    return str(name) if type(name) is int else name


#: The name of a point; a number stands for its digits.
PointName = Annotated[str, BeforeValidator(_point_name)]

Absence = tuple[str, str, str]
"""What was found where a DOF does not exist, what is expected, and what to do."""


class BeamsSpec(Spec):
    """What all beams of a structure or body are of, where they state nothing else."""

    youngs_modulus_gpa: Annotated[float, MODULUS]
    poissons_ratio: Annotated[float, POISSON] = 0.3
    density_kg_m3: Annotated[float, DENSITY]
    axial_force_n: Annotated[float, FORCE] = 0.0


class StructureBase(Spec):
    """What is asked of a structure's table of any kind."""

    kind: Annotated[str, KIND]
    supports: Labels = key_field("a list of the DOFs held fixed", ["1:y"], ())
    accelerometer_mass_g: float = not_negative("the mass in g added at each measured translation", 2.0, 0.0)
    damping: DampingSpec = Field(description="the damping")

    if TYPE_CHECKING:  # a key of a frame, and of no other kind

        @property
        def directions(self) -> tuple[str, ...]:
            """Directions of the DOFs of each point."""

    def model_copy(self, **changes: Any) -> Self:  # noqa: ANN401 (as of pydantic)
        """A copy, which is not what it was made of."""
        copied = super().model_copy(**changes)
        copied.__dict__.pop("_free", None)
        return copied

    @cached_property
    def _free(self) -> Any:  # noqa: ANN401 (a recipe of its kind)
        """The structure without its supports, also where its damping is not known yet: it knows its DOFs."""
        law = {"damping": _UNDAMPED} if self.damping.measured else {}
        return self.model_copy(update={"supports": (), **law}).recipe(())

    @property
    def points_in_order(self) -> tuple[str, ...]:
        """Names of all points, as they stand before the colon of a DOF label."""
        return tuple(self._free.positions)

    @property
    def free_dofs(self) -> int:
        """Number of DOFs that can be named and are not held."""
        return len(self.points_in_order) * len(self.directions) - len(self.supports)

    @property
    def stated(self) -> dict[str, tuple[str, float]]:
        """Unit and value of each quantity that may be uncertain, and of no other."""
        return {name: ("1", values[0]) for name, values in self.damping.values.items() if name == "loss_factor"}

    @property
    def spans(self) -> int | None:
        """Equal spans between the numbered points of a straight beam; None for other structures."""
        return None

    def absent(self, label: str) -> Absence | None:
        """What the structure says of a DOF that does not exist; None where it does."""
        try:
            self._free.require_dof(label)
        except ModelError as error:
            return error.words
        return None

    def _sensors(self, loaded: tuple[str, ...]) -> dict[str, Any]:
        """Accelerometers and where they sit, as recipes have them."""
        return {"accelerometer_mass": self.accelerometer_mass_g * 1e-3, "accelerometer_dofs": loaded}

    @abstractmethod
    def recipe(self, loaded: tuple[str, ...]) -> structures.StructureRecipe:
        """The structure; `loaded` are the DOFs at which accelerometers sit."""

    def try_objects(self) -> None:
        """The structure, whose supports are judged with all DOFs that a case names."""
        _ = self._free

    def place(self, label: str) -> str:
        """Where a DOF is, in words: its point, whose coordinates are in the file."""
        return f"point {label.rpartition(':')[0]}"


def force_stated(forces: Iterable[float]) -> dict[str, tuple[str, float]]:
    """Unit and value of axial forces in N on which one factor is: the force where all are one; none where all are 0."""
    each = set(forces)
    if each <= {0.0}:
        return {}
    low, high = min(each), max(each)
    one = ("N" if low > 0 else "N of compression", abs(low))
    return {"axial_force": one if low == high else ("× stated", 1.0)}


_BETWEEN_NODES = key_field(
    "further points between the nodes: name and distance from node 1 in mm, above 0, as { tip = 250.0 }",
    {"tip": 250.0},
    max_length=100,
)
_SHEAR = key_field('the shear coefficient, "cowper" or a number above 0 and at most 1', "cowper")
_ELEMENT = key_field(
    '"converged" (elements so fine that no mesh shows) or "paper" (its two-node elements, one for each span)',
    "converged",
)


class BeamSpec(BeamsSpec, StructureBase):
    """The structure without its joint: a uniform Timoshenko beam along x, nodes counted from 1 at x = 0."""

    field_keys = {"points": "at_mm"}  # noqa: RUF012 (no field)

    kind: Annotated[Literal["beam"], KIND] = "beam"
    length_mm: float = positive("the length of the beam in mm", 383.0)
    elements: int = count_field("the number of equal spans between numbered points", 10, 1, 500, default=10)
    element: Annotated[Literal["converged", "paper"], _ELEMENT] = "converged"
    dofs_per_node: Literal[2, 5] = key_field("2 (y, rz) or 5 (x, y, z, ry, rz) DOFs per node", 2, 2)
    shear_coefficient: Annotated[Literal["cowper"] | Fraction, _SHEAR] = "cowper"
    at_mm: Annotated[dict[PointName, Positive], _BETWEEN_NODES] = {}  # noqa: RUF012 (pydantic copies it)
    section: SectionSpec
    damping: Annotated[LAWS, DAMPING]

    @property
    def directions(self) -> tuple[str, ...]:
        """Directions of the DOFs of each node."""
        return self._free.directions

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

    def place(self, label: str) -> str:
        """Where a node is along the beam."""
        return f"{1e3 * self._free.positions[label.rpartition(':')[0]][0]:.4g} mm"

    def recipe(self, loaded: tuple[str, ...]) -> structures.BeamRecipe:
        """The beam, with accelerometers where they sit."""
        material = structures.BeamMaterial(self.youngs_modulus_gpa * 1e9, self.poissons_ratio, self.density_kg_m3)
        kappa = None if self.shear_coefficient == "cowper" else float(self.shear_coefficient)
        points = tuple((name, place * 1e-3) for name, place in self.at_mm.items())
        length, section, law = self.length_mm * 1e-3, self.section.section, self.damping.built()
        nodes = self.elements, self.dofs_per_node, kappa, self.supports, self.axial_force_n, points
        made_of = (length, section, material, law, *nodes)
        return structures.BeamRecipe(*made_of, element=self.element, **self._sensors(loaded))


_GROUND = "ground"
_MOST_MASSES = 500  # of a chain, whose matrices are dense
_MOST = 2000  # points, members, masses, springs, rows of a matrix

_BETWEEN = key_field('the two masses, or a mass and "ground"', ["1", "2"])


class SpringSpec(Spec):
    """A spring between two masses, or between one and the ground."""

    between: Annotated[tuple[PointName, PointName], Strict(False), _BETWEEN]
    stiffness_n_per_m: float = not_negative("the stiffness in N/m", 1e5)


class DamperSpec(Spec):
    """A viscous damper between two masses, or between one and the ground."""

    between: Annotated[tuple[PointName, PointName], Strict(False), _BETWEEN]
    damping_n_s_per_m: float = not_negative("the damping constant in N s/m", 10.0)


class DampersSpec(DampingSpec):
    """Dampers between the masses of a chain."""

    law: Annotated[Literal["dampers"], LAW]
    dampers: Annotated[ListOf[DamperSpec], max_length(_MOST)] = Field(min_length=1, description="a list of dampers")


_Diagonal = Annotated[ListOf[float], max_length(_MOST)]
Matrix = Annotated[str | _Diagonal | Annotated[ListOf[ListOf[float]], max_length(_MOST)], AfterValidator(even)]
_MATRIX_TEXT = "a list of rows, a list of the diagonal, or the name of a .npy or .csv file"


class MatrixDampingSpec(DampingSpec):
    """Viscous damping by its matrix C."""

    field_keys = {"viscous_matrix": "damping_matrix"}  # noqa: RUF012 (no field)

    law: Annotated[Literal["matrix"], LAW]
    damping_matrix: Matrix = key_field(f"C in SI units (N s/m): {_MATRIX_TEXT}", "C.npy")

    def built(self) -> structures.ViscousMatrix:
        """The law of the matrix."""
        return structures.ViscousMatrix(_array(self.damping_matrix))

    def try_objects(self) -> None:
        """The law, once its file is read."""
        if not isinstance(self.damping_matrix, str):
            self.built()


class _RowsSpec(StructureBase):
    """A structure whose DOFs are the rows of its matrices, which may be in files that are not read yet."""

    if TYPE_CHECKING:  # a key, or what others say

        @property
        def dofs(self) -> tuple[str, ...]:
            """Labels of the rows."""

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
        return f'found "{label}", no DOF of [structure]', f"one of {listed(self.dofs)}", "correct the label"


class ChainSpec(_RowsSpec):
    """The structure without its joints: masses that move along one line, with springs between them."""

    kind: Annotated[Literal["chain"], KIND]
    masses_kg: Annotated[dict[str, Positive], max_length(_MOST_MASSES)] = table_field(
        "the masses in kg, each by its name or number", min_length=1
    )
    springs: Annotated[ListOf[SpringSpec], max_length(_MOST)] = table_field("a list of springs", ())
    direction: Direction = key_field("the direction of the DOFs", "x", "x")
    damping: Annotated[LAWS | DampersSpec, DAMPING]

    field_keys = {"dampers": "damping.dampers"}  # noqa: RUF012 (no field)

    @property
    def dofs(self) -> tuple[str, ...]:
        """One of each mass."""
        return tuple(f"{name}:{self.direction}" for name in self.masses_kg)

    @property
    def dampers(self) -> Sequence[DamperSpec]:
        """Dampers between masses; none under a damping law."""
        return self.damping.dampers if isinstance(self.damping, DampersSpec) else ()

    def place(self, label: str) -> str:
        """The mass itself."""
        return f"mass {label.rpartition(':')[0]}"

    def recipe(self, loaded: tuple[str, ...]) -> structures.MatrixRecipe:
        """The chain, with accelerometers where they sit."""
        springs = [(*spring.between, spring.stiffness_n_per_m) for spring in self.springs]
        dampers = [(*damper.between, damper.damping_n_s_per_m) for damper in self.dampers]
        law = None if dampers else self.damping.built()
        whole = structures.chain(self.masses_kg, springs, law, dampers=dampers, direction=self.direction)
        return replace(whole, supports=self.supports, **self._sensors(loaded))

    def _findings(self) -> Iterator[Finding]:
        for name in self.masses_kg:
            if not POINT.fullmatch(name) or name == _GROUND:
                expected = "a number from 1, or a word of letters, digits, _ and - other than ground"
                yield Finding(("masses_kg",), f'found the name "{name[:40]}"', expected, "rename the mass")


class MatricesSpec(_RowsSpec):
    """The structure without its joints, given by its stiffness and mass matrices."""

    kind: Annotated[Literal["matrices"], KIND]
    dofs: Annotated[Labels, Field(min_length=1)] = key_field("the DOF labels of the rows, in order", ["1:x", "2:x"])
    stiffness: Matrix = key_field(f"K in SI units (N/m): {_MATRIX_TEXT}", "K.npy")
    mass: Matrix = key_field(f"M in SI units (kg): {_MATRIX_TEXT}", "M.npy")
    points: dict[str, Vector] = table_field("the places of points in mm by their names, where they are known", {})
    damping: Annotated[LAWS | MatrixDampingSpec, DAMPING]

    field_keys = {"damping": "damping.damping_matrix"}  # noqa: RUF012 (no field)

    @property
    def matrices(self) -> dict[tuple[str, ...], Matrix]:
        """Its matrices by their keys below the table."""
        stated: dict[tuple[str, ...], Matrix] = {("stiffness",): self.stiffness, ("mass",): self.mass}
        if isinstance(self.damping, MatrixDampingSpec):
            stated["damping", "damping_matrix"] = self.damping.damping_matrix
        return stated

    def recipe(self, loaded: tuple[str, ...]) -> structures.MatrixRecipe:
        """The structure, with accelerometers where they sit."""
        places = {name: metres(place) for name, place in self.points.items()}
        made_of = _array(self.stiffness), _array(self.mass), self.dofs, self.damping.built(), self.supports, places
        return structures.MatrixRecipe(*made_of, **self._sensors(loaded))

    def try_objects(self) -> None:
        """The structure, once its files are read."""
        if not any(isinstance(matrix, str) for matrix in self.matrices.values()):
            super().try_objects()


def _array(matrix: Matrix) -> Array:
    import numpy as np

    array = np.array(matrix, dtype=float)
    return np.diag(array) if array.ndim == 1 else array


_VECTOR = "three numbers x, y, z"

_Points = Annotated[
    dict[str, Vector],
    Field(description=f"the points: for each its name or number and its place in mm, {_VECTOR}", max_length=_MOST),
]
_POINTS = key_field("the names of two points or more that the member runs through, in order", ["a", "b"])
_SHEARS = key_field(
    'the shear coefficient, "cowper", a number above 0 and at most 1, or two of them: along height and width', "cowper"
)
_Shears = Literal["cowper"] | Fraction | Annotated[tuple[Fraction, Fraction], Strict(False)]
_SECTION = Field(description="the cross-section: its shape and dimensions")
_END_SECTION = Field(description="the cross-section at the last point, of the same shape: dimensions change linearly")
_OFFSETS = key_field(
    f"from the first and from the last point to the member's axis in mm, two times {_VECTOR}",
    [[0.0, 5.0, 0.0], [0.0, 5.0, 0.0]],
)
_OFFSET = key_field(f"from the point to the centre of the mass in mm, {_VECTOR}", [0.0, 0.0, 10.0])
_INERTIA = key_field(
    "the moments of inertia about x, y, z in kg m2, three numbers, or six with xy, yz, xz", [1e-4, 2e-4, 2e-4]
)


class _Stuff(Spec):
    """Material, section and shear coefficient: those of a body or member where they differ from what it is part of."""

    youngs_modulus_gpa: Annotated[float | None, MODULUS] = None
    poissons_ratio: Annotated[float | None, POISSON] = None
    density_kg_m3: Annotated[float | None, DENSITY] = None
    shear_coefficient: Annotated[_Shears | None, _SHEARS] = None
    axial_force_n: Annotated[float | None, FORCE] = None
    section: Annotated[SectionSpec | None, _SECTION] = None


class MemberSpec(_Stuff):
    """A row of straight beams through points."""

    points: Annotated[ListOf[PointName], Field(min_length=2), max_length(_MOST), _POINTS]
    end_section: Annotated[SectionSpec | None, _END_SECTION] = None
    up: Vector | None = key_field(f"the direction in which the section's height lies, {_VECTOR}", [0.0, 1.0, 0.0], None)
    offsets_mm: Annotated[Annotated[tuple[Vector, Vector], Strict(False)] | None, _OFFSETS] = None

    def member(self, *around: _Stuff | FrameSpec) -> structures.Member:
        """The member; what it does not state is its body's, and what that does not state the frame's."""
        modulus, poisson, density, kappa, force, section = (
            next(value for owner in (self, *around) if (value := getattr(owner, key)) is not None)
            for key in _Stuff.model_fields
        )
        first, last = self.offsets_mm or ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        material, ends = structures.BeamMaterial(modulus * 1e9, poisson, density), (metres(first), metres(last))
        last_section = self.end_section.section if self.end_section else None
        shear = None if kappa == "cowper" else kappa
        return structures.Member(self.points, section.section, material, last_section, shear, self.up, ends, force)


class PointMassSpec(Spec):
    """A rigid mass at a point."""

    point: PointName = key_field("the name of a point", "tip")
    mass_kg: float = not_negative("the mass in kg", 0.5)
    inertia_kg_m2: Annotated[ListOf[float], max_length(6), _INERTIA] = (0.0, 0.0, 0.0)
    offset_mm: Annotated[Vector, _OFFSET] = (0.0, 0.0, 0.0)

    def built(self) -> structures.PointMass:
        """The mass."""
        return structures.PointMass(self.point, self.mass_kg, self.inertia_kg_m2, metres(self.offset_mm))


_Members = Annotated[
    ListOf[MemberSpec],
    max_length(_MOST),
    Field(description="a list of members: each a table with points and, where it differs, section and material"),
]
_Masses = Annotated[ListOf[PointMassSpec], max_length(_MOST), Field(description="a list of masses at points")]


class BodySpec(_Stuff):
    """Members that hold together; without a list of members one through all points in the order in which they stand."""

    points: _Points
    members: _Members = ()
    masses: _Masses = ()

    def body(self, frame: _Stuff | FrameSpec) -> structures.FrameBody:
        """The body, in a frame that states what it does not."""
        members = self.members or (MemberSpec(points=tuple(self.points)),)
        places = tuple((name, metres(place)) for name, place in self.points.items())
        return structures.FrameBody(
            places, tuple(m.member(self, frame) for m in members), tuple(m.built() for m in self.masses)
        )


class BesideSpec(BeamsSpec, BodySpec):  # type: ignore[misc]  # what a body may leave out it must state
    """A body of beams next to an imported model; joints alone connect the two."""

    shear_coefficient: Annotated[_Shears, _SHEARS] = "cowper"
    section: Annotated[SectionSpec, _SECTION]

    def built(self) -> structures.FrameBody:
        """The body."""
        return self.body(self)


class FrameSpec(BeamsSpec, StructureBase):
    """The structure without its joints: Timoshenko beams in space, one body or several that joints alone connect."""

    kind: Annotated[Literal["frame"], KIND]
    directions: Annotated[ListOf[Direction], Field(min_length=1), AfterValidator(distinct), max_length(6)] = key_field(
        "the directions in which points move, some of x, y, z, rx, ry, rz", ["x", "y", "rz"], DIRECTIONS
    )
    element: Annotated[Literal["converged", "paper"], _ELEMENT] = "converged"
    shear_coefficient: Annotated[_Shears, _SHEARS] = "cowper"
    section: Annotated[SectionSpec | None, _SECTION] = None
    points: _Points = {}  # noqa: RUF012 (pydantic copies it)
    members: _Members = ()
    masses: _Masses = ()
    bodies: dict[Word, BodySpec] = table_field("a table for each body, as [structure.bodies.tool]", {}, max_length=100)
    damping: Annotated[LAWS, DAMPING]

    @property
    def all_bodies(self) -> dict[str, BodySpec]:
        """Bodies by their names; a single one may have none."""
        own = BodySpec.model_construct(points=self.points, members=self.members, masses=self.masses)
        return self.bodies or {"": own}

    @property
    def stated(self) -> dict[str, tuple[str, float]]:
        """Unit and value of each quantity that may be uncertain, of all bodies and of one; shares of what is stated.

        A length is one of straight bodies: in mm, but for one factor on those of several bodies that differ.
        """
        from jointbayes.structure.frame import line_length

        of_bodies = ("youngs_modulus", "density", "section_size", "shear_coefficient")
        names = [*of_bodies, *(f"{body}.{name}" for body in self.bodies for name in of_bodies)]
        stated = dict.fromkeys(names, ("× stated", 1.0)) | {"accelerometer_mass": ("g", self.accelerometer_mass_g)}
        bodies, places = self._free.bodies, {name: body.points.values() for name, body in self.all_bodies.items()}
        lengths = {n: length for n, body in bodies if body.straight and (length := line_length(places[n]))}
        if len(lengths) == len(bodies):
            low, high = min(lengths.values()), max(lengths.values())
            stated["length"] = ("mm", high) if math.isclose(low, high) else ("× stated", 1.0)
        stated |= {f"{name}.length": ("mm", length) for name, length in lengths.items() if name}
        forces = {name: [member.axial_force for member in body.members] for name, body in bodies}
        stated |= force_stated(itertools.chain(*forces.values()))
        stated |= {f"{n}.{q}": of for n, each in forces.items() if n for q, of in force_stated(each).items()}
        return stated | super().stated

    def recipe(self, loaded: tuple[str, ...]) -> structures.FrameRecipe:
        """The frame, with accelerometers where they sit."""
        bodies = tuple((name, body.body(self)) for name, body in self.all_bodies.items())
        made_of = bodies, self.damping.built(), self.directions, self.supports
        return structures.FrameRecipe(*made_of, element=self.element, **self._sensors(loaded))

    def try_objects(self) -> None:
        """Its bodies."""
        for name, body in self.all_bodies.items():
            try:
                body.body(self)
            except ModelError as error:
                error.key = ("bodies", name, *error.key) if name else error.key
                raise

    def _findings(self) -> Iterator[Finding]:
        """Yield bodies that are stated twice or not at all, or with a member without a section."""
        if self.bodies and (self.points or self.members or self.masses):
            key = "points" if self.points else "members" if self.members else "masses"
            fault = f"found {key} beside [structure.bodies.{next(iter(self.bodies))}]"
            yield Finding((key,), fault, "either points of one body here, or bodies", "move it into a body")
            return
        if not self.bodies and not self.points:
            yield Finding(("points",), missing=True)
            return
        for name, body in self.all_bodies.items():
            loc = ("bodies", name) if self.bodies else ()
            for i, member in enumerate(body.members or (None,)):
                if not (self.section or body.section or (member and member.section)):
                    where = (*loc, "members", i) if member else loc or ("section",)
                    expected = "a section of each member, or one of its body or of the frame for all"
                    remedy = 'add section = { shape = "circle", diameter_mm = 25.0 }'
                    yield Finding(where, "no section", expected, remedy)


_MOST_NODE = 1_000_000_000


class PortSpec(Spec):
    """Where joints or sensors hold an imported model: a node, or a patch of nodes that moves as one."""

    node: int | None = count_field("the number of a node", 1021, 1, _MOST_NODE, default=None)
    nodes: Annotated[ListOf[Annotated[int, Field(ge=1, le=_MOST_NODE)]], max_length(100_000)] = key_field(
        f"a list of node numbers from 1 to {_MOST_NODE}, a patch", [7, 8, 9], ()
    )
    box_mm: Annotated[tuple[Vector, Vector] | None, Strict(False)] = key_field(
        "two opposite corners in mm of a box: all nodes in it", [[-0.1, 0, 0], [0.1, 30, 20]], None
    )
    kind: Literal["averaged", "rigid"] = key_field(
        'how a patch moves, "averaged" (RBE3, stiffens nothing) or "rigid" (RBE2)', "averaged", "averaged"
    )
    at_mm: Annotated[Vector | None, Strict(False)] = key_field(
        "the place of the point whose motion it is in mm, without it the mean place of its nodes", [0, 0, 0], None
    )

    def _findings(self) -> Iterator[Finding]:
        given = [key for key in ("node", "nodes", "box_mm") if getattr(self, key) not in (None, ())]
        if len(given) != 1:
            found = f"found {' and '.join(given) or 'none of node, nodes, box_mm'}"
            yield Finding((given[-1],) if given else (), found, "one of node, nodes and box_mm", "state one of them")


class PartSpec(Spec):
    """A part of an imported model whose modulus, density or thickness is uncertain: an export of that part alone."""

    file: str = key_field("the file of the part's own K and M, on DOFs of the whole model", "wall.npz")
    mass_file: str | None = key_field("the file of its M, where that is another", "wall.mas", None)
    bending_file: str | None = key_field(
        "the file of the share of its K that grows with thickness³", "wall_bending.npz", None
    )


class ModelDampingSpec(DampingSpec):
    """Viscous damping by the matrix C of the model's files."""

    law: Literal["model"] = Field(description="the damping matrix of the model's files")


class ImportedSpec(StructureBase):
    """The structure without its joints, imported from a finite-element program."""

    kind: Annotated[Literal["imported"], KIND]
    file: str = key_field("the file of the model, or of its stiffness matrix", "bracket.npz")
    mass_file: str | None = key_field("the file of the mass matrix, where it has its own", "bracket.mas", None)
    damping_file: str | None = key_field("the file of the damping matrix C, if any", "bracket.dmp", None)
    dofs_file: str | None = key_field("the file that says which node and direction each row is", "bracket.dof", None)
    nodes_file: str | None = key_field("the file with the places of the nodes", "bracket.inp", None)
    length_unit: Literal["m", "mm", "in", "ft"] = key_field(
        'the units of its files, by the length: "m" (N, kg), "mm" (N, t), "in" (lbf) or "ft" (lbf)', "mm"
    )
    top_hz: float | None = positive(
        "the frequency in Hz up to which it is reduced, by itself that of the data", 3000.0, None
    )
    ports: dict[Word, PortSpec] = table_field("a table for each port, as [structure.ports.tip]", {}, max_length=1000)
    parts: dict[Word, PartSpec] = table_field("a table for each part that may be uncertain", {}, max_length=100)
    bodies: dict[Word, BesideSpec] = table_field(
        "a table for each body of beams beside the model, as [structure.bodies.tool]", {}, max_length=100
    )
    damping: Annotated[LAWS | ModelDampingSpec, DAMPING]

    _reduced: ImportedRecipe | None = PrivateAttr(default=None)

    def with_reduced(self, recipe: ImportedRecipe) -> ImportedSpec:
        """The table with its files read and the model reduced."""
        same = self.model_copy()
        same._reduced = recipe
        return same

    @property
    def file_keys(self) -> dict[tuple[str, ...], str]:
        """Names of its files by their keys below the table."""
        own: dict[tuple[str, ...], str | None] = {
            (key,): getattr(self, key) for key in ("file", "mass_file", "damping_file", "dofs_file", "nodes_file")
        }
        for name, part in self.parts.items():
            own |= {("parts", name, key): getattr(part, key) for key in ("file", "mass_file", "bending_file")}
        return {key: name for key, name in own.items() if name is not None}

    @property
    def points_in_order(self) -> tuple[str, ...]:
        """Names of its ports, points of beams, and once it is reduced numbers of nodes that the case uses."""
        used = self._reduced.dofs if self._reduced is not None else ()
        beams = (f"{name}.{point}" for name, body in self.bodies.items() for point, _ in body.built().all_points)
        return tuple(dict.fromkeys([*self.ports, *beams, *(label.rpartition(":")[0] for label in used)]))

    @property
    def free_dofs(self) -> int:
        """More than anyone measures."""
        return 1_000_000

    @property
    def stated(self) -> dict[str, tuple[str, float]]:
        """Unit and value of each quantity that may be uncertain."""
        quantities = ("youngs_modulus", "density", "thickness")
        names = ["youngs_modulus", "density", *(f"{part}.{q}" for part in self.parts for q in quantities)]
        names += [f"{body}.{q}" for body in self.bodies for q in quantities[:2]]
        stated = dict.fromkeys(names, ("× stated", 1.0))
        return stated | {"accelerometer_mass": ("g", self.accelerometer_mass_g)} | super().stated

    def absent(self, label: str) -> Absence | None:
        """What to say of a DOF that does not exist; of a node that is not read yet nothing."""
        point, names = label.rpartition(":")[0], self.points_in_order
        if point not in names and not point.isdecimal():
            expected = f"one of {listed(names)}, or the number of a node" if names else "the number of a node"
            remedy = f"add [structure.ports.{point}], or correct the name"
            return f'found "{label}": there is no port {point}', expected, remedy
        if self._reduced is not None and label not in (every := self._reduced.dofs):
            there = [dof for dof in every if dof.rpartition(":")[0] == point] or every
            return f'found "{label}": no such DOF in the model', f"one of {listed(there)}", "correct it"
        return None

    def place(self, label: str) -> str:
        """A port by its name, or a node by its number."""
        point = label.rpartition(":")[0]
        return f"port {point}" if point in self.ports else f"node {point}" if point.isdecimal() else f"point {point}"

    def recipe(self, loaded: tuple[str, ...]) -> ImportedRecipe:
        """The structure once it is reduced, with accelerometers where they sit."""
        assert self._reduced is not None
        law = self._reduced.damping if isinstance(self.damping, ModelDampingSpec) else self.damping.built()
        return replace(self._reduced, damping=law, **self._sensors(loaded))

    def try_objects(self) -> None:
        """Nothing: its files are not read yet."""

    def _findings(self) -> Iterator[Finding]:
        for name in self.parts.keys() & self.bodies.keys():
            fault = f'found the name "{name}", also that of a part'
            yield Finding(("bodies", name), fault, "one of its own", "rename it")
