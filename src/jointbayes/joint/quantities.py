"""What a joint is made of, by name: its stiffnesses, and the coordinates that these are inferred in.

A stiffness has a name, a unit and a place in K^J; a coordinate has a name, a label and bounds. Whoever reads, prints,
stores or judges them asks these objects and knows no name itself. They are stated here, apart from what is computed
with them, because what is wrong with a case file is said before NumPy is loaded.
"""

import math
from dataclasses import dataclass

__all__ = [
    "COORDINATES",
    "HYPOTHESES",
    "STIFFNESSES",
    "STIFFNESS_NAMES",
    "Coordinate",
    "Quantity",
]


@dataclass(frozen=True, slots=True)
class Quantity:
    """One stiffness of a joint.

    Parameters
    ----------
    name
        As in case files, draws and tables.
    unit
        SI unit.
    words
        What it is, for messages.
    place
        Row and column in K^J, row ≤ column.
    """

    name: str
    unit: str
    words: str
    place: tuple[int, int]

    @property
    def may_be_negative(self) -> bool:
        """Whether a joint that stores energy may have a negative one: off the diagonal."""
        return self.place[0] != self.place[1]


#: Of a joint of one translation and one rotation. The paper prints N/m for all three; such a joint has these.
STIFFNESSES = (
    Quantity("k11", "N/m", "the translational stiffness", (0, 0)),
    Quantity("k12", "N", "the coupling stiffness", (0, 1)),
    Quantity("k22", "N·m/rad", "the rotational stiffness", (1, 1)),
)
STIFFNESS_NAMES = tuple(quantity.name for quantity in STIFFNESSES)


@dataclass(frozen=True, slots=True)
class Coordinate:
    """One coordinate of a joint.

    Parameters
    ----------
    name
        As in case files and tables; that of a stiffness if it is the logarithm of one.
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
        Between which every joint lies, whatever the prior.
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


_LN_K11, _LN_K12, _LN_K22 = (Coordinate.logarithm_of(quantity) for quantity in STIFFNESSES)

#: What ``joint.parametrisation`` of a case file may be: its coordinates by name; the first is the default. What is
#: computed in them stands in the file of this room that has that name.
COORDINATES: dict[str, tuple[Coordinate, ...]] = {
    "log": (_LN_K11, _LN_K12, _LN_K22),
    "signed": (
        _LN_K11,
        _LN_K22,
        Coordinate("rho", "1", "k12", "the coupling coefficient k12/√(k11 k22)", False, "ρ", (-1.0, 1.0)),
    ),
    "elastic_centre": (
        _LN_K11,
        Coordinate("arm", "m", "k12", "the lever arm k12/k11 from the joint's node to its elastic centre", False),
        Coordinate("k22c", "N·m/rad", "k22", "the rotational stiffness about the elastic centre, k22 − k12²/k11"),
    ),
}

#: Springs that yield in the simpler joints that `jointbayes compare` sets against the case's own joint with coupling,
#: for which None stands; every other motion is rigid.
HYPOTHESES: dict[str, tuple[str, ...] | None] = {
    "rigid": (),
    "translation": ("k11",),
    "rotation": ("k22",),
    "springs": ("k11", "k22"),
    "full": None,
}
