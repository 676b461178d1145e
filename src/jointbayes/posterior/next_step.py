"""What to measure next: the further measurement that would tell most of the stiffness that is known least.

A first look, linearised about a few draws, among what needs nothing new but a sensor or time: `jointbayes plan`
simulates the measurements and knows of more kinds.
"""

import itertools
import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from jointbayes.errors import JointBayesError
from jointbayes.frf import Ports
from jointbayes.inference import Problem
from jointbayes.joint import Joints
from jointbayes.posterior.any_posterior import AnyPosterior
from jointbayes.posterior.coordinates import by_names
from jointbayes.posterior.first_look import (
    FREE,
    FREE_WORDS,
    RELATIVE_CALIBRATION,
    Candidate,
    FirstLook,
    ModalCandidate,
    as_measured,
    estimated_law,
    is_worth_hitting_free,
    modes_hit_free,
    repeated,
    scatter,
)
from jointbayes.posterior.identifiability import CERTAINTY, Identifiability
from jointbayes.posterior.phrases import WORKSHOP
from jointbayes.rounding import percent, sentence_start
from vibrecords import ModalData

#: Places of one further sensor that are looked at in each test.
_MOST_PLACES = 8
_AVERAGES = 4.0
_DRAWS = 5
#: What a measurement costs, by a word that names it.
_PRICES = {
    "hit free": "a test without the joint", "antiresonances": "a force and a sensor at one place",
    "accelerometer": "a sensor and its FRF", "averages": f"{_AVERAGES:g} times the measuring time",
    "modes": "a wider band",
}  # fmt: skip
#: Of a 95 % interval's half width in standard deviations; and up to which standard deviation of ln k it is told in %.
_HALF_WIDTH, _SMALL = 1.96, 0.2
#: A measurement that makes the standard deviation less than so many times smaller is not worth its price.
_LEAST_GAIN = 1.15
#: Standard deviations of ln k beyond which nothing is known of a stiffness, and up to which a forecast is worth a word:
#: 0.1 to 10 times.
_LARGEST, _WORTH_SAYING = 3.0, math.log(10.0) / 1.96


@dataclass(frozen=True, slots=True)
class NextStep:
    """A forecast: which measurement, and the standard deviation of ln of a stiffness before and after it.

    Both are linearised; `words` name the measurement in a sentence, `names` is empty where the run's other quantities
    are as it takes them, else the quantities that are uncertain in the forecast though the run takes them as exact.
    """

    quantity: str
    words: str
    sd_before: float
    sd_after: float
    names: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """The step with what it should bring, said to be an estimate, and its price."""
        rest = f" with {WORKSHOP}" if self.names else ""
        price = next(price for word, price in _PRICES.items() if word in self.words)
        return (
            f"{sentence_start(self.words)} should give {self.quantity} to {spread_in_words(self.sd_after)}"
            f"{rest} (95 %, an estimate). It costs {price}; `jointbayes plan` simulates it."
        )


def spread_in_words(sd: float) -> str:
    """The 95 % interval of a stiffness around its median, by the standard deviation of its logarithm.

    Examples
    --------
    >>> spread_in_words(0.045), spread_in_words(0.5), spread_in_words(9.0)
    ('±8.8 %', '0.38 to 2.7 times', 'beyond 0.0028 to 360 times')
    """
    if sd <= _SMALL:
        return f"±{percent(_HALF_WIDTH * sd)}"
    low, high = (float(f"{math.exp(side * _HALF_WIDTH * min(sd, _LARGEST)):.2g}") for side in (-1, 1))
    return f"{'' if sd <= _LARGEST else 'beyond '}{low:g} to {high:g} times"


def next_step(posterior: AnyPosterior, freed: Problem | None, judged: Mapping[str, Identifiability]) -> NextStep | None:
    """The further measurement that would tell most of the stiffness that is known least.

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
    NextStep
        None where nothing among what is looked at would help, it cannot be computed, or the draws have not converged.
    """
    problem = freed or posterior.problem
    if not posterior.record.converged:
        return None
    every = itertools.chain(_hit_free(problem), *map(_candidates, problem.parts))
    candidates = {candidate.name: candidate for candidate in every}
    if not candidates:
        return None
    theta = np.vstack([posterior.estimate.theta, posterior.thinned(_DRAWS - 1)])
    draws = by_names(theta, posterior.problem.names, problem.names)
    least_known_first = sorted(judged, key=lambda name: (CERTAINTY.get(judged[name].verdict, 0), -judged[name].ratio))
    try:
        look = FirstLook(problem, candidates, least_known_first[0], draws)
    except (JointBayesError, np.linalg.LinAlgError):
        return None
    for wanted in least_known_first:
        look = look.of(wanted)
        try:
            before = look.linearised(()).median
            best = min((look.linearised((name,)) for name in candidates), key=lambda look: look.median)
        except (JointBayesError, np.linalg.LinAlgError):
            continue
        if best.median <= _WORTH_SAYING and before > _LEAST_GAIN * best.median:
            names = tuple(name for name in problem.names if name not in posterior.problem.names)
            return NextStep(wanted, candidates[best.names[0]].words, before, best.median, names)
    return None


def _hit_free(problem: Problem) -> Iterator[Candidate]:
    """A test of the structure without its joints, of which there is none yet, as one of the present tests is made."""
    if not all(part.test.joints.size for part in problem.parts):
        return
    for part in filter(is_worth_hitting_free, problem.parts):
        test, test_name = part.test, part.test.name or FREE
        measured, modes = test.data.frfs, test.data.modes
        name, words = f"{test_name} {FREE}", f"a test of {FREE_WORDS}{_of_test(part.test.name)}"
        if measured is not None:
            yield as_measured(part, name, words, test=test_name, joint=Joints(()))
        elif modes is not None:
            yield from (replace(each, name=name, words=words) for each in modes_hit_free(test, modes, test_name))


def _of_test(test: str) -> str:
    return f" in test {test}" if test else ""


def _candidates(part: Problem) -> Iterator[Candidate]:
    """Of one test: one sensor more, more averages, two modes more or two antiresonances."""
    test, test_name = part.test, part.test.name
    measured, modes = test.data.frfs, test.data.modes
    of_test = _of_test(test_name)
    if measured is not None:
        frf, law = measured.frf, estimated_law(measured)
        directions = dict.fromkeys(dof.rpartition(":")[2] for dof in frf.outputs if ":r" not in dof)
        for label, place in _free_places(part, (*frf.outputs, *frf.inputs), directions):
            words, ports = f"an accelerometer at {place}{of_test}", Ports(frf.frequency_hz, (label,), frf.inputs)
            yield as_measured(part, f"{test_name} {label}", words, test=test_name, law=law, ports=ports)
        more = repeated(part, _AVERAGES)
        yield replace(
            more, name=f"{test_name} {more.name}", words=f"{_AVERAGES:g} times the averages{of_test}", test=test_name
        )
    elif modes is not None and test.most_modes >= max(modes.numbers) + 2:
        last = max(modes.numbers)
        yield ModalCandidate(
            name=f"{test_name} modes", words=f"modes {last + 1} and {last + 2}{of_test}", test=test_name,
            structure=test.structure, numbers=(last + 1, last + 2), relative=scatter(modes),
        )  # fmt: skip
        yield from _beside_modes(part, modes, of_test)


def _beside_modes(part: Problem, modes: ModalData, of_test: str) -> Iterator[Candidate]:
    """Of one test whose data are modes: one sensor more, or two antiresonances of the place that moves most."""
    test, test_name = part.test, part.test.name
    directions = dict.fromkeys(label.rpartition(":")[2] for label in test.joints.labels if ":r" not in label)
    places, zeros = _free_places(part, modes.dofs, directions), getattr(modes, "zeros", None)
    known = (*getattr(modes, "references", ()), *(zeros.dofs if zeros else ()))
    if not (places or known):
        return
    reference, at = (known[0], known[0]) if known else places.pop()
    for label, place in places[2::3]:
        yield ModalCandidate(
            name=f"{test_name} {label}", words=f"an accelerometer at {place}, calibrated with the one at {at}{of_test}",
            test=test_name, structure=test.structure, numbers=modes.numbers, relative=RELATIVE_CALIBRATION, dof=label,
            reference=reference,
        )  # fmt: skip
    seen = zip(zeros.dofs, zeros.numbers, strict=True) if zeros else ()
    first = 1 + max((number for dof, number in seen if dof == reference), default=0)
    numbers = (first, first + 1)
    if test.most_modes - 1 < first + 1:  # with that place held there is a mode less
        return
    how = "in a wider band" if first > 1 else "by force and sensor there"
    words = f"antiresonances {first} and {first + 1} at {at}, {how}{of_test}"
    yield ModalCandidate(
        name=f"{test_name} zeros", words=words, test=test_name, structure=test.structure, numbers=numbers,
        relative=scatter(modes), held=reference,
    )  # fmt: skip


def _free_places(part: Problem, measured: Collection[str], directions: Collection[str]) -> list[tuple[str, str]]:
    """Translations at which nothing is measured, in these directions, and where each is, away from joints."""
    test = part.test
    positions = getattr(getattr(test.structures, "recipe", None), "positions", None) or {}
    points = tuple(positions) or tuple(dict.fromkeys(dof.partition(":")[0] for dof in test.structures.labels))
    taken = {dof.rpartition(":")[0] for dof in test.joints.labels}
    every = [
        f"{point}:{direction}" for point in points for direction in directions
        if point not in taken and f"{point}:{direction}" not in measured
    ]  # fmt: skip
    chosen = [every[i] for i in np.unique(np.linspace(0, len(every) - 1, _MOST_PLACES).astype(int))] if every else []
    return [(dof, _place(dof, positions.get(dof.rpartition(":")[0]))) for dof in chosen]


def _place(dof: str, position: tuple[float, float, float] | None) -> str:
    """Where a DOF is: at so many mm along the axis of a straight structure, else at its point."""
    if position is None or any(position[1:]):
        return dof
    return f"{1e3 * position[0]:.4g} mm ({dof})"
