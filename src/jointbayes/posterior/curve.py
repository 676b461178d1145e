"""A joint's quantity over the levels of the set-ups: torque, drive level, temperature."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import ModelError
from jointbayes.inference import Level, Setup
from jointbayes.inference.setup import own_name
from jointbayes.posterior.draws import PosteriorDraws

__all__ = ["Curve", "curve_of", "curves_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A quantity at each level, in the order of the levels.

    Parameters
    ----------
    name, unit
        The quantity as a set-up calls it, ``"k11"`` or ``"clamp.k11"``, and its unit.
    of
        What the level is, with its unit; its value is that of the first set-up.
    setups, quantities
        Name of each set-up, and of its quantity: ``"loud.k11"``, or ``"k11"`` where it shares that.
    level
        Level of each set-up, shape (n,).
    median, low, high
        Median and ends of the interval, in the unit, each shape (n,).
    probability
        Inside the interval at each level.
    ratio
        Median and ends of the interval of the quantity at the last level over that at the first.
    """

    name: str
    unit: str
    of: Level
    setups: tuple[str, ...]
    quantities: tuple[str, ...]
    level: Array
    median: Array
    low: Array
    high: Array
    probability: float
    ratio: tuple[float, float, float]

    @property
    def sentence(self) -> str:
        """Whether the quantity changes with the level, with its figures."""
        middle, low, high = self.ratio
        unit = f" {self.of.unit}" if self.of.unit else ""
        text = f"{self.name} at {self.level[-1]:g}{unit} over that at {self.level[0]:g}{unit}: median {middle:.4g}, "
        text += f"{100 * self.probability:g} % credible interval {low:.4g} to {high:.4g}"
        told = "the data show no change" if low <= 1 <= high else f"it {'rises' if low > 1 else 'falls'}"
        return f"{text}; {told}."


def curve_of(posterior: PosteriorDraws, name: str, probability: float = 0.95) -> Curve:
    """The curve of one quantity.

    Raises
    ------
    ModelError
        If set-ups have no levels, or none has this quantity for itself.
    """
    if not 0 < probability < 1:
        raise ModelError(f"curve: found probability {probability:g}; expected a number between 0 and 1; correct it")
    problem = posterior.problem
    known = [*posterior.stiffness_names, *(nuisance.name for nuisance in problem.prior.nuisances)]
    setups = _with_levels(problem.setups)
    found = [(one, own_name(one.name, name, known)) for one in setups]
    named = [(one, own) for one, own in found if own is not None]
    if len(setups) < 2 or not any(own != name for _, own in named):
        what = f"{len(setups)} set-ups with a level" if len(setups) < 2 else f"{name!r} in no set-up of its own"
        raise ModelError(
            f"curve: found {what}; expected a quantity that is each set-up's own, and a level for each; give the "
            "set-ups levels, and the joint own quantities"
        )
    values = np.stack([posterior.values(own).ravel() for _, own in named], axis=-1)
    tail = (1 - probability) / 2
    low, median, high = np.quantile(values, [tail, 0.5, 1 - tail], axis=0)
    ratio = np.quantile(values[:, -1] / values[:, 0], [0.5, tail, 1 - tail])
    first = named[0][0].level
    assert first is not None
    return Curve(
        name,
        posterior.unit(named[0][1]),
        first,
        tuple(one.name for one, _ in named),
        tuple(own for _, own in named),
        np.array([_value(one) for one, _ in named]),
        median,
        low,
        high,
        probability,
        (float(ratio[0]), float(ratio[1]), float(ratio[2])),
    )


def curves_of(posterior: PosteriorDraws) -> tuple[Curve, ...]:
    """The curve of every quantity of the joints that set-ups with levels have for themselves."""
    setups = _with_levels(posterior.problem.setups)
    names = dict.fromkeys(
        name.removeprefix(f"{one.name}.")
        for name in posterior.stiffness_names
        for one in setups
        if name.startswith(f"{one.name}.")
    )
    return tuple(curve_of(posterior, name) for name in names) if len(setups) > 1 else ()


def _with_levels(setups: Sequence[Setup]) -> list[Setup]:
    return sorted((one for one in setups if one.level is not None), key=_value)


def _value(setup: Setup) -> float:
    assert setup.level is not None
    return setup.level.value
