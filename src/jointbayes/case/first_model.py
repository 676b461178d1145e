"""What a first case says of an imported model: its files, the place of the joint, and the DOFs of the channels."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from jointbayes.case.toml_text import toml_value
from jointbayes.errors import ModelError
from jointbayes.structure.imported.fe_model import DIRECTIONS, FeModel
from jointbayes.structure.imported.read import UNITS, holds_matrices, read_structure
from vibrecords.arrays import Array
from vibrecords.formats.read import detect_format
from vibrecords.formats.uff_data_sets import places_of_points
from vibrecords.records import parse_dof

#: Endings of files that only a model has, and the key of `[structure]` that names each.
_KEYS = {
    **dict.fromkeys((".sti", ".mtx", ".mmf", ".rb", ".hb", ".matrix", ".op4", ".pch"), "file"),
    **dict.fromkeys((".dof", ".asm", ".mapping"), "dofs_file"),
    **dict.fromkeys((".inp", ".cdb", ".bdf", ".nas"), "nodes_file"),
    ".mas": "mass_file",
}
_ARRAYS = (".npz", ".mat", ".h5", ".hdf5")
_MASS, _DAMPING = re.compile(r"mass|(?<![a-z])m(?![a-z])"), re.compile(r"damp|(?<![a-z])c(?![a-z])")
#: A measured point lies on a node if it is off by less than this part of its distance from the origin.
_OFF = 0.02


def files_of_model(paths: Sequence[Path]) -> dict[str, Path]:
    """Return the files of a finite-element model among some files, by their keys in `[structure]`.

    The ending decides. Of npz, MATLAB and HDF5 files the content decides, and of CSV files the title line. A matrix in
    a file of its own is the mass or the damping if its name says so, or if it is the second one.
    """
    found: dict[str, Path] = {}
    for path in paths:
        key, suffix, name = _KEYS.get(path.suffix.lower()), path.suffix.lower(), path.stem.lower()
        if suffix == ".csv" and path.is_file():
            with path.open(encoding="utf-8-sig", errors="replace") as lines:
                words = re.split(r"[;,\t]", lines.readline(200).lower())
            key = {2: "dofs_file", 4: "nodes_file"}.get(len(words)) if words[0].strip() == "node" else None
        elif suffix in _ARRAYS and path.is_file() and holds_matrices(path):
            key = "file"
        if key == "file" and (_MASS.search(name) or "file" in found) and suffix not in (".op4", ".pch"):
            key = "damping_file" if _DAMPING.search(name) else "mass_file"
        if key is not None:
            found.setdefault(key, path)
    return found


@dataclass(frozen=True)
class FirstModel:
    """An imported model in a first case.

    Parameters
    ----------
    names
        Names of its files by their keys in `[structure]`, as the case gives them.
    model
        The model. Its lengths are in `unit`, which is only a guess.
    unit
        Unit of length in which the model was read.
    points
        Places of measured points by their numbers, each shape (3,), in the unit of the measurement file.
    """

    names: Mapping[str, str]
    model: FeModel
    unit: str
    points: Mapping[int, Array] = field(default_factory=dict)

    @classmethod
    def read(cls, files: Mapping[str, Path], names: Mapping[str, str], measured: Sequence[Path]) -> "FirstModel":
        """Return the model of some files, in the first unit of length that is possible.

        Raises
        ------
        ModelError
            If a file cannot be read, or another one is needed.
        """
        further = {key: files.get(f"{key}_file") for key in ("mass", "damping", "dofs", "nodes")}
        for unit in UNITS:
            try:
                model = read_structure(files["file"], length_unit=unit, **further)
                break
            except ModelError as error:
                if unit == list(UNITS)[-1]:
                    raise ModelError(f"{error}; a further file of the model is named behind --from, too") from None
        points: dict[int, Array] = {}
        for path in measured:
            if path.is_file() and detect_format(path) == "uff":
                points |= places_of_points(path)
        return cls(names, model, unit, points)

    @cached_property
    def node_of(self) -> dict[int, int]:
        """Node of the model at each measured point; empty if no points are known or they do not lie on its nodes."""
        moving = np.isin(self.model.nodes, self.model.dofs[:, 0])
        if not self.points or not moving.any():
            return {}
        from scipy.spatial import KDTree

        nodes, tree = self.model.nodes[moving], KDTree(self.model.places[moving])
        here, least, nearest = np.array(list(self.points.values())), _OFF, np.empty(0, dtype=np.intp)
        farthest = max(float(np.linalg.norm(here, axis=1).max()), np.finfo(float).tiny)
        lengths = [length for length, _ in UNITS.values()]
        for ratio in sorted({one / other for one in lengths for other in lengths}):
            distance, at = tree.query(ratio * here)
            if (off := float(np.max(distance)) / (ratio * farthest)) < least:
                least, nearest = off, np.asarray(at)
        return dict(zip(self.points, nodes[nearest].tolist(), strict=False))

    def dof(self, label: str) -> str:
        """DOF of the model for a channel: at the same place, or else with the same number; "?" if it has none."""
        parsed = parse_dof(label)
        if parsed is None or not parsed.direction:
            return "?"
        node = self.node_of.get(parsed.node) if self.points else parsed.node
        way = DIRECTIONS[abs(parsed.direction) - 1]
        if node is None or self.model.row(node, way) is None:
            return "?"
        return f"{'-' if parsed.direction < 0 else ''}{node}:{way}"

    @property
    def how(self) -> str:
        """How DOFs were found, in words."""
        return "at the nodes where the file has its points" if self.points else "at the nodes that the labels name"

    def lines(self, damping: str) -> Iterator[str]:
        """The tables `[structure]` and `[joint]`, with a question for the unit and one for the place of the joint."""
        model, (length, energy) = self.model, UNITS[self.unit]
        yield f"# 1. The structure without its joint is an FE model of {model.n_dofs} DOFs. In which unit of length?"
        for unit, (other, of_energy) in UNITS.items():
            mass = model.whole_mass * of_energy / energy * (length / other) ** 2
            sides = [side * other / length for side in model.box or ()]
            size = f", {' × '.join(f'{side:.4g}' for side in sides)} m" if sides else ""
            yield f'#    "{unit}" makes it {mass:.4g} kg{size}.'
        yield "[structure]"
        yield 'kind = "imported"'
        yield from (f"{key} = {toml_value(name)}" for key, name in self.names.items())
        yield 'length_unit = "?"'
        yield from [damping] * bool(damping)
        yield ""
        yield "# 2. Where is the joint? Two corners of a box around the nodes of its face, [[x, y, z], [x, y, z]], or a"
        yield '#    node in place of the box: node = 12. With kind = "rigid" the face moves as one body.'
        yield "[structure.ports.joint]"
        ways = sorted(set(model.dofs[:, 1].tolist()) - {0})
        if model.box is None:
            yield 'node = "?"'
        else:
            ends = zip("xyz", *(end / length for end in model.extent), strict=True)
            reach = ", ".join(f"{way} {low:.4g} to {high:.4g}" for way, low, high in ends)
            yield f'box_mm = "?"   # the file reaches {reach}, in its own unit'
            ways = list(range(1, 7)) if ways == [1, 2, 3] else ways
        yield ""
        yield "[joint]"
        yield 'kind = "springs"'
        yield f"dofs = {toml_value([f'joint:{DIRECTIONS[way - 1]}' for way in ways])}"
