"""Which joint, and which case, explains the data best: the evidence of each hypothesis."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointbayes.case import Case
from jointbayes.errors import CaseError, JointBayesError, ModelError
from jointbayes.inference import JointPrior, Problem
from jointbayes.inference.likelihood import FrfLikelihood
from jointbayes.joint import RIGID, STIFFNESS_NAMES, PlainSprings
from jointbayes.measurement import FrfMeasurement
from jointbayes.posterior import data_sha256
from jointbayes.posterior.bayes_factors import bayes_factor_words, model_probabilities
from jointbayes.posterior.evidence import PARETO_LIMIT, Evidence, evidence
from jointbayes.posterior.leave_one_out import LeaveOneOut, leave_one_out
from jointbayes.sampling import Start
from jointbayes.workflow import charts, find_map, package_versions, starts_of

__all__ = ["HYPOTHESES", "Candidate", "Comparison", "PriorEdge", "compare", "under"]

Array = NDArray[np.float64]

#: Springs that yield under each hypothesis; None is the case's own joint with coupling.
HYPOTHESES: dict[str, tuple[str, ...] | None] = {
    "rigid": (),
    "translation": ("k11",),
    "rotation": ("k22",),
    "springs": ("k11", "k22"),
    "full": None,
}

_KEPT = 2000  # posterior draws, for what the evidence does not need
_EDGE = 0.05  # of a prior's interval
_PILED = 2.0  # times the prior's probability in that strip


@dataclass(frozen=True, slots=True)
class PriorEdge:
    """A prior's edge that the posterior piles up on.

    Parameters
    ----------
    name
        Coordinate.
    side
        ``"low"`` or ``"high"``.
    probability
        Posterior probability of the outer 5 % of the prior's interval.
    """

    name: str
    side: str
    probability: float


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """One hypothesis about the joint in one case.

    Parameters
    ----------
    case, title
        Name and title of the case.
    hypothesis
        One of `HYPOTHESES`.
    names
        Coordinates, those of nuisances included.
    stiffness
        (k11, k12, k22) at the posterior mode, shape (3,); `jointbayes.joint.RIGID` stands for a motion that is held.
    evidence
        ln Z of the data with its error, and how it was found.
    at_edge
        Edges of the prior that the posterior piles up on: there ln Z depends on where the prior ends.
    loo
        Cross-validation; None where it makes no sense, and `loo_note` says why.
    """

    case: str
    title: str
    hypothesis: str
    names: tuple[str, ...]
    stiffness: Array
    evidence: Evidence
    at_edge: tuple[PriorEdge, ...]
    loo: LeaveOneOut | None
    loo_note: str

    @property
    def label(self) -> str:
        """Hypothesis and case in words."""
        return f"{self.hypothesis} in {self.case}"

    @property
    def trusted(self) -> bool:
        """Whether the stated error of the evidence may be believed."""
        return self.evidence.method != "importance" or self.evidence.pareto_k <= PARETO_LIMIT


@dataclass(frozen=True, slots=True)
class Comparison:
    """Candidates for the same data.

    Parameters
    ----------
    candidates
        One for each case and hypothesis, in the order of the cases.
    seed
        Seed of all random numbers.
    data_sha256
        Fingerprint of the data that all share.
    """

    candidates: tuple[Candidate, ...]
    seed: int
    data_sha256: str

    @property
    def best(self) -> Candidate:
        """The candidate of the largest evidence."""
        return max(self.candidates, key=lambda c: c.evidence.log_z)

    @property
    def ranking(self) -> tuple[Candidate, ...]:
        """All candidates, the best first."""
        return tuple(sorted(self.candidates, key=lambda c: -c.evidence.log_z))

    @property
    def probabilities(self) -> Array:
        """Posterior probability of each candidate, shape (candidates,), if all were equally probable before."""
        return model_probabilities([c.evidence.log_z for c in self.candidates])

    @property
    def trusted(self) -> bool:
        """Whether every evidence's error may be believed."""
        return all(c.trusted for c in self.candidates)

    def two_log_b(self, candidate: Candidate) -> float:
        """2 ln B of the best against a candidate: 0 for the best itself."""
        return 2 * (self.best.evidence.log_z - candidate.evidence.log_z)

    def words(self, candidate: Candidate) -> str:
        """Evidence for the best against a candidate in the words of Kass and Raftery; ``"best"`` for itself."""
        return "best" if candidate is self.best else bayes_factor_words(self.two_log_b(candidate))

    @property
    def verdict(self) -> str:
        """One plain sentence, or two, that name the winner."""
        best, *others = self.ranking
        z = best.evidence
        text = f"The data favour {best.label}: ln Z = {_log_z_text(z)}."
        if others:
            two_log_b = self.two_log_b(others[0])
            text += f" The evidence against the next, {others[0].label}, is {bayes_factor_words(two_log_b)}"
            text += f" (2 ln B = {two_log_b:.1f})."
        else:
            text += " It is the only one: nothing was compared."
        if best.at_edge:
            edges = ", ".join(dict.fromkeys(edge.name for edge in best.at_edge))
            text += f" Its posterior piles up on an edge of the prior of {edges}: there ln Z depends on the prior."
        return text

    def summary(self) -> dict[str, Any]:
        """The numbers, as in ``compare.json``."""
        rows = zip(self.candidates, self.probabilities, strict=True)
        return {
            "verdict": self.verdict,
            "trusted": self.trusted,
            "seed": self.seed,
            "data_sha256": self.data_sha256,
            "best": {"case": self.best.case, "hypothesis": self.best.hypothesis},
            "candidates": [self._row(candidate, float(probability)) for candidate, probability in rows],
            "versions": package_versions(),
        }

    def _row(self, candidate: Candidate, probability: float) -> dict[str, Any]:
        z = candidate.evidence
        held = [bool(k == RIGID) for k in candidate.stiffness]
        stiffness = zip(STIFFNESS_NAMES, candidate.stiffness.tolist(), held, strict=True)
        return {
            "case": candidate.case,
            "title": candidate.title,
            "hypothesis": candidate.hypothesis,
            "parameters": list(candidate.names),
            "map": {name: None if rigid else value for name, value, rigid in stiffness},
            "rigid": [name for name, rigid in zip(STIFFNESS_NAMES, held, strict=True) if rigid],
            "log_z": z.log_z,
            "log_z_error": z.error,
            "method": z.method,
            "pareto_k": _finite(z.pareto_k),
            "ess": _finite(z.ess),
            "evaluations": z.evaluations,
            "trusted": candidate.trusted,
            "two_log_b": self.two_log_b(candidate),
            "words": self.words(candidate),
            "probability": probability,
            "at_prior_edge": [{"name": e.name, "side": e.side, "probability": e.probability} for e in candidate.at_edge],
            "loo": self._loo(candidate),
            "loo_note": candidate.loo_note,
        }

    def _loo(self, candidate: Candidate) -> dict[str, Any] | None:
        if candidate.loo is None:
            return None
        known = [c.loo for c in self.candidates if c.loo is not None]
        best = max(known, key=lambda loo: loo.elpd)
        difference, se = candidate.loo.difference(best)
        return {
            "elpd": candidate.loo.elpd,
            "se": candidate.loo.se,
            "difference": difference,
            "difference_se": se,
            "pareto_k_max": _finite(float(candidate.loo.pareto_k.max())),
            "pareto_k_above_0.7": int((candidate.loo.pareto_k > PARETO_LIMIT).sum()),
        }


def under(problem: Problem, hypothesis: str) -> Problem:
    """The problem with the joint that a hypothesis allows; priors of what stays free are as they were.

    Parameters
    ----------
    problem
        Problem with the full joint.
    hypothesis
        One of `HYPOTHESES`.

    Raises
    ------
    ModelError
        If there is no such hypothesis.
    """
    if hypothesis not in HYPOTHESES:
        raise ModelError(f"comparison: found hypothesis {hypothesis!r}; expected one of {', '.join(HYPOTHESES)}")
    springs = HYPOTHESES[hypothesis]
    if springs is None:
        return problem
    known = dict(zip(problem.parametrisation.names, problem.prior.marginals, strict=True))
    marginals = tuple(known[name] for name in springs)
    return replace(problem, prior=replace(problem.prior, parametrisation=PlainSprings(springs), marginals=marginals))


def compare(
    cases: Sequence[Case], seed: int | None = None, progress: Callable[[str], None] | None = None
) -> Comparison:
    """Weigh the hypotheses of cases that hold the same data against each other.

    Parameters
    ----------
    cases
        Cases, each with its list of hypotheses.
    seed
        Seed of all random numbers; by default the first case's.
    progress
        Told which candidate is next.

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
    require_same_data(cases)
    seed = cases[0].spec.sampling.seed if seed is None else seed
    candidates = []
    for case in cases:
        for hypothesis in case.spec.compare.hypotheses:
            if progress is not None:
                progress(f"{hypothesis} in {case.name}")
            try:
                candidates.append(_candidate(case, hypothesis, seed))
            except CaseError:
                raise
            except JointBayesError as error:
                raise CaseError(f"{case.name}, {hypothesis}: {error}") from error
    return Comparison(tuple(candidates), seed, data_sha256(cases[0].problem.measurement))


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
    measured = problem.measurement
    if not isinstance(measured, FrfMeasurement):
        return (data_sha256(measured),)
    frf = measured.frf
    return data_sha256(measured), frf.outputs, frf.inputs, frf.quantity, problem.residual_kind


def _candidate(case: Case, hypothesis: str, seed: int) -> Candidate:
    # one stream for each candidate, whatever else is compared
    key = [seed, *case.name.encode(), 256 + list(HYPOTHESES).index(hypothesis)]
    rng = np.random.default_rng(key)
    problem = under(case.problem, hypothesis)
    log_posterior = problem.log_posterior
    starts: tuple[Start, ...] = ()
    mode = np.empty(0)
    if problem.names:
        estimate = find_map(replace(case, problem=problem), seed=seed)
        starts, mode = starts_of(estimate), estimate.theta
    found = evidence(log_posterior, charts(problem), starts, rng)
    if not np.isfinite(found.log_z):
        raise ModelError("found a likelihood of zero everywhere; expected a joint that the data allow; leave it out")
    draws = np.empty((_KEPT, 0)) if found.draws is None else found.draws.resample(rng, _KEPT)
    efficiency = 1.0 if found.draws is None else min(1.0, found.ess / _KEPT)
    loo, note = _cross_validated(problem, draws, efficiency)
    return Candidate(
        case.name,
        case.title,
        hypothesis,
        problem.names,
        problem.prior.stiffness(mode),
        found,
        _piled_up(problem.prior, draws),
        loo,
        note,
    )


def _cross_validated(problem: Problem, draws: Array, efficiency: float) -> tuple[LeaveOneOut | None, str]:
    likelihood = problem.log_posterior.likelihood
    if isinstance(likelihood, FrfLikelihood) and "discrepancy_scale" in problem.names:
        return None, "left out: the noise model correlates the residuals"
    try:
        return leave_one_out(problem, draws, efficiency), ""
    except ModelError as error:
        return None, f"left out: {error}"


def _piled_up(prior: JointPrior, draws: Array) -> tuple[PriorEdge, ...]:
    """Edges with more than twice the probability nearby that the prior has there."""
    low, high = prior.support
    found = []
    for i, (name, marginal) in enumerate(zip(prior.names, prior.all_marginals, strict=True)):
        if not np.isfinite(marginal.support).all():
            continue
        place = (draws[:, i] - low[i]) / (high[i] - low[i])
        shares = {"low": float((place < _EDGE).mean()), "high": float((place > 1 - _EDGE).mean())}
        found += [PriorEdge(name, side, share) for side, share in shares.items() if share > _PILED * _EDGE]
    return tuple(found)


def _log_z_text(evidence: Evidence) -> str:
    value = f"{evidence.log_z:.2f}".replace("-", "−")
    return value if evidence.method == "exact" else f"{value} ± {evidence.error:.1g}"


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
