"""The modal model of measured FRFs: where its poles may be, weighted least squares for them, and further ones.

Starting values are poles of polynomial models that are stable over rising order.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.linalg

from vibrecords.arrays import Array, ComplexArray, Lines, Quantity, quantity_factor

#: The band covers this much of the unit circle; the polynomials wrap round, the FRF does not.
_ARC = 0.95
#: A pole more damped than this is not a mode that lines in the band can show.
_MOST_DAMPING = 0.3
#: Two poles are the same one if they are closer than this fraction of their distance from the imaginary axis.
_SAME = 0.5
#: What modes outside the band leave inside it: powers of jω, and undamped poles at these multiples of its ends.
_REST_POWERS = (-2, -1, 0, 1)
_REST_BELOW = (0.5, 0.8)
_REST_ABOVE = (1.15, 1.5, 2.5)
_REST_COLUMNS = len(_REST_POWERS) + 2 * len(_REST_BELOW + _REST_ABOVE)
#: One climb goes no further than this many half-power bandwidths and this much in ln ζ; so many climbs in a row.
_REACH = (3.0, 1.5)
_CLIMBS = 3
#: A mode this far outside the band may join the fit, which without it would bend the modes inside.
_EDGE = 1.1
#: A climb ends where χ² falls by less: while searching, in prices of a mode, and at last, relative to χ².
_ROUGH, _FINE = 0.03, 1e-10
#: Added to squares of rows of unit length, which rounding may leave without an inverse.
_ROUNDING = 1e-13
#: Poles of a piece of the band that is searched by itself.
_IN_A_PIECE = 5
#: The noise about a pole is judged within so many half-power widths of it, and so many lines at least.
_REACH_WIDTHS, _REACH_LINES = 4.0, 64
#: What is not worth its price without so many of its lines is no resonance.
ON_LINES = 3
#: Damping ratios to start from where a residual stands out.
_TRIED_DAMPING = (0.001, 0.003, 0.01, 0.03)


class ModalProblem:
    """Weighted least squares for poles, with residues and the rest eliminated (variable projection).

    References
    ----------
    Golub, G., Pereyra, V. (2003). Separable nonlinear least squares: the variable projection method and its
    applications. Inverse Problems 19, R1. DOI 10.1088/0266-5611/19/2/201
    Kaufman, L. (1975). A variable projection method for solving separable nonlinear least squares problems. BIT 15, 49.
    """

    def __init__(self, frequency_hz: Array, values: ComplexArray, weight: Array, quantity: Quantity) -> None:
        self.omega = 2 * np.pi * frequency_hz
        self.values = values
        self.weight = weight
        self.quantity = quantity
        self.factor = quantity_factor(frequency_hz, quantity)
        #: real and imaginary parts in turn: noise of σ² = E|δH|² = 1 has unit variance in each
        self.both_weights = np.sqrt(2.0) * np.repeat(weight.T, 2, axis=1)
        #: what lies outside the band is the same for all poles: it is taken out of everything once
        outside = np.array([r * self.omega[0] for r in _REST_BELOW] + [r * self.omega[-1] for r in _REST_ABOVE])
        one_pole = 1 / (outside[:, None] ** 2 - self.omega**2)
        rows = [(1j * self.omega) ** np.array(_REST_POWERS)[:, None], one_pole, 1j * self.omega * one_pole]
        rest = self.factor * np.vstack(rows)
        of_size_1 = (rest / np.abs(rest).max(axis=1)[:, None]).view(float)
        weighted = [w * of_size_1 for w in self.both_weights]
        of_length_1 = [each / np.linalg.norm(each, axis=1)[:, None] for each in weighted]
        self.rest = [np.ascontiguousarray(np.linalg.qr(each.T, "reduced")[0].T) for each in of_length_1]
        targets = self.both_weights * np.ascontiguousarray(values.T).view(float)
        self.target = [t - (rest @ t) @ rest for rest, t in zip(self.rest, targets, strict=True)]
        self._last: tuple[bytes, list[_Linear]] = (b"none", [])

    def climb(self, poles: ComplexArray, *, fine: bool = False) -> ComplexArray:
        """Poles of least squares, from a start; shape (modes,), rad/s."""
        for _ in range(_CLIMBS if poles.size else 0):
            least_fall = _FINE * self.chi2(poles) if fine else _ROUGH * self.price * self._misfit(poles)
            poles, ended_inside = self._climb_within_reach(poles, least_fall)
            if ended_inside:
                break
        return poles[np.argsort(np.abs(poles))]

    def _climb_within_reach(self, poles: ComplexArray, least_fall: float) -> tuple[ComplexArray, bool]:
        """Poles of least squares not far from the start, and whether none ended at the limit of that."""
        # steps are measured in half-power bandwidths, and damping stays positive
        centre, width = np.abs(poles), -poles.real

        def poles_at(x: Array) -> ComplexArray:
            shift, log_growth = x.reshape(2, -1)
            zeta = np.minimum(width / centre * np.exp(log_growth), 0.9)
            return pole_of(np.maximum(centre + width * shift, centre / 2), zeta)

        def slopes(now: ComplexArray) -> tuple[Array, Array]:
            """JᵀJ and Jᵀr, of steps in x."""
            scale = np.concatenate([width, -now.real / np.abs(now)])
            square, slope = self._normal(now)
            return square * np.outer(scale, scale), slope * scale

        reach = np.repeat(_REACH, poles.size)
        x, now, least, damping = np.zeros(2 * poles.size), poles, self.chi2(poles), 1e-3
        square, slope = slopes(now)
        for _ in range(40):  # Levenberg-Marquardt
            step = -scipy.linalg.lstsq(square + damping * np.diag(np.diag(square)), slope)[0]
            further = np.clip(x + step, -reach, reach)
            fallen = least - self.chi2(poles_at(further))
            if fallen > 0:
                x, now, least, damping = further, poles_at(further), least - fallen, damping / 10
                if fallen < least_fall:
                    break
                square, slope = slopes(now)
            elif damping > 1e6 or np.abs(further - x).max() < 1e-9:
                break
            else:
                damping *= 10
        return now, bool((np.abs(x) < 0.95 * reach).all())

    def search(self, poles: ComplexArray, order: int) -> ComplexArray:
        """Poles, roughly climbed piece by piece: further ones join while they pay their price, idle ones must go."""
        poles = self.by_pieces(poles, lambda piece, some: piece._search_piece(some, order))
        # what two pieces found of one mode is idle
        return self._drop_idle(poles)

    def by_pieces(
        self, poles: ComplexArray, improved: Callable[["ModalProblem", ComplexArray], ComplexArray]
    ) -> ComplexArray:
        """Poles improved by a few of a piece of the band at a time, the modes elsewhere being as they are.

        A mode tells of itself in its neighbourhood: a piece reaches one pole further than those that it answers for.
        What the others leave in it is nearly smooth, and is fitted with the rest.
        """
        poles = poles[np.argsort(np.abs(poles))]
        pieces = -(-poles.size // _IN_A_PIECE)
        if pieces < 2:
            return improved(self, poles)
        gaps, apart = _gaps(poles)
        nominal = np.linspace(0, poles.size, pieces + 1).round().astype(int)[1:-1].tolist()
        ends = [0, *(k - 1 + int(np.argmax(apart[k - 1 : k + 2])) for k in nominal)]
        answers = []
        for first, last in pairwise([*ends, poles.size]):
            low, high = max(first - 2, 0), min(last + 2, poles.size)
            answer = improved(self._piece(poles, low, high), poles[low:high])
            answers.append(answer[(np.abs(answer) >= gaps[first]) & (np.abs(answer) < gaps[last])])
        return np.concatenate(answers)

    def without(self, poles: ComplexArray, pole: int) -> tuple[ComplexArray, float]:
        """Poles, in order, without one of them, its neighbours climbed; and by how much χ² rises about them."""
        low, high = max(pole - 3, 0), min(pole + 4, poles.size)
        piece, before = self._piece(poles, low, high, whole=True), poles[low:high]
        after = piece.climb(np.delete(before, pole - low))
        return np.concatenate([poles[:low], after, poles[high:]]), piece.chi2(after) - piece.chi2(before)

    def _piece(self, poles: ComplexArray, low: int, high: int, *, whole: bool = False) -> "ModalProblem":
        """The problem of some of the poles, which are in order, without what is fitted of the others."""
        if high - low == poles.size:
            return self
        gaps = _gaps(poles)[0]
        lines = (self.omega >= gaps[low]) & (self.omega <= gaps[high]) | whole
        others = np.ones(poles.size, dtype=bool)
        others[low:high] = False
        amplitudes = self.residues(poles)[:, others]
        in_phase, quadrature = np.vsplit(self._basis(poles[others], lines), 2)
        values = self.values[lines] - (amplitudes.real @ in_phase + amplitudes.imag @ quadrature).T
        return ModalProblem(self.omega[lines] / (2 * np.pi), values, self.weight[lines], self.quantity)

    def _search_piece(self, poles: ComplexArray, order: int) -> ComplexArray:
        """Poles with further ones from what the fit leaves, among them two modes in the place of one.

        The price is what the Bayesian information criterion asks for the numbers that a mode adds, two for its pole and
        two for each FRF, plus a margin; χ² is taken relative to its mean.
        """
        poles = self._drop_idle(self.climb(poles), even=True)
        for _ in range(order // 2):
            least = self.chi2(poles) - self.price * self._misfit(poles)
            for start in self._further(poles, order):
                more = self._drop_idle(self.climb(start), even=True)
                if self.chi2(more) < least:
                    poles = more
                    break
            else:
                break
        return poles

    @property
    def price(self) -> float:
        """What one mode more must improve χ² by."""
        return float((2 + 2 * self.values.shape[1]) * np.log(2 * self.values.size) + 10.0)

    def _further(self, poles: ComplexArray, order: int) -> Iterator[ComplexArray]:
        """Starts with one mode more, the most promising first."""
        residual = self.values - self.model(poles)
        square = (np.abs(self.weight * residual) ** 2).mean(axis=1)
        by_order = polynomial_poles(self.omega / (2 * np.pi), residual, self.weight, min(order, self.omega.size // 4))
        # poles at the lines that the fit explains worst, with dampings from a wide range
        smooth, worst = np.convolve(square, np.full(5, 0.2), "same"), list[int]()
        for line in np.argsort(smooth)[::-1].tolist():
            if len(worst) < 4 and all(abs(line - other) > 5 for other in worst):
                worst.append(line)
        peaks = [pole_of(self.omega[worst], np.full(len(worst), zeta)) for zeta in _TRIED_DAMPING]
        candidates = np.concatenate([steady_poles(by_order, 3), *peaks])
        misfit = self._misfit(poles)
        gain = self.gain(poles, candidates) / misfit
        for i in np.argsort(gain)[::-1][:3]:
            if gain[i] > self.price:
                yield np.append(poles, candidates[i])
        for i, pole in enumerate(poles):
            width = -pole.real
            near = np.abs(self.omega - abs(pole)) < 3 * width
            # the mean has a spread of 1/√n
            if near.any() and square[near].mean() > misfit * (1 + 4 / np.sqrt(near.sum() * self.values.shape[1])):
                yield np.append(np.delete(poles, i), [pole - 0.7j * width, pole + 0.7j * width])

    def _drop_idle(self, poles: ComplexArray, *, even: bool = False) -> ComplexArray:
        """Poles that are worth their price, the noise about each as it is or, while modes are missing, even."""
        while poles.size:
            frequency = np.abs(poles)
            near = (frequency >= self.omega[0] / _EDGE) & (frequency <= self.omega[-1] * _EDGE)
            if not near.all():
                poles = self.climb(poles[near])
                continue
            support = self.losses(poles).sum(axis=0) / (self._misfit(poles) if even else self.inflation(poles))
            worst = int(np.argmin(support))
            if support[worst] >= self.price:
                break
            poles = self.climb(np.delete(poles, worst))
        return poles

    def chi2(self, poles: ComplexArray) -> float:
        """χ² of the best residues for these poles."""
        return float(sum(fit.residual @ fit.residual for fit in self._linear(poles)))

    def inflation(self, poles: ComplexArray) -> Array:
        """By how much more than its stated variance noise counts for each pole, shape (poles,), at least 1."""
        at, about, correlated = self.noise_about(poles)
        return np.maximum(1.0, np.maximum(at, about)) * correlated

    def noise_about(self, poles: ComplexArray) -> Array:
        """Powers of what is left at and about each pole, over the noise, and by how much correlation multiplies them.

        Shape (3, poles).

        A pole is told by the projection of the FRFs on its response s over the lines. The power at the pole is the mean
        weighted by |s|². About it, it is that mean without the lines that tell most, or the median if it is larger. A
        band where the force is nearly zero has more than the stated power. Noise that decays over the block as
        exp(−2at), as behind an exponential window, has a correlation of 1/(1 + jΔω/2a) over one line. It counts by the
        mean of its power over the block, weighted by the energy exp(−2σt) of the pole's ring-down.
        """
        residual, step, noise = self.residual(poles), np.gradient(self.omega), np.ones((3, poles.size))
        square, tiny = np.abs(residual) ** 2, np.finfo(float).tiny
        for i, pole in enumerate(poles):
            energy = self.part_of(poles, i)
            rest = np.sort(energy.sum(axis=1))[-ON_LINES - 1] >= energy.sum(axis=1)
            noise[:2, i] = [np.average(square[some], weights=energy[some] + tiny) for some in (slice(None), rest)]
            at = np.clip(abs(pole), self.omega[0], self.omega[-1])
            line_step = step[np.searchsorted(self.omega, at)]
            near = np.abs(self.omega - at) <= max(-_REACH_WIDTHS * 2 * pole.real, _REACH_LINES * line_step)
            share, r, p = energy.sum(axis=0) / (energy.sum() + tiny), residual[near], square[near]
            noise[1, i] = max(noise[1, i], share @ np.median(p, axis=0) / np.log(2))
            together = (r[1:] * r[:-1].conj()).real.sum(axis=0) / (p.sum(axis=0) + tiny)
            correlation = share @ together
            correlation = np.clip(correlation - (1 - correlation**2) / np.sqrt(p.size), 1e-6, 1 - 1e-6)
            decays = 2 * np.pi * np.array([(1 / correlation - 1) ** -0.5, -2 * pole.real / line_step])
            fallen = -np.expm1(-np.append(decays, decays.sum())) / np.append(decays, decays.sum())
            noise[2, i] = fallen[2] / (fallen[0] * fallen[1])
        return noise

    def part_of(self, poles: ComplexArray, pole: int) -> Array:
        """Square of what one of the poles adds to the FRFs, over the noise, shape (lines, frfs)."""
        pair = [pole, pole + poles.size]
        parts = [(fit.amplitudes[pair] @ fit.rows[pair]).view(complex) for fit in self._linear(poles)]
        return np.abs(np.column_stack(parts)) ** 2 / 2

    def _misfit(self, poles: ComplexArray) -> float:
        return max(1.0, self.chi2(poles) / self.freedom(poles.size))

    def model(self, poles: ComplexArray) -> ComplexArray:
        """Fitted FRFs, shape (lines, frfs)."""
        return self.values - self.residual(poles) / self.weight

    def residual(self, poles: ComplexArray) -> ComplexArray:
        """What the best residues for these poles leave, over the noise, shape (lines, frfs)."""
        return np.column_stack([fit.residual.view(complex) for fit in self._linear(poles)]) / np.sqrt(2)

    def losses(self, poles: ComplexArray) -> Array:
        """By how much χ² of each FRF rises without each of the poles, shape (frfs, poles), before any climb."""
        rows = []
        for fit in self._linear(poles):
            pairs = np.arange(2 * poles.size).reshape(2, -1).T
            amplitudes, blocks = fit.amplitudes[pairs][:, :, None], fit.inverse[pairs[:, :, None], pairs[:, None]]
            rows.append((amplitudes * np.linalg.solve(blocks, amplitudes)).sum(axis=(1, 2)))
        return np.array(rows)

    def residues(self, poles: ComplexArray) -> ComplexArray:
        """In-phase and quadrature amplitudes of each pole as complex numbers, shape (frfs, poles)."""
        amplitudes = np.array([fit.amplitudes for fit in self._linear(poles)])
        return np.asarray(amplitudes[:, : poles.size] + 1j * amplitudes[:, poles.size :])

    def in_phase(self, poles: ComplexArray) -> tuple[Array, Array]:
        """In-phase amplitudes of each pole and their standard deviations, with the poles as given, (frfs, poles).

        Widened by what the fit leaves of each FRF, where that is more than its noise.
        """
        fits, few = self._linear(poles), slice(poles.size)
        freedom = max(1, 2 * self.omega.size - 2 * poles.size - _REST_COLUMNS)
        misfit = np.array([max(1.0, float(fit.residual @ fit.residual) / freedom) for fit in fits])
        variance = np.array([np.diag(fit.inverse)[few] for fit in fits])
        return np.array([fit.amplitudes[few] for fit in fits]), np.sqrt(variance * misfit[:, None])

    def gain_by_line(self, poles: ComplexArray, pole: int) -> Array:
        """At which lines one of the poles makes χ² smaller, shape (lines,), before any climb."""
        total = np.zeros(self.omega.size)
        pair = [pole, pole + poles.size]
        for fit, rest in zip(self._linear(poles), self.rest, strict=True):
            # what the pole's two rows explain that the others cannot
            shares = np.linalg.solve(fit.inverse[np.ix_(pair, pair)], fit.amplitudes[pair]) @ fit.inverse[pair]
            explained = shares @ fit.rows - (shares @ fit.on_rest) @ rest
            total += ((fit.residual + explained) ** 2 - fit.residual**2).reshape(-1, 2).sum(axis=1)
        return total

    def gain(self, poles: ComplexArray, candidates: ComplexArray) -> Array:
        """By how much χ² falls if one of the candidates is added, shape (candidates,), before any climb."""
        further = self._basis(candidates).view(float)
        pairs = np.arange(2 * candidates.size).reshape(2, -1).T
        total = np.zeros(candidates.size)
        for w, rest, fit in zip(self.both_weights, self.rest, self._linear(poles), strict=True):
            new = w * further
            new /= np.linalg.norm(new, axis=1)[:, None]
            on_rest = new @ rest.T
            on_rows = new @ fit.rows.T - on_rest @ fit.on_rest.T
            square = new @ new.T - on_rest @ on_rest.T - on_rows @ fit.inverse @ on_rows.T
            slope = (new @ fit.residual)[pairs][:, :, None]
            blocks = square[pairs[:, :, None], pairs[:, None]] + _ROUNDING * np.eye(2)
            total += (slope * np.linalg.solve(blocks, slope)).sum(axis=(1, 2))
        return total

    def freedom(self, modes: int) -> int:
        """Degrees of freedom of χ²: values less fitted numbers."""
        lines, frfs = (int(n) for n in self.values.shape)
        return max(1, 2 * lines * frfs - 2 * modes - frfs * (2 * modes + _REST_COLUMNS))

    def _basis(self, poles: ComplexArray, lines: Lines = slice(None)) -> ComplexArray:
        """Rows of the linear model: mode r has ω_r²/D and jωω_r/D, shape (2 modes, lines).

        D = ω_r² − ω² + 2jζ_r ω_r ω, each times (jω)ⁿ of the quantity: real coefficients of both allow complex modes.
        """
        omega_r, per_d = np.abs(poles)[:, None], self._per_denominator(poles, lines)
        return np.vstack([omega_r**2 * per_d, 1j * self.omega[lines] * (omega_r * per_d)])

    def _per_denominator(self, poles: ComplexArray, lines: Lines = slice(None)) -> ComplexArray:
        omega_r, omega = np.abs(poles)[:, None], self.omega[lines]
        d = np.empty((poles.size, omega.size), dtype=complex)
        d.real = (omega_r - omega) * (omega_r + omega)
        d.imag = -2 * poles.real[:, None] * omega
        return np.asarray(self.factor[lines] / np.abs(self.factor).max() / d)

    def _linear(self, poles: ComplexArray) -> list["_Linear"]:
        """Return the best residues of each FRF for these poles, and keep them until other poles are asked for."""
        if self._last[0] != poles.tobytes():
            basis, fits = self._basis(poles).view(float), []
            for w, rest, target in zip(self.both_weights, self.rest, self.target, strict=True):
                rows = w * basis
                on_rest, square = rows @ rest.T, rows @ rows.T
                scale = np.sqrt(np.outer(np.diag(square), np.diag(square)))
                square = (square - on_rest @ on_rest.T) / scale + _ROUNDING * np.eye(len(rows))
                inverse = scipy.linalg.cho_solve(scipy.linalg.cho_factor(square), np.eye(len(rows))) / scale
                amplitudes = inverse @ (rows @ target)
                residual = target - amplitudes @ rows + (amplitudes @ on_rest) @ rest
                fits.append(_Linear(rows, on_rest, inverse, amplitudes, residual))
            self._last = poles.tobytes(), fits
        return self._last[1]

    def _normal(self, poles: ComplexArray) -> tuple[Array, Array]:
        """JᵀJ, shape (2n, 2n), and Jᵀr of all FRFs, by each ω_r, then each ζ_r.

        The Jacobian, but for its sign, is what neither the rest nor the rows explain of the derivatives (Kaufman).
        """
        jtj, jtr = np.zeros((2 * poles.size, 2 * poles.size)), np.zeros(2 * poles.size)
        omega_r, zeta, omega = np.abs(poles)[:, None], (-poles.real / np.abs(poles))[:, None], self.omega
        per_d = self._per_denominator(poles)
        square = per_d * per_d / (self.factor / np.abs(self.factor).max())
        by_denominator = np.vstack([(2 * omega_r + 2j * zeta * omega) * square, 2j * omega * omega_r * square])
        of_in_phase = -np.tile(omega_r**2, (2, 1)) * by_denominator
        of_quadrature = -1j * omega * (np.tile(omega_r, (2, 1)) * by_denominator)
        of_in_phase[: poles.size] += 2 * omega_r * per_d
        of_quadrature[: poles.size] += 1j * omega * per_d
        of_in_phase, of_quadrature = of_in_phase.view(float), of_quadrature.view(float)
        for w, rest, fit in zip(self.both_weights, self.rest, self._linear(poles), strict=True):
            in_phase, quadrature = np.tile(fit.amplitudes.reshape(2, -1), (1, 2))[:, :, None]
            by_pole = in_phase * of_in_phase
            by_pole += quadrature * of_quadrature
            by_pole *= w
            on_rest = by_pole @ rest.T
            on_rows = by_pole @ fit.rows.T - on_rest @ fit.on_rest.T
            jtj += by_pole @ by_pole.T - on_rest @ on_rest.T - on_rows @ fit.inverse @ on_rows.T
            jtr -= by_pole @ fit.residual
        return jtj, jtr

    def covariance(self, poles: ComplexArray) -> Array:
        """Covariance of (ω₁ … ω_n, ζ₁ … ζ_n) of poles of least squares, shape (2n, 2n).

        The inverse of JᵀJ, widened by the `inflation` of each pole.
        """
        square, _ = self._normal(poles)
        scale = np.sqrt(np.diag(square))
        inverse = np.linalg.pinv(square / np.outer(scale, scale), rcond=1e-14, hermitian=True)
        widening = np.tile(np.sqrt(self.inflation(poles)), 2) / scale
        return np.asarray(inverse * np.outer(widening, widening))

    def damping_sd(self, poles: ComplexArray) -> Array:
        """Standard deviations of the damping ratios, shape (poles,)."""
        return np.sqrt(np.diag(self.covariance(poles))[poles.size :])


@dataclass(frozen=True, slots=True, eq=False)
class _Linear:
    """Best residues of one FRF: rows X, their shares of the rest, (XXᵀ)⁻¹ without it, and what is left."""

    rows: Array
    on_rest: Array
    inverse: Array
    amplitudes: Array
    residual: Array


def _gaps(poles: ComplexArray) -> tuple[Array, Array]:
    """Where between neighbours of ordered poles, nearer to the narrower, and how many half-power widths they are apart.

    Both have an entry before the first pole and one after the last, shape (poles + 1,).
    """
    at, width = np.abs(poles), -poles.real
    both, apart = width[:-1] + width[1:], np.diff(at)
    gaps = np.concatenate([[0.0], at[:-1] + apart * width[:-1] / both, [np.inf]])
    return gaps, np.concatenate([[0.0], apart / both, [0.0]])


def pole_of(omega_r: Array, zeta: Array) -> ComplexArray:
    """λ = ω_r (−ζ + j√(1 − ζ²)) of natural frequencies, rad/s, and damping ratios, any shape."""
    return omega_r * (-zeta + 1j * np.sqrt(1 - zeta**2))


def polynomial_poles(frequency_hz: Array, values: ComplexArray, weight: Array, max_order: int) -> list[ComplexArray]:
    """Poles of common-denominator models of rising order, those only that a damped mode in the band can have.

    Each FRF is B_k(z)/A(z) with complex polynomials in z = exp(−jτ(ω − ω₁)), which maps the band to the unit circle.
    The linear residuals B_k − A H_k, weighted, are minimised with the B_k eliminated. The last coefficient of A is
    fixed to 1, so that poles that only follow noise tend to come out unstable and can be told by that.

    Parameters
    ----------
    frequency_hz
        Lines, shape (lines,), Hz; need not be even.
    values
        FRFs, shape (lines, frfs).
    weight
        One over the standard deviation of the noise, shape as `values`.
    max_order
        Highest order of A.

    Returns
    -------
    list
        Poles of each order from 2 to `max_order`.

    References
    ----------
    Guillaume, P., Verboven, P., Vanlanduit, S., Van der Auweraer, H., Peeters, B. (2003). A poly-reference
    implementation of the least-squares complex frequency-domain estimator. Proc. IMAC XXI.
    Verboven, P. (2002). Frequency-domain system identification for modal analysis. PhD thesis, VUB, section 5.3.3.
    """
    omega = 2 * np.pi * frequency_hz
    tau = 2 * np.pi * _ARC / (omega[-1] - omega[0])
    powers = np.exp(-1j * tau * np.outer(omega - omega[0], np.arange(max_order + 1)))
    reduced = np.zeros((max_order + 1, max_order + 1), dtype=complex)
    eliminated = []
    for h, w in zip(values.T, weight.T, strict=True):
        x = w[:, None] * powers
        y = -h[:, None] * x
        # the first columns of the orthonormal x R⁻¹ serve the lower orders
        triangle = np.linalg.qr(x, mode="r")
        eliminated.append(scipy.linalg.solve_triangular(triangle, x.conj().T @ y, trans="C"))
        reduced += y.conj().T @ y
    poles_by_order = []
    for order in range(2, max_order + 1):
        used = slice(0, order + 1)
        matrix = reduced[used, used] - sum(part[used, used].conj().T @ part[used, used] for part in eliminated)
        ascending = np.append(scipy.linalg.lstsq(matrix[:order, :order], -matrix[:order, order])[0], 1.0)
        roots = np.roots(ascending[::-1])
        # ln z = −τ(λ − jω₁); the band is the arc from 0 to −2π·_ARC
        angle = np.mod(-np.angle(roots), 2 * np.pi)
        poles = 1j * omega[0] + (-np.log(np.abs(roots)) + 1j * angle) / tau
        frequency = np.abs(poles)
        damping = -poles.real / frequency
        in_band = (frequency > omega[0]) & (frequency < omega[-1])
        poles_by_order.append(poles[in_band & (damping > 0) & (damping < _MOST_DAMPING)])
    return poles_by_order


def steady_poles(by_order: list[ComplexArray], least: int) -> ComplexArray:
    """Poles that appear again and again as the order rises: the stabilisation diagram, read without an eye.

    From the highest order down each pole is followed through the lower orders; it counts if at least `least` orders
    have one within half its distance from the imaginary axis. The median of each such family is returned.

    Parameters
    ----------
    by_order
        Poles of each order, the lowest order first.
    least
        In how many orders a pole must be found.

    Returns
    -------
    ndarray, shape (n,)
        Poles in rad/s, by rising frequency.
    """
    kept: list[complex] = []
    taken = [np.zeros(p.size, dtype=bool) for p in by_order]
    for top in range(len(by_order) - 1, -1, -1):
        for pole in by_order[top][~taken[top]]:
            family = []
            for poles, used in zip(by_order[: top + 1], taken, strict=False):
                if poles.size:
                    near = int(np.argmin(np.abs(poles - pole)))
                    if not used[near] and abs(poles[near] - pole) < _SAME * abs(pole.real):
                        family.append(poles[near])
                        used[near] = True
            if len(family) >= least:
                kept.append(complex(np.median(np.real(family)), np.median(np.imag(family))))
    return np.array(sorted(kept, key=abs), dtype=complex)
