"""Priors, likelihoods and the posterior density: stated laws, exact derivatives, invariance."""

import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats
from scipy.integrate import cumulative_trapezoid

from jointbayes.errors import ModelError
from jointbayes.frf import Ports, receptance_model, synthesise_frf
from jointbayes.identification.refine import laplace_covariance
from jointbayes.inference import JointPrior, LogPosterior, Normal, Nuisance, Problem, Uniform
from jointbayes.joint import LogStiffness, SignedCoupling
from jointbayes.structure import LossFactor
from tests.conftest import CLAMP, TABLE_3, lone_likelihood, pair_matrix, rod
from vibrecords import FrequencyData, FrfData, FrfSet, RelativeNoise

ROD = rod(elements=4)
LINES = np.linspace(50.0, 2400.0, 60)
QUANTITIES = ("receptance", "mobility", "accelerance")
NORMAL = JointPrior(LogStiffness(), tuple(Normal(np.log(k), 1.5) for k in TABLE_3))
BOX = JointPrior(
    SignedCoupling(), (Uniform(np.log(1e6), np.log(1e12)), Uniform(np.log(1e3), np.log(1e9)), Uniform(-1.0, 1.0))
)


def frf_measurement(quantity="receptance", structure=ROD):
    ports = Ports(LINES, ("5:y", "3:y"), ("5:y", "5:rz"))
    rng = np.random.default_rng(1)
    return synthesise_frf(structure, CLAMP, pair_matrix(TABLE_3), ports, RelativeNoise(0.03, 0.01), quantity, rng)


def frequency_measurement():
    measured = np.array([120.0, 762.0, 2101.0])
    return FrequencyData(measured, np.hypot(0.005 * measured, 0.5))


def posterior(measurement, prior=NORMAL, structure=ROD):
    return Problem(structure=structure, joint=CLAMP, data=measurement, prior=prior).log_posterior


DENSITIES = {
    "receptance": (frf_measurement("receptance"), ROD),
    "mobility": (frf_measurement("mobility"), ROD),
    "accelerance": (frf_measurement("accelerance"), ROD),
    "receptance, loss factor": (
        frf_measurement("receptance", rod(elements=4, damping=LossFactor(0.02))),
        rod(elements=4, damping=LossFactor(0.02)),
    ),
    "frequencies": (frequency_measurement(), ROD),
}
EVERY_DENSITY = pytest.mark.parametrize(("measurement", "structure"), DENSITIES.values(), ids=DENSITIES)
BOTH_PRIORS = pytest.mark.parametrize("prior", [NORMAL, BOX], ids=["log, normal", "signed, uniform"])


# ---- priors


def test_a_normal_prior_is_the_normal_distribution():
    prior, theta = Normal(20.0, 0.7), np.linspace(15.0, 25.0, 11)
    assert_allclose(prior.log_density(theta), stats.norm(20.0, 0.7).logpdf(theta), rtol=1e-13)
    assert stats.kstest(prior.sample(np.random.default_rng(1), 5000), stats.norm(20.0, 0.7).cdf).pvalue > 1e-3
    assert prior.precision == pytest.approx(1 / 0.7**2)
    assert prior.support == (-np.inf, np.inf)


def test_a_uniform_prior_is_the_uniform_distribution_with_its_ends():
    prior = Uniform(-1.0, 3.0)
    assert_allclose(np.exp(prior.log_density(np.array([-1.0, 0.0, 3.0]))), 0.25)
    assert np.isneginf(prior.log_density(np.array([-1.0001, 3.0001]))).all()
    assert stats.kstest(prior.sample(np.random.default_rng(1), 5000), stats.uniform(-1, 4).cdf).pvalue > 1e-3
    assert (prior.mean, prior.support, prior.precision) == (1.0, (-1.0, 3.0), 0.0)
    assert prior.sd == pytest.approx(stats.uniform(-1, 4).std())


@pytest.mark.parametrize("decades", [0.3, 1.0, 2.0])
def test_a_guess_is_right_to_within_its_decades_with_95_per_cent(decades):
    prior = Normal.from_decades(1e9, decades)
    ln_k = stats.norm(prior.mean, prior.sd)
    inside = ln_k.cdf(np.log(1e9 * 10**decades)) - ln_k.cdf(np.log(1e9 / 10**decades))
    assert inside == pytest.approx(0.95, abs=1e-12)
    assert ln_k.median() == pytest.approx(np.log(1e9))


@pytest.mark.parametrize(
    "broken",
    [
        lambda: Normal(0.0, 0.0),
        lambda: Normal(0.0, -1.0),
        lambda: Normal(np.nan, 1.0),
        lambda: Normal(0.0, np.inf),
        lambda: Normal.from_decades(0.0, 1.0),
        lambda: Normal.from_decades(1e9, 0.0),
        lambda: Uniform(1.0, 1.0),
        lambda: Uniform(2.0, 1.0),
        lambda: Uniform(np.nan, 1.0),
        lambda: Uniform(0.0, np.inf),
        lambda: JointPrior(LogStiffness(), (Normal(0.0, 1.0),) * 2),
        # k12 far above what k11 and k22 allow
        lambda: JointPrior(LogStiffness(), tuple(Normal(m, 0.01) for m in (1.0, 9.0, 1.0))).sample(
            np.random.default_rng(1), 10
        ),
    ],
)
def test_impossible_priors_are_refused_in_one_line(broken):
    with pytest.raises(ModelError, match="expected") as caught:
        broken()
    assert "\n" not in str(caught.value)


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
    measured = frf_measurement("mobility")
    frf = measured.frf
    model = receptance_model(ROD, CLAMP, Ports(LINES, frf.outputs, frf.inputs))
    stiffness = pair_matrix(TABLE_3 * [0.9, 1.2, 1.05])
    predicted = model.receptance(stiffness)[0] * (2j * np.pi * LINES)[:, None, None]
    sd = np.sqrt(measured.variance / 2)
    by_hand = stats.norm.logpdf(frf.values.real, predicted.real, sd).sum()
    by_hand += stats.norm.logpdf(frf.values.imag, predicted.imag, sd).sum()
    likelihood = lone_likelihood(ROD, CLAMP, measured)
    assert likelihood.log_likelihood(stiffness[None])[0] == pytest.approx(by_hand, rel=1e-11)
    assert likelihood.n_data == 60 * 2 * 2


def test_the_frequency_likelihood_is_that_of_independent_normals():
    measured = frequency_measurement()
    predicted = Problem(structure=ROD, joint=CLAMP, data=measured, prior=NORMAL).natural_frequencies_hz(TABLE_3, 3)[0]
    by_hand = stats.norm.logpdf(measured.frequency_hz, predicted, measured.sd_hz).sum()
    likelihood = lone_likelihood(ROD, CLAMP, measured)
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
    converted = FrfData(
        receptance.frf.converted(quantity), receptance.variance * factor[:, None, None] ** 2, synthetic=True
    )
    joints = pair_matrix(TABLE_3 * np.random.default_rng(1).uniform(0.5, 2.0, (20, 3)))
    here, there = (lone_likelihood(ROD, CLAMP, m).log_likelihood(joints) for m in (receptance, converted))
    assert np.ptp(here) > 100.0
    assert_allclose(there - there[0], here - here[0], rtol=1e-8, atol=1e-8)
    assert there[0] - here[0] == pytest.approx(-2 * 4 * np.log(factor).sum(), rel=1e-10)


def test_the_likelihood_belongs_to_the_joint_and_not_to_its_coordinates():
    log, signed = posterior(frf_measurement(), NORMAL), posterior(frf_measurement(), BOX)
    joints = TABLE_3 * np.random.default_rng(1).uniform(0.5, 1.2, (10, 3))
    values = [
        density(density.prior.parametrisation.coordinates(joints))
        - density.prior.log_density(density.prior.parametrisation.coordinates(joints))
        for density in (log, signed)
    ]
    assert np.ptp(values[0]) > 10.0
    assert_allclose(values[0], values[1], rtol=1e-9)


def test_a_measured_dof_that_does_not_exist_is_refused():
    frf = FrfSet([100.0], np.ones((1, 1, 1)), ("12:y",), ("5:y",))
    with pytest.raises(ModelError, match="found DOF '12:y'"):
        lone_likelihood(ROD, CLAMP, FrfData(frf, np.ones((1, 1, 1))))
    many = np.arange(1.0, 12.0)
    with pytest.raises(ModelError, match="expected 1 to 10"):
        lone_likelihood(ROD, CLAMP, FrequencyData(many, np.ones(11)))


# ---- posterior density


def points(prior, count=6):
    """Points of the support around Table 3."""
    centre = prior.parametrisation.coordinates(TABLE_3)
    theta = centre + 0.3 * np.random.default_rng(4).normal(size=(50, 3))
    return theta[np.isfinite(prior.log_density(theta))][:count]


@EVERY_DENSITY
@BOTH_PRIORS
def test_residuals_are_the_density_up_to_a_constant(measurement, structure, prior):
    density = posterior(measurement, prior, structure)
    theta = points(prior)
    from_residuals = np.array([-0.5 * (density.residuals(t)[0] ** 2).sum() for t in theta])
    exact = density(theta)
    for i, j in itertools.combinations(range(len(theta)), 2):
        assert from_residuals[i] - from_residuals[j] == pytest.approx(exact[i] - exact[j], rel=1e-8, abs=1e-7)
    likelihood = density.likelihood
    constant = (
        likelihood.constant
        + density.prior.log_density(theta)
        + 0.5 * (prior.precision * (theta - prior.mean) ** 2).sum(axis=1)
    )
    assert_allclose(exact, constant + from_residuals, rtol=1e-10)


@EVERY_DENSITY
@BOTH_PRIORS
def test_the_gradient_and_the_jacobian_are_derivatives(measurement, structure, prior):
    density = posterior(measurement, prior, structure)
    for theta in points(prior, 3):
        gradient, (_, jacobian) = density.gradient(theta), density.residuals(theta)
        for i in range(3):
            step = 1e-4 * np.eye(3)[i]
            near = density(np.array([theta + 2 * step, theta + step, theta - step, theta - 2 * step]))
            difference = (8 * (near[1] - near[2]) - (near[0] - near[3])) / 12e-4
            assert difference == pytest.approx(gradient[i], rel=1e-5, abs=1e-5 * np.abs(gradient).max())
            up, down = (density.residuals(theta + n * step)[0] for n in (1, -1))
            slope = jacobian[:, i]
            assert np.abs((up - down) / 2e-4 - slope).max() < 1e-5 * np.abs(slope).max()


def test_log_magnitudes_have_a_gradient_and_a_covariance_too():
    data, kind = frf_measurement("receptance"), "log_magnitude"
    density = Problem(structure=ROD, joint=CLAMP, data=data, prior=NORMAL, residual_kind=kind).log_posterior
    theta, step = NORMAL.parametrisation.coordinates(TABLE_3), 1e-4
    sides = [density(theta + sign * step * np.eye(3)) for sign in (1, -1)]
    assert density.gradient(theta) == pytest.approx((sides[0] - sides[1]) / (2 * step), rel=1e-4, abs=1e-3)
    assert np.linalg.eigvalsh(laplace_covariance(density, theta)).min() > 0


@EVERY_DENSITY
@BOTH_PRIORS
def test_a_batch_is_the_same_as_one_by_one(measurement, structure, prior):
    density = posterior(measurement, prior, structure)
    theta = points(prior)
    assert len(theta) == 6
    assert_allclose(density(theta), [density(t)[0] for t in theta], rtol=1e-12)
    assert np.ptp(density(theta)) > 0.1


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


def test_the_forward_model_is_made_for_six_standard_deviations_of_a_normal_quantity():
    assert Nuisance("length", "mm", 383.0, Normal(0.1, 0.02)).range == pytest.approx((-0.02, 0.22))
    assert Nuisance("length", "mm", 383.0, Uniform(-0.3, 0.2)).range == (-0.3, 0.2)
