"""Values with their noise: the law of its variance, and what is refused."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.one_line import refused
from vibrecords import FrequencyData, FrfData, FrfSet, RelativeNoise
from vibrecords.errors import MeasurementError


def test_relative_noise_alone_and_a_floor_alone_are_possible():
    values = np.array([1.0, 2.0, 10.0])[:, None, None] * (1 + 0j)
    assert_allclose(RelativeNoise(0.1, 0.0).variance(values).ravel(), 2 * np.array([0.1, 0.2, 1.0]) ** 2)
    assert_allclose(RelativeNoise(0.0, 0.1).variance(values).ravel(), 2 * np.full(3, 0.2) ** 2)


def test_a_floor_is_taken_from_each_frf_by_itself():
    values = np.array([[1.0, 100.0], [1.0, 100.0]])[:, :, None] * (1 + 0j)
    assert_allclose(RelativeNoise(0.0, 0.1).variance(values)[0, :, 0], [0.02, 200.0])


FRF = FrfSet([1.0, 2.0], np.ones((2, 1, 1)), ("1:y",), ("1:y",))


def frequencies(values, sd):
    return FrequencyData(np.array(values, dtype=float), np.array(sd, dtype=float))


REFUSED = {
    "negative relative noise": lambda: RelativeNoise(-0.1, 0.1),
    "negative floor": lambda: RelativeNoise(0.1, -0.1),
    "no noise": lambda: RelativeNoise(0.0, 0.0),
    "NaN noise": lambda: RelativeNoise(np.nan, 0.1),
    "variance of another shape": lambda: FrfData(FRF, np.ones((2, 1))),
    "real values": lambda: FrfData.of_arrays([100.0, 200.0], np.ones((2, 1, 1)), 0.1, ("1:y",), ("1:y",)),
    "zero variance": lambda: FrfData(FRF, np.array([1.0, 0.0]).reshape(2, 1, 1)),
    "negative variance": lambda: FrfData(FRF, np.array([1.0, -1.0]).reshape(2, 1, 1)),
    "NaN variance": lambda: FrfData(FRF, np.array([1.0, np.nan]).reshape(2, 1, 1)),
    "infinite variance": lambda: FrfData(FRF, np.array([1.0, np.inf]).reshape(2, 1, 1)),
    "falling frequencies": lambda: frequencies([762.0, 120.0], [1.0, 1.0]),
    "equal frequencies": lambda: frequencies([120.0, 120.0], [1.0, 1.0]),
    "zero frequency": lambda: frequencies([0.0, 120.0], [1.0, 1.0]),
    "NaN frequency": lambda: frequencies([120.0, np.nan], [1.0, 1.0]),
    "infinite frequency": lambda: frequencies([120.0, np.inf], [1.0, 1.0]),
    "zero deviation": lambda: frequencies([120.0, 762.0], [1.0, 0.0]),
    "NaN deviation": lambda: frequencies([120.0, 762.0], [1.0, np.nan]),
    "one deviation for two": lambda: frequencies([120.0, 762.0], [1.0]),
    "a matrix": lambda: frequencies([[120.0]], [[1.0]]),
}


@pytest.mark.parametrize("broken", REFUSED.values(), ids=REFUSED)
def test_impossible_measurements_are_refused_in_one_line(broken):
    refused(broken, MeasurementError)


def test_measurements_are_read_only():
    frf, natural = FrfData(FRF, np.ones((2, 1, 1))), frequencies([120.0, 762.0], [1.0, 2.0])
    for array in (frf.variance, frf.frf.values, natural.frequency_hz, natural.sd_hz):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 7.0
