"""What posterior draws predict: FRF bands and natural frequencies."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.arrays import Array
from jointbayes.frf import LowRankCoupling, NoisePropagation, Ports, Quantity, quantity_factor
from jointbayes.inference import Problem

_LINES_AT_ONCE = 128  # whose values of all draws are sorted together
_DRAWS_AT_ONCE = 32  # whose errors of measured bodies are held in memory
_SEED = 8  # of these errors: a band is the same at every look


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
    factor_rows, problem = np.asarray(factors, dtype=float), problem.part(None)
    receptance = problem.test.receptance_model(ports).receptance(
        problem.parametrisation.matrix(stiffness), problem.structural(factor_rows)
    )
    receptance *= problem.gain(factor_rows)[..., None, None, None]
    receptance *= quantity_factor(ports.frequency_hz, quantity)[:, None, None]
    return receptance


def predict_frf(
    problem: Problem, theta: ArrayLike, ports: Ports, quantity: Quantity, probability: float
) -> FrfPrediction:
    """Summarise the FRFs of a set of draws, θ (n, d), line by line, see `frfs_as_measured`.

    What errors of measured bodies make of the FRFs is drawn as well, unless they are ignored.

    Raises
    ------
    ModelError
        If a DOF does not exist.
    """
    values = frfs_as_measured(problem, ports, quantity, problem.prior.values(theta), problem.prior.factors(theta))
    if problem.test.measured_bodies and not problem.test.ignores_noise_of_bodies:
        values += _errors_of_bodies(problem, ports, quantity, np.atleast_2d(np.asarray(theta, dtype=float)))
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


def _errors_of_bodies(problem: Problem, ports: Ports, quantity: Quantity, theta: Array) -> NDArray[np.complex128]:
    """One draw for each θ of what errors of measured bodies make of the FRFs, (n, lines, outputs, inputs)."""
    model = problem.test.receptance_model(ports)
    assert isinstance(model, LowRankCoupling)
    propagation, prior, rng = NoisePropagation(model), problem.prior, np.random.default_rng(_SEED)
    errors = []
    for begin in range(0, len(theta), _DRAWS_AT_ONCE):
        some = theta[begin : begin + _DRAWS_AT_ONCE]
        factors = prior.factors(some)
        roots = propagation.roots(prior.matrix(some), problem.structural(factors))
        white = rng.standard_normal((*roots.shape[:2], roots.shape[3], 2)) @ [np.sqrt(0.5), 1j * np.sqrt(0.5)]
        drawn = (roots @ white[..., None]).reshape(*roots.shape[:2], len(ports.outputs), len(ports.inputs))
        errors.append(drawn * problem.gain(factors)[:, None, None, None])
    return np.concatenate(errors) * quantity_factor(ports.frequency_hz, quantity)[:, None, None]
