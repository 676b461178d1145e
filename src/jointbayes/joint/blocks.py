"""Several joints as one parametrisation: their coordinates, stiffnesses and matrices side by side."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, permutations
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.errors import ModelError
from jointbayes.joint.parametrisation import CondensedCoordinates, Cone, Parametrisation
from jointbayes.joint.quantities import Coordinate, Quantity
from vibrecords.arrays import Array, Flags, Indices

_ALL_ORDERS = 4  # joints of a kind, of which all orders are exchanges


@dataclass(frozen=True, slots=True)
class Block:
    """One joint, or several that share their quantities.

    Parameters
    ----------
    name
        What its quantities are prefixed with; none where it is empty.
    parametrisation
        Of one of the joints.
    rows
        Rows of K^J at which the DOFs of each joint begin.
    joints
        Names of those joints; by default that of the quantities.
    """

    name: str
    parametrisation: Parametrisation
    rows: tuple[int, ...]
    joints: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", tuple(self.joints) or (self.name,))


@dataclass(frozen=True)
class Blocks(Parametrisation):
    """Product of parametrisations: θ, quantities and matrices one after the other, see `blocks_of`.

    Parameters
    ----------
    blocks
        In order.

    Raises
    ------
    ModelError
        If a name occurs twice.
    """

    blocks: tuple[Block, ...]

    key: ClassVar[str] = "blocks"

    def __post_init__(self) -> None:
        names = [block.name for block in self.blocks]
        if len(set(names)) != len(names):
            raise ModelError.of("joints", (), f"found names {', '.join(names)}", "each once", "rename one")

    @cached_property
    def axes(self) -> tuple[Coordinate, ...]:
        """The coordinates of all, with the names of their joints."""
        return tuple(axis.assign_to_joint(block.name) for block in self.blocks for axis in block.parametrisation.axes)

    @cached_property
    def quantities(self) -> tuple[Quantity, ...]:
        """The quantities of all, with the names of their joints."""
        return tuple(
            q.assign_to_joint(block.name, block.rows) for block in self.blocks for q in block.parametrisation.quantities
        )

    @cached_property
    def held(self) -> tuple[int, ...]:
        """Rows of K^J that are rigid and no quantity."""
        return tuple(row + i for block in self.blocks for row in block.rows for i in block.parametrisation.held)

    @cached_property
    def _parts(self) -> tuple[tuple[Parametrisation, slice, slice], ...]:
        """Each block with its columns of θ and of the quantities."""
        parts, t, k = [], 0, 0
        for block in self.blocks:
            joint = block.parametrisation
            parts.append((joint, slice(t, t + len(joint.axes)), slice(k, k + len(joint.quantities))))
            t, k = t + len(joint.axes), k + len(joint.quantities)
        return tuple(parts)

    @cached_property
    def cones(self) -> tuple[Cone, ...]:
        """Those of all."""
        return tuple(cone.moved(t.start) for joint, t, _ in self._parts for cone in joint.cones)

    @cached_property
    def ridges(self) -> tuple[CondensedCoordinates, ...]:
        """Those of all."""
        return tuple(CondensedCoordinates(r.cone.moved(t.start)) for joint, t, _ in self._parts for r in joint.ridges)

    @property
    def exchanges(self) -> Indices:
        """Columns of θ after exchanges of like joints: all orders of up to four of a kind, and pairs of more.

        The first exchange leaves them as they are. Of several tests with quantities of their own, ``low.foot`` and
        ``high.foot``, joints change places in all.
        """
        kinds: dict[str, list[tuple[str, Parametrisation]]] = {}
        columns: dict[str, list[Indices]] = {}
        for block, (parametrisation, t, _) in zip(self.blocks, self._parts, strict=True):
            test, _, joint = block.name.rpartition(".")
            kinds.setdefault(joint, []).append((test, parametrisation))
            columns.setdefault(joint, []).append(np.arange(t.start, t.stop))
        orders: list[dict[str, str]] = [{}]
        for kind in [kind for i, kind in enumerate(kinds.values()) if kind not in list(kinds.values())[:i]]:
            like = [joint for joint, other in kinds.items() if other == kind]
            if len(like) <= _ALL_ORDERS:
                exchanged = [dict(zip(like, new, strict=True)) for new in permutations(like)]
            else:
                none = dict(zip(like, like, strict=True))
                exchanged = [none, *(none | {one: other, other: one} for one, other in combinations(like, 2))]
            orders = [order | new for order in orders for new in exchanged]
        columns_after = np.tile(np.arange(len(self.axes)), (len(orders), 1))
        for row, order in zip(columns_after, orders, strict=True):
            for here, taken in order.items():
                row[np.concatenate(columns[here])] = np.concatenate(columns[taken])
        return columns_after

    def _each(
        self, of: Callable[[Parametrisation, Array], ArrayLike], numbers: ArrayLike, are_values: bool
    ) -> list[Array]:
        """What a function gives of each block and its part of θ or of the quantities, shape (..., d) or (..., q)."""
        array = np.asarray(numbers, dtype=float)
        return [np.asarray(of(joint, array[..., k if are_values else t])) for joint, t, k in self._parts]

    def _side_by_side(self, parts: Sequence[Array], numbers: ArrayLike) -> Array:
        none = np.asarray(numbers, dtype=float)[..., :0]  # gives the shape where there are no parts
        return np.concatenate([none, *parts], axis=-1)

    def values(self, theta: ArrayLike) -> Array:
        """Quantities, shape (..., q), from θ, shape (..., d)."""
        return self._side_by_side(self._each(lambda joint, t: joint.values(t), theta, False), theta)

    def describes(self, values: ArrayLike) -> Flags:
        """Whether all have coordinates."""
        return np.logical_and.reduce(self._each(lambda joint, k: joint.describes(k), values, True))

    def _coordinates(self, values: Array) -> Array:
        return self._side_by_side(self._each(lambda joint, k: joint._coordinates(k), values, True), values)

    def derivative(self, theta: ArrayLike) -> Array:
        """∂k/∂θ, shape (..., q, d), block by block."""
        t = np.asarray(theta, dtype=float)
        slope = np.zeros((*t.shape[:-1], len(self.quantities), t.shape[-1]))
        for joint, columns, rows in self._parts:
            slope[..., rows, columns] = joint.derivative(t[..., columns])
        return slope

    def log_slope(self, theta: Array) -> Array:
        """ln |∂k/∂θ|, shape (...): the sum of all."""
        return np.sum(self._each(lambda joint, t: joint.log_slope(t), theta, False), axis=0)

    def log_determinant(self, theta: Array) -> Array:
        """ln det of the blocks, shape (...): the sum of all."""
        return np.sum(self._each(lambda joint, t: joint.log_determinant(t), theta, False), axis=0)

    def nearest(self, values: ArrayLike) -> Array:
        """The nearest joint of each, shape (q,)."""
        return self._side_by_side(self._each(lambda joint, k: joint.nearest(k), values, True), values)

    def is_positive_semidefinite(self, values: ArrayLike) -> Flags:
        """Whether every joint is, shape (...)."""
        return np.logical_and.reduce(self._each(lambda joint, k: joint.is_positive_semidefinite(k), values, True))

    def uncoupled(self, values: ArrayLike) -> Array:
        """The same joints, shape (..., q), each without coupling."""
        return self._side_by_side(self._each(lambda joint, k: joint.uncoupled(k), values, True), values)

    def middle(self, mean: Array) -> Array:
        """The joints, shape (q,), at the means of the priors of their coordinates, shape (d,)."""
        return self._side_by_side(self._each(lambda joint, t: joint.middle(t), mean, False), mean)

    def _semidefinite(self, values: Array) -> str:
        at_fault = [
            block.name
            for block, (joint, _, k) in zip(self.blocks, self._parts, strict=True)
            if not joint.is_positive_semidefinite(values[k])
        ]
        return (
            f"a positive semidefinite matrix of {', '.join(at_fault)}; lower its couplings, or raise the stiffnesses "
            "beside them"
        )

    def compliance(self, theta: Array) -> Array:
        """φ of each joint, shape (n, d), of θ, shape (n, d)."""
        return self._side_by_side(self._each(lambda joint, t: joint.compliance(t), theta, False), theta)

    def coordinates_of_compliance(self, phi: Array) -> tuple[Array, Flags]:
        """θ, shape (n, d), of φ, shape (n, d), and whether φ is a joint each, shape (n,)."""
        parts = [joint.coordinates_of_compliance(phi[:, t]) for joint, t, _ in self._parts]
        inside = np.logical_and.reduce([inside for _, inside in parts])
        return self._side_by_side([theta for theta, _ in parts], phi), inside

    def log_compliance_volume(self, theta: Array) -> Array:
        """ln |∂θ/∂φ|, shape (n,): the sum of all."""
        return np.sum(self._each(lambda joint, t: joint.log_compliance_volume(t), theta, False), axis=0)


def blocks_of(joints: Mapping[str, Parametrisation | str]) -> Parametrisation:
    """Parametrisation of several joints in the order in which they are given.

    Parameters
    ----------
    joints
        By the joint's name its parametrisation, or the name of the joint whose quantities it shares. Of a lone joint
        without a name the parametrisation itself comes back.

    Raises
    ------
    ModelError
        If a joint shares the quantities of one that is not there, or that shares those of another.
    """
    rows: dict[str, list[int]] = {name: [] for name in joints}
    sharing: dict[str, list[str]] = {name: [] for name in joints}
    row = 0
    for name, joint in joints.items():
        owner = joint if isinstance(joint, str) else name
        shared = joints.get(owner)
        if not isinstance(shared, Parametrisation):
            owners = ", ".join(other for other, of in joints.items() if isinstance(of, Parametrisation)) or "no one"
            found, expected = f"found shared quantities of {owner!r}", f"one with quantities of its own, {owners}"
            raise ModelError.of(f"joint {name}", ("joints", name, "shared"), found, expected, "name that one")
        rows[owner].append(row)
        sharing[owner].append(name)
        row += shared.size
    alone = [(name, joint) for name, joint in joints.items() if not isinstance(joint, str)]
    if len(joints) == 1 and alone[0][0] == "":
        return alone[0][1]
    return Blocks(tuple(Block(name, joint, tuple(rows[name]), tuple(sharing[name])) for name, joint in alone))
