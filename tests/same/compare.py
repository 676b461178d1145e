"""What differs between what is kept of a case and what is found: number by number, sentence by sentence."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import SequenceMatcher
from itertools import zip_longest
from typing import Any

from tests.same.record import NUMBER, Record, number

_DIGITS = 5
_HASH = re.compile(r"\b[0-9a-f]{16,64}\b")
#: Draws of another arithmetic are other draws: an end of an interval may lie off by this share of the interval's width,
#: or by so many Monte Carlo errors, as the summary states them.
_WIDTHS, _ERRORS = 0.2, 6.0
#: Which moves were made, and which starts reached the mode, is theirs as well.
_WALK = ("sampler", "starts")
#: And this share of a report's sentences may have other words; verdicts, classes and keys may not.
_SENTENCES = 0.05
_ABSENT = object()


@dataclass(frozen=True)
class Difference:
    """Where, what was kept and found there, and whether it is the words of a sentence."""

    where: str
    kept: str
    found: str
    words: bool = False

    def __str__(self) -> str:
        return f"{self.where}: kept {self.kept}, found {self.found}"


def other_arithmetic(kept: Record, found: Record) -> str:
    """What computed the two differs in this; empty if in nothing, so that draws must be the same to the last bit."""
    pairs = ((name, kept["made_with"].get(name, "–"), here) for name, here in found["made_with"].items())
    return "; ".join(f"{name} {there}, here {here}" for name, there, here in pairs if there != here)


def differences(kept: Record, found: Record) -> list[Difference]:
    """All of them. By another arithmetic only words, verdicts and intervals of the stiffnesses are compared.

    Of runs so short one may have settled by one arithmetic and not by the other, and a run that has not has no verdict:
    then intervals alone are compared.
    """
    exact = not other_arithmetic(kept, found)
    if not exact and kept["summary"]["converged"] != found["summary"]["converged"]:
        return [*_intervals(kept["summary"], found["summary"])]
    hashes = _values("draws_sha256", kept["draws_sha256"], found["draws_sha256"], exact=True) if exact else ()
    summaries = _values("summary", kept["summary"], found["summary"], exact=exact)
    intervals = () if exact else _intervals(kept["summary"], found["summary"])
    return [*hashes, *summaries, *intervals, *_reports(kept["report"], found["report"], exact=exact)]


def judged(kept: Record, found: Record) -> tuple[list[Difference], list[Difference]]:
    """What differs, and what may: by another arithmetic a few sentences whose words hang on a threshold."""
    named = differences(kept, found)
    sentences = [each for each in named if each.words] if other_arithmetic(kept, found) else []
    if len(sentences) > _SENTENCES * len(kept["report"]):
        sentences = []
    return [each for each in named if each not in sentences], sentences


def _values(where: str, kept: Any, found: Any, *, exact: bool) -> Iterator[Difference]:
    """Of two parts of a summary."""
    match kept, found:
        case dict(), dict():
            for key in {**kept, **found}:
                if key in _WALK and not exact:
                    continue
                yield from _values(f"{where}.{key}", kept.get(key, _ABSENT), found.get(key, _ABSENT), exact=exact)
        case list(), list():
            for i, pair in enumerate(zip_longest(kept, found, fillvalue=_ABSENT)):
                yield from _values(f"{where}[{i}]", *pair, exact=exact)
        case str(), str():
            yield from _texts(where, kept, found, exact=exact)
        case (bool(), _) | (_, bool()):
            if kept is not found:
                yield _difference(where, kept, found)
        case (int() | float(), int() | float()):
            if exact and not near(kept, found):
                yield _difference(where, kept, found)
        case _ if kept is not found:
            yield _difference(where, kept, found)


def _difference(where: str, kept: Any, found: Any) -> Difference:
    return Difference(where, *("nothing" if value is _ABSENT else repr(value) for value in (kept, found)))


def near(kept: float, found: float) -> bool:
    """Whether two numbers differ by no more than one in the fifth digit: rounding may have parted them."""
    largest = max(abs(kept), abs(found))
    return kept == found or abs(kept - found) < 1.5 * 10.0 ** (math.floor(math.log10(largest)) + 1 - _DIGITS)


def masked(text: str, *, exact: bool = True) -> str:
    """The text with # in the place of each number and, where data may differ in their last bits, of their hash."""
    return NUMBER.sub("#", text if exact else _HASH.sub("#", text))


def _texts(where: str, kept: str, found: str, *, exact: bool) -> Iterator[Difference]:
    """Of two texts: the whole where words differ, else number by number."""
    if masked(kept, exact=exact) != masked(found, exact=exact):
        yield Difference(where, repr(kept), repr(found), words=not where.endswith(".verdict"))
    elif exact:
        for one, other in zip(NUMBER.findall(kept), NUMBER.findall(found), strict=True):
            if not near(number(one), number(other)):
                yield Difference(where if where.startswith("summary") else f"{where} {found!r}", one, other)


def _reports(kept: Sequence[str], found: Sequence[str], *, exact: bool) -> Iterator[Difference]:
    """Of the sentences of two reports, matched by their words."""
    words = [[masked(text, exact=exact) for text in texts] for texts in (kept, found)]
    matcher = SequenceMatcher(None, *words, autojunk=False)
    for kind, i, i_end, j, j_end in matcher.get_opcodes():
        for one, other in zip_longest(kept[i:i_end], found[j:j_end]):
            if kind == "equal":
                yield from _texts("report", one, other, exact=exact)
            else:
                there, here = ("nothing" if text is None else repr(text) for text in (one, other))
                yield Difference("report", there, here, words=True)


def _intervals(kept: Mapping[str, Any], found: Mapping[str, Any]) -> Iterator[Difference]:
    """Medians and ends of intervals that lie farther apart than draws of two arithmetics do."""
    for name in kept["parameters"].keys() & found["parameters"].keys():
        one, other = kept["parameters"][name], found["parameters"][name]
        low, high = one["interval95"]
        for key in ("median", "interval95"):
            # the error of a median is less than that of an end
            errors = [
                each["interval95_error"] if key == "interval95" else max(each["interval95_error"])
                for each in (one, other)
            ]
            ends = (one[key], errors[0], other[key], errors[1])
            for there, its_error, here, error in zip(*map(_listed, ends), strict=True):
                if abs(there - here) > max(_WIDTHS * (high - low), _ERRORS * math.hypot(its_error, error)):
                    yield _difference(f"summary.parameters.{name}.{key} (draws of two arithmetics)", there, here)


def _listed(value: Any) -> list[float]:
    return value if isinstance(value, list) else [value]
