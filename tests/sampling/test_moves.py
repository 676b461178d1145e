"""Moves by themselves: where they propose to, and what their coordinates' volumes and the acceptance make of it."""

from types import SimpleNamespace

import numpy as np
import pytest

from jointbayes.sampling import Proposal, StudentT
from jointbayes.sampling.coordinate_maps import Identity
from jointbayes.sampling.moves import DEMove, IndependenceMove
from jointbayes.sampling.moves.base import settle


class Sinh:
    """φ = sinh θ."""

    def forward(self, theta):
        return np.sinh(theta)

    def inverse(self, phi):
        return np.arcsinh(phi), np.ones(len(phi), dtype=bool)

    def log_volume(self, theta):
        return -np.log(np.cosh(theta)).sum(axis=1)


def test_the_way_back_of_a_difference_in_other_coordinates_is_weighed_by_the_volumes_at_both_ends():
    rng = np.random.default_rng(1)
    here, resting = rng.normal(1.0, 1.0, (2, 500, 3))
    there, log_factor = DEMove(Sinh()).get_proposal(here, [resting], np.random.RandomState(1))
    # the proposal is symmetric in φ, so q(back)/q(forth) over θ is |dφ/dθ| here over that there
    step = 1e-6
    here_slope, there_slope = ((np.sinh(x + step) - np.sinh(x - step)) / (2 * step) for x in (here, there))
    assert np.abs(log_factor).max() > 1
    assert log_factor == pytest.approx(np.log(here_slope / there_slope).sum(axis=1), abs=1e-6)


def test_a_difference_is_that_of_two_walkers_and_each_two_come_alike_often():
    here, resting = np.zeros((60_000, 1)), np.array([[0.0], [1.0], [10.0]])
    there, _ = DEMove(Identity(), gamma0=1.0).get_proposal(here, [resting], np.random.RandomState(1))
    steps, count = np.unique(np.round(there, 2), return_counts=True)
    assert steps.tolist() == [-10, -9, -1, 1, 9, 10]
    assert np.abs(count / 10_000 - 1).max() < 5 / np.sqrt(10_000)


@pytest.mark.parametrize("gain", [-1.0, 0.5])
def test_what_a_proposal_costs_counts_as_what_the_density_gains(gain):
    count = 40_000
    for factor, density in ((gain, 0.0), (0.0, gain), (gain + 2.0, -2.0)):
        state = SimpleNamespace(coords=np.zeros((count, 1)), log_prob=np.zeros(count))
        model = SimpleNamespace(
            log_prob_fn=lambda theta, value=density: np.full(len(theta), value), random=np.random.RandomState(2)
        )
        accepted = settle(model, state, slice(None), np.ones((count, 1)), np.full(count, factor))
        assert accepted.mean() == pytest.approx(min(1.0, np.exp(gain)), abs=0.01)
        assert state.coords[:, 0].tolist() == accepted.tolist()
        assert state.log_prob == pytest.approx(np.where(accepted, density, 0.0))


class Positive(Identity):
    """θ above zero, where a fitted distribution proposes places below as well."""

    def inverse(self, phi):
        return phi, (phi > 0).all(axis=1)


def test_what_is_known_of_the_last_step_is_what_a_new_look_says():
    """Walkers that stay, go, were sent out of the region or were moved by another move meanwhile."""
    proposal = Proposal(StudentT(np.full(2, 0.5), np.eye(2), 5.0), 0.5, Positive())
    rng, theta = np.random.default_rng(1), np.random.default_rng(2).uniform(0.1, 2.0, (60, 2))
    kept = IndependenceMove(proposal)
    for seed in range(4):
        proposed, log_factor = kept.get_proposal(theta, np.random.RandomState(seed))
        again, expected = IndependenceMove(proposal).get_proposal(theta, np.random.RandomState(seed))
        np.testing.assert_array_equal(proposed, again)
        np.testing.assert_allclose(log_factor, expected, rtol=1e-12)
        assert np.isneginf(log_factor).any()
        theta[...] = np.where(rng.random((60, 1)) < 0.5, proposed, theta)  # in place, as emcee's state is
        theta[:7] = rng.uniform(0.1, 2.0, (7, 2))
