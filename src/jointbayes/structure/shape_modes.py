"""Free modes over the few numbers that change them by more than factors, and from these at all quantities.

E, ρ and size change the modes of a body by similarity, that is by factors. Over what is left, such as slenderness or an
accelerometer's mass beside the body's, the modes and the few vectors that stand for those above the band
(`jointbayes.structure.reduction`) are interpolated between Chebyshev points, at which the body is assembled and solved.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.structure.matrices import Modes, Structure
from jointbayes.structure.mode_table import Ends, ModeTable, tabulated
from jointbayes.structure.reduction import Forced, Reduction

#: Powers in which quantities change a shape number.
Powers = Mapping[str, float]
StructureAt = Callable[[Sequence[float]], Structure]

#: Of more modes than these no table is accurate enough: rounding in the highest is all that is left.
_MOST_TABULATED = 60
#: Where no table is accurate enough for the modes that are wanted, those up to so many times the frequency are tried.
_FURTHER = 2.5


class SolvedModes:
    """Reduced modes over the shape numbers, one solution for each."""

    def __init__(self, structure_at: StructureAt, reduction: Reduction) -> None:
        self._structure_at, self._reduction = structure_at, reduction
        self._size: int | None = None

    def at(self, numbers: Sequence[float]) -> tuple[Modes, Array]:
        """Modes and mass matrix at shape numbers (axes,)."""
        structure = self._structure_at(numbers)
        found = self._reduction.of(structure.modes(), self._size)
        self._size = found.eigenvalues.size  # as many at every other point
        return found, structure.mass

    def __call__(self, numbers: Array) -> tuple[Array, Array]:
        """Eigenvalues (n, m) and motions (n, k, m) at shape numbers (n, axes), one solution for each row."""
        solved = [self.at(row.tolist())[0] for row in numbers]
        motions = self._reduction.motions.T
        return np.stack([s.eigenvalues for s in solved]), np.stack([motions @ s.shapes for s in solved])


ModesOverShape = ModeTable | SolvedModes


def modes_over_shape(
    structure_at: StructureAt, nominal: Modes, ends: Ends, motions: Array, forced: Forced, reach_hz: float | None
) -> ModesOverShape:
    """Interpolated modes; where modes cross or meet, so that they cannot be, one solution for each row.

    Parameters
    ----------
    structure_at
        The body at shape numbers (axes,), assembled anew; all are 0 at the nominal one.
    nominal
        Modes of the nominal one.
    ends
        Lower and upper end of each shape number.
    motions, forced
        See `jointbayes.structure.StructureFamily.free_modes`.
    reach_hz
        Frequency up to which modes are wanted, Hz; None wants them all.
    """
    if reach_hz is None:
        reductions = [Reduction(nominal.eigenvalues.size, motions)]
    else:
        # of a stubby body the vectors that stand for the modes above avoid each other there, and further up they do not
        reductions = [Reduction.below(hz, nominal, motions, forced) for hz in (reach_hz, _FURTHER * reach_hz)]
        if ends and reductions[0].kept > _MOST_TABULATED:
            return SolvedModes(structure_at, reductions[0])
        reductions = [one for one in reductions if one is reductions[0] or one.kept <= _MOST_TABULATED]
    for reduction in reductions:
        # the last terms are the least smooth over the ranges, and the least needed
        for terms in (reduction.terms, reduction.terms - 1):
            solved = SolvedModes(structure_at, replace(reduction, terms=terms))
            table = tabulated(solved.at, motions, ends)
            if table is not None:
                return table
    return SolvedModes(structure_at, reductions[0])


@dataclass(frozen=True, slots=True, eq=False)
class Parts:
    """Motions taken apart into translations and rotations, which similarity scales by different factors.

    Parameters
    ----------
    motions, forced
        As of `StructureFamily.free_modes`, one for each part, shapes (DOFs, parts) and (parts,).
    turned
        Which of them are rotations, shape (parts,).
    whole
        Which motion each is a part of, shape (parts,).
    """

    motions: Array
    forced: Forced
    turned: NDArray[np.bool_]
    whole: NDArray[np.intp]

    def joined(self, rows: Array) -> Array:
        """Rows (n, parts, m) of the parts as those of the motions, shape (n, k, m)."""
        if len(self.whole) == self.whole[-1] + 1:
            return rows
        sums = (np.arange(self.whole[-1] + 1)[:, None] == self.whole).astype(float)
        joined: Array = sums @ rows
        return joined


def parts_of(dofs: Sequence[str], motions: Array, forced: Forced) -> Parts:
    """Take motions (DOFs, k) apart; those that are a translation or a rotation stay as they are."""
    rotation = np.array([":r" in dof for dof in dofs])
    turned: NDArray[np.bool_] = (motions[rotation] != 0).any(axis=0)
    mixed = turned & (motions[~rotation] != 0).any(axis=0)
    if not mixed.any():
        return Parts(motions, forced, turned, np.arange(len(turned)))
    whole = np.repeat(np.arange(len(turned)), 1 + mixed)
    second = np.concatenate([[False], whole[1:] == whole[:-1]])
    turned = turned[whole]
    turned[mixed[whole] & ~second] = False
    kept = np.where(mixed[whole], rotation[:, None] == turned, True)
    return Parts(motions[:, whole] * kept, None if forced is None else forced[whole], turned, whole)


@dataclass(frozen=True, slots=True, eq=False)
class Similarity:
    """What takes the modes of a body at its shape numbers to those at its quantities.

    Parameters
    ----------
    numbers
        Shape numbers, shape (n, axes).
    stiffness, density, size
        Factors on E, on ρ and on all lengths alike, shape (n,).
    """

    numbers: Array
    stiffness: Array
    density: Array
    size: Array

    def scaled(self, modes: ModesOverShape, turned: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Eigenvalues (n, m), rising, and motions (n, k, m), of which some are rotations: `turned`, shape (k,)."""
        eigenvalues, motions = modes(self.numbers)
        size, density = self.size, self.density
        eigenvalues = eigenvalues * (self.stiffness / (density * size**2))[:, None]
        unit = 1 / np.sqrt(density * size**3)
        scale = np.where(turned, (unit / size)[:, None], unit[:, None])
        return rising(eigenvalues, motions * scale[:, :, None])


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
