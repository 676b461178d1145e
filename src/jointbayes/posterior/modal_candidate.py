"""Further modes that could be measured: of the structure free, their ratios at one more sensor, and antiresonances."""

from dataclasses import dataclass, replace

import numpy as np

from jointbayes.inference import ModelErrorNoise, Problem
from jointbayes.joint import Joints
from jointbayes.posterior.candidate import FREE, FREE_WORDS, Candidate
from jointbayes.posterior.prediction import replace_values, simulated_values
from vibrecords import Antiresonances, ModalData, ModeData, ModeShapes, Observed
from vibrecords.arrays import Array

#: How well a sensor that roves, or one calibrated beside another, knows a ratio of components, as a fraction of it.
RELATIVE_CALIBRATION = 0.01
_NODE = 0.01  # ratios below this are not known better than one of this size
#: Standard deviation of natural frequencies beside a ratio of which nothing is to be said, as a fraction.
_UNKNOWN = 1e3
_KNOWN = 1 + 1e-6  # factor by which the size of an error may be larger where it is known


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModalCandidate(Candidate):
    """Natural frequencies; the ratio of each mode's component at a DOF to that at a reference; or antiresonances.

    Errors of the model in natural frequencies are those of the present ones, of which a further measurement of the same
    structure says nothing: beside ratios and antiresonances natural frequencies do not count.

    Parameters
    ----------
    numbers
        Of the modes, or of the antiresonances, from 1.
    relative
        Standard deviation of each value as a fraction of it.
    dof, reference
        Labels; empty of natural frequencies.
    held
        Label of the DOF at which force and sensor are, of antiresonances.
    """

    numbers: tuple[int, ...]
    relative: float
    dof: str = ""
    reference: str = ""
    held: str = ""

    def problem(self, problem: Problem, theta: Array, rng: np.random.Generator | None = None) -> Problem:
        """The modes measured where θ is the truth, see `Candidate`."""
        point, there = np.asarray(theta, dtype=float), self.without_data(problem)
        exact = _of_data(there, self._measured(np.ones(2 * len(self.numbers)))).log_posterior.predicted(point)[0]
        there = _of_data(there, self._measured(exact))
        if rng is None:
            return _with_usual_errors(there)
        values = simulated_values(there, point, rng)
        if self.dof or self.held:
            values[: len(self.numbers)] = exact[: len(self.numbers)]
        return replace_values(there, values)

    def _measured(self, values: Array) -> ModeData:
        """Data of some values: natural frequencies, then ratios or antiresonances."""
        frequency, ratios = np.split(values[: 2 * len(self.numbers)], [len(self.numbers)])
        if self.held:
            held = Antiresonances((self.held,) * len(ratios), Observed(ratios, self.relative * ratios), self.numbers)
            return ModeData(Observed(frequency, _UNKNOWN * frequency), numbers=self.numbers, zeros=held)
        if not self.dof:
            return ModeData(Observed(frequency, self.relative * frequency), numbers=self.numbers)
        components = Observed(ratios[:, None], self.relative * np.maximum(np.abs(ratios), _NODE)[:, None])
        shapes = ModeShapes((self.dof,), self.reference, components)
        return ModeData(Observed(frequency, _UNKNOWN * frequency), shapes=shapes, numbers=self.numbers)


def modes_hit_free(modes: ModalData, setup: str) -> ModalCandidate:
    """As many natural frequencies of the structure without its joints, as well known as the present ones."""
    numbers = tuple(range(1, modes.frequency_hz.size + 1))
    return ModalCandidate(
        name=FREE, words=FREE_WORDS, setup=setup, joint=Joints(()), numbers=numbers, relative=scatter(modes)
    )


def _of_data(problem: Problem, data: ModeData) -> Problem:
    """The problem of one test with other modes as its data, judged as its own."""
    noise = problem.test.noise
    if noise is not None:
        noise = noise.fitted_to(data, noise.parts)  # type: ignore[arg-type]  # that of modes takes modes
    return problem.with_test(data=data, noise=noise)


def _with_usual_errors(problem: Problem) -> Problem:
    """With errors of the model as large as they usually are: data that fit exactly would say that there are none."""
    noise = problem.test.noise
    if not isinstance(noise, ModelErrorNoise):
        return problem
    test = problem.test.with_model_error(replace(noise.sizes, factor=_KNOWN))
    return problem.with_test(noise=test.noise)


def scatter(modes: ModalData) -> float:
    """Standard deviation of natural frequencies that are measured as the present ones, as a fraction."""
    return float(np.median(modes.sd_hz / modes.frequency_hz))
