"""How often is an unchanged joint called changed, and a changed one not? `python -m benchmarks.same_joint`.

Pairs of tests as in `benchmarks.two_levels`: four natural frequencies of the exact beam of 360 mm on two springs, which
the model misses by N(0, 0.5 %), alike in both tests, and which scatter by 0.02 %; between the tests both springs stay,
or get 0.5 % or 5 % stiffer. Each test is a case of its own, and `jointbayes same` compares them. Counted is how often
the joint is called changed, and how often the interval of the change of krz holds the truth.

Outcomes are kept in build/same_joint, one line of JSON each, so that a run that was cut off goes on where it was.
Figures go to benchmarks/same_joint.json, the table to docs/continuous-integration.md.
"""

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

import jointbayes as jb
from benchmarks.coverage import write_between
from benchmarks.page import table
from benchmarks.record import environment, kept_outcomes, record_kind
from benchmarks.two_levels import CONFIGS, MODEL_ERROR, MODES, SCATTER, exact_frequencies
from jointbayes.posterior.evidence_table import STRONG
from jointbayes.progress import tell_nobody
from jointbayes.studies.same import JointChange, compare_joints
from jointbayes.workflow import answered_case

ROOT = Path(__file__).resolve().parents[1]
KEPT = ROOT / "build" / "same_joint"
SUMMARY = ROOT / "benchmarks" / "same_joint.json"
PAGE = ROOT / "docs" / "continuous-integration.md"
ENTROPY = 20261128

#: Stiffness in the new test over that before, by what the table calls it.
KINDS = {"no change": 1.0, "0.5 % stiffer": 1.005, "5 % stiffer": 1.05}
CASES = {"no change": 300, "0.5 % stiffer": 100, "5 % stiffer": 100}
_TEXT = """
extends = "clamped_beam_frequencies_360mm.toml"
remove = ["data", "joint", "prior", "uncertain", "compare"]
title = "One clamp, tested twice"
joint = { kind = "springs", dofs = ["1:y", "1:rz"] }
prior.ky = { distribution = "log_uniform", low = 1e6, high = 1e11 }
prior.krz = { distribution = "log_uniform", low = 1e3, high = 1e8 }
data.kind = "natural_frequencies"
"""


def pair_of(factor: float, index: int) -> tuple[jb.Case, jb.Case]:
    """Two tests of one clamp that is so many times as stiff in the second; beam and noise are those of the index."""
    rng = np.random.default_rng([ENTROPY, index])
    ky, krz = np.exp(rng.uniform(np.log(1e7), np.log(2e8))), np.exp(rng.uniform(np.log(2e4), np.log(2e5)))
    missed = np.exp(MODEL_ERROR * rng.standard_normal(MODES))
    cases = []
    for name, times in (("before", 1.0), ("new", factor)):
        found = missed * exact_frequencies(times * ky, times * krz) * np.exp(SCATTER * rng.standard_normal(MODES))
        text = f"{_TEXT}data.frequencies_hz = {found.tolist()}\ndata.sd_relative = {SCATTER}\n"
        cases.append(jb.case_from_text(f"{name} {index}", text, directory=CONFIGS))
    return cases[0], cases[1]


def compared(factor: float, index: int) -> JointChange:
    """What `jointbayes same` says of a pair."""
    before, new = (answered_case(case, 1, tell_nobody) for case in pair_of(factor, index))
    return compare_joints(before, new, 1, tell_nobody)


def outcome(kind: str, index: int) -> dict[str, Any]:
    """What is counted of a pair; JSON-ready."""
    began = time.process_time()
    change = compared(KINDS[kind], index)
    of_krz = next(each for each in change.stiffness if each.name == "krz")
    return {
        "index": index,
        "two_log_b": change.two_log_b,
        "changed": change.changed,
        "krz": [of_krz.low95, of_krz.high95],
        "any_interval": any(each.shown for each in change.stiffness),
        "converged": change.converged,
        "seconds": time.process_time() - began,
    }


def summary(kind: str, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """JSON-ready counts of what is said."""
    ends = [row["krz"] for row in rows]
    return {
        "cases": len(rows),
        "changed": sum(row["changed"] for row in rows),
        "for_a_change": sum(row["two_log_b"] > 0 for row in rows),
        "any_interval": sum(row["any_interval"] for row in rows),
        "held": sum(low <= KINDS[kind] - 1 <= high for low, high in ends),
        "width_percent": float(np.median([100 * (high - low) / 2 for low, high in ends])),
        "not_converged": sum(not row["converged"] for row in rows),
        "median_seconds": float(np.median([row["seconds"] for row in rows])),
        "environment": environment(),
    }


def section(results: Mapping[str, Mapping[str, Any]]) -> str:
    """A table of what was counted, and where it was computed."""
    head = ("truth", "pairs", "called changed", "share (95 % confidence)", "odds for a change",
            "interval of krz holds the truth", "half its width, median")  # fmt: skip
    rows = []
    for kind, data in results.items():
        low, high = stats.binomtest(data["changed"], data["cases"]).proportion_ci(0.95, method="exact")
        share = f"{100 * data['changed'] / data['cases']:.0f} % ({100 * low:.1f} to {100 * high:.1f})"
        counts = [str(data[key]) for key in ("for_a_change", "held")]
        rows.append((kind, str(data["cases"]), str(data["changed"]), share, *counts, f"{data['width_percent']:.2f} %"))
    seconds = max(data["median_seconds"] for data in results.values())
    left = sum(data["not_converged"] for data in results.values())
    where = next(iter(results.values()))["environment"]
    note = f"Changed: 2 ln B above {STRONG:g}. {seconds:.1f} s of CPU a pair; {left or 'none'} not converged."
    place = f"{where['date']}, {where['cpu']}, Python {where['python']}, one core."
    return "\n".join([*table(head, rows), "", note, place, ""])


def main() -> None:
    """Run and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, help="pairs of each truth; default: the whole study")
    parser.add_argument("--pilot", action="store_true", help="print only: leave page and record as they are")
    options = parser.parse_args()
    for place, kind in enumerate(KINDS):
        head = json.dumps({"entropy": ENTROPY, "case": pair_of(1.0, 1)[0].text})
        rows = kept_outcomes(KEPT / f"{place}.jsonl", head, options.count or CASES[kind], partial(outcome, kind), kind)
        data = summary(kind, rows)
        print(section({kind: data}), flush=True)
        if not options.pilot:
            write_between(PAGE, "same_joint.py", section(record_kind(SUMMARY, KINDS, kind, data)))


if __name__ == "__main__":
    main()
