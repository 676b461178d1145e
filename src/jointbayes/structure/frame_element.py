"""Elements of space frames: Timoshenko beams that stretch, twist and bend in two planes, of any order and taper.

The six motions of a section are interpolated independently by polynomials of one order on Gauss-Lobatto-Legendre
points, as `jointbayes.structure.high_order` does for one plane. Local x runs along the member, local y along the height
of its section, local z along its width. v' = θz and w' = −θy where shear vanishes.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.polynomial import legendre

from jointbayes.errors import ModelError
from jointbayes.structure.beam import BeamMaterial, spatial_element
from jointbayes.structure.high_order import element_points
from jointbayes.structure.section import Section
from vibrecords.arrays import Array

#: What a straight beam's six motions (u, v, w, θx, θy, θz) fall into, each with the numbers of its motions.
FIELDS: dict[str, tuple[int, ...]] = {"axial": (0,), "torsion": (3,), "xy": (1, 5), "xz": (2, 4)}

#: Gauss points beyond those that a uniform element takes: rigidities of a taper are of the fourth degree or rational.
_MORE_POINTS = 4


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
    """

    length: float
    material: BeamMaterial
    start: Section
    end: Section
    shear_coefficient: tuple[float, float] | None = None
    shear_factor: float = 1.0

    @property
    def tapered(self) -> bool:
        """Whether the section changes along it."""
        return self.start != self.end

    def scaled(self, stiffness: float, density: float, length: float, size: float, shear: float) -> "Stretch":
        """The stretch with E, ρ, length, every dimension of the section and κ times factors."""
        e, rho = self.material.youngs_modulus * stiffness, self.material.density * density
        return Stretch(
            self.length * length,
            replace(self.material, youngs_modulus=e, density=rho),
            self.start.scaled(size),
            self.end.scaled(size),
            self.shear_coefficient,
            self.shear_factor * shear,
        )

    def part(self, first: float, last: float) -> "Stretch":
        """The piece between two shares of its length."""
        if first == 0 and last == 1:
            return self
        start, end = self.start.between(self.end, first), self.start.between(self.end, last)
        return replace(self, length=self.length * (last - first), start=start, end=end)

    def rigidities(self, shares: Array) -> "Rigidities":
        """Rigidities and inertias at shares (q,) of the length."""
        sections = [self.start.between(self.end, x) for x in shares.tolist()] if self.tapered else [self.start]
        constants = np.array([self._constants(section) for section in sections])
        return Rigidities(*np.broadcast_to(constants, (shares.size, constants.shape[1])).T)

    def _constants(self, section: Section) -> tuple[float, ...]:
        e, g, rho = self.material.youngs_modulus, self.material.shear_modulus, self.material.density
        along_y, along_z = self.shear_coefficient or section.shear_coefficient(self.material.poissons_ratio)
        if section.torsion is None:
            raise ModelError(
                "frame: found a section without a torsion constant; expected J in m4; make it by Section.circle, tube, "
                "rectangle or box, or state torsion"
            )
        area, iy, iz = section.area, section.inertia_y, section.inertia_z
        shear = self.shear_factor * g * area
        return (
            *(e * area, g * section.torsion, e * iy, e * iz, along_y * shear, along_z * shear),
            *(rho * area, rho * (iy + iz), rho * iy, rho * iz),
        )


@dataclass(frozen=True, slots=True)
class Rigidities:
    """EA, GJ, EI_y, EI_z, κ_yGA, κ_zGA and ρA, ρ(I_y + I_z), ρI_y, ρI_z along a stretch, each of shape (q,)."""

    axial: Array
    torsion: Array
    bending_y: Array
    bending_z: Array
    shear_y: Array
    shear_z: Array
    mass: Array
    polar: Array
    rotary_y: Array
    rotary_z: Array


@cache
def _gauss(order: int, count: int) -> tuple[Array, Array, Array, Array]:
    """Gauss points on [0, 1] (q,), weights (q,), and values and slopes (q, p + 1) of the nodal polynomials there."""
    nodal = np.linalg.inv(legendre.legvander(2 * element_points(order) - 1, order))
    at, weight = legendre.leggauss(count)
    value = legendre.legvander(at, order) @ nodal
    slope = np.stack([legendre.legval(at, legendre.legder(row)) for row in np.eye(order + 1)], axis=-1) @ nodal
    return (at + 1) / 2, weight / 2, value, 2 * slope


def part_matrices(stretch: Stretch, order: int, field: str) -> tuple[Array, Array]:
    """Stiffness and mass of one element of a stretch for one of the `FIELDS`.

    Its DOFs are those motions, at each of the p + 1 nodes in turn: shape (p + 1, p + 1) or (2p + 2, 2p + 2).
    """
    points, weight, value, slope = _gauss(order, order + 1 + _MORE_POINTS * stretch.tapered)
    at, length = stretch.rigidities(points), stretch.length

    def form(left: Array, right: Array, factor: Array) -> Array:
        return (left * (weight * factor)[:, None]).T @ right

    if field == "axial":
        return form(slope, slope, at.axial) / length, form(value, value, at.mass) * length
    if field == "torsion":
        return form(slope, slope, at.torsion) / length, form(value, value, at.polar) * length
    shear, bending, rotary, sign = (
        (at.shear_y, at.bending_z, at.rotary_z, -1.0) if field == "xy" else (at.shear_z, at.bending_y, at.rotary_y, 1.0)
    )
    size = 2 * (order + 1)
    v, t = slice(0, None, 2), slice(1, None, 2)
    stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
    # strain energy ½∫EI θ'² + κGA (v' ∓ θ)² dx: − in the x-y plane, + in the x-z plane
    stiffness[v, v] = form(slope, slope, shear) / length
    stiffness[v, t] = sign * form(slope, value, shear)
    stiffness[t, v] = stiffness[v, t].T
    stiffness[t, t] = form(slope, slope, bending) / length + form(value, value, shear) * length
    mass[v, v], mass[t, t] = form(value, value, at.mass) * length, form(value, value, rotary) * length
    return stiffness, mass


def local_matrices(stretch: Stretch, order: int) -> tuple[Array, Array]:
    """Stiffness and mass of one element, DOFs (u, v, w, θx, θy, θz) at each node, shape (6(p + 1), 6(p + 1))."""
    nodes = 6 * np.arange(order + 1)
    stiffness, mass = np.zeros((2, 6 * (order + 1), 6 * (order + 1)))
    for field, motions in FIELDS.items():
        rows = (nodes[:, None] + np.array(motions)).ravel()
        stiffness[np.ix_(rows, rows)], mass[np.ix_(rows, rows)] = part_matrices(stretch, order, field)
    return stiffness, mass


def paper_matrices(stretch: Stretch) -> tuple[Array, Array]:
    """Stiffness and mass of the two-node element of the section at mid-length, shape (12, 12)."""
    section = stretch.start.between(stretch.end, 0.5)
    if section.torsion is None:
        stretch.rigidities(np.zeros(1))  # says what is missing
    cowper = stretch.shear_coefficient or section.shear_coefficient(stretch.material.poissons_ratio)
    along_y, along_z = (stretch.shear_factor * kappa for kappa in cowper)
    return spatial_element(stretch.length, section, stretch.material, along_y, along_z)


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
