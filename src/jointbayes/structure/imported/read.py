"""`read_structure`: a finite-element model from the files of any program, told by what is in them."""

import math
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from jointbayes.errors import ModelError, require
from jointbayes.structure.imported import text_matrices
from jointbayes.structure.imported.axes import require_own_axes
from jointbayes.structure.imported.entries import MOST_DOFS, MOST_WAYS, Entries, Exported, fault
from jointbayes.structure.imported.fe_model import FeModel, Sparse
from jointbayes.structure.imported.mesh import read_map, read_nodes
from jointbayes.structure.imported.named_arrays import read_named_arrays
from jointbayes.structure.imported.nastran import read_assembly, read_dmig, read_op4
from vibrecords.arrays import Array, Indices
from vibrecords.errors import MeasurementError
from vibrecords.records import MOST_BYTES

PathLike = str | Path
#: Length in m and energy in J of a consistent system of units: m-kg-s, mm-t-s, in-lbf-s, ft-lbf-s.
UNITS = {"m": (1.0, 1.0), "mm": (1e-3, 1e-3), "in": (0.0254, 0.112984829027616), "ft": (0.3048, 1.3558179483314004)}
#: Entries are below this, so that no product of two overflows.
_LARGEST = 1e100
#: Abaqus writes this on the diagonal of a DOF that is held.
_HELD = 1e35
#: Mass over the cube of the longest side of beams and shells, kg/m³: a wire of 10 m and 1 mm has 6e-5. Mass over the
#: box of a solid: below 1 it is lighter than air, as steel in inches that is taken for feet (0.4) or metres (7e-4).
_SPARSEST, _SPARSEST_SOLID, _DENSEST = 1e-5, 1.0, 5e4
#: Densities of a unit that is proposed, kg/m³.
_LIKELY = 100.0, 23_000.0


def read_structure(
    path: PathLike,
    *,
    mass: PathLike | None = None,
    damping: PathLike | None = None,
    dofs: PathLike | None = None,
    nodes: PathLike | None = None,
    length_unit: str,
) -> FeModel:
    """A structure without its joints from the files of a finite-element program.

    What kind a file is of is told by what is in it. Files that a program writes together are found by their
    names: ``.mas`` and ``.dof`` of CalculiX, ``_MASS`` of Abaqus, ``.asm`` of Nastran, ``.mapping`` of Ansys, and the
    ``.inp`` of CalculiX and Abaqus for the coordinates.

    Parameters
    ----------
    path
        Stiffness, or all matrices: npz, MATLAB, HDF5, Matrix Market, OP4 or DMIG punch of Nastran, ``*MATRIX OUTPUT``
        or ``*SUBSTRUCTURE MATRIX OUTPUT`` of Abaqus, ``.sti`` of CalculiX, Harwell-Boeing or Matrix Market of Ansys.
    mass, damping
        Mass and viscous damping where they are files of their own.
    dofs
        Node and direction of each row, where the matrices have none: CSV ``node,direction``, or a ``.dof``, ``.asm``
        or ``.mapping``.
    nodes
        Where nodes are: CSV ``node,x,y,z``, an ``.inp``, GRID cards, or a ``.cdb`` with NBLOCK.
    length_unit
        ``"m"`` for models in m, kg, N, s; ``"mm"`` in mm, t, N, s; ``"in"`` in inch, lbf, s; ``"ft"`` in foot, lbf, s.

    Raises
    ------
    ModelError
        If a file cannot be read, files do not fit each other, mass is missing, K is not symmetric, or the mass is that
        of another system of units: one line with file and entry, what was found, what is expected, what to do.

    Examples
    --------
    >>> model = read_structure("bracket.sti", length_unit="mm")  # doctest: +SKIP
    >>> model.n_dofs, model.mass_along("x")  # doctest: +SKIP
    (16335, 1.87)
    """
    expected = 'one of "m", "mm", "in", "ft"; give that of the model'
    require(length_unit, str, "length_unit: found", expected, lambda unit: unit in UNITS)
    main = Path(path)
    exported = _read(main, _matrices)
    matrices = {role or "stiffness": entries for role, entries in exported.matrices.items()}
    sources = dict.fromkeys(matrices, main)
    beside = _beside(main, "mass") if "" in exported.matrices else None
    for role, given in (("mass", mass or beside), ("damping", damping)):
        if given is not None:
            sources[role] = Path(given)
            found = _read(sources[role], _matrices).matrices
            if not {"", role} & found.keys():
                raise fault(given, f"a matrix of {' and '.join(found)}", f"one of {role}", f"correct {role}=")
            matrices[role] = found[""] if "" in found else found[role]
    for role, example in (("stiffness", "K in N/m"), ("mass", "M in kg")):
        if role not in matrices:
            raise fault(
                main, f"no {role} matrix, but {' and '.join(matrices)}", example, f"export it too, give {role}="
            )
    given_map = dofs or (_beside(main, "dofs") if exported.dofs is None else None)
    kind = Path(given_map).suffix.lower() if given_map else ""
    of_kind = {".dof": text_matrices.read_dof_file, ".mapping": text_matrices.read_mapping}.get(kind, read_map)
    of_map = read_assembly if kind == ".asm" else lambda path: Exported(dofs=of_kind(path))
    mapped = exported if given_map is None else _read(Path(given_map), of_map)
    whole, rows = _whole_matrices(sources, matrices, mapped.dofs, given_map)
    places = mapped if len(mapped.nodes) else exported
    if nodes is not None:
        places = _read(Path(nodes), read_nodes)
    elif not len(places.nodes) and (mesh := _beside(main, "nodes")):
        try:
            places = _read(mesh, read_nodes)
        except ModelError as error:
            places = replace(places, notes=(f"no coordinates: {error}",))
    whole = _in_basic_system(whole, rows, {**mapped.axes, **places.axes}, nodes or given_map or main)
    return _model(main, whole, rows, replace(places, notes=(*exported.notes, *places.notes)), length_unit)


def _model(main: Path, whole: dict[str, Sparse], rows: Indices, found: Exported, unit: str) -> FeModel:
    """The model in SI units, of DOFs that are not held and not empty."""
    diagonals = {role: abs(matrix.diagonal()) for role, matrix in whole.items()}
    held = diagonals["stiffness"] >= _HELD
    empty = np.all([abs(matrix).sum(axis=0) == 0 for matrix in whole.values()], axis=0)
    notes = [*found.notes]
    notes += [f"{held.sum()} DOFs with 1e36 on the diagonal of K are supports, and left out"] * bool(held.any())
    notes += [f"{empty.sum()} DOFs without stiffness and mass are left out"] * bool(empty.any())
    kept = np.flatnonzero(~(held | empty))
    if not kept.size:
        what = f"{len(rows)} DOFs, all of them held (1e36 on the diagonal of K) or without stiffness and mass"
        raise fault(main, what, "a structure that can move", "export it without its supports")
    rows = rows[kept]
    # relative rounding of the numbers of K as the file has them: half of the last of 10 to 15 digits, or 0
    values, rounding = np.abs(whole["stiffness"].data), 0.0
    values = values[values > 1e-280][:10_000]  # of smaller ones the last digit is below all numbers
    for digits in range(10, 16):
        last = 10.0 ** (np.floor(np.log10(values)) + 1 - digits)
        if (np.abs(np.rint(values / last) * last - values) <= 4 * np.finfo(float).eps * values).all():
            rounding = 0.5 * 10.0 ** (1 - digits)
            break
    length, energy = UNITS[unit]
    scale = np.where((rows[:, 1] >= 1) & (rows[:, 1] <= 3), 1 / length, 1.0)
    turn = sparse.diags_array(scale)
    whole = {role: energy * (turn @ matrix[kept][:, kept] @ turn) for role, matrix in whole.items()}
    k, m, damping, places = whole["stiffness"], whole["mass"], whole.get("damping"), found.places * length
    said: dict[str, Any] = {"source": str(main), "notes": tuple(notes), "rounding": rounding}
    model = FeModel(k, m, rows, found.nodes, places, damping, edges=found.edges, **said)
    with np.errstate(all="ignore"):  # of damaged numbers
        further = require_own_axes(model)
        _require_sane_units(model, unit)
    return replace(model, notes=(*model.notes, *further))


def _in_basic_system(
    whole: dict[str, Sparse], rows: Indices, axes: Mapping[int, Array], where: PathLike
) -> dict[str, Sparse]:
    """Turn the DOFs of nodes that stand in systems of their own."""
    turned = {node: own for node, own in axes.items() if not np.array_equal(own, np.eye(3))}
    row_of = {(node, way): row for row, (node, way) in enumerate(rows.tolist())} if turned else {}
    turn: Sparse = sparse.eye_array(len(rows), format="lil")
    for node, own in turned.items():
        for first in (1, 4):
            at = [row_of[node, way] for way in range(first, first + 3) if (node, way) in row_of]
            if at and len(at) < 3:
                found = f"a system of its own at node {node}, which has not all three directions"
                raise fault(where, found, "the basic system", "export these nodes in it")
            if at:
                turn[np.ix_(at, at)] = own
    turn = turn.tocsc()
    return {role: turn @ matrix @ turn.T for role, matrix in whole.items()} if turned else whole


def _require_sane_units(model: FeModel, unit: str) -> None:
    """Refuse a model whose mass is absurd for its size, and name the units in which it is not."""
    box = model.box
    if box is None or not max(box):
        return
    solid = set(model.dofs[:, 1].tolist()) == {1, 2, 3} and min(box) > 1e-3 * max(box)
    density = float(np.divide(model.whole_mass, math.prod(box if solid else 3 * [max(box)])))
    bounds = (_SPARSEST_SOLID if solid else _SPARSEST), _DENSEST
    numbers = {other: energy / length**5 for other, (length, energy) in UNITS.items()}
    densities = {other: density * size / numbers[unit] for other, size in numbers.items()}
    if bounds[0] <= densities[unit] <= bounds[1]:
        return
    named: list[str] = []
    for low, high in (_LIKELY, bounds):
        named = named or [f'"{u}" ({d:.3g} kg/m³)' for u, d in densities.items() if low <= d <= high]
    found = f"found {model.size} in the unit {unit!r}: {densities[unit]:.3g} kg/m³"
    expected = "mass and size of one structure, in m-kg-s, mm-t-s, in-lbf-s or ft-lbf-s"
    remedy = f"give length_unit={' or '.join(named)}, or " if named else ""
    remedy += "export in consistent units (mm with t, not kg)"
    raise ModelError.of(model.source, ("mass",), found, expected, remedy)


# ---- matrices


def _whole_matrices(
    sources: Mapping[str, Path], matrices: Mapping[str, Entries], dofs: Indices | None, map_file: PathLike | None
) -> tuple[dict[str, Sparse], Indices]:
    """Matrices with both triangles, and node and direction of their rows."""
    main = sources["stiffness"]
    labelled = {role: entries.labelled for role, entries in matrices.items()}
    if len(set(labelled.values())) > 1 or (any(labelled.values()) and dofs is not None):
        found = "matrices with nodes and directions beside " + ("a map" if dofs is not None else "others without")
        raise fault(map_file or main, found, "one of both", "export all matrices in the same way, with one map")
    if any(labelled.values()):
        ends = [np.concatenate([entries.rows, entries.columns]) for entries in matrices.values()]
        # nodes and directions as one number each, which sorts in a fifth of the time
        codes, inverse = np.unique(np.concatenate(ends) @ np.array([MOST_WAYS, 1]), return_inverse=True)
        dofs = np.stack(np.divmod(codes, MOST_WAYS), axis=1)
        parts = np.split(inverse, np.cumsum([len(pairs) for pairs in ends])[:-1])
        matrices = {
            role: replace(entries, rows=part[: len(part) // 2], columns=part[len(part) // 2 :], size=len(dofs))
            for (role, entries), part in zip(matrices.items(), parts, strict=True)
        }
        own = dofs[:, 0] < 1  # no node: a Lagrange multiplier or a mode of the program
        dofs[own] = np.stack([-np.arange(own.sum()) - 1, np.zeros(own.sum(), dtype=np.intp)], axis=1)
    if dofs is None:
        remedy = "give dofs= a CSV node,direction with a line for each row, or save 'dofs' in the file"
        raise fault(main, "no map of the DOFs", "node and direction of each row", remedy)
    if len(dofs) > MOST_DOFS:
        raise fault(main, f"{len(dofs)} DOFs", f"at most {MOST_DOFS}", "export a coarser mesh")
    for role, entries in matrices.items():
        size = entries.size or int(max(entries.rows.max(), entries.columns.max())) + 1
        if size != len(dofs):
            found = f"a {role} matrix of {size} rows, and a map of {len(dofs)} DOFs in {map_file or main}"
            raise fault(sources[role], found, "as many", "give matrices and map of one export")
    whole = {role: _mirrored(entries, len(dofs), role, sources[role]) for role, entries in matrices.items()}
    bare = (whole["mass"].diagonal() != 0) & (whole["stiffness"].diagonal() == 0) if any(labelled.values()) else []
    if np.any(bare):
        node, way = dofs[int(np.argmax(bare))]
        found = f"mass but no stiffness at node {node}, direction {way}"
        raise fault(main, found, "both of the same model", "export it again: the file is cut off")
    return whole, dofs


def _mirrored(entries: Entries, size: int, role: str, source: Path) -> Sparse:
    """The whole matrix of entries that are whole, or one triangle: where no entry has one across the diagonal."""
    rows, columns, values = entries.rows, entries.columns, entries.values
    bad = ~(np.abs(values) < _LARGEST)
    if bad.any():
        at = int(np.argmax(bad))
        found = f"{values[at]:g} in the {role} matrix at row {rows[at] + 1}, column {columns[at] + 1}"
        raise fault(source, found, "a finite number", "export it again")
    whole = sparse.coo_array((values, (rows, columns)), shape=(size, size)).tocsc()
    if whole.nnz < values.size:
        order = np.lexsort((rows, columns))
        again = (np.diff(rows[order]) == 0) & (np.diff(columns[order]) == 0)
        at = order[int(np.argmax(again))]
        found = f"an entry of the {role} matrix twice, at row {rows[at] + 1}, column {columns[at] + 1}"
        raise fault(source, found, "each entry once", "export it again")
    there = sparse.csc_array((np.ones(whole.nnz), whole.indices, whole.indptr), shape=whole.shape)  # also zeros
    if there.multiply(there.T).nnz == np.count_nonzero(rows == columns):
        return whole + whole.T - sparse.diags_array(whole.diagonal())
    return whole


# ---- files


def holds_matrices(path: Path) -> bool:
    """Return whether a file holds matrices of a model, by its content."""
    with suppress(ModelError):
        return bool(_read(path, _matrices).matrices)
    return False


def _read(path: Path, read: Callable[[Path], Exported]) -> Exported:
    """What a reader makes of a file; any fault is one line that names it."""
    try:
        if not path.is_file():
            raise fault(path, "no such file" if not path.exists() else "no regular file", "a file", "correct the path")
        if not 0 < path.stat().st_size <= MOST_BYTES:
            found = f"{path.stat().st_size} bytes"
            raise fault(path, found, f"1 byte to {MOST_BYTES >> 30} GiB", "export it again")
        return read(path)
    except ModelError:
        raise
    except MeasurementError as error:
        raise ModelError(f"{path}: {error}") from None
    except Exception as error:  # of libraries, on damaged bytes: anything
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        found = f"content that cannot be read ({reason})"
        raise fault(str(path)[:300], found, "a complete file", "copy or export it again") from None


def _matrices(path: Path) -> Exported:
    """Matrices of a file by the reader of its kind."""
    with path.open("rb") as file:
        head = file.read(4096)
    suffix, lines = path.suffix.lower(), head.decode("latin-1").splitlines()
    text = not re.search(rb"[\0-\x08\x0e-\x1f]", head)
    if head.startswith(b"PK\x03\x04"):
        return read_named_arrays(path, "npz")
    if b"\x89HDF\r\n\x1a\n" in (head[:8], head[512:520]):
        return read_named_arrays(path, "mat73" if head.startswith(b"MATLAB") else "hdf5")
    if head.startswith(b"MATLAB 5.0"):
        return read_named_arrays(path, "mat")
    if head[:14].lower() == b"%%matrixmarket":
        return text_matrices.read_matrix_market(path)
    is_op4 = re.match(rb"\s*\d+\s+-?\d+\s+\d+\s+\d+\s*\w+\s+1P", head) or (
        len(head) > 24 and {int.from_bytes(head[:4], order) for order in ("little", "big")} & {24, 48}
    )
    if suffix == ".op4" or is_op4:
        return read_op4(path)
    if text and (suffix == ".pch" or re.search(rb"(?m)^DMIG", head)):
        return read_dmig(path)
    if text and len(lines) > 3 and re.match(r"[RCP][SUHZR][AE] ", lines[2].upper()):
        return text_matrices.read_harwell_boeing(path)
    if text and re.search(rb"(?im)^\*USER ELEMENT", head):
        return text_matrices.read_substructure(path)
    if text and suffix in (".sti", ".mas"):
        return text_matrices.read_calculix(path)
    if text and re.match(rb"(\s*\*\*.*\n)*\s*-?\d+[\s,]+-?\d", head):
        return text_matrices.read_abaqus(path)
    expected = "npz, MATLAB, Matrix Market, OP4, DMIG, Harwell-Boeing, or text of Abaqus or CalculiX"
    raise fault(path, "no matrices of a known kind", expected, "export K and M in one of them")


def _beside(path: Path, what: str) -> Path | None:
    """The file that a program writes with this one; None where there is none."""
    suffix, stem = path.suffix.lower(), path.stem
    job = re.sub(r"_STIF\d*$", "", stem)
    names = {
        "mass": [f"{stem}.mas"] if suffix == ".sti" else [stem.replace("_STIF", "_MASS") + path.suffix],
        "dofs": {".sti": [f"{stem}.dof"], ".op4": [f"{stem}.asm"]}.get(suffix, [f"{stem}.mapping"]),
        "nodes": [f"{job}.inp"] if suffix == ".sti" or job != stem else [],
    }[what]
    found = (path.with_name(name) for name in names)
    return next((other for other in found if other != path and other.is_file()), None)
