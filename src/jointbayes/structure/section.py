"""Materials and cross-sections of beams: area, second moments of area, torsion constant and Cowper's shear coefficient.

References
----------
Cowper, G. R. (1966). The shear coefficient in Timoshenko's beam theory. Journal of Applied
Mechanics 33(2), 335-340. DOI 10.1115/1.3625046
Timoshenko, S. P., Goodier, J. N. (1970). Theory of Elasticity, 3rd ed., art. 109 (torsion of a rectangle) and
art. 116 (of thin tubes). McGraw-Hill.
"""

import math
from dataclasses import dataclass
from typing import Self

from jointbayes.errors import ModelError

#: Sizes beyond these are none of this world, m; their fourth powers stay finite.
_SMALLEST, _LARGEST = 1e-15, 1e15
_ZETA_5 = 1.0369277551433699  # Σ 1/n⁵
_MOST = 1e100  # of a modulus in Pa or a density in kg/m³: finite, also times a length


@dataclass(frozen=True, slots=True)
class BeamMaterial:
    """Isotropic material: Young's modulus E in Pa, Poisson's ratio ν, density ρ in kg/m³."""

    youngs_modulus: float
    poissons_ratio: float
    density: float

    def __post_init__(self) -> None:
        if not (0 < self.youngs_modulus < _MOST and 0 < self.density < _MOST and -1 < self.poissons_ratio < 0.5):
            found = f"found E = {self.youngs_modulus:g} Pa, nu = {self.poissons_ratio:g}, rho = {self.density:g} kg/m3"
            raise ModelError.of("material", (), found, "E > 0, -1 < nu < 0.5, rho > 0", "correct the material")

    @property
    def shear_modulus(self) -> float:
        """G = E / 2(1 + ν), Pa."""
        return self.youngs_modulus / (2 * (1 + self.poissons_ratio))


def _possible(size: float) -> bool:
    return _SMALLEST <= size <= _LARGEST


@dataclass(frozen=True, slots=True)
class Section:
    """Cross-section in the (y, z) plane of a beam along x.

    Use the constructors `circle`, `tube`, `rectangle` and `box`.

    Parameters
    ----------
    area
        Cross-sectional area A, m².
    inertia_y, inertia_z
        Second moments of area about y and z, m⁴; `inertia_z` governs bending in the x-y plane.
    cowper
        Coefficients (a_y, b_y, a_z, b_z) of Cowper's κ = (1 + ν)/(a + bν) for shear along y and z.
    torsion
        Torsion constant J, m⁴; None where it is not known, which only members that twist mind.
    shape, dimensions
        Name of the constructor and what it was given, m: what a taper goes between.
    """

    area: float
    inertia_y: float
    inertia_z: float
    cowper: tuple[float, float, float, float]
    torsion: float | None = None
    shape: str = ""
    dimensions: tuple[float, ...] = ()

    @classmethod
    def circle(cls, diameter: float) -> Self:
        """Solid circle of the given diameter, m."""
        return cls.tube(diameter, 0.0)

    @classmethod
    def tube(cls, outer_diameter: float, inner_diameter: float) -> Self:
        """Hollow circle; both diameters in m.

        Raises
        ------
        ModelError
            If not 0 ≤ inner < outer.
        """
        if not (0.0 <= inner_diameter < outer_diameter and _possible(outer_diameter)):
            found = f"found {1e3 * inner_diameter:g} mm in an outer diameter of {1e3 * outer_diameter:g} mm: no wall"
            key = ("inner_diameter",) if _possible(outer_diameter) else ("outer_diameter",)
            raise ModelError.of("section", key, found, "0 <= inner < outer", "correct the diameters")
        inertia = math.pi / 64 * (outer_diameter**4 - inner_diameter**4)
        m2 = (inner_diameter / outer_diameter) ** 2
        # Cowper (1966), hollow circle; m = 0 gives 6(1+ν)/(7+6ν)
        a = (7 * (1 + m2) ** 2 + 20 * m2) / (6 * (1 + m2) ** 2)
        b = (6 * (1 + m2) ** 2 + 12 * m2) / (6 * (1 + m2) ** 2)
        area = math.pi / 4 * (outer_diameter**2 - inner_diameter**2)
        polar = 2 * inertia  # a circle does not warp
        return cls(area, inertia, inertia, (a, b, a, b), polar, "tube", (outer_diameter, inner_diameter))

    @classmethod
    def rectangle(cls, width: float, height: float) -> Self:
        """Solid rectangle, `width` along z and `height` along y, m.

        Raises
        ------
        ModelError
            If a side is not positive.
        """
        if not (_possible(width) and _possible(height)):
            found = f"found width {width:g} m and height {height:g} m"
            raise ModelError.of("section", (), found, "both above zero", "correct the sides")
        a, b = 12 / 10, 11 / 10  # Cowper (1966): 10(1+ν)/(12+11ν), for any aspect ratio
        # J = a b³ (1/3 − 64/π⁵ b/a Σ tanh(nπa/2b)/n⁵), n = 1, 3, 5 …, sides a ≥ b: Timoshenko & Goodier, art. 109
        long, short = max(width, height), min(width, height)
        # with Σ 1/n⁵ = 31/32 ζ(5) what is left, Σ (1 − tanh)/n⁵, needs six terms
        rest = sum(2 / ((math.exp(min(n * math.pi * long / short, 700.0)) + 1) * n**5) for n in range(1, 12, 2))
        torsion = long * short**3 * (1 / 3 - 64 / math.pi**5 * short / long * (31 / 32 * _ZETA_5 - rest))
        inertia_y, inertia_z = height * width**3 / 12, width * height**3 / 12
        return cls(width * height, inertia_y, inertia_z, (a, b, a, b), torsion, "rectangle", (width, height))

    @classmethod
    def box(cls, width: float, height: float, wall: float) -> Self:
        """Hollow rectangle with walls of one thickness, outer sides in m; κ and J for thin walls.

        Raises
        ------
        ModelError
            If the walls do not fit: 0 < 2 wall < min(width, height) is needed.
        """
        if not (_possible(width) and _possible(height) and _possible(wall) and 2 * wall < min(width, height)):
            found = f"found a wall of {1e3 * wall:g} mm in a box of {1e3 * width:g} mm x {1e3 * height:g} mm"
            expected = f"a wall above 0 and below {500 * min(width, height):g} mm, half the smaller side"
            raise ModelError.of("section", ("wall",), found, expected, "make it thinner or use a solid rectangle")
        outer, inner = cls.rectangle(width, height), cls.rectangle(width - 2 * wall, height - 2 * wall)
        flange, web = width - wall, height - wall  # sides at mid-wall
        cowper = (*_cowper_thin_box(flange, web), *_cowper_thin_box(web, flange))
        torsion = 2 * wall * (flange * web) ** 2 / (flange + web)  # Bredt: 4 (enclosed area)² / ∮ ds/t
        inertias = outer.inertia_y - inner.inertia_y, outer.inertia_z - inner.inertia_z
        return cls(outer.area - inner.area, *inertias, cowper, torsion, "box", (width, height, wall))

    def scaled(self, size: float, shear: float = 1.0) -> "Section":
        """Section with every dimension multiplied by `size`, and Cowper's κ by `shear`.

        Raises
        ------
        ModelError
            If a factor is not positive.
        """
        if not (size > 0 and shear > 0):
            raise ModelError.of("section", (), f"found factors {size:g} of size and {shear:g} of κ", "both above zero")
        a_y, b_y, a_z, b_z = (c / shear for c in self.cowper)
        area, bending = self.area * size**2, size**4
        inertias, cowper = (self.inertia_y * bending, self.inertia_z * bending), (a_y, b_y, a_z, b_z)
        torsion = None if self.torsion is None else self.torsion * bending
        return Section(area, *inertias, cowper, torsion, self.shape, tuple(d * size for d in self.dimensions))

    def between(self, other: "Section", share: float) -> "Section":
        """Section at a share of the way to another one of the same shape, every dimension changing linearly.

        Raises
        ------
        ModelError
            If the two are of different shapes, or one was not made by a constructor.
        """
        if self == other or share == 0:
            return self
        if not self.shape or self.shape != other.shape:
            first, last = (each.shape or "a section of given constants" for each in (self, other))
            expected = "two sections of one shape (a circle is a tube without a bore); make it of two members"
            raise ModelError(f"section: found a taper from {first} to {last}; expected {expected}")
        ends = zip(self.dimensions, other.dimensions, strict=True)
        return getattr(Section, self.shape)(*((1 - share) * a + share * b for a, b in ends))

    def shear_coefficient(self, poissons_ratio: float) -> tuple[float, float]:
        """Cowper's κ for shear along y and along z.

        Examples
        --------
        >>> round(Section.circle(0.025).shear_coefficient(0.3)[0], 6)
        0.886364
        """
        a_y, b_y, a_z, b_z = self.cowper
        nu = poissons_ratio
        return (1 + nu) / (a_y + b_y * nu), (1 + nu) / (a_z + b_z * nu)


def _cowper_thin_box(flange: float, web: float) -> tuple[float, float]:
    """Coefficients (a, b) for a thin-walled box of one wall thickness, sides at mid-wall."""
    m = n = flange / web
    scale = 10 * (1 + 3 * m) ** 2
    a = 12 + 72 * m + 150 * m**2 + 90 * m**3 + 10 * n**2 * (3 * m + 3 * m**2)
    b = 11 + 66 * m + 135 * m**2 + 90 * m**3 + 10 * n**2 * m
    return a / scale, b / scale
