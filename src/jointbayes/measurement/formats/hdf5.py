"""HDF5 files, and MATLAB's version 7.3, which is HDF5 with arrays turned round."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import MeasurementError
from jointbayes.measurement.formats.layout import Arrays
from jointbayes.measurement.formats.limits import check_unpacked

__all__ = ["read_hdf5", "read_mat73", "write_hdf5", "write_mat73"]

_MATLAB_HEADER = b"MATLAB 7.3 MAT-file, Platform: jointbayes, Created on: unknown HDF5 schema 1.00 ."
_REMEDY = "store plain numbers and text in this file"


def read_hdf5(path: Path) -> Iterator[tuple[str, Arrays]]:
    """Blocks of named arrays of an HDF5 file, one for each group; attributes count as arrays.

    Raises
    ------
    MeasurementError
        If the file is damaged, or a data set is not plain numbers or text, or lies in another file.
    """
    yield from _read(path, matlab=False)


def read_mat73(path: Path) -> Iterator[tuple[str, Arrays]]:
    """Blocks of named arrays of a MAT file of version 7.3, one for each struct.

    Raises
    ------
    MeasurementError
        As `read_hdf5`, and for function handles and objects.
    """
    yield from _read(path, matlab=True)


def _read(path: Path, *, matlab: bool) -> Iterator[tuple[str, Arrays]]:
    import h5py  # type: ignore[import-untyped]

    try:
        with h5py.File(path, "r") as file:
            groups: dict[str, dict[str, Any]] = {}
            everything: list[Any] = []

            def visit(name: str, item: Any) -> None:  # noqa: ANN401 - h5py is untyped here
                if name.startswith("#"):
                    return
                group, _, key = name.rpartition("/")
                if isinstance(item, h5py.Dataset):
                    groups.setdefault(group, {})[key] = item
                    everything.append(item)
                else:
                    groups.setdefault(name, {})

            groups[""] = {}
            file.visititems(visit)  # passes over links to other files
            check_unpacked(path, sum(item.nbytes for item in everything))
            for group in sorted(groups, key=_natural):
                prefix = f"{group}/" if group else ""
                block = {key: _array(item, f"variable '{prefix}{key}'", matlab) for key, item in groups[group].items()}
                attributes = {key: _attribute(v) for key, v in file[group or "/"].attrs.items()} if not matlab else {}
                block = {key: value for key, value in {**attributes, **block}.items() if value is not None}
                if block:
                    yield prefix, block
    except MeasurementError:
        raise
    # the library raises whatever the damaged bytes lead it to; which kind is of no use to the reader
    except Exception as error:
        reason = " ".join(str(error).split())[:120]
        raise MeasurementError(
            f"HDF5 content: found a part that cannot be read ({reason}); expected a complete file; copy it again"
        ) from None


def _natural(name: str) -> list[tuple[int, str]]:
    """Order in which record_10 comes after record_9."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d{1,9})", name) if part]


def _attribute(value: Any) -> Any:  # noqa: ANN401
    return value if isinstance(value, (str, bytes, int, float, np.number, np.ndarray)) else None


def _array(item: Any, where: str, matlab: bool) -> Any:  # noqa: ANN401
    """Content of a data set, or None where MATLAB marks it as empty."""
    import h5py

    if item.is_virtual or item.external:
        raise MeasurementError(f"{where}: found data kept in another file; expected them in this one; {_REMEDY}")
    kind = item.attrs.get("MATLAB_class", b"")
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    if "MATLAB_object_decode" in item.attrs or kind == "function_handle":
        raise MeasurementError(f"{where}: found a function handle or an object of MATLAB; expected numbers; {_REMEDY}")
    if item.shape is None or "MATLAB_empty" in item.attrs:
        return None
    if h5py.check_string_dtype(item.dtype):
        return item.asstr(errors="replace")[()]
    if h5py.check_ref_dtype(item.dtype) is h5py.Reference:
        return [_text(item.file[reference], where) for reference in item[()].ravel(order="K")]
    found: NDArray[Any] = item[()]
    if found.dtype.names is not None and tuple(name[0] for name in found.dtype.names) == ("r", "i"):
        real, imaginary = (found[name] for name in found.dtype.names)
        whole = np.empty(found.shape, complex)
        whole.real, whole.imag = real, imaginary
        found = whole
    if found.dtype.kind not in "iufcUSb":
        raise MeasurementError(f"{where}: found data of type {item.dtype}; expected numbers or text; {_REMEDY}")
    if kind == "char":
        return _characters(found)
    return np.asarray(found).T if matlab else found


def _text(item: Any, where: str) -> str:  # noqa: ANN401
    """Text in a cell of a cell array."""
    kind = item.attrs.get("MATLAB_class", b"")
    if kind not in (b"char", "char") or item.nbytes > 4096:
        raise MeasurementError(f"{where}: found cells that are not text; expected a cell array of labels; {_REMEDY}")
    return "" if "MATLAB_empty" in item.attrs else _characters(item[()])[0]


def _characters(codes: NDArray[Any]) -> list[str]:
    """Rows of a character array, stored as UTF-16 with rows along the last axis."""
    rows = np.atleast_2d(codes.T).astype("<u2")
    return [row.tobytes().decode("utf-16-le", errors="replace").rstrip() for row in rows]


def write_hdf5(blocks: dict[str, dict[str, Any]], path: Path) -> None:
    """Write blocks of named arrays, one group for each where there are several."""
    import h5py

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
