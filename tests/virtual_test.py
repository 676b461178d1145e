"""Virtual tests for studies: measure the truth that a case states, and return what a measurement file would hold."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import scipy  # its parts load at first use

from jointbayes.case.case import AnyCase, Case, require_case
from jointbayes.case.case_objects import CaseTest, generator_of, true_family, true_stiffness
from jointbayes.case.spec.data_table import SyntheticFrfSpec
from jointbayes.errors import CaseError, MeasurementError
from jointbayes.frf import NaturalFrequencies, Ports, receptance_model, rigid_body_modes
from jointbayes.joint import JointMatrix
from jointbayes.reproducibility import one_blas_thread
from jointbayes.structure import Body
from tests.simulated import (
    ChannelNoise,
    Hammer,
    Rig,
    channel_label,
    hammer_records,
    lines_apart,
    noisy_frf,
    shaker_records,
)
from vibrecords import FrfSet, quantity_factor
from vibrecords.arrays import Array
from vibrecords.formats import records_of_frf
from vibrecords.records import Record, TimeRecord
from vibrecords.signals.impact import frfs_of_hits
from vibrecords.signals.spectra import ImpactSettings, MadeFrfs, ShakerSettings, frfs_of_shaker
from vibrecords.signals.windows import effective_averages

_AVERAGES = 10  # where neither the virtual test nor the noise of the data states a number
#: Length of a block times the decay rate of the slowest mode: what is cut off is below any noise; a shaker leaks.
_BLOCK_DECAY = {"impact": 10.0, "shaker": 30.0}
#: Time histories, and what makes FRFs of them.
_Histories = tuple[list[TimeRecord], Callable[[list[TimeRecord]], MadeFrfs]]
_GONE = 20.0  # the same, for what must have died away altogether


@dataclass(frozen=True)
class VirtualTest:
    """How a truth is measured, at the lines of `[data]`; `averages` are by default those of `[data.noise]`, or 10."""

    method: Literal["frf", "impact", "shaker"] = "frf"
    writes: Literal["frf", "time"] = "frf"
    averages: int | None = None
    extra_outputs: tuple[str, ...] = ()
    estimator: Literal["H1", "H2", "Hv"] = "H1"
    block_s: float | None = None  # by default the least multiple of 1/f_step_hz in which the slowest mode decays
    sample_rate_hz: float | None = None  # by default eight times the highest line
    force_noise: float = 0.0005  # sd over the peak of a nominal hit, or over the sd of the shaker's force
    response_noise: float = 0.001  # the same of each response
    exponential_end: float = 1.0
    double_hits: int = 0
    overloads: int = 0
    overlap: float = 0.5


@dataclass(frozen=True)
class Truth:
    """The structure and joint that make the data of a case, or of one of its tests by name.

    Raises
    ------
    CaseError
        If the data are not of kind ``"synthetic_frf"``: nothing else has a known truth; or if there is no such test,
        or several and none is named.
    """

    case: Case
    test: str = ""

    @cached_property
    def case_test(self) -> CaseTest:
        """The test; a lone test is one."""
        wanted = next((test for test in self.case.tests if test.name == self.test), None)
        if wanted is None:
            names = ", ".join(test.name for test in self.case.tests)
            raise CaseError(
                f"{self.case.name}: found test {self.test!r} to be simulated; expected one of {names or 'none'}; "
                "name it"
            )
        return wanted

    @cached_property
    def data(self) -> SyntheticFrfSpec:
        """The case's `[data]`."""
        data = self.case_test.spec.synthetic
        if data is None:
            expected = '"synthetic_frf", whose [data.truth] a virtual test can measure'
            words = f'found "{self.case_test.spec.data.kind}"', expected, "state a truth"
            raise CaseError(self.case_test.source.fault(("data", "kind"), *words))
        return data

    @cached_property
    def _structures(self) -> Body:
        return true_family(self.case_test.spec)

    @cached_property
    def matrix(self) -> JointMatrix:
        """True K^J, shape (2, 2)."""
        return self.case_test.spec.parametrisation.matrix(true_stiffness(self.case_test.spec))

    @cached_property
    def decay_rate(self) -> float:
        """Decay rate ζω of the slowest mode with the joint in place, 1/s; rigid motion does not count."""
        body, joint = self._structures.certain(), self.case_test.joint
        count, law = body.n_dofs - rigid_body_modes(body, joint), body.damping
        omega = 2 * np.pi * NaturalFrequencies(body, joint, count).frequency_hz(self.matrix)[0]
        alpha, beta = law.viscous
        ratio = law.per_mode(count) + law.hysteretic / 2
        return float((ratio * omega + (alpha + beta * omega**2) / 2).min())

    def frf(self, frequency_hz: Array, outputs: tuple[str, ...]) -> FrfSet:
        """Exact FRFs of the case's quantity and gain at given lines (lines,) in Hz, at given outputs."""
        ports = Ports(frequency_hz, outputs, self.data.inputs)
        model = receptance_model(self._structures.reference(), self.case_test.joint, ports)
        receptance = model.receptance(self.matrix)[0]
        values = self.data.truth.gain * receptance * quantity_factor(frequency_hz, self.data.quantity)[:, None, None]
        return FrfSet(frequency_hz, values, outputs, self.data.inputs, self.data.quantity)


@one_blas_thread()
def simulate(case: AnyCase, settings: VirtualTest | None = None, *, test: str = "", seed: int = 1) -> list[Record]:
    """Measure the truth of a case, or of one of its tests, whose data are computed.

    Returns one record for each pair of output and input, or for each channel and hit. The noise of `[data.noise]` is
    that of method ``"frf"``; the others have noise on their channels.

    Raises
    ------
    CaseError
        If the case, or the test, has no truth; or if there is no such test.
    MeasurementError
        If the test cannot be made so, for example with blocks too short for the lines.
    """
    truth = Truth(require_case(case), test)
    return _measured(truth, settings or VirtualTest(), generator_of(seed, truth.case_test.name))


def _measured(truth: Truth, test: VirtualTest, rng: np.random.Generator) -> list[Record]:
    outputs = truth.data.outputs + test.extra_outputs
    averages = test.averages or truth.data.noise.averages or _AVERAGES
    if test.method == "frf":
        true = truth.frf(np.array(truth.data.lines_hz()), outputs)
        noisy = noisy_frf(true, truth.data.noise.built(), averages, rng)
        return list(records_of_frf(noisy, channel_label, "virtual test"))
    histories = _impact if test.method == "impact" else _shaker
    records, frfs_of = histories(truth, test, _rig(truth, test, outputs), averages, rng)
    if test.writes == "time":
        return list(records)
    frfs, step = frfs_of(records).frfs, truth.data.f_step_hz
    # the lines that the case has, where those of the block are closer
    return [frf if step is None else frf.at_lines(lines_apart(frf.frequency_hz, step)) for frf in frfs]


def _rig(truth: Truth, test: VirtualTest, outputs: tuple[str, ...]) -> Rig:
    """Structure and analyser; blocks are multiples of 1/f_step_hz, so that the lines of the case are among theirs."""
    decay = truth.decay_rate
    if not decay > 0:
        raise MeasurementError(
            "virtual test: found a structure without damping; expected some, without which no hit ever ends; state it "
            "in [structure.damping]"
        )
    step, highest = truth.data.f_step_hz, truth.data.lines_hz()[-1]
    block_s = test.block_s
    if block_s is None:
        enough = _BLOCK_DECAY[test.method] / decay
        block_s = enough if step is None else math.ceil(enough * step) / step
    rate = test.sample_rate_hz or math.ceil(8 * highest * block_s) / block_s
    if rate < 2.56 * highest:
        raise MeasurementError(
            f"virtual test: found {rate:g} samples per second for lines up to {highest:g} Hz; expected at least "
            f"{2.56 * highest:g}; raise sample_rate_hz"
        )
    return Rig(
        lambda lines: truth.frf(lines, outputs).values,
        outputs,
        truth.data.inputs,
        truth.data.quantity,
        rate,
        round(block_s * rate),
        _GONE / decay,
    )


def _impact(truth: Truth, test: VirtualTest, rig: Rig, averages: int, rng: np.random.Generator) -> _Histories:
    low, high = truth.data.band_hz
    hammer = Hammer(averages, 1 / high, test.double_hits, test.overloads)
    records = list(hammer_records(rig, hammer, ChannelNoise(test.force_noise, test.response_noise), rng))
    settings = ImpactSettings(
        force_window_s=2 * hammer.pulse_s,
        exponential_end=test.exponential_end,
        estimator=test.estimator,
        f_min_hz=low,
        f_max_hz=high,
    )
    return records, lambda made: frfs_of_hits(made, settings)


def _shaker(truth: Truth, test: VirtualTest, rig: Rig, averages: int, rng: np.random.Generator) -> _Histories:
    low, high = truth.data.band_hz
    settings = ShakerSettings(rig.block / rig.sample_rate_hz, test.overlap, "hann", test.estimator, low, high)
    hop = max(round(rig.block * (1 - test.overlap)), 1)
    window = np.asarray(scipy.signal.get_window("hann", rig.block), dtype=float)
    # as many blocks as it takes for them to count as the averages that are asked for
    blocks = next(n for n in range(averages, 10**9) if effective_averages(n, window, hop) >= averages)
    noise = ChannelNoise(test.force_noise, test.response_noise)
    records = list(shaker_records(rig, rig.block + (blocks - 1) * hop, noise, rng))
    return records, lambda made: frfs_of_shaker(made, settings)
