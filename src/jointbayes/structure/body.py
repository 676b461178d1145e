"""A body without its joints, as forward models, search, checks and report see it: by its motions, never by matrices.

And its modes, and what is kept of them. Modes above the band move almost as one static answer to the forces. That
answer and its next terms in ω², taken from all of them at once, stand for them as a handful of vectors (MacNeal 1971;
Rubin 1975, with further terms), so that a draw costs as much with any mesh.

References
----------
MacNeal, R. H. (1971). A hybrid method of component mode synthesis. Computers & Structures 1(4), 581-601.
DOI 10.1016/0045-7949(71)90031-9
Rubin, S. (1975). Improved component-mode representation for structural dynamic analysis. AIAA Journal 13(8), 995-1006.
DOI 10.2514/3.60497
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from inspect import get_annotations
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from jointbayes.errors import ModelError
from jointbayes.structure.damping import DampingLaw
from vibrecords.arrays import Array, ComplexArray, Flags, Indices


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
#: and little of the motion of a stiff joint itself, which is small next to its parts.
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


Rows = Indices
"""DOFs of a body by their indices, shape (p,)."""

#: DOFs that a joint may hold: each may lift every natural frequency to where the next one was.
MOST_HELD = 6


@dataclass(frozen=True, slots=True)
class Discretisation:
    """How a body is cut into elements: kind, see `jointbayes.structure.ElementKind`, number, highest order."""

    kind: str
    elements: int
    order: int


if TYPE_CHECKING:
    stated = property
else:

    class stated:  # noqa: N801 (a decorator)
        """A property that a dataclass may have as a field: it is no default, and an instance's own value wins."""

        def __init__(self, get: Callable[[Any], Any]) -> None:
            self._get, self.__doc__ = get, get.__doc__

        def __get__(self, instance: object | None, owner: type | None = None) -> Any:  # noqa: ANN401
            return self if instance is None else self._get(instance)


class FreeModes(Protocol):
    """Modes without the joint as functions of the factors, shape (n, q), on the body's uncertain quantities.

    An object that can be pickled, so that it can be sent to another process.
    """

    def __call__(self, factors: Array, /) -> tuple[Array, Array]:
        """Eigenvalues (n or 1, m), rad²/s², rising, and motions (n or 1, k, m) in modes of unit modal mass."""


class Body(ABC):
    """A body without its joints, or several that nothing but joints holds together.

    It is asked how its DOFs move, by their indices, and never for matrices, so that it may have any number of DOFs. A
    kind of body has `labels`, `damping`, `reach_hz`, `rigid_motions` and `free_modes`; the rest has defaults, those of
    a body that is exactly known. Factors multiply its uncertain quantities `names`, shape (n, q).
    """

    if TYPE_CHECKING:  # a property would be taken for the default value of a field

        @property
        def damping(self) -> DampingLaw:
            """Damping law, at all factors 1."""

    def __init_subclass__(cls, **options: Any) -> None:  # noqa: ANN401 (of other bases)
        """Let what is `stated` be a field without a default, wherever it stands among the fields of a dataclass."""
        super().__init_subclass__(**options)
        for name in get_annotations(cls):
            if name not in cls.__dict__ and isinstance(getattr(cls, name, None), stated):
                setattr(cls, name, field())

    def __repr__(self) -> str:
        law = type(self.damping).__name__
        return f"{type(self).__name__}({self.n_dofs} DOFs, {self.labels[0]} to {self.labels[-1]}, {law})"

    @stated
    def labels(self) -> Sequence[str]:
        """Labels of its DOFs such as ``"11:y"``; of many a sequence that makes them when they are asked for."""
        raise NotImplementedError(f"{type(self).__name__} has no labels of its DOFs")

    @abstractmethod
    def reach_hz(self, count: int) -> float:
        """A frequency above the first `count` natural frequencies with any six DOFs held, Hz.

        That of the body's own mode number `count` + 6, rigid-body modes, which are at 0 Hz, counted with the others: a
        solid that floats has six, so that of it `reach_hz(3)` is above its third elastic mode.
        """

    @abstractmethod
    def rigid_motions(self, dofs: Rows) -> Array:
        """Motions of DOFs in its rigid-body modes, shape (p, rigid), exactly 0 where a DOF does not move."""

    @abstractmethod
    def free_modes(self, dofs: Rows, motions: Array, forced: Forced = None) -> FreeModes:
        """Modes without the joint with k motions, given as forms on DOFs, shape (p, k).

        Below the frequency of `at` they are the modes, eigenvalues of rigid-body ones exactly 0. Those above are
        replaced by the few that carry their answer, static and to the first powers of ω², to forces at these motions,
        or at those that are `forced`, shape (k,): see `Reduction`.
        """

    @property
    def n_dofs(self) -> int:
        """Number of DOFs."""
        return len(self.labels)

    def index(self, labels: Sequence[str]) -> Rows:
        """Indices of DOFs by their labels, shape (len(labels),).

        Raises
        ------
        ModelError
            If a label does not exist.
        """
        rows = []
        for label in labels:
            try:
                rows.append(self.labels.index(label))
            except ValueError:
                expected = f"one of {self.labels[0]!r} to {self.labels[-1]!r} that is not fixed by a support"
                raise ModelError.of("structure", (), f"found DOF {label!r}", expected, "correct the label") from None
        return np.array(rows, dtype=np.intp)

    def position(self, label: str) -> tuple[float, float, float] | None:
        """Where a DOF is, m; None where that is not known."""
        return None

    @stated
    def names(self) -> tuple[str, ...]:
        """The q uncertain quantities."""
        return ()

    @property
    def discretisation(self) -> Discretisation | None:
        """Elements; None where there are none, or they are what they are."""
        return None

    def at(self, dofs: Iterable[str], top_hz: float) -> "Body":
        """The same body, exact at these DOFs up to this frequency; it has them among its own."""
        return self

    def reference(self, *, solved: bool = True) -> "Body":
        """The same body on a much richer mesh: what others are compared with.

        `solved` again for each row of factors, with every mode kept, far slower; or interpolated and reduced as ever.
        """
        return self

    def solved_anew(self) -> "Body":
        """The same body for few rows of factors: solved for each in place of a table over what is uncertain."""
        return self

    def certain(self) -> "Body":
        """The same body at all factors 1, with nothing uncertain and every mode that there is."""
        return self

    def with_certain_damping(self, factors: Mapping[str, float]) -> "Body":
        """The same body without the uncertain quantities of its damping: they move no natural frequency.

        They are held at these factors, by name, 1 where none is given.
        """
        return self

    @property
    def shift(self) -> float:
        """Shift σ, rad²/s², for assembled eigenvalues 1/ν − σ; they have the error of rounding × (λ + σ)²/σ."""
        return (2 * np.pi * self.reach_hz(1)) ** 2

    def damping_ratios(self, factors: Array, count: int) -> Array:
        """Damping ratio of each of the first `count` modes, shape (n or 1, count), for modal damping."""
        return self.damping.per_mode(count)[None]

    def loss_factors(self, factors: Array) -> Array:
        """Loss factor, shape (n or 1,), for structural damping."""
        return np.array([self.damping.hysteretic])

    def own_stiffness(self, row: str, column: str) -> float:
        """Stiffness by itself where two DOFs of a point are, N/m or N·m/rad: what default priors are relative to.

        Here the stiffness of a static deformation, without rigid-body motion, by a force at each; 0 if nothing deforms.
        """
        sizes = []
        for label in (row, column):
            eigenvalues, motions = self.certain().free_modes(self.index((label,)), np.eye(1))(np.empty((1, 0)))
            elastic = eigenvalues[0] > 0
            flexibility = float((motions[0, 0, elastic] ** 2 / eigenvalues[0, elastic]).sum())
            sizes.append(1 / flexibility if flexibility else 0.0)
        return float(np.sqrt(np.prod(sizes)))

    def own_inertia(self, label: str) -> float:
        """Mass, kg, or moment of inertia, kg·m², that a spring at a DOF moves where nothing else holds the body."""
        moved = float((self.rigid_motions(self.index((label,))) ** 2).sum())
        return 1 / moved if moved else np.inf

    def dampers(self) -> tuple[Array, Rows, Array]:
        """Dampers, C = Σ ± form formᵀ, where no law states them: signs (d,), DOFs (p,), forms of the strokes (p, d)."""
        return np.empty(0), np.empty(0, dtype=np.intp), np.empty((0, 0))

    def solved_receptance(self, dofs: Rows, motions: Array, omega: Array) -> ComplexArray | None:
        """Receptance between motions (p, k) without a sum over modes, shape (lines, k, k); None to sum over modes."""
        return None
