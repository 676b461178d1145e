"""Virtual tests: measure the truth that a case states, and return what a measurement file would hold."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from jointbayes.case import Case
from jointbayes.case_data import SyntheticFrfSpec
from jointbayes.case_objects import beam_recipe, noise_law, stiffness_of, true_beam
from jointbayes.case_virtual_test import VirtualTestSpec
from jointbayes.errors import CaseError
from jointbayes.frf import FrfSet, Ports, quantity_factor, receptance_model
from jointbayes.joint import joint_matrix
from jointbayes.measurement.records import FrfRecord, Record
from jointbayes.measurement.virtual_frf import frf_records, noisy_frf
from jointbayes.structure import Structure

__all__ = ["Truth", "describe", "simulate"]

_AVERAGES = 10  # where neither the virtual test nor the noise of the data states a number


@dataclass(frozen=True)
class Truth:
    """The structure and joint that make the data of a case.

    Raises
    ------
    CaseError
        If the case's data are not of kind ``"synthetic_frf"``: nothing else has a known truth.
    """

    case: Case

    @cached_property
    def data(self) -> SyntheticFrfSpec:
        """The case's `[data]`."""
        data = self.case.spec.data
        if not isinstance(data, SyntheticFrfSpec):
            raise CaseError(
                f'{self.case.name}: found data of kind = "{data.kind}"; expected "synthetic_frf", whose [data.truth] a '
                "virtual test can measure; state a truth"
            )
        return data

    @cached_property
    def structure(self) -> Structure:
        """The true structure without its joint, accelerometers in place."""
        return true_beam(beam_recipe(self.case.spec.structure, self.data), self.data.truth).structure()

    @cached_property
    def stiffness(self) -> NDArray[np.float64]:
        """True K^J, shape (2, 2)."""
        return joint_matrix(stiffness_of(self.data.truth))

    def frf(self, frequency_hz: NDArray[np.float64], outputs: tuple[str, ...]) -> FrfSet:
        """Exact FRFs of the case's quantity and gain at given lines (lines,) in Hz, at given outputs."""
        ports = Ports(frequency_hz, outputs, self.data.inputs)
        receptance = receptance_model(self.structure, self.case.problem.joint, ports).receptance(self.stiffness)[0]
        values = self.data.truth.gain * receptance * quantity_factor(frequency_hz, self.data.quantity)[:, None, None]
        return FrfSet(frequency_hz, values, outputs, self.data.inputs, self.data.quantity)


def simulate(case: Case, settings: VirtualTestSpec | None, rng: np.random.Generator) -> list[Record]:
    """Measure the truth of a case in a virtual test.

    Parameters
    ----------
    case
        Case with data of kind ``"synthetic_frf"``: its `[data.truth]` is measured at its outputs, for its inputs, in
        its band. The noise of `[data.noise]` is that of method ``"frf"``; the others have noise on their channels.
    settings
        The `[virtual_test]` table; None takes the case's own.
    rng
        Source of all noise, hits and forces.

    Returns
    -------
    list of FrfRecord or TimeRecord
        One for each pair of output and input, or one for each channel and hit.

    Raises
    ------
    CaseError
        If the case has no truth.
    MeasurementError
        If the test cannot be made so, for example with blocks too short for the lines.
    """
    truth = Truth(case)
    test = case.spec.virtual_test if settings is None else settings
    outputs = truth.data.outputs + test.extra_outputs
    averages = test.averages or truth.data.noise.averages or _AVERAGES
    true = truth.frf(np.array(truth.data.lines_hz()), outputs)
    return list(frf_records(noisy_frf(true, noise_law(truth.data.noise), averages, rng)))


def describe(records: list[Record]) -> list[str]:
    """What a virtual test holds, in a few lines of text."""
    frfs = [record for record in records if isinstance(record, FrfRecord)]
    lines = []
    if frfs:
        first = frfs[0]
        lines.append(
            f"{len(frfs)} FRF{'s' * (len(frfs) > 1)} ({first.quantity}) of {first.frequency_hz.size} lines, "
            f"{first.frequency_hz[0]:g} to {first.frequency_hz[-1]:g} Hz, averages: {first.averages}"
        )
    return lines
