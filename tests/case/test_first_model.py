"""`init --from` with a finite-element model: its table, and the channels on its DOFs; valid once it is answered."""

import re

import numpy as np
import pytest
from benchmarks.written_files import write_records

import jointbayes as jb
from tests.conftest import cli
from tests.structure.imported import small_frame as small
from tests.structure.imported.nastran_files import superelement
from tests.structure.imported.small_frame import DOFS, NODES, PLACES, K, M
from tests.structure.imported.test_formats import BOEING, WRITERS, two_files
from vibrecords.records import FrfRecord

LINES = np.arange(20.0, 400.0, 2.0)
OMEGA = 2 * np.pi * LINES
ROW = {(int(node), int(way)): row for row, (node, way) in enumerate(DOFS)}
#: One or two of each program; all are read in tests/structure/imported/test_formats.py.
FILES = {name: WRITERS[name] for name in (
    "npz", "npz with labels", "MATLAB 5, sparse", "MATLAB 7.3", "Matrix Market, general",
    "Matrix Market of Ansys, its mapping beside", "Harwell-Boeing of Ansys, 3", "OP4, bigmat, binary", "DMIG", "Abaqus",
    "a substructure of Abaqus")}  # fmt: skip
FILES |= {"Rutherford-Boeing": two_files(BOEING, ("k.rb", "m.rb"), small.write_map)}


def measure(path, labels, points=None):
    """A universal file of accelerances between DOFs (node, direction), the first is hit; with the places of points."""
    rows = [ROW[dof] for dof in labels.values()]
    whole = np.array([np.linalg.solve((1 + 0.02j) * K - w**2 * M, np.eye(len(K))[:, rows[0]]) for w in OMEGA])
    hit = next(iter(labels))
    records = [
        FrfRecord(label, hit, LINES, -(OMEGA**2) * whole[:, row], "accelerance", "m/s^2/N")
        for label, row in zip(labels, rows, strict=True)
    ]
    write_records(records, path, "uff58b")
    if points:
        lines = [f"{n:10d}{0:10d}{0:10d}{11:10d}\n{x:25.16E}{y:25.16E}{z:25.16E}" for n, (x, y, z) in points.items()]
        block = "\n".join([f"{-1:6d}", f"{2411:6d}", *lines, f"{-1:6d}"]).replace("E+", "D+").replace("E-", "D-")
        path.write_bytes(f"{block}\n".encode() + path.read_bytes())


def first_case(home, *files, unit="m"):
    """The case that `init` writes for some files, and the same with its answers."""
    result = cli("init", home / "my_case.toml", "--from", *files)
    assert result.exit_code == 0, result.output
    text = (home / "my_case.toml").read_text(encoding="utf-8")
    answered = text.replace('length_unit = "?"', f'length_unit = "{unit}"')
    answered = re.sub(r'box_mm = "\?"', "box_mm = [[-1, -1, -1], [1, 1, 1]]", answered)
    (home / "my_case.toml").write_text(answered.replace('node = "?"', "node = 3"), encoding="utf-8")
    return text


@pytest.mark.parametrize("writer", FILES)
def test_a_model_of_every_format_is_valid_once_two_questions_are_answered(tmp_path, writer):
    path, more = FILES[writer](tmp_path, small.FREE, M)
    measure(tmp_path / "tap.uff", {"41:X+": (41, 1), "12:Y-": (12, 2)})
    text = first_case(tmp_path, tmp_path / "tap.uff", path, *more.values())
    rows = [line for line in text.splitlines() if '"?"' in line and not line.startswith("#")]
    assert [row.split(" = ")[0] for row in rows] in (["length_unit", "node"], ["length_unit", "box_mm"])
    assert 'channels = { "41:X+" = "41:x", "12:Y-" = "-12:y" }' in text
    assert "# 3. Sensors and hammer, at the nodes that the labels name" in text
    assert all(f'joint:{way}"' in text for way in ("x", "y", "z", "rx", "ry", "rz"))
    validated = cli("validate", tmp_path / "my_case.toml")
    assert validated.exit_code == 0, validated.output
    case = jb.load_case(tmp_path / "my_case.toml")
    assert case.problem.test.data.frf.outputs == ("41:x", "12:y")
    assert len(case.problem.quantities) == 6


def test_files_beside_a_model_of_calculix_are_found(tmp_path):
    k, m = small.in_mm(small.FREE, M)
    for name, matrix in (("a.sti", k), ("a.mas", m)):
        small.write_calculix(tmp_path / name, matrix)
    small.write_dof(tmp_path / "a.dof")
    measure(tmp_path / "tap.uff", {"41:X+": (41, 1)})
    text = first_case(tmp_path, tmp_path / "tap.uff", tmp_path / "a.sti", unit="mm")
    assert 'file = "a.sti"\nlength_unit' in text
    mass = jb.read_structure(tmp_path / "a.sti", length_unit="mm").whole_mass
    assert f'#    "mm" makes it {mass:.4g} kg.' in text
    assert cli("validate", tmp_path / "my_case.toml").exit_code == 0


def test_a_superelement_of_nastran_has_a_box_in_its_own_unit(tmp_path):
    path = superelement(tmp_path, "outboard")
    measure(tmp_path / "tap.uff", {"41:X+": (41, 1)})
    text = first_case(tmp_path, tmp_path / "tap.uff", path)
    assert re.search(r'box_mm = "\?"   # the file reaches x 600 to 600, y 0 to 300, ', text)
    assert '#    "mm" makes it 1590 kg, 0 × 0.3 × 0.3 m.' in text
    assert '"41:X+" = "?"' in text  # no such node


@pytest.mark.parametrize("scale", [1.0, 1e3])
def test_channels_go_by_place_whatever_numbers_and_unit_the_test_has(tmp_path, scale):
    """Point 3 of the test is node 41 of the model, not node 3; both have that number."""
    np.savez(tmp_path / "a.npz", K=small.FREE, M=M, dofs=DOFS, nodes=NODES, xyz=PLACES)
    points = {3: scale * PLACES[4], 7: scale * (PLACES[2] + [1e-4, 0, 0])}
    measure(tmp_path / "tap.uff", {"3:X+": (41, 1), "7:Y+": (12, 2), "9:Y+": (11, 2)}, points)
    text = first_case(tmp_path, tmp_path / "tap.uff", tmp_path / "a.npz")
    assert 'channels = { "3:X+" = "41:x", "7:Y+" = "12:y", "9:Y+" = "?" }' in text


def test_points_that_are_no_nodes_of_the_model_are_asked(tmp_path):
    np.savez(tmp_path / "a.npz", K=small.FREE, M=M, dofs=DOFS, nodes=NODES, xyz=PLACES)
    measure(tmp_path / "tap.uff", {"3:X+": (41, 1)}, {3: PLACES[4] + [0.02, 0.01, 0]})
    assert '"3:X+" = "?"' in first_case(tmp_path, tmp_path / "tap.uff", tmp_path / "a.npz")


def test_arrays_of_a_measurement_are_no_model_and_a_model_alone_is_no_case(tmp_path):
    np.savez(tmp_path / "frf.npz", frequency_hz=LINES, frf=np.exp(1j * LINES))
    assert 'length_mm = "?"' in first_case(tmp_path, tmp_path / "frf.npz")
    small.write_matrix_market(tmp_path / "k.mtx", K)
    alone = cli("init", tmp_path / "other.toml", "--from", tmp_path / "frf.npz", tmp_path / "k.mtx")
    assert (alone.exit_code, "found no mass matrix" in alone.output) == (2, True)
    assert "a further file of the model is named behind --from, too" in alone.output
    np.savez(tmp_path / "a.npz", K=K, M=M, dofs=DOFS)
    alone = cli("init", tmp_path / "other.toml", "--from", tmp_path / "a.npz")
    assert "a.npz: found a model, no FRF, time history or mode; expected one of these" in alone.output
