"""Which poles of a modal fit are modes: the others are left out, and named with the reason."""

from dataclasses import dataclass, field

import numpy as np
import scipy  # its parts load at first use

from vibrecords.arrays import Array, ComplexArray, Flags
from vibrecords.modal_problem import ON_LINES, ModalProblem

#: A second pole within a half-power width is a mode of its own only if χ² insists by this many prices of a mode.
_INSISTED = 3.0
#: Shapes over FRFs whose modal assurance criterion is below this are of different modes.
_OTHER_SHAPE = 0.9
#: Incoherence at a resonance over the incoherence on both sides, above which the resonance has a coherence dip.
_DIP = 1.5
#: So many lines apart, or less, are neighbouring poles by which a window's leakage is fitted.
_LEAKS = 3.0
#: Two poles closer than so many lines are of one resonance, unless their shapes differ.
_TOLD_APART = 1.25
#: A pole below this fraction of a mode in every FRF, and not further from it than that, is a sideband of it.
_SIDEBAND, _BESIDE = 10 ** (-65 / 20), 0.25
#: A mode is damped by so many standard deviations, as a tone is not; and by so many if it is narrower than some lines.
_DAMPED, _DAMPED_NARROW, _NARROW, _DAMPED_COHERENT = 2.0, 4.0, 3.0, 1.0
#: With noise unknown, what is narrower than so many lines may be a tone or a zero of the force: a ring-down would have
#: a third of its amplitude left at the end of the block.
_UNRESOLVED = 0.35
#: With noise unknown, a mode of few lines is worth so many prices.
_UNTOLD = 4.0
#: Damping ratios above this are of a background.
_MOST_DAMPING = 0.3
#: A response is coherent with the force if chance would make it as large less often than this.
_SURE = 0.99
#: Where only one FRF of several shows a mode, it must do so by this many prices.
_IN_ONE_FRF = 5.0


@dataclass(frozen=True, slots=True)
class DoubtfulMode:
    """Something that looks like a mode and is not counted as one.

    Parameters
    ----------
    frequency_hz
        Where, Hz.
    reason
        Why it is left out, in words.
    """

    frequency_hz: float
    reason: str


@dataclass(slots=True)
class PoleReview:
    """Poles of a fit as they are reviewed, and those in doubt.

    Parameters
    ----------
    problem
        The fit.
    poles
        Its poles, rad/s, shape (poles,).
    incoherence
        1 - γ², shape (lines, frfs), or None where unknown.
    squares, averages
        σ² of each line as coherence and averages tell it, shape (lines, frfs), and the averages; None where unknown.
    told
        Whether the variance was stated.
    """

    problem: ModalProblem
    poles: ComplexArray
    incoherence: Array | None
    squares: Array | None = None
    averages: int | None = None
    told: bool = False
    doubtful: list[DoubtfulMode] = field(default_factory=list)
    leaking: Flags = field(default_factory=lambda: np.zeros(0, dtype=bool))

    @property
    def frequency_hz(self) -> Array:
        """Natural frequencies of the poles, Hz."""
        return np.abs(self.poles) / (2 * np.pi)

    @property
    def width_hz(self) -> Array:
        """Half-power widths."""
        return -self.poles.real / np.pi

    @property
    def lines_hz(self) -> Array:
        """Lines of the fit, Hz."""
        return self.problem.omega / (2 * np.pi)

    def line_step_hz(self, frequency_hz: Array) -> Array:
        """Distance of the lines about these frequencies, Hz."""
        steps = np.diff(self.lines_hz)
        return steps[np.clip(np.searchsorted(self.lines_hz, frequency_hz) - 1, 0, steps.size - 1)]

    def review(self) -> Flags:
        """Merge poles of one resonance, name what is doubtful; which of the poles left are modes."""
        if not self.poles.size:
            return np.zeros(0, dtype=bool)
        # 1. poles of one resonance
        nonlinear = self._merge()
        self.leaking = np.array([self._coherence_dips(i) for i in range(self.poles.size)], dtype=bool)
        # 2. why each pole of the fit is no mode; empty where it is one
        problem, price = self.problem, self.problem.price
        _, about, correlated = problem.noise_about(self.poles)
        losses = problem.losses(self.poles) / problem.inflation(self.poles)
        damping, damping_sd = -self.poles.real / np.abs(self.poles), problem.damping_sd(self.poles)
        widths = self.width_hz / self.line_step_hz(self.frequency_hz)
        reasons = [""] * self.poles.size
        for i, width in enumerate(widths):
            # a. A background is damped more than any mode.
            if damping[i] > _MOST_DAMPING:
                reasons[i] = f"a damping of {100 * damping[i]:.0f} %: a background, not a mode"
                continue
            # b. A mode is worth its price also without the lines that tell most of it, with the noise at the others.
            #    Where nothing else tells the noise, as at a zero of a hit's force, the data must insist.
            by_line = np.sort(problem.gain_by_line(self.poles, i))[:-ON_LINES].sum()
            unknown = self.squares is None and not self.told and width < _NARROW
            if by_line < price * max(1.0, about[i]) * correlated[i] * (_UNTOLD if unknown else 1.0):
                reasons[i] = f"stands on {ON_LINES} lines: a tone, an outlier, or a zero of the force"
                continue
            # c. Its response stands out of what is incoherent with the force at its lines.
            if self._is_incoherent(i):
                reasons[i] = "hardly coherent with the force: a tone, noise, or a zero of the force"
                continue
            # d. Its damping differs from zero. Without coherence only this tells it from a tone.
            least = np.inf if width < _UNRESOLVED and not self.told else _DAMPED_NARROW if width < _NARROW else _DAMPED
            if damping[i] < damping_sd[i] * (least if self.squares is None else _DAMPED_COHERENT):
                reasons[i] = "its damping hardly differs from zero: a tone or leakage"
                continue
            # e. More than one of several FRFs shows it, or one clearly.
            by_frf = losses[:, i]
            if by_frf.size > 1 and (by_frf > price / by_frf.size).sum() < 2 and by_frf.max() < _IN_ONE_FRF * price:
                reasons[i] = f"only one of {by_frf.size} FRFs shows it, and hardly"
        # 3. modes that hardly stand next to another: no test shows two so unlike that are both true
        height = np.abs(problem.residues(self.poles)) * self.frequency_hz / self.width_hz
        modes = np.array([not reason for reason in reasons])
        for pole in np.flatnonzero(modes).tolist():
            near = modes & (np.abs(self.frequency_hz / self.frequency_hz[pole] - 1) < _BESIDE)
            above = np.flatnonzero(near & (height[:, [pole]] < _SIDEBAND * height).all(axis=0))
            if above.size:
                other = self.frequency_hz[above[np.argmax(height[:, above].max(axis=0))]]
                reasons[pole] = f"more than 65 dB below the resonance at {other:.6g} Hz: a sideband"
        for frequency, reason, named in zip(self.frequency_hz, reasons, nonlinear, strict=True):
            if reason and not named:
                self.doubtful.append(DoubtfulMode(float(frequency), reason))
        self.doubtful.sort(key=lambda doubt: doubt.frequency_hz)
        return ~nonlinear & np.array([not reason for reason in reasons])

    def _merge(self) -> Flags:
        """Take out poles that are second poles of a mode; which are of nonlinear resonances, and stay in the fit."""
        while True:
            nonlinear, named = np.zeros(self.poles.size, dtype=bool), []
            order = np.argsort(self.problem.losses(self.poles).sum(axis=0)).tolist()  # the weakest first
            near = [self._one_resonance(i) | self._untold(i) for i in range(self.poles.size)]
            for weak, strong in [(weak, s) for i, weak in enumerate(order) for s in order[:i:-1] if near[weak][s]]:
                if nonlinear[weak] and nonlinear[strong]:
                    continue
                fewer, rise = self.problem.without(self.poles, weak)
                gain = rise / self.problem.inflation(self.poles)[strong]
                a, b = self.problem.residues(self.poles)[:, [weak, strong]].T
                assurance = np.abs(np.vdot(a, b)) ** 2 / (np.vdot(a, a).real * np.vdot(b, b).real)
                dips, differ = self._coherence_dips(strong), a.size > 1 and assurance < _OTHER_SHAPE
                untold = self._untold(strong)[weak]
                if gain > _INSISTED * self.problem.price and (differ or not (dips or untold)):
                    continue
                if dips and not (untold or self._one_resonance(strong)[weak]):
                    continue
                cluster = self._one_resonance(weak) | self._one_resonance(strong)
                leaks = _LEAKS * (cluster.sum() - 1) * self.line_step_hz(self.frequency_hz[strong])
                if not dips or np.ptp(self.frequency_hz[cluster]) <= leaks:
                    place = f"within the half-power width of the mode at {self.frequency_hz[strong]:.6g} Hz"
                    reason = f"a second pole {place}: {'leakage' if dips else 'one resonance'}"
                    self.doubtful.append(DoubtfulMode(float(self.frequency_hz[weak]), reason))
                    self.poles = self.problem.climb(fewer, fine=True)
                    break
                nonlinear |= cluster
                f, w = self.frequency_hz[cluster], self.width_hz[cluster]
                dip = "fits badly all the same" if self.incoherence is None else "has a coherence dip"
                span = f"between {(f - w / 2).min():.6g} and {(f + w / 2).max():.6g} Hz"
                poles = f"{span}, which takes {f.size} poles and {dip}"
                reason = f"nonlinear? One resonance {poles}; measure it at a lower level"
                named.append(DoubtfulMode(float(self.frequency_hz[strong]), reason))
            else:
                self.doubtful += named
                return nonlinear

    def _one_resonance(self, pole: int) -> Flags:
        """Which poles are within a half-power width of this one (the geometric mean of both), or within a line."""
        width = np.sqrt(self.width_hz * self.width_hz[pole])
        reach = np.maximum(width, self.line_step_hz(self.frequency_hz))
        return np.asarray(np.abs(self.frequency_hz - self.frequency_hz[pole]) < reach)

    def _untold(self, pole: int) -> Flags:
        """Which poles are so close to this one that lines do not tell them apart."""
        reach = _TOLD_APART * self.line_step_hz(self.frequency_hz)
        return np.asarray(np.abs(self.frequency_hz - self.frequency_hz[pole]) < reach)

    def _coherence_dips(self, pole: int) -> bool:
        """Whether the coherence is lower at a resonance than around it; where unknown, whether the fit fails there."""
        if self.incoherence is None:
            at, about = self.problem.noise_about(self.poles)[:2, pole]
            return bool(at > 2 * max(about, 1.0))
        width = max(self.width_hz[pole], 2 * self.line_step_hz(self.frequency_hz[pole]))
        off = np.abs(self.lines_hz - self.frequency_hz[pole]) / width
        at, sides = self.incoherence[off <= 0.5], self.incoherence[(off > 1) & (off < 4)]
        if not at.size or not sides.size:
            return False
        return bool((at.mean(axis=0) > _DIP * np.median(sides, axis=0)).any())

    def _is_incoherent(self, pole: int) -> bool:
        """Whether what a pole adds to the FRFs at its lines may be chance, by the scatter over the averages there.

        Both are squares of one normal variate where noise is smooth over the resonance, so that their ratio is of an F
        distribution, for any width.
        """
        if self.squares is None or self.averages is None:
            return False
        off = np.abs(self.lines_hz - self.frequency_hz[pole])
        at = off <= max(self.width_hz[pole] / 2, off.min())
        part, noise = self.problem.part_of(self.poles, pole)[at], self.squares[at] * self.problem.weight[at] ** 2
        most = scipy.stats.f.ppf(_SURE, 2, 2 * (self.averages - 1))
        return bool(part.sum() < most * noise.sum())
