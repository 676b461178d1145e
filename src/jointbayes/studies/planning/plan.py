"""What to measure next: the plan of a case, ranked by simulated measurements."""

import math
import os
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jointbayes.case.case import Case
from jointbayes.case.errors import show_key
from jointbayes.errors import CaseError
from jointbayes.posterior import Posterior
from jointbayes.posterior.coordinates import coordinate_systems
from jointbayes.posterior.information.directions import spread_in_words
from jointbayes.sampling import Progress
from jointbayes.studies.planning.candidates import Candidate
from jointbayes.studies.planning.case_candidates import candidates_of
from jointbayes.studies.planning.first_look import FirstLook, Linearised, sets_of, worth_simulating
from jointbayes.studies.planning.forecast import SimulatedPosterior, Simulation
from jointbayes.studies.planning.race import KEPT, KeptSimulations, Race, plan_directory, plan_fingerprint
from jointbayes.studies.planning.simulation import Simulator, assumed_truth, stated_joint
from jointbayes.threads import one_blas_thread
from jointbayes.workflow import sample

Names = tuple[str, ...]

#: Simulated truths of each candidate, and of those few that could still come first after that.
FIRST, ALL = 9, 19
#: So many candidates are simulated whatever the first look says of them; of sets of several, so many at most.
MOST_SINGLES, MOST_SETS = 12, 8
#: A measurement helps if it leaves at most this share of the present standard deviation, in the median.
HELPS = 0.9
#: Another is about as good as the first if it did better for at least this share of the truths.
AS_GOOD = 1 / 3


@dataclass(frozen=True, slots=True)
class PlannedMeasurement:
    """A candidate, or a set of them, and what is forecast of it.

    Parameters
    ----------
    candidates
        The measurements to be made together.
    linearised
        First look by Fisher information about draws of the present posterior.
    simulation
        What simulated measurements say; None where none was made.
    """

    candidates: tuple[Candidate, ...]
    linearised: Linearised
    simulation: Simulation | None = None

    @property
    def names(self) -> Names:
        """Names of the candidates."""
        return tuple(one.name for one in self.candidates)

    @property
    def label(self) -> str:
        """The names in one."""
        return " + ".join(self.names)

    @property
    def words(self) -> str:
        """The candidates for a sentence."""
        words = [one.words for one in self.candidates]
        return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"

    @property
    def ranked(self) -> bool:
        """Whether simulations stand behind it, so that it may be recommended."""
        return self.simulation is not None and self.simulation.valid

    @property
    def sd_after(self) -> float:
        """Median simulated standard deviation; NaN where it is not ranked."""
        return self.simulation.median if self.simulation is not None and self.simulation.valid else math.nan

    def as_json(self) -> dict[str, Any]:
        """One entry of `plan.json`."""
        low, high = self.linearised.ends
        return {
            "names": list(self.names),
            "words": self.words,
            "positions": [one.position for one in self.candidates],
            "simulated": None if self.simulation is None else _simulated(self.simulation),
            "linearised": {"median": _finite(self.linearised.median), "range": [_finite(low), _finite(high)]},
        }


def _simulated(one: Simulation) -> dict[str, Any]:
    return {
        "valid": one.valid,
        "sd_median": _finite(one.median),
        "sd_range80": [_finite(end) for end in one.range80],
        "sds": [_finite(sd) for sd in one.sds.tolist()],
        "verdict": one.verdict if one.found else None,
        "verdict_count": one.agreeing if one.found else 0,
        "truths": len(one.posteriors),
        "lost": one.lost,
        "reweighted": one.reweighted,
        "least_effective": min((draws.effective for draws in one.found), default=None),
    }


@dataclass(frozen=True, eq=False)
class Plan:
    """Further measurements of a case, ranked by simulation.

    Parameters
    ----------
    case_name, title
        Of the case.
    seed
        Seed of the one random generator.
    parameter
        The stiffness to be known best.
    now
        What the present posterior says of it.
    measurements
        Candidates and sets: simulated ones first, by their median standard deviation; then the others, by their
        linearised one.
    converged, reason
        Whether the sampler of the present posterior converged, and why it stopped.
    assumed
        Whether the joint of the simulated measurements was stated, rather than drawn from the present posterior.
    left_out
        Sets that could come first by their linearised range and were not simulated, for there are too many.
    """

    case_name: str
    title: str
    seed: int
    parameter: str
    now: SimulatedPosterior
    measurements: tuple[PlannedMeasurement, ...]
    converged: bool
    reason: str
    assumed: bool = False
    left_out: int = 0

    @property
    def ranked(self) -> tuple[PlannedMeasurement, ...]:
        """Measurements with simulations behind them, the best first."""
        return tuple(one for one in self.measurements if one.ranked)

    @property
    def recommended(self) -> PlannedMeasurement | None:
        """The measurement to make next.

        That of the least median simulated standard deviation, if it leaves at most nine tenths of the present one.
        None if no simulation stands behind any, or if the present posterior had not converged.
        """
        best = next(iter(self.ranked), None)
        if best is None or not self.converged or best.sd_after > HELPS * self.now.sd:
            return None
        return best

    @property
    def as_good(self) -> tuple[PlannedMeasurement, ...]:
        """Measurements that did better than the recommended one for a third of the same truths or more."""
        best = self.recommended
        if best is None:
            return ()
        return tuple(one for one in self.ranked[1:] if _share_better(one, best) >= AS_GOOD)

    @property
    def sentence(self) -> str:
        """The recommendation in plain words."""
        if not self.converged:
            return f"No recommendation: the draws of the present posterior have not converged ({self.reason})."
        if not self.ranked:
            return "No recommendation: every simulation failed."
        best = self.recommended
        now = f"{spread_in_words(self.now.sd)} ({self.now.verdict})"
        if best is None:
            first = self.ranked[0]
            return (
                f"None of the {len(self.ranked)} simulated measurements would narrow {self.parameter} much: it is now "
                f"known to {now}, and after the best, {first.words}, to {spread_in_words(first.sd_after)}."
            )
        assert best.simulation is not None
        low, high = best.simulation.range80
        said = (
            f"Measure next: {best.words}. It is expected to make {self.parameter} known to "
            f"{spread_in_words(best.sd_after)} ({best.simulation.verdict}); now it is known to {now}. In 80 % of "
            f"simulated measurements: {spread_in_words(low)} to {spread_in_words(high)}."
        )
        others = ", ".join(one.words for one in self.as_good)
        return f"{said} About as good: {others}." if others else said

    @property
    def notes(self) -> tuple[str, ...]:
        """What the reader must know to trust the plan."""
        notes = []
        if self.assumed:
            notes.append("The measurements were simulated for a stated joint, not for what the present data allow.")
        lost = [one.label for one in self.measurements if one.simulation is not None and not one.simulation.valid]
        if lost:
            notes.append(f"Not ranked, because too many simulations failed: {', '.join(lost)}.")
        if self.left_out:
            notes.append(
                f"{self.left_out} further sets that could rank first by the linearised estimate were not simulated."
            )
        return tuple(notes)

    def summary(self) -> dict[str, Any]:
        """The plan as one JSON-ready dictionary: `plan.json`, described in docs/planning.md."""
        best = self.recommended
        return {
            "schema_version": 2,
            "case": self.case_name,
            "title": self.title,
            "seed": self.seed,
            "parameter": self.parameter,
            "assumed": self.assumed,
            "converged": self.converged,
            "reason": self.reason,
            "now": {"sd": _finite(self.now.sd), "verdict": self.now.verdict},
            "measurements": [one.as_json() for one in self.measurements],
            "recommended": None if best is None else list(best.names),
            "as_good": [list(one.names) for one in self.as_good],
            "sentence": self.sentence,
            "notes": list(self.notes),
        }


def _share_better(one: PlannedMeasurement, best: PlannedMeasurement) -> float:
    """Share of the truths that both were simulated for in which the first leaves less than the second."""
    assert one.simulation is not None
    assert best.simulation is not None
    count = min(len(one.simulation.sds), len(best.simulation.sds))
    mine, other = one.simulation.sds[:count], best.simulation.sds[:count]
    both = np.isfinite(mine) & np.isfinite(other)
    return float((mine < other)[both].mean()) if both.any() else 0.0


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


@one_blas_thread()
def plan(
    case: Case,
    posterior: Posterior | None = None,
    seed: int | None = None,
    *,
    assume: Mapping[str, float] | None = None,
    simulations: int = ALL,
    directory: str | os.PathLike[str] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Plan:
    """Rank the further measurements that a case could be given.

    Parameters
    ----------
    case
        Case with FRF data; its `[plan]` names the stiffness to be known best and the candidates.
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
        Called with a line of text at each step, of simulations with about how long the others will take.

    Returns
    -------
    Plan
        ``.recommended``, ``.sentence``, ``.measurements``, ``.summary()``.

    Raises
    ------
    CaseError
        If the data are natural frequencies, the posterior is of another case, there is nothing to choose from, or
        `assume` does not name every quantity of the joint; if the directory holds simulations of another plan: which
        part of it differs.
    ModelError
        If the prior thinks the assumed joint impossible.
    WriteError
        If the directory holds something else, or another process is at work in it.
    """
    tell = progress or (lambda line: None)
    bodies = [(part.setup, body.name) for part in case.problem.parts for body in part.measured_bodies]
    if bodies:
        setup, name = bodies[0]
        source = {one.name: one.source for one in case.setups}.get(setup, case.source)
        expected = "expected a modelled structure, for FRFs of a body say nothing of other lines and DOFs"
        words = "found a measured body", expected, "plan with a model of it"
        raise CaseError(source.fault(("bodies", name), show_key(source.written(("bodies", name))), *words))
    candidates = {c.name: c for c in candidates_of(case)}
    if posterior is not None and posterior.problem.names != case.problem.names:
        raise CaseError(f"{case.name}: found a posterior over other parameters; expected one of this case")
    seed, parameter = case.spec.sampling.seed if seed is None else seed, case.plan_parameter
    problem, settings = case.problem, case.spec.plan
    joint = None if assume is None else stated_joint(case.name, problem, assume)
    stated = _stated_sets(case, candidates)
    truths, target = max(simulations, FIRST), None if directory is None else Path(directory)
    with nullcontext() if target is None else plan_directory(target):
        kept = KeptSimulations(target and target / KEPT, plan_fingerprint(case, seed, assume, truths))
        if posterior is None:
            posterior = _present(case, seed, target and target / "present", tell)
        truth = None if joint is None else assumed_truth(problem, posterior.mode_theta, joint)
        simulator = Simulator(
            problem, parameter, posterior.theta, coordinate_systems(problem), np.random.default_rng([seed, 7]),
            truths=truths, assumed=truth,
        )  # fmt: skip
        kept.take(simulator.digest)
        if kept.done:
            tell(f"going on with {len(kept.done)} simulations that are kept")
        tell(f"first look at {len(candidates)} candidates")
        look = FirstLook(problem, candidates, parameter, simulator.truths[:FIRST])
        chosen, others, left_out = _chosen(candidates, look, settings.max_measurements, stated)
        # truths from draws that have not converged would be simulated for nothing
        count = simulations if posterior.converged else 0
        entrants = [one.names for one in chosen]
        simulated = Race(simulator, candidates, kept, tell).run(entrants, min(FIRST, count), count)
    planned = [
        PlannedMeasurement(tuple(candidates[name] for name in one.names), one, simulated.get(one.names))
        for one in (*chosen, *others)
    ]
    planned.sort(key=lambda one: (not one.ranked, one.sd_after if one.ranked else one.linearised.median))
    return Plan(
        case.name, case.title, seed, parameter, simulator.now, tuple(planned), posterior.converged,
        posterior.reason, truth is not None, left_out,
    )  # fmt: skip


def _present(case: Case, seed: int, checkpoint: Path | None, tell: Callable[[str], None]) -> Posterior:
    """Draws of the present posterior, kept in a directory of their own while they are made."""
    tell("sampling the present posterior")

    def report(progress: Progress) -> None:
        left = max(0.0, progress.elapsed_seconds * (progress.expected_steps / progress.steps - 1))
        tell(f"sampling the present posterior: step {progress.steps} of about {progress.expected_steps}, about "
             f"{left:.0f} s left before candidates are simulated")  # fmt: skip

    return sample(case, seed, progress=report, checkpoint=checkpoint, resume=True)


def _stated_sets(case: Case, candidates: Mapping[str, Candidate]) -> tuple[Names, ...]:
    """Sets that the plan of a case states, in the order in which their candidates are named."""
    found = []
    for number, names in enumerate(case.spec.plan.together):
        unknown = [name for name in names if name not in candidates]
        if unknown:
            words = f'found "{unknown[0]}"', f"expected names of candidates: {', '.join(candidates)}", "correct it"
            raise CaseError(case.source.fault(("plan", "together", number), "plan.together", *words))
        found.append(tuple(name for name in candidates if name in names))
    return tuple(dict.fromkeys(found))


def _chosen(
    candidates: Mapping[str, Candidate], look: FirstLook, size: int, stated: tuple[Names, ...]
) -> tuple[tuple[Linearised, ...], tuple[Linearised, ...], int]:
    """What is simulated, single candidates that are not, and the number of sets that could come first and are not.

    Sets that are stated are simulated whatever the first look says of them.
    """
    singles = [look.at((name,)) for name in candidates]
    chosen = worth_simulating(singles, MOST_SINGLES)
    others = tuple(one for one in singles if one not in chosen)
    chosen = (*chosen, *map(look.at, stated))
    if size < 2 or len(candidates) < 2:
        return chosen, others, 0
    sets = [
        look.at(names)
        for names in sets_of(tuple(candidates), size, lambda names: look.at(names).median)
        if names not in stated
    ]
    worth = worth_simulating(sets, MOST_SETS)
    return (*chosen, *worth[:MOST_SETS]), others, len(worth[MOST_SETS:])
