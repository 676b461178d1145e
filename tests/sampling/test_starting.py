"""Where walkers start."""

import numpy as np

from jointbayes.sampling import Proposal, SamplerSettings, StudentT, replace_far_walkers, starting_walkers

PROPOSAL = Proposal(StudentT(np.zeros(2), np.eye(2), 5.0), 0.9, 0)


def log_density(theta):
    return -0.5 * (theta**2).sum(axis=1)


def test_walkers_far_below_the_mode_are_replaced_and_the_others_left_alone():
    start = np.random.default_rng(1).normal(size=(2, 10, 2))
    start[0, 3] = [40.0, 0.0]
    start[1, 5] = [0.0, -10.1]  # ln p = -51
    start[1, 6] = [9.9, 0.0]  # ln p = -49
    found = replace_far_walkers(start, log_density, -50.0, PROPOSAL, np.random.default_rng(2))
    moved = np.any(found != start, axis=-1)
    assert np.argwhere(moved).tolist() == [[0, 3], [1, 5]]
    assert (log_density(found.reshape(-1, 2)) > -50).all()
    assert np.array_equal(replace_far_walkers(found, log_density, -50.0, PROPOSAL, np.random.default_rng(2)), found)


def test_every_ensemble_has_as_many_walkers_as_asked_for_however_many_modes_there_are():
    settings = SamplerSettings(ensembles=4, walkers=18)
    modes = [(np.array([100.0 * i, 0.0]), np.eye(2)) for i in range(5)]
    start = starting_walkers(modes, lambda theta: np.zeros(len(theta)), settings, np.random.default_rng(3))
    assert start.shape == (4, 18, 2)
    nearest = np.round(start[..., 0] / 100).astype(int)
    assert [np.bincount(row).tolist() for row in nearest] == [[4, 4, 4, 3, 3]] * 4
