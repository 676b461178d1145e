"""Priors, likelihoods and the posterior density: stated laws, exact derivatives, invariance."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats
from scipy.integrate import cumulative_trapezoid

from jointbayes.frf import Ports, receptance_model, synthesise_frf
from jointbayes.inference import JointPrior, LogPosterior, Normal, Problem, Uniform
from jointbayes.joint import LogStiffness, SignedCoupling
from jointbayes.structure import LossFactor
from tests.conftest import CLAMP, TABLE_3, lone_likelihood, pair_matrix, rod
from tests.oracles import check_density
from vibrecords import FrequencyData, FrfData, RelativeNoise

ROD = rod(elements=4)
LINES = np.linspace(50.0, 2400.0, 60)
QUANTITIES = ("receptance", "mobility", "accelerance")
NORMAL = JointPrior(LogStiffness(), tuple(Normal(np.log(k), 1.5) for k in TABLE_3))
WIDE = (Uniform.of_logarithm(1e6, 1e12), Uniform.of_logarithm(1e3, 1e9), Uniform(-1.0, 1.0))
BOX = JointPrior(SignedCoupling(), WIDE)


def frf_measurement(quantity="receptance", structure=ROD):
    ports = Ports(LINES, ("5:y", "3:y"), ("5:y", "5:rz"))
    rng = np.random.default_rng(1)
    return synthesise_frf(structure, CLAMP, pair_matrix(TABLE_3), ports, RelativeNoise(0.03, 0.01), quantity, rng)


def frequency_measurement():
    measured = np.array([120.0, 762.0, 2101.0])
    return FrequencyData(measured, np.hypot(0.005 * measured, 0.5))


def posterior(measurement, prior=NORMAL, structure=ROD):
    return Problem(structure=structure, joint=CLAMP, data=measurement, prior=prior).log_posterior


LOSSY = rod(elements=4, damping=LossFactor(0.02))
DENSITIES = {
    **{quantity: (frf_measurement(quantity), ROD) for quantity in QUANTITIES},
    "receptance, loss factor": (frf_measurement("receptance", LOSSY), LOSSY),
    "frequencies": (frequency_measurement(), ROD),
}
EVERY_DENSITY = pytest.mark.parametrize(("measurement", "structure"), DENSITIES.values(), ids=DENSITIES)
BOTH_PRIORS = pytest.mark.parametrize("prior", [NORMAL, BOX], ids=["log, normal", "signed, uniform"])


# ---- priors


def test_a_joint_prior_is_the_product_of_its_marginals_inside_the_cone_and_zero_outside():
    theta = np.random.default_rng(1).normal(NORMAL.mean, 2 * NORMAL.sd, size=(500, 3))
    inside = 2 * theta[:, 1] < theta[:, 0] + theta[:, 2]
    assert 0 < inside.sum() < 500
    found = NORMAL.log_density(theta)
    product = sum(stats.norm(np.log(k), 1.5).logpdf(theta[:, i]) for i, k in enumerate(TABLE_3))
    # over the probability of the cone: ln k11 + ln k22 − 2 ln k12 is normal
    middle = np.log(TABLE_3) @ [1.0, -2.0, 1.0]
    cone = stats.norm(middle, 1.5 * np.sqrt(6.0)).logsf(0.0)
    assert_allclose(found[inside], product[inside] - cone, rtol=0.0, atol=1e-3)
    assert_allclose(np.ptp((found - product)[inside]), 0.0, atol=1e-12)
    assert np.isneginf(found[~inside]).all()
    assert_allclose(NORMAL.mean, np.log(TABLE_3))
    assert_allclose((NORMAL.sd, NORMAL.precision), (np.full(3, 1.5), np.full(3, 1 / 2.25)))


def test_draws_from_the_prior_follow_its_density_where_the_cone_does_not_cut():
    marginals = (Normal(20.0, 1.0), Uniform(10.0, 14.0), Uniform(-0.5, 0.9))
    prior = JointPrior(SignedCoupling(), marginals)
    theta = prior.sample(np.random.default_rng(2), 4000)
    assert theta.shape == (4000, 3)
    for i, marginal in enumerate(marginals):
        grid = np.linspace(marginal.mean - 5 * marginal.sd, marginal.mean + 5 * marginal.sd, 4001)
        line = np.tile(prior.mean, (4001, 1))
        line[:, i] = grid
        cdf = cumulative_trapezoid(np.exp(prior.log_density(line)), grid, initial=0)
        assert stats.kstest(theta[:, i], lambda x, g=grid, c=cdf / cdf[-1]: np.interp(x, g, c)).pvalue > 1e-3
    assert np.abs(np.corrcoef(theta.T) - np.eye(3)).max() < 5 / np.sqrt(4000)


def test_draws_from_the_prior_follow_its_density_where_the_cone_cuts():
    prior = JointPrior(LogStiffness(), (Uniform(0.0, 1.0),) * 3)
    theta = prior.sample(np.random.default_rng(3), 4000)
    assert theta.shape == (4000, 3)
    assert prior.parametrisation.feasible(theta).all()

    def cdf(x):  # of θ₁ uniform on the half of the unit cube where 2θ₁ < θ₀ + θ₂
        return np.where(x < 0.5, 2 * (x - 2 * x**3 / 3), 1 - 4 * (1 - x) ** 3 / 3)

    assert cdf(np.array([0.0, 0.5, 1.0])) == pytest.approx([0.0, 5 / 6, 1.0])
    assert stats.kstest(theta[:, 1], cdf).pvalue > 1e-3


# ---- likelihoods


def test_the_frf_likelihood_is_that_of_independent_normal_parts():
    measured, stiffness = frf_measurement("mobility"), pair_matrix(TABLE_3 * [0.9, 1.2, 1.05])
    model = receptance_model(ROD, CLAMP, Ports(LINES, measured.frf.outputs, measured.frf.inputs))
    off = measured.frf.values - model.receptance(stiffness)[0] * (2j * np.pi * LINES)[:, None, None]
    by_hand = stats.norm.logpdf([off.real, off.imag], 0, np.sqrt(measured.variance / 2)).sum()
    likelihood = lone_likelihood(ROD, CLAMP, measured)
    assert likelihood.log_likelihood(stiffness[None])[0] == pytest.approx(by_hand, rel=1e-11)
    assert likelihood.n_data == 60 * 2 * 2


def test_the_frequency_likelihood_is_that_of_independent_normals():
    measured, likelihood = frequency_measurement(), lone_likelihood(ROD, CLAMP, frequency_measurement())
    predicted = Problem(structure=ROD, joint=CLAMP, data=measured, prior=NORMAL).natural_frequencies_hz(TABLE_3, 3)[0]
    by_hand = stats.norm.logpdf(measured.frequency_hz, predicted, measured.sd_hz).sum()
    assert likelihood.log_likelihood(pair_matrix(TABLE_3)[None])[0] == pytest.approx(by_hand, rel=1e-11)
    assert likelihood.n_data == 3


@pytest.mark.parametrize(("length", "expected", "tolerance"), [(0.383, -16.19, 0.02), (0.360, -950.9, 0.5)])
def test_a_rigid_clamp_explains_the_measured_frequencies_as_well_as_it_does_in_an_independent_code(
    length, expected, tolerance
):
    likelihood = lone_likelihood(rod(length), CLAMP, frequency_measurement())
    rigid = pair_matrix([1e18, 0.0, 1e16])
    assert likelihood.log_likelihood(rigid[None])[0] == pytest.approx(expected, abs=tolerance)


@pytest.mark.parametrize("quantity", QUANTITIES[1:])
def test_likelihood_differences_do_not_depend_on_the_quantity(quantity):
    receptance = frf_measurement()
    factor = np.abs(2j * np.pi * LINES) ** QUANTITIES.index(quantity)
    converted = FrfData(receptance.frf.converted(quantity), receptance.variance * factor[:, None, None] ** 2)
    joints = pair_matrix(TABLE_3 * np.random.default_rng(1).uniform(0.5, 2.0, (20, 3)))
    here, there = (lone_likelihood(ROD, CLAMP, m).log_likelihood(joints) for m in (receptance, converted))
    assert np.ptp(here) > 100.0
    assert_allclose(there - there[0], here - here[0], rtol=1e-8, atol=1e-8)
    assert there[0] - here[0] == pytest.approx(-2 * 4 * np.log(factor).sum(), rel=1e-10)


def test_the_likelihood_belongs_to_the_joint_and_not_to_its_coordinates():
    log, signed = posterior(frf_measurement(), NORMAL), posterior(frf_measurement(), BOX)
    joints = TABLE_3 * np.random.default_rng(1).uniform(0.5, 1.2, (10, 3))
    thetas = [density.prior.parametrisation.coordinates(joints) for density in (log, signed)]
    values = [one(theta) - one.prior.log_density(theta) for one, theta in zip((log, signed), thetas, strict=True)]
    assert np.ptp(values[0]) > 10.0
    assert_allclose(values[0], values[1], rtol=1e-9)


# ---- posterior density


def points(prior, count=6):
    """Points of the support around Table 3."""
    centre = prior.parametrisation.coordinates(TABLE_3)
    theta = centre + 0.3 * np.random.default_rng(4).normal(size=(50, 3))
    return theta[np.isfinite(prior.log_density(theta))][:count]


@EVERY_DENSITY
@BOTH_PRIORS
def test_residuals_are_the_density_up_to_a_constant_and_a_batch_is_the_same_as_one_by_one(
    measurement, structure, prior
):
    density, theta = posterior(measurement, prior, structure), points(prior)
    assert len(theta) == 6
    constant = density.likelihood.constant + prior.log_density(theta)
    constant += 0.5 * (prior.precision * (theta - prior.mean) ** 2).sum(axis=1)
    from_residuals = [-0.5 * (density.residuals(t)[0] ** 2).sum() for t in theta]
    assert_allclose(density(theta), constant + from_residuals, rtol=1e-10)
    assert_allclose(density(theta), [density(t)[0] for t in theta], rtol=1e-12)
    assert np.ptp(density(theta)) > 0.1


@EVERY_DENSITY
@BOTH_PRIORS
def test_the_gradient_and_the_jacobian_are_derivatives(measurement, structure, prior):
    density = posterior(measurement, prior, structure)
    for theta in points(prior, 3):
        check_density(density, theta)


class NeverCalled:
    names = ()

    def log_likelihood(self, stiffness, factors=None):
        raise AssertionError(f"called for {stiffness}")


def test_outside_the_support_the_density_is_zero_and_the_likelihood_is_not_asked():
    outside = {
        NORMAL: [[20.0, 21.0, 20.0], [0.0, 1e-9, 0.0]],
        BOX: [[20.0, 10.0, 1.0001], [20.0, 10.0, -1.0], [1.0, 10.0, 0.0], [20.0, 40.0, 0.0], [np.nan, 10.0, 0.0]],
    }
    for prior, theta in outside.items():
        assert np.isneginf(LogPosterior(prior, NeverCalled())(theta)).all()


def test_points_outside_do_not_disturb_those_inside():
    density = posterior(frf_measurement(), BOX)
    inside = points(BOX, 2)
    mixed = density(np.array([inside[0], [20.0, 10.0, 2.0], inside[1]]))
    assert np.isneginf(mixed[1])
    assert_allclose(mixed[[0, 2]], density(inside), rtol=1e-12)
