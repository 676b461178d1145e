"""Damping of a joint: found where it shows, and said not to be known where it does not; the study's data and code."""

import numpy as np
import pytest
from benchmarks.joint_damping import INPUTS, LINES, OUTPUTS, STUDIES, analyse, data_set, exact_frf
from scipy import stats

from jointbayes.frf import Ports
from jointbayes.identification import refine
from tests.conftest import first_in_ci
from tests.oracles import off_peak

pytestmark = pytest.mark.science

SETS = 20
VERDICTS = {
    "stiff": {"not identified", "bounded above"},
    "yielding": {"identified", "weakly identified"},
    "dashpot": {"identified"},
}


def theta_of(problem, truth):
    """θ of ky, krz, damping and the rod's loss factor."""
    return np.log(truth / np.array([1.0, 1.0, 1.0, problem.prior.nuisances[0].nominal]))


@pytest.mark.parametrize("study", list(STUDIES))
def test_the_model_with_a_damped_joint_is_the_exact_beam_with_it(study):
    problem, truth = data_set(study, 1)
    exact = exact_frf(study, truth[:3], truth[3])
    theta = theta_of(problem, truth)[None]
    model = problem.test.receptance_model(Ports(LINES, OUTPUTS, INPUTS))
    found = model.receptance(problem.prior.matrix(theta), problem.structural(problem.prior.factors(theta)))[0]
    assert off_peak(found, exact) < 1.1e-6


@pytest.mark.parametrize("study", ["yielding", "dashpot"])
def test_the_best_fit_is_better_than_the_truth_by_as_much_as_four_parameters_are_worth(study):
    """Twice the gain in ln L, summed over data sets: χ² with a degree of freedom for each parameter (Wilks)."""
    gains = []
    for index in range(1, SETS + 1):
        problem, truth = data_set(study, index)
        theta = theta_of(problem, truth)
        mode, _ = refine(problem.log_posterior, theta)
        best, true = problem.log_posterior.log_likelihood(np.stack([mode, theta]))
        gains.append(2 * (best - true))
    low, high = stats.chi2(4 * SETS).ppf([0.0005, 0.9995])
    assert low < sum(gains) < high


@pytest.mark.parametrize(("study", "verdicts"), first_in_ci(list(VERDICTS.items()), 1))
def test_the_verdict_says_whether_the_damping_is_known(study, verdicts):
    posterior, truth = analyse(study, 1)
    assert posterior.converged
    assert posterior.check.explains
    known = posterior.verdict(STUDIES[study].damping)
    assert known.cls in verdicts, known
    for name, value in truth.items():
        low, high = posterior.interval(name, 0.999)
        assert low < value < high, name
