"""How a frame is cut into elements, so rich that no mesh shows below a frequency, and their sparse assembly."""

import itertools
import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import linalg, sparse

from jointbayes.errors import ModelError
from jointbayes.structure.frame import SPATIAL, FrameBody, Vector
from jointbayes.structure.frame_element import (
    FIELDS,
    Stretch,
    end_transformation,
    local_matrices,
    mass_matrix,
    paper_matrices,
    part_matrices,
)
from jointbayes.structure.high_order import ACCURACY, RICHER, ROUNDING, cheapest_elements, condensed_to_ends
from vibrecords.arrays import Array, Indices

#: Beyond so many DOFs of one body dense modes take minutes: units are mistaken, or it is no frame of beams.
MOST_DOFS = 2400
_HIGHEST_HZ = 1e20


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
class BodyFactors:
    """Factors on a body's E, ρ, length, every dimension of its sections, κ, and on its masses at points."""

    youngs_modulus: float = 1.0
    density: float = 1.0
    length: float = 1.0
    section_size: float = 1.0
    shear_coefficient: float = 1.0
    masses: float = 1.0


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
    segments = []
    for member in body.members:
        kept = [s for s in body.stations(member) if not s.numbered or used is None or s.point in used]
        for first, second in itertools.pairwise(kept):
            gap = np.subtract(second.place, first.place)
            end = member.end_section or member.section
            start, end = (member.section.between(end, share) for share in (first.share, second.share))
            stretch = Stretch(float(np.linalg.norm(gap)), member.material, start, end, member.kappas)
            x, y, z = ((float(a), float(b), float(c)) for a, b, c in member.axes(gap))
            segments.append(Segment((first.point, second.point), (x, y, z), (first.offset, second.offset), stretch))
    return tuple(segments)


def mesh_of(
    segments: Sequence[Segment], directions: Sequence[str], top_hz: float | None, extra_order: int = 0
) -> BodyMesh:
    """Elements that are exact up to a frequency in Hz; None takes the paper's element, one for each segment.

    Parameters
    ----------
    segments
        Straight beams of a body.
    directions
        Those of `SPATIAL` in which points move.
    extra_order
        Polynomial orders more than that takes: for a reference.

    Raises
    ------
    ModelError
        If the frequency is too high for the body.
    """
    if top_hz is None:
        return BodyMesh(tuple(segments), ((1, 0),) * len(segments))
    if not 0 <= top_hz <= _HIGHEST_HZ:
        raise ModelError(f"frame: found lines up to {top_hz:g} Hz; expected up to {_HIGHEST_HZ:g} Hz; correct them")
    elements, nodes = [], 1
    for segment in segments:
        count, order = _cheapest(segment.stretch, _moving_fields(segment, directions), 2 * math.pi * top_hz)
        elements.append((count, order + extra_order))
        nodes += count * (order + extra_order)
    if nodes * len(directions) > MOST_DOFS:
        lengths = [segment.stretch.length for segment in segments]
        raise ModelError(
            f"frame: found members of {min(lengths):g} to {max(lengths):g} m and lines up to {top_hz:g} Hz, which "
            f"take {nodes * len(directions)} DOFs; expected at most {MOST_DOFS}; lower the frequencies, or correct the "
            "units of length and material"
        )
    return BodyMesh(tuple(segments), tuple(elements))


def _moving_fields(segment: Segment, directions: Sequence[str]) -> tuple[str, ...]:
    """Those of `FIELDS` that move where points move in some directions only."""
    free = np.array([direction in directions for direction in SPATIAL])
    axes = np.abs(np.array(segment.axes)) > 1e-9
    moves = np.concatenate([axes @ free[:3], axes @ free[3:]])
    return tuple(field for field, motions in FIELDS.items() if any(moves[motion] for motion in motions))


@lru_cache(maxsize=1024)
def _cheapest(stretch: Stretch, fields: tuple[str, ...], omega: float) -> tuple[int, int]:
    """Number of elements and order that are accurate enough for these motions up to ω and need the fewest nodes."""
    at = stretch.rigidities(np.array([0.0, 1.0]))
    # shear strain is a difference of two slopes: in a thin beam rounding leaves no more of it than this
    slender = max(float((at.shear_y / at.bending_z).max()), float((at.shear_z / at.bending_y).max()))
    rounding = ROUNDING * np.finfo(float).eps * slender * stretch.length**2 * any(len(f) == 2 for f in fields)
    enough = max(ACCURACY, rounding)

    def accurate(order: int, elements: int) -> bool:
        # of a taper the first and the last element are the thinnest and the steepest
        ends = {0, elements - 1} if stretch.tapered else {0}
        parts = [stretch.part(i / elements, (i + 1) / elements) for i in ends]
        return all(_error(piece, order, field, omega) <= enough for piece in parts for field in fields)

    return cheapest_elements(accurate, stretch.length, omega, "frame: found a member")


def _error(stretch: Stretch, order: int, field: str, omega: float) -> float:
    """Largest relative error of an element's energy for motions that fall off as e^(−ωt), seen from its ends.

    As `jointbayes.structure.high_order.element_error`, for each of the motions; that of a taper has a part that
    does not fall with ω, and is not scaled down with it.
    """
    length, rigid = stretch.length, stretch.rigidities(np.array([0.0, 1.0]))
    bending = rigid.bending_z if field == "xy" else rigid.bending_y
    velocity = np.sqrt({"axial": rigid.axial / rigid.mass, "torsion": rigid.torsion / rigid.polar}.get(field, 0.0))
    waves = np.max(velocity) / length if len(FIELDS[field]) == 1 else np.max(np.sqrt(bending / rigid.mass)) / length**2
    at = max(omega, float(waves))  # a wave number of at least 1/length: below it rounding would hide the error
    finer = (part_matrices(stretch, p, field) for p in (order, order + RICHER))
    coarse, fine = (condensed_to_ends(matrices, at, length, len(FIELDS[field])) for matrices in finer)
    error = float(np.abs(linalg.eigh(coarse - fine, fine, eigvals_only=True)).max())
    return error if stretch.tapered else error * (omega / at) ** 2


def assembled(
    body: FrameBody, mesh: BodyMesh, factors: BodyFactors, loads: Iterable[tuple[str, float]]
) -> tuple[sparse.csr_array, sparse.csr_array, tuple[str, ...]]:
    """Sparse stiffness and mass of a body with six DOFs at each of its nodes, and the nodes' names.

    Parameters
    ----------
    body, mesh, factors
        The body, its elements, and factors on its quantities.
    loads
        Points and the masses in kg that sit there, beside those of the body.
    """
    ends = dict.fromkeys(point for segment in mesh.segments for point in segment.points)
    nodes = {name: i for i, name in enumerate(ends)}
    entries: list[tuple[Sequence[int] | Indices, Array, Array]] = []
    for number, (segment, (count, order)) in enumerate(zip(mesh.segments, mesh.elements, strict=True)):
        per = max(order, 1)
        stretch = segment.stretch.scaled(
            factors.youngs_modulus, factors.density, factors.length, factors.section_size, factors.shear_coefficient
        )
        inner = [f"~{number}~{i}" for i in range(1, count * per)]
        first = len(nodes)
        nodes |= {name: first + i for i, name in enumerate(inner)}
        row = np.array([nodes[segment.points[0]], *range(first, first + len(inner)), nodes[segment.points[1]]])
        turns = _turns(segment, len(row))
        for i in range(count):
            element = stretch.part(i / count, (i + 1) / count)
            stiffness, mass = local_matrices(element, order) if order else paper_matrices(element)
            inside = slice(i * per, (i + 1) * per + 1)
            turn = linalg.block_diag(*turns[inside])
            entries.append((row[inside], turn.T @ stiffness @ turn, turn.T @ mass @ turn))
    none, nowhere = np.zeros((6, 6)), np.zeros(3)
    for heavy in body.masses:
        mass = mass_matrix(heavy.mass, heavy.inertia_matrix, np.array(heavy.offset))
        entries.append(([nodes[heavy.point]], none, factors.masses * mass))
    for point, load in loads:
        entries.append(([nodes[point]], none, mass_matrix(load, np.zeros((3, 3)), nowhere)))
    return *_summed(entries, 6 * len(nodes)), tuple(nodes)


def _turns(segment: Segment, count: int) -> list[Array]:
    """From the motion of each node along a segment, global, to that of the beam's axis, in local axes."""
    axes = np.array(segment.axes)
    first, last = (end_transformation(axes, np.array(offset)) for offset in segment.offsets)
    return [first, *[end_transformation(axes, np.zeros(3))] * (count - 2), last]


def _summed(
    entries: Sequence[tuple[Sequence[int] | Indices, Array, Array]], size: int
) -> tuple[sparse.csr_array, sparse.csr_array]:
    """Stiffness and mass of nodes by their numbers, six DOFs each, added up."""
    dofs = [(6 * np.asarray(nodes)[:, None] + np.arange(6)).ravel() for nodes, _, _ in entries]
    rows = np.concatenate([np.repeat(own, own.size) for own in dofs])
    columns = np.concatenate([np.tile(own, own.size) for own in dofs])
    both = zip(*((stiffness, mass) for _, stiffness, mass in entries), strict=True)
    # an element's matrices are symmetric but for the last bits of its turn
    values = (np.concatenate([((matrix + matrix.T) / 2).ravel() for matrix in matrices]) for matrices in both)
    stiffness, mass = (sparse.coo_array((each, (rows, columns)), shape=(size, size)).tocsr() for each in values)
    return stiffness, mass
