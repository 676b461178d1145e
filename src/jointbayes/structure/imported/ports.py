"""Where a joint or a sensor holds an imported model: a node, or a patch of nodes that moves as one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from jointbayes.errors import ModelError
from jointbayes.structure.imported.fe_model import DIRECTIONS, FeModel
from vibrecords.arrays import Array, convert_fields

_MOST_BODIES = 100  # that hang together; more is no assembly but a mechanism
_NO_ARM = 1e-6  # of a patch's size: about an axis through all its nodes nothing says how it turns


@dataclass(frozen=True, slots=True)
class Port:
    """A node, or a patch of nodes, with up to six DOFs.

    Parameters
    ----------
    nodes
        Numbers of its nodes.
    rigid
        Whether the patch moves as a rigid body (RBE2). Otherwise its motion is the average of its nodes' (RBE3), which
        stiffens nothing.
    at
        Place of the point whose motion it is, m; None takes the mean place of the nodes.
    """

    nodes: tuple[int, ...]
    rigid: bool = False
    at: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        convert_fields(self, lambda nodes: tuple(int(node) for node in nodes), "nodes")
        if not self.nodes or len(set(self.nodes)) < len(self.nodes):
            found = f"found {len(self.nodes)} nodes, {len(set(self.nodes))} of them different"
            raise ModelError.of("port", ("nodes",), found, "one node, or several, each once", "correct the list")

    def place(self, model: FeModel) -> Array | None:
        """Where it is, shape (3,), m; None where its nodes have no places."""
        if self.at is not None:
            return np.array(self.at)
        places = [model.place(node) for node in self.nodes]
        known = [place for place in places if place is not None]
        return np.mean(known, axis=0) if len(known) == len(places) else None


def hold_rigid(model: FeModel, port: Port, name: str) -> tuple[FeModel, int]:
    """The model with a patch of nodes as one rigid body, and the number of the node that stands for it.

    K and M become TᵀKT and TᵀMT, where u = T v gives the patch's DOFs by the six of its point.

    Raises
    ------
    ModelError
        If a node does not exist or has no known place.
    """
    arms = _arms(model, port, name)
    patch = np.isin(model.dofs[:, 0], port.nodes)
    kept = np.flatnonzero(~patch)
    number = int(min(model.dofs[:, 0].min(), 0)) - 1
    rows, columns, values = [kept], [np.arange(len(kept))], [np.ones(len(kept))]
    for row in np.flatnonzero(patch):
        node, way = (int(of) for of in model.dofs[row])
        motion = np.eye(6)[way - 1]
        if way <= 3:
            motion[3:] = np.cross(arms[node], np.eye(3)[way - 1])  # (θ × r)·e = θ·(r × e)
        rows.append(np.full(6, row))
        columns.append(len(kept) + np.arange(6))
        values.append(motion)
    shape = model.n_dofs, len(kept) + 6
    turn = sparse.csc_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=shape)
    own = np.stack([np.full(6, number), np.arange(1, 7)], axis=1)
    place = port.place(model)
    assert place is not None  # as its arms are known
    return model.changed(turn, np.concatenate([model.dofs[kept], own]), {number: place}), number


def port_forms(model: FeModel, port: Port, name: str) -> dict[str, Array]:
    """The DOFs of a port by their directions, each as a form on the model's, shape (n,).

    A node has those that the model has. Of a patch the translation is the mean, and the rotation the one that fits
    its nodes' translations best, θ = J⁻¹ Σ r × u with J = Σ (r·r 1 − r rᵀ) (RBE3 of equal weights).

    Raises
    ------
    ModelError
        If a node does not exist, is held, or has no known place.
    """
    if len(port.nodes) == 1 and port.at is None:
        of_node = {way: row for way in DIRECTIONS if (row := model.row(port.nodes[0], way)) is not None}
        if not of_node:
            raise _no_node(model, port.nodes[0], name)
        return {way: (np.arange(model.n_dofs) == row).astype(float) for way, row in of_node.items()}
    arms = _arms(model, port, name)
    rows = {node: [model.row(node, way) for way in "xyz"] for node in port.nodes}
    free = [node for node in port.nodes if all(row is not None for row in rows[node])]
    if not free:
        listed = ", ".join(map(str, port.nodes[:6])) + " …" * (len(port.nodes) > 6)
        found = f"found no node of {listed} that is free to move"
        expected = "a patch that no support holds"
        raise ModelError.of(f"port {name}", ("ports", name), found, expected, "choose other nodes")
    mean_arm = np.mean([arms[node] for node in free], axis=0)
    inertia = np.zeros((3, 3))
    translation, turning = np.zeros((3, model.n_dofs)), np.zeros((3, model.n_dofs))
    for node in free:
        arm = arms[node] - mean_arm
        inertia += (arm @ arm) * np.eye(3) - np.outer(arm, arm)
        for way, row in enumerate(rows[node]):
            translation[way, row] = 1 / len(free)
            turning[:, row] += np.cross(arm, np.eye(3)[way])
    sizes, axes = np.linalg.eigh(inertia)
    turned = sizes > _NO_ARM**2 * max(sizes.max(), np.finfo(float).tiny)
    if not turned.all():  # nodes in one line, or one
        known = [d for d in range(3) if np.abs(axes[d, ~turned]).max(initial=0.0) < _NO_ARM]
    else:
        known = [0, 1, 2]
    rotation = (axes[:, turned] / sizes[turned]) @ (axes[:, turned].T @ turning)
    # u at the point is u of the nodes' middle plus θ × (point − middle)
    at_point = translation - np.cross(rotation, mean_arm, axisa=0, axisc=0)
    forms = {way: at_point[d] for d, way in enumerate("xyz")}
    return forms | {f"r{'xyz'[d]}": rotation[d] for d in known}


def _no_node(model: FeModel, node: int, name: str) -> ModelError:
    numbers = np.unique(model.dofs[model.dofs[:, 1] > 0, 0])
    expected = (
        f"one of {len(numbers)} that can move, from {numbers.min()} to {numbers.max()}" if len(numbers) else "none"
    )
    found = f"found no DOF of node {node} in {model.source}"
    return ModelError.of(f"port {name}", ("ports", name), found, expected, "correct the number")


def _arms(model: FeModel, port: Port, name: str) -> Mapping[int, Array]:
    """From the port's point to each of its nodes, m."""
    arms = {}
    for node in port.nodes:
        place = model.place(node)
        if place is None:
            found = f"found no place of node {node} in {model.source}"
            expected = "the places of all nodes of a patch"
            raise ModelError.of(f"port {name}", ("ports", name), found, expected, "give coordinates")
        if not (model.dofs[:, 0] == node).any():
            raise _no_node(model, node, name)
        arms[node] = place
    point = np.mean(list(arms.values()), axis=0) if port.at is None else np.array(port.at)
    return {node: place - point for node, place in arms.items()}


def rigid_motions(model: FeModel) -> Array | None:
    """Translations and rotations of each body that hangs together, about its middle, shape (n, 6 each).

    None where a place is not known.
    """
    nodes, of_row = np.unique(model.dofs[:, 0], return_inverse=True)
    if not np.isin(nodes, model.nodes).all() or (model.dofs[:, 1] < 1).any():
        return None
    links = model.stiffness.tocoo()
    joined = of_row[links.row[links.data != 0]], of_row[links.col[links.data != 0]]
    linked = sparse.coo_array((np.ones(len(joined[0])), joined), shape=(len(nodes), len(nodes)))
    count, body = connected_components(linked, directed=False)
    if count > _MOST_BODIES:
        count, body = 1, np.zeros_like(body)
    places, ways = np.array([model.place(int(node)) for node in nodes]), model.dofs[:, 1]
    rows = np.arange(model.n_dofs)
    motions = np.zeros((model.n_dofs, count, 6))
    motions[rows, body[of_row], ways - 1] = 1.0
    middles = np.array([places[body == one].mean(axis=0) for one in range(count)])
    arms, moved = (places - middles[body])[of_row], ways <= 3
    motions[rows[moved], body[of_row][moved], 3:] = np.cross(arms[moved], np.eye(3)[ways[moved] - 1])
    return motions.reshape(model.n_dofs, 6 * count)


def nodes_in_box(model: FeModel, low: Sequence[float], high: Sequence[float]) -> tuple[int, ...]:
    """Numbers of the nodes in a box of these corners, m."""
    inside = ((model.places >= np.array(low)) & (model.places <= np.array(high))).all(axis=1)
    return tuple(int(node) for node in model.nodes[inside])
