"""Sentences that terminal, page, summary, cards and studies share: each is typed here, and nowhere else."""

from jointbayes.posterior.run_record import DO_NOT_USE

NOT_SETTLED = "the calculation has not settled"
#: How well material, dimensions and damping are known where nobody stated it.
WORKSHOP = "inputs as in a workshop"


def not_converged(reason: str) -> str:
    """What stands above numbers that are printed all the same, in a file or on the terminal."""
    return f"NOT CONVERGED, {DO_NOT_USE.upper()}: {reason}"


def taken_as_exact(names: str, count: int) -> str:
    """What numbers rest on, from names in a sentence and how many these are.

    Examples
    --------
    >>> taken_as_exact("density and length", 2)
    'density and length are taken as exact'
    """
    return f"{names} {'is' if count == 1 else 'are'} taken as exact"


def published_values(level: float, most: float = 0.95) -> str:
    """Whether published values lie in the region of a posterior, by the share of its draws that are likelier.

    Examples
    --------
    >>> published_values(0.0151)
    'agree with the data: 1.5 % of the draws are likelier'
    """
    agree = "agree" if level <= most else "do NOT agree"
    return f"{agree} with the data: {100 * level:.1f} % of the draws are likelier"
