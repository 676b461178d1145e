"""The `[virtual_test]` table of a case file: how `jointbayes simulate` measures the truth of `[data.truth]`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from jointbayes.case.errors import Finding
from jointbayes.case.schema.fields import (
    Fraction,
    Labels,
    Positive,
    Spec,
    count_field,
    key_field,
    not_negative,
    positive,
)

_METHOD = key_field('how the truth is measured, "frf", "impact" or "shaker"', "impact")
_WRITES = key_field('what the file holds, "frf" or "time"', "frf")
_ESTIMATOR = key_field('the estimator of the FRFs, "H1", "H2" or "Hv"', "H1")
_AVERAGES = Field(ge=1, le=10_000, description="the number of averages, a whole number from 1 to 10000", examples=[10])
_OVERLAP = Field(
    ge=0, lt=1, description="the overlap of the blocks, a number of at least 0 and below 1", examples=[0.5]
)
_FORCE_NOISE = not_negative("the noise of the force channel as a fraction of a typical peak", 0.001)
_RESPONSE_NOISE = not_negative("the noise of the response channels as a fraction of a typical peak", 0.001)
_MOST_HITS = 10_000

#: Keys that some methods only use: anywhere else a value for them would be lost without a word.
_USED_WITH = {
    "writes": ("impact", "shaker"),
    "estimator": ("impact", "shaker"),
    "block_s": ("impact", "shaker"),
    "sample_rate_hz": ("impact", "shaker"),
    "force_noise": ("impact", "shaker"),
    "response_noise": ("impact", "shaker"),
    "exponential_end": ("impact",),
    "double_hits": ("impact",),
    "overloads": ("impact",),
    "overlap": ("shaker",),
}


class VirtualTestSpec(Spec):
    """A test on paper with the truth of `[data.truth]`, in the band of `[data]`."""

    method: Annotated[Literal["frf", "impact", "shaker"], _METHOD] = "frf"
    writes: Annotated[Literal["frf", "time"], _WRITES] = "frf"
    seed: Annotated[int, count_field("the seed", 1, 0)] = 1
    averages: Annotated[int | None, _AVERAGES] = None
    extra_outputs: Annotated[Labels, key_field("a list of further measured DOFs", ["1:y"])] = ()
    estimator: Annotated[Literal["H1", "H2", "Hv"], _ESTIMATOR] = "H1"
    block_s: Annotated[Positive | None, positive("the length of a block in s", 1.0)] = None
    sample_rate_hz: Annotated[Positive | None, positive("the number of samples per second", 10_000.0)] = None
    force_noise: Annotated[float, _FORCE_NOISE] = 0.0005
    response_noise: Annotated[float, _RESPONSE_NOISE] = 0.001
    exponential_end: Annotated[Fraction, key_field("the exponential window at the end of a block", 0.05)] = 1.0
    double_hits: Annotated[int, count_field("the number of double hits", 1, 0, _MOST_HITS)] = 0
    overloads: Annotated[int, count_field("the number of overloaded hits", 1, 0, _MOST_HITS)] = 0
    overlap: Annotated[float, _OVERLAP] = 0.5

    def _findings(self) -> Iterator[Finding]:
        for key, methods in _USED_WITH.items():
            value = getattr(self, key)
            if self.method not in methods and value != type(self).model_fields[key].default:
                expected = " or ".join(f'"{method}"' for method in methods)
                found = f'found {value!r}, which method = "{self.method}" does not use'
                yield Finding((key,), found, f"method = {expected}", f"write method so, or remove {key}")
