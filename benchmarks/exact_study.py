"""How far results can be trusted, against data of an exact beam: `python -m benchmarks.exact_study`.

Four parts, each data set analysed as a user would, with the default settings of the copied main case:

- coverage: random joints on four structures. How often do intervals hold the true stiffness?
- mode: the same data. Is the mode found that a climb from the truth leads to, and in what time?
- bounds: truths beyond a bound of the prior. What verdict does the stiffness get?
- seeds: the main case with other seeds of the sampler. Do the reported errors of interval ends match their scatter?

Part of `make science`. Outcomes are kept in build/exact as they come, one line of JSON each, so that a run that was cut
off goes on where it was. Figures go to benchmarks/exact.json, tables to docs/trust.md.
"""

import argparse
import dataclasses
import json
import multiprocessing
import os
import shutil
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import jointbayes as jb
from benchmarks.exact_data import BASE, ENTROPY, NAMES, SUBJECTS, Edits, base_case, beyond, draw
from benchmarks.exact_page import bounds_summary, coverage_summary, mode_summary, seeds_summary, write_page
from benchmarks.record import kept_lines, merged
from jointbayes.errors import JointBayesError
from jointbayes.identification import refine
from jointbayes.posterior.summary import summarise

#: Errors of the ends of 95 % intervals as a share of their width, for a run that shall know the 99.9 % interval.
LONGER = 0.003

ROOT = Path(__file__).resolve().parents[1]
PARTIAL = ROOT / "build" / "exact"
RESULTS = ROOT / "benchmarks" / "exact.json"


@dataclass(frozen=True)
class Task:
    """One data set: a part of the study, a structure, a number, and values of keys that differ from the study's."""

    part: str
    subject: str
    index: int
    edits: Edits = ()


@dataclass(frozen=True)
class StiffnessOutcome:
    """What a run said of one stiffness; `error95` as the summary states it, None where it does not."""

    truth: float | None
    interval95: tuple[float, float]
    interval999: tuple[float, float]
    verdict: str
    verdict_reason: str
    if_model_right: bool
    error95: tuple[float, float] | None


@dataclass(frozen=True)
class Outcome:
    """What came of one analysis; `seconds` of CPU. A failed one has an error and nothing else."""

    index: int
    seconds: float
    stiffness: dict[str, StiffnessOutcome]
    converged: bool = False
    mode_agrees: bool = False
    explains: bool = False
    bound: tuple[str, str, float] | None = None
    error: str = ""


@dataclass(frozen=True)
class ModeOutcome:
    """Log posterior at the mode found and at the end of a climb from the truth, and the CPU seconds of the search."""

    index: int
    seconds: float
    found: float = -np.inf
    from_truth: float = -np.inf
    error: str = ""


def analyse(case: jb.Case, seed: int, index: int, truth: np.ndarray | None, bound: Any = None) -> Outcome:
    """Sample a case and note what its summary says."""
    began = time.process_time()
    try:
        posterior = jb.sample(case, seed=seed)
        stated = summarise(posterior, case.problem.first_guess).to_json()["parameters"]
    except (JointBayesError, ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        return Outcome(index, time.process_time() - began, {}, bound=bound, error=f"{type(error).__name__}: {error}")
    seconds = time.process_time() - began
    stiffness = {}
    for row, name in enumerate(NAMES):
        one = stated[name]
        error95 = one.get("interval95_error")
        stiffness[name] = StiffnessOutcome(
            None if truth is None else float(truth[row]),
            tuple(one["interval95"]),
            _interval999(posterior, case, seed, name, None if truth is None else float(truth[row])),
            one["verdict"],
            one.get("verdict_reason") or "",
            bool(one.get("if_model_right")),
            None if error95 is None or None in error95 else tuple(error95),
        )
    flags = posterior.converged, posterior.mode_agrees, posterior.check.explains
    return Outcome(index, seconds, stiffness, *flags, bound=bound)


def _interval999(
    posterior: jb.Posterior, case: jb.Case, seed: int, name: str, truth: float | None
) -> tuple[float, float]:
    """99.9 % interval; of a run with many more draws where that of the run's own leaves the truth outside.

    Some ten draws lie beyond each of its ends in a run of default length: they are known to a tenth of the interval.
    """
    low, high = posterior.interval(name, 0.999)
    if truth is None or low <= truth <= high or not posterior.converged:
        return low, high
    longer = jb.sample(case, seed=seed, settings=dataclasses.replace(case.sampler, end_tolerance=LONGER))
    return longer.interval(name, 0.999)


def coverage(task: Task) -> Outcome:
    """Analyse one data set of a structure."""
    data = draw(task.subject, task.index, task.edits)
    return analyse(data.case, task.index, task.index, data.truth)


def bounds(task: Task) -> Outcome:
    """Analyse one data set whose truth lies beyond a bound."""
    bound, data = beyond(task.index, task.edits)
    return analyse(data.case, task.index, task.index, data.truth, bound)


def seeds(task: Task) -> Outcome:
    """Analyse the main case as it is shipped, with another seed of the sampler."""
    return analyse(_shipped(), task.index, task.index, None)


@cache
def _shipped() -> jb.Case:
    return jb.load_case(BASE)


def mode(task: Task) -> ModeOutcome:
    """Search for the mode of one data set, and climb from the truth."""
    _warm(task.subject, task.edits)
    data = draw(task.subject, task.index, task.edits)
    log_posterior = data.case.problem.log_posterior
    began = time.process_time()
    try:
        found = jb.find_map(data.case, seed=task.index).log_posterior
    except (JointBayesError, ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        return ModeOutcome(task.index, time.process_time() - began, error=f"{type(error).__name__}: {error}")
    seconds = time.process_time() - began
    _, climbed = refine(log_posterior, np.log(data.truth))
    return ModeOutcome(task.index, seconds, found, climbed)


@cache
def _warm(subject: str, edits: Edits) -> None:
    """Let everything be compiled before any search is timed."""
    jb.find_map(base_case(subject, edits))


#: Function, number of data sets and structures of each part.
PARTS: dict[str, tuple[Callable[[Task], Outcome | ModeOutcome], int, tuple[str, ...]]] = {
    "coverage": (coverage, 100, tuple(SUBJECTS)),
    "mode": (mode, 50, tuple(SUBJECTS)),
    "bounds": (bounds, 40, ("main",)),
    "seeds": (seeds, 100, ("main",)),
}
_SUMMARIES = {"coverage": coverage_summary, "mode": mode_summary, "bounds": bounds_summary, "seeds": seeds_summary}


def run(task: Task) -> Outcome | ModeOutcome:
    """Do one data set."""
    return PARTS[task.part][0](task)


def outcomes(
    part: str, subject: str, count: int, *, edits: Edits = (), processes: int = 1, kept: Path | None = None
) -> list[dict[str, Any]]:
    """Outcomes of the first `count` data sets, as dictionaries; those kept in a file are not done again."""
    done = {one["index"]: one for one in _read(kept, part, subject, edits)} if kept is not None else {}
    todo = [Task(part, subject, i, edits) for i in range(count) if i not in done]
    began = time.monotonic()
    for i, outcome in enumerate(_each(todo, processes), 1):
        line = json.dumps(asdict(outcome))
        done[outcome.index] = json.loads(line)
        if kept is not None:
            with kept.open("a", encoding="utf-8") as file:
                file.write(line + "\n")
            if i % 10 == 0 or i == len(todo):
                left = (time.monotonic() - began) / i * (len(todo) - i) / 60
                print(f"{part}, {subject}: {len(done)} of {count}, {left:.1f} min left", flush=True)
    return [done[i] for i in range(count)]


def _each(tasks: list[Task], processes: int) -> Iterator[Outcome | ModeOutcome]:
    if processes == 1 or len(tasks) < 2:
        yield from map(run, tasks)
        return
    with multiprocessing.get_context("spawn").Pool(min(processes, len(tasks))) as pool:
        yield from pool.imap_unordered(run, tasks)


def _read(file: Path, part: str, subject: str, edits: Edits) -> list[dict[str, Any]]:
    """Outcomes kept in a file; it is begun anew if it is of another case."""
    text = BASE.read_text(encoding="utf-8") if part == "seeds" else base_case(subject, edits).text
    fields = [one.name for one in dataclasses.fields(StiffnessOutcome)]
    head = json.dumps({"part": part, "entropy": ENTROPY, "fields": fields, "case": text})
    return kept_lines(file, head)


def main() -> None:
    """Run and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", action="append", choices=list(PARTS), help="may be repeated; default: all")
    parser.add_argument("--subject", action="append", choices=list(SUBJECTS), help="may be repeated; default: all")
    parser.add_argument("--count", type=int, help="data sets of each part and structure; default: the whole study")
    parser.add_argument("--processes", type=int, default=os.cpu_count())
    parser.add_argument("--pilot", action="store_true", help="print only: leave page and record as they are")
    parser.add_argument("--fresh", action="store_true", help="forget outcomes kept of an earlier run")
    options = parser.parse_args()
    if options.fresh:
        shutil.rmtree(PARTIAL, ignore_errors=True)
    for part in options.part or PARTS:
        _, whole, subjects = PARTS[part]
        found = {}
        for subject in subjects:
            if subject in (options.subject or subjects):
                kept = PARTIAL / f"{part}-{subject.replace(' ', '-')}.jsonl"
                count = min(options.count or whole, whole)
                found[subject] = outcomes(part, subject, count, processes=options.processes, kept=kept)
        if not found:
            continue
        data = {subject: _SUMMARIES[part](each) for subject, each in found.items()}
        print(json.dumps({part: data}, indent=1), flush=True)
        if not options.pilot:
            earlier = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}
            known = earlier.get(part, {}).get("subjects", {})
            section = merged(None, part, {"subjects": {**known, **data}}, quick=False)
            RESULTS.write_text(json.dumps({**earlier, **section}, indent=1) + "\n", encoding="utf-8")
            write_page(RESULTS)


if __name__ == "__main__":
    main()
