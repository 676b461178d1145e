"""Systems of coordinates: one harness for all, and what each makes of its draws."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from jointbayes.joint import CondensedCoordinates, Cone
from jointbayes.sampling import ComposedCoordinates, NormalScores
from jointbayes.sampling.coordinate_maps import Identity, straightened
from tests.oracles import check_coordinates
from tests.science.test_invariance import Warp

INF = np.inf
BOX = NormalScores([2.0, -INF, -1.0], [5.0, INF, 1.0])
BASE = NormalScores([-INF, 0.0, -INF], [INF, 2.0, INF])


def bent(seed, n=4000):
    a, b, c = np.random.default_rng(seed).normal(size=(3, n))
    return np.column_stack([a, 2 * stats.norm.cdf(0.5 * a**2 + 0.1 * b - 1), a * b + 0.05 * c])


def coupled():
    """ln k11, ln k12, ln k22 of positive definite pairs."""
    rng = np.random.default_rng(4)
    k11, k22 = np.exp(rng.normal(20, 1, 50)), np.exp(rng.normal(14, 1, 50))
    return np.log(np.stack([k11, rng.uniform(0.01, 0.99, 50) * np.sqrt(k11 * k22), k22], axis=1))


IN_BOX = BOX.inverse(np.random.default_rng(3).normal(scale=1.5, size=(200, 3)))[0]
BENT = bent(3)
#: Away from the edges, at which differences have no digits.
INNER = BENT[np.abs(BASE.forward(BENT)[:, 1]) < 3][:20]
SYSTEMS = {
    "identity": (Identity(), IN_BOX),
    "normal scores": (BOX, IN_BOX),
    "straightened": (straightened(BASE, BENT), INNER),
    "composed": (ComposedCoordinates(Identity(), BOX), IN_BOX),
    "condensed": (CondensedCoordinates(Cone(0, 1, 2)), coupled()),
    "those of the tests of moves": (Warp(), IN_BOX),
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_coordinates_lead_back_with_the_volume_that_they_state(name):
    check_coordinates(*SYSTEMS[name])


def test_the_condensed_stiffness_is_what_is_left_with_the_other_motion_free():
    theta = coupled()
    k11, k12, k22 = np.exp(theta.T)
    assert_allclose(np.exp(CondensedCoordinates(Cone(0, 1, 2)).forward(theta)[:, 2]), k22 - k12**2 / k11, rtol=1e-9)


def test_composed_coordinates_are_applied_one_after_the_other():
    both = ComposedCoordinates(Identity(), BOX)
    np.testing.assert_array_equal(both.forward(IN_BOX), BOX.forward(IN_BOX))
    assert not both.inverse(np.array([[9.0, 0.0, 0.0]]))[1].any()


def test_a_uniform_density_becomes_a_normal_one_and_what_has_no_ends_stays():
    theta = np.random.default_rng(5).uniform(2.0, 5.0, size=(4000, 3))
    phi = BOX.forward(theta)
    assert stats.kstest(phi[:, 0], stats.norm.cdf).pvalue > 1e-3
    np.testing.assert_array_equal(phi[:, 1], theta[:, 1])


def test_the_ends_are_finite_and_points_beyond_seven_are_not_of_the_box():
    ends = BOX.forward(np.array([[2.0, 0.0, 1.0], [5.0, 0.0, -1.0]]))
    assert np.isfinite(ends).all()
    assert (np.abs(ends[:, [0, 2]]) > 7.0).all()
    assert BOX.inverse(np.array([[7.1, 0.0, 0.0], [0.0, 70.0, 6.9]]))[1].tolist() == [False, True]


def test_bent_draws_are_straight_where_they_are_straightened_also_others_than_those():
    before, coordinates = BASE.forward(BENT), straightened(BASE, BENT)
    phi = coordinates.forward(BENT)
    assert (phi.std(axis=0) * before.std(axis=0)).min() < 0.2 * before.std(axis=0).min()
    assert abs(np.corrcoef(phi[:, 0] ** 2, phi[:, 1])[0, 1]) < 0.05
    others = bent(2)
    theta, inside = coordinates.inverse(coordinates.forward(others))
    assert inside.all()
    assert_allclose(theta, others, rtol=1e-9, atol=1e-9)


def test_independent_draws_are_left_as_they_are():
    draws = np.random.default_rng(4).normal(size=(4000, 3)) * [1.0, 5.0, 0.2] + 7.0
    phi = straightened(Identity(), draws).forward(draws)
    assert_allclose(phi, (draws - draws.mean(axis=0)) / draws.std(axis=0), atol=1e-12)
