"""A quantity over the levels of the tests, and whether it changes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from jointbayes.errors import ModelError, require_probability
from jointbayes.inference import Level, Test
from jointbayes.inference.test import own_name
from jointbayes.posterior.any_posterior import AnyPosterior
from jointbayes.posterior.homogeneity import compare_tests
from jointbayes.posterior.verdicts import reasons_for_no_verdict
from vibrecords.arrays import Array

_TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True, slots=True, eq=False)
class Curve:
    """A quantity at each level, in the order of the levels.

    Parameters
    ----------
    name, unit
        The quantity as a test calls it, ``"k11"`` or ``"clamp.k11"``, and its unit.
    of
        What the level is, with its unit; its value is that of the first test.
    tests, quantities
        Name of each test, and of its quantity: ``"loud.k11"``, or ``"k11"`` where it shares that.
    level
        Level of each test, shape (n,).
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
    equal_data
        Whether the data of the two are equal within their noise, so that they show no change.
    """

    name: str
    unit: str
    of: Level
    tests: tuple[str, ...]
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
    equal_data: bool = False

    def __repr__(self) -> str:
        return self.sentence

    @property
    def changes(self) -> bool:
        """Whether a change is shown: the interval leaves none out, and the data differ by more than their noise."""
        _, low, high = self.change
        return not (self.unjudged or self.equal_data or low <= (1.0 if self.relative else 0.0) <= high)

    @property
    def sentence(self) -> str:
        """Whether the quantity changes with the level, with its figures."""
        middle, low, high = self.change
        unit = f" {self.of.unit}" if self.of.unit else ""
        first, second = (f"{self.level[place]:g}{unit}" for place in self.pair)
        between = f"between {first} and {second}"
        if self.unjudged:
            return f"{self.name} {between}: nothing is said of a change, for {self.unjudged}."
        least, quantity_unit = (1.0, "") if self.relative else (0.0, f" {self.unit}" if self.unit != "1" else "")
        text = f"{self.name} at {second} {'over' if self.relative else 'minus'} that at {first}"
        held = f"{100 * self.probability:g} % credible interval"
        if self.pairs > 1:
            text += f", of {self.pairs} pairs of levels the one that differs most clearly"
            held = f"{100 * self.probability:g} % credible interval for all pairs together"
        text += f": median {middle:.4g}{quantity_unit}, {held} {low:.4g} to {high:.4g}{quantity_unit}"
        if not self.changes:
            why = ", for the data of the two are equal within their noise" if self.equal_data else ""
            return f"{text}; no change {between} is shown{why}."
        return f"{text}; it {'rises' if low > least else 'falls'} {between}."


def curve_of(posterior: AnyPosterior, name: str, probability: float = 0.95) -> Curve:
    """The curve of one quantity.

    Raises
    ------
    ModelError
        If tests have no levels, or none has this quantity for itself.
    """
    require_probability(probability, "curve")
    problem = posterior.problem
    names = [*posterior.stiffness_names, *(nuisance.name for nuisance in problem.prior.nuisances)]
    own_names = [(test, own_name(test.name, name, names)) for test in _sorted_by_level(problem.tests)]
    named = [(test, quantity) for test, quantity in own_names if quantity is not None]
    levels = {_value(test) for test, _ in named}
    if len(levels) < 2 or not any(quantity != name for _, quantity in named):
        what = f"{len(levels)} levels of tests with {name!r}" if len(levels) < 2 else f"{name!r} in no test of its own"
        raise ModelError(
            f"curve: found {what}; expected a quantity that is each test's own, and two levels at least; give the "
            "tests levels that differ, and the joint own quantities"
        )
    values = np.stack([posterior.values(quantity).ravel() for _, quantity in named], axis=-1)
    tail = (1 - probability) / 2
    low, median, high = np.quantile(values, [tail, 0.5, 1 - tail], axis=0)
    level = np.array([_value(test) for test, _ in named])
    # a ratio of two tells their change where both are above 0 whatever the data say
    signed = {quantity.name for quantity in problem.quantities if quantity.may_be_negative}
    signed -= {axis.quantity for axis in problem.parametrisation.axes if axis.logarithmic}
    relative = signed.isdisjoint(quantity for _, quantity in named) and bool((values > 0).all())
    pair, pairs, change = _change(values, level, relative=relative, tail=tail)
    first = named[0][0].level
    assert first is not None
    compared = compare_tests(*(named[place][0] for place in pair))
    return Curve(
        name, posterior.unit(named[0][1]), first, tuple(test.name for test, _ in named), tuple(q for _, q in named),
        level=level, median=median, low=low, high=high, probability=probability, pair=pair, pairs=pairs,
        relative=relative, change=change, unjudged="; ".join(reasons_for_no_verdict(posterior)),
        equal_data=compared is not None and compared.equal,
    )  # fmt: skip


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


def curves_of(posterior: AnyPosterior) -> tuple[Curve, ...]:
    """The curve of every quantity of the joints that tests with levels have for themselves."""
    levels: dict[str, set[float]] = {}
    for name in posterior.stiffness_names:
        for test in _sorted_by_level(posterior.problem.tests):
            if name.startswith(f"{test.name}."):
                levels.setdefault(name.removeprefix(f"{test.name}."), set()).add(_value(test))
    return tuple(curve_of(posterior, name) for name, values in levels.items() if len(values) > 1)


def _sorted_by_level(tests: Sequence[Test]) -> list[Test]:
    return sorted((test for test in tests if test.level is not None), key=_value)


def _value(test: Test) -> float:
    assert test.level is not None
    return test.level.value
