"""What all studies share: data sets one by one, kept as they come, counted, and written with date and machine.

A study has kinds of data sets. Each row is kept in build/NAME/KIND.jsonl as it comes, so that a run that was cut off
goes on where it was; another version of the study's file begins again. What is counted goes to benchmarks/NAME.json,
the tables to a page of docs. Every study has the options of `Study.main`.
"""

import argparse
import hashlib
import inspect
import json
import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import stats

from benchmarks.record import ROOT, environment, write_between

if TYPE_CHECKING:  # studies of measurement files run without jointbayes
    from jointbayes.posterior import Posterior
    from jointbayes.posterior.identifiability import Verdict

Row = dict[str, Any]
#: Kinds from which on a page has the shortest and the longest time.
_MANY = 5


@dataclass(frozen=True)
class Study:
    """A study of several kinds of data sets.

    Parameters
    ----------
    name
        Its file in benchmarks/.
    page
        Page of docs with its mark; none where nothing is quoted.
    sets
        Number of data sets by kind.
    analyse
        JSON-ready row of data set number so many, from 1, of a kind.
    summary
        JSON-ready counts of the rows of a kind.
    tables
        Lines of Markdown from the counts by kind.
    page_per_kind
        Whether each kind has a mark of its own.
    """

    name: str
    page: str
    sets: Mapping[str, int]
    analyse: Callable[[str, int], Row]
    summary: Callable[[Sequence[Row]], Row]
    tables: Callable[[Mapping[str, Row]], Sequence[str]]
    page_per_kind: bool = False

    @property
    def record(self) -> Path:
        """Where the counts are kept."""
        return ROOT / "benchmarks" / f"{self.name}.json"

    def rows(self, kind: str, count: int, folder: Path | None = None) -> list[Row]:
        """Rows of the first data sets of a kind; those that the folder keeps are not made again."""
        done: dict[int, Row] = {}
        if folder is not None:
            file = folder / f"{'_'.join(''.join(c if c.isalnum() else ' ' for c in kind).split())}.jsonl"
            head = hashlib.sha256(Path(inspect.getfile(self.analyse)).read_bytes()).hexdigest()
            done = {row["index"]: row for row in kept_lines(file, head)}
        for index in range(1, count + 1):
            if index in done:
                continue
            began = time.process_time()
            row = self.analyse(kind, index)
            done[index] = {"index": index, **row, "seconds": time.process_time() - began}
            if folder is not None:
                with file.open("a", encoding="utf-8") as end:
                    end.write(json.dumps(done[index]) + "\n")
                print(f"{self.name}, {kind} {index} of {count}: {done[index]['seconds']:.1f} s", flush=True)
        return [done[index] for index in range(1, count + 1)]

    def counted(self, rows: Sequence[Row]) -> Row:
        """Counts of the rows of a kind, with their number, seconds of CPU, date and machine."""
        seconds = float(np.median([row["seconds"] for row in rows]))
        return {"sets": len(rows), **self.summary(rows), "seconds": seconds, "environment": environment()}

    def section(self, results: Mapping[str, Row]) -> str:
        """What stands on the page."""
        where = [data["environment"] for data in results.values()]
        places = "; ".join(dict.fromkeys(f"{one['date']}, {one['cpu']}, Python {one['python']}" for one in where))
        each = [data["seconds"] for data in results.values() if "seconds" in data]
        seconds = ", ".join(f"{one:.1f}" for one in each)
        seconds = seconds if len(each) < _MANY else f"{min(each):.1f} to {max(each):.1f}"
        place = f"{places}, one core; {seconds} s of CPU a data set."
        return "\n".join([*self.tables(results), "", place])

    def write(self, results: Mapping[str, Row]) -> None:
        """Write the tables into the page."""
        for kind, data in results.items() if self.page_per_kind else ():
            write_between(ROOT / "docs" / self.page, f"{self.name}.py, {kind}", self.section({kind: data}) + "\n")
        if self.page and not self.page_per_kind:
            write_between(ROOT / "docs" / self.page, f"{self.name}.py", self.section(results) + "\n")

    def main(self, arguments: Sequence[str] | None = None) -> Mapping[str, Row]:
        """Run what is not yet kept, print the tables, and write record and page."""
        parser = argparse.ArgumentParser(description=inspect.getdoc(inspect.getmodule(self.analyse)))
        parser.add_argument("--kind", action="append", choices=list(self.sets), help="may be repeated; default: all")
        parser.add_argument("--sets", type=int, help="data sets of each kind; default: the whole study")
        parser.add_argument("--pilot", action="store_true", help="print only: leave page and record as they are")
        options = parser.parse_args(arguments)
        kept = json.loads(self.record.read_text(encoding="utf-8")) if self.record.exists() else {}
        for kind in options.kind or self.sets:
            rows = self.rows(kind, options.sets or self.sets[kind], ROOT / "build" / self.name)
            kept[kind] = self.counted(rows)
        results = {kind: kept[kind] for kind in self.sets if kind in kept}
        print(self.section(results))
        if self.page and not options.pilot:
            self.record.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
            self.write(results)
        return results


def outcome(posterior: "Posterior", truth: Mapping[str, float]) -> Row:
    """What a run says of each quantity, next to its true value; JSON-ready. Open ends are None."""
    known = {}
    for name, true in truth.items():
        known[name] = {"truth": float(true), "interval95": [float(end) for end in posterior.interval(name)]}
        if name in posterior.stiffness_names:
            verdict = posterior.verdict(name)
            ends = [float(end) if math.isfinite(end) else None for end in printed(verdict)]
            known[name] |= {"verdict": verdict.cls, "ends": ends}
    return {"converged": posterior.converged, "explains": posterior.check.explains, "known": known}


def printed(known: "Verdict") -> tuple[float, float]:
    """Ends that a run prints of a stiffness; infinite where it gives a limit on the other side."""
    if known.cls == "bounded below":
        return known.limit, math.inf
    if known.cls == "bounded above":
        return -math.inf, known.limit
    return known.interval


def holds(known: Mapping[str, Any], ends: str = "interval95") -> bool:
    """Whether ends hold the truth; an open one does."""
    low, high = known[ends]
    return (low is None or low <= known["truth"]) and (high is None or known["truth"] <= high)


def coverage(rows: Sequence[Row]) -> Row:
    """How many intervals hold the truth, and how often each verdict is given, by quantity."""
    held, verdicts = {}, {}
    for name in rows[0]["known"]:
        said = [row["known"][name] for row in rows]
        held[name] = sum(map(holds, said))
        verdicts[name] = dict(sorted(Counter(one["verdict"] for one in said if "verdict" in one).items()))
    counts = {name: sum(row[name] for row in rows) for name in ("converged", "explains")}
    return {**counts, "held": held, "verdicts": verdicts}


def share(count: int, of: int, digits: int = 0) -> str:
    """A count with the 95 % confidence interval of its share."""
    low, high = (100 * end for end in stats.binomtest(count, of).proportion_ci(0.95, method="exact"))
    return f"{count} of {of} ({low:.{digits}f} to {high:.{digits}f} %)"


def kept_lines(file: Path, head: str) -> list[Row]:
    """Rows that an earlier run kept, one line of JSON each after a head; none, if the file has another head.

    A line at which a run was cut off is left out.
    """
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    if not lines or lines[0] != head:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(head + "\n", encoding="utf-8")
        return []
    found = []
    for line in lines[1:]:
        try:
            found.append(json.loads(line))
        except ValueError:
            continue
    if len(found) < len(lines) - 1:
        file.write_text("\n".join([head, *map(json.dumps, found)]) + "\n", encoding="utf-8")
    return found
