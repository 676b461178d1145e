"""What posterior draws predict: FRF bands and natural frequencies."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.frf import Ports, Quantity, quantity_factor
from jointbayes.inference import Problem

__all__ = ["FrfPrediction", "frfs_as_measured", "predict_frf"]

Array = NDArray[np.float64]

_LINES_AT_ONCE = 128  # whose values of all draws are sorted together


@dataclass(frozen=True, slots=True, eq=False)
class FrfPrediction:
    """Pointwise median and interval of predicted FRFs; all arrays of shape (lines, outputs, inputs).

    Parameters
    ----------
    frequency_hz
        Lines, shape (lines,), Hz.
    outputs, inputs
        DOF labels.
    quantity
        Receptance, mobility or accelerance.
    probability
        Probability inside lower to upper, line by line.
    magnitude, magnitude_low, magnitude_high
        |H|, SI units.
    phase_deg, phase_deg_low, phase_deg_high
        Phase, degrees, continuous around the median's.
    """

    frequency_hz: Array
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    quantity: Quantity
    probability: float
    magnitude: Array
    magnitude_low: Array
    magnitude_high: Array
    phase_deg: Array
    phase_deg_low: Array
    phase_deg_high: Array


def frfs_as_measured(
    problem: Problem, ports: Ports, quantity: Quantity, stiffness: ArrayLike, factors: ArrayLike
) -> NDArray[np.complex128]:
    """FRFs as the measurement would show them without its noise: the gain and all else that was fitted is in them.

    Parameters
    ----------
    problem
        Structure, joint, data and prior.
    ports, quantity
        Lines, DOFs and quantity.
    stiffness
        Quantities of the joint, shape (n, q).
    factors
        Factors of all uncertain quantities in the order of the prior, shape (n, q).

    Returns
    -------
    ndarray, shape (n, lines, outputs, inputs)
        SI units of the quantity.

    Raises
    ------
    ModelError
        If a DOF does not exist.
    """
    known = np.asarray(factors, dtype=float)
    receptance = problem.receptance_model(ports).receptance(
        problem.parametrisation.matrix(stiffness), problem.structural(known)
    )
    names = [nuisance.name for nuisance in problem.prior.nuisances]
    if "gain" in names:
        receptance *= known[:, names.index("gain"), None, None, None]
    receptance *= quantity_factor(ports.frequency_hz, quantity)[:, None, None]
    return receptance


def predict_frf(
    problem: Problem, theta: ArrayLike, ports: Ports, quantity: Quantity, probability: float
) -> FrfPrediction:
    """Summarise the FRFs of a set of draws, θ (n, d), line by line, see `frfs_as_measured`.

    Raises
    ------
    ModelError
        If a DOF does not exist.
    """
    values = frfs_as_measured(problem, ports, quantity, problem.prior.stiffness(theta), problem.prior.factors(theta))
    tail = (1 - probability) / 2
    magnitude, turn = np.empty((2, 3, *values.shape[1:]))
    centre = values.mean(axis=0)
    for begin in range(0, len(ports.frequency_hz), _LINES_AT_ONCE):
        lines = slice(begin, begin + _LINES_AT_ONCE)
        some = values[:, lines]
        magnitude[:, lines] = np.quantile(np.abs(some), [tail, 0.5, 1 - tail], axis=0)
        # phases relative to the mean FRF, so that a band across ±180° does not wrap
        relative = np.angle(some * np.conj(centre[lines]), deg=True)
        turn[:, lines] = np.quantile(relative, [tail, 0.5, 1 - tail], axis=0)
    phase = np.angle(centre, deg=True)
    low, middle, high = magnitude
    return FrfPrediction(
        ports.frequency_hz,
        ports.outputs,
        ports.inputs,
        quantity,
        probability,
        middle,
        low,
        high,
        phase + turn[1],
        phase + turn[0],
        phase + turn[2],
    )
