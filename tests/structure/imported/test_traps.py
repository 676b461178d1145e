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


# ---- for the rows of refused_calls.txt


def read(path, **further):
    return jb.read_structure(path, **{"length_unit": "m"} | further)


def write(path, text):
    path.write_text(text)
    return path


def cut(path, share):
    """The file cut at the end of a line."""
    lines = path.read_text().splitlines(keepends=True)
    return write(path, "".join(lines[: int(share * len(lines))]))


def calculix(tmp_path, share, dofs=None):
    """Files of a job, its mass cut."""
    cut(small.write_calculix(tmp_path / "j.mas", M), share)
    assert dofs or small.write_dof(tmp_path / "j.dof")
    return small.write_calculix(tmp_path / "j.sti", K)


def market(tmp_path):
    return small.write_matrix_market(tmp_path / "k.mmf", K)


def mapped(tmp_path, change):
    """The file of `market`, with a mapping beside it that is changed."""
    path = small.write_mapping(tmp_path / "k.mapping")
    write(path, change(path.read_text()))
    return market(tmp_path)


def boeing(tmp_path):
    return small.write_harwell_boeing(tmp_path / "k", K).read_text()


def beside(tmp_path):
    mass = small.write_matrix_market(tmp_path / "m.mtx", M)
    return {"mass": mass, "dofs": small.write_map(tmp_path / "map.csv")}


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


def test_grids_of_a_superelement_hold_some_directions_only(tmp_path):
    model = jb.read_structure(superelement(tmp_path, "reduced_bset_notall6"), length_unit="in")
    assert model.n_dofs == 29
    assert model.place(411) / 0.0254 == pytest.approx([0, -61.25, 19.5])


def test_pyyeti_missing_is_one_line(tmp_path, monkeypatch):
    (tmp_path / "a.op4").write_bytes(b"x" * 100)
    for name in ("pyyeti", "pyyeti.nastran.op4"):
        monkeypatch.setitem(sys.modules, name, None)
    refused(tmp_path / "a.op4", r"a.op4: found a file of Nastran; expected pyyeti.*pip install jointbayes\[nastran\]$")


DMIG = "".join(
    f"DMIG    {name}{0:12d}{6:8d}{2:8d}{0:8d}{2:24d}\nDMIG*   {name}{1:28d}{1:16d}\n*{1:23d}{1:16d} {value}\n"
    for name, value in (("KAAX", "2.000000000D+03"), ("MAAX", "2.000000000D+00"))
)


# ---- Ansys, Matrix Market


SYMMETRIC = "coordinate real symmetric\n30 30"


# ---- CalculiX


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


def test_maps_and_coordinates_in_csv(tmp_path):
    k, m = small.write_matrix_market(tmp_path / "k.mtx", K), small.write_matrix_market(tmp_path / "m.mtx", M)
    good, places = small.write_map(tmp_path / "map.csv"), small.write_places(tmp_path / "xyz.csv")
    semicolons = tmp_path / "semi.csv"
    semicolons.write_text(good.read_text().replace(",", ";").replace("rx", "ROTX").replace(";x", ";1"))
    small.require_same(jb.read_structure(k, mass=m, dofs=semicolons, nodes=places, length_unit="m"))


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


# ---- units


def test_a_unit_must_be_stated(tmp_path):
    with pytest.raises(TypeError, match="length_unit"):
        jb.read_structure(npz(tmp_path))


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


def test_an_input_file_found_beside_that_cannot_be_used_is_a_note(tmp_path):
    path = abaqus(tmp_path)
    (tmp_path / "j.inp").write_text(INP.replace("13, 0, 0, 3", "12, 0, 0, 3"))
    model = jb.read_structure(path, length_unit="m")
    assert re.fullmatch(r"no coordinates: .*j\.inp: found node 12 2 times; .*", model.notes[0])
    assert model.place(12) is None


def test_damping_in_a_file_of_its_own(tmp_path):
    dofs = small.write_map(tmp_path / "map.csv")
    k, m, c = (small.write_matrix_market(tmp_path / f"{i}.mtx", a) for i, a in enumerate((K, M, small.C)))
    model = jb.read_structure(k, mass=m, damping=c, dofs=dofs, length_unit="m")
    np.testing.assert_array_equal(model.damping.toarray(), small.C)
