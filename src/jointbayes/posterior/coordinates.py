"""Coordinates of a joint's posterior: in which it is near Gaussian, and whose intervals must be narrowly known."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.inference import JointPrior, Problem
from jointbayes.joint import ComplianceCoordinates, Parametrisation
from jointbayes.sampling import ComposedCoordinates, Coordinates, NormalScores, ProductCoordinates, Quantities
from jointbayes.structure import is_mode_frequency


def coordinate_systems(problem: Problem) -> tuple[Coordinates, ...]:
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
    freed: tuple[Coordinates, ...] = ()
    ridges = problem.parametrisation.ridges
    if ridges:
        replaced = [ridge.column for ridge in ridges]
        low[replaced], high[replaced] = -np.inf, np.inf
        freed = *ridges, NormalScores(low, high)
    if not errors.size:
        return (compliance, flat, ComposedCoordinates(*freed)) if freed else (compliance, flat)

    def log_frequency(theta: Array) -> Array:
        k, factors = prior.values(theta), prior.factors(theta)
        frequency = problem.natural_frequencies_hz(k, errors.size, factors, of_model=True)
        return np.log(np.maximum(frequency, np.finfo(float).tiny))  # a free body has modes at 0 Hz

    resonances = ResonanceCoordinates(log_frequency, errors, prior.support)
    return ComposedCoordinates(resonances, compliance), ComposedCoordinates(resonances, *(freed or (flat,)))


def compliance_and_scores(parametrisation: Parametrisation, low: Array, high: Array) -> tuple[Coordinates, Coordinates]:
    """Compliance of the joint beside normal scores of the rest, and normal scores of all, between ends (d,)."""
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
    others = [(i, q) for i, q in enumerate(parametrisation.quantities) if q.name in parametrisation.derived]

    def values(theta: Array) -> Array:
        joint = prior.joint(theta)
        if not others:
            return joint
        stiffness = prior.values(theta)
        columns = [_logarithm(stiffness[..., i], signed=q.may_be_negative) for i, q in others]
        return np.concatenate([joint, np.stack(columns, axis=-1)], axis=-1)

    return Quantities((*parametrisation.names, *(q.name for _, q in others)), values)


def _logarithm(stiffness: Array, *, signed: bool) -> Array:
    if not signed:
        return np.log(stiffness)
    scale = float(np.median(np.abs(stiffness))) or 1.0
    return np.arcsinh(stiffness / scale)


class ResonanceCoordinates:
    """Replaces each ln(error of a predicted natural frequency) by ln(frequency with that error).

    FRFs fix a resonance to a fraction of a per mille, and so the sum of what the model predicts and of its error,
    however wide each of the two is: a thin curved sheet in θ, which is flat here. The prediction depends on the other
    coordinates only, so that the change has volume 1.

    Parameters
    ----------
    log_frequency : callable
        ln of the predicted natural frequencies without their errors, shape (n, m), at θ, shape (n, d); must not
        depend on the errors themselves.
    columns : ndarray of int, shape (m,)
        Where the errors stand in θ.
    support : tuple of ndarray, each shape (d,)
        Lower and upper ends of θ.
    """

    def __init__(
        self, log_frequency: Callable[[Array], Array], columns: NDArray[np.intp], support: tuple[Array, Array]
    ) -> None:
        self._log_frequency, self._columns = log_frequency, columns
        self._low, self._high = (end[columns] for end in support)

    def forward(self, theta: Array) -> Array:
        """φ, shape (n, d), of θ, shape (n, d)."""
        phi = np.array(theta, dtype=np.float64)
        phi[:, self._columns] += self._log_frequency(theta)
        return phi

    def inverse(self, phi: Array) -> tuple[Array, NDArray[np.bool_]]:
        """θ, shape (n, d), and whether the errors lie within their ends, shape (n,)."""
        theta = np.array(phi, dtype=np.float64)
        theta[:, self._columns] -= self._log_frequency(phi)
        error = theta[:, self._columns]
        inside: NDArray[np.bool_] = np.all((error > self._low) & (error < self._high), axis=1)
        return theta, inside

    def log_volume(self, theta: Array) -> Array:
        """Zeros, shape (n,)."""
        return np.zeros(len(theta))
