"""Compiled sums and recursions of the noise models: cost linear in lines, memory that of the data.

Noise correlated along frequency is an Ornstein-Uhlenbeck process g, the state, seen through white noise w: z = g + w.
Real and imaginary part are independent and alike, so complex values of shape (n, lines, pairs) are taken as reals of
shape (n, lines, 2·pairs), and variances in units of the stated noise's: the gain depends on the hyperparameters alone
and serves all columns.

References
----------
Kalman, R. E. (1960). A new approach to linear filtering and prediction problems. Journal of Basic Engineering 82(1),
35-45. DOI 10.1115/1.3662552
"""

import math

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.frf.kernels.compiled import compiled

Indices = NDArray[np.int64]

#: Rows filtered side by side: each one's recursion waits for its own division, several keep the processor busy.
ROWS = 8

# a product of variances is turned into its logarithm before it leaves the range of numbers
_LARGE, _SMALL = 1e140, 1e-140


@compiled
def ou_log_likelihood(z: Array, kind: Indices, spacing: Array, hyper: Array, out: Array) -> None:
    """ln L (n,) of z (n, lines, columns), without the constant of the stated noise, by the Kalman filter.

    `kind` (lines,) tells which of the `spacing` (m,) lies before each line (the first line's is not used); `hyper`
    (n, 3) holds white variance, discrepancy variance, length. Spacings that recur cost one exponential each.
    """
    n, lines, columns = z.shape
    phi, gained = np.empty((spacing.size, ROWS)), np.empty((spacing.size, ROWS))
    mean = np.empty((columns, ROWS))
    variance, white, total = np.empty(ROWS), np.empty(ROWS), np.empty(ROWS)
    product, inverse, gain = np.empty(ROWS), np.empty(ROWS), np.empty(ROWS)
    block = np.empty((columns, ROWS))
    for start in range(0, n, ROWS):
        used = min(ROWS, n - start)
        for j in range(ROWS):
            i = start + min(j, used - 1)  # rows beyond the last repeat it, so that the loops below have one length
            white[j], variance[j] = hyper[i, 0], hyper[i, 1]
            total[j], product[j] = 0.0, 1.0
            for m in range(spacing.size):
                lost = -math.expm1(-spacing[m] / hyper[i, 2])  # 1 − φ, exact for lines much closer than the length
                phi[m, j] = 1.0 - lost
                gained[m, j] = lost * (2.0 - lost) * hyper[i, 1]
        mean[:] = 0.0
        for k in range(lines):
            for j in range(ROWS):
                i = start + min(j, used - 1)
                for c in range(columns):
                    block[c, j] = z[i, k, c]
            if k > 0:
                for j in range(ROWS):
                    variance[j] = phi[kind[k], j] * phi[kind[k], j] * variance[j] + gained[kind[k], j]
                for c in range(columns):
                    for j in range(ROWS):
                        mean[c, j] *= phi[kind[k], j]
            for j in range(ROWS):
                s = variance[j] + white[j]
                inverse[j] = 1.0 / s
                gain[j] = variance[j] * inverse[j]
                variance[j] = gain[j] * white[j]
                product[j] *= s
            for c in range(columns):
                for j in range(ROWS):
                    v = block[c, j] - mean[c, j]
                    total[j] += v * v * inverse[j]
                    mean[c, j] += gain[j] * v
            for j in range(ROWS):
                if not _SMALL < product[j] < _LARGE:
                    total[j] += 0.5 * columns * math.log(product[j])
                    product[j] = 1.0
        for j in range(used):
            out[start + j] = -total[j] - 0.5 * columns * math.log(product[j])


@compiled
def innovations(z: Array, kind: Indices, spacing: Array, hyper: Array, out: Array) -> None:
    """Innovations over their standard deviations, `out` (n, lines, columns); arguments as in `ou_log_likelihood`."""
    n, lines, columns = z.shape
    mean = np.empty(columns)
    for i in range(n):
        white, sill, length = hyper[i, 0], hyper[i, 1], hyper[i, 2]
        variance = sill
        mean[:] = 0.0
        for k in range(lines):
            if k > 0:
                lost = -math.expm1(-spacing[kind[k]] / length)
                phi = 1.0 - lost
                variance = phi * phi * variance + lost * (2.0 - lost) * sill
                for c in range(columns):
                    mean[c] *= phi
            s = variance + white
            gain, scale = variance / s, 1 / math.sqrt(s)
            variance = gain * white
            for c in range(columns):
                v = z[i, k, c] - mean[c]
                out[i, k, c] = v * scale
                mean[c] += gain * v


@compiled
def correlate(unit: Array, kind: Indices, spacing: Array, hyper: Array, out: Array) -> None:
    """Adds to `out` (n, lines, columns) an Ornstein-Uhlenbeck process driven by `unit`, independent N(0, 1/2)."""
    n, lines, columns = unit.shape
    for i in range(n):
        sd, length = math.sqrt(hyper[i, 1]), hyper[i, 2]
        for c in range(columns):
            g = sd * unit[i, 0, c]
            out[i, 0, c] += g
            for k in range(1, lines):
                lost = -math.expm1(-spacing[kind[k]] / length)
                g = (1.0 - lost) * g + sd * math.sqrt(lost * (2.0 - lost)) * unit[i, k, c]
                out[i, k, c] += g


@compiled
def log1p_sum(z: Array, parts: int, factor: Array, out: Array) -> None:
    """Σ ln(1 + factor·|z|²) (n,) over z (n, lines, pairs·parts), by the logarithm of products of a few factors."""
    n, lines, columns = z.shape
    for i in range(n):
        f, total, product = factor[i], 0.0, 1.0
        for k in range(lines):
            for c in range(0, columns, parts):
                square = z[i, k, c] * z[i, k, c]
                if parts == 2:
                    square += z[i, k, c + 1] * z[i, k, c + 1]
                product *= 1.0 + f * square
                if not product < _LARGE:
                    total += math.log(product)
                    product = 1.0
        out[i] = total + math.log(product)
