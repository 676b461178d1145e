"""What each reader gives of a file of matrices, and what all of them ask of text and of indices."""

import re
import warnings
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointbayes.errors import ModelError
from jointbayes.structure.imported.fe_model import DIRECTIONS
from vibrecords.arrays import Array, Indices

#: Rows of the largest model: what the reduction could not solve, and what damage makes of a count.
MOST_DOFS = 3_000_000
#: Directions of a node are below this, those of a program's own nodes as well.
MOST_WAYS = 64
#: Names of matrices in files of several: of Python and MATLAB, and of Nastran's superelements and DMIG.
_NAMES = {
    "stiffness": re.compile(r"k|k(mat|(aa|xx|gg|ff|ll|pp|2gg|2pp)x?)|stif\w*"),
    "mass": re.compile(r"m|m(mat|(aa|xx|gg|ff|ll|pp|2gg|2pp)x?)|mass\w*"),
    "damping": re.compile(r"[cb]|[cb]mat|b(aa|xx|gg|ff|ll|pp|2gg|2pp)x?|damp\w*"),
}
#: Directions as programs write them: 1, x, UX, ROTX, T1, R1; 0 is a generalised coordinate.
_DIRECTIONS = {"0": 0} | {
    word: i + 1
    for i, name in enumerate(DIRECTIONS)
    for word in (name, str(i + 1), f"t{i + 1}" if i < 3 else f"r{i - 2}", f"u{name}" if i < 3 else f"rot{name[1]}")
}


@dataclass(frozen=True)
class Entries:
    """Entries of one matrix as a file lists them: whole, or one triangle.

    `rows` and `columns` are indices from 0, shape (m,), of a matrix of `size` rows; or nodes with directions, shape
    (m, 2), in files that have these in place of indices.
    """

    rows: Indices
    columns: Indices
    values: Array
    size: int = 0

    @property
    def labelled(self) -> bool:
        """Whether rows are told by node and direction."""
        return self.rows.ndim == 2


@dataclass(frozen=True)
class Exported:
    """What a file holds: matrices by their role, ``""`` of one that the file does not tell, and what comes with them.

    `axes` are those of nodes whose DOFs stand in a system of their own: a column for each direction, shape (3, 3).
    """

    matrices: Mapping[str, Entries] = field(default_factory=dict)
    dofs: Indices | None = None
    nodes: Indices = field(default_factory=lambda: np.empty(0, dtype=np.intp))
    places: Array = field(default_factory=lambda: np.empty((0, 3)))
    edges: Indices | None = None
    axes: Mapping[int, Array] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def fault(where: object, found: str, expected: str, remedy: str) -> ModelError:
    """Refusal of a file: where, what was found, what is expected, what to do."""
    return ModelError.of(str(where), (), f"found {found}", expected, remedy)


def role_of(name: str) -> str | None:
    """Role of a matrix of this name: ``stiffness``, ``mass``, ``damping`` or None."""
    return next((role for role, known in _NAMES.items() if known.fullmatch(name.strip().lower())), None)


def direction_of(word: str, where: str) -> int:
    """Number of a direction by any of its names.

    Raises
    ------
    ModelError
        If it is none of a structure's.
    """
    number = _DIRECTIONS.get(word.strip().lower())
    if number is None:
        expected = "1 to 6, x to rz, UX to ROTZ, or 0 of a generalised coordinate"
        raise fault(where, f"the direction {word[:20]!r}", expected, "correct it, or export a structural model")
    return number


def indices(values: NDArray[Any], where: object, least: int = 1, most: int = MOST_DOFS) -> Indices:
    """Whole numbers within bounds, as integers.

    Raises
    ------
    ModelError
        If one is not.
    """
    with np.errstate(invalid="ignore"):
        bad = ~((values >= least) & (values <= most) & (values == np.rint(values)))
    if bad.any():
        first = np.unravel_index(int(np.argmax(bad)), bad.shape)
        expected = f"whole numbers from {least} to {most}"
        raise fault(f"{where}, entry {int(first[0]) + 1}", f"{values[first]:g}", expected, "export it again")
    return np.asarray(values).astype(np.intp)


def require_end(path: Path) -> None:
    """Refuse text whose last line has no end: its last number would be another one.

    Raises
    ------
    ModelError
        If the file was cut off there.
    """
    with path.open("rb") as file:
        file.seek(-1, 2)
        if file.read(1) != b"\n":
            raise fault(path, "no end of the last line", "a complete file", "copy or export it again")


def number_table(path: Path, columns: int, delimiter: str | None = None, skip: int = 0, comment: str = "*") -> Array:
    """Numbers of a text file in so many columns, shape (lines, columns).

    Raises
    ------
    ModelError
        If a line has something else, or the last one has no end, as in a file that was cut off.
    """
    require_end(path)
    with suppress(ValueError), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a file without numbers
        table = np.loadtxt(path, comments=comment, delimiter=delimiter, skiprows=skip, ndmin=2, encoding="latin-1")
        if table.size and table.shape[1] == columns:
            return table
    with path.open(encoding="latin-1") as lines:
        for number, line in enumerate(lines, 1):
            bare = line.partition(comment)[0].strip()
            if number <= skip or not bare:
                continue
            with suppress(ValueError):
                if len([float(word) for word in bare.split(delimiter)]) == columns:
                    continue
            raise fault(f"{path}, line {number}", repr(bare[:40]), f"{columns} numbers", "copy or export it again")
    raise fault(path, "no entries", f"lines of {columns} numbers", "copy or export it again")
