"""What one measured FRF contradicts by itself: axis, coherence, unit, physics at its resonances, its excitation."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import scipy  # its parts load at first use

from vibrecords.arrays import Array, Flags, Quantity
from vibrecords.driven import BAD, GOOD, RISE
from vibrecords.formats.units import frf_unit, is_force_over_motion
from vibrecords.provenance import MeasurementWarning
from vibrecords.records import HIGHEST_HZ, FrfRecord, measurable
from vibrecords.warnings.clear_frf import ClearFrf, Resonance, usable
from vibrecords.warnings.kinds import warn

#: Cosine of the phase of mobility at a resonance: beyond this it has a sign, within this it has none.
_SIGNED, _UNSIGNED = 0.5, 0.35
#: Lines above half power that a resonance needs to be looked at.
_RESOLVED = 3
#: A mass line may be wrong by this factor for calibration and for modes near by.
_TOO_HEAVY = 1.3
#: No phase error of a measuring chain makes a drive point less passive than this fraction of its magnitude.
_PHASE_ERROR = 0.15
#: Values that show one number or no imaginary part, and noise; over a window noise is never so like its neighbours.
_FEW_VALUES, _MANY_VALUES, _WINDOW, _UNLIKE = 16, 100, 30, 0.75


def conjugated_warning(clear: ClearFrf) -> MeasurementWarning:
    """That an FRF is the complex conjugate of what it should be."""
    rising = tuple(peak for peak in clear.resonances if peak.turn > 0)
    return warn("conjugated", peaks=_peak_words(rising) if rising else "the resonances of the other FRFs")


def warnings_of_frf(record: FrfRecord, clear: ClearFrf | None, mass_kg: float | None) -> Iterator[MeasurementWarning]:
    """What one FRF contradicts by itself.

    Parameters
    ----------
    record
        As a reader gives it.
    clear
        What can be judged of it.
    mass_kg
        Mass of the structure if it hangs free, kg.
    """
    yield from _line_warnings(record)
    yield from _value_warnings(record)
    yield from _unit_warnings(record)
    if clear is None:
        return
    yield from _excitation_warnings(record, clear)
    # the phase at a resonance between two lines is anything
    peaks = tuple(p for p in clear.resonances if p.lines >= _RESOLVED)
    if clear.response == clear.reference:
        yield from _drive_point_warnings(clear, peaks)
        if mass_kg is not None:
            yield from _mass_line_warnings(clear, mass_kg)
    elif len(peaks) >= 2 and max(abs(p.cosine) for p in peaks) < _UNSIGNED:
        yield _phase_warning(peaks, clear.quantity)


def _line_warnings(record: FrfRecord) -> Iterator[MeasurementWarning]:
    """Lines without a measured number, at 0 Hz, out of order, uneven, or in rad/s."""
    f = record.frequency_hz
    if np.isnan(record.window_rate):
        yield warn("exponential_window")
    possible = np.isfinite(f) & (np.abs(f) <= HIGHEST_HZ)
    broken, zero = ~(possible & measurable(record.values)), record.values == 0
    if broken.any():
        yield warn("not_finite", count=int(broken.sum()), size=f.size, what="lines")
    if zero.any():
        yield warn("zero_lines", count=int(zero.sum()), size=f.size, at=float(f[np.argmax(zero)]))
    f = f[possible]
    if f.size and f[0] == 0:
        yield warn("zero_hz")
        f = f[1:]
    if f.size < 3:
        return
    step, mean = np.diff(f), float((f[-1] - f[0]) / (f.size - 1))
    middle = float(np.median(step))
    if (step <= 0).any():
        line = int(np.argmax(step <= 0))
        yield warn("lines_out_of_order", after=f[line + 1], before=f[line])
        return
    if np.abs(step - middle).max() > 1e-3 * middle + 2e-6 * f[-1]:
        yield warn("uneven_lines", least=step.min(), most=step.max())
        return
    # the step of an analyser is a round number, and 2π times one where the axis is in rad/s
    rounding = float(np.abs(f - (f[0] + mean * np.arange(f.size))).max() / f[-1])
    tolerance, turns = max(1e-9, 2 * rounding * f[-1] / (mean * f.size)), mean / (2 * np.pi)
    if tolerance <= 1e-6 and not _is_round(mean, tolerance) and _is_round(turns, tolerance):
        yield warn("rad_per_s", found=f"lines are {mean:.6g} Hz apart, 2π times the round number {turns:.6g}")


def _is_round(value: float, tolerance: float) -> bool:
    """Whether a number has at most four digits, or is a whole number over 2¹⁴ as in sample rate over block length."""
    if not 1 / HIGHEST_HZ <= value <= HIGHEST_HZ:
        return False
    decade = 10.0 ** (np.floor(np.log10(value)) - 3)
    return any(abs(value / unit - round(value / unit)) * unit < tolerance * value for unit in (decade, 2.0**-14))


def _value_warnings(record: FrfRecord) -> Iterator[MeasurementWarning]:
    """Values that no structure has: one number throughout, no imaginary part, nothing but noise; and the coherence."""
    values = record.values[measurable(record.values) & (record.values != 0)]
    size = np.abs(values)
    if values.size >= _FEW_VALUES:
        if size.max() - size.min() <= 1e-9 * size.max() and np.abs(values - values[0]).max() <= 1e-9 * size.max():
            yield warn("constant", value=values[0], size=values.size)
        elif not values.imag.any():
            yield warn("real_only", size=values.size)
        elif values.size >= _MANY_VALUES:
            # coherence of each value with the next over windows of lines: 1 of a structure, less of noise
            turn = values[1:] * values[:-1].conj()
            of_pairs = np.abs(np.convolve(turn / np.abs(turn), np.ones(_WINDOW), "valid")) / _WINDOW
            if (likeness := float(of_pairs.max())) < _UNLIKE:
                yield warn("noise_only", window=_WINDOW, likeness=likeness)
    coherence = record.coherence
    if coherence is None:
        yield warn("coherence_missing")
        return
    finite = coherence[np.isfinite(coherence)]
    if finite.size and (finite >= 1 - 1e-9).all():
        yield warn("coherence_one", once=", as it always is with one average" if record.averages == 1 else "")
    if finite.size < coherence.size:
        missing = coherence.size - finite.size
        yield warn("coherence_range", wrong=f"is NaN or infinite on {missing} of {coherence.size} lines")
    elif ((finite < -1e-6) | (finite > 1 + 1e-6)).any():
        yield warn("coherence_range", wrong=f"runs from {finite.min():.4g} to {finite.max():.4g}")
    if record.averages is None:
        yield warn("averages_missing")


def _unit_warnings(record: FrfRecord) -> Iterator[MeasurementWarning]:
    if record.quantity is None:
        yield warn("quantity_missing", which="receptance, mobility or accelerance")
    if is_force_over_motion(record.unit):
        yield warn("unit_inverse", unit=record.unit)
        return
    yield from warnings_of_notes(record.notes)
    parsed = frf_unit(record.unit)
    if not record.unit.strip():
        yield warn("unit_missing")
    elif parsed is not None and record.quantity is not None and parsed[1] != record.quantity:
        yield warn("quantity_units", quantity=record.quantity, unit=record.unit, other=parsed[1])


def warnings_of_notes(notes: tuple[str, ...]) -> Iterator[MeasurementWarning]:
    """What a reader noted already: units that it could not read, or of which the file says two things."""
    for note in notes:
        if "left as written" in note or "not understood" in note:
            yield warn("unit_unknown", note=note)
        if "says otherwise" in note:
            yield warn("unit_system", note=note)


def _drive_point_warnings(clear: ClearFrf, peaks: tuple[Resonance, ...]) -> Iterator[MeasurementWarning]:
    mobility, quantity = clear.mobility, clear.quantity
    cosines = np.array([p.cosine for p in peaks])
    if cosines.size and (np.abs(cosines) < _UNSIGNED).all():
        yield _phase_warning(peaks, quantity)
        return
    if cosines.size and (cosines < -_SIGNED).all():
        other = {"accelerance": "receptance", "receptance": "accelerance"}.get(quantity)
        yield warn(
            "sign_flip",
            part="real" if quantity == "mobility" else "imaginary",
            quantity=quantity,
            sign="positive" if quantity == "receptance" else "negative",
            peaks=_peak_words(peaks),
            other=f", or the FRF is {other} and not {quantity}" if other else "",
        )
        return
    wrong = mobility.real < -(4 * clear.noise + _PHASE_ERROR * np.abs(mobility))
    run = scipy.ndimage.minimum_filter1d(wrong.astype(int), 5).astype(bool)  # five in a row
    wrong_peaks = [p.frequency_hz for p in peaks if p.cosine < -_SIGNED]
    if wrong_peaks or (run.any() and wrong.mean() > 0.03):
        yield warn("not_passive", at=wrong_peaks[0] if wrong_peaks else float(clear.frequency_hz[np.argmax(run)]))
    for left, right in pairwise(peaks):
        # the phase turns by π at a resonance and back at an antiresonance: without one the next peak has the other sign
        if min(abs(left.cosine), abs(right.cosine)) > _SIGNED and left.cosine * right.cosine < 0:
            yield warn("antiresonance_missing", left=left.frequency_hz, right=right.frequency_hz)
            return


def _mass_line_warnings(clear: ClearFrf, mass_kg: float) -> Iterator[MeasurementWarning]:
    """A free structure's drive point has at low frequency an accelerance of 1/m at least, more off its centre."""
    f, peaks = clear.frequency_hz, clear.resonances
    accelerance = 2j * np.pi * f * clear.mobility
    line = accelerance[f < (peaks[0].frequency_hz / 6 if peaks else f[-1])]
    if line.size < 6:
        return
    level = float(np.median(line.real))
    parts = [float(np.median(line.real[: line.size // 2])), float(np.median(line.real[line.size // 2 :]))]
    # a mass line is flat and real
    if level <= 0 or np.median(np.abs(np.angle(line))) > 0.3 or abs(parts[0] - parts[1]) > 0.1 * level:
        return
    heavy = 1 / (level * mass_kg)
    if heavy > _TOO_HEAVY:
        warning = warn("mass_line", mass=1 / level, times=heavy, stated=mass_kg)
        yield warn("g_against_ms2", found=warning.sentence) if abs(np.log(heavy / 9.80665)) < 1.5 else warning


def _phase_warning(peaks: tuple[Resonance, ...], quantity: Quantity) -> MeasurementWarning:
    part, likely = ("imaginary", "receptance or accelerance") if quantity == "mobility" else ("real", "mobility")
    return warn("quantity_phase", quantity=quantity, part=part, peaks=_peak_words(peaks), likely=likely)


def _peak_words(peaks: tuple[Resonance, ...]) -> str:
    if len(peaks) == 1:
        return f"its resonance at {peaks[0].frequency_hz:.4g} Hz"
    return f"its {len(peaks)} resonances (the first at {peaks[0].frequency_hz:.4g} Hz)"


# ---- how it was excited: leakage, an excitation that ends, hum of the mains

#: Incoherence 1 − γ² at a resonance from which on, and over that on both sides, there is a dip.
_DIP, _OVER = 0.05, 3.0
#: A mean of k degrees of freedom exceeds its expectation by 8/√k once in 100 000.
_SCATTER = 8.0
#: Averages where the file does not say.
_FEW_AVERAGES = 4
#: Stretches of the band.
_STRETCHES = 40
#: Multiples of the mains that are looked at; how many at least must stand out, and what share of them: of the
#: coherence, and of the FRF, where the tips of resonances stand out as well.
_MULTIPLES, _HUMMING, _SHARE, _SHARE_OF_LINES = 20, 3, 0.25, 0.5
#: Lines further apart show no single tone.
_COARSE_HZ = 5.0


def _excitation_warnings(record: FrfRecord, clear: ClearFrf) -> Iterator[MeasurementWarning]:
    """Warnings that rest on coherence, or where there is none on the scatter of neighbouring lines.

    That the excitation ends is judged of all lines, the others of those that were driven, which `clear` has.
    """
    record, whole = usable(record), clear
    if record.frequency_hz.size > clear.frequency_hz.size:
        whole = ClearFrf.of(record) or clear
    coherence = record.coherence
    if coherence is not None and not ((coherence >= 0) & (coherence <= 1)).all():
        return
    averages = max((record.averages or _FEW_AVERAGES) - 1, 1)
    incoherence = None if coherence is None or (coherence >= 1 - 1e-9).all() else 1 - coherence
    yield from _end_of_excitation(whole, record)
    if incoherence is not None:
        incoherence = incoherence[np.isin(whole.frequency_hz, clear.frequency_hz)]
    hum, humming = _mains(clear, incoherence, averages)
    yield from hum
    if incoherence is None:
        return
    # resonances at which the coherence dips: there the response is largest, and noise of the sensor does least
    lines, dips, magnitude = np.arange(incoherence.size), [], np.abs(clear.mobility)
    noise = magnitude**2 * incoherence / np.maximum(1 - incoherence, 1e-6)
    for peak in clear.resonances:
        top, half = int(np.searchsorted(clear.frequency_hz, peak.frequency_hz)), max(peak.lines, 2)
        reach = max(4 * half, 8)
        # lines of an antiresonance close by are none of the resonance
        at = lines[max(top - half // 2, 0) : top + half // 2 + 1]
        at = at[(magnitude[at] > magnitude[top] / 2) & ~humming[at]]
        sides = lines[max(top - reach, 0) : max(top - half, 0)], lines[top + half + 1 : top + reach + 1]
        if at.size * averages < 4 or min(side.size for side in sides) < 4:
            continue
        over = max(_OVER, 1 + _SCATTER / np.sqrt(at.size * averages))
        around = max(float(np.median(incoherence[side])) for side in sides)
        # a weak mode between strong ones has a low coherence, but no more noise than they
        noisier = noise[at].mean() > over * max(np.median(noise[side]) for side in sides)
        if noisier and incoherence[at].mean() > max(_DIP, over * around):
            dips.append((peak, 1 - incoherence[at].mean(), 1 - around))
    if dips:
        peak, low, high = dips[0]
        few = f", of which {peak.lines} lines are within half power" if peak.lines < 5 else ""
        more = f" and at {len(dips) - 1} more" if len(dips) > 1 else ""
        yield warn("leakage", low=low, at=peak.frequency_hz, few=few, high=high, more=more)


def _end_of_excitation(clear: ClearFrf, record: FrfRecord) -> Iterator[MeasurementWarning]:
    """From where on to the end of the band coherence is gone and the noise far above that before."""
    f = clear.frequency_hz
    if f.size < 4 * _STRETCHES:
        return
    coherence, noise = clear.excitation(record)
    each = f.size // _STRETCHES
    good, level = (np.median(x[-_STRETCHES * each :].reshape(_STRETCHES, each), axis=1) for x in (coherence, noise))
    bad = np.flatnonzero(good >= BAD)
    first = int(bad[-1]) + 1 if bad.size else 0
    if not 3 <= first <= _STRETCHES - 2:
        return
    before = slice(0, max(first - 2, 1))
    rise = np.median(level[first:]) / np.median(level[before])
    if np.median(good[before]) > GOOD and rise > RISE:
        yield warn("excitation_ends", start=f[f.size - (_STRETCHES - first) * each], end=f[-1], bad=BAD, rise=rise)


def _mains(clear: ClearFrf, incoherence: Array | None, averages: int) -> tuple[list[MeasurementWarning], Flags]:
    """Lines at multiples of the mains that stand out of both sides, as hardly any elsewhere do; and which these are."""
    f = clear.frequency_hz
    warnings: list[MeasurementWarning] = []
    hum = np.zeros(f.size, dtype=bool)
    step = (f[-1] - f[0]) / (f.size - 1)
    if step > _COARSE_HZ or f.size < 64:
        return warnings, hum
    values, share = (np.abs(clear.mobility), _SHARE_OF_LINES) if incoherence is None else (incoherence, _SHARE)

    def outlying(places: Array) -> Flags:
        """Whether one of the three lines about each place stands out of those three to six lines away."""
        about = np.clip(np.searchsorted(f, places), 7, f.size - 8)[:, None] + np.arange(-1, 2)
        around = np.median(values[about[:, :, None] + [-6, -5, -4, -3, 3, 4, 5, 6]], axis=2)
        if incoherence is None:
            return np.asarray((values[about] > around + _SCATTER * clear.noise[about]).any(axis=1))
        above = (values[about] > (1 + _SCATTER / np.sqrt(averages)) * around) & (values[about] > _DIP)
        return np.asarray(above.any(axis=1))

    for mains in (50.0, 60.0):
        multiples = mains * np.arange(1, _MULTIPLES + 1)
        multiples = multiples[(multiples > f[0] + 8 * step) & (multiples < f[-1] - mains)]
        humming, elsewhere = outlying(multiples), outlying(multiples + 0.37 * mains)
        if humming.sum() >= max(_HUMMING, share * multiples.size, 3 * elsewhere.sum()):
            hum |= np.abs((f + mains / 2) % mains - mains / 2) <= 2.5 * step
            places = ", ".join(f"{at:g}" for at in multiples[humming][:4]) + " and more" * bool(humming.sum() > 4)
            warnings.append(warn("mains", places=places, count=int(humming.sum()), all=multiples.size, mains=mains))
    return warnings, hum
