"""Modes of a body, and what is kept of them.

Modes above the band move almost as one static answer to the forces. That answer and its next terms in ω², taken from
all of them at once, stand for them as a handful of vectors (MacNeal 1971; Rubin 1975, with further terms), so that a
draw costs as much whatever the mesh.

References
----------
MacNeal, R. H. (1971). A hybrid method of component mode synthesis. Computers & Structures 1(4), 581-601.
DOI 10.1016/0045-7949(71)90031-9
Rubin, S. (1975). Improved component-mode representation for structural dynamic analysis. AIAA Journal 13(8), 995-1006.
DOI 10.2514/3.60497
"""

from dataclasses import dataclass

import numpy as np

from vibrecords.arrays import Array, Flags


@dataclass(frozen=True, slots=True)
class Modes:
    """Undamped modes in rising order of frequency, shapes normalised to unit modal mass.

    Parameters
    ----------
    eigenvalues
        ω², shape (m,), rad²/s².
    shapes
        Mode shapes, shape (DOFs, m), 1/√kg.
    """

    eigenvalues: Array
    shapes: Array

    @property
    def frequency_hz(self) -> Array:
        """Natural frequencies, shape (m,), Hz."""
        return np.sqrt(np.maximum(self.eigenvalues, 0.0)) / (2 * np.pi)


Forced = Flags | None
"""At which of some motions forces act; None for all."""

#: Modes up to this many times the highest frequency are kept one by one; where responses have no vectors, up to more.
_KEPT, _KEPT_OF_FORCES = 2.0, 3.0
#: Terms of the residual in ω²: static, and the first two beyond. With these less than 1e-10 of an FRF's peak is lost,
#: and little of the motion of a stiff joint itself, which is small beside its parts.
MOST_TERMS = 3
#: Of more motions than these only those at which forces act have vectors of their own: what many responses would add is
#: nearly what there is already, and rounding.
FEW_MOTIONS = 16
_TERMS_OF_FORCES = 2 * MOST_TERMS  # as exact: a vector at either end of an FRF counts for its power in ω²
#: A direction that holds less than this of a unit vector adds nothing but rounding.
_SAME = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Reduction:
    """What is kept of a structure's modes.

    Parameters
    ----------
    kept
        The first so many modes stay as they are.
    motions
        Where forces act and motion is observed, as forms on the DOFs, shape (DOFs, k).
    terms
        Terms of the residual for each of the forces.
    forced
        Those of the motions at which forces act, shape (DOFs, f); None takes all.
    """

    kept: int
    motions: Array
    terms: int = MOST_TERMS
    forced: Array | None = None

    @classmethod
    def below(cls, top_hz: float, modes: Modes, motions: Array, forced: Forced = None) -> "Reduction":
        """The reduction that serves up to a frequency in Hz, for a structure with these modes.

        With `forced`, shape (k,), no force acts at the other motions.
        """
        all_forced = forced is None or motions.shape[1] <= FEW_MOTIONS
        highest = (_KEPT if all_forced else _KEPT_OF_FORCES) * 2 * np.pi * top_hz
        kept = int(np.searchsorted(modes.eigenvalues, highest**2))
        return cls(kept, motions) if all_forced else cls(kept, motions, _TERMS_OF_FORCES, motions[:, forced])

    def reduce(self, modes: Modes, size: int | None = None) -> Modes:
        """The kept modes, and Ritz vectors that stand for all others: unit modal mass, rising, shapes (DOFs, m).

        Parameters
        ----------
        modes
            All modes of a structure.
        size
            How many to give, where structures are compared of which one has a vector more that is all but rounding.
        """
        above, shapes = modes.eigenvalues[self.kept :], modes.shapes[:, self.kept :]
        participation = (self.motions if self.forced is None else self.forced).T @ shapes
        participation = participation[np.abs(participation).max(axis=1, initial=0.0) > 0]
        if not len(participation):  # nothing ever moves or is seen to move the others
            kept = max(self.kept, 1)
            return Modes(modes.eigenvalues[:kept], modes.shapes[:, :kept])
        if self.terms * len(participation) >= above.size:
            return modes
        # Σ φ φᵀ/(λ − ω²) = Σ φ φᵀ/λ + ω² Σ φ φᵀ/λ² + …; powers relative to the lowest, so that all are numbers
        answers = np.hstack([(participation / (above / above[0]) ** (term + 1)).T for term in range(self.terms)])
        left, share, _ = np.linalg.svd(answers / np.linalg.norm(answers, axis=0), full_matrices=False)
        basis = left[:, share > _SAME * share[0]] if size is None else left[:, : size - self.kept]
        eigenvalues, turn = np.linalg.eigh((basis.T * above) @ basis)
        return Modes(
            np.concatenate([modes.eigenvalues[: self.kept], eigenvalues]),
            np.hstack([modes.shapes[:, : self.kept], shapes @ (basis @ turn)]),
        )
