"""Do printed ends hold for the joint at hand? Joints around a truth: `python -m benchmarks.limits_hold`.

Calibration over a prior asks how often intervals hold when joints are drawn from it. An engineer has one joint. Here
the joints scatter a little around one centre, k11 by 30 %, k22 by 8 % and the coupling by 10 %, and each is measured as
in the main case (`configs/clamped_beam.toml`: exact model, its priors, its noise with a seed of its own). Centres: the
paper's joint, and one five times softer and one five times stiffer. Counted is, by stiffness and verdict, how often the
draws' interval or limit holds the true value, and how often that which is printed does.

Part of `make science`; the table goes to docs/trust.md.
"""

import math
import re
from collections.abc import Mapping, Sequence

import numpy as np
from scipy import stats

import jointbayes as jb
from benchmarks.page import table
from benchmarks.record import ROOT
from benchmarks.study import Row, Study, holds, outcome

BASE = ROOT / "configs" / "clamped_beam.toml"
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


def analysed(centre: str, index: int) -> Row:
    """What a run says of each stiffness of one joint, next to the truth."""
    case, truth = case_of(centre, index)
    return outcome(jb.sample(case, seed=index, settings=SETTINGS), truth)


def summary(rows: Sequence[Row]) -> Row:
    """Counts by stiffness and verdict."""
    classes = []
    for name in rows[0]["known"]:
        said = [row["known"][name] for row in rows]
        for verdict in sorted({one["verdict"] for one in said}):
            of_class = [one for one in said if one["verdict"] == verdict]
            held = {"held_by_draws": sum(map(holds, of_class)), "held": sum(holds(one, "ends") for one in of_class)}
            classes.append({"stiffness": name, "verdict": verdict, "joints": len(of_class), **held})
    return {**{key: sum(row[key] for row in rows) for key in ("converged", "explains")}, "classes": classes}


def finding(row: Row) -> str:
    """Whether a class holds as often as is wanted; a dash where it has too few joints."""
    if row["joints"] < LEAST or row["verdict"] == "no verdict":
        return "–"
    share, low = row["held"] / row["joints"], WANTED_OF_LIMITS if "bounded" in row["verdict"] else WANTED[0]
    if share < low:
        return "**too seldom**"
    return "yes" if share <= WANTED[1] or "bounded" in row["verdict"] else "more often"


#: Of a class with fewer joints a share says nothing.
_SHOWN = 10


def tables(results: Mapping[str, Row]) -> list[str]:
    """Return one row for each verdict, and each class that holds too seldom; classes of few joints are left out."""
    classes = [(centre, row) for centre, data in results.items() for row in data["classes"] if row["joints"] >= _SHOWN]
    rows = []
    for verdict in sorted({row["verdict"] for _, row in classes}):
        same = [row for _, row in classes if row["verdict"] == verdict]
        joints, held = (sum(row[key] for row in same) for key in ("joints", "held"))
        share = f"{_share(held, joints)} in all, {_least(same)} at least"
        rows.append((verdict, str(joints), share, finding({"joints": joints, "verdict": verdict, "held": held})))
    seldom = [
        f"- Too seldom: {row['stiffness']} {row['verdict']} at {CENTRES[centre][0]:g} times the paper's stiffnesses, "
        f"{_share(row['held'], row['joints'])} of {row['joints']}."
        for centre, row in classes
        if "seldom" in finding(row)
    ]
    return [*table(("verdict", "joints", "hold (95 % confidence)", "as wanted"), rows), "", *seldom]


def _share(held: int, joints: int) -> str:
    low, high = stats.binomtest(held, joints).proportion_ci(0.95, method="exact")
    return f"{100 * held / joints:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def _least(rows: Sequence[Row]) -> str:
    return f"{min(100 * row['held'] / row['joints'] for row in rows):.1f} %"


STUDY = Study(
    "limits_hold",
    "trust.md",
    {centre: count for centre, (_, count) in CENTRES.items()},
    analysed,
    summary,
    tables,
)

if __name__ == "__main__":
    STUDY.main()
