"""The imported bar of `configs/` and FRFs of it, clamped and with a tool: `python -m benchmarks.solid_data` writes all.

Scikit-fem makes its matrices. The FRFs are solves of these line by line, a face rigid on springs, and of a tool the
formulas of an exact beam: nothing of the package is in them, above all not its reduction.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu
from skfem.models.elasticity import lame_parameters, linear_elasticity

from benchmarks.exact_beam import ExactBeam, circle
from benchmarks.written_files import write_frf
from vibrecords import FrfSet

Array, Complex = NDArray[np.float64], NDArray[np.complex128]
CONFIGS = Path(__file__).resolve().parents[1] / "configs"
MODEL = CONFIGS / "data" / "solid_bar.npz"

SIZE, MODULUS, DENSITY, LOSS_FACTOR, NOISE = (0.2, 0.03, 0.02), 2.1e11, 7800.0, 0.01, 0.02
#: kx, ky, kz, N/m, and krx, kry, krz, N·m/rad, of the face at x = 0.
SPRINGS = np.array([2.0e8, 1.5e8, 1.0e8, 4.0e4, 5.0e4, 8.0e4])
#: ky, N/m, and krz, N·m/rad, between the face at x = 0.2 m and a tool of this length in m.
TAPER, TOOL_LENGTH = np.array([1.5e8, 6.0e4]), 0.09
#: Labels in the files, by how many there are.
LABELS = {3: ("1:x", "1:y", "1:z"), 2: ("1:y", "2:y")}
LINES = np.arange(50.0, 2600.1, 4.0)


def matrices() -> tuple[Any, Any, Array]:
    """K and M of a bar without damping, DOFs x, y, z at each node in turn, and the nodes' places, shape (k, 3), m."""
    mesh = skfem.MeshHex.init_tensor(*map(np.linspace, (0.0, 0.0, 0.0), SIZE, (13, 3, 3)))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHexS2()), intorder=5)
    inertia = skfem.BilinearForm(lambda u, v, _: DENSITY * skfem.helpers.dot(u, v))
    stiffness = linear_elasticity(*lame_parameters(MODULUS, 0.3)).assemble(basis)
    return stiffness, inertia.assemble(basis), basis.doflocs[:, ::3].T


def write_model(path: Path) -> None:
    """The bar that is imported, one triangle of each matrix; ten digits, so that equal elements pack well."""
    k, m, places = matrices()
    numbers = np.arange(1, len(places) + 1)
    parts: dict[str, Any] = {}
    for name, matrix in (("K", k), ("M", m)):
        triangle = sparse.triu(matrix).tocsc()
        size = 10.0 ** np.floor(np.log10(np.abs(triangle.data).max()) - 11)
        triangle.data = np.round(triangle.data / size) * size
        parts |= {f"{name}_data": triangle.data, f"{name}_indices": triangle.indices, f"{name}_indptr": triangle.indptr}
    dofs = np.stack([np.repeat(numbers, 3), np.tile([1, 2, 3], len(numbers))], axis=1)
    np.savez_compressed(path, dofs=dofs.astype(np.int32), nodes=numbers, xyz=places.round(12), **parts)


def rigid_face(x: float) -> tuple[Any, Any, Any]:
    """K and M with the face at x as a rigid body, and T: u = T v, whose last six columns are motions of its middle."""
    k, m, places = matrices()
    face = np.flatnonzero(np.isclose(places[:, 0], x))
    free = np.setdiff1d(np.arange(len(places)), face)
    turn = sparse.lil_array((3 * len(places), 3 * len(free) + 6))
    turn[(3 * free[:, None] + np.arange(3)).ravel(), np.arange(3 * len(free))] = 1.0
    for node, (x, y, z) in zip(face, places[face] - places[face].mean(axis=0), strict=True):
        turn[3 * node : 3 * node + 3, -6:-3] = np.eye(3)
        turn[3 * node : 3 * node + 3, -3:] = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
    turn = turn.tocsc()
    return turn.T @ k @ turn * (1 + 1j * LOSS_FACTOR), turn.T @ m @ turn, turn


def solved(stiffness: Any, mass: Any, seen: Array, lines: Array) -> Complex:
    """Receptances between forms (n, f) on the DOFs, each line solved, shape (lines, f, f)."""
    return np.array([seen.T @ splu((stiffness - w * w * mass).tocsc()).solve(seen + 0j) for w in 2 * np.pi * lines])


def measured(values: Complex, seed: int, every: int, outputs: int, inputs: Sequence[int]) -> FrfSet:
    """FRFs from some of the first `outputs` DOFs with noise of `NOISE` of each value, as `relative` of a case."""
    white = np.random.default_rng(seed).standard_normal((len(LINES), outputs, len(inputs), 2)) @ [1, 1j]
    labels = LABELS[outputs]
    noisy = values[:, :outputs][:, :, inputs] * (1 + NOISE * white[::every])
    return FrfSet(LINES[::every], noisy, labels, tuple(labels[i] for i in inputs))


def clamped(every: int = 1) -> FrfSet:
    """FRFs at a corner of the bar whose face at x = 0 is on springs, or so many of their lines."""
    stiffness, mass, turn = rigid_face(0.0)
    (corner,) = np.flatnonzero(np.isclose(matrices()[2], SIZE).all(axis=1))
    springs = np.concatenate([np.zeros(turn.shape[1] - 6), SPRINGS])
    seen = turn[3 * corner : 3 * corner + 3].toarray().T
    values = solved(stiffness + sparse.diags_array(springs), mass, seen, LINES[::every])
    return measured(values, 5, every, 3, (0, 2))


def with_tool(every: int = 1) -> FrfSet:
    """FRFs of the bar as a holder with a tool at its face x = 0.2 m, at the tool's tip and the holder's back."""
    stiffness, mass, turn = rigid_face(SIZE[0])
    (back,) = np.flatnonzero(np.isclose(matrices()[2], (0.0, SIZE[1] / 2, SIZE[2] / 2)).all(axis=1))
    seen = np.stack([*np.eye(turn.shape[1])[[-5, -1]], turn[3 * back + 1].toarray().ravel()], axis=1)
    lines = LINES[::every]
    tool = ExactBeam(TOOL_LENGTH, circle(0.014, 0.3), 5.8e11, 0.3, 14400.0, {1: 0.0, 2: TOOL_LENGTH}, (0.0, 0.0, 0.0))
    ends = ("2:y", "1:y", "1:rz")
    apart = np.zeros((len(lines), 6, 6), dtype=complex)  # tip, shank (2), seat (2), back
    apart[:, :3, :3] = tool.receptance(lines, ends, ends, loss_factor=LOSS_FACTOR)
    apart[:, 3:, 3:] = solved(stiffness, mass, seen, lines)
    stroke = np.zeros((2, 6))
    stroke[[0, 1], [1, 2]], stroke[[0, 1], [3, 4]] = 1.0, -1.0
    yielding = np.diag(1 / TAPER) + stroke @ apart @ stroke.T
    joined = apart - apart @ stroke.T @ np.linalg.solve(yielding, stroke @ apart)
    return measured(joined[:, [0, 5]][:, :, [0, 5]], 5, every, 2, (0,))


MADE = {"solid_tip.uff": clamped, "solid_tool.uff": with_tool}

if __name__ == "__main__":
    write_model(MODEL)
    for name, make in MADE.items():
        write_frf(make(), CONFIGS / "data" / name, "uff58b")
