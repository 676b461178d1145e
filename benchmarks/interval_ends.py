"""Do the ends of 95 % intervals scatter over seeds as their stated Monte Carlo errors say, on every shipped case?

`python -m benchmarks.interval_ends [SEEDS] [--case NAME ...]`, a part of `make science`. Each case of configs/ is
sampled at each seed. Of each end of each stiffness's 95 % interval the standard deviation over the seeds is compared
with the root mean square of the stated errors. Outcomes are kept in build/interval_ends.jsonl as they come, one line
of JSON for a case and a seed, so that a run that was cut off goes on where it was; other sources of the package begin
a new file. The table goes to docs/trust.md once every case has as many seeds.

The rule. A case's figure is the root mean square of the ratios of all its ends, and should lie in 0.8 to 1.25. A
standard deviation over n seeds is itself uncertain, and the ends of one case move together: the lower ends of its
stiffnesses count as one, the upper ends as another, so that the figure has 2 (n - 1) degrees of freedom. A case fails
where its figure, divided by what chance does to such a figure in 95 of 100 studies, lies outside 0.8 to 1.25 as a
whole: with 20 seeds below 0.62 or above 1.53. The figure of all cases together, of as many degrees for each, must lie
in 0.8 to 1.25 as it stands.
"""

import argparse
import hashlib
import json
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

import jointbayes as jb
from benchmarks.exact_page import where_measured
from benchmarks.page import number, table
from benchmarks.record import environment, kept_lines, write_between
from jointbayes.sampling import INTERVAL, quantile_error

ROOT = Path(__file__).resolve().parents[1]
CASES = tuple(sorted(path.stem for path in (ROOT / "configs").glob("*.toml")))
KEPT, PAGE = ROOT / "build" / "interval_ends.jsonl", ROOT / "docs" / "trust.md"

#: Between which the ratio of scatter to stated error should lie.
LIMITS = (0.8, 1.25)

Row = Mapping[str, Any]
"""A case at a seed: `converged`, `seconds` of CPU, `ends` and their stated `errors`, [lower, upper] for each name."""


def measure(case: str, seed: int) -> dict[str, Any]:
    """Ends and stated errors of one case at one seed."""
    began = time.process_time()
    posterior = jb.sample(jb.load_case(ROOT / "configs" / f"{case}.toml"), seed=seed)
    names = posterior.stiffness_names
    draws = {name: posterior.by_ensemble(name) for name in names}
    return {
        "case": case,
        "seed": seed,
        "converged": posterior.converged,
        "seconds": round(time.process_time() - began, 2),
        "ends": {name: np.quantile(draws[name], INTERVAL).tolist() for name in names},
        "errors": {name: [quantile_error(draws[name], p) for p in INTERVAL] for name in names},
    }


def ratios(rows: Sequence[Row]) -> dict[str, tuple[float, float]]:
    """Scatter of each end over the seeds, over the root mean square of its stated errors: (lower, upper) by name."""
    found = {}
    for name in rows[0]["ends"]:
        scatter = np.std([row["ends"][name] for row in rows], axis=0, ddof=1)
        stated = np.sqrt(np.mean(np.square([row["errors"][name] for row in rows]), axis=0))
        low, high = (scatter / stated).tolist()
        found[name] = low, high
    return found


def pooled(each: Iterable[tuple[float, float]]) -> float:
    """Root mean square of ratios."""
    return float(np.sqrt(np.mean(np.square(list(each)))))


def allowed(seeds: int) -> tuple[float, float]:
    """Between which a case's figure lies in 95 of 100 studies at least, if the true ratio is within the limits.

    Examples
    --------
    >>> [round(end, 2) for end in allowed(20)]
    [0.62, 1.53]
    """
    freedom = 2 * (seeds - 1)
    low, high = np.sqrt(stats.chi2(freedom).ppf((0.025, 0.975)) / freedom)
    return LIMITS[0] * float(low), LIMITS[1] * float(high)


def verdict(by_case: Mapping[str, Sequence[Row]]) -> list[str]:
    """What the rule finds wrong, one sentence each; empty where it is met."""
    wrong, figures = [], {case: pooled(ratios(rows).values()) for case, rows in by_case.items()}
    for case, rows in by_case.items():
        low, high = allowed(len(rows))
        if not low <= figures[case] <= high:
            wrong.append(f"{case}: {figures[case]:.2f} is outside {low:.2f} to {high:.2f}")
        failed = [row["seed"] for row in rows if not row["converged"]]
        wrong += [f"{case}: not converged at seeds {failed}"] if failed else []
    whole = float(np.sqrt(np.mean(np.square(list(figures.values())))))
    if not LIMITS[0] <= whole <= LIMITS[1]:
        wrong.append(f"all cases: {whole:.2f} is outside {LIMITS[0]} to {LIMITS[1]}")
    return wrong


def section(by_case: Mapping[str, Sequence[Row]], where: Mapping[str, Any]) -> str:
    """Table of all cases, and what fails."""
    body, figures = [], list[float]()
    for case, rows in by_case.items():
        found = ratios(rows)
        ends = [end for pair in found.values() for end in pair]
        figures.append(pooled(found.values()))
        seconds = number(float(np.median([row["seconds"] for row in rows])), 2)
        body.append((case, f"{figures[-1]:.2f}", f"{min(ends):.2f} to {max(ends):.2f}", f"{seconds} s"))
    head = ("case", "scatter over stated error", "single ends", "CPU, median")
    whole = float(np.sqrt(np.mean(np.square(figures))))
    wrong = [f"- Failed: {line}." for line in verdict(by_case)] or ["None outside its band, and every run converged."]
    return "\n".join(
        [where_measured(where), "", *table(head, body), "", f"All cases together: {whole:.2f}.", "", *wrong]
    )


def main() -> None:
    """Measure what is missing, print, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seeds", type=int, nargs="?", default=20, help="seeds of each case; default 20")
    parser.add_argument("--case", action="append", choices=CASES, help="may be repeated; by default every case")
    options = parser.parse_args()
    cases = options.case or CASES
    done = {(row["case"], row["seed"]): row for row in kept_lines(KEPT, f"interval ends, sources {_sources()}")}
    for seed in range(1, options.seeds + 1):
        for case in cases:
            if (case, seed) in done:
                continue
            done[case, seed] = row = measure(case, seed)
            with KEPT.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
            print(f"{case}, seed {seed}: {row['seconds']:.1f} s of CPU, converged: {row['converged']}", flush=True)
    by_case = {case: [done[case, seed] for seed in range(1, options.seeds + 1)] for case in cases}
    text = section(by_case, environment())
    print(text)
    if not options.case and options.seeds >= 20:
        write_between(PAGE, "interval_ends.py", text + "\n")
    sys.exit(bool(verdict(by_case)))


def _sources() -> str:
    """Digest of the package's sources and of the cases: other draws are to be expected with others."""
    files = [*sorted((ROOT / "src").rglob("*.py")), *sorted((ROOT / "configs").glob("*.toml"))]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:16]


if __name__ == "__main__":
    main()
