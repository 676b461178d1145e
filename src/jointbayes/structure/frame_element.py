"""Elements of frames: Timoshenko beams that stretch, twist and bend in two planes, of any order and taper.

The six motions of a section are interpolated independently by polynomials of one order on Gauss-Lobatto-Legendre
points and integrated exactly; the error of such an element falls with the power 2p of its length over the wavelength,
where that of the paper's two-node element falls with the second. Local x runs along the member, local y along the
height of its section, local z along its width. v' = θz and w' = −θy where shear vanishes.

References
----------
Patera, A. T. (1984). A spectral element method for fluid dynamics. Journal of Computational Physics 54(3), 468-488.
DOI 10.1016/0021-9991(84)90128-1 (the nodal basis).
Przemieniecki, J. S. (1968). Theory of Matrix Structural Analysis. McGraw-Hill, sec. 5.6 and 11.5 (two nodes).
Friedman, Z., Kosmatka, J. B. (1993). An improved two-node Timoshenko beam finite element. Computers & Structures 47(3),
473-481. DOI 10.1016/0045-7949(93)90243-7
Cao, H., Li, B., He, Z. A joint stiffness identification method based on finite element modeling and frequency response
functions (element with five DOFs per node, Fig. 3).
"""

import math
from dataclasses import astuple, dataclass, replace
from functools import cache

import numpy as np
from numpy.polynomial import legendre

from jointbayes.errors import ModelError
from jointbayes.structure.section import BeamMaterial, Section
from vibrecords.arrays import Array

#: What a straight beam's six motions (u, v, w, θx, θy, θz) fall into, each with the numbers of its motions.
FIELDS: dict[str, tuple[int, ...]] = {"axial": (0,), "torsion": (3,), "xy": (1, 5), "xz": (2, 4)}

Numbers = float | Array
#: Gauss points beyond those that a uniform element takes: rigidities of a taper are of the fourth degree or rational.
_MORE_POINTS = 4


@dataclass(frozen=True, slots=True)
class BodyFactors:
    """Factors on a body's E, ρ, length, every dimension of its sections, κ, axial forces, and masses at points."""

    youngs_modulus: float = 1.0
    density: float = 1.0
    length: float = 1.0
    section_size: float = 1.0
    shear_coefficient: float = 1.0
    axial_force: float = 1.0
    masses: float = 1.0


@dataclass(frozen=True, slots=True)
class Stretch:
    """A straight piece of a member between two points: what its elements are made from.

    Parameters
    ----------
    length
        Length, m.
    material
        Isotropic material.
    start, end
        Sections at its ends; in between every dimension changes linearly.
    shear_coefficient
        κ for shear along local y and z; None takes Cowper's.
    shear_factor
        Factor on κ.
    axial_force
        Force along it at rest, N, tension positive.
    """

    length: float
    material: BeamMaterial
    start: Section
    end: Section
    shear_coefficient: tuple[float, float] | None = None
    shear_factor: float = 1.0
    axial_force: float = 0.0

    @property
    def tapered(self) -> bool:
        """Whether the section changes along it."""
        return self.start != self.end

    def scaled(self, factors: BodyFactors) -> "Stretch":
        """The stretch with E, ρ, length, every dimension of the section, κ and axial force times factors."""
        e, rho = self.material.youngs_modulus * factors.youngs_modulus, self.material.density * factors.density
        material = replace(self.material, youngs_modulus=e, density=rho)
        sections = self.start.scaled(factors.section_size), self.end.scaled(factors.section_size)
        shear, force = self.shear_factor * factors.shear_coefficient, self.axial_force * factors.axial_force
        return Stretch(self.length * factors.length, material, *sections, self.shear_coefficient, shear, force)

    def part(self, first: float, last: float) -> "Stretch":
        """The piece between two shares of its length."""
        if first == 0 and last == 1:
            return self
        start, end = self.start.between(self.end, first), self.start.between(self.end, last)
        return replace(self, length=self.length * (last - first), start=start, end=end)

    def rigidities(self, shares: Array) -> "Rigidities":
        """Rigidities and inertias at shares (q,) of the length; numbers where it is uniform."""
        if not self.tapered:
            return self._rigidities(self.start)
        sections = [self._rigidities(self.start.between(self.end, x)) for x in shares.tolist()]
        return Rigidities(*np.array([astuple(section) for section in sections]).T)

    def _rigidities(self, section: Section) -> "Rigidities":
        e, g, rho = self.material.youngs_modulus, self.material.shear_modulus, self.material.density
        along_y, along_z = self.shear_coefficient or section.shear_coefficient(self.material.poissons_ratio)
        area, iy, iz = section.area, section.inertia_y, section.inertia_z
        torsion, shear = math.nan if section.torsion is None else section.torsion, self.shear_factor * g * area
        return Rigidities(
            *(e * area, g * torsion, e * iy, e * iz, along_y * shear, along_z * shear),
            *(rho * area, rho * (iy + iz), rho * iy, rho * iz),
        )

    def bending_frequency_hz(self, half_waves: float, *, softer: bool = False) -> float:
        """Frequency below which so many half waves of bending fit the length: of a slender beam, or of pure shear.

        They fit in both planes, or in the `softer` one. Tension raises both.
        """
        at, wave_number = self.rigidities(np.array([0.0, 1.0])), half_waves * np.pi / self.length
        planes = ((at.bending_y, at.shear_z), (at.bending_z, at.shear_y))
        slow = [
            np.minimum(wave_number**2 * np.sqrt(b / at.mass), wave_number * np.sqrt(s / at.mass)).min()
            for b, s in planes
        ]
        taut = wave_number * np.sqrt(max(self.axial_force, 0.0) / at.mass)
        return float(np.hypot((min if softer else max)(slow), np.max(taut))) / (2 * np.pi)


@dataclass(frozen=True, slots=True)
class Rigidities:
    """EA, GJ, EI_y, EI_z, κ_yGA, κ_zGA and ρA, ρ(I_y + I_z), ρI_y, ρI_z, each a number or along a stretch (q,)."""

    axial: Numbers
    torsion: Numbers
    bending_y: Numbers
    bending_z: Numbers
    shear_y: Numbers
    shear_z: Numbers
    mass: Numbers
    polar: Numbers
    rotary_y: Numbers
    rotary_z: Numbers

    def bending(self, field: str) -> tuple[Numbers, Numbers, Numbers]:
        """EI, κGA and ρI of bending in the "xy" or the "xz" plane."""
        if field == "xy":
            return self.bending_z, self.shear_y, self.rotary_z
        return self.bending_y, self.shear_z, self.rotary_y


def lobatto_points(order: int) -> Array:
    """Nodes of an element of an order, from −1 to 1, shape (p + 1,)."""
    inner = legendre.legroots(legendre.legder(np.eye(order + 1)[order])) if order > 1 else np.empty(0)
    return np.concatenate([[-1.0], np.sort(np.real(inner)), [1.0]])


@cache
def _basis(order: int, count: int) -> tuple[Array, Array, Array]:
    """Gauss points on [0, 1] (q,), their weights (q,), and values and slopes there (2, q, p + 1).

    Of the polynomials that are 1 at one Gauss-Lobatto-Legendre point each.
    """
    nodal = np.linalg.inv(legendre.legvander(lobatto_points(order), order))
    at, weight = legendre.leggauss(count)
    value = legendre.legvander(at, order) @ nodal
    slope = np.stack([legendre.legval(at, legendre.legder(row)) for row in np.eye(order + 1)], axis=-1) @ nodal
    return (at + 1) / 2, weight / 2, np.stack([value, 2 * slope])


@cache
def _integrals(order: int) -> Array:
    """∫ of each derivative, the 0th and the 1st, times each over a unit length, shape (2, 2, p + 1, p + 1)."""
    _, weight, basis = _basis(order, order + 1)  # exact to degree 2p + 1
    return np.einsum("iqa,q,jqb->ijab", basis, weight, basis)


def part_matrices(stretch: Stretch, order: int, field: str) -> tuple[Array, Array]:
    """Stiffness and mass of one element of a stretch for one of the `FIELDS`; of order 0 the paper's.

    Its DOFs are those motions, at each of the p + 1 nodes in turn: shape (p + 1, p + 1) or (2p + 2, 2p + 2).

    Raises
    ------
    ModelError
        If its section has no torsion constant and it twists.
    """
    if field == "torsion" and stretch.start.torsion is None:
        remedy = "make it by Section.circle, tube, rectangle or box, or state torsion"
        raise ModelError.of("frame", (), "found a section without a torsion constant", "J in m4", remedy)
    if not order:
        return _paper_matrices(stretch, field)
    points, weight, basis = _basis(order, order + 1 + _MORE_POINTS * stretch.tapered)
    at, length = stretch.rigidities(points), stretch.length

    def integral(i: int, j: int, factor: Numbers) -> Array:
        if not stretch.tapered:
            return factor * _integrals(order)[i, j]
        return (basis[i] * (weight * factor)[:, None]).T @ basis[j]

    if field in ("axial", "torsion"):
        stiffness, mass = (at.axial, at.mass) if field == "axial" else (at.torsion, at.polar)
        return integral(1, 1, stiffness) / length, integral(0, 0, mass) * length
    bending, shear, rotary = at.bending(field)
    sign = -1.0 if field == "xy" else 1.0
    stiffness, mass = np.zeros((2, 2 * (order + 1), 2 * (order + 1)))
    v, t = slice(0, None, 2), slice(1, None, 2)
    # strain energy ½∫EI θ'² + κGA (v' ∓ θ)² dx: − in the x-y plane, + in the x-z plane
    stiffness[v, v] = integral(1, 1, shear) / length
    stiffness[v, t] = sign * integral(1, 0, shear)
    stiffness[t, v] = stiffness[v, t].T
    stiffness[t, t] = integral(1, 1, bending) / length + integral(0, 0, shear) * length
    if stretch.axial_force:
        # second-order work of the force at rest: ½∫N v'² dx
        stiffness[v, v] += integral(1, 1, stretch.axial_force) / length
    mass[v, v], mass[t, t] = integral(0, 0, at.mass) * length, integral(0, 0, rotary) * length
    return stiffness, mass


def _paper_matrices(stretch: Stretch, field: str) -> tuple[Array, Array]:
    """Consistent stiffness and mass of the two-node element of the section at mid-length, shape (2, 2) or (4, 4)."""
    middle = stretch.start.between(stretch.end, 0.5)
    at, length = replace(stretch, start=middle, end=middle).rigidities(np.zeros(1)), stretch.length
    if field in ("axial", "torsion"):
        rigidity, inertia = (at.axial, at.mass) if field == "axial" else (at.torsion, at.polar)
        rod = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([[2.0, 1.0], [1.0, 2.0]])
        return rigidity / length * rod[0], inertia * length / 6 * rod[1]
    bending, shear, rotary = at.bending(field)
    phi = 12 * bending / (shear * length**2)
    slope = length if field == "xy" else -length  # θy = −∂w/∂x
    unit = np.diag([1.0, slope, 1.0, slope])  # so that the tables below are pure numbers
    stiffness = np.array([[12, 6, -12, 6], [6, 4 + phi, -6, 2 - phi], [-12, -6, 12, -6], [6, 2 - phi, -6, 4 + phi]])
    m1, m2 = 13 / 35 + 7 * phi / 10 + phi**2 / 3, 11 / 210 + 11 * phi / 120 + phi**2 / 24
    m3, m4 = 9 / 70 + 3 * phi / 10 + phi**2 / 6, 13 / 420 + 3 * phi / 40 + phi**2 / 24
    m5, m6 = 1 / 105 + phi / 60 + phi**2 / 120, 1 / 140 + phi / 60 + phi**2 / 120
    translation = np.array([[m1, m2, m3, -m4], [m2, m5, m4, -m6], [m3, m4, m1, -m2], [-m4, -m6, -m2, m5]])
    r1, r2 = 6 / 5, 1 / 10 - phi / 2
    r3, r4 = 2 / 15 + phi / 6 + phi**2 / 3, -1 / 30 - phi / 6 + phi**2 / 6
    rotation = np.array([[r1, r2, -r1, r2], [r2, r3, -r2, r4], [-r1, -r2, r1, -r2], [r2, r4, -r2, r3]])
    mass = (at.mass * length * translation + rotary / length * rotation) / (1 + phi) ** 2
    elastic: Array = bending / (length**3 * (1 + phi)) * unit @ stiffness @ unit
    if stretch.axial_force:  # ∫v'² of the element
        g1, g2 = 6 / 5 + 2 * phi + phi**2, 1 / 10
        g3, g4 = 2 / 15 + phi / 6 + phi**2 / 12, -1 / 30 - phi / 6 - phi**2 / 12
        taut = np.array([[g1, g2, -g1, g2], [g2, g3, -g2, g4], [-g1, -g2, g1, -g2], [g2, g4, -g2, g3]])
        elastic = elastic + stretch.axial_force / length * (unit @ (taut / (1 + phi) ** 2) @ unit)
    return elastic, unit @ mass @ unit


def skew(vector: Array) -> Array:
    """Matrix of the cross product: skew(a) @ b = a × b."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def end_transformation(axes: Array, offset: Array) -> Array:
    """Motion of an element's end in its own axes from that of a point, shape (6, 6).

    Parameters
    ----------
    axes
        Local axes, one a row, shape (3, 3).
    offset
        From the point to the end, which a rigid link joins, m, shape (3,).
    """
    transformation = np.zeros((6, 6))
    transformation[:3, :3], transformation[3:, 3:] = axes, axes
    transformation[:3, 3:] = -axes @ skew(offset)  # u_end = u + θ × offset
    return transformation


def mass_matrix(mass: float, inertia: Array, offset: Array) -> Array:
    """Mass matrix (6, 6) at a point of a rigid body with given inertia (3, 3) about its centre, `offset` from there."""
    arm = skew(offset)
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = mass * np.eye(3)
    matrix[:3, 3:], matrix[3:, :3] = -mass * arm, mass * arm  # velocity of the centre: v − offset × ω
    matrix[3:, 3:] = inertia - mass * arm @ arm
    return matrix
