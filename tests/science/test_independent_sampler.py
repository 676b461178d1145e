"""The posterior agrees with nested sampling, which shares nothing with it but the density."""

import dynesty
import numpy as np
import pytest

import jointbayes as jb
from tests.conftest import CONFIGS

SHORT = {"f_step_hz = 1.0": "f_step_hz = 4.0"}
CASES = {
    "tip FRF, log": ("clamped_beam.toml", SHORT),
    "frequencies, signed, 360 mm": ("clamped_beam_frequencies_360mm.toml", {}),
}


def _nested(case: jb.Case, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Draws of θ and their weights."""
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
        nlive=600,
        sample="rslice",
        bootstrap=0,
        rstate=np.random.default_rng(seed),
    )
    sampler.run_nested(dlogz=0.05, print_progress=False)
    results = sampler.results
    return results.samples, results.importance_weights()


def _moments(theta: np.ndarray, weight: np.ndarray, size: np.ndarray | float) -> np.ndarray:
    """Means and sds of each coordinate with their standard errors: shape (2, 2, d)."""
    mean = weight @ theta
    centred = theta - mean
    variance = weight @ centred**2
    sd = np.sqrt(variance)
    fourth = weight @ centred**4
    return np.array(
        [[mean, sd], [sd / np.sqrt(size), np.sqrt((fourth - variance**2) / size) / (2 * sd)]],
    )


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
    ours, our_error = _moments(draws, np.full(len(draws), 1 / len(draws)), ess)
    samples, weight = _nested(case, seed=2)
    theirs, their_error = _moments(samples, weight, 1 / np.sum(weight**2))
    z = (ours - theirs) / np.hypot(our_error, their_error)
    assert np.abs(z).max() < 4, f"z of means and sds: {z}"
