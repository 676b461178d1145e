"""Draws from a joint's posterior: coordinates in which it is near Gaussian, and whose ends must be narrowly known."""

from collections.abc import Callable, Sequence

import numpy as np

from jointbayes.identification import with_lines_in_groups
from jointbayes.inference import JointPrior, Landing, Problem
from jointbayes.joint import ComplianceCoordinates, Parametrisation
from jointbayes.progress import Budget, Progress
from jointbayes.sampling import (
    Chains,
    ComposedCoordinates,
    Coordinates,
    NormalScores,
    ProductCoordinates,
    Proposal,
    Quantities,
    SamplerSettings,
    draw,
)
from vibrecords.arrays import Array, Indices


def draw_problem(
    problem: Problem,
    modes: Array,
    rng: np.random.Generator,
    settings: SamplerSettings,
    tell: Callable[[Progress], object] = lambda _: None,
    *,
    free: Indices | None = None,
    budget: Budget | None = None,
) -> tuple[Chains, Proposal]:
    """Draw from the posterior of a problem, see `jointbayes.sampling.draw`.

    Parameters
    ----------
    problem
        The problem.
    modes
        Modes that are known, shape (m, d).
    rng, settings, tell, budget
        As for `draw`.
    free
        Columns of θ that are free, those of the joint among them; by default all. The others are held at zero, and the
        draws have none of them.
    """
    columns, judged = np.arange(modes.shape[1]) if free is None else free, judged_quantities(problem.prior)
    part = Landing(problem.log_posterior, columns, modes[0], with_lines_in_groups(problem).log_posterior)
    quantities = Quantities(judged.names, lambda theta: judged.values(part.whole(theta)))
    systems = coordinate_systems(problem, columns)
    return draw(part, modes[:, columns], rng, settings, tell, systems=systems, quantities=quantities, budget=budget)


def coordinate_systems(problem: Problem, free: Indices | None = None) -> tuple[Coordinates, ...]:
    """Coordinates in which the posterior may be near Gaussian: the joint's compliance, and the prior's normal scores.

    Of the columns `free` of θ, those of the joint among them; by default of all.

    An FRF is nearly linear in the compliance. Where data say little the posterior is flat up to the prior's ends, or
    flat but for a ridge, which the joint's coordinates may know how to straighten.
    """
    ends = np.array([m.support for m in problem.prior.all_marginals]).reshape(-1, 2)
    low, high = (ends if free is None else ends[free]).T
    compliance, flat = compliance_and_scores(problem.parametrisation, low, high)
    ridges = problem.parametrisation.ridges
    if not ridges:
        return compliance, flat
    replaced = [ridge.column for ridge in ridges]
    low[replaced], high[replaced] = -np.inf, np.inf
    return compliance, flat, ComposedCoordinates(*ridges, NormalScores(low, high))


def by_names(theta: Array, names: Sequence[str], wanted: Sequence[str]) -> Array:
    """Points θ, shape (n, d), by other coordinates, shape (n, w); 0, in the middle, where they have none of a name."""
    points = np.zeros((len(theta), len(wanted)))
    for i, name in enumerate(wanted):
        if name in names:
            points[:, i] = theta[:, names.index(name)]
    return points


def compliance_and_scores(parametrisation: Parametrisation, low: Array, high: Array) -> tuple[Coordinates, Coordinates]:
    """Compliance of the joint, normal scores of the rest, and normal scores of all, between ends (d,)."""
    compliance: Coordinates = ComplianceCoordinates(parametrisation)
    count = len(parametrisation.names)
    if len(low) > count:
        compliance = ProductCoordinates(compliance, count, NormalScores(low[count:], high[count:]))
    return compliance, NormalScores(low, high)


def judged_quantities(prior: JointPrior) -> Quantities:
    """What the stop rule's bound on the errors of interval ends holds for: the joint's coordinates, and stiffnesses.

    Coordinates as they are; a stiffness that is none of them by its logarithm, or where it may have either sign by its
    signed logarithm arsinh(k/s), with s the median of |k|: its draws may spread over decades to both sides.
    """
    parametrisation = prior.parametrisation
    if not parametrisation.names:  # of a rigid joint, all else that is uncertain
        return Quantities(prior.names, lambda theta: theta)
    others = [(i, q) for i, q in enumerate(parametrisation.quantities) if q.name in parametrisation.derived]

    def values(theta: Array) -> Array:
        joint = prior.joint(theta)
        if not others:
            return joint
        stiffness = prior.values(theta)
        columns = []
        for i, quantity in others:
            k, scale = stiffness[..., i], float(np.median(np.abs(stiffness[..., i]))) or 1.0
            columns.append(np.arcsinh(k / scale) if quantity.may_be_negative else np.log(k))
        return np.concatenate([joint, np.stack(columns, axis=-1)], axis=-1)

    return Quantities((*parametrisation.names, *(q.name for _, q in others)), values)
