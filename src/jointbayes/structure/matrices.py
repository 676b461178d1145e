"""A structure as matrices: stiffness, mass, damping law and DOF labels."""

import copy
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np
from scipy import linalg

from jointbayes.errors import ModelError, require
from jointbayes.structure.body import MOST_HELD, Body, Forced, FreeModes, Modes, Reduction, Rows
from jointbayes.structure.damping import DampingLaw, require_symmetric
from vibrecords.arrays import Array, ComplexArray
from vibrecords.errors import array_of

#: A motion is a rigid body's if its strain energy is no more than so many times the rounding of φᵀ|K|φ. In
#: rigid-body motions of beams, frames and chains it is at most 0.6 times as much, on the softest supports that were
#: tried thousands.
_RIGID = 30 * np.finfo(float).eps


_LINES_SOLVED = 20_000  # at most, line by line
_LARGER = 1e4  # of the shift, the most that is tried
_LINES_AT_ONCE = 512  # bounds the memory of one batch of dense matrices
_REFINEMENTS = 2
#: A DOF that moves less than this in a rigid-body mode, over its largest motion in any mode, moves by rounding.
_AT_REST = 1e-8


@dataclass(frozen=True, eq=False)
class ConstantModes:
    """Free modes that no factor changes: eigenvalues (1, m) and motions (1, k, m)."""

    eigenvalues: Array
    motions: Array

    def __call__(self, factors: Array) -> tuple[Array, Array]:
        """The same for all factors."""
        return self.eigenvalues, self.motions


@dataclass(frozen=True, repr=False)
class Structure(Body):
    """Linear structure without its joint, exactly known.

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
    #: A structure of so few DOFs is solved line by line, refined to the last bits; a larger one is summed over modes.
    most_solved: ClassVar[int] = 50
    #: Highest frequency that is wanted, Hz; None keeps every mode.
    _top_hz: float | None = field(default=None, init=False, compare=False)
    _every_mode: bool = field(default=False, init=False, compare=False)
    #: Its modes, once computed, for it and for what `at` makes of it.
    _solved: list[Modes] = field(default_factory=list, init=False, compare=False)

    def __post_init__(self) -> None:
        n = len(self.dofs)
        object.__setattr__(self, "dofs", tuple(self.dofs))
        if n == 0:
            raise ModelError("structure: found no DOF; expected at least one; give labels, and matrices of their size")
        if len(set(self.dofs)) != n:
            raise ModelError.of("structure", (), "found a DOF label twice", "each label once", "rename it")
        for name in ("stiffness", "mass"):
            matrix_given = getattr(self, name)
            # a copy, so that the caller's arrays stay writable; sparse ones are made dense
            dense = matrix_given.toarray() if hasattr(matrix_given, "toarray") else matrix_given
            matrix = array_of(dense, float, f"structure: {name}", ModelError)
            object.__setattr__(self, name, matrix)
            if matrix.shape != (n, n):
                found = f"found a {name} matrix of shape {matrix.shape} for {n} DOFs"
                remedy = "give one row and column per DOF label"
                raise ModelError.of("structure", (name,), found, f"({n}, {n})", remedy)
            if not np.isfinite(matrix).all():
                found = f"found NaN or infinity in the {name} matrix"
                raise ModelError.of("structure", (name,), found, "finite numbers", "correct them")
            require_symmetric(matrix, "structure", name, f"an unsymmetric {name} matrix")
            matrix.setflags(write=False)
        law = "a damping law, such as LossFactor(0.01) or ModalDamping((0.01,))"
        require(self.damping, DampingLaw, "structure: found as damping", law)
        viscous = self.damping.matrix
        if viscous is not None and len(viscous) != n:
            found = f"found a damping matrix of {len(viscous)} rows for {n} DOFs"
            raise ModelError.of("structure", ("damping",), found, str(n), "give one row and column per DOF label")

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the DOFs."""
        return self.dofs

    def position(self, label: str) -> tuple[float, float, float] | None:
        """Where a DOF is, m; None where that is not known."""
        return self.positions.get(label.rpartition(":")[0])

    def loaded(self, dofs: Iterable[str], mass: float) -> Self:
        """The structure with a mass in kg at the point of each of these DOFs that is a translation."""
        points = {label.rpartition(":")[0] for label in dofs if ":r" not in label}
        moving = [i for i, d in enumerate(self.dofs) if d.rpartition(":")[0] in points and ":r" not in d]
        forms = self.on_all_dofs(np.array(moving, dtype=np.intp), np.eye(len(moving)))
        return replace(self, mass=self.mass + mass * (forms @ forms.T)) if moving and mass else self

    def fixed(self, supports: Sequence[str]) -> "Structure":
        """Return the structure with the DOFs in `supports` held fixed (their rows and columns removed)."""
        if not supports:
            return self
        keep = np.setdiff1d(np.arange(self.n_dofs), self.index(tuple(supports)))
        stiffness, mass = (matrix[np.ix_(keep, keep)].copy() for matrix in (self.stiffness, self.mass))
        dofs = tuple(self.dofs[i] for i in keep)
        return replace(self, stiffness=stiffness, mass=mass, damping=self.damping.kept(keep), dofs=dofs)

    def modes(self, added_stiffness: Array | None = None) -> Modes:
        """All undamped modes, with `added_stiffness` (n, n) such as an assembled joint on top if given.

        Solved as (K + σM)⁻¹M, so that the low modes carry full relative accuracy: rounding is relative to the
        largest eigenvalue, and for Kφ = λMφ that is the highest mode, 10⁵ times and more above the first.
        """
        if added_stiffness is not None:
            return self._modes(added_stiffness)
        if not self._solved:
            self._solved.append(self._modes(None))
        return self._solved[0]

    def _modes(self, added_stiffness: Array | None) -> Modes:
        stiffness = self.stiffness if added_stiffness is None else self.stiffness + added_stiffness
        shift, last = self.shift, self.shift * _LARGER
        while True:
            try:
                inverse, shapes = linalg.eigh(self.mass, stiffness + shift * self.mass)
                break
            except linalg.LinAlgError:  # compression makes an eigenvalue more negative than that
                if shift > last:
                    raise
                shift *= 10
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
        eigenvalues[: low.shape[1]][np.abs(strain) <= _RIGID * cancelled] = 0.0
        return Modes(eigenvalues, shapes)

    @property
    def shift(self) -> float:
        """Shift σ, rad²/s², that makes K + σM positive definite and lies low among the eigenvalues.

        Eigenvalues λ found as 1/ν − σ carry an error near rounding × (λ + σ)²/σ, so that any σ among the modes
        of interest serves; max K_ii/M_ii is of the order of the highest eigenvalue.
        """
        highest = float((np.diag(self.stiffness) / np.diag(self.mass)).max())
        return 1e-5 * highest if highest > 0 else 1.0  # masses without springs: any will do

    def at(self, dofs: Iterable[str], top_hz: float) -> Self:
        """The same structure with the modes up to this frequency; its matrices are what they are."""
        return self if self._every_mode else self._like(top_hz, every_mode=False)

    def reference(self, *, solved: bool = True) -> Self:
        """The same structure, with all its modes if `solved`, for any frequency."""
        return self._like(None, every_mode=True) if solved else self

    def _like(self, top_hz: float | None, *, every_mode: bool) -> Self:
        same = copy.copy(self)
        object.__setattr__(same, "_top_hz", top_hz)
        object.__setattr__(same, "_every_mode", every_mode)
        return same

    def reach_hz(self, count: int) -> float:
        """A frequency above the first `count` natural frequencies, Hz."""
        frequency = self.modes().frequency_hz
        return float(frequency[min(count + MOST_HELD, frequency.size) - 1])

    def rigid_motions(self, dofs: Rows) -> Array:
        """Motions of DOFs in the rigid-body modes, see `Body`."""
        modes = self.modes()
        motions = self.on_all_dofs(dofs, np.eye(len(dofs))).T @ modes.shapes
        rigid = motions[:, modes.eigenvalues == 0.0]
        return np.where(np.abs(rigid) > _AT_REST * np.abs(motions).max(axis=1, keepdims=True), rigid, 0.0)

    def on_all_dofs(self, dofs: Rows, motions: Array) -> Array:
        """Motions given as forms on some DOFs, shape (p, k), as forms on all, shape (n, k)."""
        forms = np.zeros((self.n_dofs, motions.shape[1]))
        forms[dofs] = motions
        return forms

    def unit_forms(self, labels: Sequence[str]) -> Array:
        """Motions of labelled DOFs as forms on all, shape (n, len(labels))."""
        return self.on_all_dofs(self.index(labels), np.eye(len(labels)))

    def free_modes(self, dofs: Rows, motions: Array, forced: Forced = None) -> FreeModes:
        """Its modes, see `Body`."""
        modes, forms = self.modes(), self.on_all_dofs(dofs, motions)
        if self._top_hz is not None:
            modes = Reduction.below(self._top_hz, modes, forms, forced).reduce(modes)
        return ConstantModes(modes.eigenvalues[None], np.ascontiguousarray(forms.T @ modes.shapes)[None])

    def dampers(self) -> tuple[Array, Rows, Array]:
        """Dampers that a matrix C amounts to, see `Body`."""
        if self.damping.matrix is None:
            return super().dampers()
        values, vectors = np.linalg.eigh(self.damping.matrix)
        some = np.abs(values) > np.finfo(float).eps * np.abs(values).max(initial=0.0)
        strokes = vectors[:, some] * np.sqrt(np.abs(values[some]))
        return np.sign(values[some]), np.arange(self.n_dofs), strokes

    def solved_receptance(self, dofs: Rows, motions: Array, omega: Array) -> ComplexArray | None:
        """Solved line by line if it is small and lines are few, or no modes diagonalise its damping matrix."""
        law = self.damping
        small = self.n_dofs <= self.most_solved and omega.size <= _LINES_SOLVED
        if law.matrix is None and (law.of_assembled_modes or not small):
            return None
        forms = self.on_all_dofs(dofs, motions)
        return self.solve_lines(omega, forms, forms)

    def solve_lines(
        self,
        omega: Array,
        observed: Array,
        loads: Array,
        joint_stiffness: Array | None = None,
        joint_viscous: Array | float = 0.0,
        joint_hysteretic: Array | float = 0.0,
        rigid: int | None = None,
    ) -> ComplexArray:
        """oᵀZ⁻¹f at each line, shape (lines, motions, loads), for motions o (n, motions) and loads f (n, loads).

        A structure that is nearly free loses six of double precision's digits at low frequency, because K x nearly
        cancels. So K x is computed in extended precision, and what is left of the load is solved for twice more.

        Modal damping acts in the modes above the `rigid` lowest ones, by default above those at 0 Hz.

        Raises
        ------
        ModelError
            If a line is an undamped natural frequency.
        """
        # 1. the viscous matrix of the damping law
        added, law = np.zeros_like(self.stiffness) if joint_stiffness is None else joint_stiffness, self.damping
        if law.matrix is not None:
            viscous = law.matrix
        elif law.of_assembled_modes:  # C = MΦ diag(2ζω) ΦᵀM of the assembled structure
            modes = self.modes(added)
            first = int((modes.eigenvalues <= 0).sum()) if rigid is None else rigid  # a rigid-body motion has no ratio
            rate = np.zeros(self.n_dofs)
            rate[first:] = 2 * law.per_mode(self.n_dofs - first) * np.sqrt(np.maximum(modes.eigenvalues[first:], 0.0))
            weighted = self.mass @ modes.shapes
            viscous = (weighted * rate) @ weighted.T
        else:
            alpha, beta = law.viscous
            viscous = alpha * self.mass + beta * self.stiffness
        # 2. the lines, some at a time
        exact, viscous = self.stiffness.astype(np.longdouble), viscous + joint_viscous
        dynamic = added + 1j * joint_hysteretic if np.any(joint_hysteretic) else added
        loss = 1 + 1j * law.hysteretic
        parts = []
        for start in range(0, omega.size, _LINES_AT_ONCE):
            w = omega[start : start + _LINES_AT_ONCE, None, None]
            z = loss * self.stiffness + dynamic - w**2 * self.mass + 1j * w * viscous
            try:
                x = np.linalg.solve(z, loads.astype(complex)).astype(np.clongdouble)
                for _ in range(_REFINEMENTS):
                    elastic = loss * (exact @ x.real + 1j * (exact @ x.imag))
                    rounded = x.astype(complex)
                    others = dynamic @ rounded - w**2 * (self.mass @ rounded) + 1j * w * (viscous @ rounded)
                    x = x + np.linalg.solve(z, (loads - elastic - others).astype(complex))
            except np.linalg.LinAlgError:
                low, high = (f"{end / (2 * np.pi):g}" for end in (w.min(), w.max()))
                found = f"found an undamped natural frequency on a line between {low} and {high} Hz"
                remedy = "give the structure damping or move the lines"
                raise ModelError.of("FRF", (), found, "damping, or lines beside it", remedy) from None
            parts.append(observed.T @ x.astype(complex))
        return np.concatenate(parts)


StructureAt = Callable[[Sequence[float]], Structure]
"""A structure at numbers, assembled again."""


class SolvedModes:
    """Reduced modes over the shape numbers, one solution for each."""

    def __init__(self, structure_at: StructureAt, reduction: Reduction) -> None:
        self._structure_at, self._reduction = structure_at, reduction
        self._size: int | None = None

    def solve(self, numbers: Sequence[float]) -> tuple[Modes, Array]:
        """Modes and mass matrix at shape numbers (axes,)."""
        structure = self._structure_at(numbers)
        reduced = self._reduction.reduce(structure.modes(), self._size)
        self._size = reduced.eigenvalues.size  # as many at every other point
        return reduced, structure.mass

    def __call__(self, numbers: Array) -> tuple[Array, Array]:
        """Eigenvalues (n, m) and motions (n, k, m) at shape numbers (n, axes), one solution for each row.

        One for all where there are no axes.
        """
        solved = [self.solve(row.tolist())[0] for row in (numbers if numbers.shape[1] else np.empty((1, 0)))]
        motions = self._reduction.motions.T
        return np.stack([s.eigenvalues for s in solved]), np.stack([motions @ s.shapes for s in solved])
