"""A joint's quantity over the levels of the set-ups: torque, drive level, temperature."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.inference import Level, Setup
from jointbayes.inference.setup import own_name
from jointbayes.posterior.draws import PosteriorDraws
from jointbayes.posterior.verdicts import reasons_for_no_verdict

_TINY = float(np.finfo(float).tiny)


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
    pair
        Places of the two levels that are compared: the lowest and the highest where the medians rise or fall
        throughout, else those between which the quantity differs most clearly.
    pairs
        Number of pairs among which they were chosen: for all of them together the interval of the change holds.
    relative
        Whether the change is a ratio; of a quantity that may be negative it is a difference.
    change
        Median and ends of the interval of the quantity at the second of the levels over that at the first, or minus it.
    unjudged
        Why nothing is said of a change: that the run has no verdict; empty where it has.
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
    pair: tuple[int, int]
    pairs: int
    relative: bool
    change: tuple[float, float, float]
    unjudged: str = ""

    @property
    def sentence(self) -> str:
        """Whether the quantity changes with the level, with its figures."""
        middle, low, high = self.change
        unit = f" {self.of.unit}" if self.of.unit else ""
        first, second = (f"{self.level[place]:g}{unit}" for place in self.pair)
        between = f"between {first} and {second}"
        if self.unjudged:
            return f"{self.name} {between}: nothing is said of a change, for {self.unjudged}."
        least, own = (1.0, "") if self.relative else (0.0, f" {self.unit}" if self.unit != "1" else "")
        text = f"{self.name} at {second} {'over' if self.relative else 'minus'} that at {first}"
        held = f"{100 * self.probability:g} % credible interval"
        if self.pairs > 1:
            text += f", of {self.pairs} pairs of levels the one that differs most clearly"
            held = f"{100 * self.probability:g} % credible interval for all pairs together"
        text += f": median {middle:.4g}{own}, {held} {low:.4g} to {high:.4g}{own}"
        if low <= least <= high:
            return f"{text}; no change {between} is shown."
        return f"{text}; it {'rises' if low > least else 'falls'} {between}."


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
    levels = {_value(one) for one, _ in named}
    if len(levels) < 2 or not any(own != name for _, own in named):
        what = (
            f"{len(levels)} levels of set-ups with {name!r}" if len(levels) < 2 else f"{name!r} in no set-up of its own"
        )
        raise ModelError(
            f"curve: found {what}; expected a quantity that is each set-up's own, and two levels at least; give the "
            "set-ups levels that differ, and the joint own quantities"
        )
    values = np.stack([posterior.values(own).ravel() for _, own in named], axis=-1)
    tail = (1 - probability) / 2
    low, median, high = np.quantile(values, [tail, 0.5, 1 - tail], axis=0)
    level = np.array([_value(one) for one, _ in named])
    relative = all(_is_positive(posterior, own) for _, own in named)
    pair, pairs, change = _change(values, level, relative=relative, tail=tail)
    first = named[0][0].level
    assert first is not None
    return Curve(
        name,
        posterior.unit(named[0][1]),
        first,
        tuple(one.name for one, _ in named),
        tuple(own for _, own in named),
        level,
        median,
        low,
        high,
        probability,
        pair,
        pairs,
        relative,
        change,
        "; ".join(reasons_for_no_verdict(posterior)),
    )


def _change(
    values: Array, level: Array, *, relative: bool, tail: float
) -> tuple[tuple[int, int], int, tuple[float, float, float]]:
    """The pair of levels that is compared, the number among which it was chosen, and the change between them.

    Parameters
    ----------
    values
        Draws at each level, shape (draws, n).
    level
        Levels, rising, shape (n,).
    relative
        Whether the change is a ratio.
    tail
        Probability on either side of the interval, which is divided among the pairs that were looked at.
    """
    shown = np.log(values) if relative else values
    steps = np.diff(np.median(shown, axis=0))
    last = len(level) - 1
    pairs = [(0, last)]
    if (steps > 0).any() and (steps < 0).any():
        pairs = [(i, j) for i in range(last) for j in range(i + 1, last + 1) if level[i] < level[j]]
    # of many pairs one differs by chance: the interval is that of all pairs together (Bonferroni)
    tail /= len(pairs)
    changes = [np.quantile(shown[:, j] - shown[:, i], [0.5, tail, 1 - tail]) for i, j in pairs]
    clearest = max(range(len(pairs)), key=lambda k: abs(changes[k][0]) / max(changes[k][2] - changes[k][1], _TINY))
    i, j = pairs[clearest]
    changed = values[:, j] / values[:, i] if relative else values[:, j] - values[:, i]
    middle, low, high = np.quantile(changed, [0.5, tail, 1 - tail])
    return (i, j), len(pairs), (float(middle), float(low), float(high))


def _is_positive(posterior: PosteriorDraws, name: str) -> bool:
    """Whether a quantity is above 0 whatever the data say, so that a ratio of two tells their change."""
    problem = posterior.problem
    logarithmic = {axis.quantity for axis in problem.parametrisation.axes if axis.logarithmic}
    signed = {one.name for one in problem.quantities if one.may_be_negative}
    return (name in logarithmic or name not in signed) and bool((posterior.values(name) > 0).all())


def curves_of(posterior: PosteriorDraws) -> tuple[Curve, ...]:
    """The curve of every quantity of the joints that set-ups with levels have for themselves."""
    levels: dict[str, set[float]] = {}
    for name in posterior.stiffness_names:
        for one in _with_levels(posterior.problem.setups):
            if name.startswith(f"{one.name}."):
                levels.setdefault(name.removeprefix(f"{one.name}."), set()).add(_value(one))
    return tuple(curve_of(posterior, name) for name, found in levels.items() if len(found) > 1)


def _with_levels(setups: Sequence[Setup]) -> list[Setup]:
    return sorted((one for one in setups if one.level is not None), key=_value)


def _value(setup: Setup) -> float:
    assert setup.level is not None
    return setup.level.value
