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
from jointbayes.sampling.distributions import StudentMixture, StudentT, importance_efficiency
from jointbayes.sampling.sampler import KEPT, MANY_DIMENSIONS, independence_share, run_ensembles, weighted_moves
from jointbayes.workflow import sample
from tests.conftest import edited, first_in_ci
from tests.models import six_joints
from tests.oracles import differences


class GaussianInCompliance:
    """Gaussian with independent coordinates in compliance about the paper's Table 3, as a density over θ."""

    def __init__(self, parametrisation, relative):
        self.coordinates = ComplianceCoordinates(parametrisation)
        self.theta = parametrisation.coordinates([5.05e9, 3.44e7, 1.52e6])
        self.mean = self.coordinates.forward(self.theta[None])[0]
        self.sd = relative * np.abs(self.mean)

    def __call__(self, theta):
        out = np.full(len(theta), -np.inf)
        inside = self.coordinates.parametrisation.feasible(theta)
        z = (self.coordinates.forward(theta[inside]) - self.mean) / self.sd
        out[inside] = -0.5 * np.sum(z**2, axis=1) - self.coordinates.log_volume(theta[inside])
        return out

    @property
    def covariance(self):
        """Of θ, to first order."""
        inverse = np.linalg.inv(differences(lambda at: self.coordinates.forward(at[None])[0], self.theta).T)
        return inverse @ np.diag(self.sd**2) @ inverse.T


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


def fitted(log_density, theta, covariance, coordinates=None, seed=3):
    start = np.asarray(theta), np.asarray(covariance)
    return fit_proposal(log_density, [coordinates], [start], np.random.default_rng(seed))


def components(density):
    return density.components if isinstance(density, StudentMixture) else (density,)


class TestFit:
    @pytest.mark.parametrize("parametrisation", [LogStiffness(), SignedCoupling()], ids=lambda p: type(p).__name__)
    def test_finds_a_gaussian_in_the_coordinates(self, parametrisation):
        density = GaussianInCompliance(parametrisation, 0.03)
        found = fitted(density, density.theta, density.covariance, density.coordinates)
        assert found.efficiency > 0.85  # of a t distribution with 5 degrees of freedom for a Gaussian: 0.89
        np.testing.assert_allclose(found.density.mean, density.mean, atol=0.05 * density.sd.min(), rtol=0.01)
        np.testing.assert_allclose(np.sqrt(np.diag(found.density.scale)), density.sd, rtol=0.05)
        # the mode over θ is not that over φ, and the fit is not the Laplace approximation over θ
        assert found.evaluations < 2200

    def test_mode_and_width_are_found_from_a_wrong_start(self):
        precision = np.linalg.inv(SCALE)

        start = MEAN + np.array([3.0, -1.0, 1.0])
        found = fitted(lambda x: -0.5 * np.einsum("ni,ij,nj->n", x - MEAN, precision, x - MEAN), start, 9 * np.eye(3))
        assert found.efficiency > 0.85
        np.testing.assert_allclose(found.density.mean, MEAN, atol=0.02)

    def test_refinement_raises_the_efficiency_of_a_skewed_density(self):
        # a gamma density in each coordinate: the curvature at the mode tells little of the tail
        def gamma(x):
            inside = (x > 0).all(axis=1)
            safe = np.where(x > 0, x, 1.0)
            return np.where(inside, np.sum(np.log(safe) - safe, axis=1), -np.inf)

        found = fitted(gamma, np.ones(2), np.eye(2))
        laplace = StudentT(np.ones(2), np.eye(2), 5.0)
        x = laplace.draw(np.random.default_rng(4), 20_000)
        assert found.efficiency > importance_efficiency(gamma(x) - laplace.log_density(x)) + 0.1

    @pytest.mark.parametrize("seed", range(3))
    def test_the_same_generator_gives_the_same_fit(self, seed):
        first, second = (fitted(lambda x: -np.abs(x[:, 0]), [0.5], [[1.0]], seed=seed) for _ in range(2))
        for one, other in zip(components(first.density), components(second.density), strict=True):
            np.testing.assert_array_equal(one.mean, other.mean)
        assert first.efficiency == second.efficiency


def wall(x):
    return np.where(x[:, 0] >= 0.0, -3.0 * x[:, 0] - 0.5 * x[:, 1] ** 2, -np.inf)


def ridge(x):
    return np.where(np.abs(x[:, 0]) < 50.0, -0.5 * x[:, 1] ** 2, -np.inf)


def valley(x):
    """Curved upwards along the first axis where the fit starts: two modes at ±2."""
    return -0.25 * (x[:, 0] ** 2 - 4.0) ** 2 - 0.5 * x[:, 1] ** 2


def thin_banana(x):
    return -0.5 * (x[:, 0] ** 2 + ((x[:, 1] - 5.0 * x[:, 0] ** 2) / 0.02) ** 2)


def point(x):
    return np.where((x == 0.0).all(axis=1), 0.0, -np.inf)


def far_off(x):
    return np.where(np.abs(x[:, 0] - 100.0) < 1.0, 0.0, -np.inf)


class TestRobustness:
    @pytest.mark.parametrize(
        ("density", "least", "width"),
        [
            *((density, least, width) for width in (1e-4, 1.0, 1e4)
              for density, least in [(wall, 0.2), (ridge, 0.2), (valley, 0.2), (point, 0.0), (far_off, 0.0)]),
            *(pytest.param(thin_banana, 0.0, w, marks=[pytest.mark.science] * (w != 1)) for w in (1e-4, 1.0, 1e4)),
        ],
    )  # fmt: skip
    @pytest.mark.parametrize("seed", first_in_ci([0, 1, 2], 1))
    def test_a_difficult_density_gives_a_finite_proposal(self, density, least, width, seed):
        found = fitted(density, np.zeros(2), width * np.eye(2), seed=seed)
        for bell in components(found.density):
            assert np.isfinite(bell.mean).all()
            assert np.linalg.eigvalsh(bell.scale).min() > 0.0
        assert 0.0 <= found.efficiency <= 1.0
        if width == 1.0:
            assert found.efficiency > least or least == 0.0

    @pytest.mark.parametrize("covariance", [np.zeros((2, 2)), np.ones((2, 2)), np.diag([1.0, -1.0])])
    def test_a_covariance_that_is_not_positive_definite_is_a_rough_guess_like_any(self, covariance):
        found = fitted(lambda x: -0.5 * np.sum(x**2, axis=1), np.zeros(2), covariance)
        assert found.efficiency > 0.8

    def test_a_joint_at_the_edge_of_the_coordinates(self):
        coordinates = ComplianceCoordinates(LogStiffness())
        theta = np.array([20.0, 17.0 - 1e-9, 14.0])  # k12² within 2e-9 of k11 k22
        feasible = coordinates.parametrisation.feasible
        found = fitted(lambda t: np.where(feasible(t), 0.0, -np.inf), theta, np.eye(3), coordinates)
        assert 0.0 <= found.efficiency <= 1.0


class TestMixture:
    def test_share_falls_with_the_efficiency(self):
        shares = [independence_share(e) for e in (0.0, 0.1, 0.2, 0.3, 0.5, 0.9, 1.0)]
        assert shares == sorted(shares)
        assert shares[:2] == [0.0, 0.0]
        assert shares[2] > 0.0
        assert shares[4:] == [0.9] * 3

    @pytest.mark.parametrize("efficiency", [0.0, 0.2, 0.9])
    @pytest.mark.parametrize("coordinates", [None, ComplianceCoordinates(LogStiffness())], ids=["plain", "adapted"])
    def test_weights_sum_to_one_and_names_differ(self, coordinates, efficiency):
        moves = weighted_moves(coordinates, Proposal(StudentT(np.zeros(3), np.eye(3), 5.0), efficiency, 0))
        assert sum(move.weight for move in moves) == pytest.approx(1.0, rel=1e-12)
        assert len({move.name for move in moves}) == len(moves)
        assert ("independence" in [move.name for move in moves]) == (efficiency > 0.1)
        # whatever the fit, some steps are made where the density is, not where it was fitted
        always = {"differential evolution", "differential evolution, full step", "stretch"}
        assert always <= {move.name for move in moves}

    def test_moves_survive_pickling(self):
        proposal = Proposal(StudentT(np.zeros(3), np.eye(3), 5.0), 0.9, 0)
        pickle.loads(pickle.dumps(weighted_moves(ComplianceCoordinates(SignedCoupling()), proposal)))


def names(d):
    moves = weighted_moves(Identity(), Proposal(StudentT(np.zeros(d), np.eye(d), 5.0), 0.2, 0))
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

    proposal = fit_proposal(density, [None], [(np.zeros(d), root @ root.T)], rng)
    start = rng.normal(size=(4, 80, d)) @ root.T
    settings = SamplerSettings(walkers=80, max_steps=300, check_every=50)
    chains = run_ensembles(density, start, rng, settings, coordinates=Identity(), proposal=proposal)
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
