"""Control charts: scatter without the estimates' errors, limits that a few odd joints do not move, false alarms."""

import numpy as np
import pytest

from jointbayes.studies.campaign.control import FALSE_ALARM, control_chart, outlier_limit
from tests.conftest import first_in_ci

ERROR = 0.1


def estimates(joints, seed, scatter=0.2):
    rng = np.random.default_rng(seed)
    sd = ERROR * np.exp(0.5 * rng.normal(size=joints))
    return 3.0 + scatter * rng.normal(size=joints) + sd * rng.normal(size=joints), sd


def test_scatter_is_that_of_the_joints_without_the_errors_of_their_estimates():
    charts = [control_chart(*estimates(200, seed)) for seed in range(40)]
    assert np.mean([one.long_term for one in charts]) == pytest.approx(0.2, rel=0.05)
    assert np.mean([one.short_term for one in charts]) == pytest.approx(0.2, rel=0.05)
    assert np.mean([one.centre for one in charts]) == pytest.approx(3.0, abs=0.01)


@pytest.mark.whole
def test_so_many_joints_lie_beyond_their_limits_as_is_stated():
    beyond = np.mean([control_chart(*estimates(300, seed)).exceeds_limits.mean() for seed in range(100)])
    assert beyond == pytest.approx(0.0027, abs=0.0015)


def test_joints_that_all_lie_as_far_from_the_centre_have_the_scatter_of_that_median():
    value = 0.7 * np.resize([1.0, -1.0], 40)
    assert control_chart(value, np.full(40, 1e-9)).long_term == pytest.approx(0.7 / 0.6744897501960817, rel=1e-6)


def test_joints_that_are_all_alike_have_no_scatter():
    charts = [control_chart(*estimates(200, seed, scatter=0.0)) for seed in range(20)]
    assert np.median([one.long_term for one in charts]) < 0.5 * ERROR


@pytest.mark.science
@pytest.mark.parametrize("joints", first_in_ci([12, 200], 1))
def test_of_campaigns_without_outliers_the_stated_share_has_any(joints):
    limit = outlier_limit(joints, 1)
    alarms = [(np.abs(control_chart(*estimates(joints, s)).score) > limit).any() for s in range(400)]
    assert np.mean(alarms) == pytest.approx(FALSE_ALARM, abs=0.035)


def test_the_limit_grows_with_the_quantities_and_shrinks_with_what_is_known_of_the_scatter():
    assert outlier_limit(200, 3) > outlier_limit(200, 1)
    assert outlier_limit(8, 1) > outlier_limit(30, 1)
    assert outlier_limit(5000, 1) == pytest.approx(4.4, abs=0.2)  # of 5000 normal values one in twenty sets has more


def test_odd_joints_move_neither_centre_nor_limits_and_are_found():
    value, sd = estimates(100, 1)
    odd = value.copy()
    odd[[10, 40, 41]] += [3.0, -2.0, 4.0]
    plain, chart = control_chart(value, sd), control_chart(odd, sd)
    assert chart.centre == pytest.approx(plain.centre, abs=0.03)
    assert chart.long_term == pytest.approx(plain.long_term, rel=0.15)
    assert chart.short_term == pytest.approx(plain.short_term, rel=0.2)
    assert np.flatnonzero(np.abs(chart.score) > outlier_limit(100, 1)).tolist() == [10, 40, 41]


def test_a_drift_widens_the_scatter_of_all_but_not_the_limits():
    value, sd = estimates(200, 2)
    chart = control_chart(value + np.linspace(-1.5, 1.5, 200), sd)
    assert chart.short_term == pytest.approx(0.2, rel=0.25)
    assert chart.long_term > 0.6
    assert chart.exceeds_limits.mean() > 0.1


def test_a_joint_that_is_hardly_known_is_no_outlier_and_does_not_move_the_others():
    value, sd = estimates(50, 3)
    unknown, wide = np.append(value, 9.0), np.append(sd, 5.0)
    chart = control_chart(unknown, wide)
    assert abs(chart.score[-1]) < 2
    assert not chart.exceeds_limits[-1]
    assert chart.centre == pytest.approx(control_chart(value, sd).centre, abs=0.02)


def test_one_joint_has_a_chart():
    chart = control_chart(np.array([1.0]), np.array([0.1]))
    assert chart.centre == 1.0
    assert not chart.exceeds_limits.any()
