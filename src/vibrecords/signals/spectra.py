"""FRFs and coherence from the spectra of force and response: H1, H2, Hv; and tests with a shaker."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
import scipy  # its parts load at first use

from vibrecords.arrays import Array, ComplexArray, Indices
from vibrecords.errors import MeasurementError, refusal, require_one_of
from vibrecords.formats.units import MOTION_OF, si_frf_unit
from vibrecords.records import LARGEST, FrfRecord, TimeRecord, measurable
from vibrecords.signals.hits import HitSettings
from vibrecords.signals.windows import effective_averages, independent_step, line_correlation

Estimator = Literal["H1", "H2", "Hv"]
_QUANTITY = {motion: quantity for quantity, motion in MOTION_OF.items()}
#: Above this share of the sample rate the anti-aliasing filters of analysers fall off.
HIGHEST_LINE = 1 / 2.56
#: Of a window on paper: the correlation of lines does not depend on their number.
WINDOW_SAMPLES = 1024


@dataclass(frozen=True, slots=True)
class MadeFrfs:
    """FRFs that were made of time histories.

    Parameters
    ----------
    frfs
        One for each response and force.
    line_step
        Every how many lines are independent, with the windows that were used.
    notes
        What was done, and which hits were left out.
    """

    frfs: tuple[FrfRecord, ...]
    line_step: int = 1
    notes: tuple[str, ...] = ()


def estimate_frf(
    force: ComplexArray, response: ComplexArray, estimator: Estimator = "H1"
) -> tuple[ComplexArray, Array]:
    """FRF and coherence from spectra of averages.

    H1 = S_fx/S_ff has no bias from noise at the response, H2 = S_xx/S_xf none from noise at the force, and Hv, their
    geometric mean with the phase of both, lies between.

    Parameters
    ----------
    force, response
        Spectra, shape (averages, lines); any common factor of both drops out.
    estimator
        ``"H1"``, ``"H2"`` or ``"Hv"``.

    Returns
    -------
    values, coherence : ndarray, shape (lines,)
        γ² is 1 throughout for a single average.

    Raises
    ------
    MeasurementError
        If the estimator does not exist, or a line has no force or no response.

    References
    ----------
    Rocklin, G. T., Crowley, J., Vold, H. (1985). A comparison of H1, H2, and Hv frequency response functions.
    Proc. 3rd International Modal Analysis Conference, 272-278.
    """
    require_one_of(get_args(Estimator), estimator, "FRF estimate", "estimator ")
    of_force, of_response = (np.mean(np.abs(x) ** 2, axis=0) for x in (force, response))
    cross = np.mean(force.conj() * response, axis=0)
    silent = np.flatnonzero((of_force == 0) | (cross == 0))
    if silent.size:
        what = "force" if of_force[silent[0]] == 0 else "response that belongs to the force"
        found, expected = f"no {what} at line {int(silent[0]) + 1} of {cross.size}", "some at every line"
        raise refusal("FRF estimate", found, expected, "look at the channel, or choose a band that the force reaches")
    coherence: Array = np.minimum(np.abs(cross) ** 2 / (of_force * of_response), 1.0)
    return cross / of_force / coherence ** {"H1": 0.0, "H2": 1.0, "Hv": 0.5}[estimator], coherence


def record_of_estimate(
    pair: tuple[TimeRecord, TimeRecord],
    frequency_hz: Array,
    estimate: tuple[ComplexArray, Array],
    averages: int,
    *notes: str,
) -> FrfRecord:
    """The FRF of records of force and response; of a single average coherence says nothing, and is left out."""
    (force, response), (values, coherence) = pair, estimate
    quantity = _QUANTITY[response.quantity]
    told = (si_frf_unit(quantity), coherence if averages > 1 else None, averages, response.where, notes)
    return FrfRecord(response.channel, force.channel, frequency_hz, values, quantity, *told)


@dataclass(frozen=True, slots=True)
class ImpactSettings:
    """How FRFs are made from hits.

    Parameters
    ----------
    hits
        How hits are found and judged.
    force_window_s
        How long after the trigger the force counts, s; None leaves it as it is.
    exponential_end
        What is left of the exponential window at the end of a block, 1 without one; it is put on both channels.
    estimator
        ``"H1"``, ``"H2"`` or ``"Hv"``.
    f_min_hz, f_max_hz
        Band of the lines that are kept; by default from the first above 0 Hz to the sample rate over 2.56.
    """

    hits: HitSettings = field(default_factory=HitSettings)
    force_window_s: float | None = None
    exponential_end: float = 1.0
    estimator: Estimator = "H1"
    f_min_hz: float | None = None
    f_max_hz: float | None = None


@dataclass(frozen=True, slots=True)
class ShakerSettings:
    """How FRFs are made from the records of a shaker.

    Parameters
    ----------
    block_s
        Length of a block, s; lines are 1/block_s apart.
    overlap
        Of neighbouring blocks, 0 to below 1.
    window
        Name of a window of `scipy.signal.get_window`: ``"hann"`` for random force, ``"boxcar"`` for one that is
        periodic in the block or a burst that dies out within it.
    estimator
        ``"H1"``, ``"H2"`` or ``"Hv"``.
    f_min_hz, f_max_hz
        Band of the lines that are kept; by default from the first above 0 Hz to the sample rate over 2.56.

    Raises
    ------
    MeasurementError
        If a number is impossible.
    """

    block_s: float
    overlap: float = 0.5
    window: str = "hann"
    estimator: Estimator = "H1"
    f_min_hz: float | None = None
    f_max_hz: float | None = None

    def __post_init__(self) -> None:
        if not (self.block_s > 0 and 0 <= self.overlap < 1):
            found = f"blocks of {self.block_s:g} s with an overlap of {self.overlap:g}"
            raise refusal("shaker", found, "a length above 0 and an overlap of at least 0 and below 1", "correct them")


@dataclass(frozen=True, slots=True)
class ShakerResult:
    """FRF of a shaker test.

    Parameters
    ----------
    frf
        Its `averages` are the independent ones, rounded.
    blocks
        Number of blocks, overlapping or not.
    effective_averages
        What they count for.
    """

    frf: FrfRecord
    blocks: int
    effective_averages: float


def shaker_frf(forces: Sequence[TimeRecord], responses: Sequence[TimeRecord], settings: ShakerSettings) -> ShakerResult:
    """FRF from records of a shaker's force and of one response, by overlapping windowed blocks (Welch).

    Parameters
    ----------
    forces, responses
        One record or several, the first response belonging to the first force and so on.
    settings
        Blocks, window and estimator.

    Returns
    -------
    ShakerResult
        Coherence is None where the blocks count for less than two averages.

    Raises
    ------
    MeasurementError
        If the records do not belong together, or are shorter than a block.

    References
    ----------
    Welch, P. D. (1967). The use of fast Fourier transform for the estimation of power spectra. IEEE Transactions on
    Audio and Electroacoustics 15(2), 70-73. DOI 10.1109/TAU.1967.1161901
    """
    pairs = pair_records(forces, responses)
    rate = pairs[0][0].sample_rate_hz
    samples = round(settings.block_s * rate)
    hop = max(round(samples * (1 - settings.overlap)), 1)
    window = np.asarray(scipy.signal.get_window(settings.window, samples), dtype=float)
    longest = max(record.values.size for record, _ in pairs)
    if longest < samples or samples < 2:
        raise MeasurementError(
            f"shaker: found records of at most {longest / rate:g} s for blocks of {settings.block_s:g} s at {rate:g} "
            "samples per second; expected records longer than a block of two samples or more; shorten the blocks"
        )
    frequency, kept = kept_lines(samples, rate, settings.f_min_hz, settings.f_max_hz)
    spectra = [[_block_spectra(x.values, window, hop)[:, kept] for x in pair] for pair in pairs]
    of_force, of_response = map(np.concatenate, zip(*spectra, strict=True))
    estimate = estimate_frf(of_force, of_response, settings.estimator)
    each = [len(x) for x, _ in spectra]
    effective = sum(effective_averages(count, window, hop) for count in each if count)
    note = f"{settings.estimator} from {sum(each)} blocks that count for {effective:.3g} averages"
    frf = record_of_estimate(pairs[0], frequency, estimate, max(round(effective), 1), note)
    return ShakerResult(frf, sum(each), effective)


def frfs_of_shaker(records: Sequence[TimeRecord], settings: ShakerSettings) -> MadeFrfs:
    """All FRFs of the time records of a shaker test, one for each response; errors as `sort_by_force`, `shaker_frf`."""
    tests = sort_by_force(records)
    results = [shaker_frf(forces, response, settings) for forces, responses in tests for response in responses]
    window = scipy.signal.get_window(settings.window, WINDOW_SAMPLES)
    hop = max(round(WINDOW_SAMPLES * (1 - settings.overlap)), 1)
    blocks = min((result.blocks for result in results), default=1)
    correlation = line_correlation(window, random=True, blocks=blocks, hop=hop)
    return MadeFrfs(tuple(result.frf for result in results), independent_step(correlation))


def kept_lines(
    samples: int, sample_rate_hz: float, f_min_hz: float | None, f_max_hz: float | None
) -> tuple[Array, Indices]:
    """Frequencies of the lines of a block within a band, without 0 Hz, and their numbers.

    Raises
    ------
    MeasurementError
        If none is left.
    """
    every = np.asarray(np.arange(samples // 2 + 1) * (sample_rate_hz / samples), dtype=float)
    low = every[1] / 2 if f_min_hz is None else f_min_hz
    high = HIGHEST_LINE * sample_rate_hz if f_max_hz is None else f_max_hz
    close = 1e-6 * every[1]
    kept: Indices = np.flatnonzero((every >= low - close) & (every <= high + close) & (every > 0))
    if not kept.size:
        found = f"no line between {low:g} and {high:g} Hz"
        expected = f"a band that holds multiples of {every[1]:g} Hz up to {every[-1]:g} Hz"
        raise refusal("FRF estimate", found, expected, "widen the band or lengthen the blocks")
    return every[kept], kept


def pair_records(forces: Sequence[TimeRecord], responses: Sequence[TimeRecord]) -> list[tuple[TimeRecord, TimeRecord]]:
    """Records of force and response, as many of both, in pairs of which an FRF can be made.

    Raises
    ------
    MeasurementError
        If they differ in length or sample rate, hold NaN or infinity, or are not a force and a motion.
    """
    pairs = list(zip(forces, responses, strict=True))
    rate = forces[0].sample_rate_hz
    for x, y in pairs:
        where = f"time records {x.channel!r} and {y.channel!r}" + (f", hit {x.hit}" if x.hit is not None else "")
        if x.quantity != "force" or y.quantity not in _QUANTITY or y.quantity != responses[0].quantity:
            expected = f"force and one kind of motion ({', '.join(_QUANTITY)})"
            raise refusal(where, f"{x.quantity} and {y.quantity}", expected, "name the channels right")
        if x.values.shape != y.values.shape or {x.sample_rate_hz, y.sample_rate_hz} != {rate} or not rate > 0:
            sizes, rates = f"{x.values.size} and {y.values.size}", f"{x.sample_rate_hz:g} and {y.sample_rate_hz:g}"
            expected = f"the same of both and of all records ({rate:g} per second)"
            raise refusal(where, f"{sizes} samples at {rates} per second", expected, "export the channels together")
        if not (measurable(x.values).all() and measurable(y.values).all()):
            found = f"NaN, infinity or a number beyond {LARGEST:g} or its inverse"
            raise refusal(where, found, "measured samples", "drop or repair the record")
    return pairs


def sort_by_force(records: Sequence[TimeRecord]) -> list[tuple[list[TimeRecord], list[list[TimeRecord]]]]:
    """Sort time records into tests: the forces on one channel, and for each response the records that go with them.

    Records belong together by `TimeRecord.hit`; without it, all are one recording.

    Returns
    -------
    list of (forces, responses)
        One for each force channel, in the order in which they first occur.

    Raises
    ------
    MeasurementError
        If there is no force, a hit has two forces, or a response is missing in some hits.
    """
    forces: dict[str, dict[int | None, TimeRecord]] = {}
    moved: dict[str, dict[int | None, TimeRecord]] = {}
    driven: dict[int | None, str] = {}
    for record in records:
        if record.quantity == "force" and driven.setdefault(record.hit, record.channel) != record.channel:
            found = f"forces on {driven[record.hit]!r} and {record.channel!r} at once"
            raise refusal("time records", found, "one at a time", "H1 of several forces at once is not offered")
        channel_records = (forces if record.quantity == "force" else moved).setdefault(record.channel, {})
        if record.hit in channel_records:
            again = "" if record.hit is None else f" for hit {record.hit}"
            raise refusal("time records", f"{record.channel!r} twice{again}", "it once", "number the hits")
        channel_records[record.hit] = record
    if not forces:
        raise refusal("time records", "no force", "one channel of it", "name the channels right")
    tests = []
    for channel, by_hit in forces.items():
        responses = [channel_records for channel_records in moved.values() if channel_records.keys() & by_hit.keys()]
        for channel_records in responses:
            if missing := by_hit.keys() - channel_records.keys():
                name = next(iter(channel_records.values())).channel
                found = f"no response of {name!r} to hit {min(str(m) for m in missing)} on {channel!r}"
                raise refusal("time records", found, "one for each hit", "leave that hit out")
        tests.append((list(by_hit.values()), [[of_channel[hit] for hit in by_hit] for of_channel in responses]))
    return tests


def _block_spectra(values: Array, window: Array, hop: int) -> ComplexArray:
    """Spectra of windowed blocks, their mean removed, shape (blocks, lines); none where the record is too short."""
    if values.size < window.size:
        return np.empty((0, window.size // 2 + 1), dtype=complex)
    blocks = np.lib.stride_tricks.sliding_window_view(values, window.size)[::hop]
    return np.fft.rfft(scipy.signal.detrend(blocks, type="constant") * window)
