"""Whether the modes of a set-up have changed between two measurement files: without a model, so without a stiffness.

1. Modes and their standard deviations come from a modal fit of the FRFs, or as a modal test states them.
2. Each mode before is paired with the new mode that is nearest to it.
3. Two hypotheses are weighed for what each pair shows, and for all pairs together: the logarithm has not changed, or it
   has changed by a normal amount. The standard deviation of this amount is log-uniform over the sizes of changes.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import special, stats

from jointbayes.errors import ModelError
from jointbayes.posterior.evidence_table import STRONG, is_close, odds
from jointbayes.rounding import signed
from vibrecords.arrays import Array
from vibrecords.inspection import inspect_file

#: Relative standard deviations with which an untouched set-up repeats: temperature, cables, the hand.
_REPEATS = {"frequencies": 5e-4, "damping ratios": 0.05}
#: Standard deviations of the logarithm of a change, from the smallest to the largest.
_CHANGES = {"frequencies": (5e-4, 0.1), "damping ratios": (0.05, 0.7)}
_NODES = 50
_FARTHEST = 0.15  # between the logarithms of the frequencies of one mode


@dataclass(frozen=True, slots=True)
class ModeChange:
    """Change of a natural frequency or of a damping ratio.

    Parameters
    ----------
    name, unit
        Such as ``"Mode 1"`` and ``"Hz"``; the unit is ``"%"`` of a damping ratio.
    before, new
        Value and standard deviation in the unit, of both files.
    change, sd
        New over before, less 1, and its standard deviation. It has the part of each fit, and the scatter of a repeated
        test.
    probability
        That it has changed, with even odds before the files.
    """

    name: str
    unit: str
    before: tuple[float, float]
    new: tuple[float, float]
    change: float
    sd: float
    probability: float

    @property
    def line(self) -> str:
        """The change in words."""
        places = max(0, 1 - math.floor(math.log10(100 * self.sd)))
        told = [f"{value:.{max(0, 1 - math.floor(math.log10(sd or 0.1)))}f}" for value, sd in (self.before, self.new)]
        told = [text + f" ± {sd:.2g}" * bool(sd) for text, (_, sd) in zip(told, (self.before, self.new), strict=True)]
        amount = f"{signed(100 * self.change, places)} ± {100 * self.sd:.{places}f} %"
        odds_of = f"probability of a change {self.probability:.3f}"
        return f"{self.name}: {told[0]} {self.unit}, then {told[1]} {self.unit}: {amount}; {odds_of}."


@dataclass(frozen=True, slots=True)
class ModesChange:
    """Whether the modes of a set-up have changed.

    Parameters
    ----------
    frequencies, damping_ratios
        Change of each mode that both files show, by rising frequency.
    two_log_b
        2 ln B of a change, all modes together, of the frequencies and of the damping ratios.
    alone
        Frequencies of modes that only one of the files shows, Hz, by file.
    """

    frequencies: tuple[ModeChange, ...]
    damping_ratios: tuple[ModeChange, ...]
    two_log_b: dict[str, float]
    alone: dict[str, tuple[float, ...]]

    @property
    def converged(self) -> bool:
        """True, because nothing is drawn."""
        return True

    @property
    def changed(self) -> bool:
        """Whether the evidence for a change of frequencies or damping ratios is strong."""
        return max(self.two_log_b.values()) > STRONG

    @property
    def lines(self) -> Iterator[str]:
        """What is printed, a line each."""
        for change in (*self.frequencies, *self.damping_ratios):
            yield change.line
        for file, modes in self.alone.items():
            if modes:
                yield f"Only in {file}: {', '.join(f'{hz:.5g}' for hz in modes)} Hz."
        for what, twice in self.two_log_b.items():
            yield change_in_words(f"{what} have", twice, "all modes together")
        said = " and ".join(f"{what} to {100 * sd:g} %" for what, sd in _REPEATS.items())
        yield f"Assumed: a set-up that is not touched repeats its {said}. A repeated test shows this."
        yield "Which stiffness has changed, and by how much: give a case for each file."


def change_in_words(what: str, two_log_b: float, together: str) -> str:
    """Say whether something has changed, from 2 ln B of a change against none.

    Examples
    --------
    >>> change_in_words("joint has", -9.0, "all stiffnesses together")
    'The joint has not changed: odds 90 to 1, all stiffnesses together.'
    """
    weight = f"odds {odds(abs(two_log_b))}, {together}"
    if is_close(abs(two_log_b)):
        return f"Cannot decide whether the {what} changed: {weight}."
    sure = "" if two_log_b > STRONG else "probably " if two_log_b > 0 else "not "
    return f"The {what} {sure}changed: {weight}."


def compare_modes(before: Path, new: Path) -> ModesChange:
    """Compare the modes of two measurement files of one set-up.

    Raises
    ------
    MeasurementError
        If a file cannot be read.
    ModelError
        If a file shows no mode, or no mode is in both.
    """
    # 1. Modes of both files
    modes = [_modes(path) for path in (before, new)]
    # 2. Pairs of modes that are nearest to each other
    apart = np.abs(np.log(modes[0][:, None, 0] / modes[1][:, 0]))
    nearest = enumerate(apart.argmin(axis=1).tolist())
    pairs = np.array([(i, j) for i, j in nearest if apart[:, j].argmin() == i and apart[i, j] < _FARTHEST])
    if not pairs.size:
        found = " and ".join(", ".join(f"{hz:.5g}" for hz in each[:, 0]) for each in modes)
        raise ModelError(f"same: found modes at {found} Hz; expected some in both files; compare files of one set-up")
    # 3. Evidence for a change of each, and of all together
    changes, two_log_b = [], dict[str, float]()
    for (what, repeats), at, scale, unit in zip(_REPEATS.items(), (0, 2), (1.0, 100.0), ("Hz", "%"), strict=True):
        both = np.stack([each[of, at : at + 2] for each, of in zip(modes, pairs.T, strict=True)])
        known = (both[..., 0] > 0).all(axis=0)
        (first, second), own = both[:, known, 0], both[:, known, 1] / both[:, known, 0]
        change, sd = np.log(second / first), np.sqrt((own**2).sum(axis=0) + repeats**2)
        log_b, together = evidence_of_change(change, sd, *_CHANGES[what])
        two_log_b[what] = 2 * together
        probable = special.expit(log_b)
        rows = zip(pairs[known, 0] + 1, *(scale * both[:, known]), np.expm1(change), sd, probable, strict=True)
        changes.append(tuple(
            ModeChange(f"Mode {number}", unit, tuple(a.tolist()), tuple(b.tolist()), float(c), float(s), float(p))
            for number, a, b, c, s, p in rows
        ))  # fmt: skip
    alone = {
        str(path): tuple(np.delete(each[:, 0], of).tolist())
        for path, each, of in zip((before, new), modes, pairs.T, strict=True)
    }
    return ModesChange(changes[0], changes[1], two_log_b, alone)


def evidence_of_change(change: Array, sd: Array, least: float, most: float) -> tuple[Array, float]:
    """Return ln B of a change against none, of each value, shape (n,), and of all together.

    Parameters
    ----------
    change, sd
        Change of each logarithm and its standard deviation, shape (n,).
    least, most
        Range of the standard deviation of real changes, which is log-uniform.
    """
    wide = np.hypot(sd[:, None], np.geomspace(least, most, _NODES))
    density, none = stats.norm.logpdf(change[:, None], scale=wide), stats.norm.logpdf(change, scale=sd)
    log_b = np.asarray(density) - np.asarray(none)[:, None]
    each = np.logaddexp.reduce(log_b, axis=1) - math.log(_NODES)
    return each, float(np.logaddexp.reduce(log_b.sum(axis=0))) - math.log(_NODES)


def _modes(path: Path) -> Array:
    """Frequency in Hz, damping ratio, and their standard deviations of each mode of a file, shape (n, 4).

    Columns are frequency, its standard deviation, damping ratio, its standard deviation; NaN for an unknown ratio, 0
    for an unknown standard deviation.
    """
    inspection = inspect_file(path)
    rows = [(m.frequency_hz, m.frequency_sd_hz, m.damping_ratio, m.damping_sd) for m in inspection.modes]
    rows = rows or [
        (m.frequency_hz, m.frequency_sd_hz or 0.0, m.damping_ratio or np.nan, m.damping_sd or 0.0)
        for m in inspection.listed_modes
    ]
    if not rows:
        found = f"found no mode ({inspection.modes_note or 'no FRF'})"
        raise ModelError(f"{path}: {found}; expected FRFs or modes; look at it: jointbayes inspect {path}")
    return np.array(sorted(rows))
