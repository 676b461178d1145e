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

from jointbayes.joint.parametrisation import RIGID
from jointbayes.posterior.any_posterior import AnyPosterior
from jointbayes.posterior.identifiability import CERTAINTY
from jointbayes.posterior.limits import LikelihoodRegion
from jointbayes.rounding import likelihood_ratio

#: Probability that the likelihood ratio of a joint that is so exceeds the limit.
LEVEL = 1e-3
_TRIED = 100  # draws of the run from the best of which is climbed
_LARGEST = 1e9  # of a ratio


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


def known_by_bounds(posterior: AnyPosterior) -> tuple[str, ...]:
    """Joints of which most stiffnesses are neither identified nor weakly identified, by name; none without verdicts.

    One that is not identified only because solutions differ in it is known by more than bounds.
    """
    verdicts: dict[str, list[str]] = {}
    for quantity in posterior.problem.quantities:
        if quantity.role == "stiffness" and quantity.name not in posterior.solutions.split:
            verdict = posterior.verdict(quantity.name).verdict
            verdicts.setdefault(quantity.name.rpartition(".")[0], []).append(verdict)
    if any("no verdict" in each for each in verdicts.values()):
        return ()
    return tuple(name for name, each in verdicts.items() if 2 * sum(v in CERTAINTY for v in each) < len(each))


def simpler_joints(posterior: AnyPosterior) -> tuple[SimplerJoint, ...]:
    """Rigid, absent and uncoupled joints in place of each that is known by bounds at most; none of damped joints."""
    problem = posterior.problem
    if problem.parametrisation.damped or problem.extra_log_likelihood is not None:
        return ()
    simpler = []
    modes = [posterior.estimate.theta, posterior.mode_theta, *(mode.theta for mode in posterior.estimate.modes[1:])]
    theta = np.vstack([*modes, posterior.thinned(_TRIED)])
    solution = posterior.solutions.nearest(theta)

    def greatest(put: dict[int, float]) -> float:
        return LikelihoodRegion(problem.log_posterior, theta, solution, put).greatest

    joints = known_by_bounds(posterior)
    if not joints:
        return ()
    best = greatest({})
    for joint in joints:
        rows = [i for i, q in enumerate(problem.quantities) if q.name.rpartition(".")[0] == joint]
        couplings = [i for i in rows if problem.quantities[i].may_be_negative]
        springs = [i for i in rows if i not in couplings]
        values: list[tuple[Literal["rigid", "absent", "uncoupled"], dict[int, float]]] = [
            ("rigid", dict.fromkeys(springs, RIGID) | dict.fromkeys(couplings, 0.0)),
            ("absent", dict.fromkeys(rows, 0.0)),
        ]
        values += [("uncoupled", dict.fromkeys(couplings, 0.0))] if couplings else []
        for kind, put in values:
            worse = 2 * (best - greatest(put))
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
