"""A small bent frame of Euler beams with numbers of nine digits, which every format holds exactly, and its writers."""

import csv

import numpy as np
from scipy import linalg, sparse
from scipy.io import mmwrite, savemat

from tests.euler_beam import euler_element
from tests.vibrecords.array_trees import write_mat73

NODES = np.array([3, 11, 12, 40, 41])
PLACES = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.2, 0, 0], [0.2, 0.1, 0], [0.2, 0.1, 0.15]])
AXES = ("x", "y", "z", "rx", "ry", "rz")


def element(length, axis):
    """K and M, 12 × 12, of a square steel beam of 10 mm along an axis of the frame."""
    side, e, g, rho = 0.01, 2.1e11, 8e10, 7800.0
    area, bend, twist = side**2, side**4 / 12, 0.141 * side**4
    k, m = np.zeros((2, 12, 12))
    for i, stiff, inertia in ((0, e * area, rho * area), (3, g * twist, rho * side**4 / 6)):
        at = np.ix_([i, i + 6], [i, i + 6])
        k[at] += stiff / length * np.array([[1, -1], [-1, 1]])
        m[at] += inertia * length / 6 * np.array([[2, 1], [1, 2]])
    bent, heavy = euler_element(length, e * bend, rho * area)
    for rows, sign in (((1, 5, 7, 11), 1), ((2, 4, 8, 10), -1)):
        flip = np.array([1, sign, 1, sign])
        k[np.ix_(rows, rows)] += bent * np.outer(flip, flip)
        m[np.ix_(rows, rows)] += heavy * np.outer(flip, flip)
    turn = np.roll(np.eye(3), axis, axis=0)  # x of the beam becomes the axis
    whole = np.kron(np.eye(4), turn)
    return whole @ k @ whole.T, whole @ m @ whole.T


def frame(springs=1.0):
    """K, M and DOFs, nodes in the order of `NODES`; node 3 stands on springs, or on none."""
    size = 6 * len(NODES)
    k, m = np.zeros((2, size, size))
    for i, axis in enumerate((0, 0, 1, 2)):
        at = np.arange(6 * i, 6 * i + 12)
        ke, me = element(float(np.linalg.norm(PLACES[i + 1] - PLACES[i])), axis)
        k[np.ix_(at, at)] += ke
        m[np.ix_(at, at)] += me
    k[range(6), range(6)] += springs * np.array([1e7, 1e7, 1e7, 1e4, 1e4, 1e4])
    nine = np.vectorize(lambda value: float(f"{value:.9e}"))
    dofs = np.array([(node, way) for node in NODES for way in range(1, 7)])
    return *(nine((a + a.T) / 2) for a in (k, m)), dofs


K, M, DOFS = frame()
FREE = frame(0.0)[0]
C = 1e-5 * K


def frequencies(model):
    """Natural frequencies, Hz."""
    k, m = (getattr(model, name).toarray() for name in ("stiffness", "mass"))
    return np.sqrt(np.abs(linalg.eigh(k, m, eigvals_only=True))) / 2 / np.pi


EXACT = np.sqrt(linalg.eigh(K, M, eigvals_only=True)) / 2 / np.pi


def require_same(model, rtol=1e-9):
    """Frequencies, and K and M between DOFs that are asked by node and direction."""
    np.testing.assert_allclose(frequencies(model), EXACT, rtol=rtol)
    rows = [model.row(int(node), AXES[way - 1]) for node, way in DOFS]
    assert None not in rows
    for found, given in ((model.stiffness, K), (model.mass, M)):
        np.testing.assert_allclose(found.toarray()[np.ix_(rows, rows)], given, rtol=rtol, atol=1e-12 * given.max())
    if len(model.nodes):
        for node, place in zip(NODES, PLACES, strict=True):
            np.testing.assert_allclose(model.place(int(node)), place, atol=1e-12)


def in_mm(k, m):
    """The same in mm, t, N, s."""
    scale = np.where(DOFS[:, 1] <= 3, 1e-3, 1.0)
    return (1e3 * a * np.outer(scale, scale) for a in (k, m))


# ---- writers


def write_table(path, title, rows):
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([title, *rows])
    return path


def write_map(path, dofs=DOFS):
    return write_table(path, ["node", "direction"], [(node, AXES[way - 1]) for node, way in dofs])


def write_places(path, places=PLACES):
    return write_table(path, ["node", "x", "y", "z"], [(n, *p) for n, p in zip(NODES, places, strict=True)])


def triangle(matrix, upper):
    rows, columns = np.nonzero(np.triu(matrix) if upper else np.tril(matrix))
    return zip(rows.tolist(), columns.tolist(), matrix[rows, columns].tolist(), strict=True)


def write_matrix_market(path, matrix, symmetry="symmetric"):
    with path.open("wb") as file:
        mmwrite(file, sparse.coo_array(matrix), precision=17, symmetry=symmetry)
    return path


def write_abaqus(path, matrix, dofs=DOFS):
    lines = [f"{dofs[i][0]},{dofs[i][1]}, {dofs[j][0]},{dofs[j][1]}, {v:.16e}" for i, j, v in triangle(matrix, False)]
    path.write_text("\n".join(["**", "** MATRIX OUTPUT", *lines]) + "\n")
    return path


def write_calculix(path, matrix):
    rows = sorted(triangle(matrix, True), key=lambda entry: entry[1])
    path.write_text("".join(f"{i + 1} {j + 1} {v:.13e}\n" for i, j, v in rows))
    return path


def write_dof(path, dofs=DOFS):
    path.write_text("".join(f"{node}.{way}\n" for node, way in dofs))
    return path


def write_harwell_boeing(path, matrix, per_line=3):
    """Lower triangle by columns, as HBMAT of Ansys."""
    csc = sparse.csc_array(np.tril(matrix))
    csc.sort_indices()

    def lines(words, count):
        return ["".join(words[i : i + count]) for i in range(0, len(words), count)]

    parts = [
        lines([f"{i + 1:10d}" for i in csc.indptr], 8),
        lines([f"{i + 1:10d}" for i in csc.indices], 8),
        lines([f"{v:25.16E}".replace("E", "D") for v in csc.data], per_line),
    ]
    counts = [len(part) for part in parts]
    head = ["Stiffness matrix".ljust(72) + "K".ljust(8), "".join(f"{n:14d}" for n in (sum(counts), *counts, 0))]
    head += ["RSA".ljust(14) + "".join(f"{n:14d}" for n in (*matrix.shape, csc.nnz, 0))]
    head += ["(8I10)".ljust(16) * 2 + f"(1P,{per_line}D25.16)".ljust(20) + "".ljust(20)]
    path.write_text("\n".join([*head, *(line for part in parts for line in part)]) + "\n")
    return path


def write_mapping(path, dofs=DOFS):
    labels = ("UX", "UY", "UZ", "ROTX", "ROTY", "ROTZ")
    rows = [f"{row:12d}{node:12d}        {labels[way - 1]}" for row, (node, way) in enumerate(dofs, 1)]
    path.write_text("\n".join(["  Matrix Eqn        Node         DOF", *rows]) + "\n")
    return path


def write_matlab_73(path, **arrays):
    write_mat73(arrays, path)
    return path


def write_matlab_5(path, **arrays):
    savemat(path, arrays, do_compression=True)
    return path


def write_all(place):
    """Files of the frame in the formats of every program, in a directory."""
    import pandas as pd
    from pyyeti.nastran import bulk, op4
    from scipy import io

    np.savez(place / "a.npz", K=K, M=M, dofs=DOFS, nodes=NODES, xyz=PLACES)
    sparse.save_npz(place / "b.npz", sparse.csc_array(K))
    write_matlab_5(place / "a.mat", K=sparse.csc_array(K), M=M, dofs=DOFS)
    write_matlab_73(place / "b.mat", K=sparse.csc_array(K), M=M, dofs=DOFS)
    op4.write(str(place / "a.op4"), {"kaa": K, "maa": M}, binary=True, sparse="bigmat")
    op4.write(str(place / "b.op4"), {"kaa": K, "maa": M}, binary=False, sparse="nonbigmat")
    op4.write(str(place / "c.op4"), {"kaa": K, "maa": M}, binary=True, sparse="dense")
    index = pd.MultiIndex.from_tuples(list(map(tuple, DOFS.tolist())))
    frames = {name: pd.DataFrame(matrix, index=index, columns=index) for name, matrix in (("KAAX", K), ("MAAX", M))}
    bulk.wtdmig(str(place / "a.pch"), frames)
    io.mmwrite(place / "array.mtx", K, symmetry="symmetric")
    write_matrix_market(place / "a.mtx", K)
    write_harwell_boeing(place / "a.matrix", K)
    write_abaqus(place / "b.mtx", K)
    write_calculix(place / "a.sti", K)
    for write, name in (
        (write_dof, "a.dof"),
        (write_mapping, "a.mapping"),
        (write_map, "a.map"),
        (write_places, "a.xyz"),
    ):
        write(place / name)
    return sorted(path for path in place.iterdir() if path.is_file())
