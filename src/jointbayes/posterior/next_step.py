"""What to measure next: further measurements, ranked by how well they would tell the stiffness that is known least.

Linearised: the Fisher information of the data in hand plus the information of the further ones, about a few draws.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from jointbayes.errors import JointBayesError
from jointbayes.inference import Problem
from jointbayes.posterior.candidates import candidates_of
from jointbayes.posterior.checks import checks_of
from jointbayes.posterior.coordinates import by_names
from jointbayes.posterior.diagnosis import diagnoses_of
from jointbayes.posterior.fisher import FisherInformation, fisher_information
from jointbayes.posterior.forecast import NextStep
from jointbayes.posterior.identifiability import CERTAINTY, Verdict
from jointbayes.posterior.sampled import Sampled
from jointbayes.posterior.verdicts import advice_on_solutions
from vibrecords.arrays import Array

_DRAWS = 5


def next_steps(posterior: Sampled, freed: Problem | None, judged: Mapping[str, Verdict]) -> tuple[NextStep, ...]:
    """Rank further measurements by how well the stiffness that is known least would then be known, the best first.

    Parameters
    ----------
    posterior
        The draws, about which it is linearised.
    freed
        The same problem with more quantities uncertain, in which the forecast is then made.
    judged
        What is known of each stiffness.

    Returns
    -------
    tuple of NextStep
        About the stiffness that is known least among those that a measurement would help with; about the one that is
        known least of all where none would help. Empty where the draws have not converged, or it cannot be computed.
    """
    if not posterior.record.converged:
        return ()
    # 1. Points: the mode and a few draws, with what is uncertain only here at its stated value
    problem = freed or posterior.problem
    theta = np.vstack([posterior.estimate.theta, posterior.thinned(_DRAWS - 1)])
    points = by_names(theta, posterior.problem.names, problem.names)
    # 2. What is known of each stiffness now, and after each measurement: the median over the points
    try:
        present = [fisher_information(problem, point) for point in points]
        before = _spreads(present)
    except (JointBayesError, np.linalg.LinAlgError):
        return ()
    after: dict[tuple[str, str], dict[str, float]] = {}
    for candidate in candidates_of(problem):
        try:
            more = [candidate.information(point) for point in points]
            after[candidate.words, candidate.price] = _spreads(present, more)
        except (JointBayesError, np.linalg.LinAlgError):
            continue  # a model that cannot be evaluated there, as with more modes than it has
    # 3. The rows of each stiffness, the least known first, until a measurement helps
    names = tuple(name for name in problem.names if name not in posterior.problem.names)
    wanted = sorted(judged, key=lambda name: (CERTAINTY.get(judged[name].cls, 0), -judged[name].ratio))
    rows = []
    for k in (name for name in wanted if name in before):
        steps = [NextStep(k, *which, before[k], sd[k], names) for which, sd in after.items()]
        rows.append(sorted(steps, key=lambda step: step.sd_after))
    return tuple(next((each for each in rows if each and each[0].is_worth_it), rows[0] if rows else ()))


def advice(posterior: Sampled, steps: Sequence[NextStep]) -> str:
    """What to do next in words: what comes before any further measurement, else the first of the steps."""
    worst = min(
        zip(checks_of(posterior), diagnoses_of(posterior), strict=True), key=lambda each: each[0].smallest_p_value
    )
    if not posterior.converged:
        return f"Raise {posterior.record.limit_to_raise} in [sampling] and run again."
    if not worst[0].explains:
        return " ".join(worst[1].advice)
    if apart := advice_on_solutions(posterior):
        return apart
    if steps and steps[0].is_worth_it:
        return steps[0].sentence
    if posterior.problem.premises.of_modes:
        return (
            "None of what was looked at, two more modes, one more sensor or two antiresonances, would tell much more "
            "by itself. A wider band with force and sensor at a second point gives several of them at once."
        )
    return "None of what was looked at, one more sensor, more averages or further modes, would tell much more."


def _spreads(present: list[FisherInformation], more: list[Array] | None = None) -> dict[str, float]:
    """Median over points of the standard deviation of ln of each stiffness, with further information (d, d) at each."""
    each = [fisher.with_more(0.0 if more is None else more[i]).known_to() for i, fisher in enumerate(present)]
    return {name: float(np.median([sds[name] for sds in each])) for name in each[0]}
