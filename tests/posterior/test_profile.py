"""Profile likelihood: exact on linear models, and what it says at open ends and at the edge of possible joints."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy import optimize

from jointbayes.case.case import case_from_text
from jointbayes.errors import ModelError
from jointbayes.inference import Normal, Uniform
from jointbayes.joint import LogStiffness, Parametrisation
from jointbayes.posterior.fisher import fisher_information
from jointbayes.posterior.profile import _compress_rows, _crossing, profile_likelihood
from tests.conftest import cheap_text, edited

NAMES = ("k11", "k12", "k22", "youngs_modulus", "noise_scale")
CENTRE = np.array([21.0, 15.0, 14.0, 0.01, 0.0])
HALF_CHI2 = 3.841458820694124 / 2


@dataclass(frozen=True)
class LinearPrior:
    marginals: tuple
    parametrisation: Parametrisation = LogStiffness()  # noqa: RUF009 (frozen)
    names: tuple[str, ...] = NAMES

    @property
    def support(self):
        ends = np.array([m.support for m in self.marginals])
        return ends[:, 0], ends[:, 1]

    @property
    def mean(self):
        return np.array([m.mean for m in self.marginals])

    @property
    def sd(self):
        return np.array([m.sd for m in self.marginals])

    @property
    def precision(self):
        return np.array([m.precision for m in self.marginals])


class Linear:
    """A problem whose data residuals are A (θ − centre); the last coordinate enters none of them."""

    def __init__(self, matrix, marginals):
        self.prior = LinearPrior(marginals)
        self.parametrisation, self.names = self.prior.parametrisation, NAMES
        self.log_posterior = self
        self.matrix = np.column_stack([matrix, np.zeros(len(matrix))])

    def data_residuals(self, theta):
        return self.matrix @ (theta - CENTRE), self.matrix

    def log_likelihood(self, theta):
        return np.array([-0.5 * (self.data_residuals(one)[0] ** 2).sum() for one in theta])

    def residuals(self, theta):
        (data, slope), root = self.data_residuals(theta), np.sqrt(self.prior.precision)
        return np.append(data, root * (theta - self.prior.mean)), np.concatenate([slope, np.diag(root)])


def wide(half=10.0):
    return tuple(Uniform(c - half, c + half) for c in CENTRE[:3])


def linear(seed=0, joint=None, scale=(3.0, 5.0, 9.0, 60.0)) -> Linear:
    matrix = np.random.default_rng(seed).normal(size=(8, 4)) * scale
    return Linear(matrix, (*(joint or wide()), Normal(0.0, 0.02), Normal(0.0, 1.0)))


@pytest.mark.parametrize("smallest", [1.0, 1e-6], ids=["independent", "nearly dependent"])
def test_few_rows_have_the_products_of_all_residuals(smallest):
    rng = np.random.default_rng(3)
    residual, jacobian = rng.normal(size=500), rng.normal(size=(500, 4)) * [1e3, 1.0, 1e-3, 0.0]
    jacobian[:, 1] = jacobian[:, 0] + smallest * jacobian[:, 1]
    e, j = _compress_rows(residual, jacobian)
    assert len(e) == 5
    np.testing.assert_allclose(e @ e, residual @ residual, rtol=1e-12)
    np.testing.assert_allclose(j.T @ e, jacobian.T @ residual, rtol=1e-9, atol=1e-12)
    # a step by either is the same to the last digits that the data give
    kept = j[:, :3], jacobian[:, :3]
    steps = [np.linalg.lstsq(matrix, right)[0] for matrix, right in zip(kept, (e, residual), strict=True)]
    np.testing.assert_allclose(*steps, rtol=1e-5)


@pytest.mark.parametrize("name", NAMES[:4])
def test_on_a_linear_model_the_profile_is_the_gaussian_of_the_marginal_sd(name):
    problem = linear()
    profile = profile_likelihood(problem, CENTRE, name)
    at = NAMES.index(name)
    rows = problem.matrix[:, :4]
    precision = rows.T @ rows + np.diag([0, 0, 0, 1 / 0.02**2])
    covariance = np.linalg.inv(precision)
    best = np.linalg.solve(precision, rows.T @ rows @ CENTRE[:4])[at]  # the nuisance's prior pulls at it
    sd = np.sqrt(covariance[at, at])
    np.testing.assert_allclose(profile.log_ratio, -0.5 * ((profile.value - best) / sd) ** 2, atol=1e-4)
    np.testing.assert_allclose(profile.interval, best + np.array([-1, 1]) * sd * np.sqrt(2 * HALF_CHI2), rtol=1e-4)
    assert not profile.open_below
    assert not profile.open_above
    assert (np.diff(profile.value) > 0).all()
    assert profile.theta.shape == (profile.value.size, 5)
    assert (profile.theta[:, 4] == 0.0).all()  # nothing depends on it: it stays
    assert profile.sentence == f"{name} has a lower and an upper 95 % limit"


def test_the_stiffness_priors_count_only_by_their_support():
    pulling = tuple(Normal(c + 1.0, 0.2) for c in CENTRE[:3])  # as a prior it would move everything
    flat = profile_likelihood(linear(), CENTRE, "k12")
    normal = profile_likelihood(linear(joint=pulling), CENTRE, "k12")
    assert normal.interval == pytest.approx(flat.interval, abs=1e-3)


def test_an_end_that_the_prior_cuts_is_open():
    narrow = (Uniform(CENTRE[0] - 0.01, CENTRE[0] + 10), *wide()[1:])
    profile = profile_likelihood(linear(joint=narrow), CENTRE, "k11")
    assert profile.open_below
    assert not profile.open_above
    assert profile.interval[0] == pytest.approx(CENTRE[0] - 0.01, abs=1e-6)
    assert profile.sentence == "k11 has no lower limit within the prior"


def test_a_flat_ridge_has_no_limit_at_either_end():
    # data see k11·k22 and k12 alone, so k11 may be anything
    matrix = np.array([[30.0, 0, 30.0, 0], [0, 30.0, 0, 0]])
    profile = profile_likelihood(linear_of(matrix), CENTRE, "k11")
    assert profile.open_below
    assert profile.open_above
    assert profile.sentence == "k11 has no lower and no upper limit within the prior"
    np.testing.assert_allclose(profile.log_ratio, 0.0, atol=1e-6)
    np.testing.assert_allclose(profile.theta[:, 0] + profile.theta[:, 2], CENTRE[0] + CENTRE[2], atol=1e-3)


def linear_of(matrix) -> Linear:
    return Linear(matrix, (*wide(), Normal(0.0, 0.02), Normal(0.0, 1.0)))


def test_along_the_edge_of_positive_definite_joints_the_profile_is_that_of_the_constrained_problem():
    # k12 pushed above √(k11 k22) takes k11 and k22 with it, unequally
    matrix = np.diag([1.0, 0.3, 2.5, 60.0])
    problem = linear_of(matrix)
    profile = profile_likelihood(problem, CENTRE, "k12")
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


def test_where_the_posterior_is_nearly_gaussian_the_interval_is_that_of_the_fisher_information():
    # the cheap case itself is skewed: the tip sees k22 through the poorly known k11; less noise makes it Gaussian
    text = edited(cheap_text(), ("relative = 0.008", "relative = 0.002"), ("floor = 0.0016", "floor = 0.0004"))
    case = case_from_text("quiet", text)
    theta = cheap_case_mode(case)
    profile = profile_likelihood(case.problem, theta, "k22", level=0.6827)
    sd = fisher_information(case.problem, theta).sd()["k22"]
    low, high = profile.interval
    assert (high - low) / 2 == pytest.approx(sd, rel=0.02)


def test_no_point_of_the_profile_can_be_bettered(cheap_case):
    problem = cheap_case.problem
    profile = profile_likelihood(problem, cheap_case_mode(cheap_case), "k11")
    rng = np.random.default_rng(0)
    constant = problem.log_posterior(profile.theta[profile.log_ratio.argmax()])[0]  # uniform priors: likelihood only
    for theta, ratio in zip(profile.theta, profile.log_ratio, strict=True):
        around = theta + rng.normal(size=(50, 3)) * [0.0, 0.003, 0.0003]
        assert problem.log_posterior(theta)[0] - constant == pytest.approx(ratio, abs=1e-6)
        assert (problem.log_posterior(around) - constant <= ratio + 1e-6).all()


def cheap_case_mode(case):
    import jointbayes as jb

    return jb.find_map(case).theta


def test_unknown_and_unseen_coordinates_are_refused():
    with pytest.raises(ModelError, match="found coordinate 'k13'"):
        profile_likelihood(linear(), CENTRE, "k13")
    with pytest.raises(ModelError, match="no residual depends on noise_scale"):
        profile_likelihood(linear(), CENTRE, "noise_scale")
    with pytest.raises(ModelError, match="expected a positive definite joint"):
        profile_likelihood(linear(), CENTRE + 5 * np.eye(5)[1], "k11")


def test_a_limit_is_found_where_a_climb_that_is_repeated_ends_above_it():
    class Elsewhere:
        at = 0

        def maximum_at(self, value, _):
            return np.array([value]), value**2 + 0.02

    (end,), cost = _crossing(Elsewhere(), (np.array([1.0]), 1.0), (np.array([1.5]), 2.27), 1.01)
    assert end == pytest.approx(1.0, abs=1e-3)
    assert cost == pytest.approx(1.02, abs=2e-3)
