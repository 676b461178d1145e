"""Thresholds of verdicts on stiffnesses."""

from dataclasses import dataclass

from jointbayes.errors import ModelError


@dataclass(frozen=True, slots=True)
class VerdictRule:
    """Thresholds by which a stiffness is judged; a case may set them, ``[verdict.k22]``.

    Parameters
    ----------
    identified, weakly_identified
        Largest upper over lower end of the 95 % interval of an identified and of a weakly identified stiffness.
    contraction
        Least share of the prior's variance of ln k that the data must remove: below it the prior speaks.
    nothing
        Share below which the data are said to say nothing.
    excluded
        Least share of the prior that a one-sided limit must exclude to be a statement about the data.

    Raises
    ------
    ModelError
        If the ratios are not above 1 and rising, or a share is not inside (0, 1).
    """

    identified: float = 1.25
    weakly_identified: float = 3.0
    contraction: float = 0.5
    nothing: float = 0.05
    excluded: float = 0.1

    #: Probability inside the interval, and of the one-sided limit; the same in all rules.
    INTERVAL = 0.95
    LIMIT = 0.975

    def __post_init__(self) -> None:
        shares = (self.contraction, self.nothing, self.excluded)
        if not (1 < self.identified <= self.weakly_identified and all(0 < share < 1 for share in shares)):
            expected = "1 < identified ≤ weakly_identified and shares inside (0, 1)"
            raise ModelError(f"verdict: found {self!r}; expected {expected}; correct them")

    def __str__(self) -> str:
        return (
            f"Identified (weakly): upper end of the 95 % interval at most {self.identified:g} "
            f"({self.weakly_identified:g}) times the lower end, and the variance of ln k at least "
            f"{100 * self.contraction:g} % less than the prior's"
        )


#: The default rule.
RULE = VerdictRule()
