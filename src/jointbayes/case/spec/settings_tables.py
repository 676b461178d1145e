"""The tables of a case file that set what is done with the data, and `[reference]`, what it is compared with.

Noise models, the sampler, hypotheses, virtual tests; and `[tests.NAME]`, what differs between several tests.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import date, datetime
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, BeforeValidator, Field, Strict

from jointbayes.case.spec.fields import (
    FREQUENCIES,
    JOINED,
    MOST_ENSEMBLES,
    MOST_STEPS,
    MOST_WALKERS,
    OWN,
    Finding,
    Frequencies,
    Labels,
    ListOf,
    Name,
    Positive,
    Spec,
    band_lines,
    count_field,
    distinct,
    key_field,
    max_length,
    not_above,
    not_negative,
    positive,
    raise_findings,
    table_field,
)
from jointbayes.case.spec.prior_tables import NamedStiffnessSpec
from jointbayes.joint import HYPOTHESES, USUAL_HYPOTHESES
from jointbayes.verdict_rule import RULE

_LINE = r"^[^\r\n]*$"


def _what(of: str, example: str, **default: Any) -> Any:  # noqa: ANN401
    text = f"{of}: a text of one line, at most 200 characters"
    return Field(**default, max_length=200, pattern=_LINE, description=text, examples=[example])


def _day(value: object) -> object:
    """A day as text: TOML has dates of its own, with or without quotes."""
    if isinstance(value, date):
        return (value.date() if isinstance(value, datetime) else value).isoformat()
    if isinstance(value, str) and value:
        try:
            return date.fromisoformat(value).isoformat()
        except ValueError:
            raise_findings([Finding((), "", "", "write year, month and day in this order")])
    return value


class AboutSpec(Spec):
    """What was tested, when, by whom and with what, as a report has it: no number depends on it."""

    specimen: str = _what("what was tested", "Clamp 12, serial number 0471", default="")
    date: Annotated[str, BeforeValidator(_day)] = key_field("the day of the test, as 2026-11-25", "2026-11-25", "")
    operator: str = _what("who made the test", "A. Miller", default="")
    instruments: str = _what("what it was measured with", "hammer PCB 086C03, accelerometer 352C33", default="")
    computed: str = _what("what the data were computed from, if nothing was measured", "a model of mine", default="")


class IdentificationSpec(Spec):
    """The paper's iteration; ``threshold`` is relative to the norm of the measured FRF."""

    sensitivity: Literal["measured", "analytical"] = key_field('"measured" or "analytical"', "measured", "measured")
    max_steps: int = count_field("the largest number of steps", 30, 1, 10000, default=30)
    threshold: float = positive("the residual to stop at, relative to the measured FRF", 1e-8, 1e-8)
    line_weight: float = not_negative("the exponent p of the weights |H|^-p of the lines, 0 as in the paper", 0.5, 0.0)


class SamplingSpec(Spec):
    """The sampler: independent ensembles of walkers, and the most steps of each."""

    seed: int = count_field("the seed", 1, 0, default=1)
    ensembles: int = count_field("the number of ensembles", 4, 4, MOST_ENSEMBLES, default=4)
    walkers: int = count_field("the number of walkers", 48, 8, MOST_WALKERS, 2, default=48)
    max_steps: int = count_field("the largest number of steps", 20000, 200, MOST_STEPS, default=20000)
    max_evaluations: int | None = count_field(
        "the most evaluations of search and of sampling, each", 4_000_000, 1, 10**12, default=None
    )


class ReferenceSpec(NamedStiffnessSpec):
    """Published values to compare with."""

    source: Annotated[str, Field(min_length=1)] = key_field("a text: where the values are published", "Table 3")
    natural_frequencies_hz: Annotated[Frequencies, FREQUENCIES] = ()


_NAMES_OF_HYPOTHESES = tuple(HYPOTHESES)
Hypothesis = Literal[_NAMES_OF_HYPOTHESES]  # type: ignore[valid-type]


_HYPOTHESES = key_field(
    "a list of at least one of " + ", ".join(f'"{name}"' for name in HYPOTHESES), ["rigid", "springs", "full"]
)
_Hypotheses = Annotated[ListOf[Hypothesis], Field(min_length=1), AfterValidator(distinct)]


class CompareSpec(Spec):
    """What `jointbayes compare` sets against each other: how much of the joint is flexible."""

    hypotheses: Annotated[_Hypotheses, _HYPOTHESES] = USUAL_HYPOTHESES


def _ratio(of: str, example: float, **default: Any) -> Any:  # noqa: ANN401
    what = f"the largest upper over lower end of the 95 % interval of {of} stiffness, a number greater than 1"
    return Field(**default, gt=1, description=what, examples=[example])


_CONTRACTION = "the least share of the prior's variance removed, a number greater than 0 and below 1"


class VerdictSpec(Spec):
    """Thresholds of the verdict on one stiffness."""

    identified: float = _ratio("an identified", 1.02, default=RULE.identified)
    weakly_identified: float = _ratio("a weakly identified", 2.0, default=RULE.weakly_identified)
    contraction: float = key_field(_CONTRACTION, 0.6, RULE.contraction, gt=0, lt=1)


def _changes(of: str, **default: Any) -> Any:  # noqa: ANN401
    return Field(**default, description=f"what is different in {of}, a table")


_Table = dict[str, Any] | None


class TestSpec(Spec):
    """One test of several: what is different from the rest of the file, whose tables these are."""

    joined: Annotated[bool, JOINED] = True
    structure: _Table = _changes("the structure", default=None)
    joint: _Table = _changes("the joint", default=None)
    joints: _Table = _changes("the joints", default=None)
    uncertain: _Table = _changes("what else is uncertain", default=None)
    data: _Table = _changes("the data", default=None)
    bodies: _Table = _changes("the measured bodies", default=None)
    prior: _Table = _changes("the priors of a joint of its own", default=None)
    noise: _Table = _changes("how residuals are judged", default=None)


_LEFT_MODES = Field(description="a list of the numbers of modes that are left out and predicted", examples=[[3, 4]])
_LEFT_BANDS = key_field("a list of bands [lowest, highest] in Hz whose lines are left out and predicted", [[300, 400]])


class LeftOutSpec(Spec):
    """What of the data does not enter the estimate and is predicted by it."""

    modes: Annotated[ListOf[Annotated[int, Field(ge=1, le=1000)]], max_length(1000), _LEFT_MODES] = ()
    bands_hz: Annotated[ListOf[Annotated[tuple[float, Positive], Strict(False)]], max_length(1000), _LEFT_BANDS] = ()
    tests: ListOf[Name] = key_field("a list of the names of tests that are left out and predicted", ["long"], ())


_MOST_LINES = 100_000  # of a prediction


class LobesSpec(Spec):
    """A milling cut whose stability lobes are wanted: tool, material and spindle speeds."""

    x: str = key_field("the DOF of the tool's tip along the feed", "tip:y")
    y: str = key_field("the DOF of the tool's tip across the feed", "tip:z")
    teeth: int = count_field("the number of teeth", 4, 1, 1000)
    kt_mpa: float = positive("the tangential cutting coefficient in MPa", 800.0)
    kr: float = not_negative("the radial force over the tangential one", 0.3)
    immersion: float = key_field(
        "the width of cut over the tool's diameter, a number above 0 and at most 1", 0.5, gt=0, le=1
    )
    milling: Literal["up", "down"] = key_field('"up" or "down"', "down")
    speed_min_rpm: float = positive("the lowest spindle speed in rev/min", 6000.0)
    speed_max_rpm: float = positive("the highest spindle speed in rev/min", 20000.0)

    def _findings(self) -> Iterator[Finding]:
        yield from not_above(self.speed_min_rpm, self.speed_max_rpm, "speed_min_rpm", "speed_max_rpm", "in rev/min")


class PredictSpec(Spec):
    """What `jointbayes predict` wants to know of this structure, held by a joint that was identified in another one."""

    outputs: Annotated[Labels, Field(min_length=1)] = key_field("a list of DOFs whose motion is wanted", ["tip:y"])
    inputs: Annotated[Labels, Field(min_length=1)] = key_field("a list of DOFs at which a force acts", ["tip:y"])
    f_min_hz: float = positive("the lowest frequency in Hz", 20.0)
    f_max_hz: float = positive("the highest frequency in Hz", 2500.0)
    f_step_hz: float = positive("the distance of the lines in Hz", 1.0)
    quantity: Literal["receptance", "mobility", "accelerance"] = key_field(
        'what is predicted, "receptance", "mobility" or "accelerance"', "receptance", "receptance"
    )
    lobes: LobesSpec | None = table_field("a milling cut whose stability lobes are wanted", None)

    def lines_hz(self) -> tuple[float, ...]:
        """The lines, Hz; the last one is at ``f_max_hz`` or less than a step below."""
        return band_lines(self.f_min_hz, self.f_max_hz, self.f_step_hz)

    def _findings(self) -> Iterator[Finding]:
        yield from not_above(self.f_min_hz, self.f_max_hz, "f_min_hz", "f_max_hz", "in Hz")
        if self.f_max_hz > self.f_min_hz and (self.f_max_hz - self.f_min_hz) / self.f_step_hz > _MOST_LINES:
            yield Finding(("f_step_hz",), f"found {self.f_step_hz:g}", f"at most {_MOST_LINES} lines", "raise it")


#: Each is a module of `jointbayes.inference.noise`.
Distribution = Literal["gaussian", "student_t", "proportional"]
_NAMES = " or ".join(f'"{name}"' for name in get_args(Distribution))
_SCALE = key_field('the factor on the stated noise, "known" (1), "sampled" or "integrated"', "known")
_SCALE_LOW = key_field("the smallest factor on the noise, a number above 0 and at most 1", 0.1, gt=0, le=1)
_SCALE_HIGH = Field(ge=1, description="the largest factor on the noise, a number of at least 1", examples=[10.0])


class NoiseModelSpec(Spec):
    """What the likelihood takes the residuals to be: their distribution, and the size of the noise."""

    used_with = {  # noqa: RUF012 (no field)
        "dof": ("distribution", "student_t"),
        **dict.fromkeys(("scale_low_factor", "scale_high_factor"), ("scale", "sampled")),
        **dict.fromkeys(("scale_dof", "scale_guess"), ("scale", "integrated")),
    }

    distribution: Distribution = key_field(f"the distribution of the residuals, {_NAMES}", "gaussian", "gaussian")
    dof: float = key_field("the degrees of freedom of student_t, a number above 2", 4.0, 4.0, gt=2)
    scale: Annotated[Literal["known", "sampled", "integrated"], _SCALE] = "known"
    scale_low_factor: Annotated[float, _SCALE_LOW] = 0.1
    scale_high_factor: Annotated[float, _SCALE_HIGH] = 10.0
    scale_dof: Positive = positive("the degrees of freedom of the prior of the squared factor", 4.0, 4.0)
    scale_guess: Positive = positive("the guess of the factor on the noise", 1.0, 1.0)
    own: Annotated[bool, OWN] = False

    @property
    def inferred(self) -> bool:
        """Whether parameters of the noise are sampled."""
        return self.scale == "sampled" or self.distribution == "proportional"

    def _findings(self) -> Iterator[Finding]:
        yield from not_above(self.scale_low_factor, self.scale_high_factor, "scale_low_factor", "scale_high_factor", "")
        if self.distribution != "gaussian" and self.scale == "integrated":
            law = self.distribution
            fault = f'found "integrated" with distribution = "{law}": the integral over the factor is Gaussian only'
            yield Finding(("scale",), fault, f'"known" or "sampled" with {law}', 'write scale = "sampled"')
