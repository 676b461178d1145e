"""The same small model in the files of every program: the same frequencies, DOF by DOF."""

from itertools import pairwise

import numpy as np
import pytest
from scipy import io, linalg, sparse
from scipy.spatial.transform import Rotation

import jointbayes as jb
from jointbayes.frf import NaturalFrequencies
from tests.case.refusal_rows import case_text_named
from tests.conftest import edited
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


def npz(folder, **arrays):
    np.savez_compressed(folder / "a.npz", **arrays)
    return folder / "a.npz", {}


def matlab(write, kind):
    """A writer of full or of sparse matrices into a MAT-file."""
    more = {"dofs": DOFS.astype(float), "nodes": NODES[:, None].astype(float)}
    return lambda folder, k, m: (write(folder / "a.mat", K=kind(k), M=kind(m), **more), {})


def two_files(write, names, map_of, *how, beside=False):
    """A writer of each matrix into a file of its own, with a map that is given or found beside the first."""

    def written(folder, k, m):
        first, second = (write(folder / name, matrix, *how) for name, matrix in zip(names, (k, m), strict=True))
        kind = "mapping" if map_of is small.write_mapping else "csv"
        dofs = map_of(folder / f"{'k' if beside else 'any'}.{kind}")
        return first, {"mass": second} | ({} if beside else {"dofs": dofs})

    return written


def whole_array(path, matrix):
    io.mmwrite(path, matrix, precision=17, symmetry="symmetric" if path.stem == "k" else "general")
    return path


def harwell_boeing_of_scipy(path, matrix):
    io.hb_write(path, sparse.csc_matrix(matrix))
    return path


def rows_and_columns(path, matrix):
    path.write_text("".join(f"{i + 1} {j + 1} {v!r}\n" for i, j, v in small.triangle(matrix, False)))
    return path


def struct_of_matlab(folder, k, m):
    io.savemat(folder / "a.mat", {"model": {"K": sparse.csc_array(k), "M": sparse.csc_array(m), "dofs": DOFS}})
    return folder / "a.mat", {}


def abaqus(folder, k, m):
    """In another order than that of the node numbers; the mass is found beside the stiffness."""
    shuffled = np.random.default_rng(1).permutation(len(DOFS))
    for name, matrix in (("job_STIF1.mtx", k), ("job_MASS1.mtx", m)):
        small.write_abaqus(folder / name, matrix[np.ix_(shuffled, shuffled)], DOFS[shuffled])
    return folder / "job_STIF1.mtx", {}


def substructure(folder, k, m):
    """As Abaqus writes it: nodes in comments, DOFs once for all, four numbers a line, a triangle row by row."""
    nodes = ", ".join(f"{node:10d}" for node in NODES[:3]) + ", \n** " + ", ".join(f"{node:10d}" for node in NODES[3:])
    text = (
        f"**\n** GENERATION OF SUBSTRUCTURE Z1\n*USER ELEMENT, NODES=         5, LINEAR\n** ELEMENT NODES\n** {nodes}\n"
    )
    text += "** NODE NUMBERS WHICH ARE NOT POSITIVE INDICATE Abaqus INTERNAL NODES.\n  1,  2,  3,  4,  5,  6\n"
    for name, matrix in (("STIFFNESS", k), ("MASS", m)):
        text += f"*MATRIX,TYPE={name}\n"
        for row in range(len(matrix)):
            words = [f"{value: .16E}" for value in matrix[row, : row + 1]]
            text += "".join("    , ".join(words[at : at + 4]) + "    ,\n" for at in range(0, len(words), 4))
    (folder / "substructure.mtx").write_text(text)
    return folder / "substructure.mtx", {}


def op4(form, binary):
    def written(folder, k, m):
        writer = pytest.importorskip("pyyeti.nastran.op4", reason="pyyeti, which writes OP4, is not installed")
        named = {"kaa": k, "maa": m, "gpxx": np.zeros((1, 1)), "mug1": np.ones((3, 2))}
        writer.write(str(folder / "a.op4"), named, binary=binary, digits=17, sparse=form)
        return folder / "a.op4", {"dofs": small.write_map(folder / "map.csv")}

    return written


MTX, MMF = ("k.mtx", "m.mtx"), ("k.mmf", "m.mmf")
MARKET, BOEING = small.write_matrix_market, small.write_harwell_boeing
WRITERS = {
    "npz": lambda folder, k, m: npz(folder, K=k, M=m, dofs=DOFS),
    "npz of sparse parts": lambda folder, k, m: npz(folder, **parts("K", k), **parts("M", m), dofs=DOFS),
    "npz of halves": lambda folder, k, m: npz(folder, **parts("K", np.triu(k)), **parts("M", np.tril(m)), dofs=DOFS),
    "npz per row": lambda folder, k, m: npz(folder, stiffness=k, mass=m, nodes=DOFS[:, 0], dofs=DOFS[:, 1]),
    "npz with labels": lambda folder, k, m: npz(folder, k=k, m=m, dofs=[f"{n}:{small.AXES[w - 1]}" for n, w in DOFS]),
    "MATLAB 5": matlab(small.write_matlab_5, np.array),
    "MATLAB 5, sparse": matlab(small.write_matlab_5, sparse.csc_array),
    "MATLAB 7.3": matlab(small.write_matlab_73, np.array),
    "MATLAB 7.3, sparse": matlab(small.write_matlab_73, sparse.csc_array),
    "a struct of MATLAB": struct_of_matlab,
    "Matrix Market, symmetric": two_files(MARKET, MTX, small.write_map),
    "Matrix Market, general": two_files(MARKET, MTX, small.write_map, "general"),
    "Matrix Market, a whole array": two_files(whole_array, MTX, small.write_map),
    "Matrix Market of Ansys, its mapping beside": two_files(MARKET, MMF, small.write_mapping, beside=True),
    "Harwell-Boeing of Ansys, 1": two_files(BOEING, ("k.matrix", "m.matrix"), small.write_mapping, 1),
    "Harwell-Boeing of Ansys, 3": two_files(BOEING, ("k.matrix", "m.matrix"), small.write_mapping, 3),
    "Harwell-Boeing of SciPy": two_files(harwell_boeing_of_scipy, ("k", "m"), small.write_map),
    **{f"OP4, {form}, {how}": op4(form, how == "binary")
       for form in ("dense", "bigmat", "nonbigmat") for how in ("binary", "ascii")},
    "DMIG": lambda folder, k, m: (write_punch(folder / "a.pch", KAAX=k, MAAX=m), {}),
    "DMIG of superelement 10": lambda folder, k, m: (write_punch(folder / "a.pch", K10=k, M10=m), {}),
    "Abaqus": abaqus,
    "a substructure of Abaqus": substructure,
    "rows and columns of Abaqus with a map": two_files(rows_and_columns, MTX, small.write_map),
}  # fmt: skip


@pytest.mark.parametrize("writer", WRITERS)
def test_every_file_gives_the_same_model(tmp_path, writer, unit):
    path, more = WRITERS[writer](tmp_path, *matrices(unit))
    small.require_same(jb.read_structure(path, length_unit=unit, **more))


@pytest.mark.parametrize("writer", WRITERS)
def test_a_case_runs_on_every_file_of_a_free_model_whose_places_it_does_not_know(tmp_path, writer):
    path, more = WRITERS[writer](tmp_path, small.FREE, M)
    more_files = "".join(f'{key}_file = "{file.name}"\n' for key, file in more.items())
    exact = np.sqrt(np.abs(linalg.eigh(small.FREE, M, eigvals_only=True))) / 2 / np.pi
    text = edited(case_text_named("small_frame"), ("FILE", path.name), ("MORE", more_files))
    (tmp_path / "case.toml").write_text(f"{text}frequencies_hz = {small.EXACT[:6].tolist()}\n")
    problem = jb.load_case(tmp_path / "case.toml").problem
    found = problem.test.structure.nominal.modes().frequency_hz
    assert (found[:6] == 0).all()
    np.testing.assert_allclose(found[6:9], exact[6:9], rtol=1e-7)
    springs = np.diag([1e7, 1e7, 1e7, 1e4, 1e4, 1e4])[None]
    on_springs = NaturalFrequencies(problem.test.structures, problem.test.joints, 6).frequency_hz(springs)
    np.testing.assert_allclose(on_springs[0], small.EXACT[:6], rtol=1e-6)


def test_npz_with_damping_and_places(tmp_path):
    np.savez(tmp_path / "a.npz", K=K, M=M, C=C, dofs=DOFS, nodes=NODES, xyz=PLACES)
    model = jb.read_structure(tmp_path / "a.npz", length_unit="m")
    small.require_same(model)
    assert model.nodes.tolist() == NODES.tolist()
    np.testing.assert_array_equal(model.damping.toarray(), C)


@pytest.mark.parametrize("form", ["csc", "csr", "coo"])
def test_a_sparse_matrix_in_a_file_of_its_own(tmp_path, form):
    for name, matrix in (("k", K), ("m", M)):
        sparse.save_npz(tmp_path / f"{name}.npz", sparse.coo_array(matrix).asformat(form))
    dofs, nodes = small.write_map(tmp_path / "map.csv"), small.write_places(tmp_path / "xyz.csv")
    model = jb.read_structure(tmp_path / "k.npz", mass=tmp_path / "m.npz", dofs=dofs, nodes=nodes, length_unit="m")
    small.require_same(model)
    assert model.place(41).tolist() == PLACES[4].tolist()


def test_nastran_dmig_whose_matrices_have_lists_of_their_own(tmp_path):
    light = M.copy()
    light[DOFS[:, 1] > 3] = light[:, DOFS[:, 1] > 3] = 0  # masses without rotary inertia: M is semidefinite
    path = write_punch(tmp_path / "a.pch", KAAX=K, MAAX=light, TUGX=K)
    model = jb.read_structure(path, nodes=path, length_unit="m")
    assert np.array_equal(model.dofs, DOFS)
    np.testing.assert_array_equal(model.stiffness.toarray(), K)
    np.testing.assert_array_equal(model.mass.toarray(), light)
    np.testing.assert_allclose(model.places, PLACES)
    assert model.notes == ("DMIG TUGX is not used", "K holds 1 of 5 nodes to ground: node 3")


def test_modes_of_a_substructure_of_abaqus_are_generalised_coordinates(tmp_path):
    """The last node has DOF 2 alone, and two internal nodes follow with one DOF each."""
    (tmp_path / "s.mtx").write_text(
        "** \n*USER ELEMENT, NODES=   4, LINEAR\n** ELEMENT NODES\n**  7,  9, -1, -2\n 1, 2\n 2, 2\n 3, 1\n"
        "*MATRIX,TYPE=STIFFNESS\n 1.0 ,\n 0. , 2.0\n 0. , -2.0 , 2.0\n 0. , 0. , 0. , 30.0\n 0. , 0. , 0. , 0.\n 40.0\n"
        "*MATRIX,TYPE=MASS\n 1.0 ,\n 0. , 2.0\n 0. , 0. , 2.0\n 0. , 0. , 0. , 1.0\n 0. , 0.5 , 0. , 0.\n 1.0\n"
    )
    model = jb.read_structure(tmp_path / "s.mtx", length_unit="m")
    assert model.dofs.tolist() == [[7, 1], [7, 2], [9, 2], [-1, 0], [-2, 0]]
    assert model.stiffness.diagonal().tolist() == [1, 2, 2, 30, 40]
    assert model.mass[1, 4] == model.mass[4, 1] == 0.5
    text = (tmp_path / "s.mtx").read_text()
    for old, new, words in (
        (" 40.0\n", " 40.0, 1.0\n", "16 numbers of STIFFNESS for 5 DOFs; expected 15, one triangle"),
        ("** ELEMENT NODES", "** NODES", "no nodes or no DOFs"),
        ("30.0", "3o.0", "line 12: found '0. , 0. , 0. , 3o.0'"),
    ):
        (tmp_path / "s.mtx").write_text(text.replace(old, new, 1))
        with pytest.raises(jb.ModelError, match=rf"s\.mtx.*{words}"):
            jb.read_structure(tmp_path / "s.mtx", length_unit="m")


def test_nodes_of_ansys_whose_systems_are_turned(tmp_path):
    """THXY, THYZ and THZX turn about z, then about the new x, then about the new y. Zeros at the end are left out."""
    angles = {11: (30.0, 0.0, 0.0), 41: (20.0, -35.0, 50.0)}
    own = np.eye(len(DOFS))
    for node, turned in angles.items():
        for first in (1, 4):
            rows = [i for i, (n, w) in enumerate(DOFS) if n == node and first <= w < first + 3]
            own[np.ix_(rows, rows)] = Rotation.from_euler("ZXY", turned, degrees=True).as_matrix()
    k, m = (small.write_matrix_market(tmp_path / f"{i}.mmf", own.T @ a @ own) for i, a in (("k", K), ("m", M)))
    lines = ["/PREP7", "NBLOCK,6,SOLID,       41,        5", "(3i9,6e21.13e3)"]
    for node, place in zip(NODES, PLACES, strict=True):
        row = f"{node:9d}{0:9d}{0:9d}" + "".join(f"{x:21.13E}" for x in (*place, *angles.get(node, ())))
        lines.append(row.removesuffix(f"{0.0:21.13E}" * 2))
    lines += ["N,R5.3,LOC,       -1,", "EBLOCK,19,SOLID,        1", "        1        1"]
    cdb = tmp_path / "a.cdb"
    cdb.write_text("\n".join(lines) + "\n")
    dofs = small.write_mapping(tmp_path / "k.mapping")
    more = {"mass": m, "dofs": dofs, "nodes": cdb, "length_unit": "m"}
    small.require_same(jb.read_structure(k, **more), rtol=1e-8)
    cdb.write_text(cdb.read_text().replace("(3i9,6e21.13e3)", "(free)"))
    with pytest.raises(jb.ModelError, match=r"a\.cdb, line 2: found no format such as \(3i9,6e21.13e3\) below it"):
        jb.read_structure(k, **more)


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
    model = jb.read_structure(tmp_path / "a.npz", length_unit="m")
    expected = 7800 * 1e-4 * 0.45
    assert [model.mass_along(way) for way in "xyz"] == pytest.approx([expected] * 3, rel=1e-8)
