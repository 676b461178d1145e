"""The posterior of a joint as a sum of squares, for climbs from many starts at once."""

import math

import numpy as np
from numpy.typing import NDArray

from jointbayes.inference import LogPosterior
from jointbayes.inference.likelihood import FrfLikelihood
from jointbayes.joint import joint_matrix

__all__ = ["PosteriorSquares"]

Array = NDArray[np.float64]


class PosteriorSquares:
    """Standardised residuals of data under Gaussian noise of the stated size.

    Where the noise model is another one this is the posterior with the noise model's parameters left out.

    Parameters
    ----------
    log_posterior
        The posterior.
    weight
        Factor on each residual, shape (lines, pairs); by default 1.
    """

    def __init__(self, log_posterior: LogPosterior, weight: Array | None = None) -> None:
        self.prior = log_posterior.prior
        self._posterior, self._weight = log_posterior, weight
        likelihood = log_posterior.likelihood
        self.columns = np.arange(self.prior.mean.size - likelihood.hyper_count)
        self._exact = likelihood.gaussian and weight is None
        # E|z|² = 1 of a complex residual, half of it in each part
        self._scale = math.sqrt(2) if isinstance(likelihood, FrfLikelihood) else 1.0

    def residuals(self, theta: Array) -> Array:
        """Residuals e, shape (n, m), of points inside the support, shape (n, d)."""
        matrices, factors = joint_matrix(self.prior.stiffness(theta)), self.prior.factors(theta)
        z = self._posterior.likelihood.standardised(matrices, factors)
        if self._weight is not None:
            z = z * self._weight
        flat = np.ascontiguousarray(z).reshape(len(theta), -1)
        real: Array = flat.view(np.float64) if np.iscomplexobj(flat) else flat
        return self._scale * real

    def value(self, theta: Array) -> Array:
        """Log density, shape (n,), up to a constant; −inf outside the support."""
        if self._exact:
            return self._posterior(theta)
        out = self.prior.log_density(theta)
        inside = np.flatnonzero(np.isfinite(out))
        for one in np.array_split(inside, max(1, inside.size // 16)):
            out[one] -= 0.5 * (self.residuals(theta[one]) ** 2).sum(axis=1)
        out[~np.isfinite(out)] = -np.inf
        return out
