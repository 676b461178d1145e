"""One rule for how numbers are rounded in a report."""

from collections.abc import Sequence

import numpy as np

from jointbayes.posterior.rounding import factor, number, rounded, rounded_interval

__all__ = ["contraction", "fixed", "factor", "interval", "number", "rounded", "rounded_interval"]


def contraction(value: float | None, decimals: int) -> str:
    """Share of the prior's variance that the data removed; "none" where the posterior is as wide as the prior or wider.

    Examples
    --------
    >>> contraction(0.98765, 4), contraction(-4.1, 4)
    ('0.9877', 'none')
    """
    return "none" if value is not None and value <= 0 else fixed(value, decimals)


def fixed(value: float | None, decimals: int) -> str:
    """Format with so many decimals; a dash where the number does not exist, as the effective size of a short run."""
    return "–" if value is None or not np.isfinite(value) else f"{value:.{decimals}f}"


def interval(ends: Sequence[float], digits: int = 3) -> str:
    """Format the ends of an interval."""
    return f"{number(ends[0], digits)} … {number(ends[1], digits)}"
