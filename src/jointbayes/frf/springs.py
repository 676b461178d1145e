"""A joint matrix as independent springs: K = Σ_p d_p l_p l_pᵀ, spring p stretched by δ_p = l_pᵀ x."""

import numpy as np
from numpy.typing import NDArray

from jointbayes.frf.compiled import compiled

__all__ = ["springs"]

Array = NDArray[np.float64]


@compiled
def _unit_triangular(matrices: Array, directions: Array, stiffness: Array) -> int:
    """K = L D Lᵀ without pivoting, stable as K is positive semidefinite; returns the number of other matrices."""
    failed = 0
    r = matrices.shape[1]
    for i in range(len(matrices)):
        rest = matrices[i].copy()
        for p in range(r):
            pivot = rest[p, p]
            stiffness[i, p] = pivot
            for a in range(r):
                directions[i, a, p] = 0.0
            directions[i, p, p] = 1.0
            for a in range(p + 1, r):
                # |k_ap|² ≤ k_aa k_pp where no energy is released; rounding is let pass
                if rest[a, p] ** 2 > (1 + 1e-9) * abs(pivot * rest[a, a]) or pivot < 0:
                    failed += 1
                    stiffness[i, 0] = np.nan
                if pivot != 0.0:
                    directions[i, a, p] = rest[a, p] / pivot
            for a in range(p + 1, r):
                for b in range(p + 1, r):
                    rest[a, b] -= directions[i, a, p] * rest[p, b]
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
        K = L diag(d) Lᵀ with an invertible L: unit lower triangular where K is positive semidefinite, which keeps
        each spring's relative accuracy over any number of decades, and eigenvectors where it is not.
    """
    matrices = np.ascontiguousarray(matrices)
    directions, stiffness = np.empty_like(matrices), np.empty(matrices.shape[:2])
    if _unit_triangular(matrices, directions, stiffness):
        for i in np.flatnonzero(np.isnan(stiffness[:, 0]) & np.isfinite(matrices).all(axis=(1, 2))):
            scale = np.sqrt(np.abs(matrices[i]).max(axis=1))
            scale[scale == 0] = 1.0
            stiffness[i], vectors = np.linalg.eigh(matrices[i] / np.outer(scale, scale))
            directions[i] = scale[:, None] * vectors
    return directions, stiffness
