"""The names and words that readers know, whose table is names.toml; how numbers are written, and windows stated."""

import math
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

NAMES: dict[str, Any] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


def words_of(table: str) -> dict[str, frozenset[str]]:
    """Words of each key of a table."""
    return {key: frozenset(text.split()) for key, text in NAMES[table].items()}


def factors_of(table: dict[str, float]) -> dict[str, float]:
    """Factor of each name, of which several may stand in one key."""
    return {name: factor for names, factor in table.items() for name in names.split()}


#: A number of a text, with a decimal point or comma.
NUMBER = re.compile(r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.IGNORECASE)


def float_of(text: str) -> float | None:
    """Number of a text with a decimal point; None where it is none."""
    return float(text) if NUMBER.fullmatch(text) and "," not in text else None


#: Key of a layout that states what no file says.
RATE_KEY = 'sample_rate_hz = "1024" with your own rate in Hz'
#: What is said of an FRF, with the time constant in s.
WINDOW_NOTE = "exponential window of time constant {:.6g} s, as the file states: modes are without its damping"
_NUMBER = r"(\d+(?:[.,]\d+)?(?:e[+-]?\d+)?)"
_SAYS = {
    what: re.compile(words.replace("N", _NUMBER), re.IGNORECASE | re.VERBOSE) for what, words in NAMES["window"].items()
}


def stated_decay_rate(text: str, lines: NDArray[np.float64]) -> float:
    """Return a of the exponential window e^(−at) that a text states, 1/s: NaN where it says no number, 0 without one.

    Parameters
    ----------
    text
        What the file says of its windows: a time constant, a rate, or what is left at the end of a block.
    lines
        Frequency lines of the FRF, Hz; the block is one over their distance.

    Examples
    --------
    >>> stated_decay_rate("Windows of force and response: Exponential, tau = 0.25 s", np.arange(3.0))
    4.0
    """
    parts = [part for part in re.split(r"[;\n]", text) if _SAYS["any"].search(part) and not _SAYS["other"].search(part)]
    if not any(_SAYS["exponential"].search(part) for part in parts):
        return 0.0
    text = ";".join(parts)
    if tau := _SAYS["tau"].search(text):
        in_ms = tau[2] == "ms" or re.search(r"[\[(]ms[\])]", tau[0])
        return 1 / max(_number(tau[1]) * (1e-3 if in_ms else 1.0), 1e-9)
    if rate := _SAYS["rate"].search(text):
        return _number(rate[1])
    end = _SAYS["end"].search(text)
    left = 0.0 if end is None else _number(end[1]) / 100 if end[1] else _number(end[2])
    return -math.log(left) * float(np.median(np.diff(lines))) if 0 < left < 1 and lines.size > 1 else math.nan


def _number(text: str) -> float:
    return float(text.replace(",", "."))
