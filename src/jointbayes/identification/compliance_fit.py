"""A start without a guess: the joint compliance by linear least squares.

With a joint of two DOFs, (A_ab − H^x) D = N where D = det(C + A_jj) and N = A_aj adj(C + A_jj) A_jb are both linear
in (c11, c12, c22, det C). The weights 1/|D| of the last pass turn the equation error into the output error.

References
----------
Sanathanan, C. K., Koerner, J. (1963). Transfer function synthesis as a ratio of two complex polynomials.
IEEE Transactions on Automatic Control 8(1), 56-58. DOI 10.1109/TAC.1963.1105517
"""

from dataclasses import dataclass

import numpy as np

from jointbayes.frf import AnyStructure, LowRankCoupling, Ports
from jointbayes.frf.coupling import free_receptance
from jointbayes.frf.measured_body import Substructures, substructures
from jointbayes.joint import AnyJoint
from vibrecords import FrfData, quantity_factor
from vibrecords.arrays import Array, ComplexArray

_PASSES = 10


def compliance_start(structure: AnyStructure, joint: AnyJoint, data: FrfData) -> Array:
    """Estimate K^J of two DOFs from FRFs alone, positive definite, as a start for a proper fit.

    Parameters
    ----------
    structure, joint
        Structure without the joint, and where the joint acts (two DOFs). Modal damping of the assembled structure
        has no counterpart without the joint; the loss factor 2ζ of its first mode stands in.
    data
        FRFs with variances.

    Returns
    -------
    ndarray, shape (2, 2)

    References
    ----------
    Sanathanan & Koerner (1963), DOI 10.1109/TAC.1963.1105517
    """
    measured, sigma, free = measured_receptances(structure, joint, data)
    scale = free.scale
    unknown = np.zeros(4)
    weight = 1 / sigma
    for _ in range(_PASSES):
        matrix, right = free.equations(measured, scale)
        rows = (matrix * weight[..., None]).reshape(-1, 4)
        weighed = (right * weight).ravel()
        unknown, *_ = np.linalg.lstsq(
            np.concatenate([rows.real, rows.imag]), np.concatenate([weighed.real, weighed.imag]), rcond=None
        )
        weight = 1 / (sigma * np.abs(free.denominator(unknown, scale))[:, None, None])
    return _positive_definite(unknown[:3] * scale[:3])


def measured_receptances(
    structure: AnyStructure, joint: AnyJoint, data: FrfData
) -> "tuple[ComplexArray, Array, FreeReceptance]":
    """Measured receptances and their σ, each (lines, outputs, inputs), and those of the structure without the joint.

    Parameters
    ----------
    structure, joint, data
        As for `compliance_start`, but a joint of any number of DOFs, or several.
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

    @property
    def scale(self) -> Array:
        """Typical size of (c11, c12, c22, det C), shape (4,): compliances that matter are near the receptance."""
        c11, c22 = np.median(np.abs(self.jj[:, [0, 1], [0, 1]]), axis=0)
        return np.array([c11, np.sqrt(c11 * c22), c22, c11 * c22])

    def denominator(self, unknown: Array, scale: Array) -> ComplexArray:
        """D per line, relative to its scale, shape (lines,)."""
        return (self._factors() @ (unknown * scale) + self._determinant()) / scale[3]

    def equations(self, measured: ComplexArray, scale: Array) -> tuple[ComplexArray, ComplexArray]:
        """Matrix (lines, outputs, inputs, 4) and right-hand side (lines, outputs, inputs) of (A − H^x) D = N."""
        difference = self.oi - measured
        a, b = self.oj[:, :, None, :], self.ji.swapaxes(1, 2)[:, None, :, :]
        numerator = np.stack(
            [
                a[..., 1] * b[..., 1],
                -(a[..., 0] * b[..., 1] + a[..., 1] * b[..., 0]),
                a[..., 0] * b[..., 0],
                np.zeros_like(difference),
            ],
            axis=-1,
        )
        jj = self.jj[:, None, None]
        constant = (
            a[..., 0] * b[..., 0] * jj[..., 1, 1]
            - (a[..., 0] * b[..., 1] + a[..., 1] * b[..., 0]) * jj[..., 0, 1]
            + a[..., 1] * b[..., 1] * jj[..., 0, 0]
        )
        matrix = difference[..., None] * self._factors()[:, None, None, :] - numerator
        right = constant - difference * self._determinant()[:, None, None]
        return matrix * scale / scale[3], right / scale[3]

    def _factors(self) -> ComplexArray:
        """∂D/∂(c11, c12, c22, det C), shape (lines, 4)."""
        ones = np.ones(len(self.jj), dtype=complex)
        return np.stack([self.jj[:, 1, 1], -2 * self.jj[:, 0, 1], self.jj[:, 0, 0], ones], axis=-1)

    def _determinant(self) -> ComplexArray:
        return self.jj[:, 0, 0] * self.jj[:, 1, 1] - self.jj[:, 0, 1] ** 2


def _unique(labels: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(labels))


def _positive_definite(compliance: Array) -> Array:
    """Stiffness of the positive definite compliance nearest to (c11, c12, c22), in scaled terms."""
    c11, c12, c22 = compliance
    size = np.sqrt(np.abs([c11, c22])) + np.finfo(float).tiny
    unit = np.array([[c11, c12], [c12, c22]]) / np.outer(size, size)
    values, vectors = np.linalg.eigh(unit)
    # noise may turn an eigenvalue negative: a nearly rigid direction is then the nearest joint that exists
    values = np.maximum(values, 1e-3 * np.abs(values).max())
    return (vectors / values) @ vectors.T / np.outer(size, size)
