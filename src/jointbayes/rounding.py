"""How numbers are rounded, on the terminal as in reports, to the digits their errors support; and put in columns."""

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

#: Longest line of what Python shows of a posterior.
LINE = 100
_MOST_DIGITS = 5
_DIGITS_WITHOUT_ERROR = 3
#: Monte Carlo error of a number over the number: from here on it has one digit, and an end of an interval no value.
_ONE_DIGIT, _NO_VALUE = 0.25, 0.5
_POWERS_FROM = 4  # the power of ten from which on a number is written as one
_DECADE = math.log(10)
_PREFIXES = (("G", 1e9), ("M", 1e6), ("k", 1e3))


def rounded(value: float, error: float = math.nan) -> str:
    """Format a number with the digits that its Monte Carlo standard error supports.

    The last digit shown stands where the first digit of the error does; at least one digit and at most five are
    shown, three where the error is not known. Powers of ten only for large or small numbers.

    Examples
    --------
    >>> rounded(1.4552e10, 2.1e8), rounded(3.532e9, 5.1e6), rounded(0.9302, 0.0012), rounded(8.7e7)
    ('1.46e10', '3.532e9', '0.930', '8.70e7')
    """
    return rounded_row((value,), (error,))[0]


def rounded_row(values: Sequence[float], errors: Sequence[float] = (), *, fill: bool = False) -> tuple[str, ...]:
    """Format numbers that stand side by side as `rounded` does, in one notation: powers of ten for all or for none.

    Parameters
    ----------
    values
        Numbers of one unit; "–" where one is not finite.
    errors
        Monte Carlo standard error of each; by default not known.
    fill
        Write zeros for places that an error does not support ("120", its error 15) rather than powers of ten.

    Examples
    --------
    >>> rounded_row((99936.0, 99210.0, 100673.0), (12.0, 40.0, 40.0))
    ('9.994e4', '9.921e4', '1.0067e5')
    """
    split = [_split(value, error) for value, error in zip(values, errors or [math.nan] * len(values), strict=True)]
    given = [(digits, power) for digits, power in split if digits]
    plain = all(-4 <= power < 5 and (fill or digits > power) for digits, power in given)
    texts = []
    for value, (digits, power) in zip(values, split, strict=True):
        text = _in_powers(value, digits)
        texts.append(f"{float(text):.{max(digits - 1 - power, 0)}f}" if digits and plain else text)
    return tuple(texts)


def _in_powers(value: float, digits: int) -> str:
    """A number as a power of ten with so many digits; 0 and what is not finite as they are told elsewhere."""
    if value == 0 or not math.isfinite(value):
        return "0" if value == 0 else "–"
    mantissa, power = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}e{int(power)}"


def _split(value: float, error: float) -> tuple[int, int]:
    """Significant digits of a number that its error supports, and the power of ten of the first; no digits of a 0."""
    if value == 0 or not math.isfinite(value):
        return 0, 0
    digits = _DIGITS_WITHOUT_ERROR
    if error > 0 and math.isfinite(error):
        digits = math.floor(math.log10(abs(value))) - math.floor(math.log10(error)) + 1
        digits = 1 if error > _ONE_DIGIT * abs(value) else digits
    elif error == 0:
        digits = _MOST_DIGITS
    digits = min(max(digits, 1), _MOST_DIGITS)
    return digits, int(f"{value:.{digits - 1}e}".split("e")[1])


def engineering(values: Sequence[float], unit: str, errors: Sequence[float] = ()) -> tuple[tuple[str, ...], str]:
    """Format the numbers of a row, such as a median and its interval, with one prefix: GN/m, MN·m/rad, kN·s/m.

    The prefix fits the first number, so state the median first; only units of a force have one, and m/N is
    printed in nm/N. Each number shows
    the digits that its error supports, with zeros for the places that it does not. Where a number would be below 0.0001
    or above 99999 with that prefix, all of the row are powers of ten in the unit without a prefix.

    Parameters
    ----------
    values
        Numbers in the unit; "–" where one is not finite.
    unit
        Unit without a prefix, such as ``"N·m/rad"``.
    errors
        Monte Carlo standard error of each; by default not known, and three digits are shown.

    Returns
    -------
    texts
        One string per number, without the unit.
    unit
        The unit with its prefix.

    Examples
    --------
    >>> engineering((5.046e9, 3.532e9, 1.4552e10), "N/m", (2.1e7, 5.1e6, 2.1e8))
    (('5.05', '3.532', '14.6'), 'GN/m')
    >>> engineering((99936.0, 99210.0, 100673.0), "N·m/rad", (12.0, 40.0, 40.0))
    (('99.94', '99.21', '100.67'), 'kN·m/rad')
    >>> engineering((3.44e7, 1.2, 9e12), "N"), engineering((0.0801, 0.02), "1")
    ((('3.44e7', '1.20e0', '9.00e12'), 'N'), (('0.0801', '0.0200'), '1'))
    >>> engineering((6.12e-10, 4.02e-10), "m/N")
    (('0.612', '0.402'), 'nm/N')
    """
    if unit == "m/N":  # of a joint
        values, errors, unit = [1e9 * v for v in values], [1e9 * e for e in errors], "nm/N"
    first = next((abs(value) for value in values if value and math.isfinite(value)), 0.0) if unit[:1] == "N" else 0.0
    prefix, scale = next(((p, s) for p, s in _PREFIXES if first >= s), ("", 1.0))
    errors = errors or [math.nan] * len(values)
    texts = rounded_row([v / scale for v in values], [e / scale for e in errors], fill=True)
    if any("e" in text for text in texts):
        return rounded_row(values, errors), unit
    return texts, prefix + unit


def with_interval(values: Sequence[float], unit: str, errors: Sequence[float] = ()) -> str:
    """A value with its 95 % interval, or the interval alone, as every page, line and figure prints it.

    Three digits, or as many as tell the ends apart to a fifth of the interval's width, and no more than the errors
    support. An end that its error leaves open by a factor is printed as "above" or "below" one standard error inside.

    Parameters
    ----------
    values
        Value and both ends, or the ends alone, in the unit.
    unit
        Unit without a prefix.
    errors
        Monte Carlo standard error of each; by default not known.

    Examples
    --------
    >>> with_interval((1.52214e6, 1.50943e6, 1.5801e6), "N·m/rad"), with_interval((3.19e9, 1.52e10), "N/m")
    ('1.52 (1.51 to 1.58) MN·m/rad', '3.19 to 15.2 GN/m')
    >>> with_interval((2.0005e7, 1.9988e7, 2.0021e7), "N/m")
    '20.005 (19.988 to 20.021) MN/m'
    >>> with_interval((5.1e9, 3.2e9, 4.1e10), "N/m", (1e8, 1e7, 3e10))
    '5.1 (3.20 to above 20) GN/m'
    """
    width = abs(values[-1] - values[-2])
    least = [_last_place(value, width) for value in values]
    supported = [np.fmax(*pair) for pair in zip(least, errors or least, strict=True)]
    shown, open_ends = list(values), ["", ""]
    for end, (word, side) in enumerate((("below ", 1.0), ("above ", -1.0)), len(values) - 2):
        share = supported[end] / values[end] if values[end] > 0 else 0.0
        if share > _NO_VALUE:
            shown[end] *= math.exp(side * min(share, _DECADE))
            open_ends[end - len(values)] = word
    (*value, low, high), of = engineering(shown, unit, supported)
    low, high = (word + text for word, text in zip(open_ends, (low, high), strict=True))
    return join_unit(f"{value[0]} ({low} to {high})" if value else f"{low} to {high}", of)


def _last_place(value: float, width: float) -> float:
    """An error that leaves a number three digits, or so many that an interval of this width has its fifths."""
    sizes = (abs(value) / 100, width / 5)
    return 1.5 * 10.0 ** min((math.floor(math.log10(size)) for size in sizes if 0 < size < math.inf), default=0)


def quantity_text(value: float, unit: str) -> str:
    """One number with three digits and its unit.

    Examples
    --------
    >>> quantity_text(9.3549e9, "N/m")
    '9.35 GN/m'
    """
    (text,), of = engineering((value,), unit)
    return join_unit(text, of)


def join_unit(text: str, unit: str) -> str:
    """A number with its unit; a pure number, whose unit is "1", by itself.

    Examples
    --------
    >>> join_unit("3.2e6", "N/m"), join_unit("0.08", "1")
    ('3.2e6 N/m', '0.08')
    """
    return text if unit == "1" else f"{text} {unit}"


def rounded_interval(ends: tuple[float, float], errors: tuple[float, float]) -> str:
    """Format the ends of an interval, each with the digits that its own error supports.

    Examples
    --------
    >>> rounded_interval((3.532e9, 1.4552e10), (5.1e6, 2.1e8))
    '3.532e9 to 1.46e10'
    """
    return " to ".join(rounded_row(ends, errors))


def number(value: float | None, digits: int = 3) -> str:
    """Format a number without an error: so many significant digits, powers of ten only from 10 000 on or below 0.0001.

    Examples
    --------
    >>> number(5.05e9), number(0.1234), number(104.0, 2), number(None)
    ('5.05e9', '0.123', '100', '–')
    """
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return text
    mantissa, power = text.split("e")
    return f"{mantissa}e{int(power)}" if not 0 < int(power) < _POWERS_FROM else f"{float(text):.0f}"


def percent(share: float, digits: int = 2) -> str:
    """Format a fraction as a percentage with so many significant digits.

    Examples
    --------
    >>> percent(0.0456), percent(1.04), percent(23.71), percent(0.002345, 3)
    ('4.6 %', '100 %', '2400 %', '0.234 %')
    """
    return f"{number(100 * share, digits)} %"


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


def told_apart(value: float, *limits: float) -> tuple[str, ...]:
    """A number and its limits with three digits, or as many as tell it from them.

    Examples
    --------
    >>> told_apart(1.0201, 0.98, 1.02)
    ('1.0201', '0.98000', '1.0200')
    """
    for digits in range(3, 8):
        texts = tuple(f"{each:#.{digits}g}".rstrip(".") for each in (value, *limits))
        if texts[0] not in texts[1:]:
            break
    return texts


def p_value_in_words(value: float) -> str:
    """A p-value after "p": as a number, or beyond which one.

    Examples
    --------
    >>> p_value_in_words(0.1234), p_value_in_words(1e-9)
    ('= 0.12', '< 0.001')
    """
    return "< 0.001" if value < 0.001 else "> 0.999" if value > 0.999 else f"= {value:.2g}"


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


def sentence_start(text: str) -> str:
    """Text with a capital in front, whose other letters stay.

    Examples
    --------
    >>> sentence_start("length 360 mm"), sentence_start("")
    ('Length 360 mm', '')
    """
    return f"{text[:1].upper()}{text[1:]}"


def in_lines(text: str, indent: int, *, inside: int = 0) -> list[str]:
    """A sentence in lines of at most `LINE` characters, the first indented by so many blanks, the others by four more.

    Lines are shorter by `inside` where these are printed with further blanks before them.

    Examples
    --------
    >>> in_lines("k22: 1.5e6", 4)
    ['    k22: 1.5e6']
    """
    first = " " * indent
    width = LINE - inside
    return textwrap.wrap(text, width, initial_indent=first, subsequent_indent=first + " " * 4, break_on_hyphens=False)


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
    """Format the ends of an interval with so many digits, both in one notation.

    Examples
    --------
    >>> interval((99.2, 12345.0)), interval((0.12, 4.5))
    ('9.92e1 to 1.23e4', '0.12 to 4.5')
    """
    texts = [number(end, digits) for end in ends]
    if len({"e" in text for text in texts}) > 1:
        texts = [_in_powers(end, digits) for end in ends]
    return " to ".join(texts)


def attributes_of(thing: object, *names: str) -> dict[str, Any]:
    """Attributes by their names, for what has the same names in JSON.

    Examples
    --------
    >>> attributes_of(3 + 4j, "real", "imag")
    {'real': 3.0, 'imag': 4.0}
    """
    return {name: getattr(thing, name) for name in names}


def json_ready(value: Any) -> Any:  # noqa: ANN401 (walks any JSON-like value)
    """A summary as JSON holds it: no NaN or infinity, None where a number does not exist."""
    if isinstance(value, Mapping):
        return {str(key): json_ready(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [json_ready(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
