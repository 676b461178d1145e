"""What the tables of all kinds of structure share: fields, and what is asked of each kind."""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Self

from jointbayes.case.errors import Finding
from jointbayes.case.schema.damping import ModalDampingSpec
from jointbayes.case.schema.fields import Spec, key_field, listed, not_negative

if TYPE_CHECKING:
    from jointbayes.case.schema.data import TruthSpec


KIND = key_field('the kind of structure, "beam", "frame", "chain" or "matrices"', "beam")
SUPPORTS = key_field("a list of the DOFs held fixed", ["1:y"])
MASS = not_negative("the mass in g added at each measured translation", 2.0)
#: Names of points: numbers from 1, or words.
POINT = re.compile(r"[1-9][0-9]{0,6}|[A-Za-z][A-Za-z0-9_-]{0,59}")

Absence = tuple[str, str, str]
"""What was found where a DOF does not exist, what is expected, and what to do."""


def point_and_direction(label: str) -> tuple[str, str]:
    """The two parts of a DOF label."""
    point, _, direction = label.rpartition(":")
    return point, direction


class AnyStructureSpec(Spec):
    """What is asked of a structure's table, whatever its kind."""

    @property
    @abstractmethod
    def points_in_order(self) -> tuple[str, ...]:
        """Names of all points, as they stand before the colon of a DOF label."""

    @property
    @abstractmethod
    def free_dofs(self) -> int:
        """Number of DOFs that can be named and are not held."""

    @property
    @abstractmethod
    def stated(self) -> dict[str, tuple[str, float]]:
        """Unit and value of each quantity that may be uncertain, and of no other."""

    @abstractmethod
    def absent(self, label: str) -> Absence | None:
        """What to say of a DOF that does not exist; None where it does."""

    @abstractmethod
    def place(self, label: str) -> str:
        """Where a DOF is, in words; empty where nobody knows."""

    @property
    def spans(self) -> int | None:
        """Equal spans between the numbered points of a straight beam; None for other structures."""
        return None

    @abstractmethod
    def of_truth(self, truth: TruthSpec) -> Self:
        """The structure that makes the data: as analysed, but for what the truth states otherwise."""


def absent_dofs(structure: AnyStructureSpec, labels: Iterable[str], loc: tuple[str, ...]) -> Iterator[Finding]:
    """Yield the DOF labels that the structure does not have."""
    for i, label in enumerate(labels):
        words = structure.absent(label)
        if words is not None:
            yield Finding((*loc, i), *words)


def absent_point(label: str, points: Iterable[str], directions: Iterable[str]) -> Absence | None:
    """What to say of a DOF where points have names."""
    point, direction = point_and_direction(label)
    names, ways = tuple(points), tuple(directions)
    if point not in names:
        remedy = f'write for example "{names[0]}:{direction}"' if names else "state the points"
        return f'"{label}": there is no point {point}', f"one of {listed(names)}", remedy
    if direction not in ways:
        return f'"{label}": no direction {direction}', f"one of {', '.join(ways)}", "choose one of these"
    return None


def changed_by(truth: TruthSpec) -> dict[str, object]:
    """What a truth changes in a structure of any kind: the accelerometers' mass and modal damping."""
    damping = truth.damping_ratio and ModalDampingSpec(law="modal", ratio=truth.damping_ratio)
    stated = {"accelerometer_mass_g": truth.accelerometer_mass_g, "damping": damping}
    return {name: value for name, value in stated.items() if value is not None}
