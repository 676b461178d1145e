"""The same small model in the files of every program: the same frequencies, DOF by DOF."""

from itertools import pairwise

import numpy as np
import pytest
from scipy import io, sparse

import jointbayes as jb
from tests.structure.imported import small_frame as small
from tests.structure.imported.nastran_files import write_punch
from tests.structure.imported.small_frame import DOFS, NODES, PLACES, C, K, M


@pytest.fixture(params=["m", "mm"])
def unit(request):
    return request.param


def matrices(unit):
    return (K, M) if unit == "m" else tuple(small.in_mm(K, M))


def parts(name, matrix):
    csc = sparse.csc_array(matrix)
    return {f"{name}_{key}": getattr(csc, key) for key in ("data", "indices", "indptr", "shape")}


def half(matrix):
    return np.triu(matrix)


NPZ = {
    "dense": lambda k, m: {"K": k, "M": m, "dofs": DOFS},
    "parts": lambda k, m: parts("K", k) | parts("M", m) | {"dofs": DOFS},
    "half": lambda k, m: parts("K", half(k)) | parts("M", half(m).T) | {"dofs": DOFS},
    "per row": lambda k, m: {"stiffness": k, "mass": m, "nodes": DOFS[:, 0], "dofs": DOFS[:, 1]},
    "labels": lambda k, m: {"k": k, "m": m, "dofs": [f"{n}:{small.AXES[w - 1]}" for n, w in DOFS]},
}


@pytest.mark.parametrize("form", NPZ)
def test_npz(tmp_path, form, unit):
    np.savez_compressed(tmp_path / "a.npz", **NPZ[form](*matrices(unit)))
    small.require_same(jb.read_structure(tmp_path / "a.npz", length_unit=unit))


def test_npz_with_damping_and_places(tmp_path):
    np.savez(tmp_path / "a.npz", K=K, M=M, C=C, dofs=DOFS, nodes=NODES, xyz=PLACES)
    model = jb.read_structure(tmp_path / "a.npz")
    small.require_same(model)
    assert model.nodes.tolist() == NODES.tolist()
    np.testing.assert_array_equal(model.damping.toarray(), C)


@pytest.mark.parametrize("form", ["csc", "csr", "coo"])
def test_a_sparse_matrix_in_a_file_of_its_own(tmp_path, form):
    for name, matrix in (("k", K), ("m", M)):
        sparse.save_npz(tmp_path / f"{name}.npz", sparse.coo_array(matrix).asformat(form))
    dofs, nodes = small.write_map(tmp_path / "map.csv"), small.write_places(tmp_path / "xyz.csv")
    model = jb.read_structure(tmp_path / "k.npz", mass=tmp_path / "m.npz", dofs=dofs, nodes=nodes)
    small.require_same(model)
    assert model.place(41).tolist() == PLACES[4].tolist()


@pytest.mark.parametrize("write", [small.write_matlab_5, small.write_matlab_73])
@pytest.mark.parametrize("dense", [True, False])
def test_matlab(tmp_path, write, dense, unit):
    k, m = (matrix if dense else sparse.csc_array(matrix) for matrix in matrices(unit))
    write(tmp_path / "a.mat", K=k, M=m, dofs=DOFS.astype(float), nodes=NODES[:, None].astype(float))
    small.require_same(jb.read_structure(tmp_path / "a.mat", length_unit=unit))


def test_a_struct_of_matlab(tmp_path):
    io.savemat(tmp_path / "a.mat", {"model": {"K": sparse.csc_array(K), "M": sparse.csc_array(M), "dofs": DOFS}})
    small.require_same(jb.read_structure(tmp_path / "a.mat"))


@pytest.mark.parametrize("symmetry", ["symmetric", "general"])
def test_matrix_market(tmp_path, symmetry, unit):
    k, m = (
        small.write_matrix_market(tmp_path / name, matrix, symmetry)
        for name, matrix in zip(("k.mtx", "m.mtx"), matrices(unit), strict=True)
    )
    dofs = small.write_map(tmp_path / "map.csv")
    small.require_same(jb.read_structure(k, mass=m, dofs=dofs, length_unit=unit))


def test_matrix_market_as_a_whole_array(tmp_path):
    for name, matrix, symmetry in (("k", K, "symmetric"), ("m", M, "general")):
        io.mmwrite(tmp_path / f"{name}.mtx", matrix, precision=17, symmetry=symmetry)
    dofs = small.write_map(tmp_path / "map.csv")
    small.require_same(jb.read_structure(tmp_path / "k.mtx", mass=tmp_path / "m.mtx", dofs=dofs))


def test_ansys_matrix_market_with_its_mapping_beside(tmp_path):
    k = small.write_matrix_market(tmp_path / "k.mmf", K)
    small.write_mapping(tmp_path / "k.mapping")
    small.require_same(jb.read_structure(k, mass=small.write_matrix_market(tmp_path / "m.mmf", M)))


@pytest.mark.parametrize("per_line", [1, 3])
def test_ansys_harwell_boeing(tmp_path, per_line, unit):
    k, m = (
        small.write_harwell_boeing(tmp_path / name, matrix, per_line)
        for name, matrix in zip(("stiff.matrix", "mass.matrix"), matrices(unit), strict=True)
    )
    dofs = small.write_mapping(tmp_path / "any.mapping")
    small.require_same(jb.read_structure(k, mass=m, dofs=dofs, length_unit=unit))


def test_harwell_boeing_as_scipy_writes_it(tmp_path):
    for name, matrix in (("k", K), ("m", M)):
        io.hb_write(tmp_path / name, sparse.csc_matrix(matrix))
    model = jb.read_structure(tmp_path / "k", mass=tmp_path / "m", dofs=small.write_map(tmp_path / "map.csv"))
    small.require_same(model)


@pytest.mark.parametrize("how", ["binary", "ascii"])
@pytest.mark.parametrize("form", ["dense", "bigmat", "nonbigmat"])
def test_nastran_op4(tmp_path, how, form):
    op4 = pytest.importorskip("pyyeti.nastran.op4", reason="pyyeti, which writes OP4, is not installed")
    named = {"kaa": K, "maa": M, "gpxx": np.zeros((1, 1)), "mug1": np.ones((3, 2))}
    op4.write(str(tmp_path / "a.op4"), named, binary=how == "binary", digits=17, sparse=form)
    small.require_same(jb.read_structure(tmp_path / "a.op4", dofs=small.write_map(tmp_path / "map.csv")))


def test_nastran_dmig_whose_matrices_have_lists_of_their_own(tmp_path):
    light = M.copy()
    light[DOFS[:, 1] > 3] = light[:, DOFS[:, 1] > 3] = 0  # masses without rotary inertia: M is semidefinite
    path = write_punch(tmp_path / "a.pch", KAAX=K, MAAX=light, TUGX=K)
    model = jb.read_structure(path, nodes=path)
    assert np.array_equal(model.dofs, DOFS)
    np.testing.assert_array_equal(model.stiffness.toarray(), K)
    np.testing.assert_array_equal(model.mass.toarray(), light)
    np.testing.assert_allclose(model.places, PLACES)
    assert model.notes == ("DMIG TUGX is not used",)


def test_nastran_dmig_frequencies(tmp_path):
    small.require_same(jb.read_structure(write_punch(tmp_path / "a.pch", KAAX=K, MAAX=M)))


def test_abaqus(tmp_path, unit):
    shuffled = np.random.default_rng(1).permutation(len(DOFS))  # its order is not that of the node numbers
    for name, matrix in zip(("job_STIF1.mtx", "job_MASS1.mtx"), matrices(unit), strict=True):
        small.write_abaqus(tmp_path / name, matrix[np.ix_(shuffled, shuffled)], DOFS[shuffled])
    small.require_same(jb.read_structure(tmp_path / "job_STIF1.mtx", length_unit=unit))


def test_abaqus_rows_and_columns_with_a_map(tmp_path):
    for name, matrix in (("k.mtx", K), ("m.mtx", M)):
        lines = [f"{i + 1} {j + 1} {v!r}\n" for i, j, v in small.triangle(matrix, False)]
        (tmp_path / name).write_text("".join(lines))
    dofs = small.write_map(tmp_path / "map.csv")
    small.require_same(jb.read_structure(tmp_path / "k.mtx", mass=tmp_path / "m.mtx", dofs=dofs))


def test_calculix_files_found_beside_each_other(tmp_path, unit):
    for name, matrix in zip(("job.sti", "job.mas"), matrices(unit), strict=True):
        small.write_calculix(tmp_path / name, matrix)
    small.write_dof(tmp_path / "job.dof")
    scale = 1.0 if unit == "m" else 1e3
    nodes = [f"{n}, {', '.join(repr(float(x)) for x in scale * p)}" for n, p in zip(NODES, PLACES, strict=True)]
    beams = [f"{i + 1}, {a}, {b}" for i, (a, b) in enumerate(pairwise(NODES))]
    lines = ["*NODE, NSET=ALL", *nodes, "*ELEMENT, TYPE=B31, ELSET=E", *beams, "*NODE PRINT", "U"]
    (tmp_path / "job.inp").write_text("\n".join(lines))
    model = jb.read_structure(tmp_path / "job.sti", length_unit=unit)
    small.require_same(model)
    assert model.edges.tolist() == [[3, 11], [11, 12], [12, 40], [40, 41]]


def test_mass_of_rigid_motion(tmp_path):
    np.savez(tmp_path / "a.npz", K=K, M=M, dofs=DOFS)
    model = jb.read_structure(tmp_path / "a.npz")
    expected = 7800 * 1e-4 * 0.45
    assert [model.mass_along(way) for way in "xyz"] == pytest.approx([expected] * 3, rel=1e-8)


def test_inches(tmp_path):
    inch, pound = 0.0254, 4.4482216152605
    scale = np.where(DOFS[:, 1] <= 3, inch, 1.0)
    k, m = (a * np.outer(scale, scale) / (inch * pound) for a in (K, M))
    np.savez(tmp_path / "a.npz", K=k, M=m, dofs=DOFS, nodes=NODES, xyz=PLACES / inch)
    small.require_same(jb.read_structure(tmp_path / "a.npz", length_unit="in"))
