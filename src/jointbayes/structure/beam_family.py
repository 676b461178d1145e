"""Free modes of a structure whose quantities are uncertain, for many values of them at once.

E, ρ and size change the modes of a beam by similarity, that is by factors. What is left are at most three numbers:
slenderness, shear coefficient, and the accelerometer's mass beside the beam's. Over these the modes, and the few
vectors that stand for those above the band (`jointbayes.structure.reduction`), are interpolated between Chebyshev
points at which the beam is assembled and solved; the interpolation is checked where it is made.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property, lru_cache
from typing import Self

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import ModelError
from jointbayes.structure.damping import LossFactor, ModalDamping
from jointbayes.structure.family import MOST_HELD, Discretisation, FreeModes
from jointbayes.structure.matrices import Modes, Structure
from jointbayes.structure.mesh import BeamMesh
from jointbayes.structure.mode_table import ModeTable, tabulated
from jointbayes.structure.reduction import Forced, Reduction
from jointbayes.structure.uncertain_quantities import BeamRecipe, is_damping_ratio, is_mode_frequency

__all__ = ["BeamFamily"]

Array = NDArray[np.float64]

#: Free modes of so many beams are kept, of no more motions each: search, draws, checks and report of one case, and
#: cases that differ in their data alone, ask for the same ones again and again.
_KEPT, _KEPT_MOTIONS = 12, 256


@dataclass(frozen=True, eq=False, repr=False)
class BeamFamily:
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
    ranges: Mapping[str, tuple[float, float]]
    _: KW_ONLY
    dofs: tuple[str, ...] | None = None
    top_hz: float | None = None
    exact: bool = False

    def __post_init__(self) -> None:
        law = self.recipe.damping
        for name in self.names:
            of_other_law = is_damping_ratio(name) and not isinstance(law, ModalDamping)
            if of_other_law or (name == "loss_factor" and not isinstance(law, LossFactor)):
                raise ModelError(
                    f"uncertain beam: found {name!r} with a damping law of another kind; expected damping_ratio for "
                    "modal damping or loss_factor for structural damping; remove it or change the law"
                )
        numbers = [name for name in self.names if is_mode_frequency(name)]
        if numbers != [f"mode_frequency_{i + 1}" for i in range(len(numbers))]:
            raise ModelError(
                f"uncertain beam: found {', '.join(numbers)}; expected mode_frequency_1, mode_frequency_2 and so on"
            )

    def __repr__(self) -> str:
        law, uncertain = type(self.recipe.damping).__name__, ", ".join(self.names) or "nothing"
        return f"BeamFamily({1e3 * self.recipe.length:g} mm, {law}, uncertain: {uncertain})"

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The q quantities."""
        return tuple(self.ranges)

    @cached_property
    def _axes(self) -> "_ShapeAxes":
        return _ShapeAxes(self.recipe, self.ranges)

    @property
    def shape_ends(self) -> list[tuple[float, float]]:
        """Least and largest of each of the shape numbers."""
        return self._axes.ends

    @cached_property
    def reach_of_modes_hz(self) -> float | None:
        """Frequency up to which modes are wanted: a beam at the end of its range may have its modes so much lower."""
        return None if self.top_hz is None else self.top_hz * self._widest

    @cached_property
    def mesh(self) -> BeamMesh | None:
        """How the beam is discretised; None for the paper's element."""
        return self.recipe.mesh(self.dofs, self.reach_of_modes_hz)

    @cached_property
    def nominal(self) -> Structure:
        """Beam at all factors 1."""
        return self.recipe.structure(dict.fromkeys(self.names, 1.0), self.mesh)

    @property
    def discretisation(self) -> Discretisation:
        """Elements; the paper's are cubic in the deflection."""
        if self.mesh is None:
            return Discretisation("paper", self.recipe.elements, 3)
        return Discretisation("converged", self.mesh.elements, self.mesh.order)

    @property
    def _widest(self) -> float:
        power = {"youngs_modulus": 0.5, "density": 0.5, "length": 1.0, "section_size": 1.0}
        sizes = {name: max(map(abs, ends)) for name, ends in self.ranges.items()}
        modes = max((size for name, size in sizes.items() if is_mode_frequency(name)), default=0.0)
        return float(np.exp(modes + sum(p * sizes.get(name, 0.0) for name, p in power.items())))

    def at(self, dofs: Iterable[str], top_hz: float) -> Self:
        """The same beams, exact at these DOFs up to this frequency; elements end at their points."""
        return replace(self, dofs=tuple(dofs), top_hz=top_hz)

    def reference(self, *, solved: bool = True) -> "BeamFamily":
        """The same beams of much richer elements; solved anew for each row of factors, or interpolated as ever."""
        recipe = replace(self.recipe, element="converged", richer=True)
        return BeamFamily(recipe, self.ranges, exact=solved)

    def reach_hz(self, count: int) -> float:
        """A frequency above the first `count` natural frequencies, Hz: that of so many half waves in a slender beam."""
        return self.recipe.shape.bending_frequency_hz(count + MOST_HELD + len(self.recipe.supports))

    def structure(self, factors: Array) -> Structure:
        """Beam at factors (q,), assembled anew."""
        given = np.asarray(factors, dtype=float)
        named = dict(zip(self.names, given.tolist(), strict=True)) if given.size else {}
        return self.recipe.structure(named, self.mesh)

    def free_modes(self, motions: Array, forced: Forced = None) -> FreeModes:
        """Interpolated modes; where modes cross or meet, so that they cannot be, one solution for each row."""
        if self.exact:
            return _AssembledModes(self, motions)
        beams = _BeamsOf(self.recipe, tuple(self.ranges.items()), self.dofs, self.top_hz)
        if motions.shape[1] > _KEPT_MOTIONS or not beams.known_by_value:
            return _interpolated(self, motions, forced)
        return _kept(beams, motions.shape, motions.tobytes(), None if forced is None else tuple(forced.tolist()))

    def structure_at(self, numbers: Sequence[float]) -> Structure:
        """Beam of nominal length, E and ρ at shape numbers (axes,), assembled anew."""
        factors = dict(zip(self._axes.names, np.exp(numbers).tolist(), strict=True))
        if "accelerometer_mass" in factors:  # the section's size changes the beam's mass, and the ratio is wanted
            factors["accelerometer_mass"] *= factors.get("section_size", 1.0) ** 2
        return self.recipe.lumped.structure(factors, self.mesh)

    def damping_ratios(self, factors: Array) -> Array:
        """Damping ratio of every mode, shape (n, m), or (1, m) where all are certain."""
        law = self.recipe.damping
        if not any(map(is_damping_ratio, self.names)):
            return self._certain_ratios
        listed = len(law.ratios) if isinstance(law, ModalDamping) else 1
        ratios = np.tile(law.per_mode(self.nominal.n_dofs), (len(factors), 1))
        ratios *= self.factor(factors, "damping_ratio")[:, None]
        for i in range(listed):
            # the last one holds for all higher modes
            ratios[:, i : None if i == listed - 1 else i + 1] *= self.factor(factors, f"damping_ratio_{i + 1}")[:, None]
        return ratios

    @cached_property
    def _certain_ratios(self) -> Array:
        return self.recipe.damping.per_mode(self.nominal.n_dofs)[None]

    def loss_factors(self, factors: Array) -> Array:
        """Loss factor, shape (n,)."""
        return self.recipe.damping.hysteretic * self.factor(factors, "loss_factor")

    def frequency_factors(self, factors: Array) -> Array:
        """True over predicted natural frequency of the first modes of the assembled structure, shape (n, c)."""
        named = [name for name in self.names if is_mode_frequency(name)]
        each = [self.factor(factors, name) for name in named]
        return np.stack(each, axis=-1) if each else np.empty((len(factors), 0))

    def factor(self, factors: Array, name: str) -> Array:
        """Factor on one quantity, shape (n,), or all mass at an accelerometer; ones where it is certain."""
        if name not in self.names or not factors.shape[1]:
            return np.ones(len(factors))
        found = factors[:, self.names.index(name)]
        return self.recipe.lumped_factor(found) if name == "accelerometer_mass" else found

    def shape_numbers(self, factors: Array) -> Array:
        """Logarithms of the numbers that change the modes by more than factors, shape (n, axes)."""
        return self._axes.numbers(self, factors)


@dataclass(frozen=True, slots=True)
class _BeamsOf:
    """What a family is made from: equal where the beams are."""

    recipe: BeamRecipe
    ranges: tuple[tuple[str, tuple[float, float]], ...]
    dofs: tuple[str, ...] | None
    top_hz: float | None

    @property
    def known_by_value(self) -> bool:
        """Whether it can be looked up; not where a caller gave lists for tuples."""
        try:
            hash(self)
        except TypeError:
            return False
        return True


@lru_cache(maxsize=_KEPT)
def _kept(beams: _BeamsOf, shape: tuple[int, ...], motions: bytes, forced: tuple[bool, ...] | None) -> FreeModes:
    family = BeamFamily(beams.recipe, dict(beams.ranges), dofs=beams.dofs, top_hz=beams.top_hz)
    given = np.frombuffer(motions).reshape(shape)
    return _interpolated(family, given, None if forced is None else np.array(forced, dtype=bool))


#: Of more modes than these no table is accurate enough: rounding in the highest is all that is left.
_MOST_TABULATED = 60


def _interpolated(family: BeamFamily, motions: Array, forced: Forced = None) -> FreeModes:
    turned = _rotations(family.nominal.dofs, motions)
    modes, reach = family.nominal.modes(), family.reach_of_modes_hz
    reduction = Reduction(modes.eigenvalues.size, motions)
    if reach is not None:
        reduction = Reduction.below(reach, modes, motions, forced)
        if reduction.kept > _MOST_TABULATED:
            return _ScaledModes(family, _BeamModes(family, reduction), turned)
    # the last terms are the least smooth over the ranges, and the least needed
    for terms in (reduction.terms, reduction.terms - 1):
        beams = _BeamModes(family, replace(reduction, terms=terms))
        table = tabulated(beams.at, motions, family.shape_ends)
        if table is not None:
            return _ScaledModes(family, table, turned)
    return _ScaledModes(family, _BeamModes(family, reduction), turned)


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
        self.ends: list[tuple[float, float]] = []
        self._powers: list[dict[str, float]] = []
        for name, powers in exponents.items():
            known = {q: p for q, p in powers.items() if q in ranges}
            if not known:
                continue
            sides = [sorted((p * ranges[q][0], p * ranges[q][1])) for q, p in known.items()]
            self.names.append(name)
            self.ends.append((sum(s[0] for s in sides), sum(s[1] for s in sides)))
            self._powers.append(known)

    def numbers(self, family: BeamFamily, factors: Array) -> Array:
        logs = [sum(p * np.log(family.factor(factors, q)) for q, p in powers.items()) for powers in self._powers]
        return np.stack(logs, axis=-1) if logs else np.zeros((len(factors), 0))


class _BeamModes:
    """Reduced modes of the beam over its shape numbers."""

    def __init__(self, family: BeamFamily, reduction: Reduction) -> None:
        self._family, self._reduction = family, reduction

    def at(self, numbers: Sequence[float]) -> tuple[Modes, Array]:
        """Modes and mass matrix at shape numbers (axes,)."""
        structure = self._family.structure_at(numbers)
        return self._reduction.of(structure.modes()), structure.mass

    def __call__(self, numbers: Array) -> tuple[Array, Array]:
        """Eigenvalues (n, m) and motions (n, k, m) at shape numbers (n, axes), one solution for each row."""
        solved = [self.at(row.tolist())[0] for row in numbers]
        motions = self._reduction.motions.T
        return np.stack([s.eigenvalues for s in solved]), np.stack([motions @ s.shapes for s in solved])


class _ScaledModes:
    """Modes at all factors from those over the shape numbers, by similarity."""

    def __init__(self, family: BeamFamily, modes: "ModeTable | _BeamModes", turned: NDArray[np.bool_]) -> None:
        self._family, self._modes, self._turned = family, modes, turned

    @cached_property
    def _certain(self) -> tuple[Array, Array]:
        return self._at(np.empty((1, 0)))

    def __call__(self, factors: Array) -> tuple[Array, Array]:
        """Eigenvalues (n, m) and motions (n, k, m) at factors (n, q); one row for all where no factor changes them."""
        return self._at(factors) if self._family.names else self._certain

    def _at(self, factors: Array) -> tuple[Array, Array]:
        family = self._family
        eigenvalues, motions = self._modes(family.shape_numbers(factors))
        size = family.factor(factors, "length")  # the beam of the table, made longer and thicker alike
        stiffness, density = family.factor(factors, "youngs_modulus"), family.factor(factors, "density")
        eigenvalues = eigenvalues * (stiffness / (density * size**2))[:, None]
        unit = 1 / np.sqrt(density * size**3)
        scale = np.where(self._turned, (unit / size)[:, None], unit[:, None])
        motions = motions * scale[:, :, None]
        if (np.diff(eigenvalues, axis=1) < 0).any():
            order = np.argsort(eigenvalues, axis=1)
            eigenvalues = np.take_along_axis(eigenvalues, order, axis=1)
            motions = np.take_along_axis(motions, order[:, None, :], axis=2)
        return eigenvalues, motions


class _AssembledModes:
    """Motions in all free modes, the beam assembled and solved anew for each row of factors."""

    def __init__(self, family: BeamFamily, motions: Array) -> None:
        self._family, self._motions = family, motions

    def __call__(self, factors: Array) -> tuple[Array, Array]:
        rows = factors if factors.shape[1] else np.empty((1, 0))
        solved = [self._family.structure(row).modes() for row in rows]
        return np.stack([s.eigenvalues for s in solved]), np.stack([self._motions.T @ s.shapes for s in solved])


def _rotations(dofs: Sequence[str], motions: Array) -> NDArray[np.bool_]:
    """Which of the motions (DOFs, k) are rotations, shape (k,)."""
    rotation = np.array([":r" in dof for dof in dofs])
    turned: NDArray[np.bool_] = (motions[rotation] != 0).any(axis=0)
    moved = (motions[~rotation] != 0).any(axis=0)
    if (turned & moved).any():
        raise ModelError("uncertain beam: found a motion that mixes translation and rotation; expected one of them")
    return turned
