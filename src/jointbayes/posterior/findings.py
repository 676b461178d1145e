"""The table of findings on the fit: what is said where level and pattern of the residuals meet the noise model.

A row for each level of the residuals (far below, below, as expected, above the noise) and pattern (white, correlated
along frequency), with one finding; a column for what the noise model absorbs of a misfit, with one remedy.
"""

from dataclasses import dataclass
from typing import Literal

from jointbayes.inference.noise.base import Absorbed

Finding = Literal["explained", "misfit", "misfit below the noise", "noise overstated"]
ResidualLevel = Literal["far below", "below", "as expected", "above"]
ResidualPattern = Literal["white", "correlated"]


@dataclass(frozen=True, slots=True)
class FitCell:
    """One cell of the table.

    Parameters
    ----------
    finding
        As ``summary.json`` has it.
    remedy
        What helps; empty where nothing needs help.
    """

    finding: Finding
    remedy: str

    @property
    def head(self) -> str:
        """What the sentence opens with."""
        return _WORDS[self.finding][0]

    @property
    def consequence(self) -> str:
        """What it means for the intervals; empty where the model explains the data."""
        return _WORDS[self.finding][1]


#: Opening and consequence of each finding.
_WORDS: dict[Finding, tuple[str, str]] = {
    "explained": ("The model explains the data", ""),
    "misfit": ("The model does NOT explain the data", "Intervals based on it are too narrow."),
    "misfit below the noise": (
        "The model does NOT explain the data, though its error is smaller than the stated noise",
        "The stated noise is too large, which widens intervals, and the model's error may shift them.",
    ),
    "noise overstated": ("The stated noise is overstated", "The model explains the data; intervals are too wide."),
}

_INFER = '([noise] scale = "sampled")'
_SMALLER = f"State the noise as small as it is, or infer its size {_INFER}."
_LARGER = f"The residuals look like noise that is larger than stated: state it so, or infer its size {_INFER}."
_TAILS = (
    "The residuals are larger than Student-t noise allows: state the noise as large as it is, or infer its size "
    f"{_INFER}."
)
_BOUND = "The size of the noise that was inferred lies at a bound of its prior: widen it."
_ADMIT = "The residuals point to no single cause; [noise.discrepancy] allows for a model discrepancy."
_BOTH = f"Infer the size of the noise {_INFER}, and allow for a model discrepancy ([noise.discrepancy])."
_MORE = "The inferred discrepancy does not take it up: widen the prior of its length, or look for what the model lacks."
_SD_LARGER = "State their standard deviations as large as they are, or allow for [uncertain.mode_frequencies]."
_SD_SMALLER = "State their standard deviations as small as they are."

_COLUMNS: tuple[Absorbed, ...] = ("nothing", "outliers", "size", "discrepancy", "frequencies")
# fmt: off
_ROWS: dict[tuple[ResidualLevel, ResidualPattern], tuple[Finding, tuple[str, ...]]] = {
    # level and pattern              finding                    nothing   outliers  size    discrepancy  frequencies
    ("far below", "white"):        ("noise overstated",       (_SMALLER, _SMALLER, _BOUND, _SMALLER,    _SD_SMALLER)),
    ("far below", "correlated"):   ("noise overstated",       (_SMALLER, _SMALLER, _BOUND, _SMALLER)),
    ("below", "white"):            ("noise overstated",       (_SMALLER, _SMALLER, _BOUND, _SMALLER,    _SD_SMALLER)),
    ("below", "correlated"):       ("misfit below the noise", (_BOTH,    _BOTH,    _ADMIT, _MORE)),
    ("as expected", "white"):      ("explained",              ("",       "",       "",     "",          "")),
    ("as expected", "correlated"): ("misfit",                 (_ADMIT,   _ADMIT,   _ADMIT, _MORE)),
    ("above", "white"):            ("misfit",                 (_LARGER,  _TAILS,   _BOUND, _LARGER,     _SD_LARGER)),
    ("above", "correlated"):       ("misfit",                 (_ADMIT,   _ADMIT,   _ADMIT, _MORE)),
}
# fmt: on
#: The cell of each level, pattern and what the noise model absorbs; natural frequencies are too few for a pattern.
CELLS: dict[tuple[ResidualLevel, ResidualPattern, Absorbed], FitCell] = {
    (*row, column): FitCell(finding, remedy)
    for row, (finding, remedies) in _ROWS.items()
    for column, remedy in zip(_COLUMNS, remedies, strict=False)
}
