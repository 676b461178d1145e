"""An exponential window that a file states in words: how fast it decays."""

import math
import re

import numpy as np

from vibrecords.arrays import Array

#: What is said of an FRF, with the time constant in s.
WINDOW_NOTE = "exponential window of time constant {:.6g} s, as the file states: modes are without its damping"
_EXPONENTIAL = re.compile(r"\bexp(?:o\w*)?\b", re.IGNORECASE)
_WINDOW = re.compile(
    r"window|fenster|fen[êe]tre|weighting|wichtung|\btau\b|τ|time ?const|zeitkonst|decay", re.IGNORECASE
)
#: What is no window: none, and an average that forgets.
_OTHER = re.compile(
    r"\b(?:no|without|ohne|kein\w*|sans) expo\w*|averaging|expo\w*\s+(?:averag|mittel)"
    r"|(?:averag|mittel|moyenn)\w*(?: \w+)?\s*[:=]?\s*expo",
    re.IGNORECASE,
)
_N = r"(\d+(?:[.,]\d+)?(?:e[+-]?\d+)?)"
_TAU = re.compile(
    rf"(?:\btau\b|τ|time ?const\w*|decay time|zeitkonstante)[^\d;]{{0,20}}?{_N}\s*(ms|s)?\b", re.IGNORECASE
)
_RATE = re.compile(rf"{_N}\s*(?:1/s|/s\b|rad/s|s\^?-1|s⁻¹)", re.IGNORECASE)
_END = re.compile(
    rf"\bexp(?:(?!overlap)[^;]){{0,40}}?{_N}\s*%|\b(?:end|final|last)(?: value)?[\s:=]{{1,3}}(0[.,]\d+)", re.IGNORECASE
)


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
    parts = [part for part in re.split(r"[;\n]", text) if _WINDOW.search(part) and not _OTHER.search(part)]
    if not any(_EXPONENTIAL.search(part) for part in parts):
        return 0.0
    text = ";".join(parts)
    if tau := _TAU.search(text):
        in_ms = tau[2] == "ms" or re.search(r"[\[(]ms[\])]", tau[0])
        return 1 / max(_number(tau[1]) * (1e-3 if in_ms else 1.0), 1e-9)
    if rate := _RATE.search(text):
        return _number(rate[1])
    end = _END.search(text)
    left = 0.0 if end is None else _number(end[1]) / 100 if end[1] else _number(end[2])
    return -math.log(left) * float(np.median(np.diff(lines))) if 0 < left < 1 and lines.size > 1 else math.nan


def _number(text: str) -> float:
    return float(text.replace(",", "."))
