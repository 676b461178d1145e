"""Structures given by their matrices: small K, M and C, and masses with springs and dampers between them."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np

from jointbayes.errors import ModelError
from jointbayes.structure.body import Forced, FreeModes
from jointbayes.structure.damping import NOT_NEGATIVE, DampingLaw, ViscousMatrix, lowest_eigenvalue
from jointbayes.structure.matrices import Structure
from jointbayes.structure.recipe import Recipe, UncertainBody
from vibrecords.arrays import Array, convert_fields
from vibrecords.errors import array_of, printable

#: The other side of a spring that holds a mass to what does not move.
GROUND = "ground"


@dataclass(frozen=True, eq=False)
class MatrixRecipe(Recipe):
    """A structure by its matrices.

    Parameters
    ----------
    stiffness, mass
        K and M, shape (n, n), SI units: symmetric, K positive semidefinite, M positive definite.
    dofs
        Labels of the DOFs, ``"point:direction"``, shape (n,).
    damping
        Damping law; `ViscousMatrix` holds a matrix C.
    positions
        Place of points in m, by what stands before the colon of their labels, where it is known.
    supports, accelerometer_mass, added_mass, accelerometer_dofs
        See `Recipe`.

    Raises
    ------
    ModelError
        If shapes disagree, a matrix is not symmetric or has a negative eigenvalue, an accelerometer's mass is negative,
        or a DOF does not exist.

    Examples
    --------
    >>> from jointbayes.structure import ModalDamping
    >>> two = MatrixRecipe([[2e5, -1e5], [-1e5, 1e5]], [[1, 0], [0, 2]], ("1:x", "2:x"), ModalDamping((0.01,)))
    >>> two.structure().modes().frequency_hz.round(2).tolist()
    [23.56, 76.01]
    """

    stiffness: Array
    mass: Array
    dofs: tuple[str, ...]
    damping: DampingLaw
    supports: tuple[str, ...] = ()
    positions: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)

    kind: ClassVar[str] = "structure"
    quantities: ClassVar[tuple[str, ...]] = ("damping_ratio", "loss_factor")
    extent: ClassVar[float] = 1.0  # a metre: matrices have no size

    def __post_init__(self) -> None:
        convert_fields(self, tuple, "dofs", "supports")
        for name in ("stiffness", "mass"):
            object.__setattr__(self, name, array_of(getattr(self, name), float, f"structure: {name}", ModelError))
        whole = Structure(self.stiffness, self.mass, self.damping, self.dofs, self.positions)
        whole.index(self.supports)
        self._require_masses()
        whole.index(self.accelerometer_dofs)
        self._require_sign("mass", whole.mass, definite=True)
        self._require_sign("stiffness", whole.stiffness, definite=False)

    def _require_sign(self, name: str, matrix: Array, *, definite: bool) -> None:
        lowest, diagonal = lowest_eigenvalue(matrix, f"structure: found a {name} matrix"), np.diag(matrix)
        if lowest < -NOT_NEGATIVE or (definite and lowest <= NOT_NEGATIVE / 1e3):
            kind = "positive definite" if definite else "positive semidefinite"
            at = self.dofs[int(np.argmin(diagonal))]
            found = f"found a {name} matrix with {lowest:.3g} as lowest eigenvalue, diagonal scaled to 1"
            found += f", and {diagonal.min():.4g} at {printable(at)}"
            raise ModelError.of("structure", (name,), found, f"a {kind} one", f"correct the {name} matrix")

    def own_stiffness(self, row: str, column: str) -> float:
        """The structure's stiffness at a DOF, N/m or of a rotation N·m/rad; of two DOFs the root of their product.

        0 of a mass that nothing holds.
        """
        first, second = (float(self.stiffness[at, at]) for at in (self.dofs.index(row), self.dofs.index(column)))
        return first if row == column else math.sqrt(first) * math.sqrt(second)

    def own_inertia(self, dof: str) -> float:
        """The mass, kg, or moment of inertia, kg·m², at a DOF."""
        at = self.dofs.index(dof)
        return float(self.mass[at, at])

    @property
    def what(self) -> str:
        """The structure by its size."""
        return f"{len(self.dofs)} DOFs"

    @property
    def reference(self) -> Self:
        """The same: matrices are what they are."""
        return self

    def mesh(self, dofs: Iterable[str] | None = None, top_hz: float | None = None) -> None:
        """No elements."""

    def structure(self, factors: Mapping[str, float] | None = None, mesh: None = None) -> Structure:
        """The structure, its damping multiplied by factors where some are given.

        Raises
        ------
        ModelError
            If a name is unknown.
        """
        damping = self.damping.scaled(self.checked_factors(factors))
        whole = Structure(self.stiffness, self.mass, damping, self.dofs, self.positions)
        return whole.loaded(self.accelerometer_dofs, self.accelerometer_mass + self.added_mass).fixed(self.supports)


@dataclass(frozen=True, eq=False, repr=False)
class MatrixFamily(UncertainBody):
    """A structure of given matrices whose damping is uncertain.

    Parameters
    ----------
    recipe
        The matrices.
    ranges
        Smallest and largest logarithm of the factor by quantity: ``damping_ratio``, ``loss_factor``.
    dofs, top_hz, exact
        As of `BeamFamily`.

    Raises
    ------
    ModelError
        If a quantity is unknown or does not belong to the damping law.
    """

    recipe: MatrixRecipe

    def reach_hz(self, count: int) -> float:
        """A frequency above the first `count` natural frequencies, Hz."""
        return self.nominal.reach_hz(count)

    def over_factors(self, motions: Array, forced: Forced) -> FreeModes:
        """Its modes, for any factors."""
        reach = self.reach_of_modes_hz
        structure = self.nominal if reach is None else self.nominal.at((), reach)
        return structure.free_modes(np.arange(len(motions)), motions, forced)


def chain(
    masses: Mapping[str, float] | Sequence[float],
    springs: Iterable[tuple[str, str, float]],
    damping: DampingLaw | None = None,
    *,
    dampers: Iterable[tuple[str, str, float]] = (),
    direction: str = "x",
) -> MatrixRecipe:
    """Masses that move along one line, with springs and dampers between them.

    Parameters
    ----------
    masses
        Mass in kg by its name, or in order: 1, 2 and so on.
    springs
        Two names, of which one may be ``"ground"``, and the stiffness between them in N/m.
    damping
        Damping law; None where there are dampers.
    dampers
        As springs, with the damping constant in N·s/m.
    direction
        That of the DOFs: ``"1:x"``.

    Raises
    ------
    ModelError
        If a name is unknown, a number is negative, or both a law and dampers are given.

    Examples
    --------
    >>> from jointbayes.structure import ModalDamping
    >>> two = chain([1.0, 2.0], [("ground", "1", 1e5), ("1", "2", 1e5)], ModalDamping((0.01,)))
    >>> two.structure().modes().frequency_hz.round(2).tolist()
    [23.56, 76.01]
    """
    named = dict(masses.items() if isinstance(masses, Mapping) else enumerate(masses, 1))
    weights = {str(name): float(mass) for name, mass in named.items()}
    for name, mass in weights.items():
        if not 0 < mass < np.inf or name == GROUND:
            found = f"found a mass {printable(name)!r} of {mass:g} kg"
            raise ModelError.of("chain", (), found, "one above 0", "correct it")
    between = list(dampers)
    if (damping is None) == (not between):
        found = f"found {len(between)} dampers and {('no' if damping is None else 'a')} damping law"
        raise ModelError.of("chain", (), found, "either dampers or a law", "remove one of the two, or state one")
    stiffness = _connection_matrix(weights, springs, "a spring", "N/m")
    law = damping if damping is not None else ViscousMatrix(_connection_matrix(weights, between, "a damper", "N s/m"))
    return MatrixRecipe(stiffness, np.diag(list(weights.values())), tuple(f"{n}:{direction}" for n in weights), law)


def _connection_matrix(
    masses: Mapping[str, float], connections: Iterable[tuple[str, str, float]], what: str, unit: str
) -> Array:
    """Matrix of springs or dampers between masses."""
    at = {name: i for i, name in enumerate(masses)}
    matrix = np.zeros((len(at), len(at)))
    for i, (first, second, value) in enumerate(connections):
        ends = [str(first), str(second)]
        wrong = [end for end in ends if end != GROUND and end not in at]
        if wrong or ends[0] == ends[1] or not 0 <= value < np.inf:
            found = f"found {what} from {printable(ends[0])!r} to {printable(ends[1])!r} of {value:g} {unit}"
            expected = f"two of {', '.join([*[*at][:12], GROUND])} and a number of at least 0"
            raise ModelError.of("chain", (f"{what.split()[-1]}s", i, "between"), found, expected, "correct it")
        form = np.zeros(len(at))
        for end, sign in zip(ends, (1.0, -1.0), strict=True):
            if end != GROUND:
                form[at[end]] = sign
        with np.errstate(over="ignore"):  # found to be infinite later
            matrix += value * np.outer(form, form)
    return matrix
