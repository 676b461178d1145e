"""Straight Timoshenko beams of equal two-node elements.

References
----------
Przemieniecki, J. S. (1968). Theory of Matrix Structural Analysis. McGraw-Hill.
Friedman, Z., Kosmatka, J. B. (1993). An improved two-node Timoshenko beam finite element.
Computers & Structures 47(3), 473-481. DOI 10.1016/0045-7949(93)90243-7
Cao, H., Li, B., He, Z. A joint stiffness identification method based on finite element modeling and
frequency response functions (element with five DOFs per node, Fig. 3).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointbayes.errors import ModelError
from jointbayes.structure.damping import DampingLaw
from jointbayes.structure.matrices import Structure
from jointbayes.structure.section import Section
from vibrecords.arrays import Array

#: Directions of the DOFs of a node, by their number.
DIRECTIONS: dict[int, tuple[str, ...]] = {2: ("y", "rz"), 5: ("x", "y", "z", "ry", "rz")}


_MOST = 1e100  # of a modulus in Pa or a density in kg/m³: finite, also times a length


@dataclass(frozen=True, slots=True)
class BeamMaterial:
    """Isotropic material: Young's modulus E in Pa, Poisson's ratio ν, density ρ in kg/m³."""

    youngs_modulus: float
    poissons_ratio: float
    density: float

    def __post_init__(self) -> None:
        if not (0 < self.youngs_modulus < _MOST and 0 < self.density < _MOST and -1 < self.poissons_ratio < 0.5):
            raise ModelError(
                f"material: found E = {self.youngs_modulus:g} Pa, nu = {self.poissons_ratio:g}, "
                f"rho = {self.density:g} kg/m3; expected E > 0, -1 < nu < 0.5, rho > 0; correct the material"
            )

    @property
    def shear_modulus(self) -> float:
        """G = E / 2(1 + ν), Pa."""
        return self.youngs_modulus / (2 * (1 + self.poissons_ratio))


def bending_element(
    length: float, material: BeamMaterial, area: float, inertia: float, shear_coefficient: float
) -> tuple[Array, Array]:
    """Timoshenko bending element with DOFs (v₁, θ₁, v₂, θ₂), θ = ∂v/∂x where shear vanishes.

    Parameters
    ----------
    length
        Element length l, m.
    material
        Isotropic material.
    area, inertia
        Area A in m² and second moment of area I in m⁴ of the section.
    shear_coefficient
        κ; as it tends to infinity the element becomes Euler-Bernoulli's with rotary inertia.

    Returns
    -------
    stiffness, mass : ndarray, shape (4, 4), consistent, rotary inertia included

    References
    ----------
    Przemieniecki (1968), sec. 5.6 and 11.5; Friedman & Kosmatka (1993), DOI 10.1016/0045-7949(93)90243-7
    """
    ei = material.youngs_modulus * inertia
    phi = 12 * ei / (shear_coefficient * material.shear_modulus * area * length**2)
    unit = np.diag([1.0, length, 1.0, length])  # so that the tables below are pure numbers

    stiffness = np.array(
        [
            [12, 6, -12, 6],
            [6, 4 + phi, -6, 2 - phi],
            [-12, -6, 12, -6],
            [6, 2 - phi, -6, 4 + phi],
        ]
    )
    m1, m2 = 13 / 35 + 7 * phi / 10 + phi**2 / 3, 11 / 210 + 11 * phi / 120 + phi**2 / 24
    m3, m4 = 9 / 70 + 3 * phi / 10 + phi**2 / 6, 13 / 420 + 3 * phi / 40 + phi**2 / 24
    m5, m6 = 1 / 105 + phi / 60 + phi**2 / 120, 1 / 140 + phi / 60 + phi**2 / 120
    translation = np.array(
        [
            [m1, m2, m3, -m4],
            [m2, m5, m4, -m6],
            [m3, m4, m1, -m2],
            [-m4, -m6, -m2, m5],
        ]
    )
    r1, r2 = 6 / 5, 1 / 10 - phi / 2
    r3, r4 = 2 / 15 + phi / 6 + phi**2 / 3, -1 / 30 - phi / 6 + phi**2 / 6
    rotation = np.array(
        [
            [r1, r2, -r1, r2],
            [r2, r3, -r2, r4],
            [-r1, -r2, r1, -r2],
            [r2, r4, -r2, r3],
        ]
    )
    rho = material.density
    mass = (rho * area * length * translation + rho * inertia / length * rotation) / (1 + phi) ** 2
    return ei / (length**3 * (1 + phi)) * unit @ stiffness @ unit, unit @ mass @ unit


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
    """Free-free straight beam along x.

    Parameters
    ----------
    length
        Length, m.
    section, material, damping
        Cross-section, material and damping law.
    elements
        Number of equal elements; the nodes are numbered 1 to elements + 1.
    dofs_per_node
        2: deflection ``y`` and rotation ``rz`` in the x-y plane.  5: ``x, y, z, ry, rz``, the paper's
        element (two bending planes and axial motion, no torsion).
    shear_coefficient
        κ for both planes; None takes Cowper's formula for the section.

    Returns
    -------
    Structure
        dofs_per_node × (elements + 1) DOFs, labelled ``"node:direction"``.

    Raises
    ------
    ModelError
        If the length, the element count or κ is not positive.

    Examples
    --------
    >>> from jointbayes.structure import ModalDamping
    >>> steel = BeamMaterial(2.1e11, 0.3, 7800.0)
    >>> rod = beam(0.383, Section.circle(0.025), steel, ModalDamping((0.01,)))
    >>> rod.fixed(["1:y", "1:rz"]).modes().frequency_hz[:2].round(2).tolist()
    [123.41, 762.62]
    """
    if not (length > 0 and elements >= 1 and dofs_per_node in DIRECTIONS):
        raise ModelError(
            f"beam: found length {length:g} m, {elements} elements, {dofs_per_node} DOFs per node; "
            "expected length > 0, at least 1 element, 2 or 5 DOFs per node; correct the beam"
        )
    if shear_coefficient is not None and not shear_coefficient > 0:
        raise ModelError(f"beam: found shear coefficient {shear_coefficient:g}; expected a number above 0")
    along_y, along_z = (shear_coefficient or cowper for cowper in section.shear_coefficient(material.poissons_ratio))
    whole = spatial_element(length / elements, section, material, along_y, along_z)
    element_stiffness, element_mass = (matrix[np.ix_(_ROWS[dofs_per_node], _ROWS[dofs_per_node])] for matrix in whole)
    n = dofs_per_node * (elements + 1)
    stiffness, mass = np.zeros((n, n)), np.zeros((n, n))
    for e in range(elements):
        rows = slice(e * dofs_per_node, (e + 2) * dofs_per_node)
        stiffness[rows, rows] += element_stiffness
        mass[rows, rows] += element_mass
    dofs = tuple(f"{node}:{d}" for node in range(1, elements + 2) for d in DIRECTIONS[dofs_per_node])
    return Structure(stiffness, mass, damping, dofs)


#: Rows of (x, y, z, rx, ry, rz) at both ends of the two-node element that a beam of so many DOFs per node has.
_ROWS = {2: (1, 5, 7, 11), 5: (0, 1, 2, 4, 5, 6, 7, 8, 10, 11)}


def spatial_element(
    length: float, section: Section, material: BeamMaterial, along_y: float, along_z: float
) -> tuple[Array, Array]:
    """The paper's two-node element with its torsion, DOFs (x, y, z, rx, ry, rz) at either end.

    Parameters
    ----------
    length
        Element length, m.
    section, material
        Cross-section and material.
    along_y, along_z
        Shear coefficients κ.

    Returns
    -------
    stiffness, mass : ndarray, shape (12, 12), consistent

    References
    ----------
    Przemieniecki (1968), sec. 5.6 and 11.5
    """
    in_plane = bending_element(length, material, section.area, section.inertia_z, along_y)
    out_of_plane = bending_element(length, material, section.area, section.inertia_y, along_z)
    rod = np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([[2.0, 1.0], [1.0, 2.0]])
    axial = (
        material.youngs_modulus * section.area / length * rod[0],
        material.density * section.area * length / 6 * rod[1],
    )
    twist = (
        material.shear_modulus * (section.torsion or 0.0) / length * rod[0],
        material.density * (section.inertia_y + section.inertia_z) * length / 6 * rod[1],
    )
    # ry = -∂w/∂x turns the sign of the slope
    sign = np.diag([1.0, -1.0, 1.0, -1.0])
    matrices = []
    for along, about, xy, xz in zip(axial, twist, in_plane, out_of_plane, strict=True):
        full = np.zeros((12, 12))
        full[np.ix_([0, 6], [0, 6])] = along
        full[np.ix_([3, 9], [3, 9])] = about
        full[np.ix_([1, 5, 7, 11], [1, 5, 7, 11])] = xy
        full[np.ix_([2, 4, 8, 10], [2, 4, 8, 10])] = sign @ xz @ sign
        matrices.append(full)
    return matrices[0], matrices[1]
