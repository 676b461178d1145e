"""A table of numbers in a text file: where its numbers begin, how they are separated, and the numbers themselves."""

import csv
import itertools
import re
from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError
from jointbayes.measurement.records import MOST_COLUMNS, require_short

_NUMBER = re.compile(r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.IGNORECASE)
_LONGEST_LINE = 8 * 2**20
_LONGEST_HEADER = 1000


@dataclass(frozen=True, slots=True, eq=False)
class TextTable:
    """Numbers of a table, shape (rows, columns), with its header.

    Parameters
    ----------
    header
        Fields of the last line before the numbers, empty strings where there is none; one for each column.
    comments
        ``key: value`` lines that begin with ``#`` or ``%``, keys in lower case.
    values
        The numbers.
    first_line
        Line of the file of the first row, counted from 1.
    """

    header: tuple[str, ...]
    comments: dict[str, str]
    values: Array
    first_line: int


@dataclass(frozen=True, slots=True)
class _TableHead:
    """A line above the numbers, without the sign of a comment."""

    number: int
    text: str
    is_comment: bool = False


def text_lines(path: Path) -> Iterator[tuple[int, str]]:
    """Lines of a text file with their numbers, without line ends.

    UTF-8, or Windows' Latin-1 where it is not: numbers are the same in both.

    Raises
    ------
    MeasurementError
        If a line is longer than 8 MiB or holds a NUL byte.
    """
    with path.open("rb") as file:
        number = 0
        while raw := file.readline(_LONGEST_LINE):
            number += 1
            if len(raw) == _LONGEST_LINE:
                raise MeasurementError(
                    f"line {number}: found a line longer than {_LONGEST_LINE >> 20} MiB; expected rows of a table; "
                    "export the file again"
                )
            if b"\0" in raw:
                raise MeasurementError(
                    f"line {number}: found a NUL byte; expected text; save as plain text in UTF-8 (not UTF-16)"
                )
            yield number, plain_text(raw).removeprefix("\ufeff" if number == 1 else "").rstrip("\r\n")


def plain_text(raw: bytes) -> str:
    """Text in UTF-8, or in Latin-1 where it is not."""
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def bad_number(field: str, where: str) -> MeasurementError:
    """Error for a field that is not a number, with its cause where it is a known one."""
    shown = field.strip()[:30]
    if re.fullmatch(r"[+-]?[\d.,]+[dDqQ][+-]?\d+", shown):
        return MeasurementError(
            f"{where}: found {shown!r}, an exponent of Fortran's; expected E in its place; replace "
            f"{shown.strip('+-.,0123456789')[:1]} by E in the numbers"
        )
    if not shown:
        return MeasurementError(f"{where}: found an empty field; expected a number; export the file again")
    return MeasurementError(f"{where}: found {shown!r}; expected a number; correct the file or export it again")


def float_of(text: str) -> float | None:
    """Number of a text with a decimal point; None where it is none."""
    return float(text) if _NUMBER.fullmatch(text) and "," not in text else None


def read_text_table(path: Path) -> TextTable:
    """Read a CSV or TSV file; delimiter (tab, semicolon, comma, blanks) and decimal sign from its first row of numbers.

    Raises
    ------
    MeasurementError
        If there is no row of numbers, a row has another number of fields, or a field is not a number.
    """
    lines = text_lines(path)
    head: list[_TableHead] = []
    comments: dict[str, str] = {}
    for number, line in lines:
        if line.lstrip()[:1] in ("#", "%"):
            key, colon, value = line.lstrip("#% \t").partition(":")
            if colon:
                comments[key.strip().lower()] = value.strip()
            else:
                head.append(_TableHead(number, line.lstrip("#% \t"), is_comment=True))
            continue
        if not line.strip():
            continue
        delimiter = _delimiter(line)
        if delimiter is not None:
            break
        head.append(_TableHead(number, line))
        if len(head) > _LONGEST_HEADER:
            raise MeasurementError(f"line {number}: found no row of numbers so far; expected a table; correct the file")
    else:
        raise MeasurementError(
            f"line {head[-1].number if head else 1}: found no row of two numbers or more in the file; expected a table "
            "of frequency, real and imaginary part; export the FRF as text"
        )
    count = len(_fields(line, delimiter))
    if count > MOST_COLUMNS:
        raise MeasurementError(f"line {number}: found {count} columns; expected at most {MOST_COLUMNS}; split the file")
    header = _header(head, delimiter, count)
    rows = itertools.chain([(number, line)], lines)
    return TextTable(header, comments, _rows(rows, delimiter, count), number)


def _delimiter(line: str) -> str | None:
    """Delimiter under which all fields of the line are numbers, or None."""
    for delimiter in ("\t", ";", ",", " "):
        fields = _fields(line, delimiter)
        decimal_comma_clash = delimiter == "," and any("," in field for field in fields)
        if len(fields) > 1 and not decimal_comma_clash and all(_NUMBER.fullmatch(f.strip()) for f in fields):
            return delimiter
    return None


def _fields(line: str, delimiter: str) -> list[str]:
    fields = line.split() if delimiter == " " else line.split(delimiter)
    # a delimiter at the end of each row is common, and stands for nothing
    return fields[:-1] if len(fields) > 1 and not fields[-1].strip() else fields


def _header(head: list[_TableHead], delimiter: str, count: int) -> tuple[str, ...]:
    names: _TableHead | None = None
    for entry in head:
        fields = _fields(entry.text, delimiter)
        broken = next((f for f in fields if not _NUMBER.fullmatch(f.strip())), None)
        if broken is None and entry.is_comment:
            continue  # a row that somebody has taken out
        if broken is not None and len(fields) == count and _NUMBER.fullmatch(fields[0].strip()):
            raise bad_number(broken, f"line {entry.number}")
        names = entry
    return ("",) * count if names is None else _names(names, delimiter, count)


def _names(line: _TableHead, delimiter: str, count: int) -> tuple[str, ...]:
    where = f"line {line.number}"
    try:
        names = line.text.split() if delimiter == " " else next(csv.reader([line.text], delimiter=delimiter))
    except csv.Error as error:
        raise MeasurementError(
            f"{where}: found a header that cannot be read ({error}); expected a name for each column, and lines that "
            "end in LF or CR LF; correct the header or save the file again"
        ) from None
    if len(names) == count + 1 and not names[-1].strip():
        names = names[:-1]
    if len(names) != count:
        raise MeasurementError(
            f"{where}: found {len(names)} names above {count} columns of numbers; expected one for each column; "
            "correct the header"
        )
    require_short(where, *names)
    return tuple(name.strip() for name in names)


def _rows(lines: Iterable[tuple[int, str]], delimiter: str, count: int) -> Array:
    """All rows from the first one on, as one array; text is not kept, so that memory stays below the file's size."""
    comma = delimiter != ","
    numbers = array("d")
    for number, line in lines:
        if not line.strip() or line.lstrip()[0] in "#%":
            continue
        fields = _fields(line.replace(",", ".") if comma else line, delimiter)
        if len(fields) != count:
            raise MeasurementError(
                f"line {number}: found {len(fields)} fields; expected {count} as in the rows before; "
                "the file is cut off or damaged, export it again"
            )
        try:
            numbers.extend(map(float, fields))
        except ValueError:
            broken = next(f for f in fields if not _NUMBER.fullmatch(f.strip()))
            raise bad_number(broken, f"line {number}") from None
        if "_" in line:  # Python's own spelling of long numbers, nobody's else
            raise bad_number(next(f for f in fields if "_" in f), f"line {number}")
    return np.frombuffer(numbers, dtype=float).reshape(-1, count)
