"""The table `[data.layout]`: what the variables of a measurement file stand for, where their names do not tell."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from jointbayes.case.spec.fields import Spec, key_field

_VARIABLE = 'the variable of the file that holds {}, as "H", "run.H", "run(2).H" or, of a matrix, "data(:,2)"'
_Name = Annotated[str, Field(min_length=1, max_length=400)]


def _variable(held: str, example: str, or_number: str = "") -> object:
    return key_field(_VARIABLE.format(held) + or_number, example)


_OR = ", or the number itself in quotes"
_TABLE_AXIS = key_field('what the first column of a table is, "time" in s or "frequency_hz"', "time")


class LayoutSpec(Spec):
    """Names of variables by what they stand for; where one of values is given, nothing else of the file is read."""

    axis: Annotated[Literal["time", "frequency_hz"] | None, _TABLE_AXIS] = None
    frequency_hz: Annotated[_Name | None, _variable("the frequency lines in Hz", "Freq")] = None
    omega_rad_s: Annotated[_Name | None, _variable("the lines in rad/s", "w")] = None
    f_start_hz: Annotated[_Name | None, _variable("the first line in Hz", "f0", _OR)] = None
    f_step_hz: Annotated[_Name | None, _variable("the distance of lines in Hz", "df", _OR)] = None
    frf: Annotated[_Name | None, _variable("the complex FRFs", "H1")] = None
    real: Annotated[_Name | None, _variable("the real part of the FRFs", "a")] = None
    imaginary: Annotated[_Name | None, _variable("their imaginary part", "b")] = None
    magnitude: Annotated[_Name | None, _variable("the magnitude of the FRFs", "A")] = None
    magnitude_db: Annotated[_Name | None, _variable("the magnitude in dB, as 20 log10", "A")] = None
    phase: Annotated[_Name | None, _variable("the phase, with its unit in its name", "P_deg")] = None
    phase_deg: Annotated[_Name | None, _variable("the phase in degrees", "P")] = None
    phase_rad: Annotated[_Name | None, _variable("the phase in radians", "P")] = None
    coherence: Annotated[_Name | None, _variable("the coherence", "C")] = None
    time: Annotated[_Name | None, _variable("the instants in s", "tt")] = None
    sample_rate_hz: Annotated[_Name | None, _variable("the sampling rate in Hz", "rate", _OR)] = None
    samples: Annotated[_Name | None, _variable("the samples of all channels, one column each", "data")] = None
    force: Annotated[_Name | None, _variable("the force, hits in columns", "data(:,1)")] = None
    response: Annotated[_Name | None, _variable("the response, hits in columns", "data(:,2)")] = None
    mode_frequencies_hz: Annotated[_Name | None, _variable("the natural frequencies of modes in Hz", "freqs")] = None
    damping_ratios: Annotated[_Name | None, _variable("the damping ratios of modes", "zeta")] = None
    mode_shapes: Annotated[_Name | None, _variable("the shapes of modes, channels × modes", "V")] = None

    @property
    def names(self) -> Mapping[str, str]:
        """What is given, by key."""
        return {key: name for key, name in self.model_dump().items() if name is not None}
