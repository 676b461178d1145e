"""How far windows and overlap make averages and frequency lines depend on each other, and which lines to keep."""

import math

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.errors import MeasurementError


def effective_averages(blocks: int, window: Array, hop: int) -> float:
    """Independent averages that overlapping blocks of random noise count for.

    n/(1 + 2 Σ (1 − j/n) ρ_j²), where ρ_j is the correlation of spectra of blocks j apart.

    Parameters
    ----------
    blocks
        Number n of blocks.
    window
        Window of each block, shape (samples,).
    hop
        Samples from the start of a block to that of the next.

    Raises
    ------
    MeasurementError
        If there is no block or they do not move on.

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


def line_correlation(window: Array, *, random: bool, blocks: int = 1, hop: int | None = None, most: int = 64) -> Array:
    """|correlation| of the errors of an FRF at lines 0, 1, 2, … apart, shape (most,).

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
    most
        How many lines apart.
    """
    most = min(most, window.size // 2)
    if random:
        spectrum = _overlapping(blocks, window, hop or window.size, most)
    else:
        spectrum = np.abs(np.fft.rfft(window**2))[:most]
    return spectrum / spectrum[0]


def _overlapping(blocks: int, window: Array, hop: int, most: int) -> Array:
    """Σ_j (1 − |j|/n) |R(m, j)|² over pairs of blocks j apart for lines m apart, shape (most,)."""
    if blocks < 1 or hop < 1:
        raise MeasurementError(
            f"averages: found {blocks} blocks {hop} samples apart; expected at least 1 of each; correct them"
        )
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


def lines_apart(frequency_hz: Array, spacing_hz: float) -> NDArray[np.intp]:
    """Numbers of lines that are at least `spacing_hz` apart, from the first on; for even and uneven lines."""
    kept = [0]
    for i in range(1, frequency_hz.size):
        if frequency_hz[i] - frequency_hz[kept[-1]] >= spacing_hz * (1 - 1e-6):
            kept.append(i)
    return np.array(kept, dtype=np.intp)
