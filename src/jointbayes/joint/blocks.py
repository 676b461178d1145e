"""Several joints as one parametrisation: their coordinates, stiffnesses and matrices side by side."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, permutations
from typing import ClassVar

import numpy as np

from jointbayes.errors import ModelError
from jointbayes.joint.parametrisation import LOWER_COUPLINGS, Parametrisation
from jointbayes.joint.quantities import Coordinate, Quantity
from jointbayes.joint.side_by_side import SideBySide
from vibrecords.arrays import Array, Indices

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
        Names of those joints; by default the quantities'.
    """

    name: str
    parametrisation: Parametrisation
    rows: tuple[int, ...]
    joints: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", tuple(self.joints) or (self.name,))


@dataclass(frozen=True)
class Blocks(SideBySide):
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
    def product_of(self) -> tuple[Parametrisation, ...]:
        """The parametrisation of each block."""
        return tuple(block.parametrisation for block in self.blocks)

    @property
    def exchanges(self) -> Indices:
        """Columns of θ after exchanges of like joints: all orders of up to four of a kind, and pairs of more.

        The first exchange leaves them as they are. Of several tests with quantities of their own, ``low.foot`` and
        ``high.foot``, joints change places in all.
        """
        kinds: dict[str, list[tuple[str, Parametrisation]]] = {}
        columns: dict[str, list[Indices]] = {}
        for block, (parametrisation, t, _) in zip(self.blocks, self.parts, strict=True):
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

    def _semidefinite(self, values: Array) -> tuple[str, str]:
        at_fault = [
            block.name
            for block, (joint, _, k) in zip(self.blocks, self.parts, strict=True)
            if not joint.is_positive_semidefinite(values[k])
        ]
        return f"a positive semidefinite matrix of {', '.join(at_fault)}", LOWER_COUPLINGS


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
