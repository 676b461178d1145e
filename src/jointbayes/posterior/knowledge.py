"""What the data say beyond the draws: does the model explain them, what is known of the joint, and resting on what."""

from dataclasses import dataclass

import numpy as np

from jointbayes.errors import ModelError
from jointbayes.inference import Problem
from jointbayes.posterior.checks import PredictiveCheck
from jointbayes.posterior.directions import NamedDirection, name_directions, summary_sentence
from jointbayes.posterior.fisher import FisherInformation, fisher_information
from jointbayes.posterior.freeing import FreedRow, freeing_sentence, freeing_table
from jointbayes.posterior.profile import ProfileLikelihood, profile_likelihood
from jointbayes.posterior.result import Posterior

__all__ = ["Knowledge", "gather_knowledge"]


@dataclass(frozen=True, eq=False)
class Knowledge:
    """How far the numbers of a posterior carry.

    Parameters
    ----------
    check
        Posterior predictive check.
    fisher
        Fisher information at the MAP, of the problem as it was sampled.
    directions
        Combinations of the joint's stiffnesses that are determined independently, best known first.
    profiles
        Profile likelihood of each coordinate of the joint.
    freed
        How the verdicts change when what else is uncertain is freed; empty where there is nothing to free.
    assumed
        Whether that uncertainty was assumed for the table, the case itself taking it as exactly known.
    """

    check: PredictiveCheck
    fisher: FisherInformation
    directions: tuple[NamedDirection, ...]
    profiles: tuple[ProfileLikelihood, ...]
    freed: tuple[FreedRow, ...]
    assumed: bool

    @property
    def directions_sentence(self) -> str:
        """Which combinations are known, in one sentence."""
        return summary_sentence(self.directions)

    @property
    def freed_sentence(self) -> str:
        """What becomes of the verdicts, in one sentence."""
        return freeing_sentence(self.freed) if self.freed else ""


def gather_knowledge(posterior: Posterior, freed: Problem | None = None) -> Knowledge:
    """Check and examine a posterior.

    Parameters
    ----------
    posterior
        The posterior; the seed of its run also replicates the data of the check.
    freed
        The same problem with more quantities uncertain, for the table of what freeing them does where the posterior's
        own problem takes all as exactly known.
    """
    problem, theta = posterior.problem, posterior.estimate.theta
    fisher = fisher_information(problem, theta)
    own = _freeable(problem)
    wider, assumed = fisher, False
    if not own and freed is not None:
        known = dict(zip(problem.names, theta, strict=True))
        whole = np.array([known.get(name, 0.0) for name in freed.names])  # at the nominal value
        wider, assumed, own = fisher_information(freed, whole), True, _freeable(freed)
    return Knowledge(
        posterior.check,
        fisher,
        name_directions(fisher),
        _profiles(problem, posterior),
        freeing_table(wider, own) if own else (),
        assumed,
    )


def _freeable(problem: Problem) -> tuple[str, ...]:
    """Uncertain quantities on which the prediction depends; parameters of the noise are none."""
    count = len(problem.prior.nuisances) - problem.log_posterior.likelihood.hyper_count
    return tuple(n.name for n in problem.prior.nuisances[:count])


def _profiles(problem: Problem, posterior: Posterior) -> tuple[ProfileLikelihood, ...]:
    found = []
    for name in problem.parametrisation.names:
        try:
            found.append(profile_likelihood(problem, posterior.estimate.theta, name))
        except ModelError:
            continue  # no residual depends on it: its prior is all there is, and the verdict says so
    return tuple(found)
