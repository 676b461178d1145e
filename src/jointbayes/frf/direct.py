"""Receptances by solving the assembled dynamic stiffness at each line: slow, and the reference."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.frf.ports import Ports, as_batch
from jointbayes.joint import Joint
from jointbayes.structure import LossFactor, ModalDamping, Rayleigh, Structure

__all__ = ["DirectSolve", "dynamic_stiffness"]

_LINES_AT_ONCE = 512  # bounds the memory of one batch of dense matrices


def dynamic_stiffness(
    structure: Structure, omega: NDArray[np.float64], joint_stiffness: NDArray[np.float64] | None = None
) -> Iterator[NDArray[np.complex128]]:
    """Z(ω) = K − ω²M + jωC (or K(1 + jη) − ω²M), in blocks of lines.

    Parameters
    ----------
    structure
        Structure with its damping law.
    omega
        Angular frequencies, shape (lines,), rad/s.
    joint_stiffness
        B K^J Bᵀ at the structure's DOFs, shape (n, n); None is the structure without joint.

    Yields
    ------
    ndarray, shape (block, n, n)

    References
    ----------
    Cao et al., Eq. (2).
    """
    added = np.zeros_like(structure.stiffness) if joint_stiffness is None else joint_stiffness
    stiffness = structure.stiffness + added
    law = structure.damping
    static = stiffness.astype(complex)
    if isinstance(law, LossFactor):
        static += 1j * law.loss_factor * structure.stiffness
        viscous = np.zeros_like(stiffness)
    elif isinstance(law, Rayleigh):
        viscous = law.alpha * structure.mass + law.beta * structure.stiffness
    else:
        viscous = _modal_damping_matrix(structure, added, law)
    for start in range(0, omega.size, _LINES_AT_ONCE):
        w = omega[start : start + _LINES_AT_ONCE, None, None]
        yield static - w**2 * structure.mass + 1j * w * viscous


def _modal_damping_matrix(structure: Structure, added: NDArray[np.float64], law: ModalDamping) -> NDArray[np.float64]:
    """C = MΦ diag(2ζω) ΦᵀM of the assembled structure, shape (n, n)."""
    modes = structure.modes(added)
    rate = 2 * law.per_mode(structure.n_dofs) * np.sqrt(np.maximum(modes.eigenvalues, 0.0))
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

    def __init__(self, structure: Structure, joint: Joint, ports: Ports) -> None:
        self._structure, self._omega = structure, ports.omega
        self._joined, self._outputs, self._inputs = ports.selections(structure, joint)

    def receptance(self, stiffness: ArrayLike) -> NDArray[np.complex128]:
        """Receptances for joint matrices of shape (r, r) or (batch, r, r): shape (batch, lines, outputs, inputs)."""
        return np.stack([self._one(matrix) for matrix in as_batch(stiffness)])

    def _one(self, matrix: NDArray[np.float64]) -> NDArray[np.complex128]:
        added = self._joined @ matrix @ self._joined.T
        blocks = dynamic_stiffness(self._structure, self._omega, added)
        return np.concatenate([self._outputs.T @ np.linalg.solve(z, self._inputs.astype(complex)) for z in blocks])
