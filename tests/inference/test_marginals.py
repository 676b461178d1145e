"""Priors on a stiffness itself: against its density in k, and what asks a marginal."""

import math

import numpy as np
import pytest
from scipy import integrate, stats

from jointbayes.errors import ModelError
from jointbayes.inference import JointPrior, Normal, Nuisance, OfStiffness, Uniform
from jointbayes.joint import ElasticCentre, LogStiffness, SignedCoupling
from jointbayes.posterior.widened import bounds_within_reach, widened_prior

PRIORS = [
    (OfStiffness(Uniform(2e5, 7e6)), stats.uniform(2e5, 6.8e6)),
    (OfStiffness(Uniform(0.0, 7e6)), stats.uniform(0.0, 7e6)),
    (OfStiffness(Normal(3e6, 1e6)), stats.truncnorm(-3, np.inf, 3e6, 1e6)),
    (OfStiffness(Normal(1e6, 2e6)), stats.truncnorm(-0.5, np.inf, 1e6, 2e6)),
    (OfStiffness(stats.gamma(4.0, scale=1e6)), stats.gamma(4.0, scale=1e6)),
]


@pytest.mark.parametrize(("prior", "of_k"), PRIORS)
def test_the_density_of_ln_k_is_that_of_k_times_k(prior, of_k):
    k = of_k.ppf([0.001, 0.3, 0.9999])
    np.testing.assert_allclose(np.exp(prior.log_density(np.log(k))), of_k.pdf(k) * k, rtol=1e-9)
    low, high = prior.ppf(np.array([1e-9, 1 - 1e-9]))
    assert integrate.quad(lambda t: math.exp(prior.log_density(np.array(t))), low, high)[0] == pytest.approx(
        1, abs=1e-6
    )


@pytest.mark.parametrize(("prior", "of_k"), PRIORS)
def test_probabilities_quantiles_draws_and_width_are_those_of_k(prior, of_k):
    p = np.array([0.01, 0.4, 0.975])
    np.testing.assert_allclose(np.exp(prior.ppf(p)), of_k.ppf(p), rtol=1e-9)
    np.testing.assert_allclose(prior.cdf(np.log(of_k.ppf(p))), p, rtol=1e-9)
    assert stats.kstest(np.exp(prior.sample(np.random.default_rng(2), 20_000)), of_k.cdf).pvalue > 1e-3
    assert prior.mean == pytest.approx(math.log(of_k.median()))
    middle = np.log(of_k.ppf(stats.norm.cdf([-1, 1])))
    assert prior.sd == pytest.approx((middle[1] - middle[0]) / 2)
    np.testing.assert_allclose(np.exp(prior.support), np.maximum(of_k.support(), 0.0), rtol=1e-12)


def test_the_ends_of_its_support_are_inside():
    prior = OfStiffness(Uniform(2e5, 7e6))
    assert np.isfinite(prior.log_density(np.array(prior.support))).all()
    assert prior.log_density(np.log(np.array([1.99e5, 7.01e6]))).tolist() == [-math.inf, -math.inf]


@pytest.mark.parametrize("given", [Uniform(-3.0, -1.0), Normal(-1.0, 1e-3), OfStiffness(Uniform(1.0, 2.0))])
def test_a_prior_without_a_stiffness_above_zero_is_refused(given):
    with pytest.raises(ModelError, match="expected a distribution of k"):
        OfStiffness(given)


@pytest.mark.parametrize(("parametrisation", "refused"), [(SignedCoupling(), "rho"), (ElasticCentre(), "arm")])
def test_a_coordinate_that_is_no_logarithm_has_no_prior_on_a_stiffness(parametrisation, refused):
    marginals = (OfStiffness(Uniform(1e6, 1e9)),) * 3
    with pytest.raises(ModelError, match=f"prior of {refused}: .* not the logarithm of a stiffness") as error:
        JointPrior(parametrisation, marginals)
    assert "\n" not in str(error.value)
    with pytest.raises(ModelError, match=r"density: .* expected a prior on"):
        Nuisance("density", "kg/m³", 7800.0, OfStiffness(Uniform(1.0, 2.0)))


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


def test_widened_by_a_decade_it_is_still_one_on_the_stiffness():
    prior = JointPrior(
        LogStiffness(), (OfStiffness(Uniform(0.0, 1e9)), Normal(10.0, 1.0), OfStiffness(Normal(1e6, 1e5)))
    )
    first, _, last = widened_prior(prior).marginals
    assert first == OfStiffness(Uniform(0.0, 1e10))
    assert isinstance(last, Normal)
    assert last.mean == pytest.approx(math.log(1e6), abs=1e-3)
    assert last.sd == pytest.approx(0.1 + math.log(10) / 1.96, rel=1e-2)
    at_the_end = np.full((1000, 3), math.log(0.99e9))
    assert bounds_within_reach(prior, at_the_end) == (("k11", "upper"),)
    assert bounds_within_reach(prior, at_the_end - 5.0) == ()
