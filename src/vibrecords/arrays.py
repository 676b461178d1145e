"""The names for arrays in annotations, and how a frozen dataclass makes its fields what they are."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
Flags = NDArray[np.bool_]
Indices = NDArray[np.intp]


def complex_of(real: NDArray[Any], imaginary: NDArray[Any]) -> ComplexArray:
    """Complex numbers of two parts; not a + 1j·b, which makes NaN of an infinite part and loses the sign of a zero."""
    values = np.empty(real.shape, complex)
    values.real, values.imag = real, imaginary
    return values


def convert_fields(instance: object, convert: Callable[[Any], object], *names: str) -> None:
    """Convert fields of a frozen dataclass where they are not None, while it is made."""
    for name in names:
        if (value := getattr(instance, name)) is not None:
            object.__setattr__(instance, name, convert(value))
