"""Free modes of a frame whose quantities are uncertain, for many values of them at once.

Bodies that joints alone connect have modes of their own without these. Those of each body follow from its quantities as
those of a beam do, see `jointbayes.structure.shape_modes`; all together, in rising order, are the frame's.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.structure.family import MOST_HELD, Discretisation, FreeModes
from jointbayes.structure.frame_mesh import BodyFactors
from jointbayes.structure.frame_recipe import FrameMesh, FrameRecipe
from jointbayes.structure.matrices import Forced, Structure
from jointbayes.structure.shape_modes import (
    ModesOverShape,
    Parts,
    Similarity,
    ends_of,
    modes_over_shape,
    parts_of,
    rising,
    shape_numbers,
)
from jointbayes.structure.uncertain_family import UncertainFamily

#: Powers in which quantities of a body change each of its shape numbers.
_POWERS: dict[str, dict[str, float]] = {
    "section_size": {"section_size": 1.0, "length": -1.0},
    "shear_coefficient": {"shear_coefficient": 1.0},
    # masses beside that of the body of nominal section, ρ L³
    "masses": {"density": -1.0, "length": -3.0},
    "accelerometer_mass": {"accelerometer_mass": 1.0, "density": -1.0, "length": -3.0},
}
_QUANTITIES = tuple(dict.fromkeys(["youngs_modulus", *(q for powers in _POWERS.values() for q in powers)]))
_TRIES = 60


@dataclass(frozen=True, eq=False, repr=False)
class FrameFamily(UncertainFamily):
    """Frames whose quantities are uncertain.

    Parameters
    ----------
    recipe
        The frame at its nominal quantities.
    ranges
        Smallest and largest logarithm of the factor by quantity, see `FrameRecipe.quantities`; outside these the modes
        are not defined. ``"tool.density"`` is the density of one body, ``"density"`` that of all at once.
    dofs, top_hz
        DOFs where something acts or is observed, and the highest frequency that is wanted, Hz; see `at`.
    exact
        Whether the frame is assembled and solved anew for each row of factors, and every mode kept: a reference.

    Raises
    ------
    ModelError
        If a quantity is unknown or does not belong to the damping law, a body that is not straight has an uncertain
        length, or the frequency is too high.
    """

    recipe: FrameRecipe

    @property
    def what(self) -> str:
        """The frame by its bodies."""
        return ", ".join(name for name, _ in self.recipe.bodies) or "frame"

    @property
    def discretisation(self) -> Discretisation:
        """Elements; the paper's are cubic in the deflection."""
        mesh: FrameMesh = self.mesh
        each = [one for body in mesh for one in body.elements]
        return Discretisation(self.recipe.element, sum(n for n, _ in each), max(order or 3 for _, order in each))

    def reference(self, *, solved: bool = True) -> "FrameFamily":
        """The same frames of much richer elements; solved anew for each row of factors, or interpolated as ever."""
        recipe = replace(self.recipe, element="converged", richer=True)
        return FrameFamily(recipe, self.ranges, exact=solved)

    def reach_hz(self, count: int) -> float:
        """A frequency above the first `count` natural frequencies, whatever holds at most six DOFs, Hz."""
        recipe, wanted = replace(self.recipe, element="converged"), count + MOST_HELD
        top = 1.0
        for _ in range(_TRIES):
            frequency = recipe.structure({}, recipe.mesh((), top)).modes().frequency_hz
            # a mesh that is too coarse for it has modes too high, so that this goes down to where it is fine
            highest = float(frequency[min(wanted, frequency.size) - 1])
            if wanted <= frequency.size and highest <= top:
                return min(top, 1.01 * highest)
            top = max(4 * top, 1.0) if wanted > frequency.size else 1.01 * max(highest, top)
        raise ModelError(f"frame: found no frequency with {wanted} modes below; expected one; correct the units")

    def over_factors(self, motions: Array, forced: Forced) -> FreeModes:
        """Modes of each body over its shape numbers, scaled, all of them in rising order."""
        moving = [number for number, rows in enumerate(self.body_dofs) if rows.stop > rows.start]
        return _UnitedModes(self, [_Body.of(self, number, motions, forced) for number in moving])

    @cached_property
    def body_dofs(self) -> tuple[slice, ...]:
        """Rows of `nominal` that belong to each body."""
        names = [name for name, _ in self.recipe.bodies]
        owners = [label.partition(".")[0] if names != [""] else "" for label in self.nominal.dofs]
        starts = [owners.index(name) if name in owners else len(owners) for name in names]
        return tuple(slice(start, start + owners.count(name)) for name, start in zip(names, starts, strict=True))

    def body_factor(self, number: int, factors: Array, quantity: str) -> Array:
        """Factor on one quantity of a body, shape (n,)."""
        name, _ = self.recipe.bodies[number]
        common = self.factor(factors, quantity)
        return common * self.factor(factors, f"{name}.{quantity}") if name else common


@dataclass(frozen=True, eq=False)
class _Body:
    """One body of a family, and what its modes are made over."""

    family: FrameFamily
    number: int
    parts: Parts
    axes: Mapping[str, Mapping[str, float]]

    @classmethod
    def of(cls, family: FrameFamily, number: int, motions: Array, forced: Forced) -> "_Body":
        rows = family.body_dofs[number]
        own = motions[rows]
        length = any(name in family.names for name in ("length", f"{family.recipe.bodies[number][0]}.length"))
        parts = Parts(own, forced, np.zeros(own.shape[1], dtype=bool), np.arange(own.shape[1]))
        if length:  # rotations are scaled by another factor than translations
            parts = parts_of(family.nominal.dofs[rows], own, forced)
        return cls(family, number, parts, _axes(family, number))

    @property
    def ends(self) -> list[tuple[float, float]]:
        """Lower and upper end of each shape number."""
        return ends_of(self.axes.values(), self._range)

    def _range(self, quantity: str) -> tuple[float, float]:
        family = self.family
        named = [
            family.ranges.get(n, (0.0, 0.0)) for n in (quantity, f"{family.recipe.bodies[self.number][0]}.{quantity}")
        ]
        low, high = (sum(ends) for ends in zip(*named, strict=True))
        if quantity == "accelerometer_mass":
            low, high = np.log(family.recipe.lumped_factor(np.exp([low, high]))).tolist()
        return low, high

    @cached_property
    def modes(self) -> ModesOverShape:
        """Modes over the shape numbers."""
        reach, nominal = self.family.reach_of_modes_hz, self.structure_at([0.0] * len(self.axes)).modes()
        return modes_over_shape(self.structure_at, nominal, self.ends, self.parts.motions, self.parts.forced, reach)

    def structure_at(self, numbers: Sequence[float]) -> Structure:
        """The body at nominal E, ρ and length and at shape numbers (axes,), assembled anew."""
        recipe, mesh = self.family.recipe.lumped, self.family.mesh
        at = dict(zip(self.axes, np.exp(numbers).tolist(), strict=True))
        masses = at.pop("masses", 1.0)
        load = recipe.accelerometer_mass * at.pop("accelerometer_mass", masses)
        factors = BodyFactors(**at, masses=masses)
        stiffness, mass, labels = recipe.matrices(self.number, factors, load, mesh[self.number])
        return Structure(stiffness.toarray(), mass.toarray(), recipe.damping, labels)

    def __call__(self, factors: Array) -> tuple[Array, Array]:
        """Eigenvalues (n, m) and motions (n, k, m) at factors (n, q)."""
        each = {q: self.family.body_factor(self.number, factors, q) for q in _QUANTITIES}
        numbers = shape_numbers(self.axes.values(), each.__getitem__, len(factors))
        similarity = Similarity(numbers, each["youngs_modulus"], each["density"], each["length"])
        eigenvalues, motions = similarity.scaled(self.modes, self.parts.turned)
        return eigenvalues, self.parts.joined(motions)


def _axes(family: FrameFamily, number: int) -> dict[str, dict[str, float]]:
    """Shape numbers of a body that its uncertain quantities change, each with the powers in which they do."""
    recipe = family.recipe.lumped
    name, body = recipe.bodies[number]

    def uncertain(quantity: str) -> bool:
        return quantity in family.names or f"{name}.{quantity}" in family.names

    loaded = recipe.accelerometer_mass > 0 and bool(recipe.loaded_points(number))
    sensors = loaded and uncertain("accelerometer_mass")
    heavy = any(mass.mass > 0 or any(mass.inertia) for mass in body.masses) or (loaded and not sensors)
    present = {"section_size": True, "shear_coefficient": True, "masses": heavy, "accelerometer_mass": sensors}
    found = {axis: {q: p for q, p in _POWERS[axis].items() if uncertain(q)} for axis, here in present.items() if here}
    return {axis: powers for axis, powers in found.items() if powers}


class _UnitedModes:
    """Modes of all bodies together."""

    def __init__(self, family: FrameFamily, bodies: Sequence[_Body]) -> None:
        self._family, self._bodies = family, bodies

    @cached_property
    def _certain(self) -> tuple[Array, Array]:
        return self._at(np.empty((1, 0)))

    def __call__(self, factors: Array) -> tuple[Array, Array]:
        """Eigenvalues (n, m) and motions (n, k, m) at factors (n, q); one row for all where no factor changes them."""
        return self._at(factors) if self._family.names else self._certain

    def _at(self, factors: Array) -> tuple[Array, Array]:
        each = [body(factors) for body in self._bodies]
        return rising(np.concatenate([e for e, _ in each], axis=1), np.concatenate([m for _, m in each], axis=2))
