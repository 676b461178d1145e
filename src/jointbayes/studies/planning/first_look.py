"""A first look at further measurements: what Fisher information, linearised about draws of the posterior, says of each.

Measurements that are independent given the parameters add their Fisher information, so that a set of candidates is a
sum of matrices. This is exact for a Gaussian posterior about a known point, costs milliseconds, and is not what a plan
recommends by: it chooses which of many candidates are worth simulating (`jointbayes.studies.planning.simulation`).

References
----------
Chaloner, K., Verdinelli, I. (1995). Bayesian experimental design: a review. Statistical Science 10(3), 273-304.
DOI 10.1214/ss/1177009939
Papadimitriou, C. (2004). Optimal sensor placement methodology for parametric identification of structural systems.
Journal of Sound and Vibration 278, 923-947. DOI 10.1016/j.jsv.2003.10.063 (sequential choice of a set)
"""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.inference import Problem
from jointbayes.posterior.information.fisher import FisherInformation, fisher_information
from jointbayes.studies.planning.candidates import Candidate
from jointbayes.studies.planning.own_quantities import WithOwn, own_of

Names = tuple[str, ...]

#: Sets are chosen among all there are up to this number, beyond it one by one.
MOST_SETS = 5000
#: A linearised figure may be off by this factor either way when it decides what is not simulated.
MARGIN = 2.0


def measurement_information(candidate: Candidate, problem: Problem, theta: ArrayLike) -> Array:
    """Fisher information of a further measurement about θ, shape (d, d), where θ, shape (d,), is the truth.

    JᵀJ of the standardised residuals, for the noise that the candidate's law makes of the model's FRFs there.
    """
    point = np.asarray(theta, dtype=float)
    return fisher_information(candidate.problem(problem, point), point).data


def sd_of(fisher: FisherInformation, quantity: str) -> float:
    """Standard deviation of ln of a stiffness, nuisances marginalised; at most the prior's where it has one of its own.

    Raises
    ------
    ModelError
        If the joint's coordinates do not move that stiffness.
    """
    spread = fisher.stiffness_sd()
    if quantity not in spread:
        raise ModelError(f"planning: found parameter {quantity!r}; expected one of {', '.join(spread)}")
    limit = math.inf
    if quantity in fisher.joint_names:
        limit = float(fisher.prior_sd[fisher.names.index(quantity)])
    return min(spread[quantity], limit)


@dataclass(frozen=True, slots=True, eq=False)
class Linearised:
    """Linearised standard deviation of ln of the wanted stiffness after a set of measurements.

    Parameters
    ----------
    names
        Names of the candidates.
    sds
        One for each draw about which it was linearised, shape (draws,).
    """

    names: Names
    sds: Array

    @property
    def median(self) -> float:
        """Median over the draws."""
        return float(np.median(self.sds))

    @property
    def ends(self) -> tuple[float, float]:
        """The least and the greatest."""
        return float(self.sds.min()), float(self.sds.max())


class FirstLook:
    """Linearised figures of all candidates and of sets of them, about the same draws.

    Parameters
    ----------
    problem
        The problem in hand.
    candidates
        By name.
    quantity
        The wanted stiffness.
    draws
        Draws of the present posterior, shape (n, d).
    """

    def __init__(self, problem: Problem, candidates: Mapping[str, Candidate], quantity: str, draws: Array) -> None:
        self._quantity = quantity
        whole = WithOwn(problem, own_of(candidates.values()))
        points = whole.middle(draws)
        self._present = [whole.fisher(theta) for theta in points]
        self._added = {
            name: [measurement_information(one, whole.problem, theta) for theta in points]
            for name, one in candidates.items()
        }

    def at(self, names: Names) -> Linearised:
        """Figures of one set."""
        return Linearised(names, np.array([
            sd_of(replace(now, data=now.data + sum(self._added[name][i] for name in names)), self._quantity)
            for i, now in enumerate(self._present)
        ]))  # fmt: skip


def sets_of(names: Sequence[str], size: int, loss: Callable[[Names], float]) -> Iterable[Names]:
    """Sets of so many names: all there are up to 5000, beyond that the one found by adding the best one at a time.

    Raises
    ------
    ModelError
        If none is to be chosen, or there are none to choose from.
    """
    if size < 1 or not names:
        raise ModelError(f"planning: found {size} of {len(names)} candidates to choose; expected at least one")
    size = min(size, len(names))
    if math.comb(len(names), size) <= MOST_SETS:
        return tuple(itertools.combinations(names, size))
    chosen: Names = ()
    for _ in range(size):
        chosen = min(((*chosen, name) for name in names if name not in chosen), key=loss)
    return (chosen,)


def worth_simulating(looks: Sequence[Linearised], most: int) -> tuple[Linearised, ...]:
    """Those that could come first: all if there are no more than `most`, else by their linearised range.

    One could come first if the least of its linearised figures, halved, is no more than twice the greatest of that
    with the least median. Ordered by their median.
    """
    ordered = sorted(looks, key=lambda one: one.median)
    if len(ordered) <= most:
        return tuple(ordered)
    limit = ordered[0].ends[1] * MARGIN
    return tuple(one for one in ordered if one.ends[0] / MARGIN <= limit)
