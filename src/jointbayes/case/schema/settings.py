"""The tables of a case file that set what is done with the data, and `[reference]`, what it is compared with."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, Field, Strict

from jointbayes.case.errors import Finding, raise_findings
from jointbayes.case.schema.fields import (
    FREQUENCIES,
    Frequencies,
    Labels,
    Positive,
    Spec,
    count_field,
    key_field,
    not_negative,
    positive,
    repeated,
)
from jointbayes.case.schema.joint import StiffnessSpec
from jointbayes.case.schema.limits import MOST_ENSEMBLES, MOST_PROCESSES, MOST_STEPS, MOST_WALKERS
from jointbayes.case.schema.setups import PlannedSetupSpec
from jointbayes.joint import COUPLED, HYPOTHESES, USUAL_HYPOTHESES


class IdentificationSpec(Spec):
    """The paper's iteration; ``threshold`` is relative to the norm of the measured FRF."""

    sensitivity: Annotated[Literal["measured", "analytical"], key_field('"measured" or "analytical"', "measured")] = (
        "measured"
    )
    max_steps: Annotated[int, count_field("the largest number of steps", 30, 1, 10000)] = 30
    threshold: Annotated[float, positive("the residual to stop at, relative to the measured FRF", 1e-8)] = 1e-8
    line_weight: Annotated[
        float, not_negative("the exponent p of the weights |H|^-p of the lines, 0 as in the paper", 0.5)
    ] = 0.0


class SamplingSpec(Spec):
    """The sampler: independent ensembles of walkers, and the most steps of each."""

    seed: Annotated[int, count_field("the seed", 1, 0)] = 1
    ensembles: Annotated[int, count_field("the number of ensembles", 4, 4, MOST_ENSEMBLES)] = 4
    walkers: Annotated[int, count_field("the number of walkers", 48, 8, MOST_WALKERS, 2)] = 48
    max_steps: Annotated[int, count_field("the largest number of steps", 20000, 200, MOST_STEPS)] = 20000
    processes: Annotated[int, count_field("the number of processes", 2, 1, MOST_PROCESSES)] = 1


class ReferenceSpec(StiffnessSpec):
    """Published values to compare with; ``paper_audit`` appends the audit of the paper's tables."""

    source: Annotated[str, Field(min_length=1), key_field("a text: where the values are published", "Table 3")]
    natural_frequencies_hz: Annotated[Frequencies, FREQUENCIES] = ()
    paper_audit: Annotated[bool, key_field("true (append the audit of the paper's tables) or false", True)] = False


if TYPE_CHECKING:
    Hypothesis = str
else:
    Hypothesis = Literal[tuple(HYPOTHESES)]


def _each_once(hypotheses: tuple[Hypothesis, ...]) -> tuple[Hypothesis, ...]:
    raise_findings(
        Finding((i,), f'"{name}" is listed twice', "each hypothesis once", "remove the repeated one")
        for i, name in repeated(hypotheses)
    )
    return hypotheses


_HYPOTHESES = key_field(
    "a list of at least one of " + ", ".join(f'"{name}"' for name in HYPOTHESES), ["rigid", "springs", "full"]
)
_Hypotheses = Annotated[tuple[Hypothesis, ...], Strict(False), Field(min_length=1), AfterValidator(_each_once)]


class CompareSpec(Spec):
    """What `jointbayes compare` sets against each other: how much of the joint is flexible."""

    hypotheses: Annotated[_Hypotheses, _HYPOTHESES] = USUAL_HYPOTHESES


_COUPLING = next(quantity.name for quantity in COUPLED if quantity.may_be_negative)
_PARAMETER = key_field("the stiffness to be known best, by its name; without it the first coupling", _COUPLING)
_AVERAGES_FACTOR = Field(gt=1, description="the factor on the averages, a number above 1", examples=[4.0])
_F_MAX = Field(description="the highest frequency of a wider band in Hz, a number greater than 0", examples=[5000.0])
_ADDED_MASS = Field(description="the mass in g to add on trial, a number greater than 0", examples=[50.0])


_TOGETHER = Field(
    max_length=8,
    description="a list of sets of candidates to rank beside single ones, each a list of their names",
    examples=[[["6:y", "short"]]],
)
_Set = Annotated[tuple[str, ...], Strict(False), Field(min_length=2, max_length=8, description="a list of names")]


class PlanSpec(Spec):
    """The further measurements that `jointbayes plan` ranks; an empty list stands for the default."""

    parameter: Annotated[str, _PARAMETER] = ""
    outputs: Annotated[Labels, key_field("a list of DOFs that could be measured", ["6:y"])] = ()
    inputs: Annotated[Labels, key_field("a list of DOFs that could be excited", ["11:y"])] = ()
    max_measurements: Annotated[int, count_field("the largest number of further measurements", 1, 1, 4)] = 1
    setups: Annotated[
        dict[str, PlannedSetupSpec],
        Field(description="tests that could be made, a table for each by its name, as [plan.setups.short.structure]"),
    ] = {}  # noqa: RUF012 (pydantic copies it)
    together: Annotated[tuple[_Set, ...], Strict(False), _TOGETHER] = ()
    averages_factor: Annotated[float, _AVERAGES_FACTOR] = 4.0
    f_max_hz: Annotated[Positive | None, _F_MAX] = None
    added_mass_g: Annotated[Positive | None, _ADDED_MASS] = None
