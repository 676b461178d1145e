"""Why a verdict is what it is, as data, and one table that puts each reason into words for every surface."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from jointbayes.rounding import factor, number, percent, quantity_text, with_interval

NO_VERDICT_NO_USE = "do not use a number without a verdict"
#: How well material, dimensions and damping are known if the case does not state it.
WORKSHOP = "inputs as in a workshop"
#: What is said in place of a verdict where the model does not explain the data, and what sentences open with there.
NO_VALID_VALUE = "no valid value, as the model does not fit the data"
IF_MODEL_RIGHT = "if the model fitted the data"


class Reason(Enum):
    """Why a stiffness has its verdict; the value is its code in ``summary.json``."""

    SPAN = "span"
    ZERO = "contains_zero"
    NOTHING = "test_says_nothing"
    LITTLE = "test_says_little"
    OPEN = "one_end_open"
    OPEN_BOTH = "both_ends_open"
    EXCLUDES_LITTLE = "excludes_little"
    SOLUTIONS = "several_solutions"
    TEST_ALONE = "test_alone"
    BODIES = "noise_of_bodies_ignored"
    NOT_CONVERGED = "not_converged"
    HOLDS_UNSETTLED = "not_converged_but_certain"
    BEST_FIT_MISSED = "best_fit_missed"
    BEST_FITS_APART = "best_fits_apart"
    MISFIT = "misfit"
    PATTERN = "misfit_along_frequency"
    NO_MODEL = "no_model_of_this_structure"
    MESH = "mesh"
    AT_BOUND = "draws_at_bound"


@dataclass(frozen=True, slots=True)
class Because:
    """A reason with its numbers; `str` gives the sentence, without full stop.

    Examples
    --------
    >>> str(Because(Reason.SPAN, {"ratio": 4.8, "most": 3.0}))
    'its interval spans a factor of 4.8 (limit 3)'
    """

    reason: Reason
    numbers: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # what comes from a file has lists where it had tuples
        object.__setattr__(self, "numbers", {key: _without_lists(value) for key, value in self.numbers.items()})

    def __str__(self) -> str:
        return PHRASES[self.reason](self.numbers)

    def as_json(self) -> dict[str, Any]:
        """What an entry of ``reasons`` of ``summary.json`` holds."""
        return {"code": self.reason.value, **self.numbers, "text": str(self)}


def _without_lists(value: object) -> object:
    return tuple(map(_without_lists, value)) if isinstance(value, list | tuple) else value


def _of(n: Mapping[str, Any], key: str) -> str:
    return quantity_text(n[key], n["unit"])


def _bound(n: Mapping[str, Any]) -> str:
    what = "the end of the default range" if n["default"] else f"the prior's {n['side']} bound"
    return f"{what} {_of(n, 'bound')}"


def _solutions(n: Mapping[str, Any]) -> str:
    """Each solution's value and probability; of a row without draws of each solution only that there are several."""
    each = " or ".join(f"{value} with probability {share:.2f}" for value, share in n["solutions"])
    return f"{counted(len(n['solutions']))} solutions: {each}" if each else "several solutions"


def _test_alone(n: Mapping[str, Any]) -> str:
    """Ends of the likelihood, None where it leaves an end open, and where the prior decides."""
    low, high = n["likelihood95"]
    if low is not None and high is not None:
        alone = with_interval((low, high), n["unit"])
    elif low is not None or high is not None:
        alone = f"{'above' if high is None else 'below'} {quantity_text(low if high is None else high, n['unit'])}"
    else:
        alone = "no limit"
    return f"the test alone: {alone}; {n['prior']}"


#: What is said of each reason, from its numbers.
PHRASES: Mapping[Reason, Callable[[Mapping[str, Any]], str]] = {
    Reason.SPAN: lambda n: f"its interval spans a factor of {factor(n['ratio'])} (limit {n['most']:g})",
    Reason.ZERO: lambda _: "its interval contains zero",
    Reason.NOTHING: lambda _: "the test says nothing about it",
    Reason.LITTLE: lambda n: (
        f"the test removes {percent(n['removed'])} of the prior's variance ({percent(n['needed'])} is needed)"
    ),
    Reason.OPEN: lambda n: f"the test sets no {n['side']} limit before {_bound(n)}",
    Reason.OPEN_BOTH: lambda n: f"the test sets no limit between {_of(n, 'lower')} and {_of(n, 'upper')} of the prior",
    Reason.EXCLUDES_LITTLE: lambda n: f"the data exclude less than {percent(n['least'])} of the prior",
    Reason.SOLUTIONS: _solutions,
    Reason.TEST_ALONE: _test_alone,
    Reason.BODIES: lambda n: f"{n['noise']} is ignored, so that the interval is too narrow",
    Reason.NOT_CONVERGED: lambda _: "the calculation has not converged, and its error could change the verdict",
    Reason.HOLDS_UNSETTLED: lambda _: "the calculation has not converged, but its error cannot change the verdict",
    Reason.BEST_FIT_MISSED: lambda n: (
        f"the search missed the best fit: a draw leads to a better one, {n['gain']:.3g} higher in log density"
    ),
    Reason.BEST_FITS_APART: lambda n: (
        f"draws and search lead to best fits {n['distance_sd']:.2g} standard deviations apart; "
        f"the fit from the draws is {n['loss']:.3g} lower in log density"
    ),
    Reason.MISFIT: lambda n: f"the model misses the measured data by {number(n['times'], 2)} times their noise",
    Reason.PATTERN: lambda _: "the model misses the measured data in a pattern along frequency",
    Reason.NO_MODEL: lambda n: f"the model does not describe this structure: {' and '.join(n['findings'])}",
    Reason.MESH: lambda n: f"a finer mesh moves it by {n['shift_sd']:.2g} posterior standard deviations",
    Reason.AT_BOUND: lambda n: f"its draws reach {_bound(n)}",
}


_COUNTS = {2: "two", 3: "three", 4: "four", 5: "five", 6: "six"}


def counted(count: int) -> str:
    """A small number in words."""
    return _COUNTS.get(count, str(count))


def not_converged(reason: str, what: str = "do not use these numbers") -> str:
    """What stands above numbers that are printed all the same, in a file or on the terminal."""
    return f"NOT CONVERGED, {what.upper()}: {reason}"


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


def listed(names: Sequence[str], last: str = "and") -> str:
    """Names in a sentence: ``"density, length and gain"``."""
    readable = [name.replace("youngs", "Young's").replace("_", " ") for name in names]
    return "".join(readable) if len(readable) < 2 else f"{', '.join(readable[:-1])} {last} {readable[-1]}"
