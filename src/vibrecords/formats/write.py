"""Records written in any of the formats; a file is there completely or not at all."""

import csv
from collections.abc import Callable, Iterable, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from vibrecords.arrays import Array
from vibrecords.errors import MeasurementError, WriteError, require_one_of
from vibrecords.files import whole_file
from vibrecords.formats.array_files import write_hdf5, write_matlab, write_npz
from vibrecords.formats.uff_write import write_uff
from vibrecords.formats.units import SI_SENSOR, si_frf_unit
from vibrecords.formats.written_by import WRITTEN_BY
from vibrecords.frf_set import FrfSet
from vibrecords.records import FrfRecord, Record, SpectrumRecord, TimeRecord

_WRITERS: dict[str, Callable[[Sequence[Record], Path], None]] = {
    "uff58": lambda records, path: write_uff(records, path, binary=False),
    "uff58b": lambda records, path: write_uff(records, path, binary=True),
    "csv": lambda records, path: write_table(records, path, ","),
    "tsv": lambda records, path: write_table(records, path, "\t"),
    "npz": lambda records, path: write_npz(arrays_of(records), path),
    "mat": lambda records, path: write_matlab(arrays_of(records), path),
    "mat73": lambda records, path: write_hdf5(arrays_of(records), path, matlab=True),
    "hdf5": lambda records, path: write_hdf5(arrays_of(records), path),
}

#: Formats that can be written.
FORMATS = tuple(_WRITERS)


def write_frf(frf: FrfSet, path: str | Path, format: str) -> None:
    """Write a set of FRFs; `format` is one of `FORMATS`.

    Read back, it is the same to the last bit; of ``"uff58"``, which is text, values have 13 digits.

    Raises
    ------
    MeasurementError
        If the format is unknown or cannot hold the records.
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


def write_records(records: Iterable[Record], path: str | Path, format: str) -> None:
    """Write FRFs or time histories in SI units; `format` is one of `FORMATS`.

    The file is written in the same directory under another name and moved there when it is complete.

    Raises
    ------
    MeasurementError
        If the format is unknown or cannot hold the records.
    WriteError
        If the file cannot be written.
    """
    path, records = Path(path), tuple(records)
    require_one_of(FORMATS, format, str(path), "format ")
    if not records:
        raise MeasurementError(f"{path}: found nothing to write; expected FRFs or time histories; give at least one")
    if any(getattr(record, "factor", 1.0) is None for record in records):
        raise MeasurementError(f"{path}: found records in no SI unit; expected SI units; convert them before")
    if "\0" in str(path):
        raise WriteError(f"{path}: found a null byte in it, so that it cannot be written; expected a path; correct it")
    try:
        with whole_file(path) as temporary_path:
            _WRITERS[format](records, temporary_path)
    except MeasurementError as error:
        raise MeasurementError(f"{path}: {error}") from None
    except UnicodeEncodeError as error:
        raise MeasurementError(
            f"{path}: found a label that is no text ({error.object[:30]!r}); expected characters; rename it"
        ) from None


def arrays_of(records: Iterable[Record]) -> dict[str, dict[str, Any]]:
    """Blocks of named arrays for records: one block for FRFs on one grid and one rate, else one for each record.

    Returns
    -------
    dict
        Name of the block to its arrays; the name is empty where there is one block only.
    """
    records = list(records)
    frfs = [record for record in records if isinstance(record, FrfRecord)]
    times = [record for record in records if isinstance(record, TimeRecord)]
    blocks = [_frf_block(group) for group in _grids(frfs)]
    same = len({(record.sample_rate_hz, record.values.size) for record in times}) == 1
    blocks += [_time_block(group) for group in ([times] if same else [[record] for record in times])]
    return {"": blocks[0]} if len(blocks) == 1 else {f"record_{i + 1}": block for i, block in enumerate(blocks)}


def _grids(frfs: Sequence[FrfRecord]) -> list[list[FrfRecord]]:
    """All records as one grid where they form one, in grid order; else each by itself."""
    pairs = {(record.response, record.reference): record for record in frfs}
    outputs, inputs = (dict.fromkeys(pair[side] for pair in pairs) for side in (0, 1))
    alike = len({(r.quantity, r.averages, r.coherence is None) for r in frfs}) == 1
    on_lines = all(np.array_equal(r.frequency_hz, frfs[0].frequency_hz) for r in frfs)
    if alike and on_lines and len(pairs) == len(frfs) == len(outputs) * len(inputs):
        return [[pairs[pair] for pair in product(outputs, inputs)]]
    return [[record] for record in frfs]


def _frf_block(group: list[FrfRecord]) -> dict[str, Any]:
    first = group[0]
    outputs, inputs = (list(dict.fromkeys(getattr(r, side) for r in group)) for side in ("response", "reference"))
    shape = (len(outputs), len(inputs), first.frequency_hz.size)
    block: dict[str, Any] = {
        "frequency_hz": first.frequency_hz,
        "frf": np.moveaxis(np.array([r.values for r in group]).reshape(shape), -1, 0),
        "outputs": outputs,
        "inputs": inputs,
    }
    if first.quantity is not None:
        block |= {"quantity": first.quantity, "unit": si_frf_unit(first.quantity)}
    if first.coherence is not None:
        block["coherence"] = np.moveaxis(np.array([r.coherence for r in group]).reshape(shape), -1, 0)
    if first.averages is not None:
        block["averages"] = float(first.averages)
    return block


def _time_block(group: list[TimeRecord]) -> dict[str, Any]:
    return {
        "sample_rate_hz": group[0].sample_rate_hz,
        "samples": np.array([r.values for r in group]).T,
        "channels": [r.channel for r in group],
        "quantities": [r.quantity for r in group],
        "units": [SI_SENSOR[r.quantity] or " " for r in group],
        "hits": np.array([float(r.hit or 0) for r in group]),
    }


# ---- tables in text


def _columns(records: Sequence[Record]) -> tuple[list[str], list[Array], dict[str, str]]:
    """Headers, columns and comments of a table that holds the records.

    Raises
    ------
    MeasurementError
        If the records do not share their lines, or their sampling rate and length.
    """
    frfs = [record for record in records if isinstance(record, FrfRecord)]
    times = [record for record in records if isinstance(record, TimeRecord)]
    if bool(frfs) == bool(times):
        raise MeasurementError("table: found FRFs and time histories, or neither; expected one kind; write a file each")
    if frfs:
        names, columns, comments = _frf_columns(frfs)
        for r in (r for r in records if isinstance(r, SpectrumRecord)):
            names.append(f"{r.kind} of {r.channel}")
            columns.append(r.values.real)
        return names, columns, comments
    rate, size = times[0].sample_rate_hz, times[0].values.size
    if any((r.sample_rate_hz, r.values.size) != (rate, size) for r in times):
        raise MeasurementError(
            "table: found time histories of different rates or lengths; expected one time axis; write uff58 or hdf5"
        )
    labels = (r.channel if r.hit is None else f"{r.channel} hit {r.hit}" for r in times)
    names = [f"{label} [{SI_SENSOR[r.quantity]}]" for label, r in zip(labels, times, strict=True)]
    columns = [np.arange(size) / rate, *(r.values for r in times)]
    return ["time [s]", *names], columns, {"sample_rate_hz": repr(float(rate))}


def _frf_columns(frfs: Sequence[FrfRecord]) -> tuple[list[str], list[Array], dict[str, str]]:
    lines = frfs[0].frequency_hz
    names, columns = ["frequency [Hz]"], [lines]
    for r in frfs:
        if not np.array_equal(r.frequency_hz, lines):
            raise MeasurementError("table: found FRFs on different lines; expected one axis; write uff58 or hdf5")
        pair = f"{r.response} / {r.reference}"
        unit = f" [{si_frf_unit(r.quantity)}]" if r.quantity else ""
        names += [f"real {pair}{unit}", f"imaginary {pair}{unit}"]
        columns += [r.values.real, r.values.imag]
        if r.coherence is not None:
            names.append(f"coherence {pair}")
            columns.append(r.coherence)
    told = [str(r.averages) for r in frfs]
    averages = ", ".join(told if len(set(told)) > 1 else told[:1])
    return names, columns, {"averages": averages} if "None" not in told else {}


def write_table(records: Sequence[Record], path: Path, delimiter: str, remarks: Sequence[str] = ()) -> None:
    """Write records as a table, remarks above; numbers with as many digits as it takes to read them back exactly."""
    names, columns, comments = _columns(records)
    with path.open("w", encoding="utf-8", newline="") as file:
        for line in (WRITTEN_BY, *remarks, *(f"{key}: {value}" for key, value in comments.items())):
            file.write(f"# {line}\n")
        writer = csv.writer(file, delimiter=delimiter, lineterminator="\n")
        writer.writerow(names)
        for row in zip(*(column.tolist() for column in columns), strict=True):
            writer.writerow(map(repr, row))
