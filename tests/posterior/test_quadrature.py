"""Integrals over the unit cube by quadrature, against closed forms."""

import math

import numpy as np
import pytest
from scipy import stats

from jointbayes.posterior.evidence import integrate


def turned(rng, dimension, sd):
    """A normal density inside the cube, turned at random: ln of it; its integral is 1."""
    turn = stats.special_ortho_group(dimension, seed=rng).rvs() if dimension > 1 else np.eye(1)
    middle = rng.uniform(0.45, 0.55, dimension)
    return stats.multivariate_normal(middle, turn * np.square(sd) @ turn.T)


@pytest.mark.parametrize("sd", [[1e-6], [0.08], [2e-5, 1e-5], [0.07, 4e-4], [0.05, 0.04, 0.05], [0.06, 2e-3, 1e-3]])
def test_bells_needles_and_ridges_in_any_direction_integrate_to_one(sd):
    rng = np.random.default_rng(len(sd))
    for _ in range(5 if len(sd) < 3 else 1):
        found = integrate(turned(rng, len(sd), sd).logpdf, len(sd))
        assert abs(found.log_integral) < max(2 * found.error, 1e-5)
        assert found.error < 0.003


def test_two_needles_far_apart_have_their_shares():
    # a hundred times as high, and of a third of the width along both axes: ten times the mass
    needles = [stats.multivariate_normal([0.21, 0.83], 1e-8), stats.multivariate_normal([0.77, 0.12], 1e-9)]
    found = integrate(lambda u: np.logaddexp(needles[0].logpdf(u), math.log(10) + needles[1].logpdf(u)), 2)
    assert found.log_integral == pytest.approx(math.log(11), abs=2e-3)
    weight = np.exp(found.log_weight - found.log_integral)
    assert weight[found.points[:, 0] < 0.5].sum() == pytest.approx(1 / 11, abs=1e-3)
    mean = weight @ found.points
    assert mean == pytest.approx([(0.21 + 7.7) / 11, (0.83 + 1.2) / 11], abs=1e-3)


def test_where_the_data_are_impossible_nothing_is_added():
    found = integrate(lambda u: np.where(u.sum(axis=1) < 1.0, 3.0, -np.inf), 2)
    assert found.log_integral == pytest.approx(3.0 + math.log(0.5), abs=2 * found.error)
    assert integrate(lambda u: np.full(len(u), -np.inf), 3) is None


def test_values_are_counted_and_a_surface_with_too_many_is_given_up():
    calls = []

    def sphere(u):
        calls.append(len(u))
        return -0.5 * ((np.linalg.norm(u - 0.5, axis=1) - 0.4) / 1e-4) ** 2

    assert integrate(sphere, 3) is None
    assert sum(calls) < 1_200_000
    calls.clear()
    assert integrate(lambda u: sphere(np.hstack([u, np.full_like(u, 0.5)])), 1).evaluations == sum(calls)
