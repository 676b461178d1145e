"""An imported model as a body: what its ports see, exactly known or with uncertain parts."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import ClassVar

import numpy as np
from scipy import linalg

from jointbayes.errors import ModelError
from jointbayes.structure.body import Discretisation, Forced, FreeModes, Modes, Rows
from jointbayes.structure.damping import DampingLaw, ViscousMatrix
from jointbayes.structure.imported.fe_model import FeModel
from jointbayes.structure.imported.ports import Port, hold_rigid, port_forms
from jointbayes.structure.imported.reduction import MODES_TO, PART_QUANTITIES, ReducedModel, reduce_model
from jointbayes.structure.matrices import ConstantModes, Structure
from jointbayes.structure.recipe import Recipe, UncertainBody
from jointbayes.structure.shape_modes import ModesOverShape, Powers, ends_of, modes_over_shape, rising, shape_numbers
from vibrecords.arrays import Array, Indices, convert_fields

#: Lines of a picture at most, and cells along the longest side: as many as leave no more lines than that.
_MOST_LINES = 240
_CELLS = (48, 32, 24, 16, 12, 8, 6, 4, 3, 2)


@dataclass(frozen=True, eq=False)
class Outline:
    """Lines of a picture.

    Parameters
    ----------
    places
        Where their ends are, shape (k, 3), m.
    lines
        Which ends each connects, shape (l, 2).
    motions
        Motion of the ends along x, y, z in the reduced coordinates, shape (r, 3 k); 0 where a support holds them.
    """

    places: Array
    lines: Indices
    motions: Array


def outline_of(model: FeModel) -> tuple[Indices, Indices] | None:
    """Nodes that stand for the surface of a model, shape (k,), and lines between them, shape (l, 2).

    None of a model without edges or places.
    """
    if model.edges is None or not len(model.edges) or not len(model.nodes):
        return None
    order = np.argsort(model.nodes)
    found = np.searchsorted(model.nodes, model.edges, sorter=order)
    at = order[np.minimum(found, len(order) - 1)]
    at = at[(model.nodes[at] == model.edges).all(axis=1)]  # of an element on a node without place nothing is drawn
    if not len(at):
        return None
    low, high = model.places[at].min(axis=(0, 1)), model.places[at].max(axis=(0, 1))
    moving = np.isin(model.nodes, model.dofs[:, 0])
    for count in _CELLS:
        size = max(float((high - low).max()) / count, np.finfo(float).tiny)
        cells = np.round((model.places - low) / size).astype(np.intp)
        _, cluster = np.unique(cells, axis=0, return_inverse=True)
        lines = np.unique(np.sort(cluster.reshape(-1)[at], axis=1), axis=0)
        lines = lines[lines[:, 0] != lines[:, 1]]
        if 0 < len(lines) <= _MOST_LINES or count == _CELLS[-1]:
            break
    used, lines = np.unique(lines[:_MOST_LINES], return_inverse=True)
    surface = np.zeros(len(model.nodes), dtype=bool)
    surface[at] = True
    nodes = []
    for each in used:  # of those in a cell one on the surface that moves, if any does
        inside = np.flatnonzero(cluster.reshape(-1) == each)
        nodes.append(inside[np.argmax(2 * moving[inside] + surface[inside])])
    return model.nodes[nodes], lines.reshape(-1, 2)


#: Powers in which the whole model's quantities change its eigenvalues by similarity.
_WHOLE = ("youngs_modulus", "density")


@dataclass(frozen=True, repr=False)
class ReducedStructure(Structure):
    """A structure whose coordinates are not its DOFs: these move as forms on the coordinates.

    Parameters
    ----------
    motions
        Motion of each labelled DOF in the coordinates, shape (r, p).
    rigid
        How many of the first coordinates are rigid-body modes, in which nothing is strained.
    """

    motions: Array = field(kw_only=True)
    rigid: int = field(kw_only=True)
    most_solved: ClassVar[int] = 0  # its DOFs are not its coordinates

    def __post_init__(self) -> None:
        """Nothing is checked again: the reduction made it."""

    @property
    def n_dofs(self) -> int:
        """Number of coordinates, or of labelled DOFs where these are more: many that move alike."""
        return max(len(self.mass), len(self.dofs))

    def on_all_dofs(self, dofs: Rows, motions: Array) -> Array:
        """Motions given as forms on some DOFs, shape (p, k), as forms on the coordinates, shape (r, k)."""
        return np.asarray(self.motions[:, dofs] @ motions)

    def _modes(self, added_stiffness: Array | None) -> Modes:
        if added_stiffness is not None:
            return super()._modes(added_stiffness)
        n = self.rigid
        of_rigid = self.mass[:n, :n]
        # modes that are strained move no momentum: what of the rigid-body modes each takes along
        taken = np.vstack([-np.linalg.solve(of_rigid, self.mass[:n, n:]), np.eye(len(self.mass) - n)])
        kinetic = taken.T @ self.mass @ taken
        inverse, turn = linalg.eigh((kinetic + kinetic.T) / 2, self.stiffness[n:, n:])
        inverse, turn = inverse[::-1], turn[:, ::-1]
        moved = np.zeros((len(self.mass), n))
        moved[:n] = np.linalg.inv(np.linalg.cholesky(of_rigid)).T
        shapes = np.hstack([moved, taken @ (turn / np.sqrt(inverse))])
        return Modes(np.concatenate([np.zeros(n), 1 / inverse]), shapes)

    @property
    def shift(self) -> float:
        """Shift low among the eigenvalues, rad²/s², see `Structure.shift`: the first that is not zero."""
        eigenvalues = self.modes().eigenvalues
        return float(eigenvalues[self.rigid]) if eigenvalues.size > self.rigid else 1.0

    def dampers(self) -> tuple[Array, Rows, Array]:
        """None that could be told from the matrix C of a reduction: it is solved line by line."""
        return np.empty(0), np.empty(0, dtype=np.intp), np.empty((0, 0))


@dataclass(frozen=True, eq=False)
class ImportedRecipe(Recipe):
    """An imported model as its ports see it up to a frequency.

    Made by `reduce_to_ports`; the model itself is not kept.

    Parameters
    ----------
    reduced, finer
        The reduced model, and one with more vectors that it is compared with.
    dofs
        Labels of the ports' DOFs, shape (p,), ``"tip:y"``.
    top_hz
        Frequency up to which it is reduced, Hz.
    damping
        Damping law; that of a matrix C holds the reduced one.
    source, n_whole, size
        The file in words, the number of its DOFs, and its mass and box in words.
    positions
        Places of ports, m, by their names, where known.
    accelerometer_mass, added_mass, accelerometer_dofs
        See `Recipe`.
    outline
        Lines of a picture; None where the model has no elements.
    corners
        Two opposite corners of the box that holds the nodes, m; none without coordinates.
    """

    reduced: ReducedModel
    finer: ReducedModel
    dofs: tuple[str, ...]
    top_hz: float
    damping: DampingLaw
    source: str = "structure"
    n_whole: int = 0
    size: str = ""
    positions: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    outline: Outline | None = None
    corners: tuple[tuple[float, ...], ...] = ()

    kind: ClassVar[str] = "imported structure"
    extent: ClassVar[float] = 1.0  # a metre, as of matrices

    def __post_init__(self) -> None:
        convert_fields(self, tuple, "dofs", "accelerometer_dofs")
        self._require_masses()

    def drawn(self) -> ReducedStructure:
        """The structure with the ends of the outline's lines, ``"~0:x"`` and so on, among its DOFs."""
        bare = self.structure()
        assert self.outline is not None
        labels = tuple(f"~{end}:{way}" for end in range(len(self.outline.places)) for way in "xyz")
        motions = np.hstack([bare.motions, self.reduced.seen])
        return replace(bare, dofs=(*bare.dofs, *labels), motions=motions)

    @property
    def used(self) -> ReducedModel:
        """The reduced model, or the finer one."""
        return self.finer if self.richer else self.reduced

    @property
    def quantities(self) -> tuple[str, ...]:
        """Young's modulus and density of the whole, those and the thickness of parts, accelerometers, damping."""
        of_parts = [f"{part}.{quantity}" for part in self.reduced.parts for quantity in PART_QUANTITIES]
        return (*_WHOLE, *of_parts, "accelerometer_mass", "damping_ratio", "loss_factor")

    @property
    def usual(self) -> dict[str, tuple[str, float]]:
        """Factors on Young's modulus and density, and the mass of the accelerometers."""
        return self._with_accelerometers(dict.fromkeys(_WHOLE, ("× stated", 1.0)))

    @property
    def what(self) -> str:
        """The model by its file, size and first natural frequency."""
        return f"{self.source}, {self.n_whole} DOFs reduced to {len(self.used.mass)}, {self.in_words}"

    @property
    def in_words(self) -> str:
        """Mass, box and first natural frequency without the joint, by which a wrong unit shows."""
        frequencies, top = self.structure().modes().frequency_hz[self.used.rigid :], MODES_TO * self.top_hz
        first = f"at {frequencies[0]:.4g} Hz" if frequencies.size and frequencies[0] <= top else f"above {top:.4g} Hz"
        return f"{self.size}, first natural frequency without its joint {first}"

    def mesh(self, dofs: Iterable[str] | None = None, top_hz: float | None = None) -> None:
        """No elements to be chosen; a frequency beyond the modes of the reduction is refused.

        Raises
        ------
        ModelError
            If it is.
        """
        if top_hz is not None and top_hz > MODES_TO * self.top_hz:  # a search may look a little above the data
            found = f"found {self.source} reduced up to {self.top_hz:.4g} Hz"
            raise ModelError.of("structure", ("top_hz",), found, f"{top_hz:.4g} Hz or more", "raise structure.top_hz")

    def structure(self, factors: Mapping[str, float] | None = None, mesh: None = None) -> ReducedStructure:
        """The structure, its quantities multiplied by factors where some are given.

        Raises
        ------
        ModelError
            If a name is unknown.
        """
        named, of = self.checked_factors(factors), self.used
        stiffness, mass = of.stiffness, of.mass
        for name, part in of.parts.items():
            given = {q: named.get(f"{name}.{q}", 1.0) for q in PART_QUANTITIES}
            grown = [math.prod(given[q] ** powers[i] for q, powers in PART_QUANTITIES.items()) - 1 for i in range(3)]
            if any(grown):
                stiffness = stiffness + grown[0] * part.stiffness + grown[1] * part.bending
                mass = mass + grown[2] * part.mass
        stiffness, mass = (named.get(q, 1.0) * matrix for q, matrix in zip(_WHOLE, (stiffness, mass), strict=True))
        bare = ReducedStructure(
            stiffness, mass, self.damping.scaled(named), self.dofs, self.positions, motions=of.motions, rigid=of.rigid
        )
        return bare.loaded(self.accelerometer_dofs, self.load(named))


@dataclass(frozen=True)
class _ScaledModes:
    """Modes at all factors from those over the shape numbers, by similarity."""

    modes: ModesOverShape
    axes: Mapping[str, Powers]
    factor: Callable[[Array, str], Array]

    def __call__(self, factors: Array) -> tuple[Array, Array]:
        """Eigenvalues (n, m) and motions (n, k, m) at factors (n, q)."""
        of = partial(self.factor, factors)
        eigenvalues, motions = self.modes(shape_numbers(self.axes.values(), of, len(factors)))
        stiffness, density = (of(q)[:, None] for q in _WHOLE)
        return rising(eigenvalues * stiffness / density, motions / np.sqrt(density)[:, :, None])


@dataclass(frozen=True, eq=False, repr=False)
class ImportedFamily(UncertainBody):
    """An imported model whose quantities are uncertain, see `UncertainBody` and `ImportedRecipe.quantities`."""

    recipe: ImportedRecipe

    @property
    def n_dofs(self) -> int:
        """Number of coordinates or of labelled DOFs, whichever are more."""
        return self.nominal.n_dofs

    @property
    def discretisation(self) -> Discretisation:
        """Vectors that stand for its DOFs."""
        return Discretisation("reduced", len(self.recipe.used.mass), self.recipe.n_whole)

    @cached_property
    def reach_of_modes_hz(self) -> float | None:
        """Frequency up to which modes are wanted: at the ends of the ranges they may be so much lower."""
        if self.top_hz is None:
            return None
        widest = sum(max(map(abs, self.ranges.get(q, (0.0, 0.0)))) for q in _WHOLE) / 2
        return min(self.top_hz * math.exp(widest), max(self.recipe.top_hz, self.top_hz))

    def reach_hz(self, count: int) -> float:
        """A frequency above the first `count` natural frequencies, Hz, or the reduction's limit: data end below it."""
        return min(self.nominal.reach_hz(count), self.recipe.top_hz)

    @cached_property
    def _axes(self) -> dict[str, Powers]:
        """What changes modes by more than factors: parts, and masses of accelerometers in addition to the model's."""
        axes: dict[str, Powers] = {
            q: {q: 1.0} for q in self.names if q.rpartition(".")[2] in PART_QUANTITIES and "." in q
        }
        loaded = self.recipe.accelerometer_mass + self.recipe.added_mass > 0 and self.recipe.accelerometer_dofs
        powers = {q: p for q, p in (("accelerometer_mass", 1.0), ("density", -1.0)) if q in self.names}
        return axes | ({"accelerometer_mass": powers} if loaded and powers else {})

    def over_factors(self, motions: Array, forced: Forced) -> FreeModes:
        """Interpolated modes over the shape numbers, scaled; motions as forms on the coordinates, shape (r, k)."""
        ends = ends_of(self._axes.values(), lambda q: self.ranges.get(q, (0.0, 0.0)))

        def structure_at(numbers: Sequence[float]) -> Structure:
            return self.recipe.lumped.structure(dict(zip(self._axes, np.exp(numbers).tolist(), strict=True)))

        modes = modes_over_shape(structure_at, self.nominal.modes(), ends, motions, forced, self.reach_of_modes_hz)
        moved = set(self.names) & {*self._axes, *_WHOLE}
        return _ScaledModes(modes, self._axes, self.factor) if moved else ConstantModes(*modes(np.zeros((1, 0))))

    def factor(self, factors: Array, name: str) -> Array:
        """Factor on one quantity, shape (n,); of accelerometers on all mass at their places."""
        of_one = super().factor(factors, name)
        return self.recipe.lumped_factor(of_one) if name == "accelerometer_mass" else of_one


def reduce_to_ports(
    model: FeModel,
    ports: Mapping[str, Port | int | Sequence[int]],
    top_hz: float,
    damping: DampingLaw | None = None,
    *,
    ends: Mapping[str, tuple[float, float]] | None = None,
    supports: Iterable[tuple[int, str]] = (),
    accelerometer_mass: float = 0.0,
    accelerometer_dofs: Iterable[str] = (),
) -> ImportedRecipe:
    """A structure from an imported model, reduced to what joints and sensors at its ports see.

    Parameters
    ----------
    model
        The model, see `read_structure`.
    ports
        Where joints and sensors may be, by names: a node, nodes whose motion is averaged, or a `Port`.
    top_hz
        Highest frequency of any data or prediction, Hz.
    damping
        Damping law; None takes the model's own matrix C.
    ends
        Smallest and largest factor on uncertain quantities of parts, ``{"wall.thickness": (0.9, 1.1)}``.
    supports
        DOFs held fixed, each a node and a direction.
    accelerometer_mass, accelerometer_dofs
        Mass of each accelerometer, kg, and where they sit.

    Returns
    -------
    ImportedRecipe, for `family_of_recipe`; a solve of a large sparse model stands behind it, once.

    Raises
    ------
    ModelError
        If a node does not exist, an end is of no part, or the model cannot be reduced.
    """
    held = model.held(supports)
    as_ports = {
        name: given if isinstance(given, Port) else Port(tuple(np.atleast_1d(given).tolist()))
        for name, given in ports.items()
    }
    numbers: dict[str, Port] = {}
    for name, port in as_ports.items():
        if port.rigid:
            held, number = hold_rigid(held, port, name)
            numbers[name] = Port((number,))
    forms = {
        f"{name}:{way}": form
        for name, port in as_ports.items()
        for way, form in port_forms(held, numbers.get(name, port), name).items()
    }
    for name in ends or {}:
        part, _, quantity = name.rpartition(".")
        if part not in held.parts or quantity not in PART_QUANTITIES:
            known = ", ".join(f"{p}.{q}" for p in held.parts for q in PART_QUANTITIES) or "none, as it has no parts"
            found = f"found the quantity {name!r}"
            raise ModelError.of(model.source, ("uncertain",), found, f"one of {known}", "correct it")
    drawn = outline_of(held)
    seen = [held.row(int(node), way) for node in (drawn[0] if drawn else ()) for way in "xyz"]
    reduced, finer = reduce_model(held, np.stack([*forms.values()], axis=1), top_hz, ends, seen)
    if damping is None:
        if reduced.damping is None:
            found = "found no damping matrix and no damping law"
            raise ModelError.of(model.source, ("damping",), found, "one of the two", "state a law")
        damping = ViscousMatrix(reduced.damping)
    places = {name: port.place(held) for name, port in as_ports.items()}
    outline = None
    if drawn is not None:
        ends_of_lines = np.array([held.place(int(node)) for node in drawn[0]])
        outline = Outline(ends_of_lines, drawn[1], reduced.seen)
    placed = {name: tuple(place.tolist()) for name, place in places.items() if place is not None}
    of_model = model.source, model.n_dofs, model.size, placed, outline, model.corners
    recipe = ImportedRecipe(reduced, finer, tuple(forms), top_hz, damping, *of_model)
    return replace(recipe, accelerometer_mass=accelerometer_mass, accelerometer_dofs=tuple(accelerometer_dofs))
