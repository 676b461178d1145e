"""Free modes of a beam whose quantities are uncertain, for many values of them at once.

E, ρ and size change the modes of a beam by similarity, that is by factors. What is left are at most three numbers:
slenderness, shear coefficient, and the accelerometer's mass beside the beam's. Over these the modes are
interpolated, see `jointbayes.structure.shape_modes`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.structure.family import MOST_HELD, Discretisation, FreeModes
from jointbayes.structure.matrices import Forced, Structure
from jointbayes.structure.mesh import BeamMesh
from jointbayes.structure.shape_modes import (
    ModesOverShape,
    Parts,
    Similarity,
    ends_of,
    modes_over_shape,
    parts_of,
    shape_numbers,
)
from jointbayes.structure.uncertain_family import UncertainFamily
from jointbayes.structure.uncertain_quantities import BeamRecipe

_OFFSET, _SHORTEST = "length_offset", 0.1  # what is added to the length; of which so much must be left


@dataclass(frozen=True, eq=False, repr=False)
class BeamFamily(UncertainFamily):
    """Beams whose quantities are uncertain.

    Parameters
    ----------
    recipe
        The beam at its nominal quantities.
    ranges
        Smallest and largest logarithm of the factor by quantity, see `STRUCTURE_QUANTITIES`; outside these
        the modes are not defined.
    dofs, top_hz
        DOFs where something acts or is observed, and the highest frequency that is wanted, Hz; see `at`.
    exact
        Whether the beam is assembled and solved anew for each row of factors, and every mode kept: a reference.

    Raises
    ------
    ModelError
        If a quantity is unknown or does not belong to the damping law, or the frequency is too high for the beam.
    """

    recipe: BeamRecipe

    @property
    def what(self) -> str:
        """The beam by its length."""
        return f"{1e3 * self.recipe.length:g} mm"

    def __post_init__(self) -> None:
        super().__post_init__()
        low, _ = self.ranges.get(_OFFSET, (0.0, 0.0))
        if math.exp(self.ranges.get("length", (0.0, 0.0))[0]) + low / self.recipe.length < _SHORTEST:
            raise ModelError(
                f"uncertain structure: found a length_offset of {1e3 * low:.4g} mm within six standard deviations, for "
                f"a length of {1e3 * self.recipe.length:.4g} mm; expected one that leaves a beam; lower it"
            )

    @cached_property
    def of_factors(self) -> Mapping[str, tuple[float, float]]:
        """Ranges of the logarithm of each factor; that of the length with its offset."""
        if _OFFSET not in self.ranges:
            return self.ranges
        others = {name: ends for name, ends in self.ranges.items() if name != _OFFSET}
        factors, added = np.exp(others.get("length", (0.0, 0.0))), np.array(self.ranges[_OFFSET]) / self.recipe.length
        low, high = np.log(factors + added).tolist()
        return {**others, "length": (low, high)}

    def factor(self, factors: Array, name: str) -> Array:
        """Factor on one quantity, shape (n,), on the length with what its offset makes of it."""
        found = super().factor(factors, name)
        if name == "length" and _OFFSET in self.names and factors.shape[1]:
            found = found + np.log(super().factor(factors, _OFFSET)) / self.recipe.length
        return found

    @cached_property
    def _axes(self) -> "_ShapeAxes":
        return _ShapeAxes(self.recipe, self.of_factors)

    @property
    def discretisation(self) -> Discretisation:
        """Elements; the paper's are cubic in the deflection."""
        mesh: BeamMesh | None = self.mesh
        if mesh is None:
            return Discretisation("paper", self.recipe.elements, 3)
        return Discretisation("converged", mesh.elements, mesh.order)

    def reference(self, *, solved: bool = True) -> "BeamFamily":
        """The same beams of much richer elements; solved anew for each row of factors, or interpolated as ever."""
        recipe = replace(self.recipe, element="converged", richer=True)
        return BeamFamily(recipe, self.ranges, exact=solved)

    def reach_hz(self, count: int) -> float:
        """A frequency above the first `count` natural frequencies, Hz: that of so many half waves in a slender beam."""
        return self.recipe.shape.bending_frequency_hz(count + MOST_HELD + len(self.recipe.supports))

    def structure_at(self, numbers: Sequence[float]) -> Structure:
        """Beam of nominal length, E and ρ at shape numbers (axes,), assembled anew."""
        factors = dict(zip(self._axes.names, np.exp(numbers).tolist(), strict=True))
        if "accelerometer_mass" in factors:  # the section's size changes the beam's mass, and the ratio is wanted
            factors["accelerometer_mass"] *= factors.get("section_size", 1.0) ** 2
        return self.recipe.lumped.structure(factors, self.mesh)

    def shape_numbers(self, factors: Array) -> Array:
        """Logarithms of the numbers that change the modes by more than factors, shape (n, axes)."""
        return self._axes.numbers(self, factors)

    def over_factors(self, motions: Array, forced: Forced) -> FreeModes:
        """Modes over the shape numbers, scaled."""
        parts, nominal = parts_of(self.nominal.dofs, motions, forced), self.nominal.modes()
        ends, reach = self._axes.ends, self.reach_of_modes_hz
        modes = modes_over_shape(self.structure_at, nominal, ends, parts.motions, parts.forced, reach)
        return _ScaledModes(self, modes, parts)


class _ShapeAxes:
    """The numbers that similarity leaves: ln of slenderness, shear coefficient and relative accelerometer mass."""

    def __init__(self, recipe: BeamRecipe, ranges: Mapping[str, tuple[float, float]]) -> None:
        exponents = {
            "section_size": {"section_size": 1.0, "length": -1.0},
            "shear_coefficient": {"shear_coefficient": 1.0},
        }
        if recipe.lumped.accelerometer_mass > 0 and recipe.accelerometer_dofs:
            if "accelerometer_mass" in ranges:
                low, high = np.log(recipe.lumped_factor(np.exp(ranges["accelerometer_mass"])))
                ranges = {**ranges, "accelerometer_mass": (float(low), float(high))}
            # the mass beside that of the beam, ρ d² L
            exponents["accelerometer_mass"] = {
                "accelerometer_mass": 1.0, "density": -1.0, "section_size": -2.0, "length": -1.0
            }  # fmt: skip
        self.names: list[str] = []
        self._powers: list[dict[str, float]] = []
        for name, powers in exponents.items():
            known = {q: p for q, p in powers.items() if q in ranges}
            if not known:
                continue
            self.names.append(name)
            self._powers.append(known)
        self.ends = ends_of(self._powers, ranges.__getitem__)

    def numbers(self, family: BeamFamily, factors: Array) -> Array:
        return shape_numbers(self._powers, lambda quantity: family.factor(factors, quantity), len(factors))


class _ScaledModes:
    """Modes at all factors from those over the shape numbers, by similarity."""

    def __init__(self, family: BeamFamily, modes: ModesOverShape, parts: Parts) -> None:
        self._family, self._modes, self._parts = family, modes, parts

    @cached_property
    def _certain(self) -> tuple[Array, Array]:
        return self._at(np.empty((1, 0)))

    def __call__(self, factors: Array) -> tuple[Array, Array]:
        """Eigenvalues (n, m) and motions (n, k, m) at factors (n, q); one row for all where no factor changes them."""
        return self._at(factors) if self._family.names else self._certain

    def _at(self, factors: Array) -> tuple[Array, Array]:
        family = self._family
        e, rho, size = (family.factor(factors, name) for name in ("youngs_modulus", "density", "length"))
        # the beam of the table, made longer and thicker alike
        similarity = Similarity(family.shape_numbers(factors), e, rho, size)
        eigenvalues, motions = similarity.scaled(self._modes, self._parts.turned)
        return eigenvalues, self._parts.joined(motions)
