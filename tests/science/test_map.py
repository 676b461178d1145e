"""The MAP is one point whatever the start; a start that ends elsewhere is named."""

import re

import numpy as np
import pytest

import jointbayes as jb
from jointbayes.identification import refine
from tests.conftest import CONFIGS, TABLE_3, first_in_ci


@pytest.fixture(scope="module")
def noisy() -> jb.Case:
    return jb.load_case(CONFIGS / "clamped_beam.toml")


@pytest.fixture(scope="module")
def estimate(noisy) -> jb.MapEstimate:
    return jb.find_map(noisy)


def _with_noise_seed(case: jb.Case, seed: int) -> jb.Case:
    text, changed = re.subn(r"(?m)^seed = \d+(?=.*\n.*added)", f"seed = {seed}", case.text)
    assert changed == 1
    return jb.case_from_text(case.name, text)


@pytest.mark.science
@pytest.mark.parametrize("chunk", first_in_ci(range(10), 1))
def test_find_map_reaches_the_same_mode_from_100_starts_over_two_decades(noisy, estimate, chunk):
    rng = np.random.default_rng(100 + chunk)
    starts: list[np.ndarray] = []
    while len(starts) < 10:
        k = TABLE_3 * 10 ** rng.uniform(-2, 2, 3)
        if k[1] ** 2 <= k[0] * k[2]:
            starts.append(k)
    sd = np.sqrt(np.diag(estimate.covariance))
    found = [jb.find_map(noisy, initial=k, seed=chunk).theta for k in starts]
    assert all(np.abs((theta - estimate.theta) / sd).max() < 1e-3 for theta in found)


def test_most_starts_reach_the_mode_by_themselves_and_the_rest_are_named(noisy, estimate):
    names = [s.name for s in estimate.starts]
    assert {"first guess", "natural frequencies 1", "screened draw 1"} <= set(names)
    by_density = {s.name for s in estimate.starts if estimate.log_posterior - s.log_posterior > 1}
    assert set(estimate.failed_starts) == by_density
    assert "first guess" in by_density  # Levenberg-Marquardt from (1e8, 0, 0) sticks in a local minimum


def test_the_mode_is_stationary_and_a_maximum(noisy, estimate):
    log_posterior = noisy.problem.log_posterior
    sd = np.sqrt(np.diag(estimate.covariance))
    assert np.abs(log_posterior.gradient(estimate.theta) * sd).max() < 1e-4
    rng = np.random.default_rng(0)
    around = estimate.theta + rng.multivariate_normal(np.zeros(3), estimate.covariance, 200)
    assert (log_posterior(around) <= estimate.log_posterior).all()


def test_exact_data_have_their_mode_at_the_truth():
    estimate = jb.find_map(jb.load_case(CONFIGS / "clamped_beam_noise_free.toml"))
    np.testing.assert_allclose(estimate.values, TABLE_3, rtol=1e-6)


@pytest.mark.parametrize("seed", first_in_ci(range(2), 1))
def test_the_mode_is_found_on_other_noise(noisy, seed):
    case = _with_noise_seed(noisy, seed)
    _, from_truth = refine(case.problem.log_posterior, np.log(TABLE_3))
    assert jb.find_map(case).log_posterior >= from_truth - 1e-6
