"""Harwell-Boeing files of Ansys, which HBMAT writes, and the mapping of their rows that is exported apart."""

import re
from pathlib import Path

import numpy as np

from jointbayes.structure.imported.entries import (
    MOST_DOFS,
    Entries,
    Exported,
    direction_of,
    fault,
    indices,
    require_end,
)
from vibrecords.arrays import Array, Indices

#: A format of Fortran such as ``(8I10)`` or ``(1P,3D25.16)``: fields of a line, and their width.
_FORMAT = re.compile(r"\((?:1P,?)?(\d*)[IEDFG](\d+)(?:\.\d+)?(?:E\d+)?\)", re.IGNORECASE)
#: A row of the mapping: its number, which may be missing, node, and label of the direction.
_ROW = re.compile(r"\s*(?:(\d{1,10})[\s,]+)?(\d{1,15})[\s,]+([A-Za-z]\w*)\s*")


def read_harwell_boeing(path: Path) -> Exported:
    """The one matrix of a file, real and symmetric (RSA) or whole (RUA), by columns.

    Raises
    ------
    ModelError
        If it is of another kind, not square, or cut off.
    """
    require_end(path)
    with path.open(encoding="latin-1") as lines:
        head = [lines.readline(1000) for _ in range(4)]
        counts = [int(head[1][at : at + 14].strip() or 0) for at in range(0, 70, 14)]
        kind = head[2][:3].upper()
        rows, columns, entries = (int(head[2][at : at + 14]) for at in (14, 28, 42))
        if kind not in ("RSA", "RUA"):
            remedy = "write the assembled real stiffness or mass matrix with HBMAT"
            raise fault(path, f"a matrix of the kind {kind!r}", "RSA", remedy)
        if rows != columns or not 0 < rows <= MOST_DOFS or not 0 <= entries <= path.stat().st_size:
            found = f"{rows} rows, {columns} columns, {entries} entries"
            raise fault(f"{path}, line 3", found, f"a square matrix of at most {MOST_DOFS} rows", "export it again")
        if counts[4] > 0:
            lines.readline(1000)
        formats = [_FORMAT.fullmatch(head[3][a:b].strip().replace(" ", "")) for a, b in ((0, 16), (16, 32), (32, 52))]
        if None in formats:
            raise fault(f"{path}, line 4", repr(head[3].strip()[:60]), "three formats of Fortran", "export it again")
        parts = []
        sizes = (columns + 1, entries, entries)
        for name, size, count, form in zip(("pointers", "indices", "values"), sizes, counts[1:], formats, strict=False):
            text = [lines.readline(1000).rstrip("\r\n") for _ in range(min(count, path.stat().st_size))]
            assert form is not None
            parts.append(_numbers(text, int(form[1] or 1), int(form[2]), size, f"{path}, {name}"))
    starts = indices(parts[0], f"{path}, pointers", most=entries + 1)
    steps = np.diff(starts)
    if steps.min(initial=0) < 0 or starts[-1] != entries + 1:
        raise fault(f"{path}, pointers", f"{starts[-1]} at the end", f"rising to {entries + 1}", "export it again")
    below = indices(parts[1], f"{path}, indices", most=rows) - 1
    return Exported({"": Entries(below, np.repeat(np.arange(columns), steps), parts[2], rows)})


def _numbers(lines: list[str], fields: int, width: int, count: int, where: str) -> Array:
    """Numbers parted by blanks, or in fields of one width, which may touch."""
    words = " ".join(lines).split()
    if len(words) != count and width:
        lines = [line.ljust(fields * width) for line in lines[: count // fields + 1]]
        words = [line[at : at + width].strip() for line in lines for at in range(0, fields * width, width)]
        words = [word for word in words if word]
    if len(words) != count:
        raise fault(where, f"{len(words)} numbers", f"{count} as the header says", "copy or export it again")
    return np.array([float(word.upper().replace("D", "E")) for word in words])


def read_mapping(path: Path) -> Indices:
    """Map of the DOFs from a ``.mapping`` of Ansys: lines of row, node and label such as ``UX``; others are titles.

    Raises
    ------
    ModelError
        If there are none, rows do not count from 1, or a label is no direction.
    """
    pairs: list[tuple[int, int]] = []
    with path.open(encoding="latin-1") as lines:
        for number, line in enumerate(lines, 1):
            row = _ROW.fullmatch(line.rstrip("\r\n"))
            if row is None:
                continue
            if row[1] and int(row[1]) != len(pairs) + 1:
                raise fault(f"{path}, line {number}", f"row {row[1]}", f"row {len(pairs) + 1}", "export it again")
            pairs.append((int(row[2]), direction_of(row[3], f"{path}, line {number}")))
    if not pairs:
        raise fault(path, "no DOFs", "lines of row, node and label such as 'UX'", "write it with HBMAT, ..., YES")
    return np.array(pairs, dtype=np.intp)
