"""Header of the data set 58 of a universal file, function at nodal DOF, text or binary.

References
----------
Structural Dynamics Research Lab, University of Cincinnati: Universal File Formats, data sets 58 and 58b.
"""

import math
import re
from dataclasses import dataclass

from jointbayes.measurement.records import Dof

#: Ordinate types: real single, real double, complex single, complex double.
_TYPES = (2, 4, 5, 6)
#: No FRF has more values, and no count beyond it is worth a multiplication.
_MOST_VALUES = 10**10


class FieldError(Exception):
    """A field of the header that cannot be read; `line` counts the header's lines from 0."""

    def __init__(self, line: int, message: str) -> None:
        super().__init__(message)
        self.line = line


@dataclass(frozen=True, slots=True)
class Axis:
    """Specific data type (8 displacement, 11 velocity, 12 acceleration, 13 force, 18 frequency, …) and labels."""

    kind: int
    label: str
    unit: str


@dataclass(frozen=True, slots=True)
class FunctionHeader:
    """What stands above the values of a data set 58.

    Parameters
    ----------
    ids
        The five ID lines.
    function
        1 time response, 4 frequency response, 6 coherence and so on.
    version
        Version or sequence number.
    response, reference
        Degrees of freedom.
    ordinate
        2 and 4 real, 5 and 6 complex; 2 and 5 single precision.
    count
        Values, or pairs of abscissa and value.
    even
        True where no abscissa is stored.
    minimum, increment
        Abscissa where `even`.
    abscissa, numerator, denominator
        Axes.
    byte_order
        ``"<"`` or ``">"`` in a binary data set, empty in text.
    said_bytes
        Bytes of values that a binary header announces; some programs write a wrong number.
    """

    ids: tuple[str, ...]
    function: int
    version: int
    response: Dof
    reference: Dof
    ordinate: int
    count: int
    even: bool
    minimum: float
    increment: float
    abscissa: Axis
    numerator: Axis
    denominator: Axis
    byte_order: str = ""
    said_bytes: int = 0

    @property
    def is_complex(self) -> bool:
        """True for complex ordinates."""
        return self.ordinate in (5, 6)

    @property
    def is_double(self) -> bool:
        """True for double precision."""
        return self.ordinate in (4, 6)

    @property
    def per_value(self) -> int:
        """Numbers stored for each value: one or two, and the abscissa where spacing is uneven."""
        return (2 if self.is_complex else 1) + (0 if self.even else 1)


def body_bytes(header: FunctionHeader) -> int:
    """Bytes of the values of a binary data set.

    The abscissa of uneven spacing is stored as wide as the values by most programs, in single precision by the letter
    of the format; the announced number of bytes tells which.
    """
    width = 8 if header.is_double else 4
    full = header.count * header.per_value * width
    narrow = header.count * (4 + (header.per_value - 1) * width)
    return narrow if not header.even and header.said_bytes == narrow else full


def function_header(lines: list[str], binary: str | bytes | None) -> FunctionHeader:
    """Header of a data set 58 from its eleven lines, and the line of the set's number where it is binary.

    Raises
    ------
    FieldError
        If a field is no number or impossible.
    """
    dof = _fields(lines, 5, ((0, 5), (5, 15), (15, 20), (20, 30), (41, 51), (51, 55), (66, 76), (76, 80)))
    form = _fields(lines, 6, ((0, 10), (10, 20), (20, 30)))
    minimum, increment = _real(lines, 6, 30, 43), _real(lines, 6, 43, 56)
    ordinate, count, spacing = form
    if ordinate not in _TYPES:
        raise FieldError(6, f"found ordinate data type {ordinate}; expected 2, 4, 5 or 6; export it again")
    if not 0 < count <= _MOST_VALUES:
        raise FieldError(6, f"found {count} values; expected 1 or more; export the function again")
    if spacing not in (0, 1):
        raise FieldError(6, f"found abscissa spacing {spacing}; expected 0 (uneven) or 1 (even); export it again")
    if spacing == 1 and not (math.isfinite(minimum) and math.isfinite(increment) and increment > 0) and count > 1:
        raise FieldError(6, f"found abscissa increment {increment:g}; expected it above 0; export it again")
    order, said = _binary(binary)
    return FunctionHeader(
        tuple(line.strip() for line in lines[:5]),
        dof[0],
        dof[2],
        Dof(_entity(lines[5][30:41]), dof[4], dof[5]),
        Dof(_entity(lines[5][55:66]), dof[6], dof[7]),
        ordinate,
        count,
        spacing == 1,
        minimum,
        increment,
        _axis(lines, 7),
        _axis(lines, 8),
        _axis(lines, 9),
        order,
        said,
    )


def _fields(lines: list[str], line: int, columns: tuple[tuple[int, int], ...]) -> list[int]:
    text = lines[line].rstrip("\r\n")
    out = []
    for first, last in columns:
        field = text[first:last].strip()
        if not re.fullmatch(r"[+-]?\d*", field):
            raise FieldError(
                line,
                f"found {field!r} in columns {first + 1} to {last}; expected a whole number; the header is damaged, "
                "export it again",
            )
        out.append(int(field) if field.strip("+-") else 0)
    if line == 5 and any(abs(direction) > 6 for direction in (out[5], out[7])):
        raise FieldError(5, f"found directions {out[5]} and {out[7]}; expected -6 to 6; export it again")
    return out


def _real(lines: list[str], line: int, first: int, last: int) -> float:
    field = lines[line].rstrip("\r\n")[first:last].strip()
    if re.fullmatch(r"[+-]?[\d.]+[dD][+-]?\d+", field):
        raise FieldError(
            line, f"found {field!r}, an exponent D; expected E in its place; replace D by E in the numbers"
        )
    try:
        return float(field.replace("_", "?") or "0")
    except ValueError:
        raise FieldError(
            line, f"found {field!r} in columns {first + 1} to {last}; expected a number; export it again"
        ) from None


def _axis(lines: list[str], line: int) -> Axis:
    kind = _fields(lines, line, ((0, 10),))[0]
    text = lines[line].rstrip("\r\n")
    label, unit = (_entity(text[first:last]) for first, last in ((26, 46), (47, 67)))
    return Axis(kind, label, unit)


def _entity(text: str) -> str:
    text = text.strip()
    return "" if text.upper() == "NONE" else text


def _binary(line: str | bytes | None) -> tuple[str, int]:
    if line is None:
        return "", 0
    text = line.decode("ascii", errors="replace") if isinstance(line, bytes) else line
    fields = (text[7:13].strip(), text[13:19].strip(), text[19:31].strip(), text[31:43].strip())
    if not all(re.fullmatch(r"\d*", field) for field in fields):
        raise FieldError(0, f"found {text.strip()[:40]!r} as binary header; expected numbers; export it again")
    order, form, _, said = (int(field or 0) for field in fields)
    if order not in (1, 2) or form not in (0, 2):
        raise FieldError(
            0,
            f"found byte order {order} and floating-point format {form}; expected 1 or 2, and 2 (IEEE 754); export as "
            "IEEE numbers or as text",
        )
    return "<" if order == 1 else ">", said
