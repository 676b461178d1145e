"""Posteriors and their densities can be sent to another process, as calibrations and campaigns do."""

import pickle

import numpy as np
import pytest

from jointbayes import load_case
from jointbayes.posterior.coordinates import coordinate_systems
from tests.conftest import CONFIGS

#: One of each kind of structure, data and noise.
KINDS = ("clamped_beam", "clamped_beam_frequencies", "clamped_beam_uncertain", "measured_rotation", "portal_frame",
         "spindle_measured", "two_storeys_shape")  # fmt: skip


@pytest.mark.parametrize("name", KINDS)
def test_the_density_of_a_case_is_the_same_in_another_process(name):
    problem = load_case(CONFIGS / f"{name}.toml").problem
    theta = problem.prior.sample(np.random.default_rng(4), 40)
    sent, _ = pickle.loads(pickle.dumps((problem.log_posterior, coordinate_systems(problem))))
    assert np.isfinite(sent(theta)).any()
    assert sent(theta).tobytes() == problem.log_posterior(theta).tobytes()


def test_a_posterior_of_frfs_can_be_pickled(cheap_posterior):
    again = pickle.loads(pickle.dumps(cheap_posterior))
    assert again.theta.tobytes() == cheap_posterior.theta.tobytes()
    mode = cheap_posterior.best.theta
    assert again.problem.log_posterior(mode) == cheap_posterior.problem.log_posterior(mode)
