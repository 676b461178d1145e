"""A structure as matrices: stiffness, mass, damping law and DOF labels; its modes, and what is kept of them.

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

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from jointbayes.arrays import Array
from jointbayes.errors import ModelError, array_of
from jointbayes.structure.damping import DampingLaw

#: A motion is a rigid body's if its strain energy is no more than so many times the rounding of φᵀ|K|φ. In
#: rigid-body motions of beams, frames and chains it is at most 0.6 times as much, on the softest supports that were
#: tried thousands.
_RIGID = 30 * np.finfo(float).eps


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


@dataclass(frozen=True, slots=True)
class Structure:
    """Linear structure without its joint.

    Parameters
    ----------
    stiffness, mass
        Symmetric real matrices, shape (n, n), SI units; lists and sparse matrices are copied into arrays.
    damping
        Damping law.
    dofs
        Labels of the n DOFs such as ``"11:y"`` (one-based node, direction).
    positions
        Place of points in m, by what stands before the colon of their labels, where it is known.

    Raises
    ------
    ModelError
        If shapes disagree, a matrix is not finite or not symmetric, or a label occurs twice.
    """

    stiffness: Array
    mass: Array
    damping: DampingLaw
    dofs: tuple[str, ...]
    positions: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n = len(self.dofs)
        object.__setattr__(self, "dofs", tuple(self.dofs))
        if n == 0:
            raise ModelError("structure: found no DOF; expected at least one; give labels, and matrices of their size")
        if len(set(self.dofs)) != n:
            raise ModelError("structure: found a DOF label twice; expected each label once; rename it")
        for name in ("stiffness", "mass"):
            matrix_given = getattr(self, name)
            # a copy, so that the caller's arrays stay writable; sparse ones are made dense
            dense = matrix_given.toarray() if hasattr(matrix_given, "toarray") else matrix_given
            matrix = array_of(dense, float, f"structure: {name}", ModelError)
            object.__setattr__(self, name, matrix)
            if matrix.shape != (n, n):
                raise ModelError(
                    f"structure: found a {name} matrix of shape {matrix.shape} for {n} DOFs; "
                    f"expected ({n}, {n}); give one row and column per DOF label"
                )
            if not np.isfinite(matrix).all():
                raise ModelError(f"structure: found NaN or infinity in the {name} matrix; expected finite numbers")
            scale = np.abs(matrix).max(initial=0.0)
            if np.abs(matrix - matrix.T).max(initial=0.0) > 1e-10 * scale:
                raise ModelError(f"structure: found an unsymmetric {name} matrix; expected a symmetric one")
            matrix.setflags(write=False)
        if not isinstance(self.damping, DampingLaw):
            raise ModelError(
                f"structure: found {self.damping!r} as damping; expected a damping law, such as LossFactor(0.01) or "
                "ModalDamping((0.01,))"
            )
        viscous = self.damping.matrix
        if viscous is not None and len(viscous) != n:
            raise ModelError(f"structure: found a damping matrix of {len(viscous)} rows for {n} DOFs; expected {n}")

    def __repr__(self) -> str:
        law = type(self.damping).__name__
        return f"Structure({self.n_dofs} DOFs, {self.dofs[0]} to {self.dofs[-1]}, {law})"

    @property
    def n_dofs(self) -> int:
        """Number of DOFs."""
        return len(self.dofs)

    def index(self, labels: Sequence[str]) -> NDArray[np.intp]:
        """Row numbers of DOF labels, shape (len(labels),).

        Raises
        ------
        ModelError
            If a label does not exist.
        """
        rows = {label: i for i, label in enumerate(self.dofs)}
        for label in labels:
            if label not in rows:
                raise ModelError(
                    f"structure: found DOF {label!r}; expected one of {self.dofs[0]!r} to {self.dofs[-1]!r} that is "
                    "not fixed by a support; correct the label"
                )
        return np.array([rows[label] for label in labels], dtype=np.intp)

    def position(self, label: str) -> tuple[float, float, float] | None:
        """Where a DOF is, m; None where that is not known."""
        return self.positions.get(label.rpartition(":")[0])

    def loaded(self, dofs: Iterable[str], mass: float) -> "Structure":
        """The structure with a mass in kg at the point of each of these DOFs that is a translation."""
        points = {label.rpartition(":")[0] for label in dofs if ":r" not in label}
        moving = [i for i, d in enumerate(self.dofs) if d.rpartition(":")[0] in points and ":r" not in d]
        if not (moving and mass):
            return self
        total = self.mass.copy()
        total[moving, moving] += mass
        return replace(self, mass=total)

    def fixed(self, supports: Sequence[str]) -> "Structure":
        """Return the structure with the DOFs in `supports` held fixed (their rows and columns removed)."""
        if not supports:
            return self
        gone = self.index(tuple(supports))
        keep = np.setdiff1d(np.arange(self.n_dofs), gone)
        return replace(
            self,
            stiffness=self.stiffness[np.ix_(keep, keep)].copy(),
            mass=self.mass[np.ix_(keep, keep)].copy(),
            damping=self.damping.kept(keep),
            dofs=tuple(self.dofs[i] for i in keep),
        )

    def modes(self, added_stiffness: Array | None = None) -> Modes:
        """All undamped modes, with `added_stiffness` (n, n) such as an assembled joint on top if given.

        Solved as (K + σM)⁻¹M, so that the low modes carry full relative accuracy: rounding is relative to the
        largest eigenvalue, and for Kφ = λMφ that is the highest mode, 10⁵ times and more above the first.
        """
        stiffness = self.stiffness if added_stiffness is None else self.stiffness + added_stiffness
        shift = mode_shift(self)
        inverse, shapes = linalg.eigh(self.mass, stiffness + shift * self.mass)
        inverse, shapes = inverse[::-1], shapes[:, ::-1]
        shapes = shapes / np.sqrt(inverse)
        # the highest are orthonormal to rounding over their small inverse eigenvalue; a Newton step makes them all so
        shapes = shapes @ (1.5 * np.eye(len(inverse)) - 0.5 * (shapes.T @ self.mass @ shapes))
        eigenvalues = 1 / inverse - shift
        # far below the shift the difference is all rounding; Rayleigh's quotient in extended precision is not
        low = shapes[:, eigenvalues < 0.1 * shift]
        exact = self.stiffness.astype(np.longdouble)
        exact = exact if added_stiffness is None else exact + added_stiffness
        strain = (low.T.astype(np.longdouble) @ exact * low.T).sum(axis=1)
        eigenvalues[: low.shape[1]] = strain / (low.T @ self.mass * low.T).sum(axis=1)
        cancelled = (np.abs(low.T) @ np.abs(stiffness) * np.abs(low.T)).sum(axis=1)
        eigenvalues[: low.shape[1]][strain <= _RIGID * cancelled] = 0.0
        return Modes(eigenvalues, shapes)


def mode_shift(structure: Structure) -> float:
    """Shift σ, rad²/s², that makes K + σM positive definite and lies low among the eigenvalues.

    Eigenvalues λ found as 1/ν − σ carry an error near rounding × (λ + σ)²/σ, so that any σ among the modes
    of interest serves; max K_ii/M_ii is of the order of the highest eigenvalue.
    """
    highest = float((np.diag(structure.stiffness) / np.diag(structure.mass)).max())
    return 1e-5 * highest if highest > 0 else 1.0  # masses without springs: any will do


Forced = NDArray[np.bool_] | None
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
