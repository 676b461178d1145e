"""What simulations of a further measurement left."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointbayes.posterior.identifiability import Verdict
from vibrecords.arrays import Array

Method = Literal["reweighting", "importance sampling"]

#: A candidate of which more than this share of the simulated posteriors was not found is not ranked.
MOST_LOST = 0.15
#: Probability of a forecast's range.
RANGE = 0.8


@dataclass(frozen=True, slots=True)
class SimulatedPosterior:
    """What one simulated measurement leaves.

    Parameters
    ----------
    sd
        Posterior standard deviation of ln |k| of the wanted stiffness.
    verdict
        On that stiffness, by the rule of `jointbayes.posterior.identifiability.assess`.
    effective
        Effective number of draws behind both.
    method
        How they were found.
    """

    sd: float
    verdict: Verdict
    effective: float
    method: Method


@dataclass(frozen=True, slots=True)
class Simulation:
    """What simulated measurements say of one set of candidates.

    Parameters
    ----------
    posteriors
        One for each truth, in the order of the truths; None where it was not found.
    """

    posteriors: tuple[SimulatedPosterior | None, ...]

    @property
    def found(self) -> tuple[SimulatedPosterior, ...]:
        """Those that were found."""
        return tuple(posterior for posterior in self.posteriors if posterior is not None)

    @property
    def sds(self) -> Array:
        """Standard deviation of ln |k| by truth, shape (truths,); NaN where the posterior was not found."""
        return np.array([math.nan if posterior is None else posterior.sd for posterior in self.posteriors])

    @property
    def lost(self) -> int:
        """Simulated measurements whose posterior was not found."""
        return len(self.posteriors) - len(self.found)

    @property
    def valid(self) -> bool:
        """Whether nearly all simulated posteriors were found: the lost ones need not be like the others."""
        return len(self.found) >= 2 and self.lost <= MOST_LOST * len(self.posteriors)

    @property
    def median(self) -> float:
        """Median of the standard deviations found."""
        return float(np.median([posterior.sd for posterior in self.found])) if self.found else math.nan

    @property
    def range80(self) -> tuple[float, float]:
        """10th and 90th percentile of the standard deviations found, see `predictive_range`."""
        return predictive_range([posterior.sd for posterior in self.found])

    @property
    def verdict(self) -> Verdict:
        """The most frequent verdict; of equally frequent ones that of the wider posterior."""
        counts = Counter(posterior.verdict for posterior in sorted(self.found, key=lambda posterior: -posterior.sd))
        return counts.most_common(1)[0][0]

    @property
    def agreeing(self) -> int:
        """How many simulated posteriors have the most frequent verdict."""
        return sum(posterior.verdict == self.verdict for posterior in self.found)

    @property
    def reweighted(self) -> int:
        """How many posteriors were found by reweighting draws of the present one."""
        return sum(posterior.method == "reweighting" for posterior in self.found)


def predictive_range(values: Sequence[float]) -> tuple[float, float]:
    """10th and 90th percentile such that a further value lies between them with a probability of 80 %.

    With n values the p-quantile is at place p(n + 1) among them: exact for any continuous distribution from n = 9 on,
    where it is from the least to the greatest; the usual place 1 + p(n − 1) would hold only 64 % there.

    References
    ----------
    Hyndman, R. J., Fan, Y. (1996). Sample quantiles in statistical packages. The American Statistician 50(4), 361-365.
    DOI 10.2307/2684934 (definition 6)

    Examples
    --------
    >>> low, high = predictive_range([float(i) for i in range(1, 20)])
    >>> round(low, 9), round(high, 9)
    (2.0, 18.0)
    """
    if not len(values):
        return math.nan, math.nan
    tail = (1 - RANGE) / 2
    low, high = np.quantile(values, [tail, 1 - tail], method="weibull")
    return float(low), float(high)
