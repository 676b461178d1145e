"""Poles of polynomial models of rising order, and those that are stable over the orders."""

import numpy as np
import scipy.linalg

from vibrecords.arrays import Array, ComplexArray

#: The band covers this much of the unit circle; the polynomials wrap round, the FRF does not.
_ARC = 0.95
#: A pole more damped than this is not a mode that lines in the band can show.
_MOST_DAMPING = 0.3
#: Two poles are the same one if they are closer than this fraction of their distance from the imaginary axis.
_SAME = 0.5


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
