"""What to measure next: the plan of a case, ranked by simulated measurements, each kept once it is made.

The posterior that each would leave comes of nested Monte Carlo: a truth is drawn from the present posterior, the
further measurement is made there with noise, and the posterior of the data in hand together with the simulated ones is
found: by reweighting draws of the present posterior with the likelihood of the new data where enough of them stay
effective, and otherwise by importance sampling from a Student-t fit about the truth, in coordinates in which the
posterior is near Gaussian.

References
----------
Ryan, E. G. et al. (2016). A review of modern computational algorithms for Bayesian optimal design. International
Statistical Review 84(1), 128-154. DOI 10.1111/insr.12107
"""

import json
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.case.case import AnyCase, Case, require_case
from jointbayes.errors import CaseError, JointBayesError, ModelError
from jointbayes.inference import Problem
from jointbayes.inference.climb import PosteriorSquares, climb_all
from jointbayes.posterior import Posterior
from jointbayes.posterior.coordinates import coordinate_systems
from jointbayes.posterior.evidence import PARETO_LIMIT
from jointbayes.posterior.first_look import (
    Candidate,
    FirstLook,
    Linearised,
    Names,
    WithOwn,
    measurement_information,
    own_of,
    sets_of,
    worth_simulating,
)
from jointbayes.posterior.identifiability import assess, listed
from jointbayes.posterior.knowledge import taken_as_exact
from jointbayes.posterior.run_record import sha256_of
from jointbayes.posterior.storage import run_fingerprint
from jointbayes.progress import Progress, ProgressCallback, callback_of
from jointbayes.reproducibility import one_blas_thread
from jointbayes.sampling import Coordinates, Start, WeightedDraws, fit_proposal
from jointbayes.sampling.diagnostics import pareto_k
from jointbayes.studies.planning.case_candidates import candidates_of
from jointbayes.studies.planning.plan_report import (
    A_PLAN,
    Method,
    Plan,
    PlannedMeasurement,
    SimulatedPosterior,
    Simulation,
)
from jointbayes.studies.study_directory import append_line, kept_lines
from jointbayes.workflow import sample
from vibrecords.arrays import Array
from vibrecords.files import OwnDirectory

#: Fewer effective draws than this say too little about a standard deviation: 5 % of it at this number.
LEAST_EFFECTIVE = 200.0
#: Draws of the present posterior that are reweighted: first a few, then as many as these promise to be enough.
_FEW, _ALL = 2000, 40_000
#: So many times the draws that would just leave enough of them effective, by the first few.
_SPARE = 1.3
#: Present draws are no independent ones: so many times the effective number must be left of them.
_CORRELATED = 2.0
#: Where neither way leaves enough, so many will do for a figure to 10 %; rather that than leaving out the posteriors
#: of awkward shape, which need not be like the others.
_ROUGH = 50.0
#: Efficiency at which a fit ends, and importance draws from it: a Student-t, a mixture, the best mixture there is.
_FITS: tuple[tuple[float | None, int], ...] = ((0.1, 4000), (0.4, 4000), (None, 8000))
_RESAMPLED = 4000
_STEPS = 100  # of the climb to an assumed truth


class WithFurther:
    """ln p(θ | present data, further data) up to the evidence: measurements independent given θ.

    Parameters
    ----------
    present
        Log posterior density of the measurement in hand, (n, d) → (n,).
    further
        Problems over the same parameters, of whose densities only the likelihood is added.
    """

    def __init__(self, present: Callable[[Array], Array], further: Sequence[Problem]) -> None:
        self._present, self._further = present, [problem.log_posterior for problem in further]

    def __call__(self, theta: ArrayLike) -> Array:
        """Log density, shape (n,), of θ, shape (n, d)."""
        t = np.atleast_2d(np.asarray(theta, dtype=float))
        log_density = self._present(t)
        inside = np.isfinite(log_density)
        if inside.any():
            log_density[inside] += self.new_log_likelihood(t[inside])
        return log_density

    def new_log_likelihood(self, theta: Array) -> Array:
        """ln L of the further data alone, shape (n,), of θ, shape (n, d), inside the prior's support."""
        return sum((problem.log_likelihood(theta) for problem in self._further), np.zeros(len(theta)))


class Simulator:
    """Simulates further measurements and finds the posteriors that they leave.

    Parameters
    ----------
    problem
        The problem in hand.
    quantity
        Name of the wanted stiffness.
    draws
        Draws of θ from the present posterior, shape (n, d), equally weighted.
    systems
        Coordinates in which the posterior may be near Gaussian, the likeliest first.
    rng
        Chooses the truths among the draws, and seeds all noise.
    truths
        Number of truths.
    assumed
        θ that is the truth of every simulated measurement, shape (d,); by default truths are drawn from `draws`.

    Raises
    ------
    ModelError
        If there are too few draws, or no truth is asked for.
    """

    def __init__(
        self,
        problem: Problem,
        quantity: str,
        draws: Array,
        systems: Sequence[Coordinates],
        rng: np.random.Generator,
        *,
        truths: int,
        assumed: Array | None = None,
    ) -> None:
        if truths < 1 or len(draws) < 2 * truths:
            raise ModelError(
                f"planning: found {truths} simulations and {len(draws)} draws of the present posterior; expected at "
                "least one simulation and twice as many draws"
            )
        order = rng.permutation(len(draws))
        #: θ of each simulated truth, shape (truths, d).
        self.truths: Array = draws[order[:truths]] if assumed is None else np.repeat(assumed[None], truths, axis=0)
        # a truth must not be among the draws that are reweighted
        self._draws: Array = draws[order[truths : truths + _ALL]]
        self._draw_sd = draws.std(axis=0)
        self._problem = problem
        self._systems: dict[tuple[str, ...], Sequence[Coordinates]] = {(): tuple(systems)}
        self._column = problem.parametrisation.stiffness_names.index(quantity)
        self._prior_values = self._values(problem.prior.sample(rng, _RESAMPLED))
        self._seed = int(rng.integers(2**32))
        #: What is known now.
        self.now = self._posterior(WeightedDraws(draws.copy(), np.zeros(len(draws))), rng, "reweighting")

    @property
    def digest(self) -> str:
        """Of truths, draws and seed: where it is the same, so is what is simulated of a candidate."""
        return sha256_of([self.truths, self._draws, np.array(self._seed)])[:16]

    def posterior_after(self, candidates: Sequence[Candidate], truth: int) -> SimulatedPosterior | None:
        """Posterior after a set of further measurements of truth number `truth`; None where it is not found.

        A candidate has the same noise for the same truth, alone and in every set.
        """
        whole = WithOwn(self._problem, own_of(candidates))
        names = tuple(nuisance.name for nuisance in whole.own_nuisances)
        own_values = [
            nuisance.prior.sample(self._generator(truth, nuisance.name), 1) for nuisance in whole.own_nuisances
        ]
        theta = whole.joined(self.truths[truth][None], np.reshape(own_values, (1, -1)))[0]
        further = [c.problem(whole.problem, theta, self.noise(truth, c)) for c in candidates]
        density = WithFurther(whole.log_density, further)
        rng = self._generator(truth, *(c.name for c in candidates), "draws")
        # with nothing of its own no random number is taken, and the draws are the present ones
        draws = whole.drawn(self._draws, rng)
        few, needed = draws[:_FEW].copy(), _CORRELATED * LEAST_EFFECTIVE
        first = WeightedDraws(few, density.new_log_likelihood(few))
        wanted = math.ceil(_SPARE * needed / max(first.effective, 1.0) * len(first.theta))
        if wanted <= len(draws):
            present = _reweighted(density, draws, first, wanted)
            if _trusted(present, needed):
                return self._posterior(present, rng, "reweighting")
        best: Array = first.theta[int(np.argmax(first.log_weight))]
        starts = (self._start(whole, candidates, theta), self._start(whole, candidates, best))
        if names not in self._systems:
            self._systems[names] = coordinate_systems(whole.problem)
        about_truth = _importance(density, self._systems[names], starts, rng)
        if about_truth is not None and _trusted(about_truth, LEAST_EFFECTIVE):
            return self._posterior(about_truth, rng, "importance sampling")
        present = _reweighted(density, draws, first, len(draws))
        # what leaves more effective draws where neither leaves enough; nothing where too few for a rough figure
        effective = present.effective / _CORRELATED
        other = 0.0 if about_truth is None else about_truth.effective
        if max(effective, other) < _ROUGH:
            return None
        if about_truth is not None and other > effective:
            return self._posterior(about_truth, rng, "importance sampling")
        return self._posterior(present, rng, "reweighting")

    def _start(self, whole: WithOwn, candidates: Sequence[Candidate], theta: Array) -> Start:
        """A point, and the linearised covariance there, no wider than the present posterior in any coordinate."""
        fisher = whole.fisher(theta)
        added = sum((measurement_information(c, whole.problem, theta) for c in candidates), np.zeros_like(fisher.data))
        covariance = replace(fisher, data=fisher.data + added).covariance()
        widest = fisher.prior_sd.copy()
        widest[whole.present_columns] = np.minimum(widest[whole.present_columns], self._draw_sd)
        variance = np.diag(covariance)
        finite = np.isfinite(variance)
        shrink = np.minimum(1.0, widest / np.sqrt(np.where(finite, variance, widest**2)))
        bounded = np.where(np.isfinite(covariance), covariance, 0.0) * np.outer(shrink, shrink)
        bounded[~finite, ~finite] = widest[~finite] ** 2
        return theta, bounded

    def _posterior(self, draws: WeightedDraws, rng: np.random.Generator, method: Method) -> SimulatedPosterior:
        weight, values = draws.weight, self._values(draws.theta)
        with np.errstate(divide="ignore"):
            logs = np.log(np.abs(values))
        sd = math.sqrt(float(weight @ (logs - weight @ logs) ** 2))
        verdict = assess(self._values(draws.resample(rng, _RESAMPLED)), self._prior_values).verdict
        return SimulatedPosterior(sd, verdict, draws.effective, method)

    def noise(self, truth: int, candidate: Candidate) -> np.random.Generator:
        """Generator, at its beginning, of the noise with which a candidate measures truth number `truth`."""
        return self._generator(truth, candidate.name)

    def _generator(self, truth: int, *names: str) -> np.random.Generator:
        return np.random.default_rng([self._seed, truth, *" + ".join(names).encode()])

    def _values(self, theta: Array) -> Array:
        return self._problem.prior.values(theta)[:, self._column]


def _reweighted(density: WithFurther, draws: Array, first: WeightedDraws, count: int) -> WeightedDraws:
    """So many draws of the present posterior, weighted by the likelihood of the new data as the first few are."""
    rest = draws[len(first.theta) : count]
    if not len(rest):
        return first
    whole = np.concatenate([first.log_weight, density.new_log_likelihood(rest)])
    return WeightedDraws(draws[: len(whole)].copy(), whole)


def _importance(
    density: WithFurther, systems: Sequence[Coordinates], starts: tuple[Start, Start], rng: np.random.Generator
) -> WeightedDraws | None:
    """Weighted draws from a Student-t about the truth, or a mixture where its tails are too light; None if none.

    The mixtures start from the second point as well, the likeliest of the present draws, which may lie at another mode.
    """
    best: WeightedDraws | None = None
    begun: tuple[Start, ...] = starts[:1]
    for enough, count in _FITS:
        if enough is None and best is not None and best.effective >= _ROUGH:
            break  # a rough figure is there: the best mixture would cost seconds more
        try:
            proposal = fit_proposal(density, systems, begun, rng, enough=enough)
        except JointBayesError:
            continue  # a start at the very edge of the coordinates
        drawn = WeightedDraws(*proposal.weighted_draws(density, rng, count))
        if _trusted(drawn, LEAST_EFFECTIVE):
            return drawn
        if best is None or drawn.effective > best.effective:
            best = drawn
        begun = starts
    return best


def _trusted(weighted: WeightedDraws, effective: float) -> bool:
    """Whether weighted draws leave so many effective ones, in a tail that can be trusted."""
    return weighted.effective >= effective and pareto_k(weighted.log_weight) <= PARETO_LIMIT


def stated_joint(where: str, problem: Problem, assume: Mapping[str, float]) -> list[float]:
    """Quantities of an assumed joint, given by their names, in the order of the problem."""
    names = [quantity.name for quantity in problem.prior.parametrisation.quantities]
    if set(assume) != set(names):
        raise CaseError(
            f"{where}: found an assumed joint of {', '.join(map(str, assume))}; expected a value for each of "
            f"{', '.join(names)}; state all of them"
        )
    return [float(assume[name]) for name in names]


def assumed_truth(problem: Problem, theta: Array, stiffness: ArrayLike) -> Array:
    """θ, shape (d,), of an assumed joint, all else as the present data have it, given that joint.

    Parameters
    ----------
    problem
        The problem in hand.
    theta
        Mode of its posterior, shape (d,), from which the other quantities start.
    stiffness
        Quantities of the joint, shape (q,).

    Raises
    ------
    ModelError
        If the prior thinks that joint impossible.
    """
    prior, log_posterior = problem.prior, problem.log_posterior
    joint = prior.parametrisation.coordinates(stiffness)
    low, high = prior.support
    start = np.concatenate([joint, theta[joint.size :]])
    if not (prior.feasible(start) and (start >= low).all() and (start <= high).all()):
        given = ", ".join(f"{k:g}" for k in np.asarray(stiffness, dtype=float))
        raise ModelError(f"planning: found an assumed joint ({given}) outside the prior; expected one inside it")
    others = np.arange(joint.size, start.size - log_posterior.likelihood.hyper_count)
    (theta,), _ = climb_all(PosteriorSquares(log_posterior, columns=others, exact=True), start[None], _STEPS, fine=True)
    return theta


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
        posterior.reason, truth is not None, left_out, case.text, exact, case.problem.parts[0],
    )  # fmt: skip


def _require_modelled(case: Case) -> None:
    bodies = [(part.test.name, body.name) for part in case.problem.parts for body in part.test.measured_bodies]
    if bodies:
        where, name = bodies[0]
        source = {test.name: test.source for test in case.tests}.get(where, case.source)
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
    for name, spec in {"": case.spec, **{test.name: test.spec for test in case.tests}}.items():
        for key, value in spec.plan.model_dump(mode="json").items():
            parts[f"tests.{name}.plan.{key}" if name else f"plan.{key}"] = json.dumps(value, sort_keys=True)
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
