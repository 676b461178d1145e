"""Building blocks of the case file's schema: described fields, DOF labels, lists, and the common base model."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Annotated, Self

import pydantic
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, Strict

from jointbayes.case.errors import Finding, raise_findings
from jointbayes.case.schema.limits import MOST_LABELS, MOST_RATIOS, beyond, limit_text


def key_field(description: str, example: object) -> object:
    """Field with what is expected of it, and an example."""
    return Field(description=description, examples=[example])


def either(words: Iterable[str]) -> str:
    """Texts a key may be: one, another or a third."""
    *first, last = words
    return f"{', '.join(first)} or {last}" if first else last


def ascii_unit(unit: str) -> str:
    """A unit as messages print it: ``"N m/rad"``, ``"no unit"``."""
    return "no unit" if unit == "1" else unit.replace("·", " ")


OWN = key_field("true (each set-up has its own) or false (one for all set-ups)", True)
FREQUENCIES = key_field("the frequencies in Hz, a list of numbers above 0 that increase", [120.0, 762.0])


def positive(what: str, example: float) -> object:
    """Field for a number above zero."""
    return Field(gt=0, description=f"{what}, a number greater than 0", examples=[example])


def not_negative(what: str, example: float) -> object:
    """Field for a number of at least zero."""
    return Field(ge=0, description=f"{what}, a number of at least 0", examples=[example])


def count_field(what: str, example: int, least: int, most: int = 2**32 - 1, step: int = 1) -> object:
    """Field for a whole number within limits."""
    text = f"{what}, {'a whole' if step == 1 else 'an even'} number from {least} to {most}"
    return Field(ge=least, le=most, multiple_of=step, description=text, examples=[example])


#: A number from 1, or a word; of one body among several with the body's name before it.
POINT_LABEL = r"(?:[A-Za-z][A-Za-z0-9_-]{0,59}\.)?(?:[1-9][0-9]{0,6}|[A-Za-z][A-Za-z0-9_-]{0,59})"


def _label(text: str) -> str:
    if not re.fullmatch(POINT_LABEL + ":(x|y|z|rx|ry|rz)", text):
        guess = re.fullmatch(r"\s*0*([1-9][0-9]{0,6})\W*([xyz]|r[xyz])\s*", text.lower())
        remedy = f'did you mean "{guess[1]}:{guess[2]}"?' if guess else 'write for example "1:y"'
        expected = "a DOF label node:direction, nodes counted from 1, direction x, y, z, rx, ry or rz"
        raise_findings([Finding((), "", expected, remedy)])
    return text


def _distinct(labels: tuple[str, ...]) -> tuple[str, ...]:
    raise_findings(
        Finding((i,), f'"{label}" is listed twice', "each DOF once", "remove the repeated label")
        for i, label in repeated(labels)
    )
    return labels


def repeated(entries: Iterable[str]) -> Iterator[tuple[int, str]]:
    """Yield place and text of each entry that an earlier one is equal to."""
    known: set[str] = set()
    for i, entry in enumerate(entries):
        if entry in known:
            yield i, entry
        known.add(entry)


def listed(words: Sequence[str], most: int = 12) -> str:
    """Words after each other, of many the first."""
    rest = len(words) - most
    return ", ".join(words[:most]) + (f" and {rest} more" if rest > 0 else "")


def at_most(count: int) -> BeforeValidator:
    """Refuses a longer list before its entries are looked at."""

    def check(value: object) -> object:
        if isinstance(value, list) and len(value) > count:
            raise_findings([Finding((), f"found a list of {len(value)}", f"at most {count} entries", "shorten it")])
        return value

    return BeforeValidator(check)


def _increasing(values: tuple[float, ...]) -> tuple[float, ...]:
    wrong = (
        Finding((i,), f"found entry {i + 1} = {b!r} after {a!r}", "", "sort the list, each value once")
        for i, (a, b) in enumerate(itertools.pairwise(values), 1)
        if b <= a
    )
    raise_findings(itertools.islice(wrong, 1))
    return values


def as_list(value: object) -> object:
    """A value alone, as the list of one that it stands for."""
    return value if isinstance(value, list | tuple) else [value]


# A TOML array is a list; the frozen models keep tuples, which strict mode would refuse to build from lists.
Label = Annotated[str, AfterValidator(_label)]
Labels = Annotated[tuple[Label, ...], Strict(False), AfterValidator(_distinct), at_most(MOST_LABELS)]
Positive = Annotated[float, Field(gt=0)]
Fraction = Annotated[float, Field(gt=0, le=1)]
Frequencies = Annotated[tuple[Positive, ...], Strict(False), AfterValidator(_increasing)]
Ratio = Annotated[float, Field(ge=0, lt=1)]
Ratios = Annotated[
    tuple[Ratio, ...], Strict(False), Field(min_length=1), BeforeValidator(as_list), at_most(MOST_RATIOS)
]


class Spec(BaseModel):
    """Frozen model that refuses unknown keys; subclasses add checks between keys in `_findings`."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)

    @pydantic.model_validator(mode="after")
    def _check(self) -> Self:
        raise_findings(self._beyond_limits())
        raise_findings(self._findings())
        return self

    def _beyond_limits(self) -> Iterator[Finding]:
        """Yield numbers that no machine has."""
        fields = type(self).model_fields
        for loc, value, limits in beyond(self.__dict__):
            what = str(fields[str(loc[0])].description).rstrip(".")
            expected = f"{what}, of a magnitude from {limit_text(limits.least)} to {limit_text(limits.most)}"
            yield Finding(loc, f"found {value!r}", expected, "correct the number or its unit")

    def _findings(self) -> Iterator[Finding]:
        """Yield what is wrong between keys that are each right by themselves."""
        yield from ()


def not_above(low: float, high: float, low_key: str, high_key: str, unit: str) -> Iterator[Finding]:
    """Yield that the upper of two bounds does not lie above the lower one."""
    if high <= low:
        found = f"found {high!r}, which is not above {low_key} = {low!r}"
        yield Finding((high_key,), found, f"a number greater than {low_key} {unit}".rstrip(), "correct one of the two")
