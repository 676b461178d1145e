"""Whether measured natural frequencies fit far better as those of other modes, or in another unit, than is stated."""

import math
from dataclasses import dataclass

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.errors import JointBayesError
from jointbayes.inference import Problem
from jointbayes.measurement import ModalData

#: Modes that the first measured one may be away from its stated number.
SHIFTS = (*range(-3, 0), *range(1, 7))
#: A numbering is doubted where another one has a sum of squares lower by this, and by this factor.
LEAST_GAIN, LEAST_FACTOR = 20.0, 4.0
_DRAWS, _CLIMBS, _STEP = 300, 3, 1e-4
_RAD_PER_S = 1 / (2 * math.pi)  # Hz
_FAR = 1e6  # a residual where a joint outside the prior has no natural frequency


@dataclass(frozen=True, slots=True)
class Renumbered:
    """A numbering that fits better than the stated one: both, and the sums of squared residuals over their sd.

    With `rad_per_s` it is the stated numbering of frequencies that were divided by 2π.
    """

    stated: tuple[int, ...]
    better: tuple[int, ...]
    stated_squares: float
    better_squares: float
    rad_per_s: bool = False


def find_numbering(problem: Problem) -> Renumbered | None:
    """Look for a numbering that fits natural frequencies far better than the stated one; None where none does.

    For each shift of all numbers, and for frequencies that are 2π times too high, the joint is fitted anew, within its
    prior and from the best of draws of it, with what else is uncertain at its middle. Default priors follow the
    measured frequencies: of frequencies in rad/s the springs may be softer by (2π)².

    Parameters
    ----------
    problem
        One test.
    """
    measured, prior = problem.test.data.modes, problem.prior
    if measured is None or measured.match == "shape" or measured.shown_frfs or not prior.marginals:
        return None  # modes that were read off FRFs were numbered by the model
    numbers, most = np.array(measured.numbers), problem.test.most_modes
    draws = np.tile(prior.mean, (_DRAWS, 1))
    joint = len(prior.marginals)
    draws[:, :joint] = prior.sample(np.random.default_rng(0), _DRAWS)[:, :joint]
    try:
        stated = _least_squares(problem, measured, numbers, draws)
        if stated < LEAST_GAIN:
            return None
        possible = [shift for shift in SHIFTS if numbers.min() + shift >= 1 and numbers.max() + shift <= most]
        each = {shift: _least_squares(problem, measured, numbers + shift, draws) for shift in possible}
        each[0] = _least_squares(problem, measured, numbers, draws, _RAD_PER_S)
    except (JointBayesError, ArithmeticError, np.linalg.LinAlgError):  # the run itself will say it
        return None
    best = min(each, key=lambda shift: each[shift])
    if stated - each[best] < LEAST_GAIN or each[best] * LEAST_FACTOR > stated:
        return None
    return Renumbered(tuple(numbers.tolist()), tuple((numbers + best).tolist()), stated, each[best], best == 0)


def _least_squares(
    problem: Problem, measured: ModalData, numbers: NDArray[np.int_], draws: Array, unit_hz: float = 1.0
) -> float:
    """Sum of squared residuals of the best joint, for modes of these numbers, climbing from the best of draws."""
    prior = problem.prior
    joint = len(prior.marginals)
    rest, scale = draws[0, joint:], np.maximum([marginal.sd for marginal in prior.marginals], 1e-12)
    softer = np.array([2 * math.log(unit_hz) * axis.logarithmic for axis in prior.parametrisation.axes])
    low, high = np.array([marginal.support for marginal in prior.marginals]).T
    low, high = (low + softer) / scale, high / scale
    draws = np.vstack([draws, draws + np.append(softer, 0 * rest)]) if softer.any() else draws

    def residuals(theta: Array) -> Array:
        stiffness, factors = prior.values(theta), prior.factors(theta)
        predicted = problem.natural_frequencies_hz(stiffness, int(numbers.max()), factors)[:, numbers - 1]
        return np.nan_to_num(
            (measured.frequency_hz - predicted / unit_hz) / measured.sd_hz, nan=_FAR, posinf=_FAR, neginf=-_FAR
        )

    def fit(x: Array) -> Array:
        return residuals(np.concatenate([x * scale, rest])[None])[0]

    def slope(x: Array) -> Array:
        moved = np.stack([x, *(x + _STEP * np.eye(joint))]) * scale
        values = residuals(np.hstack([moved, np.tile(rest, (joint + 1, 1))]))
        return (values[1:] - values[0]).T / _STEP

    start = (residuals(draws) ** 2).sum(axis=1)
    least = float(start.min())
    for row in np.argsort(start)[:_CLIMBS]:
        x = np.clip(draws[row, :joint] / scale, low + _STEP, high - _STEP)
        fitted = scipy.optimize.least_squares(fit, x, slope, bounds=(low, high), max_nfev=30)
        least = min(least, 2 * float(fitted.cost))
    return least
