"""The posterior agrees with nested sampling, which shares nothing with it but the density."""

import dynesty
import numpy as np
import pytest
from dynesty.results import Results
from dynesty.utils import resample_run

import jointbayes as jb
from tests.conftest import CONFIGS

CASES = {
    "tip FRF, log": ("clamped_beam.toml", {"f_step_hz = 1.0": "f_step_hz = 8.0"}),
    "frequencies, signed, 360 mm": ("clamped_beam_frequencies_360mm.toml", {}),
}


def _nested(case: jb.Case, seed: int) -> Results:
    """Nested sampling of θ over the prior's box, the cone left to the density."""
    log_posterior = case.problem.log_posterior
    low, high = log_posterior.prior.support
    inside = -np.log(high - low).sum()  # all marginals are uniform: the prior density inside the cone

    def log_likelihood(theta: np.ndarray) -> float:
        value = log_posterior(theta)[0] - inside
        return float(value) if np.isfinite(value) else -1e300

    sampler = dynesty.NestedSampler(
        log_likelihood,
        lambda u: low + u * (high - low),
        low.size,
        nlive=500,
        sample="rslice",
        slices=5,
        rstate=np.random.default_rng(seed),
    )
    sampler.run_nested(dlogz=0.02, print_progress=False)
    return sampler.results


def _moments(theta: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Means and sds of each coordinate, shape (2, d)."""
    mean = weight @ theta
    return np.array([mean, np.sqrt(weight @ (theta - mean) ** 2)])


def _nested_error(results: Results) -> np.ndarray:
    """Standard errors of `_moments` over bootstrapped live points, shape (2, d).

    The weights' effective size would understate them: it knows nothing of the unknown volumes.
    """
    rng = np.random.default_rng(0)
    again = [resample_run(results, rstate=rng) for _ in range(40)]
    return np.std([_moments(r.samples, r.importance_weights()) for r in again], axis=0, ddof=1)


def _ensemble_error(theta: np.ndarray, ess: np.ndarray) -> np.ndarray:
    """Standard errors of `_moments` of draws with so many effective ones, shape (2, d)."""
    _, sd = _moments(theta, np.full(len(theta), 1 / len(theta)))
    fourth = np.mean((theta - theta.mean(axis=0)) ** 4, axis=0)
    return np.array([sd / np.sqrt(ess), np.sqrt((fourth - sd**4) / ess) / (2 * sd)])


@pytest.mark.parametrize("name", CASES)
def test_means_and_sds_agree_with_nested_sampling_within_four_standard_errors(name):
    file, edits = CASES[name]
    text = (CONFIGS / file).read_text()
    for old, new in edits.items():
        assert old in text
        text = text.replace(old, new)
    case = jb.case_from_text(name, text)
    posterior = jb.sample(case, seed=1)
    assert posterior.converged
    draws = case.problem.parametrisation.coordinates(posterior.stiffness)
    ess = np.array(list(posterior.record.sampler["ess"].values()))
    results = _nested(case, seed=2)
    ours = _moments(draws, np.full(len(draws), 1 / len(draws)))
    theirs = _moments(results.samples, results.importance_weights())
    error = np.hypot(_ensemble_error(draws, ess), _nested_error(results))
    z = (ours - theirs) / error
    assert np.abs(z).max() < 4, f"z of means and sds: {z}"
    # and the test is sharp: a posterior half a standard deviation off, or a quarter too wide, would fail
    assert (4 * error < [[0.5], [0.25]] * ours[1]).all()
