"""Does `jointbayes plan` recommend the right measurement, and does its forecast hold?

Random cases: the joint is drawn from the prior, each of four quantities of the beam is uncertain with probability a
half, its true value then from its prior; which stiffness is wanted and where three further accelerometers could go are
drawn as well, the seed being the number of the case. None is left out. The tip is measured from 10 to 2500 Hz in steps
of 4 Hz with 3 % noise and a floor of 1 %, and the case is planned from these data alone. Then every candidate is really
measured: with noise of its own at the true joint, and the posterior of the tip's data and the new ones together is
sampled, by the whole search for the mode and the ensemble sampler, not by the methods of the plan. Counted are

- forecasts: whether the standard deviation of ln k so found lies in the 80 % range that the plan states;
- first choices: whether the plan's first is one of the two candidates that leave least, in the median over repeated
  measurements.

A case whose present posterior does not converge has no plan; it is counted as such.

Cases are kept in build/planning as they come, one line of JSON each, so that a run that was cut off goes on where it
was. The table goes to docs/planning.md.

    python -m benchmarks.planning --cases 50
"""

import argparse
import json
import math
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from benchmarks.exact_page import where_measured
from benchmarks.record import between, environment, kept_lines
from jointbayes.posterior.first_look import Candidate
from jointbayes.studies.planning.plan_report import PlannedMeasurement
from vibrecords import FrfData, FrfSet

Array = NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks" / "planning.json"
KEPT, PAGE = ROOT / "build" / "planning" / "cases.jsonl", ROOT / "docs" / "planning.md"

#: About 1000 effective draws: a standard deviation to 3 %.
SETTINGS = jb.SamplerSettings(walkers=24, max_steps=4000, tau_factor=20.0, tau_tolerance=0.1, r_hat_max=1.03)
#: Uncertain quantity: standard deviation in per cent; the damping ratio is between a third and three times its value.
QUANTITIES = {"youngs_modulus": 2.0, "length": 0.5, "density": 1.0, "damping_ratio": None}
NOMINAL = {"youngs_modulus": 210.0, "length": 383.0, "density": 7800.0, "damping_ratio": 0.01}
TRUTH_KEYS = {
    "youngs_modulus": "youngs_modulus_gpa", "length": "length_mm", "density": "density_kg_m3",
    "damping_ratio": "damping_ratio",
}  # fmt: skip
#: Bounds of the prior, uniform in the logarithms.
BOUNDS = {"k11": (1e6, 1e11), "k12": (1e4, 1e10), "k22": (1e3, 1e8)}
TEMPLATE = """
title = "Random case {seed}"
[structure]
kind = "beam"
length_mm = 383.0
elements = 10
youngs_modulus_gpa = 210.0
poissons_ratio = 0.3
density_kg_m3 = 7800.0
section = {{ shape = "circle", diameter_mm = 25.0 }}
damping = {{ law = "modal", ratio = 0.01 }}
[joint]
dofs = ["1:y", "1:rz"]
initial = {{ k11 = 1.0e8, k12 = 0.0, k22 = 0.0 }}
[prior]
{priors}
[uncertain]
{uncertain}
[data]
kind = "synthetic_frf"
outputs = ["11:y"]
inputs = ["11:y"]
quantity = "receptance"
f_min_hz = 10.0
f_max_hz = 2500.0
f_step_hz = 4.0
[data.truth]
{truth}
[data.noise]
relative = 0.03
floor = 0.01
seed = {noise_seed}
[identification]
line_weight = 0.5
[plan]
parameter = "{parameter}"
outputs = {outputs}
"""


@dataclass(frozen=True)
class RandomCase:
    """One draw: the case in hand, the truth θ, shape (d,), and what was drawn."""

    seed: int
    case: jb.Case
    parameter: str
    uncertain: tuple[str, ...]
    truth: Array


def random_case(seed: int) -> RandomCase:
    """Draw a case; see the module."""
    rng = np.random.default_rng([seed, 2026])
    uncertain = tuple(name for name in QUANTITIES if rng.random() < 0.5)
    parameter = ("k11", "k12", "k22")[rng.integers(3)]
    nodes = sorted(rng.choice(np.arange(1, 11), 3, replace=False).tolist())
    k11, k12, k22 = _joint(rng)
    logs = {name: _draw(name, rng) for name in uncertain}
    lines = [f"k11 = {k11!r}", f"k12 = {k12!r}", f"k22 = {k22!r}"]
    lines += [f"{TRUTH_KEYS[name]} = {NOMINAL[name] * math.exp(log)!r}" for name, log in logs.items()]
    widths = [
        f"{name} = {{ low_factor = 0.3333, high_factor = 3.0 }}" if sd is None else f"{name} = {{ sd_percent = {sd} }}"
        for name, sd in QUANTITIES.items()
        if name in uncertain
    ]
    priors = [
        f'{name} = {{ distribution = "log_uniform", low = {low!r}, high = {high!r} }}'
        for name, (low, high) in BOUNDS.items()
    ]
    text = TEMPLATE.format(
        seed=seed, priors="\n".join(priors), uncertain="\n".join(widths), truth="\n".join(lines),
        noise_seed=1000 + seed, parameter=parameter, outputs=[f"{node}:y" for node in nodes],
    ).replace("'", '"')  # fmt: skip
    case = jb.case_from_text(f"random case {seed}", text)
    in_order = [logs[n.name] for n in case.problem.prior.nuisances]
    return RandomCase(seed, case, parameter, uncertain, np.concatenate([np.log([k11, k12, k22]), in_order]))


def _joint(rng: np.random.Generator) -> tuple[float, float, float]:
    """(k11, k12, k22) from the prior: uniform in the logarithms, drawn again until positive semidefinite."""
    low, high = np.log(np.array(list(BOUNDS.values()))).T
    while True:
        k11, k12, k22 = np.exp(rng.uniform(low, high)).tolist()
        if k12 < math.sqrt(k11 * k22):
            return k11, k12, k22


def _draw(name: str, rng: np.random.Generator) -> float:
    sd = QUANTITIES[name]
    return float(rng.uniform(-math.log(3), math.log(3)) if sd is None else rng.normal(0.0, sd / 100))


def measured_together(drawn: RandomCase, candidate: Candidate, rng: np.random.Generator) -> jb.Case:
    """The case with the candidate really measured at the truth, as one set of FRFs with that in hand if it can be."""
    problem = drawn.case.problem
    further = candidate.problem(problem, drawn.truth, rng).test
    if candidate.joint is not None:  # the structure hit free
        tests = [replace(problem.test, name="joined"), further]
        return replace(drawn.case, problem=jb.Problem(tests, problem.prior, problem.initial))
    old, new = problem.test.data, further.data
    assert isinstance(old, FrfData)
    assert isinstance(new, FrfData)
    if new.frf.outputs == old.frf.outputs:  # averages: the weighted mean says the same
        precision = 1 / old.variance + 1 / new.variance
        values = (old.frf.values / old.variance + new.frf.values / new.variance) / precision
        frf, variance = replace(old.frf, values=values), 1 / precision
    else:
        frf = FrfSet(
            old.frf.frequency_hz, np.concatenate([old.frf.values, new.frf.values], axis=1),
            old.frf.outputs + new.frf.outputs, old.frf.inputs, old.frf.quantity,
        )  # fmt: skip
        variance = np.concatenate([old.variance, new.variance], axis=1)
    together = problem.with_test(data=FrfData(frf, variance, synthetic=True))
    return replace(drawn.case, problem=together)


@dataclass(frozen=True)
class Row:
    """One candidate of one case: the forecast, and the standard deviations found of repeated real measurements."""

    seed: int
    parameter: str
    uncertain: int
    name: str
    recommended: bool
    before: float
    median: float
    low: float
    high: float
    found: tuple[float, ...]


def analyse(seed: int, repeats: int = 2) -> list[Row]:
    """Plan a case from its present data, then make each measurement and sample; the plan's order."""
    drawn = random_case(seed)
    began = time.process_time()
    found = jb.plan(drawn.case, seed=1)
    print(f"case {seed}: planned in {time.process_time() - began:.0f} s of CPU: {found.sentence}", flush=True)
    return [_measured(drawn, found, one, repeats) for one in found.ranked] if found.converged else []


def _measured(drawn: RandomCase, plan: jb.Plan, one: PlannedMeasurement, repeats: int) -> Row:
    assert one.simulation is not None
    (candidate,) = one.candidates
    sds = []
    for repeat in range(repeats):
        rng = np.random.default_rng([drawn.seed, repeat, *one.label.encode()])
        posterior = jb.sample(measured_together(drawn, candidate, rng), seed=repeat, settings=SETTINGS)
        # a run that did not converge says nothing of the spread, whatever its draws are like
        spread = float(np.log(posterior.values(drawn.parameter)).std())
        sds.append(spread if posterior.converged else math.nan)
    return Row(
        drawn.seed, drawn.parameter, len(drawn.uncertain), one.label, one is plan.ranked[0], plan.now.sd,
        one.sd_after, *one.simulation.range80, tuple(sds),
    )  # fmt: skip


def in_range(rows: list[Row]) -> tuple[int, int]:
    """Number of standard deviations found in the stated range, and number found: those of runs that converged."""
    inside = [row.low <= sd <= row.high for row in rows for sd in row.found if math.isfinite(sd)]
    return sum(inside), len(inside)


def first_is_among_best_two(rows: list[Row]) -> bool:
    """Whether the plan's first of one case leaves one of the two least medians."""
    ordered = sorted(rows, key=lambda row: float(np.median(row.found)))  # NaN comes last
    return any(row.recommended for row in ordered[:2])


def counts(cases: list[list[Row]]) -> dict[str, Any]:
    """What the study claims; an empty case is one that was not planned."""
    planned = [rows for rows in cases if rows]
    all_rows = [row for rows in planned for row in rows]
    every, first = in_range(all_rows), in_range([row for row in all_rows if row.recommended])
    return {
        "cases": len(cases),
        "planned": len(planned),
        "spreads": every[1],
        "in_range": every[0],
        "spreads_of_first": first[1],
        "in_range_of_first": first[0],
        "first_among_best_two": sum(first_is_among_best_two(rows) for rows in planned),
        "not_converged": sum(len(row.found) for row in all_rows) - every[1],
    }


def report(cases: list[list[Row]]) -> str:
    """The counts, in Markdown; `planning.json` has every candidate of every case."""
    n = counts(cases)
    return "\n".join([
        f"- Of {n['cases']} cases {n['planned']} were planned; the present posterior of the others had not converged.",
        f"- In the stated 80 % range: {_share(n['in_range'], n['spreads'])} of the standard deviations found; of first "
        f"choices {_share(n['in_range_of_first'], n['spreads_of_first'])}.",
        f"- First choice among the best two: {_share(n['first_among_best_two'], n['planned'])} of the planned cases.",
        f"- Left out: {n['not_converged']} measurements whose posterior had not converged within "
        f"{SETTINGS.max_steps} steps (–).",
    ])  # fmt: skip


def _share(some: int, all_: int) -> str:
    return f"{some} of {all_} ({some / max(all_, 1):.0%})"


def kept_cases(seeds: Iterable[int], repeats: int, kept: Path | None) -> list[list[Row]]:
    """Every case, those of an earlier run of the same study as they were kept in a file."""
    head = json.dumps({"template": TEMPLATE, "repeats": repeats})
    done: dict[int, list[Row]] = {}
    if kept is not None:
        for one in kept_lines(kept, head):
            done[one["seed"]] = [Row(**{**row, "found": tuple(row["found"])}) for row in one["rows"]]
    for seed in seeds:
        if seed in done:
            continue
        done[seed] = analyse(seed, repeats)
        if kept is not None:
            with kept.open("a", encoding="utf-8") as file:
                file.write(json.dumps({"seed": seed, "rows": [asdict(row) for row in done[seed]]}) + "\n")
    return [done[seed] for seed in seeds]


def main() -> None:
    """Run, print the table and write it to the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cases", type=int, default=50)
    parser.add_argument("--first", type=int, default=1, help="number of the first case")
    parser.add_argument("--repeats", type=int, default=2, help="real measurements of each candidate")
    parser.add_argument("--pilot", action="store_true", help="print only: leave the page as it is")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.cases)
    cases = kept_cases(seeds, options.repeats, KEPT)
    text = report(cases)
    print(text)
    if not options.pilot:
        found = {"environment": environment(), **counts(cases)}
        RESULTS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        text = f"{where_measured(environment())}\n\n{text}\n"
        PAGE.write_text(between(PAGE.read_text(encoding="utf-8"), text), encoding="utf-8")


if __name__ == "__main__":
    main()
