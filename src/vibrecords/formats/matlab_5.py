"""MATLAB 5 files (up to v7) as one tree: structs are dicts, cells and arrays of structs lists, the rest arrays.

MATLAB 4 files, as ME'scope still writes them, are full matrices of numbers and of text, one after the other.

Why not `scipy.io.loadmat`: about one in a hundred damaged files ends the process there (types of elements, widths of
names and the depth of cells are not checked in C), and to check them first takes as many lines as to read them.

References
----------
The MathWorks: MAT-File Format, level 5 MAT-files.
"""

import math
import re
import struct
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrecords.arrays import complex_of
from vibrecords.errors import refusal

#: Names to what stands under them: arrays of numbers or text, further blocks, lists of both, or `Unread`.
Block = dict[str, Any]

#: Sign between the name of a data set and that of its attribute.
ATTRIBUTE = "@"
REMEDY = "store plain numbers and text in this file"
#: Groups, structs and cells within each other, and all that a file holds; no export comes near.
DEEPEST, MOST_OBJECTS = 32, 200_000
#: Numbers of the format's data types.
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CODECS = {1: "utf-8", 2: "utf-8", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
_CELL, _STRUCT, _OBJECT, _CHARACTERS, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_COMPLEX = 1 << 11


@dataclass(frozen=True, slots=True)
class Unread:
    """What a file has where neither numbers nor text are."""

    what: str


UNREADABLE = Unread("a function handle or an object of MATLAB")


def read_matlab(path: Path, most: int, matrix: "MatrixOf") -> Block:
    """All variables of a file, of which `most` bytes may be unpacked."""
    variables: Block = {}
    unpacked, size = 0, path.stat().st_size
    with path.open("rb") as file:
        header = file.read(128)
        if len(header) < 128:
            raise ValueError(f"a header of {len(header)} bytes")
        order = "<" if header[126:] == b"IM" else ">"
        reader = _Reader(order, most, matrix)
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
            name, value = reader.variable(content)
            if name:  # nameless is what MATLAB keeps for itself
                variables[name] = value
    return variables


def refuse_larger(size: float, most: int) -> None:
    """Refuse arrays that are far larger than their file.

    Raises
    ------
    MeasurementError
        If there are more than `most` bytes.
    """
    if size > most:
        found, remedy = f"arrays of {size / 1000000.0:.3g} MB or more", "save it again without compression"
        raise refusal("content", found, f"at most {most / 1000000.0:.3g} MB in a file of this size", remedy)


def refuse_deeper(depth: int, count: int, where: str) -> None:
    """Refuse what lies deeper than any export, or is more.

    Raises
    ------
    MeasurementError
        If it is deeper than `DEEPEST` or more than `MOST_OBJECTS`.
    """
    if depth > DEEPEST or count > MOST_OBJECTS:
        found = f"groups {depth} deep, {count} entries so far"
        raise refusal(where[:80], found, f"at most {DEEPEST} deep and {MOST_OBJECTS} entries", REMEDY)


def full_matrix(
    shape: tuple[int, ...], rows: NDArray[Any], starts: NDArray[Any], values: NDArray[Any], most: int
) -> NDArray[Any] | Unread:
    """Matrix of a sparse one, stored by columns, where it is no larger than `most` bytes."""
    if len(shape) != 2 or 16 * math.prod(shape) > most:
        return Unread("a sparse matrix, too large to be written in full")
    ends = starts.astype(np.int64)
    counts = ends[1:] - ends[:-1]
    used = int(counts.sum())
    if counts.size != shape[1] or counts.min(initial=0) < 0 or not 0 <= used <= min(rows.size, values.size):
        raise ValueError(f"a sparse matrix of {values.size} values")
    matrix = np.zeros(shape, values.dtype if values.size else float)
    matrix[rows[:used].astype(np.int64), np.repeat(np.arange(shape[1]), counts)] = values[:used]
    return matrix


def column_parts(
    shape: tuple[int, ...], rows: NDArray[Any], starts: NDArray[Any], values: NDArray[Any], _most: int
) -> Block:
    """A sparse matrix as its parts, named as SciPy names them."""
    return {"shape": np.array(shape), "indices": rows, "indptr": starts, "data": values}


#: What makes something of a sparse matrix: its shape, parts, and bytes that are left.
MatrixOf = Callable[[tuple[int, ...], NDArray[Any], NDArray[Any], NDArray[Any], int], Any]


def list_or_texts(items: list[Any]) -> list[Any] | NDArray[np.str_]:
    """Cells as one array where all of them are texts, or texts and empty ones."""
    arrays = [item for item in items if isinstance(item, np.ndarray) and (item.size == 0 or item.dtype.kind == "U")]
    if len(arrays) == len(items) and all(item.size < 2 for item in arrays):
        return np.array([str(item.ravel()[0]) if item.size else "" for item in arrays], dtype=str)
    return items


class _Reader:
    """Reads the variables of a file, however structs and cells are within each other."""

    def __init__(self, order: str, most: int, matrix: MatrixOf) -> None:
        self.order, self.left, self.count, self.matrix = order, most, 0, matrix

    def variable(self, content: bytes, depth: int = 0, where: str = "") -> tuple[str, Any]:
        """Name and value of a matrix."""
        self.count += 1
        refuse_deeper(depth, self.count, where)
        if not content:
            return "", np.zeros((0, 0))
        (_, flags), *elements = _elements(content, self.order)
        word = struct.unpack_from(f"{self.order}I", flags)[0]
        kind = word & 255
        name = elements[0 if kind == _OPAQUE else 1][1].decode("latin-1")
        where = where or f"variable '{name}'"
        if kind in (_OBJECT, _FUNCTION, _OPAQUE):
            return name, UNREADABLE
        (_, dimensions), _, *elements = elements
        shape = struct.unpack(f"{self.order}{len(dimensions) // 4}i", dimensions)
        if min(shape) < 0:
            raise ValueError(f"shape {shape}")
        if kind == _STRUCT:
            (_, length), (_, names), *values = elements
            width = struct.unpack(f"{self.order}i", length)[0]
            if not names:  # an array of structs without fields holds nothing, however many there are
                return name, {}
            fields = [names[i : i + width].split(b"\0")[0].decode("latin-1") for i in range(0, len(names), width)]
            read = [self.variable(value, depth + 1, where)[1] for _, value in values]
            count = len(read) // max(len(fields), 1)
            blocks = [dict(zip(fields, read[i * len(fields) :], strict=False)) for i in range(count)]
            return name, blocks[0] if math.prod(shape) == count == 1 else _reorder_by_rows(blocks, shape)
        if kind == _CELL:
            cells = [self.variable(cell, depth + 1, where)[1] for _, cell in elements]
            return name, list_or_texts(_reorder_by_rows(cells, shape))
        if kind == _CHARACTERS:
            return name, _char_rows(*elements[0], shape, self.order) if elements else np.array([], dtype=str)
        count = 4 if kind == _SPARSE else 2  # indices of a sparse matrix, real part, imaginary part or none
        raw = [np.frombuffer(data, f"{self.order}{_TYPES[code]}") for code, data in elements[:count]]
        parts = [numbers.astype(numbers.dtype.newbyteorder("=")) for numbers in raw]
        *indices, real, imaginary = parts if len(parts) == count else [*parts, np.zeros(0)]
        numbers = complex_of(real, imaginary) if word & _COMPLEX else real
        if kind == _SPARSE:
            matrix = self.matrix(shape, indices[0], indices[1], numbers, self.left)
            self.left -= getattr(matrix, "nbytes", 0)
            return name, matrix
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


#: By the digit P of the type: doubles, singles, and integers of 4, 2, 2 and 1 bytes.
_NUMBERS = ("f8", "f4", "i4", "i2", "u2", "u1")
_HEADER = 20


def matlab_4_header(head: bytes) -> tuple[str, int, tuple[int, int], bool, int] | None:
    """Type of the numbers, kind, shape, whether complex, length of the name; None of another file.

    A file begins with a matrix: the format has no other mark.
    """
    for order, machine in (("<", 0), (">", 1000)):
        kind, rows, columns, imaginary, length = struct.unpack(f"{order}5i", head[:_HEADER].ljust(_HEADER, b"\xff"))
        digits, kind = divmod(kind - machine, 10)
        is_one = 0 <= digits < len(_NUMBERS) and 0 <= kind < 3 and min(rows, columns) >= 0 and imaginary in (0, 1)
        if is_one and 1 < length <= 64 and re.fullmatch(rb"[A-Za-z]\w*\0+", head[_HEADER : _HEADER + length]):
            return order + _NUMBERS[digits], kind, (rows, columns), bool(imaginary), length
    return None


def read_matlab_4(path: Path, _most: int, _matrix: MatrixOf) -> Block:
    """All variables of a file; sparse ones are named and not read."""
    variables: Block = {}
    content, at = path.read_bytes(), 0
    while at < len(content):
        header = matlab_4_header(content[at : at + _HEADER + 64])
        if header is None:
            raise ValueError(f"no matrix at byte {at}")
        numbers, kind, shape, is_complex, length = header
        name, at = content[at + _HEADER : at + _HEADER + length].split(b"\0")[0].decode("ascii"), at + _HEADER + length
        count = shape[0] * shape[1]
        parts: Any = np.frombuffer(content, numbers, count * (1 + is_complex), at).astype(f"={numbers[1:]}")
        at += parts.size * int(numbers[-1])
        values = (complex_of(parts[:count], parts[count:]) if is_complex else parts).reshape(shape, order="F")
        if kind == 1:
            codes = np.clip(np.nan_to_num(values.real), 0, 0xFFFF).astype(int).tolist()
            values = np.array(["".join(map(chr, row)) for row in codes], dtype=str)
        variables[name] = Unread("a sparse matrix of MATLAB 4") if kind == 2 else values
    return variables
