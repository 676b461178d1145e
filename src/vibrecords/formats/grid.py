"""FRFs of files put together: one set on one grid, or an error that says what is in the way."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from vibrecords.arrays import Array, Flags
from vibrecords.errors import MeasurementError, refusal
from vibrecords.frf_set import FrfSet, require_lines
from vibrecords.records import HIGHEST_HZ, LARGEST, FrfRecord, measurable

#: A coherence stored in single precision may pass 1 by this much.
_ROUNDING = 1e-6
#: Frequencies of lines left out that are named.
_NAMED = 8


def join_frfs(records: Iterable[FrfRecord], where: str) -> FrfSet:
    """FRFs as one set: the same lines for all, every output with every input.

    Parameters
    ----------
    records
        One for each pair of output and input.
    where
        Name of the file, for messages.

    Returns
    -------
    FrfSet
        Outputs and inputs in the order of their first record. Coherence only where each FRF has one; the smallest
        number of averages, None where an FRF does not tell it.

    Raises
    ------
    MeasurementError
        If there is no FRF, a pair is missing or occurs twice, lines or quantities differ, or a line is at 0 Hz, out of
        order, NaN or exactly zero.
    """
    # 1. each FRF by itself, and as the first
    frfs: dict[tuple[str, str], FrfRecord] = {}
    for record in records:
        checked, place = _check(record, f"{where}: {record.where}"), f"{where}: {record.where}"
        pair, first = (checked.response, checked.reference), next(iter(frfs.values()), checked)
        if pair in frfs:
            found = f"the FRF of {pair[0]!r} over {pair[1]!r} again, first in {frfs[pair].where}"
            raise refusal(place, found, "each pair once", "split repeated measurements into files")
        frfs[pair] = checked
        if checked.quantity is None:
            expected = "receptance, mobility or accelerance from unit or axis type"
            raise refusal(place, "no word on what the FRF is", expected, "state the quantity")
        if checked.quantity != first.quantity:
            found, expected = f"{checked.quantity} beside {first.quantity} in {first.where}", "one quantity throughout"
            raise refusal(place, found, expected, "split the file or state the quantity")
        if not np.isclose(checked.window_rate, first.window_rate, equal_nan=True):
            found = f"another exponential window than in {first.where}"
            raise refusal(place, found, "one window throughout", "split the file")
        if not np.array_equal(checked.frequency_hz, first.frequency_hz):
            own, others = (f"{r.frequency_hz.size} lines, {_span(r.frequency_hz)}," for r in (checked, first))
            found = f"{own} other than the {others} of {first.where}"
            raise refusal(place, found, "the same lines for all FRFs", "split the file")
    if not frfs:
        raise refusal(where, "no FRF", "at least one", "time histories must be turned into FRFs")
    # 2. all pairs of outputs and inputs
    first = next(iter(frfs.values()))
    outputs, inputs = (tuple(dict.fromkeys(pair[side] for pair in frfs)) for side in (0, 1))
    rows, columns = ({label: i for i, label in enumerate(labels)} for labels in (outputs, inputs))
    for output, input_ in product(outputs, inputs):
        if (output, input_) not in frfs:
            raise refusal(where, f"no FRF of {output!r} over {input_!r}", "every output with every input", "add it")
    # 3. one array; each record is dropped once it is in place, so that no file is in memory three times
    shape = (first.frequency_hz.size, len(outputs), len(inputs))
    complete = all(record.coherence is not None for record in frfs.values())
    told = [record.averages for record in frfs.values() if record.averages is not None]
    averages = min(told) if len(told) == len(frfs) else None
    values, coherence = np.empty(shape, complex), np.empty(shape) if complete else None
    while frfs:
        (output, input_), record = frfs.popitem()
        cell = (slice(None), rows[output], columns[input_])
        values[cell] = record.values
        if coherence is not None:
            coherence[cell] = record.coherence
    assert first.quantity is not None
    about = (first.quantity, coherence, averages, np.nan_to_num(first.window_rate))
    return FrfSet(first.frequency_hz, values, outputs, inputs, *about)


def cut_to_band(record: FrfRecord, where: str, f_min_hz: float | None, f_max_hz: float | None) -> FrfRecord:
    """The lines of an FRF from `f_min_hz` to `f_max_hz`, either of which may be open.

    Raises
    ------
    MeasurementError
        If no line lies in the band.
    """
    if f_min_hz is None and f_max_hz is None:
        return record
    lines = record.frequency_hz
    low, high = (end if given is None else given for given, end in ((f_min_hz, -np.inf), (f_max_hz, np.inf)))
    inside = (lines >= low) & (lines <= high)
    if not inside.any():
        span = f"above {low:g}" if f_max_hz is None else f"{f'from {low:g} to' if f_min_hz else 'below'} {high:g}"
        found, key = f"found no line {span} Hz", "f_max_hz" if high < lines.min() else "f_min_hz"
        words = f"{found}; expected some, the file has {_span(lines)}; widen the band"
        raise MeasurementError(f"{where}: {record.where}: {words}", key)
    return record.at_lines(inside)


def measured_lines(
    records: Sequence[FrfRecord],
    where: str,
    exclude_hz: Sequence[tuple[float, float]] = (),
    *,
    needs_coherence: bool = False,
) -> tuple[list[FrfRecord], list[str]]:
    """FRFs without excluded lines, and without lines on which one of them holds no measured number.

    What no number is: NaN, infinity, an exact zero and, where coherence counts, one that is not above 0 and at most 1.
    Where it does not count, an FRF with such a coherence has none. Where more than half of the lines are bad all stay,
    so that the file is refused.

    Parameters
    ----------
    records
        FRFs, at least one.
    where
        Name of the file, for messages.
    exclude_hz
        Bands, each the lowest and the highest frequency, both with it.
    needs_coherence
        Whether the variance comes from the coherence.

    Returns
    -------
    records, notes
        The FRFs, and in words what was left out.

    Raises
    ------
    MeasurementError
        If no line is left of an FRF.
    """
    kept, notes = list(records), []
    if exclude_hz:
        kept = [record.at_lines(~excluded_lines(record.frequency_hz, exclude_hz)) for record in records]
        if any(record.frequency_hz.size == 0 for record in kept):
            bands = ", ".join(f"{low:g} to {high:g} Hz" for low, high in exclude_hz)
            raise refusal(where, f"no line outside {bands}", "some", "narrow exclude_hz")
        count = records[0].frequency_hz.size - kept[0].frequency_hz.size
        notes.append(f"Of {records[0].frequency_hz.size} lines {count} were left out, as exclude_hz asks.")
    lines = kept[0].frequency_hz
    if not all(np.array_equal(record.frequency_hz, lines) for record in kept):
        return kept, notes
    bad = np.zeros(lines.size, dtype=bool)
    for i, record in enumerate(kept):
        with np.errstate(invalid="ignore"):  # of NaN that signal
            bad |= ~measurable(record.values) | (record.values == 0)
        if record.coherence is None or record.coherence.shape != lines.shape:
            continue
        wrong = ~((record.coherence >= 0) & (record.coherence <= 1 + _ROUNDING))
        if needs_coherence:
            bad |= wrong | (record.coherence == 0)
        elif wrong.any():
            kept[i] = replace(record, coherence=None)
    if not bad.any() or 2 * bad.sum() > bad.size:
        return kept, notes
    named = ", ".join(f"{f:g}" for f in lines[bad][:_NAMED])
    more = f" and {bad.sum() - _NAMED} more" if bad.sum() > _NAMED else ""
    coherence = ", or whose coherence is not above 0 and at most 1," if needs_coherence else ""
    notes.append(
        f"Of {lines.size} lines {bad.sum()} were left out, on which an FRF is no number or exactly 0{coherence} "
        f"at {named} Hz{more}."
    )
    return [record.at_lines(~bad) for record in kept], notes


def excluded_lines(lines: Array, bands: Sequence[tuple[float, float]]) -> Flags:
    """Which lines lie in one of the bands, ends included."""
    inside = np.zeros(lines.shape, dtype=bool)
    for low, high in bands:
        inside |= (lines >= low) & (lines <= high)
    return inside


def _span(lines: Array) -> str:
    finite = lines[np.isfinite(lines)]
    return f"{finite.min():g} to {finite.max():g} Hz" if finite.size else "none"


def _check(record: FrfRecord, place: str) -> FrfRecord:
    """The record, its coherence no larger than 1, if its lines, values and coherence are those of a measurement."""
    lines, values, coherence = record.frequency_hz, record.values, record.coherence
    require_lines(lines, place)
    if lines[-1] > HIGHEST_HZ or lines[0] < 1 / HIGHEST_HZ:
        expected = f"them within {1 / HIGHEST_HZ:g} to {HIGHEST_HZ:g} Hz"
        raise refusal(place, f"lines from {lines[0]:g} to {lines[-1]:g} Hz", expected, "look at the unit of the axis")
    with np.errstate(invalid="ignore"):  # of NaN that signal
        zero = values == 0
    absurd = (~measurable(values), f"a number beyond {LARGEST:g} or its inverse")
    for missing, name in ((~np.isfinite(values), "NaN or infinity"), (zero, "exactly 0"), absurd):
        if missing.any():
            found = f"{name} at {lines[np.argmax(missing)]:g} Hz, {int(missing.sum())} such lines"
            expected = "a measured number on at least half of the lines"
            raise refusal(place, found, expected, "leave out a channel or a band (exclude_hz), or export again")
    if coherence is None:
        return record
    if coherence.shape != lines.shape:
        raise refusal(place, f"coherence on {coherence.size} lines", lines.size, "drop it")
    bad = ~((coherence >= 0) & (coherence <= 1 + _ROUNDING))
    if bad.any():
        line = int(np.argmax(bad))
        raise refusal(place, f"coherence {coherence[line]:g} at {lines[line]:g} Hz", "0 to 1", "leave it out")
    return replace(record, coherence=np.minimum(coherence, 1.0))
