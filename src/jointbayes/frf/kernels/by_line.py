"""Joints that are another complex matrix at every line: what they make of receptances, and of errors of these."""

import math

import numpy as np
from numpy.typing import NDArray

from jointbayes.frf.kernels.compiled import compiled, inner
from vibrecords.arrays import Array, ComplexArray

Indices = NDArray[np.int64]


@inner
def _solve(m: ComplexArray, x: ComplexArray) -> None:
    """m⁻¹ x in place of x, (r, r) and (r, q), by elimination with the largest pivot of each column."""
    r, q = x.shape
    for p in range(r):
        best, size = p, abs(m[p, p].real) + abs(m[p, p].imag)
        for i in range(p + 1, r):
            other = abs(m[i, p].real) + abs(m[i, p].imag)
            if other > size:
                best, size = i, other
        if best != p:
            for j in range(p, r):
                m[p, j], m[best, j] = m[best, j], m[p, j]
            for j in range(q):
                x[p, j], x[best, j] = x[best, j], x[p, j]
        inverse = 1.0 / m[p, p]
        m[p, p] = inverse
        for i in range(p + 1, r):
            if m[i, p] != 0.0:
                f = m[i, p] * inverse
                for j in range(p + 1, r):
                    m[i, j] -= f * m[p, j]
                for j in range(q):
                    x[i, j] -= f * x[p, j]
    for p in range(r - 1, -1, -1):
        for j in range(q):
            total = x[p, j]
            for i in range(p + 1, r):
                total -= m[p, i] * x[i, j]
            x[p, j] = total * m[p, p]


@compiled
def add_joints(
    stiffness: Array,
    viscous: Array,
    hysteretic: Array,
    omega: Array,
    free: ComplexArray,
    along: Array,
    n_out: int,
    value: ComplexArray,
    motion: ComplexArray,
) -> None:
    """Receptances once a joint is added into `value`, motions of the joint under each load into `motion`.

    Of the joints K, C and H, each (n, r, r), of which D = K + jωC + jH at each line (lines,); the receptance
    without them (1 or n, lines, r + q, r + q) between the joint's motions and the q ports' others, and the part of each
    port's motion that is the joint's own (r, q). Shapes (n, lines, outputs, inputs) and (n, lines, r, q). NaN where a
    line is singular.
    """
    n, r = stiffness.shape[:2]
    q, lines = along.shape[1], len(omega)
    d, m = np.empty((r, r), dtype=np.complex128), np.empty((r, r), dtype=np.complex128)
    x, force = np.empty((r, q), dtype=np.complex128), np.empty(r, dtype=np.complex128)
    for i in range(n):
        for line in range(lines):
            a = free[min(i, len(free) - 1), line]
            for p in range(r):
                for s in range(r):
                    loss = omega[line] * viscous[i, p, s] + hysteretic[i, p, s]
                    d[p, s] = complex(stiffness[i, p, s], loss)
            for p in range(r):
                for s in range(r):
                    total = complex(1.0 if p == s else 0.0, 0.0)
                    for k in range(r):
                        if d[k, s] != 0.0:
                            total += a[p, k] * d[k, s]
                    m[p, s] = total
                for c in range(q):
                    total = a[p, r + c]
                    for k in range(r):
                        total += a[p, k] * along[k, c]
                    x[p, c] = total
            _solve(m, x)  # (1 + A_jj D) δ = A_jp
            for p in range(r):
                for c in range(q):
                    motion[i, line, p, c] = x[p, c]
            for c in range(n_out, q):
                for p in range(r):
                    total = complex(along[p, c], 0.0)
                    for k in range(r):
                        total -= d[p, k] * x[k, c]
                    force[p] = total
                for o in range(n_out):
                    total = a[r + o, r + c]
                    for p in range(r):
                        total += a[r + o, p] * force[p] + along[p, o] * x[p, c]
                    value[i, line, o, c - n_out] = total


@compiled
def error_roots(
    k: ComplexArray,
    free: ComplexArray,
    along: Array,
    motions: Array,
    entries: Indices,
    root: Array,
    n_out: int,
    out: ComplexArray,
) -> None:
    """Roots R of E[δH δHᴴ] = R Rᴴ into `out` (n, lines, pairs, E), see `jointbayes.frf.coupling`.

    Of joint matrices (n, 1 or lines, r, r), the free receptance (1 or n, lines, r + q, r + q) between the joint's
    motions and the rest of the q ports, their parts along the joint (r, q), motions of the bodies' DOFs (DOFs, r + q),
    rows and columns (2, E) of the measured receptances among these DOFs, and the roots of their covariance
    (lines, E, E).
    """
    n, r = k.shape[0], k.shape[2]
    lines, q, dofs, count = free.shape[1], along.shape[1], motions.shape[0], entries.shape[1]
    m, x = np.empty((r, r), dtype=np.complex128), np.empty((r, q), dtype=np.complex128)
    force, slope = np.empty((dofs, q), dtype=np.complex128), np.empty(count, dtype=np.complex128)
    for i in range(n):
        for line in range(lines):
            a, b = free[min(i, free.shape[0] - 1), line], k[i, min(line, k.shape[1] - 1)]
            for row in range(r):
                for c in range(r):
                    total = complex(1.0 if row == c else 0.0, 0.0)
                    for s in range(r):
                        total += b[row, s] * a[s, c]
                    m[row, c] = total
                for c in range(q):
                    total = complex(along[row, c], 0.0)
                    for s in range(r):
                        total -= b[row, s] * a[s, r + c]
                    x[row, c] = total
            # forces on the free bodies along the joint under a unit force at each port, its own part included
            _solve(m, x)
            for d in range(dofs):
                for c in range(q):
                    total = complex(motions[d, r + c], 0.0)
                    for s in range(r):
                        total += motions[d, s] * x[s, c]
                    force[d, c] = total
            for o in range(n_out):
                for c in range(n_out, q):
                    for e in range(count):
                        p, s = entries[0, e], entries[1, e]
                        slope[e] = force[p, o] * force[s, c]
                        if p != s:
                            slope[e] += force[s, o] * force[p, c]
                    pair = o * (q - n_out) + c - n_out
                    for f in range(count):
                        total = complex(0.0, 0.0)
                        for e in range(count):
                            if root[line, e, f] != 0.0:
                                total += slope[e] * root[line, e, f]
                        out[i, line, pair, f] = total


@compiled
def noise_roots(added: ComplexArray, gain: Array, variance: Array, out: ComplexArray) -> None:
    """Lower triangular L with L Lᴴ = diag(σ²) + g² R Rᴴ into `out` (n, lines, pairs, pairs), by Cholesky.

    Of roots R (n, lines, pairs, E), factors g (n,) and variances (lines, pairs). NaN where nothing is finite.
    """
    n, lines, pairs, count = added.shape
    for i in range(n):
        for line in range(lines):
            for p in range(pairs):
                for q in range(p + 1):
                    total = complex(variance[line, p] if p == q else 0.0, 0.0)
                    for e in range(count):
                        x, y = added[i, line, p, e], added[i, line, q, e]
                        total += gain[i] * gain[i] * x * complex(y.real, -y.imag)
                    for s in range(q):
                        x, y = out[i, line, p, s], out[i, line, q, s]
                        total -= x * complex(y.real, -y.imag)
                    if p == q:
                        out[i, line, p, p] = complex(math.sqrt(total.real), 0.0)
                    else:
                        out[i, line, p, q] = total / out[i, line, q, q].real
                        out[i, line, q, p] = 0.0
