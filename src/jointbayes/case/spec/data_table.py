"""The `[data]` table of a case file: what was measured, or how synthetic measurements are made."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import singledispatch
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from jointbayes.case.spec.fields import (
    DATA_KIND,
    FREQUENCIES,
    MOST_VALUES,
    DataTable,
    Finding,
    Frequencies,
    KeyPath,
    Labels,
    Ratios,
    Spec,
    count_field,
    key_field,
    law_findings,
    not_above,
    not_negative,
    positive,
)
from jointbayes.case.spec.measured_table import MeasuredFrequenciesSpec, MeasuredFrfSpec, MeasuredSpec
from jointbayes.case.spec.mode_data_table import ModesSpec
from jointbayes.case.spec.prior_tables import NamedStiffnessSpec

if TYPE_CHECKING:
    from vibrecords import FrequencyData, NoiseLaw

_MOST_LINES = 1_000_000  # frequency lines; more is a slip in f_step_hz, and would fill the memory


_COHERENCE = Field(gt=0, lt=1, description="the coherence γ², a number above 0 and below 1", examples=[0.98])
# One average makes every coherence 1, so that it says nothing about the noise.
_AVERAGES = Field(ge=2, le=10**6, description="the number of averages, a whole number from 2 to 1000000", examples=[10])
_MASS = not_negative("the mass in g of each accelerometer that makes the data", 2.0)
_RATIO = key_field("the damping ratio that makes the data, from 0 to below 1, or a list of such numbers", 0.01)


class NoiseSpec(Spec):
    """Noise of synthetic data: relative to |H| with a floor, or the one that a coherence leaves after averaging."""

    relative: Annotated[float, not_negative("the standard deviation as a fraction of |H|", 0.03)] = 0.0
    floor: Annotated[float, not_negative("the standard deviation as a fraction of the median |H|", 0.01)] = 0.0
    coherence: Annotated[float | None, _COHERENCE] = None
    averages: Annotated[int | None, _AVERAGES] = None
    seed: Annotated[int, count_field("the seed", 1, 0)]
    added: Annotated[bool, key_field("true (noise in the data) or false (in the likelihood only)", True)] = True

    def law(self) -> NoiseLaw:
        """The law."""
        from vibrecords import CoherenceNoise, RelativeNoise

        if self.coherence is not None and self.averages is not None:
            return CoherenceNoise(self.coherence, self.averages, self.floor)
        return RelativeNoise(self.relative, self.floor)

    def try_objects(self) -> None:
        """The law."""
        self.law()

    def _findings(self) -> Iterator[Finding]:
        if self.coherence is None and self.averages is None:
            yield from law_findings(self)
        elif self.coherence is None or self.averages is None:
            yield Finding(("coherence" if self.coherence is None else "averages",), missing=True)
        elif self.relative > 0:
            fault = f"found {self.relative!r} together with coherence"
            expected = "relative, or coherence and averages, not both"
            yield Finding(("relative",), fault, expected, "remove one of the two")


class TruthSpec(NamedStiffnessSpec):
    """The joint that makes the data, and where the structure that makes them differs from `[structure]`."""

    youngs_modulus_gpa: Annotated[float | None, positive("Young's modulus in GPa that makes the data", 210.0)] = None
    density_kg_m3: Annotated[float | None, positive("the density in kg/m³ that makes the data", 7800.0)] = None
    length_mm: Annotated[float | None, positive("the length of the beam in mm that makes the data", 360.0)] = None
    accelerometer_mass_g: Annotated[float | None, _MASS] = None
    gain: Annotated[float, positive("the factor on the measured FRFs", 1.02)] = 1.0
    damping_ratio: Annotated[Ratios | None, _RATIO] = None


_QUANTITY = key_field('the measured quantity, "receptance", "mobility" or "accelerance"', "receptance")


class SyntheticFrfSpec(DataTable):
    """FRFs computed from a stated truth, with noise; the frequencies are a band or a list."""

    frfs: ClassVar[bool] = True

    kind: Annotated[Literal["synthetic_frf"], DATA_KIND]
    outputs: Annotated[Labels, Field(min_length=1), key_field("a list of at least one measured DOF", ["11:y"])]
    inputs: Annotated[Labels, Field(min_length=1), key_field("a list of at least one excited DOF", ["11:y"])]
    quantity: Annotated[Literal["receptance", "mobility", "accelerance"], _QUANTITY] = "receptance"
    f_min_hz: Annotated[float | None, positive("the lowest frequency in Hz", 20.0)] = None
    f_max_hz: Annotated[float | None, positive("the highest frequency in Hz", 2500.0)] = None
    f_step_hz: Annotated[float | None, positive("the distance of the lines in Hz", 1.0)] = None
    frequencies_hz: Annotated[Frequencies | None, FREQUENCIES] = None
    truth: Annotated[TruthSpec, Field(description="the joint that makes the data: k11, k12, k22")]
    noise: Annotated[NoiseSpec, Field(description="the noise: relative, floor, seed")]

    @property
    def labelled(self) -> dict[KeyPath, tuple[str, ...]]:
        """Outputs and inputs."""
        return {("data", "outputs"): self.outputs, ("data", "inputs"): self.inputs}

    @property
    def band_hz(self) -> tuple[float, float]:
        """First and last line, Hz."""
        lines = self.lines_hz()
        return lines[0], lines[-1]

    @property
    def band_key(self) -> str:
        """The step, which is the first line where no f_min_hz is stated, or the list of lines."""
        return "frequencies_hz" if self.f_step_hz is None else "f_step_hz"

    def lines_hz(self) -> tuple[float, ...]:
        """Return the frequency lines in Hz; the last one is at ``f_max_hz`` or less than a step below."""
        if self.f_max_hz is None or self.f_step_hz is None:
            return self.frequencies_hz or ()
        lowest = self.f_min_hz or self.f_step_hz
        # The allowance keeps f_max itself when the division falls just short of a whole number.
        steps = math.floor((self.f_max_hz - lowest) / self.f_step_hz + 1e-9)
        return tuple(lowest + i * self.f_step_hz for i in range(steps + 1))

    def _findings(self) -> Iterator[Finding]:
        band = {"f_min_hz": self.f_min_hz, "f_max_hz": self.f_max_hz, "f_step_hz": self.f_step_hz}
        given = [key for key, value in band.items() if value is not None]
        if self.frequencies_hz is not None:
            if given:
                fault = f"given together with {', '.join(given)}"
                yield Finding(("frequencies_hz",), fault, "a list or a band, not both", "remove one of the two")
            if len(self.frequencies_hz) < 2:
                yield Finding(("frequencies_hz",), "", "at least two frequencies in Hz", "add frequencies")
        elif not given:
            remedy = "add f_max_hz = 2500.0 and f_step_hz = 1.0 to [data]"
            yield Finding((), "no frequencies", "f_max_hz and f_step_hz, or frequencies_hz", remedy)
        elif self.f_max_hz is None or self.f_step_hz is None:
            yield from (Finding((key,), missing=True) for key in ("f_max_hz", "f_step_hz") if key not in given)
        else:
            low_key, lowest = ("f_min_hz", self.f_min_hz) if self.f_min_hz else ("f_step_hz", self.f_step_hz)
            yield from not_above(lowest, self.f_max_hz, low_key, "f_max_hz", "in Hz")
            steps = (self.f_max_hz - lowest) / self.f_step_hz
            if 0 < steps < 1 - 1e-9:
                fault = f"empty band: {self.f_step_hz!r} Hz leaves only the line at {low_key} = {lowest!r}"
                yield Finding(("f_step_hz",), fault, "at least two lines up to f_max_hz", "lower f_step_hz")
            elif steps >= _MOST_LINES:
                fault = f"{self.f_step_hz!r} Hz makes {steps:.3g} lines"
                yield Finding(("f_step_hz",), fault, f"at most {_MOST_LINES} lines", "raise f_step_hz")
            elif steps * len(self.outputs) * len(self.inputs) > MOST_VALUES:
                frfs = len(self.outputs) * len(self.inputs)
                fault = f"{self.f_step_hz!r} Hz makes {steps:.3g} lines in each of {frfs} FRFs"
                yield Finding(("f_step_hz",), fault, f"at most {MOST_VALUES} values", "raise f_step_hz")


class NaturalFrequenciesSpec(DataTable):
    """Measured natural frequencies, the lowest ones in order; the two deviations add in quadrature."""

    field_keys = {"sd_hz": "sd_relative"}  # noqa: RUF012 (no field)

    kind: Annotated[Literal["natural_frequencies"], DATA_KIND]
    frequencies_hz: Annotated[Frequencies, Field(min_length=1), FREQUENCIES]
    sd_relative: Annotated[float, not_negative("the standard deviation as a fraction", 0.005)] = 0.0
    sd_hz: Annotated[float, not_negative("the standard deviation in Hz", 0.5)] = 0.0

    @property
    def least_modes(self) -> Mapping[KeyPath, int]:
        """Number of the highest mode."""
        return {("data", "frequencies_hz"): len(self.frequencies_hz)}

    @property
    def depends_on(self) -> frozenset[str]:
        """Nothing else."""
        return frozenset()

    @property
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest natural frequency, Hz."""
        return self.frequencies_hz[0], self.frequencies_hz[-1]

    def stated(self) -> FrequencyData:
        """The natural frequencies."""
        import numpy as np

        from vibrecords import FrequencyData

        frequency = np.array(self.frequencies_hz)
        return FrequencyData(frequency, np.hypot(self.sd_relative * frequency, self.sd_hz))

    def try_objects(self) -> None:
        """The natural frequencies."""
        self.stated()


@singledispatch
def synthetic_table(data: DataTable) -> SyntheticFrfSpec | None:
    """The table of data that a stated truth makes."""
    return None


@synthetic_table.register
def _synthetic_table(data: SyntheticFrfSpec) -> SyntheticFrfSpec:
    return data


@singledispatch
def files_table(data: DataTable) -> MeasuredSpec | None:
    """The table of data that are in measurement files."""
    return None


@files_table.register
def _files_table(data: MeasuredSpec) -> MeasuredSpec:
    return data


DataSpec = Annotated[
    SyntheticFrfSpec | NaturalFrequenciesSpec | ModesSpec | MeasuredFrfSpec | MeasuredFrequenciesSpec,
    Field(discriminator="kind", description="the data: their kind and what belongs to it"),
]
