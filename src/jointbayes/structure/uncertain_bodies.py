"""Free modes of beams and frames whose quantities are uncertain, for many values of them at once.

E, ρ and size change the modes of a body by similarity, that is by factors. What is left are few numbers: slenderness,
shear coefficient, and masses in addition to the body's own. Over these the modes are interpolated, see
`jointbayes.structure.shape_modes`. Bodies that joints alone connect have modes of their own without these; all
together, in rising order, are the frame's.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache, partial

import numpy as np

from jointbayes.errors import ModelError
from jointbayes.structure import shape_modes
from jointbayes.structure.body import MOST_HELD, Discretisation, Forced, FreeModes
from jointbayes.structure.frame_element import BodyFactors
from jointbayes.structure.frame_recipe import BeamRecipe, FrameMesh, FrameRecipe, MemberRecipe
from jointbayes.structure.given_matrices import MatrixFamily, MatrixRecipe
from jointbayes.structure.imported.imported_body import ImportedFamily, ImportedRecipe
from jointbayes.structure.matrices import ConstantModes, Structure
from jointbayes.structure.recipe import UncertainBody, is_hashable
from vibrecords.arrays import Array

_SHORTEST = 0.1  # of a beam's length must be left
#: Powers in which quantities of a body change each of its shape numbers.
_POWERS: dict[str, shape_modes.Powers] = {
    "section_size": {"section_size": 1.0, "length": -1.0},
    "shear_coefficient": {"shear_coefficient": 1.0},
    # masses over the mass of the body of nominal section, ρ L³
    "masses": {"density": -1.0, "length": -3.0},
    "accelerometer_mass": {"accelerometer_mass": 1.0, "density": -1.0, "length": -3.0},
    # force over E L² of the body of nominal E and length; with the size above it is N L²/EI
    "axial_force": {"axial_force": 1.0, "youngs_modulus": -1.0, "length": -2.0},
}
#: Powers in which a body's quantities change its natural frequencies by similarity, but for their sign.
_FREQUENCY_POWERS = {"youngs_modulus": 0.5, "density": 0.5, "length": 1.0, "section_size": 1.0, "axial_force": 0.5}
_TRIES = 60


@dataclass(frozen=True, eq=False)
class _ScaledModes:
    """Modes of a body at all factors from those over its shape numbers, by similarity."""

    modes: shape_modes.ModesOverShape
    parts: shape_modes.Parts
    axes: Mapping[str, shape_modes.Powers]
    #: Factor on one of the body's quantities, shape (n,), from those on the family's, shape (n, q).
    factor: Callable[[Array, str], Array]

    def __call__(self, factors: Array) -> tuple[Array, Array]:
        """Eigenvalues (n, m) and motions (n, k, m) at factors (n, q)."""
        of_quantity = cache(partial(self.factor, factors))
        eigenvalues, motions = self.modes(shape_modes.shape_numbers(self.axes.values(), of_quantity, len(factors)))
        # the body of the table, made longer and thicker alike
        stiffness, density, size = map(of_quantity, ("youngs_modulus", "density", "length"))
        eigenvalues = eigenvalues * (stiffness / (density * size**2))[:, None]
        unit = 1 / np.sqrt(density * size**3)
        scale = np.where(self.parts.turned, (unit / size)[:, None], unit[:, None])
        eigenvalues, motions = shape_modes.rising(eigenvalues, motions * scale[:, :, None])
        return eigenvalues, self.parts.joined(motions)


@dataclass(frozen=True, eq=False)
class _BodiesModes:
    """Modes of one body or of several together."""

    bodies: Sequence[_ScaledModes]

    def __call__(self, factors: Array) -> tuple[Array, Array]:
        """Eigenvalues (n, m) and motions (n, k, m) at factors (n, q)."""
        modes = [body(factors) for body in self.bodies]
        if len(modes) == 1:
            return modes[0]
        return shape_modes.rising(
            np.concatenate([e for e, _ in modes], axis=1), np.concatenate([m for _, m in modes], axis=2)
        )


@lru_cache(maxsize=64)
def _reach_hz(recipe: FrameRecipe | BeamRecipe, count: int) -> float:
    """See `FrameFamily.reach_hz`: each call meshes and solves the frame several times."""
    recipe, wanted = replace(recipe, element="converged"), count + MOST_HELD
    top = 1.0
    for _ in range(_TRIES):
        frequency = recipe.structure({}, recipe.mesh((), top)).modes().frequency_hz
        # a mesh that is too coarse for it has modes too high, so that this goes down to where it is fine
        highest = float(frequency[min(wanted, frequency.size) - 1])
        if wanted <= frequency.size and highest <= top:
            return min(top, 1.01 * highest)
        top = max(4 * top, 1.0) if wanted > frequency.size else 1.01 * max(highest, top)
    raise ModelError.of("frame", (), f"found no frequency with {wanted} modes below", "one", "correct the units")


@dataclass(frozen=True, eq=False, repr=False)
class FrameFamily(UncertainBody):
    """Frames whose quantities are uncertain.

    Parameters
    ----------
    recipe
        The frame at its nominal quantities.
    ranges
        Smallest and largest logarithm of the factor by quantity, see `FrameRecipe.quantities`; outside these the modes
        are not defined. ``"tool.density"`` is the density of one body, ``"density"`` of all at once.
    dofs, top_hz
        DOFs where something acts or is observed, and the highest frequency that is wanted, Hz; see `at`.
    exact
        Whether the frame is assembled and solved again for each row of factors, and every mode kept: a reference.

    Raises
    ------
    ModelError
        If a quantity is unknown or does not belong to the damping law, a body that is not straight has an uncertain
        length, or the frequency is too high.
    """

    recipe: FrameRecipe | BeamRecipe

    @cached_property
    def reach_of_modes_hz(self) -> float | None:
        """Frequency up to which modes are wanted: at the ends of the ranges they may be so much lower."""
        if self.top_hz is None:
            return None
        widest = (
            sum(power * max(map(abs, self.range_of(number, q))) for q, power in _FREQUENCY_POWERS.items())
            for number in range(len(self.recipe.bodies))
        )
        return self.top_hz * math.exp(max(widest))

    @cached_property
    def mesh(self) -> FrameMesh:
        """Elements, fine enough for the largest axial forces."""
        forces = [math.exp(self.range_of(number, "axial_force")[1]) for number in range(len(self.recipe.bodies))]
        return self.recipe.mesh(self.dofs, self.reach_of_modes_hz, forces)

    @property
    def discretisation(self) -> Discretisation:
        """Elements; the paper's are cubic in the deflection."""
        elements = [of_segment for body in self.mesh for of_segment in body.elements]
        orders = (order or 3 for _, order in elements)
        return Discretisation(self.recipe.element, sum(count for count, _ in elements), max(orders))

    def reach_hz(self, count: int) -> float:
        """A frequency above the first `count` natural frequencies with any six DOFs held, Hz."""
        return _reach_hz(self.recipe, count) if is_hashable(self.recipe) else _reach_hz.__wrapped__(self.recipe, count)

    def over_factors(self, motions: Array, forced: Forced) -> FreeModes:
        """Modes of each body over its shape numbers, scaled, all of them in rising order."""
        moving = [number for number, rows in enumerate(self.body_dofs) if rows.stop > rows.start]
        modes = _BodiesModes([_Body(self, number).scaled(motions, forced) for number in moving])
        return modes if self.names else ConstantModes(*modes(np.empty((1, 0))))

    @cached_property
    def body_dofs(self) -> tuple[slice, ...]:
        """Rows of `nominal` that belong to each body."""
        names = [name for name, _ in self.recipe.bodies]
        owners = [label.partition(".")[0] if names != [""] else "" for label in self.nominal.dofs]
        starts = [owners.index(name) if name in owners else len(owners) for name in names]
        return tuple(slice(start, start + owners.count(name)) for name, start in zip(names, starts, strict=True))

    def body_factor(self, number: int, factors: Array, quantity: str) -> Array:
        """Factor on one quantity of a body, shape (n,)."""
        return np.broadcast_to(self.recipe.body_factor(number, self.named(factors), quantity), len(factors))

    def range_of(self, number: int, quantity: str) -> tuple[float, float]:
        """Smallest and largest logarithm of the factor on one quantity of a body."""
        ends = np.exp(list(self.ranges.values())).T.reshape(2, -1)
        low, high = np.log(self.body_factor(number, ends, quantity)).tolist()
        return low, high


@dataclass(frozen=True, eq=False, repr=False)
class BeamFamily(FrameFamily):
    """Beams whose quantities are uncertain: frames of one member, see `FrameFamily` and `STRUCTURE_QUANTITIES`.

    Raises
    ------
    ModelError
        If a quantity is unknown or does not belong to the damping law, no beam is left of a length, or the frequency is
        too high for the beam.
    """

    recipe: BeamRecipe

    def __post_init__(self) -> None:
        super().__post_init__()
        ends = {name: np.exp(range_) for name, range_ in self.ranges.items()}
        if np.min(self.recipe.body_factor(0, ends, "length")) < _SHORTEST:
            found = f"found a length_offset of {1e3 * self.ranges['length_offset'][0]:.4g} mm within six standard "
            found += f"deviations, for a length of {1e3 * self.recipe.length:.4g} mm"
            raise ModelError.of("uncertain structure", (), found, "one that leaves a beam", "lower it")

    def reach_hz(self, count: int) -> float:
        """A frequency above the first `count` natural frequencies, Hz: that of so many half waves in a slender beam.

        For a beam that bends in two planes the softer plane decides.
        """
        half_waves = count + MOST_HELD + len(self.recipe.supports)
        return self.recipe.whole.bending_frequency_hz(half_waves, softer=self.recipe.dofs_per_node == 5)


@dataclass(frozen=True, eq=False)
class _Body:
    """One body of a family, and what its modes are made over."""

    family: FrameFamily
    number: int

    @cached_property
    def _recipe(self) -> MemberRecipe:
        return self.family.recipe.lumped

    def _range(self, quantity: str) -> tuple[float, float]:
        return self.family.range_of(self.number, quantity)

    def _uncertain(self, quantity: str) -> bool:
        low, high = self._range(quantity)
        return low < high

    @cached_property
    def _axes(self) -> dict[str, shape_modes.Powers]:
        """Shape numbers that uncertain quantities change, each with the powers in which they do."""
        _, body = self._recipe.bodies[self.number]
        loaded = self._recipe.accelerometer_mass > 0 and bool(self._recipe.loaded_points(self.number))
        sensors = loaded and self._uncertain("accelerometer_mass")
        heavy = any(mass.mass > 0 or any(mass.inertia) for mass in body.masses) or (loaded and not sensors)
        loose = not any(member.axial_force for member in body.members)
        absent = {"masses": not heavy, "accelerometer_mass": not sensors, "axial_force": loose}
        of_uncertain = {
            axis: {q: power for q, power in powers.items() if self._uncertain(q)}
            for axis, powers in _POWERS.items()
            if not absent.get(axis)
        }
        return {axis: powers for axis, powers in of_uncertain.items() if powers}

    def scaled(self, motions: Array, forced: Forced) -> _ScaledModes:
        """Its modes at all factors with its part of motions (DOFs, k)."""
        family, rows = self.family, self.family.body_dofs[self.number]
        moved = motions[rows]
        parts = shape_modes.Parts(moved, forced, np.zeros(moved.shape[1], dtype=bool), np.arange(moved.shape[1]))
        if self._uncertain("length"):  # rotations are scaled by another factor than translations
            parts = shape_modes.parts_of(family.nominal.dofs[rows], moved, forced)
        nominal = self.structure_at([0.0] * len(self._axes)).modes()
        ends, reach = shape_modes.ends_of(self._axes.values(), self._range), family.reach_of_modes_hz
        modes = shape_modes.modes_over_shape(self.structure_at, nominal, ends, parts.motions, parts.forced, reach)
        return _ScaledModes(modes, parts, self._axes, partial(family.body_factor, self.number))

    def structure_at(self, numbers: Sequence[float]) -> Structure:
        """The body at nominal E, ρ and length and at shape numbers (axes,), assembled again."""
        factors = dict(zip(self._axes, np.exp(numbers).tolist(), strict=True))
        masses = factors.pop("masses", 1.0)
        load = self._recipe.accelerometer_mass * factors.pop("accelerometer_mass", masses)
        of_body = BodyFactors(**factors, masses=masses)
        stiffness, mass, labels = self._recipe.matrices(self.number, of_body, load, self.family.mesh[self.number])
        return Structure(stiffness, mass, self._recipe.damping, labels)


StructureRecipe = BeamRecipe | FrameRecipe | MatrixRecipe | ImportedRecipe


def family_of_recipe(
    recipe: StructureRecipe, ranges: Mapping[str, tuple[float, float]] | None = None
) -> BeamFamily | FrameFamily | MatrixFamily | ImportedFamily:
    """The structures of a recipe whose quantities lie within ranges of the logarithm of a factor, by name."""
    match recipe:
        case BeamRecipe():
            return BeamFamily(recipe, ranges or {})
        case FrameRecipe():
            return FrameFamily(recipe, ranges or {})
        case MatrixRecipe():
            return MatrixFamily(recipe, ranges or {})
        case ImportedRecipe():
            return ImportedFamily(recipe, ranges or {})
