"""Frames by another route than the package's: exact transfer matrices without a mesh.

They know nothing of `jointbayes`, and take sections as functions of the place along a member.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import integrate, linalg


@dataclass
class Rod:
    """Member between two nodes, its ends shifted by offsets, its height along `height`.

    `constants` at x in [0, 1] gives EA, GJ, EIy, EIz, kyGA, kzGA, rhoA, rhoIy, rhoIz.
    """

    nodes: tuple[int, int]
    ends: tuple[np.ndarray, np.ndarray]
    height: np.ndarray
    constants: Callable[[float], tuple[float, ...]]
    offsets: tuple[np.ndarray, np.ndarray] = (np.zeros(3), np.zeros(3))

    @property
    def start(self) -> np.ndarray:
        return np.asarray(self.ends[0]) + self.offsets[0]

    @property
    def vector(self) -> np.ndarray:
        return np.asarray(self.ends[1]) + self.offsets[1] - self.start

    @property
    def length(self) -> float:
        return float(np.sqrt(self.vector @ self.vector))

    def cosines(self) -> np.ndarray:
        """Direction cosines by Gram-Schmidt with a QR factorisation, signs set by hand."""
        e1 = self.vector / self.length
        q, _ = np.linalg.qr(np.column_stack([e1, self.height]))
        e2 = q[:, 1] * np.sign(q[:, 1] @ self.height)
        e3 = np.array([e1[1] * e2[2] - e1[2] * e2[1], e1[2] * e2[0] - e1[0] * e2[2], e1[0] * e2[1] - e1[1] * e2[0]])
        return np.vstack([e1, e2, e3])


def lever(offset: np.ndarray) -> np.ndarray:
    """Rows: translation at the end of a rigid arm by the six motions at its foot."""
    out, (dx, dy, dz) = np.eye(6), offset
    out[:3, 3:] = [[0, dz, -dy], [-dz, 0, dx], [dy, -dx, 0]]  # u = ... + ry dz - rz dy
    return out


# transfer matrices: the state (motions, forces) along a member obeys y' = A(x, w) y


def _state_matrix(constants: tuple[float, ...], omega: float) -> np.ndarray:
    ea, gj, eiy, eiz, kya, kza, ra, riy, riz = constants
    a = np.zeros((12, 12))
    u, v, w, tx, ty, tz = range(6)
    n, qy, qz, mx, my, mz = range(6, 12)
    a[u, n], a[tx, mx], a[ty, my], a[tz, mz] = 1 / ea, 1 / gj, 1 / eiy, 1 / eiz
    a[v, qy], a[v, tz] = 1 / kya, 1.0
    a[w, qz], a[w, ty] = 1 / kza, -1.0
    s = -(omega**2)
    a[n, u], a[qy, v], a[qz, w], a[mx, tx] = s * ra, s * ra, s * ra, s * (riy + riz)
    a[mz, tz], a[mz, qy] = s * riz, -1.0
    a[my, ty], a[my, qz] = s * riy, 1.0
    return a


def dynamic_stiffness(nodes: int, rods: list[Rod], omega: float, uniform: bool = True) -> np.ndarray:
    """Exact dynamic stiffness (6 nodes, 6 nodes) of members between nodes at one angular frequency."""
    z = np.zeros((6 * nodes, 6 * nodes))
    for rod in rods:
        scale = np.concatenate([[1.0] * 6, [1e-6] * 6])  # forces in MN, so that numbers are alike

        def slope(x: float, y: np.ndarray, rod: Rod = rod, scale: np.ndarray = scale) -> np.ndarray:
            a = _state_matrix(rod.constants(x / rod.length), omega)
            return (scale[:, None] * a / scale @ y.reshape(12, -1)).ravel()

        if uniform:
            a = scale[:, None] * _state_matrix(rod.constants(0.0), omega) / scale
            transfer = linalg.expm(a * rod.length)
        else:
            solved = integrate.solve_ivp(
                slope, (0.0, rod.length), np.eye(12).ravel(), method="DOP853", rtol=1e-13, atol=1e-14
            )
            transfer = solved.y[:, -1].reshape(12, 12)
        uu, uf, fu, ff = transfer[:6, :6], transfer[:6, 6:], transfer[6:, :6], transfer[6:, 6:]
        first = np.hstack([-np.linalg.solve(uf, uu), np.linalg.solve(uf, np.eye(6))])  # forces at the start
        last = np.hstack([fu, np.zeros((6, 6))]) + ff @ first
        local = np.vstack([-first, last]) * 1e6
        turn = np.kron(np.eye(2), rod.cosines())
        ends = linalg.block_diag(turn @ lever(rod.offsets[0]), turn @ lever(rod.offsets[1]))
        rows = np.concatenate([np.arange(6 * n, 6 * n + 6) for n in rod.nodes])
        z[np.ix_(rows, rows)] += ends.T @ local @ ends
    return z
