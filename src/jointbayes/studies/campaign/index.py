"""The directory of a campaign: one row a case in a file of JSON lines, and one posterior file a case.

A row is on the disk as soon as its case is: appended to the lines, which costs the same for the first case and the
last. At the end the index is written anew, whole, in the order of the table.
"""

import datetime
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from jointbayes.errors import MeasurementError
from jointbayes.rounding import engineering
from jointbayes.studies.study_directory import read_lines
from vibrecords.files import OwnDirectory, write_whole_file

#: File of the rows.
INDEX = "index.jsonl"
DONE, FAILED, KILLED = "done", "failed", "killed its worker"

#: Columns that an index has whatever its cases are.
COLUMNS = (
    "key", "file", "status", "attempts", "error", "serial", "date", "order", "seed", "converged", "reason", "seconds",
    "explains", "misfit_p_value", "fingerprint", "code",
)  # fmt: skip
_EXPECTED = "expected the index that `jointbayes campaign` writes"

Row = dict[str, Any]


def campaign_directory(directory: str | os.PathLike[str]) -> OwnDirectory:
    """The directory of a campaign, new or of an earlier start; entered, it keeps other processes out."""
    return OwnDirectory(directory, "a campaign")


def write_index(directory: Path, rows: Iterable[Row]) -> None:
    """Write an index anew, whole, its rows in the order of the campaign's table.

    Raises
    ------
    WriteError
        If it cannot be written.
    """
    lines = [json.dumps(row, default=datetime.datetime.isoformat) + "\n" for row in sorted(rows, key=_order)]
    write_whole_file(directory / INDEX, "".join(lines).encode())


def _order(row: Row) -> int:
    return int(row["order"])


def kept_rows(directory: Path) -> dict[str, Row]:
    """Rows of an earlier start of a campaign by key, without one that was cut off; none where there was none.

    Raises
    ------
    MeasurementError
        If the index cannot be read.
    """
    file = directory / INDEX
    lines = read_lines(file)
    rows = [row for row in lines if isinstance(row, dict) and {"key", "status", "order"} <= row.keys()]
    if not rows and any(line is not None for line in lines):
        raise MeasurementError(
            f"{file}: found no index of a campaign in it; {_EXPECTED}; give another directory, or remove the file, "
            "and all cases are done again"
        )
    return {str(row["key"]): row for row in rows}


@dataclass(frozen=True, slots=True)
class Estimate:
    """What the index says of one stiffness: all as printed in the case's own report, in its unit.

    Parameters
    ----------
    unit, median, verdict
        As in the index.
    low95, high95
        Ends of the 95 % interval, each the more cautious of draws and likelihood.
    limit95
        One-sided limit of a stiffness that is bounded.
    words
        The verdict with what it takes as exact; empty in an index of an older version.
    """

    unit: str
    median: float
    low95: float
    high95: float
    verdict: str
    limit95: float | None = None
    words: str = ""

    @property
    def row(self) -> tuple[str, str, str]:
        """Median, interval or limit, and unit, with one prefix."""
        one_sided = {"bounded below": ("above", self.low95), "bounded above": ("below", self.high95)}
        if self.verdict in one_sided:
            side, end = one_sided[self.verdict]
            (limit,), unit = engineering((end if self.limit95 is None else self.limit95,), self.unit)
            return "–", f"{side} {limit}", unit
        (median, low, high), unit = engineering((self.median, self.low95, self.high95), self.unit)
        return median, f"{low} to {high}", unit


@dataclass(frozen=True, slots=True)
class CaseRow:
    """What the index says of one case.

    Parameters
    ----------
    key, file, status, attempts, error, serial, date, order, converged, reason, explains
        As in the index; None where it says nothing.
    verdicts
        Verdict on each stiffness by name; empty unless the case is done.
    stiffness
        Estimate of each stiffness by name, where the index has its numbers.
    """

    key: str
    status: str
    order: int
    verdicts: Mapping[str, str]
    stiffness: Mapping[str, Estimate]
    file: str = ""
    attempts: int = 0
    error: str = ""
    serial: str | None = None
    date: datetime.datetime | None = None
    converged: bool = False
    reason: str = ""
    explains: bool | None = None

    @property
    def label(self) -> str:
        """Serial number of the joint, or the key of its case."""
        return self.serial or self.key


_CASE_ROW = TypeAdapter(CaseRow)
_ESTIMATE = tuple(each.name for each in fields(Estimate))
_NEEDED = {"unit", "median", "low95", "high95", "verdict"}


def read_index(directory: str | os.PathLike[str]) -> tuple[CaseRow, ...]:
    """Read the index of a campaign, in the order of its table.

    Raises
    ------
    MeasurementError
        If there is none, or it is no index of a campaign.
    """
    try:
        return tuple(_case_row(row) for row in rows_of_campaign(Path(directory)))
    except (KeyError, TypeError, ValueError) as error:
        raise MeasurementError(
            f"{Path(directory) / INDEX}: found no index in it ({type(error).__name__}); {_EXPECTED}; give another "
            "directory"
        ) from error


def rows_of_campaign(directory: Path) -> list[Row]:
    """The rows of a campaign's directory; an error where it holds none."""
    rows = kept_rows(directory)
    if not rows:
        raise MeasurementError(f"{directory / INDEX}: found no case, or no such file; {_EXPECTED}; give its directory")
    return sorted(rows.values(), key=_order)


def _case_row(row: Row) -> CaseRow:
    suffix = ".verdict"
    # NaN, the only value unlike itself, stands for an empty cell in an index that pandas has written
    given = {name: value for name, value in row.items() if value not in (None, "") and value == value}
    verdicts = {name.removesuffix(suffix): value for name, value in given.items() if name.endswith(suffix)}
    date = date_of(row["date"]) if row.get("date") else None
    stiffness = {name: cells for name in verdicts if (cells := _cells(given, name)).keys() >= _NEEDED}
    return _CASE_ROW.validate_python(given | {"date": date, "verdicts": verdicts, "stiffness": stiffness})


def _cells(given: Row, name: str) -> Row:
    """Columns of one stiffness, its interval as it is printed."""
    cells = {column: given[f"{name}.{column}"] for column in _ESTIMATE if f"{name}.{column}" in given}
    printed = {end: given[at] for end in ("low95", "high95") if (at := f"{name}.printed_{end}") in given}
    return cells | printed


def date_of(text: str) -> datetime.datetime:
    """A date without its time zone: those of one table are compared with each other only."""
    date = datetime.datetime.fromisoformat(text)
    return date.astimezone(datetime.UTC).replace(tzinfo=None) if date.tzinfo else date
