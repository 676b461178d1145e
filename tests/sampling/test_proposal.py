"""Fitted proposals, and the moves that are made with them, also in many dimensions."""

import pickle

import numpy as np
import pytest
from scipy import stats

from jointbayes.case.case import case_from_text
from jointbayes.errors import SamplingError
from jointbayes.joint import ComplianceCoordinates, LogStiffness, SignedCoupling
from jointbayes.sampling import Proposal, SamplerSettings, fit_proposal
from jointbayes.sampling.coordinate_maps import Identity
from jointbayes.sampling.distributions import StudentMixture, StudentT
from jointbayes.sampling.kernels import Kernels
from jointbayes.sampling.sampler import KEPT, MANY_DIMENSIONS, independence_share, run_ensembles, weighted_moves
from jointbayes.workflow import sample
from tests.conftest import edited
from tests.models import six_joints

MEAN, SCALE = np.array([1.0, -2.0, 0.5]), np.array([[2.0, 0.9, 0.0], [0.9, 1.0, -0.3], [0.0, -0.3, 0.5]])


class TestStudentT:
    t = StudentT(MEAN, SCALE, 5.0)

    def test_log_density_is_that_of_scipy(self):
        x = np.random.default_rng(1).normal(scale=4.0, size=(50, 3))
        np.testing.assert_allclose(self.t.log_density(x), stats.multivariate_t(MEAN, SCALE, 5.0).logpdf(x), rtol=1e-12)

    @pytest.mark.parametrize("random", [np.random.default_rng(2), np.random.RandomState(2)], ids=["new", "old"])
    def test_draws_have_their_moments_with_either_generator(self, random):
        x = self.t.draw(random, 20_000)
        covariance = SCALE * 5 / 3
        error = np.sqrt(np.diag(covariance) / 20_000)
        assert (np.abs(x.mean(axis=0) - MEAN) < 4 * error).all()
        whitened = (x - MEAN) @ np.linalg.inv(np.linalg.cholesky(SCALE)).T
        # each whitened coordinate and their squared length have known distributions
        assert min(stats.kstest(whitened[:, k], stats.t(5).cdf).pvalue for k in range(3)) > 1e-4
        assert stats.kstest((whitened**2).sum(axis=1) / 3, stats.f(3, 5).cdf).pvalue > 1e-4


def wall(x):
    return np.where(x[:, 0] >= 0.0, -3.0 * x[:, 0] - 0.5 * x[:, 1] ** 2, -np.inf)


def thin_banana(x):
    return -0.5 * (x[:, 0] ** 2 + ((x[:, 1] - 5.0 * x[:, 0] ** 2) / 0.02) ** 2)


def far_off(x):
    return np.where(np.abs(x[:, 0] - 100.0) < 1.0, 0.0, -np.inf)


@pytest.mark.parametrize("density", [wall, thin_banana, far_off])
@pytest.mark.parametrize("width", [1e-4, 1.0, 1e4])
def test_draws_of_another_density_give_a_finite_proposal(density, width):
    """An efficiency says how poor it is."""
    rng = np.random.default_rng(1)
    found = fit_proposal(density, [Identity()], width * rng.normal(size=(3000, 2)), rng)
    for bell in found.density.components:
        assert np.isfinite(bell.mean).all()
        assert np.linalg.eigvalsh(bell.scale).min() > 0.0
    assert 0.0 <= found.efficiency <= 1.0


def test_a_joint_at_the_edge_of_the_coordinates():
    coordinates, rng = ComplianceCoordinates(LogStiffness()), np.random.default_rng(2)
    theta = np.array([20.0, 17.0 - 1e-9, 14.0]) + 1e-10 * rng.normal(size=(3000, 3))  # k12² within 2e-9 of k11 k22
    feasible = coordinates.parametrisation.feasible
    density = lambda t: np.where(feasible(t), 0.0, -np.inf)  # noqa: E731
    assert 0.0 <= fit_proposal(density, [coordinates, Identity()], theta, rng).efficiency <= 1.0


@pytest.mark.parametrize("seed", range(3))
def test_the_same_generator_gives_the_same_fit(seed):
    density = lambda x: -np.abs(x[:, 0])  # noqa: E731
    draws = np.random.default_rng(9).laplace(size=(3000, 1))
    first, second = (fit_proposal(density, [Identity()], draws, np.random.default_rng(seed)) for _ in range(2))
    for one, other in zip(first.density.components, second.density.components, strict=True):
        np.testing.assert_array_equal(one.mean, other.mean)
    assert first.efficiency == second.efficiency


class TestMixture:
    def test_share_falls_with_the_efficiency(self):
        shares = [independence_share(e) for e in (0.0, 0.1, 0.2, 0.3, 0.5, 0.9, 1.0)]
        assert shares == sorted(shares)
        assert shares[:2] == [0.0, 0.0]
        assert shares[2] > 0.0
        assert shares[4:] == [0.9] * 3

    @pytest.mark.parametrize("efficiency", [0.0, 0.2, 0.9])
    @pytest.mark.parametrize(
        "coordinates", [Identity(), ComplianceCoordinates(LogStiffness())], ids=["plain", "adapted"]
    )
    def test_weights_sum_to_one_and_names_differ(self, coordinates, efficiency):
        moves = weighted_moves(Proposal(StudentT(np.zeros(3), np.eye(3), 5.0), efficiency, coordinates))
        assert sum(move.weight for move in moves) == pytest.approx(1.0, rel=1e-12)
        assert len({move.name for move in moves}) == len(moves)
        assert ("independence" in [move.name for move in moves]) == (efficiency > 0.1)
        # whatever the fit, some steps are made where the density is, not where it was fitted
        always = {"differential evolution", "differential evolution, full step", "stretch"}
        assert always <= {move.name for move in moves}

    def test_moves_survive_pickling(self):
        proposal = Proposal(StudentT(np.zeros(3), np.eye(3), 5.0), 0.9, ComplianceCoordinates(SignedCoupling()))
        pickle.loads(pickle.dumps(weighted_moves(proposal)))

    def test_on_a_thin_sheet_kernels_propose_most_steps_however_poor_they_are(self):
        one = Kernels(np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 0, 0, 3)), np.ones(1))
        share = {move.name: move.weight for move in weighted_moves(Proposal(one, 0.05))}["independence"]
        assert share == pytest.approx(0.9)


def names(d):
    moves = weighted_moves(Proposal(StudentT(np.zeros(d), np.eye(d), 5.0), 0.2))
    assert sum(move.weight for move in moves) == pytest.approx(1.0)
    return [move.name for move in moves]


def test_part_of_the_way_is_proposed_in_many_dimensions_only():
    assert not any("autoregressive" in name for name in names(MANY_DIMENSIONS - 1))
    assert sum("autoregressive" in name for name in names(MANY_DIMENSIONS)) == len(KEPT)


def test_a_mixture_as_a_whole_has_its_mean_and_scale_without_the_wide_component():
    left, right, wide = (StudentT(np.array([x, 0.0]), s * np.eye(2), 5.0) for x, s in ((0, 1.0), (4, 2.0), (1, 99.0)))
    whole = StudentMixture((left, right, wide), np.array([0.6, 0.2, 0.2])).whole
    np.testing.assert_allclose(whole.mean, [1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(whole.scale, np.diag([0.75 + 0.5 + 3.0, 0.75 + 0.5]))


@pytest.mark.science
def test_forty_dimensions_are_drawn_within_few_steps():
    d = 40
    rng = np.random.default_rng(1)
    root = np.linalg.qr(rng.normal(size=(d, d)))[0] * np.geomspace(0.01, 1.0, d)
    precision = np.linalg.inv(root @ root.T)

    def density(x):
        y = x @ precision
        skew = np.log1p(np.exp(-2 * x @ root[:, 0] / 0.01**2))  # a logistic wall across the narrowest direction
        return -0.5 * np.einsum("ni,ni->n", y, x) - 0.2 * skew

    proposal = fit_proposal(density, [Identity()], rng.normal(size=(6000, d)) @ root.T, rng)
    start = rng.normal(size=(4, 80, d)) @ root.T
    settings = SamplerSettings(walkers=80, max_steps=300, check_every=50)
    chains = run_ensembles(density, start, rng, settings, proposal=proposal)
    drawn = chains.theta[:, chains.held_burn_in :].reshape(-1, d) @ np.linalg.inv(root).T
    assert chains.tau.max() < 25
    assert abs(drawn[:, 1:].mean()) < 0.01
    np.testing.assert_allclose(drawn[:, 1:].std(axis=0), 1.0, atol=0.1)


@pytest.mark.whole
def test_a_case_of_many_unknowns_has_as_many_walkers_as_they_need_unless_it_states_them():
    case = six_joints()
    assert case.sampler.walkers == 72  # of 36 unknowns
    text = case.source.text + "[sampling]\nwalkers = 96\n"
    assert case_from_text("six", text).sampler.walkers == 96
    too_few = case_from_text("six", edited(text, ("walkers = 96", "walkers = 48")))
    told = []
    with pytest.raises(SamplingError, match="found 48 for 36 parameters, expected at least 72"):
        sample(too_few, progress=told.append)
    assert told == []  # before the search for the mode
