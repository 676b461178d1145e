"""Windows on force and response of an impact test, and what an exponential one adds to the damping."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError
from jointbayes.frf import FrfSet
from jointbayes.frf.frf_set import POWER_OF_JW

_TAPER = 0.25  # of the force window's length, cosine-shaped, follows its end


def force_window(samples: int, trigger: int, length: int) -> Array:
    """Window that keeps the pulse and drops the noise after it: 1 up to `length` samples after the trigger, then 0.

    Its end is a quarter of `length` of a cosine, so that no step is made. Shape (samples,).
    """
    taper = max(int(_TAPER * length), 1)
    after = np.clip((np.arange(samples) - trigger - length) / taper, 0.0, 1.0)
    return 0.5 * (1 + np.cos(np.pi * after))


def exponential_window(samples: int, end: float) -> Array:
    """e^(−at) over the whole block, from 1 at its start to `end` one sample after it, shape (samples,).

    Multiplied to *both* channels, it makes of the FRF H(jω) of a linear system at rest before the block exactly
    H(jω + a), whatever the force.

    Raises
    ------
    MeasurementError
        If `end` is not above 0 and at most 1.
    """
    if not 0 < end <= 1:
        raise MeasurementError(
            f"exponential window: found {end:g} at its end; expected a value above 0 and at most 1; correct it"
        )
    return end ** (np.arange(samples) / samples)


def added_decay_rate(end: float, block_s: float) -> float:
    """Rate a of the exponential window in 1/s: it moves each pole s to s − a, and so adds about a/ω to each ζ."""
    return float(-np.log(end) / block_s)


def without_added_damping(frf: FrfSet, frequency_hz: Array, damping_ratio: Array, rate: float) -> FrfSet:
    """FRFs with the damping of an exponential window taken out, by the modes that were fitted to them.

    What was measured is H(jω + a); H(jω) is not in the data, so that *some* model must carry it over by a. Here the
    modes do: residues of the given poles, with residual terms of the modes below and above the band, are fitted to
    the receptance linearly, and the difference of the fit between jω and jω + a is added to the data. Noise stays
    as it was, and what the modes do not explain stays uncorrected. (To undo the window in time, by e^(+at), would
    multiply the noise at the end of the block by 1/`end`.)

    Parameters
    ----------
    frf
        Measured with an exponential window on both channels.
    frequency_hz, damping_ratio
        Modes in the band *as fitted to* `frf`, added damping included, shape (modes,).
    rate
        a of `added_decay_rate`, 1/s.

    Returns
    -------
    FrfSet
        Coherence and averages as they were.

    Raises
    ------
    MeasurementError
        If there are fewer lines than unknowns.
    """
    omega, power = 2 * np.pi * frf.frequency_hz, POWER_OF_JW[frf.quantity]
    wanted_at = np.asarray(1j * omega, dtype=np.complex128)
    measured_at = np.asarray(wanted_at + rate, dtype=np.complex128)
    true = _poles(frequency_hz, damping_ratio) + rate
    before, after = _partial_fractions(measured_at, true), _partial_fractions(wanted_at, true)
    if 2 * omega.size < before.shape[1]:
        raise MeasurementError(
            f"exponential window: found {omega.size} lines for {true.size} modes; expected at least "
            f"{(before.shape[1] + 1) // 2} lines; widen the band"
        )
    receptance = frf.values.reshape(omega.size, -1) / measured_at[:, None] ** power
    corrected = np.empty_like(receptance)
    for i, one in enumerate(receptance.T):
        weight = 1 / np.maximum(np.abs(one), 1e-3 * np.abs(one).max())
        rows = weight[:, None] * before
        scale = np.linalg.norm(rows, axis=0)
        stacked, target = np.vstack([rows.real, rows.imag]) / scale, weight * one
        amplitude, *_ = np.linalg.lstsq(stacked, np.concatenate([target.real, target.imag]))
        corrected[:, i] = one + (after - before) @ (amplitude / scale)
    values = (corrected * wanted_at[:, None] ** power).reshape(frf.values.shape)
    return replace(frf, values=values)


def _poles(frequency_hz: Array, damping_ratio: Array) -> NDArray[np.complex128]:
    omega, ratio = 2 * np.pi * np.asarray(frequency_hz, dtype=float), np.asarray(damping_ratio, dtype=float)
    return -ratio * omega + 1j * omega * np.sqrt(np.maximum(1 - ratio**2, 0.0))


def _partial_fractions(s: NDArray[np.complex128], poles: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Columns of real unknowns: real and imaginary part of each residue, 1/s² below and 1 above, (lines, 2m + 2)."""
    one, other = 1 / (s[:, None] - poles), 1 / (s[:, None] - poles.conj())
    return np.hstack([one + other, 1j * (one - other), 1 / s[:, None] ** 2, np.ones((s.size, 1))])
