"""A finite-element model as another program exports it: sparse matrices, which DOF each row is, where nodes are."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from scipy import sparse

from jointbayes.errors import ModelError
from jointbayes.structure.damping import require_symmetric
from vibrecords.arrays import Array, Indices

#: Directions by their numbers in Nastran, Abaqus, Ansys and CalculiX, 1 to 6.
DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")

#: A sparse matrix by columns, shape (n, n): `scipy.sparse.csc_array`.
Sparse = Any

#: An entry across the diagonal may differ by so much of the largest.
_SYMMETRIC = 1e-8


@dataclass(frozen=True, eq=False)
class FePart:
    """What an uncertain quantity of a part of a model multiplies: matrices that the whole contains.

    Parameters
    ----------
    stiffness
        Its K, shape (n, n): grows with Young's modulus, and with the thickness of a sheet.
    mass
        Its M, shape (n, n): grows with density, and with thickness.
    bending
        Its further K that grows with the third power of thickness: the bending of a sheet. None without.
    """

    stiffness: Sparse
    mass: Sparse
    bending: Sparse | None = None

    def __post_init__(self) -> None:
        for name in ("stiffness", "mass", "bending"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, sparse.csc_array(getattr(self, name)))

    def turned(self, turn: Sparse) -> "FePart":
        """The part in other coordinates v, u = T v."""
        further = None if self.bending is None else turn.T @ self.bending @ turn
        return FePart(turn.T @ self.stiffness @ turn, turn.T @ self.mass @ turn, further)


@dataclass(frozen=True, eq=False)
class FeModel:
    """A structure without its joints by its matrices, SI units.

    Parameters
    ----------
    stiffness, mass
        Symmetric sparse matrices K and M, shape (n, n), whole, not one triangle; M may be semidefinite.
    dofs
        Number of the node and number of the direction, 1 to 6, of each row, shape (n, 2); direction 0 is that of a
        generalised coordinate, which nothing can hold.
    nodes
        Numbers of the nodes whose places are known, shape (k,), and
    places
        where they are, shape (k, 3), m.
    damping
        Viscous damping matrix C, shape (n, n), or None.
    parts
        Parts by their names, which are contained in the whole: those with an uncertain modulus, density or thickness.
    edges
        Pairs of node numbers, shape (e, 2), as lines of a picture; None where the file has no elements.
    source
        The file in words, such as ``"bracket.npz"``.
    notes
        What a reader left out or doubts, a sentence each.
    rounding
        Relative rounding of the entries of K in the file: 5e-10 for ten digits, 0 for sixteen.

    Raises
    ------
    ModelError
        If shapes disagree, a matrix is not finite or not symmetric, a row occurs twice, or there is no mass.
    """

    stiffness: Sparse
    mass: Sparse
    dofs: Indices
    nodes: Indices = field(default_factory=lambda: np.empty(0, dtype=np.intp))
    places: Array = field(default_factory=lambda: np.empty((0, 3)))
    damping: Sparse | None = None
    parts: Mapping[str, FePart] = field(default_factory=dict)
    edges: Indices | None = None
    source: str = "structure"
    notes: tuple[str, ...] = ()
    rounding: float = 0.0

    def __post_init__(self) -> None:
        n = len(self.dofs)
        twice = n - len(np.unique(np.asarray(self.dofs, dtype=np.intp).reshape(n, -1), axis=0)) if n else 0
        if n == 0 or twice:
            found = f"found {twice} DOFs twice" if n else "found no DOF"
            raise ModelError.of(self.source, ("dofs",), found, "each row's node and direction once", "correct the map")
        object.__setattr__(self, "dofs", np.asarray(self.dofs, dtype=np.intp).reshape(n, -1))
        for name in ("stiffness", "mass", "damping"):
            given = getattr(self, name)
            if given is None:
                continue
            matrix = sparse.csc_array(given)
            object.__setattr__(self, name, matrix)
            if matrix.shape != (n, n):
                found = f"found a {name} matrix of shape {matrix.shape} for {n} DOFs"
                raise ModelError.of(self.source, (name,), found, f"({n}, {n})", "give the map of the same model")
            if not np.isfinite(matrix.data).all():
                found = f"found NaN or infinity in the {name} matrix"
                raise ModelError.of(self.source, (name,), found, "finite numbers", "export it again")
            remedy = "export the symmetric matrix (no contact with friction, no follower loads)"
            require_symmetric(matrix, self.source, name, f"an unsymmetric {name} matrix", _SYMMETRIC, remedy)
        if not self.mass.diagonal().max(initial=0.0) > 0:
            raise ModelError.of(self.source, ("mass",), "found no mass", "a mass matrix in kg", "export M too")

    @property
    def n_dofs(self) -> int:
        """Number of rows."""
        return len(self.dofs)

    @cached_property
    def row_of(self) -> dict[tuple[int, int], int]:
        """Rows by the numbers of node and direction."""
        return {(int(node), int(way)): row for row, (node, way) in enumerate(self.dofs)}

    @cached_property
    def _place_of(self) -> dict[int, int]:
        return {int(node): i for i, node in enumerate(self.nodes)}

    def row(self, node: int, direction: str) -> int | None:
        """The row of a DOF; None where the model has none, such as a rotation of a solid's node."""
        return self.row_of.get((node, DIRECTIONS.index(direction) + 1))

    def place(self, node: int) -> Array | None:
        """Where a node is, shape (3,), m; None where that is not known."""
        at = self._place_of.get(node)
        return None if at is None else self.places[at]

    @property
    def extent(self) -> tuple[Array, Array]:
        """Smallest and largest coordinates of its nodes, each shape (3,), m."""
        return self.places.min(axis=0), self.places.max(axis=0)

    def changed(self, turn: Sparse, dofs: Indices, places: Mapping[int, Array]) -> Self:
        """The model in other coordinates v, u = T v, with the map of these and the places of further nodes."""
        return replace(
            self,
            stiffness=turn.T @ self.stiffness @ turn,
            mass=turn.T @ self.mass @ turn,
            damping=None if self.damping is None else turn.T @ self.damping @ turn,
            parts={name: part.turned(turn) for name, part in self.parts.items()},
            dofs=dofs,
            nodes=np.concatenate([self.nodes, np.array(list(places), dtype=np.intp)]),
            places=np.concatenate([self.places, np.array(list(places.values())).reshape(-1, 3)]),
        )

    def held(self, supports: Iterable[tuple[int, str]]) -> Self:
        """The model with DOFs held fixed, each by its node and direction.

        Raises
        ------
        ModelError
            If the model has no such DOF.
        """
        rows = []
        for node, way in supports:
            row = self.row(node, way)
            if row is None:
                found = f"found no DOF {node}:{way} in {self.source}"
                raise ModelError.of("structure", ("supports",), found, "a DOF of the model", "correct the support")
            rows.append(row)
        kept = np.setdiff1d(np.arange(self.n_dofs), rows)
        selection = sparse.eye_array(self.n_dofs, format="csc")[:, kept]
        return self if not rows else self.changed(selection, self.dofs[kept], {})

    @property
    def whole_mass(self) -> float:
        """Largest mass that moves along x, y or z, kg."""
        return max(self.mass_along(way) for way in "xyz")

    @property
    def box(self) -> tuple[float, ...] | None:
        """Sides of the box that holds the nodes that move, m; None without coordinates."""
        return tuple(np.ptp(self.corners, axis=0).tolist()) if self.corners else None

    @property
    def corners(self) -> tuple[tuple[float, ...], ...]:
        """Two opposite corners of the box that holds the nodes that move, m; none without coordinates."""
        places = self.places[np.isin(self.nodes, self.dofs[:, 0])]
        return (tuple(places.min(axis=0).tolist()), tuple(places.max(axis=0).tolist())) if len(places) else ()

    @property
    def size(self) -> str:
        """Mass and box in words."""
        sides = "no coordinates" if self.box is None else " × ".join(f"{1e3 * side:.4g}" for side in self.box) + " mm"
        return f"{self.whole_mass:.4g} kg, {sides}"

    def mass_along(self, direction: str) -> float:
        """Mass that moves when the whole structure moves along x, y or z, kg: where nothing is held, all of it."""
        moved = (self.dofs[:, 1] == DIRECTIONS.index(direction) + 1).astype(float)
        return float(moved @ (self.mass @ moved))
