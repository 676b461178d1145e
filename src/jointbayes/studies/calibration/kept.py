"""Data sets that are done, one line of a file each: what was begun goes on where it was cut off."""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from jointbayes.case.case import Case
from jointbayes.inference import Problem
from jointbayes.own_directory import OwnDirectory
from jointbayes.posterior.fingerprint import run_fingerprint
from jointbayes.sampling import SamplerSettings
from jointbayes.studies.calibration.data_set import DRAWS, DataSet
from jointbayes.studies.study_directory import append_line, kept_lines

#: Name of the file.
KEPT = "data_sets.jsonl"


def calibration_directory(directory: str | os.PathLike[str]) -> OwnDirectory:
    """The directory of a calibration, new or of an earlier start; entered, it keeps other processes out."""
    return OwnDirectory(directory, "a calibration")


class KeptDataSets:
    """The file of data sets that are done.

    Its first line says what they depend on. Each further line is one data set, on the disk before the next is begun to
    be written; a line that was cut off is passed over, and its data set is done again.

    Parameters
    ----------
    directory
        In which it is, or is to be.
    head
        What all data sets have in common, as `fingerprint` has it.
    quantities
        How many quantities are ranked.

    Raises
    ------
    CaseError
        If the file holds data sets that have something else in common: what differs.
    """

    def __init__(self, directory: Path, head: Mapping[str, str], quantities: int) -> None:
        self._file, self.done = directory / KEPT, dict[int, DataSet]()
        for line in kept_lines(self._file, head, "data sets", "calibration"):
            one = _data_set(line, quantities)
            if one is not None:
                self.done[one.index] = one

    def add(self, one: DataSet) -> None:
        """Keep one more."""
        append_line(self._file, asdict(one))
        self.done[one.index] = one


def fingerprint(
    analysis: Case | Problem, source: Case | Problem, settings: SamplerSettings, seed: int
) -> dict[str, str]:
    """What data sets depend on, part by part, in words of a message; `source` gives truths and data."""
    parts = {**_parts(analysis, settings, seed), "number of ranked draws": str(DRAWS)}
    if source is analysis:
        return parts
    whole = json.dumps(_parts(source, settings, seed), sort_keys=True)
    return {**parts, "source of data": hashlib.sha256(whole.encode()).hexdigest()[:16]}


def _parts(case: Case | Problem, settings: SamplerSettings, seed: int) -> dict[str, str]:
    if isinstance(case, Problem):
        return run_fingerprint(case, None, seed, settings)
    return run_fingerprint(case.problem, case, seed, settings)


def _data_set(found: Any, quantities: int) -> DataSet | None:  # noqa: ANN401 (any JSON)
    """The data set of a line; None where it is none."""
    try:
        one = DataSet(
            int(found["index"]),
            float(found["seconds"]),
            tuple(map(float, found["truth"])),
            tuple(map(int, found["rank"])),
            tuple(map(float, found["low"])),
            tuple(map(float, found["high"])),
            bool(found["converged"]),
            bool(found["mode_agrees"]),
            float(found["ess"]),
            str(found["error"]),
        )
    except (KeyError, TypeError, ValueError):
        return None
    if one.error:
        return one
    each = (one.truth, one.rank, one.low, one.high)
    return one if all(len(values) == quantities for values in each) else None
