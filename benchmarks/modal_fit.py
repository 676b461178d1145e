"""Modes of virtual tests found by `fit_modes`, against the truth: `python -m benchmarks.modal_fit [--tests 200]`.

Beams, tests and noise come from `benchmarks.virtual_modal_tests`, which shares nothing with the fit. A mode is invented
that no true one is near: within two half-power widths, two lines or four standard deviations. One is missed that stands
20 dB above the noise and is not among the modes; where a doubtful one is named in its place this is counted apart.

Outcomes are kept in build/modal_fit.jsonl as they come, so that a study that was cut off goes on where it was.
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from benchmarks.record import environment, kept_lines
from benchmarks.virtual_modal_tests import KINDS, VirtualTest, simulate
from vibrecords.modal_fit import ModalFit, fit_modes

KEPT = Path(__file__).resolve().parents[1] / "build" / "modal_fit.jsonl"
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
    seconds: float


def analyse(index: int) -> Outcome:
    """Make virtual test number so many, and compare what is found with the truth."""
    test = simulate(index)
    began = time.process_time()
    fit = fit_modes(test.frf)
    return compared(index, test, fit, time.process_time() - began)


def compared(index: int, test: VirtualTest, fit: ModalFit, seconds: float) -> Outcome:
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
        seconds,
    )


def table(outcomes: Sequence[Outcome]) -> str:
    """Markdown table by kind of test, and of all."""
    head = ("Kind", "Tests", "With an invented mode", "Clear modes", "Missed", "Doubtful instead")
    head += ("f within 2 sd", "f within 3 sd", "ζ within 2 sd", "CPU s, median")
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    groups = {kind: [o for o in outcomes if o.kind == kind] for kind in KINDS}
    groups["notches in the coherence"] = [o for o in outcomes if o.notches]
    groups["all"] = list(outcomes)
    for name, group in groups.items():
        if group:
            f = np.abs(np.concatenate([o.frequency_scores for o in group]))
            z = np.abs(np.concatenate([o.damping_scores for o in group]))
            lines.append(
                f"| {name} | {len(group)} | {sum(bool(o.invented) for o in group)} | {sum(o.clear for o in group)} | "
                f"{sum(len(o.missed) for o in group)} | {sum(len(o.named) for o in group)} | "
                f"{100 * np.mean(f < 2):.1f} % | {100 * np.mean(f < 3):.1f} % | {100 * np.mean(z < 2):.0f} % | "
                f"{np.median([o.seconds for o in group]):.1f} |"
            )
    return "\n".join(lines)


def main() -> None:
    """Run what is not yet kept, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tests", type=int, default=200)
    options = parser.parse_args()
    outcomes = [Outcome(**line) for line in kept_lines(KEPT, "modal fit, 2")]
    done = {outcome.index for outcome in outcomes}
    for index in range(options.tests):
        if index not in done:
            outcome = analyse(index)
            with KEPT.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(outcome)) + "\n")
            outcomes.append(outcome)
    where = environment()
    print(f"{where['date']}, {where['cpu']}, Python {where['python']}\n")
    print(table([outcome for outcome in outcomes if outcome.index < options.tests]))


if __name__ == "__main__":
    main()
