"""Moves in many dimensions: part of the way to a new draw of the proposal."""

import numpy as np
import pytest
from benchmarks.many_joints_data import six_joints

from jointbayes.case.case import case_from_text
from jointbayes.errors import SamplingError
from jointbayes.sampling import SamplerSettings, fit_proposal
from jointbayes.sampling.coordinate_maps import Identity
from jointbayes.sampling.distributions import StudentMixture, StudentT
from jointbayes.sampling.proposal import Proposal
from jointbayes.sampling.sampler import run_ensembles
from jointbayes.sampling.starting import KEPT, MANY_DIMENSIONS, weighted_moves
from jointbayes.workflow import sample
from tests.conftest import edited


def names(d):
    moves = weighted_moves(Identity(), Proposal(StudentT(np.zeros(d), np.eye(d), 5.0), 0.2, 0))
    assert sum(move.weight for move in moves) == pytest.approx(1.0)
    return [move.name for move in moves]


def test_part_of_the_way_is_proposed_in_many_dimensions_only():
    assert not any("autoregressive" in name for name in names(MANY_DIMENSIONS - 1))
    assert sum("autoregressive" in name for name in names(MANY_DIMENSIONS)) == len(KEPT)


def test_a_mixture_as_a_whole_has_its_mean_and_scale_without_the_wide_component():
    left, right, wide = (StudentT(np.array([x, 0.0]), s * np.eye(2), 5.0) for x, s in ((-1, 1.0), (3, 2.0), (0, 99.0)))
    whole = StudentMixture((left, right, wide), np.array([0.6, 0.2, 0.2])).whole
    np.testing.assert_allclose(whole.mean, [0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(whole.scale, np.diag([0.75 + 0.5 + 3.0, 0.75 + 0.5]))


def test_forty_dimensions_are_drawn_within_few_steps():
    d = 40
    rng = np.random.default_rng(1)
    root = np.linalg.qr(rng.normal(size=(d, d)))[0] * np.geomspace(0.01, 1.0, d)
    precision = np.linalg.inv(root @ root.T)

    def density(x):
        y = x @ precision
        skew = np.log1p(np.exp(-2 * x @ root[:, 0] / 0.01**2))  # a logistic wall across the narrowest direction
        return -0.5 * np.einsum("ni,ni->n", y, x) - 0.2 * skew

    proposal = fit_proposal(density, [None], [(np.zeros(d), root @ root.T)], rng)
    start = rng.normal(size=(4, 80, d)) @ root.T
    settings = SamplerSettings(walkers=80, max_steps=300, check_every=50)
    chains = run_ensembles(density, start, rng, settings, coordinates=Identity(), proposal=proposal)
    drawn = chains.theta[:, chains.held_burn_in :].reshape(-1, d) @ np.linalg.inv(root).T
    assert chains.tau.max() < 25
    assert abs(drawn[:, 1:].mean()) < 0.01
    np.testing.assert_allclose(drawn[:, 1:].std(axis=0), 1.0, atol=0.1)


def test_a_case_of_many_unknowns_has_as_many_walkers_as_they_need_unless_it_states_them():
    stated = six_joints()
    assert stated.sampler.walkers == 96
    text = stated.source.text
    assert case_from_text("six", edited(text, ("walkers = 96", ""))).sampler.walkers == 72  # of 36 unknowns
    too_few = case_from_text("six", edited(text, ("walkers = 96", "walkers = 48")))
    told = []
    with pytest.raises(SamplingError, match="found 48 for 36 parameters, expected at least 72"):
        sample(too_few, tell=told.append)
    assert told == []  # before the search for the mode
