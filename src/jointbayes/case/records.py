"""From the time histories of a measurement file to its FRFs, as a case asks for it."""

from collections.abc import Iterable
from dataclasses import dataclass

import scipy  # its parts load at first use

from jointbayes.case.schema.measured import MeasuredSpec, RecordsSpec
from jointbayes.errors import MeasurementError
from jointbayes.measurement.records import FrfRecord, TimeRecord
from jointbayes.measurement.signals.hits import HitSettings
from jointbayes.measurement.signals.impact import ImpactSettings, corrected_frfs, impact_frfs
from jointbayes.measurement.signals.line_thinning import independent_step, line_correlation
from jointbayes.measurement.signals.spectra import ShakerSettings, by_force, shaker_frf
from jointbayes.measurement.signals.windows import exponential_window

_SAMPLES = 1024  # of a window on paper: the correlation of lines does not depend on their number

__all__ = ["FrfsOfRecords", "frfs_of_records"]


@dataclass(frozen=True)
class FrfsOfRecords:
    """FRFs that were made of time histories.

    Parameters
    ----------
    frfs
        One for each response and force.
    step
        Every how many lines are independent, with the windows that were used.
    notes
        What was done, and which hits were left out.
    """

    frfs: tuple[FrfRecord, ...]
    step: int = 1
    notes: tuple[str, ...] = ()


def frfs_of_records(records: Iterable[TimeRecord], data: MeasuredSpec, where: str) -> FrfsOfRecords:
    """FRFs of the records of a hammer or a shaker.

    Parameters
    ----------
    records
        Time histories of the channels that the case maps.
    data
        `[data]` with its table `[data.records]`.
    where
        The files, for messages.

    Raises
    ------
    MeasurementError
        If the records do not make FRFs.
    """
    settings = data.records
    assert settings is not None
    try:
        tests = by_force(list(records))
        return _impact(tests, data, settings) if settings.method == "impact" else _shaker(tests, data, settings)
    except MeasurementError as error:
        raise MeasurementError(f"{where}: {error}") from error


_Tests = list[tuple[list[TimeRecord], list[list[TimeRecord]]]]


def _impact(tests: _Tests, data: MeasuredSpec, spec: RecordsSpec) -> FrfsOfRecords:
    settings = ImpactSettings(
        HitSettings(spec.block_s, spec.pretrigger_s, force_range_n=spec.force_range_n),
        spec.force_window_s,
        spec.exponential_end,
        spec.estimator,
        data.f_min_hz,
        data.f_max_hz,
    )
    frfs: list[FrfRecord] = []
    notes: list[str] = []
    for forces, responses in tests:
        found = impact_frfs(forces, responses, settings)
        frfs += corrected_frfs(found)
        lost = [f"hit {hit.number} ({hit.reason})" for hit in found[0].hits if not hit.kept]
        if lost:
            notes.append(f"Left out of the hits on {forces[0].channel}: {', '.join(lost)}.")
    step = independent_step(line_correlation(exponential_window(_SAMPLES, spec.exponential_end), random=False))
    return FrfsOfRecords(tuple(frfs), step, tuple(notes))


def _shaker(tests: _Tests, data: MeasuredSpec, spec: RecordsSpec) -> FrfsOfRecords:
    assert spec.block_s is not None
    settings = ShakerSettings(spec.block_s, spec.overlap, spec.window, spec.estimator, data.f_min_hz, data.f_max_hz)
    found = [shaker_frf(forces, one, settings) for forces, responses in tests for one in responses]
    window = scipy.signal.get_window(spec.window, _SAMPLES)
    hop = max(round(_SAMPLES * (1 - spec.overlap)), 1)
    blocks = min((result.blocks for result in found), default=1)
    correlation = line_correlation(window, random=True, blocks=blocks, hop=hop)
    return FrfsOfRecords(tuple(result.frf for result in found), step=independent_step(correlation))
