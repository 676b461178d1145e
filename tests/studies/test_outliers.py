"""Outliers among joints: scatter without the errors of estimates, medians that a few odd joints do not move, alarms."""

import numpy as np
import pytest

from jointbayes.studies.campaign.campaign_findings import FALSE_ALARM, outlier_limit, spread_of
from tests.conftest import first_in_ci

ERROR = 0.1


def estimates(joints, seed, scatter=0.2):
    rng = np.random.default_rng(seed)
    sd = ERROR * np.exp(0.5 * rng.normal(size=joints))
    return 3.0 + scatter * rng.normal(size=joints) + sd * rng.normal(size=joints), sd


def test_scatter_is_that_of_the_joints_without_the_errors_of_their_estimates():
    spreads = [spread_of(*estimates(200, seed)) for seed in range(40)]
    assert np.mean([one.scatter for one in spreads]) == pytest.approx(0.2, rel=0.05)
    assert np.mean([one.centre for one in spreads]) == pytest.approx(3.0, abs=0.01)


def test_joints_that_all_lie_as_far_from_the_centre_have_the_scatter_of_that_median():
    value = 0.7 * np.resize([1.0, -1.0], 40)
    assert spread_of(value, np.full(40, 1e-9)).scatter == pytest.approx(0.7 / 0.6744897501960817, rel=1e-6)


def test_joints_that_are_all_alike_have_no_scatter():
    spreads = [spread_of(*estimates(200, seed, scatter=0.0)) for seed in range(20)]
    assert np.median([one.scatter for one in spreads]) < 0.5 * ERROR


@pytest.mark.science
@pytest.mark.parametrize("joints", first_in_ci([12, 200], 1))
def test_of_campaigns_without_outliers_the_stated_share_has_any(joints):
    limit = outlier_limit(joints, 1)
    alarms = [(np.abs(spread_of(*estimates(joints, s)).score) > limit).any() for s in range(400)]
    assert np.mean(alarms) == pytest.approx(FALSE_ALARM, abs=0.035)


def test_the_limit_grows_with_the_quantities_and_shrinks_with_what_is_known_of_the_scatter():
    assert outlier_limit(200, 3) > outlier_limit(200, 1)
    assert outlier_limit(8, 1) > outlier_limit(30, 1)
    assert outlier_limit(5000, 1) == pytest.approx(4.4, abs=0.2)  # of 5000 normal values one in twenty sets has more


def test_odd_joints_do_not_move_centre_and_scatter_and_are_found():
    value, sd = estimates(100, 1)
    odd = value.copy()
    odd[[10, 40, 41]] += [3.0, -2.0, 4.0]
    plain, spread = spread_of(value, sd), spread_of(odd, sd)
    assert spread.centre == pytest.approx(plain.centre, abs=0.03)
    assert spread.scatter == pytest.approx(plain.scatter, rel=0.15)
    assert np.flatnonzero(np.abs(spread.score) > outlier_limit(100, 1)).tolist() == [10, 40, 41]


def test_a_joint_that_is_hardly_known_is_no_outlier_and_does_not_move_the_others():
    value, sd = estimates(50, 3)
    spread = spread_of(np.append(value, 9.0), np.append(sd, 5.0))
    assert abs(spread.score[-1]) < 2
    assert spread.centre == pytest.approx(spread_of(value, sd).centre, abs=0.02)


def test_one_joint_is_its_own_centre():
    spread = spread_of(np.array([1.0]), np.array([0.1]))
    assert (spread.centre, spread.scatter, spread.score[0]) == (1.0, 0.0, 0.0)
