"""Doubts of the data of a case: a truth that the prior excludes, signs of files, numbers of modes. Never errors."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.case.case_text import CaseText, InputWarning
from jointbayes.case.spec.fields import Finding
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.errors import JointBayesError
from jointbayes.inference import JointPrior, Problem
from jointbayes.measurement import ModalData

if TYPE_CHECKING:
    from jointbayes.measurement.provenance import Provenance

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
    if measured is None or measured.match == "shape" or not prior.marginals:
        return None
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


def truth_warnings(spec: CaseSpec, text: CaseText, prior: JointPrior) -> tuple[InputWarning, ...]:
    """Look whether the prior excludes the joint that makes the data, so that no analysis can find it.

    Of a set-up the prior is that of its own joints alone.
    """
    return text.warnings(_excluded(spec, prior, text.setup))


def sign_warnings(provenance: Provenance | None, text: CaseText) -> tuple[InputWarning, ...]:
    """Doubts of the sign, or of the sign of i, of FRFs of files, with which every number of a run would be wrong."""
    doubts = provenance.sign_doubts if provenance else ()
    findings = (Finding(("data", "file"), f"found that at {w.where} {w.sentence}", "", w.remedy) for w in doubts)
    return text.warnings(findings)


def numbering_warnings(doubt: Renumbered | None, text: CaseText, from_files: bool) -> tuple[InputWarning, ...]:
    """A doubt of the numbers of measured modes, or of their unit, as `find_numbering` finds it."""
    if doubt is None:
        return ()
    loc = ("data", "file") if from_files else ("data", "frequencies_hz")
    squares = (
        f"squared residuals of {doubt.better_squares:.3g} and {doubt.stated_squares:.3g} standard deviations in all, "
        "the joint fitted anew for each"
    )
    if doubt.rad_per_s:
        oddity = f"found natural frequencies that fit far better divided by 2π, as if they were in rad/s: {squares}"
        return text.warnings([Finding(loc, oddity, "natural frequencies in Hz", "divide them by 2π")])
    stated, better = (", ".join(map(str, numbers)) for numbers in (doubt.stated, doubt.better))
    oddity = (
        f"found natural frequencies that fit far better as those of modes {better} than of modes {stated}: {squares}"
    )
    expected = "modes counted from the lowest one, those included in which the structure moves rigidly on a soft joint"
    remedy = f'if a lower one was left out, write kind = "modes" with numbers = [{better}]'
    return text.warnings([Finding(loc, oddity, expected, remedy)])


def _excluded(spec: CaseSpec, prior: JointPrior, setup: str) -> Iterator[Finding]:
    """Yield stiffnesses of the truth that have no coordinates, or coordinates of it that the prior excludes."""
    if spec.data.synthetic is None:
        return
    joint, loc, stated = prior.parametrisation, ("data", "truth"), spec.data.synthetic.truth
    truth = [stated.stiffness_by_name[_name_in_tables(setup, name)] for name in joint.stiffness_names]
    if not joint.describes(truth):
        each = ", ".join(f"{name} = {value:g}" for name, value in zip(joint.stiffness_names, truth, strict=True))
        kinds = " and ".join(dict.fromkeys(joint_spec.parametrisation for joint_spec in spec.all_joints.values()))
        oddity = f'found {each}, which joint.parametrisation = "{kinds}" cannot describe'
        yield Finding(loc, oddity, "a truth that the analysis can find", "choose another parametrisation or truth")
        return
    for axis, marginal, value in zip(joint.axes, prior.marginals, joint.coordinates(truth), strict=True):
        low, high = marginal.support
        if not low <= value <= high:
            shown, least, most = (math.exp(x) if axis.logarithmic else x for x in (value, low, high))
            oddity = f"found a truth with {axis.name} = {shown:.4g}, which the prior excludes"
            expected = f"{axis.name} from {least:.4g} to {most:.4g}, so that the analysis can find it"
            of_truth = _name_in_tables(setup, axis.quantity)
            place = (of_truth,) if stated.stiffness is None else ("stiffness", *of_truth.split("."))
            owner, _, name = _name_in_tables(setup, axis.name).rpartition(".")
            table = f"joints.{owner}.prior.{name}" if owner else f"prior.{name}"
            yield Finding((*loc, *place), oddity, expected, f"widen [{table}] or correct the truth")


def _name_in_tables(setup: str, name: str) -> str:
    """Name of a quantity of a set-up as its own tables have it."""
    return name.removeprefix(f"{setup}.") if setup else name
