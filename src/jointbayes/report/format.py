"""One rule for how numbers are rounded in a report."""

from collections.abc import Sequence

import numpy as np

__all__ = ["fixed", "interval", "number"]


def number(value: float | None, digits: int = 3) -> str:
    """Format with so many significant digits; powers of ten only for very large or small numbers.

    Examples
    --------
    >>> number(5.05e9), number(0.1234), number(None)
    ('5.05e9', '0.123', '–')
    """
    if value is None or not np.isfinite(value):
        return "–"
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return text
    mantissa, exponent = text.split("e")
    return f"{mantissa}e{int(exponent)}"


def fixed(value: float | None, decimals: int) -> str:
    """Format with so many decimals; a dash where the number does not exist, as the effective size of a short run."""
    return "–" if value is None or not np.isfinite(value) else f"{value:.{decimals}f}"


def interval(ends: Sequence[float], digits: int = 3) -> str:
    """Format the ends of an interval."""
    return f"{number(ends[0], digits)} … {number(ends[1], digits)}"
