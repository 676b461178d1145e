"""The errors a user may see: each is one line that says where, what, what is expected and what to do."""

from __future__ import annotations

import difflib
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

from vibrecords.errors import MeasurementError as MeasurementError
from vibrecords.errors import UserError, printable
from vibrecords.errors import WriteError as WriteError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable


JointBayesError = UserError
"""Base of every error that a user's input can cause, also of those that vibrecords raises; one line of text."""


class CaseError(JointBayesError):
    """A case file cannot be read or asks for something that does not exist; one line for each fault."""

    def __str__(self) -> str:
        return printable(Exception.__str__(self), keep="\n")


class ModelError(JointBayesError):
    """A structure, joint or forward model is not physically or numerically possible."""


class SamplingError(JointBayesError):
    """The sampler was set up in a way that cannot give draws."""


class WorkerError(JointBayesError):
    """The processes that tasks are spread over cannot be had, or end one after the other."""


class ReportError(JointBayesError):
    """A report failed after its draws were made; the message names the file that holds them."""


class ReportInterruptedError(KeyboardInterrupt):
    """A report was interrupted after its draws were made; the message names the file that holds them."""


class TerminatedError(KeyboardInterrupt):
    """The program was asked to end by SIGTERM or SIGHUP."""


def similar(word: str, choices: Iterable[str]) -> str | None:
    """Return the choice a misspelt word was probably meant to be, or None."""
    by_lower = {choice.lower(): choice for choice in choices}
    close = difflib.get_close_matches(word.lower(), by_lower, 1, 0.6)
    return by_lower[close[0]] if close else None


def shown(given: object) -> str:
    """What a user gave, as a message names it: text, numbers and None as they are typed, all else by its kind."""
    return repr(given) if given is None or isinstance(given, str | bool | int | float) else type(given).__name__


def require(given: object, kind: Any, what: str, expected: str, within: Callable[[Any], bool] | None = None) -> None:  # noqa: ANN401
    """Refuse an argument that is of no such kind, or that `within` is not true of; True and False are no numbers.

    Parameters
    ----------
    given
        What a user gave.
    kind
        Type or union of types, as for `isinstance`.
    what
        Where it was given, before what was found.
    expected
        What is expected, and what to do.
    within
        What must be true of a value of this kind.

    Raises
    ------
    ModelError
        If it is something else: where, what, and what is expected.
    """
    if isinstance(given, bool) or not isinstance(given, kind) or (within is not None and not within(given)):
        raise ModelError(f"{what} {shown(given)}; expected {expected}")


def require_probability(given: object, where: str) -> None:
    """Refuse what is no probability inside (0, 1).

    Raises
    ------
    ModelError
        If it is none.
    """
    require(given, Real, f"{where}: found probability", "a number between 0 and 1, such as 0.95", lambda p: 0 < p < 1)


def require_count(given: object, what: str, least: int = 1) -> None:
    """Refuse what is no whole number, `least` or more.

    Raises
    ------
    ModelError
        If it is none.
    """
    require(given, Integral, what, f"a whole number, {least} or more; correct it", lambda count: count >= least)


#: What earlier versions had and this one has not, with what to do instead: keys of a case file by table and key,
#: commands by name, options as they are typed.
WENT = {
    "noise.discrepancy": "use [uncertain.model_error], an error of the model in each mode",
    "noise.model_error": "use [uncertain.model_error], an error of the model in each mode",
    "uncertain.mode_frequencies": "use [uncertain.model_error], an error of the model in each mode",
    "noise.residuals": "delete it, complex FRFs are compared; where the phase is not trusted state modes as data",
    "sampling.budget_s": "use max_evaluations, a number of evaluations, which ends a run in the same place everywhere",
    "sampling.processes": "delete it, a run is one process (campaign takes --workers)",
    "calibrate": "simulation-based calibration checks the program itself and is one of its tests",
    "hierarchical": "the posteriors of a campaign are files; a population of two numbers is a few lines with emcee",
    "plan": "delete the table, jointbayes plan chooses the measurements itself",
    "--assume": "leave it out, jointbayes plan ranks for what the present data say of the joint",
    "--out": "leave it out, the command prints its results; keep them with --json",
    "simulate": 'computed data stand in a case as kind = "synthetic_frf"',
    "level": "delete the table and the level of each test; with own = true the report has the ratios of tests",
    "Summary.to_json": "use .to_dict()",
    "Comparison.verdict": "use .finding",
    "plot_levels": 'draw posterior["tight.k22"] / posterior["loose.k22"]; the report has the ratios of tests',
    "Level": "leave it out; tests with joints of their own have ratios in the report",
    "assembly": "delete the table; with own = true each test has a joint of its own, to be compared in their ratio",
    "virtual_test": "delete the table, nothing is simulated from a case",
    "remove": "delete it; a table of another kind, law, shape, distribution or source replaces the inherited one",
    "--resume": "leave it out, a run takes seconds and begins again",
    "--draws": "leave it out: a campaign keeps all draws of each case",
    "--limit": "leave it out: end the worker of a case that takes too long, it is done again, the third time set aside",
    "--again": "leave it out: a campaign tries all cases again that are not done",
}


def went(owner: object, name: str) -> AttributeError:
    """Return the error of an attribute that an object lacks, with what to do where an earlier version had it."""
    instead = WENT.get(f"{type(owner).__name__}.{name}", "")
    return AttributeError(f"{type(owner).__name__} has no attribute {name!r}{instead and f': {instead}'}")
