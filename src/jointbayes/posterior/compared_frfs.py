"""Measured FRFs against the FRFs that the answer predicts, whether they were fitted or not.

An answer by modes fits frequencies and leaves the lines of the FRFs unused. They still show a sensor that is wrong: its
level, its sign, or the shape of its FRF. All three are compared in robust terms in which each line counts alike,
because a resonance that is off by a part in a hundred is off by its own height.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from jointbayes.frf import Ports
from jointbayes.inference import Problem
from jointbayes.posterior.sampled import Sampled, once
from jointbayes.rounding import number
from vibrecords.arrays import Array, ComplexArray

Fault = Literal["sign", "shape", "level"]

#: An FRF is off in level from this factor on, upwards or downwards.
LEVEL = 1.3
#: It is turned up to this correlation, and has another shape below that one.
TURNED, FOLLOWS = -0.5, 0.9
#: Lines that are compared: above so many standard deviations of the noise; with fewer than that nothing is said.
CLEAR, FEWEST = 3.0, 10
_MOST_LINES = 2000  # evenly spaced
_MOST_NAMED = 3
_COMPARED_DRAWS = 20  # whose FRFs are compared with the measured ones

#: What to check, by the first fault of an FRF.
_CHECK: dict[Fault, str] = {
    "sign": "check its sensor's direction",
    "shape": "check its sensor's channel, position and delay, and the model",
    "level": "check its sensor's calibration, unit and position",
}


@dataclass(frozen=True, slots=True)
class ComparedFrf:
    """One measured FRF and the predicted one.

    Parameters
    ----------
    output, input
        DOF labels.
    level
        Measured over predicted magnitude, the median over lines; NaN with too few clear lines.
    correlation
        Mean over lines of the cosine of the phase from one to the other: 1 in phase, −1 of opposite sign. NaN as
        `level`, and of magnitudes without phase.
    faults
        What is off at the best fit and at every draw.
    """

    output: str
    input: str
    level: float
    correlation: float
    faults: tuple[Fault, ...]

    @property
    def sentence(self) -> str:
        """What is off, and what to check; empty where nothing is."""
        if not self.faults:
            return ""
        what = {
            "sign": "has the opposite sign",
            "shape": f"does not follow the predicted one (in phase {self.correlation:.2f} of 1)",
            "level": f"is {number(self.level, 2)} times the predicted one",
        }
        said = " and ".join(what[fault] for fault in self.faults)
        return f"FRF {self.output}/{self.input} {said}: {_CHECK[self.faults[0]]}."


@once
def compared_frfs_of(posterior: Sampled) -> dict[str, tuple[ComparedFrf, ...]]:
    """Compare each measured FRF with the predicted one by test, fitted or not: level, sign, shape and what is off."""
    theta = np.vstack([posterior.estimate.theta, posterior.thinned(_COMPARED_DRAWS)])
    return {part.test.name: compare_frfs(part, theta) for part in posterior.problem.parts}


def compare_frfs(part: Problem, theta: Array) -> tuple[ComparedFrf, ...]:
    """Compare the measured FRFs of a lone test with those predicted at each θ, shape (n, d), the best fit first.

    A fault is one at every θ, because a joint that is hardly known predicts FRFs near it of any size. Returns an entry
    for each FRF; empty where none was measured.
    """
    data = part.test.data.shown_frfs
    if data is None:
        return ()
    # 1. Take lines of the measured FRFs, and those of them that stand out of the noise.
    frf, every = data.frf, slice(None, None, -(-data.frf.n_lines // _MOST_LINES))
    measured, lines = frf.values[every], frf.frequency_hz[every]
    clear = np.abs(measured) > CLEAR * np.sqrt(data.variance[every])
    # 2. Predict them, one θ after the other.
    ports, prior = Ports(lines, frf.outputs, frf.inputs), part.prior
    rows = zip(prior.values(theta), prior.factors(theta), strict=True)
    predicted = (part.frfs_as_measured(ports, frf.quantity, k[None], more[None])[0] for k, more in rows)
    # 3. Level and correlation of each FRF at each θ, shape (2, n, outputs, inputs).
    levels, correlations = np.stack([level_and_correlation(measured, h, clear) for h in predicted], axis=1)
    if not measured.imag.any():
        correlations[:] = np.nan  # magnitudes without phase
    # 4. Name what every θ says.
    found = []
    for o, i in np.ndindex(levels.shape[1:]):
        level, correlation = levels[:, o, i], correlations[:, o, i]
        faults: dict[Fault, bool] = {
            "sign": bool((correlation <= TURNED).all()),
            "shape": bool((correlation < FOLLOWS).all() and not (correlation <= TURNED).all()),
            "level": bool((level >= LEVEL).all() or (level <= 1 / LEVEL).all()),
        }
        named = tuple(fault for fault, is_off in faults.items() if is_off)
        found.append(ComparedFrf(frf.outputs[o], frf.inputs[i], float(level[0]), float(correlation[0]), named))
    return tuple(found)


def level_and_correlation(
    measured: ComplexArray, predicted: ComplexArray, clear: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Median of |measured|/|predicted| and mean cosine of their phase over clear lines, (lines, outputs, inputs) each.

    NaN, in which nothing is off, where there are fewer than `FEWEST` clear lines.
    """
    # NaN where a line is not clear: medians and means leave it out
    ratio = np.full(measured.shape, np.nan, dtype=complex)
    np.divide(measured, predicted, out=ratio, where=clear & (predicted != 0))
    size, enough = np.abs(ratio), np.isfinite(ratio).sum(axis=0) >= FEWEST
    level, correlation = np.full((2, *enough.shape), np.nan)
    level[enough] = np.nanmedian(size[:, enough], axis=0)
    correlation[enough] = np.nanmean((ratio.real / size)[:, enough], axis=0)
    return level, correlation


def sentences_of_faults(compared: Sequence[ComparedFrf], test: str = "") -> tuple[str, ...]:
    """What is off in the FRFs of a test, a sentence for each of the first few; one where all have another level."""
    off = [each for each in compared if each.faults]
    of_test = f" of test {test}" if test else ""
    levels = [each.level for each in off]
    alike = bool(off) and max(levels) < LEVEL * min(levels)
    if alike and len(off) == len(compared) and all(each.faults == ("level",) for each in off):
        ratio = number(float(np.median(levels)), 2)
        return (
            f"The FRFs{of_test} are {ratio} times as large as the answer predicts: check unit and sensitivity of the "
            "channels.",
        )
    more = len(off) - _MOST_NAMED
    said = [f"Test {test}: {each.sentence}" if test else each.sentence for each in off[:_MOST_NAMED]]
    return (*said, f"{more} more FRFs{of_test} are off.") if more > 0 else tuple(said)
