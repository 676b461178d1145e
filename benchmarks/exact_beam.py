"""Exact FRFs of a uniform Timoshenko beam with a joint to ground: a truth that has no mesh.

Between two points the equations of motion are solved by trigonometric and hyperbolic functions of x, which gives a
dynamic stiffness for each span; the spans are assembled at the points. Nothing of jointbayes is imported, the shear
coefficients included, so that an error there cannot hide behind the same error here.

Conventions: bending in the x-y plane, DOFs ``"n:y"`` (deflection v) and ``"n:rz"`` (rotation θ, = ∂v/∂x where shear
vanishes) at numbered points; forces and moments that do work on these.

References
----------
Cowper, G. R. (1966). The shear coefficient in Timoshenko's beam theory. Journal of Applied Mechanics 33(2), 335-340.
DOI 10.1115/1.3625046
Howson, W. P., Williams, F. W. (1973). Natural frequencies of frames with axially loaded Timoshenko members. Journal of
Sound and Vibration 26(4), 503-515. DOI 10.1016/S0022-460X(73)80216-0
Wittrick, W. H., Williams, F. W. (1971). A general algorithm for computing natural frequencies of elastic structures.
Quarterly Journal of Mechanics and Applied Mathematics 24(3), 263-284. DOI 10.1093/qjmam/24.3.263
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: Below this |λ|h the difference of hyperbolic functions is taken from its series; above this Re λh they are scaled.
_SMALL, _LARGE = 0.5, 20.0
_SERIES_TERMS = 10
#: Relative step of the complex-step derivative along ω²: no difference is formed, so it may be as small as one likes.
_STEP = 1e-30
#: Modes above this multiple of the highest line are no part of the band; points on the circle that gives their sum.
_BAND, _CIRCLE = 3.0, 64
_BISECTIONS = 60


@dataclass(frozen=True, slots=True)
class CrossSection:
    """Area A in m², second moment of area I in m⁴ for bending in the x-y plane, shear coefficient κ."""

    area: float
    inertia: float
    shear_coefficient: float


def circle(diameter: float, nu: float) -> CrossSection:
    """Solid circle, κ = 6(1 + ν)/(7 + 6ν)."""
    kappa = 6 * (1 + nu) / (7 + 6 * nu)
    return CrossSection(math.pi * diameter**2 / 4, math.pi * diameter**4 / 64, kappa)


def tube(outer: float, inner: float, nu: float) -> CrossSection:
    """Hollow circle, κ = 6(1 + ν)(1 + m²)²/[(7 + 6ν)(1 + m²)² + (20 + 12ν)m²] with m = inner/outer diameter."""
    m2 = (inner / outer) ** 2
    kappa = 6 * (1 + nu) * (1 + m2) ** 2 / ((7 + 6 * nu) * (1 + m2) ** 2 + (20 + 12 * nu) * m2)
    return CrossSection(math.pi / 4 * (outer**2 - inner**2), math.pi / 64 * (outer**4 - inner**4), kappa)


def rectangle(width: float, height: float, nu: float) -> CrossSection:
    """Rectangle, `height` along y, the direction of motion: κ = 10(1 + ν)/(12 + 11ν)."""
    return CrossSection(width * height, width * height**3 / 12, 10 * (1 + nu) / (12 + 11 * nu))


@dataclass(frozen=True)
class ExactModes:
    """Undamped modes: ω in rad/s, shape (m,), and shapes of unit modal mass at all DOFs, shape (m, DOFs)."""

    omega: Array
    shapes: Array


@dataclass(frozen=True)
class ExactBeam:
    """Uniform Timoshenko beam from x = 0 to its length, free at both ends but for a joint to ground at one point.

    Parameters
    ----------
    length
        Length, m.
    section
        Cross-section.
    youngs_modulus, poissons_ratio, density
        E in Pa, ν, ρ in kg/m³; G = E/2(1 + ν).
    points
        Position in m of each numbered point, by number.
    stiffness
        (k11, k12, k22) of the joint's K^J in N/m, N and N·m/rad.
    joint_point
        Number of the point that the joint holds.
    masses
        Point masses in kg, without rotary inertia, by number of the point.
    """

    length: float
    section: CrossSection
    youngs_modulus: float
    poissons_ratio: float
    density: float
    points: Mapping[int, float]
    stiffness: tuple[float, float, float]
    joint_point: int = 1
    masses: Mapping[int, float] = field(default_factory=dict)

    @cached_property
    def positions(self) -> Array:
        """Positions of the ends of all spans, m: the points and both ends of the beam."""
        return np.unique([0.0, self.length, *self.points.values()])

    @property
    def _bending(self) -> float:
        return self.youngs_modulus * self.section.inertia

    @property
    def _shear(self) -> float:
        modulus = self.youngs_modulus / (2 * (1 + self.poissons_ratio))
        return self.section.shear_coefficient * modulus * self.section.area

    @cached_property
    def _scale(self) -> Array:
        """Scale of each DOF, so that rounding is relative to the beam's stiffness however stiff the joint is."""
        stiffness = np.tile([self._bending / self.length**3, self._bending / self.length], self.positions.size)
        at_joint = self.index([f"{self.joint_point}:y", f"{self.joint_point}:rz"])
        stiffness[at_joint] += [self.stiffness[0], self.stiffness[2]]
        return 1 / np.sqrt(stiffness)

    def index(self, labels: Sequence[str]) -> list[int]:
        """Rows of DOFs such as ``"11:y"`` in the dynamic stiffness."""
        found = []
        for label in labels:
            number, direction = label.split(":")
            node = int(np.searchsorted(self.positions, self.points[int(number)]))
            found.append(2 * node + ("y", "rz").index(direction))
        return found

    def dynamic_stiffness(self, squared: ArrayLike, elastic: ArrayLike = 1.0, inertial: ArrayLike = 1.0) -> Complex:
        """Assembled D(ω²) with joint and masses, shape (n, DOFs, DOFs), at n values of ω², complex if so wished.

        `elastic` and `inertial` multiply the stiffness and the mass of the beam, and the latter its point masses.
        """
        squared, elastic, inertial = np.broadcast_arrays(
            *(np.atleast_1d(np.asarray(v, dtype=complex)) for v in (squared, elastic, inertial))
        )
        size = 2 * self.positions.size
        out = np.zeros((squared.size, size, size), dtype=complex)
        for i, length in enumerate(np.diff(self.positions)):
            rows = slice(2 * i, 2 * i + 4)
            out[:, rows, rows] += _stiffness_of(self._span(float(length), squared, elastic, inertial))
        for number, mass in self.masses.items():
            (row,) = self.index([f"{number}:y"])
            out[:, row, row] -= mass * inertial * squared
        first, second = self.index([f"{self.joint_point}:y", f"{self.joint_point}:rz"])
        k11, k12, k22 = self.stiffness
        out[:, first, first] += k11
        out[:, first, second] += k12
        out[:, second, first] += k12
        out[:, second, second] += k22
        return out

    def _span(self, length: float, squared: Complex, elastic: Complex, inertial: Complex) -> "_Halves":
        mass = self.density * self.section.area * inertial * squared
        return _halves(
            length / 2,
            mass,
            self._bending * elastic,
            a=self.density * inertial * squared / (self.youngs_modulus * elastic),
            b=mass / (self._shear * elastic),
        )

    def receptance(
        self,
        frequency_hz: ArrayLike,
        outputs: Sequence[str],
        inputs: Sequence[str],
        *,
        loss_factor: float = 0.0,
        alpha: float = 0.0,
        beta: float = 0.0,
    ) -> Complex:
        """Receptances, shape (lines, outputs, inputs), with structural or Rayleigh damping of the beam.

        Structural: E(1 + jη), G(1 + jη). Rayleigh: C = αM + βK of beam and point masses. The joint has no damping.
        """
        omega = 2 * np.pi * np.atleast_1d(np.asarray(frequency_hz, dtype=float))
        elastic = 1 + 1j * loss_factor + 1j * beta * omega
        return self._solved(omega**2 + 0j, outputs, inputs, elastic, 1 - 1j * alpha / omega)

    def _solved(
        self,
        squared: Complex,
        outputs: Sequence[str],
        inputs: Sequence[str],
        elastic: ArrayLike = 1.0,
        inertial: ArrayLike = 1.0,
    ) -> Complex:
        stiffness = self.dynamic_stiffness(squared, elastic, inertial)
        loads = np.eye(stiffness.shape[-1])[:, self.index(inputs)]
        return np.linalg.solve(stiffness, np.broadcast_to(loads, (len(stiffness), *loads.shape)))[
            :, self.index(outputs)
        ]

    def count_below(self, omega: ArrayLike) -> NDArray[np.int64]:
        """Number of natural frequencies below each ω in rad/s, shape (n,), after Wittrick and Williams (1971).

        Negative eigenvalues of D, and the frequencies of the spans with both ends clamped (Howson and Williams 1973):
        as many as with simple supports, sin(nπx/l), less the negative ones among the moments' stiffnesses.
        """
        squared = np.atleast_1d(np.asarray(omega, dtype=float)) ** 2 + 0j
        one = np.ones_like(squared)
        stiffness = self.dynamic_stiffness(squared).real * np.outer(self._scale, self._scale)
        count = (np.linalg.eigvalsh(stiffness) < 0).sum(axis=1)
        for length in np.diff(self.positions):
            span = self._span(float(length), squared, one, one)
            waves = np.floor(np.sqrt(np.maximum(-span.roots.real, 0)) * length / np.pi)
            above_cut_off = span.roots[0].real < 0  # where even n = 0, rotation alone, oscillates
            count += waves.sum(axis=0).astype(int) + above_cut_off
            count -= (span.even[2].real < 0).astype(int) + (span.odd[2].real < 0)
        return count

    def modes(self, highest_hz: float) -> ExactModes:
        """All undamped modes up to a frequency: bisection on their number, and one step of Newton's on φᵀD(ω²)φ = 0."""
        highest = 2 * np.pi * highest_hz
        number = np.arange(1, int(self.count_below(highest)[0]) + 1)
        grid = np.concatenate([[0.0], np.geomspace(1e-5 * highest, highest, 400)])
        below = np.concatenate([[0], self.count_below(grid[1:])])
        upper = np.searchsorted(np.maximum.accumulate(below), number)
        low, high = grid[upper - 1], grid[upper]
        for _ in range(_BISECTIONS):
            middle = (low + high) / 2
            reached = self.count_below(middle) >= number
            low, high = np.where(reached, low, middle), np.where(reached, middle, high)
        squared = ((low + high) / 2) ** 2
        stepped = self.dynamic_stiffness(squared * (1 + 1j * _STEP)) * np.outer(self._scale, self._scale)
        values, vectors = np.linalg.eigh(stepped.real)
        least = np.abs(values).argmin(axis=1)
        shapes = np.take_along_axis(vectors, least[:, None, None], axis=2)[:, :, 0]
        slope = stepped.imag / (_STEP * squared[:, None, None])
        # −φᵀ(∂D/∂ω²)φ is the modal mass of the whole mode, spans included
        mass = -np.einsum("mi,mij,mj->m", shapes, slope, shapes)
        squared = squared + np.take_along_axis(values, least[:, None], axis=1)[:, 0] / mass
        return ExactModes(np.sqrt(squared), shapes * self._scale / np.sqrt(mass)[:, None])

    def modal_receptance(
        self,
        frequency_hz: ArrayLike,
        outputs: Sequence[str],
        inputs: Sequence[str],
        ratios: Sequence[float],
        reach: float = 60.0,
    ) -> Complex:
        """Receptances, shape (lines, outputs, inputs), with damping ratios of the modes of beam *and* joint.

        Modes up to `reach` times the highest line are damped; those above are summed exactly, without damping, which
        they hardly feel at the lines (their share of it falls with the cube of their frequency).

        Parameters
        ----------
        ratios
            ζ of the first modes in order of frequency; the last one holds for all above.
        """
        frequency = np.atleast_1d(np.asarray(frequency_hz, dtype=float))
        omega = 2 * np.pi * frequency
        modes = self.modes(reach * float(frequency.max()))
        given = np.asarray(ratios, dtype=float)[: modes.omega.size]
        zeta = np.concatenate([given, np.full(modes.omega.size - given.size, given[-1])])
        residues = modes.shapes[:, self.index(outputs), None] * modes.shapes[:, None, self.index(inputs)]
        own = modes.omega[:, None]
        damped = 1 / (own**2 - omega**2 + 2j * zeta[:, None] * own * omega)
        # the highest mode that is taken out of the undamped sum leaves it analytic up to the next one's ω²
        in_band = max(int((modes.omega <= _BAND * omega.max()).sum()), 1)
        undamped = 1 / (own[in_band:] ** 2 - omega**2)
        summed = np.einsum("mab,ml->lab", residues, damped) - np.einsum(
            "mab,ml->lab", residues[in_band:], undamped + 0j
        )
        return summed + self._above(omega, modes, residues, in_band, outputs, inputs)

    def _above(
        self,
        omega: Array,
        modes: ExactModes,
        residues: Array,
        in_band: int,
        outputs: Sequence[str],
        inputs: Sequence[str],
    ) -> Complex:
        """Undamped share of all modes but the first `in_band`: a power series in ω² from values on a circle."""
        radius = float(omega.max()) * float(modes.omega[in_band])
        circle_points = radius * np.exp(2j * np.pi * (np.arange(_CIRCLE) + 0.5) / _CIRCLE)
        values = self._solved(circle_points, outputs, inputs)
        poles = 1 / (modes.omega[:in_band, None] ** 2 - circle_points)
        values -= np.einsum("mab,mc->cab", residues[:in_band], poles)
        orders = np.arange(_CIRCLE // 2)
        weights = (circle_points[None, :] / radius) ** -orders[:, None] / _CIRCLE
        coefficients = np.einsum("kc,cab->kab", weights, values).real
        powers = (omega**2 / radius)[:, None] ** orders
        return np.einsum("lk,kab->lab", powers, coefficients) + 0j


@dataclass(frozen=True, slots=True)
class _Halves:
    """Dynamic stiffness of a span in its two symmetries, as (force/v, force/θ = moment/v, moment/θ) at its right end.

    `even` has v even and θ odd about the middle, `odd` the reverse; `roots` are the two values of λ² of e^{λx}.
    """

    even: tuple[Complex, Complex, Complex]
    odd: tuple[Complex, Complex, Complex]
    roots: Complex


def _halves(half: float, mass: Complex, bending: Complex, a: Complex, b: Complex) -> _Halves:
    """Solve the equations of motion in a span of length 2h for the ends' forces and moments.

    With v' = dv/dx: κGA(v'' − θ') + ρAω²v = 0 and EIθ'' + κGA(v' − θ) + ρIω²θ = 0. For v ∝ e^{λx} it follows that
    (λ² + a)(λ² + b) = ρAω²/EI with a = ρω²/E, b = ρω²/κG, and θ = (λ² + b)v/λ. Shear force κGA(v' − θ) and moment
    EIθ' at x = h follow from cosh λx and sinh(λx)/λ of the two λ², which are functions of λ² and so have no branches.

    Parameters
    ----------
    half
        h, m.
    mass, bending
        ρAω² and EI, shape (n,).
    """
    c4 = mass / bending
    root = np.sqrt((a - b) ** 2 + 4 * c4)
    root = np.where(((a + b) * root.conj()).real < 0, -root, root)
    second = -(a + b + root) / 2
    product = a * b - c4
    first = product / second
    cosh1, sinh1, scale1 = _hyperbolic(first, half)
    cosh2, sinh2, scale2 = _hyperbolic(second, half)
    # P = (C₁S₂ − C₂S₁)/(λ₁² − λ₂²), Q = (C₁λ₂²S₂ − C₂λ₁²S₁)/(λ₁² − λ₂²), all with the scale of C₁C₂
    p = (cosh1 * sinh2 - cosh2 * sinh1) / (first - second)
    small = np.maximum(np.abs(first), np.abs(second)) * half**2 < _SMALL**2
    p[small] = _series(first[small] * half**2, second[small] * half**2) * half**3 * scale1[small] * scale2[small]
    q = (cosh1 * second * sinh2 - cosh2 * first * sinh1) / (first - second)
    even, odd = q + b * p, product * p + b * q
    return _Halves(
        (mass * sinh1 * sinh2 / even, -mass * p / even, -bending * cosh1 * cosh2 / even),
        (-mass * cosh1 * cosh2 / odd, -mass * q / odd, bending * product * sinh1 * sinh2 / odd),
        np.stack([first, second]),
    )


def _hyperbolic(squared: Complex, half: float) -> tuple[Complex, Complex, Array]:
    """cosh λh and sinh(λh)/λ, both times the scale e^{−Re λh}, and that scale."""
    root = np.sqrt(squared)
    x = root * half
    scale = np.exp(-np.minimum(np.abs(x.real), 700.0))
    large = np.abs(x.real) > _LARGE
    moderate = np.where(large, 0.0, x)
    growing = np.exp(np.where(large, x - x.real, 0.0)) / 2
    cosh = np.where(large, growing, np.cosh(moderate) * scale)
    with np.errstate(divide="ignore", invalid="ignore"):
        sinh = np.where(large, growing, np.sinh(moderate) * scale) / root
    return cosh, np.where(squared == 0, half, sinh), scale


def _series(first: Complex, second: Complex) -> Complex:
    """P/h³ for small x₁² = λ₁²h², x₂²: 2 Σ_{k≥1} (uᵏ − wᵏ)/(u − w)/(2k + 1)! with u, w = (x₁ ± x₂)².

    No square root is taken, so that a tiny imaginary part of ω² is carried through (complex-step derivative).
    """
    total, product = first + second, (first - second) ** 2  # u + w is twice the first, u w the second
    before, symmetric = np.zeros_like(total), np.ones_like(total)
    out = np.zeros_like(total)
    for k in range(1, _SERIES_TERMS + 1):
        out += 2 * symmetric / math.factorial(2 * k + 1)
        before, symmetric = symmetric, 2 * total * symmetric - product * before
    return out


def _stiffness_of(span: _Halves) -> Complex:
    """Dynamic stiffness, shape (n, 4, 4), for (v, θ) at the left and the right end."""
    # amplitudes of each symmetry at the right end from the four DOFs
    even = np.array([[1, 0, 1, 0], [0, -1, 0, 1]]) / 2
    odd = np.array([[-1, 0, 1, 0], [0, 1, 0, 1]]) / 2
    out = 0
    for shape, (force, mixed, moment) in ((even, span.even), (odd, span.odd)):
        matrix = np.stack([np.stack([force, mixed], axis=-1), np.stack([mixed, moment], axis=-1)], axis=-2)
        out = out + 2 * shape.T @ matrix @ shape
    return out
