"""What a frame is made from: bodies of straight members between points in space, with masses at points."""

import itertools
import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from jointbayes.errors import ModelError
from jointbayes.structure.section import BeamMaterial, Section
from vibrecords.arrays import Array, convert_fields
from vibrecords.errors import printable

Vector = tuple[float, float, float]

#: Directions of the DOFs of a point of a frame.
SPATIAL = ("x", "y", "z", "rx", "ry", "rz")
_NOWHERE: Vector = (0.0, 0.0, 0.0)
_FARTHEST, _HEAVIEST = 1e6, 1e9  # m, and kg or kg m²
_STRONGEST = 1e15  # N
_SHORTEST = 1e-9  # a member in relation to the distance of its points from the origin, or in m
_PARALLEL = 1e-6  # sine of the angle below which two directions are one
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,59}")
_MOST_FILLED = 10_000


@dataclass(frozen=True, slots=True)
class Member:
    """A row of straight Timoshenko beams, each fixed to the next.

    Parameters
    ----------
    points
        Names of the points it runs through. Where two that follow each other are whole numbers, such as 1 and 11, and
        no point has a number between, those between stand for equally spaced points on the line.
    section, material
        Cross-section and material.
    end_section
        Section at the last point, to which every dimension changes linearly with the length; None: uniform.
    shear_coefficient
        κ for shear along the height and along the width, or one for both; None takes Cowper's.
    up
        Direction in which the section's height lies, as far as it is perpendicular to the member. None: in a member
        along z that of y, in others perpendicular to z, so that members in the x-y plane have their height in it.
    offsets
        From the first and the last point to where the beam's axis begins and ends, m: rigid links. Points between have
        what lies between.
    axial_force
        Force along it at rest, N, tension positive: it stiffens the member against bending in both planes, compression
        softens it. The force is the same all along.

    Raises
    ------
    ModelError
        If there are fewer than two points, or a number is not possible.
    """

    points: tuple[str, ...]
    section: Section
    material: BeamMaterial
    end_section: Section | None = None
    shear_coefficient: float | tuple[float, float] | None = None
    up: Vector | None = None
    offsets: tuple[Vector, Vector] = (_NOWHERE, _NOWHERE)
    axial_force: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", tuple(str(point) for point in self.points))
        first, last = self.offsets
        object.__setattr__(self, "offsets", (_vector(first, "an offset"), _vector(last, "an offset")))
        convert_fields(self, lambda up: _vector(up, "the direction of the height"), "up")
        if len(self.points) < 2 or any(a == b for a, b in itertools.pairwise(self.points)):
            found, remedy = f"found a member through {', '.join(self.points) or 'no points'}", "correct the member"
            raise ModelError.of("frame", (), found, "two points or more, none of them twice in a row", remedy)
        if not all(1e-6 <= kappa <= 1e6 for kappa in self.kappas or ()):
            found = f"found the shear coefficient {self.shear_coefficient}"
            raise ModelError.of("frame", (), found, "one above 0, about 0.9")
        if not abs(self.axial_force) <= _STRONGEST:
            found = f"found an axial force of {self.axial_force:g} N"
            raise ModelError.of("frame", (), found, f"one of at most {_STRONGEST:g} N, tension positive", "correct it")
        if self.end_section is not None:
            self.section.between(self.end_section, 0.5)

    @property
    def kappas(self) -> tuple[float, float] | None:
        """κ for shear along the height and along the width; None takes Cowper's."""
        kappa = self.shear_coefficient
        return (float(kappa), float(kappa)) if isinstance(kappa, int | float) else kappa

    def axes(self, along: Array) -> Array:
        """Local axes, one a row, of a beam in direction `along`.

        Raises
        ------
        ModelError
            If the height is to lie along the member.
        """
        x = along / np.linalg.norm(along)
        if self.up is not None:
            up = np.array(self.up) / max(np.abs(self.up).max(), np.finfo(float).tiny)
            up = up / max(float(np.linalg.norm(up)), _PARALLEL)
        else:
            up = np.array([-x[1], x[0], 0.0])  # z × x
            up = np.array([0.0, 1.0, 0.0]) if np.linalg.norm(up) < _PARALLEL else up
        y = up - (up @ x) * x
        if np.linalg.norm(y) < _PARALLEL:
            found = f"found up = {list(self.up or ())} along the member {self.points[0]} to {self.points[-1]}"
            expected = "a direction across it, in which the section's height lies"
            raise ModelError.of("frame", (), found, expected, "correct it")
        y = y / np.linalg.norm(y)
        return np.stack([x, y, np.cross(x, y)])


@dataclass(frozen=True, slots=True)
class PointMass:
    """A rigid mass at a point.

    Parameters
    ----------
    point
        Name of the point.
    mass
        Mass, kg.
    inertia
        Moments of inertia about its own centre along x, y, z, or six with the products xy, yz, xz of the inertia
        matrix behind them, kg m².
    offset
        From the point to its centre, m.

    Raises
    ------
    ModelError
        If the mass is negative, or no body has such an inertia.
    """

    point: str
    mass: float
    inertia: tuple[float, ...] = _NOWHERE
    offset: Vector = _NOWHERE

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", str(self.point))
        object.__setattr__(self, "inertia", tuple(float(number) for number in self.inertia))
        object.__setattr__(self, "offset", _vector(self.offset, "an offset"))
        numbers = (self.mass, *self.inertia)
        possible = all(abs(number) <= _HEAVIEST for number in numbers) and len(self.inertia) in (3, 6)
        if possible:
            matrix = self.inertia_matrix
            possible = self.mass >= 0 and np.linalg.eigvalsh(matrix).min() >= -1e-12 * np.abs(matrix).max(initial=0.0)
        if not possible:
            given = f"{self.mass:g} kg with the inertia {list(self.inertia)} kg m2 at point {self.point}"
            expected = "a mass of at least 0 and three moments of inertia, or six with xy, yz, xz, of a matrix that is "
            expected += "positive semidefinite"
            raise ModelError.of("frame", ("inertia",), f"found a mass of {given}", expected, "correct them")

    @property
    def inertia_matrix(self) -> Array:
        """Inertia about its own centre, shape (3, 3)."""
        xx, yy, zz, xy, yz, xz = (*self.inertia, 0.0, 0.0, 0.0)[:6]
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@dataclass(frozen=True, slots=True)
class Station:
    """A point of a member: its name, where the member's axis is, what lies between, and the share of the length there.

    `numbered` is whether it only has its place by its number, so that no element need end there.
    """

    point: str
    place: Vector
    offset: Vector
    share: float
    numbered: bool


@dataclass(frozen=True)
class FrameBody:
    """Members that hold together, and masses at their points.

    Parameters
    ----------
    points
        Place of each point in m by its name or number: a mapping, or pairs.
    members
        What lies between them.
    masses
        Rigid masses at points.

    Raises
    ------
    ModelError
        If a member or mass names a point that does not exist, a member has no length, or not all hang together.
    """

    points: tuple[tuple[str, Vector], ...]
    members: tuple[Member, ...]
    masses: tuple[PointMass, ...] = ()

    def __post_init__(self) -> None:
        given: Any = self.points.items() if isinstance(self.points, Mapping) else self.points
        named = tuple((str(name), _vector(place, f"the place of point {name}")) for name, place in given)
        object.__setattr__(self, "points", named)
        convert_fields(self, tuple, "members", "masses")
        # 1. names that are possible, and points that exist
        names = [name for name, _ in self.points]
        for name in names:
            if not _NAME.fullmatch(name) or names.count(name) > 1:
                found = f"found the point {printable(name)!r}{' twice' * (names.count(name) > 1)}"
                expected = "names of letters, digits, _ and -, each once"
                raise ModelError.of("frame", ("points",), found, expected, "rename it")
        if not self.members:
            raise ModelError.of("frame", (), "found a body without members", "at least one", "state a member")
        at = [(("members", i), point) for i, member in enumerate(self.members) for point in member.points]
        for key, point in [*at, *((("masses", i), mass.point) for i, mass in enumerate(self.masses))]:
            if point not in names:
                found = f"found a member or mass at point {printable(point)!r}"
                remedy = "correct the name or state the point's place"
                raise ModelError.of("frame", key, found, f"one of {', '.join(names[:12])}", remedy)
        # 2. members with a length
        for member in self.members:
            for start, end in itertools.pairwise(self.stations(member)):
                gap = np.subtract(end.place, start.place)
                if not math.hypot(*gap) > _SHORTEST * max(1.0, math.hypot(*start.place)):
                    found = f"found no length between the points {start.point} and {end.point} of a member"
                    raise ModelError.of("frame", (), found, "two places", "correct a point or an offset")
                member.axes(gap)
        # 3. numbers that one member counts through
        twice = [name for name, count in Counter(name for name, _ in self.all_points).items() if count > 1]
        if twice:
            found, expected = f"found the point {twice[0]} on two members that count through it", "each number once"
            raise ModelError.of("frame", (), found, expected, "give the points of one of them places of their own")
        # 4. one piece
        reached, rest = set(self.members[0].points), list(self.members[1:])
        while touching := [member for member in rest if reached & set(member.points)]:
            reached.update(*(member.points for member in touching))
            rest = [member for member in rest if member not in touching]
        alone = [name for name in names if name not in reached]
        if alone:
            first, remedy = self.members[0].points[0], "connect them or make them another body"
            found = f"frame: found the points {', '.join(alone[:12])} without a member that connects them to {first}"
            raise ModelError(f"{found}; expected a body in one piece; {remedy}")

    def stations(self, member: Member) -> tuple[Station, ...]:
        """The points along one of its members, those with a number between among them."""
        places = {name: np.array(place) for name, place in self.points}
        names: list[str] = [member.points[0]]
        for first_name, second_name in itertools.pairwise(member.points):
            numbered = first_name.isdecimal() and second_name.isdecimal()
            gap = int(second_name) - int(first_name) if numbered else 0
            if abs(gap) > _MOST_FILLED:
                found, remedy = f"found a member from point {first_name} to {second_name}", "name them otherwise"
                raise ModelError.of("frame", (), found, f"at most {_MOST_FILLED} numbers between", remedy)
            between = [str(int(first_name) + (i if gap > 0 else -i)) for i in range(1, abs(gap))]
            if places.keys().isdisjoint(between):
                for i, name in enumerate(between, 1):
                    share = i / abs(gap)
                    places[name] = (1 - share) * places[first_name] + share * places[second_name]
                names += between
            names.append(second_name)
        along = np.array([np.linalg.norm(places[b] - places[a]) for a, b in itertools.pairwise(names)])
        whole = along.sum()
        shares = np.concatenate([[0.0], np.cumsum(along) / (whole if whole > 0 else 1.0)])
        shares[-1] = 1.0
        first, last = (np.array(offset) for offset in member.offsets)
        stations = []
        for name, share in zip(names, shares.tolist(), strict=True):
            offset = (1 - share) * first + share * last
            place = places[name] + offset
            stations.append(Station(name, _tuple(place), _tuple(offset), share, name not in member.points))
        return tuple(stations)

    @cached_property
    def all_points(self) -> tuple[tuple[str, Vector], ...]:
        """Name and place of every point, those that members count through among them."""
        counted = [
            (station.point, _tuple(np.subtract(station.place, station.offset)))
            for member in self.members
            for station in self.stations(member)
            if station.numbered
        ]
        return (*self.points, *counted)

    @property
    def straight(self) -> bool:
        """Whether all its members lie on one line and nothing sticks out, so that its length is one number."""
        beside = (any(map(any, member.offsets)) for member in self.members)
        out = (any(mass.inertia) or any(mass.offset) for mass in self.masses)
        return not any((*beside, *out)) and line_length([place for _, place in self.points]) is not None


def line_length(points: Iterable[Vector]) -> float | None:
    """Length of the straight line that points lie on, in their unit; None where they do not lie on one."""
    places = np.array(list(points))
    if np.linalg.matrix_rank(places - places[0], tol=1e-9 * np.abs(places).max()) != 1:
        return None
    return float(np.linalg.norm(np.ptp(places, axis=0)))


def _vector(value: object, what: str) -> Vector:
    try:
        x, y, z = (float(number) for number in value)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise ModelError(f"frame: found {value!r:.60} for {what}; expected three numbers x, y, z; correct it") from None
    if not all(math.isfinite(number) and abs(number) <= _FARTHEST for number in (x, y, z)):
        found = f"found {[x, y, z]} for {what}"
        raise ModelError.of("frame", (), found, f"numbers up to {_FARTHEST:g} m", "correct it or its unit")
    return x, y, z


def _tuple(vector: Array) -> Vector:
    x, y, z = vector.tolist()
    return x, y, z
