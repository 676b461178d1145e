"""Modes as data: what is kept of them, and what is refused."""

import numpy as np
import pytest

from jointbayes.errors import MeasurementError
from jointbayes.measurement import FrequencyData, ModeData, ModeShapes, Observed

NAN = float("nan")
FREQUENCY = Observed(np.array([[12.1, 31.4], [12.2, NAN]]), 0.1)
SHAPES = ModeShapes(("1:x", "3:x"), "2:x", Observed(np.array([[0.6, NAN], [-1.6, 0.2]]), 0.02))


def test_values_come_by_quantity_repetition_and_mode_without_those_that_were_not_observed():
    measured = ModeData(FREQUENCY, Observed(np.array([0.01, 0.02]), np.array([1e-3, 2e-3])), SHAPES)
    np.testing.assert_array_equal(measured.values, [12.1, 31.4, 12.2, 0.01, 0.02, 0.6, -1.6, 0.2])
    np.testing.assert_array_equal(measured.sd, [0.1, 0.1, 0.1, 1e-3, 2e-3, 0.02, 0.02, 0.02])
    assert [(v.quantity, v.mode, v.dof, v.repetition) for v in measured.observed[2:6]] == [
        ("frequency", 0, 0, 1),
        ("damping", 0, 0, 0),
        ("damping", 1, 0, 0),
        ("shape", 0, 0, 0),
    ]
    assert measured.dofs == ("1:x", "3:x", "2:x")
    assert measured.references == ("2:x", "2:x")
    other = measured.with_values(2 * measured.values / 3)
    np.testing.assert_allclose(other.values, 2 * measured.values / 3)
    np.testing.assert_array_equal(other.sd, measured.sd)


def test_natural_frequencies_are_weighted_means_over_repetitions():
    measured = ModeData(Observed(np.array([[10.0, 20.0], [11.0, NAN]]), np.array([[0.1], [0.2]])))
    np.testing.assert_allclose(measured.frequency_hz, [(10 / 0.01 + 11 / 0.04) / 125, 20.0])
    np.testing.assert_allclose(measured.sd_hz, [125**-0.5, 0.1])
    eigenvalue = (2 * np.pi * 10.0) ** 2
    of_eigenvalues = ModeData(Observed(np.array([eigenvalue]), 0.02 * eigenvalue), eigenvalues=True)
    np.testing.assert_allclose(of_eigenvalues.frequency_hz, 10.0)
    np.testing.assert_allclose(of_eigenvalues.sd_hz, 0.1)  # half of 2 %


def test_which_modes_are_the_lowest_is_known():
    assert FrequencyData(np.array([1.0, 2.0]), np.array([0.1, 0.1])).lowest_hz
    assert ModeData(FREQUENCY).lowest_hz
    assert ModeData(FREQUENCY, numbers=(1, 3)).lowest_hz is None
    assert ModeData(FREQUENCY, shapes=SHAPES, match="shape").lowest_hz is None


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: ModeData(Observed(np.array([-1.0]), 0.1)), "natural frequencies: .* above 0"),
        (lambda: ModeData(Observed(np.array([[1.0, NAN]]), 0.1)), "a mode without any"),
        (lambda: ModeData(Observed(np.array([1.0]), 0.0)), "a standard deviation that is not above 0"),
        (lambda: ModeData(Observed(np.array([1.0]), np.ones(3))), "one for each value, shape"),
        (
            lambda: ModeData(FREQUENCY, Observed(np.array([0.1]), 0.1)),
            r"damping ratios: found values of shape \(1,\)",
        ),
        (lambda: ModeData(FREQUENCY, Observed(np.array([1.0, 2.0]), 0.1)), "one outside 0 to 1"),
        (lambda: ModeData(FREQUENCY, numbers=(1, 1)), "a different one"),
        (lambda: ModeData(FREQUENCY, match="shape"), 'match = "shape" without shapes'),
        (
            lambda: ModeData(FREQUENCY, shapes=ModeShapes(("2:x", "1:x"), "2:x", SHAPES.components)),
            "reference DOF",
        ),
        (
            lambda: ModeData(FREQUENCY, shapes=ModeShapes(("1:x",), ("2:x",), SHAPES.components)),
            "1 reference DOFs",
        ),
    ],
)
def test_impossible_modes_are_refused_in_one_line(made, words):
    with pytest.raises(MeasurementError, match=words) as refused:
        made()
    assert "\n" not in str(refused.value)
