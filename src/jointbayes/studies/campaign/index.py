"""The index of a campaign: one row a case in a Parquet file, and the rows that are not in it yet in a file of lines.

A row is on the disk as soon as its case is: appended to the lines, which costs the same for the first case and the
last. The index is written anew, whole, now and then.
"""

import datetime
import os
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from jointbayes.errors import MeasurementError
from jointbayes.own_directory import open_regular
from jointbayes.studies.campaign.cases import INDEX
from jointbayes.studies.json_lines import append_line, read_lines
from jointbayes.whole_file import whole_file

FAILED, KILLED = "failed", "killed its worker"  # and `DONE`
LINES = "index.new.jsonl"

_KINDS = {
    "key": "string", "file": "string", "status": "string", "attempts": "int64", "error": "string", "serial": "string",
    "date": "timestamp[us]", "order": "int64", "seed": "int64", "converged": "bool", "reason": "string",
    "seconds": "double", "explains": "bool", "misfit_p_value": "double", "fingerprint": "string", "code": "string",
}  # fmt: skip
_TEXTS = ("unit", "verdict")  # what of a quantity is no number
_APART = 5.0  # seconds between two writings of the index, or
_SHARE = 20.0  # so many times what the last one took: of thousands of cases it is not the work

Row = dict[str, Any]


class Index:
    """Rows as they come in; for one process at a time.

    Parameters
    ----------
    directory
        Of the campaign.
    rows
        Rows of cases that are done already.

    Raises
    ------
    WriteError
        If it cannot be written.
    """

    def __init__(self, directory: Path, rows: Iterable[Row] = ()) -> None:
        self._file, self._lines = directory / INDEX, directory / LINES
        self._tables = [_as_table(list(rows))]  # a tenth of what the rows take as dictionaries
        self._new: list[Row] = []
        self.write()

    def add(self, row: Row) -> None:
        """Add the row of a case that has ended, and put it on the disk."""
        append_line(self._lines, row)
        self._new.append(row)
        if time.monotonic() - self._written > max(_APART, _SHARE * self._took):
            self.write()
            lines = open_regular(self._lines, os.O_WRONLY)
            os.truncate(lines, 0)
            os.close(lines)

    def write(self) -> None:
        """Write the index, whole, in the order of the campaign's table."""
        import pyarrow
        from pyarrow import parquet

        begin = time.monotonic()
        if self._new:
            self._tables.append(_as_table(self._new))
            self._new = []
        table = pyarrow.concat_tables(self._tables, promote_options="default").combine_chunks()
        self._tables = [table]
        with whole_file(self._file) as scratch:
            try:
                parquet.write_table(table.sort_by("order"), scratch)
            except pyarrow.ArrowException as error:
                raise OSError(str(error)) from error
        self._written = time.monotonic()
        self._took = self._written - begin

    def close(self) -> None:
        """Write what is not written, and remove the lines, which say no more than the index."""
        self.write()
        self._lines.unlink(missing_ok=True)


def kept_rows(directory: Path) -> dict[str, Row]:
    """Rows of an earlier start of a campaign by key; none where there was none.

    Raises
    ------
    MeasurementError
        If the index cannot be read.
    """
    import pyarrow
    from pyarrow import parquet

    rows: list[Row] = []
    if (directory / INDEX).exists():
        try:
            rows = parquet.read_table(directory / INDEX).to_pylist()
        except (pyarrow.ArrowException, OSError, ValueError) as error:
            raise MeasurementError(
                f"{directory / INDEX}: found no index of a campaign in it ({type(error).__name__}); expected the one "
                "that was written there; remove it, and all cases are done again, or choose another --out"
            ) from error
    rows += read_lines(directory / LINES)  # of a line that was cut off the case is done again
    return {row["key"]: row for row in rows if isinstance(row, dict) and "key" in row and "status" in row}


def _as_table(rows: list[Row]) -> Any:  # noqa: ANN401 (pyarrow has no types)
    import pyarrow

    names = dict.fromkeys(_KINDS) | {name: None for row in rows for name in row}
    schema = pyarrow.schema([(name, _kind(name)) for name in names])
    return pyarrow.Table.from_pylist([_ready(row) for row in rows], schema=schema)


def _kind(name: str) -> str:
    if name in _KINDS:
        return _KINDS[name]
    return "string" if name.rpartition(".")[2] in _TEXTS else "double"


def _ready(row: Mapping[str, Any]) -> Row:
    date = row.get("date")
    return {**row, "date": datetime.datetime.fromisoformat(date) if isinstance(date, str) else date}
