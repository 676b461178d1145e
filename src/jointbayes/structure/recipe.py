"""What recipes of structures share: names of uncertain quantities, supports, accelerometers, elements.

And the bodies that come of them: beams, frames and given matrices that differ by factors on what is uncertain.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np

from jointbayes.errors import ModelError
from jointbayes.structure.body import Body, Forced, FreeModes, Reduction, Rows
from jointbayes.structure.damping import DampingLaw, LossFactor, ModalDamping
from jointbayes.structure.matrices import SolvedModes, Structure
from vibrecords.arrays import Array, ComplexArray
from vibrecords.errors import printable

#: ``"converged"``: elements of high order, so many that no mesh shows.  ``"paper"``: the paper's two-node element.
ElementKind = Literal["converged", "paper"]

HALF_WAVES = 10.0  # along the beam, or a frame's longest segment: what a mesh without a stated frequency is made for
_MOST_MASS = 1e6  # kg


def is_additive(name: str) -> bool:
    """Whether a quantity is no factor but a length that is added: an offset in m, whose factor is e to that power.

    So the offset's own value is the coordinate, and may be of either sign.
    """
    return name.rpartition(".")[2] == "length_offset"


def is_damping_ratio(name: str) -> bool:
    """Whether a quantity is the damping ratio of all modes, or of one."""
    return name == "damping_ratio" or name.startswith("damping_ratio_")


def is_damping(name: str) -> bool:
    """Whether a quantity is one of the structure's damping, which moves no undamped natural frequency."""
    return name == "loss_factor" or is_damping_ratio(name)


def in_unit(value: float, unit: float) -> float:
    """A value as a multiple of a unit, free of the rounding of the conversion: 0.3829 m are 382.9 mm."""
    return float(f"{value / unit:.12g}")


@dataclass(frozen=True, eq=False)
class Recipe(ABC):
    """Everything that a structure's matrices are made from, each quantity open to a factor.

    A recipe has these fields.

    Parameters
    ----------
    damping
        Damping law.
    supports
        DOFs held fixed.
    accelerometer_mass
        Mass of each accelerometer, kg.
    added_mass
        Mass that is exactly known, next to the mass of each accelerometer, kg.
    accelerometer_dofs
        Where one sits: its mass moves in all translations of the point of each of these DOFs that is a translation.
    element, richer
        How it is discretised, and whether elements are four orders richer than it takes, one where points are many: a
        reference for others. No matter to the paper's element, or where matrices are given.
    """

    #: What it is, where a message begins.
    kind: ClassVar[str]

    if TYPE_CHECKING:  # a field of each, in its place among theirs

        @property
        def damping(self) -> DampingLaw:
            """Damping law."""

    _: KW_ONLY
    accelerometer_mass: float = 0.0
    added_mass: float = 0.0
    accelerometer_dofs: tuple[str, ...] = ()
    element: ElementKind = "converged"
    richer: bool = False

    def _require_masses(self) -> None:
        if not all(0 <= mass <= _MOST_MASS for mass in (self.accelerometer_mass, self.added_mass)):
            found = f"found accelerometers of {self.accelerometer_mass:g} + {self.added_mass:g} kg"
            expected = f"masses of at least 0 and at most {_MOST_MASS:g} kg"
            raise ModelError.of(f"{self.kind}", (), found, expected, "correct them")

    @property
    @abstractmethod
    def quantities(self) -> tuple[str, ...]:
        """Quantities that may be uncertain, in addition to ``damping_ratio_1`` and so on."""

    @property
    def usual(self) -> dict[str, tuple[str, float]]:
        """Unit and nominal value of what a workshop does not know exactly; empty where only matrices are known."""
        return {}

    def _with_accelerometers(self, usual: dict[str, tuple[str, float]]) -> dict[str, tuple[str, float]]:
        return usual | {"accelerometer_mass": ("g", in_unit(self.accelerometer_mass, 1e-3))}

    @property
    @abstractmethod
    def what(self) -> str:
        """The structure in a word or two."""

    @property
    @abstractmethod
    def extent(self) -> float:
        """Size, m."""

    def own_stiffness(self, row: str, column: str) -> float:
        """Its stiffness by itself where two DOFs of a point are: what default priors are relative to."""
        return self.structure().own_stiffness(row, column)

    def own_inertia(self, dof: str) -> float:
        """Mass, kg, or moment of inertia, kg·m², that a spring at a DOF moves where nothing else holds it."""
        return self.structure().own_inertia(dof)

    @abstractmethod
    def mesh(self, dofs: Iterable[str] | None = None, top_hz: float | None = None) -> Any:  # noqa: ANN401 (its own)
        """Elements that are exact up to a frequency and end where something acts or is observed."""

    @abstractmethod
    def structure(self, factors: Mapping[str, float] | None = None, mesh: Any = None) -> Structure:  # noqa: ANN401
        """The structure with its quantities multiplied by factors, 1 where none is given."""

    @property
    def reference(self) -> Self:
        """The same structure of much richer elements."""
        return replace(self, element="converged", richer=True)

    def has_quantity(self, name: str) -> bool:
        """Whether a quantity is one of the structure's."""
        return name in self.quantities or is_damping_ratio(name)

    def require_quantity(self, name: str) -> None:
        """Refuse a quantity that the structure does not have.

        Raises
        ------
        ModelError
            If the name is unknown.
        """
        if not self.has_quantity(name):
            found = f"found uncertain quantity {printable(name)!r}"
            expected = f"one of {', '.join(self.quantities)}, damping_ratio_1 and so on"
            raise ModelError.of(f"{self.kind}", (), found, expected, "correct the name or remove it")

    def checked_factors(self, factors: Mapping[str, float] | None) -> dict[str, float]:
        """Factors by name, each on a quantity of the structure.

        Raises
        ------
        ModelError
            If a name is unknown.
        """
        for name in factors or {}:
            self.require_quantity(name)
        return dict(factors or {})

    @property
    def lumped(self) -> Self:
        """The same structure, all mass at an accelerometer's place taken for the accelerometer's."""
        masses: dict[str, Any] = {"accelerometer_mass": self.accelerometer_mass + self.added_mass, "added_mass": 0.0}
        return replace(self, **masses)

    def lumped_factor(self, factor: Array) -> Array:
        """Factors on all mass at an accelerometer's place, from those on the accelerometer alone."""
        sensor, added = self.accelerometer_mass, self.added_mass
        return (sensor * factor + added) / (sensor + added) if added else factor

    def load(self, factors: Mapping[str, float]) -> float:
        """Mass at each accelerometer's place, kg."""
        return self.accelerometer_mass * factors.get("accelerometer_mass", 1.0) + self.added_mass


#: Free modes of so many structures are kept, of no more motions each: search, draws, checks and report of one case, and
#: cases that differ in their data alone, ask for the same ones again and again.
_KEPT, _KEPT_MOTIONS = 12, 256


@dataclass(frozen=True, eq=False, repr=False)
class UncertainBody(Body):
    """Structures whose quantities are uncertain.

    Parameters
    ----------
    recipe
        The structure at its nominal quantities.
    ranges
        Smallest and largest logarithm of the factor by quantity; outside these the modes are not defined.
    dofs, top_hz
        DOFs where something acts or is observed, and the highest frequency that is wanted, Hz; see `at`.
    exact
        Whether it is assembled and solved again for each row of factors, and every mode kept: a reference.

    Raises
    ------
    ModelError
        If a quantity is unknown or does not belong to the damping law.
    """

    recipe: Recipe
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
                found = f"found {name!r} with a damping law of another kind"
                expected = "damping_ratio for modal damping or loss_factor for structural damping"
                raise ModelError.of("uncertain structure", (), found, expected, "remove it or change the law")
            self.recipe.require_quantity(name)

    def __repr__(self) -> str:
        law, uncertain = type(self.recipe.damping).__name__, ", ".join(self.names) or "nothing"
        return f"{type(self).__name__}({self.recipe.what}, {law}, uncertain: {uncertain})"

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The q quantities."""
        return tuple(self.ranges)

    @property
    def reach_of_modes_hz(self) -> float | None:
        """Frequency up to which modes are wanted."""
        return self.top_hz

    @cached_property
    def mesh(self) -> Any:  # noqa: ANN401 (of the recipe's own kind)
        """How it is discretised."""
        return self.recipe.mesh(self.dofs, self.reach_of_modes_hz)

    @cached_property
    def nominal(self) -> Structure:
        """Structure at all factors 1."""
        return self.recipe.structure(dict.fromkeys(self.names, 1.0), self.mesh)

    def certain(self) -> Structure:
        """The structure at all factors 1."""
        return self.nominal

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the DOFs."""
        return self.nominal.dofs

    @property
    def damping(self) -> DampingLaw:
        """Damping law at all factors 1."""
        return self.nominal.damping

    @property
    def shift(self) -> float:
        """Shift of the nominal structure, see `Structure.shift`."""
        return self.nominal.shift

    def position(self, label: str) -> tuple[float, float, float] | None:
        """Where a DOF is, m; None where that is not known."""
        return self.nominal.position(label)

    def rigid_motions(self, dofs: Rows) -> Array:
        """Motions of DOFs in the rigid-body modes, see `Body`."""
        return self.nominal.rigid_motions(dofs)

    def own_stiffness(self, row: str, column: str) -> float:
        """Its stiffness by itself where two DOFs of a point are, see `Recipe`."""
        return self.recipe.own_stiffness(row, column)

    def own_inertia(self, label: str) -> float:
        """Mass or moment of inertia that a spring at a DOF moves, see `Recipe`."""
        return self.recipe.own_inertia(label)

    def dampers(self) -> tuple[Array, Rows, Array]:
        """Dampers that a matrix C amounts to, see `Body`."""
        return self.nominal.dampers()

    def solved_receptance(self, dofs: Rows, motions: Array, omega: Array) -> ComplexArray | None:
        """That of the structure, see `Structure`, where nothing is uncertain."""
        return None if self.names else self.nominal.solved_receptance(dofs, motions, omega)

    def at(self, dofs: Iterable[str], top_hz: float) -> Self:
        """The same structures, exact at these DOFs up to this frequency; elements end at their points."""
        there = replace(self, dofs=tuple(dofs), top_hz=top_hz)
        return there if self.exact or not is_hashable(there._made_from) else _one_of(there._made_from)

    @property
    def _made_from(self) -> tuple[Any, ...]:
        """Equal for equal ones."""
        return type(self), self.recipe, tuple(self.ranges.items()), self.dofs, self.top_hz

    def reference(self, *, solved: bool = True) -> Self:
        """The same of much richer elements; solved again for each row of factors, or interpolated as ever."""
        return type(self)(self.recipe.reference, self.ranges, exact=solved)

    def solved_anew(self) -> Self:
        """The same, solved for each row of factors; itself where these change no mode, which is solved once anyway."""
        return self if all(map(is_damping, self.names)) else replace(self, exact=True)

    def with_certain_damping(self, factors: Mapping[str, float]) -> Self:
        """The same, its damping taken for certain, at these factors."""
        certain = {name: factors.get(name, 1.0) for name in self.ranges if is_damping(name)}
        ranges = {name: ends for name, ends in self.ranges.items() if name not in certain}
        recipe = replace(self.recipe, damping=self.recipe.damping.scaled(certain))  # type: ignore[call-arg]  # a field of each
        return replace(self, recipe=recipe, ranges=ranges)

    def structure(self, factors: Sequence[float] | Array) -> Structure:
        """Structure at factors (q,), assembled again."""
        values = np.asarray(factors, dtype=float)
        named = dict(zip(self.names, values.tolist(), strict=True)) if values.size else {}
        return self.recipe.structure(named, self.mesh)

    def named(self, factors: Array) -> dict[str, Array]:
        """Factors (n, q) by their names, each (n,); none where no column gives them."""
        return dict(zip(self.names, factors.T, strict=True)) if factors.shape[1] else {}

    def free_modes(self, dofs: Rows, motions: Array, forced: Forced = None) -> FreeModes:
        """Interpolated modes; where modes cross or meet, so that they cannot be, one solution for each row."""
        forms = self.nominal.on_all_dofs(dofs, motions)
        if self.exact:
            return SolvedModes(self.structure, Reduction(self.n_dofs, forms))
        if forms.shape[1] > _KEPT_MOTIONS or not is_hashable(self._made_from):
            return self.over_factors(forms, forced)
        return _kept(self._made_from, forms.shape, forms.tobytes(), None if forced is None else tuple(forced.tolist()))

    def over_factors(self, motions: Array, forced: Forced) -> FreeModes:
        """The free modes with motions given as forms on all DOFs, shape (DOFs, k)."""
        raise NotImplementedError

    def damping_ratios(self, factors: Array, count: int) -> Array:
        """Damping ratio of each of the first `count` modes, (n, count), or (1, count) where all are certain."""
        law = self.recipe.damping
        certain = law.per_mode(min(count, self.n_dofs))
        if not any(map(is_damping_ratio, self.names)):
            return certain[None]
        listed = len(law.ratios) if isinstance(law, ModalDamping) else 1
        ratios = np.tile(certain, (len(factors), 1))
        ratios *= self.factor(factors, "damping_ratio")[:, None]
        for i in range(listed):
            # the last one holds for all higher modes
            ratios[:, i : None if i == listed - 1 else i + 1] *= self.factor(factors, f"damping_ratio_{i + 1}")[:, None]
        return ratios

    def loss_factors(self, factors: Array) -> Array:
        """Loss factor, shape (n,)."""
        return self.recipe.damping.hysteretic * self.factor(factors, "loss_factor")

    def factor(self, factors: Array, name: str) -> Array:
        """Factor on one quantity, shape (n,); ones where it is certain."""
        return np.broadcast_to(self.named(factors).get(name, 1.0), len(factors))


def is_hashable(values: object) -> bool:
    """Whether something can be looked up; not where a caller gave lists for tuples."""
    try:
        hash(values)
    except TypeError:
        return False
    return True


@lru_cache(maxsize=_KEPT)
def _one_of(made_from: tuple[Any, ...]) -> Any:  # noqa: ANN401 (of the kind that is asked for)
    """A body with its mesh and its nominal structure, which are made once."""
    kind, recipe, ranges, dofs, top_hz = made_from
    return kind(recipe, dict(ranges), dofs=dofs, top_hz=top_hz)


@lru_cache(maxsize=_KEPT)
def _kept(
    made_from: tuple[Any, ...], shape: tuple[int, ...], motions: bytes, forced: tuple[bool, ...] | None
) -> FreeModes:
    family: UncertainBody = _one_of(made_from)
    forms = np.frombuffer(motions).reshape(shape)
    return family.over_factors(forms, None if forced is None else np.array(forced, dtype=bool))
