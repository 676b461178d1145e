"""Low-rank coupling of a joint of any number of DOFs: its springs are coupled one after the other, line by line.

With K = L D Lᵀ and stretches δ = Lᵀx the joint's motion solves (1 + Ã D) δ = ã, Ã = LᵀA_jj L and ã = LᵀA_jp. Both a
rigid (d → ∞) and an absent spring (d = 0) leave every pivot 1 + d Ã_pp a number.

Of most joints K⁻¹ is known to nearly all digits: H = A_ab − A_aj (K⁻¹ + A_jj)⁻¹ A_jb needs no springs, half the work.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.frf.kernels.compiled import aligned_zeros, compiled, inner, lane_blocks
from jointbayes.frf.kernels.secular import springs
from jointbayes.frf.ports import stiffness_batch
from vibrecords.arrays import Array, ComplexArray

_WIDTH = 48  # lines at once: few enough for the first cache, many enough to hide the start of each loop
#: Largest diagonal of (K scaled to a unit diagonal)⁻¹ for which K⁻¹ + A_jj loses no digit that counts: four of sixteen.
_WELL_CONDITIONED = 1e4
_NONE, _NO_ROWS = np.empty((0, 0, 0)), np.empty((0, 0, 0, 0))


# A complex number at _WIDTH lines is one row: the real parts, then the imaginary ones.


@inner
def _copy(row: Array, out: Array) -> None:
    """out = row; an assignment of slices takes a second to compile."""
    for j in range(len(row)):
        out[j] = row[j]


@inner
def _add(x: float, row: Array, out: Array) -> None:
    """out += x·row, x real, for any number of rows."""
    for j in range(len(row)):
        out[j] += x * row[j]


@inner
def _minus_products(f: Array, rows: Array, out: Array) -> None:
    """out −= f·row for each of the rows, which lie one after the other."""
    for start in range(0, len(rows), 2 * _WIDTH):
        row, here = rows[start : start + 2 * _WIDTH], out[start : start + 2 * _WIDTH]
        for j in range(_WIDTH):
            fr, fi, re, im = f[j], f[_WIDTH + j], row[j], row[_WIDTH + j]
            here[j] -= fr * re - fi * im
            here[_WIDTH + j] -= fr * im + fi * re


@inner
def _product(d: float, f: Array, row: Array, out: Array) -> None:
    """out = d·f·row, d real."""
    for j in range(_WIDTH):
        fr, fi, re, im = f[j], f[_WIDTH + j], row[j], row[_WIDTH + j]
        out[j] = d * (fr * re - fi * im)
        out[_WIDTH + j] = d * (fr * im + fi * re)


@inner
def _inverse_pivot(unit: float, d: float, row: Array, out: Array) -> None:
    """out = 1/(unit + d·row)."""
    for j in range(_WIDTH):
        re, im = unit + d * row[j], d * row[_WIDTH + j]
        size = 1.0 / (re * re + im * im)
        out[j], out[_WIDTH + j] = re * size, -im * size


@inner
def _add_compliance(compliance: Array, free: Array, a: Array) -> None:
    """Return K⁻¹ + A_jj, and next to it A_jp."""
    r, row = len(compliance), 2 * _WIDTH
    for i in range(r):
        for k in range(i, r):
            c, since, here = compliance[i, k], free[i, k * row : (k + 1) * row], a[i, k * row : (k + 1) * row]
            for j in range(_WIDTH):
                here[j], here[_WIDTH + j] = since[j] + c, since[_WIDTH + j]
        _copy(free[i, r * row :], a[i, r * row :])


@inner
def _turn_into_springs(turn: Array, along: Array, free: Array, a: Array, rest: Array, half: Array) -> None:
    """Return Ã, next to it the motion under each load (r, (r + q) rows), and ã, from the receptance without joint."""
    r, q = along.shape
    row = 2 * _WIDTH
    for i in range(r):
        half[:] = 0.0
        for m in range(r):
            if turn[m, i] != 0.0:
                _add(turn[m, i], free[m], half)
        for k in range(i, r):
            here = a[i, k * row : (k + 1) * row]
            here[:] = 0.0
            for m in range(r):
                if turn[m, k] != 0.0:
                    _add(turn[m, k], half[m * row : (m + 1) * row], here)
        _copy(half[r * row :], rest[i])
        _copy(half[r * row :], a[i, r * row :])
    for k in range(q):
        for m in range(r):
            if along[m, k] != 0.0:
                for i in range(r):
                    x, y = min(i, m), max(i, m)
                    _add(along[m, k], a[x, y * row : (y + 1) * row], a[i, (r + k) * row : (r + k + 1) * row])


@inner
def _eliminate(
    unit: float, d: Array, ports: NDArray[np.int64], free: Array, a: Array, inverse: Array, h: Array, f: Array
) -> None:
    """Take the joint's DOFs out without pivoting; H of each pair of ports (n, row), unless one moves with the joint."""
    r, row = len(d), 2 * _WIDTH
    for n in range(len(ports)):
        x, y = r + ports[n, 0], (r + ports[n, 1]) * row
        _copy(free[x, y : y + row], h[n])
    for p in range(r):
        _inverse_pivot(unit, d[p], a[p, p * row : (p + 1) * row], inverse[p])
        if d[p] != 0.0:
            for i in range(p + 1, r):
                _product(d[p], inverse[p], a[p, i * row : (i + 1) * row], f)
                _minus_products(f, a[p, i * row :], a[i, i * row :])
            for n in range(len(ports)):
                x, y = (r + ports[n, 0]) * row, (r + ports[n, 1]) * row
                _product(d[p], inverse[p], a[p, x : x + row], f)
                _minus_products(f, a[p, y : y + row], h[n])


@inner
def _stretches(d: Array, a: Array, inverse: Array, f: Array) -> None:
    """Stretches δ under each load, in place of it, by back substitution."""
    r, row = len(d), 2 * _WIDTH
    for k in range(r * row, a.shape[1], row):
        for p in range(r - 1, -1, -1):
            here = a[p, k : k + row]
            for i in range(p + 1, r):
                if d[i] != 0.0:
                    _product(d[i], a[i, k : k + row], a[p, i * row : (i + 1) * row], f)
                    _add(-1.0, f, here)
            _product(1.0, inverse[p], here, f)
            _copy(f, here)


@inner
def _response(d: Array, along: Array, free: Array, rest: Array, a: Array, o: int, s: int, h: Array, f: Array) -> None:
    """H of one pair of ports, one row."""
    r, row = len(d), 2 * _WIDTH
    _copy(free[r + o, (r + s) * row : (r + s + 1) * row], h)
    for p in range(r):
        delta, column = a[p, (r + s) * row : (r + s + 1) * row], rest[p, o * row : (o + 1) * row]
        if along[p, o] != 0.0:
            _add(along[p, o], delta, h)
        if along[p, s] != 0.0:
            _add(along[p, s], column, h)
        _product(d[p], column, delta, f)
        _add(-1.0, f, h)


@inner
def _distance(h: Array, data: Array) -> float:
    total = 0.0
    for j in range(_WIDTH):
        re, im = h[j] - data[j], h[_WIDTH + j] - data[_WIDTH + j]
        total += (re * re + im * im) * data[2 * _WIDTH + j]
    return total


@inner
def _overlap(h: Array, data: Array, x: Array, y: Array) -> float:
    """Σ w² Re(r̄ x y)."""
    total = 0.0
    for j in range(_WIDTH):
        re, im = (h[j] - data[j]) * data[2 * _WIDTH + j], (h[_WIDTH + j] - data[_WIDTH + j]) * data[2 * _WIDTH + j]
        xr, xi, yr, yi = x[j], x[_WIDTH + j], y[j], y[_WIDTH + j]
        total += re * (xr * yr - xi * yi) + im * (xr * yi + xi * yr)
    return total


@compiled
def _evaluate_lines(
    unit: Array, turn: Array, d: Array, along: Array, free: Array, ports: NDArray[np.int64], data: Array, chi2: Array,
    slope: Array, value: Array, delta: Array,
) -> None:  # fmt: skip
    """χ² (batch,), and its gradient in the springs' coordinates (batch, r, r) where `slope` has any row.

    Where `value` has any row, H (batch, blocks, pairs, row) at every line instead, and where `delta` has, the stretches
    δ (batch, blocks, r, q rows).
    Where `unit` (batch,) is 0, `turn` is K⁻¹ and d is 1; where it is 1, they are the springs.
    """
    r, q = along.shape[1:]
    row = 2 * _WIDTH
    a, rest, half = np.empty((r, (r + q) * row)), np.empty((r, q * row)), np.empty((r + q) * row)
    inverse, f, h = np.empty((r, row)), np.empty(row), np.empty((len(ports), row))
    at_joint = along.any()
    chi2[:] = 0.0
    slope[:] = 0.0
    for b in range(len(free)):
        for i in range(len(chi2)):
            if unit[i] == 0.0:
                _add_compliance(turn[i], free[b], a)
            else:
                _turn_into_springs(turn[i], along[i], free[b], a, rest, half)
            _eliminate(unit[i], d[i], ports, free[b], a, inverse, h, f)
            if at_joint or len(slope) > 0 or len(delta) > 0:
                _stretches(d[i], a, inverse, f)
            for n in range(len(ports)):
                o, s = ports[n]
                if at_joint:
                    _response(d[i], along[i], free[b], rest, a, o, s, h[n], f)
                if len(value) > 0:
                    _copy(h[n], value[i, b, n])
                else:
                    chi2[i] += _distance(h[n], data[b, n])
                if len(slope) > 0:  # dH = −δ_oᵀ dK̃ δ_i
                    for p in range(r):
                        for k in range(r):
                            x, y = a[p, (r + o) * row :], a[k, (r + s) * row :]
                            slope[i, p, k] -= 2.0 * _overlap(h[n], data[b, n], x, y)
            if len(delta) > 0:
                for p in range(r):
                    _copy(a[p, r * row :], delta[i, b, p])


@compiled
def _pack(free: ComplexArray, rows: NDArray[np.int64], out: Array) -> None:
    """Receptances (lines, k, k) between some of the motions, as rows (blocks, q, q rows)."""
    for line in range(len(free)):
        b, j = line // _WIDTH, line % _WIDTH
        for p in range(len(rows)):
            for q in range(len(rows)):
                value = free[line, rows[p], rows[q]]
                out[b, p, q * 2 * _WIDTH + j] = value.real
                out[b, p, (q * 2 + 1) * _WIDTH + j] = value.imag


@compiled
def _yielding_over_lines(
    compliance: Array,
    places: NDArray[np.int64],
    r: int,
    free: Array,
    ports: NDArray[np.int64],
    data: Array,
    chi2: Array,
) -> None:
    """χ² (batch,) of joints with a complex compliance: entries (batch, blocks or 1, entries·row) at places."""
    row = 2 * _WIDTH
    q = free.shape[2] // row - r
    a, d = np.empty((r, (r + q) * row)), np.ones(r)
    inverse, f, h = np.empty((r, row)), np.empty(row), np.empty((len(ports), row))
    chi2[:] = 0.0
    for b in range(len(free)):
        for i in range(len(chi2)):
            for k in range(r):
                _copy(free[b, k, k * row :], a[k, k * row :])
            for e in range(len(places)):
                x, y = places[e, 0], places[e, 1] * row
                _add(1.0, compliance[i, min(b, compliance.shape[1] - 1), e * row : (e + 1) * row], a[x, y : y + row])
            _eliminate(0.0, d, ports, free[b], a, inverse, h, f)
            for n in range(len(ports)):
                chi2[i] += _distance(h[n], data[b, n])


class MultiDofCoupling:
    """Receptance of a structure whose joint has any number of DOFs; parameters as `PairCoupling`."""

    def __init__(self, free: ComplexArray, along: Array, n_out: int) -> None:
        r, q = along.shape
        self._lines, self._n_out, self._n_in = len(free), n_out, q - n_out
        # a DOF that is both driven and observed is one port
        columns = np.concatenate([along, free[:, :, r:].real.sum(axis=0), free[:, :, r:].imag.sum(axis=0)])
        _, kept, port = np.unique(columns, axis=1, return_index=True, return_inverse=True)
        port = port.ravel()
        self.ports = np.array([(port[o], port[n_out + i]) for o in range(n_out) for i in range(q - n_out)])
        rows = np.concatenate([np.arange(r), r + kept])
        self.along = along[:, kept]
        self.free = aligned_zeros((-(-len(free) // _WIDTH), len(rows), len(rows) * 2 * _WIDTH))
        _pack(free, rows, self.free)

    def receptance(self, stiffness: ArrayLike) -> ComplexArray:
        """Receptances for joint matrices of shape (r, r) or (batch, r, r): shape (batch, lines, outputs, inputs)."""
        matrices = stiffness_batch(stiffness)
        value = np.empty((len(matrices), len(self.free), len(self.ports), 2 * _WIDTH))
        self.run(matrices, value=value)
        return np.moveaxis(self._complex_lines(value), 1, 2).reshape(-1, self._lines, self._n_out, self._n_in)

    def tangent(self, stiffness: ArrayLike, directions: ArrayLike) -> tuple[ComplexArray, ComplexArray]:
        """Receptance and its derivative along p changes of one joint matrix; see `ReceptanceModel`."""
        matrices, (r, q) = stiffness_batch(stiffness), self.along.shape
        value = np.empty((1, len(self.free), len(self.ports), 2 * _WIDTH))
        stretches = np.empty((1, len(self.free), r, q * 2 * _WIDTH))
        turn, _, _ = self.run(matrices, value=value, delta=stretches)
        delta = self._complex_lines(stretches.reshape(1, len(self.free), r, q, -1))[0]
        back = np.linalg.inv(turn[0])
        change = back @ np.asarray(directions, dtype=float) @ back.T
        at_outputs, at_inputs = delta[:, self.ports[:, 0]], delta[:, self.ports[:, 1]]
        slopes = np.empty((len(change), self._lines, len(self.ports)), dtype=complex)
        for by_joint, slope in zip(change, slopes, strict=True):  # of several joints each changes few rows
            rows = np.flatnonzero(by_joint.any(axis=1))
            flat = at_inputs[rows].reshape(len(rows), at_inputs[0].size)  # no row: a quantity of another test's joint
            moved = (by_joint[np.ix_(rows, rows)] @ flat).reshape(-1, *at_inputs.shape[1:])
            slope[:] = -(at_outputs[rows] * moved).sum(axis=0).T
        h = self._complex_lines(value)[0].T
        return h.reshape(self._lines, self._n_out, self._n_in), slopes.reshape(
            -1, *h.shape[:1], self._n_out, self._n_in
        )

    def misfit(self, measured: ComplexArray, weight: Array) -> "MultiDofMisfit":
        """Weighted distance from measured receptances, shape (lines, outputs, inputs)."""
        flat, square = measured.reshape(self._lines, -1).T, weight.reshape(self._lines, -1).T ** 2
        return MultiDofMisfit(self, _blocks(np.stack([flat.real, flat.imag, square], axis=1)))

    def run(
        self,
        matrices: Array,
        data: Array = _NONE,
        slope: Array = _NONE,
        value: Array = _NO_ROWS,
        delta: Array = _NO_ROWS,
    ) -> tuple[Array, Array, Array]:
        """Fill what has any row, see `_evaluate_lines`; the springs' directions, χ² (batch,), and the slope."""
        turn, d = springs(matrices)  # directions L (batch, r, r) and stiffness (batch, r)
        along = np.asarray(np.linalg.solve(turn, self.along[None]), dtype=float)
        unit, chi2 = np.ones(len(turn)), np.empty(len(turn))
        if not (len(slope) or len(delta) or along.any()):
            back = np.linalg.inv(turn)
            with np.errstate(divide="ignore", invalid="ignore"):
                compliance = (back.swapaxes(1, 2) / d[:, None, :]) @ back
                product = np.einsum("bii,bii->bi", compliance, matrices)
            plain = (d > 0).all(axis=1) & (product <= _WELL_CONDITIONED).all(axis=1)
            unit[plain], turn[plain], d[plain] = 0.0, compliance[plain], 1.0
        _evaluate_lines(unit, turn, d, along, self.free, self.ports, data, chi2, slope, value, delta)
        return turn, chi2, slope

    def _complex_lines(self, rows: Array) -> ComplexArray:
        """Rows (batch, blocks, ..., row) as complex numbers (batch, ..., lines)."""
        value = np.moveaxis(rows[..., :_WIDTH] + 1j * rows[..., _WIDTH:], 1, -2)
        return value.reshape(*value.shape[:-2], -1)[..., : self._lines]


class MultiDofMisfit:
    """χ² = Σ |H − H^x|² w² over lines and FRFs as a function of the joint, without any array over its lines."""

    def __init__(self, coupling: MultiDofCoupling, data: Array) -> None:
        self._coupling, self._data = coupling, data

    def chi2(self, stiffness: Array, factors: ArrayLike | None = None) -> Array:
        """χ², shape (batch,), of joint matrices, shape (batch, r, r); not finite where a line is singular."""
        return self._coupling.run(stiffness, self._data)[1]

    def yielding_chi2(self, compliance: ComplexArray, places: NDArray[np.int64]) -> Array:
        """χ², shape (batch,), of joints with damping; not finite where a line is singular.

        Parameters
        ----------
        compliance
            Entries of the joints' inverse dynamic stiffness, shape (batch, entries, lines), or (batch, entries, 1)
            where it is the same at all of them.
        places
            Row and column of each, in the upper triangle, shape (entries, 2).
        """
        # lines that fill up the last block have the last one's compliance: zeros could not be inverted
        short = -compliance.shape[-1] % _WIDTH
        filled = np.concatenate([compliance, np.repeat(compliance[..., -1:], short, axis=-1)], axis=-1)
        rows = np.moveaxis(_blocks(np.stack([filled.real, filled.imag], axis=2)), 0, 1)
        compliances, chi2 = np.ascontiguousarray(rows).reshape(*rows.shape[:2], -1), np.empty(len(rows))
        of = self._coupling
        _yielding_over_lines(compliances, places, of.along.shape[0], of.free, of.ports, self._data, chi2)
        return chi2

    def chi2_gradient(self, stiffness: Array, factors: ArrayLike | None = None) -> tuple[Array, Array]:
        """χ² and its gradient S, shape (batch, r, r): dχ² = Σ S_ij dK_ij for symmetric dK."""
        turn, chi2, slope = self._coupling.run(stiffness, self._data, np.empty_like(stiffness))
        back = np.linalg.inv(turn)
        gradient = back.swapaxes(1, 2) @ slope @ back
        return chi2, (gradient + gradient.swapaxes(1, 2)) / 2


def _blocks(rows: Array) -> Array:
    """Vectors over lines, shape (..., k, lines), as rows (blocks, ..., k·width), zero-padded and aligned."""
    *lead, k, lines = rows.shape
    return lane_blocks(rows.reshape(-1, lines), _WIDTH).reshape(-1, *lead, k * _WIDTH)
