"""An exponential window that a file states in words: how fast it decays."""

import math
import re

import numpy as np

from vibrecords.arrays import Array
from vibrecords.formats.names import NAMES

#: What is said of an FRF, with the time constant in s.
WINDOW_NOTE = "exponential window of time constant {:.6g} s, as the file states: modes are without its damping"
_NUMBER = r"(\d+(?:[.,]\d+)?(?:e[+-]?\d+)?)"
_SAYS = {
    what: re.compile(words.replace("N", _NUMBER), re.IGNORECASE | re.VERBOSE) for what, words in NAMES["window"].items()
}


def stated_decay_rate(text: str, lines: Array) -> float:
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
