"""Variance from repeated measurements."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from vibrecords import FrfSet, RelativeNoise
from vibrecords.assemble import mean_of_repeats
from vibrecords.errors import MeasurementError

LINES = np.arange(10.0, 60.0)
TRUE = (1 + LINES / 10) * np.exp(0.1j * LINES)


def repeats(rng: np.random.Generator, count: int, sd: float = 0.3) -> list[FrfSet]:
    """Measurements of the same FRF, noise of both parts together 2 sd²."""
    noise = rng.standard_normal((2, count, LINES.size)) * sd
    values = (TRUE + noise[0] + 1j * noise[1])[..., None, None]
    return [FrfSet(LINES, one, ("1:y",), ("1:y",), averages=5) for one in values]


@pytest.mark.parametrize("count", [2, 4, pytest.param(10, marks=pytest.mark.science)])
def test_the_variance_of_repeats_is_the_scatter_of_their_mean(count):
    rng = np.random.default_rng(count)
    tests = [mean_of_repeats(repeats(rng, count)) for _ in range(800)]
    means = np.array([test.frf.values[:, 0, 0] for test in tests])
    predicted = np.mean([test.variance[:, 0, 0] for test in tests], axis=0)
    assert predicted.mean() == pytest.approx(2 * 0.3**2 / count, rel=0.03)
    assert np.mean(np.abs(means - TRUE) ** 2) == pytest.approx(predicted.mean(), rel=0.03)


def test_the_mean_of_repeats_has_their_averages_and_no_coherence():
    sets = repeats(np.random.default_rng(1), 3)
    measured = mean_of_repeats(sets)
    mean = measured.frf
    assert_allclose(mean.values, sum(frf.values for frf in sets) / 3)
    assert (mean.averages, mean.coherence, measured.variance.shape) == (15, None, mean.values.shape)
    assert mean_of_repeats([sets[0], replace(sets[1], averages=None)]).frf.averages is None


def test_the_floor_holds_where_repeats_agree_too_well():
    sets = repeats(np.random.default_rng(1), 2, sd=1e-9)
    measured = mean_of_repeats(sets, RelativeNoise(0.01, 0.0))
    assert_allclose(measured.variance, 2 * (0.01 * np.abs(measured.frf.values)) ** 2)


SETS = repeats(np.random.default_rng(3), 2)
REFUSED = {
    "one": (SETS[:1], "found 1 measurement"),
    "the same twice": ([SETS[0], SETS[0]], "the same to the last digit"),
    "other lines": ([SETS[0], replace(SETS[1], frequency_hz=LINES + 1)], "other lines in measurement 2"),
    "other DOFs": ([SETS[0], replace(SETS[1], outputs=("2:y",))], "other DOFs"),
    "other quantity": ([*SETS, replace(SETS[1], quantity="mobility")], "other quantity in measurement 3"),
}


@pytest.mark.parametrize(("sets", "message"), REFUSED.values(), ids=REFUSED)
def test_repeats_that_tell_nothing_are_refused(sets, message):
    with pytest.raises(MeasurementError, match=message):
        mean_of_repeats(sets)
