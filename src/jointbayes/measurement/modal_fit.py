"""Natural frequencies and damping ratios from measured FRFs, with standard deviations and without an eye on a diagram."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import NDArray

from jointbayes.errors import MeasurementError
from jointbayes.frf import FrfSet, quantity_factor
from jointbayes.measurement.pole_search import polynomial_poles, steady_poles

__all__ = ["MeasuredMode", "ModalFit", "fit_modes", "identify_modes"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: What modes outside the band leave inside it: powers of jω, and undamped poles at these multiples of its ends.
_REST_POWERS = (-2, -1, 0, 1)
_REST_BELOW = (0.5, 0.8)
_REST_ABOVE = (1.15, 1.5, 2.5)
_REST_COLUMNS = len(_REST_POWERS) + 2 * len(_REST_BELOW + _REST_ABOVE)


@dataclass(frozen=True, slots=True)
class MeasuredMode:
    """One mode found in measured FRFs.

    Parameters
    ----------
    frequency_hz, frequency_sd_hz
        Undamped natural frequency |λ|/2π and its standard deviation, Hz.
    damping_ratio, damping_sd
        Damping ratio −Re λ/|λ| and its standard deviation.
    """

    frequency_hz: float
    frequency_sd_hz: float
    damping_ratio: float
    damping_sd: float


@dataclass(frozen=True, slots=True, eq=False)
class ModalFit:
    """Modes of a set of FRFs and the modal model fitted with them.

    Parameters
    ----------
    modes
        By rising frequency.
    values
        The model's FRFs, shape (lines, outputs, inputs), in the quantity of the data.
    misfit
        χ² per degree of freedom: 1 where the model explains the data within the stated noise.
    """

    modes: tuple[MeasuredMode, ...]
    values: Complex
    misfit: float


def identify_modes(
    frf: FrfSet,
    variance: Array | None = None,
    *,
    f_min_hz: float | None = None,
    f_max_hz: float | None = None,
    max_order: int = 40,
) -> tuple[MeasuredMode, ...]:
    """Natural frequencies and damping ratios of the modes that FRFs show, with standard deviations.

    Poles that keep still while the order of a least-squares complex frequency-domain model rises are the start of a
    weighted least-squares fit of the modal model: two real numbers for each mode and FRF, and seven for each FRF for the
    modes outside the band. A mode stays only if it improves the fit by more than the search for one in pure noise would.
    Standard deviations come from the Jacobian of that fit, and are widened by √(χ² per degree of freedom) where the
    model does not explain the data within the stated noise.

    Parameters
    ----------
    frf
        FRFs of one structure, of any quantity.
    variance
        σ² = E|δH|² of both parts together, shape as ``frf.values``. If None, it is estimated from what the fit leaves.
    f_min_hz, f_max_hz
        Band to look at; by default all of it. Only modes inside are returned.
    max_order
        Highest order of the polynomial models: at least three times the number of modes expected.

    Returns
    -------
    tuple
        Modes by rising frequency; empty where none stands out of the noise.

    Raises
    ------
    MeasurementError
        If the band holds too few lines, or the variance has another shape or is not positive.
    """
    return fit_modes(frf, variance, f_min_hz=f_min_hz, f_max_hz=f_max_hz, max_order=max_order).modes


def fit_modes(
    frf: FrfSet,
    variance: Array | None = None,
    *,
    f_min_hz: float | None = None,
    f_max_hz: float | None = None,
    max_order: int = 40,
) -> ModalFit:
    """As `identify_modes`, with the fitted FRFs (in the band) and the misfit as well."""
    low, high = f_min_hz or 0.0, f_max_hz or np.inf
    inside = (frf.frequency_hz >= low) & (frf.frequency_hz <= high)
    n_lines = int(inside.sum())
    if n_lines < _FEWEST_LINES:
        raise MeasurementError(
            f"modal fit: found {n_lines} lines between {low:g} and {high:g} Hz; expected {_FEWEST_LINES} or more; "
            "widen the band or measure finer lines"
        )
    if variance is not None and (variance.shape != frf.values.shape or not (variance > 0).all()):
        raise MeasurementError(
            f"modal fit: found a variance of shape {variance.shape}; expected positive numbers of shape "
            f"{frf.values.shape}; correct it"
        )
    frequency = frf.frequency_hz[inside]
    values = frf.values[inside].reshape(n_lines, -1)
    stated = None if variance is None else variance[inside].reshape(n_lines, -1)
    problem = _Problem(frequency, values, _first_weight(values) if stated is None else stated**-0.5, frf)
    order = min(max_order, n_lines // 4)
    by_order = polynomial_poles(frequency, values, problem.weight, order)
    poles = problem.search(steady_poles(by_order, max(4, order // 5)), order)
    if stated is None:
        problem = _Problem(frequency, values, _weight_of_residuals(values, problem.model(poles)), frf)
        poles = problem.search(poles, order)
    return problem.result(poles, (n_lines, len(frf.outputs), len(frf.inputs)))


#: One climb goes no further than this many half-power bandwidths and this much in ln ζ; so many climbs in a row.
_REACH = (3.0, 1.5)
_CLIMBS = 4
#: Damping ratios to start from where a residual stands out.
_TRIED_DAMPING = (0.001, 0.003, 0.01, 0.03)

#: Below this many lines there is nothing to fit: seven numbers for the rest and four for one mode need more values.
_FEWEST_LINES = 16


def _first_weight(values: Complex) -> Array:
    """One over the noise where nothing is known of it: 3 % of |H| and 1 % of its median."""
    magnitude = np.abs(values)
    weight: Array = 1 / (0.03 * magnitude + 0.01 * np.median(magnitude, axis=0) + np.finfo(float).tiny)
    return weight


def _weight_of_residuals(values: Complex, model: Complex) -> Array:
    """One over the noise: ln σ² a parabola in ln|H| plus a line in ln f, FRF by FRF, as likely as the residuals allow."""
    weight = np.empty(values.shape)
    lines = np.linspace(-1, 1, len(values))
    for k, (measured, fitted) in enumerate(zip(values.T, model.T, strict=True)):
        square = np.abs(measured - fitted) ** 2
        level = np.log(np.abs(fitted) + 1e-3 * np.median(np.abs(measured)))
        level = (level - level.mean()) / max(level.std(), 1e-6)
        columns = np.column_stack([np.ones_like(level), level, level**2, lines])
        weight[:, k] = np.exp(-columns @ _log_linear_fit(columns, square) / 2)
    return weight


def _log_linear_fit(columns: Array, square: Array) -> Array:
    """Coefficients c of E[square] = exp(columns c) for exponentially distributed squares, by Fisher scoring."""
    coefficients = np.zeros(columns.shape[1])
    coefficients[0] = np.log(square.mean() + np.finfo(float).tiny)
    for _ in range(30):
        ratio = np.minimum(square / np.exp(columns @ coefficients), 50.0)
        step = scipy.linalg.lstsq(columns, ratio - 1)[0]
        coefficients = coefficients + np.clip(step, -1, 1)
        if np.abs(step).max() < 1e-6:
            break
    return coefficients


class _Problem:
    """Weighted least squares for poles, with residues and the rest eliminated (variable projection).

    References
    ----------
    Golub, G., Pereyra, V. (2003). Separable nonlinear least squares: the variable projection method and its applications.
    Inverse Problems 19, R1. DOI 10.1088/0266-5611/19/2/201
    """

    def __init__(self, frequency_hz: Array, values: Complex, weight: Array, frf: FrfSet) -> None:
        self.omega = 2 * np.pi * frequency_hz
        self.values = values
        self.weight = weight
        self.factor = quantity_factor(frequency_hz, frf.quantity)
        self.target = [_parts((weight * values)[:, k : k + 1])[:, 0] for k in range(values.shape[1])]
        self.rest = self._rest()

    def climb(self, poles: Complex) -> Complex:
        """Poles of least squares, from a start; shape (modes,), rad/s."""
        for _ in range(_CLIMBS if poles.size else 0):
            poles, ended_inside = self._climb_within_reach(poles)
            if ended_inside:
                break
        return poles[np.argsort(np.abs(poles))]

    def _climb_within_reach(self, poles: Complex) -> tuple[Complex, bool]:
        """Poles of least squares not far from the start, and whether none ended at the limit of that."""
        # steps are measured in half-power bandwidths, and damping stays positive
        centre, width = np.abs(poles), -poles.real

        def poles_at(x: Array) -> Complex:
            shift, log_growth = x.reshape(2, -1)
            return _pole(centre + width * shift, np.minimum(width / centre * np.exp(log_growth), 0.9))

        def residual(x: Array) -> Array:
            return self._residual(poles_at(x))

        def jacobian(x: Array) -> Array:
            now = poles_at(x)
            by_omega, by_zeta = self._jacobian(now)
            return np.hstack([by_omega * width, by_zeta * (-now.real / np.abs(now))])

        reach = np.repeat(_REACH, poles.size)
        start = np.zeros(2 * poles.size)
        end = scipy.optimize.least_squares(
            residual, start, jacobian, bounds=(-reach, reach), xtol=1e-9, ftol=1e-9, max_nfev=60
        )
        return poles_at(end.x), bool((np.abs(end.x) < 0.95 * reach).all())

    def search(self, poles: Complex, order: int) -> Complex:
        """Poles of least squares: further ones join while they pay their price, and those that do not must go.

        Further ones are sought in what the fit leaves: its polynomial poles, and two modes in the place of one.
        The price is what the Bayesian information criterion asks for the numbers that a mode adds, two for its pole and
        two for each FRF, plus a margin; χ² is taken relative to its mean.
        """
        price = (2 + 2 * self.values.shape[1]) * np.log(2 * self.values.size) + 10.0
        poles = self._without_idle(self.climb(poles), price)
        for _ in range(order):
            least = self._chi2(poles) - price * self._misfit(poles)
            for start in self._further(poles, order, price):
                more = self._without_idle(self.climb(start), price)
                if self._chi2(more) < least:
                    poles = more
                    break
            else:
                break
        return poles

    def _further(self, poles: Complex, order: int, price: float) -> Iterator[Complex]:
        """Starts with one mode more, the most promising first."""
        residual = self.values - self.model(poles)
        square = (np.abs(self.weight * residual) ** 2).mean(axis=1)
        by_order = polynomial_poles(self.omega / (2 * np.pi), residual, self.weight, order)
        candidates = np.concatenate([*by_order, self._peaks(square)])
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

    def _without_idle(self, poles: Complex, price: float) -> Complex:
        while poles.size:
            inside = (np.abs(poles) >= self.omega[0]) & (np.abs(poles) <= self.omega[-1])
            if not inside.all():
                poles = self.climb(poles[inside])
                continue
            loss = np.array([self._chi2(np.delete(poles, i)) for i in range(poles.size)]) - self._chi2(poles)
            worst = int(np.argmin(loss))
            if loss[worst] / self._misfit(poles) >= price:
                break
            poles = self.climb(np.delete(poles, worst))
        return poles

    def _chi2(self, poles: Complex) -> float:
        return float(np.sum(self._residual(poles) ** 2))

    def _misfit(self, poles: Complex) -> float:
        return max(1.0, self._chi2(poles) / self._freedom(poles.size))

    def result(self, poles: Complex, shape: tuple[int, int, int]) -> ModalFit:
        """Modes with standard deviations, and the fitted FRFs."""
        misfit = self._chi2(poles) / self._freedom(poles.size)
        modes: tuple[MeasuredMode, ...] = ()
        if poles.size:
            jacobian = np.hstack(self._jacobian(poles))
            scale = np.linalg.norm(jacobian, axis=0)
            covariance = np.linalg.inv((jacobian / scale).T @ (jacobian / scale)) / np.outer(scale, scale)
            sd_omega, sd_zeta = np.sqrt(np.diag(covariance) * max(1.0, misfit)).reshape(2, -1)
            modes = tuple(
                MeasuredMode(*(float(v) for v in (abs(p) / (2 * np.pi), so / (2 * np.pi), -p.real / abs(p), sz)))
                for p, so, sz in zip(poles, sd_omega, sd_zeta, strict=True)
            )
        return ModalFit(modes, self.model(poles).reshape(shape), misfit)

    def model(self, poles: Complex) -> Complex:
        """Fitted FRFs, shape (lines, frfs)."""
        basis, _, _ = self._basis(poles)
        columns = []
        for w, target in zip(self.weight.T, self.target, strict=True):
            columns.append(basis @ scipy.linalg.lstsq(_parts(w[:, None] * basis), target)[0])
        return np.stack(columns, axis=1)

    def gain(self, poles: Complex, candidates: Complex) -> Array:
        """By how much χ² falls if one of the candidates is added, shape (candidates,), before any climb."""
        basis, _, _ = self._basis(poles)
        further, _, _ = self._basis(candidates)
        n = candidates.size
        total = np.zeros(n)
        for w, target in zip(self.weight.T, self.target, strict=True):
            q = _orthonormal(_parts(w[:, None] * basis))
            residual = target - q @ (q.T @ target)
            new = _parts(w[:, None] * further[:, : 2 * n])
            new -= q @ (q.T @ new)
            # two columns each: in-phase and quadrature
            first = new[:, :n] / np.linalg.norm(new[:, :n], axis=0)
            second = new[:, n:] - first * np.sum(first * new[:, n:], axis=0)
            second /= np.linalg.norm(second, axis=0)
            total += (residual @ first) ** 2 + (residual @ second) ** 2
        return total

    def _rest(self) -> Complex:
        omega = self.omega[:, None]
        outside = np.array([r * self.omega[0] for r in _REST_BELOW] + [r * self.omega[-1] for r in _REST_ABOVE])
        one_pole = 1 / (outside**2 - omega**2)
        columns = [(1j * omega) ** np.array(_REST_POWERS), one_pole, 1j * omega * one_pole]
        rest = self.factor[:, None] * np.hstack(columns)
        scaled: Complex = rest / np.abs(rest).max(axis=0)
        return scaled

    def _freedom(self, modes: int) -> int:
        frfs = self.values.shape[1]
        return max(1, 2 * self.values.size - 2 * modes - frfs * (2 * modes + _REST_COLUMNS))

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
        return np.hstack([modal, self.rest]), by_omega, by_zeta

    def _residual(self, poles: Complex) -> Array:
        basis, _, _ = self._basis(poles)
        out = []
        for w, target in zip(self.weight.T, self.target, strict=True):
            q = _orthonormal(_parts(w[:, None] * basis))
            out.append(target - q @ (q.T @ target))
        return np.concatenate(out)

    def _jacobian(self, poles: Complex) -> tuple[Array, Array]:
        """Derivatives of the residuals by each ω_r and each ζ, shape (values, modes) each, after Kaufman (1975)."""
        basis, by_omega, by_zeta = self._basis(poles)
        n = poles.size
        out: list[list[Array]] = [[], []]
        for w, target in zip(self.weight.T, self.target, strict=True):
            weighted = _parts(w[:, None] * basis)
            scale = np.linalg.norm(weighted, axis=0)
            q = _orthonormal(weighted)
            amplitude = scipy.linalg.lstsq(weighted / scale, target)[0] / scale
            for rows, derivative in zip(out, (by_omega, by_zeta), strict=True):
                column = derivative[:, :n] * amplitude[:n] + derivative[:, n:] * amplitude[n : 2 * n]
                slope = _parts(w[:, None] * column)
                rows.append(-(slope - q @ (q.T @ slope)))
        return np.vstack(out[0]), np.vstack(out[1])


def _pole(omega_r: Array, zeta: Array) -> Complex:
    pole: Complex = omega_r * (-zeta + 1j * np.sqrt(1 - zeta**2))
    return pole


def _parts(columns: Complex) -> Array:
    """Real and imaginary parts over each other, scaled so that noise of σ² = E|δH|² = 1 has unit variance in each."""
    return np.sqrt(2.0) * np.vstack([columns.real, columns.imag])


def _orthonormal(columns: Array) -> Array:
    q: Array = scipy.linalg.qr(columns / np.linalg.norm(columns, axis=0), mode="economic")[0]
    return q
