"""Values of a data set 58: columns of fixed width in text, IEEE numbers in binary."""

import io
import re
from array import array
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.measurement.formats.table_text import bad_number
from jointbayes.measurement.formats.uff_data_sets import FunctionHeader, LineError, body_bytes

#: With these alone, NumPy reads a field as we do; it would also take 1_000 for a number.
_OF_NUMBERS = b"0123456789eE+-. \r\n"
_NUMBER = re.compile(rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.IGNORECASE)


@dataclass(frozen=True, slots=True, eq=False)
class Function:
    """Abscissa and ordinate, shape (count,)."""

    abscissa: Array
    ordinate: Array | NDArray[np.complex128]


def decode(header: FunctionHeader, body: bytes) -> Function:
    """Values of a data set 58.

    Parameters
    ----------
    header
        Header of the data set.
    body
        Content after the header, up to the delimiter.

    Raises
    ------
    LineError
        If a field is not a number, or there are more or fewer than the header says.
    """
    numbers = _binary(header, body) if header.byte_order else _text(header, body)
    numbers = numbers.reshape(header.count, header.per_value)
    if header.even:
        with np.errstate(over="ignore"):
            abscissa = np.asarray(header.minimum + np.arange(header.count) * header.increment, dtype=np.float64)
    else:
        abscissa, numbers = numbers[:, 0].copy(), numbers[:, 1:]
    if not header.is_complex:
        return Function(abscissa, numbers[:, 0].copy())
    ordinate = np.empty(header.count, complex)
    # not a + 1j·b, which turns an infinite part into NaN and loses the sign of a zero
    ordinate.real, ordinate.imag = numbers[:, 0], numbers[:, 1]
    return Function(abscissa, ordinate)


def _binary(header: FunctionHeader, body: bytes) -> Array:
    kind = header.byte_order + ("f8" if header.is_double else "f4")
    if len(body) == header.count * header.per_value * int(kind[-1]):
        return np.frombuffer(body, dtype=kind).astype(float)
    assert len(body) == body_bytes(header)
    narrow = np.dtype([("x", header.byte_order + "f4"), ("y", kind, (header.per_value - 1,))])
    rows = np.frombuffer(body, dtype=narrow)
    return np.concatenate([rows["x"][:, None].astype(float), rows["y"].astype(float)], axis=1)


def _text(header: FunctionHeader, body: bytes) -> Array:
    expected = header.count * header.per_value
    # each number takes a digit and, but for columns that touch, a blank: a count beyond that is wrong
    if expected > len(body):
        raise LineError(0, _count_message(header, f"at most {len(body)} numbers"))
    if not body.translate(None, _OF_NUMBERS):
        fast = _columns(header, body, expected)
        if fast is not None:
            return fast
    return _numbers(header, body, expected)


def _widths(header: FunctionHeader) -> tuple[int, ...]:
    """Widths of the columns of a full line: 6E13.5, 4E20.12, 2(E13.5,E20.12) or E13.5,2E20.12."""
    if not header.is_double:
        return (13,) * 6
    if header.even:
        return (20,) * 4
    return (13, 20, 20) if header.is_complex else (13, 20) * 2


def _columns(header: FunctionHeader, body: bytes, expected: int) -> Array | None:
    """All numbers at once where every full line is as long as the first; None where one differs.

    Nothing but one column at a time is copied, so that memory stays near the size of the text.
    """
    widths = _widths(header)
    per_line, width, length = len(widths), sum(widths), body.find(b"\n") + 1
    full = expected // per_line
    if length <= width or full * length > len(body):
        return None
    cells = np.frombuffer(body, "S1", count=full * length).reshape(full, length)
    ends = cells[:, width:]
    if not ((ends == b"\n") | (ends == b"\r") | (ends == b" ")).all() or not (ends[:, -1] == b"\n").all():
        return None
    numbers = np.empty(expected)
    first = 0
    for i, wide in enumerate(widths):
        field = np.ascontiguousarray(cells[:, first : first + wide]).view(f"S{wide}")[:, 0]
        try:
            numbers[i : full * per_line : per_line] = field.astype(float)
        except ValueError:
            return None
        first += wide
    rest = _numbers(header, body[full * length :], expected - full * per_line, full)
    numbers[full * per_line :] = rest
    return numbers


def _numbers(header: FunctionHeader, body: bytes, expected: int, skipped: int = 0) -> Array:
    """Numbers by the format's columns, or separated by blanks where the columns do not hold numbers."""
    numbers = array("d")
    line = skipped
    for line, raw in enumerate(io.BytesIO(body), start=skipped):
        text = raw.rstrip()
        cells, first = [], 0
        for wide in _widths(header):
            if first < len(text):
                cells.append(text[first : first + wide].strip())
            first += wide
        if len(text) > first or not all(_NUMBER.fullmatch(cell) for cell in cells):
            cells = text.split()
        for cell in cells:
            if not _NUMBER.fullmatch(cell):
                raise LineError(line, str(bad_number(cell.decode("ascii", errors="replace"), "")).removeprefix(": "))
            numbers.append(float(cell))
        if len(numbers) > expected:
            raise LineError(line, _count_message(header, "more numbers"))
    if len(numbers) != expected:
        actual = header.count * header.per_value - expected + len(numbers)
        raise LineError(line, _count_message(header, f"{actual} numbers"))
    return np.frombuffer(numbers, dtype=float) if expected else np.empty(0)


def _count_message(header: FunctionHeader, actual: str) -> str:
    expected = header.count * header.per_value
    return (
        f"found {actual}; expected {expected} for the {header.count} values that the header says; the file "
        "is cut off or its counts are wrong, export it again"
    )
