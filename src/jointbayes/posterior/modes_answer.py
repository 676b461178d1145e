"""What the modes that measured FRFs show say of the joint, the model being a little wrong; and which answer to believe.

An FRF at a good signal-to-noise ratio states each resonance to a few parts in 10⁵, a model of a real structure misses
it by parts in 10³. The likelihood of the FRFs then takes the model's error for the joint. That of the modes has a place
for it, see `jointbayes.inference.ModelErrorNoise`, and so the wider, truer intervals.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from jointbayes.arrays import Array
from jointbayes.errors import JointBayesError
from jointbayes.frf import HeldFrequencies
from jointbayes.inference import ErrorSizes, ModelErrorNoise, Problem, Test
from jointbayes.inference.test import likelihood_of, own_name
from jointbayes.measurement import Antiresonances, FrfData, ModeData, Observed
from jointbayes.measurement.modal_fit import identify_modes, identify_zeros
from jointbayes.measurement.provenance import MeasuredMode
from jointbayes.posterior.identifiability import Identifiability
from jointbayes.posterior.rounding import number
from jointbayes.posterior.verdicts import JudgedPosterior, lines_of

#: A resonance that no predicted mode comes closer to than this, as a fraction, is compared with none.
FARTHEST = 0.1
_DRAWS = 300  # of the prior, at which modes are counted besides the MAP
_MORE = 8  # modes of the model above the number of resonances
_SIZES, _STREAM = 8000, 7  # draws that the size of the error is told from, and their random numbers
_SPREAD = 0.02  # of frequencies: errors well below it count by their square, those above hardly more


@dataclass(frozen=True, slots=True)
class UsedMode:
    """A measured resonance and the mode of the model that it is compared with, from 1.

    Or an antiresonance of the drive point `held`, and the mode of the model with that DOF held.
    """

    setup: str
    number: int
    frequency_hz: float
    sd_hz: float
    held: str = ""


@dataclass(frozen=True, slots=True)
class ModesProblem:
    """The problem of the modes that FRFs show, with the modes used, and sentences on those that are not."""

    problem: Problem
    sizes: ErrorSizes
    used: tuple[UsedMode, ...]
    left_out: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ModesAnswer:
    """What the modes of measured FRFs say of the joint, with an error of the model in each.

    Parameters
    ----------
    known
        What is known of each stiffness, by name.
    modes, left_out
        The modes used, and sentences on those that are not.
    model_error
        Median and ends of the 95 % interval of the model's error in a frequency, as a fraction.
    believed
        Whether it is this answer that is to be believed, not that of the FRFs.
    reason
        Why, in a sentence without full stop.
    assumed
        What is uncertain in it that nobody stated, in words.
    """

    known: Mapping[str, Identifiability]
    modes: tuple[UsedMode, ...]
    left_out: tuple[str, ...]
    model_error: tuple[float, float, float]
    believed: bool
    reason: str
    assumed: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """Which answer is to be believed, and why."""
        return f"Use the answer of the {'modes' if self.believed else 'FRFs'}: {self.reason}."

    @property
    def basis(self) -> str:
        """What the modes' answer rests on."""
        middle, low, high = (number(100 * value, 2) for value in self.model_error)
        where = {mode.held: _frequencies(self.modes, mode.held) for mode in self.modes}
        zeros = "".join(f", and the antiresonances of {held} at {text} Hz" for held, text in where.items() if held)
        text = (
            f"That of the modes uses those that the FRFs show at {where['']} Hz{zeros}. The model misses each by about "
            f"{middle} % ({low} to {high} %), as inferred."
        )
        if self.assumed:
            text += f" The case does not say how well the rest is known; assumed: {', '.join(self.assumed)}."
        return " ".join((text, *self.left_out))

    def lines(self) -> list[str]:
        """Median, interval and verdict of each stiffness, for the terminal."""
        return [line for name, known in self.known.items() for line in lines_of(name, known, known.unit)]

    def as_json(self) -> dict[str, Any]:
        """What ``answers`` of ``summary.json`` holds besides the answer of the FRFs."""
        return {
            "model_error": {"median": self.model_error[0], "interval95": self.model_error[1:]},
            "modes": [asdict(mode) for mode in self.modes],
            "left_out": self.left_out,
            "assumed": self.assumed,
            "parameters": known_json(self.known),
        }


def _frequencies(modes: Sequence[UsedMode], held: str) -> str:
    return ", ".join(number(mode.frequency_hz, 4) for mode in modes if mode.held == held)


def known_json(known: Mapping[str, Identifiability]) -> dict[str, dict[str, Any]]:
    """What ``answers`` of ``summary.json`` holds of each stiffness in one of them."""
    values = ("median", "interval95", "limit95")
    keys = (*values, *(f"{value}_error" for value in values), "printed95", "verdict", "verdict_reason")
    return {name: {key: getattr(assessment, key) for key in keys} for name, assessment in known.items()}


def modes_problem(posterior: JudgedPosterior, sizes: ErrorSizes, freed: Problem | None = None) -> ModesProblem | None:
    """The problem with the modes that its measured FRFs show in the place of these.

    Parameters
    ----------
    posterior
        Of measured FRFs: their MAP says, with draws of the prior, which mode of the model a resonance is.
    sizes
        Of the model's errors.
    freed
        The same problem with more quantities uncertain, which the answer is then to allow for.

    Returns
    -------
    ModesProblem
        None where FRFs were computed, show no mode, or are of a structure that has none: one with a measured body; and
        where those of the only test of a joint show none.
    """
    problem, answered = posterior.problem, freed or posterior.problem
    if not is_of_measured_frfs(problem) or problem.extra_log_likelihood is not None:
        return None
    tests, used, left_out = [], list[UsedMode](), list[str]()
    for part, test in zip(problem.parts, answered.tests, strict=True):
        frfs = test.data.frfs
        if frfs is None:
            tests.append(test)
            continue
        resonances, tried = resonances_of(frfs), _tried(part, posterior)
        numbers, far = _numbers(part, tried, np.array([mode.frequency_hz for mode in resonances]))
        left_out += [_far_in_words(test, resonances[place]) for place in far]
        modes = [mode for place, mode in enumerate(resonances) if place not in far]
        if modes:
            of_test = _used(test, modes, numbers)
            of_test += [zero for dof, fit in _zeros(frfs).items() for zero in _held_modes(part, tried, dof, fit)]
            tests.append(_test_of_modes(test, of_test, sizes))
            used += of_test
    if not used:
        return None
    of_modes = _with_tests(answered, tests)
    if not all(quantity.places for quantity in of_modes.quantities):
        return None
    return ModesProblem(of_modes, sizes, tuple(used), tuple(left_out))


def is_of_measured_frfs(problem: Problem) -> bool:
    """Whether FRFs of a structure that is modelled throughout are among the data, and none was computed."""
    frfs = [test.data.frfs for test in problem.tests if test.data.frfs is not None]
    modelled = not any(test.measured_bodies for test in problem.tests)
    return bool(frfs) and modelled and not any(data.synthetic for data in frfs)


def resonances_of(frfs: FrfData) -> Sequence[MeasuredMode]:
    """Modes that FRFs show; those that were found as they were read."""
    if frfs.provenance is not None:
        return frfs.provenance.modes
    accelerance = frfs.converted("accelerance")
    try:
        return identify_modes(accelerance.frf, accelerance.variance)
    except JointBayesError:  # too few lines
        return ()


def _zeros(frfs: FrfData) -> Mapping[str, Sequence[MeasuredMode]]:
    """Antiresonances of each drive point that FRFs show."""
    accelerance = frfs.converted("accelerance")
    try:
        return {dof: fit.modes for dof, fit in identify_zeros(accelerance.frf, accelerance.variance).items()}
    except JointBayesError:  # too few lines
        return {}


def _numbers(part: Problem, tried: tuple[Array, Array], measured_hz: Array) -> tuple[NDArray[np.intp], tuple[int, ...]]:
    """Number of the mode that each resonance is, and the places of resonances that are none of the model's."""
    count = min(part.test.most_modes, len(measured_hz) + _MORE)
    if not count or not len(measured_hz):
        return np.empty(0, dtype=np.intp), tuple(range(len(measured_hz)))
    stiffness, factors = tried
    return _nearest(measured_hz, part.natural_frequencies_hz(stiffness, count, factors))


def _held_modes(
    part: Problem, tried: tuple[Array, Array], dof: str, zeros: Sequence[MeasuredMode]
) -> Sequence[UsedMode]:
    """Antiresonances of a drive point with the number of each; those that are none of the model's are left out."""
    count = min(part.test.most_modes - 1, len(zeros) + _MORE)
    if count < 1 or not zeros or dof in part.test.joints.labels:
        return []
    stiffness, factors = tried
    held = HeldFrequencies(part.test.structures, part.test.joints, (dof,) * count, range(1, count + 1))
    predicted_hz = held.frequency_hz(part.parametrisation.matrix(stiffness), part.structural(factors))
    numbers, far = _nearest(np.array([zero.frequency_hz for zero in zeros]), predicted_hz)
    near = [zero for place, zero in enumerate(zeros) if place not in far]
    return [replace(mode, held=dof) for mode in _used(part.test, near, numbers)]


def _tried(part: Problem, posterior: JudgedPosterior) -> tuple[Array, Array]:
    """Stiffnesses and factors at the MAP, other modes and draws of the prior: where the modes are counted."""
    prior = part.prior
    modes = [posterior.estimate.theta, *(mode.theta for mode in posterior.estimate.modes)]
    theta = np.vstack([*modes, prior.sample(np.random.default_rng(posterior.record.seed), _DRAWS)])
    return prior.values(theta), prior.factors(theta)


def _nearest(measured_hz: Array, predicted_hz: Array) -> tuple[NDArray[np.intp], tuple[int, ...]]:
    """Number of each measured frequency among the predicted ones, shape (n, count), and places of those that are none.

    Counted at the one of n points whose natural frequencies are nearest.
    """
    best, least = None, math.inf
    for row in predicted_hz:
        away = np.abs(np.log(measured_hz[:, None] / row))
        cost = np.log1p((away / _SPREAD) ** 2)
        places, numbers = scipy.optimize.linear_sum_assignment(cost)
        if (total := float(cost[places, numbers].sum())) < least:
            best, least = (places, numbers, away[places, numbers]), total
    assert best is not None
    places, numbers, away = best
    near = away <= FARTHEST
    return numbers[near] + 1, tuple(sorted({*range(len(measured_hz))} - {*places[near].tolist()}))


def _used(test: Test, modes: Sequence[MeasuredMode], numbers: NDArray[np.intp]) -> list[UsedMode]:
    return [
        UsedMode(test.name, int(number), mode.frequency_hz, mode.frequency_sd_hz)
        for number, mode in zip(numbers, modes, strict=True)
    ]


def _far_in_words(test: Test, mode: MeasuredMode) -> str:
    where = f" of set-up {test.name}" if test.name else ""
    return (
        f"The resonance at {number(mode.frequency_hz, 4)} Hz{where} is not used: the model has no mode within "
        f"{100 * FARTHEST:g} % of it."
    )


def _test_of_modes(test: Test, used: Sequence[UsedMode], sizes: ErrorSizes) -> Test:
    """The test with modes and antiresonances as data, with errors of the model in each."""
    modes = sorted((mode for mode in used if not mode.held), key=lambda mode: mode.number)
    held = [mode for mode in used if mode.held]
    zeros = (
        Antiresonances(tuple(z.held for z in held), _observed(held), tuple(z.number for z in held)) if held else None
    )
    data = ModeData(_observed(modes), numbers=tuple(mode.number for mode in modes), zeros=zeros)
    structure = test.structures.with_certain_damping()  # an unknown that no datum sees keeps draws from settling
    noise = ModelErrorNoise.of(data, sizes)
    return replace(test, structure=structure, data=data, noise=noise, residual_kind="complex")


def _observed(modes: Sequence[UsedMode]) -> Observed:
    return Observed(np.array([mode.frequency_hz for mode in modes]), np.array([mode.sd_hz for mode in modes]))


def _with_tests(problem: Problem, tests: Sequence[Test]) -> Problem:
    """The problem of other tests, with what of all that is uncertain they depend on."""
    nuisances = problem.prior.nuisances
    names = [nuisance.name for nuisance in nuisances]
    used = {own_name(test.name, name, names) for test in tests for name in likelihood_of(test.data, test).names}
    prior = replace(problem.prior, nuisances=tuple(n for n in nuisances if n.name in used))
    return Problem(tests, prior, problem.initial, name=f"{problem.name}: modes")


def which_to_believe(posterior: JudgedPosterior, asked: ModesProblem) -> tuple[bool, str]:
    """Whether the answer of the modes is to be believed, not that of the FRFs; and why.

    It is unless the model explains the FRFs and its errors, as stated, are smaller than what the noise of the FRFs
    leaves open of the frequencies.
    """
    stated = asked.sizes.frequency
    smallest = min(mode.sd_hz / mode.frequency_hz for mode in asked.used if not mode.held)
    if not posterior.check.explains:
        return True, "the model does not explain the FRFs within their noise"
    if stated > smallest:
        return True, (
            f"the model itself may be wrong by {number(100 * stated, 2)} % of a natural frequency, more than the "
            f"{number(100 * smallest, 2)} % that the noise of the FRFs leaves open"
        )
    return False, (
        f"the model explains them, and is stated to be wrong by {number(100 * stated, 2)} % of a natural frequency at "
        f"most, less than the {number(100 * smallest, 2)} % that their noise leaves open"
    )


def modes_answer(
    posterior: JudgedPosterior, of_modes: JudgedPosterior, asked: ModesProblem, assumed: tuple[str, ...] = ()
) -> ModesAnswer:
    """What the modes say, and whether that is the answer to believe, see `which_to_believe`.

    Parameters
    ----------
    posterior, of_modes
        Of the FRFs, and of the modes that they show.
    asked
        The problem of the latter.
    assumed
        What is uncertain in it that nobody stated, in words.
    """
    believed, reason = which_to_believe(posterior, asked)
    prior, likelihood = of_modes.problem.prior, of_modes.problem.log_posterior.likelihood
    rng, theta = np.random.default_rng([posterior.record.seed, _STREAM]), of_modes.thinned(_SIZES)
    size = likelihood.draw_error_size(asked.sizes, prior.matrix(theta), prior.factors(theta), rng)
    assert size is not None
    low, middle, high = np.quantile(size, [0.025, 0.5, 0.975]).tolist()
    known = {
        name: replace(of_modes.identifiability(name), unit=of_modes.unit(name)) for name in posterior.stiffness_names
    }
    return ModesAnswer(known, asked.used, asked.left_out, (middle, low, high), believed, reason, assumed)
