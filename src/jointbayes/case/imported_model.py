"""The finite-element model that a case imports: its files read, its ports and band collected, reduced once."""

import itertools
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy import sparse

from jointbayes.case.case_objects import CaseHome, quantities_of
from jointbayes.case.spec.imported_table import ImportedSpec, ModelDampingSpec, PortSpec
from jointbayes.case.spec.structure_table import metres
from jointbayes.case.spec.whole import CaseSpec
from jointbayes.errors import ModelError
from jointbayes.structure import FeModel, FePart, ImportedRecipe, LossFactor, Port, read_structure, reduce_to_ports
from jointbayes.structure.imported import nodes_in_box
from jointbayes.structure.imported.kept import kept_or_made, key_of
from vibrecords import Data

#: Beyond the highest natural frequency that is data: a model that is a little wrong has it higher.
_BEYOND_MODES = 1.25

_Stamp = tuple[str, int, int]
"""A file by its path, its size and when it was written."""


def top_of(spec: CaseSpec, data: Data | None) -> float:
    """The highest frequency that data ask of a model, Hz, also where they have not been made yet."""
    if data is not None:
        return data.band_hz[1] * (1.0 if data.frfs else _BEYOND_MODES)
    band = spec.data.band_hz
    assert band is not None  # data of files have been read
    return band[1] * (1.0 if spec.synthetic else _BEYOND_MODES)


def reduce_imported(spec: CaseSpec, home: CaseHome, dofs: Iterable[str], top_hz: float) -> CaseSpec:
    """A case of an imported model with that read and reduced.

    Everything that the case may ask of the model is reduced at once: ports, nodes that joints, data and plan name, up
    to the highest line. Set-ups of one structure share one reduction.

    Parameters
    ----------
    spec
        The case.
    home
        From where the names of files count.
    dofs
        DOFs at which joints act, and those of data that were read from files.
    top_hz
        The highest frequency that is asked, Hz.

    Raises
    ------
    CaseError
        If a file lies outside.
    ModelError
        If one cannot be read, or the model cannot be reduced: by which key of the structure.
    """
    structure = spec.structure
    assert isinstance(structure, ImportedSpec)
    for key, name in structure.file_keys.items():
        home.require_inside(("structure", *key), [name])
    stamps = {key: _stamp(home.directory / name, key) for key, name in structure.file_keys.items()}
    model = _read(tuple(stamps.items()), structure.length_unit)
    labels = [*dofs, *spec.data.loaded, *itertools.chain(*spec.data.labelled.values())]
    labels += [*spec.plan.outputs, *spec.plan.inputs]
    named = dict.fromkeys(point for label in labels if (point := label.rpartition(":")[0]) not in structure.ports)
    ports = {name: _port(port, model, name) for name, port in structure.ports.items()}
    ports |= {point: Port((int(point),)) for point in named if point.isdecimal()}
    quantities = {nuisance.name: nuisance.range for nuisance, _ in quantities_of(spec)}
    whole = sum(max(map(abs, quantities.get(q, (0.0, 0.0)))) for q in ("youngs_modulus", "density")) / 2
    ends = {
        name: tuple(np.exp(range_).tolist())
        for name, range_ in quantities.items()
        if name.rpartition(".")[0] in model.parts
    }
    recipe = _reduced(
        tuple(stamps.items()),
        structure.length_unit,
        tuple(ports.items()),
        max(structure.top_hz or 0.0, top_hz * float(np.exp(whole))),
        tuple(ends.items()),
        tuple((int(node), way) for node, _, way in (label.rpartition(":") for label in structure.supports)),
        isinstance(structure.damping, ModelDampingSpec),
    )
    return spec.model_copy(update={"structure": structure.with_reduced(recipe)})


def _stamp(file: Path, key: tuple[str, ...]) -> _Stamp:
    try:
        state = file.stat()
    except OSError:
        raise ModelError.of(str(file.name), key, "found no such file", "the model's file", "correct the name") from None
    return str(file), state.st_size, state.st_mtime_ns


@lru_cache(maxsize=4)
def _read(stamps: tuple[tuple[tuple[str, ...], _Stamp], ...], length_unit: str) -> FeModel:
    files = {key: Path(path) for key, (path, _, _) in stamps}
    further = {key: files.get((f"{key}_file",)) for key in ("mass", "damping", "dofs", "nodes")}
    model = read_structure(files["file",], length_unit=length_unit, **further)
    maps = {key: further[key] for key in ("dofs", "nodes")}
    parts = {}
    for name in dict.fromkeys(key[1] for key in files if key[0] == "parts"):
        of = {key[2]: file for key, file in files.items() if key[:2] == ("parts", name)}
        part = read_structure(of["file"], length_unit=length_unit, mass=of.get("mass_file"), **maps)
        bending = None
        if "bending_file" in of:
            bending = read_structure(of["bending_file"], length_unit=length_unit, mass=of.get("mass_file"), **maps)
        parts[name] = _part(model, part, bending, name)
    return replace(model, parts={**model.parts, **parts})


def _part(model: FeModel, part: FeModel, bending: FeModel | None, name: str) -> FePart:
    """A part on the rows of the whole model."""
    missing = [row for row in map(tuple, part.dofs.tolist()) if row not in model.row_of]
    if missing:
        node, way = missing[0]
        found = f"found DOF {way} of node {node} in {part.source}, which {model.source} does not have"
        raise ModelError.of(
            part.source, ("parts", name, "file"), found, "a part of it", "export both with one numbering"
        )
    rows = [model.row_of[row] for row in map(tuple, part.dofs.tolist())]
    place = sparse.eye_array(model.n_dofs, format="csc")[:, rows]
    stiffness, mass = (place @ matrix @ place.T for matrix in (part.stiffness, part.mass))
    if bending is None:
        return FePart(stiffness, mass)
    bent = _part(model, bending, None, name).stiffness
    return FePart(stiffness - bent, mass, bent)


def _port(spec: PortSpec, model: FeModel, name: str) -> Port:
    nodes: tuple[int, ...] = (spec.node,) if spec.node is not None else spec.nodes
    if spec.box_mm is not None:
        corners = np.sort([metres(corner) for corner in spec.box_mm], axis=0)
        nodes = nodes_in_box(model, *corners)
        if not nodes:
            ends = [f"{low:g} to {high:g}" for low, high in zip(*(1e3 * np.array(model.extent)), strict=True)]
            found = f"found no node of {model.source} in the box"
            expected = f"some of its {len(model.nodes)}, which lie at x {ends[0]}, y {ends[1]}, z {ends[2]} mm"
            raise ModelError.of(f"port {name}", ("ports", name, "box_mm"), found, expected, "correct the corners")
    return Port(nodes, spec.kind == "rigid", None if spec.at_mm is None else metres(spec.at_mm))


@lru_cache(maxsize=8)
def _reduced(
    stamps: tuple[tuple[tuple[str, ...], _Stamp], ...],
    length_unit: str,
    ports: tuple[tuple[str, Port], ...],
    top_hz: float,
    ends: tuple[tuple[str, tuple[float, float]], ...],
    supports: tuple[tuple[int, str], ...],
    own_damping: bool,
) -> ImportedRecipe:
    model, law = _read(stamps, length_unit), None if own_damping else LossFactor(0.0)
    files = [Path(path) for _, (path, _, _) in stamps]
    return kept_or_made(
        model.n_dofs,
        lambda: key_of(files, length_unit, ports, top_hz, ends, supports, own_damping),
        lambda: reduce_to_ports(model, dict(ports), top_hz, law, ends=dict(ends), supports=supports),
    )
