"""Are the coordinates and DOFs of an imported model those of its matrices? Rigid motions tell: they strain nothing."""

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from jointbayes.errors import ModelError
from jointbayes.structure.imported.fe_model import DIRECTIONS, FeModel
from vibrecords.arrays import Array, Flags, Indices

#: What of |K||φ| is left in a row of a node that is strained, by a translation and by a turn, and of one that nothing
#: strains: files have ten digits, coordinates of input files six.
_STRAINED, _TURNED, _FREE = 1e-4, 1e-3, 1e-5
_RELEASED = 1e-6  # the same once the strained nodes may move
_DIGITS = 1e-5  # of the model's extent
_FEW = 0.01  # of the nodes may be strained by turning alone, as loads of a prestressed model do
_NO_MASS = 0.02  # of φᵀ|M|φ: a stiffness matrix whose supports hold few nodes has less
_GROUND = 1e-10  # of the diagonal: keeps the solve of a part that floats regular


def require_own_axes(model: FeModel) -> tuple[str, ...]:
    """Refuse a model whose coordinates, DOFs or mass are not those of its stiffness matrix; return notes on supports.

    1. Moving everything along an axis must take mass along: otherwise K stands in place of M.
    2. Turning everything must not strain nodes that moving does not strain: otherwise coordinates are wrong.
    3. Where moving strains nodes, let these move as they like. At a support a reaction stays. Where none stays, K
       floats and the DOFs of these nodes do not point along the axes.

    Rows next to generalised coordinates are passed over: how these move with the whole is not known.

    Raises
    ------
    ModelError
        With the nodes that were found, and what to do.
    """
    nodes, of_row = np.unique(model.dofs[:, 0], return_inverse=True)
    ways, size = model.dofs[:, 1], abs(model.stiffness)
    along = (ways[:, None] == np.arange(1, 4)).astype(float)

    # 1. mass
    for way, moved in zip("xyz", along.T, strict=True):
        most = float(moved @ (abs(model.mass) @ moved))
        if most > 0 and model.mass_along(way) <= _NO_MASS * most:
            found = f"found {model.mass_along(way):.3g} kg when all moves along {way}, as if M were a stiffness matrix"
            remedy = "K and M are exchanged, or one file is given twice: correct file and mass"
            raise ModelError.of(model.source, ("mass",), found, "a mass matrix in kg", remedy)

    # 2. turning
    unknown = ways < 1
    moved = _left(model, along, unknown)
    touched = _nodes_of(moved.max(axis=1) > _FREE, of_row)
    touched |= _nodes_of(size @ touched[of_row].astype(float) > 0, of_row)  # a symmetric support may strain a node so
    places = np.full((len(nodes), 3), np.nan)
    placed, at = np.isin(nodes, model.nodes), np.argsort(model.nodes)
    places[placed] = model.places[at[np.searchsorted(model.nodes, nodes[placed], sorter=at)]]
    if placed.any():
        arms = (places - places[placed].mean(axis=0))[of_row]
        turns = np.eye(3)[np.clip(ways - 4, 0, 2)]
        turns[ways <= 3] = np.cross(arms[ways <= 3], np.eye(3)[np.clip(ways[ways <= 3] - 1, 0, 2)])
        unplaced = unknown | ~placed[of_row]
        turns[unplaced] = 0.0
        allowed = _DIGITS * float(np.ptp(places[placed], axis=0).max()) * (size @ along.sum(axis=1))
        turned = _left(model, turns, unplaced, allowed).max(axis=1) > _TURNED
        bad = _nodes_of(turned & (ways <= 3), of_row) & ~touched
        if bad.sum() > _FEW * len(nodes):
            found = f"found {_listed(nodes[bad])} strained when the whole model turns, and not when it moves"
            expected = f"K times a turn to be 0 at these {bad.sum()} of {len(nodes)} nodes"
            remedy = (
                "give the coordinates of the mesh that the matrices are of: no instance moved or turned, no *SYSTEM, "
                "no shifted numbers; or correct the directions in the map of the DOFs"
            )
            raise ModelError.of(model.source, ("nodes",), found, expected, remedy)

    # 3. moving
    strained = _nodes_of(moved.max(axis=1) > _STRAINED, of_row)
    inside = np.flatnonzero(strained[of_row])
    if not inside.size:
        return ()
    inner = model.stiffness[inside][:, inside]
    ground = _GROUND * np.where(inner.diagonal() > 0, inner.diagonal(), 1.0)
    outer = along.copy()
    outer[inside] = 0.0
    right = ground[:, None] * along[inside] - (model.stiffness @ outer)[inside]
    released = outer
    try:
        released[inside] = splu((inner + sparse.diags_array(ground)).tocsc()).solve(right)
    except RuntimeError:  # exactly singular: not positive semidefinite, which the reduction refuses
        return ()
    still = _left(model, released, unknown)
    count, part_of = connected_components(inner, directed=False)
    beside = abs(model.stiffness[:, inside]) @ sparse.csr_array(
        (np.ones(inside.size), (np.arange(inside.size), part_of)), shape=(inside.size, count)
    )
    hidden = size @ unknown.astype(float) > 0  # rows whose strain is not known
    for part in range(count):
        near = beside[:, [part]].toarray().ravel() > 0
        rows = inside[part_of == part]
        floats = (moved[rows].max(axis=0) > _STRAINED) & (still[near].max(axis=0) <= _RELEASED)
        if floats.any() and not hidden[near].any():
            bad = _nodes_of(np.isin(np.arange(model.n_dofs), rows), of_row)
            way = DIRECTIONS[int(np.argmax(floats))]
            found = f"found {_listed(nodes[bad])} strained when the whole model moves along {way}, which nothing holds"
            expected = f"DOFs along x, y, z at these {bad.sum()} of {len(nodes)} nodes"
            remedy = (
                "export in the basic system, without *TRANSFORM, nodal or output systems (field CD, NROTAT), or give "
                "the map of the DOFs of this very export: the order of its rows is another one"
            )
            raise ModelError.of(model.source, ("dofs",), found, expected, remedy)
    return (f"K holds {strained.sum()} of {len(nodes)} nodes to ground: {_listed(nodes[strained])}",)


def _left(model: FeModel, motions: Array, unknown: Flags, allowed: Array | None = None) -> Array:
    """Return what motions (n, k) leave of K φ as a share of |K||φ|, shape (n, k); 0 next to what is not known."""
    size = abs(model.stiffness)
    most = size @ np.abs(motions)
    left = np.abs(model.stiffness @ motions)
    if allowed is not None:
        left = np.maximum(left - allowed[:, None], 0.0)
    share = np.divide(left, most, out=np.zeros_like(left), where=most > 0)
    share[size @ unknown.astype(float) > 0] = 0.0
    return share


def _nodes_of(rows: Flags, of_row: Indices) -> Flags:
    """Return which nodes have one of the rows."""
    return np.asarray(np.bincount(of_row[rows], minlength=of_row.max() + 1) > 0)


def _listed(nodes: Indices) -> str:
    shown = ", ".join(str(node) for node in nodes[:4])
    return f"node{'s' * (len(nodes) > 1)} {shown}{' …' * (len(nodes) > 4)}"
