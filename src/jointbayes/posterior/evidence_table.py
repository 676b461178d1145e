"""Evidences of hypotheses about the same data in one table: which is the most probable, and by what odds.

References
----------
Kass, R. E., Raftery, A. E. (1995). Bayes factors. Journal of the American Statistical Association 90(430), 773-795,
section 3.2. DOI 10.1080/01621459.1995.10476572
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from scipy import special

Name = TypeVar("Name")
Group = TypeVar("Group")

#: Ends of 2 ln B, and evidence up to there in the words of Kass and Raftery.
GRADES = ((2.0, "not worth more than a bare mention"), (6.0, "positive"), (10.0, "strong"))
_STRONGEST = "very strong"
#: 2 ln B from which on evidence is strong, and from which on it is very strong.
STRONG, VERY_STRONG = GRADES[1][0], GRADES[2][0]
_POWER = 6  # of ten from which on odds are written as a power
_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


@dataclass(frozen=True, slots=True)
class EvidenceTable(Generic[Name]):
    """ln evidence of each hypothesis by its name, each as probable as the others before the data.

    Parameters
    ----------
    log_z
        ln of the probability of the data under each hypothesis.
    """

    log_z: Mapping[Name, float]

    @property
    def ranking(self) -> dict[Name, float]:
        """ln evidence by name, the best first."""
        return dict(sorted(self.log_z.items(), key=lambda item: -item[1]))

    @property
    def probabilities(self) -> dict[Name, float]:
        """Posterior probability by name.

        Examples
        --------
        >>> found = EvidenceTable({"a": math.log(3.0), "b": 0.0}).probabilities
        >>> {name: round(share, 3) for name, share in found.items()}
        {'a': 0.75, 'b': 0.25}
        """
        return dict(zip(self.log_z, special.softmax(np.array([*self.log_z.values()])).tolist(), strict=True))

    def two_log_b(self, name: Name, against: Name | None = None) -> float:
        """2 ln B of one hypothesis, by default the best, against another: `name` is the other."""
        better = max(self.log_z.values()) if against is None else self.log_z[against]
        return 2 * (better - self.log_z[name])

    def pooled(self, group: Callable[[Name], Group]) -> "EvidenceTable[Group]":
        """The table of groups of hypotheses, those in a group as probable as each other before the data."""
        each: dict[Group, list[float]] = {}
        for name, log_z in self.log_z.items():
            each.setdefault(group(name), []).append(log_z)
        return EvidenceTable({g: float(special.logsumexp(z)) - math.log(len(z)) for g, z in each.items()})


def bayes_factor_words(two_log_b: float) -> str:
    """Grade of the evidence for the better of two hypotheses, from 2 ln B, not negative.

    Examples
    --------
    >>> bayes_factor_words(0.6), bayes_factor_words(7.2)
    ('not worth more than a bare mention', 'strong')
    """
    return next((words for limit, words in GRADES if two_log_b <= limit), _STRONGEST)


def is_close(two_log_b: float) -> bool:
    """Whether evidence is not worth more than a bare mention."""
    return bayes_factor_words(two_log_b) == GRADES[0][1]


def odds(two_log_b: float) -> str:
    """Odds for the better of two hypotheses, from 2 ln B.

    Examples
    --------
    >>> odds(4.0), odds(55.0)
    ('7.4 to 1', '10¹² to 1')
    """
    power = two_log_b / (2 * math.log(10))
    if power >= _POWER:
        return f"10{f'{power:.0f}'.translate(_SUPERSCRIPTS)} to 1"
    ratio = float(f"{10**power:.2g}")
    return f"{ratio:.0f} to 1" if ratio >= 10 else f"{ratio:g} to 1"
