"""Warnings about measured records: what in a file contradicts itself or physics, in words."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from jointbayes.frf import quantity_factor
from jointbayes.measurement.provenance import MeasurementWarning
from jointbayes.measurement.records import FrfRecord, Record, TimeRecord
from jointbayes.measurement.warnings.of_frfs import pair_of, resonances_of, usable, warnings_of_frf
from jointbayes.measurement.warnings.of_pairs import Sketch, disagreement, sketch_of
from jointbayes.measurement.warnings.of_records import warnings_of_history

__all__ = ["WarningCollector", "find_warnings"]

#: Places named in one warning; the rest are counted.
_NAMED = 3
#: A mass line may be wrong by this factor for calibration and for modes near by.
_TOO_HEAVY = 1.3


def find_warnings(records: Record | Iterable[Record], mass_kg: float | None = None) -> tuple[MeasurementWarning, ...]:
    """Look for contradictions in records of one file.

    What cannot be told is not claimed: one FRF alone does not show g against m/s², or receptance against accelerance
    with the opposite sign. See the documentation for what each warning rests on.

    Parameters
    ----------
    records
        A record or records, as readers give them.
    mass_kg
        Mass of the structure if it hangs free: drive points are then held against its mass line, kg.

    Returns
    -------
    tuple of MeasurementWarning
        In the order of the file; the same about several records is one warning.
    """
    collector = WarningCollector(mass_kg)
    for record in [records] if isinstance(records, FrfRecord | TimeRecord) else records:
        collector.add(record)
    return collector.warnings()


class WarningCollector:
    """Warnings about records that come one by one; of each only a sketch is kept.

    Parameters
    ----------
    mass_kg
        As in `find_warnings`.
    """

    def __init__(self, mass_kg: float | None = None) -> None:
        self._mass_kg = mass_kg
        self._raw: dict[tuple[str, str], list[MeasurementWarning]] = {}
        self._counts: dict[tuple[str, str], int] = {}
        self._sketches: dict[tuple[str, str], list[Sketch]] = {}
        self._highest_hz = 0.0
        self._highest_where = ""
        self._nyquist_hz = np.inf

    def add(self, record: Record) -> None:
        """Look at one record."""
        if isinstance(record, TimeRecord):
            where = _named(record.channel, record.where)
            self._nyquist_hz = min(self._nyquist_hz, record.sample_rate_hz / 2)
            for warning in warnings_of_history(record):
                self._keep(where, warning)
            return
        where = _named(f"{record.response}/{record.reference}", record.where)
        for warning in warnings_of_frf(record):
            self._keep(where, warning)
        if self._mass_kg is not None:
            for warning in _mass_line(record, self._mass_kg):
                self._keep(where, warning)
        highest = float(np.max(record.frequency_hz, initial=0.0))
        if highest > self._highest_hz:
            self._highest_hz, self._highest_where = highest, where
        sketch = sketch_of(record)
        if sketch is not None:
            self._compare(pair_of(record)[:2], sketch)

    def warnings(self) -> tuple[MeasurementWarning, ...]:
        """All warnings so far, equal ones put together."""
        if self._highest_hz > 1.01 * self._nyquist_hz:
            self._keep(
                self._highest_where,
                MeasurementWarning(
                    "rad_per_s",
                    f"the lines reach {self._highest_hz:.6g} Hz, but the time histories of the file can show "
                    f"{self._nyquist_hz:.6g} Hz at most: the axis is probably in rad/s",
                    "divide the frequencies by 2π, or say rad/s in the header of the column",
                ),
            )
        merged = []
        for group, alike in self._raw.items():
            count = self._counts[group]
            more = f" and {count - len(alike)} more" if count > len(alike) else ""
            where = ", ".join(warning.where for warning in alike) + more
            differ = len({warning.sentence for warning in alike}) > 1
            sentence = alike[0].sentence + (" (here the first of them)" if differ else "")
            merged.append(replace(alike[0], where=where, sentence=sentence))
        return tuple(merged)

    def _keep(self, where: str, warning: MeasurementWarning) -> None:
        group = (warning.key, warning.remedy)
        self._counts[group] = self._counts.get(group, 0) + 1
        known = self._raw.setdefault(group, [])
        if len(known) < _NAMED:
            known.append(replace(warning, where=where))

    def _compare(self, pair: tuple[str, str], sketch: Sketch) -> None:
        swapped = (pair[1], pair[0])
        before = self._sketches.get(pair, [])
        across = self._sketches.get(swapped, []) if swapped != pair else []
        for others, reciprocal in ((before, False), (across, True)):
            for other in others:
                warning = disagreement(other, sketch)
                if warning is not None:
                    where = f"{_named(other.record, other.where)} and {sketch.where}"
                    self._keep(where, _of_pair(warning, reciprocal))
        # two of a kind are enough to compare with
        if len(before) < 2:
            self._sketches.setdefault(pair, []).append(sketch)


def _of_pair(warning: MeasurementWarning, reciprocal: bool) -> MeasurementWarning:
    # the ratio of two quantities of one sensor, g and rad/s have warnings of their own
    keys = {"g": "g_against_ms2", "rad_per_s": "rad_per_s", "quantity": "quantity_phase"}
    key = keys.get(warning.key, "reciprocity" if reciprocal else "repeats_differ")
    what = "with response and force exchanged the FRFs should be equal" if reciprocal else "the same FRF is there twice"
    return replace(warning, key=key, sentence=f"{what}, but {warning.sentence}")


def _mass_line(record: FrfRecord, mass_kg: float) -> Iterable[MeasurementWarning]:
    """A free structure's drive point has at low frequency an accelerance of 1/m at least, more off its centre."""
    response, reference, sign = pair_of(record)
    good = usable(record)
    if response != reference or good.quantity is None or good.frequency_hz.size < 16:
        return
    f = good.frequency_hz
    accelerance = sign * good.values * quantity_factor(f, "accelerance", good.quantity)
    peaks = resonances_of(f, accelerance / (2j * np.pi * f))
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
        in_g = abs(np.log(heavy / 9.80665)) < 1.5
        yield MeasurementWarning(
            "g_against_ms2" if in_g else "mass_line",
            f"below its first resonance the drive point moves like {1 / level:.4g} kg, {heavy:.3g} times the "
            f"structure's {mass_kg:g} kg; a free structure cannot appear heavier than it is"
            + (": the response is probably in g" if in_g else ""),
            "find out the unit of the accelerometer" + (" and give the channel the gain 9.80665" if in_g else ""),
        )


def _named(channel: str, where: str) -> str:
    return f"{where} ({channel})" if where else channel
