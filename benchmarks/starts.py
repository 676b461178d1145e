"""Which kinds of starts the search for the mode needs: each is left out, and the modes that are then missed counted.

Beams, random frames of four to eight springs, frames of six springs, and chains are searched with all starts, and then
again without each kind on which the mode may depend. Climbs of one start do not see those of others: where a start of
another kind, known before the search went on by itself, ended at the mode, leaving a kind out loses nothing, and it is
not searched again. `python -m benchmarks.mode_found --without` prints the table and writes it into docs/method.md.
"""

import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray

import jointbayes as jb
from benchmarks import mode_found, random_frames
from benchmarks.coverage import write_between
from benchmarks.many_joints_data import chain_case, chain_truth
from benchmarks.page import table
from jointbayes import workflow
from jointbayes.identification import ModeSearch, effort, refine

Array = NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[1]
RECORD = ROOT / "benchmarks" / "starts.json"
PAGE = ROOT / "docs" / "method.md"
#: A kind of start by a word of the starts' names, and the function that makes it where making costs time.
KINDS = {
    "first guess": None,
    "lowest lines": (effort, "lowest_lines_first"),
    "reconstructed": (effort, "reconstructed_starts"),
    "natural frequencies": (effort, "frequency_starts"),
    "screened draw": (effort, "screened_draws"),
}
#: What climbs from modes, and not from starts, by the method of the search.
FROM_MODES = {"images of modes": "climb_images", "one spring moved": "climb_moved", "flattened modes": "climb_on"}
ROUNDS = "further rounds"
#: Coordinates in which a coupling may have either sign, with default priors.
SIGNED = {
    kind: mode_found.Beam({"parametrisation": f'"{kind}"'}, priors="# by default\n")
    for kind in ("signed", "elastic_centre")
}


def kind_of(name: str) -> str:
    """Kind of a start by its name."""
    return next((kind for kind in KINDS if kind in name), "first guess")


@dataclass
class Search:
    """One search of a problem: what it left out, how high it ended beside a climb from the truth, and what it took.

    Parameters
    ----------
    above
        Log posterior of its end above that of a climb from the truth.
    arrived
        Kinds of which a start of the first search ended at the mode, and climbs from modes that gained.
    seconds
        Processor time: of all, and of each kind: to make its starts, and its share of the climbs by their number.
    """

    above: float = -np.inf
    arrived: set[str] = field(default_factory=set)
    seconds: float = 0.0
    of_kind: dict[str, float] = field(default_factory=dict)

    @property
    def found(self) -> bool:
        """Whether it ended at the mode."""
        return self.above > -mode_found.TOLERANCE


def search(problem: jb.Problem, truth: Array, seed: int, without: str = "") -> Search:
    """Search the mode without one kind of start, and climb from the truth to compare."""
    told = Search()
    took = told.of_kind

    def timed(kind: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def run(*given: Any, **named: Any) -> Any:
            began = time.process_time()
            try:
                return work(*given, **named)
            finally:
                took[kind] = took.get(kind, 0.0) + time.process_time() - began

        return run

    class Watched(ModeSearch):
        def climb(self, starts: Mapping[str, Array], *given: Any) -> None:
            kept = {name: theta for name, theta in starts.items() if kind_of(name) != without}
            began = time.process_time()
            super().climb(kept, *given)
            each = (time.process_time() - began) / max(1, len(kept))
            for name in kept:
                took[kind_of(name)] = took.get(kind_of(name), 0.0) + each

    with ExitStack() as patches:
        patches.enter_context(mock.patch.object(workflow, "ModeSearch", Watched))
        for kind, place in KINDS.items():
            if place is not None:
                made = _nothing if kind == without else getattr(*place)
                patches.enter_context(mock.patch.object(*place, timed(kind, made)))
        for kind, method in FROM_MODES.items():
            climbed = (lambda *_: None) if kind == without else _noticed(kind, told, getattr(ModeSearch, method))
            patches.enter_context(mock.patch.object(Watched, method, timed(kind, climbed)))
        patches.enter_context(mock.patch.object(effort, "ROUNDS", 0 if without == ROUNDS else effort.ROUNDS))
        began = time.process_time()
        estimate = jb.find_map(problem, seed=seed)
        told.seconds = time.process_time() - began
    _, from_truth = refine(problem.log_posterior, truth)
    told.above = estimate.log_posterior - from_truth
    first = (s for s in estimate.starts if s.reached_mode and not s.name.startswith("round "))
    told.arrived |= {kind_of(start.name) for start in first} if told.found else set()
    return told


def _nothing(of: Any, *_: object) -> Array:
    return np.empty((0, of.prior.mean.size))


def _noticed(kind: str, told: Search, climb: Callable[..., None]) -> Callable[..., None]:
    """The climb from modes; where it leads higher, its kind is one that the mode may depend on."""

    def run(of: ModeSearch, *given: Any) -> None:
        before = of.best[1]
        climb(of, *given)
        if of.best[1] > before + mode_found.TOLERANCE:
            told.arrived.add(kind)

    return run


def problems(family: str, count: int) -> Iterator[tuple[jb.Problem, Array, int]]:
    """Problems of a family, each with its truth as a point θ and the seed of its search."""
    if family in ("beams", "signed couplings"):
        beams = mode_found.BEAMS if family == "beams" else SIGNED
        for seed in range(count):
            name = list(beams)[seed % len(beams)]
            base = beams[name].case(name)
            truth = mode_found.random_joint(base, seed)
            prior, made = base.problem.prior, mode_found.model_data(base, truth, seed)
            yield made.problem, np.concatenate([prior.parametrisation.coordinates(truth), prior.mean[3:]]), 1
    elif family == "chains":
        for number in range(count):
            springs, seed = (6, 12, 24)[number % 3], 1 + number // 3
            yield chain_case(springs, seed).problem, np.log(chain_truth(springs, seed)), seed
    else:
        for seed in range(count) if family == "frames" else range(12, 12 + 5 * count, 5):
            frame = random_frames.Frame(seed)
            problem = frame.problem()
            yield problem, problem.parametrisation.coordinates(frame.stiffness), seed


#: Families of problems, and of each so many.
FAMILIES = {"beams": 16, "signed couplings": 12, "frames": 4, "frames of six springs": 3, "chains": 2}


def study(family: str, count: int) -> dict[str, Any]:
    """Search so many problems of a family with all starts, and without the kinds that their modes may need."""
    kinds = {kind: {"led": 0, "lost": 0, "seconds": 0.0} for kind in (*KINDS, *FROM_MODES, ROUNDS)}
    found = 0
    for problem, truth, seed in problems(family, count):
        first = search(problem, truth, seed)
        found += first.found
        print(family, f"{first.above:.3g}, {first.seconds:.1f} s, from {sorted(first.arrived)}", flush=True)
        for kind, seconds in first.of_kind.items():
            kinds[kind]["seconds"] += seconds
        for kind in first.arrived:
            kinds[kind]["led"] += 1
        for kind in _needed_perhaps(first):
            again = search(problem, truth, seed, kind)
            print(f"  without {kind}: {again.above:.3g}", flush=True)
            kinds[kind]["lost"] += not again.found
    return {"count": count, "found": found, "kinds": kinds}


def _needed_perhaps(first: Search) -> list[str]:
    """Kinds without which the mode that was found could be lost."""
    if not first.found:
        return []
    starts = first.arrived & set(KINDS)
    if len(starts) > 1:
        # the lowest lines keep other starts from being made: those that were made beside them still arrive
        return []
    climbs = sorted(first.arrived - starts) if not starts else []
    return [*starts, *climbs, *([] if starts else [ROUNDS, *_used(first)])]


def _used(first: Search) -> list[str]:
    """Kinds that had starts, where no start of the first search ended at the mode."""
    return [kind for kind in KINDS if kind in first.of_kind]


def lines(record: Mapping[str, Any]) -> list[str]:
    """What the study found, for a page."""
    rows = []
    for kind in KINDS:
        families = [family["kinds"][kind] for family in record.values()]
        led, lost = (sum(each[what] for each in families) for what in ("led", "lost"))
        if led or lost:
            rows.append((kind, str(led), str(lost), f"{sum(each['seconds'] or 0.0 for each in families):.1f} s"))
    found = ", ".join(f"{family['found']} of {family['count']} {name}" for name, family in record.items())
    timed = ", ".join(name for name, f in record.items() if all(k["seconds"] is not None for k in f["kinds"].values()))
    after = f"With all of them the mode is found of {found}. Processor time is that of {timed}."
    return [*table(["Kind of start", "led to the mode", "modes lost without it", "processor time"], rows), "", after]


def main() -> None:
    """Study each family, keep what was found, and write it into the page."""
    kept = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {}
    for family, count in FAMILIES.items():
        found = study(family, count)
        # kinds that are made no more keep their row where as many were searched with them
        gone = kept[family]["kinds"] if kept.get(family, {}).get("count") == count else {}
        kept[family] = found | {"kinds": gone | found["kinds"]}
    RECORD.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    write_page(kept)


def write_page(record: Mapping[str, Any]) -> None:
    """Write the table into its place."""
    text = "\n".join(lines(record))
    print(text)
    write_between(PAGE, "starts.py", text + "\n")
