"""Coordinates, DOFs and mass that are not those of the stiffness matrix are refused; supports, all of them, are not."""

import numpy as np
import pytest
from benchmarks.bricks import brick_model, face
from scipy import linalg

import jointbayes as jb

BAR = brick_model((8, 2, 2))
K, M, DOFS, NODES, PLACES = BAR.stiffness.toarray(), BAR.mass.toarray(), BAR.dofs, BAR.nodes, BAR.places
FACE = np.isin(DOFS[:, 0], face(BAR, 0.0))
TURN = np.array([[np.cos(0.5), -np.sin(0.5), 0], [np.sin(0.5), np.cos(0.5), 0], [0, 0, 1]])


def read(folder, k=K, m=M, dofs=DOFS, xyz=PLACES, nodes=NODES):
    arrays = {"K": k, "M": m, "dofs": dofs} | ({} if xyz is None else {"nodes": nodes, "xyz": xyz})
    np.savez(folder / "a.npz", **arrays)
    return jb.read_structure(folder / "a.npz", length_unit="m")


def turned(nodes, k=K, m=M, turn=TURN):
    """K and M with the DOFs of some nodes in a system of their own."""
    whole = np.eye(len(k))
    for node in nodes:
        rows = np.flatnonzero(DOFS[:, 0] == node)
        whole[np.ix_(rows, rows)] = turn
    return whole.T @ k @ whole, whole.T @ m @ whole


def held(rows, **more):
    """The bar without the DOFs of some rows."""
    kept = np.flatnonzero(~rows)
    pairs = np.ix_(kept, kept)
    k, m = more.pop("k", K), more.pop("m", M)
    return {"k": k[pairs], "m": m[pairs], "dofs": DOFS[kept]} | more


def ground(rows, stiffness):
    return {"k": K + np.diag(np.where(rows, stiffness, 0.0))}


EDGES = (np.abs(PLACES - PLACES.mean(axis=0))[:, 0] > 0.0999) | (np.abs(PLACES - PLACES.mean(axis=0))[:, 1] > 0.0099)
ALL = np.ones(len(DOFS), dtype=bool)
MOVED = np.where(PLACES[:, [0]] > 0.1001, PLACES + np.array([0.0, 0.02, 0.0]), PLACES)
SHIFTED = np.roll(PLACES, 1, axis=0)
SHUFFLED = np.random.default_rng(1).permutation(len(DOFS))
SWAPPED = DOFS[:, 1] % 3 + 1

RIGHT = {
    "free": {},
    "free, no coordinates": {"xyz": None},
    "coordinates of six digits": {"xyz": PLACES * (1 + 1e-6 * np.random.default_rng(1).standard_normal(PLACES.shape))},
    "a support next to a generalised coordinate": {
        "k": 1e6 * np.array([[2.0, -1, 0], [-1, 2, -1], [0, -1, 1]]),
        "m": np.eye(3),
        "dofs": np.array([[1, 1], [2, 1], [900, 0]]),
        "xyz": None,
    },
    "clamped at a face": held(FACE),
    "clamped at one node": held(DOFS[:, 0] == 40),
    "rollers": held(FACE & (DOFS[:, 1] == 1)),
    "clamped all around": held(np.repeat(EDGES, 3)),
    "clamped all around, no coordinates": held(np.repeat(EDGES, 3), xyz=None),
    **{f"a face on springs of {k:g} N/m": ground(FACE, k) for k in (1.0, 1e3, 1e6, 1e9, 1e14, 1e20)},
    **{f"all nodes on springs of {k:g} N/m": ground(ALL, k) for k in (1.0, 1e3, 1e5, 1e7, 1e9)},
    **{f"rollers of {k:g} N/m": ground(ALL & (DOFS[:, 1] == 2), k) for k in (1e3, 1e5, 1e7)},
}


@pytest.mark.parametrize("right", RIGHT)
def test_a_right_model_is_read_however_it_is_held(tmp_path, right):
    read(tmp_path, **RIGHT[right])


@pytest.mark.parametrize("interior", ["free", "fixed"])
def test_superelements_are_read(tmp_path, interior):
    """Static condensation to the end faces, alone and with modes of the fixed interior as generalised coordinates."""
    ends = FACE | np.isin(DOFS[:, 0], face(BAR, 0.2))
    b, i = np.flatnonzero(ends), np.flatnonzero(~ends)
    static = np.zeros((len(K), b.size))
    static[b], static[i] = np.eye(b.size), -np.linalg.solve(K[np.ix_(i, i)], K[np.ix_(i, b)])
    dofs, base = DOFS[b], static
    if interior == "fixed":
        modes = np.zeros((len(K), 5))
        modes[i] = linalg.eigh(K[np.ix_(i, i)], M[np.ix_(i, i)], subset_by_index=[0, 4])[1]
        dofs, base = np.vstack([dofs, [(900 + n, 0) for n in range(5)]]), np.hstack([static, modes])
    k, m = (base.T @ a @ base for a in (K, M))
    model = read(tmp_path, (k + k.T) / 2, (m + m.T) / 2, dofs)
    assert model.whole_mass == pytest.approx(0.936)


def test_a_rotor_that_turns_freely_in_a_held_base_is_read(tmp_path):
    """Springs along x, y and z hold the axis of one bar to another that is clamped: K still lets the first turn."""
    k = linalg.block_diag(K, K)
    middle = np.flatnonzero(np.isclose(PLACES[:, 1:], [0.01, 0.015]).all(axis=1))
    for node in (middle[1], middle[-2]):
        for way in range(3):
            at = 3 * node + way, len(K) + 3 * node + way
            k[np.ix_(at, at)] += 1e8 * np.array([[1, -1], [-1, 1]])
    dofs = np.vstack([DOFS, DOFS + np.array([1000, 0])])
    kept = np.flatnonzero(~np.concatenate([FACE, 0 * FACE]).astype(bool))
    pairs = np.ix_(kept, kept)
    m = linalg.block_diag(M, M)
    xyz = np.vstack([PLACES, PLACES])
    model = read(tmp_path, k[pairs], m[pairs], dofs[kept], xyz, np.concatenate([NODES, NODES + 1000]))
    assert model.notes[-1].startswith("K holds 9 of 153 nodes to ground")
