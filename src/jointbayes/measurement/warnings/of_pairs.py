"""What FRFs of the same two points contradict in each other: reciprocity, repeats, and the factors that explain it."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.measurement.provenance import MeasurementWarning
from jointbayes.measurement.records import FrfRecord
from jointbayes.measurement.warnings.clear_frf import ClearFrf

Complex = NDArray[np.complex128]

#: Lines kept of each FRF, so that a file of many thousands can be compared within little memory.
_KEPT = 128
#: A ratio is constant if ln|ratio| and its phase scatter by less than this.
_CONSTANT = 0.1
_G = 9.80665
#: Factors with a name, and how far a calibration may be off.
_NEAR = 0.04


@dataclass(frozen=True, slots=True, eq=False)
class Sketch:
    """A few lines of an FRF as mobility with signs of directions taken out, and their noise; and where it is from."""

    record: str
    where: str
    frequency_hz: Array
    mobility: Complex
    noise: Array


def sketch_of(record: FrfRecord, clear: ClearFrf) -> Sketch:
    """Sketch of a record and of what can be judged of it."""
    kept = np.unique(np.linspace(0, clear.frequency_hz.size - 1, _KEPT).astype(int))
    # single precision is enough and half as large
    mobility, noise = clear.mobility[kept].astype(np.complex64), clear.noise[kept].astype(np.float32)
    return Sketch(f"{record.response}/{record.reference}", record.where, clear.frequency_hz[kept], mobility, noise)


def disagreement(one: Sketch, other: Sketch) -> MeasurementWarning | None:
    """Warning where two FRFs that should be equal are not; None where they are or cannot be compared.

    Its key is ``"sign"``, ``"g"``, ``"rad_per_s"``, ``"quantity"``, ``"factor"`` or ``"shape"``.
    """
    if one.frequency_hz.shape != other.frequency_hz.shape or not np.allclose(one.frequency_hz, other.frequency_hz):
        return None
    a, b = one.mobility.astype(complex), other.mobility.astype(complex)
    clear = (np.abs(a) > 5 * one.noise) & (np.abs(b) > 5 * other.noise)
    if clear.sum() >= 16:
        found = _named_ratio(one.frequency_hz[clear], b[clear] / a[clear])
        if found is not None:
            return found
    larger = np.maximum(np.abs(a), np.abs(b))
    noise = np.hypot(one.noise.astype(float), other.noise.astype(float))
    apart = np.abs(a - b) > 4 * noise + 0.15 * larger
    if apart.mean() > 0.1:
        return MeasurementWarning(
            "shape",
            f"they differ by more than noise and 15 % on {100 * apart.mean():.0f} % of the lines",
            "look at labels and directions, the mass of the accelerometer, and whether the structure is linear",
        )
    return None


def _named_ratio(f: Array, ratio: Complex) -> MeasurementWarning | None:
    """What a ratio that is constant, or a power of jω, says."""
    omega = 2 * np.pi * f
    for power in (0, 1, -1, 2, -2):
        rest = ratio / (1j * omega) ** power
        level = float(np.median(np.abs(rest)))
        turn = np.median(rest.real) + 1j * np.median(rest.imag)
        scatter = np.log(np.abs(rest) / level)
        phase = np.angle(rest / turn) if turn != 0 else np.full(rest.size, np.pi)
        if np.median(np.abs(scatter)) > _CONSTANT or np.median(np.abs(phase)) > _CONSTANT:
            continue
        if power:
            return MeasurementWarning(
                "quantity",
                f"their ratio grows like frequency to the power {power}: one quantity is not what is said",
                "find out the quantity of each sensor and state it",
            )
        return _named_constant(level, bool(turn.real < 0))
    return None


def _named_constant(level: float, turned: bool) -> MeasurementWarning | None:
    def near(value: float) -> bool:
        return abs(math.log(level / value)) < _NEAR

    opposite = " and the opposite sign" if turned else ""
    if near(_G) or near(1 / _G):
        return MeasurementWarning(
            "g",
            f"one is {max(level, 1 / level):.4g} times the other{opposite}: one is in g, the other in m/s²",
            "find out which channel is in g and give it the gain 9.80665",
        )
    for power in (1, 2):
        if near((2 * np.pi) ** power) or near((2 * np.pi) ** -power):
            factor = "2π" if power == 1 else "(2π)²"
            return MeasurementWarning(
                "rad_per_s",
                f"one is {factor} times the other once both are the same quantity{opposite}: the axis is in rad/s",
                "divide the frequencies by 2π, or say rad/s in the header of the column",
            )
    if abs(math.log(level)) > 0.15:
        return MeasurementWarning(
            "factor",
            f"one is {max(level, 1 / level):.4g} times the other on all lines{opposite}",
            "compare sensitivities and units of the channels; 1000 is mm against m, 4.45 is lbf against N",
        )
    if turned:
        return MeasurementWarning(
            "sign", "they have opposite signs on all lines", 'turn one of the channels in the case file ("-11:y")'
        )
    return None
