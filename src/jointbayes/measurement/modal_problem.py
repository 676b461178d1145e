"""The modal model of measured FRFs: where its poles may be, weighted least squares for them, and further ones."""

from collections.abc import Iterator

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import ArrayLike, NDArray

from jointbayes.arrays import Array
from jointbayes.frf import Quantity, quantity_factor


def prominent_peaks(curve: ArrayLike, least: float) -> NDArray[np.intp]:
    """Numbers of the maxima of a curve whose prominence is `least` or more.

    Prominence: by how much the curve falls, on both sides, before it rises above the peak or ends. As
    `scipy.signal.find_peaks` finds them (of a flat top here the first point), which takes 0.3 s to load.

    Parameters
    ----------
    curve
        Values, shape (n,), all finite.
    least
        Least prominence, in the unit of the curve, above 0.

    Examples
    --------
    >>> prominent_peaks([0.0, 3.0, 2.5, 4.0, 1.0, 1.2, 0.0], 1.0)
    array([3])
    """
    values = np.asarray(curve, dtype=float).tolist()
    peaks = []
    rising, low, top, at = True, np.inf, -np.inf, 0
    for i, value in enumerate(values):
        if rising:
            if value > top:
                top, at = value, i
            elif top - low < least and value < low:  # what rose so far was a ripple on the way down
                low, top = value, value
            elif top - low >= least and top - value >= least:
                peaks.append(at)
                rising, low = False, value
            low = min(low, value) if top - low < least else low
        elif value < low:
            low = value
        elif value - low >= least:
            rising, top, at = True, value, i
    return np.array(peaks, dtype=np.intp)


Complex = NDArray[np.complex128]

#: Poles λ of one model order, shape (n,), rad/s.
Poles = Complex

#: The band covers this much of the unit circle; the polynomials wrap round, the FRF does not.
_ARC = 0.95
#: A pole more damped than this is not a mode that lines in the band can show.
_MOST_DAMPING = 0.3
#: Two poles are the same one if they are closer than this fraction of their distance from the imaginary axis.
_SAME = 0.5


def polynomial_poles(frequency_hz: Array, values: Complex, weight: Array, max_order: int) -> list[Poles]:
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
    numerator, mixed, denominator = _normal_matrices(powers, values, weight)
    poles_by_order = []
    for order in range(2, max_order + 1):
        used = slice(0, order + 1)
        reduced = sum(
            (
                t[used, used] - s[used, used].conj().T @ scipy.linalg.lstsq(r[used, used], s[used, used])[0]
                for r, s, t in zip(numerator, mixed, denominator, strict=True)
            ),
            start=np.zeros((order + 1, order + 1), dtype=complex),
        )
        ascending = np.append(scipy.linalg.lstsq(reduced[:order, :order], -reduced[:order, order])[0], 1.0)
        roots = np.roots(ascending[::-1])
        # ln z = −τ(λ − jω₁); the band is the arc from 0 to −2π·_ARC
        angle = np.mod(-np.angle(roots), 2 * np.pi)
        poles = 1j * omega[0] + (-np.log(np.abs(roots)) + 1j * angle) / tau
        poles_by_order.append(poles[_possible(poles, omega)])
    return poles_by_order


def _normal_matrices(
    powers: Complex, values: Complex, weight: Array
) -> tuple[list[Complex], list[Complex], list[Complex]]:
    """Sums over lines R = XᴴX, S = XᴴY, T = YᴴY for each FRF, with X the powers and Y = −H X, both weighted."""
    matrices: tuple[list[Complex], list[Complex], list[Complex]] = ([], [], [])
    for h, w in zip(values.T, weight.T, strict=True):
        x = w[:, None] * powers
        y = -h[:, None] * x
        for matrix, product in zip(matrices, (x.conj().T @ x, x.conj().T @ y, y.conj().T @ y), strict=True):
            matrix.append(product)
    return matrices


def _possible(poles: Poles, omega: Array) -> NDArray[np.bool_]:
    frequency = np.abs(poles)
    damping = -poles.real / frequency
    possible: NDArray[np.bool_] = (damping > 0) & (damping < _MOST_DAMPING)
    possible &= (frequency > omega[0]) & (frequency < omega[-1])
    return possible


def steady_poles(by_order: list[Poles], least: int) -> Poles:
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
#: Steps of χ² at which a climb ends, relative to χ²: while searching, and at last.
_ROUGH, _FINE = 1e-6, 1e-10
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
        self.target = [_parts((weight * values)[:, k : k + 1])[:, 0] for k in range(values.shape[1])]
        self.rest = self._rest()

    def climb(self, poles: Complex, tolerance: float = _ROUGH) -> Complex:
        """Poles of least squares, from a start; shape (modes,), rad/s."""
        for _ in range(_CLIMBS if poles.size else 0):
            poles, ended_inside = self._climb_within_reach(poles, tolerance)
            if ended_inside:
                break
        return poles[np.argsort(np.abs(poles))]

    def _climb_within_reach(self, poles: Complex, tolerance: float) -> tuple[Complex, bool]:
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
            by_omega, by_zeta = self.jacobian(now)
            return np.hstack([by_omega * width, by_zeta * (-now.real / np.abs(now))])

        reach = np.repeat(_REACH, poles.size)
        start = np.zeros(2 * poles.size)
        end = scipy.optimize.least_squares(
            residual, start, jacobian, bounds=(-reach, reach), xtol=1e-9, ftol=tolerance, max_nfev=40
        )
        return poles_at(end.x), bool((np.abs(end.x) < 0.95 * reach).all())

    def search(self, poles: Complex, order: int) -> Complex:
        """Poles of least squares: further ones join while they pay their price, and those that do not must go.

        Further ones are sought in what the fit leaves: its polynomial poles, and two modes in the place of one.
        The price is what the Bayesian information criterion asks for the numbers that a mode adds, two for its pole and
        two for each FRF, plus a margin; χ² is taken relative to its mean.
        """
        price = (2 + 2 * self.values.shape[1]) * np.log(2 * self.values.size) + 10.0
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
        return self.climb(poles, _FINE)

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

    def _drop_idle(self, poles: Complex, price: float) -> Complex:
        while poles.size:
            frequency = np.abs(poles)
            near = (frequency >= self.omega[0] / _EDGE) & (frequency <= self.omega[-1] * _EDGE)
            if not near.all():
                poles = self.climb(poles[near])
                continue
            loss = np.array([self.chi2(np.delete(poles, i)) for i in range(poles.size)]) - self.chi2(poles)
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
        return np.hstack([modal, self.rest]), by_omega, by_zeta

    def _residual(self, poles: Complex) -> Array:
        basis, _, _ = self._basis(poles)
        residuals = []
        for w, target in zip(self.weight.T, self.target, strict=True):
            q = _orthonormal(_parts(w[:, None] * basis))
            residuals.append(target - q @ (q.T @ target))
        return np.concatenate(residuals)

    def jacobian(self, poles: Complex) -> tuple[Array, Array]:
        """Derivatives of the residuals by each ω_r and each ζ, shape (values, modes) each, after Kaufman (1975)."""
        basis, by_omega, by_zeta = self._basis(poles)
        n = poles.size
        blocks: list[list[Array]] = [[], []]
        for w, target in zip(self.weight.T, self.target, strict=True):
            weighted = _parts(w[:, None] * basis)
            scale = np.linalg.norm(weighted, axis=0)
            q = _orthonormal(weighted)
            amplitude = scipy.linalg.lstsq(weighted / scale, target)[0] / scale
            for rows, derivative in zip(blocks, (by_omega, by_zeta), strict=True):
                column = derivative[:, :n] * amplitude[:n] + derivative[:, n:] * amplitude[n : 2 * n]
                slope = _parts(w[:, None] * column)
                rows.append(-(slope - q @ (q.T @ slope)))
        return np.vstack(blocks[0]), np.vstack(blocks[1])


def _pole(omega_r: Array, zeta: Array) -> Complex:
    return omega_r * (-zeta + 1j * np.sqrt(1 - zeta**2))


def _parts(columns: Complex) -> Array:
    """Real and imaginary parts over each other, scaled so that noise of σ² = E|δH|² = 1 has unit variance in each."""
    return np.sqrt(2.0) * np.vstack([columns.real, columns.imag])


def _orthonormal(columns: Array) -> Array:
    return np.linalg.qr(columns / np.linalg.norm(columns, axis=0), "reduced")[0]
