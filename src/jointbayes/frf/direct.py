"""Receptances by solving the assembled dynamic stiffness at each line: slow, and the reference."""

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.frf.modal import rigid_body_modes
from jointbayes.frf.ports import Ports
from jointbayes.joint import AnyJoint, AnyJointMatrix, JointMatrix, as_joint_matrix
from jointbayes.structure import Structure

_LINES_AT_ONCE = 512  # bounds the memory of one batch of dense matrices
_REFINEMENTS = 2


def solve_lines(
    structure: Structure,
    omega: Array,
    observed: Array,
    loads: Array,
    joint_stiffness: Array | None = None,
    joint_viscous: Array | float = 0.0,
    joint_hysteretic: Array | float = 0.0,
    rigid: int | None = None,
) -> NDArray[np.complex128]:
    """oᵀZ⁻¹f at each line, shape (lines, motions, loads), for motions o (n, motions) and loads f (n, loads).

    A structure that is nearly free loses six of double precision's digits at low frequency, because K x nearly
    cancels. So K x is computed in extended precision, and what is left of the load is solved for twice more.

    Modal damping is that of the modes above the `rigid` lowest ones, by default above those at 0 Hz.

    Raises
    ------
    ModelError
        If a line is an undamped natural frequency.
    """
    added = np.zeros_like(structure.stiffness) if joint_stiffness is None else joint_stiffness
    exact, viscous = structure.stiffness.astype(np.longdouble), _viscous(structure, added, rigid) + joint_viscous
    dynamic = added + 1j * joint_hysteretic if np.any(joint_hysteretic) else added
    loss = 1 + 1j * structure.damping.hysteretic
    parts = []
    for start in range(0, omega.size, _LINES_AT_ONCE):
        w = omega[start : start + _LINES_AT_ONCE, None, None]
        z = loss * structure.stiffness + dynamic - w**2 * structure.mass + 1j * w * viscous
        try:
            x = np.linalg.solve(z, loads.astype(complex)).astype(np.clongdouble)
            for _ in range(_REFINEMENTS):
                elastic = loss * (exact @ x.real + 1j * (exact @ x.imag))
                rounded = x.astype(complex)
                others = dynamic @ rounded - w**2 * (structure.mass @ rounded) + 1j * w * (viscous @ rounded)
                x = x + np.linalg.solve(z, (loads - elastic - others).astype(complex))
        except np.linalg.LinAlgError:
            raise ModelError(
                f"FRF: found an undamped natural frequency on a line between {w.min() / (2 * np.pi):g} and "
                f"{w.max() / (2 * np.pi):g} Hz; expected damping, or lines beside it; give the structure damping or "
                "move the lines"
            ) from None
        parts.append(observed.T @ x.astype(complex))
    return np.concatenate(parts)


def _viscous(structure: Structure, added: Array, rigid: int | None) -> Array:
    law = structure.damping
    if law.matrix is not None:
        return law.matrix
    if not law.of_assembled_modes:
        alpha, beta = law.viscous
        return alpha * structure.mass + beta * structure.stiffness
    # C = MΦ diag(2ζω) ΦᵀM of the assembled structure
    modes = structure.modes(added)
    first = int((modes.eigenvalues <= 0).sum()) if rigid is None else rigid  # a rigid-body motion has no ratio
    rate = np.zeros(structure.n_dofs)
    rate[first:] = 2 * law.per_mode(structure.n_dofs - first) * np.sqrt(np.maximum(modes.eigenvalues[first:], 0.0))
    weighted = structure.mass @ modes.shapes
    return (weighted * rate) @ weighted.T


class DirectSolve:
    """Assembled receptance by a dense solve per line.

    Parameters
    ----------
    structure
        Structure without the joint; any damping law.
    joint
        Where the joint acts.
    ports
        Lines, outputs and inputs.
    """

    def __init__(self, structure: Structure, joint: AnyJoint, ports: Ports) -> None:
        self._structure, self._omega = structure, ports.omega
        self._joined, self._outputs, self._inputs = ports.selections(structure, joint)
        # of a joint that happens to be absent, the motions that it would hold are modes all the same
        self._rigid = rigid_body_modes(structure, joint) if structure.damping.of_assembled_modes else None

    def receptance(self, matrices: AnyJointMatrix) -> NDArray[np.complex128]:
        """Receptances for joint matrices of shape (r, r) or (batch, r, r): shape (batch, lines, outputs, inputs)."""
        batch = as_joint_matrix(matrices).batch
        return np.stack([self._of_joint(batch[i]) for i in range(len(batch))])

    def _of_joint(self, matrix: JointMatrix) -> NDArray[np.complex128]:
        if not matrix.damped:
            added = self._joined @ matrix.stiffness @ self._joined.T
            return solve_lines(self._structure, self._omega, self._outputs, self._inputs, added, rigid=self._rigid)
        k, c, h = (self._joined @ side @ self._joined.T for side in matrix.sides)
        return solve_lines(self._structure, self._omega, self._outputs, self._inputs, k, c, h, self._rigid)
