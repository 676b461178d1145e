"""The tables of a case file that state a prior: `[prior]` for the joint, `[uncertain]` for all else."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from jointbayes.case.errors import Finding
from jointbayes.case.schema.fields import Positive, Spec, key_field, not_above, positive

__all__ = [
    "DecadesPriorSpec",
    "FactorPriorSpec",
    "LogNormalPriorSpec",
    "LogUniformPriorSpec",
    "PriorSpec",
    "PriorsSpec",
    "UncertainSpec",
    "UniformPriorSpec",
]

_DISTRIBUTION = key_field('the kind of prior, "log_uniform", "log_normal" or "decades"', "log_uniform")
_UNIT = "in the unit of the parameter (k11: N/m, k12: N, k22: N m/rad)"


class LogUniformPriorSpec(Spec):
    """Every order of magnitude between two bounds is equally probable."""

    distribution: Annotated[Literal["log_uniform"], _DISTRIBUTION]
    low: Annotated[float, positive(f"the lower bound {_UNIT}", 1e6)]
    high: Annotated[float, positive(f"the upper bound {_UNIT}", 1e11)]

    def _findings(self) -> Iterator[Finding]:
        yield from not_above(self.low, self.high, "low", "high", _UNIT)


class LogNormalPriorSpec(Spec):
    """The logarithm of the stiffness is normal about the logarithm of the median."""

    distribution: Annotated[Literal["log_normal"], _DISTRIBUTION]
    median: Annotated[float, positive(f"the median {_UNIT}", 1e9)]
    sd_log: Annotated[float, positive("the standard deviation of the natural logarithm", 1.0)]


class DecadesPriorSpec(Spec):
    """A guess that is good to so many decades either way with 95 % probability."""

    distribution: Annotated[Literal["decades"], _DISTRIBUTION]
    guess: Annotated[float, positive(f"the guess {_UNIT}", 1e9)]
    decades: Annotated[float, positive("the decades the guess may be off, 95 % inside", 1.0)]


Correlation = Annotated[float, Field(ge=-1, le=1)]


class UniformPriorSpec(Spec):
    """Every coupling coefficient rho = k12/√(k11 k22) between two bounds is equally probable."""

    distribution: Annotated[Literal["uniform"], key_field('"uniform", the only kind of prior for rho', "uniform")]
    low: Annotated[Correlation, key_field("the lower bound, a number from -1 to 1", -1.0)]
    high: Annotated[Correlation, key_field("the upper bound, a number from -1 to 1", 1.0)]

    def _findings(self) -> Iterator[Finding]:
        yield from not_above(self.low, self.high, "low", "high", "(from -1 to 1)")


_StiffnessPrior = LogUniformPriorSpec | LogNormalPriorSpec | DecadesPriorSpec
PriorSpec = Annotated[_StiffnessPrior, Field(discriminator="distribution")]


def _prior(parameter: str, unit: str) -> object:
    return Field(description=f"the prior of {parameter} ({unit}): its distribution and constants")


class PriorsSpec(Spec):
    """The priors, one for each of `JointSpec.parameters`."""

    k11: Annotated[PriorSpec | None, _prior("k11", "N/m")] = None
    k12: Annotated[PriorSpec | None, _prior("k12", "N")] = None
    k22: Annotated[PriorSpec | None, _prior("k22", "N m/rad")] = None
    rho: Annotated[UniformPriorSpec | None, _prior("rho", "no unit")] = None


_SD_PERCENT = Field(
    description="the standard deviation in percent of the value, a number greater than 0", examples=[2.0]
)
_LOW_FACTOR = Field(
    gt=0, le=1, description="the lowest factor on the value, a number above 0 and at most 1", examples=[0.1]
)
_HIGH_FACTOR = Field(ge=1, description="the highest factor on the value, a number of at least 1", examples=[10.0])


class FactorPriorSpec(Spec):
    """The prior of a positive quantity about its stated value: normal in the logarithm, or log-uniform."""

    sd_percent: Annotated[Positive | None, _SD_PERCENT] = None
    low_factor: Annotated[float | None, _LOW_FACTOR] = None
    high_factor: Annotated[float | None, _HIGH_FACTOR] = None

    def _findings(self) -> Iterator[Finding]:
        factors = {"low_factor": self.low_factor, "high_factor": self.high_factor}
        given = [key for key, value in factors.items() if value is not None]
        forms = "sd_percent, or low_factor and high_factor"
        if self.sd_percent is not None:
            if given:
                found = f"given together with {' and '.join(given)}"
                yield Finding(("sd_percent",), found, f"{forms}, not both", "remove one of the two")
        elif not given:
            yield Finding((), "no prior", forms, "add sd_percent = 2.0, or low_factor = 0.1 and high_factor = 10.0")
        elif self.low_factor is None or self.high_factor is None:
            yield from (Finding((key,), missing=True) for key in factors if key not in given)
        else:
            yield from not_above(self.low_factor, self.high_factor, "low_factor", "high_factor", "")


def _uncertain(what: str) -> object:
    return Field(description=f"the prior of {what}: sd_percent, or low_factor and high_factor")


class UncertainSpec(Spec):
    """What is a parameter beside the joint, each with its prior; what is not named here is known exactly."""

    youngs_modulus: Annotated[FactorPriorSpec | None, _uncertain("Young's modulus")] = None
    density: Annotated[FactorPriorSpec | None, _uncertain("the density")] = None
    length: Annotated[FactorPriorSpec | None, _uncertain("the length of the beam")] = None
    section_size: Annotated[FactorPriorSpec | None, _uncertain("one factor on all dimensions of the section")] = None
    shear_coefficient: Annotated[FactorPriorSpec | None, _uncertain("the shear coefficient")] = None
    damping_ratio: Annotated[FactorPriorSpec | None, _uncertain("each damping ratio")] = None
    loss_factor: Annotated[FactorPriorSpec | None, _uncertain("the loss factor")] = None
    accelerometer_mass: Annotated[FactorPriorSpec | None, _uncertain("the mass of the accelerometers")] = None
    mode_frequencies: Annotated[FactorPriorSpec | None, _uncertain("each predicted natural frequency")] = None
    gain: Annotated[FactorPriorSpec | None, _uncertain("the gain of the measurement, 1 by itself")] = None

    @property
    def given(self) -> dict[str, FactorPriorSpec]:
        """Priors that the file states, in the order of the fields, which is that of the coordinates."""
        stated = ((name, getattr(self, name)) for name in type(self).model_fields)
        return {name: prior for name, prior in stated if prior is not None}
