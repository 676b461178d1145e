"""Several modes: their shares, the moves between them, and where walkers start."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from jointbayes.sampling import Proposal, SamplerSettings, SeveralModes, StudentT, fit_each_mode, fit_proposal
from jointbayes.sampling.coordinate_maps import Identity
from jointbayes.sampling.moves import JumpMove
from jointbayes.sampling.proposal import refit_proposal, starts_of_hills
from jointbayes.sampling.sampler import replace_far_walkers, run_ensembles, starting_walkers, weighted_moves
from jointbayes.sampling.stopping import diagnose
from tests.oracles import differences

SWAP = np.array([[0.0, 1.0], [1.0, 0.0]])
NARROW, WIDE = np.array([[0.01, 0.004], [0.004, 0.04]]), np.array([[0.09, 0.0], [0.0, 0.25]])
#: Two Gaussians of unlike size far apart, and the share of the first.
PLACES, SHARE = (np.array([0.0, 8.0]), np.array([8.0, 0.0])), 0.3
STARTS = tuple(zip(PLACES, (NARROW, WIDE), strict=True))


def one_gaussian(theta, place, covariance):
    z = theta - place
    return -0.5 * np.einsum("ni,ij,nj->n", z, np.linalg.inv(covariance), z) - 0.5 * np.linalg.slogdet(covariance)[1]


def two_gaussians(theta):
    first, second = (one_gaussian(theta, *start) for start in STARTS)
    return np.logaddexp(np.log(SHARE) + first, np.log(1 - SHARE) + second)


def anywhere(theta):
    return np.zeros(len(theta))


def mirrored(theta):
    """A ring segment and its image, which no Gaussian resembles."""
    first, second = theta, theta[:, ::-1]
    bent = [-0.5 * ((x[:, 0] - 4) ** 2 + ((x[:, 1] + 4 - (x[:, 0] - 4) ** 2) / 0.05) ** 2) for x in (first, second)]
    return np.logaddexp(*bent)


def test_a_point_carried_to_another_mode_and_back_is_where_it_was():
    modes = SeveralModes.from_starts(STARTS)
    theta, here, there = np.array([[0.1, 7.9], [7.5, 0.4]]), np.array([0, 1]), np.array([1, 0])
    moved, log_volume = modes.carried(theta, here, there)
    assert modes.nearest(moved).tolist() == there.tolist()
    back, log_back = modes.carried(moved, there, here)
    np.testing.assert_allclose(back, theta, rtol=1e-12)
    np.testing.assert_allclose(log_back, -log_volume)
    slopes = differences(lambda at: modes.carried(at, here, there)[0], theta)
    assert np.linalg.slogdet(slopes.swapaxes(0, 1))[1] == pytest.approx(log_volume, abs=1e-6)


def test_between_exact_images_the_map_is_the_exchange_itself():
    starts = [(np.array([1.0, 5.0]), NARROW), (np.array([5.0, 1.0]), SWAP @ NARROW @ SWAP)]
    modes = SeveralModes.from_starts(starts, np.array([np.eye(2), SWAP]))
    np.testing.assert_allclose([modes.maps[0, 1], modes.maps[1, 0]], [SWAP, SWAP], atol=1e-12)
    theta = np.array([[1.05, 5.2]])
    moved, log_volume = modes.carried(theta, np.array([0]), np.array([1]))
    np.testing.assert_allclose(moved, theta[:, ::-1])
    assert log_volume == pytest.approx(0.0, abs=1e-12)


def test_a_proposal_of_each_mode_knows_the_shares_and_is_as_good_as_that_of_one():
    proposal = fit_each_mode(two_gaussians, [Identity()], STARTS, None, np.random.default_rng(1))
    assert proposal.shares == pytest.approx([0.95 * SHARE + 0.025, 0.95 * (1 - SHARE) + 0.025], abs=0.02)
    alone = fit_proposal(lambda t: one_gaussian(t, *STARTS[0]), [Identity()], STARTS[:1], np.random.default_rng(1))
    assert proposal.efficiency > alone.efficiency - 0.05
    theta, log_weight = proposal.weighted_draws(two_gaussians, np.random.default_rng(2), 20_000)
    weight = np.exp(log_weight - log_weight.max())
    assert weight[theta[:, 0] < 4].sum() / weight.sum() == pytest.approx(SHARE, abs=0.015)
    assert np.exp(np.logaddexp.reduce(log_weight)) / 20_000 == pytest.approx(2 * np.pi, rel=0.02)  # unit volume


@pytest.mark.parametrize(("apart", "left"), [(1.0, 2), (4.5, 2), (5.0, 3)])
def test_of_starts_that_no_deep_valley_parts_one_is_left(apart, left):
    # between the first two the log density falls by 0, 1.8 and 2.4
    starts = [(np.array([place, 0.0]), np.eye(2)) for place in (0.0, apart, 40.0)]

    def hills(theta):
        return np.logaddexp.reduce([one_gaussian(theta, *start) for start in starts], axis=0)

    kept = starts_of_hills(hills, starts)
    assert len(kept) == left
    assert kept[-1] is starts[-1]
    # of two on one hill the one with more probability about it, not the higher one
    narrow, wide = (starts[2][0], NARROW), (starts[2][0] + 0.1, np.eye(2))
    assert starts_of_hills(hills, [narrow, wide])[0] is wide


def test_of_one_mode_nothing_changes():
    one = fit_each_mode(two_gaussians, [Identity()], STARTS[:1], None, np.random.default_rng(1))
    same = fit_proposal(two_gaussians, [Identity()], STARTS[:1], np.random.default_rng(1))
    assert np.array_equal(one.density.mean, same.density.mean)
    assert one.modes is None
    assert "between modes" not in {move.name for move in weighted_moves(Identity(), one)}
    several = fit_each_mode(two_gaussians, [Identity()], STARTS, None, np.random.default_rng(1))
    assert "between modes" in {move.name for move in weighted_moves(Identity(), several)}


@pytest.mark.science
@pytest.mark.parametrize("efficiency", [None, 0.0], ids=["fitted proposal", "the jump alone"])
def test_a_run_has_the_shares_of_the_modes(efficiency):
    settings = SamplerSettings(walkers=16, max_steps=3000, tau_factor=50)
    rng = np.random.default_rng(3)
    proposal = fit_each_mode(two_gaussians, [Identity()], STARTS, None, rng)
    if efficiency is not None:  # no independence move: what carries walkers is the jump
        proposal = replace(proposal, efficiency=efficiency)
    start = starting_walkers(STARTS, anywhere, settings, rng, proposal.shares)
    chains = run_ensembles(two_gaussians, start, rng, settings, coordinates=Identity(), proposal=proposal)
    assert chains.converged
    theta = chains.draws(thinned=False).theta
    assert (theta[..., 0] < 4).mean() == pytest.approx(SHARE, abs=0.02)


@pytest.mark.whole
def test_a_proposal_is_fitted_anew_to_the_draws_of_each_mode():
    starts = [(np.array([4.0, -4.0]), 0.01 * np.eye(2)), (np.array([-4.0, 4.0]), 0.01 * np.eye(2))]
    rng = np.random.default_rng(4)
    first = fit_each_mode(lambda t: -50 * (t**2).sum(axis=1), [Identity()], starts, np.array([SWAP]), rng)
    x = 4 + rng.normal(size=20_000)
    draws = np.column_stack([x, (x - 4) ** 2 - 4 + 0.05 * rng.normal(size=x.size)])
    draws[::2] = draws[::2, ::-1]
    again = refit_proposal(mirrored, [Identity()], first, draws, rng)
    assert again.modes is first.modes
    assert again.efficiency > 0.5
    assert again.shares == pytest.approx([0.5, 0.5], abs=0.03)
    # where a mode has too few draws its proposal stays
    few = refit_proposal(mirrored, [Identity()], first, draws[draws[:, 0] > draws[:, 1]], rng)
    assert few.parts[1] is first.parts[1]
    assert few.parts[0] is not first.parts[0]


def test_walkers_that_never_leave_their_mode_cannot_have_converged():
    """Of draws that are independent within each mode, while no walker ever changes it."""
    rng = np.random.default_rng(5)
    frozen = np.array([rng.choice([0.0, 8.0], size=(1, 16)) * np.ones((400, 1)) for _ in range(4)])
    theta = np.stack([frozen, 8.0 - frozen], axis=-1) + 0.1 * rng.normal(size=(4, 400, 16, 2))
    modes = SeveralModes.from_starts(STARTS)
    found = diagnose(theta, None, modes=modes)
    assert found.modes_tau > 100
    assert found.tau_max == max(found.modes_tau, found.tau.max())
    mixing = theta[:, rng.permutation(400)]
    mixing = np.where(rng.random((4, 400, 16, 1)) < 0.5, mixing, mixing[..., ::-1])
    assert diagnose(mixing, None, modes=modes).modes_tau < 2
    one_mode = np.where(theta[..., :1] > 4, theta[..., ::-1], theta)
    assert diagnose(one_mode, None, modes=modes).modes_tau == 0.0


@pytest.mark.whole
def test_a_run_whose_walkers_cannot_jump_goes_on_to_its_end_and_has_not_converged():
    offset = np.array([0.5, 0.5])

    def two(theta):
        first, second = (one_gaussian(theta, place, np.diag([1.0, 1e-6])) for place in (offset, -offset))
        return np.logaddexp(first, second)

    starts = [(place, np.diag([1.0, 1e-6])) for place in (offset, -offset)]
    settings = SamplerSettings(walkers=16, max_steps=500, tau_factor=10, end_tolerance=0.2, r_hat_max=1.1)
    rng = np.random.default_rng(7)
    proposal = replace(fit_each_mode(two, [Identity()], starts, None, rng), efficiency=0.0)
    wrong = replace(proposal.modes, maps=np.zeros_like(proposal.modes.maps) + 3.0 * np.eye(2))  # no jump is accepted
    start = starting_walkers(starts, anywhere, settings, rng)
    frozen = run_ensembles(two, start, rng, settings, coordinates=Identity(), proposal=replace(proposal, modes=wrong))
    jumping = run_ensembles(two, start, rng, settings, coordinates=Identity(), proposal=proposal)
    assert not frozen.converged
    assert jumping.converged
    assert frozen.history[-1].modes_tau > 3 * jumping.history[-1].modes_tau > 0


@pytest.mark.parametrize(("shares", "first"), [([0.999, 0.001], 19), ([0.3, 0.7], 6)])
def test_walkers_begin_in_proportion_to_the_shares_and_at_least_one_about_each_mode(shares, first):
    settings, rng = SamplerSettings(ensembles=4, walkers=20), np.random.default_rng(6)
    start = starting_walkers(STARTS, anywhere, settings, rng, np.array(shares))
    assert ((start[..., 0] < 4).sum(axis=1) == first).all()


def test_a_walker_that_could_not_come_back_stays():
    starts = [(np.array([0.0]), np.eye(1)), (np.array([3.0]), np.eye(1)), (np.array([6.0]), np.eye(1))]
    move = JumpMove(SeveralModes.from_starts(starts))
    random = np.random.RandomState(1)
    proposed, log_factor = move.get_proposal(np.full((200, 1), -1.0), random)
    assert set(np.unique(proposed.round(9))) == {2.0, 5.0}
    assert (log_factor == 0.0).all()
    # carried to 1 or 4, which are nearer to the first and to the second mode
    proposed, log_factor = move.get_proposal(np.full((200, 1), -2.0), random)
    assert (proposed == -2.0).all()
    assert np.isneginf(log_factor).all()


def test_a_mode_with_a_draw_or_two_does_not_hold_up_a_run():
    """Of the draws that are ranked none may be among these: their share then has no R̂."""
    theta = PLACES[0] + 0.1 * np.random.default_rng(1).normal(size=(4, 1000, 16, 2))
    theta[1, 731, 5] = PLACES[1]
    check = diagnose(theta, None, modes=SeveralModes.from_starts(STARTS))
    assert 0 < check.modes_tau < 2
    assert check.r_hat_max < 1.01


def test_walkers_far_below_the_mode_are_replaced_and_the_others_left_alone():
    start = np.random.default_rng(1).normal(size=(2, 10, 2))
    start[0, 3] = [40.0, 0.0]
    start[1, 5] = [0.0, -10.1]  # ln p = -51
    start[1, 6] = [9.9, 0.0]  # ln p = -49
    log_density = partial(one_gaussian, place=0.0, covariance=np.eye(2))
    proposal = Proposal(StudentT(np.zeros(2), np.eye(2), 5.0), 0.9, 0)
    found = replace_far_walkers(start, log_density, -50.0, proposal, np.random.default_rng(2))
    moved = np.any(found != start, axis=-1)
    assert np.argwhere(moved).tolist() == [[0, 3], [1, 5]]
    assert (log_density(found.reshape(-1, 2)) > -50).all()
    assert np.array_equal(replace_far_walkers(found, log_density, -50.0, proposal, np.random.default_rng(2)), found)


def test_every_ensemble_has_as_many_walkers_as_asked_for_however_many_modes_there_are():
    settings = SamplerSettings(ensembles=4, walkers=18)
    modes = [(np.array([100.0 * i, 0.0]), np.eye(2)) for i in range(5)]
    start = starting_walkers(modes, anywhere, settings, np.random.default_rng(3))
    assert start.shape == (4, 18, 2)
    nearest = np.round(start[..., 0] / 100).astype(int)
    assert [np.bincount(row).tolist() for row in nearest] == [[4, 4, 4, 3, 3]] * 4
