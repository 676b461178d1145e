"""Modes as data: what is kept of them, and what is refused."""

import numpy as np
import pytest

from vibrecords import Antiresonances, FrequencyData, ModalConstants, ModeData, ModeShapes, Observed, split_modes
from vibrecords.errors import MeasurementError

NAN = float("nan")
FREQUENCY = Observed(np.array([[12.1, 31.4], [12.2, NAN]]), 0.1)
SHAPES = ModeShapes(("1:x", "3:x"), "2:x", Observed(np.array([[0.6, NAN], [-1.6, 0.2]]), 0.02))


def test_values_come_by_quantity_repetition_and_mode_without_those_that_were_not_observed():
    measured = ModeData(FREQUENCY, Observed(np.array([0.01, 0.02]), np.array([1e-3, 2e-3])), SHAPES)
    np.testing.assert_array_equal(measured.values, [12.1, 31.4, 12.2, 0.01, 0.02, 0.6, -1.6, 0.2])
    np.testing.assert_array_equal(measured.sd, [0.1, 0.1, 0.1, 1e-3, 2e-3, 0.02, 0.02, 0.02])
    some = [(v.quantity, v.mode, v.dof, v.repetition) for v in measured.observed[2:6]]
    assert some == [("frequency", 0, 0, 1), ("damping", 0, 0, 0), ("damping", 1, 0, 0), ("shape", 0, 0, 0)]
    assert measured.dofs == ("1:x", "3:x", "2:x")
    assert measured.references == ("2:x", "2:x")
    other = measured.with_values(2 * measured.values / 3)
    np.testing.assert_allclose(other.values, 2 * measured.values / 3)
    np.testing.assert_array_equal(other.sd, measured.sd)


def test_antiresonances_and_modal_constants_are_values_with_names_of_their_own():
    zeros = Antiresonances(("2:x", "1:x", "2:x"), Observed(np.array([[5.0, 6.0, 20.0], [5.1, NAN, 21.0]]), 0.1))
    constants = ModalConstants(("1:x", "2:x"), ("2:x", "2:x"), Observed(np.array([[0.3, 0.5], [-0.4, NAN]]), 0.02))
    measured = ModeData(FREQUENCY, zeros=zeros, constants=constants)
    assert zeros.numbers == (1, 1, 2)
    assert measured.dofs == ("1:x", "2:x")
    assert measured.value_names[3:] == (
        *("zero 1 of 2:x", "zero 1 of 1:x", "zero 2 of 2:x", "zero 1 of 2:x", "zero 2 of 2:x"),
        *("constant 1 1:x/2:x", "constant 1 2:x/2:x", "constant 2 1:x/2:x"),
    )
    np.testing.assert_array_equal(measured.values[3:], [5.0, 6.0, 20.0, 5.1, 21.0, 0.3, 0.5, -0.4])
    other = measured.with_values(1.5 * measured.values)
    np.testing.assert_array_equal(other.zeros.frequency.values, 1.5 * zeros.frequency.values)
    np.testing.assert_array_equal(other.constants.constants.values, 1.5 * measured.constants.constants.values)
    assert other.layout == measured.layout
    assert measured.layout != ModeData(FREQUENCY, zeros=zeros).layout
    kept, left_out = split_modes(measured, [2])
    assert kept.value_names == ("frequency 1", "frequency 1", *measured.value_names[3:10])
    assert left_out.value_names == ("frequency 2", "constant 2 1:x/2:x")
    assert "antiresonances of 2:x, 1:x; modal constants of 1:x/2:x, 2:x/2:x" in repr(measured)


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


@pytest.mark.parametrize(("made", "words"), [
    (lambda: ModeData(Observed(np.array([-1.0]), 0.1)), "natural frequencies: .* above 0"),
    (lambda: ModeData(Observed(np.array([[1.0, NAN]]), 0.1)), "a mode without any"),
    (lambda: ModeData(Observed(np.array([1.0]), 0.0)), "a standard deviation that is not above 0"),
    (lambda: ModeData(Observed(np.array([1.0]), np.ones(3))), "one for each value, shape"),
    (lambda: ModeData(FREQUENCY, Observed(np.array([0.1]), 0.1)), r"damping ratios: found values of shape \(1,\)"),
    (lambda: ModeData(FREQUENCY, Observed(np.array([1.0, 2.0]), 0.1)), "one outside 0 to 1"),
    (lambda: ModeData(FREQUENCY, numbers=(1, 1)), "a different one"),
    (lambda: ModeData(FREQUENCY, match="shape"), 'match = "shape" without shapes'),
    (lambda: ModeData(FREQUENCY, shapes=ModeShapes(("2:x", "1:x"), "2:x", SHAPES.components)), "reference DOF"),
    (lambda: ModeData(FREQUENCY, shapes=ModeShapes(("1:x",), ("2:x",), SHAPES.components)), "1 reference DOFs"),
    (lambda: Antiresonances("1:x", Observed(np.array([5.0, -6.0]), 0.1)), "without any, or one that is not above 0"),
    (lambda: Antiresonances("1:x", Observed(np.array([5.0, 6.0]), 0.1), (2, 2)), "a different number"),
    (lambda: Antiresonances(("1:x",), Observed(np.array([5.0, 6.0]), 0.1)), "expected one of each"),
    (lambda: ModalConstants(("1:x", "1:x"), ("2:x", "2:x"), SHAPES.components), "pairs, each once"),
    (lambda: ModalConstants(("1:x", "3:x"), ("2:x",), SHAPES.components), "pairs, each once"),
    (lambda: ModeData(FREQUENCY, constants=ModalConstants(("1:x",), ("2:x",), SHAPES.components)),
        r"modal constants: found values of shape \(2, 2\)"),
])  # fmt: skip
def test_impossible_modes_are_refused_in_one_line(made, words):
    with pytest.raises(MeasurementError, match=words) as refused:
        made()
    assert "\n" not in str(refused.value)
