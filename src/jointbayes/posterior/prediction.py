"""What posterior draws predict: FRF bands, what was left out of the data, and FRFs that tell solutions apart."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jointbayes.errors import JointBayesError, require, require_probability
from jointbayes.frf import LowRankCoupling, NoisePropagation, Ports
from jointbayes.inference import Problem
from jointbayes.joint.quantities import is_rotation, prefixed
from jointbayes.posterior.sampled import Sampled
from jointbayes.rounding import number
from vibrecords import FrfSet, Quantity, quantity_factor
from vibrecords.arrays import Array

_LINES_AT_ONCE = 128  # whose values of all draws are sorted together
_MOST_FRF_DRAWS = 400  # that predict lines which were left out
_MOST_SHOWN = 60  # values in a table
_MOST_NAMED = 3  # values outside, in a sentence
_DRAWS_AT_ONCE = 32  # whose errors of measured bodies are held in memory
_LINES_COMPARED = 200  # at which FRFs of the solutions are compared
_MOST_PLACES = 1000  # of further sensors that are compared
_ALIKE = 1e-3  # of |H|: FRFs that differ by less are equal
_SHALLOWEST = 0.1  # of the median |H|: smaller values lie below the noise of other lines
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

    def __repr__(self) -> str:
        frf = FrfSet(self.frequency_hz, np.asarray(self.magnitude, complex), self.outputs, self.inputs, self.quantity)
        return f"FrfPrediction(median and {100 * self.probability:g} % band of {frf!r})"


@dataclass(frozen=True, eq=False)
class LeftOut:
    """What was left out of the data of one test, and what the draws predict a measurement of it to show.

    Parameters
    ----------
    test
        Name of the test; empty of a lone one.
    names
        What each value is: ``"frequency 3"``, or DOFs and line of an FRF, of which the magnitude is compared.
    measured, median, low, high
        As measured, and as predicted with the error of the model and the noise of the measurement, shape (m,).
    probability
        Probability inside low to high, value by value.
    """

    test: str
    names: tuple[str, ...]
    measured: Array
    median: Array
    low: Array
    high: Array
    probability: float

    def __repr__(self) -> str:
        return sentence_of_left_out([self])

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """Whether each measured value lies inside its interval, shape (m,)."""
        return (self.low <= self.measured) & (self.measured <= self.high)

    @property
    def shown(self) -> list[int]:
        """Places of the values that a table shows: all of them, or of many those that lie outside."""
        places = np.arange(self.inside.size) if self.inside.size <= _MOST_SHOWN else np.flatnonzero(~self.inside)
        return places[:_MOST_SHOWN].tolist()


def sentence_of_left_out(predicted: Sequence[LeftOut]) -> str:
    """How many of the values lie inside their intervals, and which do not; empty where nothing was left out."""
    return " ".join(sentences_of_left_out(predicted))


def sentences_of_left_out(predicted: Sequence[LeftOut]) -> list[str]:
    """The same, sentence by sentence."""
    if not predicted:
        return []
    inside = np.concatenate([each.inside for each in predicted])
    share = f"{inside.sum()} of {inside.size} inside {100 * predicted[0].probability:g} % intervals"
    outside = [
        f"Outside: {prefixed(each.test, each.names[i])}, measured {number(each.measured[i], 4)}, "
        f"predicted {number(each.low[i], 4)} to {number(each.high[i], 4)}."
        for each in predicted
        for i in np.flatnonzero(~each.inside)
    ]
    more = [f"And {len(outside) - _MOST_NAMED} more."] if len(outside) > _MOST_NAMED else []
    return [f"Left out and predicted: {share}.", *outside[:_MOST_NAMED], *more]


def left_out_json(predicted: Sequence[LeftOut]) -> dict[str, Any] | None:
    """What ``left_out`` of ``summary.json`` holds; None where nothing was left out."""
    if not predicted:
        return None
    values = [
        {
            "test": each.test,
            "name": each.names[i],
            "measured": float(each.measured[i]),
            "median": float(each.median[i]),
            "interval95": [float(each.low[i]), float(each.high[i])],
            "inside": bool(each.inside[i]),
        }
        for each in predicted
        for i in each.shown
    ]
    count, inside = (sum(int(size(each.inside)) for each in predicted) for size in (np.size, np.sum))
    return {"sentence": sentence_of_left_out(predicted), "count": count, "inside": inside, "values": values}


def simulate_at(
    problem: Problem, theta: Array, rng: np.random.Generator, noise: NDArray[Any] | None = None
) -> NDArray[Any]:
    """What the one test of a problem would measure at each θ, (n, d): predicted values with a draw of their errors.

    Errors are those of its noise model: of the measurement, and of the model where that is stated; or `noise` of so
    many values, standardised, that was drawn already. Shape (n, …) with the shape of the data; not finite where the
    model is not.
    """
    likelihood, predicted = problem.log_posterior.likelihood, problem.log_posterior.predicted(theta)
    if noise is None:
        lines, pairs = predicted.shape[1], math.prod(predicted.shape[2:])
        noise = likelihood.noise.draw(rng, likelihood.hyper(problem.prior.factors(theta)), lines, pairs)
    each = zip(predicted, noise.reshape(predicted.shape), strict=True)
    return np.array([likelihood.add_noise(exact, errors) for exact, errors in each])


def _errors_of_size_shown(
    problem: Problem, part: Problem, theta: Array, rng: np.random.Generator
) -> NDArray[Any] | None:
    """Errors of what was left out, of the size that all other data show at each θ; None where they show none."""
    noise, prior = part.log_posterior.likelihood.noise, problem.prior
    likelihood, law = problem.log_posterior.likelihood, noise.shares
    size = None if law is None else likelihood.draw_error_size(law, prior.matrix(theta), prior.factors(theta), rng)
    return None if size is None else noise.draw(rng, size, part.log_posterior.likelihood.n_data, 1)


def replicate(problem: Problem, part: Problem, theta: Array, rng: np.random.Generator) -> NDArray[Any]:
    """Data like those of one part of a problem, replicated at draws θ, (n, d): shape (n, …) with their shape.

    What the noise model integrates out, such as its scale, is drawn given the data.
    """
    noise, likelihood = _errors_of_size_shown(problem, part, theta, rng), part.log_posterior.likelihood
    if noise is None:
        z = part.log_posterior.standardised(theta)
        z = z.reshape(*z.shape[:2], -1)
        squares, hyper = (np.abs(z) ** 2).sum(axis=(1, 2)), likelihood.hyper(problem.prior.factors(theta))
        law, hyper = likelihood.noise.with_scale(squares, z[0].size, hyper, rng)
        noise = law.draw(rng, hyper, *z.shape[1:])
    return simulate_at(part, theta, rng, noise)


def left_out_of(posterior: Sampled, probability: float = 0.95, max_draws: int = 2000) -> tuple[LeftOut, ...]:
    """Predict a measurement of what was left out of the data; empty without any.

    The intervals hold what is uncertain in joint and structure, the error of the model as far as the noise model
    states one, drawn again for what was left out, and the noise of the measurement. Of FRFs the magnitude is
    compared, of at most 400 draws.

    Parameters
    ----------
    posterior
        The posterior.
    probability
        Probability inside each interval.
    max_draws
        At most this many draws, evenly spaced, are evaluated.

    Raises
    ------
    ModelError
        If the probability is not inside (0, 1).
    """
    require_probability(probability, "left out")
    return predict_left_out(posterior.problem, posterior.thinned(max_draws), probability, posterior.record.seed)


def predict_left_out(problem: Problem, theta: Array, probability: float, seed: int) -> tuple[LeftOut, ...]:
    """What draws θ, (n, d), predict of all that was left out, see `Problem.left_out`."""
    rng, tail = np.random.default_rng([seed, _SEED]), (1 - probability) / 2
    predicted = []
    for part in problem.left_out_parts:
        data = part.test.data
        some = theta if data.frfs is None else theta[:: -(-len(theta) // _MOST_FRF_DRAWS)]
        values = simulate_at(part, some, rng, _errors_of_size_shown(problem, part, some, rng))
        if data.frfs is not None:
            frf = data.frfs.frf
            pairs = [f"{output}/{input_}" for output in frf.outputs for input_ in frf.inputs]
            names = tuple(f"{pair} at {line:g} Hz" for line in frf.frequency_hz for pair in pairs)
            measured, values = np.abs(frf.values), np.abs(values)
        else:
            assert data.modes is not None
            names, measured = data.modes.value_names, data.modes.values
        low, median, high = np.quantile(values.reshape(len(values), -1), [tail, 0.5, 1 - tail], axis=0)
        predicted.append(LeftOut(part.test.name, names, measured.ravel(), median, low, high, probability))
    return tuple(predicted)


def predict_frf(
    problem: Problem, theta: ArrayLike, ports: Ports, quantity: Quantity, probability: float
) -> FrfPrediction:
    """Summarise the FRFs of a set of draws, θ (n, d), line by line, see `Problem.frfs_as_measured`.

    What errors of measured bodies make of the FRFs is drawn as well, unless they are ignored.

    Raises
    ------
    ModelError
        If a DOF does not exist.
    """
    require(ports, Ports, "FRF prediction: found as ports", "jb.Ports(frequency_hz, outputs, inputs); make it")
    require_probability(probability, "FRF prediction")
    values = problem.frfs_as_measured(ports, quantity, problem.prior.values(theta), problem.prior.factors(theta))
    if problem.test.measured_bodies and not problem.test.ignores_noise_of_bodies:
        values += _errors_of_bodies(problem, ports, quantity, np.atleast_2d(np.asarray(theta, dtype=float)))
    return frf_band(values, ports, quantity, probability)


def frf_band(values: NDArray[np.complex128], ports: Ports, quantity: Quantity, probability: float) -> FrfPrediction:
    """Median and interval of FRFs of draws, shape (n, lines, outputs, inputs), line by line."""
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
    ends = (*magnitude[[1, 0, 2]], *(np.angle(centre, deg=True) + turn[[1, 0, 2]]))
    return FrfPrediction(ports.frequency_hz, ports.outputs, ports.inputs, quantity, probability, *ends)


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


def further_measurement(problem: Problem, theta: Array) -> str:
    """At which DOF the FRFs of several solutions, θ of shape (m, d), differ the most, in a sentence; or empty.

    Of the translations of the model's points that are not measured, with the force where it is, that at which the two
    solutions that differ the least differ the most, as the root of the mean square over the lines relative to |H|. Of
    modes as data force and sensor are at one point.
    """
    part = ([part for part in problem.parts if part.test.data.frfs] or list(problem.parts))[0]
    measured = part.test.data.frfs
    labels = part.test.structures_of_data.labels
    evenly = labels[:: -(-len(labels) // _MOST_PLACES)]
    candidates = tuple(dof for dof in evenly if dof.rpartition(":")[0].isalnum() and not is_rotation(dof))
    if measured is not None:
        candidates = tuple(label for label in candidates if label not in measured.frf.outputs)
        lines, inputs = measured.frf.frequency_hz, measured.frf.inputs[:1]
        noise = float(np.median(np.sqrt(measured.variance) / np.abs(measured.frf.values)))
    else:
        lines, inputs, noise = np.linspace(0.5, 1.2, _LINES_COMPARED) * part.test.data.top_hz, candidates, 0.0
    if not (candidates and part.test.data.top_hz):  # a static test says nothing of the band of a further one
        return ""
    lines = lines[np.linspace(0, len(lines) - 1, min(len(lines), _LINES_COMPARED)).round().astype(int)]
    prior = problem.prior
    try:
        ports = Ports(lines, candidates, inputs)
        frf = part.frfs_as_measured(ports, "receptance", prior.values(theta), prior.factors(theta))
    except JointBayesError:  # a body given by its FRFs has them at its measured DOFs alone
        return ""
    frf = frf[..., 0] if measured is not None else np.diagonal(frf, axis1=2, axis2=3)
    size = np.abs(frf).mean(axis=0)
    size = np.maximum(size, _SHALLOWEST * np.median(size, axis=0))
    pairs = [np.abs((frf[i] - frf[j]) / size) for i, j in combinations(range(len(theta)), 2)]
    difference = np.sqrt(np.mean(np.square(pairs), axis=1)).min(axis=0)
    best = int(np.argmax(difference))
    if not difference[best] > max(noise, _ALIKE):
        return "No single sensor at another point of the model would tell them apart."
    place = candidates[best]
    where = f"A sensor at {place} with the force at {inputs[0]}" if noise else f"An FRF at {place}"
    text = f"{where} would tell them apart: there their FRFs differ by {100 * difference[best]:.0f} % of |H|"
    return f"{text}, {number(difference[best] / noise, 2)} times the noise." if noise else f"{text}."
