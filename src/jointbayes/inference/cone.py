"""Independent priors cut off where K^J is not positive definite: the probability left, and draws by their quantiles.

A parametrisation says where: by bounds of a coordinate, |ρ| < 1, or by cones, 2 ln k12 < ln k11 + ln k22. All works on
midpoints of the marginals' probability, so that it is the same in every run.
"""

import math
from functools import lru_cache

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.inference.marginals import Marginal
from jointbayes.joint import Parametrisation

_CELLS = 1000  # of probability, in each of the two stiffnesses beside the coupling
_GRAIN = 2.0**-30
#: What is to be done about priors that contradict each other.
NO_JOINT = (
    "expected marginals that overlap with positive definite joints, k12² <= k11·k22; lower the prior of the coupling "
    "or raise those of the other stiffnesses"
)


def log_probability_inside(parametrisation: Parametrisation, marginals: tuple[Marginal, ...]) -> float:
    """ln of the probability that independent draws give a positive definite joint; 0 where all do.

    It is rounded to a multiple of 2⁻³⁰: subtracting it from log densities, whose last digits are larger, then shifts
    them without rounding them anew, and no draw depends on it.

    Parameters
    ----------
    parametrisation
        Of the joint.
    marginals
        One prior for each of its coordinates.

    Returns
    -------
    float
        Within 1e-3.

    Raises
    ------
    ModelError
        If the marginals leave no joint, or so few that a million places show none.
    """
    value = _log_probability(parametrisation, marginals)
    if value == -math.inf:
        raise ModelError(f"prior: found no positive definite joint that it allows; {NO_JOINT}")
    return round(value / _GRAIN) * _GRAIN


def cut_quantiles(parametrisation: Parametrisation, marginals: tuple[Marginal, ...], u: Array) -> Array:
    """Coordinates, shape (n, j), of points u of the unit cube, shape (n, j): uniform u give draws of the cut priors.

    Independent marginals give their quantiles, those of a bounded coordinate within its bounds. In a cone the coupling
    comes last, within what the stiffnesses leave it; these follow their distributions under the cut, interpolated
    between 1000 quantiles.

    References
    ----------
    Rosenblatt, M. (1952). Remarks on a multivariate transformation. Annals of Mathematical Statistics 23(3), 470-472.
    DOI 10.1214/aoms/1177729394
    """
    out = np.empty(u.shape)
    for i, (axis, marginal) in enumerate(zip(parametrisation.axes, marginals, strict=True)):
        low, high = marginal.cdf(np.array(axis.bounds)) if axis.bounded else (0.0, 1.0)
        out[:, i] = marginal.ppf(low + u[:, i] * (high - low))
    for cone in parametrisation.cones:
        columns = [cone.first, cone.coupling, cone.last]
        first, coupling, last = (marginals[column] for column in columns)
        edges = np.arange(_CELLS + 1) / _CELLS
        middle = _middles(last)
        one = first.ppf(np.interp(u[:, cone.first], _first_steps(first, coupling, last), edges))
        room = coupling.cdf((one[:, None] + middle) / 2)
        steps = np.concatenate([np.zeros((len(u), 1)), np.cumsum(room, axis=1)], axis=1)
        asked = u[:, cone.last] * steps[:, -1]
        share = np.array([np.interp(a, s, edges) for a, s in zip(asked, steps, strict=True)])
        other = last.ppf(share)
        between = coupling.ppf(u[:, cone.coupling] * coupling.cdf((one + other) / 2))
        out[:, columns] = np.stack([one, between, other], axis=-1)
    return out


@lru_cache(maxsize=64)
def _log_probability(parametrisation: Parametrisation, marginals: tuple[Marginal, ...]) -> float:
    probability = 1.0
    for axis, marginal in zip(parametrisation.axes, marginals, strict=True):
        if axis.bounded:
            low, high = marginal.cdf(np.array(axis.bounds))
            probability *= max(float(high - low), 0.0)
    for cone in parametrisation.cones:
        probability *= float(_room(marginals[cone.first], marginals[cone.coupling], marginals[cone.last]).mean())
    return math.log(probability) if probability > 0 else -math.inf


@lru_cache(maxsize=8)
def _first_steps(first: Marginal, coupling: Marginal, last: Marginal) -> Array:
    """Distribution of the first stiffness under the cut at the edges of its cells, shape (cells + 1,)."""
    steps = np.concatenate([[0.0], np.cumsum(_room(first, coupling, last).mean(axis=1))])
    steps /= steps[-1]
    steps.setflags(write=False)
    return steps


def _room(first: Marginal, coupling: Marginal, last: Marginal) -> Array:
    """Probability of a coupling inside the cone at the middles of all cells, shape (cells, cells)."""
    return coupling.cdf((_middles(first)[:, None] + _middles(last)) / 2)


def _middles(marginal: Marginal) -> Array:
    return marginal.ppf((np.arange(_CELLS) + 0.5) / _CELLS)
