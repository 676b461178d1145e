"""Modal identification: calibrated standard deviations, close modes, noise that is no mode, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.vibrecords.rod import measured, on_joint
from vibrecords import FrfSet, RelativeNoise
from vibrecords.errors import MeasurementError
from vibrecords.modal_fit import _few_of, fit_modes, identify_modes, identify_zeros
from vibrecords.modal_problem import polynomial_poles

LINES = np.arange(20.0, 2500.1, 5.0)


def beam_frf(seed, quantity="receptance", relative=0.03, floor=0.01, lines=LINES):
    rng = None if seed is None else np.random.default_rng(seed)
    return measured(lines, RelativeNoise(relative, floor), rng, quantity=quantity)


def true_frequencies():
    stiffness, mass = on_joint()
    squares = np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real
    return np.sqrt(np.sort(squares))[:3] / (2 * np.pi)


def plate_frf(rng, responses=1):
    """Twelve modes from 60 to 1540 Hz, two of them 2 % and two 1.2 % apart; and the noise's variance."""
    lines = np.arange(20.0, 1600.0, 0.5)
    frequency, damping = PLATE
    shapes = np.random.default_rng(5).standard_normal((responses, frequency.size))
    omega, omega_r = 2 * np.pi * lines[:, None], 2 * np.pi * frequency
    modal = -(omega**2) / (omega_r**2 - omega**2 + 2j * damping * omega_r * omega)
    exact = np.einsum("or,lr,r->lo", shapes, modal, shapes[0])[:, :, None]
    variance = RelativeNoise(0.02, 0.01).variance(exact)
    noise = np.sqrt(variance / 2) * (rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape))
    outputs = tuple(f"{i + 1}:y" for i in range(responses))
    return FrfSet(lines, exact + noise, outputs, ("1:y",), "accelerance"), variance


PLATE = (
    np.array([60, 130, 200, 204, 340, 415, 600, 607, 780, 1010, 1300, 1540.0]),
    np.array([10, 5, 6, 6, 20, 4, 10, 10, 3, 20, 5, 10.0]) / 1000,
)


def scores(modes, frequency, damping):
    """Errors over their stated standard deviations, frequencies first."""
    off = [(m.frequency_hz - f) / m.frequency_sd_hz for m, f in zip(modes, frequency, strict=True)]
    return [*off, *((m.damping_ratio - d) / m.damping_sd for m, d in zip(modes, damping, strict=True))]


@pytest.mark.science
@pytest.mark.parametrize(("stated", "sets"), [(True, 16), (False, 8)], ids=["variance stated", "variance unknown"])
def test_errors_are_as_large_as_stated(stated, sets):
    found = []
    for seed in range(sets):
        data = beam_frf(seed)
        modes = identify_modes(data.frf, data.variance if stated else None)
        found.append(scores(modes, true_frequencies(), [0.01] * 3))  # strict zip: three modes each time
    # 96 or 48 scores: their sd is known to 7 or 10 %, their mean to 10 or 14 %
    assert np.std(found) == pytest.approx(1.0, abs=0.3)
    assert abs(np.mean(found)) < 0.4


@pytest.mark.parametrize("seed", [1, 6, 9, 21])
def test_unknown_noise_at_the_ends_of_the_band_is_judged_from_many_lines(seed):
    """If the first line alone set the noise next to it, the smooth terms of the fit would follow it exactly."""
    fit = fit_modes(beam_frf(seed).frf)
    assert fit.doubtful == ()
    assert np.abs(scores(fit.modes, true_frequencies(), [0.01] * 3)).max() < 4


@pytest.mark.science
def test_close_modes_are_told_apart_and_none_is_invented():
    frf, variance = plate_frf(np.random.default_rng(1))
    fit = fit_modes(frf, variance)
    z = scores(fit.modes, *PLATE)
    assert np.std(z) == pytest.approx(1.0, abs=0.45)  # 24 scores
    assert fit.misfit == pytest.approx(1.0, abs=4 * np.sqrt(2 / (2 * frf.n_lines)))


def test_noise_alone_holds_no_mode():
    rng = np.random.default_rng(3)
    for _ in range(5):
        noise = rng.standard_normal((496, 1, 1)) + 1j * rng.standard_normal((496, 1, 1))
        frf = FrfSet(LINES[:496], noise, ("1:y",), ("1:y",))
        assert identify_modes(frf, np.full(noise.shape, 2.0)) == ()


def test_the_quantity_does_not_matter():
    by_quantity = [identify_modes(d.frf, d.variance) for d in (beam_frf(4, "receptance"), beam_frf(4, "mobility"))]
    data = beam_frf(4)
    converted = data.frf.converted("accelerance")
    scale = np.abs(converted.values / data.frf.values) ** 2
    by_quantity.append(identify_modes(converted, data.variance * scale))
    receptance, _, accelerance = by_quantity
    assert [len(m) for m in by_quantity] == [3, 3, 3]
    for a, b in zip(receptance, accelerance, strict=True):
        assert a.frequency_hz == pytest.approx(b.frequency_hz, abs=0.02 * a.frequency_sd_hz)
        assert a.damping_sd == pytest.approx(b.damping_sd, rel=0.01)


def test_uneven_lines_and_a_band_do_as_well():
    lines = np.sort(np.random.default_rng(6).uniform(20.0, 2500.0, 500))
    data = beam_frf(7, lines=lines)
    modes = identify_modes(data.frf, data.variance, f_min_hz=400.0, f_max_hz=1500.0)
    assert np.abs(scores(modes, true_frequencies()[1:2], [0.01])).max() < 4


def test_a_mode_just_outside_the_band_does_not_bend_those_inside():
    frf, variance = plate_frf(np.random.default_rng(2))
    fit = fit_modes(frf, variance, f_min_hz=900.0, f_max_hz=1537.0)  # the next mode is at 1540 Hz
    assert np.abs(scores(fit.modes, PLATE[0][9:11], PLATE[1][9:11])).max() < 3.5
    assert fit.misfit == pytest.approx(1.0, abs=4 * np.sqrt(2 / (2 * 1275)))


def test_the_fit_is_the_exact_frf_where_there_is_no_noise():
    exact = beam_frf(None)
    fit = fit_modes(exact.frf, exact.variance)
    assert_allclose(fit.values, exact.frf.values, atol=2e-3 * np.abs(exact.frf.values).max(), rtol=2e-2)
    assert_allclose([m.frequency_hz for m in fit.modes], true_frequencies(), rtol=2e-4)
    assert_allclose([m.damping_ratio for m in fit.modes], 0.01, rtol=2e-2)


def test_a_variance_stated_too_small_widens_the_standard_deviations():
    data = beam_frf(8)
    honest = identify_modes(data.frf, data.variance)
    wishful = identify_modes(data.frf, data.variance / 100)
    assert len(wishful) == 3
    for a, b in zip(honest, wishful, strict=True):
        assert b.frequency_sd_hz == pytest.approx(a.frequency_sd_hz, rel=0.1)


@pytest.mark.science
@pytest.mark.parametrize("averages", [3, 30])
def test_estimated_coherence_serves_as_variance(averages):
    found = []
    for seed in range(8):
        data = beam_frf(None)
        rng = np.random.default_rng(seed)
        sd = np.sqrt(data.variance * averages / 2)
        shape = (averages, *sd.shape)
        each = data.frf.values + sd * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
        mean = each.mean(axis=0)
        # H1 with a force of one: γ² = |mean|²/mean of squares
        coherence = np.abs(mean) ** 2 / (np.abs(each) ** 2).mean(axis=0)
        frf = replace(data.frf, values=mean, coherence=coherence, averages=averages)
        found.append(scores(identify_modes(frf), true_frequencies(), [0.01] * 3))
    assert np.std(found) == pytest.approx(1.0, abs=0.3)  # 48 scores: known to 10 %


@pytest.mark.parametrize(("change", "message"), [
    ({"f_min_hz": 100.0, "f_max_hz": 130.0}, "found 7 lines between 100 and 130 Hz"),
    ({"variance": np.ones(3)}, "variance of shape (3,)"),
    ({"variance": np.zeros((497, 1, 1))}, "expected positive numbers"),
])  # fmt: skip
def test_what_cannot_be_fitted_is_refused(change, message):
    arguments = {"variance": None, **change}
    with pytest.raises(MeasurementError) as caught:
        identify_modes(beam_frf(1).frf, **arguments)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_poles_of_many_frfs_are_sought_in_a_few_and_all_are_fitted_with_them(monkeypatch):
    frf, variance = plate_frf(np.random.default_rng(3), responses=12)
    assert len(_few_of((10_000, 200))) < 10 < len(_few_of((100, 200)))
    monkeypatch.setattr("vibrecords.modal_fit._MOST_VALUES", 1)
    few = fit_modes(frf, variance, f_max_hz=250.0)
    within = frf.frequency_hz <= 250.0
    assert few.values.shape == frf.values[within].shape
    assert few.misfit == pytest.approx(1.0, abs=0.05)  # of all twelve, six of which no pole was sought in
    assert max(map(abs, scores(few.modes, PLATE[0][:4], PLATE[1][:4]))) < 4


@pytest.mark.parametrize("lines", [24, 40, 100])
@pytest.mark.parametrize("coherence", [None, 0.9999])
def test_a_clean_frf_of_few_lines_has_modes_or_none_but_no_error(lines, coherence):
    """Whose coherence leaves squares over a range beyond the digits of their sum."""
    for low, high in ((100.0, 900.0), (200.0, 300.0), (5.0, 200.0), (10.0, 1500.0)):
        frequency = np.linspace(low, high, lines)
        omega, first = 2 * np.pi * frequency, 2 * np.pi * 121.5
        values = (1 / (first**2 - omega**2 + 0.02j * first * omega)).reshape(-1, 1, 1)
        known = {} if coherence is None else {"coherence": np.full(values.shape, coherence), "averages": 10}
        modes = identify_modes(FrfSet(frequency, values, ("1:y",), ("1:y",), "receptance", **known))
        assert all(np.isfinite([mode.frequency_hz, mode.damping_ratio]).all() for mode in modes)


def many_modes(rng, modes=14):
    """Three FRFs of a band that is searched in three pieces, and the truth."""
    lines = np.arange(20.0, 1500.0, 1.0)
    frequency = 40 + 1400 * (np.arange(modes) + rng.uniform(0.2, 0.8, modes)) / modes
    damping = rng.uniform(0.003, 0.01, modes)
    shapes = rng.choice([-1, 1], (3, modes)) * rng.uniform(0.5, 1.5, (3, modes))
    omega, omega_r = 2 * np.pi * lines[:, None], 2 * np.pi * frequency
    modal = -(omega**2) / (omega_r**2 - omega**2 + 2j * damping * omega_r * omega)
    exact = (modal @ (shapes * shapes[:1]).T)[:, :, None]
    variance = RelativeNoise(0.02, 0.01).variance(exact)
    noise = np.sqrt(variance / 2) * (rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape))
    return FrfSet(lines, exact + noise, ("1:y", "2:y", "3:y"), ("1:y",), "accelerance"), variance, frequency, damping


def test_a_band_of_many_modes_that_is_searched_in_pieces_has_the_modes_and_errors_of_the_whole(monkeypatch):
    frf, variance, frequency, damping = many_modes(np.random.default_rng(1))
    pieces = fit_modes(frf, variance)
    assert np.std(scores(pieces.modes, frequency, damping)) == pytest.approx(1.0, abs=0.4)  # 28 scores
    assert pieces.misfit == pytest.approx(1.0, abs=0.05)
    assert pieces.doubtful == ()
    monkeypatch.setattr("vibrecords.modal_problem._IN_A_PIECE", 100)
    whole = fit_modes(frf, variance)
    for a, b in zip(pieces.modes, whole.modes, strict=True):
        assert a.frequency_hz == pytest.approx(b.frequency_hz, abs=0.02 * b.frequency_sd_hz)
        assert a.damping_ratio == pytest.approx(b.damping_ratio, abs=0.02 * b.damping_sd)
    assert_allclose(pieces.covariance, whole.covariance, rtol=1e-2, atol=1e-3 * np.abs(whole.covariance).max())


def test_many_lines_are_fitted_in_sub_bands_with_errors_as_stated_and_values_on_all_lines(monkeypatch):
    """Of 6400 lines no fit has more than a sub-band and what it overlaps; where one ends nothing resonates."""
    frequency, damping = np.linspace(70, 1550, 13), np.tile([0.004, 0.01, 0.002], 5)[:13]
    lines, rng = np.arange(20.0, 1620.0, 0.25), np.random.default_rng(8)
    omega, omega_r = lines[:, None], frequency
    modal = -(omega**2) / (omega_r**2 - omega**2 + 2j * damping * omega_r * omega)
    exact = (modal @ rng.uniform(0.5, 1.5, (13, 2)))[:, :, None]
    variance = RelativeNoise(0.02, 0.01).variance(exact)
    noise = np.sqrt(variance / 2) * (rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape))
    frf = FrfSet(lines, exact + noise, ("1:y", "2:y"), ("1:y",), "accelerance")
    sizes = []

    def counted(lines_hz, *arguments):
        sizes.append(lines_hz.size)
        return polynomial_poles(lines_hz, *arguments)

    monkeypatch.setattr("vibrecords.modal_fit.polynomial_poles", counted)
    fit = fit_modes(frf, variance)
    assert len(sizes) == 6
    assert max(sizes) < 2200
    assert len(fit.modes) == 13
    assert np.abs(scores(fit.modes, frequency, damping)).max() < 4
    assert fit.values.shape == frf.values.shape
    assert np.abs(fit.values - exact).max() < 0.05 * np.abs(exact).max()
    assert fit.misfit == pytest.approx(1, abs=0.05)
    sd = [m.frequency_sd_hz for m in fit.modes] + [m.damping_sd for m in fit.modes]
    assert np.sqrt(np.diag(fit.covariance)) == pytest.approx(sd)
    assert np.count_nonzero(fit.covariance[:13, :13]) < 13 * 13  # nothing is said between sub-bands
    assert {round(fit.frequency_hz, 6) for fit in identify_modes(frf, variance)} == {
        round(mode.frequency_hz, 6) for mode in fit.modes
    }
    # one fit of all lines knows a little more: what those far from a mode tell of it
    monkeypatch.setattr("vibrecords.modal_fit._MOST_LINES", lines.size)
    whole = fit_modes(frf, variance)
    assert len(sizes) == 6 + 6 + 1
    wider = [m.frequency_sd_hz / o.frequency_sd_hz for m, o in zip(fit.modes, whole.modes, strict=True)]
    assert 0.95 < min(wider) <= np.median(wider) < 1.15


def test_zeros_of_many_lines_are_those_of_a_drive_point():
    lines = np.arange(20.0, 420.0, 0.1)
    omega, omega_r = lines[:, None], np.array([80.0, 300.0])
    values = (-(omega**2) / (omega_r**2 - omega**2 + 2j * 0.004 * omega_r * omega)).sum(axis=1)[:, None, None]
    (fit,) = identify_zeros(
        FrfSet(lines, values, ("1:y",), ("1:y",), "accelerance"), np.full(values.shape, 1e-6)
    ).values()
    # of equal residues of the accelerance: the root of the mean of both squares
    assert [mode.frequency_hz for mode in fit.modes] == [pytest.approx(np.sqrt((80**2 + 300**2) / 2), rel=1e-3)]


def test_lines_are_joined_where_a_resonance_has_far_more_than_show_its_shape(monkeypatch):
    """Sub-bands of 1200 lines would be narrower than the third mode."""
    sizes = []

    def counted(frequency_hz, *rest):
        sizes.append(frequency_hz.size)
        return polynomial_poles(frequency_hz, *rest)

    monkeypatch.setattr("vibrecords.modal_fit.polynomial_poles", counted)
    lines, frequency, damping = np.linspace(20.0, 2500.0, 40_001), np.array([121.5, 752.4, 2063.7]), 0.03 * np.ones(3)
    omega = lines[:, None]
    modal = -(omega**2) / (frequency**2 - omega**2 + 2j * damping * frequency * omega)
    exact = (modal * [1.0, 0.8, 1.2]).sum(axis=1)[:, None, None]
    variance, rng = RelativeNoise(0.02, 0.01).variance(exact), np.random.default_rng(1)
    noise = np.sqrt(variance / 2) * (rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape))
    fit = fit_modes(FrfSet(lines, exact + noise, ("1:y",), ("1:y",), "accelerance"), variance)
    assert sum(sizes) < 8000
    assert np.abs(scores(fit.modes, frequency, damping)).max() < 4
    assert max(mode.frequency_sd_hz / mode.frequency_hz for mode in fit.modes) < 2e-4
    assert np.abs(fit.values - exact).max() < 0.01 * np.abs(exact).max()
    assert fit.misfit == pytest.approx(1, abs=0.05)
