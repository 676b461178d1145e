"""Simulated data come from the likelihood that judges them, and know nothing of the truth but that."""

import numpy as np
import pytest

import jointbayes as jb
from tests.conftest import pair_matrix
from tests.science.calibration import replace_values, simulated_values
from tests.studies.calibration_cases import FREQUENCIES, TEXT, small_case

CASES = {
    "as stated": small_case(),
    "nuisances": small_case("[uncertain.length]\nsd_percent = 0.5\n[uncertain.gain]\nsd_percent = 5.0\n"),
    "scale": small_case('[noise]\nscale = "sampled"\n'),
    "integrated": small_case('[noise]\nscale = "integrated"\n'),
    "student": small_case('[noise]\ndistribution = "student_t"\n'),
    "student, scale": small_case('[noise]\ndistribution = "student_t"\nscale = "sampled"\n'),
    "proportional": small_case('[noise]\ndistribution = "proportional"\n'),
    "accelerance": small_case(text=TEXT.replace("[data]", '[data]\nquantity = "accelerance"')),
    "frequencies": small_case(text=FREQUENCIES),
    "frequencies, scale": small_case('[noise]\nscale = "sampled"\n', text=FREQUENCIES),
}
COUNT = 150


def require_no_score(problem, simulated, count, step):
    """E ∇ ln L = 0 where data come from the likelihood, in each direction of θ, the noise's parameters among them."""
    rng, scores = np.random.default_rng(20), []
    for theta in problem.prior.sample(rng, count):
        steps = step * np.minimum(problem.prior.sd, 1.0)
        around = np.concatenate([theta + np.diag(steps), theta - np.diag(steps)])
        up, down = np.split(simulated(theta, rng).log_posterior.log_likelihood(around), 2)
        scores.append((up - down) / (2 * steps))
    z = np.mean(scores, axis=0) / (np.std(scores, axis=0) / np.sqrt(count))
    assert np.abs(z).max() < 4.0, dict(zip(problem.names, z, strict=True))


@pytest.mark.science
@pytest.mark.parametrize("name", list(CASES))
def test_the_score_at_the_truth_is_zero_in_the_mean(name):
    problem = CASES[name].problem
    require_no_score(
        problem, lambda theta, rng: replace_values(problem, simulated_values(problem, theta, rng)), COUNT, 1e-5
    )


@pytest.mark.science
@pytest.mark.parametrize("name", list(CASES))
def test_whitened_residuals_at_the_truth_have_unit_variance(name):
    problem = CASES[name].problem
    rng = np.random.default_rng(21)
    squares, size = [], 0
    for theta in problem.prior.sample(rng, 100):
        simulated = replace_values(problem, simulated_values(problem, theta, rng))
        likelihood, factors = simulated.log_posterior.likelihood, problem.prior.factors(theta[None])
        white = likelihood.white(pair_matrix(problem.prior.values(theta[None])), factors)
        squares.append(np.mean(white**2))
        size = white.size
    if name == "integrated":  # each data set has a scale of its own from a wide prior: 1/s² is a gamma of mean 1
        assert 0.5 < np.median(squares) < 3
        return
    assert np.mean(squares) == pytest.approx(1.0, abs=5 * np.sqrt(2 / size / 100))


def test_what_the_case_states_of_the_noise_knows_nothing_of_the_truth():
    problem = jb.case_from_text("relative", TEXT.replace("relative = 0.0", "relative = 0.05")).problem
    rng = np.random.default_rng(3)
    simulated = replace_values(problem, simulated_values(problem, problem.prior.sample(rng, 1)[0], rng))
    assert (simulated.test.data.variance == problem.test.data.variance).all()
    assert not np.allclose(simulated.test.data.frf.values, problem.test.data.frf.values, rtol=1e-3)
    assert simulated.test.noise is problem.test.noise
    assert simulated.test.data.joint_frf is None


def test_noise_less_data_are_the_prediction():
    problem = small_case().problem
    theta = problem.prior.mean
    drawn = [simulated_values(problem, theta, np.random.default_rng(i)) for i in range(400)]
    predicted = problem.log_posterior.likelihood.predicted(pair_matrix(problem.prior.values(theta))[None])[0]
    assert (np.abs(np.mean(drawn, axis=0) - predicted) / np.sqrt(problem.test.data.variance / 400)).max() < 4.0
