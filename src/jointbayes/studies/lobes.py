"""Stability lobes of milling, from FRFs of the tool's tip across the feed and along it.

Altintas, Y., Budak, E. (1995). Analytical prediction of stability lobes in milling. CIRP Annals 44(1), 357-362.
DOI 10.1016/S0007-8506(07)62342-7. Zero order: the cutting coefficients are averaged over one turn.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from jointbayes.rounding import number
from vibrecords.arrays import Array

#: Most whole waves that a tooth leaves: at speeds with more, the lobes merge into their lower envelope.
_MOST_WAVES = 200


@dataclass(frozen=True, eq=False)
class Cut:
    """Tool and material of a cut.

    Parameters
    ----------
    teeth
        Number of teeth.
    tangential_pa, radial
        K_t, tangential cutting coefficient, Pa; and K_r, radial force as a fraction of the tangential one.
    immersion
        Width of the cut as a fraction of the tool's diameter, above 0 and at most 1 (a slot).
    up
        True for up milling, False for down milling.
    """

    teeth: int
    tangential_pa: float
    radial: float
    immersion: float
    up: bool

    def coefficients(self) -> Array:
        """Averaged directional coefficients α, shape (2, 2), of x along the feed and y across it."""
        # Altintas and Budak 1995, Eqs. (9) and (10): entry and exit angle, measured from y
        turned = math.acos(1 - 2 * self.immersion)
        entry, exit_ = (0.0, turned) if self.up else (math.pi - turned, math.pi)

        def integral(angle: float) -> Array:
            cosine, sine, twice, k = math.cos(2 * angle), math.sin(2 * angle), 2 * angle, self.radial
            return 0.5 * np.array(
                [[cosine - k * twice + k * sine, -sine - twice + k * cosine],
                 [-sine + twice + k * cosine, -cosine - k * twice - k * sine]]
            )  # fmt: skip

        return integral(exit_) - integral(entry)


def limiting_depth(
    cut: Cut, frequency_hz: Array, frf_x: NDArray[np.complex128], frf_y: NDArray[np.complex128], speeds: Array
) -> Array:
    """Depth of cut at which chatter begins at each speed.

    Parameters
    ----------
    cut
        Tool and material.
    frequency_hz
        Possible chatter frequencies, evenly spaced and fine against the width of a resonance, shape (lines,), Hz.
    frf_x, frf_y
        Receptances of the tip along the feed and across it, shape (lines,), m/N.
    speeds
        Spindle speeds, evenly spaced, shape (m,), rev/min.

    Returns
    -------
    ndarray
        Depths, shape (m,), m; infinite at a speed that no line limits.
    """
    # 1. det(1 + Λ α G) = a0 Λ² + a1 Λ + 1 = 0: two eigenvalues Λ at each line (Eq. 17)
    alpha = cut.coefficients()
    a0 = np.linalg.det(alpha) * frf_x * frf_y
    a1 = alpha[0, 0] * frf_x + alpha[1, 1] * frf_y
    # the root of the discriminant follows one branch from line to line
    discriminant = (a1**2 - 4 * a0) / a1**2
    root = a1 * np.sqrt(np.abs(discriminant)) * np.exp(0.5j * np.unwrap(np.angle(discriminant)))
    step = speeds[1] - speeds[0]
    depth = np.full(speeds.size, np.inf)
    for eigenvalue in (-2 / (a1 + root), -2 / (a1 - root)):
        # 2. Depth and phase of each (Eqs. 18 and 20)
        ratio = eigenvalue.imag / eigenvalue.real
        deep = -2 * np.pi * eigenvalue.real * (1 + ratio**2) / (cut.teeth * cut.tangential_pa)
        phase = np.pi - 2 * np.arctan(ratio)
        good = (deep[1:] > 0) & (deep[:-1] > 0) & (np.abs(np.diff(phase)) < 1)
        # 3. Speeds of each number of whole waves, of all lines (Eq. 21)
        most = min(_MOST_WAVES, math.ceil(60 * frequency_hz[-1] / (cut.teeth * speeds[0])))
        waves = np.arange(most + 1)[:, None]
        with np.errstate(divide="ignore"):  # no wave at all takes a tooth no time
            at = 60 * frequency_hz / (cut.teeth * (phase / (2 * np.pi) + waves))
        place = (at - speeds[0]) / step
        # 4. Where a line and the next lie on both sides of a speed, its depth lies between theirs
        low, high = np.minimum(place[:, 1:], place[:, :-1]), np.maximum(place[:, 1:], place[:, :-1])
        first = np.clip(np.ceil(low), 0, speeds.size)
        count = np.where(good, np.clip(np.floor(high) + 1, 0, speeds.size) - first, 0).clip(0).astype(int)
        wave, line = np.nonzero(count)
        times = count[wave, line]
        wave, line, offset = np.repeat(wave, times), np.repeat(line, times), _counted(times)
        speed = (first[wave, line] + offset).astype(int)
        share = (speed - place[wave, line]) / np.where(
            place[wave, line + 1] == place[wave, line], 1.0, place[wave, line + 1] - place[wave, line]
        )
        np.minimum.at(depth, speed, deep[line] + share * (deep[line + 1] - deep[line]))
    return depth


@dataclass(frozen=True, eq=False)
class Lobes:
    """Limiting depth of cut over spindle speed, of draws.

    Parameters
    ----------
    speeds
        rev/min, shape (m,).
    depths
        Of each draw, shape (draws, m), m.
    """

    speeds: Array
    depths: Array

    @cached_property
    def bands(self) -> Array:
        """Points at 2.5, 25, 50, 75 and 97.5 % of the depth at each speed, shape (5, m), m: ends of 95 and 50 %."""
        return np.quantile(self.depths, [0.025, 0.25, 0.5, 0.75, 0.975], axis=0, method="inverted_cdf")

    def rows(self, most: int = 5) -> list[tuple[str, str, str, str]]:
        """Speed, median depth and its 50 and 95 % intervals of the deepest lobes, the least safe depth first."""
        safe = self.bands[0]
        peaks = [i for i in range(1, safe.size - 1) if safe[i - 1] < safe[i] >= safe[i + 1] and np.isfinite(safe[i])]
        deepest = sorted(peaks, key=lambda i: -safe[i])[:most]
        return [self._row(i) for i in (int(safe.argmin()), *sorted(deepest))]

    def _row(self, i: int) -> tuple[str, str, str, str]:
        low, inner_low, median, inner_high, high = (number(1e3 * float(x), 3) for x in self.bands[:, i])
        return f"{self.speeds[i]:.0f}", median, f"{inner_low} to {inner_high}", f"{low} to {high}"

    def lines(self) -> list[str]:
        """What is printed: the safest speed, and the depth that is stable at any speed."""
        safe = self.bands[0]
        if not np.isfinite(safe).any():
            return ["lobes: no line of the band limits the depth of cut"]
        best = int(np.where(np.isfinite(safe), safe, 0.0).argmax())
        return [
            f"lobes: {number(1e3 * float(safe[best]), 3)} mm is stable at {self.speeds[best]:.0f} rev/min in 97.5 % of "
            f"the draws; {number(1e3 * float(safe.min()), 3)} mm at every speed"
        ]


def _counted(times: NDArray[np.int_]) -> NDArray[np.int_]:
    """0, 1, … of each repetition: (2, 3) gives 0 1 0 1 2."""
    return np.arange(times.sum()) - np.repeat(np.cumsum(times) - times, times)
