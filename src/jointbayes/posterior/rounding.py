"""How numbers are rounded, on the terminal as in reports, to the digits their errors support; and put in columns."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

_MOST_DIGITS = 5
_DIGITS_WITHOUT_ERROR = 3
#: The largest ratio of the ends of an interval that is told as a number.
LARGEST_FACTOR = 1e3


def rounded(value: float, error: float = math.nan) -> str:
    """Format a number with the digits that its Monte Carlo standard error supports.

    The last digit shown stands where the first digit of the error does; at least one digit and at most five are
    shown, three where the error is not known. Powers of ten only for large or small numbers.

    Examples
    --------
    >>> rounded(1.4552e10, 2.1e8), rounded(3.532e9, 5.1e6), rounded(0.9302, 0.0012), rounded(8.7e7)
    ('1.46e10', '3.532e9', '0.930', '8.70e7')
    """
    if not math.isfinite(value):
        return "–"
    digits = _DIGITS_WITHOUT_ERROR
    if value == 0:
        return "0"
    if error > 0 and math.isfinite(error):
        digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(error)) + 1
    elif error == 0:
        digits = _MOST_DIGITS
    digits = min(max(digits, 1), _MOST_DIGITS)
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    power = int(exponent)
    if -4 <= power < 5 and digits > power:
        return f"{float(f'{mantissa}e{power}'):.{digits - 1 - power}f}"
    return f"{mantissa}e{power}"


def join_unit(text: str, unit: str) -> str:
    """A number with its unit; a pure number, whose unit is "1", by itself.

    Examples
    --------
    >>> join_unit("3.2e6", "N/m"), join_unit("0.08", "1")
    ('3.2e6 N/m', '0.08')
    """
    return text if unit == "1" else f"{text} {unit}"


def rounded_interval(ends: tuple[float, float], errors: tuple[float, float], between: str = " … ") -> str:
    """Format the ends of an interval, each with the digits that its own error supports.

    Examples
    --------
    >>> rounded_interval((3.532e9, 1.4552e10), (5.1e6, 2.1e8))
    '3.532e9 … 1.46e10'
    """
    return between.join(rounded(end, error) for end, error in zip(ends, errors, strict=True))


def number(value: float | None, digits: int = 3) -> str:
    """Format a number without an error: so many significant digits, powers of ten only for very large or small ones.

    Examples
    --------
    >>> number(5.05e9), number(0.1234), number(None)
    ('5.05e9', '0.123', '–')
    """
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return text
    mantissa, exponent = text.split("e")
    return f"{mantissa}e{int(exponent)}"


def factor(ratio: float) -> str:
    """Format the ratio of an interval's ends, near 1 with two digits of what is above 1.

    Examples
    --------
    >>> factor(4.053), factor(1.0423), factor(1.00083), factor(float("inf"))
    ('4.05', '1.042', '1.00083', '–')
    """
    if 1 < ratio < 2:
        return f"{ratio:.{1 - math.floor(math.log10(ratio - 1))}f}"
    return number(ratio)


def factor_in_words(ratio: float) -> str:
    """Upper over lower end of a 95 % interval.

    Examples
    --------
    >>> factor_in_words(1.0162), factor_in_words(3.84), factor_in_words(math.inf)
    ('a factor of 1.016', 'a factor of 3.84', 'more than a factor of 1000')
    """
    if ratio > LARGEST_FACTOR:
        return f"more than a factor of {LARGEST_FACTOR:.0f}"
    return f"a factor of {factor(ratio)}"


def signed(value: float, decimals: int = 2) -> str:
    """Format a number with its sign and so many decimals; what rounds to zero is +0.

    Examples
    --------
    >>> signed(1.234), signed(-0.5, 1), signed(-0.001)
    ('+1.23', '-0.5', '+0.00')
    """
    return f"{round(value, decimals) + 0.0:+.{decimals}f}"


def align_columns(rows: Sequence[Sequence[str]], alignment: str = "") -> list[str]:
    """Lines of a table for a terminal, two blanks between columns.

    Parameters
    ----------
    rows
        Formatted cells, as many in each row; a head is a row.
    alignment
        One letter per column, "l" or "r"; by default all to the left.

    Examples
    --------
    >>> align_columns([("Mode", "Hz"), ("1", "9.5")], "lr")
    ['Mode   Hz', '1     9.5']
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    sides = alignment or "l" * len(widths)
    return [
        "  ".join(f"{c:{'>' if s == 'r' else '<'}{w}}" for c, w, s in zip(row, widths, sides, strict=True)).rstrip()
        for row in rows
    ]


def contraction(value: float | None, decimals: int) -> str:
    """Share of the prior's variance that the data removed; "none" where the posterior is as wide as the prior or wider.

    Examples
    --------
    >>> contraction(0.98765, 4), contraction(-4.1, 4)
    ('0.9877', 'none')
    """
    return "none" if value is not None and value <= 0 else fixed(value, decimals)


def fixed(value: float | None, decimals: int) -> str:
    """Format with so many decimals; a dash where the number does not exist, as the effective size of a short run."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.{decimals}f}"


def interval(ends: Sequence[float], digits: int = 3) -> str:
    """Format the ends of an interval."""
    return f"{number(ends[0], digits)} … {number(ends[1], digits)}"


def json_ready(value: Any) -> Any:  # noqa: ANN401 (walks any JSON-like value)
    """A summary as JSON holds it: no NaN or infinity, None where a number does not exist."""
    if isinstance(value, Mapping):
        return {str(key): json_ready(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [json_ready(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
