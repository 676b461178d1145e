"""Matrices that CalculiX itself writes, against its own frequencies and against the matrices of scikit-fem."""

import shutil
import subprocess

import numpy as np
import pytest
from scipy import io, sparse

import jointbayes as jb
from tests.structure.imported.small_frame import frequencies

pytestmark = [
    pytest.mark.skipif(
        shutil.which("ccx") is None,
        reason="CalculiX (ccx, package calculix-ccx) is not installed: nobody independent writes .sti, .mas and .dof",
    ),
    pytest.mark.version,
]
#: Cells of a steel block, 100 × 30 × 20 mm in m.
CELLS, SIZE = (5, 2, 2), np.array([0.1, 0.03, 0.02])
MODULUS, POISSON, DENSITY = 2.1e11, 0.3, 7800.0
HEAD = "*MATERIAL, NAME=STEEL\n*ELASTIC\n{0}, 0.3\n*DENSITY\n{1}\n*SOLID SECTION, ELSET=E, MATERIAL=STEEL\n"


def mesh():
    """Places of the nodes, and the eight nodes of each element, counted from 0."""
    grid = np.stack(np.meshgrid(*(np.arange(n + 1) for n in CELLS), indexing="ij"), axis=-1).reshape(-1, 3)
    number = {tuple(cell): i for i, cell in enumerate(grid.tolist())}
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    first = [cell for cell in grid.tolist() if (np.array(cell) < CELLS).all()]
    cells = [[number[tuple(np.add(cell, corner).tolist())] for corner in corners] for cell in first]
    return grid / CELLS * SIZE, np.array(cells)


def run_calculix(directory, name, step, mm=False, supports=""):
    """Run one step of frequencies of the block."""
    places, cells = mesh()
    unit = 1e3 if mm else 1.0
    lines = [
        "*NODE, NSET=ALL",
        *(f"{i}, {x!r}, {y!r}, {z!r}" for i, (x, y, z) in enumerate((unit * places).tolist(), 1)),
    ]
    lines += ["*ELEMENT, TYPE=C3D8, ELSET=E"]
    lines += [", ".join(map(str, (i, *(cell + 1).tolist()))) for i, cell in enumerate(cells, 1)]
    lines += [HEAD.format(MODULUS / unit**2, 7.8e-9 if mm else DENSITY).rstrip(), *supports.split("\n")]
    lines += ["*STEP", step, "12", "*END STEP"]
    (directory / f"{name}.inp").write_text("\n".join(line for line in lines if line) + "\n")
    subprocess.run(["ccx", name], cwd=directory, capture_output=True, timeout=60, check=False)
    return directory / f"{name}.sti"


@pytest.mark.parametrize("mm", [False, True])
def test_frequencies_are_those_that_calculix_finds(tmp_path, mm):
    """CalculiX prints 8 digits; supports are not in its matrices."""
    held = "*BOUNDARY\n" + "\n".join(f"{i + 1}, 1, 3" for i, place in enumerate(mesh()[0]) if place[0] == 0)
    path = run_calculix(tmp_path, "t", "*FREQUENCY, SOLVER=MATRIXSTORAGE", mm, held)
    model = jb.read_structure(path, length_unit="mm" if mm else "m")
    run_calculix(tmp_path, "f", "*FREQUENCY", mm, held)
    rows = [line.split() for line in (tmp_path / "f.dat").read_text().splitlines()]
    printed = [float(row[3]) for row in rows if len(row) == 5 and row[0].isdigit()]
    assert len(printed) == 12
    np.testing.assert_allclose(frequencies(model)[:12], printed, rtol=2e-6)
    assert model.row(1, "x") is None
    np.testing.assert_allclose(model.place(len(mesh()[0])), SIZE, rtol=1e-12)


def test_the_free_block_has_its_mass_and_its_surface(tmp_path):
    model = jb.read_structure(run_calculix(tmp_path, "t", "*FREQUENCY, SOLVER=MATRIXSTORAGE"), length_unit="m")
    assert [model.mass_along(way) for way in "xyz"] == pytest.approx([DENSITY * SIZE.prod()] * 3, rel=1e-9)
    assert (frequencies(model)[:6] < 1).all()
    a, b, c = CELLS
    faces = 2 * (a * b + b * c + c * a)
    assert len(model.edges) == 2 * faces  # of a closed surface of quadrilaterals
    assert model.notes == ()


def test_calculix_and_scikit_fem_give_one_stiffness_and_mass(tmp_path):
    """Eight-node bricks of two programs, also when the matrices of the second went through other formats."""
    skfem = pytest.importorskip("skfem", reason="scikit-fem, the independent finite elements, is not installed")
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    model = jb.read_structure(run_calculix(tmp_path, "t", "*FREQUENCY, SOLVER=MATRIXSTORAGE"), length_unit="m")
    places, _ = mesh()
    block = skfem.MeshHex.init_tensor(*(np.linspace(0, s, n + 1) for s, n in zip(SIZE, CELLS, strict=True)))
    basis = skfem.Basis(block, skfem.ElementVector(skfem.ElementHex1()), intorder=2)
    k = linear_elasticity(*lame_parameters(MODULUS, POISSON)).assemble(basis)

    @skfem.BilinearForm
    def inertia(u, v, _w):
        return DENSITY * skfem.helpers.dot(u, v)

    m = inertia.assemble(skfem.Basis(block, skfem.ElementVector(skfem.ElementHex1()), intorder=4))
    number = {tuple(np.rint(place * 1e9).astype(int).tolist()): i + 1 for i, place in enumerate(places)}
    dofs = np.empty((basis.N, 2), dtype=int)
    for vertex, place in enumerate(block.p.T):
        rows = basis.nodal_dofs[:, vertex]
        dofs[rows] = [(number[tuple(np.rint(place * 1e9).astype(int).tolist())], way) for way in (1, 2, 3)]
    np.savez(tmp_path / "a.npz", K=k.toarray(), M=m.toarray(), dofs=dofs)
    io.savemat(tmp_path / "a.mat", {"K": sparse.triu(k).tocsc(), "M": m.tocsc(), "dofs": dofs})
    for name in ("a.npz", "a.mat"):
        other = jb.read_structure(tmp_path / name, length_unit="m")
        rows = [model.row(int(node), "xyz"[way - 1]) for node, way in dofs]
        for first, second in ((model.stiffness, other.stiffness), (model.mass, other.mass)):
            gap = abs(first.toarray()[np.ix_(rows, rows)] - second.toarray()).max() / abs(second).max()
            assert gap < 1e-12
        np.testing.assert_allclose(frequencies(other)[6:], frequencies(model)[6:], rtol=1e-10)
