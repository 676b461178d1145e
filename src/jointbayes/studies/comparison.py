"""What a comparison of joints found: evidence and cross-validation of each candidate, and the best of them."""

import math
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.inference import Problem
from jointbayes.joint import COUPLED, RIGID, Quantity
from jointbayes.posterior import package_versions
from jointbayes.posterior.evidence import PARETO_LIMIT, Evidence
from jointbayes.posterior.storage import loo_pointwise

_FEWEST = 30  # values that a standard error of a sum can be taken from
_MOST_NUMBERS = 5_000_000  # log densities in memory at once
_FEWEST_DRAWS = 200


@dataclass(frozen=True, slots=True, eq=False)
class LeaveOneOut:
    """Expected log density of each measured value given all the others.

    Parameters
    ----------
    elpd_i
        ln p(value | others), shape (values,).
    pareto_k
        Shape of each value's importance weights, shape (values,): above about 0.7 its figure is not to be trusted.
    """

    elpd_i: Array
    pareto_k: Array

    @property
    def elpd(self) -> float:
        """Sum over the values: larger is better."""
        return float(self.elpd_i.sum())

    @property
    def se(self) -> float:
        """Standard error of the sum."""
        return _se_of_sum(self.elpd_i)

    def difference(self, other: "LeaveOneOut") -> tuple[float, float]:
        """Own sum less the other's, with the standard error of this difference, from the differences value by value."""
        each = self.elpd_i - other.elpd_i
        return float(each.sum()), _se_of_sum(each)


def leave_one_out(problem: Problem, theta: Array, efficiency: float) -> LeaveOneOut:
    """Cross-validate from posterior draws by Pareto-smoothed importance sampling (ArviZ).

    Each complex value of each line and FRF counts as one.

    Parameters
    ----------
    problem
        The problem.
    theta
        Posterior draws, shape (n, d); those beyond what fits into memory are left out evenly.
    efficiency
        Effective draws over draws, above 0 and at most 1.

    Raises
    ------
    ModelError
        Where values are too few, or not independent given the joint: the message says which.

    References
    ----------
    Vehtari, A., Gelman, A., Gabry, J. (2017). Practical Bayesian model evaluation using leave-one-out cross-validation
    and WAIC. Statistics and Computing 27(5), 1413-1432. DOI 10.1007/s11222-016-9696-4
    """
    likelihood = problem.log_posterior.likelihood
    others = [test.data.words for test in problem.tests if test.data.frfs is None]
    if others or likelihood.n_data < _FEWEST:
        mixed = [f"values, {words} among them" if len(problem.tests) > 1 else words for words in others]
        kind = mixed[0] if others else "values of FRFs"
        raise ModelError(
            f"found {likelihood.n_data} {kind}, too few for cross-validation; expected {_FEWEST} or more values of FRFs"
        )
    most = max(_FEWEST_DRAWS, _MOST_NUMBERS // likelihood.n_data)
    rows = np.linspace(0, len(theta) - 1, min(most, len(theta))).round().astype(int)
    chosen = theta[rows]
    values = problem.log_posterior.pointwise(chosen)
    flat = values.reshape(len(chosen), -1)
    if (flat == flat[0]).all():  # nothing is uncertain: leaving a value out changes nothing
        return LeaveOneOut(flat[0], np.zeros(flat.shape[1]))
    return LeaveOneOut(*loo_pointwise(flat, efficiency))


def _se_of_sum(each: Array) -> float:
    return float(math.sqrt(each.size) * each.std())


#: Ends of 2 ln B, and evidence up to there in the words of Kass and Raftery.
GRADES = (
    (2.0, "not worth more than a bare mention"),
    (6.0, "positive"),
    (10.0, "strong"),
)
_STRONGEST = "very strong"


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
class WeighedModel:
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
        Quantities of the joint at the posterior mode, shape (q,); `jointbayes.joint.RIGID` stands for a motion that is
        held.
    evidence
        ln Z of the data with its error, and how it was found.
    at_edge
        Edges of the prior that the posterior piles up on: there ln Z depends on where the prior ends.
    loo
        Cross-validation; None where it makes no sense, and `loo_note` says why.
    quantities
        What the numbers of `stiffness` are.
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
    quantities: tuple[Quantity, ...] = COUPLED

    @property
    def label(self) -> str:
        """Hypothesis and case in words."""
        return f"{self.hypothesis} in {self.case}"

    @property
    def trusted(self) -> bool:
        """Whether the stated error of the evidence may be believed."""
        return not self.evidence.pareto_k > PARETO_LIMIT  # without importance weights k is no number


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

    candidates: tuple[WeighedModel, ...]
    seed: int
    data_sha256: str

    @property
    def best(self) -> WeighedModel:
        """The candidate of the largest evidence."""
        return max(self.candidates, key=lambda c: c.evidence.log_z)

    @property
    def ranking(self) -> tuple[WeighedModel, ...]:
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

    def two_log_b(self, candidate: WeighedModel) -> float:
        """2 ln B of the best against a candidate: 0 for the best itself."""
        return 2 * (self.best.evidence.log_z - candidate.evidence.log_z)

    def words(self, candidate: WeighedModel) -> str:
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
            text += f" Its posterior accumulates at an edge of the prior of {edges}: there ln Z depends on the prior."
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

    def _row(self, candidate: WeighedModel, probability: float) -> dict[str, Any]:
        z = candidate.evidence
        held = [bool(k == RIGID) for k in candidate.stiffness]
        names = [quantity.name for quantity in candidate.quantities]
        stiffness = zip(names, candidate.stiffness.tolist(), held, strict=True)
        return {
            "case": candidate.case,
            "title": candidate.title,
            "hypothesis": candidate.hypothesis,
            "parameters": list(candidate.names),
            "map": {name: None if rigid else value for name, value, rigid in stiffness},
            "rigid": [name for name, rigid in zip(names, held, strict=True) if rigid],
            "units": {quantity.name: quantity.unit for quantity in candidate.quantities},
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
            "at_prior_edge": [asdict(edge) for edge in candidate.at_edge],
            "loo": self._loo(candidate),
            "loo_note": candidate.loo_note,
        }

    def _loo(self, candidate: WeighedModel) -> dict[str, Any] | None:
        if candidate.loo is None:
            return None
        estimates = [c.loo for c in self.candidates if c.loo is not None]
        best = max(estimates, key=lambda loo: loo.elpd)
        difference, se = candidate.loo.difference(best)
        return {
            "elpd": candidate.loo.elpd,
            "se": candidate.loo.se,
            "difference": difference,
            "difference_se": se,
            "pareto_k_max": _finite(float(candidate.loo.pareto_k.max())),
            "pareto_k_above_0.7": int((candidate.loo.pareto_k > PARETO_LIMIT).sum()),
        }


def _log_z_text(evidence: Evidence) -> str:
    value = f"{evidence.log_z:.2f}".replace("-", "−")
    return value if evidence.method == "exact" else f"{value} ± {evidence.error:.1g}"


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def bayes_factor_words(two_log_b: float) -> str:
    """Grade of the evidence for the better of two models, from twice the natural logarithm of the Bayes factor.

    Parameters
    ----------
    two_log_b
        2 ln B = 2 (ln Z of the better − ln Z of the other), not negative.

    References
    ----------
    Kass, R. E., Raftery, A. E. (1995). Bayes factors. Journal of the American Statistical Association 90(430),
    773-795, section 3.2. DOI 10.1080/01621459.1995.10476572

    Examples
    --------
    >>> bayes_factor_words(0.6), bayes_factor_words(7.2)
    ('not worth more than a bare mention', 'strong')
    """
    return next((words for limit, words in GRADES if two_log_b <= limit), _STRONGEST)


def model_probabilities(log_z: ArrayLike) -> Array:
    """Posterior probability of each model under equal prior probability, shape (n,), from ln Z, shape (n,).

    Examples
    --------
    >>> model_probabilities(np.log([3.0, 1.0])).round(3).tolist()
    [0.75, 0.25]
    """
    values = np.asarray(log_z, dtype=float)
    weight = np.exp(values - values.max())
    return weight / weight.sum()
