"""Structures that differ by factors on some of their quantities, as the forward models see them."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, Self

import numpy as np

from jointbayes.arrays import Array
from jointbayes.structure.matrices import Forced, Modes, Reduction, Structure

#: DOFs that a joint may hold: each may lift every natural frequency to where the next one was.
MOST_HELD = 6


@dataclass(frozen=True, slots=True)
class Discretisation:
    """How a structure is cut into elements: kind, see `jointbayes.structure.ElementKind`, number, highest order."""

    kind: str
    elements: int
    order: int


class FreeModes(Protocol):
    """Modes without the joint as functions of the factors, shape (n, q), on the family's quantities."""

    def __call__(self, factors: Array) -> tuple[Array, Array]:
        """Eigenvalues (n or 1, m), rad²/s², and motions (n or 1, k, m) in modes of unit modal mass."""
        ...


class StructureFamily(Protocol):
    """Structures that differ by factors on some of their quantities."""

    @property
    def names(self) -> tuple[str, ...]:
        """The q quantities."""
        ...

    @property
    def nominal(self) -> Structure:
        """Structure at all factors 1."""
        ...

    @property
    def discretisation(self) -> Discretisation | None:
        """Elements; None where matrices are given."""
        ...

    def at(self, dofs: Iterable[str], top_hz: float) -> "StructureFamily":
        """The same structures, exact at these DOFs up to this frequency; `nominal` has them among its DOFs."""
        ...

    def reference(self, *, solved: bool = True) -> "StructureFamily":
        """The same structures on a much richer mesh: what others are compared with.

        `solved` anew for each row of factors, with every mode kept, far slower; or interpolated and reduced as ever.
        """
        ...

    def reach_hz(self, count: int) -> float:
        """A frequency above the first `count` natural frequencies, whatever holds at most six DOFs, Hz."""
        ...

    def structure(self, factors: Array) -> Structure:
        """Structure at factors (q,), assembled anew."""
        ...

    def free_modes(self, motions: Array, forced: Forced = None) -> FreeModes:
        """Modes without the joint with k motions, given as forms on the DOFs of `nominal`, shape (DOFs, k).

        Below the frequency of `at` they are the modes; those above are replaced by the few that carry their answer to
        forces at these motions, or at those that are `forced`, shape (k,).
        """
        ...

    def damping_ratios(self, factors: Array) -> Array:
        """Damping ratio of every mode, shape (n or 1, m), for modal damping."""
        ...

    def loss_factors(self, factors: Array) -> Array:
        """Loss factor, shape (n or 1,), for structural damping."""
        ...

    def frequency_factors(self, factors: Array) -> Array:
        """True over predicted natural frequency of the first modes of the assembled structure, shape (n or 1, c)."""
        ...


class _Constant:
    """Free modes that no factor changes."""

    def __init__(self, eigenvalues: Array, motions: Array) -> None:
        self._found = eigenvalues[None], np.ascontiguousarray(motions)[None]

    def __call__(self, factors: Array) -> tuple[Array, Array]:
        return self._found


class _Solved:
    """A structure whose modes are computed once, for all forward models that are made of it."""

    def __init__(self, structure: Structure) -> None:
        self._structure = structure

    @cached_property
    def modes(self) -> Modes:
        return self._structure.modes()


class FixedFamily:
    """The family of one: a structure that is exactly known, given by its matrices.

    Parameters
    ----------
    structure
        The structure.
    top_hz
        Highest frequency that is wanted, Hz; None keeps every mode.
    """

    names: tuple[str, ...] = ()
    discretisation: Discretisation | None = None

    def __init__(self, structure: Structure, top_hz: float | None = None) -> None:
        self.nominal, self._top_hz = structure, top_hz
        self._solved = _Solved(structure)

    def __repr__(self) -> str:
        return repr(self.nominal)

    def at(self, dofs: Iterable[str], top_hz: float) -> Self:
        """The same structure; its matrices are what they are."""
        same = type(self)(self.nominal, top_hz)
        same._solved = self._solved
        return same

    def reference(self, *, solved: bool = True) -> "FixedFamily":
        """The same structure, with all its modes if `solved`."""
        return _Unreduced(self.nominal) if solved else self

    def reach_hz(self, count: int) -> float:
        """A frequency above the first `count` natural frequencies, Hz."""
        frequency = self._solved.modes.frequency_hz
        return float(frequency[min(count + MOST_HELD, frequency.size) - 1])

    def structure(self, factors: Array) -> Structure:
        """The structure, whatever the factors."""
        return self.nominal

    def free_modes(self, motions: Array, forced: Forced = None) -> FreeModes:
        """Its modes, whatever the factors."""
        modes = self._solved.modes
        if self._top_hz is None:
            return _Constant(modes.eigenvalues, motions.T @ modes.shapes)
        reduced = Reduction.below(self._top_hz, modes, motions, forced).of(modes)
        return _Constant(reduced.eigenvalues, motions.T @ reduced.shapes)

    def damping_ratios(self, factors: Array) -> Array:
        """Damping ratio of every mode, shape (1, m)."""
        return self.nominal.damping.per_mode(self.nominal.n_dofs)[None]

    def loss_factors(self, factors: Array) -> Array:
        """Loss factor, shape (1,)."""
        return np.array([self.nominal.damping.hysteretic])

    def frequency_factors(self, factors: Array) -> Array:
        """No mode is off: shape (1, 0)."""
        return np.empty((1, 0))


class _Unreduced(FixedFamily):
    """A structure of which every mode is kept, whatever frequency is wanted."""

    def at(self, dofs: Iterable[str], top_hz: float) -> Self:
        """The same structure with all its modes."""
        return self


def as_family(structure: "Structure | StructureFamily") -> StructureFamily:
    """A structure as the family of one; a family as it is."""
    return FixedFamily(structure) if isinstance(structure, Structure) else structure
