"""Is a change between two levels found, by a model that is wrong alike in both? `python -m benchmarks.two_levels`.

The data are four natural frequencies of `benchmarks.exact_beam`, which has no mesh and shares no code with the package:
the beam of 360 mm on a spring with ky of 1e7 to 2e8 N/m and one with krz of 2e4 to 2e5 N m/rad, at two torques. The
model misses each frequency by N(0, 0.5 %), alike at both; a test scatters by 0.02 %. In one half of the cases both
springs are 5 % stiffer at the higher torque, in the other nothing changes. Each case is analysed as a user would, by
`jb.sample` as in a campaign, with each level's springs its own and `[uncertain.model_error]` by default. Counted
is how often `Posterior.curve` shows a change of krz, or of any spring, and how often its interval holds the truth.

Part of `make science`. Outcomes are kept in build/two_levels as they come, one line of JSON each, so that a run that
was cut off goes on where it was. Figures go to benchmarks/two_levels.json, the table to docs/several-tests.md.
"""

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

import jointbayes as jb
from benchmarks.coverage import write_between
from benchmarks.exact_beam import ExactBeam, circle
from benchmarks.page import table
from benchmarks.record import environment, kept_outcomes, record_kind

Array = NDArray[np.float64]
ROOT = Path(__file__).resolve().parents[1]
CONFIGS = ROOT / "configs"
KEPT = ROOT / "build" / "two_levels"
SUMMARY = ROOT / "benchmarks" / "two_levels.json"
PAGE = ROOT / "docs" / "several-tests.md"
ENTROPY = 20261125

#: Stiffness at the second level over that at the first, by what the table calls it.
KINDS = {"5 % stiffer": 1.05, "no change": 1.0}
CASES = 100
MODEL_ERROR, SCATTER, MODES = 0.005, 0.0002, 4
_HIGHEST_HZ = 20_000.0
_TEXT = """
extends = "clamped_beam_frequencies_360mm.toml"
remove = ["data", "joint", "prior"]
title = "One clamp at two torques"
level = { name = "torque", unit = "N m" }
joint = { kind = "springs", dofs = ["1:y", "1:rz"], own = true }
prior.ky = { distribution = "log_uniform", low = 1e6, high = 1e11 }
prior.krz = { distribution = "log_uniform", low = 1e3, high = 1e8 }
uncertain.model_error = {}
uncertain.exact = ["youngs_modulus", "density", "length"]
tests.low.level = 10.0
tests.high.level = 20.0
"""


def exact_frequencies(ky: float, krz: float) -> Array:
    """Lowest natural frequencies of the beam on these springs, Hz."""
    beam = ExactBeam(0.36, circle(0.025, 0.3), 2.1e11, 0.3, 7800.0, {1: 0.0, 11: 0.36}, (ky, 0.0, krz))
    return beam.modes(_HIGHEST_HZ).omega[:MODES] / (2 * np.pi)


def case_of(kind: str, index: int) -> jb.Case:
    """Two tests of one beam by a model that is wrong alike in both; the same beam and noise for every kind."""
    rng = np.random.default_rng([ENTROPY, index])
    ky, krz = np.exp(rng.uniform(np.log(1e7), np.log(2e8))), np.exp(rng.uniform(np.log(2e4), np.log(2e5)))
    missed = np.exp(MODEL_ERROR * rng.standard_normal(MODES))
    text = _TEXT
    for test, factor in (("low", 1.0), ("high", KINDS[kind])):
        scattered = exact_frequencies(factor * ky, factor * krz) * np.exp(SCATTER * rng.standard_normal(MODES))
        frequencies = (missed * scattered).tolist()
        where = "data" if test == "low" else "tests.high.data"
        text += f"{where}.frequencies_hz = {frequencies}\n"
    text += f'data.kind = "natural_frequencies"\ndata.sd_relative = {SCATTER}\n'
    return jb.case_from_text(f"{kind} {index}", text, directory=CONFIGS)


def analysed(kind: str, index: int) -> dict[str, Any]:
    """What a run says of the change of each spring, and whether it shows one; JSON-ready."""
    began = time.process_time()
    case = case_of(kind, index)
    posterior = jb.sample(case, settings=case.sampler.for_one_of_many(full=False), seed=index)
    springs = {}
    for name in ("ky", "krz"):
        curve = posterior.curve(name)
        springs[name] = {"interval95": curve.change[1:], "shown": curve.changes}
    seconds = time.process_time() - began
    return {"index": index, "converged": posterior.converged, "seconds": seconds, "springs": springs}


def outcomes(kind: str, count: int, kept: Path) -> list[dict[str, Any]]:
    """Outcomes of the first `count` beams; those kept in a file are not analysed again."""
    head = json.dumps({"entropy": ENTROPY, "case": case_of(kind, 1).text})
    return kept_outcomes(kept, head, count, partial(analysed, kind), kind)


def summary(kind: str, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """JSON-ready counts and widths of what is said of krz, and of any spring."""
    change = [row["springs"]["krz"] for row in rows]
    intervals = [krz["interval95"] for krz in change]
    return {
        "cases": len(rows),
        "shown": sum(krz["shown"] for krz in change),
        "shown_of_any": sum(any(spring["shown"] for spring in row["springs"].values()) for row in rows),
        "held": sum(low <= KINDS[kind] <= high for low, high in intervals),
        "excludes_none": sum(not low <= 1.0 <= high for low, high in intervals),
        "width": float(np.median([high / low for low, high in intervals])),
        "not_converged": sum(not row["converged"] for row in rows),
        "median_seconds": float(np.median([row["seconds"] for row in rows])),
        "environment": environment(),
    }


def section(results: Mapping[str, Mapping[str, Any]]) -> str:
    """A table of what was counted, and where it was analysed."""
    head = ("truth", "cases", "a change of krz is shown", "of krz or ky", "interval of its ratio holds the truth",
            "share (95 % confidence)", "it excludes 1", "upper/lower end, median")  # fmt: skip
    rows = []
    for kind, data in results.items():
        low, high = stats.binomtest(data["held"], data["cases"]).proportion_ci(0.95, method="exact")
        share = f"{100 * data['held'] / data['cases']:.0f} % ({100 * low:.1f} to {100 * high:.1f})"
        counts = [str(data[key]) for key in ("cases", "shown", "shown_of_any", "held")]
        rows.append((kind, *counts, share, str(data["excludes_none"]), f"{data['width']:.4f}"))
    seconds = max(data["median_seconds"] for data in results.values())
    left = sum(data["not_converged"] for data in results.values())
    where = next(iter(results.values()))["environment"]
    note = f"{seconds:.1f} s of CPU a case; {left or 'none'} not converged."
    place = f"{where['date']}, {where['cpu']}, Python {where['python']}, one core."
    return "\n".join([*table(head, rows), "", note, place, ""])


def main() -> None:
    """Run and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=CASES, help="beams; default: the whole study")
    parser.add_argument("--pilot", action="store_true", help="print only: leave page and record as they are")
    options = parser.parse_args()
    for kind in KINDS:
        data = summary(kind, outcomes(kind, options.count, KEPT / f"{kind.replace(' ', '_').replace('%_', '')}.jsonl"))
        print(section({kind: data}), flush=True)
        if not options.pilot:
            write_between(PAGE, "two_levels.py", section(record_kind(SUMMARY, KINDS, kind, data)))


if __name__ == "__main__":
    main()
