"""Whether tests measured the same: calibrated for lines and modes, changes named with their size."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import jointbayes as jb
from jointbayes.inference import Level, Test
from jointbayes.posterior.homogeneity import FALSE_ALARM, _compare_lines, compare_all_tests, compare_tests
from tests.conftest import CLAMP, CONFIGS, rod
from vibrecords import FrequencyData, FrfData, FrfSet, ModeData, Observed

ROD, CLAMPED = rod(), jb.load_case(CONFIGS / "clamped_beam.toml").problem
LINES = np.arange(30.0, 300.0, 0.5)
MODES = np.array([80.0, 210.0])


def frfs(rng, frequency=MODES, damping=(0.004, 0.01), averages=None, lines=LINES):
    """Receptance of modes in closed form with noise, of known variance or of one estimated from averages."""
    omega, own = 2 * np.pi * lines[:, None], 2 * np.pi * np.asarray(frequency)
    exact = (1e4 / (own**2 - omega**2 + 2j * np.asarray(damping) * own * omega)).sum(axis=1)[:, None, None]
    sd = 0.02 * np.median(np.abs(exact)) + 0.003 * np.abs(exact)
    count = averages or 1
    draws = rng.standard_normal((2, count, *exact.shape))
    each = exact + sd * math.sqrt(count / 2) * (draws[0] + 1j * draws[1])
    values, variance = each.mean(axis=0), sd**2
    if averages:
        variance = (np.abs(each - values) ** 2).sum(axis=0) / (count - 1) / count
    dof = None if averages is None else 2 * (count - 1)
    return FrfData(FrfSet(lines, values, ("1:y",), ("1:y",)), variance, variance_dof=dof)


def of(name, data, structure=ROD, joints=CLAMP, level=None):
    return Test(name, structure, joints, data, level=level)


@pytest.mark.science
@pytest.mark.parametrize("averages", [None, 10])
def test_equal_frfs_are_called_different_as_often_as_stated(averages):
    rng = np.random.default_rng(1)
    p_values = [_compare_lines(frfs(rng, averages=averages), frfs(rng, averages=averages))[2] for _ in range(300)]
    assert stats.kstest(p_values, "uniform").pvalue > 0.01
    assert np.mean(np.array(p_values) < FALSE_ALARM) < 0.03


def test_common_lines_and_dofs_alone_are_compared_in_one_quantity():
    rng = np.random.default_rng(2)
    first, second = frfs(rng), frfs(rng, lines=np.arange(100.0, 400.0, 1.0)).converted("accelerance")
    count, chi2, p_value, largest = _compare_lines(first, second)
    assert (count, largest) == (200, ())
    assert 0.7 < chi2 < 1.3
    assert p_value > FALSE_ALARM
    other = replace(second, frf=replace(second.frf, outputs=("2:y",)))
    assert _compare_lines(first, other) is None


def test_a_resonance_whose_damping_triples_is_named_with_its_figures():
    rng = np.random.default_rng(3)
    low, high = frfs(rng), frfs(rng, (79.92, 210.0), (0.012, 0.01))
    compared = compare_tests(of("low", low), of("high", high))
    assert not compared.equal
    assert compared.values == LINES.size
    assert compared.largest_hz[0] == pytest.approx(80, abs=1.0)
    moved, still = compared.modes
    assert abs(moved.frequency_percent + 0.1) < 4 * moved.frequency_percent_sd < 0.1
    assert abs(100 * math.log(moved.damping_factor / 3)) < 4 * moved.damping_percent_sd < 20
    assert max(map(abs, still.scores)) < 4
    assert compared.sentence.startswith("Tests low and high differ by more than their noise. 540 FRF values ")
    assert compared.as_json()["equal"] is False


def test_equal_frfs_are_said_to_be_equal():
    rng = np.random.default_rng(4)
    compared = compare_tests(of("low", frfs(rng)), of("high", frfs(rng)))
    assert compared.equal
    assert "low and high are equal within their noise" in compared.sentence


def test_modes_that_are_typed_in_are_compared_by_number_in_frequency_and_damping():
    first = ModeData(Observed(np.array([80.0, 210.0]), 0.1), Observed(np.array([0.004, np.nan]), 0.0004))
    second = ModeData(Observed(np.array([210.3, 500.0]), 0.1), Observed(np.array([0.01, 0.01]), 0.001), numbers=(2, 3))
    compared = compare_tests(of("a", first), of("b", second))
    (shift,) = compared.modes
    z = math.log(210.3 / 210.0) / math.hypot(0.1 / 210.0, 0.1 / 210.3)
    assert shift.scores == pytest.approx((z,))
    assert compared.modes_p_value == pytest.approx(stats.chi2.sf(z**2, 1))
    assert (compared.values, compared.chi2_per_value, compared.lines_p_value) == (0, None, None)
    damped = replace(second, numbers=(1, 3), frequency=Observed(np.array([80.0, 500.0]), 0.1))
    (shift,) = compare_tests(of("a", first), of("b", damped)).modes
    assert shift.damping_factor == pytest.approx(2.5)
    assert shift.scores[1] == pytest.approx(math.log(2.5) / math.hypot(0.1, 0.1))


def test_each_test_of_a_structure_is_compared_with_that_of_its_lowest_level():
    data = FrequencyData([80.0], [0.1])
    torques = {"high": 20.0, "low": 5.0, "middle": 9.0}
    tests = [of(name, data, level=Level(torque)) for name, torque in torques.items()]
    other = [of("other", data, structure=rod(length=0.2)), of("free", data, joints=())]
    problem = jb.Problem([*tests, *other], jb.JointPrior(CLAMPED.prior.parametrisation, CLAMPED.prior.marginals))
    assert [(c.first, c.second) for c in compare_all_tests(problem)] == [("low", "middle"), ("low", "high")]
    assert compare_tests(tests[0], of("frfs", frfs(np.random.default_rng(5), frequency=(120.0, 250.0)))) is None
