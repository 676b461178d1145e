"""Coordinates of a joint's posterior: in which it is near a bell, and whose intervals must be narrowly known."""

import numpy as np
from numpy.typing import NDArray

from jointbayes.inference import JointPrior, Problem, ResonanceChart
from jointbayes.joint import ComplianceChart, CondensedChart, LogStiffness
from jointbayes.sampling import BoxChart, Chart, ComposedChart, ProductChart, Quantities
from jointbayes.structure import is_mode_frequency

__all__ = ["charts", "judged_quantities"]

Array = NDArray[np.float64]


def charts(problem: Problem) -> tuple[Chart, ...]:
    """Coordinates in which the posterior may be near a bell: the joint's compliance, and the prior's normal scores.

    An FRF is nearly linear in the compliance. Where data say little the posterior is flat up to the prior's ends, or
    flat but for the rotational stiffness with the translation free to follow, which then takes the place of k22.
    Errors of natural frequencies are replaced by the frequencies themselves, which data fix whatever the joint is.
    """
    prior, count = problem.prior, len(problem.parametrisation.names)
    low, high = np.array([m.support for m in prior.all_marginals]).reshape(-1, 2).T
    errors = np.flatnonzero([is_mode_frequency(name) for name in problem.names])
    low[errors], high[errors] = -np.inf, np.inf
    compliance: Chart = ComplianceChart(problem.parametrisation)
    if len(problem.names) > count:
        compliance = ProductChart(compliance, count, BoxChart(low[count:], high[count:]))
    flat = BoxChart(low, high)
    freed: tuple[Chart, ...] = ()
    if isinstance(problem.parametrisation, LogStiffness):
        low[2], high[2] = -np.inf, np.inf
        freed = CondensedChart(), BoxChart(low, high)
    if not errors.size:
        return (compliance, flat, ComposedChart(*freed)) if freed else (compliance, flat)

    def log_frequency(theta: Array) -> Array:
        k, factors = prior.stiffness(theta), prior.factors(theta)
        frequency = problem.natural_frequencies_hz(k, errors.size, factors, of_model=True)
        return np.log(np.maximum(frequency, np.finfo(float).tiny))  # a free body has modes at 0 Hz

    resonances = ResonanceChart(log_frequency, errors, prior.support)
    return ComposedChart(resonances, compliance), ComposedChart(resonances, *(freed or (flat,)))


def judged_quantities(prior: JointPrior) -> Quantities:
    """What the stop rule's bound on the errors of interval ends holds for: each coordinate of the joint and k12.

    Stiffnesses by their logarithm, ρ as it is. A k12 that may have either sign is taken by its signed logarithm
    arsinh(k12/s), with s the median of |k12|: its draws may spread over decades to both sides.
    """
    names = prior.parametrisation.names

    def values(theta: Array) -> Array:
        joint = prior.joint(theta)
        if "rho" not in names:
            return joint
        k12 = prior.stiffness(theta)[..., 1:2]
        scale = float(np.median(np.abs(k12))) or 1.0
        return np.concatenate([joint, np.arcsinh(k12 / scale)], axis=-1)

    return Quantities(names if "rho" not in names else (*names, "k12"), values)
