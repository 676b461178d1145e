"""MATLAB files up to version 7 (``save -v6``, ``save -v7``): named arrays and structs of them."""

import struct
import warnings
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from jointbayes.errors import MeasurementError
from jointbayes.measurement.formats.layout import Arrays
from jointbayes.measurement.formats.limits import check_unpacked

__all__ = ["read_matlab", "write_matlab"]

_COMPRESSED = 15
_CHUNK = 1 << 18
_REMEDY = "save the arrays alone: save('file.mat', 'frequency_hz', 'frf', 'outputs', 'inputs')"


def read_matlab(path: Path) -> Iterator[tuple[str, Arrays]]:
    """Blocks of named arrays of a MAT file; a struct is a block of its own.

    Raises
    ------
    MeasurementError
        If the file is cut off or damaged, unpacks to far more than its size, or holds function handles or objects.
    """
    from scipy.io import loadmat

    with path.open("rb") as file:
        check_unpacked(path, _unpacked(file, path.stat().st_size))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of variables that occur twice: the last one counts, as in MATLAB
            found = loadmat(str(path), appendmat=False, chars_as_strings=True)
    # scipy raises whatever the damaged bytes lead it to; which kind is of no use to the reader
    except Exception as error:
        reason = " ".join(str(error).split())[:120]
        raise MeasurementError(
            f"MAT file: found contents that cannot be read ({reason}); expected a file of version 5 to 7; save it again"
        ) from None
    arrays = {name: value for name, value in found.items() if not name.startswith("__")}
    for name, value in arrays.items():
        _refuse_code(name, value)
    top = {name: value for name, value in arrays.items() if value.dtype.names is None}
    if top:
        yield "", top
    for name, value in arrays.items():
        if value.dtype.names is not None:
            for i, element in enumerate(value.ravel()):
                place = f"{name}." if value.size == 1 else f"{name}({i + 1})."
                yield place, {key: element[key] for key in value.dtype.names}


def _unpacked(file: BinaryIO, size: int) -> int:
    """Bytes of all variables unpacked; walks the elements without keeping them."""
    header = file.read(128)
    if len(header) < 128 or header[126:128] not in (b"IM", b"MI"):
        raise MeasurementError(
            "MAT file: found a damaged header; expected 128 bytes that end in the byte order; save it again with -v7"
        )
    order = "<" if header[126:128] == b"IM" else ">"
    total, number = 0, 0
    while tag := file.read(8):
        number += 1
        kind, count = struct.unpack(f"{order}II", tag) if len(tag) == 8 else (0, size)
        here = file.tell()
        if here + count > size:
            raise MeasurementError(
                f"variable {number}: found {size - here} bytes; expected {count}; the file is cut off, copy it again"
            )
        total += _inflated(file, count, number) if kind == _COMPRESSED else count
        file.seek(here + count)
    return total


def _inflated(file: BinaryIO, count: int, number: int) -> int:
    engine, total = zlib.decompressobj(), 0
    try:
        while count > 0 and (chunk := file.read(min(count, _CHUNK))):
            count -= len(chunk)
            while chunk:
                total += len(engine.decompress(chunk, _CHUNK))
                chunk = engine.unconsumed_tail
    except zlib.error as error:
        raise MeasurementError(
            f"variable {number}: found compressed data that cannot be unpacked ({error}); expected a complete file; "
            "copy it again"
        ) from None
    return total


def _refuse_code(name: str, value: Any) -> None:  # noqa: ANN401 - whatever scipy makes of the variable
    from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

    if isinstance(value, (MatlabFunction, MatlabObject, MatlabOpaque)):
        raise MeasurementError(
            f"variable '{name}': found a function handle or an object of MATLAB; expected numbers and text; {_REMEDY}"
        )
    if not isinstance(value, np.ndarray):
        raise MeasurementError(f"variable '{name}': found a sparse matrix; expected a full one; {_REMEDY}")
    if value.dtype.names is not None:
        for key in value.dtype.names:
            for item in value[key].ravel():
                _refuse_code(f"{name}.{key}", item)
    elif value.dtype == object:
        for item in value.ravel():
            _refuse_code(name, item)


def write_matlab(blocks: dict[str, dict[str, Any]], path: Path) -> None:
    """Write blocks of named arrays as variables, or as structs where there are several."""
    from scipy.io import savemat

    variables: dict[str, Any] = {}
    for name, block in blocks.items():
        cells = {key: _cells(value) for key, value in block.items()}
        variables |= {name: cells} if name else cells
    savemat(str(path), variables, appendmat=False, oned_as="column")


def _cells(value: Any) -> Any:  # noqa: ANN401
    if not isinstance(value, list):
        return value
    cells = np.empty((len(value), 1), dtype=object)
    cells[:, 0] = value
    return cells
