import math
import pickle

import numpy as np
import pytest
from scipy import integrate, stats

import jointbayes as jb
from jointbayes.inference import GaussianNoise, IntegratedScale, NoiseModel, ProportionalNoise, ScaledNoise
from jointbayes.inference.likelihood_base import ComplexResidual, LogMagnitudeResidual, residual_of
from tests.one_line import refused
from vibrecords import FrfSet
from vibrecords.variance import coherence_variance

LINES = 40
STATED = np.geomspace(3e-3, 0.3, LINES)[:, None]  # sd over |H|, line by line


def residuals(rng: np.random.Generator, shape: tuple[int, int, int], parts: int) -> np.ndarray:
    z = rng.standard_normal(shape)
    return z + 1j * rng.standard_normal(shape) if parts == 2 else z


def models(parts: int, lines: int = LINES) -> list[tuple[NoiseModel, tuple[float, ...]]]:
    """Each model with values of its hyperparameters."""
    return [
        (GaussianNoise(parts), ()),
        (ScaledNoise(parts), (1.7,)),
        (jb.StudentNoise(parts, 5.0), ()),
        (jb.StudentNoise(parts, 5.0, scaled=True), (1.7,)),
        (ProportionalNoise(parts, STATED[:lines]), (0.02,)),
        (ProportionalNoise(parts, STATED[:lines], scaled=True), (1.7, 0.02)),
    ]


def test_long_records_of_heavy_tails_do_not_overflow() -> None:
    huge = jb.StudentNoise(2, 2.0).log_likelihood(np.full((1, 20000, 1), 1e30 + 0j), np.empty((1, 0)))
    np.testing.assert_allclose(huge, -2 * 20000 * math.log(1e60), rtol=1e-10)


@pytest.mark.parametrize("parts", [1, 2])
@pytest.mark.parametrize(("dof", "scale"), [(2.0, 1.0), (7.0, 1.6)])
def test_integrated_scale_is_the_integral_over_the_scale(parts: int, dof: float, scale: float) -> None:
    z = residuals(np.random.default_rng(4), (2, 9, 2), parts)
    model, sampled = IntegratedScale(parts, dof, scale), ScaledNoise(parts)
    prior = stats.invgamma(dof / 2, scale=dof * scale**2 / 2)  # of the variance factor

    for row, value in zip(z, model.log_likelihood(z, np.empty((2, 0))), strict=True):

        def density(log_s: float, row: np.ndarray = row) -> float:
            s = math.exp(log_s)
            log_l = sampled.log_likelihood(row[None], np.array([[s]]))[0]
            return math.exp(log_l + 40) * prior.pdf(s**2) * 2 * s**2

        integral, _ = integrate.quad(density, -4, 5, epsabs=0, epsrel=1e-10, limit=300)
        assert value == pytest.approx(math.log(integral) - 40, rel=1e-8)


@pytest.mark.parametrize("parts", [1, 2])
def test_integrated_scale_draws_the_scale_that_the_data_imply(parts: int) -> None:
    rng = np.random.default_rng(6)
    model, chi2 = IntegratedScale(parts, 3.0, 2.0), 40.0
    drawn = model.with_scale(np.full(20000, chi2), 12, np.empty((20000, 0)), rng)[1][:, 0]
    shape, rate = 1.5 + parts * 12 / 2, 6.0 + chi2
    assert stats.kstest(drawn**2, stats.invgamma(shape, scale=rate).cdf).pvalue > 0.001
    assert model.typical_scale(chi2, 12) == pytest.approx(math.sqrt(rate / shape))


@pytest.mark.parametrize("scale", [1.0, 0.6])
@pytest.mark.parametrize("dof", [1.5, 4.0])
def test_student_noise_is_normalised(dof: float, scale: float) -> None:
    def density(parts: int, z: complex) -> float:
        one = np.array([[[z if parts == 2 else z.real]]])
        return math.exp(jb.StudentNoise(parts, dof, scaled=True).log_likelihood(one, np.array([[scale]]))[0])

    # the stated constants: 1/π over the plane, 1/√π over the line
    plane, _ = integrate.quad(lambda r: 2 * r * density(2, r * np.exp(0.7j)), 0, np.inf, epsrel=1e-9)
    line, _ = integrate.quad(lambda x: 2 / math.sqrt(math.pi) * density(1, complex(x)), 0, np.inf, epsrel=1e-9)
    assert plane == pytest.approx(1, rel=1e-6)
    assert line == pytest.approx(1, rel=1e-6)


@pytest.mark.parametrize("parts", [1, 2])
def test_student_noise_of_many_degrees_of_freedom_is_gaussian(parts: int) -> None:
    z = residuals(np.random.default_rng(7), (2, 9, 2), parts)
    none = np.empty((2, 0))
    gaussian = GaussianNoise(parts).log_likelihood(z, none)
    np.testing.assert_allclose(jb.StudentNoise(parts, 1e6).log_likelihood(z, none), gaussian, rtol=1e-4)


@pytest.mark.parametrize("parts", [1, 2])
def test_pointwise_densities_add_up_to_the_likelihood(parts: int) -> None:
    z = residuals(np.random.default_rng(8), (3, 40, 2), parts)
    for model, hyper in models(parts):
        rows = np.tile(np.array(hyper), (3, 1))
        total = model.pointwise(z, rows)
        assert total.shape == (3, 40, 2)
        np.testing.assert_allclose(total.sum(axis=(1, 2)), model.log_likelihood(z, rows), rtol=1e-12)


def test_dependent_values_have_no_pointwise_densities() -> None:
    with pytest.raises(jb.ModelError, match="pointwise densities"):
        IntegratedScale(2).pointwise(np.zeros((1, 40, 1), dtype=complex), np.ones((1, 0)))


@pytest.mark.parametrize("parts", [1, 2])
def test_whitened_residuals_keep_the_sum_of_squares_and_are_linear(parts: int) -> None:
    # ln L = c(hyper) − Σ|whitened|²: what Fisher information and Gauss-Newton rest on
    z = residuals(np.random.default_rng(9), (3, LINES, 2), parts)
    for model, hyper in models(parts):
        if isinstance(model, jb.StudentNoise):
            continue
        white = model.whiten(z, np.array(hyper))
        assert white.dtype == (np.complex128 if parts == 2 else np.float64)
        square = (np.abs(white) ** 2).sum(axis=(1, 2))
        rows = np.tile(np.array(hyper), (3, 1))
        constant = model.log_likelihood(np.zeros_like(z), rows)
        np.testing.assert_allclose(model.log_likelihood(z, rows), constant - square, rtol=1e-10)
        both = model.whiten(2 * z[:1] - z[1:2], np.array(hyper))
        np.testing.assert_allclose(both, 2 * white[:1] - white[1:2], atol=1e-12)


@pytest.mark.parametrize("parts", [1, 2])
def test_scores_of_drawn_noise_are_white_gaussian(parts: int) -> None:
    rng = np.random.default_rng(10)
    for model, hyper in models(parts):
        rows = np.tile(np.array(hyper), (300, 1))
        scores = model.scores(model.draw(rng, rows, LINES, 2), rows)
        flat = np.concatenate([scores.real, scores.imag]) if parts == 2 else scores
        assert stats.kstest(flat.ravel() * math.sqrt(2), "norm").pvalue > 1e-3, model
        neighbours = (flat[:, 1:] * flat[:, :-1]).mean() * 2
        assert abs(neighbours) < 4 / math.sqrt(flat.size), model


@pytest.mark.parametrize("parts", [1, 2])
def test_drawn_noise_follows_its_likelihood(parts: int) -> None:
    # E[p(z; other)/p(z; own)] = 1 over draws of the own law: fails if the two disagree, or one is not normalised
    rng = np.random.default_rng(12)
    for model, hyper in models(parts, 3):
        if not hyper:
            continue
        rows = np.tile(np.array(hyper), (60000, 1))
        z = model.draw(rng, rows, 3, 1)
        ratio = np.exp(model.log_likelihood(z, 0.93 * rows) - model.log_likelihood(z, rows))
        assert abs(ratio.mean() - 1) < 4 * ratio.std() / math.sqrt(len(ratio)), model
        assert ratio.std() > 0.05


@pytest.mark.parametrize("parts", [1, 2])
def test_integrated_scale_draws_follow_its_likelihood(parts: int) -> None:
    rng, none = np.random.default_rng(13), np.empty((60000, 0))
    own, other = IntegratedScale(parts, 6.0, 1.0), IntegratedScale(parts, 6.0, 0.9)
    z = own.draw(rng, none, 3, 1)
    ratio = np.exp(other.log_likelihood(z, none) - own.log_likelihood(z, none))
    assert abs(ratio.mean() - 1) < 4 * ratio.std() / math.sqrt(len(ratio))


@pytest.mark.parametrize("parts", [1, 2])
def test_sum_of_squares_suffices_where_it_is_said_to(parts: int) -> None:
    z = residuals(np.random.default_rng(14), (3, 40, 2), parts)
    chi2 = (np.abs(z) ** 2).sum(axis=(1, 2))
    for model, hyper in [*models(parts), (IntegratedScale(parts, 3.0), ())]:
        rows = np.tile(np.array(hyper), (3, 1))
        if model.needs_chi2_only:
            assert not isinstance(model, jb.StudentNoise | ProportionalNoise)
            np.testing.assert_allclose(
                model.log_likelihood_of_chi2(chi2, 80, rows), model.log_likelihood(z, rows), rtol=1e-12
            )


def test_impossible_rows_have_no_likelihood_and_spoil_no_other() -> None:
    z = residuals(np.random.default_rng(15), (9, 40, 1), 2)
    z[4, 7] = np.inf + 0j
    z[5, 9] = complex(np.nan, 0)
    for model, hyper in models(2):
        rows = np.tile(np.array(hyper), (9, 1))
        value = model.log_likelihood(z, rows)
        assert (value[4:6] == -np.inf).all(), model
        assert np.isfinite(np.delete(value, [4, 5])).all(), model
    assert ScaledNoise(2).log_likelihood(z[:1], np.zeros((1, 1)))[0] == -np.inf
    assert jb.StudentNoise(2, 4.0, scaled=True).log_likelihood(z[:1], np.zeros((1, 1)))[0] == -np.inf


def test_models_travel_to_other_processes() -> None:
    z = residuals(np.random.default_rng(16), (1, 40, 1), 2)
    for model, hyper in models(2):
        again = pickle.loads(pickle.dumps(model))
        assert again.log_likelihood(z, np.array([hyper])) == model.log_likelihood(z, np.array([hyper]))


def test_impossible_models_are_refused() -> None:
    refused(lambda: GaussianNoise(3), jb.ModelError, "parts")
    refused(lambda: jb.StudentNoise(2, 0.0), jb.ModelError, "degrees of freedom")
    refused(lambda: IntegratedScale(2, 2.0, math.nan), jb.ModelError, "scale")
    with pytest.raises(jb.ModelError, match="hyperparameters"):
        ScaledNoise(2).log_likelihood(np.zeros((2, 3, 1)), np.ones((2, 2)))


# residuals


def test_complex_residuals_give_the_normalised_density_of_the_frf() -> None:
    rng = np.random.default_rng(17)
    measured, predicted = residuals(rng, (4, 2, 1), 2), residuals(rng, (3, 8, 1), 2).reshape(3, 4, 2, 1)
    variance = rng.uniform(0.5, 2, measured.shape)
    kind = ComplexResidual(measured, variance)
    value = kind.constant + GaussianNoise(kind.parts).log_likelihood(kind.z(predicted), np.empty((3, 0)))
    each = stats.norm(scale=np.sqrt(variance / 2))
    expected = each.logpdf((predicted - measured).real) + each.logpdf((predicted - measured).imag)
    np.testing.assert_allclose(value, expected.sum(axis=(1, 2, 3)), rtol=1e-12)


def test_log_magnitude_residuals_give_the_normalised_density_of_the_logarithm() -> None:
    rng = np.random.default_rng(18)
    measured, predicted = residuals(rng, (4, 2, 1), 2), residuals(rng, (3, 8, 1), 2).reshape(3, 4, 2, 1)
    variance = rng.uniform(0.01, 0.2, measured.shape)
    variance[0] = 1e3  # nothing but noise
    kind = LogMagnitudeResidual(measured, variance)
    value = kind.constant + GaussianNoise(kind.parts).log_likelihood(kind.z(predicted), np.empty((3, 0)))
    sd = np.minimum(np.sqrt(variance / 2) / np.abs(measured), math.pi / math.sqrt(24))
    assert sd[0] == pytest.approx(np.full((2, 1), math.pi / math.sqrt(24)))
    expected = stats.norm(scale=sd).logpdf(np.log(np.abs(predicted)) - np.log(np.abs(measured)))
    np.testing.assert_allclose(value, expected.sum(axis=(1, 2, 3)), rtol=1e-12)


@pytest.mark.parametrize("kind", ["complex", "log_magnitude"])
def test_residuals_have_their_exact_derivative(kind: str) -> None:
    rng = np.random.default_rng(19)
    measured, at, step = (residuals(rng, (5, 2, 1), 2) for _ in range(3))
    residual = residual_of(kind, measured, np.full(measured.shape, 0.3))
    h = 1e-6
    difference = (residual.z((at + h * step)[None]) - residual.z((at - h * step)[None])) / (2 * h)
    np.testing.assert_allclose(residual.tangent(at, step[None]), difference, rtol=1e-7, atol=1e-8)


def test_variance_of_log_magnitude_is_that_of_noisy_values() -> None:
    rng = np.random.default_rng(20)
    noise = residuals(rng, (200_000, 1, 1), 2) / math.sqrt(2)
    assert np.log(np.abs(noise)).var() == pytest.approx(math.pi**2 / 24, rel=0.02)  # pure noise
    log = np.log(np.abs(1 + 0.1 * noise))
    assert log.var() == pytest.approx(0.1**2 / 2, rel=0.03)
    assert abs(log.mean()) < 4 * log.std() / math.sqrt(noise.size)


def test_a_measured_zero_has_no_logarithm() -> None:
    measured = np.ones((3, 1, 1), dtype=complex)
    measured[1] = 0
    refused(lambda: LogMagnitudeResidual(measured, np.ones(measured.shape)), jb.MeasurementError, "line 2")
    refused(lambda: residual_of("phase", measured, np.ones(measured.shape)), jb.ModelError, "log_magnitude")


# variance from coherence


def estimates(rng: np.random.Generator, averages: int, tests: int, lines: int) -> tuple[np.ndarray, FrfSet, np.ndarray]:
    """H1 of noisy tests with random input: true FRF (lines,), the tests as outputs of one set."""
    true = np.linspace(1, 5, lines) * np.exp(1j * np.linspace(0, 3, lines))
    shape = (averages, lines, tests)
    x, n = residuals(rng, shape, 2), residuals(rng, shape, 2)
    y = true[:, None] * x + 0.7 * n
    sxx, syy, sxy = (abs(x) ** 2).sum(0), (abs(y) ** 2).sum(0), (x.conj() * y).sum(0)
    h1, coherence = sxy / sxx, abs(sxy) ** 2 / (sxx * syy)
    outputs = tuple(f"{i + 1}:y" for i in range(tests))
    frf = FrfSet(
        10.0 + np.arange(lines), h1[..., None], outputs, ("1:y",), "receptance", coherence[..., None], averages
    )
    return true, frf, h1


@pytest.mark.parametrize("averages", [3, 10, 50])
def test_variance_from_coherence_is_the_scatter_of_repeated_tests(averages: int) -> None:
    rng = np.random.default_rng(21 + averages)
    true, frf, h1 = estimates(rng, averages, 1500, 12)
    predicted = coherence_variance(frf)[..., 0].mean(axis=1)
    scatter = (np.abs(h1 - true[:, None]) ** 2).mean(axis=1)
    assert (predicted / scatter).mean() == pytest.approx(1, abs=0.05 if averages > 3 else 0.1)
    if averages > 3:
        np.testing.assert_allclose(predicted, scatter, rtol=0.1)


def test_residuals_over_an_estimated_variance_are_student_t() -> None:
    averages = 4
    true, frf, h1 = estimates(np.random.default_rng(30), averages, 2000, 2)
    z = (h1 - true[:, None]) / np.sqrt(coherence_variance(frf)[..., 0])
    model = jb.StudentNoise(2, 2.0 * (averages - 1))
    scores = model.scores(z.T[:, :, None], np.empty((2000, 0)))
    assert stats.kstest((np.abs(scores) ** 2).ravel(), "expon").pvalue > 1e-3
    assert stats.kstest((np.abs(z) ** 2).ravel(), "expon").pvalue < 1e-6  # Gaussian they are not


@pytest.mark.parametrize(
    ("coherence", "averages", "message"),
    [
        (None, 5, "no coherence"),
        ([0.9, 0.9], None, "number of averages"),
        ([1.0, 1.0], 1, "1 average"),
        ([1.0, 1.0], 5, "coherence of 1 at every line of '1:y'"),
        ([0.9, 0.0], 5, "coherence of 0 at 2 Hz"),
    ],
)
def test_coherence_that_tells_nothing_of_the_noise_is_refused(
    coherence: list[float] | None, averages: int | None, message: str
) -> None:
    array = None if coherence is None else np.array(coherence)[:, None, None]
    frf = FrfSet(np.array([1.0, 2.0]), np.ones((2, 1, 1)), ("1:y",), ("1:y",), "receptance", array, averages)
    with pytest.raises(jb.MeasurementError, match=message):
        coherence_variance(frf)
