"""What looks like a mode and is none is left out of the modal fit, and named; antiresonances are found likewise."""

from dataclasses import replace

import numpy as np
import pytest
import scipy

from tests.vibrecords.test_modal_fit import PLATE, beam_frf, plate_frf, scores, true_frequencies
from vibrecords import FrfData, FrfSet, RelativeNoise
from vibrecords.assemble import _modes as assembled_modes
from vibrecords.errors import MeasurementError
from vibrecords.formats import records_of_frf
from vibrecords.inspection import contents_of_records, resonances_text, with_resonances
from vibrecords.measurement_plan import MeasurementPlan
from vibrecords.modal_fit import fit_modes, identify_modes, identify_zeros

RATE, SAMPLES = 2048.0, 16384


def frf_of_hits(responses, forces):
    """H1 and coherence of impulses and what follows them, shape (hits, samples) each."""
    x, y = np.fft.rfft(forces), np.fft.rfft(responses)
    lines = np.fft.rfftfreq(SAMPLES, 1 / RATE)
    used = (lines > 20) & (lines < 400)
    square = np.mean(np.abs(x) ** 2, axis=0)
    h1 = np.mean(y * x.conj(), axis=0) / square
    coherence = np.clip(np.abs(h1) ** 2 * square / np.mean(np.abs(y) ** 2, axis=0), 1e-12, 1)
    values, coherence = (x[used].reshape(-1, 1, 1) for x in (h1, coherence))
    return FrfSet(lines[used], values, ("1:y",), ("1:y",), coherence=coherence, averages=len(forces))


def hits(fall_hz, spread=0.3, count=5, tone=0.0):
    """Ring-downs of a mode at 80 Hz whose frequency falls with the square of its amplitude, and of one at 210 Hz.

    The phase is that of the averaged equation of an oscillator with a cubic spring.
    """
    rng = np.random.default_rng(1)
    time = np.arange(SAMPLES) / RATE
    decay = 0.003 * 2 * np.pi * 80
    forces, responses = np.zeros((count, SAMPLES)), np.empty((count, SAMPLES))
    for force, response in zip(forces, responses, strict=True):
        level = rng.uniform(1 - spread, 1 + spread)
        force[0] = level * RATE
        fallen = fall_hz * level**2 * (1 - np.exp(-2 * decay * time)) / (2 * decay)
        response[:] = level * np.exp(-decay * time) * np.sin(2 * np.pi * (80 * time - fallen))
        response += level * 0.5 * np.exp(-0.01 * 2 * np.pi * 210 * time) * np.sin(2 * np.pi * 210 * time)
        response += tone * np.cos(2 * np.pi * 150.03 * time + rng.uniform(0, 6))
        response += 1e-4 * rng.standard_normal(SAMPLES)
    return frf_of_hits(responses, forces)


@pytest.mark.parametrize(("fall_hz", "spread", "count"), [(1.0, 0.3, 5), (1.0, 0.05, 3)])
def test_one_resonance_that_takes_several_poles_is_named_nonlinear_and_no_mode(fall_hz, spread, count):
    fit = fit_modes(hits(fall_hz, spread, count))
    assert [round(mode.frequency_hz) for mode in fit.modes] == [210]
    (doubt,) = fit.doubtful
    assert 78 < doubt.frequency_hz < 80.1
    assert doubt.reason.startswith("nonlinear? One resonance between 77.")
    assert "coherence dip" in doubt.reason


def leaking_blocks(seed):
    """H1 and coherence of random blocks with a Hann window, of modes at 80 Hz (0.1 %) and 210 Hz (1 %)."""
    rng, count = np.random.default_rng(seed), 20
    force = rng.standard_normal(SAMPLES * (count + 4))
    response = np.zeros(force.size)
    for at, damping, size in ((80, 0.001, 1.0), (210, 0.01, 0.5)):
        turn, fall = 2 * np.pi * at / RATE, np.exp(-damping * 2 * np.pi * at / RATE)
        response += scipy.signal.lfilter([0, size * fall * np.sin(turn)], [1, -2 * fall * np.cos(turn), fall**2], force)
    response += 1e-3 * response.std() * rng.standard_normal(force.size)
    settled = slice(4 * SAMPLES, None)
    window = scipy.signal.get_window("hann", SAMPLES)
    return frf_of_hits(*(record[settled].reshape(count, SAMPLES) * window for record in (response, force)))


def test_a_coherence_dip_whose_poles_are_within_some_lines_is_leakage_and_the_mode_stays():
    frf = leaking_blocks(1)
    at = np.abs(frf.frequency_hz - 80).argmin()
    assert frf.coherence[at - 2 : at + 3].min() < 0.9 < frf.coherence[at + 40, 0, 0]
    fit = fit_modes(frf)
    assert [round(mode.frequency_hz, 1) for mode in fit.modes] == [80.0, 210.0]
    (doubt,) = fit.doubtful
    assert doubt.reason.startswith("a second pole within the half-power width of the mode at 80.0")
    assert doubt.reason.endswith("Hz: leakage")


def test_the_same_resonance_is_a_mode_where_its_frequency_stays():
    fit = fit_modes(hits(0.0))
    assert [round(mode.frequency_hz) for mode in fit.modes] == [80, 210]
    assert fit.doubtful == ()


def test_a_frequency_that_moves_by_less_than_lines_can_tell_is_one_mode_with_a_wider_deviation():
    still, moving = fit_modes(hits(0.0)), fit_modes(hits(0.02))
    assert len(moving.modes) == 2
    assert moving.modes[0].frequency_sd_hz > 5 * still.modes[0].frequency_sd_hz
    assert abs(moving.modes[0].frequency_hz - 80) < 0.04


def test_a_tone_in_the_response_is_no_mode():
    fit = fit_modes(hits(0.0, tone=1e-2))
    assert [round(mode.frequency_hz) for mode in fit.modes] == [80, 210]
    (doubt,) = fit.doubtful
    assert doubt.frequency_hz == pytest.approx(150.03, abs=0.01)
    assert doubt.reason == "hardly coherent with the force: a tone, noise, or a zero of the force"


def test_one_line_that_stands_out_is_no_mode():
    frf, variance = plate_frf(np.random.default_rng(3))
    values = frf.values.copy()
    values[np.searchsorted(frf.frequency_hz, 900.0)] *= 3
    fit = fit_modes(replace(frf, values=values), variance, f_min_hz=500.0, f_max_hz=1200.0)
    assert len(fit.modes) == 4
    (doubt,) = fit.doubtful
    assert doubt.frequency_hz == pytest.approx(900.0, abs=0.1)
    assert doubt.reason.startswith("stands on 3 lines")


def test_what_one_frf_of_several_hardly_shows_is_no_mode():
    frf, variance = plate_frf(np.random.default_rng(5), responses=3)
    lines, at, width = frf.frequency_hz, 900.0, 8.0
    bump = at**2 / (at**2 - lines**2 + 1j * width * lines)
    values = frf.values.copy()
    sd = np.sqrt(variance[np.searchsorted(lines, at), 1, 0])
    values[:, 1, 0] += 2.5 * sd * bump / np.abs(bump).max()
    fit = fit_modes(replace(frf, values=values), variance, f_min_hz=700.0, f_max_hz=1100.0)
    assert [round(mode.frequency_hz) for mode in fit.modes] == [780, 1010]
    assert [doubt.reason for doubt in fit.doubtful] == ["only one of 3 FRFs shows it, and hardly"]


def test_two_poles_within_a_half_power_width_are_two_modes_where_the_data_insist():
    frf, variance = plate_frf(np.random.default_rng(4))
    fit = fit_modes(frf, variance, f_min_hz=500.0, f_max_hz=700.0)
    at, width = np.array([mode.frequency_hz for mode in fit.modes]), 2 * PLATE[1][6] * PLATE[0][6]
    assert at.size == 2
    assert at[1] - at[0] < width


def modal_sum(*modes, noise):
    """FRFs of modes of unit height, each of a frequency, a damping and its share of each FRF."""
    rng, lines = np.random.default_rng(1), np.arange(20.0, 400.0, 0.5)
    exact = sum(
        np.outer(-2 * zeta * lines**2 / (f**2 - lines**2 + 2j * zeta * f * lines), np.atleast_1d(shares))
        for f, zeta, shares in modes
    )
    values = exact + noise * (rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape))
    outputs = tuple(f"{k + 1}:z" for k in range(values.shape[1]))
    return FrfSet(lines, values[:, :, None], outputs, ("1:z",), "accelerance")


@pytest.mark.parametrize(
    ("apart", "shares", "count"),
    [(0.45, 0.8, 1), (0.7, 0.8, 2), (0.5, [0.8, -0.8], 2)],
    ids=["0.9 lines", "1.4 lines", "a line, with other shapes"],
)
def test_two_poles_that_lines_do_not_tell_apart_are_one_mode_unless_their_shapes_differ(apart, shares, count):
    frf = modal_sum((100.1, 0.0015, np.ones(np.size(shares))), (100.1 + apart, 0.0015, shares), noise=1e-4)
    fit = fit_modes(frf)
    assert len(fit.modes) == count
    assert all(100 < mode.frequency_hz < 101 for mode in fit.modes)
    assert [doubt.reason.endswith("one resonance") for doubt in fit.doubtful] == [True] * (2 - count)


@pytest.mark.parametrize(
    ("beside", "level_db", "shares", "is_mode"),
    [
        (108.0, -71, 1.0, False),
        (92.0, -71, 1.0, False),
        (108.0, -67, 1.0, False),
        (108.0, -63, 1.0, True),
        (82.0, -71, 1.0, False),  # 22 % from it, the resonance over the sideband
        (78.0, -71, 1.0, True),  # 28 %
        (108.0, -71, [1.0, 100.0], True),  # one FRF shows it better
    ],
)
def test_what_is_65_db_below_a_resonance_beside_it_is_a_sideband(beside, level_db, shares, is_mode):
    weak = 10 ** (level_db / 20) * np.atleast_1d(shares)
    fit = fit_modes(modal_sum((100.0, 0.004, np.ones(weak.size)), (beside, 0.004, weak), noise=1e-6))
    assert [round(mode.frequency_hz) for mode in fit.modes] == sorted([100, *[round(beside)] * is_mode])
    assert [doubt.reason for doubt in fit.doubtful] == ["more than 65 dB below the resonance at 100 Hz: a sideband"] * (
        not is_mode
    )


@pytest.mark.science
def test_the_covariance_holds_the_standard_deviations_and_the_correlations():
    truth = np.concatenate([true_frequencies(), [0.01] * 3])
    squares = []
    for seed in range(12):
        data = beam_frf(seed)
        fit = fit_modes(data.frf, data.variance)
        modes = fit.modes
        sds = [mode.frequency_sd_hz for mode in modes] + [mode.damping_sd for mode in modes]
        assert np.sqrt(np.diag(fit.covariance)) == pytest.approx(sds)
        off = np.array([mode.frequency_hz for mode in modes] + [mode.damping_ratio for mode in modes]) - truth
        squares.append(off @ np.linalg.solve(fit.covariance, off))
    # χ² of 72 degrees of freedom, an sd of 12; covariance is never smaller than the Jacobian's
    assert 40 < np.sum(squares) < 110


def chain(seed):
    """Mass and stiffness of a chain of four masses between walls, proportionally damped, C = 5e-6 K."""
    rng = np.random.default_rng(seed)
    springs = rng.uniform(0.5, 2, 5) * 1e6
    stiffness = np.diag(springs[:-1] + springs[1:]) - np.diag(springs[1:-1], 1) - np.diag(springs[1:-1], -1)
    return np.diag(rng.uniform(0.5, 2, 4)), stiffness


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.science)])
@pytest.mark.parametrize("known", [True, False], ids=["variance stated", "variance unknown"])
def test_zeros_of_a_drive_point_are_the_frequencies_of_the_structure_held_there(seed, known):
    mass, stiffness = chain(seed)
    lines = np.arange(40.0, 450.0, 0.25)
    omega = 2 * np.pi * lines[:, None, None]
    exact = np.linalg.inv((1 + 5e-6j * omega) * stiffness - omega**2 * mass)[:, :2, :2]
    variance = RelativeNoise(0.01, 0.003).variance(exact)
    rng = np.random.default_rng(seed)
    noise = np.sqrt(variance / 2) * (rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape))
    frf = FrfSet(lines, exact + noise, ("1:y", "2:y"), ("1:y", "2:y"))
    fits = identify_zeros(frf, variance if known else None)
    assert list(fits) == ["1:y", "2:y"]
    for dof, fit in enumerate(fits.values()):
        rest = np.delete(np.arange(4), dof)
        cut = np.ix_(rest, rest)
        held = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(mass[cut], stiffness[cut])).real))
        assert np.abs(scores(fit.modes, held / (2 * np.pi), 2.5e-6 * held)).max() < 4
        assert fit.covariance.shape == (6, 6)


def test_zeros_do_not_depend_on_the_quantity_and_need_a_drive_point():
    data = beam_frf(4)
    scale = np.abs(data.frf.converted("mobility").values / data.frf.values) ** 2
    (first,) = identify_zeros(data.frf, data.variance).values()
    (second,) = identify_zeros(data.frf.converted("mobility"), data.variance * scale).values()
    assert [m.frequency_hz for m in first.modes] == pytest.approx([m.frequency_hz for m in second.modes])
    assert len(first.modes) >= 2
    assert identify_zeros(replace(data.frf, outputs=("2:y",))) == {}
    with pytest.raises(MeasurementError, match=r"variance of shape \(3,\)"):
        identify_zeros(data.frf, np.ones(3))


def test_inspection_names_what_is_left_out():
    frf = hits(1.0)
    lines = [*resonances_text(with_resonances(contents_of_records(records_of_frf(frf))))]
    assert "Left out of the resonances" in lines
    assert any("Hz: nonlinear? One resonance" in line for line in lines)
    assert [round(mode.frequency_hz) for mode in identify_modes(frf)] == [210]


def test_data_of_files_note_what_was_not_counted_as_a_mode():
    frf = hits(1.0)
    modes, (note,) = assembled_modes(FrfData(frf, np.ones(frf.values.shape)), MeasurementPlan({}, variance=None))
    assert [round(mode.frequency_hz) for mode in modes] == [210]
    assert note.startswith("Not counted as a mode: 7")
    assert note.endswith("a coherence dip; measure it at a lower level.")
