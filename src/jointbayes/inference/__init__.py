"""Priors, likelihoods and the posterior density of a joint's coordinates."""

from jointbayes.inference.assemblies import AssemblyScatter as AssemblyScatter
from jointbayes.inference.likelihood import FrfLikelihood as FrfLikelihood
from jointbayes.inference.likelihood_base import Likelihood as Likelihood
from jointbayes.inference.log_posterior import LogPosterior as LogPosterior
from jointbayes.inference.marginals import Marginal as Marginal
from jointbayes.inference.marginals import Normal as Normal
from jointbayes.inference.marginals import OfStiffness as OfStiffness
from jointbayes.inference.marginals import Uniform as Uniform
from jointbayes.inference.modal_likelihood import GaussianLikelihood as GaussianLikelihood
from jointbayes.inference.modal_likelihood import ModePrediction as ModePrediction
from jointbayes.inference.modal_likelihood import mac as mac
from jointbayes.inference.modal_likelihood import modal_model as modal_model
from jointbayes.inference.noise.base import ErrorSizes as ErrorSizes
from jointbayes.inference.noise.base import NoiseModel as NoiseModel
from jointbayes.inference.noise.gaussian import GaussianNoise as GaussianNoise
from jointbayes.inference.noise.gaussian import IntegratedScale as IntegratedScale
from jointbayes.inference.noise.gaussian import ScaledNoise as ScaledNoise
from jointbayes.inference.noise.model_error import ModelErrorNoise as ModelErrorNoise
from jointbayes.inference.noise.proportional import ProportionalNoise as ProportionalNoise
from jointbayes.inference.noise.student_t import StudentNoise as StudentNoise
from jointbayes.inference.prior import JointPrior as JointPrior
from jointbayes.inference.prior import Nuisance as Nuisance
from jointbayes.inference.problem import Problem as Problem
from jointbayes.inference.test import Level as Level
from jointbayes.inference.test import Test as Test
from jointbayes.inference.test import likelihood_of as likelihood_of
