"""Likelihood beside a measured body: against a direct dense computation, its derivatives, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import jointbayes as jb
from jointbayes.inference import LogPosterior, ScaledNoise
from tests.conftest import STEEL, lone_likelihood
from tests.frf.test_measured_body import K_PAIR, LINES, PORTS, TAPER, coupled, measured_spindle, tool
from tests.oracles import differences
from vibrecords import FrfData, FrfSet

KNOWN = np.array([2e8, 3e6, 1e5])
PRIOR = jb.JointPrior(jb.LogStiffness(), tuple(jb.Normal(np.log(k), 1.0) for k in KNOWN))


def data(outputs=("7:y", "s4:y"), inputs=("7:y",), quantity="receptance", sd=0.02) -> FrfData:
    """Noisy FRFs of the assembled structure whose spindle is exactly what was measured."""
    exact = coupled(measured_spindle(), ports=jb.Ports(LINES, outputs, inputs)).receptance(K_PAIR)
    rng = np.random.default_rng(7)
    noise = rng.standard_normal((*exact.shape, 2)) @ [1, 1j] / np.sqrt(2)
    frf = FrfSet(LINES, (exact * (1 + sd * noise))[0], outputs, inputs).converted(quantity)
    return FrfData(frf, (sd * np.abs(frf.values)) ** 2)


def whole(sd=0.01, **kwargs) -> jb.Substructures:
    return jb.Substructures(tool(), (measured_spindle(sd=sd),), **kwargs)


def numerical_covariance(ports: jb.Ports, body: jb.MeasuredBody, k) -> np.ndarray:
    """J Σ_A Jᴴ with J by differences of the forward model, one measured receptance after the other."""
    a, b = np.triu_indices(len(body.dofs))
    columns = []
    for i, j in zip(a, b, strict=True):
        step = 1e-5 * np.abs(body.receptance[:, i, j])
        ends = []
        for sign in (1, -1):
            moved = np.array(body.receptance)
            moved[:, i, j] += sign * step
            if i != j:
                moved[:, j, i] += sign * step
            ends.append(coupled(replace(body, receptance=moved), ports=ports).receptance(k)[0])
        up, down = ends
        columns.append((up - down) / (2 * step)[:, None, None])
    jacobian = np.stack(columns, axis=-1).reshape(len(ports.frequency_hz), -1, a.size)
    return jacobian @ body.covariance @ jacobian.conj().swapaxes(1, 2)


@pytest.mark.parametrize("quantity", ["receptance", "accelerance"])
def test_the_likelihood_is_the_dense_gaussian_of_data_and_body_errors(quantity):
    """Real and imaginary parts stacked into one real normal of each line, its covariance by differences."""
    measurement = data(quantity=quantity)
    factor = np.abs(measurement.frf.values / data().frf.values)[:, :, 0]
    found = lone_likelihood(whole(), TAPER, measurement)
    for k in (K_PAIR, 1.3 * K_PAIR):
        added = numerical_covariance(PORTS, measured_spindle(), k)
        predicted = coupled(measured_spindle()).receptance(k)[0, :, :, 0]
        residual = (predicted - data().frf.values[:, :, 0]) * factor
        total = 0.0
        for line in range(len(LINES)):
            sigma = added[line] * np.outer(factor[line], factor[line]) + np.diag(measurement.variance[line, :, 0])
            real = np.block([[sigma.real, -sigma.imag], [sigma.imag, sigma.real]]) / 2
            stacked = np.concatenate([residual[line].real, residual[line].imag])
            total += stats.multivariate_normal(np.zeros(4), real, allow_singular=False).logpdf(stacked)
        assert found.log_likelihood(k[None])[0] == pytest.approx(total, abs=1e-4)


def test_without_errors_of_the_body_the_likelihood_is_the_usual_one():
    ignored = lone_likelihood(whole(propagate=False), TAPER, data())
    exact = lone_likelihood(whole(sd=0.0), TAPER, data())
    usual = lone_likelihood(whole(), TAPER, data())
    k = np.stack([K_PAIR, 1.2 * K_PAIR])
    assert exact.log_likelihood(k) == pytest.approx(ignored.log_likelihood(k), rel=1e-12)
    assert (np.abs(usual.log_likelihood(k) - ignored.log_likelihood(k)) > 1).all()
    assert ignored.gaussian
    assert not usual.gaussian


def test_a_gain_multiplies_what_the_errors_of_the_body_make():
    gain = jb.Nuisance("gain", "1", 1.0, jb.Normal(0.0, 0.05))
    prior = replace(PRIOR, nuisances=(gain,))
    log_posterior = jb.Problem(structure=whole(), joint=TAPER, data=data(), prior=prior).log_posterior
    theta = np.append(np.log(KNOWN), np.log(1.1))
    scaled = data()
    scaled = replace(scaled, frf=replace(scaled.frf, values=scaled.frf.values / 1.1), variance=scaled.variance / 1.21)
    (want,) = lone_likelihood(whole(), TAPER, scaled).log_likelihood(K_PAIR[None])
    want -= 2 * scaled.frf.values.size * np.log(1.1)
    assert log_posterior.log_likelihood(theta)[0] == pytest.approx(want, abs=1e-8)


def test_noise_models_take_the_whole_noise_for_the_stated_one():
    k, measurement = K_PAIR[None], data()
    usual = lone_likelihood(whole(), TAPER, measurement)
    scaled = lone_likelihood(whole(), TAPER, measurement, noise=ScaledNoise(2))
    assert scaled.log_likelihood(k, [[1.0]]) == pytest.approx(usual.log_likelihood(k))
    assert scaled.log_likelihood(k, [[1.5]])[0] != pytest.approx(usual.log_likelihood(k)[0], abs=1)
    many = lone_likelihood(whole(), TAPER, measurement, noise=jb.StudentNoise(2, 1e7))
    assert many.log_likelihood(k) == pytest.approx(usual.log_likelihood(k), abs=1e-3)


def test_whitened_residuals_of_replicated_data_are_white():
    """Data drawn with drawn errors of the body: E z zᴴ = 1, also between outputs."""
    body = measured_spindle(sd=1e-3)
    rng, a, b = np.random.default_rng(11), *np.triu_indices(3)
    sd = np.sqrt(np.diagonal(body.covariance, axis1=1, axis2=2))
    truth = coupled(body).receptance(K_PAIR)[0]
    variance = (1e-3 * np.abs(truth)) ** 2
    z = []
    for _ in range(60):
        delta = np.zeros((len(LINES), 3, 3), dtype=complex)
        delta[:, a, b] = delta[:, b, a] = sd * (rng.standard_normal((*sd.shape, 2)) @ [1, 1j]) / np.sqrt(2)
        noise = rng.standard_normal((*truth.shape, 2)) @ [1, 1j] * np.sqrt(variance / 2)
        noisy = jb.Substructures(tool(), (replace(body, receptance=body.receptance + delta),))
        measurement = FrfData(FrfSet(LINES, truth + noise, PORTS.outputs, PORTS.inputs), variance)
        z.append(lone_likelihood(noisy, TAPER, measurement).standardised(K_PAIR[None])[0])
    second = np.einsum("nlp,nlq->pq", z, np.conj(z)) / (60 * len(LINES))
    assert np.abs(second - np.eye(2)).max() < 4 / np.sqrt(60 * len(LINES))


def test_residuals_of_one_point_are_those_of_the_batch_and_their_jacobian_is_of_a_noise_held_fixed():
    recipe = jb.BeamRecipe(0.18, jb.Section.circle(0.02), STEEL, jb.LossFactor(0.02), elements=6)
    family = jb.BeamFamily(recipe, {"youngs_modulus": (-0.1, 0.1)})
    nuisance = jb.Nuisance("youngs_modulus", "GPa", 210.0, jb.Normal(0.0, 0.02))
    structure = jb.Substructures(family, (measured_spindle(),))
    problem = jb.Problem(structure=structure, joint=TAPER, data=data(), prior=replace(PRIOR, nuisances=(nuisance,)))
    log_posterior = problem.log_posterior
    theta = np.append(np.log(KNOWN) + 0.1, 0.01)
    residual, jacobian = log_posterior.data_residuals(theta)
    white = log_posterior.white(theta)[0]
    assert np.sort(np.abs(residual)) == pytest.approx(np.sort(np.abs(white)))
    roots = log_posterior.likelihood.terms[0].likelihood._roots(
        PRIOR.parametrisation.matrix(np.exp(theta[None, :3])), np.exp(theta[None, 3:])
    )
    for slope, column in zip(differences(lambda at: log_posterior.predicted(at)[0], theta), jacobian.T, strict=True):
        solved = np.linalg.solve(roots[0], slope.reshape(len(LINES), 2, 1))[..., 0]
        want = np.sqrt(2) * np.concatenate([solved.real.ravel(), solved.imag.ravel()])
        assert np.abs(column - want).max() < 1e-4 * np.abs(want).max()


def test_pointwise_values_add_up_and_are_refused_where_frfs_share_the_noise():
    one = data(outputs=("7:y",))
    found = lone_likelihood(whole(), TAPER, one)
    assert found.pointwise(K_PAIR[None]).sum() == pytest.approx(found.log_likelihood(K_PAIR[None])[0])


def test_the_variance_is_that_of_the_data_and_the_propagated_one():
    measurement = data(quantity="accelerance")
    found = lone_likelihood(whole(), TAPER, measurement).variance(K_PAIR[None])[0, :, :, 0]
    added = numerical_covariance(PORTS, measured_spindle(), K_PAIR)
    omega = 2 * np.pi * LINES[:, None]
    want = measurement.variance[:, :, 0] + np.diagonal(added, axis1=1, axis2=2).real * omega**4
    assert found == pytest.approx(want, rel=1e-5)
    ignored = lone_likelihood(whole(propagate=False), TAPER, measurement).variance(K_PAIR[None])
    assert (ignored[0] == measurement.variance).all()


def test_a_problem_with_a_measured_body_has_no_modes_and_says_what_it_ignores():
    problem = jb.Problem(structure=whole(), joint=TAPER, data=data(), prior=PRIOR)
    assert isinstance(problem.log_posterior, LogPosterior)
    assert problem.test.most_modes == 0
    assert problem.natural_frequencies_hz(KNOWN, 3).shape == (1, 0)
    assert [body.name for body in problem.test.measured_bodies] == ["spindle"]
    assert not problem.test.ignores_noise_of_bodies
    assert problem.with_test(structure=whole(propagate=False)).test.ignores_noise_of_bodies
