"""Text of Abaqus: ``*MATRIX OUTPUT``, by node and DOF or by row and column, and ``*SUBSTRUCTURE MATRIX OUTPUT``."""

import re
from pathlib import Path

import numpy as np

from jointbayes.structure.imported.entries import (
    MOST_WAYS,
    Entries,
    Exported,
    fault,
    indices,
    number_table,
    require_end,
)
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
        remedy = "export it with *MATRIX OUTPUT, FORMAT=MATRIX INPUT, which is the default"
        raise fault(path, repr(first.strip()[:40]), "lines of node, DOF, node, DOF, value", remedy)
    table = number_table(path, 5, delimiter)
    return Exported({"": Entries(_labels(table[:, :2], path), _labels(table[:, 2:4], path), table[:, 4])})


def read_substructure(path: Path) -> Exported:
    """K, M and viscous C of a substructure, ``*USER ELEMENT`` with ``*MATRIX, TYPE=``, and its map.

    The nodes stand in comments. The first line of DOFs is that of the first node; a further line names the node from
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
