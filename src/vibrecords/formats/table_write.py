"""Records as a table in text, CSV or TSV."""

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vibrecords.arrays import Array
from vibrecords.errors import MeasurementError
from vibrecords.formats.units import si_frf_unit, si_sensor_unit
from vibrecords.records import FrfRecord, Record, TimeRecord
from vibrecords.whole_file import WRITTEN_BY


def table_columns(records: Sequence[Record]) -> tuple[list[str], list[Array], dict[str, str]]:
    """Headers, columns and comments of a table that holds the records.

    Raises
    ------
    MeasurementError
        If the records do not share their lines, or their sampling rate and length.
    """
    frfs = [record for record in records if isinstance(record, FrfRecord)]
    times = [record for record in records if isinstance(record, TimeRecord)]
    if bool(frfs) == bool(times):
        raise MeasurementError(
            "table: found FRFs and time histories, or neither; expected one kind; write one file for each"
        )
    if frfs:
        return _frf_columns(frfs)
    rate, size = times[0].sample_rate_hz, times[0].values.size
    if any((r.sample_rate_hz, r.values.size) != (rate, size) for r in times):
        raise MeasurementError(
            "table: found time histories of different rates or lengths; expected one time axis; write uff58 or hdf5"
        )
    names = ["time [s]"]
    for r in times:
        hit = f" hit {r.hit}" if r.hit is not None else ""
        names.append(f"{r.channel}{hit} [{si_sensor_unit(r.quantity)}]")
    return names, [np.arange(size) / rate, *(r.values for r in times)], {"sample_rate_hz": repr(float(rate))}


def _frf_columns(frfs: Sequence[FrfRecord]) -> tuple[list[str], list[Array], dict[str, str]]:
    lines = frfs[0].frequency_hz
    names, columns = ["frequency [Hz]"], [lines]
    for r in frfs:
        if not np.array_equal(r.frequency_hz, lines):
            raise MeasurementError(
                "table: found FRFs on different lines; expected one frequency axis; write uff58 or hdf5"
            )
        pair = f"{r.response} / {r.reference}"
        unit = f" [{si_frf_unit(r.quantity)}]" if r.quantity else ""
        names += [f"real {pair}{unit}", f"imaginary {pair}{unit}"]
        columns += [r.values.real, r.values.imag]
        if r.coherence is not None:
            names.append(f"coherence {pair}")
            columns.append(r.coherence)
    told = [str(r.averages) for r in frfs if r.averages is not None]
    if len(told) < len(frfs):
        return names, columns, {}
    return names, columns, {"averages": ", ".join(told if len(set(told)) > 1 else told[:1])}


def write_table(records: Sequence[Record], path: Path, delimiter: str, remarks: Sequence[str] = ()) -> None:
    """Write records as a table, remarks above; numbers with as many digits as it takes to read them back exactly."""
    names, columns, comments = table_columns(records)
    with path.open("w", encoding="utf-8", newline="") as file:
        for line in (WRITTEN_BY, *remarks, *(f"{key}: {value}" for key, value in comments.items())):
            file.write(f"# {line}\n")
        writer = csv.writer(file, delimiter=delimiter, lineterminator="\n")
        writer.writerow(names)
        for row in zip(*(column.tolist() for column in columns), strict=True):
            writer.writerow(map(repr, row))
