"""The modal model of measured FRFs: where its poles may be, weighted least squares for them, and further ones."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.frf import Quantity, quantity_factor
from jointbayes.measurement.polynomial_poles import polynomial_poles, steady_poles

Complex = NDArray[np.complex128]

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
#: So many lines apart what is left may hang together: a Hann window spreads over two.
_TOGETHER = 2
#: Damping ratios to start from where a residual stands out.
_TRIED_DAMPING = (0.001, 0.003, 0.01, 0.03)


class ModalProblem:
    """Weighted least squares for poles, with residues and the rest eliminated (variable projection).

    References
    ----------
    Golub, G., Pereyra, V. (2003). Separable nonlinear least squares: the variable projection method and its
    applications. Inverse Problems 19, R1. DOI 10.1088/0266-5611/19/2/201
    """

    def __init__(self, frequency_hz: Array, values: Complex, weight: Array, quantity: Quantity) -> None:
        self.omega = 2 * np.pi * frequency_hz
        self.values = values
        self.weight = weight
        self.factor = quantity_factor(frequency_hz, quantity)
        rest = self._rest()
        #: what lies outside the band is the same for all poles: it is taken out of everything once
        self.rest = [_orthonormal(_parts(w[:, None] * rest)) for w in weight.T]
        target = [_parts((weight * values)[:, k : k + 1]) for k in range(values.shape[1])]
        self.target = [(t - q @ (q.T @ t))[:, 0] for q, t in zip(self.rest, target, strict=True)]
        self._last: tuple[bytes, list[_Linear]] = (b"none", [])

    def climb(self, poles: Complex, *, fine: bool = False) -> Complex:
        """Poles of least squares, from a start; shape (modes,), rad/s."""
        for _ in range(_CLIMBS if poles.size else 0):
            least_fall = _FINE * self.chi2(poles) if fine else _ROUGH * self.price * self._misfit(poles)
            poles, ended_inside = self._climb_within_reach(poles, least_fall)
            if ended_inside:
                break
        return poles[np.argsort(np.abs(poles))]

    def _climb_within_reach(self, poles: Complex, least_fall: float) -> tuple[Complex, bool]:
        """Poles of least squares not far from the start, and whether none ended at the limit of that."""
        # steps are measured in half-power bandwidths, and damping stays positive
        centre, width = np.abs(poles), -poles.real

        def poles_at(x: Array) -> Complex:
            shift, log_growth = x.reshape(2, -1)
            return _pole(
                np.maximum(centre + width * shift, centre / 2), np.minimum(width / centre * np.exp(log_growth), 0.9)
            )

        def slopes(now: Complex) -> tuple[Array, Array]:
            """JᵀJ and Jᵀr, of steps in x."""
            scale = np.concatenate([width, -now.real / np.abs(now)])
            jacobian = np.hstack(self.jacobian(now)) * scale
            return jacobian.T @ jacobian, jacobian.T @ self._residual(now)

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

    def search(self, poles: Complex, order: int) -> Complex:
        """Poles of least squares: further ones join while they pay their price, and those that do not must go.

        Further ones are sought in what the fit leaves: its polynomial poles, and two modes in the place of one.
        The price is what the Bayesian information criterion asks for the numbers that a mode adds, two for its pole and
        two for each FRF, plus a margin; χ² is taken relative to its mean.
        """
        price = self.price
        poles = self._drop_idle(self.climb(poles), price)
        for _ in range(order // 2):
            least = self.chi2(poles) - price * self._misfit(poles)
            for start in self._further(poles, order, price):
                more = self._drop_idle(self.climb(start), price)
                if self.chi2(more) < least:
                    poles = more
                    break
            else:
                break
        return self.climb(poles, fine=True)

    @property
    def price(self) -> float:
        """What one mode more must improve χ² by."""
        return float((2 + 2 * self.values.shape[1]) * np.log(2 * self.values.size) + 10.0)

    def _further(self, poles: Complex, order: int, price: float) -> Iterator[Complex]:
        """Starts with one mode more, the most promising first."""
        residual = self.values - self.model(poles)
        square = (np.abs(self.weight * residual) ** 2).mean(axis=1)
        by_order = polynomial_poles(self.omega / (2 * np.pi), residual, self.weight, order)
        candidates = np.concatenate([steady_poles(by_order, 3), self._peaks(square)])
        gain = self.gain(poles, candidates) / self._misfit(poles)
        for i in np.argsort(gain)[::-1][:3]:
            if gain[i] > price:
                yield np.append(poles, candidates[i])
        for i, pole in enumerate(poles):
            width = -pole.real
            near = np.abs(self.omega - abs(pole)) < 3 * width
            # E of the mean is 1; its spread is 1/√n
            if near.any() and square[near].mean() > 1 + 4 / np.sqrt(near.sum() * self.values.shape[1]):
                yield np.append(np.delete(poles, i), [pole - 0.7j * width, pole + 0.7j * width])

    def _peaks(self, square: Array) -> Complex:
        """Poles at the lines that the fit explains worst, with dampings from a wide range."""
        smooth = np.convolve(square, np.full(5, 0.2), "same")
        worst: list[int] = []
        for line in np.argsort(smooth)[::-1]:
            if all(abs(line - other) > 5 for other in worst):
                worst.append(int(line))
            if len(worst) == 4:
                break
        return np.concatenate([_pole(self.omega[worst], np.full(len(worst), zeta)) for zeta in _TRIED_DAMPING])

    def _drop_idle(self, poles: Complex, price: float) -> Complex:
        while poles.size:
            frequency = np.abs(poles)
            near = (frequency >= self.omega[0] / _EDGE) & (frequency <= self.omega[-1] * _EDGE)
            if not near.all():
                poles = self.climb(poles[near])
                continue
            loss = self.losses(poles).sum(axis=0)
            worst = int(np.argmin(loss))
            if loss[worst] / self._misfit(poles) >= price:
                break
            poles = self.climb(np.delete(poles, worst))
        return poles

    def chi2(self, poles: Complex) -> float:
        """χ² of the best residues for these poles."""
        return float(np.sum(self._residual(poles) ** 2))

    def _misfit(self, poles: Complex) -> float:
        return max(1.0, self.chi2(poles) / self.freedom(poles.size))

    def model(self, poles: Complex) -> Complex:
        """Fitted FRFs, shape (lines, frfs)."""
        return self.values - self.residual(poles) / self.weight

    def residual(self, poles: Complex) -> Complex:
        """What the best residues for these poles leave, over the noise, shape (lines, frfs)."""
        real, imaginary = np.stack([fit.residual for fit in self._linear(poles)], axis=1).reshape(2, -1, len(self.rest))
        return np.asarray((real + 1j * imaginary) / np.sqrt(2))

    def losses(self, poles: Complex) -> Array:
        """By how much χ² of each FRF rises without each of the poles, shape (frfs, poles), before any climb."""
        rows = []
        for fit in self._linear(poles):
            inverse = scipy.linalg.solve_triangular(fit.r, np.eye(len(fit.r)))
            pairs = np.arange(2 * poles.size).reshape(2, -1).T
            blocks = np.einsum("pic,pjc->pij", inverse[pairs], inverse[pairs])
            residues = (inverse @ fit.shares)[pairs][:, :, None]
            rows.append((residues * np.linalg.solve(blocks, residues)).sum(axis=(1, 2)))
        return np.array(rows)

    def residues(self, poles: Complex) -> Complex:
        """In-phase and quadrature amplitudes of each pole as complex numbers, shape (frfs, poles)."""
        amplitudes = [scipy.linalg.lstsq(fit.r, fit.shares)[0] / fit.scale for fit in self._linear(poles)]
        in_phase, quadrature = np.array(amplitudes).reshape(len(amplitudes), 2, -1).swapaxes(0, 1)
        return np.asarray(in_phase + 1j * quadrature)

    def gain_by_line(self, poles: Complex, pole: int) -> Array:
        """At which lines one of the poles makes χ² smaller, shape (lines,), before any climb."""
        others = self._residual(np.delete(poles, pole)).reshape(len(self.rest), 2, -1)
        change = others - self._residual(poles).reshape(others.shape)
        return np.asarray((change**2).sum(axis=(0, 1)))

    def gain(self, poles: Complex, candidates: Complex) -> Array:
        """By how much χ² falls if one of the candidates is added, shape (candidates,), before any climb."""
        further = self._basis(candidates)[0]
        n = candidates.size
        total = np.zeros(n)
        for w, rest, fit in zip(self.weight.T, self.rest, self._linear(poles), strict=True):
            new = _parts(w[:, None] * further)
            for q in (rest, fit.q):
                new -= q @ (q.T @ new)
            # two columns each: in-phase and quadrature
            first = new[:, :n] / np.linalg.norm(new[:, :n], axis=0)
            second = new[:, n:] - first * np.sum(first * new[:, n:], axis=0)
            second /= np.linalg.norm(second, axis=0)
            total += (fit.residual @ first) ** 2 + (fit.residual @ second) ** 2
        return total

    def _rest(self) -> Complex:
        omega = self.omega[:, None]
        outside = np.array([r * self.omega[0] for r in _REST_BELOW] + [r * self.omega[-1] for r in _REST_ABOVE])
        one_pole = 1 / (outside**2 - omega**2)
        columns = [(1j * omega) ** np.array(_REST_POWERS), one_pole, 1j * omega * one_pole]
        rest = self.factor[:, None] * np.hstack(columns)
        return rest / np.abs(rest).max(axis=0)

    def freedom(self, modes: int) -> int:
        """Degrees of freedom of χ²: values less fitted numbers."""
        lines, frfs = (int(n) for n in self.values.shape)
        return max(1, 2 * lines * frfs - 2 * modes - frfs * (2 * modes + _REST_COLUMNS))

    def _basis(self, poles: Complex) -> tuple[Complex, Complex, Complex]:
        """Columns of the linear model, and those of the modes differentiated by ω_r and by ζ.

        Mode r has the columns ω_r²/D and jωω_r/D with D = ω_r² − ω² + 2jζω_rω, each times (jω)ⁿ of the quantity: real
        coefficients of both allow complex modes.
        """
        omega_r, zeta = np.abs(poles)[None, :], (-poles.real / np.abs(poles))[None, :]
        omega = self.omega[:, None]
        factor = self.factor[:, None] / np.abs(self.factor).max()
        d = omega_r**2 - omega**2 + 2j * zeta * omega_r * omega
        upper = np.hstack([omega_r**2 + 0 * omega, 1j * omega * omega_r])
        upper_by_omega = np.hstack([2 * omega_r + 0 * omega, 1j * omega + 0 * omega_r])
        d2, d2_by_omega = np.hstack([d, d]), np.hstack([2 * omega_r + 2j * zeta * omega] * 2)
        d2_by_zeta = np.hstack([2j * omega_r * omega] * 2)
        modal = factor * upper / d2
        by_omega = factor * (upper_by_omega / d2 - upper * d2_by_omega / d2**2)
        by_zeta = -factor * upper * d2_by_zeta / d2**2
        return modal, by_omega, by_zeta

    def _residual(self, poles: Complex) -> Array:
        return np.concatenate([fit.residual for fit in self._linear(poles)])

    def _linear(self, poles: Complex) -> list["_Linear"]:
        """Best residues of each FRF for these poles; those of the last poles asked for are kept."""
        if self._last[0] != poles.tobytes():
            basis, fits = self._basis(poles)[0], []
            for w, rest, target in zip(self.weight.T, self.rest, self.target, strict=True):
                columns = _parts(w[:, None] * basis)
                columns -= rest @ (rest.T @ columns)
                scale = np.linalg.norm(columns, axis=0)
                q, r = np.linalg.qr(columns / scale)
                shares = q.T @ target
                fits.append(_Linear(q, r, scale, shares, target - q @ shares))
            self._last = poles.tobytes(), fits
        return self._last[1]

    def jacobian(self, poles: Complex) -> tuple[Array, Array]:
        """Derivatives of the residuals by each ω_r and each ζ, shape (values, modes) each, after Kaufman (1975)."""
        _, by_omega, by_zeta = self._basis(poles)
        n = poles.size
        blocks: list[Array] = []
        for w, rest, fit in zip(self.weight.T, self.rest, self._linear(poles), strict=True):
            amplitude = scipy.linalg.lstsq(fit.r, fit.shares)[0] / fit.scale
            slope = _parts(
                w[:, None]
                * np.hstack([d[:, :n] * amplitude[:n] + d[:, n:] * amplitude[n:] for d in (by_omega, by_zeta)])
            )
            for q in (rest, fit.q):
                slope -= q @ (q.T @ slope)
            blocks.append(-slope)
        both = np.vstack(blocks)
        return both[:, :n], both[:, n:]

    def covariance(self, poles: Complex) -> Array:
        """Covariance of (ω₁ … ω_n, ζ₁ … ζ_n) of poles of least squares, shape (2n, 2n).

        The inverse of JᵀJ, widened where what is left at the lines that tell of a number is larger than the noise, or
        hangs together over neighbouring lines or FRFs.
        """
        jacobian = np.hstack(self.jacobian(poles))
        scale = np.linalg.norm(jacobian, axis=0)
        inverse = np.linalg.pinv((jacobian / scale).T @ (jacobian / scale), rcond=1e-14, hermitian=True)
        lines, frfs = self.values.shape
        influence = ((jacobian / scale) @ inverse).reshape(frfs, 2, lines, -1)
        residual = self._residual(poles).reshape(frfs, 2, lines)
        by_line = np.einsum("fplk,fpl->lk", influence, residual)
        square = np.sum(by_line**2, axis=0)
        for shift in range(1, _TOGETHER + 1):
            square = square + 2 * np.sum(by_line[shift:] * by_line[:-shift], axis=0)
        widening = np.sqrt(np.maximum(square / np.diag(inverse), self._misfit(poles))) / scale
        return np.asarray(inverse * np.outer(widening, widening))


@dataclass(frozen=True, slots=True, eq=False)
class _Linear:
    """Best residues of one FRF: columns scaled and orthonormal, shares of the target in them, and what is left."""

    q: Array
    r: Array
    scale: Array
    shares: Array
    residual: Array


def _pole(omega_r: Array, zeta: Array) -> Complex:
    return omega_r * (-zeta + 1j * np.sqrt(1 - zeta**2))


def _parts(columns: Complex) -> Array:
    """Real and imaginary parts over each other, scaled so that noise of σ² = E|δH|² = 1 has unit variance in each."""
    return np.sqrt(2.0) * np.vstack([columns.real, columns.imag])


def _orthonormal(columns: Array) -> Array:
    return np.linalg.qr(columns / np.linalg.norm(columns, axis=0), "reduced")[0]
