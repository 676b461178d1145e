"""Simulations of all candidates, then of those that could still come first; each is kept once it is made."""

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from jointbayes.case.case import Case
from jointbayes.posterior.stored_problem import run_fingerprint
from jointbayes.progress import Progress, ProgressCallback
from jointbayes.studies.planning.candidates import Candidate, SimulatedPosterior, Simulation
from jointbayes.studies.planning.first_look import Names
from jointbayes.studies.planning.simulator import Simulator
from jointbayes.studies.study_directory import append_line, kept_lines

#: Name of the file of simulations that are done.
KEPT = "simulations.jsonl"
#: So many of those that could still come first are simulated further.
MOST_AGAIN = 3


@dataclass(frozen=True, slots=True)
class _Line:
    """One simulated measurement in the file: of which draws, candidates and truth, and what it left."""

    draws: str
    names: Names
    truth: int
    posterior: SimulatedPosterior | None


class KeptSimulations:
    """Simulations that are done, one line of a file each.

    Its first line says what all depend on. Each further line is one simulated measurement, on the disk before the next
    one is begun; a line that was cut off is passed over, and its simulation is made again.

    Parameters
    ----------
    file
        The file; None keeps them in memory alone.
    head
        What all simulations depend on, as `plan_fingerprint` has it.

    Raises
    ------
    CaseError
        If the file holds simulations that depend on something else: on what.
    WriteError
        If it cannot be written.
    """

    def __init__(self, file: Path | None, head: Mapping[str, str]) -> None:
        self._file, self._draws = file, ""
        self._lines = kept_lines(file, head, _Line, "simulations", "plan")
        #: By names of the candidates and number of the truth; None of a posterior that was not found.
        self.done: dict[tuple[Names, int], SimulatedPosterior | None] = {}

    def take(self, draws: str) -> None:
        """Take those of this digest of draws; those of other draws stay in the file, and are passed over."""
        self._draws = draws
        self.done = {(kept.names, kept.truth): kept.posterior for kept in self._lines if kept.draws == draws}

    def add(self, names: Names, truth: int, posterior: SimulatedPosterior | None) -> None:
        """Keep one more."""
        if self._file is not None:
            append_line(self._file, asdict(_Line(self._draws, names, truth, posterior)))
        self.done[names, truth] = posterior


def plan_fingerprint(case: Case, seed: int, assume: Mapping[str, float] | None, truths: int) -> dict[str, str]:
    """What simulations of a plan depend on, part by part, in words of a message."""
    parts = run_fingerprint(case.problem, case, seed, case.sampler)
    for name, spec in {"": case.spec, **{test.name: test.spec for test in case.setups}}.items():
        for key, value in spec.plan.model_dump(mode="json").items():
            parts[f"setups.{name}.plan.{key}" if name else f"plan.{key}"] = json.dumps(value, sort_keys=True)
    return parts | {"assumed joint": str(sorted((assume or {}).items())), "number of truths": str(truths)}


class Race:
    """Simulates all entrants for a few truths, then the first of those that could still come first for all truths.

    Parameters
    ----------
    simulator
        What simulates.
    candidates
        By name.
    kept
        What is done already, and where each simulation is kept.
    tell
        Called after each simulation.
    """

    def __init__(
        self,
        simulator: Simulator,
        candidates: Mapping[str, Candidate],
        kept: KeptSimulations,
        tell: ProgressCallback,
    ) -> None:
        self._simulator, self._candidates, self._kept, self._tell = simulator, candidates, kept, tell
        self._began, self._made = time.monotonic(), 0

    def run(self, entrants: Sequence[Names], first: int, simulations: int) -> dict[Names, Simulation]:
        """Simulations by names of a set: of `first` truths, and of so many of those that could come first."""
        if first < 1:
            return {}
        further = simulations - first
        outcome = self._round(entrants, range(first), min(MOST_AGAIN, len(entrants)) * further)
        if further:
            for names, more in self._round(could_come_first(outcome), range(first, simulations)).items():
                outcome[names] = Simulation(outcome[names].posteriors + more.posteriors)
        return outcome

    def _round(self, entrants: Sequence[Names], truths: range, later: int = 0) -> dict[Names, Simulation]:
        """Simulations of these truths; `later` is how many may follow, for the time that is left."""
        done, outcome = self._kept.done, {}
        left = later + sum((names, truth) not in done for names in entrants for truth in truths)
        for names in entrants:
            measured = [self._candidates[name] for name in names]
            for truth in truths:
                if (names, truth) in done:
                    continue
                self._kept.add(names, truth, self._simulator.posterior_after(measured, truth))
                left, self._made = left - 1, self._made + 1
                text, elapsed = f"last of {' + '.join(names)}", time.monotonic() - self._began
                total = self._made + left
                self._tell(Progress("simulating", text, self._made, total, "measurements", elapsed_seconds=elapsed))
            outcome[names] = Simulation(tuple(done[names, truth] for truth in truths))
        return outcome


def could_come_first(outcome: Mapping[Names, Simulation]) -> list[Names]:
    """The three of least median whose range begins below the end of that of the first, in this order."""
    ranked = sorted((simulation.median, names) for names, simulation in outcome.items() if simulation.valid)
    if not ranked:
        return []
    limit = outcome[ranked[0][1]].range80[1]
    return [names for _, names in ranked[:MOST_AGAIN] if outcome[names].range80[0] <= limit]
