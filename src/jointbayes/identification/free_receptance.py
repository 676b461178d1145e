"""Receptances of the structure without its joints, as the data of a set-up ask for them."""

from dataclasses import dataclass

import numpy as np

from jointbayes.frf import AnyStructure, LowRankCoupling, Ports
from jointbayes.frf.coupling import free_receptance
from jointbayes.frf.measured_body import Substructures, substructures
from jointbayes.joint import AnyJoint
from vibrecords import FrfData, quantity_factor
from vibrecords.arrays import Array, ComplexArray


def measured_receptances(
    structure: AnyStructure, joint: AnyJoint, data: FrfData
) -> "tuple[ComplexArray, Array, FreeReceptance]":
    """Measured receptances and their σ, each (lines, outputs, inputs), and those of the structure without the joint.

    Parameters
    ----------
    structure, joint
        Structure without the joints, and where these act. Modal damping of the assembled structure has no counterpart
        without them; the loss factor 2ζ of its first mode stands in.
    data
        FRFs with variances.
    """
    frf = data.frf.converted("receptance")
    sigma = np.sqrt(data.variance) / np.abs(quantity_factor(frf.frequency_hz, data.frf.quantity)[:, None, None])
    ports = Ports(frf.frequency_hz, frf.outputs, frf.inputs)
    whole = substructures(structure).at((*joint.labels, *frf.outputs, *frf.inputs), float(frf.frequency_hz[-1]))
    free = _free_of_bodies(whole, joint, ports) if whole.measured else _free_of_model(whole, joint, ports)
    return frf.values, sigma, free


def _free_of_bodies(whole: Substructures, joint: AnyJoint, ports: Ports) -> "FreeReceptance":
    """Of measured bodies beside a modelled one, whose uncertain quantities are as stated."""
    model = LowRankCoupling(whole, joint, ports)
    motions = np.vstack([model.along, np.eye(model.along.shape[1])])
    (free,), r = model.free(np.ones((1, len(whole.modelled.names)))), joint.size
    driven = free @ motions
    outputs, inputs = slice(None, model.n_out), slice(model.n_out, None)
    oj = driven[:, :r, outputs].swapaxes(1, 2)
    return FreeReceptance(free[:, :r, :r], oj, driven[:, :r, inputs], motions[:, outputs].T @ driven[:, :, inputs])


def _free_of_model(whole: Substructures, joint: AnyJoint, given: Ports) -> "FreeReceptance":
    """Of a structure as it is modelled."""
    body = whole.modelled.certain()
    # the joint's DOFs stand first among outputs and inputs
    sides = joint.labels
    ports = Ports(given.frequency_hz, _unique(sides + given.outputs), _unique(sides + given.inputs))
    # summed over free modes: a dense solution of every line would cost more than the whole search
    driven = body.index(ports.outputs + ports.inputs)
    dofs, k, n = np.unique(driven), len(ports.outputs), len(sides)
    at = np.arange(len(driven))
    modes = body.free_modes(dofs, (dofs[:, None] == driven).astype(float), (at < n) | (at >= k))
    free = free_receptance(body, modes, np.empty((1, 0)), ports.omega, hysteretic=True)[0, :, :k, k:]
    relative = joint.deformations(sides).T
    rows = [ports.outputs.index(label) for label in given.outputs]
    columns = [ports.inputs.index(label) for label in given.inputs]
    return FreeReceptance(
        relative @ free[:, :n, :n] @ relative.T,
        free[:, rows, :n] @ relative.T,
        relative @ free[:, :n, columns],
        free[:, rows][:, :, columns],
    )


@dataclass(frozen=True, slots=True)
class FreeReceptance:
    """Receptance without the joint, cut into the blocks between joint, outputs and inputs, at each line."""

    jj: ComplexArray
    oj: ComplexArray
    ji: ComplexArray
    oi: ComplexArray


def _unique(labels: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(labels))
