"""Straight Timoshenko beams of elements of high order: so exact below a frequency that no mesh shows.

Deflection and rotation are interpolated independently by polynomials of one order on Gauss-Lobatto-Legendre points and
integrated exactly. The error of such an element falls with the power 2p of its length over the wavelength, where that
of the two-node element falls with the second.

References
----------
Patera, A. T. (1984). A spectral element method for fluid dynamics. Journal of Computational Physics 54(3), 468-488.
DOI 10.1016/0021-9991(84)90128-1 (the nodal basis).
Ainsworth, M. (2004). Discrete dispersion relation for hp-version finite element approximation at high wave number.
SIAM Journal on Numerical Analysis 42(2), 553-575. DOI 10.1137/S0036142903423460 (how its error falls).
"""

import bisect
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache, partial

import numpy as np
from numpy.polynomial import legendre
from scipy import linalg

from jointbayes.errors import ModelError
from vibrecords.arrays import Array

_ORDERS = (10, 8, 7, 6, 5, 4, 3)  # the highest first: it bounds how many elements the others may take
_MOST_ELEMENTS = 4096  # between two points: beyond, the frequency asked for is no beam's
RICHER = 4  # orders by which the element is richer that another is compared with
#: Largest relative error of an element's strain and kinetic energy: eigenvalues are as exact, an FRF's peak to this
#: over the damping ratio.
ACCURACY = 2e-10
#: Between more points than these elements are so short that none needs to be as rich as that bound makes them.
MANY_POINTS = 32
_VISIBLE_OF_MANY = 1 / 64  # of the ω at which an element's error shows: still far above rounding
ROUNDING = 2000.0  # of machine epsilon times κGA l²/EI: what condensing a thin element was seen to leave


@dataclass(frozen=True, slots=True)
class BeamPlane:
    """What bending in one plane depends on.

    Parameters
    ----------
    bending, shear
        EI in N·m² and κGA in N.
    mass, rotary
        ρA in kg/m and ρI in kg·m.
    """

    bending: float
    shear: float
    mass: float
    rotary: float


@dataclass(frozen=True, slots=True)
class Span:
    """A stretch of beam: its length in m, in how many equal elements, of which polynomial order."""

    length: float
    elements: int
    order: int


@cache
def _reference(order: int) -> tuple[Array, Array, Array, Array]:
    """GLL points on [0, 1], and ∫N N, ∫N' N', ∫N' N of their Lagrange polynomials (row: the derivative)."""
    inner = legendre.legroots(legendre.legder(np.eye(order + 1)[order])) if order > 1 else np.empty(0)
    points = np.concatenate([[-1.0], np.sort(np.real(inner)), [1.0]])
    nodal = np.linalg.inv(legendre.legvander(points, order))
    at, weight = legendre.leggauss(order + 1)  # exact to degree 2p + 1
    value = legendre.legvander(at, order) @ nodal
    slope = np.stack([legendre.legval(at, legendre.legder(row)) for row in np.eye(order + 1)], axis=-1) @ nodal
    weighted = weight[:, None]
    return (
        (points + 1) / 2,
        (value * weighted).T @ value / 2,
        2 * (slope * weighted).T @ slope,
        (slope * weighted).T @ value,
    )


def element_points(order: int) -> Array:
    """Nodes of an element of unit length, shape (p + 1,)."""
    return _reference(order)[0]


def _bending_element(length: float, order: int, plane: BeamPlane) -> tuple[Array, Array]:
    """Stiffness and mass for DOFs (v, θ) at each point in turn, shape (2p + 2, 2p + 2)."""
    _, mass, stretch, mixed = _reference(order)
    v, t = slice(0, None, 2), slice(1, None, 2)
    size = 2 * (order + 1)
    stiffness, inertia = np.zeros((size, size)), np.zeros((size, size))
    # strain energy ½∫EI θ'² + κGA (v' − θ)² dx
    stiffness[v, v] = plane.shear / length * stretch
    stiffness[v, t] = -plane.shear * mixed
    stiffness[t, v] = -plane.shear * mixed.T
    stiffness[t, t] = plane.bending / length * stretch + plane.shear * length * mass
    inertia[v, v], inertia[t, t] = plane.mass * length * mass, plane.rotary * length * mass
    return stiffness, inertia


def beam_matrices(spans: Sequence[Span], plane: BeamPlane) -> tuple[Array, Array]:
    """Stiffness and mass of a free beam in one plane, DOFs (v, θ) at each node, shape (2 nodes, 2 nodes)."""
    return _assembled([(_bending_element(s.length / s.elements, s.order, plane), s) for s in spans], 2)


def bar_matrices(spans: Sequence[Span], stiffness: float, mass: float) -> tuple[Array, Array]:
    """Stiffness and mass of a free bar along its axis, EA in N and ρA in kg/m, shape (nodes, nodes)."""
    parts = []
    for span in spans:
        length = span.length / span.elements
        _, inertia, stretch, _ = _reference(span.order)
        parts.append(((stiffness / length * stretch, mass * length * inertia), span))
    return _assembled(parts, 1)


def _assembled(parts: Sequence[tuple[tuple[Array, Array], Span]], per_node: int) -> tuple[Array, Array]:
    nodes = 1 + sum(span.elements * span.order for _, span in parts)
    stiffness, mass = np.zeros((2, per_node * nodes, per_node * nodes))
    at = 0
    for (k, m), span in parts:
        for _ in range(span.elements):
            rows = slice(at, at + per_node * (span.order + 1))
            stiffness[rows, rows] += k
            mass[rows, rows] += m
            at += per_node * span.order
    return stiffness, mass


def node_positions(spans: Sequence[Span]) -> Array:
    """Position of every node along the beam, shape (nodes,), m."""
    points, start = [np.zeros(1)], 0.0
    for span in spans:
        length = span.length / span.elements
        for _ in range(span.elements):
            points.append(start + length * _reference(span.order)[0][1:])
            start += length
    return np.concatenate(points)


def element_error(length: float, order: int, plane: BeamPlane, omega: float, share: float = 1.0) -> float:
    """Largest relative error of an element's energy for motions that fall off as e^(−ωt), seen from its ends.

    Compared with an element of four orders more: K + ω²M of both, what lies between the ends condensed. An element is
    never too soft, so that the error has one sign; eigenvalues near ω² are off by no more than twice as much. Where
    the element is so short that rounding would hide the error it is taken at a higher ω and scaled down with ω²,
    which is more than is left of it at any order from 3 on; at a `share` of that ω the bound is closer.
    """
    visible = share * math.sqrt(plane.bending / plane.mass) / length**2  # a wave number of 1/length
    at = max(omega, visible)
    coarse, fine = (
        condensed_to_ends(_bending_element(length, p, plane), at, length, 2) for p in (order, order + RICHER)
    )
    try:
        return float(np.abs(linalg.eigh(coarse - fine, fine, eigvals_only=True)).max()) * (omega / at) ** 2
    except linalg.LinAlgError:  # what rounding leaves of an absurd element is not positive definite
        return math.inf


def condensed_to_ends(matrices: tuple[Array, Array], omega: float, length: float, per_node: int) -> Array:
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


def spans_between(
    positions: Sequence[float], planes: Sequence[BeamPlane], omega: float, extra_order: int = 0
) -> tuple[Span, ...]:
    """Elements between given points that are exact to `ACCURACY` up to ω.

    Parameters
    ----------
    positions
        Points at which something acts or is observed, rising, m: ends of elements.
    planes
        Bending in each plane.
    omega
        Highest angular frequency, rad/s.
    extra_order
        Orders more than that takes.

    Raises
    ------
    ModelError
        If no number of elements is enough.
    """
    share = _VISIBLE_OF_MANY if len(positions) > MANY_POINTS else 1.0
    return tuple(
        Span(end - start, elements, order + extra_order)
        for start, end in itertools.pairwise(positions)
        for elements, order in [_cheapest(round(end - start, 12), tuple(planes), omega, share)]
    )


@lru_cache(maxsize=256)
def _cheapest(length: float, planes: tuple[BeamPlane, ...], omega: float, share: float) -> tuple[int, int]:
    """Number of elements and order that need the fewest nodes."""
    # shear strain is a difference of two slopes: in a thin beam rounding leaves no more of it than this
    rounding = max(ROUNDING * np.finfo(float).eps * plane.shear * length**2 / plane.bending for plane in planes)
    enough = max(ACCURACY, rounding)

    def accurate(order: int, elements: int) -> bool:
        return max(element_error(length / elements, order, plane, omega, share) for plane in planes) <= enough

    return cheapest_elements(accurate, length, omega, "beam: found a beam")


def cheapest_elements(accurate: Callable[[int, int], bool], length: float, omega: float, where: str) -> tuple[int, int]:
    """Number of elements and order that are accurate up to ω over a length in m and need the fewest nodes.

    Raises
    ------
    ModelError
        If none is; `where` begins the message.
    """
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
            f"{where} with {length:g} m between points and a frequency of {omega / (2 * math.pi):g} Hz; expected one "
            "at which the wavelength is not thousands of times shorter; correct units of length, material or frequency"
        )
    return best
