"""The `[structure]` tables of frames, bodies of members between points, and of imported finite-element models."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, Field, PrivateAttr, Strict

from jointbayes.case.spec.fields import (
    Finding,
    Fraction,
    Spec,
    Word,
    count_field,
    distinct,
    key_field,
    listed,
    max_length,
    not_negative,
    positive,
)
from jointbayes.case.spec.structure_table import (
    DAMPING,
    DENSITY,
    FORCE,
    KIND,
    LAWS,
    MODULUS,
    POISSON,
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
from jointbayes.errors import ModelError
from jointbayes.joint import DIRECTIONS

if TYPE_CHECKING:
    from jointbayes.structure import FrameBody, FrameRecipe, ImportedRecipe, Member, PointMass

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
_ELEMENT = key_field(
    '"converged" (elements so fine that no mesh shows) or "paper" (its two-node elements)', "converged"
)
_DIRECTIONS = key_field("the directions in which points move, some of x, y, z, rx, ry, rz", ["x", "y", "rz"])


class _Stuff(Spec):
    """Material, section and shear coefficient: those of a body or member where they differ from what it is part of."""

    youngs_modulus_gpa: Annotated[float | None, MODULUS] = None
    poissons_ratio: Annotated[float | None, POISSON] = None
    density_kg_m3: Annotated[float | None, DENSITY] = None
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


class BesideSpec(BeamsSpec, BodySpec):  # type: ignore[misc]  # what a body may leave out it must state
    """A body of beams beside an imported model, which joints alone connect with it."""

    shear_coefficient: Annotated[_Shear, _SHEAR] = "cowper"
    section: Annotated[SectionSpec, _SECTION]

    def built(self) -> FrameBody:
        """The body."""
        return self.body(self)


def numbers_between(first: str, second: str, names: Mapping[str, object]) -> list[str]:
    """Numbers between two points that have numbers, if none of them is a point of its own: equally spaced points."""
    if not (first.isdecimal() and second.isdecimal()) or abs(int(first) - int(second)) > 10_000:
        return []
    low, high = sorted((int(first), int(second)))
    between = [str(number) for number in range(low + 1, high)]
    return [] if any(name in names for name in between) else between


class FrameSpec(BeamsSpec, StructureBase):
    """The structure without its joints: Timoshenko beams in space, one body or several that joints alone connect."""

    kind: Annotated[Literal["frame"], KIND]
    directions: Annotated[
        tuple[Direction, ...], Strict(False), Field(min_length=1), AfterValidator(distinct), max_length(6), _DIRECTIONS
    ] = DIRECTIONS
    element: Annotated[Literal["converged", "paper"], _ELEMENT] = "converged"
    shear_coefficient: Annotated[_Shear, _SHEAR] = "cowper"
    section: Annotated[SectionSpec | None, _SECTION] = None
    points: _Points = {}  # noqa: RUF012 (pydantic copies it)
    members: _Members = ()
    masses: _Masses = ()
    bodies: Annotated[
        dict[Word, BodySpec], Field(description="a table for each body, as [structure.bodies.tool]", max_length=100)
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
        """Yield bodies that are stated twice or not at all, or with a member without a section."""
        yield from super()._findings()
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
                    yield Finding(
                        where, "no section", expected, 'add section = { shape = "circle", diameter_mm = 25.0 }'
                    )


_MOST_NODE = 1_000_000_000
_Node = Annotated[int, Field(ge=1, le=_MOST_NODE)]
_Corner = Annotated[tuple[float, float, float], Strict(False)]
_Vector = key_field(
    "the place of the point whose motion it is in mm, without it the mean place of its nodes", [0, 0, 0]
)


class PortSpec(Spec):
    """Where joints or sensors hold an imported model: a node, or a patch of nodes that moves as one."""

    node: Annotated[int | None, count_field("the number of a node", 1021, 1, _MOST_NODE)] = None
    nodes: Annotated[
        tuple[_Node, ...],
        Strict(False),
        max_length(100_000),
        key_field(f"a list of node numbers from 1 to {_MOST_NODE}, a patch", [7, 8, 9]),
    ] = ()
    box_mm: Annotated[
        tuple[_Corner, _Corner] | None,
        Strict(False),
        key_field("two opposite corners in mm of a box: all nodes in it", [[-0.1, 0, 0], [0.1, 30, 20]]),
    ] = None
    kind: Annotated[
        Literal["averaged", "rigid"],
        key_field('how a patch moves, "averaged" (RBE3, stiffens nothing) or "rigid" (RBE2)', "averaged"),
    ] = "averaged"
    at_mm: Annotated[_Corner | None, Strict(False), _Vector] = None

    def _findings(self) -> Iterator[Finding]:
        given = [key for key in ("node", "nodes", "box_mm") if getattr(self, key) not in (None, ())]
        if len(given) != 1:
            found = f"found {' and '.join(given) or 'none of node, nodes, box_mm'}"
            yield Finding((given[-1],) if given else (), found, "one of node, nodes and box_mm", "state one of them")


class PartSpec(Spec):
    """A part of an imported model whose modulus, density or thickness is uncertain: an export of that part alone."""

    file: Annotated[str, key_field("the file of the part's own K and M, on DOFs of the whole model", "wall.npz")]
    mass_file: Annotated[str | None, key_field("the file of its M, where that is another", "wall.mas")] = None
    bending_file: Annotated[
        str | None, key_field("the file of the share of its K that grows with thickness³", "wall_bending.npz")
    ] = None


class ModelDampingSpec(DampingSpec):
    """Viscous damping by the matrix C of the model's files."""

    law: Annotated[Literal["model"], Field(description="the damping matrix of the model's files")]


class ImportedSpec(StructureBase):
    """The structure without its joints, imported from a finite-element program."""

    kind: Annotated[Literal["imported"], KIND]
    file: Annotated[str, key_field("the file of the model, or of its stiffness matrix", "bracket.npz")]
    mass_file: Annotated[str | None, key_field("the file of the mass matrix, where it has its own", "bracket.mas")] = (
        None
    )
    damping_file: Annotated[str | None, key_field("the file of the damping matrix C, if any", "bracket.dmp")] = None
    dofs_file: Annotated[
        str | None, key_field("the file that says which node and direction each row is", "bracket.dof")
    ] = None
    nodes_file: Annotated[str | None, key_field("the file with the places of the nodes", "bracket.inp")] = None
    length_unit: Annotated[
        Literal["m", "mm", "in"],
        key_field('the unit of length of its files: "m" (N, kg), "mm" (N, t) or "in" (lbf)', "m"),
    ] = "m"
    top_hz: Annotated[
        float | None, positive("the frequency in Hz up to which it is reduced, by itself that of the data", 3000.0)
    ] = None
    ports: Annotated[
        dict[Word, PortSpec], Field(description="a table for each port, as [structure.ports.tip]", max_length=1000)
    ] = {}  # noqa: RUF012 (pydantic copies it)
    parts: Annotated[
        dict[Word, PartSpec], Field(description="a table for each part that may be uncertain", max_length=100)
    ] = {}  # noqa: RUF012
    bodies: Annotated[
        dict[Word, BesideSpec],
        Field(
            description="a table for each body of beams beside the model, as [structure.bodies.tool]", max_length=100
        ),
    ] = {}  # noqa: RUF012
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
        beams = (f"{name}.{point}" for name, body in self.bodies.items() for point in body.all_points)
        return tuple(dict.fromkeys([*self.ports, *beams, *(label.rpartition(":")[0] for label in used)]))

    @property
    def directions(self) -> tuple[str, ...]:
        """Those of its nodes and ports, as far as it has been read."""
        if self._reduced is None:
            return DIRECTIONS
        there = {label.rpartition(":")[2] for label in self._reduced.dofs}
        return tuple(way for way in DIRECTIONS if way in there)

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
        point, _, direction = label.rpartition(":")
        names = self.points_in_order
        if point not in names and not point.isdecimal():
            expected = f"one of {listed(names)}, or the number of a node" if names else "the number of a node"
            return (
                f'"{label}": there is no port {point}',
                expected,
                f"add [structure.ports.{point}], or correct the name",
            )
        if direction not in DIRECTIONS:
            return f'"{label}": no direction {direction}', f"one of {', '.join(DIRECTIONS)}", "choose one of these"
        if self._reduced is not None and label not in self._reduced.dofs:
            ways = [dof for dof in self._reduced.dofs if dof.rpartition(":")[0] == point]
            return f'"{label}": no such DOF in the model', f"one of {listed(ways or self._reduced.dofs)}", "correct it"
        return None

    def place(self, label: str) -> str:
        """A port by its name, or a node by its number."""
        point = label.rpartition(":")[0]
        return f"port {point}" if point in self.ports else f"node {point}" if point.isdecimal() else f"point {point}"

    def recipe(self, loaded: tuple[str, ...]) -> ImportedRecipe:
        """The structure once it is reduced, with accelerometers where they sit."""
        from dataclasses import replace

        assert self._reduced is not None
        masses = {"accelerometer_mass": self.accelerometer_mass_g * 1e-3, "accelerometer_dofs": loaded}
        if isinstance(self.damping, ModelDampingSpec):
            return replace(self._reduced, **masses)  # type: ignore[arg-type]
        return replace(self._reduced, damping=self.damping.built(), **masses)  # type: ignore[arg-type]

    def try_objects(self) -> None:
        """The structure, once its files are read."""
        if self._reduced is not None:
            super().try_objects()

    def _findings(self) -> Iterator[Finding]:
        for name in self.parts.keys() & self.bodies.keys():
            yield Finding(
                ("bodies", name), f'found the name "{name}", also that of a part', "one of its own", "rename it"
            )
        yield from super()._findings()
