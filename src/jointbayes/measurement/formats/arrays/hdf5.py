"""HDF5 files, and MATLAB's version 7.3, which is HDF5 with arrays turned round."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from jointbayes.errors import MeasurementError
from jointbayes.measurement.formats.arrays.isolated import read_isolated
from jointbayes.measurement.formats.arrays.layout import Arrays

__all__ = ["read_hdf5", "read_mat73", "write_hdf5", "write_mat73"]

_MATLAB_HEADER = b"MATLAB 7.3 MAT-file, Platform: jointbayes, Created on: unknown HDF5 schema 1.00 ."


def read_hdf5(path: Path) -> Iterator[tuple[str, Arrays]]:
    """Blocks of named arrays of an HDF5 file, one for each group; attributes count as arrays.

    Raises
    ------
    MeasurementError
        If the file is damaged, or a data set is not plain numbers or text, or lies in another file.
    """
    _check_heaps(path)
    yield from read_isolated(path, "hdf5")


def read_mat73(path: Path) -> Iterator[tuple[str, Arrays]]:
    """Blocks of named arrays of a MAT file of version 7.3, one for each struct.

    Raises
    ------
    MeasurementError
        As `read_hdf5`, and for function handles and objects.
    """
    _check_heaps(path)
    yield from read_isolated(path, "mat73")


def _check_heaps(path: Path) -> None:
    """Walk the heaps in which text lies: the library goes round in circles in one that is damaged."""
    chunk_size, overlap = 1 << 16, 16
    with path.open("rb") as file:
        base, buffer = 0, b""
        while chunk := file.read(chunk_size):
            buffer += chunk
            for match in re.finditer(rb"GCOL\x01\x00\x00\x00", buffer):
                resume = file.tell()
                _check_heap(file, base + match.start())
                file.seek(resume)
            base += max(0, len(buffer) - overlap)
            buffer = buffer[-overlap:]


def _check_heap(file: BinaryIO, start: int) -> None:
    """One heap: objects of index, size and content, padded to 8 bytes; the free space has index 0."""
    file.seek(start + 8)
    head = file.read(8)
    size = int.from_bytes(head, "little")
    file.seek(start)
    heap = file.read(min(size, 1 << 24)) if len(head) == 8 else b""
    at = 16
    while len(heap) == size and at + 16 <= size:
        index, count = int.from_bytes(heap[at : at + 2], "little"), int.from_bytes(heap[at + 8 : at + 16], "little")
        step = count if index == 0 else 16 + -(-count // 8) * 8
        if step < 16 or at + step > size:
            break
        at += step
    else:
        if len(heap) == size >= 16:
            return
    raise MeasurementError(
        f"HDF5 content: found a damaged heap of text at byte {start}; expected a complete file; copy it again"
    )


def write_hdf5(blocks: dict[str, dict[str, Any]], path: Path) -> None:
    """Write blocks of named arrays, one group for each where there are several."""
    import h5py  # type: ignore[import-untyped]

    with h5py.File(path, "w") as file:
        for name, block in blocks.items():
            group = file.create_group(name) if name else file
            for key, value in block.items():
                group[key] = np.array(value, dtype=h5py.string_dtype()) if isinstance(value, list) else value


def write_mat73(blocks: dict[str, dict[str, Any]], path: Path) -> None:
    """Write blocks of named arrays as MATLAB 7.3 does: a header of 512 bytes, then HDF5."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, block in blocks.items():
            group: Any = file.create_group(name) if name else file
            if name:
                group.attrs["MATLAB_class"] = np.bytes_("struct")
            for key, value in block.items():
                _matlab_variable(group, key, value)
    with path.open("r+b") as raw:
        raw.write(_MATLAB_HEADER.ljust(124) + b"\x00\x02IM")


def _matlab_variable(group: Any, key: str, value: Any) -> None:  # noqa: ANN401
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
