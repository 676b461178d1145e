"""The names for arrays and quantities in annotations, and how a frozen dataclass makes its fields what they are."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Flags = NDArray[np.bool_]
Indices = NDArray[np.intp]
#: Lowest and highest frequency, Hz; None is the end of the lines.
Band = tuple[float | None, float | None]

Quantity = Literal["receptance", "mobility", "accelerance"]
#: What the sensor of a time history measures.
SensorQuantity = Literal["force", "displacement", "velocity", "acceleration", "unknown"]
#: Some of the lines of an FRF: a mask or indices over them, or a slice.
Lines = Flags | Indices | slice
#: Power of jω by which a quantity follows from the receptance.
POWER_OF_JW: dict[str, int] = {"receptance": 0, "mobility": 1, "accelerance": 2}


@dataclass(frozen=True, slots=True, eq=False)
class OverFrequency:
    """What stands over lines of frequency: FRFs, a coherence, a spectrum."""

    def at_lines(self, which: Lines) -> Self:
        """Return some of the lines, by a mask or indices over them or a slice; what is of another size stays whole."""
        arrays: dict[str, Any] = {name: getattr(self, name, None) for name in ("frequency_hz", "values", "coherence")}
        on_lines = {name: a for name, a in arrays.items() if np.shape(a)[:1] == arrays["frequency_hz"].shape}
        return replace(self, **{name: array[which] for name, array in on_lines.items()})


def quantity_factor(frequency_hz: Array, to: Quantity, source: Quantity = "receptance") -> ComplexArray:
    """Factor (jω)ⁿ per line that turns `source` into `to`, shape (lines,); ω = 2πf."""
    power = POWER_OF_JW[to] - POWER_OF_JW[source]
    omega = 2 * np.pi * np.asarray(frequency_hz, dtype=float)
    # (jω)ⁿ by integer powers of j is exact: mobility to receptance and back is the same to the last bit or two
    return np.array([1, 1j, -1, -1j])[power % 4] * omega**power


def complex_of(real: NDArray[Any], imaginary: NDArray[Any]) -> ComplexArray:
    """Complex numbers of two parts; not a + 1j·b, which makes NaN of an infinite part and loses the sign of a zero."""
    values = np.empty(real.shape, complex)
    values.real, values.imag = real, imaginary
    return values


def stretch_about(low: Flags, top: int) -> tuple[int, int]:
    """Ends of the stretch about a place that is not low: its first place, and the one behind its last."""
    before, after = np.flatnonzero(low[:top]), np.flatnonzero(low[top:])
    return int(before[-1]) + 1 if before.size else 0, top + int(after[0]) if after.size else low.size


def convert_fields(instance: object, convert: Callable[[Any], object], *names: str) -> None:
    """Convert fields of a frozen dataclass where they are not None, while it is made."""
    for name in names:
        if (value := getattr(instance, name)) is not None:
            object.__setattr__(instance, name, convert(value))
