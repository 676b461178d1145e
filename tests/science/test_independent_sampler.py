"""The posterior agrees with nested sampling, which shares nothing with it but the density."""

import warnings

import dynesty
import numpy as np
import pytest

import jointbayes as jb
from tests.conftest import shipped_text

pytestmark = [pytest.mark.science, pytest.mark.long]

RUNS = 6
#: Fewer lines and narrower priors than those of the cases, so that nested sampling is done in a minute.
CASES = {
    "clamped_beam": {
        "f_step_hz = 1.0": "f_step_hz = 8.0", "low = 1.0e6": "low = 1.0e9", "low = 1.0e4": "low = 1.0e7",
        "high = 1.0e10": "high = 1.0e9", "low = 1.0e3": "low = 1.0e6", "high = 1.0e8": "high = 1.0e7",
    },
    "clamped_beam_frequencies_360mm": {
        "low = 1000000.0": "low = 1.0e8", "low = 1000.0": "low = 5.0e4", "high = 100000000.0": "high = 5.0e6"
    },
}  # fmt: skip


def _nested(case: jb.Case, seed: int) -> np.ndarray:
    """Means and sds of θ, shape (2, d), by nested sampling over the prior's box; the cone is left to the density."""
    log_posterior = case.problem.log_posterior
    low, high = log_posterior.prior.support
    inside = -np.log(high - low).sum()  # all marginals are uniform: the prior density inside the cone

    def log_likelihood(theta: np.ndarray) -> float:
        value = log_posterior(theta)[0] - inside
        return float(value) if np.isfinite(value) else -1e300

    options = {"nlive": 250, "sample": "unif", "rstate": np.random.default_rng(seed)}
    sampler = dynesty.NestedSampler(log_likelihood, lambda u: low + u * (high - low), low.size, **options)
    sampler.run_nested(dlogz=0.02, print_progress=False)
    return _moments(sampler.results.samples, sampler.results.importance_weights())


def _moments(theta: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Means and sds of each coordinate, shape (2, d)."""
    mean = weight @ theta
    return np.array([mean, np.sqrt(weight @ (theta - mean) ** 2)])


def _ensemble_error(theta: np.ndarray, ess: np.ndarray) -> np.ndarray:
    """Standard errors of `_moments` of draws with so many effective ones, shape (2, d)."""
    _, sd = _moments(theta, np.full(len(theta), 1 / len(theta)))
    fourth = np.mean((theta - theta.mean(axis=0)) ** 4, axis=0)
    return np.array([sd / np.sqrt(ess), np.sqrt((fourth - sd**4) / ess) / (2 * sd)])


@pytest.mark.parametrize("name", CASES)
def test_means_and_sds_agree_with_nested_sampling_within_four_standard_errors(name):
    text = shipped_text(name)
    for old, new in CASES[name].items():
        assert old in text
        text = text.replace(old, new)
    case = jb.case_from_text(name, text)
    posterior = jb.sample(case, seed=1)
    assert posterior.converged
    draws = case.problem.parametrisation.coordinates(posterior.stiffness)
    ess = np.array(list(posterior.record.sampler["ess"].values()))
    # several runs, because the weights of one say nothing of the error in the volumes that they rest on
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # dynesty warns of its own low efficiency in the thin ridge
        runs = np.array([_nested(case, seed) for seed in range(RUNS)])
    ours = _moments(draws, np.full(len(draws), 1 / len(draws)))
    error = np.hypot(_ensemble_error(draws, ess), runs.std(axis=0, ddof=1) / np.sqrt(RUNS))
    z = (ours - runs.mean(axis=0)) / error
    assert np.abs(z).max() < 4, f"z of means and sds: {z}"
    # and the test is sharp: a posterior half a standard deviation off, or half too wide, would fail
    assert (4 * error < 0.5 * ours[1]).all()
