"""Frames as recipes: everything their matrices are made from, each quantity open to a factor.

A uniform straight beam is a frame of one member along x, in one plane or in two and along its axis. A user numbers its
equally spaced points. The elements between them are an inner matter: their ends lie at the joint, supports,
accelerometers, measured and excited points only, and their number and order follow from the highest line,
so rich that no mesh shows below it.

References
----------
Ainsworth, M. (2004). Discrete dispersion relation for hp-version finite element approximation at high wave number.
SIAM Journal on Numerical Analysis 42(2), 553-575. DOI 10.1137/S0036142903423460 (how an element's error falls).
"""

import bisect
import itertools
import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from numbers import Integral
from operator import itemgetter
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np
from scipy import linalg

from jointbayes.errors import ModelError, similar
from jointbayes.structure.damping import DampingLaw
from jointbayes.structure.frame import SPATIAL, FrameBody, Member, Vector, line_length
from jointbayes.structure.frame_element import (
    FIELDS,
    BodyFactors,
    Stretch,
    end_transformation,
    mass_matrix,
    part_matrices,
)
from jointbayes.structure.matrices import Structure
from jointbayes.structure.recipe import HALF_WAVES, Recipe, in_unit
from jointbayes.structure.section import BeamMaterial, Section
from vibrecords.arrays import Array, Indices, convert_fields
from vibrecords.errors import printable

_ORDERS = (10, 8, 7, 6, 5, 4, 3)  # the highest first: it bounds how many elements the others may take
_MOST_ELEMENTS = 4096  # between two points: beyond, the frequency asked for is no beam's
_RICHER = 4  # orders by which the element is richer that another is compared with
#: Largest relative error of an element's strain and kinetic energy: eigenvalues are as exact, an FRF's peak to this
#: over the damping ratio.
ACCURACY = 2e-10
#: Of so many segments and more elements are so short that none needs to be as rich as that bound makes them.
MANY = 32
_VISIBLE_OF_MANY = 1 / 64  # of the ω at which an element's error shows: still far above rounding
_AT_REST = 1e-9  # of a unit motion
_ROUNDING = 2000.0  # of machine epsilon times κGA l²/EI: what condensing a thin element was seen to leave


@dataclass(frozen=True, slots=True)
class Segment:
    """A straight beam between two points of a body.

    Parameters
    ----------
    points
        Their names.
    axes
        Local axes, one a row.
    offsets
        From each point to the beam's end, m.
    stretch
        What the beam is made of.
    """

    points: tuple[str, str]
    axes: tuple[Vector, Vector, Vector]
    offsets: tuple[Vector, Vector]
    stretch: Stretch


@dataclass(frozen=True, slots=True)
class BodyMesh:
    """Elements of a body: of each segment their number and order; order 0 is the paper's two-node element."""

    segments: tuple[Segment, ...]
    elements: tuple[tuple[int, int], ...]


def segments_of(body: FrameBody, used: Collection[str] | None = None) -> tuple[Segment, ...]:
    """The straight beams of a body, which end at its points.

    Parameters
    ----------
    body
        The body.
    used
        Of the points that only have their place by their number those where something acts or is observed; None: all.
    """
    segments, stretches = [], dict[object, Stretch]()
    for member in body.members:
        kept = [s for s in body.stations(member) if not s.numbered or used is None or s.point in used]
        for first, second in itertools.pairwise(kept):
            gap = np.subtract(second.place, first.place)
            end = member.end_section or member.section
            start, end = (member.section.between(end, share) for share in (first.share, second.share))
            length = float(np.linalg.norm(gap))
            stretch = Stretch(length, member.material, start, end, member.kappas, axial_force=member.axial_force)
            # equal spans are so to rounding, and become so to the last bit
            stretch = stretches.setdefault(replace(stretch, length=float(f"{length:.11g}")), stretch)
            x, y, z = ((float(a), float(b), float(c)) for a, b, c in member.axes(gap))
            segments.append(Segment((first.point, second.point), (x, y, z), (first.offset, second.offset), stretch))
    return tuple(segments)


def mesh_of(
    segments: Sequence[Segment],
    directions: Sequence[str],
    top_hz: float,
    kind: str,
    *,
    force: float = 1.0,
    richer: bool = False,
) -> BodyMesh:
    """Elements that are exact up to a frequency in Hz.

    Parameters
    ----------
    segments
        Straight beams of a body.
    directions
        Those of `SPATIAL` in which points move.
    kind
        What the body is, where a message begins.
    force
        Largest factor on axial forces.
    richer
        Whether elements are four orders richer than that takes, one where segments are many: for a reference.

    Raises
    ------
    ModelError
        If no number of elements is enough.
    """
    many = len(segments) >= MANY
    share, extra = (_VISIBLE_OF_MANY, 1) if many else (1.0, _RICHER)
    loaded = BodyFactors(axial_force=force)
    elements = []
    for segment in segments:
        fields = tuple(_turns(segment.axes, segment.offsets, tuple(directions), 2, True, True))
        elements.append(_cheapest(segment.stretch.scaled(loaded), fields, 2 * math.pi * top_hz, share, kind))
    return BodyMesh(tuple(segments), tuple((count, order + extra * richer) for count, order in elements))


@lru_cache(maxsize=1024)
def _turns(
    axes: tuple[Vector, Vector, Vector],
    offsets: tuple[Vector, Vector],
    directions: tuple[str, ...],
    nodes: int,
    first: bool,
    last: bool,
) -> dict[str, Array]:
    """Motions of an element of a segment in local axes from those of its nodes, by the fields that move.

    An element is the `first` or the `last` of its segment, at whose ends the offsets are.
    """
    free = [SPATIAL.index(direction) for direction in SPATIAL if direction in directions]
    arms = [np.zeros(3)] * nodes
    arms[0], arms[-1] = (np.array(o) * at_end for o, at_end in zip(offsets, (first, last), strict=True))
    motions = [end_transformation(np.array(axes), arm)[:, free] for arm in arms]
    turns = {field: linalg.block_diag(*(each[list(own)] for each in motions)) for field, own in FIELDS.items()}
    return {field: turn for field, turn in turns.items() if np.abs(turn).max() > _AT_REST}


@lru_cache(maxsize=1024)
def _cheapest(stretch: Stretch, fields: tuple[str, ...], omega: float, share: float, kind: str) -> tuple[int, int]:
    """Number of elements and order that are accurate enough for these motions up to ω and need the fewest nodes.

    Raises
    ------
    ModelError
        If none is.
    """
    at, bent = stretch.rigidities(np.array([0.0, 1.0])), [field for field in fields if len(FIELDS[field]) == 2]
    # shear strain is a difference of two slopes: in a thin beam rounding leaves no more of it than this
    slender = max((float(np.max(shear / bending)) for bending, shear, _ in map(at.bending, bent)), default=0.0)
    enough = max(ACCURACY, _ROUNDING * np.finfo(float).eps * slender * stretch.length**2)

    def accurate(order: int, elements: int) -> bool:
        # of a taper the first and the last element are the thinnest and the steepest
        ends = {0, elements - 1} if stretch.tapered else {0}
        parts = [stretch.part(i / elements, (i + 1) / elements) for i in ends]
        return all(element_error(piece, order, field, omega, share) <= enough for piece in parts for field in fields)

    best: tuple[int, int] | None = None
    for order in _ORDERS:
        most = _MOST_ELEMENTS if best is None else math.ceil(best[0] * best[1] / order) - 1
        doubled = (n for n in (2**k for k in range(13)) if n >= most or accurate(order, n))
        enough_of_them = next(doubled, most + 1)
        if enough_of_them > most or (enough_of_them == most and not accurate(order, most)):
            continue
        fewer = range(enough_of_them // 2 + 1, enough_of_them)
        best = fewer.start + bisect.bisect_left(fewer, True, key=partial(accurate, order)), order
    if best is None:
        found = f"found {stretch.length:g} m between points and a frequency of {omega / (2 * math.pi):g} Hz"
        expected = "one at which the wavelength is not thousands of times shorter"
        raise ModelError.of(f"{kind}", (), found, expected, "correct units of length, material or frequency")
    return best


def element_error(stretch: Stretch, order: int, field: str, omega: float, share: float = 1.0) -> float:
    """Largest relative error of an element's energy for motions that fall off as e^(−ωt), seen from its ends.

    Compared with an element of four orders more: K + ω²M of both, what lies between the ends condensed. An element is
    never too soft, so that the error has one sign; eigenvalues near ω² are off by no more than twice as much. Where
    the element is so short that rounding would hide the error it is taken at a higher ω and scaled down with ω²,
    which is more than is left of it at any order from 3 on; at a `share` of that ω the bound is closer. That of a
    taper, or of an element with an axial force, has a part that does not fall with ω, and is not scaled down with it.
    """
    length, rigid = stretch.length, stretch.rigidities(np.array([0.0, 1.0]))
    if len(FIELDS[field]) == 2:
        visible = np.max(np.sqrt(rigid.bending(field)[0] / rigid.mass)) / length**2  # a wave number of 1/length
    else:
        of_field = rigid.axial / rigid.mass if field == "axial" else rigid.torsion / rigid.polar
        visible = np.max(np.sqrt(of_field)) / length
    at, per_node = max(omega, share * float(visible)), len(FIELDS[field])
    of_ends: list[Array] = []
    for p in (order, order + _RICHER):  # K + ω²M, rotations times the length, seen from the two end nodes
        stiffness, mass = part_matrices(stretch, p, field)
        scale = np.tile([1.0, 1 / length][:per_node], len(mass) // per_node)
        dynamic = (stiffness + at**2 * mass) * np.outer(scale, scale)
        last, ends = len(dynamic) - per_node, 2 * per_node
        order_of = np.r_[:per_node, last : last + per_node, per_node:last]  # the ends first
        sorted_: Array = dynamic[order_of][:, order_of]
        within = np.linalg.solve(sorted_[ends:, ends:], sorted_[ends:, :ends])
        condensed: Array = sorted_[:ends, :ends] - sorted_[:ends, ends:] @ within
        of_ends.append((condensed + condensed.T) / 2)
    coarse, fine = of_ends
    try:
        error = float(np.abs(linalg.eigh(coarse - fine, fine, eigvals_only=True)).max())
    except linalg.LinAlgError:  # what rounding leaves of an absurd element is not positive definite
        return math.inf
    return error if stretch.tapered or stretch.axial_force else error * (omega / at) ** 2


def assembled(
    body: FrameBody,
    mesh: BodyMesh,
    factors: BodyFactors,
    loads: Iterable[tuple[str, float]],
    directions: tuple[str, ...],
) -> tuple[Array, Array, tuple[str, ...]]:
    """Stiffness and mass of a body with so many DOFs at each of its nodes, and the nodes' names, along each segment.

    Parameters
    ----------
    body, mesh, factors
        The body, its elements, and factors on its quantities.
    loads
        Points and the masses in kg that sit there, in addition to the body's.
    directions
        Those of `SPATIAL` in which points move, in its order.
    """
    nodes: dict[str, int] = {}
    made: dict[object, list[tuple[Array, Array]]] = {}
    elements: list[tuple[Indices, tuple[Array, Array]]] = []
    for number, (segment, (count, order)) in enumerate(zip(mesh.segments, mesh.elements, strict=True)):
        alike, each = (segment.stretch, segment.axes, segment.offsets, count, order), max(order, 1)
        if alike not in made:  # stiffness and mass of each element, DOFs those of the directions at each of its nodes
            stretch, at_nodes = segment.stretch.scaled(factors), each + 1
            all_alike = not stretch.tapered and not any(map(any, segment.offsets))
            matrices_of: list[tuple[Array, Array]] = []
            for i in range(1 if all_alike else count):
                piece = stretch.part(i / count, (i + 1) / count)
                turns = _turns(segment.axes, segment.offsets, directions, at_nodes, i == 0, i == count - 1)
                whole = np.zeros((2, at_nodes * len(directions), at_nodes * len(directions)))
                for field, turn in turns.items():
                    whole += turn.T @ np.stack(part_matrices(piece, order, field)) @ turn
                of_element = (whole + whole.swapaxes(1, 2)) / 2  # its turn leaves the last bits unsymmetric
                matrices_of.append((of_element[0], of_element[1]))
            made[alike] = matrices_of * count if all_alike else matrices_of
        first, last = segment.points
        names = (first, *(f"~{number}~{i}" for i in range(1, count * each)), last)
        along = np.array([nodes.setdefault(name, len(nodes)) for name in names])
        elements += [(along[i * each : (i + 1) * each + 1], matrices) for i, matrices in enumerate(made[alike])]
    per = len(directions)
    stiffness, mass = np.zeros((2, per * len(nodes), per * len(nodes)))

    def rows(at: Indices) -> tuple[Indices, Indices]:
        every = (per * at[:, None] + np.arange(per)).ravel()
        return every[:, None], every

    for at, (of_stiffness, of_mass) in elements:
        stiffness[rows(at)] += of_stiffness
        mass[rows(at)] += of_mass
    free = [SPATIAL.index(direction) for direction in directions]
    rigid = [(m.point, factors.masses * mass_matrix(m.mass, m.inertia_matrix, np.array(m.offset))) for m in body.masses]
    rigid += [(point, mass_matrix(load, np.zeros((3, 3)), np.zeros(3))) for point, load in loads]
    for point, heavy in rigid:
        mass[rows(np.array([nodes[point]]))] += heavy[np.ix_(free, free)]
    return stiffness, mass, tuple(nodes)


FrameMesh = tuple[BodyMesh, ...]
"""Elements of each body."""

#: Quantities that a body may have of its own, as ``"tool.density"``, or all bodies together: those of `BodyFactors`.
BODY_QUANTITIES = ("youngs_modulus", "density", "length", "section_size", "shear_coefficient", "axial_force")
_OF_ALL = ("accelerometer_mass", "damping_ratio", "loss_factor")
_BODY_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,59}")
_NAMED = 12  # points in a message
_HIGHEST_HZ = 1e20  # with squares and products that stay finite
_ONE = np.array(1.0)


class MemberRecipe(Recipe):
    """What recipes of straight members share, which make up one body or several: frames, and the beam of one member."""

    supports: tuple[str, ...]

    #: Beyond so many DOFs of one body, and nodes for each point, dense modes take minutes: units are mistaken.
    most_dofs: ClassVar[tuple[int, int]] = (2400, 0)
    most_are: ClassVar[str] = ""
    a_point: ClassVar[str] = "point"

    if TYPE_CHECKING:  # a property would be taken for the default value of a field

        @property
        def bodies(self) -> tuple[tuple[str, FrameBody], ...]:
            """Each body with its name."""

        @property
        def directions(self) -> tuple[str, ...]:
            """In which points move, some of `SPATIAL`."""

    @cached_property
    def positions(self) -> dict[str, Vector]:
        """Place of every point, m, by the name of its body and its own."""
        return {f"{_prefix(name)}{point}": place for name, body in self.bodies for point, place in body.all_points}

    def require_dof(self, label: str) -> None:
        """Refuse a DOF that no point has.

        Raises
        ------
        ModelError
            If there is no such point, or no point moves so.
        """
        point, _, direction = label.rpartition(":")
        if point not in self.positions:
            near = None if point.isdecimal() else similar(point, self.positions)
            near = near or next((name for name in self.positions if name.endswith(f".{point}")), None)
            shown = f'"{near or next(reversed(self.positions))}:{direction}"'
            remedy = f"did you mean {shown}?" if near else f"write for example {shown}"
            found = f'found "{label}": there is no {self.a_point} {point}'
            raise ModelError.of(self.kind, (), found, self.points_in_words, remedy)
        if direction not in self.directions:
            found, expected = f'found "{label}": no direction {direction}', f"one of {', '.join(self.directions)}"
            in_plane = self.kind == "beam" and direction in _DIRECTIONS[5]
            remedy = "set dofs_per_node = 5" if in_plane else "choose one of these"
            raise ModelError.of(self.kind, (), found, expected, remedy)

    @property
    def points_in_words(self) -> str:
        """What a point may be, for messages."""
        names = list(self.positions)
        return f"one of {', '.join(names[:_NAMED])}" + (f" and {len(names) - _NAMED} more" if names[_NAMED:] else "")

    def _body_at(self, point: str) -> tuple[str, FrameBody]:
        """Name and body of a point."""
        return next(
            (name, body) for name, body in self.bodies if any(_prefix(name) + p == point for p, _ in body.all_points)
        )

    def own_stiffness(self, row: str, column: str) -> float:
        """EI/L³ (N/m), EI/L² (N) or EI/L (N·m/rad) of two DOFs of a point.

        EI is the smallest of the members that end or pass there, about any axis and at either end; L is the diagonal of
        the box that holds the body: a short member at the point says little of how the body gives way.
        """
        self.require_dof(row)
        point = row.rpartition(":")[0]
        name, body = self._body_at(point)
        stations = [body.stations(member) for member in body.members]
        bending = [
            member.material.youngs_modulus * min(section.inertia_y, section.inertia_z)
            for member, along in zip(body.members, stations, strict=True)
            if any(_prefix(name) + station.point == point for station in along)
            for section in (member.section, member.end_section or member.section)
        ]
        extent = _diagonal([station.place for along in stations for station in along])
        return min(bending) / extent ** (3 - (":r" in row) - (":r" in column))

    def own_inertia(self, dof: str) -> float:
        """Mass of the members of the body of a point (kg), or for a rotation times a third of the diagonal squared."""
        self.require_dof(dof)
        body = self._body_at(dof.rpartition(":")[0])[1]
        mass, places = 0.0, []
        for member in body.members:
            along = [station.place for station in body.stations(member)]
            ends = (member.section, member.end_section or member.section)
            area = sum(section.area for section in ends) / 2
            length = np.linalg.norm(np.diff(along, axis=0), axis=1).sum()
            mass += member.material.density * area * float(length)
            places += along
        return mass * _diagonal(places) ** 2 / 3 if ":r" in dof else mass

    @property
    def extent(self) -> float:
        """Largest distance between two corners of the box that holds all points, m."""
        return _diagonal(list(self.positions.values()))

    def body_factor(self, number: int, factors: Mapping[str, Array], quantity: str) -> Array:
        """Multiply the factors on one quantity of a body: its own, and the one on all bodies."""
        name, _ = self.bodies[number]
        if quantity == "accelerometer_mass":
            return self.lumped_factor(factors.get(quantity, _ONE))
        return factors.get(quantity, _ONE) * factors.get(f"{name}.{quantity}", _ONE)

    def factors_of(self, number: int, factors: Mapping[str, float]) -> BodyFactors:
        """Factors on the quantities of a body from those by name."""
        arrays = {name: np.array(factor) for name, factor in factors.items()}
        return BodyFactors(**{q: float(self.body_factor(number, arrays, q)) for q in BODY_QUANTITIES})

    def loaded_points(self, number: int) -> tuple[str, ...]:
        """Points of a body, without its name, at which accelerometers sit."""
        name, body = self.bodies[number]
        loaded = dict.fromkeys(d.split(":")[0] for d in self.accelerometer_dofs if ":r" not in d)
        return tuple(point for point, _ in body.all_points if f"{_prefix(name)}{point}" in loaded)

    def mesh(
        self, dofs: Iterable[str] | None = None, top_hz: float | None = None, forces: Sequence[float] = ()
    ) -> FrameMesh:
        """Elements that are exact up to a frequency and end where something acts or is observed.

        Parameters
        ----------
        dofs
            Labels of such DOFs, next to supports and accelerometers; None takes all points.
        top_hz
            Highest frequency, Hz; None that of ten half waves along the straight beam where it is lowest.
        forces
            Largest factor on the axial forces of each body, 1 where none is given.

        Raises
        ------
        ModelError
            If the frequency is too high for the frame.
        """
        used = None if dofs is None else {d.split(":")[0] for d in (*dofs, *self.supports, *self.accelerometer_dofs)}
        paper, of_bodies = self.element == "paper", []
        for name, body in self.bodies:
            prefix = _prefix(name)
            here = None if used is None else {p.removeprefix(prefix) for p in used if p.startswith(prefix)}
            of_bodies.append(segments_of(body, None if paper else here))
        if paper:
            return tuple(BodyMesh(segments, ((1, 0),) * len(segments)) for segments in of_bodies)
        slowest = min(s.stretch.bending_frequency_hz(HALF_WAVES) for segments in of_bodies for s in segments)
        top_hz = slowest if top_hz is None else top_hz
        if not 0 <= top_hz <= _HIGHEST_HZ:
            found = f"found lines up to {top_hz:g} Hz"
            raise ModelError.of(f"{self.kind}", (), found, f"up to {_HIGHEST_HZ:g} Hz", "correct them")
        meshes = []
        for segments, force in zip(of_bodies, forces or (1.0,) * len(of_bodies), strict=True):
            mesh = mesh_of(segments, self.directions, top_hz, self.kind, force=force, richer=self.richer)
            nodes, (whole, at_a_point) = 1 + sum(count * order for count, order in mesh.elements), self.most_dofs
            most = whole // len(self.directions) + at_a_point * (len(segments) + 1)
            if nodes > most:
                found = f"found a length of {sum(s.stretch.length for s in segments):g} m and lines up to {top_hz:g} Hz"
                remedy = "lower the frequencies, or correct the units of length and material"
                words = f"{found}, which take {nodes} nodes; expected at most {most}{self.most_are}; {remedy}"
                raise ModelError(f"{self.kind}: {words}")
            meshes.append(mesh)
        return tuple(meshes)

    def structure(self, factors: Mapping[str, float] | None = None, mesh: FrameMesh | None = None) -> Structure:
        """Assemble the frame with its quantities multiplied by factors, 1 where none is given; bodies as blocks.

        Parameters
        ----------
        factors
            By name, see `quantities`.
        mesh
            Elements, as `mesh` gives them; None takes those through all points.

        Raises
        ------
        ModelError
            If a name is unknown or a quantity becomes impossible.
        """
        named = self.checked_factors(factors)
        of_bodies = [
            self.matrices(number, self.factors_of(number, named), self.load(named), body_mesh)
            for number, body_mesh in enumerate(mesh or self.mesh())
        ]
        stiffnesses, masses, labels = zip(*of_bodies, strict=True)
        stiffness, mass = (linalg.block_diag(*blocks) for blocks in (stiffnesses, masses))
        dofs = tuple(label for of_body in labels for label in of_body)
        return Structure(stiffness, mass, self.damping.scaled(named), dofs, self.positions)

    def matrices(
        self, number: int, factors: BodyFactors, load: float, mesh: BodyMesh
    ) -> tuple[Array, Array, tuple[str, ...]]:
        """Stiffness and mass of one body with its supports, and the labels of its DOFs.

        Parameters
        ----------
        number
            Which body.
        factors
            On its quantities.
        load
            Mass of each accelerometer with what is added to it, kg.
        mesh
            Its elements.
        """
        name, body = self.bodies[number]
        prefix = _prefix(name)
        loads = [(point, load) for point in self.loaded_points(number)]
        moving = tuple(direction for direction in SPATIAL if direction in self.directions)
        stiffness, mass, nodes = assembled(body, mesh, factors, loads, moving)
        labels = [f"{prefix}{node}:{direction}" for node in nodes for direction in moving]
        free = [i for i, label in enumerate(labels) if label not in self.supports]
        return stiffness[np.ix_(free, free)], mass[np.ix_(free, free)], tuple(labels[i] for i in free)


@dataclass(frozen=True)
class FrameRecipe(MemberRecipe):
    """What a frame is made from: one body or several, which joints alone connect.

    A DOF is ``"point:direction"``, of several bodies ``"body.point:direction"``, in global axes.

    Parameters
    ----------
    bodies
        A `FrameBody`; or several by their names, as a mapping or as pairs.
    damping
        Damping law.
    directions
        In which points move: the others of x, y, z, rx, ry, rz are held everywhere. ``("x", "y", "rz")`` is a plane
        frame.
    supports, accelerometer_mass, added_mass, accelerometer_dofs, richer
        See `Recipe`.
    element
        ``"converged"``, or ``"paper"`` for one of its two-node elements between each two points.

    Raises
    ------
    ModelError
        If a name or DOF is not possible.

    Examples
    --------
    >>> from jointbayes.structure import BeamMaterial, FrameBody, Member, ModalDamping, Section
    >>> bar = Member(("a", "b"), Section.circle(0.02), BeamMaterial(2.1e11, 0.3, 7800.0))
    >>> frame = FrameRecipe(FrameBody({"a": (0, 0, 0), "b": (0.4, 0.3, 0)}, (bar,)), ModalDamping((0.01,)))
    >>> (frame.structure().modes().frequency_hz[:6] < 1e-3).all().item()
    True
    """

    bodies: tuple[tuple[str, FrameBody], ...]
    damping: DampingLaw
    directions: tuple[str, ...] = SPATIAL
    supports: tuple[str, ...] = ()

    kind: ClassVar[str] = "frame"

    def __post_init__(self) -> None:
        bodies = {"": self.bodies} if isinstance(self.bodies, FrameBody) else self.bodies
        pairs = bodies.items() if isinstance(bodies, Mapping) else bodies
        object.__setattr__(self, "bodies", tuple((name, body) for name, body in pairs))
        convert_fields(self, tuple, "directions", "supports", "accelerometer_dofs")
        names = [name for name, _ in self.bodies]
        wrong = [name for name in names if names.count(name) > 1 or not _BODY_NAME.fullmatch(name)]
        if wrong != ([""] if names == [""] else []) or not names:
            found = f"found the bodies {printable(', '.join(map(str, names))) or 'none'}"
            expected = "names of letters, digits, _ and - that begin with a letter, each once"
            raise ModelError.of("frame", (), found, expected, "rename them")
        if not self.directions or not set(self.directions) <= set(SPATIAL):
            found = f"found the directions {', '.join(self.directions)}"
            raise ModelError.of("frame", (), found, f"some of {', '.join(SPATIAL)}")
        self._require_masses()
        for label in (*self.supports, *self.accelerometer_dofs):
            self.require_dof(label)

    @property
    def usual(self) -> dict[str, tuple[str, float]]:
        """Factors on modulus and density, the length where all bodies are straight, the mass of the accelerometers."""
        usual = dict.fromkeys(("youngs_modulus", "density"), ("× stated", 1.0))
        if all(body.straight for _, body in self.bodies):
            lengths = [line_length([place for _, place in body.points]) or 0.0 for _, body in self.bodies]
            alike = math.isclose(min(lengths), max(lengths))
            usual["length"] = ("mm", in_unit(max(lengths), 1e-3)) if alike else ("× stated", 1.0)
        return self._with_accelerometers(usual)

    @property
    def what(self) -> str:
        """The frame by its bodies."""
        return ", ".join(name for name, _ in self.bodies) or "frame"

    @property
    def quantities(self) -> tuple[str, ...]:
        """Quantities that may be uncertain, next to ``damping_ratio_1`` and so on."""
        of_bodies = [f"{_prefix(name)}{q}" for name, _ in self.bodies if name for q in BODY_QUANTITIES]
        return (*BODY_QUANTITIES, *of_bodies, *_OF_ALL)

    def require_quantity(self, name: str) -> None:
        """Refuse a quantity that the frame does not have.

        Raises
        ------
        ModelError
            If the name is unknown, or a body's length is not one number.
        """
        MemberRecipe.require_quantity(self, name)
        owner, _, quantity = name.rpartition(".")
        bent = [n or "the frame" for n, body in self.bodies if (not owner or owner == n) and not body.straight]
        if quantity == "length" and bent:
            found = f"found the uncertain quantity {name!r} where {', '.join(bent)} has members in several directions, "
            found += "offsets or inertias at points"
            remedy = "make the quantity that of a straight body"
            raise ModelError.of("frame", (), found, "a straight body, whose length is one number", remedy)


def require_unbuckled(recipe: MemberRecipe, held: Iterable[str]) -> None:
    """Refuse compression that no joint can hold: the structure buckles even where some DOFs are held still.

    Motions without strain are left out: what holds them is no matter of the structure.

    Raises
    ------
    ModelError
        If its axial forces are beyond the critical ones.
    """
    forces = [member.axial_force for _, body in recipe.bodies for member in body.members]
    if min(forces) >= 0:
        return
    held = tuple(held)
    mesh = recipe.mesh(held)
    preloaded, slack = (
        made.fixed([label for label in held if label in made.dofs])
        for made in (recipe.structure({}, mesh), recipe.structure({"axial_force": 0.0}, mesh))
    )
    modes = slack.modes()
    shapes = modes.shapes / np.sqrt(np.where(modes.eigenvalues > 0, modes.eigenvalues, np.inf))
    softened = linalg.eigvalsh(shapes.T @ (slack.stiffness - preloaded.stiffness) @ shapes)[-1]
    if softened >= 1:
        found = f"found an axial force of {min(forces):.6g} N, under which it buckles however stiff its joints are"
        expected = f"compression below the critical {-min(forces) / softened:.6g} N"
        remedy = "lower the compression, or correct section and length"
        raise ModelError.of(recipe.kind, ("axial_force_n",), found, expected, remedy)


def _diagonal(places: Sequence[Vector]) -> float:
    """Of the box that holds all places, m."""
    corners = np.array(places)
    return float(np.linalg.norm(corners.max(axis=0) - corners.min(axis=0)))


def _prefix(name: str) -> str:
    return f"{name}." if name else ""


_DIRECTIONS: dict[int, tuple[str, ...]] = {2: ("y", "rz"), 5: ("x", "y", "z", "ry", "rz")}  # by the DOFs of a node
_NEAR = 1e-6  # of the length: a point so near to a node is that node
_LEAST, _MOST, _MOST_SPANS = 1e-6, 1e6, 10_000  # of a length in m, a coefficient; and equal spans

#: Quantities of a beam that may be uncertain, next to ``damping_ratio_1`` and so on.
STRUCTURE_QUANTITIES = (
    "youngs_modulus",
    "density",
    "length",
    "length_offset",
    "section_size",
    "shear_coefficient",
    "axial_force",
    "accelerometer_mass",
    "damping_ratio",
    "loss_factor",
)


@dataclass(frozen=True)
class BeamRecipe(MemberRecipe):
    """What a uniform straight beam is made from: DOFs ``"node:direction"``, nodes numbered from 1 at x = 0.

    Parameters
    ----------
    length
        Length, m.
    section, material, damping
        Cross-section, material and damping law.
    elements
        Equal spans between the numbered points 1 to elements + 1; with the paper's element also the finite elements.
    dofs_per_node
        2: deflection ``y`` and rotation ``rz`` in the x-y plane.  5: ``x, y, z, ry, rz``, two bending planes and axial
        motion, no torsion.
    shear_coefficient
        κ for both planes; None takes Cowper's formula for the section.
    axial_force
        Force along it at rest, N, tension positive, see `Member`.
    points
        Further points between the numbered ones: name and distance from node 1, m. They move with its length.
    supports, accelerometer_mass, added_mass, accelerometer_dofs, element, richer
        See `Recipe`.

    Raises
    ------
    ModelError
        If a number is not possible or a DOF does not exist.
    """

    length: float
    section: Section
    material: BeamMaterial
    damping: DampingLaw
    elements: int = 10
    dofs_per_node: Literal[2, 5] = 2
    shear_coefficient: float | None = None
    supports: tuple[str, ...] = ()
    axial_force: float = 0.0
    points: tuple[tuple[str, float], ...] = ()

    kind: ClassVar[str] = "beam"
    quantities: ClassVar[tuple[str, ...]] = STRUCTURE_QUANTITIES
    #: A beam of so many has a hundred modes below the highest line: no test is made so.
    most_dofs: ClassVar[tuple[int, int]] = (500, 10)
    most_are: ClassVar[str] = ", a hundred natural frequencies"
    a_point: ClassVar[str] = "node"

    def __post_init__(self) -> None:
        if not _LEAST <= self.length <= _MOST:
            raise ModelError(f"beam: found a length of {self.length:g} m; expected a finite length above 0; correct it")
        self._require_masses()
        kappa = self.shear_coefficient
        if not (kappa is None or _LEAST <= kappa <= _MOST):
            found = f"found a shear coefficient of {kappa:g}"
            raise ModelError.of("beam", (), found, "one above 0, about 0.9", "correct it")
        if not (isinstance(self.elements, Integral) and 1 <= self.elements <= _MOST_SPANS):
            found = f"found {self.elements} elements"
            raise ModelError.of("beam", (), found, f"a whole number from 1 to {_MOST_SPANS}", "correct it")
        if self.dofs_per_node not in _DIRECTIONS:
            raise ModelError.of("beam", (), f"found {self.dofs_per_node} DOFs per node", "2 or 5", "correct them")
        if self.points and self.element == "paper":
            found, expected = 'found points beside element "paper", whose elements are equal', 'element "converged"'
            raise ModelError.of("beam", ("points",), found, expected, "take it, or choose elements that divide")
        for name, place in self.points:
            node = 1 + round(self.elements * place / self.length) if 0 < place < self.length else 0
            near = node > 0 and abs(place - self.length * (node - 1) / self.elements) < _NEAR * self.length
            if name.isdecimal() or near or not node:
                found = f"found the point {printable(name)!r} at {1e3 * place:g} mm{f', where node {node} is' * near}"
                expected = f"a name that is no number, and a place between nodes, 0 to {1e3 * self.length:g} mm"
                raise ModelError.of("beam", ("points", name), found, expected, "take the node there, or move it")
        for label in (*self.supports, *self.accelerometer_dofs):
            self.require_dof(label)

    @property
    def usual(self) -> dict[str, tuple[str, float]]:
        """Young's modulus, density, length and the mass of the accelerometers."""
        material = self.material
        usual = {
            "youngs_modulus": ("GPa", in_unit(material.youngs_modulus, 1e9)),
            "density": ("kg/m³", material.density),
            "length": ("mm", in_unit(self.length, 1e-3)),
        }
        return self._with_accelerometers(usual)

    @property
    def what(self) -> str:
        """The beam by its length."""
        return f"{1e3 * self.length:g} mm"

    @property
    def directions(self) -> tuple[str, ...]:
        """Directions of the DOFs of each node."""
        return _DIRECTIONS[self.dofs_per_node]

    @property
    def points_in_words(self) -> str:
        """The numbers of its nodes, and further points."""
        return ", or ".join((f"a node from 1 to {self.elements + 1} (elements + 1)", *dict(self.points)))

    @cached_property
    def bodies(self) -> tuple[tuple[str, FrameBody], ...]:
        """Its one member, through all numbered points and those between."""
        # spans before the numbered points on both sides of each further one
        spans = {int(self.elements * place / self.length) + side for _, place in self.points for side in (0, 1)}
        numbered = {str(i + 1): self.length * i / self.elements for i in spans if 0 < i < self.elements}
        return (("", self._body(numbered | dict(self.points))),)

    def _body(self, between: Mapping[str, float]) -> FrameBody:
        places = {"1": 0.0, **dict(sorted(between.items(), key=itemgetter(1))), str(self.elements + 1): self.length}
        shear, force = self.shear_coefficient, self.axial_force
        member = Member(tuple(places), self.section, self.material, shear_coefficient=shear, axial_force=force)
        return FrameBody(tuple((name, (x, 0.0, 0.0)) for name, x in places.items()), (member,))

    @cached_property
    def positions(self) -> dict[str, tuple[float, float, float]]:
        """Place of every point along it, m."""
        numbered = [(str(i + 1), self.length * i / self.elements) for i in range(self.elements + 1)]
        return {name: (x, 0.0, 0.0) for name, x in sorted((*numbered, *self.points), key=itemgetter(1))}

    @cached_property
    def whole(self) -> Stretch:
        """All of it as one piece."""
        return segments_of(self._body({}), ())[0].stretch

    def own_stiffness(self, row: str, column: str) -> float:
        """EI/L³ (N/m), EI/L² (N) or EI/L (N·m/rad) of two DOFs, of bending in the plane of the first."""
        across_y = row.rpartition(":")[2] in ("z", "ry")
        inertia = self.section.inertia_y if across_y else self.section.inertia_z
        return self.material.youngs_modulus * inertia / self.length ** (3 - (":r" in row) - (":r" in column))

    def body_factor(self, number: int, factors: Mapping[str, Array], quantity: str) -> Array:
        """Factor on a quantity from those by name; its offset, in m, is added to the length."""
        factor = super().body_factor(number, factors, quantity)
        if quantity == "length" and "length_offset" in factors:
            return factor + np.log(factors["length_offset"]) / self.length
        return factor

    def mesh(
        self, dofs: Iterable[str] | None = None, top_hz: float | None = None, forces: Sequence[float] = ()
    ) -> FrameMesh:
        """Elements as those of frames; no `top_hz` takes the frequency of ten half waves along the whole beam."""
        return super().mesh(dofs, self.whole.bending_frequency_hz(HALF_WAVES) if top_hz is None else top_hz, forces)


def beam(
    length: float,
    section: Section,
    material: BeamMaterial,
    damping: DampingLaw,
    *,
    elements: int = 10,
    dofs_per_node: Literal[2, 5] = 2,
    shear_coefficient: float | None = None,
) -> Structure:
    """Free-free straight beam along x of equal elements of the paper's kind, see `BeamRecipe`.

    Its points have no places, so that a joint may connect any two.

    Raises
    ------
    ModelError
        If a number is not possible.

    Examples
    --------
    >>> from jointbayes.structure import ModalDamping
    >>> steel = BeamMaterial(2.1e11, 0.3, 7800.0)
    >>> rod = beam(0.383, Section.circle(0.025), steel, ModalDamping((0.01,)))
    >>> rod.fixed(["1:y", "1:rz"]).modes().frequency_hz[:2].round(2).tolist()
    [123.41, 762.62]
    """
    recipe = BeamRecipe(length, section, material, damping, elements, dofs_per_node, shear_coefficient, element="paper")
    return replace(recipe.structure(), positions={})
