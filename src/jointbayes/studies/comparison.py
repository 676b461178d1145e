"""One hypothesis about the joint in one case: its evidence, its cross-validation, and the words for either."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from jointbayes.errors import ModelError
from jointbayes.inference import Problem
from jointbayes.joint import COUPLED, Quantity
from jointbayes.posterior.evidence import PARETO_LIMIT, Evidence
from jointbayes.posterior.storage import loo_pointwise
from vibrecords.arrays import Array

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
        raise ModelError(f"it needs {_FEWEST} values of FRFs; there are {likelihood.n_data} {kind}")
    most = max(_FEWEST_DRAWS, _MOST_NUMBERS // likelihood.n_data)
    chosen = theta[np.linspace(0, len(theta) - 1, min(most, len(theta))).round().astype(int)]
    flat = problem.log_posterior.pointwise(chosen).reshape(len(chosen), -1)
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
    return np.asarray(special.softmax(np.asarray(log_z, dtype=float)))
