"""Outliers among estimates that are themselves uncertain: centre and scatter of all joints, and which differ by more.

Each joint has an estimate and its own standard deviation; what is asked is whether the joint differs from the others by
more than both allow. Centre and scatter are medians, which a few odd joints do not move.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from jointbayes.studies.campaign.hierarchical import weighted_quantiles
from vibrecords.arrays import Array

#: Joints below which scatter by medians says too little to call one of them an outlier.
FEWEST = 8
#: Probability of one or more outliers, over all stiffnesses, in a campaign of joints of one normal population.
FALSE_ALARM = 0.05

_MEDIAN_OF_NORMAL = 0.6744897501960817  # of |z|
_BISECTIONS = 50
_ROUNDS = 5
_CAMPAIGNS = 2000  # simulated
_AT_ONCE = 2_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Centre and scatter of one quantity over joints.

    Parameters
    ----------
    value, sd
        Estimate of each joint and its standard deviation, shape (joints,).
    centre
        Weighted median of all.
    scatter
        Of all joints about the centre, without what the estimates' own errors add.
    """

    value: Array
    sd: Array
    centre: float
    scatter: float

    @property
    def score(self) -> Array:
        """Distance of each joint from the centre in standard deviations of scatter and error together, (joints,)."""
        return np.asarray((self.value - self.centre) / np.hypot(self.scatter, self.sd))


@dataclass(frozen=True, slots=True, eq=False)
class ComparedQuantity:
    """One stiffness of every joint, or the coordinate that stands for one of either sign; joints in their order.

    Intervals have rows of 2.5, 50 and 97.5 %, shape (joints, 3), in `unit`.

    Parameters
    ----------
    name, label, unit
        Of the stiffness or coordinate; the label is that of an axis.
    logarithmic
        Whether spread and scores are those of the logarithm.
    unpooled
        Median and interval of each joint by itself.
    shrunken
        Median and interval of each joint given all the others.
    rank
        Rank of each joint among all, 1 the lowest: median and 95 % interval, shape (joints, 3).
    spread
        Over the joints, of the logarithm where `logarithmic`.
    outlier_limit
        Score beyond which a joint is an outlier; infinite where there are too few joints.
    """

    name: str
    label: str
    unit: str
    logarithmic: bool
    unpooled: Array
    shrunken: Array
    rank: Array
    spread: Spread
    outlier_limit: float

    @property
    def in_unit(self) -> str:
        """The unit behind a name, in brackets; empty where there is none."""
        return "" if self.unit == "1" else f" ({self.unit})"

    @property
    def outlier(self) -> NDArray[np.bool_]:
        """Whether a joint is an outlier, shape (joints,)."""
        return np.asarray(np.abs(self.spread.score) > self.outlier_limit)

    def value_in_unit(self, value: Array) -> Array:
        """What the spread calls a value, in `unit`."""
        return np.asarray(np.exp(value)) if self.logarithmic else value


def spread_of(value: Array, sd: Array) -> Spread:
    """Centre and scatter of estimates.

    Parameters
    ----------
    value, sd
        Estimate of each joint and its standard deviation, shape (joints,), the latter above zero.
    """
    scatter = 0.0
    for _ in range(_ROUNDS):
        weight = 1 / np.hypot(scatter, sd)
        centre = float(weighted_quantiles(value[None], weight[None] / weight.sum(), (0.5,))[0, 0])
        scatter = _scatter(np.abs(value - centre), sd)
    return Spread(value, sd, centre, scatter)


def _scatter(distance: Array, sd: Array) -> float:
    """τ, 0 or more, for which distance/√(τ² + sd²) has the median of a normal distribution."""

    def median(tau: float) -> float:
        return float(np.median(distance / np.hypot(tau, sd)))

    if median(0.0) <= _MEDIAN_OF_NORMAL:
        return 0.0
    low, high = 0.0, float(distance.max()) / _MEDIAN_OF_NORMAL
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if median(middle) > _MEDIAN_OF_NORMAL else (low, middle)
    return high


@lru_cache(maxsize=16)
def outlier_limit(joints: int, quantities: int) -> float:
    """Score beyond which a joint is an outlier, so that `FALSE_ALARM` of campaigns have any by chance.

    From simulated campaigns of joints of one normal population, each with centre and scatter by medians as here: with
    few joints these are uncertain, and the limit is wider than that of known ones.

    Parameters
    ----------
    joints
        In the campaign, at least 2.
    quantities
        That are looked at, taken as independent.
    """
    rng = np.random.default_rng([joints, 11])
    largest = []
    step = max(1, _AT_ONCE // joints)
    for first in range(0, _CAMPAIGNS, step):
        z = rng.normal(size=(min(step, _CAMPAIGNS - first), joints))
        z = np.abs(z - np.median(z, axis=1, keepdims=True))
        largest.append(z.max(axis=1) * _MEDIAN_OF_NORMAL / np.median(z, axis=1))
    each: float = (1 - FALSE_ALARM) ** (1 / quantities)
    return float(np.quantile(np.concatenate(largest), each))
