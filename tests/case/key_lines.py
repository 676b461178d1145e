"""Which number of what is built each number of a case file names, and in which unit: ``key_lines.txt``."""

import math
import re
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np


def drawn(seed: float) -> float:
    """What a generator of a seed gives first."""
    return float(np.random.default_rng(int(seed)).random())


def count(top: float, low: float = 20.0, step: float = 5.0) -> float:
    """Lines of a band."""
    return math.floor((top - low) / step + 1e-9) + 1


#: What the formulas of the table know.
NAMES = {"mm": 1e-3, "gram": 1e-3, "gpa": 1e9, "percent": 1e-2, "decade": math.log(10) / 1.959963984540054,
         "log": math.log, "hypot": math.hypot, "drawn": drawn, "count": count}  # fmt: skip


def each_of(text: str) -> Iterator[str]:
    """The line once for each of what stands between <> in it, and for each of what stands between «»."""
    for group in (r"«([^«»]*)»", r"<([^<>]*)>"):
        if choices := re.findall(group, text):
            for number in range(choices[0].count("/") + 1):
                yield from each_of(re.sub(group, lambda found, at=number: found[1].split("/")[at], text))
            return
    yield text


def read_lines() -> Iterator[tuple[str, str, Callable[[float], float]]]:
    """Key, numbers and their value of each line of the table."""
    text = Path(__file__).with_suffix(".txt").read_text(encoding="utf-8")
    for word, said in reversed(re.findall(r"^(\$\w+\$) = (.*)$", text, re.MULTILINE)):
        text = text.replace(word, said)
    for line in text.splitlines():
        if ";;" in line and not line.startswith("#"):
            for one in each_of(line):
                key, numbers, *formula = one.split(" ;; ")
                yield key, numbers, eval(f"lambda x: {formula[0] if formula else 'x'}", NAMES)


KEYS = list(read_lines())


@cache
def expression(pattern: str) -> re.Pattern[str]:
    """A key of the schema, or of a line: ``*`` is one name or place, ``(a|b)`` one of these, ``(a)?`` a or nothing."""
    escaped = re.sub(r"\\([()|?])", r"\1", re.escape(pattern)).replace("(", "(?:")
    return re.compile(escaped.replace(r"\*", r"([^.,\[\]{}]+)"))
