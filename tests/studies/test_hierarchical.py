"""The population that joints come from: against closed forms, and against what must not change it."""

import numpy as np
import pytest
from scipy import stats

from jointbayes.joint import parametrisation_named
from jointbayes.sampling import Proposal, StudentT
from jointbayes.sampling.density import newton_climb
from jointbayes.studies.campaign import hierarchical

MEAN, SCATTER = np.array([22.0, 14.0]), np.array([0.2, 0.4])


class Toy:
    """Joints whose measurements are Gaussian: estimate and error of each, and a Gaussian prior of its own."""

    def __init__(self, joints=60, draws=1500, seed=5, scatter=SCATTER):
        rng = np.random.default_rng(seed)
        self.error = np.array([0.15, 0.3]) * np.exp(0.3 * rng.normal(size=(joints, 2)))
        self.estimate = MEAN + np.asarray(scatter) * rng.normal(size=(joints, 2))
        self.estimate += self.error * rng.normal(size=(joints, 2))
        # these priors are narrow and off, so that forgetting them is seen
        self.prior_mean = MEAN + [0.4, -0.4] + 0.3 * rng.normal(size=(joints, 2))
        self.prior_sd = 0.8 * np.exp(0.2 * rng.normal(size=(joints, 2)))
        variance = 1 / (1 / self.error**2 + 1 / self.prior_sd**2)
        middle = variance * (self.estimate / self.error**2 + self.prior_mean / self.prior_sd**2)
        theta = middle[:, None] + np.sqrt(variance)[:, None] * rng.normal(size=(joints, draws, 2))
        z = (theta - self.prior_mean[:, None]) / self.prior_sd[:, None]
        self.draws = hierarchical.JointDraws(
            theta, -0.5 * (z**2).sum(axis=2) - np.log(self.prior_sd).sum(axis=1)[:, None]
        )
        self.prior = hierarchical.PopulationPrior(MEAN, np.full(2, 2.0), np.full(2, 2.0))

    def log_density(self, phi):
        """ln p(μ, ln σ | data) with each joint integrated out by hand, shape (n,) at (n, 4)."""
        variance = np.exp(2 * phi[:, None, 2:]) + self.error**2
        square = (self.estimate - phi[:, None, :2]) ** 2 / variance + np.log(variance)
        return -0.5 * square.sum(axis=(1, 2)) + self.prior.log_density(phi[:, :2], phi[:, 2:])

    def exact(self, count=20_000):
        """Weighted draws of (μ, ln σ) from that, (n, 4) and (n,)."""
        start = np.concatenate([MEAN, np.log(SCATTER)])
        mode, _, covariance = newton_climb(self.log_density, start, np.diag(np.full(4, 0.01)))
        proposal = Proposal(StudentT(mode, covariance, 5.0), 0.0, 0)
        phi, log_weight = proposal.weighted_draws(self.log_density, np.random.default_rng(2), count)
        weight = np.exp(log_weight - log_weight.max())
        return phi, weight / weight.sum()


@pytest.fixture(scope="module")
def toy():
    return Toy()


@pytest.fixture(scope="module")
def inferred(toy):
    return hierarchical.hierarchical_posterior(toy.draws, toy.prior)


@pytest.mark.whole
def test_population_is_that_of_joints_integrated_out_by_hand(toy, inferred):
    phi, weight = toy.exact()
    mean = weight @ phi
    sd = np.sqrt(weight @ (phi - mean) ** 2)
    drawn = np.concatenate([inferred.mean, np.log(inferred.scatter)], axis=1)
    assert np.abs(drawn.mean(axis=0) - mean) / sd == pytest.approx(0, abs=0.15)
    assert drawn.std(axis=0) / sd == pytest.approx(1, abs=0.1)


def test_likelihood_is_the_closed_form_up_to_a_constant(toy):
    rng = np.random.default_rng(3)
    mean, scatter = MEAN + 0.1 * rng.normal(size=(20, 2)), SCATTER * np.exp(0.2 * rng.normal(size=(20, 2)))
    phi = np.concatenate([mean, np.log(scatter)], axis=1)
    exact = toy.log_density(phi) - toy.prior.log_density(mean, np.log(scatter))
    found = hierarchical.Reweighting(toy.draws).log_likelihood(mean, scatter)
    assert np.ptp(exact) > 5
    assert (found - found[0]) - (exact - exact[0]) == pytest.approx(0, abs=0.8)


@pytest.mark.whole
def test_a_joint_given_the_others_is_that_of_the_closed_form(toy, inferred):
    phi, weight = toy.exact(4000)
    variance = 1 / (1 / toy.error**2 + np.exp(-2 * phi[:, None, 2:]))
    middle = variance * (toy.estimate / toy.error**2 + phi[:, None, :2] * np.exp(-2 * phi[:, None, 2:]))
    mean = np.einsum("p,pjk->jk", weight, middle)
    sd = np.sqrt(np.einsum("p,pjk->jk", weight, variance + (middle - mean) ** 2))
    good = inferred.trusted
    assert good.mean() > 0.8
    for k in range(2):
        low, median, high = inferred.shrunken(toy.draws.theta[..., k]).T
        error = (median - mean[:, k]) / sd[:, k] * np.sqrt(inferred.effective)
        assert np.sqrt(np.mean(error[good] ** 2)) < 2  # of the Monte Carlo errors of medians, 1.25
        assert np.median((high - low)[good] / (3.92 * sd[good, k])) == pytest.approx(1, abs=0.05)


def test_the_stated_monte_carlo_error_is_that_of_other_draws():
    # the same measurements, other draws: the posterior means move by what is stated
    found = []
    for seed in range(6):
        toy = Toy(joints=40, draws=120)
        rows = np.random.default_rng(seed).permutation(1500)[:120]
        whole = Toy(joints=40).draws
        part = hierarchical.JointDraws(whole.theta[:, rows], whole.log_prior[:, rows])
        one = hierarchical.hierarchical_posterior(part, toy.prior)
        drawn = np.concatenate([one.mean, np.log(one.scatter)], axis=1)
        found.append((drawn.mean(axis=0), drawn.std(axis=0), one.monte_carlo.ravel()))
    mean, sd, stated = (np.array(part) for part in zip(*found, strict=True))
    assert np.sqrt(((mean.std(axis=0, ddof=1) / (sd * stated).mean(axis=0)) ** 2).mean()) == pytest.approx(1, abs=0.6)


@pytest.mark.whole
def test_joints_about_which_nothing_is_known_leave_the_population_as_it_is(toy, inferred):
    flat = np.random.default_rng(4).uniform([16.0, 8.0], [28.0, 20.0], size=(10, 1500, 2))
    theta = np.concatenate([toy.draws.theta, flat])
    more = hierarchical.JointDraws(theta, np.concatenate([toy.draws.log_prior, np.zeros((10, 1500))]))
    again = hierarchical.hierarchical_posterior(more, toy.prior)
    assert (again.mean.mean(axis=0) - inferred.mean.mean(axis=0)) / inferred.mean.std(axis=0) == pytest.approx(
        0, abs=0.3
    )
    assert again.scatter.mean(axis=0) / inferred.scatter.mean(axis=0) == pytest.approx(1, abs=0.1)
    assert np.median(again.effective[-10:]) < np.median(again.effective[:-10])


def test_joints_with_fewer_draws_count_by_their_own_number(toy):
    theta = [joint[: 300 + 20 * (j % 5)] for j, joint in enumerate(toy.draws.theta)]
    log_prior = [value[: 300 + 20 * (j % 5)] for j, value in enumerate(toy.draws.log_prior)]
    stacked = hierarchical.JointDraws.stacked(theta, log_prior)
    assert stacked.counts.tolist() == [len(one) for one in theta]
    np.testing.assert_allclose(stacked.mean, [one.mean(axis=0) for one in theta])
    np.testing.assert_allclose(stacked.variance, [one.var(axis=0) for one in theta])
    by_hand = sum(
        hierarchical.Reweighting(hierarchical.JointDraws(one[None], value[None])).log_likelihood(MEAN, SCATTER)[0]
        for one, value in zip(theta, log_prior, strict=True)
    )
    assert hierarchical.Reweighting(stacked).log_likelihood(MEAN, SCATTER)[0] == pytest.approx(by_hand)
    weight, _ = hierarchical.Reweighting(stacked).weights(MEAN[None], SCATTER[None])
    assert weight.sum(axis=1) == pytest.approx(1)
    assert not weight[0, 300:].any()


def test_joints_that_are_all_alike_have_a_scatter_of_next_to_nothing():
    toy = Toy(joints=40, draws=800, scatter=(0.0, 0.0))
    found = hierarchical.hierarchical_posterior(toy.draws, toy.prior)
    assert (np.quantile(found.scatter, 0.5, axis=0) < [0.08, 0.15]).all()
    assert (found.scatter >= hierarchical.RESOLVED * np.sqrt(np.median(toy.draws.variance, axis=0))).all()


@pytest.mark.parametrize("key", ["log", "signed", "elastic_centre"])
def test_a_population_is_cut_off_where_joints_are_impossible(key, toy):
    parametrisation = parametrisation_named(key)
    mean = {"log": [20.0, 17.2, 14.4], "signed": [20.0, 14.0, 0.8], "elastic_centre": [20.0, 0.1, 14.0]}[key]
    scatter = [0.3, 0.3, 0.3]
    theta = np.random.default_rng(1).normal(mean, scatter, size=(200_000, 3))
    share = parametrisation.feasible(theta).mean()
    draws = hierarchical.JointDraws(theta[None, :5], np.zeros((1, 5)))
    found = hierarchical.Reweighting(draws, parametrisation).log_possible(np.array([mean]), np.array([scatter]))
    assert np.exp(found[0]) == pytest.approx(share, abs=0.005)


def test_a_population_near_the_limit_of_possible_joints_keeps_its_mean():
    # ρ known all but exactly, cut off at 1: the mean of what is left lies below that of the population
    signed, rng = parametrisation_named("signed"), np.random.default_rng(6)
    theta = rng.normal([20.0, 14.0, 0.95], [0.2, 0.2, 0.1], size=(1000, 3))
    theta = theta[signed.feasible(theta)][:300]
    assert theta[:, 2].mean() < 0.91
    draws = theta[:, None] + 1e-2 * rng.normal(size=(300, 60, 3))
    draws[..., 2] = theta[:, None, 2] + 1e-3 * rng.uniform(-1, 0, size=(300, 60))
    joints = hierarchical.JointDraws(draws, np.zeros((300, 60)))
    prior = hierarchical.PopulationPrior(np.array([20.0, 14.0, 0.0]), np.full(3, 2.0), np.full(3, 2.0))
    low, high = np.quantile(hierarchical.hierarchical_posterior(joints, prior, signed).mean[:, 2], [0.005, 0.995])
    assert low < 0.95 < high
    assert np.quantile(hierarchical.hierarchical_posterior(joints, prior).mean[:, 2], 0.995) < 0.95


def test_what_a_population_means_in_stiffness():
    log = parametrisation_named("log")
    mean, scatter = np.array([[22.0, 16.0, 14.0]] * 3), np.array([[0.2, 0.1, 0.3]] * 3)
    known = hierarchical.Population(mean, scatter, np.ones((1, 1)), np.ones(1), np.zeros((2, 3)), 3.0, "", True)
    k11, k12, k22 = hierarchical.population_stiffness(known, log)
    for k, mu, sigma in ((k11, 22.0, 0.2), (k12, 16.0, 0.1), (k22, 14.0, 0.3)):
        assert k.median == pytest.approx(np.exp(mu), rel=0.01)
        assert k.low95 == pytest.approx(np.exp(mu - 1.96 * sigma), rel=0.02)
        assert k.high95 == pytest.approx(np.exp(mu + 1.96 * sigma), rel=0.02)
        assert k.scatter == pytest.approx(sigma, rel=0.02)
        assert k.logarithmic
    signed = parametrisation_named("signed")
    known = hierarchical.Population(
        np.array([[22.0, 14.0, 0.0]]),
        np.array([[0.1, 0.1, 0.3]]),
        np.ones((1, 1)),
        np.ones(1),
        np.zeros((2, 3)),
        1.0,
        "",
        True,
    )
    _, k12, k22 = hierarchical.population_stiffness(known, signed)
    assert not k12.logarithmic
    assert k12.low95[0] < 0 < k12.high95[0]
    assert k12.scatter[0] == pytest.approx(0.3 * np.exp(18.0), rel=0.1)
    assert k22.median[0] == pytest.approx(np.exp(14.0), rel=0.02)


def test_weighted_quantiles_of_equal_weights_are_those_of_numpy():
    values = np.random.default_rng(1).normal(size=(3, 501))
    found = hierarchical.weighted_quantiles(values, np.full(values.shape, 1 / 501), (0.025, 0.5, 0.975))
    np.testing.assert_allclose(found, np.quantile(values, [0.025, 0.5, 0.975], axis=1).T, atol=0.06)
    heavy = np.zeros((1, 3))
    heavy[0, 1] = 1.0
    assert hierarchical.weighted_quantiles(np.array([[1.0, 5.0, 9.0]]), heavy, (0.5,))[0, 0] == pytest.approx(5.0)
    assert hierarchical.weighted_quantiles(np.array([[7.0]]), np.ones((1, 1)), (0.025, 0.5)).tolist() == [[7.0, 7.0]]


@pytest.mark.science
def test_a_population_whose_posterior_is_no_students_t_is_drawn_all_the_same(monkeypatch):
    toy = Toy(joints=3, draws=300)
    found = hierarchical.hierarchical_posterior(toy.draws, toy.prior)
    monkeypatch.setattr(hierarchical, "_ENOUGH", 1e9)
    walked = hierarchical.hierarchical_posterior(toy.draws, toy.prior)
    assert "walkers" in walked.how
    assert "importance" in found.how
    assert np.median(walked.mean, axis=0) == pytest.approx(np.median(found.mean, axis=0), abs=0.1)
    assert np.median(np.log(walked.scatter), axis=0) == pytest.approx(np.median(np.log(found.scatter), axis=0), abs=0.3)


def test_the_same_seed_gives_the_same_population(toy):
    some = hierarchical.JointDraws(toy.draws.theta[:10, :200], toy.draws.log_prior[:10, :200])
    one, other = (hierarchical.hierarchical_posterior(some, toy.prior, seed=3) for _ in range(2))
    assert (one.mean == other.mean).all()
    assert (one.weight == other.weight).all()
    assert (hierarchical.hierarchical_posterior(some, toy.prior, seed=4).mean != one.mean).any()


def test_priors_of_joints_make_the_prior_of_the_population():
    prior = hierarchical.PopulationPrior.from_joints([[1.0, 5.0], [3.0, 5.0]], [[2.0, 1.0], [2.0, 1.0]])
    assert (prior.mean.tolist(), prior.sd) == ([2.0, 5.0], pytest.approx([np.sqrt(5.0), 1.0]))
    assert prior.scale == pytest.approx(prior.sd)


def test_the_prior_is_normal_in_the_mean_and_half_normal_in_the_scatter():
    prior = hierarchical.PopulationPrior(np.array([1.0, 2.0]), np.array([0.5, 3.0]), np.array([2.0, 0.4]))
    rng = np.random.default_rng(1)
    mean, scatter = rng.normal(size=(20, 2)), rng.uniform(0.1, 3, size=(20, 2))
    known = stats.norm(prior.mean, prior.sd).logpdf(mean) + stats.halfnorm(scale=prior.scale).logpdf(scatter)
    known += np.log(scatter)  # dσ/d ln σ
    found = prior.log_density(mean, np.log(scatter))
    np.testing.assert_allclose(found - found[0], known.sum(axis=1) - known[0].sum(), atol=1e-12)
