"""Priors, likelihoods and the posterior density of a joint's coordinates."""

from jointbayes.inference.likelihood import FrequencyLikelihood, FrfLikelihood, Likelihood, likelihood_of
from jointbayes.inference.log_posterior import LogPosterior
from jointbayes.inference.marginals import Marginal, Normal, Uniform
from jointbayes.inference.noise.models import (
    CorrelatedNoise,
    GaussianNoise,
    IntegratedScale,
    NoiseModel,
    ScaledNoise,
    StudentNoise,
)
from jointbayes.inference.prior import JointPrior, Nuisance
from jointbayes.inference.problem import Problem
from jointbayes.inference.resonance_chart import ResonanceChart

__all__ = [
    # prior
    "JointPrior",
    "Marginal",
    "Normal",
    "Nuisance",
    "Uniform",
    # likelihood
    "FrequencyLikelihood",
    "FrfLikelihood",
    "Likelihood",
    "likelihood_of",
    # noise
    "CorrelatedNoise",
    "GaussianNoise",
    "IntegratedScale",
    "NoiseModel",
    "ScaledNoise",
    "StudentNoise",
    # posterior
    "LogPosterior",
    "Problem",
    "ResonanceChart",
]
