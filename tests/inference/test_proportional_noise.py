"""An error in proportion to |H|: its density, the posterior of its size, and what it is for."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate

import jointbayes as jb
from jointbayes.inference import GaussianNoise, ProportionalNoise
from jointbayes.inference.likelihood_base import residual_of
from jointbayes.inference.noise.base import NoiseChoice
from jointbayes.inference.noise.proportional import RANGE, noise_of
from jointbayes.posterior.evidence import evidence
from tests.conftest import cheap_text, edited
from vibrecords import FrequencyData, FrfData

ERROR = 0.05


@pytest.fixture(scope="module")
def spoilt():
    """The small FRF case whose FRF is off by 5 % of |H| line by line, of which its stated noise knows nothing."""
    noise = ("[data.noise]", '[noise]\ndistribution = "proportional"\n\n[data.noise]')
    case = jb.case_from_text("spoilt", edited(cheap_text(), noise, ("relative = 0.008", "relative = 0.002")))
    measured = case.problem.test.data
    rng = np.random.default_rng(8)
    error = ERROR * (rng.standard_normal((*measured.frf.values.shape, 2)) @ [1, 1j])
    off = FrfData(replace(measured.frf, values=measured.frf.values * (1 + error)), measured.variance)
    return replace(case, problem=case.problem.with_test(data=off, noise=ProportionalNoise.of(off, 2)))


@pytest.mark.science
def test_the_density_of_a_value_integrates_to_one():
    measured, variance = np.full((1, 1, 1), 2.0 - 1.0j), np.full((1, 1, 1), 0.3)
    stated = math.sqrt(0.3 / 2) / abs(2.0 - 1.0j)
    noise, kind = ProportionalNoise(2, np.array([[stated]])), residual_of("complex", measured, variance)

    def density(y: float, x: float) -> float:
        z = kind.z(np.full((1, 1, 1, 1), x + 1j * y))
        return math.exp(kind.constant + noise.log_likelihood(z, [[0.4]])[0])

    assert integrate.dblquad(density, -10, 14, -12, 10, epsabs=1e-9)[0] == pytest.approx(1, abs=1e-6)


def test_its_standard_deviation_is_that_fraction_of_the_measured_magnitude(spoilt):
    measured = spoilt.problem.test.data
    magnitude, variance = np.abs(measured.frf.values[:, 0]), measured.variance[:, 0]
    spread = ProportionalNoise.of(measured, 2).spread([[0.1]], 1)[0]
    np.testing.assert_allclose(spread**2 * variance / 2, variance / 2 + (0.1 * magnitude) ** 2)
    # of ln |H|: its own standard deviation, and 0.1
    spread = ProportionalNoise.of(measured, 1).spread([[0.1]], 1)[0]
    own = np.minimum(variance / (2 * magnitude**2), math.pi**2 / 24)
    np.testing.assert_allclose(spread**2 * own, own + 0.1**2)


def test_without_the_error_it_is_gaussian_noise():
    z = np.random.default_rng(1).standard_normal((3, 9, 2)) + 1j
    noise = ProportionalNoise(2, np.full((9, 2), 0.01))
    np.testing.assert_allclose(
        noise.log_likelihood(z, np.full((3, 1), 1e-12)), GaussianNoise(2).log_likelihood(z, np.empty((3, 0)))
    )


def test_a_measured_zero_is_as_stated(spoilt):
    measured = spoilt.problem.test.data
    values = np.array(measured.frf.values)
    values[3] = 0.0
    noise = ProportionalNoise.of(FrfData(replace(measured.frf, values=values), measured.variance), 2)
    assert noise.spread([[0.1]], 1)[0, 3, 0] == 1.0


def test_evidence_and_posterior_of_its_size_are_those_of_a_grid(spoilt):
    """A rigid joint leaves the error's size as the only unknown."""
    low, high = np.log(RANGE)
    error = (jb.Nuisance("proportional_error", "1", 1.0, jb.Uniform(low, high)),)
    problem = replace(spoilt.problem, prior=jb.JointPrior(jb.PlainSprings(()), (), error))
    density = problem.log_posterior
    grid = np.linspace(low, high, 4001)
    value = density(grid[:, None])
    weight = np.exp(value - value.max())
    log_z = value.max() + math.log(integrate.trapezoid(weight, grid))
    start = grid[[value.argmax()]]
    found = evidence(density, [None], [(start, np.array([[1e-3]]))], np.random.default_rng(2))
    assert found.log_z == pytest.approx(log_z, abs=0.01)
    mean = float((weight * grid).sum() / weight.sum())
    sd = math.sqrt(float((weight * (grid - mean) ** 2).sum() / weight.sum()))
    assert found.draws is not None
    assert abs(found.draws.weight @ found.draws.theta[:, 0] - mean) < 5 * sd / math.sqrt(found.ess)


@pytest.mark.science
@pytest.mark.long
def test_an_error_that_coherence_does_not_see_is_found_and_the_joint_with_it(spoilt):
    settings = jb.SamplerSettings(walkers=32, max_steps=10_000, tau_factor=20, end_tolerance=0.05)
    posterior = jb.sample(spoilt, seed=1, settings=settings, premises="exact")
    assert posterior.converged
    low, high = posterior.interval("proportional_error", 0.99)
    assert low < ERROR < high
    assert high < 1.4 * low
    assert posterior.check.explains
    assert "times |H| in each part was inferred" in posterior.check.advice
    truth = {"k11": 5.05e9, "k12": 3.44e7, "k22": 1.52e6}
    assert all(a < truth[name] < b for name in truth for a, b in [posterior.interval(name, 0.99)])


@pytest.mark.science
def test_gaussian_noise_as_stated_is_refused_by_the_check_of_the_same_data(spoilt):
    prior = replace(spoilt.problem.prior, nuisances=())
    stated = replace(spoilt, problem=replace(spoilt.problem, prior=prior).with_test(noise=None))
    settings = jb.SamplerSettings(walkers=16, max_steps=600, tau_factor=20, end_tolerance=0.1)
    assert not jb.sample(stated, seed=1, settings=settings, premises="exact").check.explains


def test_natural_frequencies_are_refused():
    frequencies = FrequencyData(np.array([100.0]), np.array([1.0]))
    with pytest.raises(jb.ModelError, match="expected FRFs"):
        noise_of(NoiseChoice(), 1, frequencies)
