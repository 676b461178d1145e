"""Files of ``*FREQUENCY, SOLVER=MATRIXSTORAGE`` of CalculiX: ``.sti`` and ``.mas`` (upper triangle), and ``.dof``."""

import re
from pathlib import Path

import numpy as np

from jointbayes.structure.imported.entries import MOST_DOFS, Entries, Exported, fault, indices, number_table
from vibrecords.arrays import Indices

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
