"""The `[structure]` table of an imported finite-element model: its files, its ports, its parts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, PrivateAttr, Strict

from jointbayes.case.spec.fields import Finding, Spec, count_field, key_field, listed, max_length, positive
from jointbayes.case.spec.structure_table import DAMPING, KIND, LAWS, POINT, Absence, DampingSpec, StructureBase

if TYPE_CHECKING:
    from jointbayes.structure import ImportedRecipe

_DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")
_MOST_NODE = 1_000_000_000
_Node = Annotated[int, Field(ge=1, le=_MOST_NODE)]
_Corner = Annotated[tuple[float, float, float], Strict(False)]
_Vector = key_field(
    "the place of the point whose motion it is in mm, without it the mean place of its nodes", [0, 0, 0]
)


class PortSpec(Spec):
    """Where joints or sensors hold an imported model: a node, or a patch of nodes that moves as one."""

    node: Annotated[int | None, count_field("the number of a node", 1021, 1, _MOST_NODE)] = None
    nodes: Annotated[
        tuple[_Node, ...],
        Strict(False),
        max_length(100_000),
        key_field(f"a list of node numbers from 1 to {_MOST_NODE}, a patch", [7, 8, 9]),
    ] = ()
    box_mm: Annotated[
        tuple[_Corner, _Corner] | None,
        Strict(False),
        key_field("two opposite corners in mm of a box: all nodes in it", [[-0.1, 0, 0], [0.1, 30, 20]]),
    ] = None
    kind: Annotated[
        Literal["averaged", "rigid"],
        key_field('how a patch moves, "averaged" (RBE3, stiffens nothing) or "rigid" (RBE2)', "averaged"),
    ] = "averaged"
    at_mm: Annotated[_Corner | None, Strict(False), _Vector] = None

    def _findings(self) -> Iterator[Finding]:
        given = [key for key in ("node", "nodes", "box_mm") if getattr(self, key) not in (None, ())]
        if len(given) != 1:
            found = f"found {' and '.join(given) or 'none of node, nodes, box_mm'}"
            yield Finding((given[-1],) if given else (), found, "one of node, nodes and box_mm", "state one of them")


class PartSpec(Spec):
    """A part of an imported model whose modulus, density or thickness is uncertain: an export of that part alone."""

    file: Annotated[str, key_field("the file of the part's own K and M, on DOFs of the whole model", "wall.npz")]
    mass_file: Annotated[str | None, key_field("the file of its M, where that is another", "wall.mas")] = None
    bending_file: Annotated[
        str | None, key_field("the file of the share of its K that grows with thickness³", "wall_bending.npz")
    ] = None


class ModelDampingSpec(DampingSpec):
    """Viscous damping by the matrix C of the model's files."""

    law: Annotated[Literal["model"], Field(description="the damping matrix of the model's files")]


class ImportedSpec(StructureBase):
    """The structure without its joints, imported from a finite-element program."""

    kind: Annotated[Literal["imported"], KIND]
    file: Annotated[str, key_field("the file of the model, or of its stiffness matrix", "bracket.npz")]
    mass_file: Annotated[str | None, key_field("the file of the mass matrix, where it has its own", "bracket.mas")] = (
        None
    )
    damping_file: Annotated[str | None, key_field("the file of the damping matrix C, if any", "bracket.dmp")] = None
    dofs_file: Annotated[
        str | None, key_field("the file that says which node and direction each row is", "bracket.dof")
    ] = None
    nodes_file: Annotated[str | None, key_field("the file with the places of the nodes", "bracket.inp")] = None
    length_unit: Annotated[
        Literal["m", "mm", "in"],
        key_field('the unit of length of its files: "m" (N, kg), "mm" (N, t) or "in" (lbf)', "m"),
    ] = "m"
    top_hz: Annotated[
        float | None, positive("the frequency in Hz up to which it is reduced, by itself that of the data", 3000.0)
    ] = None
    ports: Annotated[
        dict[str, PortSpec], Field(description="a table for each port, as [structure.ports.tip]", max_length=1000)
    ] = {}  # noqa: RUF012 (pydantic copies it)
    parts: Annotated[
        dict[str, PartSpec], Field(description="a table for each part that may be uncertain", max_length=100)
    ] = {}  # noqa: RUF012
    damping: Annotated[LAWS | ModelDampingSpec, DAMPING]

    _reduced: ImportedRecipe | None = PrivateAttr(default=None)

    def with_reduced(self, recipe: ImportedRecipe) -> ImportedSpec:
        """The table with its files read and the model reduced."""
        same = self.model_copy()
        same._reduced = recipe
        return same

    @property
    def file_keys(self) -> dict[tuple[str, ...], str]:
        """Names of its files by their keys below the table."""
        own: dict[tuple[str, ...], str | None] = {
            (key,): getattr(self, key) for key in ("file", "mass_file", "damping_file", "dofs_file", "nodes_file")
        }
        for name, part in self.parts.items():
            own |= {("parts", name, key): getattr(part, key) for key in ("file", "mass_file", "bending_file")}
        return {key: name for key, name in own.items() if name is not None}

    @property
    def points_in_order(self) -> tuple[str, ...]:
        """Names of its ports, and once it is reduced numbers of nodes that the case uses."""
        used = self._reduced.dofs if self._reduced is not None else ()
        return tuple(dict.fromkeys([*self.ports, *(label.rpartition(":")[0] for label in used)]))

    @property
    def directions(self) -> tuple[str, ...]:
        """Those of its nodes and ports, as far as it has been read."""
        if self._reduced is None:
            return _DIRECTIONS
        there = {label.rpartition(":")[2] for label in self._reduced.dofs}
        return tuple(way for way in _DIRECTIONS if way in there)

    @property
    def free_dofs(self) -> int:
        """More than anyone measures."""
        return 1_000_000

    @property
    def stated(self) -> dict[str, tuple[str, float]]:
        """Unit and value of each quantity that may be uncertain."""
        quantities = ("youngs_modulus", "density", "thickness")
        names = ["youngs_modulus", "density", *(f"{part}.{q}" for part in self.parts for q in quantities)]
        stated = dict.fromkeys(names, ("× stated", 1.0))
        return stated | {"accelerometer_mass": ("g", self.accelerometer_mass_g)} | super().stated

    def absent(self, label: str) -> Absence | None:
        """What to say of a DOF that does not exist; of a node that is not read yet nothing."""
        point, _, direction = label.rpartition(":")
        if point not in self.ports and not point.isdecimal():
            expected = (
                f"one of {listed(tuple(self.ports))}, or the number of a node" if self.ports else "the number of a node"
            )
            return (
                f'"{label}": there is no port {point}',
                expected,
                f"add [structure.ports.{point}], or correct the name",
            )
        if direction not in _DIRECTIONS:
            return f'"{label}": no direction {direction}', f"one of {', '.join(_DIRECTIONS)}", "choose one of these"
        if self._reduced is not None and label not in self._reduced.dofs:
            ways = [dof for dof in self._reduced.dofs if dof.rpartition(":")[0] == point]
            return f'"{label}": no such DOF in the model', f"one of {listed(ways or self._reduced.dofs)}", "correct it"
        return None

    def place(self, label: str) -> str:
        """A port by its name, or a node by its number."""
        point = label.rpartition(":")[0]
        return f"port {point}" if point in self.ports else f"node {point}"

    def recipe(self, loaded: tuple[str, ...]) -> ImportedRecipe:
        """The structure once it is reduced, with accelerometers where they sit."""
        from dataclasses import replace

        assert self._reduced is not None
        masses = {"accelerometer_mass": self.accelerometer_mass_g * 1e-3, "accelerometer_dofs": loaded}
        if isinstance(self.damping, ModelDampingSpec):
            return replace(self._reduced, **masses)  # type: ignore[arg-type]
        return replace(self._reduced, damping=self.damping.built(), **masses)  # type: ignore[arg-type]

    def _findings(self) -> Iterator[Finding]:
        for table, name in [*(("ports", name) for name in self.ports), *(("parts", name) for name in self.parts)]:
            if not POINT.fullmatch(name) or name[0].isdecimal():
                expected = "a word of letters, digits, _ and - that begins with a letter"
                yield Finding((table, name), f'found the name "{name[:40]}"', expected, f"rename the {table[:-1]}")
        yield from super()._findings()
