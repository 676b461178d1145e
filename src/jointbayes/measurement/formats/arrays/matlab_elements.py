"""Elements of a MAT file of version 5, walked before anything is read from them.

scipy reserves what a damaged tag or dimension asks for, be it gigabytes; here each is held against the bytes there are.

References
----------
The MathWorks: MAT-File Format, level 5.
"""

import io
import math
import struct
import zlib
from pathlib import Path
from typing import BinaryIO

from jointbayes.errors import MeasurementError
from jointbayes.measurement.formats.arrays.limits import check_unpacked, most_unpacked

__all__ = ["check_elements"]

_MATRIX, _COMPRESSED = 14, 15
_CELL, _STRUCT, _OBJECT, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 5, 16, 17
#: Nobody nests structs deeper.
_DEEPEST = 20


def check_elements(path: Path) -> None:
    """Walk all elements of a MAT file of version 5.

    Raises
    ------
    MeasurementError
        If one is cut off or damaged, unpacks to far more than the file's size, or is a function handle or an object.
    """
    size, most, total = path.stat().st_size, most_unpacked(path), 0
    with path.open("rb") as file:
        header = file.read(128)
        if len(header) < 128 or header[126:128] not in (b"IM", b"MI"):
            raise MeasurementError(
                "MAT file: found a damaged header; expected 128 bytes that end in the byte order; save it again"
            )
        order = "<" if header[126:128] == b"IM" else ">"
        number = 0
        while file.tell() < size:
            number += 1
            where = f"variable {number}"
            kind, start, _, end = _tag(file, size, order, where)
            if kind == _COMPRESSED:
                file.seek(start)
                engine = zlib.decompressobj()
                try:
                    content = engine.decompress(file.read(end - start), most - total + 1)
                except zlib.error as error:
                    raise MeasurementError(
                        f"{where}: found compressed data that cannot be unpacked ({error}); expected a complete file; "
                        "copy it again"
                    ) from None
                total += len(content)
                check_unpacked(path, total)
                _walk(io.BytesIO(content), len(content), order, where, 0)
            elif kind == _MATRIX:
                _matrix(file, start, end, order, where, 0)
            file.seek(end)


def _tag(file: BinaryIO, stop: int, order: str, where: str) -> tuple[int, int, int, int]:
    """Type of the element at the position of the file, its content's first byte and length, and the byte behind it."""
    here = file.tell()
    tag = file.read(8)
    if len(tag) == 8:
        kind, count = struct.unpack(f"{order}II", tag)
        if kind >> 16:  # up to four bytes stand within the tag
            return kind & 0xFFFF, here + 4, min(kind >> 16, 4), here + 8
        start = here + 8
        padded = count if kind == _COMPRESSED else -(-count // 8) * 8
        if start + count <= stop:
            return kind, start, count, min(start + padded, stop)
    raise MeasurementError(
        f"{where}: found an element that goes beyond its {stop - here} bytes; expected a complete one; the file is cut "
        "off or damaged, copy it again"
    )


def _walk(file: BinaryIO, stop: int, order: str, where: str, depth: int) -> None:
    if depth > _DEEPEST:
        raise MeasurementError(f"{where}: found structs within structs {depth} deep; expected arrays; save the arrays")
    while file.tell() < stop:
        kind, start, _, end = _tag(file, stop, order, where)
        if kind == _MATRIX:
            _matrix(file, start, end, order, where, depth + 1)
        file.seek(end)


def _matrix(file: BinaryIO, start: int, end: int, order: str, where: str, depth: int) -> None:
    """An array with all that is in it; an empty one has no content at all."""
    if start == end:
        return
    file.seek(start)
    kind, at, count, behind = _tag(file, end, order, where)
    file.seek(at)
    flags = file.read(count)
    if kind != 6 or len(flags) != 8:
        raise MeasurementError(f"{where}: found a damaged header of an array; expected its flags; copy the file again")
    class_ = struct.unpack(f"{order}I", flags[:4])[0] & 0xFF
    if class_ in (_OBJECT, _FUNCTION, _OPAQUE):
        raise MeasurementError(
            f"{where}: found a function handle or an object of MATLAB; expected numbers and text; save the arrays "
            "alone: save('file.mat', 'frequency_hz', 'frf', 'outputs', 'inputs')"
        )
    file.seek(behind)
    kind, at, count, behind = _tag(file, end, order, where)
    file.seek(at)
    sizes = file.read(count)
    dimensions = struct.unpack(f"{order}{len(sizes) // 4}i", sizes[: len(sizes) // 4 * 4])
    elements = math.prod(max(0, n) for n in dimensions)
    # a number or a character takes a byte at least, a cell the eight of its tag
    least = 8 * elements if class_ in (_CELL, _STRUCT) else elements
    if class_ != _SPARSE and least > end - start:
        raise MeasurementError(
            f"{where}: found {end - start} bytes for {elements} elements; expected {least} or more; the file is "
            "damaged, save it again"
        )
    file.seek(behind)
    _walk(file, end, order, where, depth)
