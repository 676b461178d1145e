"""Profile likelihood: exact on linear models, and what it says at open ends and at the edge of possible joints."""

import numpy as np
import pytest
from scipy import optimize

import jointbayes as jb
from jointbayes.posterior import limits
from jointbayes.posterior.fisher import fisher_information
from jointbayes.posterior.limits import LikelihoodRegion
from jointbayes.posterior.verdicts import region_of as region_of_posterior
from tests.conftest import cheap_text, edited

NAMES = ("k11", "k12", "k22", "youngs_modulus", "noise_scale")
CENTRE = np.array([21.0, 15.0, 14.0, 0.01, 0.0])
HALF_CHI2 = 3.841458820694124 / 2
HALF_CHI2_68 = 1.0000217 / 2  # at 68.27 %


class Linear:
    """A density whose data residuals are A (θ − centre); the last coordinate enters none of them."""

    def __init__(self, matrix, joint):
        modulus, scale = jb.Nuisance("youngs_modulus", "GPa", 210.0, jb.Normal(0.0, 0.02)), jb.Normal(0.0, 1.0)
        self.prior = jb.JointPrior(jb.LogStiffness(), joint, (modulus, jb.Nuisance("noise_scale", "1", 1.0, scale)))
        self.matrix = np.column_stack([matrix, np.zeros(len(matrix))])

    def log_likelihood(self, theta):
        return -0.5 * (((theta - CENTRE) @ self.matrix.T) ** 2).sum(axis=1)

    def profile(self, name):
        """From draws as wide as data and priors leave it."""
        rows = np.concatenate([self.matrix, np.diag(1 / np.array([3.0, 3.0, 3.0, 0.02, 1.0]))])
        return region_of(self, CENTRE, np.linalg.inv(rows.T @ rows)).profile(name)


def region_of(problem, centre, covariance) -> LikelihoodRegion:
    """The joints that fit well by draws of a Gaussian, those that the prior allows."""
    theta = np.random.default_rng(5).multivariate_normal(centre, covariance, 4000)
    return LikelihoodRegion(problem, theta[np.isfinite(problem.prior.log_density(theta))])


def wide(half=10.0):
    return tuple(jb.Uniform(c - half, c + half) for c in CENTRE[:3])


def linear(seed=0, joint=None, scale=(3.0, 5.0, 9.0, 60.0)) -> Linear:
    matrix = np.random.default_rng(seed).normal(size=(8, 4)) * scale
    return Linear(matrix, joint or wide())


@pytest.mark.parametrize(("name", "joint_sd", "pull"), [*((name, None, 0.0) for name in NAMES[:4]), ("k12", 0.2, 0.1)])
def test_on_a_linear_model_the_profile_is_the_gaussian_of_the_marginal_sd(name, joint_sd, pull):
    """Data beside the priors that count: a normal one of a stiffness is a measurement, a uniform one is none."""
    problem = linear(joint=joint_sd and tuple(jb.Normal(c + pull, joint_sd) for c in CENTRE[:3]))
    profile, at, rows = problem.profile(name), NAMES.index(name), problem.matrix[:, :4]
    known = np.diag([1 / joint_sd**2 if joint_sd else 0.0] * 3 + [1 / 0.02**2])
    precision = rows.T @ rows + known
    middle = np.append(CENTRE[:3] + pull, 0.0)
    best = np.linalg.solve(precision, rows.T @ rows @ CENTRE[:4] + known @ middle)[at]  # priors pull at it
    sd = np.sqrt(np.linalg.inv(precision)[at, at])
    np.testing.assert_allclose(profile.log_ratio, -0.5 * ((profile.value - best) / sd) ** 2, atol=1e-4)
    np.testing.assert_allclose(profile.interval, best + np.array([-1, 1]) * sd * np.sqrt(2 * HALF_CHI2), rtol=1e-4)
    assert not profile.open_below | profile.open_above
    assert (np.diff(profile.value) > 0).all()
    assert profile.theta.shape == (profile.value.size, 5)
    np.testing.assert_allclose(profile.theta[:, 4], 0.0, atol=1e-4)  # nothing but its prior depends on it


def test_an_end_that_the_prior_cuts_is_open_and_a_flat_ridge_has_no_limit_at_either_end():
    narrow = (jb.Uniform(CENTRE[0] - 0.01, CENTRE[0] + 10), *wide()[1:])
    profile = linear(joint=narrow).profile("k11")
    assert (profile.open_below, profile.open_above) == (True, False)
    assert profile.interval[0] == pytest.approx(CENTRE[0] - 0.01, abs=1e-6)
    # data see k11·k22 and k12 alone, so k11 may be anything
    profile = Linear(np.array([[30.0, 0, 30.0, 0], [0, 30.0, 0, 0]]), wide()).profile("k11")
    assert (profile.open_below, profile.open_above) == (True, True)
    np.testing.assert_allclose(profile.log_ratio, 0.0, atol=1e-6)
    np.testing.assert_allclose(profile.theta[:, 0] + profile.theta[:, 2], CENTRE[0] + CENTRE[2], atol=1e-3)


def test_along_the_edge_of_positive_definite_joints_the_profile_is_that_of_the_constrained_problem():
    # k12 pushed above √(k11 k22) takes k11 and k22 with it, unequally
    matrix = np.diag([1.0, 0.3, 2.5, 60.0])
    problem = Linear(matrix, wide())
    profile = problem.profile("k12")
    edge = (CENTRE[0] + CENTRE[2]) / 2
    beyond = profile.value > edge + 0.2
    assert beyond.sum() >= 2

    def constrained(value):
        # least of Σ a² d² under d11 + d22 = 2 (value − edge), by hand
        a, need = np.array([1.0, 2.5]) ** 2, 2 * (value - edge)
        move = need / a / (1 / a).sum()
        return -0.5 * ((a * move**2).sum() + (0.3 * (value - CENTRE[1])) ** 2)

    expected = [constrained(value) for value in profile.value[beyond]]
    np.testing.assert_allclose(profile.log_ratio[beyond], expected, rtol=1e-3)
    end = optimize.brentq(lambda value: constrained(value) + HALF_CHI2, edge, edge + 10)
    assert profile.interval[1] == pytest.approx(end, rel=1e-4)
    assert not profile.open_above


def test_where_the_posterior_is_nearly_gaussian_the_interval_is_that_of_the_fisher_information(monkeypatch):
    monkeypatch.setattr(limits, "FALL", HALF_CHI2_68)
    # the cheap case itself is skewed: the tip sees k22 through the poorly known k11; less noise makes it Gaussian
    text = edited(cheap_text(), ("relative = 0.008", "relative = 0.002"), ("floor = 0.0016", "floor = 0.0004"))
    case = jb.case_from_text("quiet", text)
    mode = jb.find_map(case)
    region = region_of(case.problem.log_posterior, mode.theta, mode.covariance)
    sd = fisher_information(case.problem, mode.theta).sd()["k22"]
    low, high = np.log(region.limits(2))
    assert (high - low) / 2 == pytest.approx(sd, rel=0.02)


def test_no_point_of_the_profile_can_be_bettered(cheap_posterior):
    problem, profile = cheap_posterior.problem, region_of_posterior(cheap_posterior).profile("k11")
    rng = np.random.default_rng(0)
    constant = problem.log_posterior(profile.theta[profile.log_ratio.argmax()])[0]  # uniform priors: likelihood only
    for theta, ratio in zip(profile.theta, profile.log_ratio, strict=True):
        around = theta + rng.normal(size=(50, 3)) * [0.0, 0.003, 0.0003]
        assert problem.log_posterior(theta)[0] - constant == pytest.approx(ratio, abs=1e-6)
        assert (problem.log_posterior(around) - constant <= ratio + 1e-6).all()


def test_a_limit_below_zero_is_found_from_draws_above_zero():
    problem = linear()
    theta = np.random.default_rng(5).normal(CENTRE, [0.05, 0.05, 0.05, 0.01, 1.0], (4000, 5))
    profile = LikelihoodRegion(problem, theta[theta[:, 3] > 0]).profile("youngs_modulus")
    assert profile.interval == pytest.approx(problem.profile("youngs_modulus").interval, abs=1e-6)
    assert profile.interval[0] < -0.005


def test_between_two_modes_the_profile_is_as_low_as_the_likelihood():
    class TwoModes(Linear):
        def log_likelihood(self, theta):
            places = CENTRE + np.array([[1.0, 0, 0, 0, 0], [-1.0, 0, 0, 0, 0]])
            each = [-0.5 * (((theta - place) @ self.matrix.T) ** 2).sum(axis=1) for place in places]
            return np.logaddexp(each[0], each[1] - 0.5)

    problem = TwoModes(8 * np.eye(4), wide())
    rng, solution = np.random.default_rng(5), np.arange(2000) % 2
    theta = CENTRE + rng.normal(size=(2000, 5)) / 8 * [1, 1, 1, 0.1, 1]
    theta[:, 0] += 1 - 2 * solution
    profile = LikelihoodRegion(problem, theta, solution).profile("k11")
    reach = np.sqrt(2 * np.array([HALF_CHI2 - 0.5, HALF_CHI2])) / 8
    assert profile.interval == pytest.approx(CENTRE[0] + [-1 - reach[0], 1 + reach[1]], rel=1e-5)
    expected = [problem.log_likelihood(np.array([[x, *CENTRE[1:4], 0.0]]))[0] for x in profile.value]
    np.testing.assert_allclose(profile.log_ratio, expected, rtol=0.01, atol=0.01)
    assert profile.log_ratio.min() < -10
    assert (profile.log_ratio > -0.6).sum() >= 2
