"""A table of numbers in text or cells: where its numbers begin, what stands above them, and the numbers themselves."""

import csv
import itertools
import re
from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vibrecords.arrays import Array
from vibrecords.errors import MeasurementError
from vibrecords.formats.columns import FRF_ROLES, axis_role, column_of
from vibrecords.formats.units import parse_unit
from vibrecords.records import MOST_COLUMNS, require_short

_NUMBER = re.compile(r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.IGNORECASE)
#: A complex number as Python, MATLAB and Fortran write it: (1+2j), 1 - 2i, 1e-3+i2, -2j, (1,2).
_PART = r"(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?|nan|inf"
_COMPLEX = re.compile(
    rf"(?<![\w.])(?:[(\[]\s*)?(?:(?P<re>[+-]?(?:{_PART}))\s*(?P<sign>[+-])\s*)?"
    rf"(?:(?P<im>(?(sign)|[+-]?)(?:{_PART}))\*?[ij]|(?(sign)|(?!))[ij]\*?(?P<behind>{_PART}))(?:\s*[)\]])?(?![\w.])"
    rf"|[(\[]\s*(?P<first>[+-]?(?:{_PART}))(?:\s*[,;]\s*|\s+)(?P<second>[+-]?(?:{_PART}))\s*[)\]]",
    re.IGNORECASE,
)
_LONGEST_LINE = 8 * 2**20
_LONGEST_HEADER = 1000
#: Signs that begin a comment.
_COMMENT = ("#", "%", "*", "!")
#: Words that blanks part, each with its unit in brackets.
_NAME = re.compile(r"[^\s\[(]+(?: ?[\[(][^\])]*[\])])?")
Lines = Iterator[tuple[int, str]]


@dataclass(frozen=True, slots=True, eq=False)
class TextTable:
    """Numbers of a table, shape (rows, columns), with its header.

    Parameters
    ----------
    header
        Name and unit of each column, empty strings where there are none.
    comments
        ``key: value`` lines above the numbers, keys in lower case.
    values
        The numbers; NaN where a field is empty at the end of a column, or a whole column is.
    """

    header: tuple[str, ...]
    comments: dict[str, str]
    values: Array


@dataclass(frozen=True, slots=True)
class _TableHead:
    """A line above the numbers, without the sign of a comment."""

    number: int
    text: str
    is_comment: bool = False


def text_lines(path: Path) -> Lines:
    """Lines of a text file with their numbers, without line ends, which may be LF, CR LF or CR.

    UTF-16 where a mark says so, else UTF-8, or Windows' Latin-1 where it is not: numbers are the same in both.

    Raises
    ------
    MeasurementError
        If a line is longer than 8 MiB or holds a NUL byte.
    """
    with path.open("rb") as file:
        wide = file.read(2) in (b"\xff\xfe", b"\xfe\xff")
    encoding, errors = ("utf-16", "replace") if wide else ("utf-8", "surrogateescape")
    with path.open(encoding=encoding, errors=errors) as file:
        number = 0
        while text := file.readline(_LONGEST_LINE):
            number += 1
            if text.strip() == "\x1a":  # which ends a text of DOS
                return
            if len(text) == _LONGEST_LINE:
                raise MeasurementError(
                    f"line {number}: found a line longer than {_LONGEST_LINE >> 20} MiB; expected rows of a table; "
                    "export the file again"
                )
            if "\0" in text:
                raise MeasurementError(f"line {number}: found a NUL byte; expected text; save as plain text in UTF-8")
            if not wide and not text.isascii():
                text = plain_text(text.encode("utf-8", "surrogateescape"))
            yield number, text.removeprefix("\ufeff" if number == 1 else "").rstrip("\n")


def plain_text(raw: bytes) -> str:
    """Text in UTF-8, or in Latin-1 where it is not."""
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def bad_number(field: str, where: str) -> MeasurementError:
    """Error for a field that is not a number, with its cause where it is a known one."""
    shown = field.strip()[:30]
    fault = f"{shown!r}; expected a number; correct the file or export it again"
    if re.fullmatch(r"[+-]?[\d.,]+[dDqQ][+-]?\d+", shown):
        letter = shown.strip("+-.,0123456789")[:1]
        fault = f"{shown!r}, an exponent of Fortran's; expected E in its place; replace {letter} by E in the numbers"
    elif not shown:
        fault = "an empty field; expected a number; export the file again"
    elif re.fullmatch(r"[+-]?\d{1,3}([ .,'\u00a0\u2019]\d{3})+([.,]\d*)?", shown):
        fault = f"{shown!r}; expected a number without separators of thousands; export the file again"
    return MeasurementError(f"{where}: found {fault}")


def float_of(text: str) -> float | None:
    """Number of a text with a decimal point; None where it is none."""
    return float(text) if _NUMBER.fullmatch(text) and "," not in text else None


def read_text_table(lines: Lines) -> TextTable:
    """Read a table; delimiter (tab, semicolon, comma, blanks) and decimal sign from its first row of numbers.

    Raises
    ------
    MeasurementError
        If there is no row of numbers, a row has another number of fields, or a field is not a number.
    """
    comments: dict[str, str] = {}
    complex_at: dict[tuple[int, ...], int] = {}
    apart = _split_complex(lines, complex_at)
    head, first, delimiter = _head(apart, comments)
    pairs = next((columns for columns, number in complex_at.items() if number >= first[0][0]), ())
    lines = apart if pairs else lines
    count = len(_fields(first[0][1], delimiter))
    if head and first[0][1].rstrip(" ").endswith(delimiter) and len(_fields(head[-1].text, delimiter)) == count + 1:
        count += 1  # the last column begins empty
    if count > MOST_COLUMNS:
        raise MeasurementError(
            f"line {first[0][0]}: found {count} columns; expected at most {MOST_COLUMNS}; split the file"
        )
    if head and (halves := _numbers_and_words(head[-1].text, delimiter, count)):
        first.insert(0, (head[-1].number, halves[0]))
        header = halves[1]
    else:
        header = _header(head, delimiter, count - len(pairs), comments)
    values, gaps = read_rows(_split_rows(itertools.chain(first, lines), delimiter, count), count)
    if gaps:
        raise bad_number("", f"line {min(gaps.values())}")
    if delimiter == "," and not any(header) and count > 2 and (values == np.rint(values)).all():
        raise MeasurementError(
            f"line {first[0][0]}: found {count} columns of whole numbers without names; expected to know whether the "
            "comma parts columns or is the decimal sign; name the columns in a first line, or part them by semicolons"
        )
    if pairs:
        others = [number for columns, number in complex_at.items() if number >= first[0][0] and columns != pairs]
        if others or (0 in pairs and (values[:, 1] != 0).any()):
            raise MeasurementError(
                f"line {max(others, default=first[0][0])}: found complex numbers in the first column or changing ones; "
                "expected a frequency, then complex FRFs in the same columns throughout; export it again"
            )
        names = [name or f"output {i} / input 1" if i in pairs and i else name for i, name in enumerate(header)]
        parts = (("real ", "imaginary ") if i in pairs and i else ("",) for i in range(len(names)))
        header = tuple(part + name for name, of_name in zip(names, parts, strict=True) for part in of_name)
        values = np.delete(values, 1, axis=1) if 0 in pairs else values
    return TextTable(header, comments, values)


def _split_complex(lines: Lines, found: dict[tuple[int, ...], int]) -> Lines:
    """Lines in which a complex number is two numbers; in `found` columns of such, and the last line that has them."""
    for number, line in lines:
        if any(sign in line for sign in "ijIJ([") and line.lstrip()[:1] not in _COMMENT:
            marked = _COMPLEX.sub("j", line)
            delimiter = next((sign for sign in "\t;," if sign in marked), " ")
            parted = _COMPLEX.sub(_two_numbers, line).replace("\0", delimiter)
            if parted != line and _delimiter(parted) == delimiter:
                cells = _fields(marked, delimiter)
                found[tuple(i for i, cell in enumerate(cells) if cell.strip() == "j")] = number
                line = parted
        yield number, line


def _two_numbers(match: re.Match[str]) -> str:
    """Real and imaginary part of a complex number, with a NUL between."""
    imaginary = match["second"] or (match["sign"] or "") + (match["im"] or match["behind"])
    return f"{match['first'] or match['re'] or '0'}\0{imaginary}"


def _head(lines: Lines, comments: dict[str, str]) -> tuple[list[_TableHead], list[tuple[int, str]], str]:
    """Lines above the numbers, the first two rows of numbers (or one), and the delimiter."""
    head: list[_TableHead] = []
    row: tuple[int, str] | None = None
    delimiter: str | None = None
    for number, line in lines:
        if not line.strip():
            continue
        if line.lstrip().startswith(_COMMENT):
            text = line.lstrip("".join(_COMMENT) + " \t")
            key, colon, value = text.partition(":")
            if colon and re.fullmatch(r"[\w .-]{1,60}", key):
                comments[key.strip().lower()] = value.strip()
            elif row is None:
                head.append(_TableHead(number, text, is_comment=True))
            continue
        if row is not None and delimiter is not None:
            fields = [field for field in _fields(line, delimiter) if field.strip()]
            if len(fields) < 2 or any(_NUMBER.fullmatch(field.strip()) for field in fields):
                return head, [row, (number, line)], delimiter
            head.append(_TableHead(*row))  # numbers above the names of columns
        delimiter = _delimiter(line)
        row = None if delimiter is None else (number, line)
        if row is None:
            head.append(_TableHead(number, line))
        if len(head) > _LONGEST_HEADER:
            raise MeasurementError(f"line {number}: found no row of numbers so far; expected a table; correct the file")
    if row is None or delimiter is None:
        raise MeasurementError(
            f"line {head[-1].number if head else 1}: found no row of two numbers or more in the file; expected a table "
            "of frequency, real and imaginary part; export the FRF as text"
        )
    return head, [row], delimiter


def _delimiter(line: str) -> str | None:
    """Delimiter under which the fields of the line are numbers, two or more, or empty; or None."""
    for delimiter in ("\t", ";", ",", " "):
        fields = [field.strip() for field in _fields(line, delimiter)]
        numbers = [field for field in fields if field]
        decimal_comma_clash = delimiter == "," and any("," in field for field in fields)
        if len(numbers) > 1 and not decimal_comma_clash and all(_NUMBER.fullmatch(f) for f in numbers):
            return delimiter
    return None


def _fields(line: str, delimiter: str) -> list[str]:
    line = line.replace('"', "")
    fields = line.split() if delimiter == " " else line.split(delimiter)
    # a delimiter at the end of each row is common, and stands for nothing
    return fields[:-1] if len(fields) > 1 and not fields[-1].strip() else fields


def _numbers_and_words(text: str, delimiter: str, count: int) -> tuple[str, tuple[str, ...]] | None:
    """The first row of a CutPro file, behind whose numbers name and unit of each column stand."""
    fields = [field.strip() for field in _fields(text, delimiter)]
    words = fields[count:]
    if len(words) != 2 * count or not all(_NUMBER.fullmatch(f) for f in fields[:count]):
        return None
    units = ["" if column_of(unit).role in FRF_ROLES else unit for unit in words[1::2]]
    return delimiter.join(fields[:count]), tuple(map(_with_unit, words[::2], units))


def _with_unit(name: str, unit: str) -> str:
    inner = re.fullmatch(r"[\[(]([^\[\]()]*)[\])]", unit)
    return f"{name} [{inner[1] if inner else unit}]" if unit else name


def _header(head: list[_TableHead], delimiter: str, count: int, comments: dict[str, str]) -> tuple[str, ...]:
    """Name and unit of each column; pairs of a key and a value above them go to the comments."""
    rows: list[tuple[int, list[str]]] = []
    for entry in head:
        cells = _cells(entry, delimiter, count)
        broken = next((cell for cell in cells if not _NUMBER.fullmatch(cell)), None)
        if broken is None and entry.is_comment:
            continue  # a row that was taken out
        if broken is not None and entry is head[-1] and len(cells) == count and _NUMBER.fullmatch(cells[0]):
            raise bad_number(broken, f"line {entry.number}")
        pair = cells if len(cells) > 1 else re.split(r"\s*[:=]\s*", cells[0], maxsplit=1)
        if len(cells) > 1:
            rows.append((entry.number, cells))
        if 1 < len(pair) < 4 and (pair[1].isdecimal() or pair[0].lower() != "averages"):
            comments.setdefault(pair[0].strip(" :=").lower(), pair[1].strip())
    units = [""] * count
    if len(rows) > 1 and rows[-2][1][-1].lower() == "increment":  # of Rigol's
        *units, comments["start"], comments["increment"] = rows.pop()[1]
        units = ["", *units[1:], *[""] * count][:count]
        rows[-1] = (rows[-1][0], [*rows[-1][1][:-2], *[""] * count][:count])
    elif rows and _are_units(rows[-1][1], rows[:-1], count):
        units = [*rows.pop()[1], *units][:count]
    if not rows:
        return tuple(_with_unit("", unit) for unit in units)
    number, names = rows[-1]
    if len(names) != count:
        roles = [column_of(name).role for name in names if name]
        if (len(names) > 2 and set(roles) != {"other"}) or (roles[:1] in (["frequency"], ["time"]) and roles[1:]):
            comma = ", and commas that are no decimal signs" if delimiter == "," and len(names) < count else ""
            raise MeasurementError(
                f"line {number}: found {len(names)} names above {count} columns of numbers; expected one for each "
                f"column{comma}; correct the header"
            )
        names = [""] * count
    elif count == 2 and not any(units) and _NUMBER.fullmatch(names[1]):
        names = [""] * count  # a key and its value
    require_short(f"line {number}", *names, *units)
    above = rows[-2][1] if len(rows) > 1 and column_of(names[0]).role in ("frequency", "time") else []
    if above and not above[0] and len(above) <= count:  # the signals, each above the first of its columns
        signal = ""
        for i, cell in enumerate([*above, *[""] * count][:count]):
            signal = cell or signal
            names[i] = f"{signal} {names[i]}".strip()
    return tuple(map(_with_unit, names, units))


def _are_units(cells: list[str], above: list[tuple[int, list[str]]], count: int) -> bool:
    """Whether a row above the numbers holds units: those of an axis first, and below names or with known ones only."""
    first = next((i for i, cell in enumerate(cells) if cell), 0)
    if not 0 < len(cells) <= count or axis_role(cells[first]) is None:
        return False
    names = above[-1][1] if above else []
    named = len(names) == count and column_of(names[first]).role in ("frequency", "time")
    known = all(not cell or parse_unit(cell.strip("[]()")) is not None for cell in cells[first + 1 :])
    others = (column_of(cell).role in ("other", "spectrum") for cell in cells[first + 1 :])
    return known or (named and all(others))


def _cells(line: _TableHead, delimiter: str, count: int) -> list[str]:
    """Cells of a line above the numbers; blanks part them as well as they may."""
    try:
        if delimiter != " ":
            cells = next(csv.reader([line.text], delimiter=delimiter, skipinitialspace=True), [])
        else:
            splits = (line.text.split(), re.split(r"\s{2,}|[\t;,]", line.text.strip()), _NAME.findall(line.text))
            cells = next((split for split in splits if len(split) == count), splits[0])
    except csv.Error as error:
        raise MeasurementError(
            f"line {line.number}: found a header that cannot be read ({error}); expected a name for each column; "
            "correct the header or save the file again"
        ) from None
    cells = [cell.strip() for cell in cells]
    while len(cells) > max(count, 1) and not cells[-1]:
        cells.pop()
    return cells


def _split_rows(lines: Iterable[tuple[int, str]], delimiter: str, count: int) -> Iterator[tuple[int, list[str]]]:
    """Rows of numbers in fields, with a decimal point."""
    comma = point = False
    for number, line in lines:
        if not line.strip() or line.lstrip().startswith(_COMMENT):
            continue
        if delimiter != ",":
            comma, point = comma or "," in line, point or "." in line
            if comma and point:
                raise MeasurementError(
                    f"line {number}: found {line.strip()[:40]!r}, points and commas in one table's numbers; expected "
                    "one decimal sign and no separators of thousands; export the file again"
                )
            line = line.replace(",", ".") if comma else line
        if '"' in line:
            line = line.replace('"', "")
        fields = line.split() if delimiter == " " else line.split(delimiter)
        if len(fields) == count + 1 and not fields[-1].strip():
            fields.pop()
        yield number, fields


def read_rows(rows: Iterable[tuple[int, list[str]]], count: int) -> tuple[Array, dict[int, int]]:
    """All rows as one array, NaN for empty fields; and by column the line of an empty field that numbers follow.

    Text is not kept, so that memory stays below the file's size.

    Raises
    ------
    MeasurementError
        If a row has another number of fields, or a field is neither empty nor a number.
    """
    numbers = array("d")
    empty: dict[int, int] = {}
    gaps: dict[int, int] = {}
    for number, fields in rows:
        if len(fields) != count:
            raise MeasurementError(
                f"line {number}: found {len(fields)} fields; expected {count} as in the rows before; "
                "the file is cut off or damaged, export it again"
            )
        try:
            numbers.extend(list(map(float, fields)))
        except ValueError:
            for i, field in enumerate(fields):
                if not field.strip():
                    empty.setdefault(i, number)
                elif "," in field or not _NUMBER.fullmatch(field.strip()):
                    raise bad_number(field, f"line {number}") from None
            numbers.extend(float(field.strip() or "nan") for field in fields)
        if "_" in "".join(fields):  # Python's own spelling of long numbers
            raise bad_number(next(f for f in fields if "_" in f), f"line {number}")
        if empty:
            gaps.update({i: line for i, line in empty.items() if i not in gaps and fields[i].strip()})
    return np.frombuffer(numbers, dtype=float).reshape(-1, count), gaps
