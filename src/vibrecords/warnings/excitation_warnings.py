"""What coherence and noise of one FRF say of how it was excited: leakage, an excitation that ends, hum of the mains."""

from collections.abc import Iterator

import numpy as np

from vibrecords.arrays import Array, Flags
from vibrecords.provenance import MeasurementWarning
from vibrecords.records import FrfRecord
from vibrecords.warnings.clear_frf import ClearFrf, usable

#: Incoherence 1 − γ² at a resonance from which on, and over that beside it, there is a dip.
_DIP, _OVER = 0.05, 3.0
#: A mean of k degrees of freedom exceeds its expectation by 8/√k once in 100 000.
_SCATTER = 8.0
#: Averages where the file does not say.
_FEW_AVERAGES = 4
#: Stretches of the band; coherence above and below which one is good and bad; how the noise rises where the force ends.
_STRETCHES, _GOOD, _BAD, _RISE = 40, 0.9, 0.5, 5.0
#: Multiples of the mains that are looked at; how many at least must stand out, and what share of them: of the
#: coherence, and of the FRF, where the tips of resonances stand out as well.
_MULTIPLES, _HUMMING, _SHARE, _SHARE_OF_LINES = 20, 3, 0.25, 0.5
#: Lines further apart show no single tone.
_COARSE_HZ = 5.0


def excitation_warnings(record: FrfRecord, clear: ClearFrf) -> Iterator[MeasurementWarning]:
    """Warnings that rest on coherence, or where there is none on the scatter of neighbouring lines.

    Parameters
    ----------
    record
        As a reader gives it.
    clear
        What can be judged of it.
    """
    coherence = usable(record).coherence
    stated = coherence is not None and coherence.shape == clear.mobility.shape
    if coherence is not None and not (stated and ((coherence >= 0) & (coherence <= 1)).all()):
        return
    averages = max((record.averages or _FEW_AVERAGES) - 1, 1)
    incoherence = None if coherence is None or (coherence >= 1 - 1e-9).all() else 1 - coherence
    hum, humming = _mains(clear, incoherence, averages)
    yield from hum
    if incoherence is not None:
        yield from _leakage(clear, incoherence, averages, ~humming)
    yield from _end_of_excitation(clear, incoherence, averages)


def _leakage(clear: ClearFrf, incoherence: Array, averages: int, judged: Flags) -> Iterator[MeasurementWarning]:
    """Resonances at which the coherence dips: there the response is largest, and noise of the sensor does least."""
    lines, dips, magnitude = np.arange(incoherence.size), [], np.abs(clear.mobility)
    noise = magnitude**2 * incoherence / np.maximum(1 - incoherence, 1e-6)
    for peak in clear.resonances:
        top, half = int(np.searchsorted(clear.frequency_hz, peak.frequency_hz)), max(peak.lines, 2)
        reach = max(4 * half, 8)
        # lines of an antiresonance close by are none of the resonance
        at = lines[max(top - half // 2, 0) : top + half // 2 + 1]
        at = at[(magnitude[at] > magnitude[top] / 2) & judged[at]]
        sides = lines[max(top - reach, 0) : max(top - half, 0)], lines[top + half + 1 : top + reach + 1]
        if at.size * averages < 4 or min(side.size for side in sides) < 4:
            continue
        over = max(_OVER, 1 + _SCATTER / np.sqrt(at.size * averages))
        beside = max(float(np.median(incoherence[side])) for side in sides)
        # a weak mode between strong ones has a low coherence, but no more noise than they
        noisier = noise[at].mean() > over * max(np.median(noise[side]) for side in sides)
        if noisier and incoherence[at].mean() > max(_DIP, over * beside):
            dips.append((peak, 1 - incoherence[at].mean(), 1 - beside))
    if dips:
        peak, low, high = dips[0]
        few = f", of which {peak.lines} lines are within half power" if peak.lines < 5 else ""
        more = f" and at {len(dips) - 1} more" if len(dips) > 1 else ""
        yield MeasurementWarning(
            "leakage",
            f"coherence is {low:.2f} at the resonance at {peak.frequency_hz:.4g} Hz{few}, and {high:.3f} beside it"
            f"{more}: leakage of blocks that are too short, or the frequency depends on the level",
            "measure with longer blocks, and once more at half the level; do not trust height and damping of the peak",
        )


def _end_of_excitation(clear: ClearFrf, incoherence: Array | None, averages: int) -> Iterator[MeasurementWarning]:
    """From where on to the end of the band coherence is gone and the noise far above that before."""
    f, size = clear.frequency_hz, np.abs(clear.mobility)
    if f.size < 4 * _STRETCHES:
        return
    if incoherence is None:
        # of noise alone the magnitude is about as large
        coherence, noise = 1 / (1 + (2 * clear.noise / size) ** 2), clear.noise
    else:
        coherence = 1 - incoherence
        noise = size * np.sqrt(incoherence / np.maximum(coherence, 1e-6) / (2 * (averages + 1)))
    if clear.quantity != "mobility":  # noise of the sensor is even in the quantity that is measured
        noise = noise * (2 * np.pi * f) ** (1 if clear.quantity == "accelerance" else -1)
    each = f.size // _STRETCHES
    good, level = (np.median(x[-_STRETCHES * each :].reshape(_STRETCHES, each), axis=1) for x in (coherence, noise))
    bad = np.flatnonzero(good >= _BAD)
    first = int(bad[-1]) + 1 if bad.size else 0
    if not 3 <= first <= _STRETCHES - 2:
        return
    before = slice(0, max(first - 2, 1))
    if np.median(good[before]) > _GOOD and np.median(level[first:]) > _RISE * np.median(level[before]):
        start, rise = f[f.size - (_STRETCHES - first) * each], np.median(level[first:]) / np.median(level[before])
        yield MeasurementWarning(
            "excitation_ends",
            f"from {start:.4g} Hz to the last line at {f[-1]:.4g} Hz coherence is mostly below {_BAD:g}, and the noise "
            f"is {rise:.2g} times that before: the force does not reach so far",
            "end the band there (f_max_hz), or hit with a harder tip, or drive with a wider band",
        )


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
        beside = np.median(values[about[:, :, None] + [-6, -5, -4, -3, 3, 4, 5, 6]], axis=2)
        if incoherence is None:
            return np.asarray((values[about] > beside + _SCATTER * clear.noise[about]).any(axis=1))
        above = (values[about] > (1 + _SCATTER / np.sqrt(averages)) * beside) & (values[about] > _DIP)
        return np.asarray(above.any(axis=1))

    for mains in (50.0, 60.0):
        multiples = mains * np.arange(1, _MULTIPLES + 1)
        multiples = multiples[(multiples > f[0] + 8 * step) & (multiples < f[-1] - mains)]
        humming, elsewhere = outlying(multiples), outlying(multiples + 0.37 * mains)
        if humming.sum() >= max(_HUMMING, share * multiples.size, 3 * elsewhere.sum()):
            hum |= np.abs((f + mains / 2) % mains - mains / 2) <= 2.5 * step
            places = ", ".join(f"{at:g}" for at in multiples[humming][:4]) + (" and more" if humming.sum() > 4 else "")
            count = f"{int(humming.sum())} of {multiples.size} multiples"
            warnings.append(
                MeasurementWarning(
                    "mains",
                    f"lines stand out at {places} Hz, {count} of {mains:g} Hz: hum of the mains",
                    "leave these lines out (exclude_hz); look at grounding and at the cables of the sensors",
                )
            )
    return warnings, hum
