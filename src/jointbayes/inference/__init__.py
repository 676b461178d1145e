"""Priors, likelihoods and the posterior density of a joint's coordinates."""

from jointbayes.inference.assemblies import AssemblyScatter
from jointbayes.inference.likelihood import FrfLikelihood
from jointbayes.inference.likelihood_base import Likelihood
from jointbayes.inference.log_posterior import ExtraLogLikelihood, LogPosterior
from jointbayes.inference.marginals import Distribution, Marginal, Normal, OfStiffness, OwnMarginal, Uniform
from jointbayes.inference.modal_likelihood import GaussianLikelihood, ModePrediction, ValueModel, mac, modal_model
from jointbayes.inference.noise.base import ErrorSizes, NoiseModel
from jointbayes.inference.noise.gaussian import GaussianNoise, IntegratedScale, ScaledNoise
from jointbayes.inference.noise.model_error import ModelErrorNoise
from jointbayes.inference.noise.proportional import ProportionalNoise
from jointbayes.inference.noise.student_t import StudentNoise
from jointbayes.inference.prior import JointPrior, Nuisance
from jointbayes.inference.problem import Problem
from jointbayes.inference.test import Level, Test, likelihood_of

__all__ = [
    # prior
    "AssemblyScatter",
    "Distribution",
    "JointPrior",
    "Marginal",
    "Normal",
    "Nuisance",
    "OfStiffness",
    "OwnMarginal",
    "Uniform",
    # likelihood
    "FrfLikelihood",
    "GaussianLikelihood",
    "Likelihood",
    "ModePrediction",
    "ValueModel",
    "likelihood_of",
    "mac",
    "modal_model",
    # noise
    "ErrorSizes",
    "GaussianNoise",
    "IntegratedScale",
    "ModelErrorNoise",
    "NoiseModel",
    "ProportionalNoise",
    "ScaledNoise",
    "StudentNoise",
    # posterior
    "ExtraLogLikelihood",
    "Level",
    "LogPosterior",
    "Problem",
    "Test",
]
