"""Measured FRFs against predicted ones that were not fitted: level, sign and shape, each at its limit."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jointbayes.posterior.compared_frfs import (
    CLEAR,
    FEWEST,
    FOLLOWS,
    LEVEL,
    TURNED,
    compare_frfs,
    level_and_correlation,
)
from tests.conftest import TABLE_3

AT = np.log(TABLE_3)
SOFT = AT - math.log(1000.0)
LITTLE = 1e-6


def measured(case, factor, noise=1e-3, at=AT):
    """The test of a case whose FRF is the one predicted there, times a factor of each line."""
    problem = case.problem
    data = problem.test.data
    exact = problem.log_posterior.predicted(at[None])[0]
    values = exact * np.broadcast_to(factor, exact.shape[:1])[:, None, None]
    frf = replace(data.frf, values=values)
    return problem.with_test(data=replace(data, frf=frf, variance=(noise * np.abs(values)) ** 2))


@pytest.mark.parametrize(
    ("factor", "faults"),
    [
        (1.0, ()),
        (LEVEL * (1 + LITTLE), ("level",)),
        (LEVEL * (1 - LITTLE), ()),
        (1 / LEVEL * (1 - LITTLE), ("level",)),
        (1 / LEVEL * (1 + LITTLE), ()),
        (np.exp(1j * math.acos(FOLLOWS - LITTLE)), ("shape",)),
        (np.exp(1j * math.acos(FOLLOWS + LITTLE)), ()),
        (np.exp(1j * math.acos(TURNED - LITTLE)), ("sign",)),
        (np.exp(1j * math.acos(TURNED + LITTLE)), ("shape",)),
        (-4.6, ("sign", "level")),
    ],
)
def test_each_fault_begins_at_its_limit(cheap_case, factor, faults):
    (found,) = compare_frfs(measured(cheap_case, factor), AT[None])
    assert found.faults == faults
    assert found.level == pytest.approx(abs(factor))
    assert found.correlation == pytest.approx(np.cos(np.angle(factor)))
    assert (found.output, found.input) == ("5:y", "5:y")


def test_a_delay_is_another_shape(cheap_case):
    hz, delay = cheap_case.problem.test.data.frf.frequency_hz, 2e-4
    (found,) = compare_frfs(measured(cheap_case, np.exp(-2j * np.pi * hz * delay)), AT[None])
    mean = np.diff(np.sin(2 * np.pi * delay * hz[[0, -1]]))[0] / (2 * np.pi * delay * (hz[-1] - hz[0]))
    assert found.correlation == pytest.approx(mean, abs=0.01)
    assert found.faults == ("shape",)


@pytest.mark.parametrize(("at", "other"), [(AT, SOFT), (SOFT, AT)])
def test_a_fault_is_one_at_every_draw(cheap_case, at, other):
    """A far softer joint predicts another FRF, larger or smaller: what is off at one of two is not the sensor's."""
    there = measured(cheap_case, 1.0, at=at)
    assert "level" in compare_frfs(there, other[None])[0].faults
    assert compare_frfs(there, np.stack([other, at]))[0].faults == ()


def test_data_without_frfs_are_compared_with_none(frequency_case):
    assert compare_frfs(frequency_case.problem, AT[None]) == ()


def test_lines_in_the_noise_and_too_few_of_them_say_nothing(cheap_case):
    (found,) = compare_frfs(measured(cheap_case, 4.6, noise=1 / CLEAR * (1 + LITTLE)), AT[None])
    assert math.isnan(found.level)
    assert found.faults == ()
    (found,) = compare_frfs(measured(cheap_case, 4.6, noise=1 / CLEAR * (1 - LITTLE)), AT[None])
    assert found.faults == ("level",)


def test_of_magnitudes_without_phase_the_level_is_compared(cheap_case):
    data = measured(cheap_case, 1.0).test.data
    for factor, faults in ((1.0, ()), (4.6, ("level",))):
        frf = replace(data.frf, values=factor * np.abs(data.frf.values) + 0j)
        (found,) = compare_frfs(cheap_case.problem.with_test(data=replace(data, frf=frf)), AT[None])
        assert found.faults == faults
        assert math.isnan(found.correlation)


@pytest.mark.parametrize("clear_lines", [FEWEST - 1, FEWEST])
def test_level_is_a_median_and_correlation_a_mean_over_clear_lines(clear_lines):
    ratios = np.array([2.0, 2.0, 2.0, -50.0, 2.0, 2.0, 2.0, 2.0j, 2.0, 2.0, 7.0, 7.0, 7.0])[:, None, None]
    predicted = np.exp(1j * np.arange(13.0))[:, None, None]
    clear = (np.arange(13) < clear_lines)[:, None, None]
    level, correlation = level_and_correlation(ratios * predicted, predicted, clear)
    if clear_lines < FEWEST:
        assert np.isnan([level, correlation]).all()
    else:
        assert level == 2.0
        assert correlation == pytest.approx((8 - 1 + 0) / 10)
