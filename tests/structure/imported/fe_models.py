"""Small finite-element models of their own: bricks of eight nodes, assembled here and by nothing of the package."""

import itertools

import numpy as np
from scipy import sparse

from jointbayes.structure import FeModel, FePart

E, NU, RHO = 2.1e11, 0.3, 7800.0
_CORNERS = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]
)


def brick_matrices(sizes, modulus=E, density=RHO):
    """K and M, shape (24, 24), of a brick with these edges, by 2 × 2 × 2 Gauss points."""
    lame, shear = modulus * NU / ((1 + NU) * (1 - 2 * NU)), modulus / (2 * (1 + NU))
    elastic = np.zeros((6, 6))
    elastic[:3, :3] = lame + 2 * shear * np.eye(3)
    elastic[3:, 3:] = shear * np.eye(3)
    half, stiffness, mass = np.array(sizes) / 2, np.zeros((24, 24)), np.zeros((24, 24))
    for point in itertools.product((-1 / np.sqrt(3), 1 / np.sqrt(3)), repeat=3):
        shape = np.prod(1 + _CORNERS * point, axis=1) / 8
        slope = np.stack([
            _CORNERS[:, d] * np.prod(np.delete(1 + _CORNERS * point, d, axis=1), axis=1) / 8 / half[d] for d in range(3)
        ])  # fmt: skip
        strain, motion = np.zeros((6, 24)), np.zeros((3, 24))
        for d in range(3):
            strain[d, d::3], motion[d, d::3] = slope[d], shape
        for row, (a, b) in enumerate(((0, 1), (1, 2), (2, 0)), 3):
            strain[row, a::3], strain[row, b::3] = slope[b], slope[a]
        stiffness += strain.T @ elastic @ strain * half.prod()
        mass += density * motion.T @ motion * half.prod()
    return stiffness, mass


def brick_model(counts=(10, 2, 2), sizes=(0.2, 0.02, 0.03), part_from=None):
    """A bar of bricks along x; the elements from `part_from` on are the part "end"."""
    edges = [size / count for size, count in zip(sizes, counts, strict=True)]
    grid = list(itertools.product(*(range(count + 1) for count in counts)))
    number = {place: i for i, place in enumerate(grid)}
    stiffness, mass = brick_matrices(edges)
    rows, columns, k, m, of_part = [], [], [], [], []
    for cell in itertools.product(*map(range, counts)):
        nodes = [number[tuple(np.array(cell) + (corner > 0))] for corner in _CORNERS]
        dofs = np.repeat(np.array(nodes) * 3, 3) + np.tile(range(3), 8)
        rows.append(np.repeat(dofs, 24))
        columns.append(np.tile(dofs, 24))
        k.append(stiffness.ravel())
        m.append(mass.ravel())
        of_part.append(np.full(576, part_from is not None and cell[0] >= part_from))
    n, at = 3 * len(grid), (np.concatenate(rows), np.concatenate(columns))
    whole = [sparse.csc_array((np.concatenate(values), at), shape=(n, n)) for values in (k, m)]
    parts = {}
    if part_from is not None:
        chosen = np.concatenate(of_part)
        inside = at[0][chosen], at[1][chosen]
        own = [sparse.csc_array((np.concatenate(v)[chosen], inside), shape=(n, n)) for v in (k, m)]
        parts["end"] = FePart(*own)
    nodes = np.arange(1, len(grid) + 1)
    places = np.array(grid) * edges
    dofs = np.stack([np.repeat(nodes, 3), np.tile([1, 2, 3], len(grid))], axis=1)
    return FeModel(*whole, dofs, nodes, places, parts=parts, source="bar of bricks")


def face(model, x):
    """Numbers of the nodes at one x."""
    return tuple(int(node) for node in model.nodes[np.isclose(model.places[:, 0], x)])


def plane_beam(elements=50, length=0.383, height=0.025, width=0.04):
    """A slender Bernoulli beam, two DOFs a node, as a model."""
    edge, area, second = length / elements, width * height, width * height**3 / 12
    k = E * second / edge**3 * np.array([
        [12, 6 * edge, -12, 6 * edge], [6 * edge, 4 * edge**2, -6 * edge, 2 * edge**2],
        [-12, -6 * edge, 12, -6 * edge], [6 * edge, 2 * edge**2, -6 * edge, 4 * edge**2]])  # fmt: skip
    m = RHO * area * edge / 420 * np.array([
        [156, 22 * edge, 54, -13 * edge], [22 * edge, 4 * edge**2, 13 * edge, -3 * edge**2],
        [54, 13 * edge, 156, -22 * edge], [-13 * edge, -3 * edge**2, -22 * edge, 4 * edge**2]])  # fmt: skip
    stiffness, mass = np.zeros((2, 2 * elements + 2, 2 * elements + 2))
    for e in range(elements):
        stiffness[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += k
        mass[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += m
    nodes = np.arange(1, elements + 2)
    dofs = np.stack([np.repeat(nodes, 2), np.tile([2, 6], elements + 1)], axis=1)
    places = np.stack([(nodes - 1) * edge, 0 * nodes, 0 * nodes], axis=1)
    return FeModel(stiffness, mass, dofs, nodes, places, source="plane beam")
