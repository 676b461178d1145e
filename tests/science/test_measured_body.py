"""A joint beside a measured body: calibrated with the body's noise, far from it without, damped or not."""

import numpy as np
import pytest
from benchmarks.measured_body import STUDIES, data_set
from scipy import stats

from jointbayes.identification import refine
from jointbayes.identification.refine import laplace_covariance

SETS = 30


def distances(study: str) -> np.ndarray:
    """Squared distance of the mode from the truth in Laplace standard deviations, one for each data set."""
    out, truth = [], np.log(STUDIES[study].truth)
    for index in range(1, SETS + 1):
        log_posterior = data_set(study, index).log_posterior
        mode, _ = refine(log_posterior, truth)
        away = mode - truth
        out.append(away @ np.linalg.solve(laplace_covariance(log_posterior, mode), away))
    return np.array(out)


@pytest.mark.science
@pytest.mark.parametrize("study", list(STUDIES))
def test_with_the_noise_of_the_body_modes_scatter_as_their_covariance_says_and_without_far_more(study):
    """Sum of squared distances: χ² with a degree of freedom for each quantity of each data set if all is right."""
    low, high = stats.chi2(len(STUDIES[study].truth) * SETS).ppf([0.0005, 0.9995])
    total = distances(study).sum()
    if STUDIES[study].propagate:
        assert low < total < high
    else:
        assert total > 1.5 * high
