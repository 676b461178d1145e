"""FRF sets: read-only data with labels, exact conversion between quantities, and what they refuse."""

import dataclasses
import itertools
from typing import get_args

import numpy as np
import pytest

from tests.one_line import refused
from vibrecords import FrfSet, Quantity, quantity_factor
from vibrecords.errors import MeasurementError

LINES = np.array([10.0, 20.0, 35.0, 50.0])
OUTPUTS, INPUTS = ("11:y", "6:y", "1:y"), ("11:y", "3:y")


def frf_set(**changes):
    rng = np.random.default_rng(1)
    shape = (4, 3, 2)
    values = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    frf = FrfSet(LINES, values, OUTPUTS, INPUTS, "mobility", rng.uniform(size=shape), 5)
    return dataclasses.replace(frf, **changes)


def test_arrays_are_copies_that_nobody_can_write_to():
    frequency, values, coherence = LINES.copy(), np.ones((4, 3, 2), complex), np.full((4, 3, 2), 0.5)
    frf = frf_set(frequency_hz=frequency, values=values, coherence=coherence)
    frequency[0], values[0, 0, 0], coherence[0, 0, 0] = 9.0, 2.0, 0.1
    assert (frf.frequency_hz[0], frf.values[0, 0, 0], frf.coherence[0, 0, 0]) == (10.0, 1.0, 0.5)
    for derived in (frf, frf.select(OUTPUTS[:2], INPUTS), frf.converted("receptance")):
        for array in (derived.frequency_hz, derived.values, derived.coherence):
            with pytest.raises(ValueError, match="read-only"):
                array[0] = 0.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        frf.averages = 7


def test_lists_become_arrays_and_tuples():
    frf = FrfSet([1.0, 2.0], [[[1]], [[2j]]], ["1:y"], ["2:y"])
    assert (frf.outputs, frf.inputs, frf.n_lines, frf.values.dtype) == (("1:y",), ("2:y",), 2, np.complex128)


def test_one_frf_is_found_by_its_labels():
    frf = frf_set()
    np.testing.assert_array_equal(frf.frf("6:y", "3:y"), frf.values[:, 1, 1])
    np.testing.assert_array_equal(frf.frf("1:y", "11:y"), frf.values[:, 2, 0])


def test_selection_keeps_the_given_order_and_everything_else():
    frf = frf_set()
    chosen = frf.select(("1:y", "11:y"), ("3:y",))
    assert (chosen.outputs, chosen.inputs) == (("1:y", "11:y"), ("3:y",))
    np.testing.assert_array_equal(chosen.values[..., 0], frf.values[:, [2, 0], 1])
    np.testing.assert_array_equal(chosen.coherence[..., 0], frf.coherence[:, [2, 0], 1])
    assert (chosen.quantity, chosen.averages, chosen.n_lines) == ("mobility", 5, 4)
    assert frf_set(coherence=None).select(("1:y",), ("3:y",)).coherence is None


def test_mobility_is_jw_and_accelerance_minus_w_squared_times_receptance():
    receptance = frf_set(quantity="receptance")
    omega = (2 * np.pi * LINES)[:, None, None]
    mobility, accelerance = receptance.converted("mobility"), receptance.converted("accelerance")
    np.testing.assert_allclose(mobility.values, 1j * omega * receptance.values, rtol=1e-15)
    np.testing.assert_allclose(accelerance.values, -(omega**2) * receptance.values, rtol=1e-15)
    np.testing.assert_allclose(mobility.converted("accelerance").values, accelerance.values, rtol=1e-15)
    assert (mobility.quantity, accelerance.quantity) == ("mobility", "accelerance")
    np.testing.assert_array_equal(mobility.coherence, receptance.coherence)


@pytest.mark.parametrize(("since", "to"), list(itertools.product(get_args(Quantity), repeat=2)))
def test_conversion_leads_back(since, to):
    frf = frf_set(quantity=since)
    back = frf.converted(to).converted(since)
    assert back.quantity == since
    np.testing.assert_allclose(back.values, frf.values, rtol=1e-15)
    powers = [("receptance", "mobility", "accelerance").index(quantity) for quantity in (since, to)]
    expected = (2j * np.pi * LINES) ** (powers[1] - powers[0])
    np.testing.assert_allclose(quantity_factor(LINES, to, since), expected, rtol=1e-14)


def with_one(value, at=(1, 2, 0), dtype=complex):
    array = np.full((4, 3, 2), 0.5, dtype)
    array[at] = value
    return array


REFUSED = {
    "NaN": (lambda: frf_set(values=with_one(np.nan)), "20 Hz, output '1:y'"),
    "infinity": (lambda: frf_set(values=with_one(complex(0, np.inf))), "NaN or infinity"),
    "NaN frequency": (lambda: frf_set(frequency_hz=[10.0, np.nan, 30.0, 40.0]), "finite frequencies"),
    "infinite frequency": (lambda: frf_set(frequency_hz=[10.0, 20.0, 30.0, np.inf]), "finite frequencies"),
    "line at zero": (lambda: frf_set(frequency_hz=[0.0, 20, 30, 40]), "at 0 Hz; expected lines above 0 Hz; drop it"),
    "negative frequency": (lambda: frf_set(frequency_hz=[-1.0, 20.0, 30.0, 40.0]), "above 0 Hz"),
    "double line": (lambda: frf_set(frequency_hz=[10.0, 20.0, 20.0, 40.0]), "20 Hz after 20 Hz (line 3)"),
    "falling lines": (lambda: frf_set(frequency_hz=[10.0, 20.0, 30.0, 25.0]), "25 Hz after 30 Hz (line 4)"),
    "no lines": (lambda: frf_set(frequency_hz=[], values=np.ones((0, 3, 2)), coherence=None), "no frequency lines"),
    "lines in a matrix": (lambda: frf_set(frequency_hz=LINES[:, None]), "one-dimensional"),
    "too few values": (lambda: frf_set(values=np.ones((3, 3, 2))), "(3, 3, 2); expected (4, 3, 2)"),
    "outputs and inputs swapped": (lambda: frf_set(values=np.ones((4, 2, 3))), "expected (4, 3, 2)"),
    "output twice": (lambda: frf_set(outputs=("11:y", "6:y", "11:y")), "each label once"),
    "input twice": (lambda: frf_set(inputs=("11:y", "11:y")), "each label once"),
    "unknown quantity": (lambda: frf_set(quantity="compliance"), "found quantity 'compliance'"),
    "coherence above one": (lambda: frf_set(coherence=with_one(1.0001, dtype=float)), "coherence in [0, 1]"),
    "negative coherence": (lambda: frf_set(coherence=with_one(-0.0001, dtype=float)), "coherence in [0, 1]"),
    "NaN coherence": (lambda: frf_set(coherence=with_one(np.nan, dtype=float)), "coherence in [0, 1]"),
    "coherence of another shape": (lambda: frf_set(coherence=np.ones((4, 3, 1))), "of shape (4, 3, 2)"),
    "no average": (lambda: frf_set(averages=0), "found 0 averages"),
    "absent output": (lambda: frf_set().select(("2:y",), INPUTS), "found DOF '2:y'"),
    "absent input": (lambda: frf_set().select(OUTPUTS, ("6:y",)), "one of 11:y, 3:y"),
    "output selected twice": (lambda: frf_set().select(("6:y", "6:y"), INPUTS), "each label once"),
    "absent FRF": (lambda: frf_set().frf("11:y", "9:y"), "found DOF '9:y'"),
}


@pytest.mark.parametrize(("broken", "words"), REFUSED.values(), ids=REFUSED)
def test_impossible_sets_are_refused_in_one_line(broken, words):
    refused(broken, MeasurementError, words)


def test_the_limits_of_coherence_and_averages_are_possible():
    coherence = with_one(1.0, dtype=float)
    coherence[0, 0, 0] = 0.0
    assert frf_set(coherence=coherence, averages=1).averages == 1
