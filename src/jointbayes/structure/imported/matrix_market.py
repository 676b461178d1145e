"""Matrix Market text, as SciPy, MATLAB and the ``*EXPORT, ..., MMF`` of Ansys write it."""

from pathlib import Path

import numpy as np

from jointbayes.structure.imported.entries import MOST_DOFS, Entries, Exported, fault, indices, number_table


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
