"""Importance weights: how many draws they leave, and how far they may be powered down."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["drawn_without_replacement", "importance_efficiency", "resampled", "tempered", "truncated"]

Array = NDArray[np.float64]


def importance_efficiency(log_weight: Array) -> float:
    """Effective fraction of importance samples, (Σw)² / (n Σw²); 0 if all weights are.

    Parameters
    ----------
    log_weight : ndarray, shape (n,)
        ln of the weights up to a constant; −inf for a weight of zero.

    References
    ----------
    A. Kong, J. S. Liu, W. H. Wong, Sequential imputations and Bayesian missing data problems (1994),
    DOI 10.1080/01621459.1994.10476469.

    Examples
    --------
    >>> importance_efficiency(np.array([0.0, 0.0, -np.inf, -np.inf]))
    0.5
    """
    top = float(log_weight.max())
    if top == -np.inf:
        return 0.0
    weight = np.exp(log_weight - top)
    return float(weight.sum() ** 2 / (weight.size * (weight**2).sum()))


def tempered(log_weight: Array, enough: float) -> Array:
    """Normalised weights, shape (n,), to the largest power that leaves enough effective draws.

    While few draws carry all the weight, a power below 1 lets a fit to them still span the space.

    Parameters
    ----------
    log_weight : ndarray, shape (n,)
        ln of the weights up to a constant, finite.
    enough : float
        Effective number of draws that must be left.

    References
    ----------
    E. Koblents, J. Míguez, A population Monte Carlo scheme with transformed weights (2015),
    DOI 10.1007/s11222-013-9440-2.
    """
    powers = 0.5 ** np.arange(12)
    power = next((p for p in powers if log_weight.size * importance_efficiency(p * log_weight) >= enough), 0.0)
    weight: Array = np.exp(power * (log_weight - log_weight.max()))
    weight /= weight.sum()
    return weight


def resampled(weight: Array, n: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Indices, shape (n,), each drawn as often as its weight asks, to within one: systematic resampling.

    Parameters
    ----------
    weight : ndarray, shape (m,)
        Normalised weights.
    n : int
        Number of indices.
    rng : numpy.random.Generator
        Source of the one random number.

    References
    ----------
    J. Carpenter, P. Clifford, P. Fearnhead, Improved particle filter for nonlinear problems (1999),
    DOI 10.1049/ip-rsn:19990255.

    Examples
    --------
    >>> resampled(np.array([0.5, 0.0, 0.5]), 4, np.random.default_rng(1)).tolist()
    [0, 0, 2, 2]
    """
    steps = np.cumsum(weight)
    found: NDArray[np.intp] = np.searchsorted(steps / steps[-1], (np.arange(n) + rng.random()) / n)
    return found


def truncated(log_weight: Array, n: int) -> Array:
    """ln of importance weights cut off at √n times their mean over n draws, shape (m,): one far out counts for less.

    Parameters
    ----------
    log_weight : ndarray, shape (m,)
        ln of the weights of m <= n draws; those of the others are zero.
    n : int
        Number of draws.

    References
    ----------
    E. L. Ionides, Truncated importance sampling (2008), DOI 10.1198/106186008X320456.
    """
    limit = np.logaddexp.reduce(log_weight) - 0.5 * np.log(n)
    cut: Array = np.minimum(log_weight, limit)
    return cut


def drawn_without_replacement(log_weight: Array, count: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Indices of at most `count` draws in proportion to their weights, none twice.

    The largest of ln w plus Gumbel noise are such a sample.
    """
    order: NDArray[np.intp] = np.argsort(-(log_weight + rng.gumbel(size=log_weight.size)))
    return order[:count]
