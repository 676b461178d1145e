"""Records written as CSV; a file is there completely or not at all."""

import csv
from collections.abc import Callable, Iterable, Sequence
from itertools import product
from pathlib import Path

import numpy as np

from vibrecords.arrays import Array
from vibrecords.errors import MeasurementError, WriteError, placed, refusal, require_one_of
from vibrecords.files import WRITTEN_BY, whole_file
from vibrecords.formats.units import SI_SENSOR, si_frf_unit
from vibrecords.frf_set import FrfSet
from vibrecords.records import FrfRecord, Record, SpectrumRecord, TimeRecord

#: Formats that were written before, each of which other packages write.
_GONE = ("uff58", "uff58b", "tsv", "npz", "mat", "mat73", "hdf5")


def require_written(format: str, where: str, formats: Sequence[str] = ("csv",)) -> None:
    """Refuse a format that is none of `formats`.

    Raises
    ------
    MeasurementError
        With what writes the format now, if an earlier version did.
    """
    if format in _GONE:
        raise MeasurementError(
            f"{where}: found format '{format}', which went in this version; expected {', '.join(formats)}; pyuff "
            "writes universal files in six lines, numpy and scipy the others: 'Exporting results' of the documentation"
        )
    require_one_of(formats, format, where, "format ")


def write_frf(frf: FrfSet, path: str | Path, format: str = "csv") -> None:
    """Write a set of FRFs as CSV; read back, it is the same to the last bit.

    Raises
    ------
    MeasurementError
        If the format is not ``"csv"``, or a table cannot hold the records.
    WriteError
        If the file cannot be written.
    """
    write_records(records_of_frf(frf), path, format)


def records_of_frf(frf: FrfSet, label: Callable[[str], str] = str, where: str = "") -> tuple[FrfRecord, ...]:
    """FRFs of a set one by one, inputs fastest; `label` makes channel labels of DOFs, `where` is the records' place."""
    records = []
    for (i, output), (j, input_) in product(enumerate(frf.outputs), enumerate(frf.inputs)):
        values, coherence = frf.values[:, i, j], None if frf.coherence is None else frf.coherence[:, i, j]
        told = (frf.quantity, si_frf_unit(frf.quantity), coherence, frf.averages, where)
        records.append(FrfRecord(label(output), label(input_), frf.frequency_hz, values, *told))
    return tuple(records)


def write_records(records: Iterable[Record], path: str | Path, format: str = "csv") -> None:
    """Write FRFs or time histories in SI units as CSV.

    The file is written in the same directory under another name and moved there when it is complete.

    Raises
    ------
    MeasurementError
        If the format is not ``"csv"``, or a table cannot hold the records.
    WriteError
        If the file cannot be written.
    """
    path, records = Path(path), tuple(records)
    require_written(format, str(path))
    if not records:
        raise refusal(path, "nothing to write", "FRFs or time histories", "give at least one")
    if any(getattr(record, "factor", 1.0) is None for record in records):
        raise refusal(path, "records in no SI unit", "SI units", "convert them before")
    if "\0" in str(path):
        raise WriteError(f"{path}: found a null byte in it, so that it cannot be written; expected a path; correct it")
    try:
        with placed(path), whole_file(path) as temporary_path:
            write_table(records, temporary_path)
    except UnicodeEncodeError as error:
        found = f"a label that is no text ({error.object[:30]!r})"
        raise refusal(str(path), found, "characters", "rename it") from None


def write_table(records: Sequence[Record], path: Path, remarks: Sequence[str] = ()) -> None:
    """Write records as a table, remarks above; numbers with as many digits as it takes to read them back exactly.

    Raises
    ------
    MeasurementError
        If the records do not share their lines, or their sampling rate and length.
    """
    # 1. names, columns and comments, of FRFs with spectra or of time histories
    frfs = [record for record in records if isinstance(record, FrfRecord)]
    times = [record for record in records if isinstance(record, TimeRecord)]
    if bool(frfs) == bool(times):
        raise refusal("table", "FRFs and time histories, or neither", "one kind", "write a file each")
    names, columns, comments = ["frequency [Hz]" if frfs else "time [s]"], list[Array](), dict[str, str]()
    if frfs:
        lines = frfs[0].frequency_hz
        columns.append(lines)
        if not all(np.array_equal(r.frequency_hz, lines) for r in frfs):
            raise refusal("table", "FRFs on different lines", "one axis", "write a file for each")
        told = [str(r.averages) for r in frfs]
        if "None" not in told:
            comments["averages"] = ", ".join(told if len(set(told)) > 1 else told[:1])
    else:
        rate, size = times[0].sample_rate_hz, times[0].values.size
        columns.append(np.arange(size) / rate)
        if any((r.sample_rate_hz, r.values.size) != (rate, size) for r in times):
            found, expected = "time histories of different rates or lengths", "one time axis"
            raise refusal("table", found, expected, "write a file for each")
        comments["sample_rate_hz"] = repr(float(rate))
    for r in frfs:
        pair, unit = f"{r.response} / {r.reference}", f" [{si_frf_unit(r.quantity)}]" if r.quantity else ""
        names += [f"real {pair}{unit}", f"imaginary {pair}{unit}", *[f"coherence {pair}"] * (r.coherence is not None)]
        columns += [r.values.real, r.values.imag, *([] if r.coherence is None else [r.coherence])]
    for spectrum in (record for record in records if isinstance(record, SpectrumRecord) and frfs):
        names.append(f"{spectrum.kind} of {spectrum.channel}")
        columns.append(spectrum.values.real)
    for history in times:
        hit = "" if history.hit is None else f" hit {history.hit}"
        names.append(f"{history.channel}{hit} [{SI_SENSOR[history.quantity]}]")
        columns.append(history.values)
    # 2. the file
    with path.open("w", encoding="utf-8", newline="") as file:
        for line in (WRITTEN_BY, *remarks, *(f"{key}: {value}" for key, value in comments.items())):
            file.write(f"# {line}\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        for row in zip(*(column.tolist() for column in columns), strict=True):
            writer.writerow(map(repr, row))
