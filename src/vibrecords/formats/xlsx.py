"""Tables in Excel workbooks (``.xlsx``): the first sheet that holds one, read as a table in text is."""

import warnings
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

from vibrecords.errors import MeasurementError
from vibrecords.formats.array_files import zip_entries
from vibrecords.formats.table_text import ColumnTable, Lines, read_text_table
from vibrecords.records import reading_package, refuse_damage

#: Bytes of a workbook unpacked, and cells of its sheets; the largest sheet that Excel writes has 10^6 rows.
_MOST_BYTES, _MOST_CELLS, _MOST_SHEETS = 2**29, 20_000_000, 50


def read_xlsx(path: Path) -> ColumnTable:
    """Table of the first sheet with rows of numbers, with a note on which that is.

    Raises
    ------
    MeasurementError
        If openpyxl is missing, the workbook is damaged or too large, or no sheet holds a table.
    """
    openpyxl = reading_package("openpyxl", "an Excel file", "save the sheet as CSV")
    size = sum(entry.file_size for entry in zip_entries(path))
    if size > _MOST_BYTES:
        raise MeasurementError(
            f"workbook: found {size / 1e6:.3g} MB when unpacked; expected at most {_MOST_BYTES >> 20}; save it as CSV"
        )
    refused: MeasurementError | None = None
    damage = refuse_damage("workbook", "an Excel file; save it again, or as CSV")
    with damage, warnings.catch_warnings(), path.open("rb") as file:  # by its name openpyxl refuses another ending
        warnings.simplefilter("ignore")  # of styles and validations, which are of no concern
        with closing(openpyxl.load_workbook(file, read_only=True, data_only=True)) as workbook:
            for sheet in workbook.worksheets[:_MOST_SHEETS]:
                try:
                    return replace(read_text_table(_lines(sheet)), notes=(f"sheet {sheet.title[:40]!r}",))
                except MeasurementError as error:
                    refused = refused or MeasurementError(f"sheet {sheet.title[:40]!r}, {error}")
            raise refused or MeasurementError("workbook: found no sheet; expected a table; save it as CSV")


def _lines(sheet: Any) -> Lines:  # noqa: ANN401 - openpyxl has no types
    sheet.reset_dimensions()
    cells = 0
    for number, row in enumerate(sheet.iter_rows(values_only=True), start=1):
        cells += len(row) + 1
        if cells > _MOST_CELLS:
            raise MeasurementError(f"line {number}: found over {_MOST_CELLS} cells; expected fewer; save it as CSV")
        yield number, "\t".join(map(_cell, row))


def _cell(value: object) -> str:
    if value is None:
        return ""
    return repr(value) if type(value) is float else " ".join(str(value).split())
