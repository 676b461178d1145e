"""MATLAB 4 files, as ME'scope still writes them: full matrices of numbers and of text, one after the other."""

import re
import struct
from pathlib import Path
from typing import Any

import numpy as np

from vibrecords.arrays import complex_of
from vibrecords.formats.matlab_5 import Block, MatrixOf, Unread

#: By the digit P of the type: doubles, singles, and integers of 4, 2, 2 and 1 bytes.
_NUMBERS = ("f8", "f4", "i4", "i2", "u2", "u1")
_HEADER = 20


def _header(head: bytes) -> tuple[str, int, tuple[int, int], bool, int] | None:
    """Type of the numbers, kind, shape, whether complex, length of the name; None of another file."""
    for order, machine in (("<", 0), (">", 1000)):
        kind, rows, columns, imaginary, length = struct.unpack(f"{order}5i", head[:_HEADER].ljust(_HEADER, b"\xff"))
        digits, kind = divmod(kind - machine, 10)
        is_one = 0 <= digits < len(_NUMBERS) and 0 <= kind < 3 and min(rows, columns) >= 0 and imaginary in (0, 1)
        if is_one and 1 < length <= 64 and re.fullmatch(rb"[A-Za-z]\w*\0+", head[_HEADER : _HEADER + length]):
            return order + _NUMBERS[digits], kind, (rows, columns), bool(imaginary), length
    return None


def is_matlab_4(head: bytes) -> bool:
    """Whether a file begins with a matrix: the format has no other mark."""
    return _header(head) is not None


def read_matlab_4(path: Path, _most: int, _matrix: MatrixOf) -> Block:
    """All variables of a file; sparse ones are named and not read."""
    variables: Block = {}
    content, at = path.read_bytes(), 0
    while at < len(content):
        header = _header(content[at : at + _HEADER + 64])
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
