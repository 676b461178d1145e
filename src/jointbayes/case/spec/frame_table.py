"""The `[structure]` table of a frame: bodies of members between points in space."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, Strict

from jointbayes.case.spec.fields import Finding, Fraction, Spec, key_field, max_length, not_negative, positive
from jointbayes.case.spec.structure_table import (
    DAMPING,
    FORCE,
    KIND,
    LAWS,
    POINT,
    POISSON,
    PointName,
    SectionSpec,
    StructureBase,
    force_stated,
    metres,
)
from jointbayes.errors import ModelError
from jointbayes.joint import DIRECTIONS

if TYPE_CHECKING:
    from jointbayes.structure import FrameBody, FrameRecipe, Member, PointMass

_MOST = 2000  # points, members and masses
_VECTOR = "three numbers x, y, z"

_Place = Annotated[tuple[float, float, float], Strict(False)]
_Points = Annotated[
    dict[str, _Place],
    Field(description=f"the points: for each its name or number and its place in mm, {_VECTOR}", max_length=_MOST),
]
_POINTS = key_field("the names of two points or more that the member runs through, in order", ["a", "b"])
_SHEAR = key_field(
    'the shear coefficient, "cowper", a number above 0 and at most 1, or two of them: along height and width', "cowper"
)
_Shear = Literal["cowper"] | Fraction | Annotated[tuple[Fraction, Fraction], Strict(False)]
_SECTION = Field(description="the cross-section: its shape and dimensions")
_END_SECTION = Field(description="the cross-section at the last point, of the same shape: dimensions change linearly")
_UP = key_field(f"the direction in which the section's height lies, {_VECTOR}", [0.0, 1.0, 0.0])
_OFFSETS = key_field(
    f"from the first and from the last point to the member's axis in mm, two times {_VECTOR}",
    [[0.0, 5.0, 0.0], [0.0, 5.0, 0.0]],
)
_OFFSET = key_field(f"from the point to the centre of the mass in mm, {_VECTOR}", [0.0, 0.0, 10.0])
_INERTIA = key_field(
    "the moments of inertia about x, y, z in kg m2, three numbers, or six with xy, yz, xz", [1e-4, 2e-4, 2e-4]
)
_E, _RHO = positive("Young's modulus in GPa", 210.0), positive("the density in kg/m³", 7800.0)
_ELEMENT = key_field(
    '"converged" (elements so fine that no mesh shows) or "paper" (its two-node elements)', "converged"
)
_DIRECTIONS = key_field("the directions in which points move, some of x, y, z, rx, ry, rz", ["x", "y", "rz"])


class _Stuff(Spec):
    """Material, section and shear coefficient: those of a body or member where they differ from what it is part of."""

    youngs_modulus_gpa: Annotated[float | None, _E] = None
    poissons_ratio: Annotated[float | None, POISSON] = None
    density_kg_m3: Annotated[float | None, _RHO] = None
    shear_coefficient: Annotated[_Shear | None, _SHEAR] = None
    axial_force_n: Annotated[float | None, FORCE] = None
    section: Annotated[SectionSpec | None, _SECTION] = None


class MemberSpec(_Stuff):
    """A row of straight beams through points."""

    points: Annotated[tuple[PointName, ...], Strict(False), Field(min_length=2), max_length(_MOST), _POINTS]
    end_section: Annotated[SectionSpec | None, _END_SECTION] = None
    up: Annotated[_Place | None, _UP] = None
    offsets_mm: Annotated[Annotated[tuple[_Place, _Place], Strict(False)] | None, _OFFSETS] = None

    def member(self, *around: _Stuff | FrameSpec) -> Member:
        """The member; what it does not state is its body's, and what that does not state the frame's."""
        from jointbayes.structure import BeamMaterial, Member

        modulus, poisson, density, kappa, force, section = (
            next(value for owner in (self, *around) if (value := getattr(owner, key)) is not None)
            for key in _Stuff.model_fields
        )
        first, last = self.offsets_mm or ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        return Member(
            self.points,
            section.section,
            BeamMaterial(modulus * 1e9, poisson, density),
            self.end_section.section if self.end_section else None,
            None if kappa == "cowper" else kappa,
            self.up,
            (metres(first), metres(last)),
            force,
        )


class PointMassSpec(Spec):
    """A rigid mass at a point."""

    point: Annotated[PointName, key_field("the name of a point", "tip")]
    mass_kg: Annotated[float, not_negative("the mass in kg", 0.5)]
    inertia_kg_m2: Annotated[tuple[float, ...], Strict(False), max_length(6), _INERTIA] = (0.0, 0.0, 0.0)
    offset_mm: Annotated[_Place, _OFFSET] = (0.0, 0.0, 0.0)

    def built(self) -> PointMass:
        """The mass."""
        from jointbayes.structure import PointMass

        return PointMass(self.point, self.mass_kg, self.inertia_kg_m2, metres(self.offset_mm))

    def try_objects(self) -> None:
        """The mass."""
        self.built()


_Members = Annotated[
    tuple[MemberSpec, ...],
    Strict(False),
    max_length(_MOST),
    Field(description="a list of members: each a table with points and, where it differs, section and material"),
]
_Masses = Annotated[
    tuple[PointMassSpec, ...], Strict(False), max_length(_MOST), Field(description="a list of masses at points")
]


class BodySpec(_Stuff):
    """Members that hold together; without a list of members one through all points in the order in which they stand."""

    points: _Points
    members: _Members = ()
    masses: _Masses = ()

    @property
    def rows(self) -> tuple[tuple[str, ...], ...]:
        """Points of each member."""
        return tuple(member.points for member in self.members) or (tuple(self.points),)

    @property
    def all_points(self) -> tuple[str, ...]:
        """Names of all points, those that members count through among them."""
        counted = (
            n for row in self.rows for a, b in itertools.pairwise(row) for n in numbers_between(a, b, self.points)
        )
        return tuple(dict.fromkeys([*self.points, *counted]))

    @property
    def length_mm(self) -> float | None:
        """Length of a straight body; None where members lie in several directions, or offsets or inertias stick out."""
        from jointbayes.structure.frame import line_length  # NumPy waits until a case needs it

        offsets = (offset for member in self.members for offset in member.offsets_mm or ())
        sticking_out = (*offsets, *(number for mass in self.masses for number in (mass.inertia_kg_m2, mass.offset_mm)))
        return None if any(map(any, sticking_out)) else line_length(self.points.values())

    def forces_n(self, frame: FrameSpec) -> list[float]:
        """Axial force of each member."""
        own = [member.axial_force_n for member in self.members] or [None]
        around = frame.axial_force_n if self.axial_force_n is None else self.axial_force_n
        return [around if force is None else force for force in own]

    def body(self, frame: _Stuff | FrameSpec) -> FrameBody:
        """The body, in a frame that states what it does not."""
        from jointbayes.structure import FrameBody

        members = self.members or (MemberSpec(points=tuple(self.points)),)
        places = tuple((name, metres(place)) for name, place in self.points.items())
        return FrameBody(places, tuple(m.member(self, frame) for m in members), tuple(m.built() for m in self.masses))


def numbers_between(first: str, second: str, names: Mapping[str, object]) -> list[str]:
    """Numbers between two points that have numbers, if none of them is a point of its own: equally spaced points."""
    if not (first.isdecimal() and second.isdecimal()) or abs(int(first) - int(second)) > 10_000:
        return []
    low, high = sorted((int(first), int(second)))
    between = [str(number) for number in range(low + 1, high)]
    return [] if any(name in names for name in between) else between


class FrameSpec(StructureBase):
    """The structure without its joints: Timoshenko beams in space, one body or several that joints alone connect."""

    kind: Annotated[Literal["frame"], KIND]
    directions: Annotated[tuple[str, ...], Strict(False), Field(min_length=1), max_length(6), _DIRECTIONS] = DIRECTIONS
    element: Annotated[Literal["converged", "paper"], _ELEMENT] = "converged"
    youngs_modulus_gpa: Annotated[float, _E]
    poissons_ratio: Annotated[float, POISSON] = 0.3
    density_kg_m3: Annotated[float, _RHO]
    shear_coefficient: Annotated[_Shear, _SHEAR] = "cowper"
    axial_force_n: Annotated[float, FORCE] = 0.0
    section: Annotated[SectionSpec | None, _SECTION] = None
    points: _Points = {}  # noqa: RUF012 (pydantic copies it)
    members: _Members = ()
    masses: _Masses = ()
    bodies: Annotated[
        dict[str, BodySpec], Field(description="a table for each body, as [structure.bodies.tool]", max_length=100)
    ] = {}  # noqa: RUF012
    damping: Annotated[LAWS, DAMPING]

    @property
    def all_bodies(self) -> dict[str, BodySpec]:
        """Bodies by their names; a single one may have none."""
        return self.bodies or {
            "": BodySpec.model_construct(points=self.points, members=self.members, masses=self.masses)
        }

    @property
    def points_in_order(self) -> tuple[str, ...]:
        """Names of all points, with that of their body."""
        return tuple(
            f"{name}.{point}" if name else point for name, body in self.all_bodies.items() for point in body.all_points
        )

    @property
    def stated(self) -> dict[str, tuple[str, float]]:
        """Unit and value of each quantity that may be uncertain, of all bodies and of one; shares of what is stated.

        A length is one of straight bodies: in mm, but for one factor on those of several bodies that differ.
        """
        of_bodies = ("youngs_modulus", "density", "section_size", "shear_coefficient")
        names = [*of_bodies, *(f"{body}.{name}" for body in self.bodies for name in of_bodies)]
        stated = dict.fromkeys(names, ("× stated", 1.0)) | {"accelerometer_mass": ("g", self.accelerometer_mass_g)}
        lengths = {name: length for name, body in self.all_bodies.items() if (length := body.length_mm) is not None}
        if len(lengths) == len(self.all_bodies):
            low, high = min(lengths.values()), max(lengths.values())
            stated["length"] = ("mm", high) if math.isclose(low, high) else ("× stated", 1.0)
        stated |= {f"{name}.length": ("mm", length) for name, length in lengths.items() if name}
        forces = {name: body.forces_n(self) for name, body in self.all_bodies.items()}
        stated |= force_stated(itertools.chain(*forces.values()))
        stated |= {f"{n}.{q}": of for n, each in forces.items() if n for q, of in force_stated(each).items()}
        return stated | super().stated

    def recipe(self, loaded: tuple[str, ...]) -> FrameRecipe:
        """The frame, with accelerometers where they sit."""
        from jointbayes.structure import FrameRecipe

        return FrameRecipe(
            tuple((name, body.body(self)) for name, body in self.all_bodies.items()),
            self.damping.built(),
            self.directions,
            self.supports,
            self.accelerometer_mass_g * 1e-3,
            accelerometer_dofs=loaded,
            element=self.element,
        )

    def try_objects(self) -> None:
        """Its bodies."""
        for name, body in self.all_bodies.items():
            try:
                body.body(self)
            except ModelError as error:
                error.key = ("bodies", name, *error.key) if name else error.key
                raise

    def _findings(self) -> Iterator[Finding]:
        yield from self._geometry_findings()
        for i, direction in enumerate(self.directions):
            if direction not in DIRECTIONS or direction in self.directions[:i]:
                yield Finding(("directions", i), f'found "{direction[:40]}"', "", "each direction once")
        yield from super()._findings()

    def _geometry_findings(self) -> Iterator[Finding]:
        """Yield bodies that are stated twice or not at all, misnamed, or with a member without a section."""
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
            if name and (not POINT.fullmatch(name) or name[0].isdecimal()):
                fault, expected = f'found the name "{name[:40]}"', "a word of letters, digits, _ and -"
                yield Finding(loc, fault, f"{expected} that begins with a letter", "rename the body")
            for i, member in enumerate(body.members or (None,)):
                if not (self.section or body.section or (member and member.section)):
                    where = (*loc, "members", i) if member else loc or ("section",)
                    expected = "a section of each member, or one of its body or of the frame for all"
                    yield Finding(
                        where, "no section", expected, 'add section = { shape = "circle", diameter_mm = 25.0 }'
                    )
