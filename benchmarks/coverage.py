"""What studies of coverage share: data sets one by one, kept as they come, and how many intervals hold the truth."""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from benchmarks.record import environment, kept_lines
from jointbayes.posterior import Posterior

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Row:
    """One data set: 95 % intervals beside the truth, and what is said of the quantity that the study is about."""

    index: int
    names: tuple[str, ...]
    truth: tuple[float, ...]
    intervals: tuple[tuple[float, float], ...]
    verdict: str
    contraction: float
    converged: bool
    explains: bool
    seconds: float

    @property
    def held(self) -> list[bool]:
        """Whether the interval of each quantity holds the truth."""
        return [low <= true <= high for (low, high), true in zip(self.intervals, self.truth, strict=True)]


def row_of(index: int, analyse: Callable[[int], tuple[Posterior, Mapping[str, float]]], judged: str) -> Row:
    """Analyse a data set: `analyse` gives its posterior and the truth by name; `judged` is whose verdict is kept."""
    began = time.process_time()
    posterior, truth = analyse(index)
    known = posterior.verdict(judged)
    return Row(
        index,
        tuple(truth),
        tuple(map(float, truth.values())),
        tuple(posterior.interval(name) for name in truth),
        known.verdict,
        float(known.contraction),
        posterior.converged,
        posterior.check.explains,
        time.process_time() - began,
    )


def kept_rows(kept: Path, head: str, sets: int, outcome: Callable[[int], Row]) -> list[Row]:
    """Rows of data sets 1 to `sets`; those that an earlier run under the same head kept are not repeated."""
    done = {row.index: row for row in map(_restored, kept_lines(kept, head))}
    for index in range(1, sets + 1):
        if index not in done:
            done[index] = row = outcome(index)
            with kept.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(row)) + "\n")
            print(f"{kept.stem} {index}: {row.seconds:.1f} s, {row.verdict}, held {row.held}", flush=True)
    return [done[index] for index in range(1, sets + 1)]


def _restored(row: Mapping[str, Any]) -> Row:
    known = {name: tuple(row[name]) for name in ("names", "truth")}
    return Row(**{**row, **known, "intervals": tuple((low, high) for low, high in row["intervals"])})


def summary(rows: Sequence[Row], judged: str) -> dict[str, Any]:
    """JSON-ready figures of a study."""
    held = np.array([row.held for row in rows]).sum(axis=0).tolist()
    coverage = {}
    for name, count in zip(rows[0].names, held, strict=True):
        low, high = stats.binomtest(count, len(rows)).proportion_ci(0.95, method="exact")
        coverage[name] = {"held": count, "interval95": [float(low), float(high)]}
    verdicts = sorted({row.verdict for row in rows})
    return {
        "data_sets": len(rows),
        "judged": judged,
        "coverage": coverage,
        "verdicts": {one: sum(row.verdict == one for row in rows) for one in verdicts},
        "median_contraction": float(np.median([row.contraction for row in rows])),
        "converged": sum(row.converged for row in rows),
        "explained": sum(row.explains for row in rows),
        "median_seconds": float(np.median([row.seconds for row in rows])),
        "environment": environment(),
    }


def of_sets(data: Mapping[str, Any], name: str) -> str:
    """How many intervals of a quantity hold the truth, with the 95 % confidence interval of their share."""
    low, high = data["coverage"][name]["interval95"]
    return f"{data['coverage'][name]['held']} of {data['data_sets']} ({100 * low:.0f} to {100 * high:.0f} %)"


def measured_where(results: Mapping[str, Mapping[str, Any]]) -> str:
    """Date, machine, and time of a data set in each study."""
    where = next(iter(results.values()))["environment"]
    seconds = ", ".join(f"{data['median_seconds']:.1f}" for data in results.values())
    return f"{where['date']}, {where['cpu']}, Python {where['python']}, one core; median of {seconds} s a data set."
