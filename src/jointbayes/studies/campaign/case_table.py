"""The cases of a campaign: rows of a table over a base case, or case files."""

import csv
import datetime
import hashlib
import io
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from glob import glob
from pathlib import Path
from typing import Any

from jointbayes.case.case_text import CaseText, find_outside, read_case_text
from jointbayes.case.parse import parse_case
from jointbayes.case.spec.fields import named_files
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.case.toml_text import key_parts, printable, similar, toml_text
from jointbayes.errors import CaseError
from jointbayes.studies.campaign.index import date_of
from vibrecords.errors import path_fault


@dataclass(frozen=True, eq=False)
class BaseCase:
    """The case over which rows of a table are laid.

    Parameters
    ----------
    path
        Its file; data files are looked for beside it.
    source
        Its text, with that of what it builds on.
    """

    path: Path
    source: CaseText

    def overridden(self, cells: Mapping[str, str], where: str) -> tuple[dict[str, Any], CaseSpec]:
        """The tables of the case with other values for some keys, and the same checked.

        A value is what TOML makes of a cell, ``0.5``, ``true`` or ``["11:y"]``; what is no TOML, and what the key wants
        as text, is text: names of files need no quotes. An empty cell leaves the base's value.

        Parameters
        ----------
        cells
            Cell of the table by dotted key.
        where
            Table and row, for messages.

        Raises
        ------
        CaseError
            One line for each fault, with the row and the column, or the line of the base.
        """
        given = {key: cell.strip() for key, cell in cells.items() if cell.strip()}
        values = {key: _parsed(cell) for key, cell in given.items()}
        data, spec, faults = self._judged(values, where)
        if spec is None:
            # a serial number as a title, say, is no number
            texts = {k: cell for k, cell in given.items() if any(f": {k}: " in fault for fault in faults)}
            data, spec, _ = self._judged(values | texts, where)
        if spec is None:
            raise CaseError("\n".join(self._placed(fault, given, where) for fault in faults))
        return data, spec

    def _judged(self, values: Mapping[str, Any], where: str) -> tuple[dict[str, Any], CaseSpec | None, list[str]]:
        data = dict(self.source.data)
        for key, value in values.items():
            _set(data, key, value, where)
        try:
            return data, parse_case(CaseText(str(self.path), "", data, self.source.places)), []
        except CaseError as error:
            return data, None, str(error).splitlines()

    def _placed(self, fault: str, given: Mapping[str, str], where: str) -> str:
        """A fault with the row in place of the base's line, where the row gives that key."""
        files = {printable(file) for file in (str(self.path), *(file for file, _ in self.source.places.values()))}
        file = max((file for file in files if fault.startswith(f"{file}:")), key=len, default=None)
        if file is None:
            return f"{where}: {fault}"
        line, _, rest = fault.removeprefix(f"{file}:").partition(": ")
        key, _, words = rest.partition(": ")
        if any(key == column or key.startswith(f"{column}.") for column in given):
            return f"{where}: {rest}"
        return f"{where}: {key}, {file}:{line}: {words}"


def _parsed(cell: str) -> Any:  # noqa: ANN401 (whatever TOML knows)
    try:
        parsed = tomllib.loads(f"value = {cell}")
    except (ValueError, RecursionError):
        return cell
    return parsed["value"] if parsed.keys() == {"value"} else cell


def _set(data: dict[str, Any], key: str, value: object, where: str) -> None:
    parts = key_parts(key)
    if not parts:
        raise CaseError(
            f"{where}: column {key!r}: found no key of a case file; expected one such as structure.length_mm, or key, "
            "serial, date or case; correct the first line of the table"
        )
    *above, last = parts
    table = data
    for name in above:
        below = table.get(name, {})
        table[name] = table = dict(below) if isinstance(below, dict) else below  # the base keeps its own
        if not isinstance(table, dict):
            raise CaseError(
                f"{where}: {key}: found that {name} is no table in the base case; expected one that holds {last}; "
                "correct the column's name"
            )
    table[last] = value


@lru_cache(maxsize=1000)
def read_base(path: Path, allow_outside: bool = False) -> BaseCase:
    """Read a base case; each file once.

    What it builds on must lie in its directory or below unless `allow_outside`.

    Raises
    ------
    CaseError
        If it cannot be read or is no TOML; whether it is a case is seen with the row.
    """
    return BaseCase(path, read_case_text(path, allow_outside))


_MEANT = {"name": "key", "id": "key"}
_OWN = ("key", "serial", "date", "case")  # columns that are no keys of a case file
_MOST_BYTES, _MOST_CASES = 100_000_000, 200_000
_MOST_FAULTS = 20
_NAME = re.compile(r"\w[\w .+-]*", re.ASCII)  # of a file, on every system
_LONGEST = 80


@dataclass(frozen=True, slots=True)
class CampaignCase:
    """One case of a campaign.

    Parameters
    ----------
    key
        By which it is known; the name of its file.
    order
        Its place in the table, from 0.
    where
        Table and row, or the case file, for messages.
    path
        Case file, or base case.
    cells
        What the table puts in place of the base's values, by dotted key; None of a case file.
    serial, date
        As the table has them.
    allow_outside
        Whether a case may build on files outside its directory.
    """

    key: str
    order: int
    where: str
    path: Path
    cells: Mapping[str, str] | None = None
    serial: str | None = None
    date: datetime.datetime | None = None
    allow_outside: bool = False

    def read(self) -> tuple[str, CaseSpec]:
        """Text of the case, and the same checked.

        Raises
        ------
        CaseError
            If it is no case.
        """
        if self.cells is None:
            source = read_case_text(self.path, self.allow_outside)
            return source.text, parse_case(source)
        data, spec = read_base(self.path, self.allow_outside).overridden(self.cells, self.where)
        return toml_text(data), spec

    def files(self, spec: CaseSpec) -> tuple[Path, ...]:
        """Files that it names: of measurements, measured bodies and matrices."""
        return tuple(self.path.parent / name for names in _named_files(spec).values() for name in names)

    def require_inside(self, spec: CaseSpec) -> None:
        """Refuse files outside the directory of the case file, or of the base case."""
        for key, names in _named_files(spec).items():
            if (outside := find_outside(self.path.parent, names)) is not None:
                found, expected, remedy = outside[1]
                raise CaseError(f"{self.where}: {'.'.join(key)}: {found}; expected {expected}; {remedy}")

    @staticmethod
    def fingerprint(text: str, files: Sequence[Path], *of_run: object) -> str:
        """Digest of what a result depends on: the case, its data, and what the run adds."""
        digest = hashlib.sha256(repr((text, *of_run)).encode())
        for file in files:
            try:
                with file.open("rb") as stream:
                    digest.update(hashlib.file_digest(stream, "sha256").digest())
            except OSError as error:
                digest.update(type(error).__name__.encode())
        return digest.hexdigest()


def _named_files(spec: CaseSpec) -> dict[tuple[str, ...], tuple[str, ...]]:
    """Names of files that a case and its set-ups state, by key."""
    tables = spec.model_dump()
    names = named_files(tables)
    for setup, changed in tables["setups"].items():
        names |= {("setups", setup, *key): files for key, files in named_files(changed).items()}
    return names


def read_cases(
    sources: Sequence[str | Path], base: str | Path | None = None, allow_outside: bool = False
) -> tuple[CampaignCase, ...]:
    """Read what the cases of a campaign are, and check each as far as its text goes.

    Parameters
    ----------
    sources
        One table in CSV, or case files, whose names may hold ``*``, ``?`` and ``[…]``.
    base
        Base case of a table without a column `case`.
    allow_outside
        Whether files that a case names may lie outside the directory of their case, or of the base case.

    Raises
    ------
    CaseError
        If a table or a case is wrong: one line for each fault, with row and column; or if two cases share a key.
    """
    paths = [Path(source) for source in sources]
    tables = [path for path in paths if path.suffix.lower() in (".csv", ".tsv", ".txt")]
    if tables and len(paths) > 1:
        raise CaseError(f"{tables[0]}: found a table and {len(paths) - 1} more; expected one table, or case files")
    if not tables and base is not None:
        raise CaseError(f"{base}: found a base case with case files; expected it with a table; give a table in CSV")
    listed = _rows(tables[0], base) if tables else _case_files(sources)
    cases = tuple(replace(case, allow_outside=allow_outside) for case in listed)
    _require_own_keys(cases)
    faults: list[str] = []
    for case in cases:
        try:
            _, spec = case.read()
            if not allow_outside:
                case.require_inside(spec)
        except CaseError as error:
            faults += str(error).splitlines()
            if len(faults) > _MOST_FAULTS:
                faults[_MOST_FAULTS:] = ["there are more faults; these are the first"]
                break
    if faults:
        raise CaseError("\n".join(faults))
    return cases


def _case_files(sources: Sequence[str | Path]) -> Iterator[CampaignCase]:
    files: list[Path] = []
    for source in sources:
        matches = sorted(glob(str(source), recursive=True)) if not Path(source).exists() else [str(source)]
        if not matches:
            raise CaseError(f"{source}: found no such file; expected a table in CSV or case files; check the path")
        files += map(Path, matches)
    for order, path in enumerate(files):
        yield CampaignCase(_key(path.stem, str(path)), order, str(path), path)


def _rows(table: Path, base: str | Path | None) -> Iterator[CampaignCase]:
    rows = _cells(table)
    head = [name.strip() for name in next(rows, (0, []))[1]]
    _require_columns(head, table, base)
    order = 0
    for number, cells in rows:
        where = f"{table}:{number}"
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(head):
            raise CaseError(
                f"{where}: found {len(cells)} cells; expected {len(head)}, one for each column; correct the row, and "
                "put cells with a separator in them into quotes"
            )
        if order == _MOST_CASES:
            raise CaseError(f"{where}: found more than {_MOST_CASES} cases; expected fewer; make several campaigns")
        row = dict(zip(head, (cell.strip() for cell in cells), strict=True))
        campaign_cells = {name: row.pop(name, "") for name in _OWN}
        if not campaign_cells["case"] and base is None:
            raise CaseError(f"{where}: case: found no base case; expected a case file; fill the cell or give --base")
        path = table.parent / campaign_cells["case"] if campaign_cells["case"] else Path(base or "")
        key = campaign_cells["key"] or campaign_cells["serial"] or f"{order + 1:05d}"
        date = _date(campaign_cells["date"], where) if campaign_cells["date"] else None
        yield CampaignCase(_key(key, where), order, where, path, row, campaign_cells["serial"] or None, date)
        order += 1
    if order == 0:
        raise CaseError(f"{table}:1: found no row; expected one for each case below the names of the columns")


def _cells(table: Path) -> Iterator[tuple[int, list[str]]]:
    """Rows of cells with the line on which each begins."""
    try:
        if table.stat().st_size > _MOST_BYTES:
            raise CaseError(
                f"{table}: found more than {_MOST_BYTES / 1e6:.0f} MB; expected a table of cases; divide it"
            )
        text = table.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise CaseError(f"{table}:{line}: found no UTF-8 text; expected a table in CSV; save it as UTF-8") from None
    except (OSError, ValueError) as error:
        reason = path_fault(error)
        raise CaseError(f"{table}: found that it cannot be read ({reason}); expected a table in CSV") from None
    first = text.split("\n", 1)[0]
    separator = max(",;\t", key=first.count)
    reader, number = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True), 1
    try:
        for cells in reader:
            yield number, cells
            number = reader.line_num + 1
    except csv.Error as error:
        raise CaseError(f"{table}:{number}: found no CSV ({error}); expected cells in rows; correct it") from None


def _require_columns(head: list[str], table: Path, base: str | Path | None) -> None:
    twice = next((name for name in head if head.count(name) > 1), None)
    if twice is not None or "" in head or not head:
        actual = "a column without a name" if "" in head or not head else f"two columns {twice!r}"
        raise CaseError(f"{table}:1: found {actual}; expected a name of its own for each; correct the first line")
    for name in (name for name in head if name not in _OWN and "." not in name):
        near = _MEANT.get(name.lower()) or similar(name, _OWN)
        if near and name not in CaseSpec.model_fields:
            raise CaseError(
                f"{table}:1: {name}: found no such column; expected a key of a case; did you mean {near!r}?"
            )
    if base is None and "case" not in head:
        raise CaseError(
            f"{table}:1: found no base case; expected a column `case`, or --base; give the case that the rows change"
        )


def _key(key: str, where: str) -> str:
    if len(key) > _LONGEST or not _NAME.fullmatch(key) or key.endswith((".", " ")):
        shown = ascii(key[:_LONGEST])
        raise CaseError(
            f"{where}: key: found {shown}; expected a name for a file of at most {_LONGEST} letters, digits, points, "
            "signs and spaces that begins with a letter or digit; give the case such a key"
        )
    return key


def _date(text: str, where: str) -> datetime.datetime:
    try:
        return date_of(text)
    except ValueError:
        raise CaseError(
            f"{where}: date: found {text[:_LONGEST]!a}; expected a date such as 2026-03-31 or 2026-03-31 14:05; "
            "correct it"
        ) from None


def _require_own_keys(cases: Sequence[CampaignCase]) -> None:
    case_by_key: dict[str, CampaignCase] = {}
    for case in cases:
        other = case_by_key.setdefault(case.key.casefold(), case)  # some systems take A and a for one name
        if other is not case:
            raise CaseError(
                f"{case.where}: key: found {case.key!r}, which {other.where} has already; expected a key of its own "
                "for each case; change one of them"
            )
