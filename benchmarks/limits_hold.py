"""Do printed ends hold for the joint at hand? Joints around a truth: `python -m benchmarks.limits_hold`.

Calibration over a prior asks how often intervals hold when joints are drawn from it. An engineer has one joint. Here
the joints scatter a little around one centre, k11 by 30 %, k22 by 8 % and the coupling by 10 %, and each is measured as
in the main case (`configs/clamped_beam.toml`: exact model, its priors, its noise with a seed of its own). Centres: the
paper's joint, and one five times softer and one five times stiffer. Counted is, by stiffness and verdict, how often the
draws' interval or limit holds the true value, and how often that which is printed does.

Part of `make science`. Outcomes are kept in build/limits as they come, one line of JSON each, so that a run that was
cut off goes on where it was. Figures go to benchmarks/limits_hold.json, the table to docs/trust.md.
"""

import argparse
import json
import math
import re
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

import jointbayes as jb
from benchmarks.page import table
from benchmarks.record import environment, kept_outcomes, record_kind, write_between
from jointbayes.posterior.identifiability import Identifiability

ROOT = Path(__file__).resolve().parents[1]
BASE = ROOT / "configs" / "clamped_beam.toml"
KEPT = ROOT / "build" / "limits"
SUMMARY = ROOT / "benchmarks" / "limits_hold.json"
PAGE = ROOT / "docs" / "trust.md"
ENTROPY = 20261123

#: Stiffness over the paper's, and number of joints.
CENTRES = {"paper": (1.0, 400), "soft": (0.2, 200), "stiff": (5.0, 200)}
#: A class of fewer joints tells too little.
LEAST = 40
#: What is asked of each class: the share that holds the truth, and of one-sided limits the least share.
WANTED, WANTED_OF_LIMITS = (0.92, 0.98), 0.93
#: Ends of intervals to 4 % of their width: what the scatter of 400 joints can tell.
SETTINGS = jb.SamplerSettings(end_tolerance=0.04, max_steps=6000)
_K11, _K22, _RHO = 5.05e9, 1.52e6, 0.39  # Table 3 of the paper
_SCATTER = {"k11": 0.30, "k12": 0.10, "k22": 0.08}


def case_of(centre: str, index: int) -> tuple[jb.Case, dict[str, float]]:
    """One measurement of one joint around a centre, and its stiffnesses."""
    factor, _ = CENTRES[centre]
    rng = np.random.default_rng([ENTROPY, *centre.encode(), index])
    move = {name: math.exp(sd * rng.standard_normal()) for name, sd in _SCATTER.items()}
    k11, k22 = _K11 * factor * move["k11"], _K22 * factor * move["k22"]
    truth = {"k11": k11, "k12": _RHO * math.sqrt(k11 * k22) * move["k12"], "k22": k22}
    head, tail = BASE.read_text(encoding="utf-8").split("\n[data.truth]")
    for key, value in {**truth, "seed": int(rng.integers(2**31))}.items():
        tail, count = re.subn(rf"(?m)^{key} = \S+", f"{key} = {value!r}", tail, count=1)
        if count != 1:
            raise ValueError(f"{BASE}: found no {key} after [data.truth]; expected one")
    return jb.case_from_text(f"{centre} {index}", f"{head}\n[data.truth]{tail}"), truth


def analysed(centre: str, index: int) -> dict[str, Any]:
    """What a run says of each stiffness of one joint, beside the truth; JSON-ready."""
    began = time.process_time()
    case, truth = case_of(centre, index)
    posterior = jb.sample(case, seed=index, settings=SETTINGS)
    stiffness = {name: _said(posterior.verdict(name), true) for name, true in truth.items()}
    return {
        "index": index,
        "converged": posterior.converged,
        "explains": posterior.check.explains,
        "seconds": time.process_time() - began,
        "stiffness": stiffness,
    }


def _said(known: Identifiability, truth: float) -> dict[str, Any]:
    below, above = (known.verdict == f"bounded {side}" for side in ("below", "above"))
    draws = (known.limit95 if below else -math.inf, known.limit95 if above else math.inf)
    draws = draws if below or above else known.interval95
    printed = known.printed95 if any(map(math.isfinite, known.printed95)) else draws
    return {
        "truth": truth,
        "verdict": known.verdict,
        "draws": [end if math.isfinite(end) else None for end in draws],
        "printed": [end if math.isfinite(end) else None for end in printed],
        "volume": bool(known.prior_volume),
    }


def outcomes(centre: str, count: int, kept: Path) -> list[dict[str, Any]]:
    """Outcomes of the first `count` joints around a centre; those kept in a file are not analysed again."""
    head = json.dumps({"centre": centre, "entropy": ENTROPY, "case": BASE.read_text(encoding="utf-8")})
    return kept_outcomes(kept, head, count, partial(analysed, centre), centre)


def _holds(one: Mapping[str, Any], which: str) -> bool:
    low, high = one[which]
    return (low is None or low <= one["truth"]) and (high is None or one["truth"] <= high)


def summary(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """JSON-ready counts by stiffness and verdict."""
    classes = []
    for name in rows[0]["stiffness"]:
        said = [row["stiffness"][name] for row in rows]
        for verdict in sorted({one["verdict"] for one in said}):
            of_class = [one for one in said if one["verdict"] == verdict]
            held = {which: sum(_holds(one, which) for one in of_class) for which in ("draws", "printed")}
            wider = [math.log(high / low) / math.log(one["draws"][1] / one["draws"][0])
                     for one in of_class for low, high in [one["printed"]] if None not in one["printed"]]  # fmt: skip
            classes.append(
                {
                    "stiffness": name,
                    "verdict": verdict,
                    "joints": len(of_class),
                    "held_by_draws": held["draws"],
                    "held": held["printed"],
                    "volume": sum(one["volume"] for one in of_class),
                    "width_ratio": float(np.median(wider)) if wider else None,
                }
            )
    return {
        "joints": len(rows),
        "converged": sum(row["converged"] for row in rows),
        "explains": sum(row["explains"] for row in rows),
        "median_seconds": float(np.median([row["seconds"] for row in rows])),
        "classes": classes,
        "environment": environment(),
    }


def finding(row: Mapping[str, Any]) -> str:
    """Whether a class holds as often as is wanted; a dash where it has too few joints."""
    if row["joints"] < LEAST or row["verdict"] == "no verdict":
        return "–"
    share, low = row["held"] / row["joints"], WANTED_OF_LIMITS if "bounded" in row["verdict"] else WANTED[0]
    if share < low:
        return "**too seldom**"
    return "yes" if share <= WANTED[1] or "bounded" in row["verdict"] else "more often"


#: Of a class with fewer joints a share says nothing.
_SHOWN = 10


def section(results: Mapping[str, Mapping[str, Any]]) -> str:
    """Tables of all centres that were studied."""
    head = ("stiffness", "verdict", "joints", "hold (95 % confidence)", "as wanted")
    lines = []
    for centre, data in results.items():
        where = data["environment"]
        rows = []
        for row in data["classes"]:
            if row["joints"] < _SHOWN:
                continue
            low, high = stats.binomtest(row["held"], row["joints"]).proportion_ci(0.95, method="exact")
            share = f"{100 * row['held'] / row['joints']:.1f} % ({100 * low:.1f} to {100 * high:.1f})"
            rows.append((row["stiffness"], row["verdict"], str(row["joints"]), share, finding(row)))
        lines += [
            f"{data['joints']} joints at {CENTRES[centre][0]:g} times the paper's stiffnesses, "
            f"{data['converged']} converged ({where['date']}, {where['cpu']}):",
            "",
            *table(head, rows),
            "",
        ]
    return "\n".join(lines)


def main() -> None:
    """Run and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--centre", action="append", choices=list(CENTRES), help="may be repeated; default: all")
    parser.add_argument("--count", type=int, help="joints of each centre; default: the whole study")
    parser.add_argument("--pilot", action="store_true", help="print only: leave page and record as they are")
    options = parser.parse_args()
    for centre in options.centre or CENTRES:
        count = options.count or CENTRES[centre][1]
        data = summary(outcomes(centre, count, KEPT / f"{centre}.jsonl"))
        print(section({centre: data}), flush=True)
        if not options.pilot:
            write_between(PAGE, "limits_hold.py", section(record_kind(SUMMARY, CENTRES, centre, data)))


if __name__ == "__main__":
    main()
