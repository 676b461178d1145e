"""At the edge of the cone of possible joints, where a start may end, differences of the density stay inside."""

import numpy as np
import pytest

from jointbayes.case.case import case_from_text
from jointbayes.identification.refine import laplace_covariance
from tests.conftest import cheap_text


@pytest.fixture(scope="module")
def log_posterior():
    return case_from_text("scaled", cheap_text() + '\n[noise]\nscale = "sampled"\n').problem.log_posterior


@pytest.fixture(scope="module")
def edge(log_posterior):
    """θ with k12² as near to k11·k22 as rounding leaves it positive definite."""
    k11, k22 = 20.0, 12.0
    theta = np.array([k11, (k11 + k22) / 2 - 1e-12, k22, 0.1])
    assert log_posterior.prior.feasible(theta)
    return theta


def test_a_move_out_of_the_cone_is_not_made_and_one_out_of_the_box_ends_at_its_side(log_posterior, edge):
    prior = log_posterior.prior
    out, inwards = prior.moved(edge, np.array([[0.0, 0.1, 0.0, 0.0], [0.0, -0.1, 0.0, 0.0]]))
    assert (out == edge).all()
    assert inwards[1] == pytest.approx(edge[1] - 0.1)
    (far,) = prior.moved(edge, np.array([[0.0, 0.0, 0.0, 1e3]]))
    assert far[3] == prior.support[1][3]


def test_gradient_and_covariance_are_finite_at_the_edge(log_posterior, edge):
    assert np.isfinite(log_posterior.gradient(edge)).all()
    covariance = laplace_covariance(log_posterior, edge)
    assert np.isfinite(covariance).all()
    assert (np.linalg.eigvalsh(covariance) > 0).all()


def test_inside_the_cone_the_differences_are_central(log_posterior):
    theta = np.array([22.0, 16.0, 14.0, 0.1])
    step = 1e-5
    moves = step * np.eye(4)
    central = (log_posterior(theta + moves) - log_posterior(theta - moves)) / (2 * step)
    assert log_posterior.gradient(theta) == pytest.approx(central, rel=1e-3)
