"""Blocks of named arrays written as npz, as HDF5, as MATLAB 7.3 (HDF5 with arrays turned round) and as MATLAB 5."""

from pathlib import Path
from typing import Any

import numpy as np

_MATLAB_HEADER = b"MATLAB 7.3 MAT-file, Platform: jointbayes, Created on: unknown HDF5 schema 1.00 ."


def write_npz(blocks: dict[str, dict[str, Any]], path: Path) -> None:
    """Write blocks of named arrays; exact, uncompressed."""
    arrays = {
        f"{name}/{key}" if name else key: np.asarray(v) for name, block in blocks.items() for key, v in block.items()
    }
    with path.open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]  # the stub takes every name for allow_pickle


def write_matlab(blocks: dict[str, dict[str, Any]], path: Path) -> None:
    """Write blocks of named arrays as variables, or as structs where there are several."""
    from scipy.io import savemat

    variables: dict[str, Any] = {}
    for name, block in blocks.items():
        cells = {
            key: np.array(value, dtype=object)[:, None] if isinstance(value, list) else value
            for key, value in block.items()
        }
        variables |= {name: cells} if name else cells
    savemat(str(path), variables, appendmat=False, oned_as="column")


def write_hdf5(blocks: dict[str, dict[str, Any]], path: Path) -> None:
    """Write blocks of named arrays, one group for each where there are several."""
    import h5py  # type: ignore[import-untyped]

    with h5py.File(path, "w", locking=False) as file:  # `whole_file` has locked it
        for name, block in blocks.items():
            group = file.create_group(name) if name else file
            for key, value in block.items():
                group[key] = np.array(value, dtype=h5py.string_dtype()) if isinstance(value, list) else value


def write_mat73(blocks: dict[str, dict[str, Any]], path: Path) -> None:
    """Write blocks of named arrays as MATLAB 7.3 does: a header of 512 bytes, then HDF5."""
    import h5py

    with h5py.File(path, "w", userblock_size=512, locking=False) as file:
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
