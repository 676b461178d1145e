"""Beams next to an imported model, such as a tool in a meshed holder: nothing but joints connects them."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy import sparse

from jointbayes.structure.damping import LossFactor
from jointbayes.structure.frame import FrameBody
from jointbayes.structure.frame_element import lobatto_points
from jointbayes.structure.frame_recipe import FrameRecipe
from jointbayes.structure.imported.fe_model import DIRECTIONS, FeModel, FePart, Sparse
from vibrecords.arrays import Array


def with_beams(model: FeModel, bodies: Mapping[str, FrameBody], top_hz: float) -> tuple[FeModel, dict[str, int]]:
    """The model with bodies of beams added, meshed up to a frequency in Hz, and their points' node numbers.

    Each body is a part, whose modulus and density may be uncertain; points are named as ``"tool.tip"``. The matrix C of
    the model damps no beam.

    Raises
    ------
    ModelError
        If a name is not possible, or the frequency is too high for a body.
    """
    recipe = FrameRecipe(tuple(bodies.items()), LossFactor(0.0))
    mesh = recipe.mesh(None, top_hz)
    beams, n = recipe.structure({}, mesh), model.n_dofs
    first = 1 + int(max(model.dofs[:, 0].max(), model.nodes.max(initial=0)))
    names = [label.partition(":") for label in beams.dofs]
    numbers = {name: first + i for i, name in enumerate(dict.fromkeys(name for name, _, _ in names))}
    places = {name: np.array(place) for name, place in recipe.positions.items()}
    for name, of_body in zip(bodies, mesh, strict=True):  # nodes between points lie on the axes of the beams
        for i, (segment, (count, order)) in enumerate(zip(of_body.segments, of_body.elements, strict=True)):
            ends = [places[f"{name}.{at}"] + o for at, o in zip(segment.points, segment.offsets, strict=True)]
            along = (np.arange(count)[:, None] + (lobatto_points(order)[1:] + 1) / 2).ravel() / count
            for k, share in enumerate(along[:-1], 1):
                places[f"{name}.~{i}~{k}"] = ends[0] + share * (ends[1] - ends[0])

    def beside(matrix: Sparse | None, other: Array) -> Sparse:
        return sparse.block_diag((sparse.csc_array((n, n)) if matrix is None else matrix, other), format="csc")

    none = np.zeros_like(beams.mass)
    parts = {
        name: FePart(*(None if m is None else beside(m, none) for m in (part.stiffness, part.mass, part.bending)))
        for name, part in model.parts.items()
    }
    for name in bodies:  # what grows with the factor: no mass at a point, no axial force
        stiffer, heavier = (recipe.structure({f"{name}.{q}": 2.0}, mesh) for q in ("youngs_modulus", "density"))
        grown = stiffer.stiffness - beams.stiffness, heavier.mass - beams.mass
        parts[name] = FePart(*(beside(None, matrix) for matrix in grown))
    edges = [
        (numbers[f"{name}.{a}"], numbers[f"{name}.{b}"])
        for name, body in bodies.items()
        for member in body.members
        for a, b in pairwise(member.points)
    ]
    whole = replace(
        model,
        stiffness=beside(model.stiffness, beams.stiffness),
        mass=beside(model.mass, beams.mass),
        damping=None if model.damping is None else beside(model.damping, none),
        dofs=np.vstack([model.dofs, [(numbers[name], DIRECTIONS.index(way) + 1) for name, _, way in names]]),
        nodes=np.concatenate([model.nodes, [*numbers.values()]]),
        places=np.concatenate([model.places, [places[name] for name in numbers]]),
        parts=parts,
        edges=None if model.edges is None else np.concatenate([model.edges, edges]),
    )
    return whole, {name: numbers[name] for name in recipe.positions}
