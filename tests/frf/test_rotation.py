"""Rotations from translations: noise gain, bias, covariance, and that they add no independent data."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from jointbayes.errors import MeasurementError
from jointbayes.frf import FrfSet, Ports, Transform, receptance_model, rotation_from_translations, transform_frf
from jointbayes.joint import joint_matrix
from tests.conftest import CLAMP, TABLE_3, rod

SCHEMES = ("first order", "second order, end", "second order, centre")
THREE = ("11:y", "10:y", "9:y")


def scheme(name, spacing=0.04):
    return rotation_from_translations(THREE[: 2 if name == "first order" else 3], spacing, name, "x:rz")


def noise_only(covariance, outputs, inputs, lines, rng):
    """An FRF set that is nothing but noise of the given covariance over its pairs, each line an independent draw."""
    pairs = len(outputs) * len(inputs)
    root = np.linalg.cholesky(covariance)
    unit = (rng.normal(size=(lines, pairs)) + 1j * rng.normal(size=(lines, pairs))) / np.sqrt(2)
    values = (unit @ root.T).reshape(lines, len(outputs), len(inputs))
    return FrfSet(np.arange(1.0, lines + 1), values, outputs, inputs)


@pytest.mark.parametrize(
    ("name", "gain"),
    [(SCHEMES[0], np.sqrt(2)), (SCHEMES[1], np.sqrt(26) / 2), (SCHEMES[2], 1 / np.sqrt(2))],
    ids=SCHEMES,
)
def test_noise_gain_for_equal_independent_errors(name, gain):
    spacing, sigma = 0.04, 3e-7
    transform = scheme(name, spacing)
    n = len(transform.since)
    frf = FrfSet([100.0], np.ones((1, n, 1)), transform.since, ("11:y",))
    _, covariance = transform_frf(frf, np.eye(n)[None] * sigma**2, outputs=transform)
    translation, rotation = np.sqrt(np.diagonal(covariance[0]))
    assert rotation == pytest.approx(gain * sigma / spacing, rel=1e-12)
    assert translation == pytest.approx(sigma, rel=1e-12)


@pytest.mark.parametrize("name", SCHEMES)
@pytest.mark.parametrize("spacing", [0.04, -0.04])
def test_schemes_are_exact_for_the_polynomials_of_their_order(name, spacing):
    transform = scheme(name, spacing)
    at = spacing * np.arange(len(transform.since))
    order = 1 if name == "first order" else 2
    where = at[1] if name == "second order, centre" else at[0]
    for power in range(order + 1):
        slope = power * where ** (power - 1) if power else 0.0
        assert_allclose(transform.matrix @ (1.7 * at**power), [1.7 * where**power, 1.7 * slope], rtol=1e-12, atol=1e-14)
    # one power more is not exact: the order is the one claimed
    assert abs((transform.matrix @ at ** (order + 1))[1] - (order + 1) * where**order) > 1e-4 * abs(spacing) ** order


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
        transform = scheme(name, -spacing)
        found = transform.matrix @ shape[: len(transform.since)]
        assert 100 * (found[1] / slope[0] - 1) == pytest.approx(expected, abs=0.06)
        assert found[0] == shape[0]


def test_first_order_has_less_bias_than_second_order_at_the_tip_of_the_clamped_rod():
    clamped = rod().fixed(CLAMP.dofs)
    shapes = clamped.modes().shapes[clamped.index((*THREE, "11:rz")), :3]
    first, second = (
        (scheme(name, -0.0383).matrix @ shapes[: len(scheme(name).since)])[1] / shapes[3] - 1
        for name in ("first order", "second order, end")
    )
    assert (np.abs(first) < np.abs(second) / 10).all()
    assert (np.diff(np.abs(first)) > 0).all()  # and the higher the mode, the more


def test_the_centre_scheme_keeps_the_middle_station():
    transform = scheme("second order, centre")
    assert transform.to == ("10:y", "x:rz")
    assert_allclose(transform.matrix[0], [0.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def tip():
    """Receptances of the clamped rod, 40 elements, at the last two nodes: translations, and rotation of the last."""
    lines = np.arange(20.0, 2501.0, 10.0)
    stations = ("41:y", "40:y", "41:rz")
    model = receptance_model(rod(elements=40), CLAMP, Ports(lines, stations, stations))
    return FrfSet(lines, model.receptance(joint_matrix(TABLE_3))[0], stations, stations)


def difference(tip):
    """Translation and rotation at the tip by the first-order scheme on both sides: T H Tᵀ."""
    stations = ("41:y", "40:y")
    transform = rotation_from_translations(stations, -0.383 / 40, "first order", "41:rz")
    translations = tip.select(stations, stations)
    covariance = np.broadcast_to(np.eye(4), (tip.n_lines, 4, 4))
    return transform_frf(translations, covariance, transform, transform)[0]


def test_rotational_frfs_are_those_of_the_fe_model_within_a_few_per_cent(tip):
    derived = difference(tip)
    assert (derived.outputs, derived.inputs) == (("41:y", "41:rz"), ("41:y", "41:rz"))
    np.testing.assert_array_equal(derived.frf("41:y", "41:y"), tip.frf("41:y", "41:y"))
    low = tip.frequency_hz < 130.0  # up to the first resonance; above come antiresonances
    for output, tolerance in (("41:rz", 0.02), ("41:y", 0.01)):
        exact = tip.frf(output, "41:rz")
        error = np.abs(derived.frf(output, "41:rz") - exact)
        assert error.max() < tolerance * np.abs(exact).max()
        assert (error[low] < tolerance * np.abs(exact[low])).all()
    assert_allclose(derived.frf("41:rz", "41:y"), derived.frf("41:y", "41:rz"), rtol=1e-6)


def test_the_product_rule_is_rank_one_and_true_only_near_a_resonance(tip):
    """H_θθ = H_θx²/H_xx makes the 2 × 2 singular; the true one, and that of a difference scheme, is not."""
    exact = tip.select(("41:y", "41:rz"), ("41:y", "41:rz")).values
    product = exact[:, 1, 0] ** 2 / exact[:, 0, 0]
    error = np.abs(product / exact[:, 1, 1] - 1)
    resonance = np.abs(tip.frequency_hz - 121.5).argmin()
    assert error[resonance] < 0.03
    assert np.median(error) > 0.2

    def rank_one_share(matrices):
        return np.linalg.det(matrices) / (matrices[:, 0, 0] * matrices[:, 1, 1])

    assert np.median(np.abs(rank_one_share(exact))) > 0.2
    assert np.median(np.abs(rank_one_share(difference(tip).values))) > 0.2
    singular = exact.copy()
    singular[:, 1, 1] = product
    assert np.abs(rank_one_share(singular)).max() < 1e-12


def test_covariance_is_that_of_the_transformed_noise():
    rng = np.random.default_rng(5)
    outputs, inputs = THREE, ("11:y", "10:y")
    root = rng.normal(size=(6, 6)) + 1j * rng.normal(size=(6, 6))
    covariance = root @ root.conj().T + np.eye(6)
    frf = noise_only(covariance, outputs, inputs, 40_000, rng)
    rotate_outputs = scheme("second order, end", 0.4)
    rotate_inputs = rotation_from_translations(inputs, -0.7, "first order", "11:rz")
    everywhere = np.broadcast_to(covariance, (frf.n_lines, 6, 6))
    moved, predicted = transform_frf(frf, everywhere, rotate_outputs, rotate_inputs)
    assert moved.values.shape == (40_000, 2, 2)
    draws = moved.values.reshape(-1, 4)
    found = np.einsum("li,lj->ij", draws, draws.conj()) / len(draws)
    sd = np.sqrt(np.diagonal(predicted[0]).real)
    # standard error of each entry is sd_i sd_j / √n
    assert np.abs((found - predicted[0]) / np.outer(sd, sd)).max() < 4.5 / np.sqrt(len(draws))
    assert_allclose(predicted[0], predicted[0].conj().T, rtol=1e-12, atol=1e-12 * np.abs(predicted).max())
    assert np.abs(predicted[0] - np.diag(np.diagonal(predicted[0]))).max() > 0.1 * sd.min() ** 2


def test_a_rotation_beside_its_own_stations_adds_no_independent_data():
    rotation = scheme("first order")
    both = Transform(rotation.since, (*rotation.since, "x:rz"), np.vstack([np.eye(2), rotation.matrix[1]]))
    frf = FrfSet([100.0], np.ones((1, 2, 1)), rotation.since, ("11:y",))
    moved, covariance = transform_frf(frf, np.diag([1.0, 2.0])[None], both)
    size = np.sqrt(np.diagonal(covariance[0]))
    assert np.linalg.matrix_rank(covariance[0] / np.outer(size, size)) == 2
    assert moved.values.shape == (1, 3, 1)


def test_without_transforms_nothing_changes_but_the_coherence_goes():
    frf = FrfSet(
        [1.0, 2.0], np.full((2, 2, 1), 3j), ("1:y", "2:y"), ("1:y",), "mobility", np.full((2, 2, 1), 0.9), averages=4
    )
    covariance = np.broadcast_to(np.array([[2.0, 1j], [-1j, 3.0]]), (2, 2, 2))
    same, unchanged = transform_frf(frf, covariance)
    np.testing.assert_array_equal(same.values, frf.values)
    np.testing.assert_array_equal(unchanged, covariance)
    assert (same.coherence, same.quantity, same.averages) == (None, "mobility", 4)


REFUSED = {
    "unknown scheme": (lambda: rotation_from_translations(THREE[:2], 0.1, "third order", "x:rz"), "third order"),
    "three stations, first order": (lambda: rotation_from_translations(THREE, 0.1, SCHEMES[0], "x:rz"), "2 stations"),
    "two stations, second": (lambda: rotation_from_translations(THREE[:2], 0.1, SCHEMES[1], "x:rz"), "3 stations"),
    "no distance": (lambda: rotation_from_translations(THREE[:2], 0.0, SCHEMES[0], "x:rz"), "non-zero distance"),
    "NaN distance": (lambda: rotation_from_translations(THREE[:2], np.nan, SCHEMES[0], "x:rz"), "nan m apart"),
    "stations in another order": (
        lambda: transform_frf(
            FrfSet([1.0], np.ones((1, 2, 1)), ("10:y", "11:y"), ("1:y",)), np.eye(2)[None], scheme(SCHEMES[0])
        ),
        "select them first",
    ),
    "inputs that are not there": (
        lambda: transform_frf(
            FrfSet([1.0], np.ones((1, 2, 1)), ("11:y", "10:y"), ("1:y",)), np.eye(2)[None], None, scheme(SCHEMES[0])
        ),
        "select them first",
    ),
    "covariance of another shape": (
        lambda: transform_frf(FrfSet([1.0], np.ones((1, 2, 1)), THREE[:2], ("1:y",)), np.eye(2), scheme(SCHEMES[0])),
        r"expected \(1, 2, 2\)",
    ),
}


@pytest.mark.parametrize(("broken", "words"), REFUSED.values(), ids=REFUSED)
def test_what_does_not_fit_is_refused_in_one_line(broken, words):
    with pytest.raises(MeasurementError, match=words) as caught:
        broken()
    assert "\n" not in str(caught.value)
