"""Difference schemes of rotations: noise gain, order, bias at a free end, and FRFs of both sides of a tip."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import eigh

from tests.vibrecords.rod import free_rod, receptance, rows
from vibrecords import FrfData, FrfSet
from vibrecords.errors import MeasurementError
from vibrecords.rotations import Rotation, replace_stations

SCHEMES = ("first order", "second order, end", "second order, centre")
THREE = ("11:y", "10:y", "9:y")


def scheme(name, spacing=0.04):
    return Rotation("x:rz", THREE[: 2 if name == "first order" else 3], spacing, name, in_likelihood=True)


@pytest.mark.parametrize(
    ("name", "gain"),
    [(SCHEMES[0], np.sqrt(2)), (SCHEMES[1], np.sqrt(26) / 2), (SCHEMES[2], 1 / np.sqrt(2))],
    ids=SCHEMES,
)
def test_noise_gain_for_equal_independent_errors(name, gain):
    spacing, sigma = 0.04, 3e-7
    rotation = scheme(name, spacing)
    n = len(rotation.stations)
    frf = FrfSet([100.0], np.ones((1, n, 1)), rotation.stations, ("11:y",))
    moved = replace_stations(FrfData(frf, np.full((1, n, 1), sigma**2)), [rotation])
    assert np.sqrt(moved.variance[0, -1, 0]) == pytest.approx(gain * sigma / spacing, rel=1e-12)


@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize("spacing", [0.04, -0.04])
def test_schemes_are_exact_for_the_polynomials_of_their_order(name, spacing):
    rotation = scheme(name, spacing)
    at = spacing * np.arange(len(rotation.stations))
    order = 1 if name == "first order" else 2
    where = at[1] if name == "second order, centre" else at[0]
    for power in range(order + 1):
        slope = power * where ** (power - 1) if power else 0.0
        assert_allclose(rotation.weights @ (1.7 * at**power), 1.7 * slope, rtol=1e-12, atol=1e-14)
    # one power more is not exact: the order is the one claimed
    assert abs(rotation.weights @ at ** (order + 1) - (order + 1) * where**order) > 1e-4 * abs(spacing) ** order


def free_free_shape(root, x):
    """Euler-Bernoulli mode of a free beam of unit length and its slope at x, for the root βL."""
    ratio = (np.cosh(root) - np.cos(root)) / (np.sinh(root) - np.sin(root))
    z = root * np.asarray(x)
    shape = np.cosh(z) + np.cos(z) - ratio * (np.sinh(z) + np.sin(z))
    slope = root * (np.sinh(z) - np.sin(z) - ratio * (np.cosh(z) + np.cos(z)))
    return shape, slope


@pytest.mark.parametrize(
    ("root", "first_order", "second_order"),
    [(4.7300407449, -0.4, 2.1), (10.9956078380, -4.3, 16.6)],
    ids=["mode 1", "mode 3"],
)
def test_first_order_has_less_bias_than_second_order_at_a_free_end(root, first_order, second_order):
    spacing = 0.1
    shape, slope = free_free_shape(root, 1 - spacing * np.arange(3))
    for name, expected in (("first order", first_order), ("second order, end", second_order)):
        rotation = scheme(name, -spacing)
        found = rotation.weights @ shape[: len(rotation.stations)]
        assert 100 * (found / slope[0] - 1) == pytest.approx(expected, abs=0.06)


def test_first_order_has_less_bias_than_second_order_at_the_tip_of_the_clamped_rod():
    stiffness, mass = (matrix[2:, 2:] for matrix in free_rod())  # without node 1
    shapes = np.vstack([np.zeros((2, len(mass))), eigh(stiffness, mass)[1]])[rows((*THREE, "11:rz")), :3]
    first, second = (
        scheme(name, -0.0383).weights @ shapes[: len(scheme(name).stations)] / shapes[3] - 1
        for name in ("first order", "second order, end")
    )
    assert (np.abs(first) < np.abs(second) / 10).all()
    assert (np.diff(np.abs(first)) > 0).all()  # and the higher the mode, the more


@pytest.fixture(scope="module")
def tip():
    """Receptances of the clamped rod, 40 elements, at the last two nodes: translations, and rotation of the last."""
    lines = np.arange(20.0, 2501.0, 10.0)
    stations = ("41:y", "40:y", "41:rz")
    return FrfSet(lines, receptance(lines, stations, stations, elements=40), stations, stations)


def difference(tip):
    """Translation and rotation at the tip by the first-order scheme on both sides: T H Tᵀ."""
    stations = ("41:y", "40:y")
    t = np.array([[1.0, 0.0], Rotation("41:rz", stations, -0.383 / 40, "first order").weights])
    values = t @ tip.select(stations, stations).values @ t.T
    return FrfSet(tip.frequency_hz, values, ("41:y", "41:rz"), ("41:y", "41:rz"))


def test_rotational_frfs_are_those_of_the_fe_model_within_a_few_per_cent(tip):
    derived = difference(tip)
    np.testing.assert_array_equal(derived.frf("41:y", "41:y"), tip.frf("41:y", "41:y"))
    low = tip.frequency_hz < 130.0  # up to the first resonance; above come antiresonances
    for output, tolerance in (("41:rz", 0.02), ("41:y", 0.01)):
        exact = tip.frf(output, "41:rz")
        error = np.abs(derived.frf(output, "41:rz") - exact)
        assert error.max() < tolerance * np.abs(exact).max()
        assert (error[low] < tolerance * np.abs(exact[low])).all()
    assert_allclose(derived.frf("41:rz", "41:y"), derived.frf("41:y", "41:rz"), rtol=1e-6)


REFUSED = {
    "unknown scheme": ((THREE[:2], 0.1, "third order"), "third order"),
    "three stations, first order": ((THREE, 0.1, SCHEMES[0]), "2 stations"),
    "two stations, second": ((THREE[:2], 0.1, SCHEMES[1]), "3 stations"),
    "no distance": ((THREE[:2], 0.0, SCHEMES[0]), "a distance other than 0"),
    "NaN distance": ((THREE[:2], np.nan, SCHEMES[0]), "nan m apart"),
}


@pytest.mark.parametrize(("given", "message"), REFUSED.values(), ids=REFUSED)
def test_impossible_rotations_are_refused(given, message):
    with pytest.raises(MeasurementError, match=message):
        Rotation("x:rz", *given)
