"""What recipes of structures share: names of uncertain quantities, supports, accelerometers, elements."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, ClassVar, Literal, Self

from jointbayes.errors import ModelError
from jointbayes.structure.damping import DampingLaw
from jointbayes.structure.matrices import Structure
from vibrecords.arrays import Array
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
        Mass that is exactly known, beside that of each accelerometer, kg.
    accelerometer_dofs
        Where one sits: its mass moves in all translations of the point of each of these DOFs that is a translation.
    element
        How it is discretised; no matter where matrices are given.
    """

    #: What it is, where a message begins.
    kind: ClassVar[str]

    __slots__ = ()
    damping: DampingLaw
    accelerometer_mass: float
    added_mass: float
    accelerometer_dofs: tuple[str, ...]
    element: ElementKind

    def _require_masses(self) -> None:
        if not all(0 <= mass <= _MOST_MASS for mass in (self.accelerometer_mass, self.added_mass)):
            raise ModelError(
                f"{self.kind}: found accelerometers of {self.accelerometer_mass:g} + {self.added_mass:g} kg; expected "
                f"masses of at least 0 and at most {_MOST_MASS:g} kg; correct them"
            )

    @property
    @abstractmethod
    def quantities(self) -> tuple[str, ...]:
        """Quantities that may be uncertain, beside ``damping_ratio_1`` and so on."""

    @property
    @abstractmethod
    def what(self) -> str:
        """The structure in a word or two."""

    @property
    @abstractmethod
    def extent(self) -> float:
        """Size, m."""

    @abstractmethod
    def own_stiffness(self, row: str, column: str) -> float:
        """Its stiffness by itself where two DOFs of a point are: what default priors are relative to."""

    @abstractmethod
    def own_inertia(self, dof: str) -> float:
        """Mass, kg, or moment of inertia, kg·m², that a spring at a DOF moves where nothing else holds it."""

    @abstractmethod
    def mesh(self, dofs: Iterable[str] | None = None, top_hz: float | None = None) -> Any:  # noqa: ANN401 (its own)
        """Elements that are exact up to a frequency and end where something acts or is observed."""

    @abstractmethod
    def structure(self, factors: Mapping[str, float] | None = None, mesh: Any = None) -> Structure:  # noqa: ANN401
        """The structure with its quantities multiplied by factors, 1 where none is given."""

    @property
    def reference(self) -> Self:
        """The same structure of much richer elements."""
        return replace(self, element="converged", richer=True)  # type: ignore[type-var]  # both have these fields

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
            raise ModelError(
                f"{self.kind}: found uncertain quantity {printable(name)!r}; expected one of "
                f"{', '.join(self.quantities)}, damping_ratio_1 and so on; correct the name or remove it"
            )

    def checked_factors(self, factors: Mapping[str, float] | None) -> dict[str, float]:
        """Factors by name, each that of a quantity of the structure.

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
        return replace(self, **masses)  # type: ignore[type-var]  # every recipe is a dataclass

    def lumped_factor(self, factor: Array) -> Array:
        """Factors on all mass at an accelerometer's place, from those on the accelerometer alone."""
        sensor, added = self.accelerometer_mass, self.added_mass
        return (sensor * factor + added) / (sensor + added) if added else factor

    def load(self, factors: Mapping[str, float]) -> float:
        """Mass at each accelerometer's place, kg."""
        return self.accelerometer_mass * factors.get("accelerometer_mass", 1.0) + self.added_mass
