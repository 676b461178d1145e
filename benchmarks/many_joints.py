"""Many joints: how often their mode is found, how fast they are drawn, and whether they are calibrated.

`chain`: processor time to the mode of chains of 12, 24 and 40 joints, from one FRF of 119 lines; kept nowhere.
`modes`: four joints with twelve springs, the truth drawn from the prior; the mode counts as found where the search
ends no more than one in log posterior below a climb from the truth. `draws`: a whole run of four joints that goes on
until it has 20 000 effective draws of every stiffness. `six`: a whole run, by the usual stop rule, of six joints with
18 springs and their loss factors. `calibrate`: data sets of the four joints at fewer lines. What was measured is
kept in benchmarks/many_joints.json and written into docs/examples/portal-frame.md.
"""

import argparse
import json
import statistics
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from benchmarks.coverage import write_between
from benchmarks.many_joints_data import chain_case, chain_truth, four_joints, random_data, six_joints
from benchmarks.record import merged
from jointbayes.identification import refine

Array = NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[1]
RECORD = ROOT / "benchmarks" / "many_joints.json"
PAGE = ROOT / "docs" / "examples" / "portal-frame.md"
SEED = 20261122
#: Log posterior that the search may end below a climb from the truth.
TOLERANCE = 1.0
#: Autocorrelation times after which the run of four joints ends: the usual 50 leave 13 000 effective draws.
LONGER = 100.0


def search(seed: int) -> dict[str, float]:
    """One search: how far it ended above a climb from the truth in log posterior, and seconds of the processor."""
    return searched(seed, *random_data(four_joints().problem, seed))


def chains(seed: int = 1) -> None:
    """Seconds of the processor to the mode of chains, and how far it ended above a climb from the truth."""
    for count in (12, 24, 40):
        row = searched(seed, np.log(chain_truth(count)), chain_case(count).problem)
        print(f"{count} joints: {row['seconds']:.2f} s, {row['above']:+.3f} in log posterior", flush=True)


def searched(seed: int, theta: Array, problem: jb.Problem) -> dict[str, float]:
    """One search of a problem whose data were made at θ, shape (12,)."""
    began = time.process_time()
    estimate = jb.find_map(problem, seed=seed)
    seconds = time.process_time() - began
    _, from_truth = refine(problem.log_posterior, theta)
    starts = [s for s in estimate.starts if "reconstructed" in s.name]
    return {
        "seed": seed,
        "above": estimate.log_posterior - from_truth,
        "seconds": seconds,
        "rounds": estimate.effort.rounds,
        "reconstructed": len(starts),
        "reached": sum(s.reached_mode for s in starts),
    }


def modes(count: int) -> dict[str, Any]:
    """Searches for random truths, row by row as they come."""
    rows = []
    for seed in range(count):
        rows.append(search(seed))
        print(json.dumps(rows[-1]), flush=True)
    found = sum(row["above"] > -TOLERANCE for row in rows)
    median = statistics.median(row["seconds"] for row in rows)
    print(f"{found} of {count} modes found, {median:.1f} s of the processor in the median")
    return {"count": count, "found": found, "median_seconds": median, "rows": rows}


def draws(case: jb.Case, tau_factor: float | None = None) -> dict[str, Any]:
    """A whole run: seconds, of the processor too, and effective draws of the quantity that has the fewest."""
    settings = replace(case.sampler, tau_factor=tau_factor or case.sampler.tau_factor, budget_s=3600.0)
    wall, own = time.perf_counter(), time.process_time()
    posterior = jb.sample(case, seed=1, settings=settings, progress=lambda now: print(now, flush=True))
    sampler = posterior.record.sampler
    found = {
        "seconds": time.perf_counter() - wall,
        "processor_seconds": time.process_time() - own,
        "converged": posterior.converged,
        "reason": posterior.reason,
        "ess": min(sampler["ess"].values()),
        "unknowns": len(posterior.problem.names),
        "evaluations": sampler["evaluations"],
        "efficiency": sampler["proposal_efficiency"],
    }
    print(json.dumps(found, indent=1))
    return found


def section(found: Mapping[str, Any]) -> str:
    """What has been measured, for the page."""
    lines: list[str] = []
    for part, what in (
        ("draws", "four joints, twelve stiffnesses"),
        ("six", "six joints, 18 springs and 18 loss factors"),
    ):
        if part in found:
            row = found[part]
            lines += [
                f"- **A whole run, {what}**: {'converged' if row['converged'] else 'not converged'} with "
                f"{row['ess']:.0f} effective draws of the quantity that has the fewest, in {row['seconds']:.0f} s "
                f"({row['processor_seconds']:.0f} s of one processor core), mode search included."
            ]
    if "modes" in found:
        row = found["modes"]
        lines.insert(
            0,
            f"- **The mode, of random truths**: found in {row['found']} of {row['count']}, in "
            f"{row['median_seconds']:.1f} s of one processor core in the median.",
        )
    return "\n".join([*lines, ""])


def main() -> None:
    """Run one part and keep what it found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=("chain", "modes", "draws", "six"))
    parser.add_argument("--count", type=int, help="searches, by default 40")
    options = parser.parse_args()
    if options.part == "chain":
        chains()
        return
    parts = {
        "modes": lambda: modes(options.count or 40),
        "draws": lambda: draws(four_joints(), LONGER),
        "six": lambda: draws(six_joints()),
    }
    found = merged(RECORD, options.part, parts[options.part](), False)
    RECORD.write_text(json.dumps(found, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    write_between(PAGE, "many_joints.py", section(found))


if __name__ == "__main__":
    main()
