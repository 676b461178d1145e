"""Cards of the joint for FE programs: each is read by another program, or by a reader of its published format.

Nastran cards are read by pyyeti, CalculiX cards by CalculiX itself. No free program reads those of Abaqus and Ansys:
the readers here follow the Abaqus Keywords Reference Guide (*SPRING, *MATRIX INPUT) and the Mechanical APDL Element
Reference (MATRIX27: C1 to C78 are the upper triangle of 12 by 12, row by row, nodes I and J).
"""

import shutil
import subprocess
from io import StringIO

import numpy as np
import pytest

from jointbayes.frf import NaturalFrequencies
from jointbayes.joint import Joint
from jointbayes.report.fe_cards import PROGRAMS, fe_cards, joint_element
from jointbayes.structure import ModalDamping, Section, beam
from tests.case.refusal_rows import parts_named
from tests.conftest import STEEL

K2 = np.array([[2.0e6, 3.0e3], [3.0e3, 40.0]])
K3 = np.array([[3e7, -2e5, 1e4], [-2e5, 8e6, 5e3], [1e4, 5e3, 900.0]])
TURN = np.array([[np.cos(0.4), np.sin(0.4), 0], [-np.sin(0.4), np.cos(0.4), 0], [0, 0, 1]])
GROUND, PAIR = Joint(("1:y", "1:rz")), Joint(("3:x", "3:y", "3:rz"), ("7:x", "7:y", "7:rz"))
OFFSET = Joint(PAIR.dofs, PAIR.against, offset_m=(0.2, 0.1, 0.0), offset_against_m=(-0.3, 0.0, 0.0))
X, Y, RZ = 1, 2, 6


def two_sided(k, dofs):
    """K between nodes 3 and 7 that are at one place, by DOF."""
    rows = [(node, dof) for node in (3, 7) for dof in dofs]
    whole = np.block([[k, -k], [-k, k]])
    return {(a, b): whole[i, j] for i, a in enumerate(rows) for j, b in enumerate(rows)}


def strain_matrix(k, deform):
    """K of the energy ½ dᵀ k d, where d are the deformations by a motion (x, y, θ) of node 3 and one of node 7."""
    motions = np.array([deform(unit[:3], unit[3:]) for unit in np.eye(6)]).T
    rows = [(node, dof) for node in (3, 7) for dof in (X, Y, RZ)]
    whole = motions.T @ k @ motions
    return {(a, b): whole[i, j] for i, a in enumerate(rows) for j, b in enumerate(rows)}


def with_offset(near, far):
    # a point at (a, b) from a node moves by (x − b θ, y + a θ)
    return near - far + np.array([-0.1 * near[2], 0.2 * near[2] + 0.3 * far[2], 0.0])


#: Joint, its K^J, and K between the DOFs of its nodes, stated without our code.
JOINTS = {
    "coupled pair to ground": (
        GROUND,
        K2,
        {((1, i), (1, j)): K2[m, n] for m, i in enumerate((Y, RZ)) for n, j in enumerate((Y, RZ))},
    ),
    "springs to ground": (GROUND, np.diag(K2.diagonal()), {((1, Y), (1, Y)): 2e6, ((1, RZ), (1, RZ)): 40.0}),
    "springs between two nodes": (PAIR, np.diag(K3.diagonal()), two_sided(np.diag(K3.diagonal()), (X, Y, RZ))),
    "full matrix between two nodes": (PAIR, K3, two_sided(K3, (X, Y, RZ))),
    "springs with offsets": (OFFSET, np.diag(K3.diagonal()), strain_matrix(np.diag(K3.diagonal()), with_offset)),
    "full matrix in its own axes": (
        Joint(PAIR.dofs, PAIR.against, axes=tuple(map(tuple, TURN))),
        K3,
        strain_matrix(K3, lambda near, far: TURN @ (near - far)),
    ),
}


def cards(program, joint, matrix, units="SI", nodes=None):
    return fe_cards(program, [joint_element(joint, matrix, (), units, nodes or {})], ["said"], units, 9001)


def assemble(entries):
    """Matrix by pairs of DOFs from entries that add up."""
    whole: dict = {}
    for a, b, value in entries:
        whole[a, b] = whole.get((a, b), 0.0) + value
    return whole


def symmetric(triangle):
    return assemble([(a, b, v) for a, b, v in triangle] + [(b, a, v) for a, b, v in triangle if a != b])


def spring(k, ends):
    """Entries of one spring between two DOFs, or one DOF and ground."""
    near, *far = ends
    return [(near, near, k)] + [entry for b in far for entry in ((b, b, k), (near, b, -k), (b, near, -k))]


def read_nastran(text):
    with np.printoptions():  # which pyyeti changes for the whole process
        bulk = pytest.importorskip("pyyeti.nastran.bulk", reason="pyyeti, which reads Nastran cards, is not installed")
    entries = []
    if "CBUSH" in text:
        stiffness = {int(row[0]): row for row in bulk.rdcards(StringIO(text), "PBUSH", return_var="list")}
        for row in bulk.rdcards(StringIO(text), "CBUSH", return_var="list"):
            _, number, near, far = (int(x or 0) for x in row[:4])
            assert row[-1] == 0  # in the basic coordinate system, as coincident nodes need
            assert stiffness[number][1] == "K"
            for direction, k in enumerate(stiffness[number][2:], 1):
                if k:
                    entries += spring(k, [(node, direction) for node in (near, far) if node])
    if "DMIG" in text:
        frame = bulk.rddmig(StringIO(text))["kjoint"]
        entries += [(a, b, frame.loc[a, b]) for a in frame.index for b in frame.columns]
    return assemble(entries)


def keywords(text):
    """Keyword lines of an Abaqus file with their parameters and data lines."""
    blocks = []
    for line in text.splitlines():
        if line.startswith("**"):
            continue
        if line.startswith("*"):
            name, *parameters = (part.strip() for part in line[1:].split(","))
            blocks.append((name, dict(p.split("=") for p in parameters), []))
        else:
            blocks[-1][2].append([part.strip() for part in line.split(",")])
    return blocks


def read_abaqus(text):
    elements, entries, matrices = {}, [], {}
    for name, parameters, data in keywords(text):
        if name == "ELEMENT":
            assert parameters["TYPE"] == f"SPRING{len(data[0]) - 1}"
            elements[parameters["ELSET"]] = [int(node) for node in data[0][1:]]
        elif name == "SPRING":
            nodes = elements[parameters["ELSET"]]
            entries += spring(float(data[1][0]), list(zip(nodes, map(int, data[0]), strict=True)))
        elif name == "MATRIX INPUT":
            assert parameters["TYPE"] == "SYMMETRIC"
            rows = [((int(a), int(i)), (int(b), int(j)), float(k)) for a, i, b, j, k in data]
            matrices[parameters["NAME"]] = symmetric(rows)
        else:
            assert name == "MATRIX ASSEMBLE"
            entries += [(a, b, k) for (a, b), k in matrices[parameters["STIFFNESS"]].items()]
    return assemble(entries)


def read_ansys(text):
    """A few commands of APDL: parameters, ET, R, RMORE, N, D, TYPE, REAL, E."""
    values = {"NMAX": 1000.0}
    constants: dict = {}
    held, entries, current = set(), [], 0
    for line in (line for line in text.splitlines() if not line.startswith("!")):
        command, *given = line.split(",")
        if command == "*GET":
            values[given[0]] = {"ETYP": 3.0, "RCON": 5.0, "NODE": 1000.0}[given[1]] + len(constants)
        elif "=" in command:
            name, _, _ = command.partition("=")
            assert command == f"{name}={name}+1"
            values[name] += 1
        elif command == "ET":
            assert given == ["JBET", "MATRIX27", "", "0", "4"]  # KEYOPT(2)=0 symmetric, KEYOPT(3)=4 stiffness
        elif command in ("R", "RMORE"):
            numbers = given[1:] if command == "R" else given
            if command == "R":
                current = values["JBR"]
            constants.setdefault(current, []).extend(map(float, numbers))
            assert len(numbers) == 6
        elif command == "N":
            assert given[1:] == [f"{axis}({given[1][3:-1]})" for axis in ("NX", "NY", "NZ")]
        elif command == "D":
            assert given[1:] == ["ALL", "0"]
            held.add(values[given[0]])
        elif command == "E":
            nodes = [int(values.get(name, 0) or name) for name in given]
            upper = iter(constants[values["JBR"]])
            dofs = [(node, direction) for node in nodes for direction in range(1, 7)]
            triangle = [(a, b, next(upper)) for i, a in enumerate(dofs) for b in dofs[i:]]
            assert next(upper, None) is None
            entries += [(a, b, k) for (a, b), k in symmetric(triangle).items() if not {a[0], b[0]} & held]
        else:
            assert command in ("/PREP7", "TYPE", "REAL"), line
    return assemble(entries)


READERS = {"nastran": (read_nastran, 1e-9), "abaqus": (read_abaqus, 1e-12), "ansys": (read_ansys, 1e-12)}


def require_equal(read, expected, tolerance):
    """Same entries, each to the digits that are printed; an entry that cancels to those of what cancelled."""
    largest = max(map(abs, expected.values()))
    for pair in {*read, *expected}:
        allowed = tolerance * abs(expected.get(pair, 0.0)) + 1e-16 * largest
        assert abs(read.get(pair, 0.0) - expected.get(pair, 0.0)) <= allowed, pair


@pytest.mark.parametrize("program", READERS)
@pytest.mark.parametrize("name", JOINTS)
def test_the_cards_are_the_joint_s_matrix(program, name):
    joint, matrix, expected = JOINTS[name]
    reader, tolerance = READERS[program]
    require_equal(reader(cards(program, joint, matrix)), expected, tolerance)


@pytest.mark.parametrize("program", READERS)
def test_millimetres_scale_each_kind_of_entry(program):
    joint, matrix, expected = JOINTS["full matrix between two nodes"]
    scale = {0: 1e-3, 1: 1.0, 2: 1e3}  # N/mm, N, N·mm
    in_mm = {(a, b): k * scale[(a[1] > 3) + (b[1] > 3)] for (a, b), k in expected.items()}
    require_equal(READERS[program][0](cards(program, joint, matrix, "mm-N-t")), in_mm, READERS[program][1])
    joint, matrix, expected = JOINTS["springs with offsets"]  # the offsets are millimetres as well
    in_mm = {(a, b): k * scale[(a[1] > 3) + (b[1] > 3)] for (a, b), k in expected.items()}
    require_equal(READERS[program][0](cards(program, joint, matrix, "mm-N-t")), in_mm, 1e-9)


@pytest.mark.parametrize("program", READERS)
def test_several_joints_at_one_node_add_up(program):
    elements = [joint_element(PAIR, K3, (), "SI", {}), joint_element(OFFSET, np.diag(K3.diagonal()), (), "SI", {})]
    elements += [joint_element(GROUND, np.diag(K2.diagonal()), (), "SI", {})]
    read = READERS[program][0](fe_cards(program, elements, [], "SI", 9001))
    names = ("full matrix between two nodes", "springs with offsets", "springs to ground")
    expected = assemble([(a, b, k) for name in names for (a, b), k in JOINTS[name][2].items()])
    require_equal(read, expected, 1e-9)


# ---- CalculiX

needs_ccx = pytest.mark.skipif(
    shutil.which("ccx") is None,
    reason="CalculiX (ccx, package calculix-ccx) is not installed: its cards are read by nobody",
)
#: A cube of steel that each node of the joint moves as a rigid body: reference node, and node of its rotations.
CUBE = parts_named("rooms")["report/fe_cards cube"]
CUBES = "*MATERIAL, NAME=STEEL\n*ELASTIC\n2.1E11, 0.3\n*SOLID SECTION, ELSET=CUBES, MATERIAL=STEEL\n"


def solve_calculix(directory, text, nodes, moved, steps):
    """Displacements of DOFs that CalculiX finds in each step, given by keyword lines; what is not moved is held."""
    lines = [CUBE.format(node) for node in nodes]
    lines += [CUBES, text, "*NSET, NSET=OUT", ", ".join(f"{node}0{i}" for node in nodes for i in (1, 2))]
    held = {(f"{node}0{i}", dof) for node in nodes for i in (1, 2) for dof in (1, 2, 3)} - set(moved)
    lines += ["*BOUNDARY", *(f"{node}, {dof}" for node, dof in sorted(held))]
    for step in steps:
        lines += ["*STEP", "*STATIC", *step, "*NODE PRINT, NSET=OUT", "U", "*END STEP"]
    (directory / "t.inp").write_text("\n".join(line for line in "\n".join(lines).split("\n") if line) + "\n")
    done = subprocess.run(["ccx", "t"], cwd=directory, capture_output=True, text=True, timeout=60, check=False)
    rows = [line.split() for line in (directory / "t.dat").read_text().splitlines()]
    rows = [row for row in rows if len(row) == 4 and row[0].isdigit()]
    count = 2 * len(nodes)
    assert len(rows) == count * len(steps), done.stdout[-2000:]
    return [
        {(row[0], dof): float(row[dof]) for row in rows[i : i + count] for dof in (1, 2, 3)}
        for i in range(0, len(rows), count)
    ]


def require_inverse(compliance, stiffness):
    """CalculiX prints 7 digits; an entry of no coupling is rounding."""
    expected = np.linalg.inv(stiffness)
    size = np.sqrt(expected.diagonal())
    np.testing.assert_allclose(compliance / np.outer(size, size), expected / np.outer(size, size), rtol=5e-6, atol=1e-7)


def forces(dofs):
    return [["*CLOAD, OP=NEW", f"{node}, {dof}, 1e-3"] for node, dof in dofs]


@needs_ccx
@pytest.mark.parametrize("coupled", [True, False])
def test_calculix_deforms_a_joint_to_ground_by_its_compliance(tmp_path, coupled):
    matrix = K2 if coupled else np.diag(K2.diagonal())
    text = cards("calculix", GROUND, matrix, nodes={"1": 101, "1:r": 102})
    dofs = [("101", 2), ("102", 3)]
    steps = solve_calculix(tmp_path, text, (1,), dofs, forces(dofs))
    compliance = np.array([[step[dof] for step in steps] for dof in dofs]) / 1e-3
    require_inverse(compliance, matrix)
    if coupled:
        with pytest.raises(AssertionError):
            require_inverse(compliance, matrix * [[1, -1], [-1, 1]])


@needs_ccx
@pytest.mark.parametrize("name", ["springs between two nodes", "full matrix between two nodes", "springs with offsets"])
def test_calculix_deforms_two_nodes_by_their_compliance(tmp_path, name):
    joint, matrix, expected = JOINTS[name]
    nodes = {"3": 301, "3:r": 302, "7": 701, "7:r": 702}
    held = Joint(PAIR.dofs)  # to ground, by known springs, so that the rest has a compliance
    ground = np.diag([1e6, 2e6, 50.0])
    elements = [joint_element(joint, matrix, (), "SI", nodes), joint_element(held, ground, (), "SI", nodes)]
    text = fe_cards("calculix", elements, [], "SI", 9001)
    rows = [(node, dof) for node in (3, 7) for dof in (X, Y, RZ)]
    whole = np.array([[expected[a, b] for b in rows] for a in rows])
    whole[:3, :3] += ground
    dofs = [("301", 1), ("301", 2), ("302", 3), ("701", 1), ("701", 2), ("702", 3)]
    steps = solve_calculix(tmp_path, text, (3, 7), dofs, forces(dofs))
    require_inverse(np.array([[step[dof] for step in steps] for dof in dofs]) / 1e-3, whole)


def solid_bar(mm):
    """A steel bar of solid elements, 400 x 20 x 60 mm; one end is a rigid body: REF NODE 9001, ROT NODE 9002."""
    nx, ny, nz, unit = 40, 2, 3, 1e3 if mm else 1.0

    def node(i, j, k):
        return 1 + k + (nz + 1) * (j + (ny + 1) * i)

    cells = [(i, j, k) for i in range(nx + 1) for j in range(ny + 1) for k in range(nz + 1)]
    places = unit * np.array([(0.4 * i / nx, 0.02 * (j / ny - 0.5), 0.06 * (k / nz - 0.5)) for i, j, k in cells])
    lines = [
        "*NODE",
        *(f"{node(*cell)}, {x:.9g}, {y:.9g}, {z:.9g}" for cell, (x, y, z) in zip(cells, places, strict=True)),
    ]
    lines += ["9001, 0., 0., 0.", "9002, 0., 0., 0.", "*ELEMENT, TYPE=C3D8I, ELSET=BAR"]
    inner = [cell for cell in cells if cell[0] < nx and cell[1] < ny and cell[2] < nz]
    for number, (i, j, k) in enumerate(inner, 1):
        side = [node(i, j, k), node(i + 1, j, k), node(i + 1, j + 1, k), node(i, j + 1, k)]
        lines.append(", ".join(map(str, (number, *side, *(n + 1 for n in side)))))
    lines += ["*NSET, NSET=FACE", *(f"{node(*cell)}," for cell in cells if cell[0] == 0)]
    lines += ["*RIGID BODY, NSET=FACE, REF NODE=9001, ROT NODE=9002", "*MATERIAL, NAME=STEEL", "*ELASTIC"]
    lines += [f"{2.1e11 / unit**2}, 0.3", "*DENSITY", f"{7.8e-9 if mm else 7800.0}"]
    return [*lines, "*SOLID SECTION, ELSET=BAR, MATERIAL=STEEL"]


@needs_ccx
@pytest.mark.parametrize("units", ["SI", "mm-N-t"])
@pytest.mark.parametrize("k12", [3e4, -3e4])
def test_a_bar_of_solid_elements_on_the_exported_joint_has_the_model_s_frequency(tmp_path, units, k12):
    """Sign and units of the whole way: the other sign of k12 moves the first natural frequency by a fifth."""
    joint, matrix = Joint(("1:y", "1:rz")), np.array([[1e6, k12], [k12, 1e4]])
    model = beam(0.4, Section.rectangle(0.06, 0.02), STEEL, ModalDamping((0.01,)), elements=10)
    first, second = NaturalFrequencies(model, joint, 2).frequency_hz(matrix)[0]
    element = joint_element(joint, matrix, (), units, {"1": 9001, "1:r": 9002})
    lines = [*solid_bar(units != "SI"), fe_cards("calculix", [element], [], units, 9101).rstrip()]
    lines += ["*BOUNDARY", "9001, 1", "9001, 3", "9002, 1, 2", "*STEP", "*FREQUENCY", "2", "*END STEP"]
    (tmp_path / "t.inp").write_text("\n".join(lines) + "\n")
    subprocess.run(["ccx", "t"], cwd=tmp_path, capture_output=True, timeout=60, check=False)
    rows = [line.split() for line in (tmp_path / "t.dat").read_text().splitlines()]
    found = [float(row[3]) for row in rows if len(row) == 5 and row[0].isdigit()]
    np.testing.assert_allclose(found[:2], [first, second], rtol=2e-3)


# ---- what stands above, and what is refused


def test_comments_are_ascii_and_short():
    element = joint_element(GROUND, K2, (), "SI", {})
    for program, (sign, _) in PROGRAMS.items():
        if program == "calculix":
            continue
        text = fe_cards(program, [element], ["k22 … ρ² − é\nCBUSH, 1" + "x" * 90], "mm-N-t", 7)
        above = text[: text.index("\n", text.index("xxx"))].splitlines()
        assert text.isascii()
        assert all(line.startswith(sign) and len(line) <= 80 for line in above)
        assert "mm, N, t, s" in text
        assert "k12 > 0" in text


def test_a_rigid_direction_is_left_out():
    element = joint_element(GROUND, np.diag([1e30, 40.0]), (0,), "SI", {})
    assert np.array_equal(element.stiffness, [[0, 0], [0, 40.0]])
    assert element.springs == ((40.0, ((1, RZ),)),)
