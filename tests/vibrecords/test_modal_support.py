"""A mode needs support: zeros of the force, smooth noise, drift and undriven bands hold none; errors are as stated."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.modal_fit import analyse
from benchmarks.virtual_modal_tests import EXPONENTIAL, KINDS, ONE_HIT, PARTLY_DRIVEN, ZEROS

from tests.vibrecords.test_driven import LINES, chirp
from vibrecords import FrfSet
from vibrecords.inspection import contents_of_records, with_resonances
from vibrecords.modal_fit import fit_modes
from vibrecords.modal_problem import ModalProblem, pole_of

MODES, DAMPING = np.array([38.2, 239.4, 670.3]), np.array([0.008, 0.006, 0.005])


def hits_of_four_milliseconds(seed, count):
    """H1 of half sines, whose spectrum is zero at 375 and 625 Hz; both channels are as fine as 16 bits."""
    rng, rate, samples = np.random.default_rng(seed), 6400.0, 25600
    time = np.arange(samples) / rate
    omega, decay = 2 * np.pi * MODES * np.sqrt(1 - DAMPING**2), 2 * np.pi * MODES * DAMPING
    ring = (np.exp(-decay[:, None] * time) * np.sin(omega[:, None] * time)).sum(axis=0)
    pulse = np.where(time < 4e-3, np.sin(np.pi * time / 4e-3), 0.0)
    answer = np.fft.irfft(np.fft.rfft(pulse, 2 * samples) * np.fft.rfft(ring, 2 * samples))[:samples]
    x, y = [], []
    for size in rng.uniform(0.5, 1.0, count):
        for spectra, record in ((x, size * pulse), (y, size * answer / np.abs(answer).max())):
            noisy = record + 1e-5 * rng.standard_normal(samples)
            spectra.append(np.fft.rfft(np.round(noisy * 2**15) / 2**15))
    x, y = np.array(x), np.array(y)
    lines = np.fft.rfftfreq(samples, 1 / rate)
    used, square = (lines > 0) & (lines <= 800), np.mean(np.abs(x) ** 2, axis=0)
    h1 = np.mean(y * x.conj(), axis=0) / square
    coherence = np.abs(h1) ** 2 * square / np.mean(np.abs(y) ** 2, axis=0)
    values, coherence = h1[used, None, None], np.clip(coherence[used, None, None], 1e-12, 1)
    known = {"coherence": coherence, "averages": count} if count > 1 else {}
    return FrfSet(lines[used], values, ("1:y",), ("1:y",), "receptance", **known)


@pytest.mark.parametrize("count", [1, 5])
def test_zeros_of_the_force_spectrum_make_no_modes(count):
    for seed in range(3):
        modes = fit_modes(hits_of_four_milliseconds(seed, count)).modes
        assert [round(mode.frequency_hz) for mode in modes] == [38, 239, 670]
        off = [(mode.frequency_hz - true) / mode.frequency_sd_hz for mode, true in zip(modes, MODES, strict=True)]
        assert np.abs(off).max() < 4


@pytest.mark.parametrize("kind", [ONE_HIT, ZEROS, EXPONENTIAL, PARTLY_DRIVEN])
def test_no_mode_is_invented_in_a_test_that_is_hard_to_read(kind):
    """The closed form of a beam is the truth; `make science` judges more of these tests."""
    outcome = analyse(KINDS.index(kind) + 2 * len(KINDS))
    assert outcome.kind == kind
    assert outcome.clear >= 3
    assert (outcome.invented, outcome.missed, outcome.named) == ([], [], [])


@pytest.mark.parametrize("decay", [0.0, 5.0, 20.0])
def test_the_standard_deviations_are_those_of_many_fits_whether_noise_is_smooth_or_not(decay):
    """An exponential window exp(−decay t) damps the mode and makes noise alike over neighbouring lines."""
    lines, truth, rng = np.arange(100.0, 300.0, 0.5), 200.0, np.random.default_rng(1)
    ratio = 0.02 + decay / (2 * np.pi * truth)
    exact = truth**2 / (truth**2 - lines**2 + 2j * ratio * truth * lines)
    window = np.exp(-decay * np.arange(1000) / 500.0)
    start, found, stated = pole_of(np.array([2 * np.pi * truth]), np.array([ratio])), [], []
    for _ in range(60):
        white = rng.standard_normal((2, 1000)).T @ [1, 1j] * window
        noise = 0.3 * np.fft.fft(white)[: lines.size] / np.sqrt(2 * np.sum(window**2))
        problem = ModalProblem(lines, (exact + noise)[:, None], np.full((lines.size, 1), 1 / 0.3), "receptance")
        pole = problem.climb(start, fine=True)
        found.append(float(np.abs(pole[0])) / (2 * np.pi))
        stated.append(np.sqrt(problem.covariance(pole)[0, 0]) / (2 * np.pi))
    assert np.std(found) / np.median(stated) == pytest.approx(1.0, abs=0.3)  # known to 10 %


@pytest.mark.parametrize(("actual", "inflation"), [(0.1, 1.0), (1.0, 1.0), (3.0, 9.0)])
def test_noise_counts_by_its_power_and_never_for_less_than_stated(actual, inflation):
    """White noise of `actual` times the stated standard deviation, about one mode that is known exactly."""
    lines, truth, ratio, stated = np.arange(100.0, 300.0, 0.1), 200.0, 0.01, 0.01
    exact = truth**2 / (truth**2 - lines**2 + 2j * ratio * truth * lines)
    noise = actual * stated * (np.random.default_rng(1).standard_normal((2, lines.size)).T @ [1, 1j]) / np.sqrt(2)
    problem = ModalProblem(lines, (exact + noise)[:, None], np.full((lines.size, 1), 1 / stated), "receptance")
    found = problem.inflation(pole_of(np.array([2 * np.pi * truth]), np.array([ratio])))
    assert found == pytest.approx(inflation, rel=0.3)
    assert found >= 1


def bumps_that_turn_the_other_way(size):
    """A drive point with one mode at 18.6 Hz, 1.2 %; above 42 Hz smooth bumps whose phase rises, without coherence."""
    mode = -(LINES**2) / (18.6**2 - LINES**2 + 2j * 0.012 * 18.6 * LINES)
    at = np.linspace(50, 120, 9)[:, None]
    bumps = (0.02 * LINES**2 / (at**2 - LINES**2 + 0.02j * at * LINES)).sum(axis=0).conj()
    rng = np.random.default_rng(1)
    noise = 0.002 * (rng.standard_normal((2, LINES.size)).T @ [1, 1j])
    values = np.where(LINES <= 42, mode, mode + size * bumps) + noise
    return replace(chirp(rng), values=values, coherence=None)


def test_small_resonances_that_turn_the_other_way_do_not_make_a_file_of_conjugates():
    record = bumps_that_turn_the_other_way(1.0)
    found = with_resonances(contents_of_records([record]))
    assert not found.conjugated
    assert "conjugated" not in {warning.key for warning in found.warnings}
    assert pytest.approx(found.modes[0].frequency_hz, rel=1e-3) == 18.6
    assert contents_of_records([record.conjugate]).conjugated


def test_conjugates_are_told_by_the_band_that_is_asked_for():
    record = bumps_that_turn_the_other_way(50.0)
    assert not contents_of_records([record], band_hz=(5.0, 42.0)).conjugated
    assert contents_of_records([record.conjugate], band_hz=(5.0, 42.0)).conjugated
    assert contents_of_records([record], band_hz=(48.0, 125.0)).conjugated
