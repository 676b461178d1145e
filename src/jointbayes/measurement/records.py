"""What a measurement file holds, as it says it: FRFs, time histories, spectra, each with its place in the file."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from jointbayes.frf import Quantity
from jointbayes.frf.frf_set import Lines, read_only

__all__ = ["FrfRecord", "Record", "SensorQuantity", "TimeRecord"]

#: What the sensor of a time history measures.
SensorQuantity = Literal["force", "displacement", "velocity", "acceleration", "unknown"]


@dataclass(frozen=True, slots=True, eq=False)
class FrfRecord:
    """One FRF of a file, in SI units, nothing else corrected: zero lines and NaN are still there.

    Parameters
    ----------
    response, reference
        Channel labels as the file gives them, such as ``"Point:12:Z+"`` or ``"acc tip"``.
    frequency_hz
        Frequency lines as stored, shape (lines,), Hz.
    values
        Complex FRF in SI units per newton, shape (lines,).
    quantity
        What the file says it is; None where it does not say.
    unit
        Unit as written in the file, before conversion; empty where none is.
    coherence
        γ², shape (lines,), or None where the file has none.
    averages
        Number of averages, or None where the file does not say.
    where
        Place in the file for messages: ``"data set 3"``, ``"columns 2 and 3"``, ``"variable 'H'"``.
    notes
        What was done on reading, in words: ``"g converted to m/s²"``.
    """

    response: str
    reference: str
    frequency_hz: NDArray[np.float64]
    values: NDArray[np.complex128]
    quantity: Quantity | None = None
    unit: str = ""
    coherence: NDArray[np.float64] | None = None
    averages: int | None = None
    where: str = ""
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        object.__setattr__(self, "frequency_hz", read_only(self.frequency_hz))
        object.__setattr__(self, "values", read_only(self.values, np.complex128))
        if self.coherence is not None:
            object.__setattr__(self, "coherence", read_only(self.coherence))

    def at_lines(self, which: Lines) -> "FrfRecord":
        """Return some of the lines: a mask or indices over lines, or a slice."""
        coherence = None if self.coherence is None else self.coherence[which]
        return replace(self, frequency_hz=self.frequency_hz[which], values=self.values[which], coherence=coherence)


@dataclass(frozen=True, slots=True, eq=False)
class TimeRecord:
    """One time history of a file, in SI units.

    Parameters
    ----------
    channel
        Channel label as the file gives it.
    sample_rate_hz
        Samples per second, Hz.
    values
        Samples, shape (samples,), in N, m, m/s or m/s²; in the file's own unit where `quantity` is ``"unknown"``.
    quantity
        What was measured.
    unit
        Unit as written in the file, before conversion.
    hit
        Which hit or block this is, counted from 1, where the file keeps them apart; else None.
    where, notes
        As in `FrfRecord`.
    """

    channel: str
    sample_rate_hz: float
    values: NDArray[np.float64]
    quantity: SensorQuantity = "unknown"
    unit: str = ""
    hit: int | None = None
    where: str = ""
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", read_only(self.values))


Record = FrfRecord | TimeRecord
