"""How residuals correlate along frequency: Ljung and Box's statistic, and its law for white residuals.

References
----------
Ljung, G. M., Box, G. E. P. (1978). On a measure of lack of fit in time series models. Biometrika 65(2), 297-303.
DOI 10.1093/biomet/65.2.297
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vibrecords.arrays import Array

#: Neighbours whose residuals are compared: model error spans the lines of a resonance, so a few suffice.
LAGS = 5
#: Replicated records, the fewest and the most, their values together, and the most lines of one: the standardised
#: statistic's law hardly depends on the length.
_FEWEST, _MOST, _VALUES, _LONG = 2000, 5000, 4_000_000, 1000
_TAIL = 0.05  # of the replicated records, from which on their law is taken as exponential


@dataclass(frozen=True, slots=True, eq=False)
class Whiteness:
    """How residuals correlate along frequency.

    Parameters
    ----------
    statistic
        Ljung and Box's, mean over draws.
    replicated
        That of replicated white records, sorted, shape (replicates,).
    correlations
        Correlation of residuals 1, 2, ... lines apart, mean over draws.
    deviations
        The same in standard deviations of white residuals.
    """

    statistic: float
    replicated: Array
    correlations: tuple[float, ...]
    deviations: tuple[float, ...]

    @property
    def _tail(self) -> tuple[float, float]:
        """Where the tail of white records begins, and their mean excess: beyond it the law is taken as exponential."""
        begin = float(np.quantile(self.replicated, 1 - _TAIL))
        return begin, float((self.replicated[self.replicated > begin] - begin).mean())

    @property
    def p_value(self) -> float:
        """Probability that white residuals look as correlated."""
        begin, excess = self._tail
        if self.statistic > begin:
            return _TAIL * math.exp((begin - self.statistic) / excess)
        return 1 - float(np.searchsorted(self.replicated, self.statistic)) / len(self.replicated)

    def limit(self, level: float) -> float:
        """What the statistic of white residuals exceeds with this probability, 5 % at most."""
        begin, excess = self._tail
        return begin + excess * math.log(_TAIL / level)


def portmanteau(scores: NDArray[np.inexact], parts: int) -> tuple[Array, Array]:
    """Ljung-Box statistic (n,) and correlations (n, lags) of each row (n, lines, pairs).

    Correlations are those of each pair's residuals over their own sum of squares, so that a wrong level of noise plays
    no part, averaged over pairs.
    """
    n, lines, pairs = scores.shape
    # the real part of conj(a)·b is the scalar product of (Re a, Im a) with (Re b, Im b)
    flat = np.ascontiguousarray(scores.swapaxes(1, 2)).view(np.float64).reshape(n, pairs, parts * lines)
    norm = np.einsum("npk,npk->np", flat, flat)
    norm = np.where(norm > 0, norm, 1.0)
    sd = lag_sd(lines, pairs, parts)
    correlations = np.empty((n, len(sd)))
    for h in range(1, len(sd) + 1):
        product = np.einsum("npk,npk->np", flat[:, :, : -h * parts], flat[:, :, h * parts :])
        correlations[:, h - 1] = (product / norm).mean(axis=1)
    return ((correlations / sd) ** 2).sum(axis=1), correlations


def lag_sd(lines: int, pairs: int, parts: int) -> Array:
    """Standard deviation of the mean correlation of white records at each lag h, shape (lags,).

    Its variance is parts·(lines − h)/(M(M + 2)) over the pairs, with M = parts·lines.
    """
    m, h = parts * lines, np.arange(1, min(LAGS, lines - 1) + 1)
    return np.asarray(np.sqrt(parts * (lines - h) / (pairs * m * (m + 2))))


def replicated_portmanteau(lines: int, pairs: int, parts: int, rng: np.random.Generator) -> Array:
    """The same statistic of white residuals, shape (replicates,)."""
    length = min(lines, max(_LONG // pairs, 10 * LAGS))
    count = int(np.clip(_VALUES // (length * pairs * parts), _FEWEST, _MOST))
    block = max(1, 100_000 // (length * pairs))
    statistics = []
    for start in range(0, count, block):
        white = rng.standard_normal((min(block, count - start), length, pairs * parts))
        statistics.append(portmanteau(white.view(np.complex128) if parts == 2 else white, parts)[0])
    return np.concatenate(statistics)
