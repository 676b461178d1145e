"""Free modes of a structure whose quantities are uncertain, for many values of them at once.

E, ρ and size change the modes of a beam by similarity, that is by factors. What is left are at most three numbers:
slenderness, shear coefficient, and the accelerometer's mass beside the beam's. Over these the modes are interpolated
between Chebyshev points at which the beam is assembled and solved; the interpolation is checked where it is made.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from jointbayes.errors import ModelError
from jointbayes.structure.assembled import Modes, Structure
from jointbayes.structure.damping import LossFactor, ModalDamping
from jointbayes.structure.recipe import BeamRecipe, is_damping_ratio

__all__ = ["BeamFamily", "FixedFamily", "FreeModes", "StructureFamily", "as_family"]

Array = NDArray[np.float64]

_NODES = (4, 6, 8, 11, 15, 20, 27, 36)
_MOST_POINTS = 1000  # beyond, tabulating costs more than it gains
_ACCURATE = 1e-8  # of the interpolation, relative to each eigenvalue and to the largest motion in any mode
_SAME_PLANE = 1e-6  # eigenvalues closer than this (relative) share a plane in which any basis is as good


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

    def structure(self, factors: Array) -> Structure:
        """Structure at factors (q,), assembled anew."""
        ...

    def free_modes(self, motions: Array) -> FreeModes:
        """Modes without the joint with k motions, given as forms on the DOFs, shape (DOFs, k)."""
        ...

    def damping_ratios(self, factors: Array) -> Array:
        """Damping ratio of every mode, shape (n or 1, m), for modal damping."""
        ...

    def loss_factors(self, factors: Array) -> Array:
        """Loss factor, shape (n or 1,), for structural damping."""
        ...


class FixedFamily:
    """The family of one: a structure that is exactly known."""

    names: tuple[str, ...] = ()

    def __init__(self, structure: Structure) -> None:
        self.nominal = structure

    def structure(self, factors: Array) -> Structure:
        """The structure, whatever the factors."""
        return self.nominal

    def free_modes(self, motions: Array) -> FreeModes:
        """Its modes, whatever the factors."""
        modes = self.nominal.modes()
        found = modes.eigenvalues[None], np.ascontiguousarray((modes.shapes.T @ motions).T)[None]
        return lambda factors: found

    def damping_ratios(self, factors: Array) -> Array:
        """Damping ratio of every mode, shape (1, m)."""
        return _ratios(self.nominal)[None]

    def loss_factors(self, factors: Array) -> Array:
        """Loss factor, shape (1,)."""
        law = self.nominal.damping
        return np.array([law.loss_factor if isinstance(law, LossFactor) else 0.0])


class BeamFamily:
    """Beams whose quantities are uncertain.

    Parameters
    ----------
    recipe
        The beam at its nominal quantities.
    ranges
        Smallest and largest logarithm of the factor by quantity, see `STRUCTURE_QUANTITIES`; outside these
        the modes are not defined.

    Raises
    ------
    ModelError
        If a quantity is unknown or does not belong to the damping law.
    """

    def __init__(self, recipe: BeamRecipe, ranges: Mapping[str, tuple[float, float]]) -> None:
        self.recipe, self._ranges = recipe, dict(ranges)
        self.names = tuple(self._ranges)
        self.nominal = recipe.structure(dict.fromkeys(self.names, 1.0))
        self._at = {name: i for i, name in enumerate(self.names)}
        law = recipe.damping
        for name in self.names:
            of_other_law = is_damping_ratio(name) and not isinstance(law, ModalDamping)
            if of_other_law or (name == "loss_factor" and not isinstance(law, LossFactor)):
                raise ModelError(
                    f"uncertain beam: found {name!r} with a damping law of another kind; expected damping_ratio for "
                    "modal damping or loss_factor for structural damping; remove it or change the law"
                )
        self._axes = _ShapeAxes(recipe, self._ranges)
        self._table: _ModeTable | None = None
        self._tabulated = False

    def structure(self, factors: Array) -> Structure:
        """Beam at factors (q,), assembled anew."""
        given = np.asarray(factors, dtype=float)
        return self.recipe.structure(dict(zip(self.names, given.tolist(), strict=True))) if given.size else self.nominal

    def free_modes(self, motions: Array) -> FreeModes:
        """Interpolated modes; where modes cross or meet, so that they cannot be, one solution for each row."""
        if not self._tabulated:
            self._table, self._tabulated = _tabulated(self), True
        if self._table is None:
            return _SolvedModes(self, motions)
        return _ScaledModes(self, self._table, motions)

    def damping_ratios(self, factors: Array) -> Array:
        """Damping ratio of every mode, shape (n, m)."""
        law = self.recipe.damping
        listed = len(law.ratios) if isinstance(law, ModalDamping) else 1
        ratios = np.repeat(_ratios(self.nominal)[None], len(factors), axis=0)
        ratios *= self.factor(factors, "damping_ratio")[:, None]
        for i in range(listed):
            # the last one holds for all higher modes
            ratios[:, i : None if i == listed - 1 else i + 1] *= self.factor(factors, f"damping_ratio_{i + 1}")[:, None]
        return ratios

    def loss_factors(self, factors: Array) -> Array:
        """Loss factor, shape (n,)."""
        law = self.recipe.damping
        nominal = law.loss_factor if isinstance(law, LossFactor) else 0.0
        return nominal * self.factor(factors, "loss_factor")

    def factor(self, factors: Array, name: str) -> Array:
        """Factor on one quantity, shape (n,); ones where it is certain, or no factors are given."""
        known = name in self._at and factors.shape[1] > 0
        return factors[:, self._at[name]] if known else np.ones(len(factors))

    def shape_numbers(self, factors: Array) -> Array:
        """Logarithms of the numbers that change the modes by more than factors, shape (n, axes)."""
        return self._axes.numbers(self, factors)


class _ShapeAxes:
    """The numbers that similarity leaves: ln of slenderness, shear coefficient and relative accelerometer mass."""

    def __init__(self, recipe: BeamRecipe, ranges: Mapping[str, tuple[float, float]]) -> None:
        exponents = {
            "section_size": {"section_size": 1.0, "length": -1.0},
            "shear_coefficient": {"shear_coefficient": 1.0},
        }
        if recipe.accelerometer_mass > 0 and recipe.accelerometer_dofs:
            # the mass beside that of the beam, ρ d² L
            exponents["accelerometer_mass"] = {
                "accelerometer_mass": 1.0, "density": -1.0, "section_size": -2.0, "length": -1.0
            }  # fmt: skip
        self.names: list[str] = []
        self.ends: list[tuple[float, float]] = []
        self._powers: list[dict[str, float]] = []
        for name, powers in exponents.items():
            known = {q: p for q, p in powers.items() if q in ranges}
            if not known:
                continue
            sides = [sorted((p * ranges[q][0], p * ranges[q][1])) for q, p in known.items()]
            self.names.append(name)
            self.ends.append((sum(s[0] for s in sides), sum(s[1] for s in sides)))
            self._powers.append(known)

    def numbers(self, family: BeamFamily, factors: Array) -> Array:
        logs = [sum(p * np.log(family.factor(factors, q)) for q, p in powers.items()) for powers in self._powers]
        return np.stack(logs, axis=-1) if logs else np.zeros((len(factors), 0))


class _ModeTable:
    """Modes of the beam of nominal length, E and ρ over the shape numbers: polynomials through tensor points."""

    def __init__(self, family: BeamFamily, ends: Sequence[tuple[float, float]], counts: Sequence[int]) -> None:
        self._nodes = [_chebyshev(low, high, n) for (low, high), n in zip(ends, counts, strict=True)]
        self._weights = [(-1.0) ** np.arange(n) * np.sin((np.arange(n) + 0.5) * np.pi / n) for n in counts]
        nominal = family.nominal.modes()
        solved = [_solved(family, point, nominal) for point in itertools.product(*self._nodes)]
        self.eigenvalues = np.stack([modes.eigenvalues for modes in solved])
        self.shapes = np.stack([modes.shapes for modes in solved])

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


def _chebyshev(low: float, high: float, n: int) -> Array:
    nodes: Array = (low + high) / 2 + (high - low) / 2 * np.cos((np.arange(n) + 0.5) * np.pi / n)
    return nodes


def _solved(family: BeamFamily, numbers: Sequence[float], nominal: Modes) -> Modes:
    """Modes at shape numbers in the order of their nominal counterparts, each turned to lie as its own does."""
    factors = dict(zip(family._axes.names, np.exp(numbers).tolist(), strict=True))
    if "accelerometer_mass" in factors:  # here the section's size changes the beam's mass, and the ratio is wanted
        factors["accelerometer_mass"] *= factors.get("section_size", 1.0) ** 2
    structure = family.recipe.structure(factors)
    modes = structure.modes()
    # modes of different symmetry cross as the beam becomes thicker: each is known by its shape, not by its number
    overlap = np.abs(modes.shapes.T @ structure.mass @ nominal.shapes)
    _, number = optimize.linear_sum_assignment(-overlap.T)
    eigenvalues, shapes = modes.eigenvalues[number], modes.shapes[:, number]
    for plane in _planes(nominal.eigenvalues):
        # the rotation within the plane that brings the shapes nearest to the nominal ones; a sign for one mode
        left, _, right = np.linalg.svd(shapes[:, plane].T @ structure.mass @ nominal.shapes[:, plane])
        shapes[:, plane] = shapes[:, plane] @ (left @ right)
    return Modes(eigenvalues, shapes)


def _planes(eigenvalues: Array) -> list[slice]:
    """Runs of modes with equal eigenvalues."""
    apart = np.diff(eigenvalues) > _SAME_PLANE * eigenvalues[1:]
    cuts = [0, *(np.flatnonzero(apart) + 1).tolist(), eigenvalues.size]
    return [slice(a, b) for a, b in itertools.pairwise(cuts)]


def _tabulated(family: BeamFamily) -> _ModeTable | None:
    """The smallest table that is accurate enough, axis by axis and then as a whole; None if there is none."""
    ends = family._axes.ends
    counts: list[int] = []
    for i in range(len(ends)):
        alone = [end if j == i else (0.0, 0.0) for j, end in enumerate(ends)]
        enough = (n for n in _NODES if _accurate(family, alone, [n if j == i else 1 for j in range(len(ends))]))
        found = next(enough, None)
        if found is None:
            return None
        counts.append(found)
    if math.prod(counts) > _MOST_POINTS:
        return None
    table = _ModeTable(family, ends, counts)
    return table if _error(family, table, ends) < 10 * _ACCURATE else None


def _accurate(family: BeamFamily, ends: Sequence[tuple[float, float]], counts: Sequence[int]) -> bool:
    return _error(family, _ModeTable(family, ends, counts), ends) < _ACCURATE


def _error(family: BeamFamily, table: _ModeTable, ends: Sequence[tuple[float, float]]) -> float:
    """Largest error of the table at a few points beside its own, near the ends among them.

    Of the lower half of the modes each has to be right. The highest avoid each other as the beam becomes thicker, and
    are then no smooth functions one by one; of them only the sum counts, in the receptance below them.
    """
    nominal, worst = family.nominal.modes(), 0.0
    for share in (0.03, 0.41, 0.97):
        point = np.array([low + share * (high - low) for low, high in ends])
        exact = _solved(family, point.tolist(), nominal)
        weights = table.coefficients(point[None])[0]
        found = Modes(weights @ table.eigenvalues, np.tensordot(weights, table.shapes, 1))
        lam = exact.eigenvalues
        lower = slice(0, -(-lam.size // 2))
        elastic = lam[lam > 0]
        scale = np.maximum(lam, elastic.min(initial=np.inf))
        size = np.abs(exact.shapes).max(axis=1, keepdims=True)
        errors = [
            (np.abs(found.eigenvalues - lam) / scale)[lower],
            (np.abs(found.shapes - exact.shapes) / size)[:, lower],
        ]
        for square in (elastic.min(initial=np.inf), lam[lower].max()):
            # at ω² = −square, where it has no poles
            right, guess = (m.shapes / (m.eigenvalues + square) @ m.shapes.T for m in (exact, found))
            root = np.sqrt(np.diag(right))
            errors.append((guess - right) / np.outer(root, root))
        worst = max(worst, *(float(np.abs(e).max()) for e in errors))
    return worst


class _ScaledModes:
    """Motions in the free modes by interpolation and similarity."""

    def __init__(self, family: BeamFamily, table: _ModeTable, motions: Array) -> None:
        self._family, self._table = family, table
        rotation = np.array([":r" in dof for dof in family.nominal.dofs])
        turned, moved = (motions[rotation] != 0).any(axis=0), (motions[~rotation] != 0).any(axis=0)
        if (turned & moved).any():
            raise ModelError("uncertain beam: found a motion that mixes translation and rotation; expected one of them")
        self._turned = turned
        rows = np.einsum("pdm,dk->pkm", table.shapes, motions)
        self._shape = rows.shape[1:]
        self._flat = np.concatenate([table.eigenvalues, rows.reshape(len(rows), -1)], axis=1)

    def __call__(self, factors: Array) -> tuple[Array, Array]:
        family, (k, m) = self._family, self._shape
        found = self._table.coefficients(family.shape_numbers(factors)) @ self._flat
        size = family.factor(factors, "length")  # the beam of the table, made longer and thicker alike
        stiffness, density = family.factor(factors, "youngs_modulus"), family.factor(factors, "density")
        eigenvalues = found[:, :m] * (stiffness / (density * size**2))[:, None]
        unit = 1 / np.sqrt(density * size**3)
        scale = np.where(self._turned, (unit / size)[:, None], unit[:, None])
        motions = found[:, m:].reshape(-1, k, m) * scale[:, :, None]
        if (np.diff(eigenvalues, axis=1) < 0).any():
            order = np.argsort(eigenvalues, axis=1)
            eigenvalues = np.take_along_axis(eigenvalues, order, axis=1)
            motions = np.take_along_axis(motions, order[:, None, :], axis=2)
        return eigenvalues, motions


class _SolvedModes:
    """Motions in the free modes, the beam assembled and solved anew for each row."""

    def __init__(self, family: BeamFamily, motions: Array) -> None:
        self._family, self._motions = family, motions

    def __call__(self, factors: Array) -> tuple[Array, Array]:
        solved = [self._family.structure(row).modes() for row in factors]
        return np.stack([s.eigenvalues for s in solved]), np.stack([self._motions.T @ s.shapes for s in solved])


def _ratios(structure: Structure) -> Array:
    law = structure.damping
    return law.per_mode(structure.n_dofs) if isinstance(law, ModalDamping) else np.zeros(structure.n_dofs)


def as_family(structure: "Structure | StructureFamily") -> StructureFamily:
    """A structure as the family of one; a family as it is."""
    return FixedFamily(structure) if isinstance(structure, Structure) else structure
