"""What a joint is made of, by name: its stiffnesses, and the coordinates that these are inferred in.

A stiffness has a name, a unit and its places in K^J; a coordinate has a name, a label and bounds. Whoever reads,
prints, stores or judges them asks these objects and knows no name itself. They are stated here, apart from what is
computed with them, because what is wrong with a case file is said before NumPy is loaded.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from typing import Literal

from vibrecords.labels import direction_of

QuantityRole = Literal["stiffness", "viscous", "loss factor"]

#: Directions in which a joint's DOF may move, as they stand after the colon of a DOF label.
DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
_UNITS = ("N/m", "N", "N·m/rad")  # of an entry of K^J of none, one or two rotations
#: Kinds of joint that a case file may ask for.
KINDS = ("coupled", "rigid", "springs", "full")


@dataclass(frozen=True, slots=True)
class Quantity:
    """One stiffness of a joint, or of several identical ones.

    Parameters
    ----------
    name
        As in case files, draws and tables: ``"k11"``, or ``"clamp.k11"`` where the joint has a name.
    unit
        SI unit.
    words
        What it is, for messages.
    places
        Row and column in K^J, row ≤ column, of each entry that it is; of joints that share it one each.
    role
        What it does in the joint.
    """

    name: str
    unit: str
    words: str
    places: tuple[tuple[int, int], ...]
    role: QuantityRole = "stiffness"

    @property
    def may_be_negative(self) -> bool:
        """Whether a joint that stores energy may have a negative one: off the diagonal."""
        return self.role == "stiffness" and any(row != column for row, column in self.places)

    def assign_to_joint(self, name: str, rows: Sequence[int]) -> "Quantity":
        """The same quantity of a joint with a name, whose DOFs begin at these rows of a larger K^J."""
        places = tuple((row + i, row + j) for row in rows for i, j in self.places)
        return replace(self, name=prefixed(name, self.name), words=words_of(self.words, name), places=places)


def prefixed(joint: str, name: str) -> str:
    """Name of a quantity of a joint, which may have no name itself."""
    return f"{joint}.{name}" if joint else name


def words_of(words: str, joint: str) -> str:
    """What a quantity of a joint is, for messages."""
    return f"{words} of {joint}" if joint else words


def is_rotation(direction: str) -> bool:
    """Whether a direction, or the DOF of a label, is a rotation."""
    return direction_of(direction).startswith("r")


def is_rotation_unit(unit: str) -> bool:
    """Whether a stiffness on the diagonal with this unit belongs to a rotation."""
    return unit == _UNITS[2]


#: Of a joint of one translation and one rotation. The paper prints N/m for all three; such a joint has these.
COUPLED = (
    Quantity("k11", "N/m", "the translational stiffness", ((0, 0),)),
    Quantity("k12", "N", "the coupling stiffness", ((0, 1),)),
    Quantity("k22", "N·m/rad", "the rotational stiffness", ((1, 1),)),
)


def spring_stiffnesses(directions: Sequence[str]) -> tuple[Quantity, ...]:
    """One spring in each direction: ``"ky"``, ``"krz"``.

    Examples
    --------
    >>> [(spring.name, spring.unit) for spring in spring_stiffnesses(("y", "rz"))]
    [('ky', 'N/m'), ('krz', 'N·m/rad')]
    """
    springs = []
    for i, direction in enumerate(directions):
        turning = is_rotation(direction)
        words = f"the {'rotational' if turning else 'translational'} stiffness {'about' if turning else 'along'} "
        springs.append(Quantity(f"k{direction}", _UNITS[2 * turning], words + direction.removeprefix("r"), ((i, i),)))
    return tuple(springs)


def full_stiffnesses(directions: Sequence[str]) -> tuple[Quantity, ...]:
    """Every entry of a symmetric K^J, row by row from the diagonal: k11, k12, … k1r, k22, … krr."""
    turning = [is_rotation(direction) for direction in directions]
    entries = []
    for i, j in combinations_with_replacement(range(len(directions)), 2):
        words = f"the stiffness of motion {i + 1} ({directions[i]})"
        if i != j:
            words = f"the coupling stiffness of motions {i + 1} ({directions[i]}) and {j + 1} ({directions[j]})"
        entries.append(Quantity(f"k{i + 1}{j + 1}", _UNITS[turning[i] + turning[j]], words, ((i, j),)))
    return tuple(entries)


def damping_quantities(
    stiffnesses: Sequence[Quantity], viscous: Sequence[str], loss_factors: Sequence[str]
) -> tuple[Quantity, ...]:
    """Dashpots and loss factors along the stiffnesses of these names; ``"all"`` is one loss factor on all of them.

    Examples
    --------
    >>> [one.name for one in damping_quantities(COUPLED, ["k22"], ["all"])]
    ['c22', 'eta']
    """
    by_name = {quantity.name: quantity for quantity in stiffnesses}
    dashpots = [
        Quantity(
            f"c{k.name[1:]}", f"{k.unit.replace('/', '·s/', 1)}", f"the dashpot beside {k.name}", k.places, "viscous"
        )
        for k in (by_name[name] for name in viscous)
    ]
    losses = []
    for name in loss_factors:
        if name == "all":
            places = tuple(place for quantity in stiffnesses for place in quantity.places)
            losses.append(Quantity("eta", "1", "the loss factor of all stiffnesses", places, "loss factor"))
        else:
            losses.append(
                Quantity(f"eta{name[1:]}", "1", f"the loss factor of {name}", by_name[name].places, "loss factor")
            )
    return (*dashpots, *losses)


@dataclass(frozen=True, slots=True)
class Coordinate:
    """One coordinate of a joint.

    Parameters
    ----------
    name
        As in case files and tables; a stiffness's own if it is the logarithm of one.
    unit
        Unit of its value, "1" for none.
    quantity
        The stiffness that it is, or that it stands for together with the others.
    words
        What it is, for messages.
    logarithmic
        Whether θ is the natural logarithm of the value, which is then positive; otherwise θ is the value.
    symbol
        As it is typeset; the name by default.
    bounds
        Between which every joint lies, with any prior.
    """

    name: str
    unit: str
    quantity: str
    words: str
    logarithmic: bool = True
    symbol: str = ""
    bounds: tuple[float, float] = (-math.inf, math.inf)

    @classmethod
    def logarithm_of(cls, quantity: Quantity) -> "Coordinate":
        """Of a stiffness."""
        return cls(quantity.name, quantity.unit, quantity.name, quantity.words)

    def assign_to_joint(self, name: str) -> "Coordinate":
        """The same coordinate of a joint with a name."""
        return replace(
            self,
            name=prefixed(name, self.name),
            quantity=prefixed(name, self.quantity),
            words=words_of(self.words, name),
            symbol=prefixed(name, self.symbol) if self.symbol else "",
        )

    @property
    def label(self) -> str:
        """How θ is written: ``"ln k11"``, ``"ρ"``."""
        return f"ln {self.name}" if self.logarithmic else self.symbol or self.name

    @property
    def axis_label(self) -> str:
        """How the axis of a figure is labelled, which shows decades: ``"log₁₀ k11"``, ``"ρ"``, ``"arm (m)"``."""
        if self.logarithmic:
            return f"log₁₀ {self.name}"
        return self.label if self.unit == "1" else f"{self.label} ({self.unit})"

    @property
    def axis_scale(self) -> float:
        """Factor from θ to what the axis of a figure shows."""
        return 1 / math.log(10) if self.logarithmic else 1.0

    @property
    def bounded(self) -> bool:
        """Whether joints lie between two finite bounds only."""
        return math.isfinite(self.bounds[0]) and math.isfinite(self.bounds[1])

    def value(self, theta: float) -> float:
        """Value in its unit at θ."""
        return math.exp(theta) if self.logarithmic else theta


_LN_K11, _LN_K12, _LN_K22 = (Coordinate.logarithm_of(quantity) for quantity in COUPLED)
_RHO = Coordinate("rho", "1", "k12", "the coupling coefficient k12/√(k11 k22)", False, "ρ", (-1.0, 1.0))

#: What ``joint.parametrisation`` of a case file may be: its coordinates by name; the first is the default. What is
#: computed in them stands in the file of this room that has that name.
COORDINATES: dict[str, tuple[Coordinate, ...]] = {
    "log": (_LN_K11, _LN_K12, _LN_K22),
    "signed": (_LN_K11, _LN_K22, _RHO),
    "elastic_centre": (
        _LN_K11,
        Coordinate("arm", "m", "k12", "the lever arm k12/k11 from the joint's node to its elastic centre", False),
        Coordinate("k22c", "N·m/rad", "k22", "the rotational stiffness about the elastic centre, k22 − k12²/k11"),
    ),
}


def full_coordinates(directions: Sequence[str]) -> tuple[Coordinate, ...]:
    """Of `full_stiffnesses`: the logarithms of the diagonal, then the partial coupling coefficients row by row."""
    stiffnesses = full_stiffnesses(directions)
    logs = [Coordinate.logarithm_of(quantity) for quantity in stiffnesses if not quantity.may_be_negative]
    partial = []
    for quantity in stiffnesses:
        ((i, j),) = quantity.places
        if i == j:
            continue
        words = f"the coupling coefficient of motions {i + 1} and {j + 1}"
        words += f" with motions 1 to {i} free" if i else ""
        name, symbol = (f"{letter}{i + 1}{j + 1}" for letter in ("rho", "ρ"))
        partial.append(Coordinate(name, "1", quantity.name, words, False, symbol, (-1.0, 1.0)))
    return (*logs, *partial)


#: What `jointbayes compare` sets against each other by default: which springs of the joint yield. All but the last have
#: no coupling, and every other motion is rigid; the last has every coupling.
USUAL_HYPOTHESES = ("rigid", "translation", "rotation", "springs", "full")
_UNDAMPED = "undamped "
#: All it may be asked for: a translation and a rotation coupled as well, and all that yield without their damping.
HYPOTHESES = (*USUAL_HYPOTHESES, "coupled", *(f"{_UNDAMPED}{name}" for name in (*USUAL_HYPOTHESES[1:], "coupled")))


def split_hypothesis(hypothesis: str) -> tuple[bool, str]:
    """Whether a hypothesis leaves the joint's damping out, and what it says of the springs.

    Examples
    --------
    >>> split_hypothesis("undamped springs")
    (True, 'springs')
    """
    return hypothesis.startswith(_UNDAMPED), hypothesis.removeprefix(_UNDAMPED)
