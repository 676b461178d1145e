"""Whether tests of one structure measured the same within their noise: FRFs line by line, modes one by one.

Nothing of a joint is inferred for it, so that it can be asked before anything is: a joint that changes with the torque
or the force, a repetition that is none.
"""

import math
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.special import chdtrc, gammaincc, gammainccinv

from jointbayes.inference import Problem, Test
from jointbayes.inference.problem import is_one_structure
from jointbayes.posterior.decision import FARTHEST, resonances_of
from jointbayes.rounding import number
from vibrecords import Data, FrfData
from vibrecords.provenance import MeasuredMode

#: Probability with which two equal tests are called different: by their lines, and by their modes.
FALSE_ALARM = 0.01
_MOST_LINES = 3  # that are named
_APART = 0.02  # of a frequency: lines closer than this are of one place


@dataclass(frozen=True, slots=True)
class ModeShift:
    """How far a mode moves from the first of two tests to the second; damping is None where one has none.

    Parameters
    ----------
    frequency_hz
        In the first, Hz.
    frequency_percent, frequency_percent_sd
        Change of the frequency, and its standard deviation.
    damping_ratio
        In the first and in the second.
    damping_percent_sd
        Standard deviation of the second over the first.
    """

    frequency_hz: float
    frequency_percent: float
    frequency_percent_sd: float
    damping_ratio: tuple[float, float] | None = None
    damping_percent_sd: float | None = None

    @property
    def damping_factor(self) -> float | None:
        """The second damping ratio over the first."""
        return None if self.damping_ratio is None else self.damping_ratio[1] / self.damping_ratio[0]

    @property
    def scores(self) -> tuple[float, ...]:
        """Changes of ln f and ln ζ over their standard deviations."""
        of_frequency = 100 * math.log1p(self.frequency_percent / 100) / self.frequency_percent_sd
        if self.damping_factor is None or not self.damping_percent_sd:
            return (of_frequency,)
        return of_frequency, 100 * math.log(self.damping_factor) / self.damping_percent_sd


@dataclass(frozen=True, slots=True)
class Homogeneity:
    """Whether two tests of one structure measured the same within their noise.

    Parameters
    ----------
    first, second
        Their names.
    values
        Number of FRF values that both have, at the same line between the same DOFs.
    chi2_per_value, lines_p_value
        Squared difference over the sum of both variances, 1 expected, and how probable more is; None without values.
    largest_hz
        Lines at which they differ most, where they do by more than chance.
    modes, modes_p_value
        Modes of both, and how probable larger changes of all together are; None without modes.
    """

    first: str
    second: str
    values: int
    chi2_per_value: float | None
    lines_p_value: float | None
    largest_hz: tuple[float, ...]
    modes: tuple[ModeShift, ...]
    modes_p_value: float | None

    @property
    def equal(self) -> bool:
        """Whether neither the lines nor the modes differ by more than their noise."""
        return all(p is None or p >= FALSE_ALARM for p in (self.lines_p_value, self.modes_p_value))

    @property
    def sentence(self) -> str:
        """Whether they are equal within their noise, and the lines that differ most."""
        what = "are equal within" if self.equal else "differ by more than"
        text = f"Tests {self.first} and {self.second} {what} their noise."
        if self.chi2_per_value is not None:
            where = ", ".join(number(hz, 4) for hz in self.largest_hz)
            text += (
                f" {self.values} FRF values differ by {number(math.sqrt(self.chi2_per_value), 3)} times their noise"
                f"{f', most at {where} Hz' if where else ''}."
            )
        return text

    def as_json(self) -> dict[str, Any]:
        """What an entry of ``homogeneity`` of ``summary.json`` holds."""
        return {**asdict(self), "equal": self.equal}


def compare_all_tests(problem: Problem) -> tuple[Homogeneity, ...]:
    """Compare the tests of each structure with the first of them, that of the lowest level where they have levels."""
    ordered = sorted(problem.tests, key=lambda test: -math.inf if test.level is None else test.level.value)
    firsts: list[Test] = []
    comparisons = []
    for test in ordered:
        first = next((earlier for earlier in firsts if is_one_structure(earlier, test)), None)
        if first is None:
            firsts.append(test)
        elif (comparison := compare_tests(first, test)) is not None:
            comparisons.append(comparison)
    return tuple(comparisons)


def compare_tests(first: Test, second: Test) -> Homogeneity | None:
    """Compare what two tests measured; None where they are of different structures, or have nothing in common."""
    if not is_one_structure(first, second):
        return None
    lines = None
    if first.data.shown_frfs is not None and second.data.shown_frfs is not None:
        lines = _compare_lines(first.data.shown_frfs, second.data.shown_frfs)
    values, chi2, lines_p, largest = lines or (0, None, None, ())
    shifts = _compare_modes(first.data, second.data)
    if lines is None and not shifts:
        return None
    scores = [score for shift in shifts for score in shift.scores]
    modes_p = float(chdtrc(len(scores), np.square(scores).sum())) if scores else None
    return Homogeneity(first.name, second.name, values, chi2, lines_p, largest, shifts, modes_p)


def _compare_lines(first: FrfData, second: FrfData) -> tuple[int, float, float, tuple[float, ...]] | None:
    """Number of common values, χ² over it, how probable more is, and where it is largest; None without common ones.

    Variances that were estimated from ν degrees of freedom make each square follow F(2, ν); the sum is taken for a
    gamma variable of the same mean and variance.
    """
    outputs = [dof for dof in first.frf.outputs if dof in second.frf.outputs]
    inputs = [dof for dof in first.frf.inputs if dof in second.frf.inputs]
    common, here, there = np.intersect1d(first.frf.frequency_hz, second.frf.frequency_hz, return_indices=True)
    if not (outputs and inputs and common.size):
        return None
    one, other = first.select(outputs, inputs), second.converted(first.frf.quantity).select(outputs, inputs)
    noise = one.variance[here] + other.variance[there]
    squares = np.abs(one.frf.values[here] - other.frf.values[there]) ** 2 / noise
    dof = math.inf
    if first.variance_dof is not None and second.variance_dof is not None:
        dof = float(first.variance_dof + second.variance_dof)
    mean, variance = (1.0, 1.0) if dof > 1e6 else (dof / (dof - 2), dof**3 / ((dof - 2) ** 2 * (dof - 4)))
    p_value = float(gammaincc(squares.size * mean**2 / variance, squares.sum() * mean / variance))
    by_line = squares.mean(axis=(1, 2))
    per_line = squares.size / by_line.size
    limit = gammainccinv(per_line * mean**2 / variance, FALSE_ALARM / by_line.size) * variance / mean / per_line
    largest: list[float] = []
    for place in np.argsort(by_line)[::-1]:
        if by_line[place] < limit or len(largest) == _MOST_LINES:
            break
        if all(abs(common[place] / hz - 1) > _APART for hz in largest):
            largest.append(float(common[place]))
    return squares.size, float(squares.mean()), p_value, tuple(largest)


@lru_cache(maxsize=8)  # they hold the data
def _modes_of(data: Data) -> tuple[tuple[int | None, MeasuredMode], ...]:
    """Modes that data state, or that FRFs show, each with its number where it is stated; NaN for what is unknown."""
    if data.shown_frfs is not None:
        return tuple((None, mode) for mode in resonances_of(data.shown_frfs))
    if data.modes is None:
        return ()
    damping = getattr(data.modes, "damping", None)
    ratio, ratio_sd = np.full((2, data.modes.frequency_hz.size), np.nan) if damping is None else damping.mean()
    values = zip(data.modes.frequency_hz, data.modes.sd_hz, ratio, ratio_sd, strict=True)
    return tuple(zip(data.modes.numbers, (MeasuredMode(*map(float, each)) for each in values), strict=True))


def _compare_modes(first: Data, second: Data) -> tuple[ModeShift, ...]:
    """Shifts of the modes that both have: those of one number, or each the nearest of the other."""
    here, there = _modes_of(first), _modes_of(second)
    if not here or not there:
        return ()
    away = np.abs([[math.log(a.frequency_hz / b.frequency_hz) for _, b in there] for _, a in here])
    shifts = []
    for i, (number_here, mode) in enumerate(here):
        j = int(away[i].argmin())
        if number_here is not None and there[0][0] is not None:
            j = next((k for k, (number_there, _) in enumerate(there) if number_there == number_here), -1)
        elif away[i, j] > FARTHEST or int(away[:, j].argmin()) != i:
            j = -1
        if j >= 0:
            shifts.append(_shift(mode, there[j][1]))
    return tuple(shifts)


def _shift(first: MeasuredMode, second: MeasuredMode) -> ModeShift:
    sd = math.hypot(first.frequency_sd_hz / first.frequency_hz, second.frequency_sd_hz / second.frequency_hz)
    moved = 100 * (second.frequency_hz / first.frequency_hz - 1)
    if not min(first.damping_ratio, second.damping_ratio) > 0:  # where one is unknown it is NaN
        return ModeShift(first.frequency_hz, moved, 100 * sd)
    ratios = first.damping_ratio, second.damping_ratio
    sd_damping = math.hypot(first.damping_sd / ratios[0], second.damping_sd / ratios[1])
    return ModeShift(first.frequency_hz, moved, 100 * sd, ratios, 100 * sd_damping)
