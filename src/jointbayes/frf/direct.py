"""Receptances by solving the assembled dynamic stiffness at each line: slow, and the reference."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.frf.ports import Ports, as_batch
from jointbayes.joint import Joint
from jointbayes.structure import LossFactor, ModalDamping, Rayleigh, Structure

__all__ = ["DirectSolve", "dynamic_stiffness", "solve_lines"]

_LINES_AT_ONCE = 512  # bounds the memory of one batch of dense matrices
_REFINEMENTS = 2


def dynamic_stiffness(
    structure: Structure,
    omega: NDArray[np.float64],
    joint_stiffness: NDArray[np.float64] | None = None,
    precision: type[np.floating[Any]] = np.float64,
) -> Iterator[NDArray[np.complexfloating[Any]]]:
    """Z(ω) = K − ω²M + jωC (or K(1 + jη) − ω²M), in blocks of lines.

    Parameters
    ----------
    structure
        Structure with its damping law.
    omega
        Angular frequencies, shape (lines,), rad/s.
    joint_stiffness
        B K^J Bᵀ at the structure's DOFs, shape (n, n); None is the structure without joint.
    precision
        Of the sum: far below the highest mode its terms nearly cancel in double precision.

    Yields
    ------
    ndarray, shape (block, n, n)

    References
    ----------
    Cao et al., Eq. (2).
    """
    added = np.zeros_like(structure.stiffness) if joint_stiffness is None else joint_stiffness
    law = structure.damping
    static = (structure.stiffness.astype(precision) + added).astype(np.result_type(precision, np.complex64))
    if isinstance(law, LossFactor):
        static += 1j * (precision(law.loss_factor) * structure.stiffness.astype(precision))
        viscous = np.zeros_like(structure.stiffness)
    elif isinstance(law, Rayleigh):
        viscous = law.alpha * structure.mass + law.beta * structure.stiffness
    else:
        viscous = _modal_damping_matrix(structure, added, law)
    for start in range(0, omega.size, _LINES_AT_ONCE):
        w = omega[start : start + _LINES_AT_ONCE, None, None].astype(precision)
        yield static - w**2 * structure.mass + 1j * w * viscous


def solve_lines(
    structure: Structure,
    omega: NDArray[np.float64],
    loads: NDArray[np.float64],
    joint_stiffness: NDArray[np.float64] | None = None,
) -> NDArray[np.complex128]:
    """Z⁻¹ f at each line, shape (lines, n, loads), for loads f of shape (n, loads).

    The residual is computed in extended precision and solved for twice more: a structure that is nearly free loses
    six of double precision's digits at low frequency otherwise.

    Raises
    ------
    ModelError
        If a line is an undamped natural frequency.
    """
    parts = []
    blocks = dynamic_stiffness(structure, omega, joint_stiffness, np.longdouble)
    for index, z in enumerate(blocks):
        rounded = z.astype(complex)
        try:
            x = np.linalg.solve(rounded, loads.astype(complex)).astype(z.dtype)
            for _ in range(_REFINEMENTS):
                x = x + np.linalg.solve(rounded, (loads - z @ x).astype(complex))
        except np.linalg.LinAlgError:
            first = omega[index * _LINES_AT_ONCE] / (2 * np.pi)
            raise ModelError(
                f"FRF: found an undamped natural frequency on one of the lines from {first:g} Hz on; expected damping "
                "or lines beside it; give the structure damping or drop the line"
            ) from None
        parts.append(x.astype(complex))
    return np.concatenate(parts)


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
        return self._outputs.T @ solve_lines(self._structure, self._omega, self._inputs, added)
