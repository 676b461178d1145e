"""How wrong a model is in an engineer's measure, and what its residuals point to.

At a good signal-to-noise ratio every model of a real structure fails a test of its residuals. What is asked then is by
how many per cent its resonances are off, how well the FRFs correlate, and which of frequency, damping, level or a
single sensor is to blame. Each resonance is fitted in measured and predicted FRF alike, so that what the fit itself
gets wrong cancels.

References
----------
Heylen, W., Lammens, S., Sas, P. (1997). Modal analysis theory and testing, KU Leuven (FRAC, the correlation of FRFs).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import singledispatch
from itertools import product
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.frf import Ports
from jointbayes.identification.resonances import SharedResonances, median_seen
from jointbayes.inference import Problem, modal_model
from jointbayes.posterior.checks import check_of, checks_of
from jointbayes.posterior.sampled import Sampled, kept
from jointbayes.rounding import percent, sentence_start
from vibrecords import Data, FrfData, ModalData, quantity_factor
from vibrecords.arrays import Array

Complex = NDArray[np.complex128]
Cause = Literal["frequencies, all the same way", "frequencies, unevenly", "damping", "level", "one sensor"]

#: Deviations are named from so many standard deviations of the noise on.
_SIGNIFICANT = 4.0
#: And where they are larger than this: a frequency in half-power bandwidths, damping and level as fractions.
_LEAST_FREQUENCY, _LEAST_DAMPING, _LEAST_LEVEL = 0.1, 0.1, 0.03
#: Frequencies are off all the same way if the least error is this share of the largest, of the same sign.
_SAME_WAY = 0.25
#: One sensor is off alone if the others are off by less than this share of it.
_ALONE = 0.35
#: A level so far off is no matter of frequencies that are off.
_GROSS = 0.3
_LET_COUNT = (
    "The noise of the measured bodies is ignored: let it count (propagate = true) before looking for another cause."
)


_ADVICE: dict[Cause, str] = {
    "frequencies, all the same way": "All resonances of the model are too {side}: check length, Young's modulus and "
    "density, or state them as uncertain.",
    "frequencies, unevenly": "No joint stiffness brings all resonances to the measured ones. Check length, "
    "Young's modulus and density, or state them as uncertain; otherwise the model lacks something (a mass, a second "
    "joint).",
    "damping": "The peaks are at the right frequency but their width is wrong: measured damping is {damping:.2g} times "
    "the model's; correct it or state it as uncertain.",
    "level": "The level is off: measured FRFs are {level:.3g} times the predicted ones at every resonance; check the "
    "calibration, or state the gain as uncertain.",
    "one sensor": "One FRF alone is off: {sensor} {how}; check its sensor's calibration, direction and position.",
}


@dataclass(frozen=True, slots=True)
class ModeError:
    """One resonance, measured and at the MAP.

    Parameters
    ----------
    measured_hz, predicted_hz
        Its frequency, Hz.
    damping_ratio
        Measured over predicted damping; NaN for natural frequencies.
    """

    measured_hz: float
    predicted_hz: float
    damping_ratio: float = math.nan

    @property
    def error_percent(self) -> float:
        """Predicted over measured frequency, less one, per cent."""
        return 100 * (self.predicted_hz / self.measured_hz - 1)


@dataclass(frozen=True, slots=True)
class PairFit:
    """One FRF, measured and at the MAP.

    Parameters
    ----------
    output, input
        DOF labels.
    correlation
        |Σ H* Hx|² / (Σ|H|² Σ|Hx|²) over all lines, 0 to 1: the FRF assurance criterion.
    level
        Measured over predicted level, at the resonances where there are any.
    turned
        Whether measured and predicted FRF have opposite signs.
    """

    output: str
    input: str
    correlation: float
    level: float
    turned: bool


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What a misfit looks like, and what it points to.

    Parameters
    ----------
    modes
        Resonances found in both measured and predicted data, by rising frequency.
    pairs
        FRFs; empty for natural frequencies.
    causes
        What the residuals point to, the first one first; empty where nothing stands out of the noise.
    sensor
        Name of the FRF that is off alone, if that is a cause.
    ignores_noise
        Whether the noise of measured bodies, which may be all there is to it, is ignored.
    remedy
        What helps where they point to nothing, see `jointbayes.posterior.checks`.
    """

    modes: tuple[ModeError, ...]
    pairs: tuple[PairFit, ...]
    causes: tuple[Cause, ...]
    sensor: str = ""
    ignores_noise: bool = False
    remedy: str = ""

    @property
    def measure(self) -> str:
        """Size of the misfit in an engineer's measure."""
        parts = []
        if self.modes:
            worst = max(self.modes, key=lambda mode: abs(mode.error_percent))
            place = self.modes.index(worst) + 1
            parts.append(
                f"resonances are off by up to {percent(abs(worst.error_percent) / 100)} (no. {place}: measured "
                f"{worst.measured_hz:.5g} Hz, MAP {worst.predicted_hz:.5g} Hz)"
            )
        if self.pairs:
            low = min(self.pairs, key=lambda pair: pair.correlation)
            which = f" ({low.output}/{low.input})" if len(self.pairs) > 1 else ""
            parts.append(f"the {'lowest ' if which else ''}FRF correlation{which} is {low.correlation:.3g}")
        text = " and ".join(parts)
        return f"{sentence_start(text)}." if text else ""

    @property
    def sentences(self) -> tuple[str, ...]:
        """Measure, and what the residuals point to; the remedy where they point to nothing."""
        return tuple(filter(None, (self.measure, *self.advice)))

    @property
    def advice(self) -> tuple[str, ...]:
        """What the residuals point to, sentence by sentence; the remedy where they point to nothing."""
        return (*(_LET_COUNT,) * self.ignores_noise, *map(self._advice_on, self.causes)) or (self.remedy,)

    @property
    def sentence(self) -> str:
        """All of it in one text."""
        return " ".join(self.sentences)

    def _advice_on(self, cause: Cause) -> str:
        ratios = [mode.damping_ratio for mode in self.modes if math.isfinite(mode.damping_ratio)]
        pair = next((p for p in self.pairs if f"{p.output}/{p.input}" == self.sensor), None)
        how = "" if pair is None else f"is {pair.level:.3g} times the predicted one"
        return _ADVICE[cause].format(
            side="low" if self.modes and self.modes[0].error_percent < 0 else "high",
            damping=np.median(ratios) if ratios else math.nan,
            level=np.median([pair.level for pair in self.pairs]) if self.pairs else math.nan,
            sensor=self.sensor,
            how="has the opposite sign" if pair is not None and pair.turned else how,
        )


@kept
def diagnoses_of(posterior: Sampled) -> tuple[Diagnosis, ...]:
    """Diagnose each test of a posterior: how far the MAP is from its data, and what its residuals point to."""
    best, estimate = posterior.best, posterior.estimate
    theta = best.theta if best.log_density > estimate.log_posterior else estimate.theta
    each = ((part, np.random.default_rng([posterior.record.seed, 4])) for part in posterior.problem.parts)
    return tuple(
        replace(diagnose(part.test.data, part, theta, rng), remedy=check.remedy)
        for (part, rng), check in zip(each, checks_of(posterior), strict=True)
    )


def diagnosis_of(posterior: Sampled) -> Diagnosis:
    """Return the diagnosis of the test that the model explains worst."""
    names = [test.name for test in posterior.problem.tests]
    return diagnoses_of(posterior)[names.index(check_of(posterior).test)]


@singledispatch
def diagnose(data: Data, problem: Problem, theta: ArrayLike, rng: np.random.Generator) -> Diagnosis:
    """Diagnose the misfit of data at θ, shape (d,), with all that was fitted: gain, masses, every nuisance.

    Each kind of data whose residuals point to something registers its own with ``@diagnose.register``.
    """
    return Diagnosis((), (), ())


@diagnose.register
def _diagnose_modes(data: ModalData, problem: Problem, theta: ArrayLike, rng: np.random.Generator) -> Diagnosis:
    prior, point = problem.prior, np.asarray(theta, dtype=float)[None]
    modes = modal_model(data, problem.test.structures, problem.test.joints)
    predicted = modes.modal_frequencies(prior.matrix(point), problem.structural(prior.factors(point)))[0]
    return diagnose_frequencies(data.frequency_hz, predicted, data.sd_hz)


@diagnose.register
def _diagnose_frf_data(data: FrfData, problem: Problem, theta: ArrayLike, rng: np.random.Generator) -> Diagnosis:
    prior, point = problem.prior, np.asarray(theta, dtype=float)[None]
    factors, frf = prior.factors(point), data.frf
    model = problem.test.receptance_model(Ports(frf.frequency_hz, frf.outputs, frf.inputs))
    receptance = model.receptance(prior.matrix(point), problem.structural(factors))[0]
    gain = float(problem.gain(factors)[0])
    factor = quantity_factor(frf.frequency_hz, frf.quantity)[:, None, None]
    sd = np.sqrt(problem.log_posterior.variance(point)[0]) / np.abs(factor)
    both = frf.values / factor, gain * receptance
    diagnosis = diagnose_frfs(frf.frequency_hz, *both, sd, frf.outputs, frf.inputs, rng)
    return replace(diagnosis, ignores_noise=problem.test.ignores_noise_of_bodies)


def diagnose_frequencies(measured_hz: Array, predicted_hz: Array, sd_hz: Array) -> Diagnosis:
    """Diagnose natural frequencies.

    Parameters
    ----------
    measured_hz, predicted_hz, sd_hz
        Frequencies, those of the MAP, and the standard deviations of the measured ones, each shape (n,), Hz.
    """
    modes = tuple(ModeError(float(m), float(p)) for m, p in zip(measured_hz, predicted_hz, strict=True))
    return Diagnosis(modes, (), tuple(_frequency_cause(np.log(measured_hz / predicted_hz), sd_hz / measured_hz, 0.0)))


def diagnose_frfs(
    frequency_hz: Array,
    measured: Complex,
    predicted: Complex,
    sd: Array,
    outputs: Sequence[str],
    inputs: Sequence[str],
    rng: np.random.Generator,
) -> Diagnosis:
    """Diagnose FRFs.

    Parameters
    ----------
    frequency_hz
        Lines, shape (lines,), Hz.
    measured, predicted
        Receptances, shape (lines, outputs, inputs), m/N.
    sd
        Standard deviation √(E|δH|²) of the measured ones, same shape.
    outputs, inputs
        DOF labels.
    rng
        Replicates the noise, so that a deviation is distinguished from it.
    """
    shape = (len(frequency_hz), len(outputs) * len(inputs))
    have, want, noise = measured.reshape(shape), predicted.reshape(shape), sd.reshape(shape)
    resonances = SharedResonances(frequency_hz, have, want, noise)
    ratios = resonances.ratios(have)
    scatter = resonances.scatter(rng)
    # level of each FRF: at its resonances, else over all lines
    levels = np.sqrt((np.abs(have) ** 2).sum(axis=0) / (np.abs(want) ** 2).sum(axis=0))
    if len(ratios):
        at_modes = median_seen(ratios[..., 2], axis=0)
        levels = np.where(np.isfinite(at_modes), np.exp(at_modes), levels)
    pairs = []
    for labels, here, there, level in zip(product(outputs, inputs), have.T, want.T, levels.tolist(), strict=True):
        both, square = np.vdot(there, here), np.vdot(there, there).real * np.vdot(here, here).real
        turned = bool(both.real < -0.5 * math.sqrt(square))
        pairs.append(PairFit(*labels, float(np.abs(both) ** 2 / square), level, turned))
    with np.errstate(invalid="ignore"):
        by_mode = median_seen(ratios, axis=1)
    modes = tuple(
        ModeError(float(f * math.exp(shift)), float(f), float(math.exp(damping)))
        for f, (shift, damping, _) in zip(resonances.predicted_hz, by_mode, strict=True)
    )
    by_mode_scatter = median_seen(scatter, axis=1)
    bandwidth = 2 * np.exp(resonances.log_damping + np.maximum(by_mode[:, 1], 0.0))
    causes = _frequency_cause(by_mode[:, 0], by_mode_scatter[:, 0], _LEAST_FREQUENCY * bandwidth)
    # of ln level of each FRF, the mean over its resonances
    seen = np.maximum(np.isfinite(scatter[..., 2]).sum(axis=0), 1)
    level_scatter = np.sqrt(np.nansum(scatter[..., 2] ** 2, axis=0)) / seen
    sensor = _sensor(pairs, level_scatter, _GROSS if causes else _LEAST_LEVEL)
    if sensor:
        causes.insert(0, "one sensor")
    elif not causes:  # whether all FRFs together are off in level
        log_level = np.log(levels)
        limit = max(_SIGNIFICANT * float(np.sqrt((level_scatter**2).sum())) / len(level_scatter), _LEAST_LEVEL)
        if abs(float(log_level.mean())) > limit and abs(np.sign(log_level).sum()) == len(log_level):
            causes.append("level")
    off = np.abs(by_mode[:, 1]) > np.maximum(_SIGNIFICANT * by_mode_scatter[:, 1], _LEAST_DAMPING)
    if off.size and off.mean() >= 0.5:
        causes.append("damping")
    return Diagnosis(modes, tuple(pairs), tuple(causes), sensor)


def _frequency_cause(shift: Array, scatter: Array, least: ArrayLike) -> list[Cause]:
    """Whether frequencies are off by more than the noise and something that counts, and how."""
    if not (np.abs(shift) > np.maximum(_SIGNIFICANT * scatter, least)).any():
        return []
    same = len(shift) > 1 and abs(np.sign(shift).sum()) == len(shift)
    even = np.abs(shift).min() >= _SAME_WAY * np.abs(shift).max()
    return ["frequencies, all the same way" if same and even else "frequencies, unevenly"]


def _sensor(pairs: Sequence[PairFit], scatter: Array, least: float) -> str:
    """Name of the one FRF that is off while the others are not; empty if there is none, or only one FRF."""
    if len(pairs) < 2:
        return ""
    turned = [pair.turned for pair in pairs]
    log_level = np.log([pair.level for pair in pairs])
    worst = turned.index(True) if any(turned) else int(np.abs(log_level).argmax())
    others = np.delete(log_level, worst)
    limit = max(_SIGNIFICANT * float(np.hypot(scatter[worst], np.delete(scatter, worst).max())), least)
    alone = np.abs(others).max() < _ALONE * abs(log_level[worst])
    apart = abs(log_level[worst] - np.median(others)) > limit
    if sum(turned) != 1 and (any(turned) or not (alone and apart)):
        return ""
    return f"{pairs[worst].output}/{pairs[worst].input}"
