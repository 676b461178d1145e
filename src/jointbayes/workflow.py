"""The steps of a run: identify, find the MAP, sample, load. One function each, from a case or a problem to a result."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.case.case import AnyCase, Case, case_around, require_case
from jointbayes.errors import ModelError, require, require_count
from jointbayes.identification import (
    IterationHistory,
    MapEstimate,
    ModeSearch,
    first_starts,
    largest_squares,
    on_fewer_lines,
    part_to_iterate,
    refine_where_possible,
    search_further,
    sensitivity_iteration,
    why_not_iterated,
)
from jointbayes.inference import Premises, Problem, in_workshop
from jointbayes.posterior import Posterior, RunRecord, package_versions
from jointbayes.posterior.coordinates import draw_problem
from jointbayes.posterior.decision import decide, is_of_measured_frfs
from jointbayes.posterior.knowledge import assumed_beyond
from jointbayes.posterior.run_record import sampler_figures
from jointbayes.posterior.sampled import BestDraw, recall
from jointbayes.posterior.storage import draws_tree
from jointbayes.progress import Progress, ProgressCallback, callback_of
from jointbayes.reproducibility import one_blas_thread
from jointbayes.sampling import Chains, SamplerSettings
from vibrecords.arrays import Array

#: What is analysed: a case, the path of its file, or a problem.
Analysed = AnyCase | Problem
#: What measured FRFs are taken as: by their modes with an error of the model where that is usual, or as exact.
TakenAs = Literal["usual", "exact"]
#: What is said of an answer that takes measured data so where that is not usual.
AS_ASKED = "As was asked, the data are taken within their noise and the model as exact."

_PRIOR_DRAWS = 8000
_SAME_DENSITY = 1e-3  # of two points that are equally the mode
_STEPS_UP, _SHALLOW = 21, 1.0  # on the way between two points that may be one mode; ln of a density's dip there
#: Generators of `sample`: each has its own.
_STEPS, _PRIOR = range(2)


def identify(case: Analysed, initial: ArrayLike | None = None) -> IterationHistory:
    """Identify the joint by the paper's sensitivity iteration.

    Parameters
    ----------
    case
        Case, path of its file, or problem, with FRFs at the joint.
    initial
        First guess of the joint's quantities, shape (q,); by default the problem's.

    Returns
    -------
    IterationHistory
        ``.stiffness``, ``.stiffness_history``, ``.residual_norm``, ``.converged``, ``.reason``. Of several tests the
        first with FRFs at the joint is iterated, ``.test``, and of the quantities those that act in it,
        ``.iterated``.

    Raises
    ------
    ModelError
        If the data are natural frequencies, or lack FRFs at the joint, or the first guess is not positive semidefinite.

    References
    ----------
    Cao, H., Li, B., He, Z. A joint stiffness identification method based on finite element modeling and frequency
    response functions, Eqs. (3)-(9).
    """
    problem, whole = _problem_and_case(case)
    part = part_to_iterate(problem)
    if part is None:
        raise ModelError(f"{problem.name}: {why_not_iterated(problem)}; use find_map instead")
    assert part.test.data.frfs is not None
    assert part.test.joint_frf is not None
    start = part.first_guess if initial is None else np.asarray(initial, dtype=float)
    part.parametrisation.check(start)
    history = sensitivity_iteration(
        part.test.structures,
        part.test.joints,
        part.test.joint_frf,
        part.test.data.frfs.frf.outputs,
        start,
        parametrisation=part.parametrisation,
        **(whole.spec.identification.model_dump() if whole is not None else {}),
    )
    return replace(history, test=part.test.name)


def _problem_and_case(given: Analysed) -> tuple[Problem, Case | None]:
    if isinstance(given, Problem):
        return given, None
    case = require_case(given, "a case, a problem")
    return case.problem, case


@one_blas_thread()
def find_map(
    case: Analysed,
    initial: ArrayLike | None = None,
    *,
    seed: int | None = None,
    progress: ProgressCallback | bool | None = None,
    floor: float = -math.inf,
    on_all_lines: bool = True,
) -> MapEstimate:
    """Find the posterior mode from several starts and its Laplace covariance.

    The starts are the modes that the problem knows already, see `Problem.with_known_modes`, joints whose natural
    frequencies agree with the resonances of the data (of five unknowns and more one that explains line after line from
    the lowest, or joints whose motion is reconstructed), the first guess, and of many draws from the prior those that
    fit the most lines. All climb at once, the best are refined, and so are images of the modes: like joints exchanged,
    couplings reflected. `MapEstimate.starts` says
    which of them reached the mode, `MapEstimate.modes` what other modes there are.
    Where the best mode does not explain the data while starts disagree, the search goes on with more starts:
    `MapEstimate.effort` and `MapEstimate.sentence` say how far and what follows. FRFs of far more lines than resolve
    their resonances are searched on some of these, and the modes found are climbed on all.

    Parameters
    ----------
    case
        The case, the path of its file, or the problem.
    initial
        First guess of the joint's quantities, shape (q,); by default the problem's.
    seed
        Seed for the starts drawn from the prior; by default the case's, 1 of a problem.
    progress
        Called as the search begins, and before each further round of it.
    floor
        Log posterior below which the mode does not matter: the search ends with its first starts if all are lower.
    on_all_lines
        Whether modes that were found on some of the lines are climbed on all.

    Raises
    ------
    ModelError
        If no start lies inside the prior's support.
    """
    tell = callback_of(progress)
    tell(Progress("searching for the best fit"))
    problem, whole = _problem_and_case(case)
    budget = (SamplerSettings() if whole is None else whole.sampler).budget(len(problem.names))
    seed = _seed(whole, seed)
    guess = problem.first_guess if initial is None else np.asarray(initial, dtype=float)
    problem.parametrisation.check(guess)
    searched = on_fewer_lines(problem)
    iteration = identify(whole or problem, guess) if part_to_iterate(problem) is not None else None
    search = ModeSearch(searched.log_posterior, tell, budget)
    further = first_starts(searched, seed)
    known = [theta for theta in searched.known_theta if np.isfinite(searched.log_posterior(theta)[0])]
    search.climb_stiffnesses({"first guess": guess})
    search.climb({f"known mode {number}": theta for number, theta in enumerate(known, 1)} | further)
    effort = search_further(search, searched, seed, tell) if search.best[1] >= floor else None
    estimate = replace(search.estimate(), effort=effort, iteration=iteration)
    return _on_all_lines(problem, estimate) if on_all_lines and searched is not problem else estimate


def _on_all_lines(problem: Problem, estimate: MapEstimate) -> MapEstimate:
    """The estimate with its modes climbed on all lines of the problem; itself where it was found on these."""
    if on_fewer_lines(problem) is problem:
        return estimate
    climbed = _climbed_again(problem, estimate, [])
    total, count = problem.log_posterior.typical_squares(climbed.theta)
    if estimate.effort is None:
        return climbed
    return replace(climbed, effort=replace(estimate.effort, squares=total / count, limit=largest_squares(count)))


def _climbed_again(problem: Problem, estimate: MapEstimate, further: Sequence[Array]) -> MapEstimate:
    """The estimate with climbs of the problem from further points, and from its modes."""
    search = ModeSearch(problem.log_posterior)
    search.climb({str(number): theta for number, theta in enumerate([*further, *(m.theta for m in estimate.modes)])})
    return replace(search.estimate(), starts=estimate.starts, effort=estimate.effort, iteration=estimate.iteration)


def _seed(case: Case | None, seed: int | None) -> int:
    if seed is None:
        return 1 if case is None else case.spec.sampling.seed
    require_count(seed, "seed: found", 0)
    return seed


@one_blas_thread()
def sample(
    case: Analysed,
    *,
    settings: SamplerSettings | None = None,
    seed: int | None = None,
    progress: ProgressCallback | bool | None = None,
    premises: TakenAs | Mapping[str, object] | None = None,
) -> Posterior:
    """Draw from the posterior of what the data are taken as, which is decided before anything is drawn.

    Measured FRFs are analysed by the modes that they show, and these as typed-in ones are: with an error of the model
    in each, and with material, length and damping as uncertain as in a workshop where the case or the problem neither
    states their uncertainty nor declares them exact; see `jointbayes.posterior.decision.decide` for when FRFs are
    analysed as they are. What was decided, and why, is in ``.problem.premises``. Computed data, and a model that is
    declared exact, are analysed as stated. A case and its problem, or one made of arrays, give the same answer.

    Parameters
    ----------
    case
        The case, the path of its file, or the problem.
    settings
        Sampler settings; by default the case's.
    seed
        Seed of all random numbers; by default the case's, 1 of a problem. The same seed gives the same draws.
    progress
        Called as each stage begins, before each further round of the search for the mode, and after each block of
        steps; True for a bar of tqdm, or lines where that is not installed.
    premises
        What the answer takes for granted. ``"exact"`` analyses data within their noise and the model as exact, but for
        what the case calls uncertain; a mapping stands in the place of the case's `[uncertain]`, as
        ``{"exact": ["density"], "model_error": {"frequency_error": 0.01}}``. By default what is usual, ``"usual"``.

    Returns
    -------
    Posterior
        ``.draws``, ``.mode``, ``.interval(name, 0.95)``, ``.converged``, ``.reason``.

    Raises
    ------
    SamplingError
        If no starting ball with finite density is found.
    MeasurementError
        If FRFs have one line only.
    """
    tell = callback_of(progress)
    require(settings, SamplerSettings | None, "settings: found", "jb.SamplerSettings(walkers=…), or None; make it")
    expected = '"usual", "exact", a table as [uncertain], or None; choose one'
    named = (None, "usual", "exact")
    require(premises, str | Mapping | None, "premises: found", expected, lambda x: isinstance(x, Mapping) or x in named)
    if isinstance(premises, Mapping):
        if isinstance(case, Problem):
            raise ModelError(
                "premises: found a table for a problem, which has none; expected a case; use problem.with_premises(…)"
            )
        case, premises = require_case(case).with_uncertain(premises), None
    problem, whole = _problem_and_case(case)
    for test in problem.tests:
        test.data.require_enough()
    seed = _seed(whole, seed)
    dimension = len(problem.prior.names)
    settings = settings or (SamplerSettings().for_dimension(dimension) if whole is None else whole.sampler)
    settings.require_dimension(dimension)
    # modes of FRFs need no climb on all lines to be numbered
    estimate = find_map(whole or problem, seed=seed, progress=tell, on_all_lines=False)
    computed = all(test.data.frfs is not None and test.data.frfs.synthetic for test in problem.tests)
    if premises != "exact":
        answered = answered_problem(problem, whole, estimate, seed)
        if answered is not problem:
            if whole is not None:
                whole = replace(whole, problem=answered, stated=whole.stated and answered)
            if answered.premises.reason:
                tell(Progress("premises", answered.premises.decision))
            settings = settings.for_dimension(len(answered.names)).for_one_of_many()
            run = _Run(answered, whole, seed, settings, find_map(answered, seed=seed, progress=tell))
            return _posterior(*_drawn(run, tell))
    elif whole is not None and not ("model" in problem.exact or computed):
        problem = replace(problem, premises=Premises(asked=AS_ASKED))
        whole = replace(whole, problem=problem, stated=whole.stated and problem)
    estimate = _on_all_lines(problem, estimate)
    return _posterior(*_drawn(_Run(problem, whole, seed, settings, estimate), tell))


@dataclass(frozen=True)
class _Run:
    """What is drawn from, for which case, with which seed and settings, and the estimate of its mode."""

    problem: Problem
    case: Case | None
    seed: int
    settings: SamplerSettings
    estimate: MapEstimate

    def generator(self, purpose: int) -> np.random.Generator:
        """Random numbers for one purpose."""
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(purpose,)))


def answered_case(case: Case | Problem, seed: int, tell: ProgressCallback) -> Problem:
    """The problem whose posterior is the answer; where nothing is decided there is no search for the mode."""
    problem, whole = (case, None) if isinstance(case, Problem) else (case.problem, case)
    if is_of_measured_frfs(problem) or any(test.data.modes is not None for test in problem.tests):
        return answered_problem(problem, whole, find_map(case, seed=seed, progress=tell, on_all_lines=False), seed)
    return problem


def answered_problem(problem: Problem, case: Case | None, estimate: MapEstimate, seed: int) -> Problem:
    """The problem whose posterior is the answer: itself where its model is exact, or where that is decided already."""
    if "model" in problem.exact or problem.premises.reason or problem.premises.asked:
        return problem
    freed = in_workshop(problem) if case is None else case.workshop_problem
    assumed = assumed_beyond(problem, freed)
    checked = partial(_on_all_lines, problem, estimate)
    return decide(problem, estimate, seed, sizes=problem.model_error, freed=freed, assumed=assumed, checked=checked)


def _posterior(run: _Run, efficiency: float, chains: Chains) -> Posterior:
    problem, estimate = run.problem, run.estimate
    best = np.unravel_index(np.argmax(chains.log_density), chains.log_density.shape)
    mode = refine_where_possible(problem.log_posterior, chains.theta[best])
    # the best draw is at one of the others, or its climb fell short of the top; one that failed says nothing
    missing = estimate.log_posterior - mode[1]
    short = missing > _SAME_DENSITY and not np.array_equal(mode[0], chains.theta[best])
    if missing > 0 and (len(estimate.modes) > 1 or (short and _on_one_hill(problem, *mode, estimate.theta))):
        mode = estimate.theta.copy(), estimate.log_posterior
    record = RunRecord(
        problem.name,
        "" if run.case is None else run.case.text,
        run.seed,
        chains.converged,
        chains.reason,
        sampler_figures(run.settings, chains, efficiency, problem.names),
        dict(zip(problem.names, chains.r_hat.tolist(), strict=True)),
        package_versions(),
    )
    tree = draws_tree(problem, chains.draws(), problem.prior.sample(run.generator(_PRIOR), _PRIOR_DRAWS))
    return Posterior(problem, tree, estimate, BestDraw(*mode), record, run.case)


def _on_one_hill(problem: Problem, lower: Array, height: float, top: Array) -> bool:
    """Whether the way from a point of this height up to another one crosses no valley that would hold walkers up."""
    between = lower + np.linspace(0.0, 1.0, _STEPS_UP)[:, None] * (top - lower)
    return bool((problem.log_posterior(between) >= height - _SHALLOW).all())


def draws_of(problem: Problem, estimate: MapEstimate, seed: int, tell: ProgressCallback) -> Chains:
    """Draws of one of many problems whose mode is known, as `sample` would make them."""
    settings = SamplerSettings().for_dimension(len(problem.names)).for_one_of_many()
    rng = _Run(problem, None, seed, settings, estimate).generator(_STEPS)
    return draw_problem(problem, estimate.places, rng, settings, tell)[0]


def _drawn(run: _Run, tell: ProgressCallback) -> tuple[_Run, float, Chains]:
    """Draws with the efficiency of the last proposal, and the run with a higher mode where the best draw led to one."""
    problem, estimate = run.problem, run.estimate
    chains, proposal = draw_problem(problem, estimate.places, run.generator(_STEPS), run.settings, tell)
    return replace(run, estimate=_with_best_draw(problem, estimate, chains)), proposal.efficiency, chains


def _with_best_draw(problem: Problem, estimate: MapEstimate, chains: Chains) -> MapEstimate:
    """The estimate, or a higher mode that the best of independent draws leads to: those lie wherever the density does.

    Walkers would wait for long at a mode that the search missed, and say nothing of it.
    """
    best = chains.theta[np.unravel_index(np.argmax(chains.log_density), chains.log_density.shape)]
    theta, height = refine_where_possible(problem.log_posterior, best)
    if height <= estimate.log_posterior + _SAME_DENSITY:
        return estimate
    return _climbed_again(problem, estimate, [theta, estimate.theta])


@one_blas_thread()
def load_posterior(path: str | os.PathLike[str], problem: Problem | None = None) -> Posterior:
    """Read a posterior written by `Posterior.save`; its problem is rebuilt from what is stored with it.

    Measurement files are not read again: they may be gone.

    Parameters
    ----------
    path
        The file.
    problem
        The one that was sampled, where it has parts that no file can hold: one's own prior or term of the likelihood.

    Raises
    ------
    MeasurementError
        If the file is missing or holds no posterior.
    ModelError
        If the problem has parts that no file can hold and is not passed, or another one is.
    """
    from jointbayes.posterior.stored_file import one_line_of, read_posterior

    problem, tree, read = read_posterior(path, problem)
    record, case = read.record, None
    if record.case_text:
        with one_line_of(os.fspath(path)):
            case = case_around(problem, record.case_text, stated=read.of_case_text)
    estimate = replace(read.map, iteration=identify(case or problem) if part_to_iterate(problem) is not None else None)
    posterior = Posterior(problem, tree, estimate, read.mode, record, case)
    recall(posterior, read.found)
    return posterior
