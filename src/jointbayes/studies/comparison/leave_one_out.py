"""How well a model predicts each measured value from all the others: leave-one-out cross-validation."""

import math
from dataclasses import dataclass

import numpy as np

from jointbayes.arrays import Array
from jointbayes.errors import ModelError
from jointbayes.inference import Problem
from jointbayes.measurement import FrfMeasurement
from jointbayes.posterior.arviz_bridge import loo_pointwise

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
    frfs = all(isinstance(part.measurement, FrfMeasurement) for part in problem.parts)
    if not frfs or likelihood.n_data < _FEWEST:
        mixed = "values, natural frequencies among them" if problem.setups else "natural frequencies"
        kind = "values of FRFs" if frfs else mixed
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
