"""Modes after springs are added: eigenvalues of diag(λ) + d v vᵀ as roots of the secular equation, spring by spring.

A joint matrix is so many independent springs: K = Σ_p d_p l_p l_pᵀ, spring p stretched by δ_p = l_pᵀ x. Of each,
1/d + Σ_s v_s²/(λ_s − μ) = 0 has one root between each two of the old eigenvalues and one above the last. All roots
are found side by side, each measured from its nearest old eigenvalue, so that every difference λ_s − μ keeps its
relative accuracy however stiff or soft the spring is.

References
----------
Golub, G. H. (1973). Some modified matrix eigenvalue problems. SIAM Review 15(2), 318-334. DOI 10.1137/1015032
Borges, C. F., Gragg, W. B. (1993). A parallel divide and conquer algorithm for the generalized real symmetric
definite tridiagonal eigenproblem. In Numerical Linear Algebra, de Gruyter, 11-29. DOI 10.1515/9783110857658.11
(the third-order iteration).
"""

import math

import numpy as np

from jointbayes.frf.kernels.compiled import LANES, compiled, keep_order
from vibrecords.arrays import Array, Indices

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


_WIDE = 1e10  # gap between two poles over the distance of a root from one, beyond which the far one is out of sight
_ROUNDS = 40  # a bracket that the iteration leaves is halved: never seen to need more than a dozen
_APART = 1e-15
_UNMOVED = 1e-20  # a mode whose share in the stretch is less takes part with this much, and no bit notices

# Scratch memory of so many roots at a time: vectors of LANES numbers one after the other in one stretch of memory,
# which is how a compiler sees that they do not overlap and uses the processor's vector unit.
_TAU, _F, _F1, _F2, _GAP, _SIDE, _LOW, _HIGH, _ORIGIN, _NORM, _SIZE = (LANES * k for k in range(11))


def workspace(modes: int, rows: int) -> tuple[Array, Array]:
    """Scratch memory of `add_springs`: turned rows with v and the new eigenvalues, and vectors over the roots."""
    return np.zeros((rows + 2, -(-modes // 8) * 8)), np.zeros(_SIZE)


@keep_order
def _sums(lam: Array, v: Array, lanes: int, w: Array) -> None:
    """f = Σ v_s²/(λ_s − μ), f' and f''/2 at μ = origin + tau of every root."""
    for k in range(lanes):
        w[_F + k], w[_F1 + k], w[_F2 + k] = 0.0, 0.0, 0.0
    for s in range(len(lam)):
        a, z = lam[s], v[s] * v[s]
        for k in range(lanes):
            t = 1.0 / ((a - w[_ORIGIN + k]) - w[_TAU + k])
            m = z * t
            w[_F + k] += m
            m *= t
            w[_F1 + k] += m
            w[_F2 + k] += m * t


@keep_order
def _step(inverse: float, lanes: int, w: Array) -> int:
    """Move every root by rational interpolation of third order; returns how many moved by more than rounding."""
    moving = 0
    for k in range(lanes):
        # seen from the origin outwards every root looks the same: x > 0, near pole at 0, far pole at gap
        side, gap = w[_SIDE + k], w[_GAP + k]
        x = side * w[_TAU + k]
        value, first, second = side * (inverse + w[_F + k]), w[_F1 + k], side * w[_F2 + k]
        low = x if value < 0.0 else w[_LOW + k]
        high = w[_HIGH + k] if value < 0.0 else x
        # c − near/x + far/(gap − x) matches the function and its first two derivatives here
        to_far, per_gap = gap - x, 1.0 / gap
        near = -x * (second * to_far - first) * per_gap
        far = to_far * (first + second * x) * per_gap
        c = value + near * x - far * to_far
        # next to the mode that only a rigid spring has, c · gap is rounding: the same sum without what cancels
        stable = gap * (value + near * x) + (near * x - far * to_far) * x
        near, far = near * x * x, far * to_far * to_far
        b = c * gap + near + far if gap < _WIDE * x else stable
        size = abs(b) + math.sqrt(abs(b * b - 4.0 * c * near * gap))
        new = (2.0 * near * gap if b > 0.0 else -size) / (size if b > 0.0 else 2.0 * c)
        # a step out of the bracket halves it, but at the end rounding may put the root just outside
        kept = new if new > low else 0.5 * (low + high)
        kept = kept if new < high else 0.5 * (low + high)
        kept = new if abs(new - x) < 1e-10 * x else kept
        moving += 1 if abs(kept - x) > 1e-4 * x else 0
        w[_LOW + k], w[_HIGH + k], w[_TAU + k] = low, high, side * kept
    return moving


@keep_order
def _roots(lam: Array, v: Array, inverse: float, start: int, lanes: int, w: Array) -> None:
    """Roots μ = origin + tau of inverse + Σ v_s²/(λ_s − μ), from number `start` on."""
    n = len(lam)
    total = 0.0
    for s in range(n):
        total += v[s] * v[s]
    for k in range(lanes):
        j = min(start + k, n - 1)  # lanes beyond the last root repeat it
        gap = lam[j + 1] - lam[j] if j < n - 1 else 2.0 * total / inverse
        w[_ORIGIN + k], w[_TAU + k], w[_GAP + k] = lam[j], 0.5 * gap, gap
        w[_SIDE + k], w[_LOW + k], w[_HIGH + k] = 1.0, 0.0, gap
    for turn in range(_ROUNDS):
        _sums(lam, v, lanes, w)
        if turn == 0:
            for k in range(min(lanes, n - 1 - start)):
                if inverse + w[_F + k] < 0.0:  # nearer to the pole on the right: measured from there
                    w[_ORIGIN + k], w[_TAU + k], w[_SIDE + k] = lam[start + k + 1], -w[_TAU + k], -1.0
        if _step(inverse, lanes, w) == 0:  # what a step of third order leaves of 1e-4 is near rounding
            break


@keep_order
def _separate(lam: Array, shift: float) -> None:
    """Part eigenvalues that are equal by a rounding error: between two of them there must be room for a root."""
    for s in range(len(lam) - 1):
        lam[s + 1] = max(lam[s + 1], lam[s] + _APART * (abs(lam[s]) + 1e-8 * shift))


@keep_order
def _turn(lam: Array, v: Array, rows: Array, start: int, lanes: int, w: Array, out: Array) -> None:
    """Motions in the new modes, Σ_s y_s v_s/(λ_s − μ_k) over their norm, into `out`."""
    for k in range(lanes):
        w[_NORM + k] = 0.0
        for i in range(len(rows)):
            out[i, start + k] = 0.0
    for s in range(len(lam)):
        a, z = lam[s], v[s]
        for k in range(lanes):
            c = z / ((a - w[_ORIGIN + k]) - w[_TAU + k])
            w[_F + k] = c
            w[_NORM + k] += c * c
        for i in range(len(rows)):
            y = rows[i, s]
            if y != 0.0:  # of bodies that nothing joins so far
                for k in range(lanes):
                    out[i, start + k] += y * w[_F + k]
    for k in range(lanes):
        scale = 1.0 / math.sqrt(w[_NORM + k])
        w[_NORM + k] = scale
        for i in range(len(rows)):
            out[i, start + k] *= scale


@keep_order
def _add_spring(lam: Array, rows: Array, p: int, d: float, shift: float, wanted: int, work: Array, w: Array) -> None:
    """Add spring number p, of stiffness d > 0, whose stretch is row p; the first `wanted` modes are replaced."""
    n, count, inverse = len(lam), len(rows), 1.0 / d
    v, new = work[count], work[count + 1]
    largest = 0.0
    for s in range(n):
        largest = max(largest, abs(rows[p, s]))
    for s in range(n):
        y = rows[p, s]
        v[s] = y if abs(y) > _UNMOVED * largest else _UNMOVED * largest
    for start in range(0, wanted, LANES):
        lanes = min(LANES, -(-(wanted - start) // 8) * 8)
        _roots(lam, v, inverse, start, lanes, w)
        _turn(lam, v, rows, start, lanes, w, work)
        for k in range(min(lanes, wanted - start)):
            new[start + k] = w[_ORIGIN + k] + w[_TAU + k]
            work[p, start + k] = -inverse * w[_NORM + k]  # by the secular equation itself: exact for a rigid spring
    for k in range(wanted):
        lam[k] = new[k]
        for i in range(count):
            rows[i, k] = work[i, k]
    _separate(lam, shift)


@keep_order
def _add_where_it_stretches(
    lam: Array, rows: Array, p: int, d: float, shift: float, wanted: int, order: Indices, part: Array,
    work: Array, w: Array,
) -> None:  # fmt: skip
    """Add spring number p to the modes in which it is stretched; the others stay, each in its new place.

    Bodies that nothing joins so far have modes of their own, and a spring between two of them leaves all others alone.
    """
    n, count = len(lam), len(rows)
    largest, moved, still = 0.0, 0, 0
    for s in range(n):
        largest = max(largest, abs(rows[p, s]))
    for s in range(n):
        if abs(rows[p, s]) > _UNMOVED * largest:
            order[moved] = s
            moved += 1
        else:
            still += 1
            order[n - still] = s
    if -(-moved // 8) == -(-n // 8):  # as many roots are found side by side
        _add_spring(lam, rows, p, d, shift, wanted, work, w)
        return
    if moved == 0:
        return
    few, others = part[: count * moved].reshape(count, moved), part[count * moved : count * n].reshape(count, still)
    few_lam, other_lam = part[count * n : count * n + moved], part[count * n + moved : (count + 1) * n]
    for k in range(moved):
        few_lam[k] = lam[order[k]]
        for i in range(count):
            few[i, k] = rows[i, order[k]]
    for k in range(still):
        other_lam[k] = lam[order[n - 1 - k]]
        for i in range(count):
            others[i, k] = rows[i, order[n - 1 - k]]
    _add_spring(few_lam, few, p, d, shift, moved, work, w)
    a, b = 0, 0
    for k in range(n):
        if b == still or (a < moved and few_lam[a] <= other_lam[b]):
            lam[k] = few_lam[a]
            for i in range(count):
                rows[i, k] = few[i, a]
            a += 1
        else:
            lam[k] = other_lam[b]
            for i in range(count):
                rows[i, k] = others[i, b]
            b += 1
    _separate(lam, shift)


@compiled
def add_springs(
    free: Array, joined: Array, rest: Array, directions: Array, stiffness: Array, shift: float, wanted: int,
    lam: Array, rows: Array, work: Array, w: Array,
) -> None:  # fmt: skip
    """Add the springs of each joint of a batch to the free structure.

    Parameters
    ----------
    free
        Eigenvalues without the joint, rising, shape (batch, m), or (1, m) where all joints share them.
    joined, rest
        Motion of the joint's DOFs (batch or 1, r, m) and other motions (batch or 1, q, m) in the free modes.
    directions, stiffness
        Springs, shapes (batch, r, r) and (batch, r), see `springs`.
    shift
        Size below which eigenvalues differ by rounding only.
    wanted
        The first so many modes are to be right; those beyond are left as they stood before the last spring.
    lam, rows
        Results: eigenvalues (batch, m), and the stretch of each spring, then `rest`, in each mode (batch, r + q, m).
    work, w
        From `workspace`.
    """
    _, r, m = joined.shape
    order, part = np.empty(m, dtype=np.int64), np.empty((rows.shape[1] + 1) * m)
    for i in range(len(lam)):
        j = i if len(free) > 1 else 0
        for k in range(m):
            lam[i, k] = free[j, k]
            for p in range(r):
                rows[i, p, k] = 0.0
                for a in range(r):
                    rows[i, p, k] += directions[i, a, p] * joined[j, a, k]
            for a in range(rest.shape[1]):
                rows[i, r + a, k] = rest[j, a, k]
        _separate(lam[i], shift)
        last = r - 1
        while last > 0 and not stiffness[i, last] > 0.0:
            last -= 1
        for p in range(r):
            if stiffness[i, p] > 0.0:
                most = wanted if p == last else m
                _add_where_it_stretches(lam[i], rows[i], p, stiffness[i, p], shift, most, order, part, work, w)


def held_still(eigenvalues: Array, motion: Array, rest: Array, shift: float, wanted: int) -> tuple[Array, Array]:
    """The first modes of structures whose motion in one place is held by a rigid spring more.

    Parameters
    ----------
    eigenvalues
        Of the modes of each, rising, shape (batch, m).
    motion, rest
        Motion there in these modes of unit modal mass, shape (batch, m), and other motions, shape (batch, q, m).
    shift, wanted
        See `add_springs`.

    Returns
    -------
    eigenvalues, rest : ndarray, shapes (batch, wanted) and (batch, q, wanted)
    """
    (batch, m), q = eigenvalues.shape, rest.shape[1]
    lam, rows = np.empty((batch, m)), np.empty((batch, 1 + q, m))
    rigid = np.full((batch, 1), RIGID)
    free, joined, others = map(np.ascontiguousarray, (eigenvalues, motion[:, None], rest))
    add_springs(free, joined, others, np.ones((batch, 1, 1)), rigid, shift, wanted, lam, rows, *workspace(m, 1 + q))
    return lam[:, :wanted], rows[:, 1:, :wanted]
