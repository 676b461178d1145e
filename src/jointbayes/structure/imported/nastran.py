"""Matrices of Nastran: OP4 with the map of a superelement's ``.asm``, by pyyeti, and DMIG in punch files."""

import warnings
from array import array
from pathlib import Path
from types import ModuleType

import numpy as np

from jointbayes.structure.imported.entries import Entries, Exported, fault, indices, role_of


def _pyyeti(module: str, path: Path) -> ModuleType:
    """A module of pyyeti, whose import changes how NumPy prints."""
    from importlib import import_module

    try:
        with np.printoptions(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return import_module(f"pyyeti.nastran.{module}")
    except ImportError:
        remedy = "pip install jointbayes[nastran]"
        raise fault(path, "a file of Nastran", "pyyeti, which reads it, to be installed", remedy) from None


def read_op4(path: Path) -> Exported:
    """K, M and viscous C of an OP4 file in any of its forms, by names such as ``kxx``, ``maa``, ``baa``.

    Raises
    ------
    ModelError
        If pyyeti is missing, or there is no such matrix.
    """
    op4 = _pyyeti("op4", path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of names that are no identifiers
        # all of them, not a chosen few: what skips a matrix goes back without end in a damaged file
        found = op4.read(str(path), justmatrix=True, sparse=True)
    matrices = {}
    for name, matrix in found.items():
        role = role_of(name.rstrip("0123456789"))
        if role is None or matrix.nnz == 0:
            continue
        if role in matrices or np.iscomplexobj(matrix.data):
            what = "complex numbers" if np.iscomplexobj(matrix.data) else "another matrix of this kind"
            raise fault(f"{path}, matrix {name!r}", what, f"one real matrix of {role}", "export K and M alone")
        if matrix.shape[0] != matrix.shape[1]:
            raise fault(f"{path}, matrix {name!r}", f"shape {matrix.shape}", "a square matrix", "export it again")
        entries = matrix.tocoo()
        rows, columns = entries.row.astype(np.intp), entries.col.astype(np.intp)
        matrices[role] = Entries(rows, columns, entries.data, matrix.shape[0])
    if not matrices:
        raise fault(path, ", ".join(list(found)[:8])[:120] or "no matrix", "kxx and mxx", "export K and M with them")
    return Exported(matrices)


def read_assembly(path: Path) -> Exported:
    """Map of the DOFs of a superelement from its ``.asm``, and from EXTRN of the ``.pch`` next to it.

    Raises
    ------
    ModelError
        If pyyeti is missing, cards do not fit each other, or an output system is not rectangular.
    """
    bulk = _pyyeti("bulk", path)
    punch = path.with_suffix(".pch")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        whole, _, _ = bulk.asm2uset(str(path), try_rdextrn=False, follow_includes=False, encoding="latin-1")
        listed = whole.index.tolist()
        if punch.is_file() and any(line.startswith("EXTRN") for line in punch.open(encoding="latin-1")):
            listed = bulk.rdextrn(str(punch), follow_includes=False, encoding="latin-1").tolist()
        dofs = np.array(listed, dtype=np.intp).reshape(-1, 2)
        rows = dict(zip(whole.index.tolist(), whole[["x", "y", "z"]].to_numpy(), strict=True))
    grids = np.array([node for node, way in rows if way == 1], dtype=np.intp)
    places = np.array([rows[node, 1] for node in grids.tolist()]).reshape(-1, 3)
    axes = {}
    for node in np.intersect1d(grids, dofs[:, 0]).tolist():
        own, (system, kind, _) = np.array([rows[node, way] for way in (4, 5, 6)]), rows[node, 2]
        if kind != 1 and not np.array_equal(own, np.eye(3)):
            found = f"the output system {system:g} at grid {node}, not rectangular"
            raise fault(path, found, "the basic system", "leave field CD of its GRID empty")
        axes[node] = own
    return Exported(dofs=dofs, nodes=grids, places=places, axes=axes)


def read_dmig(path: Path) -> Exported:
    """K, M and viscous C of DMIG cards in large fields, each with its own list of DOFs, such as ``KAAX`` or ``K10``.

    All other cards are passed over, also those that pyyeti stumbles on (DTI).

    Raises
    ------
    ModelError
        If a card is damaged, in small fields or complex, or there is no such matrix.
    """
    numbers: dict[str, tuple[array[int], array[float]]] = {}
    others, kinds = [], {}
    with path.open(encoding="latin-1") as lines:
        name, column = "", None
        for number, line in enumerate(lines, 1):
            try:
                if not line.endswith("\n"):
                    raise ValueError
                if line.startswith("*") and column is not None:
                    ends, values = numbers[name]
                    ends.extend((int(line[8:24]), int(line[24:40]), *column))
                    values.append(float(line[40:56].replace("D", "E")))
                elif line.startswith("DMIG*"):
                    name, column = line[8:24].strip(), (int(line[24:40]), int(line[40:56]))
                    numbers.setdefault(name, (array("q"), array("d")))
                elif line.startswith("DMIG"):
                    name, column = line[8:16].strip(), None
                    if line[16:24].strip() != "0" or "," in line:
                        remedy = "let Nastran punch it (PARAM,EXTOUT,DMIGPCH), which takes large fields"
                        raise fault(f"{path}, line {number}", "a DMIG card in small fields", "DMIG*", remedy)
                    kinds[name] = int(line[24:32]), int(line[32:40])
                else:
                    column = None
            except ValueError:
                what = repr(line.strip()[:60])
                raise fault(f"{path}, line {number}", what, "a whole card DMIG*", "copy or export it again") from None
    matrices = {}
    for name, (ends, values) in numbers.items():
        role = role_of(name.rstrip("0123456789"))  # K10 and M10 of superelement 10
        form, kind = kinds.get(name, (6, 2))
        if role is None or form not in (1, 6):
            others.append(name)
            continue
        if role in matrices or kind > 2:
            what = "complex numbers" if kind > 2 else "another matrix of this kind"
            raise fault(f"{path}, DMIG {name!r}", what, f"one real matrix of {role}", "export K and M alone")
        labels = np.array(ends, dtype=np.intp).reshape(-1, 4)
        indices(labels[:, ::2], f"{path}, DMIG {name!r}", most=2**53)
        indices(labels[:, 1::2], f"{path}, DMIG {name!r}", 0, 6)
        matrices[role] = Entries(labels[:, :2], labels[:, 2:], np.array(values))
    if not matrices:
        raise fault(path, ", ".join(others[:8])[:120] or "no DMIG", "KAAX and MAAX", "export K and M")
    return Exported(matrices, notes=tuple(f"DMIG {name} is not used" for name in others))
