"""Modes of the assembled structure from the modes of the structure without its joint, and their modal sum.

In the free modes (eigenvalues Λ, shapes φ_j at the joint) the assembled eigenproblem is Λ + φ_jᵀ K^J φ_j:
diagonal plus rank r, with as many rows as modes kept and no FE matrix in sight.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.frf.ports import Ports, as_batch, split_along
from jointbayes.joint import Joint
from jointbayes.structure import ModalDamping, Structure, mode_shift

__all__ = ["AssembledModes", "NaturalFrequencies"]

Array = NDArray[np.float64]

#: Eigenvalues closer than this (relative) share one mode plane: their divided difference is the derivative.
_DEGENERATE = 1e-9

_LINES_AT_ONCE = 1024  # keeps the modes × lines block of the modal sum inside the processor's cache


_FAR = 4.0  # a mode whose frequency is that many times above the band's end is far
_TERMS = 20  # of the series for far modes: _FAR**-20 = 1e-12


class _JoinedModes:
    """Assembled eigenvalues and modal coordinates for any joint matrix.

    Solved for (Λ + σ + φᵀKφ)⁻¹ = D − Dφᵀ K(1 + F K)⁻¹ φD with D = (Λ + σ)⁻¹ and F = φDφᵀ, so that rounding is
    relative to the *lowest* mode and the joint may be anything from absent to rigid.
    """

    def __init__(self, structure: Structure, joint: Joint) -> None:
        modes = structure.modes()
        self.shapes = modes.shapes
        self.at_joint = modes.shapes.T @ joint.selection(structure)
        self._shift = mode_shift(structure)
        self._inverse = 1 / (modes.eigenvalues + self._shift)
        self._driven = self._inverse[:, None] * self.at_joint
        self._flexibility = self.at_joint.T @ self._driven

    def solve(self, stiffness: Array) -> tuple[Array, Array, Array]:
        """Assembled modes for joint matrices (batch, r, r).

        Returns eigenvalues (batch, m) rising, vectors (batch, m, m) in the free modes, and the joint's motion
        in each mode, (batch, m, r).
        """
        remaining = np.linalg.inv(np.eye(stiffness.shape[-1]) + self._flexibility @ stiffness)
        inverse = np.diag(self._inverse) - self._driven @ (stiffness @ remaining) @ self._driven.T
        inverse, vectors = np.linalg.eigh(inverse)
        # modes of a rigid joint have no inverse eigenvalue left; an indefinite joint may have negative ones
        floor = np.finfo(float).eps * np.abs(inverse).max(axis=-1, keepdims=True)
        shifted = 1 / np.where(np.abs(inverse) < floor, floor, inverse)
        order = np.argsort(shifted, axis=-1)
        shifted = np.take_along_axis(shifted, order, axis=-1)
        vectors = np.take_along_axis(vectors, order[:, None, :], axis=-1)
        # φq by way of (1 + F K)⁻¹, not as a sum over free modes that nearly cancel
        at_joint = shifted[:, :, None] * (remaining @ self._driven.T @ vectors).swapaxes(-1, -2)
        return shifted - self._shift, vectors, at_joint


class NaturalFrequencies:
    """Undamped natural frequencies of the structure with its joint.

    Parameters
    ----------
    structure, joint
        Structure without the joint, and where the joint acts.
    count
        How many frequencies, from the lowest.

    Raises
    ------
    ModelError
        If the structure has fewer DOFs than that.
    """

    def __init__(self, structure: Structure, joint: Joint, count: int) -> None:
        if not 1 <= count <= structure.n_dofs:
            raise ModelError(f"natural frequencies: found a count of {count}; expected 1 to {structure.n_dofs}")
        self._modes, self._count = _JoinedModes(structure, joint), count

    def frequency_hz(self, stiffness: ArrayLike) -> Array:
        """Frequencies, shape (batch, count), Hz, for joint matrices of shape (r, r) or (batch, r, r)."""
        eigenvalues, _, _ = self._modes.solve(as_batch(stiffness))
        return np.sqrt(np.maximum(eigenvalues[:, : self._count], 0.0)) / (2 * np.pi)

    def tangent(self, stiffness: ArrayLike, directions: ArrayLike) -> tuple[Array, Array]:
        """Frequencies (count,) in Hz and their derivative (p, count) along changes dK^J (p, r, r)."""
        eigenvalues, _, at_joint = self._modes.solve(as_batch(stiffness))
        shapes = at_joint[0, : self._count]
        frequency = np.sqrt(np.maximum(eigenvalues[0, : self._count], 0.0)) / (2 * np.pi)
        slope = np.einsum("ri,pij,rj->pr", shapes, np.asarray(directions, dtype=float), shapes)
        return frequency, slope / (8 * np.pi**2 * np.maximum(frequency, np.finfo(float).tiny))


class AssembledModes:
    """Assembled receptance by the modal sum H_ab = Σ φ_ar φ_br / (ω_r² − ω² + 2jζ_r ω_r ω).

    Parameters
    ----------
    structure
        Structure with modal damping (of the assembled structure).
    joint
        Where the joint acts, r DOFs.
    ports
        Lines, outputs and inputs.

    Raises
    ------
    ModelError
        If the damping law is not modal: see `LowRankCoupling`.
    """

    def __init__(self, structure: Structure, joint: Joint, ports: Ports) -> None:
        if not isinstance(structure.damping, ModalDamping):
            raise ModelError(
                "modal sum: found a loss factor or Rayleigh damping; expected modal damping ratios; "
                "use the low-rank coupling instead"
            )
        self._modes, self._omega = _JoinedModes(structure, joint), ports.omega
        joined, outputs, inputs = ports.selections(structure, joint)
        self._along, rest = split_along(np.hstack([outputs, inputs]), joined)
        self._rest = self._modes.shapes.T @ rest
        self._n_out = len(ports.outputs)
        self._ratio = structure.damping.per_mode(structure.n_dofs)
        self._band_end = self._omega.max()
        # jⁿ(ω/ω_max)ⁿ without its factor j in the odd rows
        order = np.arange(_TERMS)[:, None]
        self._powers = (-1.0) ** (order // 2) * (self._omega / self._band_end) ** order

    def receptance(self, stiffness: ArrayLike) -> NDArray[np.complex128]:
        """Receptances for joint matrices of shape (r, r) or (batch, r, r): shape (batch, lines, outputs, inputs)."""
        solved = self._modes.solve(as_batch(stiffness))
        shape = (self._omega.size, self._n_out, self._rest.shape[1] - self._n_out)
        result = np.empty((len(solved[0]), *shape), dtype=complex)
        for one, lam, q, at_joint in zip(result, *solved, strict=True):
            out, into = self._shapes(q, at_joint)
            one[:] = self._modal_sum(lam, out[:, :, None] * into[:, None, :]).reshape(shape)
        return result

    def _shapes(self, vectors: Array, at_joint: Array) -> tuple[Array, Array]:
        """Assembled mode shapes at outputs and inputs, shapes (m, outputs) and (m, inputs)."""
        shapes = vectors.T @ self._rest + at_joint @ self._along
        return shapes[:, : self._n_out], shapes[:, self._n_out :]

    def _modal_sum(self, eigenvalues: Array, constants: Array) -> NDArray[np.complex128]:
        """Σ_r R_r / (λ_r − ω² + 2jζ_r √λ_r ω), shape (lines, pairs), for modal constants R (m, ...)."""
        flat = constants.reshape(len(eigenvalues), -1).T
        near = int(np.searchsorted(eigenvalues, (_FAR * self._band_end) ** 2))
        total = self._near_modes(eigenvalues[:near], self._ratio[:near], flat[:, :near])
        total += self._far_modes(eigenvalues[near:], self._ratio[near:], flat[:, near:])
        summed: NDArray[np.complex128] = total.T
        return summed

    def _near_modes(self, eigenvalues: Array, ratio: Array, constants: Array) -> NDArray[np.complex128]:
        """Modal sum line by line, shape (pairs, lines).

        With D_r = (λ_r − ω²)² + 4ζ_r² λ_r ω² real, only 1/D_r is needed at every line and mode: the sum is
        Σ λ_r R_r/D_r − ω² Σ R_r/D_r − jω Σ 2ζ_r √λ_r R_r/D_r, three small matrix products.
        """
        rate = 2 * ratio * np.sqrt(np.maximum(eigenvalues, 0.0))
        weights = np.concatenate([constants * eigenvalues, constants, constants * rate])
        sums = np.empty((len(weights), self._omega.size))
        square = self._omega**2
        for start in range(0, square.size, _LINES_AT_ONCE):
            lines = slice(start, start + _LINES_AT_ONCE)
            denominator = eigenvalues[:, None] - square[lines]
            denominator *= denominator
            denominator += (rate**2)[:, None] * square[lines]
            sums[:, lines] = weights @ np.reciprocal(denominator, out=denominator)
        static, inertial, damped = sums.reshape(3, len(constants), -1)
        summed: NDArray[np.complex128] = static - square * inertial - 1j * self._omega * damped
        return summed

    def _far_modes(self, eigenvalues: Array, ratio: Array, constants: Array) -> NDArray[np.complex128]:
        """Modal sum of modes far above the band, shape (pairs, lines), as a power series in x = jω/√λ.

        1/(1 + 2ζx + x²) = Σ U_n(−ζ) xⁿ with Chebyshev's polynomials of the second kind: with |x| ≤ 1/_FAR the terms
        left out are below 1e-11, and the coefficients of all far modes add up before any line is looked at.
        """
        scaled = self._band_end / np.sqrt(eigenvalues)
        chebyshev = [np.ones_like(ratio), -2 * ratio]
        while len(chebyshev) < _TERMS:
            chebyshev.append(-2 * ratio * chebyshev[-1] - chebyshev[-2])
        order = np.arange(_TERMS)[:, None]
        terms = np.array(chebyshev) * scaled**order / eigenvalues
        coefficients = constants @ terms.T
        even = coefficients[:, ::2] @ self._powers[::2]
        summed: NDArray[np.complex128] = even + 1j * (coefficients[:, 1::2] @ self._powers[1::2])
        return summed

    def tangent(
        self, stiffness: ArrayLike, directions: ArrayLike
    ) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
        """Receptance and its exact derivative along p changes of one joint matrix.

        Parameters
        ----------
        stiffness
            K^J, shape (r, r).
        directions
            Changes dK^J, shape (p, r, r).

        Returns
        -------
        receptance, derivative : ndarray, shapes (lines, outputs, inputs) and (p, lines, outputs, inputs)

        References
        ----------
        Fox, R. L., Kapoor, M. P. (1968). Rates of change of eigenvalues and eigenvectors. AIAA Journal
        6(12), 2426-2429. DOI 10.2514/3.5008
        """
        (lam,), (q,), (at_joint,) = self._modes.solve(as_batch(stiffness))
        change = at_joint @ np.asarray(directions, dtype=float) @ at_joint.T
        gap = lam[None, :] - lam[:, None]
        same = np.abs(gap) <= _DEGENERATE * np.maximum(np.abs(lam[None, :]), np.abs(lam[:, None]))
        turn = np.where(same, 0.0, change / np.where(same, 1.0, gap))  # dQ = Q turn
        out, into = (shape.T for shape in self._shapes(q, at_joint))
        d_out, d_in = out @ turn, into @ turn
        constants = out[:, None, :] * into[None, :, :]
        d_constants = d_out[:, :, None, :] * into + out[:, None, :] * d_in[:, None, :, :]
        # modes in one plane: f[λ_r, λ_s] = f'(λ_r), the diagonal r = s among them
        shared = np.einsum("or,prs,is->poir", out, np.where(same, change, 0.0), into)

        root, omega = np.sqrt(np.maximum(lam, 0.0))[:, None], self._omega
        ratio = self._ratio[:, None]
        f = 1 / (lam[:, None] - omega**2 + 2j * ratio * root * omega)
        rate = np.divide(ratio, root, out=np.zeros_like(root), where=root > 0)
        slope = -(f**2) * (1 + 1j * rate * omega)
        value = np.einsum("oir,rl->loi", constants, f, optimize=True)
        derivative = np.einsum("poir,rl->ploi", d_constants, f, optimize=True)
        derivative += np.einsum("poir,rl->ploi", shared, slope, optimize=True)
        return value, derivative
