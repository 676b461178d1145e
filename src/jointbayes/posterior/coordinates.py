"""Coordinates of a joint's posterior: in which it is near Gaussian, and whose intervals must be narrowly known."""

import numpy as np
from numpy.typing import NDArray

from jointbayes.inference import JointPrior, Problem, ResonanceChart
from jointbayes.joint import ComplianceChart, Parametrisation
from jointbayes.sampling import BoxChart, Chart, ComposedChart, ProductChart, Quantities
from jointbayes.structure import is_mode_frequency

__all__ = ["charts", "compliance_and_scores", "judged_quantities"]

Array = NDArray[np.float64]


def charts(problem: Problem) -> tuple[Chart, ...]:
    """Coordinates in which the posterior may be near Gaussian: the joint's compliance, and the prior's normal scores.

    An FRF is nearly linear in the compliance. Where data say little the posterior is flat up to the prior's ends, or
    flat but for a ridge, which the joint's coordinates may know how to straighten.
    Errors of natural frequencies are replaced by the frequencies themselves, which data fix whatever the joint is.
    """
    prior = problem.prior
    low, high = np.array([m.support for m in prior.all_marginals]).reshape(-1, 2).T
    errors = np.flatnonzero([is_mode_frequency(name) for name in problem.names])
    low[errors], high[errors] = -np.inf, np.inf
    compliance, flat = compliance_and_scores(problem.parametrisation, low, high)
    freed: tuple[Chart, ...] = ()
    ridge = problem.parametrisation.ridge
    if ridge is not None:
        low[ridge.column], high[ridge.column] = -np.inf, np.inf
        freed = ridge, BoxChart(low, high)
    if not errors.size:
        return (compliance, flat, ComposedChart(*freed)) if freed else (compliance, flat)

    def log_frequency(theta: Array) -> Array:
        k, factors = prior.stiffness(theta), prior.factors(theta)
        frequency = problem.natural_frequencies_hz(k, errors.size, factors, of_model=True)
        return np.log(np.maximum(frequency, np.finfo(float).tiny))  # a free body has modes at 0 Hz

    resonances = ResonanceChart(log_frequency, errors, prior.support)
    return ComposedChart(resonances, compliance), ComposedChart(resonances, *(freed or (flat,)))


def compliance_and_scores(parametrisation: Parametrisation, low: Array, high: Array) -> tuple[Chart, Chart]:
    """Compliance of the joint beside normal scores of the rest, and normal scores of all, between ends (d,)."""
    compliance: Chart = ComplianceChart(parametrisation)
    count = len(parametrisation.names)
    if len(low) > count:
        compliance = ProductChart(compliance, count, BoxChart(low[count:], high[count:]))
    return compliance, BoxChart(low, high)


def judged_quantities(prior: JointPrior) -> Quantities:
    """What the stop rule's bound on the errors of interval ends holds for: the joint's coordinates, and stiffnesses.

    Coordinates as they are; a stiffness that is none of them by its logarithm, or where it may have either sign by its
    signed logarithm arsinh(k/s), with s the median of |k|: its draws may spread over decades to both sides.
    """
    parametrisation = prior.parametrisation
    others = [(i, q) for i, q in enumerate(parametrisation.quantities) if q.name in parametrisation.derived]

    def values(theta: Array) -> Array:
        joint = prior.joint(theta)
        if not others:
            return joint
        stiffness = prior.stiffness(theta)
        columns = [_logarithm(stiffness[..., i], signed=q.may_be_negative) for i, q in others]
        return np.concatenate([joint, np.stack(columns, axis=-1)], axis=-1)

    return Quantities((*parametrisation.names, *(q.name for _, q in others)), values)


def _logarithm(stiffness: Array, *, signed: bool) -> Array:
    if not signed:
        return np.log(stiffness)
    scale = float(np.median(np.abs(stiffness))) or 1.0
    return np.arcsinh(stiffness / scale)
