"""How frames are cut into elements, so rich that no mesh shows below a frequency, and their assembly.

References
----------
Ainsworth, M. (2004). Discrete dispersion relation for hp-version finite element approximation at high wave number.
SIAM Journal on Numerical Analysis 42(2), 553-575. DOI 10.1137/S0036142903423460 (how an element's error falls).
"""

import bisect
import itertools
import math
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from scipy import linalg

from jointbayes.errors import ModelError
from jointbayes.structure.frame import SPATIAL, FrameBody, Vector
from jointbayes.structure.frame_element import (
    FIELDS,
    BodyFactors,
    Stretch,
    end_transformation,
    mass_matrix,
    part_matrices,
)
from vibrecords.arrays import Array, Indices

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
    elements = [
        _cheapest(segment.stretch.scaled(loaded), fields_of(segment, directions), 2 * math.pi * top_hz, share, kind)
        for segment in segments
    ]
    return BodyMesh(tuple(segments), tuple((count, order + extra * richer) for count, order in elements))


def fields_of(segment: Segment, directions: Sequence[str]) -> tuple[str, ...]:
    """Those of `FIELDS` that move where points move in some directions only."""
    return tuple(_turns(segment.axes, segment.offsets, tuple(directions), 2, True, True))


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
        raise ModelError(
            f"{kind}: found {stretch.length:g} m between points and a frequency of {omega / (2 * math.pi):g} Hz; "
            "expected one at which the wavelength is not thousands of times shorter; correct units of length, material "
            "or frequency"
        )
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
    at = max(omega, share * float(visible))
    finer = (part_matrices(stretch, p, field) for p in (order, order + _RICHER))
    coarse, fine = (_condensed(matrices, at, length, len(FIELDS[field])) for matrices in finer)
    try:
        error = float(np.abs(linalg.eigh(coarse - fine, fine, eigvals_only=True)).max())
    except linalg.LinAlgError:  # what rounding leaves of an absurd element is not positive definite
        return math.inf
    return error if stretch.tapered or stretch.axial_force else error * (omega / at) ** 2


def _condensed(matrices: tuple[Array, Array], omega: float, length: float, per_node: int) -> Array:
    """K + ω²M of an element, rotations times its length, seen from its two end nodes, (2 per_node, 2 per_node)."""
    stiffness, mass = matrices
    scale = np.tile([1.0, 1 / length][:per_node], len(mass) // per_node)
    dynamic = (stiffness + omega**2 * mass) * np.outer(scale, scale)
    last, ends = len(dynamic) - per_node, 2 * per_node
    order_of = np.r_[:per_node, last : last + per_node, per_node:last]  # the ends first
    sorted_: Array = dynamic[order_of][:, order_of]
    inner = sorted_[ends:, ends:]
    condensed: Array = sorted_[:ends, :ends] - sorted_[:ends, ends:] @ np.linalg.solve(inner, sorted_[ends:, :ends])
    return (condensed + condensed.T) / 2


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
        Points and the masses in kg that sit there, beside those of the body.
    directions
        Those of `SPATIAL` in which points move, in its order.
    """
    nodes: dict[str, int] = {}
    made: dict[object, list[tuple[Array, Array]]] = {}
    elements: list[tuple[Indices, tuple[Array, Array]]] = []
    for number, (segment, (count, order)) in enumerate(zip(mesh.segments, mesh.elements, strict=True)):
        alike, each = (segment.stretch, segment.axes, segment.offsets, count, order), max(order, 1)
        if alike not in made:
            made[alike] = _elements(segment, count, order, factors, directions)
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


def _elements(
    segment: Segment, count: int, order: int, factors: BodyFactors, directions: tuple[str, ...]
) -> list[tuple[Array, Array]]:
    """Stiffness and mass of each element of a segment, DOFs those of the directions at each of its nodes."""
    stretch = segment.stretch.scaled(factors)
    alike = not stretch.tapered and not any(map(any, segment.offsets))
    elements = []
    for i in range(1 if alike else count):
        piece, nodes = stretch.part(i / count, (i + 1) / count), max(order, 1) + 1
        turns = _turns(segment.axes, segment.offsets, directions, nodes, i == 0, i == count - 1)
        whole = np.zeros((2, nodes * len(directions), nodes * len(directions)))
        for field, turn in turns.items():
            whole += turn.T @ np.stack(part_matrices(piece, order, field)) @ turn
        stiffness, mass = (whole + whole.swapaxes(1, 2)) / 2  # its turn leaves the last bits unsymmetric
        elements.append((stiffness, mass))
    return elements * count if alike else elements
