"""Starts for a climb, picked from many draws of the prior by how much of the data they explain."""

import numpy as np
from numpy.typing import NDArray

from jointbayes.inference import LogPosterior
from jointbayes.joint import joint_matrix

__all__ = ["screened_draws"]

Array = NDArray[np.float64]

_AT_ONCE = 256  # draws: their residuals over all lines are held in memory
_APART = 0.5  # prior standard deviations of the joint's coordinates: nearer ones would climb to one place


def screened_draws(log_posterior: LogPosterior, rng: np.random.Generator, draws: int, keep: int) -> Array:
    """Points from which to climb, shape (≤ keep, d): of so many draws of the prior those that fit the most lines.

    A joint whose resonances are all off by more than their width has no slope that leads to the mode: climbs end
    where one wrong resonance stands on the slope of a measured one. Draws are ranked by Σ ln(1 + |z|²) of the
    standardised residuals z, the Cauchy loss, which counts lines that fit instead of adding up how badly the others
    do not.

    Parameters
    ----------
    log_posterior
        Density to be climbed.
    rng
        Source of the draws.
    draws, keep
        Numbers of draws, and of points to return: apart from one another by half a prior standard deviation.
    """
    prior, likelihood = log_posterior.prior, log_posterior.likelihood
    theta = prior.sample(rng, draws)
    loss = np.empty(draws)
    for begin in range(0, draws, _AT_ONCE):
        part = theta[begin : begin + _AT_ONCE]
        z = likelihood.standardised(joint_matrix(prior.stiffness(part)), prior.factors(part))
        loss[begin : begin + _AT_ONCE] = np.log1p(np.abs(z) ** 2).reshape(len(part), -1).sum(axis=1)
    joint = prior.joint(theta) / prior.sd[: len(prior.marginals)]
    picked: list[int] = []
    for i in np.argsort(np.where(np.isfinite(loss), loss, np.inf)):
        if all(np.abs(joint[i] - joint[k]).max(initial=0.0) > _APART for k in picked):
            picked.append(int(i))
        if len(picked) == keep:
            break
    return theta[picked]
