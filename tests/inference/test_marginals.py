"""Marginal priors: one harness against scipy's laws, on ln k and on the stiffness itself, and what asks a marginal."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import integrate, stats

from jointbayes.inference import JointPrior, Normal, Nuisance, OfStiffness, Uniform
from jointbayes.joint import LogStiffness
from jointbayes.posterior.verdicts import bounds_within_reach


class OfLogarithm:
    """Law of ln k by that of k; its middle is the median, its width half the central 68 %."""

    def __init__(self, of_k):
        self.of_k = of_k

    def pdf(self, t):
        return self.of_k.pdf(np.exp(t)) * np.exp(t)

    def cdf(self, t):
        return self.of_k.cdf(np.exp(t))

    def ppf(self, p):
        return np.log(self.of_k.ppf(p))

    def support(self):
        with np.errstate(divide="ignore"):
            return np.log(np.maximum(self.of_k.support(), 0.0))

    def mean(self):
        return self.ppf(0.5)

    def std(self):
        return np.diff(self.ppf(stats.norm.cdf([-1, 1])))[0] / 2


PRIORS = [
    (Normal(20.0, 0.7), stats.norm(20.0, 0.7)),
    (Uniform(-1.0, 3.0), stats.uniform(-1.0, 4.0)),
    (OfStiffness(Uniform(2e5, 7e6)), OfLogarithm(stats.uniform(2e5, 6.8e6))),
    (OfStiffness(Uniform(0.0, 7e6)), OfLogarithm(stats.uniform(0.0, 7e6))),
    (OfStiffness(Normal(3e6, 1e6)), OfLogarithm(stats.truncnorm(-3, np.inf, 3e6, 1e6))),
    (OfStiffness(Normal(1e6, 2e6)), OfLogarithm(stats.truncnorm(-0.5, np.inf, 1e6, 2e6))),
    (OfStiffness(stats.gamma(4.0, scale=1e6)), OfLogarithm(stats.gamma(4.0, scale=1e6))),
]


@pytest.mark.parametrize(("prior", "law"), PRIORS)
def test_a_marginal_is_the_law_that_it_states(prior, law):
    """On a stiffness k: the density of ln k is that of k times k."""
    theta, p = law.ppf([0.001, 0.3, 0.9999]), np.array([0.01, 0.4, 0.975])
    assert_allclose(np.exp(prior.log_density(theta)), law.pdf(theta), rtol=1e-9)
    low, high = prior.ppf(np.array([1e-9, 1 - 1e-9]))
    whole, _ = integrate.quad(lambda t: math.exp(prior.log_density(np.array(t))), low, high)
    assert whole == pytest.approx(1, abs=1e-6)
    assert_allclose(prior.ppf(p), law.ppf(p), rtol=1e-9)
    assert_allclose(prior.cdf(law.ppf(p)), p, rtol=1e-9)
    assert stats.kstest(prior.sample(np.random.default_rng(2), 20_000), law.cdf).pvalue > 1e-3
    assert (prior.mean, prior.sd) == pytest.approx((law.mean(), law.std()))
    assert_allclose(prior.support, law.support(), rtol=1e-12)
    assert prior.precision == pytest.approx(0.0 if isinstance(prior, Uniform) else 1 / prior.sd**2)


@pytest.mark.parametrize("prior", [Uniform(-1.0, 3.0), OfStiffness(Uniform(2e5, 7e6))])
def test_the_ends_of_its_support_are_inside(prior):
    ends = np.array(prior.support)
    assert np.isfinite(prior.log_density(ends)).all()
    assert np.isneginf(prior.log_density(ends + np.array([-1e-4, 1e-4]))).all()


@pytest.mark.parametrize("decades", [0.3, 1.0, 2.0])
def test_a_guess_is_right_to_within_its_decades_with_95_per_cent(decades):
    prior = Normal.from_decades(1e9, decades)
    below, above = prior.cdf(np.log([1e9 / 10**decades, 1e9 * 10**decades]))
    assert (above - below, prior.mean) == pytest.approx((0.95, np.log(1e9)), abs=1e-12)


@pytest.mark.science
def test_the_prior_of_a_joint_integrates_to_one_and_its_draws_follow_it():
    # as a share of the draws of another prior, weighted by the ratio of densities
    ends = {"k11": (1e6, 1e9), "k12": (1e3, 5e6), "k22": (1e3, 1e6)}
    prior = JointPrior(LogStiffness(), tuple(OfStiffness(Uniform(*end)) for end in ends.values()))
    other = JointPrior(LogStiffness(), tuple(Uniform(*np.log(end)) for end in ends.values()))
    assert not prior.gaussian
    assert prior.bounds_of("k12") == (1e3, 5e6)
    rng = np.random.default_rng(4)
    theta = other.sample(rng, 400_000)
    weight = np.exp(prior.log_density(theta) - other.log_density(theta))
    assert weight.mean() == pytest.approx(1, abs=5 * weight.std() / 400_000**0.5 + 2e-3)
    k = prior.values(prior.sample(rng, 40_000))
    assert (k[:, 1] ** 2 < k[:, 0] * k[:, 2]).all()
    inside = rng.uniform(*np.array(list(ends.values())).T, (400_000, 3))
    inside = inside[inside[:, 1] ** 2 < inside[:, 0] * inside[:, 2]]
    for i in range(3):
        assert stats.ks_2samp(k[:, i], inside[:, i]).pvalue > 1e-3
    of_cube = prior.values(prior.transform(rng.uniform(size=(20_000, 3))))
    assert stats.ks_2samp(of_cube[:, 1], inside[:, 1]).pvalue > 1e-3


def test_a_prior_on_the_stiffness_has_a_bound_within_reach():
    marginals = (OfStiffness(Uniform(0.0, 1e9)), Normal(10.0, 1.0), OfStiffness(Normal(1e6, 1e5)))
    prior = JointPrior(LogStiffness(), marginals)
    at_the_end = np.full((1000, 3), math.log(0.99e9))
    assert bounds_within_reach(prior, at_the_end) == (("k11", "upper"),)
    assert bounds_within_reach(prior, at_the_end - 5.0) == ()


def test_the_forward_model_is_made_for_six_standard_deviations_of_a_normal_quantity():
    assert Nuisance("length", "mm", 383.0, Normal(0.1, 0.02)).range == pytest.approx((-0.02, 0.22))
    assert Nuisance("length", "mm", 383.0, Uniform(-0.3, 0.2)).range == (-0.3, 0.2)
