"""Windows of impact tests: what they do to signals, and that the added damping comes out again exactly."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from vibrecords import FrfSet
from vibrecords.errors import MeasurementError
from vibrecords.signals.windows import added_decay_rate, exponential_window, force_window, remove_added_damping

FREQUENCY, RATIO = np.array([120.0, 310.0, 700.0]), np.array([0.01, 0.004, 0.02])
RATE = 12.0


def modal_frf(s: np.ndarray, frequency=FREQUENCY, ratio=RATIO) -> np.ndarray:
    """Receptance at s, with modes beyond the band standing in as a constant and a mass line."""
    omega = 2 * np.pi * frequency
    shapes = np.array([1.0, -0.7, 0.4])
    modes = shapes / (s[:, None] ** 2 + 2 * ratio * omega * s[:, None] + omega**2)
    return modes.sum(axis=1) + 2e-8 + 0.1 / s**2


def windowed_modes() -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and ratios that a fit finds behind the window: poles moved by −a."""
    omega = 2 * np.pi * FREQUENCY
    pole = omega * (-RATIO + 1j * np.sqrt(1 - RATIO**2)) - RATE
    return np.abs(pole) / (2 * np.pi), -pole.real / np.abs(pole)


def test_the_exponential_window_falls_to_its_end_value_in_one_block():
    window = exponential_window(1000, 0.05)
    assert (window[0], window[-1] * window[1]) == pytest.approx((1.0, 0.05))
    assert_allclose(window[1:] / window[:-1], window[1] / window[0])
    assert_allclose(window, np.exp(-added_decay_rate(0.05, 1000 / 512.0) * np.arange(1000) / 512.0))
    assert (exponential_window(10, 1.0) == 1).all()


@pytest.mark.parametrize("end", [0.0, -0.1, 1.1, np.nan])
def test_an_impossible_end_is_refused(end):
    with pytest.raises(MeasurementError, match="exponential window"):
        exponential_window(10, end)


def test_an_exponential_window_on_both_channels_shifts_the_laplace_variable_exactly():
    rate, samples, end = 8192.0, 8192, 0.01
    t, f = np.arange(samples) / rate, np.arange(20.0, 900.0, 7.0)
    s = 2j * np.pi * f
    # two systems in series, as far as samples go: a known decaying response to a decaying force
    force = np.exp(-900 * t)
    pole = -25 + 2j * np.pi * 200
    impulse = np.exp(pole * t).imag
    response = np.convolve(force, impulse)[:samples] / rate
    window = exponential_window(samples, end)
    a = added_decay_rate(end, samples / rate)

    def spectrum(x: np.ndarray) -> np.ndarray:
        return np.exp(-np.outer(s, t)) @ x

    measured = spectrum(window * response) / spectrum(window * force)
    z = np.exp(-(s + a) / rate)  # the sampled system, at s + a
    exact = (1 / (1 - np.exp(pole / rate) * z) - 1 / (1 - np.exp(pole.conjugate() / rate) * z)) / 2j / rate
    assert_allclose(measured, exact, rtol=1e-6)


@pytest.mark.parametrize(("quantity", "power"), [("receptance", 0), ("mobility", 1), ("accelerance", 2)])
def test_added_damping_comes_out_of_the_frfs_themselves(quantity, power):
    lines = np.arange(50.0, 900.0, 1.0)
    s = 2j * np.pi * lines
    true = modal_frf(s) * s**power
    measured = modal_frf(s + RATE) * (s + RATE) ** power
    both = np.stack([measured, 2 * measured], axis=1)[:, :, None]
    frf = FrfSet(lines, both, ("1:y", "2:y"), ("1:y",), quantity, np.full(both.shape, 0.9), 5)
    corrected = remove_added_damping(frf, *windowed_modes(), RATE)
    assert_allclose(corrected.values[:, 0, 0], true, rtol=1e-6)
    assert_allclose(corrected.values[:, 1, 0], 2 * true, rtol=1e-6)
    assert np.abs(measured / true - 1).max() > 0.5  # that much was wrong before
    assert (corrected.averages, corrected.quantity, corrected.coherence.mean()) == (5, quantity, pytest.approx(0.9))


def test_noise_is_not_amplified_by_the_correction():
    lines = np.arange(50.0, 900.0, 1.0)
    s = 2j * np.pi * lines
    rng = np.random.default_rng(1)
    exact = modal_frf(s + RATE)
    noise = 1e-3 * np.abs(exact) * (rng.standard_normal(lines.size) + 1j * rng.standard_normal(lines.size))
    frf = FrfSet(lines, (exact + noise)[:, None, None], ("1:y",), ("1:y",))
    left = remove_added_damping(frf, *windowed_modes(), RATE).values[:, 0, 0] - modal_frf(s)
    assert np.median(np.abs(left) / np.abs(noise)) == pytest.approx(1.0, abs=0.1)


def test_too_few_lines_are_refused():
    frf = FrfSet([100.0, 200.0, 300.0], np.ones((3, 1, 1)), ("1:y",), ("1:y",))
    with pytest.raises(MeasurementError, match="3 lines for 3 modes; expected at least 5 lines"):
        remove_added_damping(frf, FREQUENCY, RATIO, RATE)


def test_the_force_window_keeps_the_pulse_and_drops_what_follows():
    window = force_window(100, 20, 40)
    assert (window[:61] == 1).all()
    assert (window[70:] == 0).all()
    assert (np.diff(window[60:71]) < 0).all()
    assert np.abs(np.diff(window)).max() < 0.2
