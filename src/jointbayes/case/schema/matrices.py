"""The `[structure]` tables of small structures: chains of masses and springs, and given matrices."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import BeforeValidator, Field, Strict

from jointbayes.arrays import Array
from jointbayes.case.errors import Finding
from jointbayes.case.schema.damping import (
    LAW,
    LossFactorDampingSpec,
    ModalDampingSpec,
    RayleighDampingSpec,
)
from jointbayes.case.schema.fields import Labels, Positive, Spec, at_most, key_field, not_negative
from jointbayes.case.schema.structure_parts import (
    KIND,
    MASS,
    POINT,
    SUPPORTS,
    Absence,
    AnyStructureSpec,
    absent_dofs,
    absent_point,
    changed_by,
)

if TYPE_CHECKING:
    from jointbayes.case.schema.data import TruthSpec


_GROUND = "ground"
_MOST = 2000  # rows of a matrix, masses, springs

_Name = Annotated[str, BeforeValidator(lambda name: str(name) if type(name) is int else name)]
_BETWEEN = key_field('the two masses, or a mass and "ground"', ["1", "2"])


class SpringSpec(Spec):
    """A spring between two masses, or between one and the ground."""

    between: Annotated[tuple[_Name, _Name], Strict(False), _BETWEEN]
    stiffness_n_per_m: Annotated[float, not_negative("the stiffness in N/m", 1e5)]


class DamperSpec(Spec):
    """A viscous damper between two masses, or between one and the ground."""

    between: Annotated[tuple[_Name, _Name], Strict(False), _BETWEEN]
    damping_n_s_per_m: Annotated[float, not_negative("the damping constant in N s/m", 10.0)]


class DampersSpec(Spec):
    """Dampers between the masses of a chain."""

    law: Annotated[Literal["dampers"], LAW]
    dampers: Annotated[
        tuple[DamperSpec, ...], Strict(False), at_most(_MOST), Field(min_length=1, description="a list of dampers")
    ]


_Rows = Annotated[tuple[Annotated[tuple[float, ...], Strict(False)], ...], Strict(False), at_most(_MOST)]
_Diagonal = Annotated[tuple[float, ...], Strict(False), at_most(_MOST)]
_Matrix = str | _Diagonal | _Rows
_MATRIX_TEXT = "a list of rows, a list of the diagonal, or the name of a .npy or .csv file"


class MatrixDampingSpec(Spec):
    """Viscous damping by its matrix C."""

    law: Annotated[Literal["matrix"], LAW]
    damping_matrix: Annotated[_Matrix, key_field(f"C in SI units (N s/m): {_MATRIX_TEXT}", "C.npy")]

    def _findings(self) -> Iterator[Finding]:
        yield from _matrix_findings("damping_matrix", self.damping_matrix, None)


_Laws = ModalDampingSpec | LossFactorDampingSpec | RayleighDampingSpec
_DAMPING = Field(discriminator="law", description="the damping: its law and constants")


class ChainSpec(AnyStructureSpec):
    """The structure without its joints: masses that move along one line, with springs between them."""

    kind: Annotated[Literal["chain"], KIND]
    masses_kg: Annotated[
        dict[str, Positive], Field(description="the masses in kg, each by its name or number", min_length=1)
    ]
    springs: Annotated[
        tuple[SpringSpec, ...], Strict(False), at_most(_MOST), Field(description="a list of springs")
    ] = ()
    direction: Annotated[Literal["x", "y", "z", "rx", "ry", "rz"], key_field("the direction of the DOFs", "x")] = "x"
    supports: Annotated[Labels, SUPPORTS] = ()
    accelerometer_mass_g: Annotated[float, MASS] = 0.0
    damping: Annotated[_Laws | DampersSpec, _DAMPING]

    @property
    def points_in_order(self) -> tuple[str, ...]:
        """Names of the masses."""
        return tuple(self.masses_kg)

    @property
    def free_dofs(self) -> int:
        """Number of masses that are not held."""
        return len(self.masses_kg) - len(self.supports)

    @property
    def stated(self) -> dict[str, tuple[str, float]]:
        """Unit and value of each quantity that may be uncertain."""
        return _stated_damping(self.damping)

    def absent(self, label: str) -> Absence | None:
        """What to say of a DOF that does not exist."""
        return absent_point(label, self.masses_kg, (self.direction,))

    def place(self, label: str) -> str:
        """The mass itself."""
        return f"mass {label.rpartition(':')[0]}"

    def of_truth(self, truth: TruthSpec) -> Self:
        """The chain that makes the data."""
        return self.model_copy(update=changed_by(truth))

    def _findings(self) -> Iterator[Finding]:
        for name in self.masses_kg:
            if not POINT.fullmatch(name) or name == _GROUND:
                expected = "a number from 1, or a word of letters, digits, _ and - other than ground"
                yield Finding(("masses_kg",), f'found the name "{name[:40]}"', expected, "rename the mass")
        lists: dict[tuple[str, ...], list[tuple[str, str]]] = {("springs",): [s.between for s in self.springs]}
        if isinstance(self.damping, DampersSpec):
            lists[("damping", "dampers")] = [d.between for d in self.damping.dampers]
        for loc, pairs in lists.items():
            for i, pair in enumerate(pairs):
                wrong = [end for end in pair if end != _GROUND and end not in self.masses_kg]
                if wrong or pair[0] == pair[1]:
                    found = f'found "{pair[0][:40]}" and "{pair[1][:40]}"'
                    expected = f"two of {', '.join([*list(self.masses_kg)[:12], _GROUND])}"
                    yield Finding((*loc, i, "between"), found, expected, "correct the names")
        yield from absent_dofs(self, self.supports, ("supports",))


class MatricesSpec(AnyStructureSpec):
    """The structure without its joints, given by its stiffness and mass matrices."""

    kind: Annotated[Literal["matrices"], KIND]
    dofs: Annotated[Labels, Field(min_length=1), key_field("the DOF labels of the rows, in order", ["1:x", "2:x"])]
    stiffness: Annotated[_Matrix, key_field(f"K in SI units (N/m): {_MATRIX_TEXT}", "K.npy")]
    mass: Annotated[_Matrix, key_field(f"M in SI units (kg): {_MATRIX_TEXT}", "M.npy")]
    points: Annotated[
        dict[str, Annotated[tuple[float, float, float], Strict(False)]],
        Field(description="the places of points in mm by their names, where they are known"),
    ] = {}  # noqa: RUF012 (pydantic copies it)
    supports: Annotated[Labels, SUPPORTS] = ()
    accelerometer_mass_g: Annotated[float, MASS] = 0.0
    damping: Annotated[_Laws | MatrixDampingSpec, _DAMPING]

    @property
    def points_in_order(self) -> tuple[str, ...]:
        """What stands before the colon of the labels, each once."""
        return tuple(dict.fromkeys(label.rpartition(":")[0] for label in self.dofs))

    @property
    def free_dofs(self) -> int:
        """Number of DOFs that are not held."""
        return len(self.dofs) - len(self.supports)

    @property
    def stated(self) -> dict[str, tuple[str, float]]:
        """Unit and value of each quantity that may be uncertain."""
        return _stated_damping(self.damping)

    def absent(self, label: str) -> Absence | None:
        """What to say of a DOF that does not exist."""
        if label in self.dofs:
            return None
        shown = ", ".join(self.dofs[:12])
        return f'"{label}" is not one of structure.dofs', f"one of {shown}", "correct the label"

    def place(self, label: str) -> str:
        """The point itself."""
        return f"point {label.rpartition(':')[0]}"

    def of_truth(self, truth: TruthSpec) -> Self:
        """The structure that makes the data."""
        return self.model_copy(update=changed_by(truth))

    def _findings(self) -> Iterator[Finding]:
        for key in ("stiffness", "mass"):
            yield from _matrix_findings(key, getattr(self, key), len(self.dofs))
        yield from absent_dofs(self, self.supports, ("supports",))


def _stated_damping(damping: object) -> dict[str, tuple[str, float]]:
    return {"loss_factor": ("1", damping.loss_factor)} if isinstance(damping, LossFactorDampingSpec) else {}


def asymmetry(matrix: Array) -> str | None:
    """What is not symmetric about a square matrix, in words; None where it is."""
    gap = abs(matrix - matrix.T)
    row, column = divmod(int(gap.argmax()), len(gap))
    if gap[row, column] <= 1e-10 * abs(matrix).max(initial=0.0):
        return None
    values = f"{matrix[row, column]:g} and {matrix[column, row]:g}"
    return f"found {values} at row {row + 1}, column {column + 1} and across the diagonal"


def _matrix_findings(key: str, given: object, rows: int | None) -> Iterator[Finding]:
    """Yield a matrix in the file that is not square, not of the right size or not symmetric."""
    if isinstance(given, str):
        return
    assert isinstance(given, tuple)
    if not given or not isinstance(given[0], tuple):
        count, square = len(given), True
    else:
        count, square = len(given), all(len(row) == len(given) for row in given)
    wanted = rows or count
    if not square or count != wanted or not count:
        size = f"{wanted} rows of {wanted} numbers, or {wanted} numbers of the diagonal"
        lengths = sorted({len(row) for row in given if isinstance(row, tuple)})
        found = (
            f"found {count} rows of {' or '.join(map(str, lengths))} numbers" if lengths else f"found {count} numbers"
        )
        yield Finding((key,), found, size, "correct the matrix, or structure.dofs")
    elif isinstance(given[0], tuple):
        import numpy as np  # with matrices alone: other cases are read without it

        words = asymmetry(np.array(given))
        if words is not None:
            yield Finding((key,), words, "a symmetric matrix", "correct one of the two entries")
