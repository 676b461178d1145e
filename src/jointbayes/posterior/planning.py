"""What to measure next: further measurements ranked by the information that they add.

Measurements that are independent given the parameters add their Fisher information, so that a set of candidates is a
sum of matrices. This is exact for a Gaussian posterior about a known point; `jointbayes.posterior.planning_check` asks
simulated data whether it holds.

References
----------
Lindley, D. V. (1956). On a measure of the information provided by an experiment. Annals of Mathematical Statistics
27(4), 986-1005. DOI 10.1214/aoms/1177728069
Chaloner, K., Verdinelli, I. (1995). Bayesian experimental design: a review. Statistical Science 10(3), 273-304.
DOI 10.1214/ss/1177009939 (½ ln det as the gain of a linear Gaussian model)
Papadimitriou, C. (2004). Optimal sensor placement methodology for parametric identification of structural systems.
Journal of Sound and Vibration 278, 923-947. DOI 10.1016/j.jsv.2003.10.063 (sequential choice of a set)
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import ModelError
from jointbayes.inference import Problem
from jointbayes.posterior.candidates import Candidate
from jointbayes.posterior.directions import spread_in_words, verdict_of
from jointbayes.posterior.fisher import FisherInformation, fisher_information
from jointbayes.posterior.identifiability import LEAST_CONTRACTION, Verdict

__all__ = [
    "Criterion",
    "Forecast",
    "choose",
    "forecast",
    "joint_covariance",
    "joint_gain",
    "measurement_information",
    "plan_sentence",
    "sd_of",
    "verdict_on",
]

Array = NDArray[np.float64]
Criterion = Literal["sd", "gain"]

#: Sets are chosen among all there are up to this number, beyond it one by one.
MOST_SETS = 5000


def measurement_information(candidate: Candidate, problem: Problem, theta: ArrayLike) -> Array:
    """Fisher information of a further measurement about θ, shape (d, d), where θ, shape (d,), is the truth.

    JᵀJ of the standardised residuals, for the noise that the candidate's law makes of the model's FRFs there.
    """
    point = np.asarray(theta, dtype=float)
    return fisher_information(candidate.problem(problem, point), point).data


@dataclass(frozen=True, slots=True, eq=False)
class Forecast:
    """What a set of further measurements is expected to do, by Fisher information.

    Parameters
    ----------
    names
        Names of the candidates.
    words
        The same for a sentence.
    gain_nats
        Expected information gain about the joint, ½ ln det Σ_before/det Σ_after, nuisances marginalised.
    sd_before, sd_after
        Standard deviation of ln of the chosen stiffness.
    verdict_before, verdict_after
        On that stiffness, by the rule of `jointbayes.posterior.identifiability`.
    """

    names: tuple[str, ...]
    words: tuple[str, ...]
    gain_nats: float
    sd_before: float
    sd_after: float
    verdict_before: Verdict
    verdict_after: Verdict

    @property
    def gain_bits(self) -> float:
        """Expected information gain in bits."""
        return self.gain_nats / math.log(2)


def forecast(
    fisher: FisherInformation, information: Mapping[str, Array], candidates: Sequence[Candidate], parameter: str
) -> Forecast:
    """Effect of a set of candidates on top of the present information.

    Parameters
    ----------
    fisher
        Present information at a point.
    information
        `measurement_information` of each candidate at the same point, by name.
    candidates
        The set.
    parameter
        ``"k11"``, ``"k12"`` or ``"k22"``.

    Raises
    ------
    ModelError
        If the joint has no such parameter.
    """
    after = _with_more(fisher, [information[c.name] for c in candidates])
    before_sd, after_sd = sd_of(fisher, parameter), sd_of(after, parameter)
    return Forecast(
        tuple(c.name for c in candidates),
        tuple(c.words for c in candidates),
        joint_gain(fisher, after),
        before_sd,
        after_sd,
        verdict_on(fisher, parameter, before_sd),
        verdict_on(fisher, parameter, after_sd),
    )


def choose(
    fisher: FisherInformation,
    information: Mapping[str, Array],
    count: int,
    parameter: str,
    *,
    by: Criterion = "sd",
    exhaustive: bool | None = None,
) -> tuple[str, ...]:
    """Choose a set of candidates.

    Parameters
    ----------
    fisher, information, parameter
        As for `forecast`.
    count
        How many to choose; all if there are fewer.
    by
        Least standard deviation of ln of the parameter, or most information about the joint.
    exhaustive
        Whether to try all sets, rather than adding the best one at a time, which need not find the best set. By default
        where there are at most 5000 sets.

    Returns
    -------
    tuple of str
        Names; in the order of choice if one at a time, in that of `information` otherwise.

    Raises
    ------
    ModelError
        If none is to be chosen, or the joint has no such parameter.
    """
    if count < 1 or not information:
        raise ModelError(f"planning: found {count} of {len(information)} candidates to choose; expected at least one")
    count = min(count, len(information))

    def loss(names: Sequence[str]) -> float:
        after = _with_more(fisher, [information[name] for name in names])
        return sd_of(after, parameter) if by == "sd" else -joint_gain(fisher, after)

    if exhaustive is None:
        exhaustive = math.comb(len(information), count) <= MOST_SETS
    if exhaustive:
        return min(itertools.combinations(information, count), key=loss)
    chosen: tuple[str, ...] = ()
    for _ in range(count):
        chosen = min(((*chosen, name) for name in information if name not in chosen), key=loss)
    return chosen


def _with_more(fisher: FisherInformation, further: Sequence[Array]) -> FisherInformation:
    return replace(fisher, data=sum(further, start=fisher.data.copy()))


def sd_of(fisher: FisherInformation, parameter: str) -> float:
    """Standard deviation of ln of a stiffness, nuisances marginalised; at most the prior's where it has one of its own.

    Raises
    ------
    ModelError
        If the joint's coordinates do not move that stiffness.
    """
    found = fisher.stiffness_sd()
    if parameter not in found:
        raise ModelError(f"planning: found parameter {parameter!r}; expected one of {', '.join(found)}")
    limit = math.inf
    if parameter in fisher.joint_names:
        limit = float(fisher.prior_sd[fisher.names.index(parameter)])
    return min(found[parameter], limit)


def verdict_on(fisher: FisherInformation, parameter: str, sd: float) -> Verdict:
    """Verdict on a stiffness whose logarithm is known to `sd`, its prior regarded where it has one of its own."""
    if parameter in fisher.joint_names:
        prior_sd = float(fisher.prior_sd[fisher.names.index(parameter)])
        if 1 - (sd / prior_sd) ** 2 < LEAST_CONTRACTION:
            return "not identified"
    return verdict_of(sd)


def joint_covariance(fisher: FisherInformation) -> Array:
    """Covariance of the joint's coordinates, shape (p, p), nuisances marginalised.

    A uniform prior counts as a normal one of its standard deviation, so that this is finite whatever the data see.
    """
    p = len(fisher.joint_names)
    weak = np.where(np.diag(fisher.prior) > 0, 0.0, fisher.prior_sd**-2.0)
    root = np.sqrt(np.diag(fisher.data + fisher.prior) + weak)
    scaled = (fisher.data + fisher.prior + np.diag(weak)) / np.outer(root, root)
    covariance: Array = (np.linalg.inv(scaled) / np.outer(root, root))[:p, :p]
    return covariance


def joint_gain(before: FisherInformation, after: FisherInformation) -> float:
    """Information about the joint gained, ½ ln det Σ_before/det Σ_after, nats."""
    (_, old), (_, new) = (np.linalg.slogdet(joint_covariance(one)) for one in (before, after))
    return float(old - new) / 2


def plan_sentence(words: Sequence[str], parameter: str, before: float, after: float) -> str:
    """What a set of measurements does to one stiffness, in plain words.

    A standard deviation s of ln k is said as the factor exp(s), one standard deviation up: in per cent, 100 (exp(s) −
    1), where the 95 % interval spans no more than a factor of 3, and as a factor otherwise (`spread_in_words`).

    Examples
    --------
    >>> plan_sentence(["an accelerometer at mid-span (6:y)"], "k12", 1.97, 0.15)
    'An accelerometer at mid-span (6:y) takes k12 from a factor of 7.2 to 16 %.'
    """
    listed = words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
    verb = "takes" if len(words) == 1 and not words[0].split()[0].replace(".", "").isdigit() else "take"
    start = listed[0].upper() + listed[1:]
    return f"{start} {verb} {parameter} from {spread_in_words(before)} to {spread_in_words(after)}."
