"""Rotations from stations: each measurement counts once, and the joint's own motion can be assembled."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import eigh

from tests.vibrecords.rod import free_rod, receptance, rows
from vibrecords import FrfData, FrfSet
from vibrecords.errors import MeasurementError
from vibrecords.rotations import Rotation, joint_frf_set, replace_stations

JOINT = ("1:y", "1:rz")
LINES = np.linspace(30.0, 800.0, 40)
SPACING = 0.383 / 40
FIRST = Rotation("1:rz", ("1:y", "2:y"), SPACING, "first order", True)
CENTRE = Rotation("2:rz", ("1:y", "2:y", "3:y"), SPACING, "second order, centre", True)


def measured(outputs=("41:y", "1:y", "2:y", "3:y"), inputs=("41:y",), elements=40) -> FrfSet:
    soft = np.array([[2e7, 3e4], [3e4, 1e5]])
    return FrfSet(LINES, receptance(LINES, outputs, inputs, elements=elements, joint=soft), outputs, inputs)


def moved(frf, *rotations) -> FrfData:
    """Of variances of one."""
    return replace_stations(FrfData(frf, np.ones(frf.values.shape)), rotations)


def test_a_rotation_replaces_the_stations_it_was_made_from_and_leaves_the_others():
    frf = measured()
    found = moved(frf, FIRST)
    assert found.frf.outputs == ("41:y", "3:y", "1:rz")
    slope = (frf.frf("2:y", "41:y") - frf.frf("1:y", "41:y")) / SPACING
    np.testing.assert_allclose(found.frf.frf("1:rz", "41:y"), slope)
    np.testing.assert_allclose(found.variance[0, :, 0], [1, 1, 2 / SPACING**2])


def test_a_station_of_no_weight_stays():
    found = moved(measured(), CENTRE)
    assert found.frf.outputs == ("41:y", "2:y", "2:rz")
    np.testing.assert_allclose(found.variance[0, :, 0], [1, 1, 1 / (2 * SPACING**2)])


@pytest.mark.parametrize("rotation", [FIRST, CENTRE])
def test_the_variance_is_the_diagonal_of_the_covariance_and_nothing_off_it_is_lost(rotation):
    frf = measured()
    rng = np.random.default_rng(1)
    variance = rng.uniform(0.5, 2.0, frf.values.shape)
    found = replace_stations(FrfData(frf, variance), [rotation])
    both = np.array([np.eye(4)[frf.outputs.index(o)] for o in found.frf.outputs[:-1]])
    weights = np.zeros(4)
    weights[[frf.outputs.index(s) for s in rotation.stations]] = rotation.weights
    whole = np.vstack([both, weights])
    covariance = whole @ (variance[:, :, 0, None] * np.eye(4)) @ whole.T
    np.testing.assert_allclose(covariance, found.variance[:, :, 0, None] * np.eye(len(whole)), rtol=1e-12)


def test_two_rotations_from_one_station_are_refused():
    other = Rotation("2:rz", ("2:y", "3:y"), SPACING, "first order", True)
    with pytest.raises(MeasurementError, match="found station 2:y in 1:rz as well"):
        moved(measured(), FIRST, other)


def test_rotations_that_are_not_data_leave_the_data_alone():
    data = FrfData(measured(), np.ones(measured().values.shape))
    assert replace_stations(data, [Rotation("1:rz", ("1:y", "2:y"), SPACING, "first order")]) is data


def test_frfs_at_the_joint_are_measured_translations_and_rotations_from_stations():
    frf = measured(("41:y", "1:y", "2:y", "3:y"))
    end = Rotation("1:rz", ("1:y", "2:y", "3:y"), SPACING, "second order, end")
    found = joint_frf_set(frf, [end], ("41:y",), JOINT)
    assert found.outputs == ("41:y", "1:y", "1:rz")
    true = measured(("41:y", "1:y", "1:rz"))
    np.testing.assert_array_equal(found.values[:, :2], true.values[:, :2])
    np.testing.assert_array_equal(found.values[:, 2], end.compute_frf(frf).values[:, 0])


def errors_of(scheme, count, *, at_free_end):
    """Relative errors of a derived rotation for stations 9.6 mm apart and half as far."""
    errors = []
    for elements in (40, 80):
        nodes = [elements + 1 - i if at_free_end else 1 + i for i in range(count)]
        force = ("1:y" if at_free_end else f"{elements + 1}:y",)
        spacing = (-1 if at_free_end else 1) * 0.383 / elements
        rotation = Rotation(f"{nodes[0]}:rz", tuple(f"{node}:y" for node in nodes), spacing, scheme)
        true = measured((rotation.dof,), force, elements).values
        found = rotation.compute_frf(measured(rotation.stations, force, elements)).values
        errors.append(np.linalg.norm(found - true) / np.linalg.norm(true))
    return errors


@pytest.mark.parametrize(("scheme", "count", "least"), [("first order", 2, 1.7), ("second order, end", 3, 3.5)])
def test_stations_closer_together_come_nearer_to_the_rotation_of_a_free_end(scheme, count, least):
    far, near = errors_of(scheme, count, at_free_end=True)
    assert near < 0.005
    assert far / near > least


def test_at_a_joint_that_carries_shear_the_shear_angle_remains_however_close_the_stations():
    far, near = errors_of("second order, end", 3, at_free_end=False)
    assert 0.01 < near < 0.05
    assert far / near < 1.5


@pytest.mark.parametrize(("outputs", "rotations", "message"), [
    (("41:y", "1:y"), [], r'no FRF of 1:rz, a DOF of the joint.*\[data.rotations."1:rz"\]'),
    (("41:y", "2:y"), [], "no FRF of 1:y, a DOF of the joint.*measure it"),
    (("41:y", "1:y"), [FIRST], "no FRF of station 2:y"),
])  # fmt: skip
def test_what_the_iteration_lacks_is_named(outputs, rotations, message):
    with pytest.raises(MeasurementError, match=message):
        joint_frf_set(measured(outputs), rotations, ("41:y",), JOINT)


def test_a_rotation_measured_and_derived_is_refused():
    with pytest.raises(MeasurementError, match="found it among the measured DOFs"):
        moved(measured(("41:y", "1:y", "2:y", "1:rz")), FIRST)


@pytest.mark.parametrize(("dof", "stations", "axis", "told"), [
    ("1:rz", ("1:y", "2:z"), "x", "move in y and z for rz; expected all of them in y"),
    ("1:rz", ("1:z", "2:z"), "x", "move in z for rz; expected all of them in y"),
    ("1:rx", ("1:y", "2:y"), "x", "move in y for rx; expected stations along an axis that the rotation turns"),
    ("1:rz", ("1:y", "2:y"), "y", "move in y for rz; expected all of them in x"),
])  # fmt: skip
def test_stations_that_a_rotation_does_not_move_are_refused(dof, stations, axis, told):
    with pytest.raises(MeasurementError, match=told):
        Rotation(dof, stations, SPACING, "first order", axis=axis)


# ---- difference schemes: noise gain, order, bias at a free end, and FRFs of both sides of a tip

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
