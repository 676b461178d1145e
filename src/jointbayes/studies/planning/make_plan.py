"""What to measure next: the plan of a case, ranked by simulated measurements, each kept once it is made."""

import json
import os
import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from jointbayes.case.case import AnyCase, Case, require_case
from jointbayes.errors import CaseError
from jointbayes.posterior import Posterior
from jointbayes.posterior.candidate import Candidate
from jointbayes.posterior.coordinates import coordinate_systems
from jointbayes.posterior.first_look import FirstLook, Linearised, Names, sets_of, worth_simulating
from jointbayes.posterior.identifiability import listed
from jointbayes.posterior.stored_problem import run_fingerprint
from jointbayes.posterior.uncertain_inputs import taken_as_exact
from jointbayes.progress import Progress, ProgressCallback, callback_of
from jointbayes.reproducibility import one_blas_thread
from jointbayes.studies.planning.case_candidates import candidates_of
from jointbayes.studies.planning.plan_report import A_PLAN, Plan, PlannedMeasurement
from jointbayes.studies.planning.simulation import SimulatedPosterior, Simulation
from jointbayes.studies.planning.simulator import Simulator, assumed_truth, stated_joint
from jointbayes.studies.study_directory import append_line, kept_lines
from jointbayes.workflow import sample
from vibrecords.files import OwnDirectory

#: Name of the file of simulations that are done.
KEPT = "simulations.jsonl"
#: So many of those that could still come first are simulated further.
MOST_AGAIN = 3
#: Simulated truths of each candidate, and of those few that could still come first after that.
FIRST, ALL = 9, 19
#: So many candidates are simulated whatever the first look says of them; of sets of several, so many at most.
MOST_SINGLES, MOST_SETS = 12, 8


@one_blas_thread()
def plan(
    case: AnyCase,
    posterior: Posterior | None = None,
    *,
    seed: int | None = None,
    assume: Mapping[str, float] | None = None,
    simulations: int = ALL,
    directory: str | os.PathLike[str] | None = None,
    progress: ProgressCallback | bool | None = None,
) -> Plan:
    """Rank the further measurements that a case could be given.

    Parameters
    ----------
    case
        Case with FRFs or modes, or the path of its file; its `[plan]` names the stiffness to be known best, and the
        candidates. Measured FRFs of which a run answers by their modes are planned by these: further measurements then
        count by the modes that they would show, with the error of the model.
    posterior
        Posterior of the case; by default it is sampled.
    seed
        Seed of the one random generator; by default the case's.
    assume
        Quantities of the joint that makes every simulated measurement, each by its name (``{"k11": 1e9, ...}``). By
        default joints are drawn from the present posterior.
    simulations
        Measurements to simulate of each candidate that could come first; 9 at most of the others. 0 leaves the
        linearised first look, which recommends nothing.
    directory
        Where the draws of the present posterior and each simulation are kept as they are made: a plan that was cut off
        goes on where it was, and is the same bit for bit. By default nowhere.
    progress
        Called as each stage begins, after each block of steps of the present posterior, and after each simulation.

    Returns
    -------
    Plan
        ``.recommended``, ``.sentence``, ``.measurements``, ``.summary()``.

    Raises
    ------
    CaseError
        If the data are neither FRFs nor modes, the posterior is of another case, there is nothing to choose from, or
        `assume` does not name every quantity of the joint; if the directory holds simulations of another plan: which
        part of it differs.
    ModelError
        If the prior thinks the assumed joint impossible.
    WriteError
        If the directory holds something else, or another process is at work in it.
    """
    case = require_case(case)
    tell = callback_of(progress)
    _require_modelled(case)
    candidates = {c.name: c for c in candidates_of(case)}
    if posterior is not None:
        _require_posterior_of(case, posterior)
    seed, parameter = case.spec.sampling.seed if seed is None else seed, case.plan_parameter
    problem, settings = case.problem, case.spec.plan
    joint = None if assume is None else stated_joint(case.name, problem, assume)
    stated = _stated_sets(case, candidates)
    truths, target = max(simulations, FIRST), None if directory is None else Path(directory)
    with nullcontext() if target is None else OwnDirectory(target, A_PLAN):
        kept = KeptSimulations(target and target / KEPT, plan_fingerprint(case, seed, assume, truths))
        if posterior is None:
            tell(Progress("sampling the present posterior"))
            kept_run = target and target / "present"
            posterior = sample(case, seed=seed, progress=progress, checkpoint=kept_run, resume=True)
        if posterior.problem.premises.reason:  # further measurements count as what the present ones are taken as
            case = replace(case, problem=posterior.problem)
            candidates = {c.name: c for c in candidates_of(case)}
            problem, stated = case.problem, _stated_sets(case, candidates)
        truth = None if joint is None else assumed_truth(problem, posterior.mode_theta, joint)
        simulator = Simulator(
            problem, parameter, posterior.theta, coordinate_systems(problem), np.random.default_rng([seed, 7]),
            truths=truths, assumed=truth,
        )  # fmt: skip
        kept.take(simulator.digest)
        if kept.done:
            tell(Progress("going on", f"{len(kept.done)} simulations are kept"))
        tell(Progress(f"first look at {len(candidates)} candidates"))
        look = FirstLook(problem, candidates, parameter, simulator.truths[:FIRST])
        chosen, others, left_out = _chosen(candidates, look, settings.max_measurements, stated)
        # truths from draws that have not converged would be simulated for nothing
        count = simulations if posterior.converged else 0
        entrants = [estimate.names for estimate in chosen]
        simulated = simulate_first(simulator, candidates, entrants, kept, min(FIRST, count), count, tell)
    planned = [
        PlannedMeasurement(tuple(candidates[name] for name in estimate.names), estimate, simulated.get(estimate.names))
        for estimate in (*chosen, *others)
    ]
    planned.sort(key=lambda data: data.rank)
    exact = listed(taken_as_exact(case.problem, case.workshop_problem))
    now = replace(simulator.now, verdict=posterior.verdict(parameter).verdict)
    return Plan(
        case.name, case.title, seed, parameter, now, tuple(planned), posterior.converged,
        posterior.reason, truth is not None, left_out, case.text, exact,
    )  # fmt: skip


def _require_modelled(case: Case) -> None:
    bodies = [(part.test.name, body.name) for part in case.problem.parts for body in part.test.measured_bodies]
    if bodies:
        setup, name = bodies[0]
        source = {test.name: test.source for test in case.setups}.get(setup, case.source)
        expected = "a modelled structure, for FRFs of a body say nothing of other lines and DOFs"
        words = "found a measured body", expected, "plan with a model of it"
        raise CaseError(source.fault(("bodies", name), *words))


def _require_posterior_of(case: Case, posterior: Posterior) -> None:
    as_stated = not posterior.problem.premises.reason  # else it allows for inputs that the case does not
    each = posterior.problem, case.problem
    found, expected = (one.names if as_stated else one.parametrisation.stiffness_names for one in each)
    if found != expected:
        raise CaseError(f"{case.name}: found a posterior over other parameters; expected one of this case")


def _stated_sets(case: Case, candidates: Mapping[str, Candidate]) -> tuple[Names, ...]:
    """Sets that the plan of a case states, in the order in which their candidates are named."""
    stated_sets = []
    for number, names in enumerate(case.spec.plan.together):
        unknown = [name for name in names if name not in candidates]
        if unknown:
            words = f'found "{unknown[0]}"', f"names of candidates: {', '.join(candidates)}", "correct it"
            raise CaseError(case.source.fault(("plan", "together", number), *words))
        stated_sets.append(tuple(name for name in candidates if name in names))
    return tuple(dict.fromkeys(stated_sets))


def _chosen(
    candidates: Mapping[str, Candidate], look: FirstLook, size: int, stated: tuple[Names, ...]
) -> tuple[tuple[Linearised, ...], tuple[Linearised, ...], int]:
    """What is simulated, single candidates that are not, and the number of sets that could come first and are not.

    Sets that are stated are simulated whatever the first look says of them.
    """
    singles = [look.linearised((name,)) for name in candidates]
    chosen = worth_simulating(singles, MOST_SINGLES)
    others = tuple(estimate for estimate in singles if estimate not in chosen)
    chosen = (*chosen, *map(look.linearised, stated))
    if size < 2 or len(candidates) < 2:
        return chosen, others, 0
    sets = [
        look.linearised(names)
        for names in sets_of(tuple(candidates), size, lambda names: look.linearised(names).median)
        if names not in stated
    ]
    worth = worth_simulating(sets, MOST_SETS)
    return (*chosen, *worth[:MOST_SETS]), others, len(worth[MOST_SETS:])


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


def simulate_first(
    simulator: Simulator,
    candidates: Mapping[str, Candidate],
    entrants: Sequence[Names],
    kept: KeptSimulations,
    first: int,
    simulations: int,
    tell: ProgressCallback,
) -> dict[Names, Simulation]:
    """Simulate all entrants for a few truths, then the first of those that could still come first for all truths.

    Parameters
    ----------
    simulator
        What simulates.
    candidates
        By name.
    entrants
        Sets of them.
    kept
        What is done already, and where each simulation is kept.
    first, simulations
        Truths of all entrants, and of those that could come first.
    tell
        Called after each simulation.
    """
    began, made = time.monotonic(), 0
    outcome: dict[Names, Simulation] = {}
    further = simulations - first
    for truths, later in ((range(first), min(MOST_AGAIN, len(entrants)) * further), (range(first, simulations), 0)):
        if not truths:
            continue
        chosen = could_come_first(outcome) if outcome else entrants
        left = later + sum((names, truth) not in kept.done for names in chosen for truth in truths)
        for names in chosen:
            measured = [candidates[name] for name in names]
            for truth in truths:
                if (names, truth) in kept.done:
                    continue
                kept.add(names, truth, simulator.posterior_after(measured, truth))
                left, made = left - 1, made + 1
                text, elapsed = f"last of {' + '.join(names)}", time.monotonic() - began
                tell(Progress("simulating", text, made, made + left, "measurements", elapsed_seconds=elapsed))
            posteriors = tuple(kept.done[names, truth] for truth in truths)
            outcome[names] = Simulation((outcome[names].posteriors if names in outcome else ()) + posteriors)
    return outcome


def could_come_first(outcome: Mapping[Names, Simulation]) -> list[Names]:
    """The three of least median whose range begins below the end of that of the first, in this order."""
    ranked = sorted((simulation.median, names) for names, simulation in outcome.items() if simulation.valid)
    if not ranked:
        return []
    limit = outcome[ranked[0][1]].range80[1]
    return [names for _, names in ranked[:MOST_AGAIN] if outcome[names].range80[0] <= limit]
