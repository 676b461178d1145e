"""What the errors of measured bodies do to the FRFs of the assembled structure, to first order.

H = A_ab − A_aj K (1 + A_jj K)⁻¹ A_jb is a holomorphic function of the measured A, and dH_oi = p_oᵀ dA p_i with p the
forces on the body's DOFs when the assembled structure is driven by a unit force at a port. So errors that are complex
circular stay so, and cov(H) = J Σ_A Jᴴ.
"""

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.frf.coupling import LowRankCoupling
from jointbayes.frf.measured_body import MeasuredBody
from jointbayes.frf.ports import as_batch, as_factors

__all__ = ["NoisePropagation"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


class NoisePropagation:
    """Covariance of predicted receptances due to the errors of measured bodies, at each line.

    Parameters
    ----------
    model
        Forward model with measured bodies.
    """

    def __init__(self, model: LowRankCoupling) -> None:
        self._model = model

    def covariance(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> ComplexArray:
        """E[δH δHᴴ], shape (batch, lines, pairs, pairs), of receptances in the order (outputs, inputs).

        For joint matrices (r, r) or (batch, r, r) and factors on the structure's quantities, (q,) or (batch, q).
        """
        roots = self.roots(stiffness, factors)
        return roots @ roots.conj().swapaxes(-1, -2)

    def roots(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> ComplexArray:
        """R of which `covariance` is R Rᴴ, shape (batch, lines, pairs, measured receptances of all bodies)."""
        matrices = as_batch(stiffness)
        free = self._free(matrices, factors)
        k, r = matrices[:, None], matrices.shape[-1]
        # the joint's motion under a unit force at each port, with the part that is the port's own: one solution for all
        moved = np.linalg.solve(np.eye(r) + k @ free[..., :r, :r], self._model.along - k @ free[..., :r, r:])
        return np.concatenate([self._of_body(i, moved) for i in range(len(self._model.bodies))], axis=-1)

    def relative_sd(self, stiffness: ArrayLike, factors: ArrayLike | None = None) -> Array:
        """Standard deviation of det(1 + A_jj K) relative to itself, shape (batch, lines).

        The first order is not enough where it is no small number: near a resonance of the assembled structure.
        """
        matrices = as_batch(stiffness)
        free = self._free(matrices, factors)
        k, r = matrices[:, None], matrices.shape[-1]
        held = np.linalg.solve(np.eye(r) + k @ free[..., :r, :r], np.broadcast_to(k, (*free.shape[:2], r, r)))
        variance = np.zeros(held.shape[:2])
        for (body, motions), root in zip(self._model.bodies, self._roots, strict=True):
            # d ln det(1 + A_jj K) = tr(K (1 + A_jj K)⁻¹ dA_jj)
            a, b = np.triu_indices(len(body.dofs))
            weight = (motions[:, :r] @ held @ motions[:, :r].T)[..., a, b] * np.where(a == b, 1.0, 2.0)
            variance += (np.abs((weight[..., None, :] @ root)[..., 0, :]) ** 2).sum(axis=-1)
        return np.sqrt(variance)

    def _free(self, matrices: Array, factors: ArrayLike | None) -> ComplexArray:
        """Receptance without the joint at each of a batch, shape (batch, lines, k, k)."""
        known = as_factors(factors, len(matrices))
        if known.shape[1] == 0:
            whole = self._model.free(known[0] if len(known) else np.empty(0))
            return np.broadcast_to(whole, (len(matrices), *whole.shape))
        return np.stack([self._model.free(row) for row in known])

    def _of_body(self, number: int, moved: ComplexArray) -> ComplexArray:
        """Roots of the covariance of H that one body's errors make."""
        body, motions = self._model.bodies[number]
        r = moved.shape[-2]
        force = motions[:, :r] @ moved + motions[:, r:]  # p, (batch, lines, DOFs, ports)
        out, into = force[..., : self._model.n_out], force[..., self._model.n_out :]
        a, b = np.triu_indices(len(body.dofs))
        pairs = out[..., a, :, None] * into[..., b, None, :]
        off = a != b
        pairs[..., off, :, :] += out[..., b[off], :, None] * into[..., a[off], None, :]
        jacobian = np.moveaxis(pairs.reshape(*pairs.shape[:3], -1), -1, -2)
        root = self._roots[number]
        if self._independent[number]:
            return jacobian * np.diagonal(root, axis1=1, axis2=2)[:, None, :]
        return jacobian @ root

    @cached_property
    def _roots(self) -> list[Array]:
        """F with F Fᵀ the covariance of each body's receptances, shape (lines, P, P)."""
        return [_root(body) for body, _ in self._model.bodies]

    @cached_property
    def _independent(self) -> list[bool]:
        return [not (root - root * np.eye(root.shape[-1])).any() for root in self._roots]


def _root(body: MeasuredBody) -> Array:
    """A matrix root of the covariance, which may be singular."""
    diagonal = np.diagonal(body.covariance, axis1=1, axis2=2)
    unit = np.eye(diagonal.shape[1])
    if not (body.covariance - diagonal[:, :, None] * unit).any():
        return np.sqrt(diagonal)[:, :, None] * unit
    # receptances of translations and rotations differ by orders of magnitude: scaled, the small ones keep their digits
    size = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(body.covariance / (size[:, :, None] * size[:, None, :]))
    root: Array = size[:, :, None] * vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    return root
