"""Independent priors cut off where K^J is not positive definite: the probability left, and draws by their quantiles.

With log stiffnesses the cut is 2 ln k12 < ln k11 + ln k22, with the signed coupling |ρ| < 1; without a coupling there
is none. All works on midpoints of the marginals' probability, so that it is the same in every run.
"""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import ModelError
from jointbayes.inference.marginals import Marginal

__all__ = ["cut_quantiles", "log_probability_inside"]

Array = NDArray[np.float64]

_CELLS = 1000  # of probability, in each of k11 and k22
_GRAIN = 2.0**-30


def log_probability_inside(names: tuple[str, ...], marginals: tuple[Marginal, ...]) -> float:
    """ln of the probability that independent draws give a positive definite joint; 0 where all do.

    It is rounded to a multiple of 2⁻³⁰: subtracting it from log densities, whose last digits are larger, then shifts
    them without rounding them anew, and no draw depends on it.

    Parameters
    ----------
    names
        Of the joint's coordinates.
    marginals
        One prior for each.

    Returns
    -------
    float
        Within 1e-3.

    Raises
    ------
    ModelError
        If the marginals leave no joint, or so few that a million places show none.
    """
    value = _log_probability(names, marginals)
    if value == -math.inf:
        raise ModelError(
            "prior: found no positive definite joint that it allows; expected marginals that overlap with "
            "k12² <= k11·k22; lower the prior of k12 or raise those of k11 and k22"
        )
    return round(value / _GRAIN) * _GRAIN


def cut_quantiles(names: tuple[str, ...], marginals: tuple[Marginal, ...], u: Array) -> Array:
    """Coordinates, shape (n, j), of points u of the unit cube, shape (n, j): uniform u give draws of the cut priors.

    Independent marginals give their quantiles. Of the others the coupling comes last, within what the stiffnesses
    leave it; these follow their distributions under the cut, interpolated between 1000 quantiles.

    References
    ----------
    Rosenblatt, M. (1952). Remarks on a multivariate transformation. Annals of Mathematical Statistics 23(3), 470-472.
    DOI 10.1214/aoms/1177729394
    """
    if "rho" in names:
        index = names.index("rho")
        low, high = marginals[index].cdf(np.array([-1.0, 1.0]))
        u = u.copy()
        u[:, index] = low + u[:, index] * (high - low)
        return _quantiles(marginals, u)
    if "k12" not in names:
        return _quantiles(marginals, u)
    first, coupling, last = (marginals[names.index(name)] for name in ("k11", "k12", "k22"))
    columns = [names.index(name) for name in ("k11", "k12", "k22")]
    edges = np.arange(_CELLS + 1) / _CELLS
    middle = _middles(last)
    k11 = first.ppf(np.interp(u[:, columns[0]], _first_steps(first, coupling, last), edges))
    room = coupling.cdf((k11[:, None] + middle) / 2)
    steps = np.concatenate([np.zeros((len(u), 1)), np.cumsum(room, axis=1)], axis=1)
    asked = u[:, columns[2]] * steps[:, -1]
    share = np.array([np.interp(a, s, edges) for a, s in zip(asked, steps, strict=True)])
    k22 = last.ppf(share)
    k12 = coupling.ppf(u[:, columns[1]] * coupling.cdf((k11 + k22) / 2))
    out = np.empty((len(u), 3))
    out[:, columns] = np.stack([k11, k12, k22], axis=-1)
    return out


@lru_cache(maxsize=64)
def _log_probability(names: tuple[str, ...], marginals: tuple[Marginal, ...]) -> float:
    if "rho" in names:
        low, high = marginals[names.index("rho")].cdf(np.array([-1.0, 1.0]))
        return math.log(high - low) if high > low else -math.inf
    if "k12" not in names:
        return 0.0
    first, coupling, last = (marginals[names.index(name)] for name in ("k11", "k12", "k22"))
    probability = float(_room(first, coupling, last).mean())
    return math.log(probability) if probability > 0 else -math.inf


@lru_cache(maxsize=8)
def _first_steps(first: Marginal, coupling: Marginal, last: Marginal) -> Array:
    """Distribution of the first stiffness under the cut at the edges of its cells, shape (cells + 1,)."""
    steps = np.concatenate([[0.0], np.cumsum(_room(first, coupling, last).mean(axis=1))])
    steps /= steps[-1]
    steps.setflags(write=False)
    return steps


def _room(first: Marginal, coupling: Marginal, last: Marginal) -> Array:
    """Probability of a coupling below √(k11 k22) at the middles of all cells, shape (cells, cells)."""
    return coupling.cdf((_middles(first)[:, None] + _middles(last)) / 2)


def _middles(marginal: Marginal) -> Array:
    return marginal.ppf((np.arange(_CELLS) + 0.5) / _CELLS)


def _quantiles(marginals: tuple[Marginal, ...], u: Array) -> Array:
    if not marginals:
        return np.empty((len(u), 0))
    return np.stack([m.ppf(u[:, i]) for i, m in enumerate(marginals)], axis=-1)
