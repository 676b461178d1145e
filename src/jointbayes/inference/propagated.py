"""Noise of FRFs where bodies of the structure are themselves measured: it depends on the joint.

At a line the measured FRFs differ from the predicted ones by their own errors and by what the errors of the measured
bodies make of the prediction, Σ = diag(σ²) + J Σ_A Jᴴ with J = ∂H/∂A at the joint and factors at hand, so that
ln L = −Σ (ln det πΣ + rᴴ Σ⁻¹ r) with r = H − Hˣ. What the errors of the bodies have in common makes FRFs of different
outputs and inputs at one line depend on each other; lines do not.

References
----------
Goodman, N. R. (1963). Statistical analysis based on a certain multivariate complex Gaussian distribution. Annals of
Mathematical Statistics 34(1), 152-177. DOI 10.1214/aoms/1177704250
"""

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.frf import LowRankCoupling, NoisePropagation
from jointbayes.frf.kernels.by_line import noise_roots
from jointbayes.joint import AnyJointMatrix

ComplexArray = NDArray[np.complex128]


class PropagatedNoise:
    """Covariance of residuals at each line, and residuals that are white by it.

    Parameters
    ----------
    model
        Forward model with measured bodies.
    variance
        σ² of the measured receptances, shape (lines, outputs, inputs).
    """

    def __init__(self, model: LowRankCoupling, variance: Array) -> None:
        self.propagation = NoisePropagation(model)
        self._variance = variance.reshape(len(variance), -1)

    def roots(self, matrices: AnyJointMatrix, factors: Array, gain: Array) -> ComplexArray:
        """Lower triangular L with L Lᴴ = Σ, shape (batch, lines, pairs, pairs).

        Of joint matrices (batch, r, r), factors on the structure (batch, f) and on all measured FRFs (batch,).
        """
        added = self.propagation.roots(matrices, factors)
        out = np.empty((*added.shape[:3], added.shape[2]), dtype=complex)
        noise_roots(added, np.ascontiguousarray(gain), self._variance, out)
        return out

    def white(self, roots: ComplexArray, residuals: ComplexArray) -> ComplexArray:
        """L⁻¹ r, shape (n, lines, pairs), E|z|² = 1, of residuals (n, lines, outputs, inputs); roots of one or n."""
        flat = residuals.reshape(*residuals.shape[:2], -1)
        white = np.empty(flat.shape, dtype=complex)
        for p in range(flat.shape[2]):
            known = (roots[..., p, :p] * white[..., :p]).sum(axis=-1)
            white[..., p] = (flat[..., p] - known) / roots[..., p, p]
        return white

    def excess(self, roots: ComplexArray) -> Array:
        """Part of each value in ln det Σ above that of the data's own noise, shape (batch, lines, pairs)."""
        return 2 * np.log(np.diagonal(roots, axis1=2, axis2=3).real) - np.log(self._variance)

    def variance(self, roots: ComplexArray) -> Array:
        """Diagonal of Σ, shape (batch, lines, pairs)."""
        return (np.abs(roots) ** 2).sum(axis=-1)
