"""A joint matrix as independent springs: K = Σ_p d_p l_p l_pᵀ, spring p stretched by δ_p = l_pᵀ x."""

import math

import numpy as np

from jointbayes.arrays import Array
from jointbayes.frf.kernels.compiled import compiled

#: A joint stiffer than this (N/m and so on) is rigid to the last bit, one softer than its inverse absent; and the
#: determinant squared is still a number.
RIGID = 1e60
_ROUNDING = 1e-14  # what is left of a stiffness after a spring is taken out is nothing below this


@compiled
def _take_springs(matrices: Array, directions: Array, stiffness: Array) -> int:
    """K = L D Lᵀ, the stiffest DOF first, as long as K is positive semidefinite; returns how many others there are.

    The first stiffness of those others is NaN.
    """
    failed, r = 0, matrices.shape[1]
    for i in range(len(matrices)):
        rest = matrices[i].copy()
        taken = np.zeros(r, dtype=np.bool_)
        possible = True
        for n in range(r):
            p = -1
            for a in range(r):
                if not taken[a] and (p < 0 or rest[a, a] > rest[p, p]):
                    p = a
            taken[p] = True
            pivot = rest[p, p] if abs(rest[p, p]) > _ROUNDING * abs(matrices[i, p, p]) else 0.0
            stiffness[i, n] = min(pivot, RIGID) if abs(pivot) > 1.0 / RIGID else 0.0
            for a in range(r):
                directions[i, a, n] = 0.0
            directions[i, p, n] = 1.0
            for a in range(r):
                if not taken[a]:
                    size = math.sqrt(abs(matrices[i, a, a] * matrices[i, p, p]))
                    column = rest[a, p] if abs(rest[a, p]) > _ROUNDING * size else 0.0
                    # k_ap² ≤ k_aa k_pp where no energy is released; rounding is let pass
                    possible &= column * column <= abs(pivot * rest[a, a]) * (1 + 1e-9) + _ROUNDING * size * size
                    directions[i, a, n] = column / pivot if pivot != 0.0 else 0.0
            for a in range(r):
                for b in range(r):
                    if not taken[a] and not taken[b]:
                        rest[a, b] -= directions[i, a, n] * rest[p, b]
            possible &= pivot >= 0
        if not possible:
            failed += 1
            stiffness[i, 0] = np.nan
    return failed


def springs(matrices: Array) -> tuple[Array, Array]:
    """Springs of joint matrices.

    Parameters
    ----------
    matrices
        K^J, shape (batch, r, r), symmetric.

    Returns
    -------
    directions, stiffness : ndarray, shapes (batch, r, r) and (batch, r)
        K = L diag(d) Lᵀ with an invertible L: unit triangular, but for the order of its rows, where K is positive
        semidefinite, which keeps each spring's relative accuracy over any number of decades, and eigenvectors where
        it is not.
    """
    matrices = np.ascontiguousarray(matrices)
    directions, stiffness = np.empty_like(matrices), np.empty(matrices.shape[:2])
    if _take_springs(matrices, directions, stiffness):
        for i in np.flatnonzero(np.isnan(stiffness[:, 0]) & np.isfinite(matrices).all(axis=(1, 2))):
            scale = np.sqrt(np.abs(matrices[i]).max(axis=1))
            scale[scale == 0] = 1.0
            stiffness[i], vectors = np.linalg.eigh(matrices[i] / np.outer(scale, scale))
            directions[i] = scale[:, None] * vectors
    return directions, stiffness
