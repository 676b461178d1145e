"""Records written in the formats of other programs, for the shipped data and for tests of the readers.

Universal files: data sets 151, 164, for each function 58 in text or 58b, for each mode 55. Arrays: npz, MATLAB 5 and
7.3, HDF5.
"""

import math
import zipfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from vibrecords.arrays import Array, SensorQuantity
from vibrecords.errors import MeasurementError
from vibrecords.files import WRITTEN_BY
from vibrecords.formats.uff_data_sets import AXIS_TYPES, NORMAL_MODES
from vibrecords.formats.units import MOTION_OF, SI_SENSOR, si_frf_unit
from vibrecords.formats.write import records_of_frf, write_table
from vibrecords.frf_set import FrfSet
from vibrecords.records import Dof, FrfRecord, ModeRecord, Record, SpectrumRecord, TimeRecord, dof_label, parse_dof

#: Type of the data set of remarks: one that the format leaves to users.
_REMARKS = 58018
_AXIS_NAMES = {8: "Displacement", 11: "Velocity", 12: "Acceleration", 13: "Force", 17: "Time", 18: "Frequency"}


def write_uff(records: Iterable[Record], path: Path, *, binary: bool, remarks: Sequence[str] = ()) -> None:
    """Write FRFs, their coherence, time histories, modes, and real functions of frequency that are no FRFs.

    What is read back from binary functions is the same to the last bit. Text has columns for 13 digits, of an uneven
    abscissa for 6 to 10; a data set 55, which is always text, for 6. Remarks, ASCII, stand in a data set that other
    programs pass over.

    Raises
    ------
    MeasurementError
        If a label is longer than an ID line.
    """
    with path.open("wb") as file:
        _data_set(file, 151, ["jointbayes", *(["NONE"] * 6)])
        _data_set(file, 164, [f"{1:10d}{'SI: metre, newton':<20}{2:10d}", f"{1.0:25.17E}" * 3, f"{273.15:25.17E}"])
        if remarks:
            _data_set(file, _REMARKS, remarks)
        for record in records:
            if isinstance(record, ModeRecord):
                _data_set(file, 55, _mode_lines(record))
            else:
                for function in _functions(record):
                    _write_function(file, function, binary)


def _lines(file: BinaryIO, lines: Iterable[str]) -> None:
    file.writelines(f"{line.rstrip(' ') if line.strip() != '-1' else line}\n".encode() for line in lines)


def _data_set(file: BinaryIO, kind: int, lines: Iterable[str]) -> None:
    _lines(file, ["    -1", f"{kind:6d}", *lines, "    -1"])


@dataclass(frozen=True, slots=True)
class _Function:
    """A data set 58: its type, labels of response and reference, ID lines, types and units of axes, and numbers.

    Of an abscissa that is always even the step alone is kept: the sampling rate stands in an ID line.
    """

    kind: int
    pair: tuple[str, str]
    ids: Sequence[str]
    axes: Sequence[tuple[int, str]]
    abscissa: Array
    ordinate: NDArray[Any]
    always_even: bool = False


def _functions(record: Record) -> Iterator[_Function]:
    """What a record is in the terms of the format."""
    none, hertz = (0, ""), (18, "Hz")
    if isinstance(record, FrfRecord):
        above: SensorQuantity = MOTION_OF[record.quantity] if record.quantity else "unknown"
        axes = (hertz, _axis(above), _axis("force" if record.quantity else "unknown"))
        ids = ["" if record.averages is None else f"averages {record.averages}"]
        pair = (record.response, record.reference)
        yield _Function(4, pair, ids, axes, record.frequency_hz, record.values)
        if record.coherence is not None:
            yield _Function(6, pair, ids, (hertz, none, none), record.frequency_hz, record.coherence)
    elif isinstance(record, TimeRecord):
        rate = f"sample_rate_hz={float(record.sample_rate_hz)!r}"
        hit = "" if record.hit is None else f"hit {record.hit}"
        time, axes = np.arange(record.values.size) / record.sample_rate_hz, ((17, "s"), _axis(record.quantity), none)
        yield _Function(1, (record.channel, ""), [rate, hit], axes, time, record.values, always_even=True)
    elif isinstance(record, SpectrumRecord):  # a function of general type: it is no FRF to any program
        axes = (hertz, (0, record.unit), none)
        yield _Function(0, (record.channel, ""), [record.kind], axes, record.frequency_hz, record.values)
    else:
        raise MeasurementError(
            f"records: found a {type(record).__name__}; expected FRFs, time histories, spectra or modes; leave it out"
        )


def _axis(quantity: SensorQuantity) -> tuple[int, str]:
    return AXIS_TYPES.get(quantity, 0), SI_SENSOR[quantity]


def _write_function(file: BinaryIO, function: _Function, binary: bool) -> None:
    dofs, named = _dofs(function.pair)
    abscissa, ordinate = function.abscissa, function.ordinate
    even, minimum, increment = _spacing(abscissa)
    if function.always_even:
        even, minimum, increment = True, _short(0.0), _short(float(abscissa[-1]) / max(1, abscissa.size - 1))
    numbers = np.ascontiguousarray(ordinate).view(float).reshape(ordinate.size, -1)
    columns = numbers if even else np.column_stack([abscissa, numbers])
    lines = [line for line in (*named, *function.ids) if line]
    lines = ["NONE"] * (5 - len(lines)) + lines
    head = f"{58:6d}"
    if binary:
        head += f"b{1:6d}{2:6d}{11:12d}{columns.size * 8:12d}{0:6d}{0:6d}{0:12d}{0:12d}"
    cells = [f" {dof.entity or 'NONE':<10}{dof.node:10d}{dof.direction:4d}" for dof in dofs]
    lines.append(f"{function.kind:5d}{0:10d}{0:5d}{0:10d}{''.join(cells)}")
    form = f"{6 if np.iscomplexobj(ordinate) else 4:10d}{ordinate.size:10d}{int(even):10d}"
    lines.append(f"{form}{minimum:>13}{increment:>13}{'0.00000E+00':>13}")
    for kind, unit in (*function.axes, (0, "")):
        lines.append(f"{kind:10d}{0:5d}{0:5d}{0:5d} {_AXIS_NAMES.get(kind, 'NONE'):<20} {unit or 'NONE':<20}")
    _lines(file, ["    -1", head, *lines])
    file.write(np.asarray(columns, "<f8").tobytes() if binary else _text(columns, even))
    _lines(file, ["    -1"])


def _dofs(pair: tuple[str, str]) -> tuple[list[Dof], list[str]]:
    """Degrees of freedom of response and reference, and ID lines for labels that they do not spell exactly."""
    dofs, named = [], []
    for key, label in zip(("response", "reference"), pair, strict=True):
        # of a DOF with words behind it other programs see the DOF
        dof = (parse_dof(label.partition(" ")[0]) if label.isascii() else None) or Dof("", 0, 0)
        dofs.append(dof)
        if label and dof_label(dof) != label:
            line = f"{key}={label}"
            if len(line.encode()) > 80 or line != " ".join(line.split(" ")).strip() or not label.isprintable():
                found, expected = f"{len(label)} characters", "printable ones that fit an ID line of 80"
                raise MeasurementError(f"label {label[:30]!r}: found {found}; expected {expected}; shorten the label")
            named.append(line)
    return dofs, named


def _short(value: float) -> str:
    """The number in 13 columns, with as many digits as fit."""
    exact = repr(float(value))
    if len(exact) <= 12:
        return exact
    return next((text for digits in range(12, 0, -1) if len(text := f"{value:.{digits}G}") <= 12), f"{value:.5E}")


def _spacing(abscissa: Array) -> tuple[bool, str, str]:
    """True with minimum and increment in the header's columns where they give the lines back exactly."""
    if abscissa.size > 1 and np.isfinite(abscissa).all():
        minimum, increment = _short(abscissa[0]), _short((abscissa[-1] - abscissa[0]) / (abscissa.size - 1))
        step = float(increment)
        if step > 0 and np.array_equal(float(minimum) + np.arange(abscissa.size) * step, abscissa):
            return True, minimum, increment
    return False, "0.00000E+00", "0.00000E+00"


def _text(columns: Array, even: bool) -> bytes:
    """Lines of 4E20.12, 2(E13.5,E20.12) or E13.5,2E20.12."""
    wide = [f"{value:20.12E}" if math.isfinite(value) else f"{value:20}" for value in columns.ravel()]
    if not even:
        wide[:: columns.shape[1]] = [f"{_short(value):>13}" for value in columns[:, 0]]
    per_line = 3 if columns.shape[1] == 3 else 4
    return "".join("".join(wide[i : i + per_line]) + "\n" for i in range(0, len(wide), per_line)).encode()


def _mode_lines(mode: ModeRecord) -> list[str]:
    """Lines of a data set 55.

    Raises
    ------
    MeasurementError
        If a label of the shape is no node with a direction.
    """
    dofs = {label: parse_dof(label) for label in mode.shape}
    rows: dict[int, list[complex]] = {}
    per_node = 6 if any(abs(dof.direction) > 3 for dof in dofs.values() if dof) else 3
    for label, dof in dofs.items():
        if dof is None or dof.entity or not dof.direction:
            raise MeasurementError(
                f"mode {mode.number}: found label {label[:30]!r}; expected that of a node, such as '12:Z+'; rename it"
            )
        value = mode.shape[label] if dof.direction > 0 else -mode.shape[label]
        rows.setdefault(dof.node, [0j] * per_node)[abs(dof.direction) - 1] = value
    complex_ = any(value.imag for value in map(complex, mode.shape.values()))
    sds = {"frequency_sd_hz": mode.frequency_sd_hz, "damping_sd": mode.damping_sd}
    told = " ".join(f"{key}={value!r}" for key, value in sds.items() if value is not None)
    stated = [mode.frequency_hz, mode.modal_mass or 0.0, mode.damping_ratio or 0.0, 0.0]
    lines = [f"Mode {mode.number}", told or "NONE", *["NONE"] * 3]
    definition = (1, NORMAL_MODES, per_node // 3 + 1, 8, 5 if complex_ else 2, per_node)
    lines.append("".join(f"{number:10d}" for number in definition))
    lines += [f"{2:10d}{4:10d}{1:10d}{mode.number:10d}", "".join(f"{x:13.5E}" for x in stated)]
    for node, row in rows.items():
        numbers = np.array(row, complex).view(float) if complex_ else np.array(row, complex).real
        cells = [f"{x:13.5E}" for x in numbers]
        lines += [f"{node:10d}", *("".join(cells[i : i + 6]) for i in range(0, len(cells), 6))]
    return lines


# ---- arrays

Block = dict[str, Any]
_MATLAB_HEADER = b"MATLAB 7.3 MAT-file, Platform: jointbayes, Created on: unknown HDF5 schema 1.00 ."


def write_npz(blocks: dict[str, Block], path: Path) -> None:
    """Write blocks of named arrays; exact, uncompressed."""
    arrays = {f"{name}/{k}".lstrip("/"): np.asarray(v) for name, block in blocks.items() for k, v in block.items()}
    with path.open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]  # the stub takes every name for allow_pickle
    with zipfile.ZipFile(path, "a") as archive:
        archive.comment = WRITTEN_BY.encode()


def write_matlab(blocks: dict[str, Block], path: Path) -> None:
    """Write blocks of named arrays as variables, or as structs where there are several."""
    from scipy.io import savemat

    variables: Block = {}
    for name, block in blocks.items():
        cells = {k: np.array(v, dtype=object)[:, None] if isinstance(v, list) else v for k, v in block.items()}
        variables |= {name: cells} if name else cells
    savemat(str(path), variables, appendmat=False, oned_as="column")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 5.0 MAT-file, Platform: jointbayes, Created on: unknown".ljust(116))


def write_hdf5(blocks: dict[str, Block], path: Path, *, matlab: bool = False) -> None:
    """Write blocks of named arrays, one group for each where there are several.

    They stand behind a header of 512 bytes, where `matlab` that of MATLAB 7.3.
    """
    import h5py

    with h5py.File(path, "w", userblock_size=512, locking=False) as file:  # `whole_file` has locked it
        for name, block in blocks.items():
            group: Any = file.create_group(name) if name else file
            if name and matlab:
                group.attrs["MATLAB_class"] = np.bytes_("struct")
            for key, value in block.items():
                if matlab:
                    _matlab_variable(group, key, value)
                else:
                    group[key] = np.array(value, dtype=h5py.string_dtype()) if isinstance(value, list) else value
    with path.open("r+b") as raw:
        raw.write(_MATLAB_HEADER.ljust(124) + b"\x00\x02IM" if matlab else WRITTEN_BY.encode() + b"\0")


def _matlab_variable(group: Any, key: str, value: Any) -> None:
    if isinstance(value, (str, list)):
        rows = [value] if isinstance(value, str) else value
        codes = [np.frombuffer(row.encode("utf-16-le"), "<u2") for row in rows]
        table = np.full((len(rows), max(1, *(row.size for row in codes))), 32, dtype="<u2")
        for line, row in zip(table, codes, strict=True):
            line[: row.size] = row
        item = group.create_dataset(key, data=table.T)
        item.attrs["MATLAB_class"] = np.bytes_("char")
        item.attrs["MATLAB_int_decode"] = np.int32(2)
        return
    array = np.atleast_1d(np.asarray(value))
    array = array[:, None] if array.ndim == 1 else array
    if np.iscomplexobj(array):
        pair = np.empty(array.shape, dtype=[("real", "<f8"), ("imag", "<f8")])
        pair["real"], pair["imag"] = array.real, array.imag
        array = pair
    item = group.create_dataset(key, data=array.T)
    item.attrs["MATLAB_class"] = np.bytes_("double")


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


_WRITERS: dict[str, Callable[[Sequence[Record], Path], None]] = {
    "uff58": lambda records, path: write_uff(records, path, binary=False),
    "uff58b": lambda records, path: write_uff(records, path, binary=True),
    "csv": write_table,
    "npz": lambda records, path: write_npz(arrays_of(records), path),
    "mat": lambda records, path: write_matlab(arrays_of(records), path),
    "mat73": lambda records, path: write_hdf5(arrays_of(records), path, matlab=True),
    "hdf5": lambda records, path: write_hdf5(arrays_of(records), path),
}
#: Formats that can be written here.
FORMATS = tuple(_WRITERS)


def write_records(records: Iterable[Record], path: str | Path, format: str) -> None:
    """Write FRFs or time histories in SI units; `format` is one of `FORMATS`."""
    _WRITERS[format](tuple(records), Path(path))


def write_frf(frf: FrfSet, path: str | Path, format: str) -> None:
    """Write a set of FRFs; `format` is one of `FORMATS`."""
    write_records(records_of_frf(frf), path, format)
