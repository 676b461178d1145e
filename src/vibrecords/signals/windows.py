"""Windows of impact and shaker tests: what they add to the damping, and how far they make lines and averages depend."""

import math
from dataclasses import replace

import numpy as np

from vibrecords.arrays import POWER_OF_JW, Array, ComplexArray
from vibrecords.errors import refusal
from vibrecords.frf_set import FrfSet

_TAPER = 0.25  # of the force window's length, cosine-shaped, follows its end
_LINES_APART = 64  # errors of lines farther apart than that do not correlate


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
    H(jω + a), for any force.

    Raises
    ------
    MeasurementError
        If `end` is not above 0 and at most 1.
    """
    if not 0 < end <= 1:
        raise refusal("exponential window", f"{end:g} at its end", "a value above 0 and at most 1", "correct it")
    return end ** (np.arange(samples) / samples)


def added_decay_rate(end: float, block_s: float) -> float:
    """Rate a of the exponential window in 1/s: it moves each pole s to s − a, and so adds about a/ω to each ζ."""
    return float(-np.log(end) / block_s)


def remove_added_damping(frf: FrfSet, frequency_hz: Array, damping_ratio: Array, rate: float) -> FrfSet:
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
    omega_r, zeta = 2 * np.pi * np.asarray(frequency_hz, dtype=float), np.asarray(damping_ratio, dtype=float)
    true = -zeta * omega_r + 1j * omega_r * np.sqrt(np.maximum(1 - zeta**2, 0.0)) + rate
    before, after = _partial_fractions(measured_at, true), _partial_fractions(wanted_at, true)
    if 2 * omega.size < before.shape[1]:
        found = f"{omega.size} lines for {true.size} modes"
        raise refusal("exponential window", found, f"at least {(before.shape[1] + 1) // 2} lines", "widen the band")
    receptance = frf.values.reshape(omega.size, -1) / measured_at[:, None] ** power
    corrected = np.empty_like(receptance)
    for i, column in enumerate(receptance.T):
        weight = 1 / np.maximum(np.abs(column), 1e-3 * np.abs(column).max())
        rows = weight[:, None] * before
        scale = np.linalg.norm(rows, axis=0)
        stacked, target = np.vstack([rows.real, rows.imag]) / scale, weight * column
        amplitude, *_ = np.linalg.lstsq(stacked, np.concatenate([target.real, target.imag]))
        corrected[:, i] = column + (after - before) @ (amplitude / scale)
    return replace(frf, values=(corrected * wanted_at[:, None] ** power).reshape(frf.values.shape))


def _partial_fractions(s: ComplexArray, poles: ComplexArray) -> ComplexArray:
    """Columns of real unknowns, (lines, 2m + 3): both parts of each residue, 1/s² for modes below, 1 and s² above."""
    direct, conjugate = 1 / (s[:, None] - poles), 1 / (s[:, None] - poles.conj())
    return np.hstack(
        [direct + conjugate, 1j * (direct - conjugate), 1 / s[:, None] ** 2, np.ones((s.size, 1)), s[:, None] ** 2]
    )


def effective_averages(blocks: int, window: Array, hop: int) -> float:
    """Independent averages that overlapping blocks of random noise count for.

    n/(1 + 2 Σ (1 − j/n) ρ_j²), where ρ_j is the correlation of spectra of blocks j apart.

    Parameters
    ----------
    blocks
        Number n of blocks, 1 or more.
    window
        Window of each block, shape (samples,).
    hop
        Samples from the start of a block to the start of the next, 1 or more.

    References
    ----------
    Welch, P. D. (1967). IEEE Transactions on Audio and Electroacoustics 15(2), 70-73. DOI 10.1109/TAU.1967.1161901

    Examples
    --------
    >>> import numpy as np
    >>> round(effective_averages(100, np.hanning(1024), 512), 1)
    94.8
    """
    return blocks / float(_overlapping(blocks, window, hop, 1)[0])


def line_correlation(window: Array, *, random: bool, blocks: int = 1, hop: int | None = None) -> Array:
    """|correlation| of the errors of an FRF at lines 0, 1, 2, … up to 63 apart.

    White noise at the response is taken. With the same force in each block (a hammer) errors at two lines correlate as
    the spectra of the windowed noise do. With a random force they do so only where the force's spectra correlate as
    well, so that the correlation is that of the windowed noise squared, taken over all pairs of blocks that overlap.

    Parameters
    ----------
    window
        Window on the response, shape (samples,).
    random
        Whether the force is random (shaker), or the same in each block.
    blocks, hop
        Number of blocks, and samples from one to the next; by default blocks do not overlap.
    """
    most = min(_LINES_APART, window.size // 2)
    if random:
        spectrum = _overlapping(blocks, window, hop or window.size, most)
    else:
        spectrum = np.abs(np.fft.rfft(window**2))[:most]
    return spectrum / spectrum[0]


def _overlapping(blocks: int, window: Array, hop: int, most: int) -> Array:
    """Σ_j (1 − |j|/n) |R(m, j)|² over pairs of blocks j apart for lines m apart, shape (most,)."""
    samples, power = window.size, float(np.sum(window**2))
    total = np.zeros(most)
    for j in range(min(blocks, math.ceil(samples / hop))):
        product = np.zeros(samples)
        product[: samples - j * hop] = window[: samples - j * hop] * window[j * hop :]
        lag = np.abs(np.fft.rfft(product)[:most] / power) ** 2
        total += (1 if j == 0 else 2) * (1 - j / blocks) * lag
    return total


def independent_step(correlation: Array) -> int:
    """Every how many lines to keep, so that those that are left may be taken for independent.

    The number of independent values among N correlated ones is about N/Σ|ρ|², summed over all distances; this sum,
    rounded up, is the step: 1 without a window, 2 for Hann.

    Parameters
    ----------
    correlation
        Of `line_correlation`.
    """
    weight = 1 + 2 * float(np.sum(np.abs(correlation[1:]) ** 2))
    return max(math.ceil(weight - 0.05), 1)
