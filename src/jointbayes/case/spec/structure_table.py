"""What the `[structure]` tables of all kinds of structure share: damping, sections, DOFs.

What computes is imported where it is built: a case is read and checked without NumPy.
"""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import BeforeValidator, Field, ValidatorFunctionWrapHandler, WrapValidator

from jointbayes.case.spec.fields import Finding, Labels, Ratios, Spec, key_field, listed, not_negative, positive
from jointbayes.case.toml_text import similar
from jointbayes.joint import DIRECTIONS

if TYPE_CHECKING:
    from jointbayes.structure import DampingLaw, Section, StructureRecipe

LAW = key_field('the damping law, "modal", "loss_factor" or "rayleigh"', "modal")
_RATIO = key_field("the damping ratio, a number from 0 to below 1 (0.01 is 1 %), or a list of them", 0.01)


def _or_measured(value: object, ratios: ValidatorFunctionWrapHandler) -> object:
    """No ratio where they are to be those that the data show."""
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

    def built(self) -> DampingLaw:
        """Modal damping."""
        from jointbayes.structure import ModalDamping

        return ModalDamping(self.ratio)


class LossFactorDampingSpec(DampingSpec):
    """Structural (hysteretic) damping, K(1 + jη)."""

    law: Annotated[Literal["loss_factor"], LAW]
    loss_factor: Annotated[float, not_negative("the structural loss factor", 0.01)]

    @property
    def values(self) -> dict[str, tuple[float, ...]]:
        """The loss factor."""
        return {"loss_factor": (self.loss_factor,)}

    def built(self) -> DampingLaw:
        """Structural damping."""
        from jointbayes.structure import LossFactor

        return LossFactor(self.loss_factor)


class RayleighDampingSpec(DampingSpec):
    """Viscous damping, C = alpha M + beta K."""

    law: Annotated[Literal["rayleigh"], LAW]
    alpha_per_s: Annotated[float, not_negative("the factor of the mass matrix in 1/s", 1.0)]
    beta_s: Annotated[float, not_negative("the factor of the stiffness matrix in s", 1e-6)]

    def built(self) -> DampingLaw:
        """Rayleigh damping."""
        from jointbayes.structure import Rayleigh

        return Rayleigh(self.alpha_per_s, self.beta_s)


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
    def section(self) -> Section:
        """The section that it describes."""
        from jointbayes.structure import Section

        return getattr(Section, self.shape)(*(size * 1e-3 for size in self.sizes_mm.values()))

    def try_objects(self) -> None:
        """The section."""
        _ = self.section


class CircleSpec(_ShapeSpec):
    """Solid circular cross-section."""

    shape: Annotated[Literal["circle"], _SHAPE]
    diameter_mm: Annotated[float, positive("the diameter in mm", 25.0)]


class TubeSpec(_ShapeSpec):
    """Circular tube."""

    shape: Annotated[Literal["tube"], _SHAPE]
    outer_diameter_mm: Annotated[float, positive("the outer diameter in mm", 40.0)]
    inner_diameter_mm: Annotated[float, positive("the inner diameter in mm", 30.0)]


class RectangleSpec(_ShapeSpec):
    """Solid rectangle; the height lies along y, the width along z."""

    shape: Annotated[Literal["rectangle"], _SHAPE]
    width_mm: Annotated[float, positive("the width (along z) in mm", 40.0)]
    height_mm: Annotated[float, positive("the height (along y) in mm", 20.0)]


class BoxSpec(_ShapeSpec):
    """Rectangular tube of constant wall."""

    shape: Annotated[Literal["box"], _SHAPE]
    width_mm: Annotated[float, positive("the outer width (along z) in mm", 40.0)]
    height_mm: Annotated[float, positive("the outer height (along y) in mm", 20.0)]
    wall_mm: Annotated[float, positive("the thickness of the wall in mm", 2.0)]


SectionSpec = Annotated[
    CircleSpec | TubeSpec | RectangleSpec | BoxSpec,
    Field(discriminator="shape", description="the cross-section: its shape and dimensions"),
]

KIND = key_field('the kind of structure, "beam", "frame", "chain", "matrices" or "imported"', "beam")
MODULUS, DENSITY = positive("Young's modulus in GPa", 210.0), positive("the density in kg/m³", 7800.0)
POISSON = Field(gt=-1, lt=0.5, description="Poisson's ratio, above -1 and below 0.5", examples=[0.3])
FORCE = key_field("the axial force at rest in N, tension positive, compression negative", 2000.0)
_SUPPORTS = key_field("a list of the DOFs held fixed", ["1:y"])
_MASS = not_negative("the mass in g added at each measured translation", 2.0)
if TYPE_CHECKING:
    Direction = str
else:
    Direction = Literal[DIRECTIONS]
#: Names of points: numbers from 1, or words.
POINT = re.compile(r"[1-9][0-9]{0,6}|[A-Za-z][A-Za-z0-9_-]{0,59}")


def _point_name(name: object) -> object:
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
    """What is asked of a structure's table, whatever its kind."""

    kind: Annotated[str, KIND]
    supports: Annotated[Labels, _SUPPORTS] = ()
    accelerometer_mass_g: Annotated[float, _MASS] = 0.0
    damping: Annotated[DampingSpec, Field(description="the damping")]

    if TYPE_CHECKING:  # a key of a frame, and of no other kind

        @property
        def directions(self) -> tuple[str, ...]:
            """Directions of the DOFs of each point."""

    @property
    @abstractmethod
    def points_in_order(self) -> tuple[str, ...]:
        """Names of all points, as they stand before the colon of a DOF label."""

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
        """What to say of a DOF that does not exist; None where it does."""
        point, _, direction = label.rpartition(":")
        names, ways = self.points_in_order, self.directions
        if point not in names:
            near = similar(point, names) or next((name for name in names if name.endswith(f".{point}")), "")
            remedy = f'did you mean "{near}:{direction}"?' if near else "correct the point"
            return f'"{label}": there is no point {point}', f"one of {listed(names)}", remedy
        if direction not in ways:
            return f'"{label}": no direction {direction}', f"one of {', '.join(ways)}", "choose one of these"
        return None

    @abstractmethod
    def recipe(self, loaded: tuple[str, ...]) -> StructureRecipe:
        """The structure; `loaded` are the DOFs at which accelerometers sit."""

    def try_objects(self) -> None:
        """The structure, as far as its damping is known."""
        if not self.damping.measured:
            self.recipe(())

    def place(self, label: str) -> str:
        """Where a DOF is, in words: its point, whose coordinates are in the file."""
        return f"point {label.rpartition(':')[0]}"

    def _findings(self) -> Iterator[Finding]:
        each = ((i, self.absent(label)) for i, label in enumerate(self.supports))
        yield from (Finding(("supports", i), *words) for i, words in each if words is not None)


def force_stated(forces: Iterable[float]) -> dict[str, tuple[str, float]]:
    """Unit and value of axial forces in N on which one factor is: the force where all are one; none where all are 0."""
    each = set(forces)
    if each <= {0.0}:
        return {}
    low, high = min(each), max(each)
    one = ("N" if low > 0 else "N of compression", abs(low))
    return {"axial_force": one if low == high else ("× stated", 1.0)}


def metres(millimetres: Iterable[float]) -> tuple[float, float, float]:
    """A vector in m from one in mm."""
    x, y, z = (number * 1e-3 for number in millimetres)
    return x, y, z
