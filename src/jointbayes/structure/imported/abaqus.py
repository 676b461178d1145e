"""Text of ``*MATRIX OUTPUT`` of Abaqus: lines of node, DOF, node, DOF and value, or of row, column and value."""

from pathlib import Path

import numpy as np

from jointbayes.structure.imported.entries import MOST_WAYS, Entries, Exported, fault, indices, number_table
from vibrecords.arrays import Array, Indices


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
        remedy = "export it with *MATRIX OUTPUT, FORMAT=COORDINATE"
        raise fault(path, repr(first.strip()[:40]), "lines of node, DOF, node, DOF, value", remedy)
    table = number_table(path, 5, delimiter)
    return Exported({"": Entries(_labels(table[:, :2], path), _labels(table[:, 2:4], path), table[:, 4])})


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
