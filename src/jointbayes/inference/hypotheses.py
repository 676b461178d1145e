"""Problems with another joint than the stated one: simpler hypotheses, and those with more couplings."""

from dataclasses import replace

import numpy as np

from jointbayes.errors import ModelError
from jointbayes.inference.marginals import Marginal, Uniform
from jointbayes.inference.problem import Problem
from jointbayes.joint import HYPOTHESES, Parametrisation, joint_under_hypothesis
from vibrecords.arrays import Array


def hypothesis_problem(problem: Problem, hypothesis: str, only: str = "") -> Problem:
    """Return the problem with the joint of a hypothesis; priors of what stays free are as they were.

    Couplings that the problem does not know have coefficients between −1 and 1, all equally probable.

    Parameters
    ----------
    problem
        Problem with the full joint.
    hypothesis
        One of `HYPOTHESES`, or ``"absent"``.
    only
        Name of the joint that it is about; by default it is about all.

    Raises
    ------
    ModelError
        If there is no such hypothesis, or the joint cannot be so.
    """
    if hypothesis not in (*HYPOTHESES, "absent"):
        raise ModelError(f"comparison: found hypothesis {hypothesis!r}; expected one of {', '.join(HYPOTHESES)}")
    joint = joint_under_hypothesis(problem.parametrisation, hypothesis, only)
    marginal_by_name: dict[str, Marginal] = {}
    there = _places(problem.parametrisation)
    for axis, marginal in zip(problem.parametrisation.axes, problem.prior.marginals, strict=True):
        marginal_by_name |= dict.fromkeys((axis.name, axis.quantity, there[axis.quantity]), marginal)
    here, marginals = _places(joint), []
    for axis in joint.axes:
        # a coordinate that the joint has itself keeps its prior; a spring has that of what stands for it or its place
        names = (axis.name, axis.quantity, here[axis.quantity])
        inherited = next((marginal_by_name[name] for name in names if name in marginal_by_name), None)
        marginals.append(inherited or Uniform(*axis.bounds))
    prior = replace(problem.prior, parametrisation=joint, marginals=tuple(marginals))
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
