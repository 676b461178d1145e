"""What the errors of measured bodies do to the FRFs of the assembled structure, to first order.

H = A_ab − A_aj K (1 + A_jj K)⁻¹ A_jb is a holomorphic function of the measured A, and dH_oi = p_oᵀ dA p_i with p the
forces on the body's DOFs when the assembled structure is driven by a unit force at a port. So errors that are complex
circular stay so, and cov(H) = J Σ_A Jᴴ.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.arrays import Array
from jointbayes.frf.coupling import LowRankCoupling
from jointbayes.frf.kernels.by_line import error_roots
from jointbayes.frf.measured_body import MeasuredBody
from jointbayes.frf.ports import as_factors
from jointbayes.joint import AnyJointMatrix, as_joint_matrix

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
        bodies = [body for body, _ in model.bodies]
        self._motions = np.ascontiguousarray(np.concatenate([motions for _, motions in model.bodies]))
        sizes = [len(body.dofs) for body in bodies]
        starts = np.cumsum([0, *sizes[:-1]])
        # rows and columns of the measured receptances among the DOFs of all bodies, shape (2, E)
        self._entries = np.hstack(
            [start + np.array(np.triu_indices(m)) for start, m in zip(starts, sizes, strict=True)]
        )
        self._root = np.zeros((len(bodies[0].frequency_hz), self._entries.shape[1], self._entries.shape[1]))
        first = 0
        for root in map(_root, bodies):
            last = first + root.shape[-1]
            self._root[:, first:last, first:last] = root
            first = last

    def covariance(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> ComplexArray:
        """E[δH δHᴴ], shape (batch, lines, pairs, pairs), of receptances in the order (outputs, inputs).

        For joint matrices (r, r) or (batch, r, r), and factors on the structure's quantities, (q,) or (batch, q).
        """
        roots = self.roots(matrices, factors)
        return roots @ roots.conj().swapaxes(-1, -2)

    def roots(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> ComplexArray:
        """R of which `covariance` is R Rᴴ, shape (batch, lines, pairs, measured receptances of all bodies)."""
        dynamic, model = self._dynamic(matrices), self._model
        free = self._free(len(dynamic), factors)
        pairs = model.n_out * (model.along.shape[1] - model.n_out)
        out = np.empty((len(dynamic), free.shape[1], pairs, self._entries.shape[1]), dtype=complex)
        with np.errstate(all="ignore"):  # a joint at which nothing is finite: its residuals are not either
            error_roots(dynamic, free, model.along, self._motions, self._entries, self._root, model.n_out, out)
        return out

    def relative_sd(self, matrices: AnyJointMatrix, factors: ArrayLike | None = None) -> Array:
        """Standard deviation of det(1 + A_jj K) relative to itself, shape (batch, lines).

        The first order is not enough where it is no small number: near a resonance of the assembled structure.
        """
        k = self._dynamic(matrices)
        free, r = self._free(len(k), factors), k.shape[-1]
        held = np.linalg.solve(np.eye(r) + k @ free[..., :r, :r], np.broadcast_to(k, (len(k), free.shape[1], r, r)))
        # d ln det(1 + A_jj K) = tr(K (1 + A_jj K)⁻¹ dA_jj)
        a, b = self._entries
        weight = (self._motions[:, :r] @ held @ self._motions[:, :r].T)[..., a, b] * np.where(a == b, 1.0, 2.0)
        variance = (np.abs((weight[..., None, :] @ self._root)[..., 0, :]) ** 2).sum(axis=-1)
        return np.asarray(np.sqrt(variance))

    def _dynamic(self, matrices: AnyJointMatrix) -> ComplexArray:
        """Dynamic stiffness of the joint, shape (batch, lines, r, r); (batch, 1, r, r) without damping."""
        batch = as_joint_matrix(matrices).batch
        if batch.damped:
            return batch.dynamic_stiffness(self._model.omega)
        return np.ascontiguousarray(batch.stiffness[:, None].astype(complex))

    def _free(self, batch: int, factors: ArrayLike | None) -> ComplexArray:
        """Receptance without the joint, shape (batch, lines, k, k); (1, …) where it is the same for all."""
        return self._model.free(as_factors(factors, batch))


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
