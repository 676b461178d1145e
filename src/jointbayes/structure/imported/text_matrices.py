"""Matrices and maps of their rows as text of other programs.

Harwell-Boeing files of Ansys, which HBMAT writes, and the mapping of their rows that is exported apart. Abaqus:
``*MATRIX OUTPUT``, by node and DOF or by row and column, and ``*SUBSTRUCTURE MATRIX OUTPUT``. Matrix Market, as SciPy,
MATLAB and the ``*EXPORT, ..., MMF`` of Ansys write it. CalculiX with ``*FREQUENCY, SOLVER=MATRIXSTORAGE``: ``.sti`` and
``.mas`` (upper triangle), and ``.dof``.
"""

import re
from pathlib import Path

import numpy as np

from jointbayes.structure.imported.entries import (
    MOST_DOFS,
    MOST_WAYS,
    Entries,
    Exported,
    direction_of,
    fault,
    indices,
    number_table,
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


def read_abaqus(path: Path) -> Exported:
    """The one matrix of a file, as a rule one triangle of it.

    Raises
    ------
    ModelError
        If lines are of another kind, or a DOF is none of a structure's.
    """
    with path.open(encoding="latin-1") as lines:
        first = next((line for line in lines if line.strip() and not line.startswith("**")), "")
    delimiter = "," if "," in first else None
    columns = len(first.strip().split(delimiter))
    if columns == 3:
        table = number_table(path, 3, delimiter)
        rows, ends = indices(table[:, :2], path).T - 1
        return Exported({"": Entries(rows, ends, table[:, 2])})
    if columns != 5:
        remedy = "export it with *MATRIX OUTPUT, FORMAT=MATRIX INPUT, which is the default"
        raise fault(path, repr(first.strip()[:40]), "lines of node, DOF, node, DOF, value", remedy)
    table = number_table(path, 5, delimiter)
    return Exported({"": Entries(_labels(table[:, :2], path), _labels(table[:, 2:4], path), table[:, 4])})


def read_substructure(path: Path) -> Exported:
    """K, M and viscous C of a substructure, ``*USER ELEMENT`` with ``*MATRIX, TYPE=``, and its map.

    The nodes stand in comments. The first line of DOFs belongs to the first node; a further line names the node from
    which on others hold, by its place. Nodes below 1 are modes: generalised coordinates. Each matrix is a triangle.

    Raises
    ------
    ModelError
        If there are several elements, a number is missing, or a DOF is none of a structure's.
    """
    require_end(path)
    nodes: list[int] = []
    ways: dict[int, list[int]] = {}
    numbers: dict[str, list[float]] = {}
    block = ""
    with path.open(encoding="latin-1") as lines:
        for number, line in enumerate(lines, 1):
            words = [word.strip() for word in line.strip("* \n").split(",") if word.strip()]
            try:
                if re.match(r"\*\*\s*ELEMENT NODES", line, re.IGNORECASE):
                    block = "nodes"
                elif line.startswith("**"):
                    listed = block == "nodes" and all(re.fullmatch(r"[+-]?\d{1,15}", word) for word in words)
                    nodes += map(int, words if listed else ())
                elif line.startswith("*"):
                    block = line.upper().partition("TYPE=")[2].strip() if line[:7].upper() == "*MATRIX" else "ways"
                    if block in numbers or (block == "ways" and ways):
                        raise fault(f"{path}, line {number}", repr(line.strip()[:40]), "one substructure", "split it")
                    if block != "ways":
                        numbers[block] = []
                elif block in numbers:
                    numbers[block] += map(float, words)
                elif words:
                    place, *rest = map(int, words)
                    ways |= {place: rest} if ways else {1: [place, *rest]}
            except ValueError:
                raise fault(f"{path}, line {number}", repr(line.strip()[:40]), "numbers", "export it again") from None
    pairs = [
        (node, way)
        for place, node in enumerate(nodes, 1)
        for way in ways[max((first for first in ways if first <= place), default=1)]
    ] if ways else []  # fmt: skip
    if not pairs:
        raise fault(path, "no nodes or no DOFs", "comments with ELEMENT NODES, and lines of DOFs", "export it again")
    rows, columns = np.tril_indices(len(pairs))
    roles = {"STIFFNESS": "stiffness", "MASS": "mass", "VISCOUS DAMPING": "damping"}
    matrices = {}
    for name, role in roles.items():
        if name in numbers:
            if len(numbers[name]) != rows.size:
                found, expected = f"{len(numbers[name])} numbers of {name} for {len(pairs)} DOFs", f"{rows.size}"
                raise fault(path, found, f"{expected}, one triangle", "copy or export it again, symmetric")
            matrices[role] = Entries(rows, columns, np.array(numbers[name]), len(pairs))
    dofs = _labels(np.array(pairs, dtype=float), path)
    own = dofs[:, 0] < 1
    dofs[own] = np.stack([-np.arange(own.sum()) - 1, np.zeros(own.sum(), dtype=np.intp)], axis=1)
    return Exported(matrices, dofs)


def _labels(pairs: Array, path: Path) -> Indices:
    """Nodes and DOFs; those of nodes below 1 are Abaqus's own (Lagrange multipliers, modes)."""
    found = indices(pairs, path, -(2**53), 2**53)
    ways, real = found[:, 1], found[:, 0] >= 1
    foreign = np.where(real, (ways < 1) | (ways > 6), (ways < 0) | (ways >= MOST_WAYS))
    if foreign.any():
        at = int(np.argmax(foreign))
        node, way = found[at]
        raise fault(f"{path}, entry {at + 1}", f"DOF {way} of node {node}", "1 to 6", "export a structural model")
    return found


def read_matrix_market(path: Path) -> Exported:
    """The one matrix of a file, real and symmetric or general, as coordinates or as a whole array.

    Raises
    ------
    ModelError
        If it is of another kind, not square, or has another number of entries than its header says.
    """
    with path.open(encoding="latin-1") as lines:
        words = lines.readline(1000).lower().split()
        kind = (words + [""] * 5)[2:5]
        sizes, skip = "%", 1
        while sizes.startswith("%") or (sizes and not sizes.strip()):
            sizes, skip = lines.readline(1000), skip + 1
    known = kind[0] in ("coordinate", "array") and kind[1] in ("real", "integer", "double")
    if not known or kind[2] not in ("symmetric", "general"):
        remedy = "export the real matrix, not complex, a pattern or skew-symmetric"
        raise fault(path, f"the header {' '.join(words)[:80]!r}", "coordinate real symmetric", remedy)
    expected, fields = ("rows, columns and entries", 3) if kind[0] == "coordinate" else ("rows and columns", 2)
    counts = [int(word) if word.isascii() and word.isdigit() and len(word) < 12 else 0 for word in sizes.split()]
    if len(counts) != fields or counts[0] != counts[1] or not 0 < counts[0] <= MOST_DOFS:
        found = f"the sizes {sizes.strip()[:60]!r}"
        raise fault(f"{path}, line {skip}", found, f"{expected} of a square matrix", "export it again")
    size = counts[0]
    if kind[0] == "coordinate":
        table = number_table(path, 3, skip=skip, comment="%")
        _require_count(path, len(table), counts[2])
        rows, columns = indices(table[:, :2], path, most=size).T - 1
        return Exported({"": Entries(rows, columns, table[:, 2], size)})
    triangle = kind[2] == "symmetric"
    values = number_table(path, 1, skip=skip, comment="%").ravel()
    _require_count(path, values.size, size * (size + 1) // 2 if triangle else size * size)
    columns, rows = np.triu_indices(size) if triangle else np.divmod(np.arange(size * size), size)
    return Exported({"": Entries(rows, columns, values, size)})


def _require_count(path: Path, found: int, expected: int) -> None:
    if found != expected:
        raise fault(path, f"{found} entries", f"{expected} as its header says", "copy or export it again")


_DOF = re.compile(r"(\d{1,15})\.([1-6])")


def read_calculix(path: Path) -> Exported:
    """The one matrix of a ``.sti`` or ``.mas``.

    Raises
    ------
    ModelError
        If a line is of another kind, or the last is not that of the last row, as in a file that was cut off.
    """
    table = number_table(path, 3)
    rows, columns = indices(table[:, :2], path).T - 1
    size = int(max(rows.max(), columns.max())) + 1
    if not rows[-1] == columns[-1] == size - 1:
        found = f"row {rows[-1] + 1}, column {columns[-1] + 1} in the last line"
        raise fault(path, found, f"row and column {size}", "copy or export it again: it is cut off")
    return Exported({"": Entries(rows, columns, table[:, 2], size)})


def read_dof_file(path: Path) -> Indices:
    """Map of the DOFs from a ``.dof``: ``12.3`` is direction 3 of node 12.

    Raises
    ------
    ModelError
        If a line is none of these.
    """
    pairs = []
    with path.open(encoding="latin-1") as lines:
        for number, line in enumerate(lines, 1):
            found = _DOF.fullmatch(line.strip())
            if found is None or number > MOST_DOFS or not line.endswith("\n"):
                raise fault(
                    f"{path}, line {number}", repr(line.strip()[:20]), "a line 'node.direction'", "export it again"
                )
            pairs.append((int(found[1]), int(found[2])))
    return np.array(pairs, dtype=np.intp).reshape(-1, 2)
