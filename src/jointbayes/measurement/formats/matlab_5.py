"""MATLAB 5 files (up to v7): arrays of numbers, of characters, cells of text, and structs of these.

Why not `scipy.io.loadmat`: about one in a hundred damaged files ends the process there (types of elements, widths of
names and the depth of cells are not checked in C), and to check them first takes as many lines as to read them.

References
----------
The MathWorks: MAT-File Format, level 5 MAT-files.
"""

import math
import struct
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import MeasurementError

Block = dict[str, Any]

REMEDY = "store plain numbers and text in this file"
#: Numbers of the format's data types.
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CODECS = {1: "utf-8", 2: "utf-8", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_CELL, _STRUCT, _OBJECT, _CHARACTERS, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_COMPLEX = 1 << 11


def read_matlab(path: Path, most: int) -> Iterator[tuple[str, Block]]:
    """All variables as one block, and each element of a struct as a block of its own; `most` bytes may be unpacked."""
    top: Block = {}
    structs: dict[str, Block] = {}
    unpacked, size = 0, path.stat().st_size
    with path.open("rb") as file:
        header = file.read(128)
        if len(header) < 128:
            raise ValueError(f"a header of {len(header)} bytes")
        order = "<" if header[126:] == b"IM" else ">"
        while tag := file.read(8):
            kind, length = struct.unpack(f"{order}II", tag)
            content = file.read(min(length, size))
            if len(content) < length:
                raise ValueError(f"{length} bytes, of which {len(content)} are there")
            if kind == 15:
                content = zlib.decompressobj().decompress(content, most - unpacked + 1)
                unpacked += len(content)
                refuse_larger(unpacked, most)
                content = content[8:]
            name, value = _variable(content, order)
            if isinstance(value, list):
                places = [f"{name}." if len(value) == 1 else f"{name}({i + 1})." for i in range(len(value))]
                structs |= dict(zip(places, value, strict=True))
            elif name:  # nameless is what MATLAB keeps for itself
                top[name] = value
    if top:
        yield "", top
    yield from structs.items()


def refuse_larger(size: float, most: int) -> None:
    """Refuse arrays that are far larger than their file.

    Raises
    ------
    MeasurementError
        If there are more than `most` bytes.
    """
    if size > most:
        raise MeasurementError(
            f"content: found arrays of {size / 1e6:.3g} MB or more; expected at most {most / 1e6:.3g} MB in a file of "
            "this size; save it again without compression"
        )


def _variable(content: bytes, order: str, where: str = "") -> tuple[str, Any]:
    """Name and value of a matrix: an array of numbers or text, or the elements of a struct, each a block.

    `where` is its place where it is within another one, which no struct may be.
    """
    (_, flags), *elements = _elements(content, order)
    word = struct.unpack_from(f"{order}I", flags)[0]
    kind = word & 255
    name = elements[0 if kind == _OPAQUE else 1][1].decode("latin-1")
    place = where or f"variable '{name}'"
    if kind in (_OBJECT, _FUNCTION, _OPAQUE):
        raise MeasurementError(f"{place}: found a function handle or an object of MATLAB; expected numbers; {REMEDY}")
    if kind == _SPARSE or (kind == _STRUCT and where):
        raise MeasurementError(f"{place}: found a sparse matrix or a struct; expected a full array; {REMEDY}")
    (_, dimensions), _, *elements = elements
    shape = struct.unpack(f"{order}{len(dimensions) // 4}i", dimensions)
    if min(shape) < 0:
        raise ValueError(f"shape {shape}")
    if kind == _STRUCT:
        return name, _struct_elements(elements, shape, name, order)
    if kind == _CELL:
        texts = [_cell_text(cell, order, place) for _, cell in elements]
        return name, np.array(_reorder_by_rows(texts, shape), dtype=str)
    if kind == _CHARACTERS:
        return name, _char_rows(*elements[0], shape, order) if elements else np.array([], dtype=str)
    real, *imaginary = (np.frombuffer(data, f"{order}{_TYPES[code]}") for code, data in elements)
    numbers = real.astype(real.dtype.newbyteorder("="))
    if word & _COMPLEX:
        numbers = np.empty(real.size, complex)
        numbers.real, numbers.imag = real, imaginary[0]
    return name, numbers.reshape(shape, order="F")


def _elements(content: bytes, order: str) -> list[tuple[int, bytes]]:
    """Types and bytes of the data elements that follow each other."""
    elements, at = [], 0
    while at < len(content):
        kind, size = struct.unpack_from(f"{order}II", content, at)
        if kind >> 16:  # up to four bytes within the tag
            kind, size = kind & 0xFFFF, kind >> 16
            elements.append((kind, content[at + 4 : at + 4 + size]))
            at += 8
            continue
        if at + 8 + size > len(content):
            raise ValueError(f"{size} bytes, of which {len(content) - at - 8} are there")
        elements.append((kind, content[at + 8 : at + 8 + size]))
        at += 8 + size + -size % 8
    return elements


def _reorder_by_rows(items: Sequence[Any], shape: tuple[int, ...]) -> list[Any]:
    """Items of an array that MATLAB stores column by column, row by row."""
    return [items[i] for i in np.arange(len(items)).reshape(shape, order="F").ravel().tolist()]


def _struct_elements(elements: list[tuple[int, bytes]], shape: tuple[int, ...], name: str, order: str) -> list[Block]:
    (_, length), (_, names), *values = elements
    width = struct.unpack(f"{order}i", length)[0]
    fields = [names[i : i + width].split(b"\0")[0].decode("latin-1") for i in range(0, len(names), width)]
    numbers = range(len(values) // max(len(fields), 1))
    blocks = []
    for i, number in enumerate(_reorder_by_rows(numbers, shape)):
        place = f"{name}." if len(numbers) == 1 else f"{name}({i + 1})."
        given = zip(fields, values[number * len(fields) :], strict=False)
        blocks.append({key: _variable(value, order, f"variable '{place}{key}'")[1] for key, (_, value) in given})
    return blocks


def _cell_text(content: bytes, order: str, place: str) -> str:
    text = _variable(content, order, place)[1] if content else np.array([], dtype=str)
    if text.size and (text.dtype.kind != "U" or text.size > 1):
        raise MeasurementError(f"{place}: found cells that are not text; expected a cell array of labels; {REMEDY}")
    return "" if text.size == 0 else str(text.ravel()[0])


def _char_rows(kind: int, data: bytes, shape: tuple[int, ...], order: str) -> NDArray[np.str_]:
    """Rows of an array of characters, as texts."""
    count, codec = math.prod(shape), _CODECS[kind]
    if not data or not count:
        return np.array([], dtype=str)
    if count > len(data):
        raise ValueError(f"{count} characters in {len(data)} bytes")
    text = data.decode(codec if codec == "utf-8" else f"{codec}-{'le' if order == '<' else 'be'}", errors="replace")
    rows = np.array(list(text.ljust(count)[:count]), dtype="U1").reshape(shape, order="F").reshape(-1, shape[-1])
    return np.array(["".join(row) for row in rows], dtype=str)
