"""Tables in Excel workbooks (``.xlsx``): each sheet that holds one, read as a table in text is."""

import warnings
from collections.abc import Callable, Generator, Iterable
from contextlib import closing
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

from vibrecords.errors import MeasurementError, refusal
from vibrecords.formats.array_files import zip_entries
from vibrecords.formats.table_text import ColumnTable, Lines, read_text_table
from vibrecords.records import Record, reading_package, refuse_damage

#: Bytes of a workbook unpacked, and cells of its sheets; the largest sheet that Excel writes has 10^6 rows.
_MOST_BYTES, _MOST_CELLS, _MOST_SHEETS = 2**29, 20_000_000, 50


def read_xlsx(path: Path, records_of: Callable[[ColumnTable], Iterable[Record]]) -> Generator[Record, None, None]:
    """Records of all sheets that hold a table, with a note on which that is and on the sheets that hold none.

    A sheet with the columns of one before it holds the next hit. The title of a sheet names the response of an FRF
    whose columns do not, where there are several. `records_of` makes the records of one table.

    Raises
    ------
    MeasurementError
        If openpyxl is missing, the workbook is damaged or too large, or no sheet holds a table.
    """
    openpyxl = reading_package("openpyxl", "an Excel file", "save the sheet as CSV")
    size = sum(entry.file_size for entry in zip_entries(path))
    if size > _MOST_BYTES:
        found = f"{size / 1000000.0:.3g} MB when unpacked"
        raise refusal("workbook", found, f"at most {_MOST_BYTES >> 20}", "save it as CSV")
    tables: dict[str, ColumnTable] = {}
    refused: dict[str, MeasurementError] = {}
    damage = refuse_damage("workbook", "an Excel file; save it again, or as CSV")
    with damage, warnings.catch_warnings(), path.open("rb") as file:  # by its name openpyxl refuses another ending
        warnings.simplefilter("ignore")  # of styles and validations, which are of no concern
        with closing(openpyxl.load_workbook(file, read_only=True, data_only=True)) as workbook:
            for sheet in workbook.worksheets[:_MOST_SHEETS]:
                lines, title = _lines(sheet), sheet.title[:40]
                try:
                    if first := next((line for line in lines if line[1].strip()), None):
                        tables[title] = read_text_table(chain([first], lines))
                except MeasurementError as error:
                    refused[title] = error
            if more := [sheet.title[:40] for sheet in workbook.worksheets[_MOST_SHEETS:]]:
                refused[more[0]] = MeasurementError(f"found sheet {_MOST_SHEETS + 1}; expected at most {_MOST_SHEETS}")
    made: dict[str, list[Record]] = {}
    before: list[list[str]] = []
    for title, table in tables.items():
        names = [column.header for column in table.columns]
        several = sum([column.header for column in other.columns] == names for other in tables.values()) > 1
        before.append(names)
        comments = table.comments if len(tables) == 1 else {"channel": title, **table.comments}
        hit = before.count(names) if several else None
        try:
            made[title] = [*records_of(replace(table, comments=comments, hit=hit))]
        except MeasurementError as error:
            refused[title] = error
    if not made:
        title, reason = next(iter(refused.items()), ("", MeasurementError("found no numbers; expected a table")))
        raise MeasurementError(f"sheet {title!r}, {reason}" if title else f"workbook: {reason}; save it as CSV")
    unread = tuple(
        f"sheet {title!r} not read: {str(error).partition('; expected')[0]}" for title, error in refused.items()
    )
    for title, records in made.items():
        for record in records:
            where = record.where if len(made) == 1 else f"sheet {title!r}, {record.where}"
            yield replace(record, where=where, notes=(f"sheet {title!r}", *record.notes, *unread))


def _lines(sheet: Any) -> Lines:  # noqa: ANN401 - openpyxl has no types
    sheet.reset_dimensions()
    cells = 0
    for number, row in enumerate(sheet.iter_rows(values_only=True), start=1):
        cells += len(row) + 1
        if cells > _MOST_CELLS:
            raise refusal(f"line {number}", f"over {_MOST_CELLS} cells", "fewer", "save it as CSV")
        yield number, "\t".join(map(_cell, row))


def _cell(value: object) -> str:
    if value is None:
        return ""
    return repr(value) if type(value) is float else " ".join(str(value).split())
