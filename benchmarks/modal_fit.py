"""Modes of virtual tests found by `fit_modes`, against the truth: `python -m benchmarks.modal_fit `.

Beams, tests and noise come from `benchmarks.virtual_modal_tests`, which shares nothing with the fit. A mode is invented
that no true one is near: within two half-power widths, two lines or four standard deviations. One is missed that stands
20 dB above the noise and is not among the modes; where a doubtful one is named in its place this is counted apart.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from benchmarks.page import table
from benchmarks.study import Row, Study
from benchmarks.virtual_modal_tests import KINDS, VirtualTest, simulate
from vibrecords.modal_fit import ModalFit, fit_modes

#: A mode that stands so far above the noise is to be found, dB.
CLEAR_DB = 20.0


@dataclass(frozen=True)
class Outcome:
    """What was found in one virtual test; errors of frequency and damping over their stated standard deviations."""

    index: int
    kind: str
    sensors: int
    notches: bool
    clear: int
    missed: list[float]
    named: list[float]
    invented: list[float]
    frequency_scores: list[float]
    damping_scores: list[float]


def analyse(index: int) -> Outcome:
    """Make virtual test number so many, and compare what is found with the truth."""
    test = simulate(index)
    return compared(index, test, fit_modes(test.frf))


def compared(index: int, test: VirtualTest, fit: ModalFit) -> Outcome:
    """Match modes found with true ones, the nearest first."""
    truth, width = test.truth.frequency_hz, 2 * test.truth.frequency_hz * test.truth.damping
    lines = test.frf.frequency_hz
    reach = np.maximum(2 * width, 2 * (lines[1] - lines[0]))
    distance = np.array([[abs(mode.frequency_hz - f) for f in truth] for mode in fit.modes]).reshape(-1, truth.size)
    matched: dict[int, int] = {}
    for i, r in zip(*np.unravel_index(np.argsort(distance, axis=None), distance.shape), strict=True):
        near = distance[i, r] < max(reach[r], 4 * fit.modes[i].frequency_sd_hz)
        if near and i not in matched and r not in matched.values():
            matched[int(i)] = int(r)
    clear = np.flatnonzero(test.above_noise_db > CLEAR_DB)
    missed = [r for r in clear if r not in matched.values()]
    named = [r for r in missed if any(abs(d.frequency_hz - truth[r]) < reach[r] for d in fit.doubtful)]
    pairs = [(fit.modes[i], r) for i, r in matched.items()]
    return Outcome(
        index,
        test.kind,
        len(test.frf.outputs),
        test.notches,
        int(clear.size),
        [float(truth[r]) for r in missed if r not in named],
        [float(truth[r]) for r in named],
        [mode.frequency_hz for i, mode in enumerate(fit.modes) if i not in matched],
        [float((mode.frequency_hz - truth[r]) / mode.frequency_sd_hz) for mode, r in pairs],
        [float((mode.damping_ratio - test.truth.damping[r]) / mode.damping_sd) for mode, r in pairs],
    )


def summary(rows: Sequence[Row]) -> Row:
    """Counts by kind of test, and of all."""
    groups = {kind: [row for row in rows if row["kind"] == kind] for kind in KINDS}
    groups |= {"notches in the coherence": [row for row in rows if row["notches"]], "all": list(rows)}
    found = {}
    for name, group in groups.items():
        if group:
            f, z = (np.abs(np.concatenate([row[f"{one}_scores"] for row in group])) for one in ("frequency", "damping"))
            found[name] = {
                "tests": len(group),
                "with an invented mode": sum(bool(row["invented"]) for row in group),
                **{key: sum(len(row[key]) for row in group) for key in ("missed", "named")},
                "clear": sum(row["clear"] for row in group),
                **{f"f within {n} sd": float(np.mean(f < n)) for n in (2, 3)},
                "ζ within 2 sd": float(np.mean(z < 2)),
            }
    return {"groups": found}


def tables(results: Mapping[str, Row]) -> list[str]:
    """Table of what was counted."""
    (groups,) = (data["groups"] for data in results.values())
    head = ("Kind", *groups["all"])
    rows = ((name, *(f"{100 * n:.1f} %" if isinstance(n, float) else str(n) for n in group.values()))
            for name, group in groups.items())  # fmt: skip
    return table(head, rows)


STUDY = Study("modal_fit", "", {"tests": 167}, lambda _, index: asdict(analyse(index - 1)), summary, tables)

if __name__ == "__main__":
    STUDY.main()
