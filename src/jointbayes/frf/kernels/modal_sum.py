"""The modal sum over all lines: modes in and near the band line by line, those above it by interpolation.

H(ω) = S − jωT with S = Σ R_r (λ_r − ω²)/D_r and T = Σ R_r 2ζ_r√λ_r/D_r, D_r = (λ_r − ω²)² + 4ζ_r²λ_r ω², for modal
constants R_r. Both are smooth in ω² for modes above the band, and there polynomials through a few Chebyshev points
carry all of them at once.
"""

import math

import numpy as np

from jointbayes.frf.kernels.compiled import LANES, compiled, inner, lane_blocks
from vibrecords.arrays import Array, ComplexArray, Flags

#: A mode with λ above this many times the square of the band's end is interpolated. Its nearest singularity lies at
#: 2·5 − 1 = 9 half-widths from the middle of the band in ω²: of what these modes contribute, which is little next to a
#: resonance, (9 + √80)^−N is lost, 1e-10 for N = 8.
_FAR = 5.0
_NODES = 8
#: With more pairs than this each mode's 1/D is kept for all of them: dividing costs more than the products do.
_FEW_PAIRS = 4
#: So many draws are summed over one block of lines before the next: data of many lines are in no near cache.
_DRAWS = 64


@inner
def _near_modes(w2: Array, lam: Array, rate: Array, c: Array, sums: Array) -> None:
    """Add four modes: 1/D of all of them from one division, which is what costs here, and a few products."""
    l1, l2, l3, l4 = lam[0], lam[1], lam[2], lam[3]
    r1, r2, r3, r4 = rate[0] * rate[0], rate[1] * rate[1], rate[2] * rate[2], rate[3] * rate[3]
    c1, c2, c3, c4 = c[0], c[1], c[2], c[3]
    e1, e2, e3, e4 = c1 * rate[0], c2 * rate[1], c3 * rate[2], c4 * rate[3]
    for j in range(LANES):
        a1, a2, a3, a4 = l1 - w2[j], l2 - w2[j], l3 - w2[j], l4 - w2[j]
        d1, d2 = a1 * a1 + r1 * w2[j], a2 * a2 + r2 * w2[j]
        d3, d4 = a3 * a3 + r3 * w2[j], a4 * a4 + r4 * w2[j]
        d12, d34 = d1 * d2, d3 * d4
        both = 1.0 / (d12 * d34)
        i12, i34 = d34 * both, d12 * both
        sums[j] += (c1 * a1 * d2 + c2 * a2 * d1) * i12 + (c3 * a3 * d4 + c4 * a4 * d3) * i34
        sums[LANES + j] += (e1 * d2 + e2 * d1) * i12 + (e3 * d4 + e4 * d3) * i34


@inner
def _interpolate(basis: Array, s: Array, t: Array, sums: Array) -> None:
    """S and T of the far modes from their values at the interpolation points."""
    s0, s1, s2, s3, s4, s5, s6, s7 = s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7]
    t0, t1, t2, t3, t4, t5, t6, t7 = t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7]
    for j in range(LANES):
        b0, b1, b2, b3 = basis[j], basis[LANES + j], basis[2 * LANES + j], basis[3 * LANES + j]
        b4, b5, b6, b7 = basis[4 * LANES + j], basis[5 * LANES + j], basis[6 * LANES + j], basis[7 * LANES + j]
        sums[j] = (s0 * b0 + s1 * b1 + s2 * b2 + s3 * b3) + (s4 * b4 + s5 * b5 + s6 * b6 + s7 * b7)
        sums[LANES + j] = (t0 * b0 + t1 * b1 + t2 * b2 + t3 * b3) + (t4 * b4 + t5 * b5 + t6 * b6 + t7 * b7)


@inner
def _far_modes(lam: Array, constants: Array, ratio: Array, node: float) -> tuple[float, float]:
    """S and T of modes far above ω² = node."""
    s, t = 0.0, 0.0
    for k in range(len(lam)):
        per = 1.0 / lam[k]
        x = node * per  # relative: λ of a rigid joint squared is no number
        c = constants[k] * per / ((1.0 - x) * (1.0 - x) + 4.0 * ratio[k] * ratio[k] * x)
        s += c * (1.0 - x)
        t += c * ratio[k] * math.sqrt(per)
    return s, 2.0 * t


@inner
def _residual(sums: Array, omega: Array, data: Array) -> float:
    total = 0.0
    for j in range(LANES):
        re, im = sums[j] - data[j], omega[j] * sums[LANES + j] + data[LANES + j]
        total += (re * re + im * im) * data[2 * LANES + j]
    return total


@inner
def _prepare(
    lam: Array, shapes: Array, n_out: int, ratio: Array, limit: float, nodes: Array, near_modes: Array,
    constants: Array, at: Array,
) -> int:  # fmt: skip
    """Split the modes at the limit; λ and 2ζ√λ of the near ones into `near_modes`, filled up to a multiple of four."""
    n_in = len(shapes) - n_out
    for k in range(len(lam)):
        for o in range(n_out):
            for i in range(n_in):
                constants[o * n_in + i, k] = shapes[o, k] * shapes[n_out + i, k]
    near = 0
    while near < len(lam) and lam[near] < limit:
        near_modes[0, near], near_modes[1, near] = lam[near], 2.0 * ratio[near] * math.sqrt(max(lam[near], 0.0))
        near += 1
    for a in range(len(constants)):
        for j in range(_NODES):
            here = constants[a, near : len(lam)]
            at[0, a, j], at[1, a, j] = _far_modes(lam[near:], here, ratio[near:], nodes[j])
    for k in range(near, near + 4):  # padding: these modes do not count
        near_modes[0, k], near_modes[1, k] = 1.0, 1.0
        for a in range(len(constants)):
            constants[a, k] = 0.0
    return near


@compiled
def _evaluate_lines(
    lam: Array, shapes: Array, n_out: int, ratio: Array, limit: float, nodes: Array, w2: Array, omega: Array,
    basis: Array, data: Array, chi2: Array, parts: Array,
) -> None:  # fmt: skip
    """χ² (batch,); receptances, real and imaginary parts, where `parts` (batch, lines, 2·pairs) has any row."""
    pairs, m = len(data), lam.shape[1] + 4
    constants, near_modes, at = np.empty((pairs, m)), np.empty((2, m)), np.empty((2, pairs, _NODES))
    sums = np.empty(2 * LANES)
    for i in range(len(lam)):
        near = _prepare(
            lam[i], shapes[i], n_out, ratio[i if len(ratio) > 1 else 0], limit, nodes, near_modes, constants, at
        )
        total = 0.0
        for b in range(len(w2) // LANES):
            here = w2[b * LANES : (b + 1) * LANES]
            for a in range(pairs):
                _interpolate(basis[b * _NODES * LANES : (b + 1) * _NODES * LANES], at[0, a], at[1, a], sums)
                for k in range(0, near, 4):
                    _near_modes(here, near_modes[0, k:], near_modes[1, k:], constants[a, k:], sums)
                if len(parts) > 0:
                    for j in range(min(LANES, parts.shape[1] - b * LANES)):
                        parts[i, b * LANES + j, 2 * a] = sums[j]
                        parts[i, b * LANES + j, 2 * a + 1] = -omega[b * LANES + j] * sums[LANES + j]
                else:
                    measured = data[a, b * 3 * LANES : (b + 1) * 3 * LANES]
                    total += _residual(sums, omega[b * LANES : (b + 1) * LANES], measured)
        chi2[i] = total


@inner
def _fraction(w2: Array, omega: Array, lam: float, rate: float, re: Array, im: Array) -> None:
    """Real and imaginary part of 1/(λ − ω² + j·rate·ω) of one mode."""
    for j in range(LANES):
        a, e = lam - w2[j], rate * omega[j]
        per = 1.0 / (a * a + e * e)
        re[j], im[j] = a * per, -e * per


@inner
def _first_modes(basis: Array, omega: Array, s: Array, t: Array, c: Array, re: Array, im: Array, sums: Array) -> None:
    """Far modes, S − jωT from their values at the interpolation points, and the first four of the near ones."""
    s0, s1, s2, s3, s4, s5, s6, s7 = s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7]
    t0, t1, t2, t3, t4, t5, t6, t7 = t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7]
    c1, c2, c3, c4 = c[0], c[1], c[2], c[3]
    for j in range(LANES):
        b0, b1, b2, b3 = basis[j], basis[LANES + j], basis[2 * LANES + j], basis[3 * LANES + j]
        b4, b5, b6, b7 = basis[4 * LANES + j], basis[5 * LANES + j], basis[6 * LANES + j], basis[7 * LANES + j]
        near = (c1 * re[j] + c2 * re[LANES + j]) + (c3 * re[2 * LANES + j] + c4 * re[3 * LANES + j])
        sums[j] = ((s0 * b0 + s1 * b1 + s2 * b2 + s3 * b3) + (s4 * b4 + s5 * b5 + s6 * b6 + s7 * b7)) + near
        near = (c1 * im[j] + c2 * im[LANES + j]) + (c3 * im[2 * LANES + j] + c4 * im[3 * LANES + j])
        far = (t0 * b0 + t1 * b1 + t2 * b2 + t3 * b3) + (t4 * b4 + t5 * b5 + t6 * b6 + t7 * b7)
        sums[LANES + j] = near - omega[j] * far


@inner
def _two_modes(c: Array, re: Array, im: Array, sums: Array) -> None:
    """Add two more modes with these modal constants, from what `_fraction` kept of them."""
    c1, c2 = c[0], c[1]
    for j in range(LANES):
        sums[j] += c1 * re[j] + c2 * re[LANES + j]
        sums[LANES + j] += c1 * im[j] + c2 * im[LANES + j]


@inner
def _squares(sums: Array, data: Array) -> float:
    total = 0.0
    for j in range(LANES):
        re, im = sums[j] - data[j], sums[LANES + j] - data[LANES + j]
        total += (re * re + im * im) * data[2 * LANES + j]
    return total


@compiled
def _many_pairs(
    lam: Array, shapes: Array, n_out: int, ratio: Array, limit: float, nodes: Array, w2: Array, omega: Array,
    basis: Array, data: Array, chi2: Array, parts: Array,
) -> None:  # fmt: skip
    """As `_evaluate_lines`, each mode's fraction worked out once for all pairs, and the data read once for a few draws.

    Where `parts` (batch, lines, 2·pairs) has any row it takes the real and imaginary parts of the receptances.
    """
    pairs, m = len(data), lam.shape[1] + 4
    constants, near_modes = np.empty((_DRAWS, pairs, m)), np.empty((_DRAWS, 2, m))
    at, near = np.empty((_DRAWS, 2, pairs, _NODES)), np.empty(_DRAWS, dtype=np.int64)
    sums, re, im = np.empty(2 * LANES), np.empty(m * LANES), np.empty(m * LANES)
    for i in range(len(lam)):
        chi2[i] = 0.0
    for begin in range(0, len(lam), _DRAWS):
        draws = min(_DRAWS, len(lam) - begin)
        for n in range(draws):
            i = begin + n
            near[n] = _prepare(
                lam[i], shapes[i], n_out, ratio[i if len(ratio) > 1 else 0], limit, nodes, near_modes[n],
                constants[n], at[n],
            )  # fmt: skip
        for b in range(len(w2) // LANES):
            first = b * LANES
            squares, here = w2[first : first + LANES], omega[first : first + LANES]
            for n in range(draws):
                padded = max(4, (near[n] + 1) // 2 * 2)
                for k in range(padded):
                    at_mode = k * LANES
                    _fraction(squares, here, near_modes[n, 0, k], near_modes[n, 1, k], re[at_mode:], im[at_mode:])
                total = 0.0
                for a in range(pairs):
                    _first_modes(
                        basis[first * _NODES : (first + LANES) * _NODES], here, at[n, 0, a], at[n, 1, a],
                        constants[n, a], re, im, sums,
                    )  # fmt: skip
                    for k in range(4, padded, 2):
                        _two_modes(constants[n, a, k:], re[k * LANES :], im[k * LANES :], sums)
                    if len(parts) > 0:
                        for j in range(min(LANES, parts.shape[1] - first)):
                            parts[begin + n, first + j, 2 * a] = sums[j]
                            parts[begin + n, first + j, 2 * a + 1] = sums[LANES + j]
                    else:
                        total += _squares(sums, data[a, 3 * first : 3 * (first + LANES)])
                chi2[begin + n] += total


class ModalSum:
    """Receptances at given lines from eigenvalues and mode shapes.

    Parameters
    ----------
    omega
        Lines, shape (lines,), rad/s.
    n_out
        The first so many shapes are those at outputs, the others those at inputs.
    """

    def __init__(self, omega: Array, n_out: int) -> None:
        self.n_out = n_out
        self._lines = omega.size
        end = float(omega.max()) ** 2
        self.limit = _FAR * end
        self.nodes = end * (1 + np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)) / 2
        # the last block is filled up with its last line, at weight 0: there every term is a number
        filled = np.append(omega, np.full(-omega.size % LANES, omega[-1]))
        self.omega = lane_blocks(filled[None])
        self.omega2 = lane_blocks(filled[None] ** 2)
        polynomials = _lagrange(self.nodes / end, filled**2 / end)
        self.basis = lane_blocks(polynomials)
        self._line_omega, self._polynomials = omega, polynomials[:, : omega.size]

    def receptance(self, eigenvalues: Array, shapes: Array, ratio: Array) -> ComplexArray:
        """Receptance, shape (batch, lines, outputs, inputs).

        Of modes (batch, m) with shapes (batch, ports, m) and damping ratios (batch or 1, m).
        """
        n, n_in = len(eigenvalues), shapes.shape[1] - self.n_out
        parts = np.empty((n, self._lines, 2 * self.n_out * n_in))
        self.run(eigenvalues, shapes, ratio, np.empty((self.n_out * n_in, 0)), np.empty(n), parts)
        return parts.view(np.complex128).reshape(n, self._lines, self.n_out, n_in)

    def spread(self, eigenvalues: Array, ratio: Array, constants: Array, slopes: Array) -> ComplexArray:
        """Modal sums Σ R_r f_r, shape (k, lines, pairs), for constants R (k, pairs, m), f = 1/(λ − ω² + 2jζ√λω).

        To all but the first Σ Q_r ∂f_r/∂λ is added, for slopes Q (k − 1, pairs, m).
        """
        near = eigenvalues < self.limit

        def part(chosen: Flags, omega: Array) -> ComplexArray:
            lam, zeta = eigenvalues[chosen, None], ratio[chosen, None]
            root = np.sqrt(np.maximum(lam, 0.0))
            f = 1 / (lam - omega**2 + 2j * zeta * root * omega)
            rate = np.divide(zeta, root, out=np.zeros_like(root), where=root > 0)
            total = np.asarray(f.T @ constants[..., chosen].swapaxes(1, 2), dtype=complex)
            total[1:] -= (f**2 * (1 + 1j * rate * omega)).T @ slopes[..., chosen].swapaxes(1, 2)
            return total

        at = np.sqrt(self.nodes)
        far = part(~near, at)
        total = part(near, self._line_omega)
        total.real += self._polynomials.T @ far.real
        total.imag += self._line_omega[:, None] * (self._polynomials.T @ (far.imag / at[:, None]))
        return total

    def run(self, eigenvalues: Array, shapes: Array, ratio: Array, data: Array, chi2: Array, parts: Array) -> None:
        """Fill `chi2`, or `parts` if it has any row; see `_evaluate_lines` and `_many_pairs`."""
        (_evaluate_lines if len(data) <= _FEW_PAIRS else _many_pairs)(
            eigenvalues, shapes, self.n_out, ratio, self.limit, self.nodes, self.omega2, self.omega, self.basis,
            data, chi2, parts,
        )  # fmt: skip

    def lines(self, measured: ComplexArray, weight: Array) -> Array:
        """Measured receptances, shape (lines, outputs, inputs), and the squares of their weights, for `chi2`."""
        flat, square = measured.reshape(len(measured), -1).T, weight.reshape(len(weight), -1).T ** 2
        return lane_blocks(np.stack([flat.real, flat.imag, square], axis=1))

    def chi2(self, eigenvalues: Array, shapes: Array, ratio: Array, lines: Array) -> Array:
        """χ² = Σ |H − H^x|² w², shape (batch,), without any array over its lines; not finite where one is singular."""
        chi2 = np.empty(len(eigenvalues))
        self.run(eigenvalues, shapes, ratio, lines, chi2, np.empty((0, 0, 0)))
        return chi2


def _lagrange(nodes: Array, x: Array) -> Array:
    """Lagrange polynomials of the nodes at x, shape (nodes, len(x))."""
    difference = x - nodes[:, None]
    rows = []
    for k, node in enumerate(nodes):
        others = np.delete(np.arange(len(nodes)), k)
        rows.append(np.prod(difference[others] / (node - nodes[others])[:, None], axis=0))
    return np.array(rows)
