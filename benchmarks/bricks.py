"""Solids of bricks of eight nodes, assembled here and by nothing of the package: models to import, of any size."""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from jointbayes.structure import FeModel, FePart

Array = NDArray[np.float64]
MODULUS, POISSON, DENSITY = 2.1e11, 0.3, 7800.0
_CORNERS = np.array([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])


def brick_matrices(edges: Sequence[float]) -> tuple[Array, Array]:
    """K and M, shape (24, 24), of a brick of steel with these edges in m, by 2 × 2 × 2 Gauss points."""
    lame, shear = MODULUS * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), MODULUS / (2 * (1 + POISSON))
    elastic = np.zeros((6, 6))
    elastic[:3, :3] = lame + 2 * shear * np.eye(3)
    elastic[3:, 3:] = shear * np.eye(3)
    half, signs = np.array(edges) / 2, 2 * _CORNERS - 1
    stiffness, mass = np.zeros((24, 24)), np.zeros((24, 24))
    for point in itertools.product((-1 / np.sqrt(3), 1 / np.sqrt(3)), repeat=3):
        factors = 1 + signs * point
        shape = factors.prod(axis=1) / 8
        slope = [signs[:, d] * np.delete(factors, d, axis=1).prod(axis=1) / 8 / half[d] for d in range(3)]
        strain, motion = np.zeros((6, 24)), np.zeros((3, 24))
        for d in range(3):
            strain[d, d::3], motion[d, d::3] = slope[d], shape
        for row, (a, b) in enumerate(((0, 1), (1, 2), (2, 0)), 3):
            strain[row, a::3], strain[row, b::3] = slope[b], slope[a]
        stiffness += strain.T @ elastic @ strain * half.prod()
        mass += DENSITY * motion.T @ motion * half.prod()
    return stiffness, mass


def brick_model(
    counts: Sequence[int] = (10, 2, 2),
    sizes: Sequence[float] = (0.2, 0.02, 0.03),
    part_from: int | None = None,
    *,
    bracket: bool = False,
) -> FeModel:
    """A block of bricks with edges along x, y, z in m; those from the `part_from`th along x on are the part "end".

    A bracket has only the bricks that are the first along x or z: an L.
    """
    edges = np.array(sizes) / counts
    grid = np.stack(np.meshgrid(*(np.arange(c + 1) for c in counts), indexing="ij"), axis=-1).reshape(-1, 3)
    stride = np.array([(counts[1] + 1) * (counts[2] + 1), counts[2] + 1, 1])
    cells = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3)
    cells = cells[(cells[:, [0, 2]] == 0).any(axis=1)] if bracket else cells
    nodes = ((cells[:, None] + _CORNERS) * stride).sum(axis=2)
    used, places = np.unique(nodes, return_inverse=True)
    grid, nodes = grid[used], places.reshape(nodes.shape)
    dofs = (3 * nodes[:, :, None] + np.arange(3)).reshape(len(cells), 24)
    own, n = brick_matrices(edges), 3 * len(grid)

    def assembled(of: Array, some: NDArray[np.intp]) -> sparse.csc_array:
        rows, columns = np.repeat(some, 24, axis=1).ravel(), np.tile(some, 24).ravel()
        return sparse.csc_array((np.tile(of.ravel(), len(some)), (rows, columns)), shape=(n, n))

    parts = {}
    if part_from is not None:
        parts["end"] = FePart(*(assembled(of, dofs[cells[:, 0] >= part_from]) for of in own))
    numbers = np.arange(1, len(grid) + 1)
    ways = np.stack([np.repeat(numbers, 3), np.tile([1, 2, 3], len(grid))], axis=1)
    stiffness, mass = (assembled(of, dofs) for of in own)
    return FeModel(stiffness, mass, ways, numbers, grid * edges, parts=parts, source="block of bricks")


def face(model: FeModel, x: float) -> tuple[int, ...]:
    """Numbers of the nodes at one x, m."""
    return tuple(int(node) for node in model.nodes[np.isclose(model.places[:, 0], x)])
