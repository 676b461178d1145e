"""A sample of the calibration: ranks of truths from the prior are uniform, and a wrong analysis is found out."""

import numpy as np
import pytest

from jointbayes.frf import DirectSolve, Ports
from tests.conftest import pair_matrix
from tests.science.calibration import PICKED, calibrated, rank_of, simulated_values
from tests.science.calibration_data import case_of
from tests.studies.calibration_cases import noisier_case, small_case

pytestmark = pytest.mark.science
COUNT = 30


def test_a_rank_counts_the_draws_below_and_parts_ties_evenly():
    draws = np.arange(PICKED) + 0.5
    rng = np.random.default_rng(1)
    assert rank_of(np.array([20.0]), draws[:, None], rng).tolist() == [20]
    ties = [rank_of(np.array([0.0]), np.zeros((PICKED, 1)), rng)[0] for _ in range(4000)]
    assert np.mean(ties) == pytest.approx(PICKED / 2, abs=1.0)
    assert (min(ties), max(ties)) == (0, PICKED)


@pytest.mark.long
def test_ranks_of_truths_are_uniform_and_intervals_hold_them():
    found = calibrated(small_case().problem, COUNT, seed=3)
    assert found.p_value > 0.01
    assert found.converged == COUNT
    assert (found.held.sum(axis=0) >= 25).all()  # of 30: fewer has a probability of 0.003


@pytest.mark.long
def test_data_with_three_times_the_noise_are_noticed():
    found = calibrated(small_case().problem, COUNT, source=noisier_case(3.0).problem, seed=3)
    assert found.p_value < 0.01


@pytest.mark.parametrize("variant", ["nuisances", "all"])
def test_data_lie_about_the_dense_solution(variant):
    class Silent:
        def standard_normal(self, shape):
            return np.zeros(shape)

    problem = case_of(variant).problem
    theta = problem.prior.sample(np.random.default_rng(4), 1)[0]
    structure = problem.test.structures.structure(problem.structural(problem.prior.factors(theta)))
    frf = problem.test.data.frf
    dense = DirectSolve(structure, problem.test.joints, Ports(frf.frequency_hz, frf.outputs, frf.inputs))
    expected = dense.receptance(pair_matrix(problem.prior.values(theta)))[0]
    np.testing.assert_allclose(simulated_values(problem, theta, Silent()), expected, rtol=1e-6)
