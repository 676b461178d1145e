"""The posterior density over the coordinates of a joint."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.inference.likelihood import Likelihood
from jointbayes.inference.prior import JointPrior
from jointbayes.joint import STIFFNESS_PATTERN, joint_matrix

__all__ = ["LogPosterior"]

Array = NDArray[np.float64]


class LogPosterior:
    """ln p(θ | data) up to the evidence, vectorised over walkers.

    Parameters
    ----------
    prior
        Prior density over θ; carries the parametrisation.
    likelihood
        Likelihood of joint matrices.
    """

    def __init__(self, prior: JointPrior, likelihood: Likelihood) -> None:
        self.prior, self.likelihood = prior, likelihood
        #: Number of joints inside the prior's support at which the model had no finite value so far.
        self.singular = 0
        self._parametrisation = prior.parametrisation

    def __call__(self, theta: ArrayLike) -> Array:
        """Log density, shape (n,), of θ, shape (n, d); −inf outside the prior's support and where H is not finite."""
        t = np.atleast_2d(np.asarray(theta, dtype=float))
        out = self.prior.log_density(t)
        inside = np.isfinite(out)
        if inside.any():
            stiffness = joint_matrix(self._parametrisation.stiffness(t[inside]))
            value = self.likelihood.log_likelihood(stiffness)
            out[inside] += value
            self.singular += int(np.isneginf(value).sum())
        return out

    def residuals(self, theta: ArrayLike) -> tuple[Array, Array]:
        """Standardised residuals of data and prior, and their exact Jacobian, at one θ, shape (d,).

        Returns
        -------
        residual, jacobian : ndarray, shapes (m + d,) and (m + d, d)
            ln p = constant − eᵀe/2 inside the support; ∇ ln p = −Jᵀe.
        """
        t = np.asarray(theta, dtype=float)
        stiffness = self._parametrisation.stiffness(t)
        directions = np.einsum("kt,kij->tij", self._parametrisation.derivative(t), STIFFNESS_PATTERN)
        data, slope = self.likelihood.residuals(joint_matrix(stiffness), directions)
        root = np.sqrt(self.prior.precision)
        return (
            np.concatenate([data, root * (t - self.prior.mean)]),
            np.concatenate([slope, np.diag(root)]),
        )

    def gradient(self, theta: ArrayLike) -> Array:
        """∇ ln p, shape (n, d), of θ, shape (n, d), inside the support; shape (d,) of one θ, shape (d,)."""
        t = np.asarray(theta, dtype=float)
        many = np.atleast_2d(t)
        _, slope = self.likelihood.gradient(joint_matrix(self._parametrisation.stiffness(many)))
        by_stiffness = np.einsum("nij,kij->nk", slope, STIFFNESS_PATTERN)
        by_theta = np.einsum("nk,nkt->nt", by_stiffness, self._parametrisation.derivative(many))
        gradient: Array = by_theta - self.prior.precision * (many - self.prior.mean)
        return gradient.reshape(t.shape)
