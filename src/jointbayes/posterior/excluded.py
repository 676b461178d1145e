"""Whether the data exclude a joint that is rigid, absent or uncoupled, where stiffnesses are known by bounds at most.

Bounds on each stiffness say little of all together: "k11 above, k22 above" may be read as a rigid joint that the same
data exclude. So each such joint is put in place of the one that was sampled, and everything else fitted anew: other
joints within their priors, uncertain quantities with theirs. Twice the logarithm of the likelihood ratio is compared
with the χ² quantile at 99.9 %, with as many degrees of freedom as stiffnesses are given up (Wilks 1938); where a
stiffness is given up at an end of its range that is on the safe side (Self and Liang 1987).

References
----------
Wilks, S. S. (1938). Annals of Mathematical Statistics 9(1), 60-62. DOI 10.1214/aoms/1177732360
Self, S. G., Liang, K.-Y. (1987). Journal of the American Statistical Association 82(398), 605-610.
DOI 10.2307/2289471
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import chdtri

from jointbayes.arrays import Array
from jointbayes.joint.parametrisation import RIGID
from jointbayes.posterior.identifiability import CERTAINTY
from jointbayes.posterior.rounding import likelihood_ratio
from jointbayes.posterior.verdicts import JudgedPosterior

#: Probability that the likelihood ratio of a joint that is so exceeds the limit.
LEVEL = 1e-3
_TRIED = 100  # draws of the run among which a first point is looked for
_REACH = 30.0  # standard deviations of the draws, within which is searched
_STEP = 1e-4  # of a standard deviation of the draws, for differences
_LARGEST = 1e9  # of a ratio
_WORST = -1e250  # in place of ln L = −∞, for the search


@dataclass(frozen=True, slots=True)
class SimplerJoint:
    """A joint that is rigid, absent or uncoupled, against the one that was sampled.

    Parameters
    ----------
    joint
        Its name; empty where there is one.
    kind
        What it would be.
    ratio
        2 ln of the greatest likelihood over that of the best such joint.
    limit
        What that of a joint which is so exceeds once in 1000.
    """

    joint: str
    kind: Literal["rigid", "absent", "uncoupled"]
    ratio: float
    limit: float

    @property
    def excluded(self) -> bool:
        """Whether the data exclude it."""
        return self.ratio > self.limit


def known_by_bounds(posterior: JudgedPosterior) -> tuple[str, ...]:
    """Joints of which most stiffnesses are neither identified nor weakly identified, by name; none without verdicts.

    One that is not identified only because solutions differ in it is known by more than bounds.
    """
    verdicts: dict[str, list[str]] = {}
    for quantity in posterior.problem.quantities:
        if quantity.role == "stiffness" and quantity.name not in posterior.solutions.split:
            verdict = posterior.identifiability(quantity.name).verdict
            verdicts.setdefault(quantity.name.rpartition(".")[0], []).append(verdict)
    if any("no verdict" in each for each in verdicts.values()):
        return ()
    return tuple(name for name, each in verdicts.items() if 2 * sum(v in CERTAINTY for v in each) < len(each))


def simpler_joints(posterior: JudgedPosterior) -> tuple[SimplerJoint, ...]:
    """Rigid, absent and uncoupled joints in place of each that is known by bounds at most; none of damped joints."""
    problem = posterior.problem
    if problem.parametrisation.damped or problem.extra_log_likelihood is not None:
        return ()
    simpler = []
    modes = [posterior.estimate.theta, posterior.mode_theta, *(mode.theta for mode in posterior.estimate.modes[1:])]
    theta = np.vstack([*modes, posterior.thinned(_TRIED)])
    for joint in known_by_bounds(posterior):
        rows = [i for i, q in enumerate(problem.quantities) if q.name.rpartition(".")[0] == joint]
        couplings = [i for i in rows if problem.quantities[i].may_be_negative]
        springs = [i for i in rows if i not in couplings]
        best = float(_log_likelihood(posterior, theta, {}).max())
        values: list[tuple[Literal["rigid", "absent", "uncoupled"], dict[int, float]]] = [
            ("rigid", dict.fromkeys(springs, RIGID) | dict.fromkeys(couplings, 0.0)),
            ("absent", dict.fromkeys(rows, 0.0)),
        ]
        values += [("uncoupled", dict.fromkeys(couplings, 0.0))] if couplings else []
        for kind, put in values:
            worse = 2 * (best - _greatest(posterior, put, theta))
            limit = float(chdtri(len(put), LEVEL))
            simpler.append(SimplerJoint(joint, kind, float(np.clip(worse, 0.0, _LARGEST)), limit))
    return tuple(simpler)


def exclusion_sentences(joints: tuple[SimplerJoint, ...]) -> tuple[str, ...]:
    """What is excluded and what is not, joint by joint; empty without any."""
    sentences = []
    for name in dict.fromkeys(simpler.joint for simpler in joints):
        what = f"joint {name}" if name else "the joint"
        for excluded, words in ((True, "rule out"), (False, "do not rule out")):
            of_it = [joint for joint in joints if (joint.joint, joint.excluded) == (name, excluded)]
            kinds = [f"{joint.kind} ({likelihood_ratio(joint.ratio)} times less likely)" for joint in of_it]
            if kinds:
                sentences.append(f"The data {words} that {what} is {' or '.join(kinds)}.")
    return tuple(sentences)


def _log_likelihood(posterior: JudgedPosterior, theta: Array, put: dict[int, float]) -> Array:
    """ln L with these stiffnesses in place of those of θ, shape (n,), and the prior of uncertain quantities."""
    problem = posterior.problem
    prior = problem.prior
    stiffness = prior.values(theta)
    for column, value in put.items():
        stiffness[:, column] = value
    matrix = problem.parametrisation.matrix(stiffness)
    total = np.array(problem.log_posterior.likelihood.log_likelihood(matrix, prior.factors(theta)))
    first = len(prior.marginals)
    for i, marginal in enumerate(prior.all_marginals[first:], first):
        total += marginal.log_density(theta[:, i])
    return np.where(np.isfinite(total), total, _WORST)


def _greatest(posterior: JudgedPosterior, put: dict[int, float], theta: Array) -> float:
    """The greatest of it within the priors, searched for from the best of these points about each mode."""
    tried = _log_likelihood(posterior, theta, put)
    if np.ptp(tried) <= 1e-9 * max(1.0, abs(float(tried.max()))):
        return float(tried.max())  # nothing else matters
    starts, nearest = posterior.estimate.starts_for_draws, posterior.solutions.nearest(theta)
    greatest = [float(tried.max())]
    for mode, (_, covariance) in enumerate(starts):
        about = np.where(nearest == mode, tried, -np.inf)
        spread = theta.std(axis=0) if len(starts) == 1 else np.sqrt(np.diag(covariance))
        greatest.append(_climbed(posterior, put, theta[int(about.argmax())], np.maximum(spread, 1e-8)))
    return max(greatest)


def _climbed(posterior: JudgedPosterior, put: dict[int, float], start: Array, scale: Array) -> float:
    """The greatest of it that a climb from one point, shape (d,), reaches in steps of this scale, shape (d,)."""
    from scipy.optimize import minimize

    low, high = np.array([marginal.support for marginal in posterior.problem.prior.all_marginals]).T
    bounds = list(zip(*(np.clip((end - start) / scale, -_REACH, _REACH).tolist() for end in (low, high)), strict=True))
    steps = _STEP * np.vstack([np.eye(len(start)), -np.eye(len(start))])

    def cost(x: Array) -> tuple[float, Array]:
        points = np.clip(start + scale * np.vstack([x, x + steps]), low, high)
        values = _log_likelihood(posterior, points, put)
        up, down = np.split(values[1:], 2)
        return -float(values[0]), -(up - down) / (2 * _STEP)

    return -float(minimize(cost, np.zeros(len(start)), jac=True, method="L-BFGS-B", bounds=bounds).fun)
