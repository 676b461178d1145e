"""Matrices in npz, HDF5 and MATLAB files: K, M and C dense or sparse, with ``dofs``, ``nodes`` and ``xyz``."""

from pathlib import Path
from typing import Any

import numpy as np

from jointbayes.structure.imported.entries import Entries, Exported, direction_of, fault, indices, role_of
from vibrecords.arrays import Indices
from vibrecords.formats.array_files import read_arrays
from vibrecords.formats.matlab_5 import Block, Unread, column_parts
from vibrecords.formats.named_arrays import is_text, numbers, strings

#: A compressed file may unpack to this many times its size, or to 256 MiB: indices of a regular mesh pack well.
_RATIO, _ALWAYS = 40, 2**28
_DOFS, _NODES, _PLACES = ("dofs", "dof", "map"), ("nodes", "node"), ("xyz", "coordinates", "coords", "places")
#: Parts of a sparse matrix by columns or rows as SciPy and MATLAB name them; that of a symmetric one is the same.
_PARTS = {"ir": "indices", "jc": "indptr"}


def read_named_arrays(path: Path, kind: str) -> Exported:
    """All that is known of a model in an ``npz``, ``mat``, ``mat73`` or ``hdf5`` file.

    Raises
    ------
    ModelError
        If there is no matrix, or something else under a name that is known.
    """
    block = read_arrays(path, kind, max(_ALWAYS, _RATIO * path.stat().st_size), column_parts)
    alone = _parts(block, "")
    if alone is not None:
        return Exported({"": _entries(alone, str(path))})
    while not any(role_of(name) for name in block) and len(block) == 1 and isinstance(next(iter(block.values())), dict):
        block = next(iter(block.values()))  # a struct of MATLAB, a group
    names = {name: role_of(name) for name in block}
    names |= {name.rsplit("_", 1)[0]: role_of(name.rsplit("_", 1)[0]) for name in block if "_" in name}
    matrices = {}
    for name, role in names.items():
        value = _parts(block, f"{name}_") if name not in block else block[name]
        if role is None or value is None or (isinstance(value, np.ndarray) and value.size == 0):
            continue
        if role in matrices:
            raise fault(path, f"more than one matrix of {role}, also {name!r}", "one", "leave one in the file")
        matrices[role] = _entries(value, f"{path}, {name!r}")
    if not matrices:
        shown = ", ".join(sorted(block)[:8])[:120] or "nothing"
        raise fault(path, shown, "K and M", "save the matrices under these names")
    nodes, places = np.empty(0, dtype=np.intp), np.empty((0, 3))
    dofs, given = _first(block, _DOFS), _first(block, _NODES)
    if given is not None:
        nodes = indices(numbers(given, f"{path}, 'nodes'").ravel(), f"{path}, 'nodes'", most=2**53)
    if (xyz := _first(block, _PLACES)) is not None:
        places = numbers(xyz, f"{path}, 'xyz'")
        if places.shape != (nodes.size, 3):
            found = f"coordinates of shape {places.shape} for {nodes.size} nodes"
            raise fault(f"{path}, 'xyz'", found, "a row x, y, z for each of 'nodes'", "save both of the same mesh")
    rows = None if dofs is None else _dofs(dofs, nodes, f"{path}, 'dofs'")
    unique, first = np.unique(nodes, return_index=True)
    return Exported(matrices, rows, *((unique, places[first]) if len(places) else ()))


def _first(block: Block, names: tuple[str, ...]) -> Any:  # noqa: ANN401 (anything a file holds)
    lower = {name.lower(): value for name, value in block.items()}
    return next((lower[name] for name in names if name in lower), None)


def _parts(block: Block, prefix: str) -> Block | None:
    """Parts of a sparse matrix that stand side by side: ``K_data``, ``K_indices``, ``K_indptr``."""
    parts = {name[len(prefix) :].lower(): value for name, value in block.items() if name.startswith(prefix)}
    parts = {_PARTS.get(name, name): value for name, value in parts.items()}
    return parts if "data" in parts and ("indptr" in parts or "row" in parts) else None


def _entries(value: Any, where: str) -> Entries:  # noqa: ANN401
    """Entries of a dense matrix, or of the parts of a sparse one."""
    if isinstance(value, Unread):
        raise fault(where, value.what, "a matrix of numbers", "save it as a plain matrix")
    if not isinstance(value, dict):
        dense = numbers(value, where)
        if dense.ndim != 2 or dense.shape[0] != dense.shape[1]:
            raise fault(where, f"shape {dense.shape}", "a square matrix", "save K and M of the same model")
        rows, columns = np.nonzero(dense)
        return Entries(rows, columns, dense[rows, columns], len(dense))
    parts = {_PARTS.get(name, name): part for name, part in value.items()}
    form = strings(parts["format"], where)[0] if is_text(parts.get("format")) else ""
    if form not in ("", "csc", "csr", "coo") or not ("indptr" in parts or {"row", "col"} <= parts.keys()):
        raise fault(where, f"a sparse matrix in the form {form!r}", "csc", "save it after .tocsc()")
    data = numbers(parts.get("data", np.zeros(0)), where).ravel()
    if "indptr" in parts:
        ends = indices(numbers(parts["indptr"], where).ravel(), where, 0, data.size)  # MATLAB has room behind the last
        size, rows, columns = ends.size - 1, parts["indices"], np.repeat(np.arange(ends.size - 1), np.diff(ends))
    else:
        size, rows, columns = int(np.max(parts.get("shape", 0))), parts["row"], parts["col"]
    count, shape = np.size(columns), np.ravel(parts.get("shape", (size, size))).tolist()
    rows, columns = (indices(numbers(ends, where).ravel()[:count], where, 0, size - 1) for ends in (rows, columns))
    if shape != [size, size] or not len(rows) == len(columns) <= data.size:
        found = f"shape {tuple(shape)}, {len(rows)} indices for {count} entries"
        raise fault(where, found, "a whole square matrix", "save K and M of the same model")
    return Entries(rows, columns, data[:count], size)


def _dofs(given: Any, nodes: Indices, where: str) -> Indices:  # noqa: ANN401
    """Map of the DOFs: pairs of node and direction, directions of as many `nodes`, or labels such as ``11:y``."""
    if is_text(given):
        words = [text.rpartition(":") for text in strings(given, where)]
        return np.array([(int(node), direction_of(way, where)) for node, _, way in words], dtype=np.intp)
    pairs = numbers(given, where)
    if pairs.size == nodes.size and 1 in (pairs.ndim, *pairs.shape):
        pairs = np.stack([nodes, pairs.ravel()], axis=1)
    if pairs.ndim != 2 or pairs.shape[1] != 2:
        raise fault(where, f"shape {pairs.shape}", "a row (node, direction) for each row of K", "correct the map")
    indices(pairs[:, 1], where, 0, 6)
    return indices(pairs, where, 0, 2**53)
