"""Matrices of a structure in files beside the case: read, checked, and put in the place of their names."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from jointbayes.arrays import Array
from jointbayes.case.files import require_inside
from jointbayes.case.schema.case import CaseSpec
from jointbayes.case.schema.matrices import MatricesSpec, MatrixDampingSpec, asymmetry
from jointbayes.errors import CaseError, printable

_MOST_BYTES = 200_000_000
_MOST_ROWS = 2000

Start = Callable[[tuple[str, ...]], str]
"""Start of a message about a key: file, line, key."""


def with_matrices(spec: CaseSpec, directory: Path, allow_outside: bool, start: Start) -> CaseSpec:
    """The case with the matrices of files that its structure names.

    Parameters
    ----------
    spec
        The case.
    directory
        Where files are looked for.
    allow_outside
        Whether they may lie elsewhere.
    start
        Gives the start of a message about a key.

    Raises
    ------
    CaseError
        If a file cannot be read, or holds no square, symmetric matrix of the right size: file and key.
    """
    structure = spec.structure
    if not isinstance(structure, MatricesSpec):
        return spec
    update: dict[str, object] = {}
    for key in ("stiffness", "mass"):
        named = getattr(structure, key)
        if isinstance(named, str):
            update[key] = _matrix(named, directory, allow_outside, start, ("structure", key), len(structure.dofs))
    damping = structure.damping
    if isinstance(damping, MatrixDampingSpec):
        given = damping.damping_matrix
        path = ("structure", "damping", "damping_matrix")
        if isinstance(given, str):
            given = _matrix(given, directory, allow_outside, start, path, len(structure.dofs))
        if len(given) != len(structure.dofs):
            raise CaseError(
                f"{start(path)} found {len(given)} rows for {len(structure.dofs)} DOFs; expected as many; correct it"
            )
        update["damping"] = damping.model_copy(update={"damping_matrix": given})
    return spec.model_copy(update={"structure": structure.model_copy(update=update)}) if update else spec


def _matrix(
    name: str, directory: Path, allow_outside: bool, start: Start, path: tuple[str, ...], rows: int
) -> tuple[tuple[float, ...], ...]:
    begin = f"{start(path)} {printable(name)}:"
    if not allow_outside:
        require_inside(directory, [name], lambda _number: start(path).rpartition(" ")[0], ".".join(path))
    matrix = _read(directory / name, begin)
    if matrix.ndim == 1 and matrix.size == rows:
        matrix = np.diag(matrix)
    if matrix.shape != (rows, rows):
        raise CaseError(
            f"{begin} found an array of shape {matrix.shape}; expected ({rows}, {rows}), a row for each of "
            "structure.dofs; correct the file or the labels"
        )
    if not np.isfinite(matrix).all():
        raise CaseError(f"{begin} found NaN or infinity; expected finite numbers; correct the file")
    words = asymmetry(matrix)
    if words is not None:
        raise CaseError(f"{begin} {words}; expected a symmetric matrix; correct one of the two entries")
    return tuple(map(tuple, matrix.tolist()))


def _read(file: Path, begin: str) -> Array:
    """Array of a .npy or .csv file."""
    kinds: Sequence[str] = (".npy", ".csv")
    if file.suffix.lower() not in kinds:
        raise CaseError(f"{begin} found the ending {file.suffix!r}; expected {' or '.join(kinds)}; rename the file")
    try:
        if not file.is_file():  # nor a pipe, which might never end
            raise CaseError(f"{begin} found no such file; expected one with the matrix; correct the name")
        if file.stat().st_size > _MOST_BYTES:
            raise CaseError(f"{begin} found more than {_MOST_BYTES:g} bytes; expected a matrix of {_MOST_ROWS} rows")
        if file.suffix.lower() == ".npy":
            found = np.load(file, allow_pickle=False)
        else:
            found = np.loadtxt(file, delimiter=",", ndmin=2)
        if found.dtype.kind not in "biuf":
            raise ValueError(f"numbers of kind {found.dtype}")
        return np.asarray(found, dtype=float)
    except (OSError, ValueError, EOFError, UnicodeError) as error:
        said = " ".join(str(error).split())[:100]
        raise CaseError(
            f"{begin} found no readable array ({said}); expected numbers, in .csv separated by commas; correct the file"
        ) from error
