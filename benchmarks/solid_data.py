"""The imported bar of `configs/clamped_solid.toml` and its FRFs: `python -m benchmarks.solid_data` writes both.

Scikit-fem makes its matrices. The FRFs are solves of these line by line, the clamped face rigid on six springs: nothing
of the package is in them, above all not its reduction.
"""

from pathlib import Path
from typing import Any

import numpy as np
import skfem
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu
from skfem.models.elasticity import lame_parameters, linear_elasticity

from vibrecords import FrfSet
from vibrecords.formats import write_frf

Array = NDArray[np.float64]
CONFIGS = Path(__file__).resolve().parents[1] / "configs"
MODEL, FRFS = CONFIGS / "data" / "solid_bar.npz", CONFIGS / "data" / "solid_tip.uff"

SIZE, MODULUS, DENSITY, LOSS_FACTOR, NOISE = (0.2, 0.03, 0.02), 2.1e11, 7800.0, 0.01, 0.02
#: kx, ky, kz, N/m, and krx, kry, krz, N·m/rad, of the face at x = 0.
SPRINGS = np.array([2.0e8, 1.5e8, 1.0e8, 4.0e4, 5.0e4, 8.0e4])
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


def frfs(every: int = 1) -> FrfSet:
    """FRFs of the bar, or so many of their lines, with noise; the forces are along x and z at a corner."""
    k, m, places = matrices()
    face, corner = np.flatnonzero(places[:, 0] < 1e-9), int(np.abs(places - SIZE).sum(axis=1).argmin())
    free = np.setdiff1d(np.arange(len(places)), face)
    # u = T v: nodes of the face by the six motions of its middle, all others by themselves
    turn = sparse.lil_array((3 * len(places), 3 * len(free) + 6))
    turn[(3 * free[:, None] + np.arange(3)).ravel(), np.arange(3 * len(free))] = 1.0
    for node, (x, y, z) in zip(face, places[face] - places[face].mean(axis=0), strict=True):
        turn[3 * node : 3 * node + 3, -6:-3] = np.eye(3)
        turn[3 * node : 3 * node + 3, -3:] = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
    turn = turn.tocsc()
    springs = sparse.diags_array(np.concatenate([np.zeros(3 * len(free)), SPRINGS]))
    stiffness, mass = turn.T @ k @ turn * (1 + 1j * LOSS_FACTOR) + springs, turn.T @ m @ turn
    seen = turn[3 * corner : 3 * corner + 3].toarray().T
    values = [
        seen.T @ splu((stiffness - w * w * mass).tocsc()).solve(seen[:, ::2] + 0j) for w in 2 * np.pi * LINES[::every]
    ]
    white = np.random.default_rng(5).standard_normal((len(LINES), 3, 2, 2)) @ [1, 1j]  # as `relative` of a case
    labels = ("1:x", "1:y", "1:z")
    return FrfSet(LINES[::every], np.array(values) * (1 + NOISE * white[::every]), labels, labels[::2])


if __name__ == "__main__":
    write_model(MODEL)
    write_frf(frfs(), FRFS, "uff58b")
    print(f"{MODEL.name}: {MODEL.stat().st_size} bytes, {FRFS.name}: {FRFS.stat().st_size} bytes")
