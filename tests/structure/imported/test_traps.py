"""What exports do to those who trust them, each told in one line with file and entry, or undone."""

import re
import sys

import numpy as np
import pytest
from benchmarks.bricks import brick_model
from scipy import sparse

import jointbayes as jb
from tests.structure.imported import small_frame as small
from tests.structure.imported.nastran_files import superelement
from tests.structure.imported.small_frame import DOFS, NODES, PLACES, K, M


def refused(path, match, **further):
    with pytest.raises(jb.ModelError, match=match) as caught:
        jb.read_structure(path, **{"length_unit": "m"} | further)
    text = str(caught.value)
    assert "\n" not in text
    assert "; expected " in text
    return text


def npz(tmp_path, **changed):
    arrays = {"K": K, "M": M, "dofs": DOFS} | changed
    np.savez(tmp_path / "a.npz", **{name: value for name, value in arrays.items() if value is not None})
    return tmp_path / "a.npz"


# ---- Abaqus


def abaqus(tmp_path, k=K, m=M, dofs=DOFS):
    """Files of a job, the mass beside the stiffness."""
    small.write_abaqus(tmp_path / "j_MASS2.mtx", m, dofs)
    return small.write_abaqus(tmp_path / "j_STIF2.mtx", k, dofs)


def test_rows_of_1e36_are_supports(tmp_path):
    k = K.copy()
    k[:6] = k[:, :6] = 0  # node 3 clamped, as Abaqus writes it
    k[range(6), range(6)] = 1e36
    model = jb.read_structure(abaqus(tmp_path, k), length_unit="m")
    assert model.dofs.tolist() == DOFS[6:].tolist()
    np.testing.assert_array_equal(model.stiffness.toarray(), K[6:, 6:])
    assert model.notes[0] == "6 DOFs with 1e36 on the diagonal of K are supports, and left out"


def test_nodes_below_1_are_generalised_coordinates(tmp_path):
    dofs = DOFS.copy()
    dofs[dofs[:, 0] == 41, 0] = -2  # six of Abaqus's own
    model = jb.read_structure(abaqus(tmp_path, dofs=dofs), length_unit="m")
    assert sorted(model.dofs[model.dofs[:, 0] < 0].tolist()) == [[-i, 0] for i in range(6, 0, -1)]
    np.testing.assert_allclose(small.frequencies(model), small.EXACT, rtol=1e-9)


def test_abaqus_files_of_heat_or_cut_at_the_end_of_a_line_or_beside_a_map_are_refused(tmp_path):
    heat = DOFS.copy()
    heat[3, 1] = 11
    refused(abaqus(tmp_path, dofs=heat), r"j_STIF2.mtx, entry \d+: found DOF 11 of node 3; expected 1 to 6")
    path = abaqus(tmp_path)
    refused(path, "map.csv: found matrices with nodes", dofs=small.write_map(tmp_path / "map.csv"))
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[: len(lines) // 2]))
    refused(path, "found mass but no stiffness at node 12, direction")


# ---- Nastran


def test_a_superelement_of_nastran_with_output_systems_of_its_grids(tmp_path):
    """Mass is semidefinite, names are kxx and mxx, and grid 11 has an output system that is turned."""
    path = superelement(tmp_path, "outboard")
    from pyyeti.nastran import bulk, n2p, op4

    model = jb.read_structure(path, length_unit="in")
    assert sorted(model.nodes.tolist()) == [3, 11, 19, 27]
    assert (model.dofs[:, 1] == 0).sum() == 22
    uset, _, _ = bulk.asm2uset(str(tmp_path / "a.asm"))
    rigid = n2p.rbgeom_uset(uset, [0, 0, 0])  # in the output systems
    given = {name: matrix.toarray() for name, matrix in op4.read(str(path), justmatrix=True, sparse=True).items()}
    inertia = rigid.T @ given["mxx"] @ rigid
    slinch = 0.45359237 * 9.80665 / 0.0254
    assert [model.mass_along(way) for way in "xyz"] == pytest.approx(np.diag(inertia)[:3] * slinch, rel=1e-9)
    assert model.place(11) / 0.0254 == pytest.approx([600, 300, 300])
    b = model.dofs[:, 1] > 0  # rigid motion strains nothing only where the DOFs are those of the basic system
    for way in (1, 2, 3):
        push = (model.dofs[:, 1] == way).astype(float)
        assert abs(model.stiffness @ push)[b].max() < 1e-6 * abs(model.stiffness).max()


def test_grids_of_a_superelement_hold_some_directions_only_and_no_cylindrical_output_system(tmp_path):
    model = jb.read_structure(superelement(tmp_path, "reduced_bset_notall6"), length_unit="in")
    assert model.n_dofs == 29
    assert model.place(411) / 0.0254 == pytest.approx([0, -61.25, 19.5])
    path = superelement(tmp_path, "outboard", lambda _, content: content.replace(b"CORD2R", b"CORD2C"))
    refused(path, "output system 10 at grid 11, not rectangular; expected the basic system")


def test_pyyeti_missing_is_one_line(tmp_path, monkeypatch):
    (tmp_path / "a.op4").write_bytes(b"x" * 100)
    for name in ("pyyeti", "pyyeti.nastran.op4"):
        monkeypatch.setitem(sys.modules, name, None)
    refused(tmp_path / "a.op4", r"a.op4: found a file of Nastran; expected pyyeti.*pip install jointbayes\[nastran\]$")


DMIG = "".join(
    f"DMIG    {name}{0:12d}{6:8d}{2:8d}{0:8d}{2:24d}\nDMIG*   {name}{1:28d}{1:16d}\n*{1:23d}{1:16d} {value}\n"
    for name, value in (("KAAX", "2.000000000D+03"), ("MAAX", "2.000000000D+00"))
)


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("D+03", "X+03", r"a.pch, line 3: found '\* .*expected a whole card"),
        ("MAAX           0       6       2", "MAAX           0       6       4", "'MAAX': found complex"),
        ("MAAX", "TAAX", "found no mass matrix, but stiffness; expected M in kg; export it too, give mass="),
        ("DMIG*   MAAX  ", "DMIG    MAAX  ", "line 5: found a DMIG card in small fields"),
        ("               1 2.000000000D+03", "               7 2.000000000D+03", "found 7"),
        ("2.000000000D+00\n", "2.000", "a whole card"),
        ("D+00\n", f"D+00\n{'GRID':8}{1:8d}{7:8d}{0.0:8}{0.0:8}{0.0:8}\n", "line 7: found grid '1' in system '7'"),
    ],
)
def test_damaged_dmig(tmp_path, old, new, match):
    (tmp_path / "a.pch").write_text(DMIG.replace(old, new))
    refused(tmp_path / "a.pch", match, **{"nodes": tmp_path / "a.pch"} if "GRID" in new else {})


# ---- Ansys, Matrix Market


def test_a_mapping_forgotten_of_another_model_with_a_line_lost_and_with_heat(tmp_path):
    k = small.write_matrix_market(tmp_path / "k.mmf", K)
    refused(k, "k.mmf: found no map of the DOFs; expected .*; give dofs=", mass=k)
    dofs = small.write_mapping(tmp_path / "k.mapping", DOFS[:-1])
    told = "k.mmf: found a stiffness matrix of 30 rows, and a map of 29 DOFs in .*k.mapping; expected as"
    refused(k, told, mass=k, dofs=dofs)
    small.write_mapping(dofs)
    text = dofs.read_text()
    dofs.write_text("\n".join(line for i, line in enumerate(text.split("\n")) if i != 4))
    refused(k, "k.mapping, line 5: found row 5; expected row 4", mass=k)
    dofs.write_text(text.replace("ROTZ", "TEMP"))
    refused(k, "k.mapping, line 7: found the direction 'TEMP'", mass=k)


BOEING = [
    (lambda t: t.replace("RSA", "CSA"), "found a matrix of the kind 'CSA'; expected RSA"),
    (lambda t: t[: len(t) // 2].rpartition("\n")[0] + "\n", "numbers; expected .* as the header says"),
    (lambda t: t[:-5], "found no end of the last line"),
    (lambda t: t.replace("(8I10) ", "(8X10) ", 1), "line 4: found .*expected three formats of Fortran"),
    (lambda t: t.replace(f"{30:14d}{30:14d}", f"{30:14d}{31:14d}", 1), "line 3: found 30 rows, 31"),
]
SYMMETRIC = "coordinate real symmetric\n30 30"
MARKET = [
    ("coordinate complex symmetric\n1 1 1\n1 1 1 0\n", "found the header .*complex"),
    ("array real general\n4000000 4000000\n1\n", "line 2: found the sizes '4000000 4000000'"),
    (f"{SYMMETRIC} 7\n1 1 1\n", "found 1 entries; expected 7"),
    (f"{SYMMETRIC} 2\n1 1 1\n31 1 2\n", "entry 2: found 31; expected"),
    (f"{SYMMETRIC} 2\n1 1 1\n3 1 x\n", "line 4: found '3 1 x'"),
    (f"{SYMMETRIC} 2\n1 1 1\n3 1 2", "found no end of the last line"),
    (f"{SYMMETRIC} 2\n1 1 1\n1 1 2\n", "entry of the stiffness matrix twice"),
    (f"{SYMMETRIC} 1\n1 1 nan\n", "found nan in the stiffness matrix"),
]


@pytest.mark.parametrize(
    ("damaged", "match"), [*BOEING, *((lambda _, text=text: f"%%MatrixMarket matrix {text}", m) for text, m in MARKET)]
)
def test_damaged_matrices_with_a_map(tmp_path, damaged, match):
    path = small.write_harwell_boeing(tmp_path / "k", K)
    path.write_text(damaged(path.read_text()))
    mass = small.write_matrix_market(tmp_path / "m.mtx", M)
    refused(path, match, mass=mass, dofs=small.write_map(tmp_path / "map.csv"))


# ---- CalculiX


@pytest.mark.parametrize("cut", [0.3, 0.5, 0.99])
def test_a_calculix_file_cut_at_the_end_of_a_line(tmp_path, cut):
    for name, matrix in (("j.sti", K), ("j.mas", M)):
        small.write_calculix(tmp_path / name, matrix)
    small.write_dof(tmp_path / "j.dof")
    lines = (tmp_path / "j.mas").read_text().splitlines(keepends=True)
    (tmp_path / "j.mas").write_text("".join(lines[: int(cut * len(lines))]))
    refused(tmp_path / "j.sti", r"j\.mas: found (row|a mass matrix of \d+ rows)")


def test_a_dof_file_of_another_kind(tmp_path):
    path = small.write_calculix(tmp_path / "j.sti", K)
    (tmp_path / "j.dof").write_text("3.1\n3.7\n")
    refused(path, r"j.dof, line 2: found '3.7'; expected a line 'node.direction'", mass=path)


# ---- matrices and maps

UNSYMMETRIC = K * np.where(np.arange(900).reshape(30, 30) == 64, 1.01, 1.0)
CSC = sparse.csc_array(K)
SPARSE = {"K_data": CSC.data, "K_indices": CSC.indices, "K_indptr": CSC.indptr, "K_shape": CSC.shape, "K": None}


def test_a_semidefinite_mass_of_minus_5e_minus_12_is_taken(tmp_path):
    m = M.copy()
    m[29, 29] = m[29, :29] = m[:29, 29] = 0
    m[29, 29] = -5e-12
    model = jb.read_structure(npz(tmp_path, M=m), length_unit="m")
    np.testing.assert_array_equal(model.mass.toarray(), m)


def test_dofs_without_stiffness_and_mass_are_left_out(tmp_path):
    k, m = K.copy(), M.copy()
    for matrix in (k, m):
        matrix[[3, 9]] = matrix[:, [3, 9]] = 0  # rotations of a solid's nodes in the g-set
    model = jb.read_structure(npz(tmp_path, K=k, M=m), length_unit="m")
    assert model.row(3, "rx") is None
    assert model.notes[0] == "2 DOFs without stiffness and mass are left out"


@pytest.mark.parametrize(
    ("changed", "match"),
    [
        ({"dofs": None}, "found no map of the DOFs"),
        ({"dofs": DOFS[:-2]}, "found a stiffness matrix of 30 rows, and a map of 28 DOFs"),
        ({"M": M[:-1, :-1]}, "found a mass matrix of 29 rows, and a map of 30 DOFs"),
        ({"M": M[:-1]}, r"'M': found shape \(29, 30\); expected a square matrix"),
        ({"dofs": np.where(DOFS == 6, 7, DOFS)}, "'dofs', entry 6: found 7; expected whole numbers from 0 to 6"),
        ({"dofs": DOFS + 0.5}, "'dofs', entry 1: found"),
        ({"dofs": np.repeat(DOFS[:1], 30, 0)}, "found 29 DOFs twice"),
        ({"dofs": DOFS.T}, r"'dofs': found shape \(2, 30\)"),
        ({"K": np.where(K[0, 0] == K, np.nan, K)}, "found nan in the stiffness matrix at row 1, column 1"),
        ({"K": np.where(K[0, 0] == K, np.inf, K)}, "found inf in the stiffness matrix at row 1, column 1"),
        ({"K": K * (1 + 0.01j)}, "found complex numbers"),
        ({"xyz": PLACES, "nodes": NODES[1:]}, r"'xyz': found coordinates of shape \(5, 3\) for 4 nodes"),
        ({"K": None, "M": None}, "found dofs; expected K and M"),
        ({"K2": K, "stiffness": K}, "more than one matrix of stiffness"),
        ({"K": UNSYMMETRIC}, r"a.npz: found an unsymmetric stiffness matrix, .* at row (3, column 5|5, column 3)"),
        ({"M": None}, "a.npz: found no mass matrix, but stiffness; expected M in kg"),
        ({"M": 0 * M}, "found no mass; expected a mass matrix"),
        ({"K": np.array(sparse.csc_array(K), dtype=object)}, "a.npz: variable 'K'"),  # a pickle is not opened
        (SPARSE | {"K_indices": CSC.indices + 1}, "found 30; expected whole numbers from 0 to 29"),
        (SPARSE | {"K_indptr": CSC.indptr[::-1]}, "whole numbers|repeats may not contain negative"),
        (SPARSE | {"K_data": CSC.data[:-3]}, "expected whole numbers from 0 to"),
        (SPARSE | {"K_indices": CSC.indices[:-3]}, "expected a whole square matrix"),
        (SPARSE | {"K_shape": (30, 10**12)}, "expected a whole square matrix"),
    ],
)
def test_arrays_that_do_not_fit(tmp_path, changed, match):
    refused(npz(tmp_path, **changed), match)


def test_maps_and_coordinates_in_csv(tmp_path):
    k, m = small.write_matrix_market(tmp_path / "k.mtx", K), small.write_matrix_market(tmp_path / "m.mtx", M)
    good, places = small.write_map(tmp_path / "map.csv"), small.write_places(tmp_path / "xyz.csv")
    semicolons = tmp_path / "semi.csv"
    semicolons.write_text(good.read_text().replace(",", ";").replace("rx", "ROTX").replace(";x", ";1"))
    small.require_same(jb.read_structure(k, mass=m, dofs=semicolons, nodes=places, length_unit="m"))
    for path, text, match in (
        (places, "node,x,y,z\n3,0,0,inf\n", "xyz.csv, line 2: found 'inf'; expected a coordinate"),
        (places, "node,x,y,z\n3,0,0,0\n3,1,0,0\n", "xyz.csv: found node 3 2 times"),
        (places, "node,x,y\n3,0,0\n", "line 2: found '3,0,0'; expected node,x,y,z"),
        (good, "node,direction\n3,x\n3,w\n", "map.csv, line 3: found the direction 'w'"),
        (good, "node,direction\n3\n", "map.csv, line 2: found '3'; expected node,direction"),
        (good, "node,direction\n", "found no DOF"),
    ):
        path.write_text(text)
        refused(k, match, mass=m, dofs=good, **({"nodes": places} if path is places else {}))


PLANE = ((0, 0), (1, 0), (1, 1), (0, 1))
CORNERS = [f"{4 * z + i}, {x}, {y}, {z}" for z in range(3) for i, (x, y) in enumerate(PLANE, 1)]
#: Two cubes on each other, a beam and a spring; the nodes stand in lines 4 to 16.
INP = "\n".join([
    "** a comment", "*HEADING", "*NODE, NSET=ALL", *CORNERS, "13, 0, 0, 3", "*ELEMENT, TYPE=C3D8R, ELSET=E",
    "1, 1, 2, 3, 4,", "5, 6, 7, 8", "2, 5, 6, 7, 8, 9, 10, 11, 12", "*ELEMENT, TYPE=B31", "3, 9, 13",
    "*ELEMENT, TYPE=SPRINGA", "4, 1, 13", "*NODE FILE", "U", "",
])  # fmt: skip


def test_edges_of_the_surface_from_an_input_file(tmp_path):
    (tmp_path / "a.inp").write_text(INP)
    dofs = np.array([(node, way) for node in range(1, 14) for way in (1, 2, 3)])
    np.savez(tmp_path / "a.npz", K=np.eye(39), M=np.eye(39), dofs=dofs)
    model = jb.read_structure(tmp_path / "a.npz", nodes=tmp_path / "a.inp", length_unit="m")
    edges = set(map(tuple, model.edges.tolist()))
    assert len(edges) == 20 + 1  # two cubes on each other, and the beam; no spring
    assert {(9, 13), (5, 8), (1, 2)} <= edges
    assert (1, 13) not in edges
    assert model.place(11).tolist() == [1, 1, 2]


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ("*NODE, NSET", "*NODE, SYSTEM=C, NSET", "a.inp, line 3: found .*expected rectangular coordinates"),
        ("13, 0, 0, 3", "12, 0, 0, 3", "a.inp: found node 12 2 times; expected each node once; give the flat input"),
        ("2, 1, 0, 0", "2, 1, o, 0", "line 5: found 'o'; expected a coordinate"),
        ("3, 9, 13", "3, 9, a", "line 22: found '3, 9, a'"),
    ],
)
def test_damaged_input_files(tmp_path, old, new, match):
    (tmp_path / "a.inp").write_text(INP.replace(old, new, 1))
    refused(npz(tmp_path), match, nodes=tmp_path / "a.inp")


# ---- units


def test_a_unit_must_be_stated_and_be_one_of_four(tmp_path):
    with pytest.raises(TypeError, match="length_unit"):
        jb.read_structure(npz(tmp_path))
    for unit in ("cm", "?", 1, None):
        refused(npz(tmp_path), 'length_unit: found .*; expected one of "m", "mm", "in", "ft"', length_unit=unit)


#: Length in m and mass in kg of each unit: a slinch is one lbf s²/in, a slug one lbf s²/ft.
UNITS = {"m": (1.0, 1.0), "mm": (1e-3, 1e3), "in": (0.0254, 175.12683524647636), "ft": (0.3048, 14.593902937206364)}


def in_unit(unit, tmp_path, **more):
    """The small frame in the files of another system of units."""
    length, mass = UNITS[unit]
    scale = np.where(DOFS[:, 1] <= 3, length, 1.0)
    k, m = (a * np.outer(scale, scale) / (mass * length**2) for a in (K, M))
    return npz(tmp_path, K=k, M=m, nodes=NODES, xyz=PLACES / length, **more)


@pytest.mark.parametrize("unit", UNITS)
def test_each_unit_gives_the_same_model_in_si(tmp_path, unit):
    model = jb.read_structure(in_unit(unit, tmp_path), length_unit=unit)
    small.require_same(model)
    assert model.size == "0.351 kg, 200 × 100 × 150 mm"


@pytest.mark.parametrize("right", UNITS)
@pytest.mark.parametrize("stated", UNITS)
def test_a_solid_in_a_wrong_unit_is_refused_with_the_right_one_named(tmp_path, right, stated):
    """Steel that fills its box has 7800 kg/m³ in one unit alone; feet that are taken for metres leave 15."""
    model, (length, mass) = brick_model((4, 2, 2)), UNITS[right]
    k, m = model.stiffness.toarray() / mass, model.mass.toarray() / mass  # lengths cancel: only translations
    path = npz(tmp_path, K=k, M=m, dofs=model.dofs, nodes=model.nodes, xyz=model.places / length)
    if stated == right or (stated, right) == ("m", "ft"):
        assert jb.read_structure(path, length_unit=stated).whole_mass == pytest.approx(0.936 * UNITS[stated][1] / mass)
    else:
        told = refused(path, rf'length_unit="{right}" \(7.8e\+03 kg/m³\)', length_unit=stated)
        assert f"in the unit '{stated}'" in told


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("mass", [1e3, 1e6])
def test_mm_with_kg_or_g_is_refused(tmp_path, unit, mass):
    model = brick_model((4, 2, 2))
    k, m = model.stiffness.toarray() / 1e3, mass * model.mass.toarray() / 1e3
    path = npz(tmp_path, K=k, M=m, dofs=model.dofs, nodes=model.nodes, xyz=1e3 * model.places)
    if (unit, mass) not in (("in", 1e3), ("ft", 1e6)):  # 83 and 4 kg/m³
        refused(path, r"export in consistent units \(mm with t, not kg\)$", length_unit=unit)


# ---- files


def test_a_path_that_is_no_file(tmp_path):
    refused(tmp_path / "none.npz", "none.npz: found no such file")
    refused(tmp_path, "found no regular file")
    refused(npz(tmp_path), "x.csv: found no such file", dofs=tmp_path / "x.csv")


@pytest.mark.parametrize("content", [b"", b"\0" * 40, b"hello\n", b"%PDF-1.4", b"PK\x03\x04" + b"x" * 90])
def test_a_file_of_no_kind(tmp_path, content):
    (tmp_path / "a.bin").write_bytes(content)
    refused(tmp_path / "a.bin", "a.bin: (content: )?found")


def test_a_bomb_is_not_unpacked(tmp_path):
    np.savez_compressed(tmp_path / "a.npz", K=np.zeros(2**26), M=M, dofs=DOFS)
    refused(tmp_path / "a.npz", "found arrays of 537 MB or more; expected at most 268 MB")


def test_an_input_file_found_beside_that_cannot_be_used_is_a_note(tmp_path):
    path = abaqus(tmp_path)
    (tmp_path / "j.inp").write_text(INP.replace("13, 0, 0, 3", "12, 0, 0, 3"))
    model = jb.read_structure(path, length_unit="m")
    assert re.fullmatch(r"no coordinates: .*j\.inp: found node 12 2 times; .*", model.notes[0])
    assert model.place(12) is None
    refused(path, "j.inp: found node 12 2 times", nodes=tmp_path / "j.inp")


def test_damping_in_a_file_of_its_own_and_a_file_of_another_role(tmp_path):
    dofs = small.write_map(tmp_path / "map.csv")
    k, m, c = (small.write_matrix_market(tmp_path / f"{i}.mtx", a) for i, a in enumerate((K, M, small.C)))
    model = jb.read_structure(k, mass=m, damping=c, dofs=dofs, length_unit="m")
    np.testing.assert_array_equal(model.damping.toarray(), small.C)
    np.savez(tmp_path / "only.npz", M=M)
    told = "only.npz: found a matrix of mass; expected one of damping"
    refused(k, told, mass=m, damping=tmp_path / "only.npz", dofs=dofs)
