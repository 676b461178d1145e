"""Which joint, and which case, explains the data best: the evidence of each hypothesis."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jointbayes.case.case import AnyCase, Case, require_case
from jointbayes.errors import CaseError, JointBayesError, ModelError
from jointbayes.inference import JointPrior, Marginal, Problem, Uniform
from jointbayes.joint import HYPOTHESES, Parametrisation, joint_under_hypothesis
from jointbayes.posterior import data_sha256
from jointbayes.posterior.coordinates import coordinate_systems
from jointbayes.posterior.decision import only_modes
from jointbayes.posterior.evidence import evidence
from jointbayes.progress import Progress, ProgressCallback, callback_of
from jointbayes.reproducibility import one_blas_thread
from jointbayes.sampling import Start
from jointbayes.studies.comparison_report import Comparison, PriorEdge, WeighedModel, leave_one_out
from jointbayes.workflow import answered_case, find_map
from vibrecords.arrays import Array

_KEPT = 2000  # posterior draws, for what the evidence does not need
_EDGE = 0.05  # of a prior's interval
_PILED = 2.0  # times the prior's probability in that strip


def hypothesis_problem(problem: Problem, hypothesis: str) -> Problem:
    """The problem with the joint of a hypothesis; priors of what stays free are as they were.

    Couplings that the problem does not know have coefficients between −1 and 1, all equally probable.

    Parameters
    ----------
    problem
        Problem with the full joint.
    hypothesis
        One of `HYPOTHESES`.

    Raises
    ------
    ModelError
        If there is no such hypothesis, or the joint cannot be so.
    """
    if hypothesis not in HYPOTHESES:
        raise ModelError(f"comparison: found hypothesis {hypothesis!r}; expected one of {', '.join(HYPOTHESES)}")
    if problem.prior.scatters:
        raise ModelError(
            "comparison: found a joint that scatters between assemblies; expected priors that are independent; remove "
            "[assembly]"
        )
    simpler = joint_under_hypothesis(problem.parametrisation, hypothesis)
    marginal_by_name: dict[str, Marginal] = {}
    there = _places(problem.parametrisation)
    for axis, marginal in zip(problem.parametrisation.axes, problem.prior.marginals, strict=True):
        marginal_by_name |= dict.fromkeys((axis.name, axis.quantity, there[axis.quantity]), marginal)
    here, marginals = _places(simpler), []
    for axis in simpler.axes:
        # a coordinate that the joint has itself keeps its prior; a spring has that of what stands for it or its place
        names = (axis.name, axis.quantity, here[axis.quantity])
        inherited = next((marginal_by_name[name] for name in names if name in marginal_by_name), None)
        marginals.append(inherited or Uniform(*axis.bounds))
    prior = replace(problem.prior, parametrisation=simpler, marginals=tuple(marginals))
    return replace(problem, prior=prior, initial=_initial(problem, here))


def _initial(problem: Problem, here: dict[str, str]) -> Array | None:
    """First guess of the quantities that stand at these places, 0 of a coupling that the problem does not know."""
    if problem.initial is None:
        return None
    there = _places(problem.parametrisation)
    pairs = list(zip(there, np.asarray(problem.initial, dtype=float).tolist(), strict=True))
    guess = {there[name]: k for name, k in pairs} | dict(pairs)
    return np.array([guess.get(name, guess.get(place, 0.0)) for name, place in here.items()])


def _places(parametrisation: Parametrisation) -> dict[str, str]:
    """What each quantity does and where, by its name, as a text."""
    return {quantity.name: f"{quantity.role} {quantity.places}" for quantity in parametrisation.quantities}


@one_blas_thread()
def compare(
    cases: Sequence[AnyCase], *, seed: int | None = None, progress: ProgressCallback | bool | None = None
) -> Comparison:
    """Weigh the hypotheses of cases that hold the same data against each other.

    They are weighed by what a run of each case is analysed as, see `jointbayes.sample`: measured FRFs by the modes that
    they show, with the error of the model; of several cases by the modes that all of them have a place for.

    Parameters
    ----------
    cases
        Cases, or paths of their files, each with its list of hypotheses.
    seed
        Seed of all random numbers; by default the first case's.
    progress
        Called before each candidate.

    Returns
    -------
    Comparison
        ``.best``, ``.verdict``, ``.candidates``, ``.summary()``.

    Raises
    ------
    CaseError
        If there is no case, two have the same name, or they do not hold the same data.

    References
    ----------
    Kass, R. E., Raftery, A. E. (1995). Bayes factors. Journal of the American Statistical Association 90(430),
    773-795. DOI 10.1080/01621459.1995.10476572
    """
    given = [require_case(case) for case in cases]
    require_same_data(given)
    seed = given[0].spec.sampling.seed if seed is None else seed
    tell, began = callback_of(progress), time.monotonic()
    answered = _answered(given, seed, tell)
    pairs = [(case, hypothesis) for case in given for hypothesis in case.spec.compare.hypotheses]
    candidates: list[WeighedModel] = []
    for done, (case, hypothesis) in enumerate(pairs):
        text, elapsed = f"now {hypothesis} in {case.name}", time.monotonic() - began
        tell(Progress("weighing", text, done=done, total=len(pairs), unit="candidates", elapsed_seconds=elapsed))
        try:
            candidates.append(_candidate(case, answered[case.name], hypothesis, seed))
        except CaseError:
            raise
        except JointBayesError as error:
            raise CaseError(f"{case.name}, {hypothesis}: {error}") from error
    return Comparison(tuple(candidates), seed, data_sha256(given[0].problem), {case.name: case.text for case in given})


def require_same_data(cases: Sequence[Case]) -> None:
    """Refuse cases whose evidences could not be compared.

    Raises
    ------
    CaseError
        If there is no case, two have the same name, or they do not hold the same data.
    """
    if not cases:
        raise CaseError("compare: found no case; expected one or more; name them")
    names = [case.name for case in cases]
    for i, case in enumerate(cases):
        if case.name in names[:i]:
            raise CaseError(f"compare: found two cases named {case.name}; expected each once; rename one of the files")
        if _data_of(case.problem) != _data_of(cases[0].problem):
            raise CaseError(
                f"compare: found other data in {case.name} than in {cases[0].name}; expected the same, because "
                "evidences of different data cannot be compared; give both the same [data]"
            )


def _data_of(problem: Problem) -> tuple[object, ...]:
    layouts = ((test.name, test.residual_kind, test.data.frfs and test.data.frfs.layout) for test in problem.tests)
    return data_sha256(problem), *layouts


def _answered(cases: Sequence[Case], seed: int, tell: ProgressCallback) -> dict[str, Problem]:
    """What each case is analysed as, by its name: of measured FRFs the modes that all cases have a place for."""
    answered = {case.name: answered_case(case, seed, tell) for case in cases}
    each = [{mode.resonance for mode in problem.premises.modes} for problem in answered.values()]
    if len({bool(used) for used in each}) > 1:
        by = ", ".join(f"{name} by {'modes' if p.premises.of_modes else 'its FRFs'}" for name, p in answered.items())
        raise CaseError(
            f"compare: found cases that are analysed by other data: {by}; expected the same, because evidences of "
            "different data cannot be compared; state the same [uncertain.model_error] in all"
        )
    shared = set.intersection(*each)
    return {name: problem if used == shared else only_modes(problem, shared)
            for (name, problem), used in zip(answered.items(), each, strict=True)}  # fmt: skip


def _candidate(case: Case, answered: Problem, hypothesis: str, seed: int) -> WeighedModel:
    # one stream for each candidate, whatever else is compared
    rng = np.random.default_rng([seed, *case.name.encode(), 256 + list(HYPOTHESES).index(hypothesis)])
    problem = hypothesis_problem(answered, hypothesis)
    starts: tuple[Start, ...] = ()
    mode = np.empty(0)
    if problem.names:
        estimate = find_map(problem, seed=seed)
        starts, mode = estimate.starts_for_draws, estimate.theta
    result = evidence(problem.log_posterior, coordinate_systems(problem), starts, rng)
    if not np.isfinite(result.log_z):
        raise ModelError("found a likelihood of zero everywhere; expected a joint that the data allow; leave it out")
    draws = np.empty((_KEPT, 0)) if result.draws is None else result.draws.resample(rng, _KEPT)
    efficiency = 1.0 if result.draws is None else min(1.0, result.ess / _KEPT)
    loo, note = None, ""
    try:
        loo = leave_one_out(problem, draws, efficiency)
    except ModelError as error:
        note = str(error)
    return WeighedModel(
        case.name,
        case.title,
        hypothesis,
        problem.names,
        problem.prior.values(mode),
        result,
        _piled_up(problem.prior, draws),
        loo,
        note,
        problem.quantities,
    )


def _piled_up(prior: JointPrior, draws: Array) -> tuple[PriorEdge, ...]:
    """Edges with more than twice the probability nearby that the prior has there."""
    low, high = prior.support
    edges = []
    for i, (name, marginal) in enumerate(zip(prior.names, prior.all_marginals, strict=True)):
        if not np.isfinite(marginal.support).all():
            continue
        place = (draws[:, i] - low[i]) / (high[i] - low[i])
        shares = {"low": float((place < _EDGE).mean()), "high": float((place > 1 - _EDGE).mean())}
        below, within = marginal.cdf(low[i] + np.array([_EDGE, 1 - _EDGE]) * (high[i] - low[i])).tolist()
        before = {"low": max(below, _EDGE), "high": max(1 - within, _EDGE)}
        edges += [PriorEdge(name, side, share) for side, share in shares.items() if share > _PILED * before[side]]
    return tuple(edges)
