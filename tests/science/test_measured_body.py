"""A joint beside a measured body: calibrated with the body's noise, far from it without."""

import numpy as np
import pytest
from benchmarks.measured_body import TRUTH, data_set
from scipy import stats

from jointbayes.identification import refine
from jointbayes.identification.refine import laplace_covariance

SETS = 40


def distances(*, propagate: bool) -> np.ndarray:
    """Squared distance of the mode from the truth in Laplace standard deviations, one for each data set."""
    out = []
    for seed in range(1, SETS + 1):
        log_posterior = data_set(seed, propagate=propagate).log_posterior
        mode, _ = refine(log_posterior, np.log(TRUTH))
        away = mode - np.log(TRUTH)
        out.append(away @ np.linalg.solve(laplace_covariance(log_posterior, mode), away))
    return np.array(out)


@pytest.mark.science
def test_with_the_noise_of_the_body_modes_scatter_as_their_covariance_says_and_without_far_more():
    """Sum of squared distances: χ² with three degrees of freedom for each data set if all is right."""
    low, high = stats.chi2(3 * SETS).ppf([0.0005, 0.9995])
    assert low < distances(propagate=True).sum() < high
    assert distances(propagate=False).sum() > 1.5 * high
