"""A few lines that show a large mesh: its surface edges, nodes that lie close together taken for one."""

from dataclasses import dataclass

import numpy as np

from jointbayes.structure.imported.fe_model import FeModel
from vibrecords.arrays import Array, Indices

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
