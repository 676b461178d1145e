"""Priors, likelihoods and the posterior density of a joint's coordinates."""

from jointbayes.inference.likelihood import FrequencyLikelihood, FrfLikelihood, Likelihood, likelihood_of
from jointbayes.inference.log_posterior import LogPosterior
from jointbayes.inference.prior import JointPrior, Marginal, Normal, Uniform
from jointbayes.inference.problem import Problem

__all__ = [
    # prior
    "JointPrior",
    "Marginal",
    "Normal",
    "Uniform",
    # likelihood
    "FrequencyLikelihood",
    "FrfLikelihood",
    "Likelihood",
    "likelihood_of",
    # posterior
    "LogPosterior",
    "Problem",
]
