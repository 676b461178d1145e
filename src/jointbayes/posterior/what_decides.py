"""Which uncertain input matters most: each alone, the others exactly known.

Where the best fit goes with an input off by its uncertainty is found again. How wide an interval becomes is of first
order: to the draws' interval with all exact is added, in quadrature of logarithms, what the joint Gaussian at the best
fit says the input adds. `tests/posterior/test_what_decides.py` compares both with draws.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from jointbayes.errors import JointBayesError
from jointbayes.inference import Nuisance, Problem
from jointbayes.inference.climb import PosteriorSquares, climb_all
from jointbayes.posterior.coordinates import by_names
from jointbayes.posterior.first_look import fisher_information
from jointbayes.posterior.identifiability import CERTAINTY, Identifiability, listed, ratio_of
from jointbayes.rounding import number, quantity_text, with_interval
from vibrecords.arrays import Array

Flags = NDArray[np.bool_]
_STEPS = 60  # of a climb
_HALF_WIDTH = 1.96  # of a 95 % interval, in standard deviations
_FALSE_ALARM = 0.01  # that a fit as good as the noise is called none
_PERCENT = 0.5  # standard deviation of a logarithm up to which it is told in per cent
_UNCHANGED = 0.1  # share by which a wider interval is as wide
_MOST_TOLD = 4  # inputs in a sentence
_AT_END = 1e-3  # prior standard deviations: so near to an end of its range a coordinate is at the end


@dataclass(frozen=True, slots=True)
class InputAlone:
    """What one input does, the others exactly known.

    Parameters
    ----------
    name
        Such as ``"youngs_modulus"``.
    off
        Its uncertainty in words, one standard deviation: ``("2 % lower", "2 % higher")``.
    interval95
        Of each stiffness that is known with all exact, with this one uncertain: to first order, in its unit.
    best
        Each stiffness at the best fit with the input so much lower and higher than stated; NaN where the fit ends at an
        end of the prior's range.
    fits
        Whether the data are then fitted within their noise, or as well as with all exact.
    """

    name: str
    off: tuple[str, str]
    interval95: Mapping[str, tuple[float, float]]
    best: Mapping[str, tuple[float, float]]
    fits: tuple[bool, bool]


@dataclass(frozen=True, slots=True)
class WhatDecides:
    """Inputs, that which widens an interval most first, and what is known with all exact and with all uncertain.

    Parameters
    ----------
    inputs
        Each alone.
    exact
        What is known of each stiffness that is known with all exact, the best known first.
    together
        The same stiffnesses with all uncertain; empty where that is not known.
    best
        Their best fit with all exact.
    """

    inputs: tuple[InputAlone, ...]
    exact: Mapping[str, Identifiability]
    together: Mapping[str, Identifiability]
    best: Mapping[str, float]

    @property
    def quantity(self) -> str:
        """The stiffness that sentences are about, the best known."""
        return next(iter(self.exact))

    def widening(self, of: InputAlone) -> float:
        """How many times wider its interval becomes at most, in ratios of ends."""
        return max(ratio_of(ends) / ratio_of(self.exact[name].ends[0]) for name, ends in of.interval95.items())

    @property
    def sentence(self) -> str:
        """Which input matters most, and which do not."""
        first, unchanged = self.inputs[0], [i.name for i in self.inputs if self.widening(i) < 1 + _UNCHANGED]
        if first.name in unchanged:
            return f"None of {listed(unchanged)} alone makes an interval more than {100 * _UNCHANGED:g} % wider."
        name = max(first.interval95, key=lambda k: ratio_of(first.interval95[k]) / ratio_of(self.exact[k].ends[0]))
        each = [
            f"{listed((i.name,))} {with_interval(i.interval95[name], self.exact[name].unit)}"
            for i in self.inputs
            if i.name not in unchanged
        ]
        none = f" {listed(unchanged).capitalize()} hardly matters." if unchanged else ""
        return (
            f"**{listed((first.name,)).capitalize()} matters most.** With all exact {name} is "
            f"{with_interval(self.exact[name].ends[0], self.exact[name].unit)}, with one alone uncertain: "
            f"{', '.join(each)}.{none}"
        )

    @property
    def if_off(self) -> str:
        """Where the best fit of the best known stiffness goes with each input off by its uncertainty."""
        name, best = self.quantity, self.best[self.quantity]
        told = [each for each in self.inputs if any(each.fits)]
        moved = (f"{listed((each.name,))} {self._moved(each, 0)}, {self._moved(each, 1)}" for each in told[:_MOST_TOLD])
        sentences = []
        if told:
            start = self.value(name, best)
            sentences.append(f"If an input is off, the best fit of {name} goes from {start} to: {'; '.join(moved)}.")
        if wrong := [f"{listed((i.name,))} off by {i.off[1].rpartition(' ')[0]}" for i in self.inputs if i not in told]:
            sentences.append(f"With {' or '.join(wrong)} no joint fits the data.")
        return " ".join(sentences)

    def _moved(self, of: InputAlone, side: int) -> str:
        """What becomes of the best known stiffness on one side."""
        value, best = of.best[self.quantity][side], self.best[self.quantity]
        if not of.fits[side]:
            return f"{of.off[side]}: no joint fits"
        if math.isnan(value):
            return f"{of.off[side]}: an end of its prior's range"
        change = value / best
        by = f"{100 * (change - 1):+.2g} %" if 0.5 < change < 2 else f"× {number(change, 2)}"
        return f"{of.off[side]}: {self.value(self.quantity, value)} ({by})"

    def value(self, name: str, value: float) -> str:
        """A stiffness with its unit."""
        return quantity_text(value, self.exact[name].unit)

    def as_json(self) -> dict[str, Any]:
        """What ``identifiability.what_decides`` of ``summary.json`` holds."""
        return {
            "sentence": self.sentence.replace("*", ""),
            "if_off": self.if_off,
            "best_fit": dict(self.best),
            "inputs": [asdict(each) for each in self.inputs],
        }


def what_decides(
    problem: Problem,
    inputs: Sequence[str],
    names: Sequence[str],
    theta: Array,
    exact: Mapping[str, Identifiability],
    together: Mapping[str, Identifiability],
) -> WhatDecides | None:
    """Look at each input alone; None where no stiffness is known with all exact, or it cannot be computed.

    Parameters
    ----------
    problem
        With all inputs uncertain.
    inputs
        Their names.
    names, theta
        Coordinates of the run, and its best fit, shape (d,).
    exact, together
        What draws say of the stiffnesses with all inputs exact, and with all uncertain.
    """
    known = sorted((n for n, k in exact.items() if k.verdict in CERTAINTY), key=lambda n: ratio_of(exact[n].ends[0]))
    if not known:
        return None
    place = [problem.names.index(name) for name in inputs]
    start = by_names(theta[None], names, problem.names)[0]
    start[place] = 0.0
    try:
        ends, fits, at_end = _fits_if_off(problem, place, start)
        information = fisher_information(problem, ends[0])
        joint = information.parametrisation.names
        sd = information.stiffness_sd(joint)
        alone = {name: information.stiffness_sd((*joint, name)) for name in inputs}
    except (JointBayesError, np.linalg.LinAlgError):
        return None
    if at_end[0]:
        return None
    values = problem.prior.values(ends)
    nuisance = {each.name: each for each in problem.prior.nuisances}
    best_at = np.where(at_end[:, None], np.nan, values)
    column = {quantity.name: i for i, quantity in enumerate(problem.quantities)}
    rows = []
    for i, name in enumerate(inputs):
        lower, higher = 1 + 2 * i, 2 + 2 * i
        at = {k: (float(best_at[lower, column[k]]), float(best_at[higher, column[k]])) for k in known}
        wide = {k: _widened(exact[k], alone[name][k] ** 2 - sd[k] ** 2) for k in known}
        rows.append(InputAlone(name, _off(nuisance[name]), wide, at, (bool(fits[lower]), bool(fits[higher]))))
    found = WhatDecides(
        tuple(rows), {k: exact[k] for k in known}, {k: together[k] for k in known if k in together},
        {k: float(values[0, column[k]]) for k in known},
    )  # fmt: skip
    return WhatDecides(tuple(sorted(rows, key=found.widening, reverse=True)), found.exact, found.together, found.best)


def _fits_if_off(problem: Problem, place: Sequence[int], start: Array) -> tuple[Array, Flags, Flags]:
    """Best fits with all inputs exact, then with each one standard deviation lower and higher, shape (1 + 2 i, d).

    With them, shape (1 + 2 i,) each: whether the data are fitted, and whether the joint is at an end of its range.
    """
    columns = np.arange(len(problem.parametrisation.names))
    starts = np.repeat(start[None], 1 + 2 * len(place), axis=0)
    for i, at in enumerate(place):
        starts[[1 + 2 * i, 2 + 2 * i], at] = problem.prior.sd[at] * np.array([-1.0, 1.0])
    squares = PosteriorSquares(problem.log_posterior, columns=columns)
    ends, _ = climb_all(squares, starts, _STEPS)
    residuals = squares.residuals(ends)
    misfit = (residuals**2).sum(axis=1)
    fits = misfit <= max(chdtri(residuals.shape[1], _FALSE_ALARM), misfit[0] * (1 + _FALSE_ALARM))
    low, high = problem.prior.support
    near = _AT_END * problem.prior.sd[columns]
    at_end = (ends[:, columns] < low[columns] + near) | (ends[:, columns] > high[columns] - near)
    return ends, np.asarray(fits), np.asarray(at_end.any(axis=1))


def _widened(known: Identifiability, variance: float) -> tuple[float, float]:
    """Ends of an interval with so much more variance of the logarithm."""
    (low, high), middle = known.ends[0], known.median
    if not math.isfinite(variance):
        return (0.0, math.inf) if middle > 0 else (-math.inf, 0.0)
    more = _HALF_WIDTH * math.sqrt(max(variance, 0.0))
    down, up = (math.exp(math.hypot(math.log(end / middle), more)) for end in (low, high))
    return middle / down, middle * up


def _off(nuisance: Nuisance) -> tuple[str, str]:
    """One standard deviation of an input in words, lower and higher."""
    sd = nuisance.prior.sd
    if nuisance.additive:
        by = f"{number(float(nuisance.value(sd)), 2)} {nuisance.unit}"
    elif sd <= _PERCENT:
        by = f"{number(100 * sd, 2)} %"
    else:
        return f"{number(math.exp(sd), 2)} times lower", f"{number(math.exp(sd), 2)} times higher"
    return f"{by} lower", f"{by} higher"
