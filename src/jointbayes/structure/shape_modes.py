"""Free modes over the few numbers that change them by more than factors, and from these at all quantities.

E, ρ and size change the modes of a body by similarity, that is by factors. Over what is left, such as slenderness or an
accelerometer's mass over the body's, the modes and the few vectors that stand for those above the band (`Reduction`)
are interpolated between Chebyshev points, at which the body is assembled and solved.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy import optimize

from jointbayes.structure.body import Forced, Modes, Reduction
from jointbayes.structure.matrices import SolvedModes, StructureAt
from vibrecords.arrays import Array, Flags, Indices

Ends = Sequence[tuple[float, float]]
ModesAt = Callable[[Sequence[float]], tuple[Modes, Array]]

_NODES = (4, 6, 8, 11, 15, 20, 27, 36)
_MOST_POINTS = 1000  # beyond, tabulating costs more than it gains
_ACCURATE = 1e-8  # of the interpolation, relative to each eigenvalue and to the largest motion in any mode
_TRIED, _FAR = 4, 1e4  # sizes of tables whose errors tell how the others will be; errors that far above are no use
_SAME_PLANE = 1e-6  # eigenvalues closer than this (relative) share a plane in which any basis is as good


class _Interpolation:
    """Polynomials through a tensor grid of Chebyshev points.

    Parameters
    ----------
    ends
        Lower and upper end of each axis.
    counts
        Number of points on each.
    """

    def __init__(self, ends: Sequence[tuple[float, float]], counts: Sequence[int]) -> None:
        each = zip(ends, counts, strict=True)
        self._nodes = [(a + b) / 2 + (b - a) / 2 * np.cos((np.arange(n) + 0.5) * np.pi / n) for (a, b), n in each]
        self._weights = [(-1.0) ** np.arange(n) * np.sin((np.arange(n) + 0.5) * np.pi / n) for n in counts]

    @property
    def points(self) -> list[tuple[float, ...]]:
        """The points of the grid, each (axes,)."""
        return list(itertools.product(*(nodes.tolist() for nodes in self._nodes)))

    def coefficients(self, numbers: Array) -> Array:
        """Weight of each point, shape (n, points), for shape numbers (n, axes)."""
        total = np.ones((len(numbers), 1))
        for i, (nodes, weights) in enumerate(zip(self._nodes, self._weights, strict=True)):
            gap = numbers[:, i, None] - nodes
            hit = gap == 0
            # barycentric formula; at a point itself its own weight alone counts
            share = weights / np.where(hit, 1.0, gap)
            share = np.where(hit.any(axis=1, keepdims=True), hit, share)
            share = share / share.sum(axis=1, keepdims=True)
            total = (total[:, :, None] * share[:, None, :]).reshape(len(numbers), -1)
        return total


class ModeTable:
    """Eigenvalues and motions over the shape numbers: polynomials through those at tensor points.

    Parameters
    ----------
    modes_at
        Modes and mass matrix at shape numbers (axes,); the modes at zero give all others order and direction.
    motions
        Motions that are wanted, as forms on the DOFs, shape (DOFs, k).
    ends, counts
        Lower and upper end of each axis, and number of points on each.
    """

    def __init__(self, modes_at: ModesAt, motions: Array, ends: Ends, counts: Sequence[int]) -> None:
        self._grid = _Interpolation(ends, counts)
        self._ends, self._motions = ends, motions
        self._nominal, _ = modes_at([0.0] * len(ends))
        solved = [self._turned(modes_at, point) for point in self._grid.points]
        self._eigenvalues = np.stack([eigenvalues for eigenvalues, _ in solved])
        self._rows = np.stack([rows for _, rows in solved])
        self._flat = np.concatenate([self._eigenvalues, self._rows.reshape(len(self._rows), -1)], axis=1)

    def __call__(self, numbers: Array) -> tuple[Array, Array]:
        """Eigenvalues (n, m) and motions (n, k, m) at shape numbers (n, axes)."""
        k, m = self._rows.shape[1:]
        values = self._grid.coefficients(numbers) @ self._flat
        return values[:, :m], values[:, m:].reshape(len(values), k, m)

    def _turned(self, modes_at: ModesAt, numbers: Sequence[float]) -> tuple[Array, Array]:
        """Eigenvalues (m,) and motions (k, m) of modes ordered and turned like their nominal counterparts."""
        (modes, mass), nominal = modes_at(numbers), self._nominal
        # modes of different symmetry cross as the beam becomes thicker: each is known by its shape, not by its number
        likeness = modes.shapes.T @ mass @ nominal.shapes
        _, number = optimize.linear_sum_assignment(-np.abs(likeness).T)
        eigenvalues, shapes, likeness = modes.eigenvalues[number], modes.shapes[:, number], likeness[number]
        shapes = shapes * np.copysign(1.0, np.diagonal(likeness))
        apart = np.diff(nominal.eigenvalues) > _SAME_PLANE * nominal.eigenvalues[1:]
        cuts = [0, *(np.flatnonzero(apart) + 1).tolist(), nominal.eigenvalues.size]
        for first, last in itertools.pairwise(cuts):  # runs of modes with equal eigenvalues
            if last - first > 1:
                # the rotation within the plane that brings the shapes nearest to the nominal ones
                plane = slice(first, last)
                left, _, right = np.linalg.svd(shapes[:, plane].T @ mass @ nominal.shapes[:, plane])
                shapes[:, plane] = shapes[:, plane] @ (left @ right)
        return eigenvalues, self._motions.T @ shapes

    def error(self, modes_at: ModesAt) -> float:
        """Largest error of the table at a few points next to its own, near the ends among them.

        Of the lower half of the modes each has to be right. The highest avoid each other as the beam becomes thicker,
        and are then no smooth functions one by one; of them only the sum counts, in the receptance below them.
        """
        worst = 0.0
        for share in (0.03, 0.41, 0.97):
            point = np.array([low + share * (high - low) for low, high in self._ends])
            lam, rows = self._turned(modes_at, point.tolist())
            table_lam, table_rows = (rows_of_one[0] for rows_of_one in self(point[None]))
            lower = slice(0, -(-lam.size // 2))
            elastic = lam[lam > 0]
            scale = np.maximum(lam, elastic.min(initial=np.inf))
            size = np.abs(rows).max(axis=1, keepdims=True)
            size[size == 0] = 1.0  # a motion that is none: a port at the joint, with the joint's own motion taken out
            errors = [(np.abs(table_lam - lam) / scale)[lower], (np.abs(table_rows - rows) / size)[:, lower]]
            lowest = elastic.min(initial=np.inf)
            released = max(0.0, -2 * float(lam.min()))  # by compression
            for square in (lowest + released, max(lam[lower].max(), lowest) + released):
                # at ω² = −square, where it has no poles
                right, guess = (r / (e + square) @ r.T for e, r in ((lam, rows), (table_lam, table_rows)))
                root = np.sqrt(np.diag(right))
                root[root == 0] = 1.0
                errors.append((guess - right) / np.outer(root, root))
            worst = max(worst, *(float(np.abs(e).max(initial=0.0)) for e in errors))
        return worst


def tabulated(modes_at: ModesAt, motions: Array, ends: Ends) -> ModeTable | None:
    """The smallest table that is accurate enough, axis by axis and then as a whole; None if there is none."""
    each_once = cache(modes_at)  # tables of different size share points, those at which they are checked among them

    def remembered(numbers: Sequence[float]) -> tuple[Modes, Array]:
        return each_once(tuple(numbers))

    counts: list[int] = []
    for i in range(len(ends)):
        alone = [end if j == i else (0.0, 0.0) for j, end in enumerate(ends)]
        tried = [[n if j == i else 1 for j in range(len(ends))] for n in _NODES]
        errors: list[float] = []
        for n in tried:
            errors.append(ModeTable(remembered, motions, alone, n).error(remembered))
            if errors[-1] < _ACCURATE:
                counts.append(n[i])
                break
            if _hopeless(errors):
                return None
        else:
            return None
    if math.prod(counts) > _MOST_POINTS:
        return None
    table = ModeTable(remembered, motions, ends, counts)
    if not ends:  # nothing is interpolated
        return table
    return table if table.error(remembered) < 10 * _ACCURATE else None


def _hopeless(errors: Sequence[float]) -> bool:
    """Whether errors of tables of 4, 6, 8 … points fall so slowly that the largest will not be accurate by far.

    They fall geometrically with the number of points where modes are smooth, and not at all where modes change places
    or rounding is all that is left of them.
    """
    if len(errors) < _TRIED:
        return False
    first, last = errors[-_TRIED], errors[-1]
    done, left = _NODES[len(errors) - 1] - _NODES[len(errors) - _TRIED], _NODES[-1] - _NODES[len(errors) - 1]
    return not (last < first / 2 and last * (last / first) ** (left / done) < _FAR * _ACCURATE)


#: Powers in which quantities change a shape number.
Powers = Mapping[str, float]

#: Where no table is accurate enough for the modes that are wanted, those up to so many times the frequency are tried.
_FURTHER = 2.5


ModesOverShape = ModeTable | SolvedModes


def modes_over_shape(
    structure_at: StructureAt, nominal: Modes, ends: Ends, motions: Array, forced: Forced, reach_hz: float | None
) -> ModesOverShape:
    """Interpolated modes; where modes cross or meet, so that they cannot be, one solution for each row.

    Parameters
    ----------
    structure_at
        The body at shape numbers (axes,), assembled again; all are 0 at the nominal one.
    nominal
        Modes of the nominal one.
    ends
        Lower and upper end of each shape number.
    motions, forced
        See `jointbayes.structure.Body.free_modes`.
    reach_hz
        Frequency up to which modes are wanted, Hz; None wants them all.
    """
    if reach_hz is None:
        reductions = [Reduction(nominal.eigenvalues.size, motions)]
    else:
        # of a stubby body the vectors that stand for the modes above avoid each other there, and further up they do not
        reductions = [Reduction.below(hz, nominal, motions, forced) for hz in (reach_hz, _FURTHER * reach_hz)]
    for reduction in reductions:
        # the last terms are the least smooth over the ranges, and the least needed
        for terms in (reduction.terms, reduction.terms - 1):
            solved = SolvedModes(structure_at, replace(reduction, terms=terms))
            table = tabulated(solved.solve, motions, ends)
            if table is not None:
                return table
    return SolvedModes(structure_at, reductions[0])


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """Motions taken apart into translations and rotations, which similarity scales by different factors.

    Parameters
    ----------
    motions, forced
        As of `Body.free_modes`, one for each part, shapes (DOFs, parts) and (parts,).
    turned
        Which of them are rotations, shape (parts,).
    whole
        Which motion each is a part of, shape (parts,).
    """

    motions: Array
    forced: Forced
    turned: Flags
    whole: Indices

    def joined(self, rows: Array) -> Array:
        """Rows (n, parts, m) of the parts as those of the motions, shape (n, k, m)."""
        count = self.whole.max(initial=-1) + 1
        if len(self.whole) == count:
            return rows
        sums = (np.arange(count)[:, None] == self.whole).astype(float)
        return sums @ rows


def parts_of(dofs: Sequence[str], motions: Array, forced: Forced) -> Parts:
    """Take motions (DOFs, k) apart; those that are a translation or a rotation stay as they are."""
    rotation = np.array([":r" in dof for dof in dofs])
    turned: Flags = (motions[rotation] != 0).any(axis=0)
    mixed = turned & (motions[~rotation] != 0).any(axis=0)
    if not mixed.any():
        return Parts(motions, forced, turned, np.arange(len(turned)))
    whole = np.repeat(np.arange(len(turned)), 1 + mixed)
    second = np.concatenate([[False], whole[1:] == whole[:-1]])
    turned = turned[whole]
    turned[mixed[whole] & ~second] = False
    kept = np.where(mixed[whole], rotation[:, None] == turned, True)
    return Parts(motions[:, whole] * kept, None if forced is None else forced[whole], turned, whole)


def ends_of(powers: Iterable[Powers], range_of: Callable[[str], tuple[float, float]]) -> list[tuple[float, float]]:
    """Lower and upper end of each shape number, from the range of the logarithm of each quantity."""
    ends = []
    for of_one in powers:
        sides = [sorted(p * end for end in range_of(q)) for q, p in of_one.items()]
        ends.append((sum(side[0] for side in sides), sum(side[1] for side in sides)))
    return ends


def shape_numbers(powers: Iterable[Powers], factor_of: Callable[[str], Array], rows: int) -> Array:
    """Shape numbers, shape (rows, axes), from the factors on each quantity, shape (rows,)."""
    logs = [sum(p * np.log(factor_of(q)) for q, p in of_one.items()) for of_one in powers]
    return np.stack(logs, axis=-1) if logs else np.zeros((rows, 0))


def rising(eigenvalues: Array, motions: Array) -> tuple[Array, Array]:
    """Modes in rising order of their eigenvalues (n, m), their motions (n, k, m) with them."""
    if (np.diff(eigenvalues, axis=1) < 0).any():
        order = np.argsort(eigenvalues, axis=1)
        eigenvalues = np.take_along_axis(eigenvalues, order, axis=1)
        motions = np.take_along_axis(motions, order[:, None, :], axis=2)
    return eigenvalues, motions
