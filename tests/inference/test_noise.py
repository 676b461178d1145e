"""Noise models: one harness for all, what each is by itself, residuals, and the variance that a coherence tells."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import integrate, stats

import jointbayes as jb
from jointbayes.inference import GaussianNoise, IntegratedScale, ProportionalNoise, ScaledNoise
from jointbayes.inference.likelihood_base import ComplexResidual
from jointbayes.inference.noise.proportional import RANGE
from jointbayes.posterior.coordinates import draw_problem
from jointbayes.posterior.evidence import evidence
from jointbayes.sampling.coordinate_maps import Identity
from tests.conftest import cheap_text, edited
from vibrecords import FrfData, FrfSet
from vibrecords.variance import coherence_variance

LINES = 40
STATED = np.geomspace(3e-3, 0.3, LINES)[:, None]  # sd over |H|, line by line
#: Each model of so many parts and lines, and values of its hyperparameters.
MODELS = {
    "Gaussian": (lambda parts, _: GaussianNoise(parts), ()),
    "scaled": (lambda parts, _: ScaledNoise(parts), (1.7,)),
    "integrated": (lambda parts, _: IntegratedScale(parts, 6.0), ()),
    "Student": (lambda parts, _: jb.StudentNoise(parts, 5.0), ()),
    "scaled Student": (lambda parts, _: jb.StudentNoise(parts, 5.0, scaled=True), (1.7,)),
    "proportional": (lambda parts, lines: ProportionalNoise(parts, STATED[:lines]), (0.02,)),
    "scaled proportional": (lambda parts, lines: ProportionalNoise(parts, STATED[:lines], scaled=True), (1.7, 0.02)),
}
EVERY = pytest.mark.parametrize("name", MODELS)
POINTWISE = pytest.mark.parametrize("name", [name for name in MODELS if name != "integrated"])
BOTH = pytest.mark.parametrize("parts", [1, 2])


def model_of(name, parts, rows, lines=LINES):
    """A model and its hyperparameters for so many draws, shape (rows, hyper)."""
    make, hyper = MODELS[name]
    return make(parts, lines), np.tile(np.array(hyper, dtype=float), (rows, 1))


def residuals(seed, shape, parts):
    rng = np.random.default_rng(seed)
    z = rng.standard_normal(shape)
    return z + 1j * rng.standard_normal(shape) if parts == 2 else z


@POINTWISE
@BOTH
def test_pointwise_densities_add_up_to_the_likelihood(name, parts):
    z, (model, rows) = residuals(8, (3, LINES, 2), parts), model_of(name, parts, 3)
    total = model.pointwise(z, rows)
    assert total.shape == (3, LINES, 2)
    assert_allclose(total.sum(axis=(1, 2)), model.log_likelihood(z, rows), rtol=1e-12)


@pytest.mark.parametrize("name", [name for name in MODELS if "Student" not in name and name != "integrated"])
@BOTH
def test_whitened_residuals_keep_the_sum_of_squares_and_are_linear(name, parts):
    # ln L = c(hyper) − Σ|whitened|²: what Fisher information and Gauss-Newton rest on
    z, (model, rows) = residuals(9, (3, LINES, 2), parts), model_of(name, parts, 3)
    white = model.whiten(z, rows[0])
    assert white.dtype == (np.complex128 if parts == 2 else np.float64)
    constant = model.log_likelihood(np.zeros_like(z), rows)
    assert_allclose(model.log_likelihood(z, rows), constant - (np.abs(white) ** 2).sum(axis=(1, 2)), rtol=1e-10)
    assert_allclose(model.whiten(2 * z[:1] - z[1:2], rows[0]), 2 * white[:1] - white[1:2], atol=1e-12)


@POINTWISE
@BOTH
def test_scores_of_drawn_noise_are_white_gaussian(name, parts):
    model, rows = model_of(name, parts, 300)
    scores = model.scores(model.draw(np.random.default_rng(10), rows, LINES, 2), rows)
    flat = np.concatenate([scores.real, scores.imag]) if parts == 2 else scores
    assert stats.kstest(flat.ravel() * math.sqrt(2), "norm").pvalue > 1e-3
    assert abs((flat[:, 1:] * flat[:, :-1]).mean() * 2) < 4 / math.sqrt(flat.size)  # of neighbours


@pytest.mark.parametrize("name", [name for name, (_, hyper) in MODELS.items() if hyper or name == "integrated"])
@BOTH
def test_drawn_noise_follows_its_likelihood(name, parts):
    # E[p(z; other)/p(z; own)] = 1 over draws of the own law: fails if the two disagree, or one is not normalised
    model, rows = model_of(name, parts, 60_000, 3)
    other = IntegratedScale(parts, 6.0, 0.9) if name == "integrated" else model
    z = model.draw(np.random.default_rng(12), rows, 3, 1)
    ratio = np.exp(other.log_likelihood(z, 0.93 * rows) - model.log_likelihood(z, rows))
    assert abs(ratio.mean() - 1) < 4 * ratio.std() / math.sqrt(len(ratio))
    assert ratio.std() > 0.05


@EVERY
@BOTH
def test_sum_of_squares_suffices_where_it_is_said_to(name, parts):
    z, (model, rows) = residuals(14, (3, LINES, 2), parts), model_of(name, parts, 3)
    assert model.needs_chi2_only == (name in ("Gaussian", "scaled", "integrated"))
    if model.needs_chi2_only:
        of_chi2 = model.log_likelihood_of_chi2((np.abs(z) ** 2).sum(axis=(1, 2)), 2 * LINES, rows)
        assert_allclose(of_chi2, model.log_likelihood(z, rows), rtol=1e-12)


@EVERY
def test_impossible_rows_have_no_likelihood_and_spoil_no_other_and_models_travel_to_other_processes(name):
    z, (model, rows) = residuals(15, (9, LINES, 1), 2), model_of(name, 2, 9)
    z[4, 7], z[5, 9] = np.inf + 0j, complex(np.nan, 0)
    value = model.log_likelihood(z, rows)
    assert np.flatnonzero(~np.isfinite(value)).tolist() == [4, 5]
    assert (value[4:6] == -np.inf).all()
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(model)).log_likelihood(z, rows), value)
    if name in ("scaled", "scaled Student"):
        assert model.log_likelihood(z[:1], np.zeros((1, 1)))[0] == -np.inf


# what each is by itself


@BOTH
@pytest.mark.parametrize(("dof", "scale"), [(2.0, 1.0), (7.0, 1.6)])
def test_integrated_scale_is_the_integral_over_the_scale(parts, dof, scale):
    z = residuals(4, (2, 9, 2), parts)
    model, sampled = IntegratedScale(parts, dof, scale), ScaledNoise(parts)
    prior = stats.invgamma(dof / 2, scale=dof * scale**2 / 2)  # of the variance factor
    for row, value in zip(z, model.log_likelihood(z, np.empty((2, 0))), strict=True):

        def density(log_s, row=row):
            s = math.exp(log_s)
            return math.exp(sampled.log_likelihood(row[None], [[s]])[0] + 40) * prior.pdf(s**2) * 2 * s**2

        integral, _ = integrate.quad(density, -4, 5, epsabs=0, epsrel=1e-10, limit=300)
        assert value == pytest.approx(math.log(integral) - 40, rel=1e-8)


@BOTH
def test_integrated_scale_draws_the_scale_that_the_data_imply(parts):
    model, chi2 = IntegratedScale(parts, 3.0, 2.0), 40.0
    drawn = model.with_scale(np.full(20000, chi2), 12, np.empty((20000, 0)), np.random.default_rng(6))[1][:, 0]
    shape, rate = 1.5 + parts * 12 / 2, 6.0 + chi2
    assert stats.kstest(drawn**2, stats.invgamma(shape, scale=rate).cdf).pvalue > 0.001
    assert model.typical_scale(chi2, 12) == pytest.approx(math.sqrt(rate / shape))


@pytest.mark.parametrize("scale", [1.0, 0.6])
@pytest.mark.parametrize("dof", [1.5, 4.0])
def test_student_noise_is_normalised(dof, scale):
    def density(parts, z):
        one = np.array([[[z if parts == 2 else z.real]]])
        return math.exp(jb.StudentNoise(parts, dof, scaled=True).log_likelihood(one, np.array([[scale]]))[0])

    # the stated constants: 1/π over the plane, 1/√π over the line
    plane, _ = integrate.quad(lambda r: 2 * r * density(2, r * np.exp(0.7j)), 0, np.inf, epsrel=1e-9)
    line, _ = integrate.quad(lambda x: 2 / math.sqrt(math.pi) * density(1, complex(x)), 0, np.inf, epsrel=1e-9)
    assert (plane, line) == pytest.approx((1, 1), rel=1e-6)


@BOTH
def test_student_noise_of_many_degrees_of_freedom_and_an_error_of_nothing_are_gaussian(parts):
    z, none = residuals(7, (2, 9, 2), parts), np.empty((2, 0))
    gaussian = GaussianNoise(parts).log_likelihood(z, none)
    assert_allclose(jb.StudentNoise(parts, 1e6).log_likelihood(z, none), gaussian, rtol=1e-4)
    proportional = ProportionalNoise(parts, np.full((9, 2), 0.01))
    assert_allclose(proportional.log_likelihood(z, np.full((2, 1), 1e-12)), gaussian)


def test_long_records_of_heavy_tails_do_not_overflow():
    huge = jb.StudentNoise(2, 2.0).log_likelihood(np.full((1, 20000, 1), 1e30 + 0j), np.empty((1, 0)))
    assert_allclose(huge, -2 * 20000 * math.log(1e60), rtol=1e-10)


# an error in proportion to |H|

ERROR = 0.05


@pytest.fixture(scope="module")
def spoilt():
    """The small FRF case whose FRF is off by 5 % of |H| line by line, of which its stated noise knows nothing."""
    noise = ("[data.noise]", '[noise]\ndistribution = "proportional"\n\n[data.noise]')
    case = jb.case_from_text("spoilt", edited(cheap_text(), noise, ("relative = 0.008", "relative = 0.002")))
    measured = case.problem.test.data
    error = ERROR * (np.random.default_rng(8).standard_normal((*measured.frf.values.shape, 2)) @ [1, 1j])
    off = FrfData(replace(measured.frf, values=measured.frf.values * (1 + error)), measured.variance)
    return replace(case, problem=case.problem.with_test(data=off, noise=ProportionalNoise.of(off)))


@pytest.mark.science
def test_the_density_of_a_value_integrates_to_one():
    measured, variance = np.full((1, 1, 1), 2.0 - 1.0j), np.full((1, 1, 1), 0.3)
    stated = math.sqrt(0.3 / 2) / abs(2.0 - 1.0j)
    noise, kind = ProportionalNoise(2, np.array([[stated]])), ComplexResidual(measured, variance)

    def density(y, x):
        z = kind.z(np.full((1, 1, 1, 1), x + 1j * y))
        return math.exp(kind.constant + noise.log_likelihood(z, [[0.4]])[0])

    assert integrate.dblquad(density, -10, 14, -12, 10, epsabs=1e-9)[0] == pytest.approx(1, abs=1e-6)


def test_its_standard_deviation_is_that_fraction_of_the_measured_magnitude(spoilt):
    measured = spoilt.problem.test.data
    magnitude, variance = np.abs(measured.frf.values[:, 0]), measured.variance[:, 0]
    spread = ProportionalNoise.of(measured).spread([[0.1]], 1)[0]
    assert_allclose(spread**2 * variance / 2, variance / 2 + (0.1 * magnitude) ** 2)
    both = ProportionalNoise.of(measured, scaled=True).spread([[1.5, 0.1]], 1)[0]
    assert_allclose(both**2, 1.5**2 + spread**2 - 1)
    values = np.array(measured.frf.values)
    values[3] = 0.0  # a measured zero is as stated
    noise = ProportionalNoise.of(FrfData(replace(measured.frf, values=values), measured.variance))
    assert noise.spread([[0.1]], 1)[0, 3, 0] == 1.0


def test_evidence_and_posterior_of_its_size_are_those_of_a_grid(spoilt):
    """A rigid joint leaves the error's size as the only unknown."""
    low, high = np.log(RANGE)
    error = (jb.Nuisance("proportional_error", "1", 1.0, jb.Uniform(low, high)),)
    density = replace(spoilt.problem, prior=jb.JointPrior(jb.PlainSprings(()), (), error)).log_posterior
    grid = np.linspace(low, high, 4001)
    value = density(grid[:, None])
    weight = np.exp(value - value.max())
    problem = replace(spoilt.problem, prior=density.prior)
    chains, _ = draw_problem(problem, grid[[[value.argmax()]]], np.random.default_rng(2), jb.SamplerSettings())
    assert chains.converged
    found = evidence(density, [Identity()], chains.draws(), np.random.default_rng(3))
    assert found.log_z == pytest.approx(value.max() + math.log(integrate.trapezoid(weight, grid)), abs=0.01)
    mean = np.average(grid, weights=weight)
    sd = math.sqrt(np.average((grid - mean) ** 2, weights=weight))
    assert abs(chains.draws().theta.mean() - mean) < 5 * sd / math.sqrt(chains.ess.min())


@pytest.mark.science
@pytest.mark.long
def test_an_error_that_coherence_does_not_see_is_found_and_the_joint_with_it(spoilt):
    settings = jb.SamplerSettings(walkers=32, max_steps=10_000, tau_factor=20, end_tolerance=0.05)
    posterior = jb.sample(spoilt, seed=1, settings=settings, premises="exact")
    assert posterior.converged
    low, high = posterior.interval("proportional_error", 0.99)
    assert low < ERROR < high < 1.4 * low
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


# residuals


def normal_parts(difference, variance):
    each = stats.norm(scale=np.sqrt(variance / 2))
    return each.logpdf(difference.real) + each.logpdf(difference.imag)


def test_residuals_give_the_normalised_density_of_the_frf():
    measured, predicted = residuals(17, (4, 2, 1), 2), residuals(18, (3, 8, 1), 2).reshape(3, 4, 2, 1)
    variance = np.random.default_rng(19).uniform(0.01, 0.2, measured.shape)
    variance[0] = 1e3  # nothing but noise
    made = ComplexResidual(measured, variance)
    value = made.constant + GaussianNoise(2).log_likelihood(made.z(predicted), np.empty((3, 0)))
    assert_allclose(value, normal_parts(predicted - measured, variance).sum(axis=(1, 2, 3)), rtol=1e-12)


def test_residuals_have_their_exact_derivative():
    measured, at, step = residuals(19, (3, 5, 2, 1), 2)
    residual = ComplexResidual(measured, np.full(measured.shape, 0.3))
    difference = (residual.z((at + 1e-6 * step)[None]) - residual.z((at - 1e-6 * step)[None])) / 2e-6
    assert_allclose(residual.tangent(at, step[None]), difference, rtol=1e-7, atol=1e-8)


# variance from coherence


def estimates(seed, averages, tests, lines):
    """H1 of noisy tests with random input: true FRF (lines,), the tests as outputs of one set."""
    true = np.linspace(1, 5, lines) * np.exp(1j * np.linspace(0, 3, lines))
    x, n = residuals(seed, (2, averages, lines, tests), 2)
    y = true[:, None] * x + 0.7 * n
    sxx, syy, sxy = (abs(x) ** 2).sum(0), (abs(y) ** 2).sum(0), (x.conj() * y).sum(0)
    h1, coherence = sxy / sxx, abs(sxy) ** 2 / (sxx * syy)
    outputs, frequency_hz = tuple(f"{i + 1}:y" for i in range(tests)), 10.0 + np.arange(lines)
    frf = FrfSet(frequency_hz, h1[..., None], outputs, ("1:y",), "receptance", coherence[..., None], averages)
    return coherence_variance(frf)[..., 0], h1 - true[:, None]


@pytest.mark.parametrize("averages", [3, 10, 50])
def test_variance_from_coherence_is_the_scatter_of_repeated_tests(averages):
    variance, error = estimates(21 + averages, averages, 1500, 12)
    predicted, scatter = variance.mean(axis=1), (np.abs(error) ** 2).mean(axis=1)
    assert (predicted / scatter).mean() == pytest.approx(1, abs=0.05 if averages > 3 else 0.1)
    if averages > 3:
        assert_allclose(predicted, scatter, rtol=0.1)


def test_residuals_over_an_estimated_variance_are_student_t():
    averages = 4
    variance, error = estimates(30, averages, 2000, 2)
    z = error / np.sqrt(variance)
    scores = jb.StudentNoise(2, 2.0 * (averages - 1)).scores(z.T[:, :, None], np.empty((2000, 0)))
    assert stats.kstest((np.abs(scores) ** 2).ravel(), "expon").pvalue > 1e-3
    assert stats.kstest((np.abs(z) ** 2).ravel(), "expon").pvalue < 1e-6  # Gaussian they are not
