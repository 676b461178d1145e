"""The `[noise]` table of a case file: how the distance between data and model is judged."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal, get_args

from pydantic import Field

from jointbayes.case.errors import Finding
from jointbayes.case.schema.fields import OWN, Positive, Spec, key_field, not_above, positive

_SIGMAS = "in standard deviations of the noise"


class DiscrepancySpec(Spec):
    """A model error that is correlated along frequency; its size and length are parameters, log-uniform."""

    scale_low: Annotated[float, positive(f"the smallest discrepancy {_SIGMAS}", 0.03)] = 0.03
    scale_high: Annotated[float, positive(f"the largest discrepancy {_SIGMAS}", 100.0)] = 100.0
    length_low_hz: Annotated[float, positive("the shortest correlation length in Hz", 5.0)]
    length_high_hz: Annotated[float, positive("the longest correlation length in Hz", 500.0)]

    def _findings(self) -> Iterator[Finding]:
        yield from not_above(self.scale_low, self.scale_high, "scale_low", "scale_high", _SIGMAS)
        yield from not_above(self.length_low_hz, self.length_high_hz, "length_low_hz", "length_high_hz", "in Hz")


_RESIDUALS = key_field('"complex" (H itself) or "log_magnitude" (ln |H|, without the phase)', "complex")
#: Each is a module of `jointbayes.inference.noise`.
Distribution = Literal["gaussian", "student_t", "proportional"]
_NAMES = " or ".join(f'"{name}"' for name in get_args(Distribution))
_DISTRIBUTION = key_field(f"the distribution of the residuals, {_NAMES}", "gaussian")
_SCALE = key_field('the factor on the stated noise, "known" (1), "sampled" or "integrated"', "known")
_DOF = Field(gt=2, description="the degrees of freedom of student_t, a number above 2", examples=[4.0])
_SCALE_LOW = Field(
    gt=0, le=1, description="the smallest factor on the noise, a number above 0 and at most 1", examples=[0.1]
)
_SCALE_HIGH = Field(ge=1, description="the largest factor on the noise, a number of at least 1", examples=[10.0])
_DISCREPANCY = Field(description="a model error correlated along frequency: length_low_hz, length_high_hz")
# Keys that one choice alone uses: anywhere else a value for them would be lost without a word.
_USED_WITH = {
    "dof": ("distribution", "student_t"),
    "scale_low_factor": ("scale", "sampled"),
    "scale_high_factor": ("scale", "sampled"),
    "scale_dof": ("scale", "integrated"),
    "scale_guess": ("scale", "integrated"),
}


class NoiseModelSpec(Spec):
    """What the likelihood takes the residuals to be: their form, their distribution, and the size of the noise."""

    residuals: Annotated[Literal["complex", "log_magnitude"], _RESIDUALS] = "complex"
    distribution: Annotated[Distribution, _DISTRIBUTION] = "gaussian"
    dof: Annotated[float, _DOF] = 4.0
    scale: Annotated[Literal["known", "sampled", "integrated"], _SCALE] = "known"
    scale_low_factor: Annotated[float, _SCALE_LOW] = 0.1
    scale_high_factor: Annotated[float, _SCALE_HIGH] = 10.0
    scale_dof: Annotated[Positive, positive("the degrees of freedom of the prior of the squared factor", 4.0)] = 4.0
    scale_guess: Annotated[Positive, positive("the guess of the factor on the noise", 1.0)] = 1.0
    discrepancy: Annotated[DiscrepancySpec | None, _DISCREPANCY] = None
    own: Annotated[bool, OWN] = False

    @property
    def inferred(self) -> bool:
        """Whether parameters of the noise are sampled."""
        return self.scale == "sampled" or self.distribution == "proportional" or self.discrepancy is not None

    def _findings(self) -> Iterator[Finding]:
        for key, (switch, choice) in _USED_WITH.items():
            value, chosen = getattr(self, key), getattr(self, switch)
            if chosen != choice and value != type(self).model_fields[key].default:
                found = f'found {value!r}, which {switch} = "{chosen}" does not use'
                yield Finding((key,), found, f'{switch} = "{choice}"', f"write {switch} so, or remove {key}")
        yield from not_above(self.scale_low_factor, self.scale_high_factor, "scale_low_factor", "scale_high_factor", "")
        if self.distribution != "gaussian" and self.scale == "integrated":
            law = self.distribution
            found = f'found "integrated" with distribution = "{law}": the integral over the factor is Gaussian only'
            yield Finding(("scale",), found, f'"known" or "sampled" with {law}', 'write scale = "sampled"')
        yield from self._discrepancy_findings()

    def _discrepancy_findings(self) -> Iterator[Finding]:
        if self.discrepancy is None:
            return
        loc = ("discrepancy",)
        if self.distribution != "gaussian":
            found = f"residuals that are correlated are computed as Gaussian ones, not as {self.distribution}"
            yield Finding(loc, found, 'distribution = "gaussian" with a discrepancy', "remove one of the two")
        if self.scale == "integrated":
            found = "the factor cannot be integrated out where it scales only a part of the covariance"
            yield Finding(loc, found, 'scale = "known" or "sampled" with a discrepancy', 'write scale = "sampled"')
