"""Impact tests: from the records of a hammer and of responses to FRFs, their coherence, and the hits behind them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrecords.arrays import ComplexArray
from vibrecords.errors import refusal
from vibrecords.formats.grid import join_frfs
from vibrecords.frf_set import FrfSet
from vibrecords.modal_fit import identify_modes
from vibrecords.records import FrfRecord, TimeRecord
from vibrecords.signals import spectra, windows
from vibrecords.signals.hits import Hit, HitSettings, find_hits, hits_of, reject_overloads
from vibrecords.signals.spectra import ImpactSettings


@dataclass(frozen=True, slots=True)
class ImpactResult:
    """FRF of an impact test.

    Parameters
    ----------
    frf
        Its `averages` are the hits that were kept; coherence is None for a single one.
    hits
        All hits, with the reason why one was left out.
    added_decay_rate
        a of the exponential window, 1/s: `frf` is H(jω + a), see
        `vibrecords.signals.windows`. 0 without one.
    """

    frf: FrfRecord
    hits: tuple[Hit, ...]
    added_decay_rate: float


def impact_frfs(
    forces: Sequence[TimeRecord], responses: Sequence[Sequence[TimeRecord]], settings: ImpactSettings | None = None
) -> tuple[ImpactResult, ...]:
    """FRFs of several responses to the same hits, in the order of the responses.

    A hit that overloads one response is left out of all, so that all have the same averages.

    Parameters
    ----------
    forces, responses
        One record or several, the first record of a response belonging to the first force and so on; each the block of
        one hit, or a recording of several hits, as ``settings.hits.block_s`` says.
    settings
        Hits, windows and estimator; by default each record is a block.

    Raises
    ------
    MeasurementError
        If the records do not belong together, no hit can be kept, or kept hits differ in length.
    """
    chosen = settings or ImpactSettings()
    if not responses:
        raise refusal("impact", "no response", "one or more", "add the records of a response")
    together = [spectra.pair_records(forces, response) for response in responses]
    hits = find_hits(forces, chosen.hits)
    for response in responses:
        hits = reject_overloads(hits, response, chosen.hits)
    kept, results = [hit for hit in hits if hit.kept], list[ImpactResult]()
    if not kept:
        reasons = "; ".join(f"hit {hit.number}: {hit.reason}" for hit in hits[:3])
        found = f"no hit to keep among {len(hits)} ({reasons})"
        remedy = "hit again, or change block, pretrigger or levels"
        raise refusal(f"impact on {forces[0].channel!r}", found, "at least one", remedy)
    for pairs in together:
        rate = pairs[0][0].sample_rate_hz
        lengths = {chosen.hits.samples(pairs[hit.record][0]) for hit in kept}
        if len(lengths) > 1:
            found = f"blocks of {min(lengths)} to {max(lengths)} samples"
            raise refusal(f"impact on {pairs[0][0].channel!r}", found, "one length", "give block_s to cut them alike")
        (samples,) = lengths
        frequency, lines = spectra.kept_lines(samples, rate, chosen.f_min_hz, chosen.f_max_hz)
        decay = windows.exponential_window(samples, chosen.exponential_end)
        of_hits: list[list[ComplexArray]] = [[], []]  # spectra of force and response, offset removed and windowed
        for hit in kept:
            trigger = hit.trigger - hit.start
            for of_channel, history in zip(of_hits, pairs[hit.record], strict=True):
                block = history.values[hit.start : hit.start + samples]
                # the offset is the mean of what comes before the trigger, but for the last third, where it rises
                quiet = block[: 2 * trigger // 3]
                block = block - quiet.mean() if quiet.size >= 8 else block
                if of_channel is of_hits[0] and chosen.force_window_s is not None:
                    length = max(round(chosen.force_window_s * rate), 1)
                    block = block * windows.force_window(samples, trigger, length)
                of_channel.append(np.fft.rfft(decay * block)[lines])
        estimate = spectra.estimate_frf(np.array(of_hits[0]), np.array(of_hits[1]), chosen.estimator)
        added = windows.added_decay_rate(chosen.exponential_end, samples / rate)
        notes = [f"{chosen.estimator} from {len(kept)} of {len(hits)} hits"]
        if added > 0:
            notes.append(f"exponential window adds {added:.6g} 1/s to the decay rate of each mode")
        record = spectra.record_of_estimate(pairs[0], frequency, estimate, len(kept), *notes)
        results.append(ImpactResult(record, hits, added))
    return tuple(results)


def frfs_of_hits(records: Sequence[TimeRecord], settings: ImpactSettings | None = None) -> spectra.MadeFrfs:
    """All FRFs of the time records of an impact test, the damping of an exponential window taken out.

    Parameters
    ----------
    records
        Forces and responses of one hammer on one place after the other; those of the same `TimeRecord.hit` belong
        together.
    settings
        As for `impact_frfs`.

    Returns
    -------
    MadeFrfs
        One FRF for each pair of a force channel and a response; errors as for `sort_by_force`, `impact_frfs`,
        `corrected_frfs`.
    """
    chosen = settings or ImpactSettings()
    frfs: list[FrfRecord] = []
    notes: list[str] = []
    for forces, responses in spectra.sort_by_force(records):
        results = impact_frfs(forces, responses, chosen)
        frfs += corrected_frfs(results)
        lost = [f"hit {hit.number} ({hit.reason})" for hit in results[0].hits if not hit.kept]
        if lost:
            notes.append(f"Left out of the hits on {forces[0].channel}: {', '.join(lost)}.")
    return spectra.MadeFrfs(tuple(frfs), _line_step(chosen.exponential_end), tuple(notes))


def settings_of(records: Sequence[TimeRecord], f_min_hz: float | None, f_max_hz: float | None) -> ImpactSettings:
    """How FRFs are made of the records of a hammer without any settings: each record a block, or blocks about its hits.

    A block is a tenth shorter than hits are apart, as most of them are, and begins with a twentieth before the hit.

    Raises
    ------
    MeasurementError
        If there is no force, or one that is no hammer's.
    """
    of_hammer = [(record, hits_of(record)) for forces, _ in spectra.sort_by_force(records) for record in forces]
    other = next((record for record, hits in of_hammer if not hits), None)
    if other is not None:
        found, expected = f"a force on {other.channel!r} that is no hammer's", "hits, or how FRFs are made"
        raise refusal(other.where, found, expected, 'write method = "shaker" and block_s in [data.records]')
    gaps = np.concatenate(
        [np.diff([hit.trigger for hit in hits]) / record.sample_rate_hz for record, hits in of_hammer]
    )
    block_s = float(np.floor(900 * np.quantile(gaps, 0.25)) / 1000) if gaps.size else None
    hit_settings = HitSettings(block_s, block_s / 20 if block_s else 0.0)
    return ImpactSettings(hit_settings, f_min_hz=f_min_hz, f_max_hz=f_max_hz)


def _line_step(exponential_end: float) -> int:
    """Every how many lines are independent behind an exponential window."""
    window = windows.exponential_window(spectra.WINDOW_SAMPLES, exponential_end)
    return windows.independent_step(windows.line_correlation(window, random=False))


def corrected_frfs(results: Sequence[ImpactResult]) -> list[FrfRecord]:
    """FRFs without the damping that an exponential window added, by the modes that are found in them.

    See `vibrecords.signals.windows.remove_added_damping` for what this corrects and what not. Without a
    window the FRFs are returned as they are.

    Parameters
    ----------
    results
        Of `impact_frfs`: all responses to the same hits, whose modes are fitted together.

    Raises
    ------
    MeasurementError
        If no mode is found.
    """
    rate, records = results[0].added_decay_rate, [result.frf for result in results]
    if rate == 0:
        return records
    corrected, note = without_window(replace(join_frfs(records, "exponential window"), window_rate=rate))
    each = zip(records, corrected.values[:, :, 0].T, strict=True)
    return [replace(record, values=values, notes=(record.notes[0], note)) for record, values in each]


def without_window(frf: FrfSet) -> tuple[FrfSet, str]:
    """FRFs without the damping of their exponential window, by the modes that are found in them, and a note on it.

    Raises
    ------
    MeasurementError
        If no mode is found.
    """
    rate, measured = frf.window_rate, replace(frf, window_rate=0.0)
    seen = measured
    if frf.coherence is not None and frf.n_lines > 1:
        # as low as it must be for correlated lines to count as the independent ones that they are worth; otherwise the
        # smooth noise that a window leaves would be fitted by modes that are none
        seen = replace(measured, coherence=1 / (1 + line_step_of(frf) * (1 / frf.coherence - 1)))
    modes = identify_modes(seen)
    if not modes:
        found = f"no mode in the FRFs of {frf.inputs[0]!r}"
        expected = "some, by which the window's damping can be taken out"
        raise refusal("exponential window", found, expected, "widen the band or use longer blocks without a window")
    frequency, ratio = np.array([(mode.frequency_hz, mode.damping_ratio) for mode in modes]).T
    note = f"damping of the exponential window ({rate:.6g} 1/s) taken out by the {len(modes)} modes that were found"
    return windows.remove_added_damping(measured, frequency, ratio, rate), note


def line_step_of(frf: FrfSet) -> int:
    """Every how many lines of FRFs are independent behind their exponential window."""
    if not frf.window_rate or frf.n_lines < 2:
        return 1
    return _line_step(float(np.exp(-frf.window_rate / np.median(np.diff(frf.frequency_hz)))))
