"""Which combinations of a joint's stiffnesses are known, and how well: evaluated on the draws themselves.

A posterior may know k22 − k12²/k11 and none of the three stiffnesses by itself. Every quantity that can be made of a
joint is evaluated on each draw; the best known one is named, then the best known among those that say something else.
What is said of a quantity is its own 95 % interval, as it is printed everywhere, so that no sentence can say what the
draws do not.

References
----------
Gutenkunst, R. N. et al. (2007). Universally sloppy parameter sensitivities in systems biology models. PLoS
Computational Biology 3(10), e189. DOI 10.1371/journal.pcbi.0030189 (combinations of logarithms that data determine)
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.joint import Parametrisation, parametrisation_named
from jointbayes.joint.combinations import (
    Combination,
    combinations_of,
    flexibilities_at_arms,
    parametrisation_of_draws,
    powers_text,
    single_values,
)
from jointbayes.posterior.identifiability import CERTAINTY, Verdict, VerdictClass, assess, judge_by_rule, ratio_of
from jointbayes.rounding import rounded, rounded_interval, with_interval
from jointbayes.verdict_rule import RULE, VerdictRule
from vibrecords.arrays import Array

_NORMAL_95 = 1.959963984540054
_MOST_TOLD = 4  # in a sentence
#: A quantity says something else than those named before if this share of its gradient is left across theirs.
_NEW = 0.5
#: Products of any powers are the last resort: they must be known by this factor better.
_ODD_POWERS = 4.0
#: A rounded exponent may cost so much of what is known of the product.
_ROUNDING_COST = 1.3
#: A stiffness moves with another one if the correlation of their logarithms over the draws is larger than this.
_MOVES_WITH = 0.8
_STEP = 1e-5


@dataclass(frozen=True, slots=True)
class NamedDirection:
    """One combination of the joint's stiffnesses, and what its draws say.

    Parameters
    ----------
    quantity
        What it is: ``"k22 − k12²/k11"``, ``"k11"``; rho stands for k12/√(k11 k22).
    interval95
        95 % interval as it is printed, SI units: of a combination equal-tailed and credible, over the draws; of a
        stiffness see `jointbayes.posterior.verdicts`.
    ratio
        Upper over lower end; infinite where the interval holds zero or the draws have both signs.
    sd_log
        Standard deviation of ln |quantity| over the draws; NaN where they have both signs.
    verdict
        By the rule of `jointbayes.posterior.identifiability`, as for a single stiffness, whose own verdict
        is the one of the whole posterior, see `jointbayes.posterior.verdicts`.
    sentence
        For example ``"k22 is identified: 1.52 (1.51 to 1.58) MN·m/rad"``.
    interval95_error
        Monte Carlo standard errors of the two ends; NaN for a combination.
    limit
        One-sided limit of a stiffness that is bounded below or above, SI units; else NaN.
    median
        Of the quantity over the draws, SI units.
    unit
        Unit of the quantity; empty for a combination without one.
    what
        What a flexibility is in a sentence: ``"under a force at a lever arm of 100 mm the joint gives"``; else empty.
    """

    quantity: str
    interval95: tuple[float, float]
    ratio: float
    sd_log: float
    verdict: VerdictClass
    sentence: str
    interval95_error: tuple[float, float] = (math.nan, math.nan)
    limit: float = math.nan
    median: float = math.nan
    unit: str = ""
    what: str = ""

    @property
    def as_flexibility(self) -> str:
        """What the joint does under a force, in words; empty of what is no flexibility."""
        return self.what and f"{self.what} {with_interval(self.interval95, 'm/N')} ({self.verdict})"


def name_directions(
    stiffness: ArrayLike,
    prior: ArrayLike,
    judged: Mapping[str, Verdict] | None = None,
    parametrisation: Parametrisation | None = None,
    rule: Callable[[str], VerdictRule] = lambda _: RULE,
) -> tuple[NamedDirection, ...]:
    """Name the combinations of the stiffnesses that draws determine independently, best known first.

    Where every single stiffness is identified the words name those: combinations would say nothing more. A product, a
    ratio or a difference is named only where it is at least weakly identified, and better known than any single
    stiffness that says the same.

    Parameters
    ----------
    stiffness
        Posterior draws of the joint's stiffnesses, shape (n, q).
    prior
        Prior draws of the same, shape (m, q): a verdict asks what the data added.
    judged
        What is already said of single stiffnesses, by name, so that it is said here in the same words; those that are
        not among them are assessed here.
    parametrisation
        Says what the stiffnesses are; by default k11, k12 and k22 of a coupled pair.
    rule
        Gives the thresholds of a quantity by its name; by default the usual ones.

    Returns
    -------
    tuple of NamedDirection
        As many as the joint has coordinates.
    """
    draws, before = np.asarray(stiffness, dtype=float), np.asarray(prior, dtype=float)
    search = _Search(draws, before, dict(judged or {}), parametrisation or parametrisation_named("log"), rule)
    singles = [search.judged(quantity) for quantity in search.singles]
    if all(single.cls == "identified" for single in singles):
        order = sorted(zip(search.singles, singles, strict=True), key=lambda pair: pair[1].ratio)
        return tuple(search.named(quantity, single) for quantity, single in order)
    return search.run()


def summary_sentence(named: Sequence[NamedDirection]) -> str:
    """The combinations that are known best in one sentence.

    Examples
    --------
    >>> summary_sentence([])
    'The joint has no unknown stiffness.'
    """
    if not named:
        return "The joint has no unknown stiffness."
    more = [f"and {len(named) - _MOST_TOLD} more, see the table"] if len(named) > _MOST_TOLD else []
    return "; ".join([*(n.sentence for n in named[:_MOST_TOLD]), *more]) + "."


class _Search:
    """Quantities of one joint, evaluated on its draws."""

    def __init__(
        self,
        stiffness: Array,
        prior: Array,
        judged: dict[str, Verdict],
        parametrisation: Parametrisation,
        rule: Callable[[str], VerdictRule],
    ) -> None:
        self._stiffness, self._prior, self._known, self._rule = stiffness, prior, judged, rule
        self._parametrisation = parametrisation_of_draws(parametrisation, stiffness)
        self.names = self._parametrisation.names
        self._theta = self._parametrisation.coordinates(stiffness)
        scale = np.maximum(self._theta.std(axis=0), np.finfo(float).tiny)
        off = (self._theta - np.median(self._theta, axis=0)) / scale
        #: The draw in the middle: a possible joint, which a median of each coordinate by itself need not be.
        self._middle = self._theta[int((off**2).sum(axis=1).argmin())]
        self.singles = single_values(self._parametrisation)
        self._others = combinations_of(self._parametrisation)
        if not any(self.judged(quantity).cls in CERTAINTY for quantity in self.singles):
            self._others += flexibilities_at_arms(self._parametrisation, stiffness)
        self._linear = [axis.name for axis in self._parametrisation.axes if not axis.logarithmic]
        self._width = cache(self._found_width)  # each place on the list asks for it again

    def run(self) -> tuple[NamedDirection, ...]:
        """Best known first; the last is a single stiffness, and says what moves with it."""
        axes = np.empty((0, len(self.names)))
        named: list[NamedDirection] = []
        while len(named) < len(self.names):
            if len(named) == len(self.names) - 1:  # the least known single stiffness that says something else
                quantity = max([q for q in self.singles if self._share(q, axes)] or self.singles, key=self._width)
            else:  # the best known quantity, for what it adds to those named
                shares = {q: self._share(q, axes) for q in (*self.singles, *self._others, *self._powers(axes))}
                score = {q: self._width(q) * q.penalty / share if share else math.inf for q, share in shares.items()}
                quantity = next(
                    q for q in sorted(score, key=score.__getitem__) if q.single or self.judged(q).cls in CERTAINTY
                )
            judged = self.judged(quantity)
            words = "" if judged.cls in CERTAINTY else self._moving_with(quantity)
            named.append(self.named(quantity, judged, words))
            beside = _orthogonal_part(self._gradient(quantity), axes)
            axes = np.vstack([axes, beside / np.linalg.norm(beside)])
        return tuple(named)

    def judged(self, quantity: Combination) -> Verdict:
        """What is known of a quantity, by its draws; of none is more said than of single stiffnesses."""
        if quantity.name not in self._known:
            assessment = assess(quantity.of(self._stiffness), quantity.of(self._prior), rule=self._rule(quantity.name))
            failed = any(other.cls == "no verdict" for other in self._known.values())
            self._known[quantity.name] = replace(assessment, cls="no verdict") if failed else assessment
        return self._known[quantity.name]

    def named(self, quantity: Combination, judged: Verdict, moving: str = "") -> NamedDirection:
        """Return a quantity with its words: value or limit, and why its interval alone does not give the class."""
        (low, high), errors = judged.interval, judged.interval_error
        ratio = math.inf if math.isinf(judged.ratio) else ratio_of((low, high))  # draws of either sign have none
        unit, bounded = judged.unit or quantity.unit, math.isfinite(judged.limit)
        value = f"{rounded(judged.median)} ({rounded_interval((low, high), errors)}), SI units"
        if unit:
            value = replace(judged, unit=unit).value
        if not bounded and low <= 0 <= high:
            value += ", which contains zero"
        elif not bounded and math.isinf(judged.ratio):
            value += ", with draws of either sign"
        elif not bounded and judged.cls not in (
            judge_by_rule(self._rule(quantity.name), judged.ratio, 1.0)[0],
            "no verdict",
        ):
            value += f"; {judged.because}"
        verb = "has" if judged.cls == "no verdict" else "is"  # a failed run
        return NamedDirection(
            quantity.name,
            (low, high),
            ratio,
            judged.sd_log,
            judged.cls,
            f"{quantity.name} {verb} {judged.cls}: {value}{moving}",
            errors,
            judged.limit,
            judged.median,
            unit,
            quantity.what,
        )

    def _found_width(self, quantity: Combination) -> float:
        """A quarter of the 95 % interval of ln q, of q itself where it has both signs; infinite for a sum of both."""
        values = quantity.of(self._stiffness)
        if (values > 0).all() or (values < 0).all():
            values = np.log(np.abs(values))
        elif not quantity.single:
            return math.inf
        low, high = np.quantile(values, [0.025, 0.975])
        return float(high - low) / (2 * _NORMAL_95)

    def _gradient(self, quantity: Combination) -> Array:
        """∂ ln q/∂ coordinates at the draw in the middle, shape (p,); of q itself for a coordinate."""
        if quantity.single:
            return np.eye(len(self.names))[self.names.index(quantity.name)]
        step = _STEP * np.eye(len(self.names))
        ends = np.concatenate([self._middle + step, self._middle - step])
        up, down = np.split(np.log(np.abs(quantity.of(self._parametrisation.values(ends)))), 2)
        return (up - down) / (2 * _STEP)

    def _share(self, quantity: Combination, axes: Array) -> float:
        """Length of the gradient across those already named; 0 where almost nothing of it is left."""
        gradient = self._gradient(quantity)
        left = float(np.linalg.norm(_orthogonal_part(gradient, axes)))
        return left if left >= _NEW * np.linalg.norm(gradient) else 0.0

    def _powers(self, axes: Array) -> list[Combination]:
        """The product of powers that varies least over the draws, across what is named."""
        count = len(self.names)
        basis = np.linalg.svd(np.vstack([axes, np.zeros((1, count))]))[2][len(axes) :]
        weights = np.linalg.eigh(np.atleast_2d(np.cov(basis @ self._theta.T)))[1][:, 0] @ basis
        scaled = weights / np.abs(weights).max()
        exact, rounded = float((self._theta @ scaled).std()), scaled
        for decimals in (1, 2, 3):
            rounded = np.round(scaled, decimals)
            if float((self._theta @ rounded).std()) <= _ROUNDING_COST * exact:
                break
        rounded = rounded * (1.0 if rounded.sum() >= 0 else -1.0)
        each, axes_of = [quantity.of for quantity in self.singles], self._parametrisation.axes
        kept = [i for i in range(count) if rounded[i]]

        def product(k: Array) -> Array:
            columns = [np.log(np.abs(each[i](k))) if axes_of[i].logarithmic else each[i](k) for i in kept]
            return np.asarray(np.exp(np.stack(columns, axis=-1) @ rounded[kept]))

        return [Combination(powers_text(self.names, rounded.tolist(), self._linear), product, False, _ODD_POWERS)]

    def _moving_with(self, quantity: Combination) -> str:
        """How the other coordinates move with one that is not known."""
        main, coordinates = self.names.index(quantity.name), self._parametrisation.axes
        parts = []
        for i, coordinate in enumerate(coordinates):
            x, y = self._theta[:, main], self._theta[:, i]
            if i == main or not x.std() or not y.std() or abs(np.corrcoef(x, y)[0, 1]) < _MOVES_WITH:
                continue
            slope, name, other = float(np.cov(x, y)[0, 1] / x.var(ddof=1)), coordinate.name, coordinates[main].name
            if not coordinate.logarithmic:
                parts.append(f"{name} moves with it, {slope * math.log(2):+.2g} as {other} doubles")
            elif not coordinates[main].logarithmic:
                parts.append(f"{name} moves with it, times {math.exp(0.1 * slope):.3g} as {other} grows by 0.1")
            else:
                power = f"{slope:.2g}".replace("-", "−")
                parts.append(f"{name} moves with it: {name} ∝ {other}{'' if power == '1' else f'^{power}'}")
        return f" ({'; '.join(parts)})" if parts else ""


def _orthogonal_part(gradient: Array, axes: Array) -> Array:
    """What is left of a gradient, shape (p,), without its parts along orthonormal axes, shape (m, p)."""
    return gradient - axes.T @ (axes @ gradient)
