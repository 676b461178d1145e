"""Low-rank coupling of a joint of two DOFs at most: receptance = N/D, both linear in (1, k11, k12, k22, det K).

With A the receptance without the joint, D = det(1 + A_jj K) and N = D·H are sums of minors of A times minors of K
(Cauchy-Binet). No term cancels another as the joint becomes rigid or absent, and nothing is divided by but D.
"""

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.frf.kernels.compiled import LANES, compiled, inner, lane_blocks
from jointbayes.frf.kernels.secular import RIGID
from jointbayes.frf.ports import stiffness_batch
from vibrecords.arrays import Array, ComplexArray


@inner
def _parts(u1: float, u2: float, u3: float, u4: float, D: Array, E: Array, j: int) -> tuple[float, float, float, float]:
    """Real and imaginary part of D = d·u and of E = e·u at line j of a block."""
    dr = 1.0 + u1 * D[j] + u2 * D[2 * LANES + j] + u3 * D[4 * LANES + j] + u4 * D[6 * LANES + j]
    di = u1 * D[LANES + j] + u2 * D[3 * LANES + j] + u3 * D[5 * LANES + j] + u4 * D[7 * LANES + j]
    er = E[j] + u1 * E[2 * LANES + j] + u2 * E[4 * LANES + j] + u3 * E[6 * LANES + j]
    er += u4 * E[8 * LANES + j]
    ei = E[LANES + j] + u1 * E[3 * LANES + j] + u2 * E[5 * LANES + j] + u3 * E[7 * LANES + j]
    return dr, di, er, ei


@compiled
def _chi2(u: Array, d: Array, e: Array, chi2: Array) -> None:
    """χ² (n,) of joints u (n, 4) from D (blocks·8·LANES) and weighted residuals times D, e (pairs, blocks·9·LANES)."""
    chi2[:] = 0.0
    for b in range(d.size // (8 * LANES)):
        D = d[b * 8 * LANES : (b + 1) * 8 * LANES]
        for p in range(e.shape[0]):
            E = e[p, b * 9 * LANES : (b + 1) * 9 * LANES]
            for i in range(u.shape[0]):
                u1, u2, u3, u4 = u[i, 0], u[i, 1], u[i, 2], u[i, 3]
                total = 0.0
                for j in range(LANES):
                    dr, di, er, ei = _parts(u1, u2, u3, u4, D, E, j)
                    total += (er * er + ei * ei) / (dr * dr + di * di)
                chi2[i] += total


@compiled
def _chi2_slope(u: Array, d: Array, e: Array, chi2: Array, slope: Array) -> None:
    """χ² (n,) and its derivative (n, 4) by u; the arrays are those of `_chi2`.

    With E = e·u and D = d·u, ∂(|E|²/|D|²)/∂u_k = 2 Re(Ē e_k/|D|² − |E|² D̄ d_k/|D|⁴).
    """
    chi2[:] = 0.0
    slope[:] = 0.0
    q = np.empty(4 * LANES)
    for b in range(d.size // (8 * LANES)):
        D = d[b * 8 * LANES : (b + 1) * 8 * LANES]
        for p in range(e.shape[0]):
            E = e[p, b * 9 * LANES : (b + 1) * 9 * LANES]
            for i in range(u.shape[0]):
                u1, u2, u3, u4 = u[i, 0], u[i, 1], u[i, 2], u[i, 3]
                total = 0.0
                for j in range(LANES):
                    dr, di, er, ei = _parts(u1, u2, u3, u4, D, E, j)
                    w = 1.0 / (dr * dr + di * di)
                    x = (er * er + ei * ei) * w
                    total += x
                    x *= w
                    q[j], q[LANES + j], q[2 * LANES + j], q[3 * LANES + j] = er * w, ei * w, dr * x, di * x
                chi2[i] += total
                s1, s2, s3, s4 = 0.0, 0.0, 0.0, 0.0
                for j in range(LANES):
                    er, ei, dr, di = q[j], q[LANES + j], q[2 * LANES + j], q[3 * LANES + j]
                    s1 += er * E[2 * LANES + j] + ei * E[3 * LANES + j] - dr * D[j] - di * D[LANES + j]
                    s2 += er * E[4 * LANES + j] + ei * E[5 * LANES + j] - dr * D[2 * LANES + j] - di * D[3 * LANES + j]
                    s3 += er * E[6 * LANES + j] + ei * E[7 * LANES + j] - dr * D[4 * LANES + j] - di * D[5 * LANES + j]
                    s4 += er * E[8 * LANES + j] - dr * D[6 * LANES + j] - di * D[7 * LANES + j]
                slope[i, 0] += 2 * s1
                slope[i, 1] += 2 * s2
                slope[i, 2] += 2 * s3
                slope[i, 3] += 2 * s4


class PairCoupling:
    """Receptance of a structure whose joint has one or two DOFs.

    Parameters
    ----------
    free
        Receptance without the joint between joint DOFs and ports, shape (lines, r + q, r + q), r joint DOFs first.
    along
        Part of each port's motion that is the joint's own, shape (r, q).
    n_out
        The first so many ports are outputs, the others inputs.
    """

    def __init__(self, free: ComplexArray, along: Array, n_out: int) -> None:
        r = along.shape[0]
        size = free.shape[1] + 2 - r  # a joint of one DOF, or of none, gets others that nothing moves
        kept = np.concatenate([np.arange(r), np.arange(2, size)])
        a = np.zeros((len(free), size, size), dtype=complex)
        a[:, kept[:, None], kept] = free
        self._r, ports = r, np.zeros((2, along.shape[1]))
        ports[:r] = along
        self._d, self._n = _minors(a, ports, n_out)

    def receptance(self, stiffness: ArrayLike) -> ComplexArray:
        """Receptances for joint matrices of shape (r, r) or (batch, r, r): shape (batch, lines, outputs, inputs)."""
        u = self._padded_coordinates(stiffness_batch(stiffness))
        return _weighted(u, self._n) / _weighted(u, self._d)[:, :, None, None]

    def tangent(self, stiffness: ArrayLike, directions: ArrayLike) -> tuple[ComplexArray, ComplexArray]:
        """Receptance and its derivative along p changes of one joint matrix; see `ReceptanceModel`."""
        k, dk = self._padded(stiffness_batch(stiffness)), self._padded(stiffness_batch(directions))
        u, scale = self._padded_coordinates(stiffness_batch(stiffness)), _no_more_than_rigid(k)
        k, dk = scale * k, scale * dk
        d_det = dk[:, 0, 0] * k[0, 1, 1] + dk[:, 1, 1] * k[0, 0, 0] - 2 * k[0, 0, 1] * dk[:, 0, 1]
        du = np.stack([np.zeros(len(dk)), dk[:, 0, 0], dk[:, 0, 1], dk[:, 1, 1], d_det], axis=-1)
        denominator = _weighted(u, self._d)[0, :, None, None]
        value = _weighted(u, self._n)[0] / denominator
        change = _weighted(du, self._n) - value * _weighted(du, self._d)[:, :, None, None]
        return value, change / denominator

    def misfit(self, measured: ComplexArray, weight: Array) -> "PairMisfit":
        """Weighted distance from measured receptances, shape (lines, outputs, inputs)."""
        e = ((self._n - measured * self._d[:, :, None, None]) * weight).reshape(5, len(measured), -1)
        # |E| does not see a phase: turned so that its last coefficient is real, E costs one product less
        size = np.abs(e[4])
        e = e * np.where(size > 0, e[4].conj() / np.where(size > 0, size, 1.0), 1.0)
        rows = np.stack([row for k in range(5) for row in (e[k].real, e[k].imag)][:9])  # (9, lines, pairs)
        d = np.stack([row for k in range(1, 5) for row in (self._d[k].real, self._d[k].imag)])
        return PairMisfit(self, lane_blocks(d), lane_blocks(np.moveaxis(rows, -1, 0)))

    def coordinates(self, matrices: Array) -> Array:
        """(k11, k12, k22, det K), shape (batch, 4), of joint matrices (batch, r, r)."""
        k = self._padded(matrices)
        k = k * _no_more_than_rigid(k)
        k11, k12, k22 = k[:, 0, 0], k[:, 0, 1], k[:, 1, 1]
        return np.stack([k11, k12, k22, k11 * k22 - k12 * k12], axis=-1)

    def _padded_coordinates(self, matrices: Array) -> Array:
        u = self.coordinates(matrices)
        return np.concatenate([np.ones((len(u), 1)), u], axis=1)

    def _padded(self, matrices: Array) -> Array:
        if self._r == 2:
            return matrices
        padded = np.zeros((len(matrices), 2, 2))
        padded[:, : self._r, : self._r] = matrices
        return padded


class PairMisfit:
    """χ² = Σ |H − H^x|² w² over lines and FRFs as a function of the joint, without any array over its lines."""

    def __init__(self, coupling: PairCoupling, d: Array, e: Array) -> None:
        self._coupling, self._d, self._e = coupling, d, e

    def chi2(self, stiffness: Array, factors: ArrayLike | None = None) -> Array:
        """χ², shape (batch,), of joint matrices, shape (batch, r, r); not finite where a line is singular."""
        u = np.ascontiguousarray(self._coupling.coordinates(stiffness))
        chi2 = np.empty(len(u))
        _chi2(u, self._d, self._e, chi2)
        return chi2

    def chi2_gradient(self, stiffness: Array, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """χ² and its gradient S, shape (batch, r, r): dχ² = Σ S_ij dK_ij for symmetric dK."""
        u = np.ascontiguousarray(self._coupling.coordinates(stiffness))
        chi2, slope = np.empty(len(u)), np.empty((len(u), 4))
        _chi2_slope(u, self._d, self._e, chi2, slope)
        k11, k12, k22 = u[:, 0], u[:, 1], u[:, 2]
        s11, s22 = slope[:, 0] + slope[:, 3] * k22, slope[:, 2] + slope[:, 3] * k11
        s12 = slope[:, 1] / 2 - slope[:, 3] * k12
        r = stiffness.shape[-1]
        return chi2, np.stack([s11, s12, s12, s22], axis=-1).reshape(-1, 2, 2)[:, :r, :r]


def _no_more_than_rigid(k: Array) -> Array:
    """Return factors on the entries of K, shape (batch, 2, 2), that leave no DOF stiffer than `RIGID`.

    Each DOF is scaled by itself, S K S, so that the other keeps its stiffness.
    """
    with np.errstate(divide="ignore"):
        scale = np.minimum(1.0, np.sqrt(RIGID / np.abs(np.diagonal(k, axis1=1, axis2=2))))
    return np.asarray(scale[:, :, None] * scale[:, None, :])


def _weighted(u: Array, rows: ComplexArray) -> ComplexArray:
    """Σ_k u_k rows_k, shape (batch, ...), term by term: a matrix product would round a batch unlike its members."""
    first, *others = (u[:, k].reshape(-1, *[1] * (rows.ndim - 1)) * rows[k] for k in range(len(rows)))
    total: ComplexArray = first
    for term in others:
        total = total + term
    return total


def _minors(a: ComplexArray, along: Array, n_out: int) -> tuple[ComplexArray, ComplexArray]:
    """D (5, lines) and N (5, lines, outputs, inputs) by (1, k11, k12, k22, det K).

    N = αᵀ(A + adj K det A)α + αᵀ adj K adj A P + Pᵀ adj A adj K α + αᵀP + Pᵀα + R D − Pᵀ(K + adj A det K)P, with α the
    ports' parts along the joint, P = A_jp and R = A_pp of their rest.
    """
    a11, a12, a22 = a[:, 0, 0], a[:, 0, 1], a[:, 1, 1]
    det = a11 * a22 - a12 * a12
    d = np.stack([np.ones_like(det), a11, 2 * a12, a22, det])

    p = a[:, :2, 2:]  # (lines, 2, ports)
    adj_p = np.stack([a22[:, None] * p[:, 0] - a12[:, None] * p[:, 1], a11[:, None] * p[:, 1] - a12[:, None] * p[:, 0]])
    turned = adj_p + det[:, None] * along[:, None, :]  # adj A P + det A α, (2, lines, ports)
    outputs, inputs = slice(None, n_out), slice(n_out, None)

    def product(left: ComplexArray | Array, right: ComplexArray | Array) -> ComplexArray:
        return np.asarray(left[..., outputs, None] * right[..., None, inputs], dtype=complex)

    def adjugate_product(m: int, n: int) -> ComplexArray:
        return product(along[m], turned[n]) + product(adj_p[m], along[n])

    rest = a[:, 2:, 2:][:, outputs, inputs]
    at_joint = a[:, :2, :2] @ along + p  # motion of the joint itself under a force at a port, joint absent
    still = product(along[0], at_joint[:, 0]) + product(along[1], at_joint[:, 1])
    still += product(p[:, 0], along[0]) + product(p[:, 1], along[1]) + rest
    n11 = adjugate_product(1, 1) + rest * a11[:, None, None] - product(p[:, 0], p[:, 0])
    n12 = -adjugate_product(0, 1) - adjugate_product(1, 0) + 2 * rest * a12[:, None, None]
    n12 -= product(p[:, 0], p[:, 1]) + product(p[:, 1], p[:, 0])
    n22 = adjugate_product(0, 0) + rest * a22[:, None, None] - product(p[:, 1], p[:, 1])
    n_det = rest * det[:, None, None] - product(p[:, 0], adj_p[0]) - product(p[:, 1], adj_p[1])
    return d, np.stack([still, n11, n12, n22, n_det])
