"""Which stiffness do the data determine? One documented rule."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["IDENTIFIED_RATIO", "LEAST_CONTRACTION", "WEAK_RATIO", "Identifiability", "Verdict", "assess"]

Verdict = Literal["identified", "weakly identified", "not identified"]

#: Largest upper/lower ratio of the 95 % interval of an identified stiffness.
IDENTIFIED_RATIO = 1.25
#: The same for a weakly identified one.
WEAK_RATIO = 3.0
#: Least contraction 1 − var(posterior)/var(prior) of ln k: below it the prior speaks, not the data.
LEAST_CONTRACTION = 0.5


@dataclass(frozen=True, slots=True)
class Identifiability:
    """What draws of one stiffness say about how well it is known.

    Parameters
    ----------
    interval95
        Equal-tailed 95 % posterior interval, in the stiffness's unit.
    ratio
        Upper end over lower end; infinite where the interval holds zero or both signs.
    sd_log
        Posterior standard deviation of ln |k|; NaN where draws have both signs.
    contraction
        1 − var(posterior)/var(prior) of ln |k| (of k itself where draws have both signs).
    verdict
        By the rule of this module.
    """

    interval95: tuple[float, float]
    ratio: float
    sd_log: float
    contraction: float
    verdict: Verdict


def assess(posterior: NDArray[np.float64], prior: NDArray[np.float64]) -> Identifiability:
    """Judge one stiffness from posterior and prior draws, any shapes, in the stiffness's unit.

    A stiffness is *identified* if the upper end of its 95 % interval is at most 1.25 times the lower end, *weakly
    identified* if at most 3 times, and otherwise *not identified*; it is not identified either if the variance of
    its logarithm has contracted by less than half from prior to posterior.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> assess(np.exp(0.01 * rng.normal(size=4000)), np.exp(rng.normal(size=4000))).verdict
    'identified'
    """
    low, high = (float(q) for q in np.quantile(posterior, [0.025, 0.975]))
    one_sign = bool((posterior > 0).all() or (posterior < 0).all())
    if one_sign:
        ratio = max(high / low, low / high)
        sd_log = float(np.log(np.abs(posterior)).std())
        contraction = 1 - (sd_log / float(np.log(np.abs(prior)).std())) ** 2
    else:
        ratio, sd_log = math.inf, math.nan
        contraction = 1 - float(posterior.var() / prior.var())
    verdict: Verdict = "not identified"
    if contraction >= LEAST_CONTRACTION and ratio <= WEAK_RATIO:
        verdict = "identified" if ratio <= IDENTIFIED_RATIO else "weakly identified"
    return Identifiability((low, high), ratio, sd_log, contraction, verdict)
