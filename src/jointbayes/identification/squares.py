"""The posterior of a joint as a sum of squares, for climbs from many starts at once."""

import math

import numpy as np
from numpy.typing import NDArray

from jointbayes.inference import IntegratedScale, LogPosterior
from jointbayes.inference.likelihood import FrequencyLikelihood
from jointbayes.joint import joint_matrix

__all__ = ["PosteriorSquares", "white_residuals"]

Array = NDArray[np.float64]

_AT_ONCE = 16  # points whose residuals over all lines are held in memory


class PosteriorSquares:
    """Residuals that are Gaussian and white if the noise model holds, its parameters held as they are.

    Parameters
    ----------
    log_posterior
        The posterior.
    weight
        Factor on each residual, shape (lines, pairs), for a climb on a density that is flattened; by default 1.
    """

    def __init__(self, log_posterior: LogPosterior, weight: Array | None = None) -> None:
        self.prior = log_posterior.prior
        self._posterior, self._weight = log_posterior, weight
        self.columns = np.arange(self.prior.mean.size - log_posterior.likelihood.hyper_count)

    def residuals(self, theta: Array) -> Array:
        """Residuals e, shape (n, m), of points inside the support, shape (n, d)."""
        z = white_residuals(self._posterior, theta)
        return z if self._weight is None else z * np.repeat(self._weight.ravel(), z.shape[1] // self._weight.size)

    def value(self, theta: Array) -> Array:
        """Log density, shape (n,), up to a constant; −inf outside the support."""
        if self._weight is None:
            return self._posterior(theta)
        out = self.prior.log_density(theta)
        inside = np.flatnonzero(np.isfinite(out))
        for few in np.array_split(inside, max(1, inside.size // _AT_ONCE)):
            out[few] -= 0.5 * (self.residuals(theta[few]) ** 2).sum(axis=1)
        out[~np.isfinite(out)] = -np.inf
        return out


def white_residuals(log_posterior: LogPosterior, theta: Array) -> Array:
    """Residuals of points inside the support, shape (n, d), of unit variance each if model and noise hold, (n, m)."""
    likelihood = log_posterior.likelihood
    matrices, factors = joint_matrix(log_posterior.prior.stiffness(theta)), log_posterior.prior.factors(theta)
    z = likelihood.standardised(matrices, factors)
    noise, hyper = likelihood.noise, factors[:, factors.shape[1] - likelihood.hyper_count :]
    if isinstance(likelihood, FrequencyLikelihood):
        return z / hyper if likelihood.hyper_count else z
    # E|z|² = 1 of a complex residual, half of it in each part
    white = math.sqrt(2) * (noise.whiten(z, hyper) if isinstance(noise, IntegratedScale) else noise.scores(z, hyper))
    flat = np.ascontiguousarray(white).reshape(len(theta), -1)
    real: Array = flat.view(np.float64) if np.iscomplexobj(flat) else flat
    return real
